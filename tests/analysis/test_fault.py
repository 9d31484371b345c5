"""Fault on crashes built by hand, on their mirror images, and against the rules written out as plain loops."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from crashes_by_hand import DT, LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored, motion
from hypothesis import given
from hypothesis import strategies as st
from reference.recorded import recordings_of_all

from cornerforge.analysis.fault import FAULT_COLUMNS, FAULTS, RULES, Duties, Faults, RssRules, assign_fault
from cornerforge.analysis.pair import pair_motion
from cornerforge.errors import InputError
from cornerforge.recordings import Recordings, recordings_of
from cornerforge.types import Crash, Scenario

Pair = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
NONE, NO_BRAKING, SPED_UP, BRAKED_HARD, MOVED_IN, DID_NOT_STOP = range(6)


class Expected(NamedTuple):
    fault: str
    av: int
    bv: int
    longitudinal: bool


CUT_IN = Turn(1.0, 3.0, MIDDLE)
CASES: dict[str, tuple[Callable[[], Scenario], Expected]] = {
    "AV rear-ends a braking lead": (
        lambda: crash(Car(0, MIDDLE, 25), Car(35, MIDDLE, 25, ((1.0, -4.0),))),
        Expected("av", NO_BRAKING, NONE, True),
    ),
    "AV brakes too weakly behind a braking lead": (
        lambda: crash(Car(0, MIDDLE, 25, ((1.5, -2.0),)), Car(35, MIDDLE, 25, ((1.0, -4.0),))),
        Expected("av", NO_BRAKING, NONE, True),
    ),
    "AV speeds up behind a lead": (
        lambda: crash(Car(0, MIDDLE, 25, ((0.0, 3.0),)), Car(60, MIDDLE, 25)),
        Expected("av", SPED_UP, NONE, True),
    ),
    "BV rear-ends an AV that drives on": (
        lambda: crash(Car(120, MIDDLE, 20), Car(0, MIDDLE, 30)),
        Expected("bv", NONE, NO_BRAKING, True),
    ),
    "AV brakes for no reason, BV responds as hard as it can": (
        lambda: crash(Car(65, MIDDLE, 30, ((1.0, -8.0),)), Car(0, MIDDLE, 30, ((2.0, -4.0),))),
        Expected("av", BRAKED_HARD, NONE, True),
    ),
    "AV brakes for no reason, BV does not respond": (
        lambda: crash(Car(65, MIDDLE, 30, ((1.0, -8.0),)), Car(0, MIDDLE, 30)),
        Expected("both", BRAKED_HARD, NO_BRAKING, True),
    ),
    "AV brakes as hard as it may, BV responds as hard as it can": (
        lambda: crash(Car(50, MIDDLE, 30, ((1.0, -6.0),)), Car(0, MIDDLE, 30, ((2.0, -4.0),))),
        Expected("none", NONE, NONE, True),
    ),
    "BV tailgates from the start, AV brakes gently": (
        lambda: crash(Car(12, MIDDLE, 25, ((3.0, -2.0),)), Car(0, MIDDLE, 25)),
        Expected("bv", NONE, NO_BRAKING, True),
    ),
    # The paper's Figure 9 A and D: the AV runs straight, the BV comes into its side.
    "BV moves into the AV's side": (
        lambda: crash(Car(0, MIDDLE, 25), Car(1, RIGHT, 25, (), (CUT_IN,))),
        Expected("bv", NONE, MOVED_IN, False),
    ),
    "AV moves into the BV's side": (
        lambda: crash(Car(0, RIGHT, 25, (), (CUT_IN,)), Car(1, MIDDLE, 25)),
        Expected("av", MOVED_IN, NONE, False),
    ),
    # Figure 9 E and 11 A, "aggressive cut-in": the AV strikes the rear of who has just changed lanes.
    "BV cuts in right before a faster AV": (
        lambda: crash(Car(0, MIDDLE, 30), Car(28, RIGHT, 20, (), (CUT_IN,))),
        Expected("bv", NONE, MOVED_IN, False),
    ),
    "BV cuts in right before an AV that brakes in vain": (
        lambda: crash(Car(0, MIDDLE, 30, ((2.0, -4.0),)), Car(24, RIGHT, 18, (), (CUT_IN,))),
        Expected("bv", NONE, MOVED_IN, False),
    ),
    "BV cuts in far ahead, the AV drives on": (
        lambda: crash(Car(0, MIDDLE, 30), Car(150, RIGHT, 24, (), (CUT_IN,))),
        Expected("av", NO_BRAKING, NONE, True),
    ),
    "AV cuts in right before a faster BV": (
        lambda: crash(Car(28, RIGHT, 20, (), (CUT_IN,)), Car(0, MIDDLE, 30)),
        Expected("av", MOVED_IN, NONE, False),
    ),
    # Figure 9 B: cut off by one BV, the AV escapes in front of another one, which strikes its rear.
    "AV evades one BV and cuts off another": (
        lambda: crash(
            Car(0, MIDDLE, 28, (), (Turn(2.0, 2.5, LEFT),)),
            Car(-45, LEFT, 34),
            Car(26, RIGHT, 24, (), (CUT_IN,)),
        ),
        Expected("av", MOVED_IN, NONE, False),
    ),
    # Figure 9 C, 11 B to D, "lane conflict": both change at the same time and meet in the middle lane.
    "both enter one gap at once": (
        lambda: crash(Car(0, RIGHT, 25, (), (CUT_IN,)), Car(2, LEFT, 25, (), (CUT_IN,))),
        Expected("both", MOVED_IN, MOVED_IN, False),
    ),
    "both enter one gap at once and meet later, front to rear": (
        lambda: crash(Car(0, RIGHT, 28, (), (CUT_IN,)), Car(9, LEFT, 26, (), (CUT_IN,))),
        Expected("both", MOVED_IN, MOVED_IN, False),
    ),
    "BV drifts slowly into the AV": (
        lambda: crash(Car(0, MIDDLE, 25), Car(0, RIGHT, 25, (), (Turn(0.0, 40.0, 30.0),))),
        Expected("bv", NONE, DID_NOT_STOP, False),
    ),
    "cut off, the AV steers round the BV's other side": (
        lambda: crash(Car(0, MIDDLE, 32, (), (Turn(4.4, 2.5, RIGHT),)), Car(60, RIGHT, 22, (), (CUT_IN,))),
        Expected("bv", NONE, MOVED_IN, False),
    ),
}


def verdict(faults: Faults, row: int = 0) -> Expected:
    return Expected(
        FAULTS[faults.fault[row]], int(faults.av_rule[row]), int(faults.bv_rule[row]), bool(faults.longitudinal[row])
    )


@pytest.mark.parametrize("name", CASES)
def test_crashes_built_by_hand_and_their_mirror_images(name: str) -> None:
    build, expected = CASES[name]
    scenario = build()
    for image in (scenario, mirrored(scenario)):
        contact = pair_motion(recordings_of_all([image]))
        assert max(contact.free_along[0, -1], contact.free_across[0, -1]) < 0.0
        faults = assign_fault(recordings_of_all([image]))
        assert verdict(faults) == expected
        # Both rules hold only where both distances were unsafe from the start.
        assert faults.lateral[0] == (not expected.longitudinal or "from the start" in name)
        assert bool(faults.from_start[0]) == ("from the start" in name)
        broken = [rule for rule in expected[1:3] if rule]
        assert int(faults.rule[0]) in (broken or [NONE])


def test_every_verdict_and_rule_is_built_by_hand() -> None:
    assert {expected.fault for _, expected in CASES.values()} == set(FAULTS)
    of_roads = RULES.index("light: passed the stop line on red")
    assert {rule for _, expected in CASES.values() for rule in expected[1:3]} == set(range(of_roads))


def test_times_by_hand() -> None:
    # Gap 30 m, both at 25 m/s, the lead brakes with 4 m/s2 from 1 s on. After t more seconds the gap is 30 - 2 t^2 and
    # the safe one 12.5 + 0.25 + 26^2 / 8 - (25 - 4 t)^2 / 8 = 19.125 + 25 t - 2 t^2: safe until t = 0.435, so the last
    # safe frame is at 1.4 s, the AV must brake at 1.9 s, and at 30 = 2 t^2, t = 3.87, it hits: frame 4.9 s.
    faults = assign_fault(recordings_of_all([CASES["AV rear-ends a braking lead"][0]()]))
    assert faults.blame_s.tolist() == [3.5]
    assert faults.violation_s.tolist() == faults.av_violation_s.tolist() == [3.0]
    assert np.isnan(faults.bv_violation_s).all()
    assert faults.av_behind.tolist() == [True]


def test_the_first_of_two_violations_is_named() -> None:
    faults = assign_fault(recordings_of_all([CASES["AV brakes for no reason, BV does not respond"][0]()]))
    assert faults.av_violation_s[0] > faults.bv_violation_s[0]  # longer before contact
    assert faults.violation_s[0] == faults.av_violation_s[0]
    assert faults.rule[0] == BRAKED_HARD


def test_a_cut_in_is_the_followers_fault_exactly_from_the_safe_distance_on() -> None:
    # AV 30, BV 25 m/s: safe at 15.25 + 31^2 / 8 - 25^2 / 8 = 57.25 m. When the lateral distance gets unsafe, 1.3 s from
    # the start at the latest, the AV has come 6.5 m nearer.
    near, far = (
        assign_fault(recordings_of_all([crash(Car(0, MIDDLE, 30), Car(gap + 5.0, RIGHT, 25, (), (CUT_IN,)))]))
        for gap in (57.25 - 1.0, 57.25 + 11.0)
    )
    assert verdict(near) == Expected("bv", NONE, MOVED_IN, False)
    assert verdict(far) == Expected("av", NO_BRAKING, NONE, True)


def test_by_the_papers_letter_who_steers_round_the_intruder_shares_the_fault() -> None:
    recordings = recordings_of_all([CASES["cut off, the AV steers round the BV's other side"][0]()])
    letter = assign_fault(recordings, RssRules(free_evasion=False))
    assert verdict(letter) == Expected("both", MOVED_IN, MOVED_IN, False)
    assert letter.rule[0] == MOVED_IN
    assert letter.violation_s[0] == letter.bv_violation_s[0] > letter.av_violation_s[0]


def test_other_numbers_give_other_verdicts() -> None:
    recordings = recordings_of_all([CASES["AV brakes for no reason, BV does not respond"][0]()])
    lenient = replace(RssRules(), av=Duties(0.5, 2.0, 4.0, 8.0, 8.0))
    assert verdict(assign_fault(recordings, lenient)) == Expected("bv", NONE, NO_BRAKING, True)
    with pytest.raises(InputError, match=r"duties\.min_braking = 0\.0"):
        Duties(0.5, 2.0, 0.0, 8.0, 8.0)
    with pytest.raises(InputError, match=r"rules\.lateral_margin"):
        RssRules(lateral_margin=2.0)


def test_a_batch_is_its_cases_one_by_one() -> None:
    scenarios = [replace(build(), test=k) for k, (build, _) in enumerate(CASES.values())]
    batch = assign_fault(recordings_of_all(scenarios))
    assert [verdict(batch, row) for row in range(len(scenarios))] == [expected for _, expected in CASES.values()]
    for row, scenario in enumerate(scenarios):
        one = assign_fault(recordings_of_all([scenario]))
        for name in ("violation_s", "av_violation_s", "bv_violation_s", "blame_s", "rule"):
            assert np.array_equal(getattr(one, name), getattr(batch, name)[row : row + 1], equal_nan=True)
    assert sum(batch.counts().values()) == sum(batch.rule_counts().values()) == len(scenarios)
    assert batch.counts()["bv"] == sum(expected.fault == "bv" for _, expected in CASES.values())


# --- the rules as plain loops -----------------------------------------------------------------------------------------


def plain_fault(x: np.ndarray, y: np.ndarray, v: np.ndarray, h: np.ndarray) -> tuple[str, int, int, int]:
    """Fault, blame frame, and each one's rule, from (T, 2) arrays: docs/adr/0015-fault.md, frame by frame."""
    response, gain, limit, hardest = (0.5, 1.0), 2.0, (4.0, 6.0), (6.0, 4.0)
    duty = (4.0, 4.0)
    last = len(x) - 1

    def covered(t: int, along: float, across: float) -> float:
        return sum(0.5 * (along * abs(math.cos(a)) + across * abs(math.sin(a))) for a in h[t])

    def sideways(t: int) -> list[float]:
        a, b = max(0, t - 1), min(last, t + 1)
        return [(y[b, i] - y[a, i]) / ((b - a) * DT) if b > a else 0.0 for i in (0, 1)]

    def longitudinal_safe(t: int) -> bool:
        behind = 0 if x[t, 1] > x[t, 0] else 1
        vr, vf, rho = v[t, behind], v[t, 1 - behind], response[behind]
        top = vr + rho * gain
        need = vr * rho + 0.5 * gain * rho**2 + top**2 / (2 * limit[behind]) - vf**2 / (2 * hardest[1 - behind])
        return bool(abs(x[t, 1] - x[t, 0]) - covered(t, 5.0, 2.0) >= max(0.0, need))

    def lateral_safe(t: int) -> bool:
        side = math.copysign(1.0, y[t, 1] - y[t, 0]) if y[t, 1] != y[t, 0] else 0.0
        way = 0.0
        for i, w in enumerate(sideways(t)):
            w = w * side * (1 if i == 0 else -1)
            after = w + response[i] * 0.2
            way += 0.5 * (w + after) * response[i] + after * abs(after) / 1.6
        return bool(abs(y[t, 1] - y[t, 0]) - covered(t, 2.0, 5.0) >= 0.1 + max(0.0, way))

    safe = [[t for t in range(last) if is_safe(t)] for is_safe in (longitudinal_safe, lateral_safe)]
    since = [frames[-1] if frames else -1 for frames in safe]
    blame = max(*since, 0)
    behind = 0 if x[blame, 1] > x[blame, 0] else 1
    rules = []
    for i in (0, 1):
        to_other = float(np.sign(y[blame, 1 - i] - y[blame, i]))
        moving_ever = True
        found = NONE
        speed = [0.0] + [(y[t, i] - y[t - 1, i]) / DT * to_other for t in range(1, last + 1)]
        for t in range(blame, last):
            moving_ever = moving_ever and speed[t] > 0.05
            if t == blame or found:
                continue
            responding = t - blame < round(response[i] / DT)
            pull = (v[t + 1, i] - v[t, i]) / DT
            if since[0] >= since[1]:
                if i == behind and not responding and v[t + 1, i] > 0.05 and pull > 0.05 - duty[i]:
                    found = NO_BRAKING
                elif i == behind and responding and pull > gain + 0.05:
                    found = SPED_UP
                elif i != behind and pull < -hardest[i] - 0.05:
                    found = BRAKED_HARD
            if not found and since[1] >= since[0]:
                beside = abs(y[t, 1] - y[t, 0]) >= covered(t, 2.0, 5.0)
                change = (speed[t + 1] - speed[t]) / DT
                starts = change > 0.25 if responding else speed[t] <= 0.05 < speed[t + 1]
                goes_on = speed[t] > 0.05 and speed[t + 1] > 0.05 and change > 0.05 - 0.8
                if beside and starts:
                    found = MOVED_IN
                elif (beside or moving_ever) and not responding and goes_on:
                    found = DID_NOT_STOP
        rules.append(found)
    name = {(False, False): "none", (True, False): "av", (False, True): "bv", (True, True): "both"}
    return name[bool(rules[0]), bool(rules[1])], blame, rules[0], rules[1]


