"""Lane changes from trajectories: seconds at risk by hand, the simulator's own chances, known drivers found again."""

from __future__ import annotations

import math
import runpy
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.drivers.naturalistic import accept_chance, lane_change_base, tables_of
from cornerforge.errors import UnknownNameError
from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.lane_fit import (
    FEWEST_CHANGES,
    WIDTHS,
    change_chances,
    fit_lane_changes,
    maximise,
    told_by_data,
)
from cornerforge.ext.calibrate.lane_risk import SecondsAtRisk, joined_seconds, seconds_at_risk
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.ndd import default_model_path, fit_model, load_model, model_hash, read_decisions
from cornerforge.results import NddFitted
from cornerforge.results.naturalistic import FittedLaneNumber

HEADER = "scenario,veh_id,lane,t_s,s_m,length_m"
ALARM_SD = 4.9
"""A normal variable is farther off with a chance of 1e-6."""


def read(path: Path, rows: Sequence[str]) -> Reading:
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of lengths: some scenes have none that is usual
        [reading] = read_decisions([path], "tracks")
    return reading


def at_risk(path: Path, rows: Sequence[str]) -> SecondsAtRisk:
    found = seconds_at_risk(read(path, rows))
    assert found is not None
    return found


def car(
    name: int, start: float, speed: float, lanes: Mapping[float, int], length: float = 5.0, per_second: int = 10
) -> list[str]:
    """20 s from `start`; `lanes`: from which time on it is in which lane."""
    rows = []
    for tick in range(20 * per_second + 1):
        t = tick / per_second
        lane = [number for since, number in lanes.items() if t >= since - 1e-9][-1]
        rows.append(f"1,{name},{lane},{t:.2f},{start + speed * t:.4f},{length}")
    return rows


def frame() -> list[str]:
    """Two fast vehicles that make a stretch of two lanes, -500 to 600 m."""
    return [*car(8, -500.0, 55.0, {0.0: 1}), *car(9, -500.0, 55.0, {0.0: 2})]


# Seconds at risk


def test_seconds_at_risk_by_hand(tmp_path: Path) -> None:
    """Vehicle 1 enters lane 2 at 10 s, so it began at 7.6 s; then vehicle 2 is 36 m ahead there, 3 is 26 m behind."""
    rows = [
        *car(1, 0.0, 25.0, {0.0: 1, 10.0: 2}),
        *car(2, 36.0 - 7.6 * 2.0, 27.0, {0.0: 2}, 7.0),
        *car(3, -26.0 + 7.6 * 3.0, 22.0, {0.0: 2}),
        *car(4, 60.0 + 7.6, 24.0, {0.0: 1}),
        *car(5, -500.0, 25.0, {0.0: 1}),
        *car(6, -500.0, 25.0, {0.0: 2}),
        *car(7, 900.0, 25.0, {0.0: 1}),
        *car(8, 900.0, 25.0, {0.0: 2}),
    ]
    found = at_risk(tmp_path / "t.csv", rows)
    change = found.changed
    assert found.changes == 1
    assert found.vehicle[change].tolist() == [0]
    for name, wanted in (
        ("speed", 25.0), ("own_gap", 55.0), ("own_rate", -1.0), ("lead_gap", 30.0), ("lead_rate", 2.0),
        ("rear_gap", 21.0), ("rear_rate", 3.0),
    ):  # fmt: skip
        np.testing.assert_allclose(getattr(found, name)[change], wanted, atol=0.01, err_msg=name)
    # Seconds 2 to 6 before (up to 1 s vehicle 3 is beside it or less than 2 m behind; 7 is within a second of the
    # start, so it is that second), and 13 to 17 after: what begins later than 17.1 s would not be seen for 2.9 s.
    assert int((found.vehicle == 0).sum()) == 5 + 1 + 5
    assert found.changes_left_out == {}


