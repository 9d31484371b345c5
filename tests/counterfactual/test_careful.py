"""Reference drivers in the AV's place: against the same drive with objects of its own, and closed forms."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from reference.avoid import Traffic
from reference.crashes import ODD, Mover, crash, random_crash, scenario_of
from reference.shapes import Box
from reference.world import Vehicle

from cornerforge.analysis.avoidability import AvoidParams
from cornerforge.analysis.prevented import PREVENTED_COLUMNS, Prevention, driven_by, prevented_by
from cornerforge.drivers.careful import CAREFUL, Threat, braking_demanded, braking_of, own_reaction
from cornerforge.types import Scenario

PARAMS = AvoidParams(horizon_s=1.2)


def touches(a: Vehicle, b: Vehicle, margin: float) -> bool:
    one, other = (Box(v.x, v.y, v.heading, v.length + margin, v.width + margin) for v in (a, b))
    return one.overlaps(other)


def survives(traffic: Traffic, moment: int, driver: str, margin: float) -> bool:
    """Drive it with objects; all boxes are longer and wider by a margin [m]."""
    me = copy(traffic.rows[moment][0])
    me.hold(0.0, ODD)
    at_once = driver == "reg157"
    since, end = None, traffic.last + 12
    for f in range(moment, end):
        demanded = 0.0
        for other in traffic.rows[f][1:]:
            ahead, across = other.x - me.x, other.y - me.y
            if ahead > 0.0:
                drift = other.speed * np.tan(other.heading) - me.speed * np.tan(me.heading)
                length, aside = 0.5 * (me.length + other.length), abs(across) - 0.5 * (me.width + other.width)
                t = Threat(ahead - length, ahead + length, aside, -drift * np.sign(across), other.speed)
                demanded = max(demanded, braking_demanded(CAREFUL[driver], me.speed, me.acceleration, t))
        if demanded > 0.0 and since is None:
            since = f
        held = 0.0
        if since is not None:
            held = braking_of(
                CAREFUL[driver], 0.1 * (f - since), demanded, me.acceleration, 0.1, own_reaction(CAREFUL[driver])
            )
        if at_once:
            me.acceleration = held
        me.hold(held, ODD)
        me.move(ODD)
        if any(touches(me, other, margin) for other in traffic.rows[f + 1][1:]):
            return False
    ahead_of_me = [i for i, other in enumerate(traffic.rows[end]) if i > 0 and other.x > me.x]
    me.hold(-8.0, ODD)
    for row in traffic.rows[end + 1 :]:
        me.move(ODD)
        if any(touches(me, row[i], margin) for i in ahead_of_me):
            return False
        if me.speed == 0.0:
            break
    return True


def test_they_drive_as_objects_do() -> None:
    rng = np.random.default_rng(20_260_103)
    found = [traffic for traffic in (random_crash(rng) for _ in range(300)) if traffic is not None]
    seen, held = {True: 0, False: 0}, {True: 0, False: 0}
    for traffic in found:
        scenario = scenario_of(traffic)
        if traffic.rows[0][0].target_lane != traffic.rows[-1][0].target_lane:
            continue  # the objects' AV would go on with a change that it begins later
        begin = traffic.last - begin_of(scenario)
        for driver, said in prevented_by(scenario, PARAMS).items():
            assert said.by_holding == said.prevented or said.reacts_s is not None
            held[said.by_holding] += 1
            seen[said.prevented] += 1
            if said.prevented:
                assert survives(traffic, begin, driver, -0.05)
            else:
                assert not survives(traffic, begin, driver, 0.05)
    assert min(seen.values()) >= 20
    assert held[False] > 0


def begin_of(scenario: object) -> int:
    from cornerforge.analysis.avoidability import avoidability

    return round(10 * avoidability(scenario, PARAMS).manoeuvre_s)  # type: ignore[arg-type]


def test_before_a_standing_car_each_brakes_from_where_it_sees_danger() -> None:
    """From 12 m/s `cc-human` has 24 m, drives 9.6 m before it brakes, and needs 9.5 m and 3.6 m for the ramp.

    `reg157` has 17.05 m at the first step at which its TTC is below 1.45 s, drives 4.8 m in its reaction, and needs 12.
    """
    said = prevented_by(crash(Mover(400.75, 1, 12.0), Mover(520.0, 1, 0.0), frames=150))
    assert {name: one.prevented for name, one in said.items()} == dict.fromkeys(CAREFUL, True)
    assert said["cc-human"].braking_mps2 == pytest.approx(0.774 * 9.81)
    assert not said["cc-human"].by_holding
    assert said["reg157"].braking_mps2 == pytest.approx(6.0)
    assert 0.0 < said["cc-human"].least_ttc_s < 2.0
    late, early = said["cc-human"].reacts_s, said["fsm"].reacts_s
    assert late is not None
    assert early is not None
    assert early > late, "it sees danger earlier"
    # cc-human at 30 m/s: 60 m at 2 s, of which 22 m go by before it brakes, and 900 / 15.2 = 59 m are needed
    fast = prevented_by(crash(Mover(300.0, 1, 30.0), Mover(520.0, 1, 0.0)))
    assert not fast["cc-human"].prevented
    assert fast["fsm"].prevented


def late_braking() -> tuple[Scenario, float]:
    """The AV nears a car that drives 8 m/s more slowly, which begins to brake softly 0.6 s before the contact.

    Returns:
        The crash, and when the soft braking begins, before the contact [s].
    """
    scenario = crash(Mover(300.0, 1, 30.0), Mover(345.0, 1, 22.0))
    assert scenario.crash is not None
    soft = scenario.acceleration.copy()
    soft[round(10 * scenario.crash.time) - 6 :, 1] = -1.2
    return replace(scenario, acceleration=soft), 0.6


def test_who_nears_another_is_there_before_that_one_brakes() -> None:
    """At 0.6 s before the contact it is too late for all; a careful driver would have seen the slower car long ago."""
    scenario, begin = late_braking()
    said = driven_by(scenario)
    assert begin_of(scenario) == round(10 * begin)
    assert {name: one.prevented.prevented for name, one in said.items()} == dict.fromkeys(CAREFUL, True)
    # 40 m between the bumpers at 8 m/s: TTC of 2 s after 3 s; they touch after 5 s and overlap in the frame after
    assert said["cc-human"].begin_s == pytest.approx(2.1)
    assert said["cc-human"].begin_s == said["cc-human"].prevented.reacts_s
    assert said["fsm"].begin_s > said["reg157"].begin_s > begin
    assert not said["cc-human"].prevented.by_holding


def test_until_it_sees_danger_it_does_what_the_av_did() -> None:
    """An AV that falls back again is not near: nothing was dangerous, and the manoeuvre's begin counts alone."""
    scenario, begin = late_braking()
    assert scenario.crash is not None
    speed = scenario.speed.copy()
    speed[: round(10 * (scenario.crash.time - begin)), 0] = 21.0
    said = driven_by(replace(scenario, speed=speed))
    assert {one.begin_s for one in said.values()} == {begin}