def random_pair(rng: np.random.Generator) -> Pair:
    """x, y, speed, heading, (T, 2) each: two vehicles that drive at random, up to where they are nearest.

    They need not touch: what a recording ends with counts as the contact.
    """
    cars = []
    for _ in range(2):
        pulls = tuple((t, float(rng.choice([-8.0, -4.0, 0.0, 1.0, 3.0]))) for t in (0.0, rng.uniform(0.0, 6.0)))
        lanes = rng.choice([RIGHT, MIDDLE, LEFT], 3, p=[0.2, 0.6, 0.2])
        turns = tuple(
            Turn(3.0 * k + rng.uniform(0.0, 1.0), rng.uniform(0.8, 2.0), float(lanes[k + 1])) for k in range(2)
        )
        begin = float(lanes[0])
        if rng.uniform() < 0.3:  # some drift at a steady speed: they are in the middle of a very long lane change
            half = rng.uniform(-15.0, 15.0)
            begin, turns = begin - half, (Turn(-20.0, 40.0, begin + half),)
        cars.append(Car(rng.uniform(0.0, 60.0), begin, rng.uniform(5.0, 35.0), pulls, turns))
    series = [motion(car, 6.0) for car in cars]
    x, y, v, h = (np.stack([one[k] for one in series], axis=-1) for k in range(4))
    apart = np.maximum(np.abs(x[:, 1] - x[:, 0]) / 5.0, np.abs(y[:, 1] - y[:, 0]) / 2.0)
    frames = int(apart.argmin()) + 1
    return x[:frames], y[:frames], v[:frames], h[:frames]