def test_a_second_counts_once_for_each_lane_beside(tmp_path: Path) -> None:
    """Vehicle 1 has 18 seconds, but at 13 to 15 s the fast ones are too near behind it."""
    two = [*frame(), *car(1, 100.0, 15.0, {0.0: 2})]
    found = at_risk(tmp_path / "t.csv", two)
    assert int((found.vehicle == 0).sum()) == 15
    found = at_risk(tmp_path / "t.csv", [*two, *car(10, -500.0, 55.0, {0.0: 3})])
    assert int((found.vehicle == 0).sum()) == 2 * 15
    assert found.changes == 0


@pytest.mark.parametrize(
    ("start", "speed", "kept"), [(15.0, 17.0, 0), (26.0, 17.0, 1), (11.0, 22.0, 1), (9.0, 20.0, 0)]
)
def test_gaps_that_drivers_turn_back_for_are_left_out(start: float, speed: float, kept: int, tmp_path: Path) -> None:
    """Gap and closing speed at the change: 10 m and 3, 21 m and 3, 6 m and -2, 4 m and 0; critical a second later."""
    rows = [*frame(), *car(1, 200.0, 20.0, {0.0: 1, 10.0: 2}), *car(2, 352.0 + start - 7.6 * speed, speed, {0.0: 2})]
    found = at_risk(tmp_path / "t.csv", rows)
    assert found.changes == kept
    reason = "a gap for which drivers turn back, so that a change would not be seen"
    assert found.changes_left_out.get(reason, 0) == 1 - kept


def test_nobody_in_sight_is_no_neighbour_and_an_end_of_the_stretch_leaves_it_open(tmp_path: Path) -> None:
    rows = [*frame(), *car(1, 100.0, 20.0, {0.0: 1, 10.0: 2})]
    found = at_risk(tmp_path / "t.csv", rows)
    change = found.changed
    assert np.isinf(found.lead_gap[change]).all()
    assert (found.lead_rate[change] == 0.0).all()
    short = [*car(1, 0.0, 5.0, {0.0: 1, 10.0: 2}), *car(2, -10.0, 6.0, {0.0: 2}), *car(3, 60.0, 5.0, {0.0: 1})]
    found = at_risk(tmp_path / "u.csv", short)
    assert found.changes == 0
    assert found.changes_left_out == {next(iter(found.changes_left_out)): 1}
    assert "recorded stretch" in next(iter(found.changes_left_out))


def test_lengths_are_counted_out_by_reason(tmp_path: Path) -> None:
    for length in (1.5, 30.0):
        rows = [*frame(), *car(1, 200.0, 20.0, {0.0: 1, 10.0: 2}, length)]
        found = at_risk(tmp_path / "t.csv", rows)
        assert found.changes == 0
        [(reason, changes)] = found.changes_left_out.items()
        assert (reason, changes) == ("a vehicle is shorter than 2 m or longer than 25 m", 1)
        assert found.left_out[reason] > 10
    dropped = read(tmp_path / "t.csv", [*frame(), *car(1, 200.0, 20.0, {0.0: 1}, 0.5)])
    assert dropped.table.bad.reasons["length_m outside 1 to 40 m"] == (201, 404)


def test_two_rates_in_one_file_are_counted_out(tmp_path: Path) -> None:
    """Most vehicles have 10 rows a second; the one with 4 is left out, with the line at which it begins."""
    rows = [*frame(), *car(1, 200.0, 20.0, {0.0: 1, 10.0: 2}, per_second=4), *car(2, 0.0, 20.0, {0.0: 1, 9.0: 2})]
    reading = read(tmp_path / "t.csv", rows)
    reason = "t_s has another step than the file's 0.1 s (give files of one frame rate each)"
    assert reading.table.bad.reasons[reason] == (81, 404)
    found = seconds_at_risk(reading)
    assert found is not None
    assert found.changes == 1
    assert set(found.vehicle.tolist()) <= {0, 1, 2}  # numbers of 2, 8 and 9
    assert int((found.vehicle == 0).sum()) > 0


