"""Concrete OpenSCENARIO files are played as they are written."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from reference.openscenario import (
    AHEAD,
    CONTROLLER,
    apart,
    as_in_file,
    at,
    car,
    condition,
    event,
    in_state,
    lane,
    lane_change,
    on_lane,
    read,
    road,
    scenario,
    speed_action,
    time_is,
    times,
    trajectory,
)

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.ext.interchange.read_openscenario import read_openscenario
from cornerforge.library.out_case import MovingCase, script_of

DATA = Path(__file__).parent / "data"


# A whole file


def test_a_cut_in_is_played_as_it_is_written() -> None:
    case = read_openscenario(DATA / "cut_in.xosc")
    assert case.poses[0, 0, X] == 0.0
    case = as_in_file(case)
    t = times(case)
    ego, other = case.poses[:, 0], case.poses[:, 1]
    assert case.name == "cut_in"
    assert (case.odd.n_lanes, case.odd.lane_width) == (3, 3.5)
    np.testing.assert_array_equal(case.length, [4.4, 4.8])  # one by a ParameterAssignment, one by the catalog
    assert len(t) == 161  # the stop trigger waits for 16 s
    # The road is turned by 0.5 rad and begins at (100, 50): x is its s. Ego's rear axle starts at s = 200 in lane -2.
    np.testing.assert_allclose(ego[:, X], 200.0 + AHEAD + 30.0 * t, atol=1e-6)
    np.testing.assert_allclose(ego[:, Y], 1.5 * 3.5, atol=1e-6)
    # The other begins 20 m behind and is 5 m/s faster: 12 m ahead at 6.4 s. A lane change of 3 s, 0.5 s,
    # then 5 m/s2.
    began, ended = 6.4, 9.4
    u = np.clip((t - began) / (ended - began), 0.0, 1.0)
    rear = other[:, Y] - AHEAD * np.sin(other[:, HEADING])
    np.testing.assert_allclose(rear, 3.5 * (2.5 - 0.5 + 0.5 * np.cos(np.pi * u)), atol=0.02)
    np.testing.assert_allclose(other[:, SPEED], np.maximum(35.0 - 5.0 * np.maximum(t - 9.9, 0.0), 10.0), atol=0.1)
    assert other[60, LANE] == 2
    assert set(other[66:, LANE]) == {1.0}
    assert case.notes == (
        "three_lanes.xodr, line 4: lanes of road 7 that are not driven in the AV's direction are left out: 3 (driving)"
        ", 2 (driving), 1 (median), -4 (shoulder)",
        "cut_in.xosc, line 26: EnvironmentAction is left out",
    )
    assert case.av_is_recorded
    assert case.facts["format"] == "OpenSCENARIO 1.2"
    assert script_of(case).slot.size == 2


# Motion


@pytest.mark.parametrize("version", ["0", "1", "2", "3"])
def test_versions(tmp_path: Path, version: str) -> None:
    assert read(tmp_path, scenario(version=version, stop=1)).poses.shape == (11, 2, 7)


SHAPES = {
    "linear": (lambda u: u, 1.0),
    "cubic": (lambda u: 3.0 * u**2 - 2.0 * u**3, 1.5),
    "sinusoidal": (lambda u: 0.5 - 0.5 * np.cos(np.pi * u), 0.5 * np.pi),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dimension", ["time", "distance", "rate"])
def test_lane_changes(tmp_path: Path, shape: str, dimension: str) -> None:
    at_u, slope = SHAPES[shape]
    value = {"time": 4.0, "distance": 80.0, "rate": slope * 4.0 / 4.0}[dimension]  # 4 m in 4 s, at 20 m/s
    events = event(
        "go", lane_change(-1, shape, dimension, value, offset=-0.5 if dimension == "time" else 0.0), time_is(1)
    )
    case = read(tmp_path, scenario(events))
    u = np.clip((times(case) - 1.0) / 4.0, 0.0, 1.0)
    way = 3.5 if dimension == "time" else 4.0
    y = case.poses[:, 1, Y] - AHEAD * np.sin(case.poses[:, 1, HEADING])
    np.testing.assert_allclose(y, 6.0 + way * at_u(u), atol=0.03)
    assert case.poses[-1, 1, HEADING] == 0.0
    along = 0.1 * np.sqrt(20.0**2 - np.diff(y) ** 2 / 0.01)  # its speed is that along its way
    np.testing.assert_allclose(case.poses[-1, 1, X] - case.poses[0, 1, X], along.sum(), atol=0.01)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dimension", ["time", "distance", "rate"])
def test_speeds(tmp_path: Path, shape: str, dimension: str) -> None:
    at_u, slope = SHAPES[shape]
    value = {"time": 4.0, "distance": 60.0, "rate": slope * 10.0 / 4.0}[dimension]  # from 20 to 10 m/s in 4 s, 60 m
    case = read(tmp_path, scenario(event("go", speed_action(10, shape, dimension, value), time_is(1))))
    u = np.clip((times(case) - 1.0) / 4.0, 0.0, 1.0)
    np.testing.assert_allclose(case.poses[:, 1, SPEED], 20.0 - 10.0 * at_u(u), atol=1e-6)
    np.testing.assert_allclose(case.poses[50, 1, X] - case.poses[10, 1, X], 60.0, atol=1e-3)
    assert abs(case.poses[:, 1, ACCELERATION]).max() <= slope * 10.0 / 4.0 + 1e-6


def test_speeds_relative_to_another(tmp_path: Path) -> None:
    relative = '<RelativeTargetSpeed entityRef="Ego" value="{}" speedTargetValueType="{}" continuous="{}"/>'
    brakes = event("brake", speed_action(10, "linear", "rate", 2), time_is(2)).replace('name="m"', "")
    follow = event("as fast", speed_action(0, relative=relative.format(1.5, "factor", "true")), time_is(0))
    case = read(tmp_path, scenario(follow, stop=5))
    np.testing.assert_allclose(case.poses[:, 1, SPEED], 30.0)
    once = event("as fast", speed_action(0, relative=relative.format(-5, "delta", "false")), time_is(1))
    np.testing.assert_allclose(read(tmp_path, scenario(once, stop=5)).poses[10:, 1, SPEED], 15.0)
    both = scenario(follow, stop=5).replace(
        "</Story>", "</Story>" + scenario(brakes, actor="Ego").split("</Init>")[1].split("<StopTrigger>")[0]
    )
    case = read(tmp_path, both)
    np.testing.assert_allclose(case.poses[:, 1, SPEED], 1.5 * case.poses[:, 0, SPEED], atol=0.05)
    assert case.poses[-1, 0, SPEED] == pytest.approx(14.0)


def test_speed_profiles_and_offsets(tmp_path: Path) -> None:
    profile = """<LongitudinalAction><SpeedProfileAction followingMode="position">