pairs = st.builds(lambda seed: random_pair(np.random.default_rng(seed)), st.integers(0, 2**32 - 1))


def recorded(*all_pairs: Pair) -> Recordings:
    n = len(all_pairs)
    flat = [np.concatenate([pair[k].T.ravel() for pair in all_pairs]) for k in range(4)]
    frames = np.array([len(pair[0]) for pair in all_pairs])
    return Recordings(
        seed=np.zeros(n, np.int64),
        test=np.arange(n),
        frames=frames,
        vehicles=np.full(n, 2),
        at=2 * (np.cumsum(frames) - frames),
        vehicle_at=2 * np.arange(n),
        last=frames - 1,
        partner=np.ones(n, np.int64),
        slot=np.tile(np.arange(2, dtype=np.int16), n),
        kind=np.zeros(2 * n, np.int8),
        length=np.full(2 * n, 5.0),
        width=np.full(2 * n, 2.0),
        change_time=np.full(2 * n, 4.0),
        x=flat[0],
        y=flat[1],
        speed=flat[2],
        heading=flat[3],
        acceleration=np.zeros(flat[0].size),
        target_lane=np.ones(flat[0].size, np.int8),
        present=np.ones(flat[0].size, np.bool_),
    )


@given(st.lists(pairs, min_size=1, max_size=4))
def test_arrays_equal_the_rules_as_plain_loops(all_pairs: list[Pair]) -> None:
    faults = assign_fault(recorded(*all_pairs))
    for row, pair in enumerate(all_pairs):
        fault, blame, av, bv = plain_fault(*pair)
        assert (FAULTS[faults.fault[row]], int(faults.av_rule[row]), int(faults.bv_rule[row])) == (fault, av, bv)
        assert faults.blame_s[row] == pytest.approx((len(pair[0]) - 1 - blame) * DT)