def test_two_files_may_have_two_rates(tmp_path: Path) -> None:
    rows = [*frame(), *car(1, 200.0, 20.0, {0.0: 1, 10.0: 2})]
    ten = read(tmp_path / "ten.csv", rows)
    five = read(tmp_path / "five.csv", [row for row in rows if round(10.0 * float(row.split(",")[3])) % 2 == 0])
    (_, told), (_, one) = fit_lane_changes([ten, five]), fit_lane_changes([ten])
    assert (five.table.rows_read, one.changes) == (303, 1)
    assert (told.changes, told.vehicles) == (2, 2 * one.vehicles)
    assert abs(told.seconds - 2 * one.seconds) <= 2  # at the borders of gaps


def test_changes_that_cannot_be_used_are_counted_out(tmp_path: Path) -> None:
    rows = [
        *frame(),
        *car(1, 100.0, 20.0, {0.0: 1, 1.0: 2}),
        *car(2, 300.0, 20.0, {0.0: 1, 9.0: 2, 12.0: 1}),
        *car(3, 500.0, 20.0, {0.0: 1, 10.0: 3}),
    ]
    found = at_risk(tmp_path / "t.csv", rows)
    assert found.changes == 1
    assert sorted(found.changes_left_out.values()) == [1, 2]


def test_a_neighbour_that_changes_lanes_counts_in_both(tmp_path: Path) -> None:
    """Vehicle 2, 30 m ahead in lane 3, crosses into lane 2 at 10 s: then it is in both, at 9 s in lane 3 only.

    At 15 s a fast vehicle is between them in each lane; at 12 to 14 s it is too near behind.
    """
    rows = [
        *frame(), *car(10, -500.0, 55.0, {0.0: 3}), *car(11, -500.0, 55.0, {0.0: 4}),
        *car(1, 0.0, 20.0, {0.0: 2}), *car(2, 35.0, 20.0, {0.0: 3, 10.0: 2}),
    ]  # fmt: skip
    found = at_risk(tmp_path / "t.csv", rows)
    mine = found.vehicle == 0
    own = np.isclose(found.own_gap[mine], 30.0, atol=0.01)
    assert int(own.sum()) == 2 * 4  # 10 to 17 s to two sides, but for 12 to 15 s
    assert int(np.isclose(found.lead_gap[mine], 30.0, atol=0.01).sum()) == 11  # 0 to 10 s, to lane 3


def test_vehicles_seen_late_are_held_out(tmp_path: Path) -> None:
    """Of highD the last fifth: vehicle 2 is first seen after 36 of 40 s."""
    rows = [
        f"{tick},{name},{2.0 * tick + 60.0 * lane:.1f},{3.5 * lane},5.0,2.0,{lane}"
        for name, lane, first in ((1, 1, 0), (2, 1, 900), (3, 2, 0))
        for tick in range(first, 1000)
    ]
    path = tmp_path / "01_tracks.csv"
    path.write_text("\n".join(["frame,id,x,y,width,height,laneId", *rows]) + "\n")
    [reading] = read_decisions([path], "highd")
    found = seconds_at_risk(reading)
    assert found is not None
    assert set(found.vehicle.tolist()) == {0, 2}


# The likelihood


def random_seconds(n: int, seed: int) -> SecondsAtRisk:
    rng = np.random.default_rng(seed)

    def gaps() -> np.ndarray:
        return np.where(rng.random(n) < 0.2, np.inf, rng.uniform(-10.0, 140.0, n))

    def rates(gap: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(gap), rng.normal(0.0, 6.0, n), 0.0)

    own, lead, rear = gaps(), gaps(), gaps()
    return SecondsAtRisk(
        np.arange(n), np.zeros(n, dtype=bool), rng.uniform(15.0, 40.0, n), own, rates(own), lead, rates(lead), rear,
        rates(rear), {}, {},
    )  # fmt: skip