<SpeedProfileEntry speed="26" time="3"/><SpeedProfileEntry speed="20" time="2"/></SpeedProfileAction>
</LongitudinalAction>"""
    offset = """<LateralAction><LaneOffsetAction continuous="false"><LaneOffsetActionDynamics maxLateralAcc="1.5"
dynamicsShape="cubic"/><LaneOffsetTarget><AbsoluteTargetLaneOffset value="1"/></LaneOffsetTarget></LaneOffsetAction>
</LateralAction>"""
    case = read(tmp_path, scenario(event("both", [profile, offset], time_is(1))))
    t = times(case) - 1.0
    np.testing.assert_allclose(case.poses[:, 1, SPEED], np.interp(t, [0, 3, 5], [20, 26, 20]), atol=0.05)
    assert case.poses[30, 1, Y] == pytest.approx(7.0)  # 6 m/s2 on 1 m at 1.5 m/s2: 2 s
    assert case.poses[20, 1, Y] == pytest.approx(6.5, abs=0.1)


def test_trajectories_put_the_rear_axle_where_they_say(tmp_path: Path) -> None:
    h = 0.1
    vertices: list[tuple[float | None, str]] = [
        (0.1 * k, f'<WorldPosition x="{100 + 2.5 * k}" y="{-6 + 0.2 * k}" h="{h}"/>') for k in range(11)
    ]
    text = scenario(
        init=at("Ego", on_lane(-2, 100))
        + at("B", on_lane(-2, 100), 25, f"<PrivateAction>{trajectory(vertices)}</PrivateAction>"),
        stop=2,
    )
    case = read(tmp_path, text)
    t = times(case)[:11]
    pose = case.poses[:11, 1]
    np.testing.assert_allclose(pose[:, X], 100.0 + 25.0 * t + AHEAD * math.cos(h), atol=1e-9)
    np.testing.assert_allclose(pose[:, Y], 12.0 - 6.0 + 2.0 * t + AHEAD * math.sin(h), atol=1e-9)
    np.testing.assert_allclose(pose[:, HEADING], h, atol=1e-12)
    np.testing.assert_allclose(pose[1:, SPEED], 25.0, atol=0.2)
    np.testing.assert_allclose(pose[:10, LATERAL_SPEED], 2.0, atol=1e-6)
    np.testing.assert_allclose(np.diff(case.poses[12:, 1, X]), 2.5, atol=0.05)  # goes on after its end


@pytest.mark.parametrize(
    ("timing", "offset", "begins"), [("absolute", 2.0, 2.0), ("relative", 0.5, 1.5), ("", 0.0, 1.0)]
)
def test_when_a_trajectory_is_driven(tmp_path: Path, timing: str, offset: float, begins: float) -> None:
    vertices: list[tuple[float | None, str]] = [
        (0.0 if timing else None, on_lane(-2, 200)),
        (2.0 if timing else None, on_lane(-1, 260)),
    ]
    case = read(tmp_path, scenario(event("go", trajectory(vertices, timing, offset), time_is(1)), stop=6))
    k = round(10 * begins)
    rear = case.poses[:, 1, X] - AHEAD * np.cos(case.poses[:, 1, HEADING])
    assert rear[k] == pytest.approx(200.0, abs=1e-6)
    assert rear[k - 1] == pytest.approx(130.0 + 20.0 * (0.1 * (k - 1)), abs=1e-6)  # until then it keeps its speed
    assert case.poses[:, 1, SPEED].max() < 31.0
    assert any("B leaps" in note for note in case.notes)
    if timing:
        assert rear[k + 10] == pytest.approx(230.0, abs=1e-6)
    else:
        way = math.hypot(60.0, 4.0)
        assert rear[k + 10] == pytest.approx(200.0 + 20.0 * 60.0 / way, abs=1e-3)
    assert case.poses[-1, 1, Y] == pytest.approx(10.0, abs=0.15)
    assert set(case.poses[k:, 1, LANE]) == {2.0}


# Places


@pytest.mark.parametrize(
    ("place", "x", "y", "heading"),
    [
        ('<RelativeLanePosition entityRef="Ego" dLane="-1" ds="15" offset="0.5"/>', 115.0, 2.5, 0.0),
        ('<RelativeObjectPosition entityRef="Ego" dx="-20" dy="4"/>', 80.0, 10.0, 0.0),
        ('<RelativeRoadPosition entityRef="Ego" ds="7" dt="-4"/>', 107.0, 2.0, 0.0),
        ('<RelativeWorldPosition entityRef="Ego" dx="0" dy="10"/>', 110.0, 6.0, 0.0),
        ('<RoadPosition roadId="1" s="140" t="-2"/>', 140.0, 10.0, 0.0),
        (
            '<LanePosition roadId="1" laneId="-1" s="50" offset="-1"><Orientation h="0.1" type="relative"/>'
            "</LanePosition>", 50.0, 9.0, 0.1,
        ),
        ('<WorldPosition x="2" y="90" h="1.5707963267948966"/>', 90.0, 10.0, 0.0),
    ],
)  # fmt: skip
def test_places(tmp_path: Path, place: str, x: float, y: float, heading: float) -> None:
    """The road goes to the north; B stands before Ego in the file, and the places are found all the same."""
    case = read(
        tmp_path, scenario(init=at("B", place) + at("Ego", on_lane(-2, 100)), stop=1), road(heading=math.pi / 2)
    )
    pose = case.poses[0, 1]
    assert pose[X] - AHEAD * math.cos(heading) == pytest.approx(x, abs=1e-9)
    assert pose[Y] - AHEAD * math.sin(heading) == pytest.approx(y, abs=1e-9)
    assert pose[HEADING] == pytest.approx(heading, abs=1e-9)


def test_the_other_side_of_a_road_is_the_same_case_turned_round(tmp_path: Path) -> None:
    """Three lanes each way: what drives in lanes 1 to 3 against s is what drives in lanes -1 to -3 along it."""
    both = road(left=[lane(k) for k in (3, 2, 1)])
    events = event("go", lane_change(-1, "sinusoidal"), time_is(1))
    along = read(tmp_path, scenario(events), both)
    entities = car("Ego") + car("B") + car("C")
    init = at("Ego", on_lane(2, 2900)) + at("B", on_lane(2, 2870)) + at("C", on_lane(-1, 100))
    against = read(
        tmp_path, scenario(event("go", lane_change(1, "sinusoidal"), time_is(1)), entities=entities, init=init), both
    )
    np.testing.assert_allclose(against.poses, along.poses, atol=1e-9)
    assert any("C drives against the AV's direction; it is left out" in note for note in against.notes)


def test_left_hand_traffic_is_said(tmp_path: Path) -> None:
    case = read(
        tmp_path, scenario(init=at("Ego", on_lane(-1, 100)) + at("B", on_lane(-3, 80)), stop=1), road(rule="LHT")
    )
    assert case.poses[1, 0, X] > case.poses[0, 0, X]
    assert case.poses[0, 1, X] - case.poses[0, 0, X] == pytest.approx(20.0)  # ahead: they drive against s
    assert [round(y) for y in case.poses[0, :, Y]] == [2, 10]
    assert any("left-hand traffic" in note for note in case.notes)


# Triggers


def other_speed(case: MovingCase, *, from_speed: float = 20.0) -> float:
    """Time of the first frame in which B has another speed [s]."""
    changed = np.flatnonzero(np.abs(case.poses[:, 1, SPEED] - from_speed) > 1e-6)
    return round(0.1 * float(changed[0]), 1) if changed.size else math.inf


EGO_FAST = at("Ego", on_lane(-2, 100), 30) + at("B", on_lane(-1, 130), 20)
"""Ego is 30 m behind B, 10 m/s faster: side by side at 3 s."""
PLACE = f"<Position>{on_lane(-2, 200)}</Position>"
TTC = """<TimeToCollisionCondition value="1.45" freespace="true" rule="lessThan"><TimeToCollisionConditionTarget>
<EntityRef entityRef="B"/></TimeToCollisionConditionTarget></TimeToCollisionCondition>"""


@pytest.mark.parametrize(
    ("inner", "entity", "edge", "delay", "when"),
    [
        ('<SimulationTimeCondition value="2" rule="greaterThan"/>', "", "none", 0, 2.0),
        ('<SimulationTimeCondition value="2" rule="equalTo"/>', "", "rising", 0, 2.0),
        ('<SimulationTimeCondition value="2" rule="greaterThan"/>', "", "rising", 1.5, 3.5),
        ('<SimulationTimeCondition value="0" rule="greaterOrEqual"/>', "", "rising", 0, 0.0),
        (apart(9.5, "lessThan"), "Ego", "none", 0, 2.1),
        (apart(9.5, "lessThan", free="true"), "Ego", "none", 0, 1.6),
        # 30 m apart at the start is more than 10: the edge is only when it is so again, on the other side.
        (apart(10.5, "greaterThan"), "Ego", "rising", 0, 4.1),
        (apart(10.5, "greaterThan"), "Ego", "falling", 0, 2.0),
        (apart(4.7, "lessThan", kind="cartesianDistance"), "Ego", "none", 0, 2.8),
        (f'<DistanceCondition value="39" freespace="false" rule="lessThan">{PLACE}</DistanceCondition>',
         "Ego", "none", 0, 2.1),
        (f'<ReachPositionCondition tolerance="2">{PLACE}</ReachPositionCondition>', "Ego", "none", 0, 3.3),
        ('<TimeHeadwayCondition entityRef="B" value="0.49" freespace="false" rule="lessThan"/>', "Ego", "none", 0, 1.6),
        (TTC, "Ego", "none", 0, 1.1),
        ('<TraveledDistanceCondition value="60"/>', "Ego", "none", 0, 2.0),
        ('<SpeedCondition value="25" rule="greaterThan"/>', "Ego", "none", 0, 0.0),
        ('<RelativeSpeedCondition entityRef="B" value="5" rule="greaterThan"/>', "Ego", "none", 0.5, 0.5),
        ('<StandStillCondition duration="1"/>', "Ego", "none", 0, math.inf),
        (in_state("act", "startTransition", "act"), "", "none", 1, 1.0),
        (in_state("s::act", "runningState", "act"), "", "rising", 0, 0.0),
    ],
)  # fmt: skip
def test_conditions(tmp_path: Path, inner: str, entity: str, edge: str, delay: float, when: float) -> None:
    events = event("go", speed_action(10, "step"), condition(inner, edge, delay, entity))
    case = read(tmp_path, scenario(events, init=EGO_FAST, stop=6))
    assert other_speed(case) == when
    assert any("this Event does not begin" in note for note in case.notes) == (when == math.inf)
    assert len(case.notes) == (when == math.inf)


def test_collisions_trigger(tmp_path: Path) -> None:
    touch = '<CollisionCondition><EntityRef entityRef="B"/></CollisionCondition>'
    text = scenario(
        event("go", speed_action(10), condition(touch, entity="Ego")),
        init=EGO_FAST.replace('laneId="-1" s="130"', 'laneId="-2" s="130.5"'),
        stop=6,
    )
    assert other_speed(read(tmp_path, text)) == 2.6  # 30.5 m less 5 m of cars, at 10 m/s: 2.55 s


def test_groups_are_or_and_their_conditions_and(tmp_path: Path) -> None:
    never = time_is(99)
    both = f"{time_is(1)}{never}</ConditionGroup><ConditionGroup>{time_is(2)}{time_is(3)}"
    assert other_speed(read(tmp_path, scenario(event("go", speed_action(10), both)))) == 3.0


def after(name: str, state: str = "completeState", kind: str = "event") -> str:
    return condition(in_state(name, state, kind))


@pytest.mark.parametrize(
    ("priority", "speed", "y"), [("parallel", 10.0, 10.0), ("overwrite", 10.0, 10.0), ("skip", 20.0, 10.0)]
)
def test_priorities(tmp_path: Path, priority: str, speed: float, y: float) -> None:
    events = event("over", lane_change(-1), time_is(1)) + event("slow", speed_action(10), time_is(2), priority=priority)
    case = read(tmp_path, scenario(events))
    assert case.poses[-1, 1, SPEED] == speed
    assert case.poses[-1, 1, Y] == pytest.approx(y)


def test_events_after_events(tmp_path: Path) -> None:
    events = (
        event("over", lane_change(-1, value=2.0), time_is(1))
        + event("back", lane_change(-2, value=2.0), after("over-0", kind="action"))
        + event("slow", speed_action(10), after("back", "endTransition"))
        + event("again", speed_action(5), after("over", "startTransition"), count=1)
    )
    case = read(tmp_path, scenario(events, stop=None))
    assert case.poses[30, 1, Y] == pytest.approx(10.0, abs=0.01)
    assert case.poses[-1, 1, Y] == pytest.approx(6.0)
    assert case.poses[12, 1, SPEED] == pytest.approx(5.0, abs=0.2)  # along the road, while it goes over
    assert case.poses[-1, 1, SPEED] == 10.0
    assert len(case.poses) in (51, 52)  # without a stop trigger it ends when all is done


def test_an_act_is_stopped(tmp_path: Path) -> None:
    stop = f"<StopTrigger><ConditionGroup>{time_is(2)}</ConditionGroup></StopTrigger>"
    events = event("late", speed_action(10), time_is(3))
    assert other_speed(read(tmp_path, scenario(events, act_stop=stop))) == math.inf


def test_vehicles_come_and_go(tmp_path: Path) -> None:
    place = f"<Position>{on_lane(-3, 50)}</Position>"
    comes = f'<EntityAction entityRef="C"><AddEntityAction>{place}</AddEntityAction></EntityAction>'
    goes = '<EntityAction entityRef="B"><DeleteEntityAction/></EntityAction>'
    events = "".join(
        event(name, "", time_is(when)).replace(
            "<PrivateAction></PrivateAction>", f"<GlobalAction>{what}</GlobalAction>"
        )
        for name, when, what in (("comes", 1, comes), ("goes", 2, goes))
    )
    init = (
        at("Ego", on_lane(-2, 100))
        + at("B", on_lane(-1, 100))
        + f'<Private entityRef="C"><PrivateAction>{speed_action(10)}</PrivateAction></Private>'
    )
    case = read(tmp_path, scenario(events, entities=car("Ego") + car("B") + car("C"), init=init, stop=3))
    there = np.isfinite(case.poses[:, :, X])
    np.testing.assert_array_equal(there[:, 1], times(case) < 1.99)
    np.testing.assert_array_equal(there[:, 2], times(case) > 0.99)
    assert case.poses[20, 2, X] == pytest.approx(60.0 + AHEAD)


# The AV


def test_an_av_with_a_controller_is_known_at_the_start_only(tmp_path: Path) -> None:
    near = apart(9.5, "lessThan")
    events = event("go", speed_action(10), condition(near, entity="Ego"))
    case = read(tmp_path, scenario(events, entities=car("Ego", CONTROLLER) + car("B"), init=EGO_FAST, stop=4))
    assert not case.av_is_recorded
    assert np.isfinite(case.poses[0, 0]).all()
    assert np.isnan(case.poses[1:, 0]).all()
    assert other_speed(case) == 2.1
    assert any("Ego is driven by a controller and told nothing" in note for note in case.notes)
    told = read(
        tmp_path,
        scenario(event("go", speed_action(10), time_is(1)), entities=car("Ego", CONTROLLER) + car("B"), actor="Ego"),
    )
    assert told.av_is_recorded
    assert any("the controller of Ego is left out; it does what the storyboard says" in note for note in told.notes)


def test_which_one_is_the_av(tmp_path: Path) -> None:
    entities = car("A") + car("B", CONTROLLER, length=4)
    init = at("A", on_lane(-2, 100)) + at("B", on_lane(-2, 130))
    assert read(tmp_path, scenario(entities=entities, init=init, stop=1)).length[0] == 4.0
    assert read(tmp_path, scenario(entities=entities, init=init, stop=1), ego="A").length[0] == 5.0
    with pytest.raises(UnknownNameError, match=r'No entity "Aa"\. Did you mean "A"'):
        read(tmp_path, scenario(entities=entities, init=init), ego="Aa")
    with pytest.raises(InputError, match="Which entity is in the AV's seat"):
        read(tmp_path, scenario(entities=entities.replace(CONTROLLER, ""), init=init))