def test_random_pairs_reach_every_verdict_and_rule(seed: int) -> None:
    # So what the tests beside this one compare is not always the same trivial verdict. Of 2000 pairs the rarest rule
    # takes about 1 %: that none of 2000 shows it has a chance of 2e-9.
    rng = np.random.default_rng(seed)
    faults = assign_fault(recorded(*(random_pair(rng) for _ in range(2000))))
    assert min(faults.counts().values()) > 0
    of_roads = RULES[: RULES.index("light: passed the stop line on red")]
    assert min(faults.rule_counts()[rule] for rule in of_roads) > 0
    assert 0 < faults.from_start.sum() < 2000


@given(pairs, st.floats(-200.0, 200.0))
def test_mirror_and_translation_change_nothing(pair: Pair, shift: float) -> None:
    x, y, v, h = pair
    original = assign_fault(recorded(pair))
    # Images differ in the last bit at most; no random pair meets a threshold that closely.
    for image in ((x, 12.0 - y, v, -h), (x + math.ldexp(round(shift), -2), y, v, h)):
        other = assign_fault(recorded(image))
        for name in Faults.__dataclass_fields__:
            one, two = getattr(original, name), getattr(other, name)
            assert one == two if name == "case_ids" else np.array_equal(one, two, equal_nan=name.endswith("_s"))