def test_the_chances_are_those_of_the_simulator() -> None:
    """Against its kernels; they round the tables to 10 bits, and what 999 of 1000 accept to 1."""
    seconds = random_seconds(3000, 1)
    model = load_model(default_model_path())
    tables = tables_of(model)
    wanted = []
    for k in range(seconds.size):
        chance = lane_change_base(tables, seconds.speed[k], seconds.own_gap[k], seconds.own_rate[k])
        for rear, gap, rate in (
            (0, seconds.lead_gap[k], seconds.lead_rate[k]), (1, seconds.rear_gap[k], seconds.rear_rate[k]),
        ):  # fmt: skip
            chance *= model.overlook + (1.0 - model.overlook) * accept_chance(tables.lc_accept, rear, gap, rate)
        wanted.append(chance)
    np.testing.assert_allclose(change_chances(LaneChange(), seconds), wanted, rtol=5e-3, atol=1e-12)


def drawn(seconds: SecondsAtRisk, law: LaneChange, seed: int) -> SecondsAtRisk:
    chance = change_chances(law, seconds)
    return replace(seconds, changed=np.random.default_rng(seed).random(seconds.size) < chance)


@pytest.mark.full
def test_few_changes_move_little_and_many_tell(seed: int) -> None:
    law = replace(LaneChange(), rate=0.05, rear_standstill=12.0)
    seconds = random_seconds(200_000, seed)
    many = drawn(seconds, law, seed + 1)
    _, numbers = maximise(many)
    for name, number in numbers.items():
        assert number.prior == getattr(LaneChange(), name)
        assert abs(off(number, getattr(law, name))) < ALARM_SD * spread(number), name
        assert told_by_data(number), name
    one = joined_seconds([many, many])
    assert (one.size, one.changes) == (2 * many.size, 2 * many.changes)
    assert np.unique(one.vehicle).size == 2 * seconds.size
    no_change = replace(seconds, changed=np.zeros(seconds.size, dtype=bool))
    few = {name: getattr(no_change, name)[:20] for name in vars(no_change) if not name.endswith("left_out")}
    _, numbers = maximise(SecondsAtRisk(**few, left_out={}, changes_left_out={}))
    for name, number in numbers.items():
        assert abs(off(number, number.prior)) < 0.25 * WIDTHS[name], name
        assert spread(number) == pytest.approx(WIDTHS[name], rel=0.1), name
        assert not told_by_data(number), name


def off(number: FittedLaneNumber, truth: float) -> float:
    return math.log(number.estimate / truth)


def spread(number: FittedLaneNumber) -> float:
    low, high = number.interval95
    return math.log(high / low) / (2 * 1.959964)


# Known drivers, driven and recorded


TRUTH = replace(LaneChange(), rate=0.030, rear_standstill=12.0)
"""Twice the shipped rate, half the shipped gap behind."""
BIAS = dict.fromkeys(WIDTHS, 0.1) | {"lead_standstill": 0.05, "rear_standstill": 0.08, "rear_doubt": 0.11}
"""What a recording hides, on a logarithmic scale (ADR 25): who gave way, who was about to enter, when a change began.
Measured in 22,211 changes: -0.07 and +0.11 for the last two."""
HIGHD_LIKE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "highd_like.py"))


def highd_folder(folder: Path, law: LaneChange, worlds: int, seed: int) -> list[Path]:
    """Record drivers of `law`, otherwise as shipped, as the tutorial does: 62 s, 5 frames a second, a file a world."""
    moved = replace(
        load_model(default_model_path()),
        lc_base=law.base().astype(np.float32), lc_desire=law.desire().astype(np.float32),
        lc_accept_lead=law.accept_lead().astype(np.float32), lc_accept_rear=law.accept_rear().astype(np.float32),
    )  # fmt: skip
    with warnings.catch_warnings():
        # In some seeds a lane is so dense for a second; what that changes is far below all spreads here.
        warnings.filterwarnings("ignore", message="More than 32 vehicles, or 256 sets of them")
        return [Path(path) for path in HIGHD_LIKE["write_folder"](folder, moved, worlds, seed)]


def recorded_seconds(paths: Sequence[Path]) -> SecondsAtRisk:
    parts = [seconds_at_risk(reading) for reading in read_decisions(paths, "highd")]
    return joined_seconds([part for part in parts if part is not None])