def test_who_is_hit_from_behind_has_not_prevented() -> None:
    lead, av = Mover(430.0, 1, 20.0), Mover(400.0, 1, 30.0)
    alone = prevented_by(crash(av, lead))
    pressed = prevented_by(crash(av, lead, Mover(392.0, 1, 30.0)))
    assert alone["fsm"].prevented
    assert not pressed["fsm"].prevented


def test_columns_say_nobody_and_null() -> None:
    n = len(CAREFUL)
    three = Prevention(
        np.array([True, True, False]),
        np.array([2, 0, 0]),
        np.array([[True] * n, [False] * n, [False] * n]),
        np.array([True, False, False]),
        np.full((3, n), [[1.5], [np.inf], [np.inf]]),
        np.full((3, n), 2.0),
        np.array([-1, -1, -1]),
        np.array([False, False, True]),
    )
    no = np.zeros(3, np.bool_)
    columns = three.columns(no, ~no)
    assert columns["prevention"].tolist() == ["by leaving it out", "nobody", "not judged"]
    assert three.columns(no, no)["prevention"][0] == "another speed"
    assert three.columns(~no, no)["prevention"][1] == "by braking"
    assert list(columns) == [column.name for column in PREVENTED_COLUMNS]
    assert columns["manoeuvre"] == ["av-moves", "other-moves", None]
    assert columns["prevented_by"] == [", ".join(CAREFUL), "nobody", None]
    assert list(columns["held_speed_prevents"]) == [True, False, None]
    assert columns["least_ttc_fsm_s"][0] == 1.5
    assert np.isnan(columns["least_ttc_fsm_s"][1:]).all()
    assert np.isnan(columns["braking_fsm_mps2"]).tolist() == [False, False, True]