# --- recordings -------------------------------------------------------------------------------------------------------


def test_frames_before_the_partner_was_there_are_left_out() -> None:
    scenario = CASES["BV rear-ends an AV that drives on"][0]()
    present = scenario.present.copy()
    present[:20, 1] = False
    holes: dict[str, Any] = {
        name: np.where(present, getattr(scenario, name), np.nan) for name in ("x", "y", "speed", "heading")
    }
    faults = assign_fault(recordings_of_all([replace(scenario, present=present, **holes)]))
    assert verdict(faults) == Expected("bv", NONE, NO_BRAKING, True)
    assert faults.blame_s[0] <= (len(present) - 1 - 20) * DT


def test_a_crash_in_the_first_frame_is_nobodys_fault_that_we_could_know() -> None:
    faults = assign_fault(recordings_of_all([crash(Car(0, MIDDLE, 25), Car(4, MIDDLE, 20))]))
    assert FAULTS[faults.fault[0]] == "none"
    assert faults.from_start.tolist() == [True]
    assert faults.blame_s.tolist() == [0.0]


def test_columns_are_documented_and_say_what_the_arrays_say() -> None:
    scenarios = [replace(build(), test=k) for k, (build, _) in enumerate(CASES.values())]
    faults = assign_fault(recordings_of_all(scenarios))
    columns = faults.columns()
    assert list(columns) == [column.name for column in FAULT_COLUMNS]
    kinds = {"string": "U", "float64": "f", "bool": "b"}
    assert all(columns[column.name].dtype.kind == kinds[column.type] for column in FAULT_COLUMNS)
    assert columns["fault"].tolist() == [expected.fault for _, expected in CASES.values()]
    assert columns["fault_rule"].tolist() == [RULES[code] for code in faults.rule]
    row = list(CASES).index("BV tailgates from the start, AV brakes gently")
    assert (columns["blame_axis"][row], columns["blame_from_start"][row]) == ("both", True)
    assert set(columns["blame_axis"]) == {"longitudinal", "lateral", "both"}