def score(law: LaneChange, seconds: SecondsAtRisk) -> np.ndarray:
    chance = change_chances(law, seconds)
    return np.where(seconds.changed, np.log(np.maximum(chance, 1e-300)), np.log1p(-chance))


def is_found(name: str, number: FittedLaneNumber) -> bool:
    """Within chance and `BIAS` of `TRUTH`; what is hidden makes the doubt ahead smaller, never larger."""
    by, chance = off(number, getattr(TRUTH, name)), ALARM_SD * spread(number)
    return -chance - BIAS[name] < by < chance + (0.0 if name == "lead_doubt" else BIAS[name])


@pytest.mark.slow
def test_drivers_of_the_simulator_are_found_again(tmp_path: Path, seed: int) -> None:
    """The unit is a second at risk; the spread of each estimate comes from about 1,700 changes."""
    paths = highd_folder(tmp_path, TRUTH, 24, seed)
    seconds = recorded_seconds(paths)
    assert seconds.changes > 1300
    assert sum(seconds.changes_left_out.values()) < 0.03 * seconds.changes
    _, numbers = maximise(seconds)
    for name, number in numbers.items():
        assert is_found(name, number), name
    for name in ("rate", "rear_standstill"):  # the control: what the model ships is found to be wrong
        low, high = numbers[name].interval95
        assert not low <= getattr(LaneChange(), name) <= high, name
    # The other control: changes dealt out to seconds at random are not of these drivers.
    dealt = replace(seconds, changed=np.random.default_rng(seed).permutation(seconds.changed))
    _, numbers = maximise(dealt)
    assert not is_found("near", numbers["near"])
    assert not is_found("rear_doubt", numbers["rear_doubt"])


@pytest.mark.full
def test_unseen_recordings_are_likelier_under_the_fit_than_under_the_prior(tmp_path: Path, seed: int) -> None:
    """Measured: 100 nats more, standard deviation 16, for 700 changes; the truth itself is within 9 nats of the fit."""
    paths = highd_folder(tmp_path, TRUTH, 24, seed)
    law, _ = maximise(recorded_seconds(paths[:12]))
    unseen = recorded_seconds(paths[12:])
    gain = score(law, unseen) - score(LaneChange(), unseen)
    assert gain.sum() > 0.0
    assert gain.sum() > 3.0 * gain.std() * math.sqrt(gain.size)
    assert abs((score(law, unseen) - score(TRUTH, unseen)).sum()) < 30.0
    # The control: a fit to changes dealt out at random loses against the truth.
    dealt = recorded_seconds(paths[:12])
    wrong, _ = maximise(replace(dealt, changed=np.random.default_rng(seed).permutation(dealt.changed)))
    assert (score(wrong, unseen) - score(TRUTH, unseen)).sum() < -30.0


@pytest.mark.slow
def test_intervals_hold_the_truth_about_as_often_as_they_say(tmp_path: Path, seed: int) -> None:
    """40 recordings of about 550 changes: 0.90 to 1.00 were measured; 25 of 40 has a chance below 1e-6 at 0.9."""
    held = dict.fromkeys(WIDTHS, 0)
    prior_held = 0
    for k in range(40):
        _, numbers = maximise(recorded_seconds(highd_folder(tmp_path, TRUTH, 8, seed + k)))
        for name, number in numbers.items():
            held[name] += number.interval95[0] <= getattr(TRUTH, name) <= number.interval95[1]
        prior_held += numbers["rate"].interval95[0] <= LaneChange().rate <= numbers["rate"].interval95[1]
    assert min(held.values()) > 25, held
    assert prior_held == 0


# The whole fit


def source_of(result: NddFitted, part: str) -> tuple[str, str]:
    [found] = [(one.source, one.why) for one in result.parts if one.name == part]
    return found