def test_no_cases_no_faults() -> None:
    recordings = recordings_of_all([CASES["both enter one gap at once"][0]()])
    nothing = Recordings._make(values[:0] for values in recordings)
    assert assign_fault(nothing).counts() == dict.fromkeys(FAULTS, 0)


def test_bad_recordings_are_named() -> None:
    scenario = CASES["both enter one gap at once"][0]()
    with pytest.raises(InputError, match="Test 3:0 holds no crash of the AV"):
        recordings_of_all([replace(scenario, crash=None)])
    for end in (Crash(99.0, 0, 1), Crash(1.0, 0, 7)):
        message = rf"contact with slot {end.slot_b} at {end.time} s is not in the recording of \d+ frames"
        with pytest.raises(InputError, match=message):
            recordings_of_all([replace(scenario, crash=end)])
    gone = scenario.present.copy()
    gone[-1, 1] = False
    with pytest.raises(InputError, match="Case 3:0: the AV or its crash partner is absent at the contact"):
        assign_fault(recordings_of(scenario)._replace(present=gone.T.ravel()))
    x = scenario.x.copy()
    x[3, 0] = np.nan
    with pytest.raises(InputError, match="Case 3:0: x of the AV or its crash partner is not finite"):
        assign_fault(recordings_of_all([replace(scenario, x=x)]))