def many_changes(changes: int) -> list[str]:
    """Vehicles of 20 m/s, 20 m apart, of which so many change lanes at 10 s."""
    return [*frame(), *(row for k in range(changes) for row in car(100 + k, 20.0 * k, 20.0, {0.0: 1, 10.0: 2}))]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two files with 20 changes each."""
    folder = tmp_path_factory.mktemp("lanes")
    return [read(folder / f"{name}.csv", many_changes(20) + more).path for name, more in (("a", []), ("b", [""]))]


@pytest.mark.full
def test_a_fit_says_what_it_found_and_is_the_same_again(recorded: list[Path], tmp_path: Path) -> None:
    result = cornerforge.ndd_fit(recorded, out=tmp_path / "m.npz")
    told = result.lane_changes
    assert told.fitted
    assert told.why == ""
    assert told.changes >= FEWEST_CHANGES
    assert set(told.numbers) == set(WIDTHS)
    rate = told.numbers["rate"]
    assert rate.interval95[0] < rate.estimate < rate.interval95[1]
    assert (rate.prior, rate.unit) == (LaneChange().rate, "1/s")
    assert any(note.startswith(f"Lane changes: fitted to {told.changes} changes in") for note in result.notes)
    model = load_model(tmp_path / "m.npz")
    assert model.lc_base[0] == pytest.approx(rate.estimate, rel=1e-3)
    stated = model.provenance["lane_change"]
    assert stated["rear_standstill"] == told.numbers["rear_standstill"].estimate  # type: ignore[index]
    page = (tmp_path / "m.report.html").read_text(encoding="utf-8")
    assert "95 % of the prior" in page
    assert source_of(result, "lane changes")[0] == source_of(result, "gap acceptance")[0] == "fitted in part"
    again, _ = fit_model(recorded[::-1], "tracks")
    assert model_hash(again) == result.model_hash


@pytest.mark.full
def test_the_prior_can_be_kept(recorded: list[Path], tmp_path: Path) -> None:
    result = cornerforge.ndd_fit(recorded, out=tmp_path / "m.npz", lane_changes="prior")
    model, shipped = load_model(tmp_path / "m.npz"), load_model(default_model_path())
    for name in ("lc_base", "lc_desire", "lc_accept_lead", "lc_accept_rear", "lc_turn_back"):
        np.testing.assert_array_equal(getattr(model, name), getattr(shipped, name))
    assert model.provenance["lane_change"] == shipped.provenance["lane_change"]
    assert "lane_change_fit" not in model.provenance
    assert not result.lane_changes.fitted
    assert source_of(result, "lane changes") == ("prior", "That was asked for.")
    with pytest.raises(UnknownNameError, match="lane changes"):
        cornerforge.ndd_fit(recorded, out=tmp_path / "n.npz", lane_changes="pior")


def test_without_enough_changes_the_prior_stays_and_the_reason_is_told(tmp_path: Path) -> None:
    law, told = fit_lane_changes([read(tmp_path / "few.csv", many_changes(FEWEST_CHANGES - 1))])
    assert (told.fitted, told.changes, law) == (False, FEWEST_CHANGES - 1, LaneChange())
    assert told.why == "29 lane change(s) can be used, and at least 30 are needed"
    assert fit_lane_changes([read(tmp_path / "enough.csv", many_changes(FEWEST_CHANGES))])[1].fitted
    _, alone = fit_lane_changes([read(tmp_path / "alone.csv", car(1, 0.0, 20.0, {0.0: 1}))])
    assert (alone.seconds, alone.speed_median) == (0, None)
    assert "nobody was seen for long enough with a lane beside its own" in alone.why


@pytest.mark.full
def test_files_without_lanes_keep_the_prior(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    rows = [f"{f},999,{t}.0,25.0,25.0,40.0" for f in range(4) for t in range(20)]
    path.write_text("\n".join(["follower,leader,t_s,v_mps,vl_mps,gap_m", *rows]) + "\n", encoding="utf-8")
    result = cornerforge.ndd_fit([path], out=tmp_path / "m.npz")
    for part in ("lane changes", "gap acceptance"):
        assert source_of(result, part) == ("prior", "No file gives the lane of each row.")
    assert result.lane_changes.numbers == {}
