"""Concrete OpenSCENARIO files are read as they are played, and bad ones are refused in one sentence."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, SPEED, X, Y
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError, UnknownNameError
from cornerforge.interchange.cases import MovingCase, script_of
from cornerforge.interchange.read_opendrive import read_opendrive
from cornerforge.interchange.read_openscenario import read_openscenario

DATA = Path(__file__).parent / "data"
AHEAD = 1.4
"""Of a box's middle from its rear axle, in the files of these tests [m]."""


def lane(ident: int, kind: str = "driving", width: float = 4.0) -> str:
    return f'<lane id="{ident}" type="{kind}"><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'


def road(
    *, heading: float = 0.0, shape: str = "<line/>", right: Sequence[str] = (), left: Sequence[str] = (), rule: str = "RHT",
    sections: str = "",
) -> str:  # fmt: skip
    lanes = "".join(right or [lane(-1), lane(-2), lane(-3)])
    return f"""<OpenDRIVE><header revMajor="1" revMinor="7"/><road id="1" length="3000" rule="{rule}"><planView>
<geometry s="0" x="0" y="0" hdg="{heading}" length="3000">{shape}</geometry></planView><lanes><laneSection s="0">
<left>{"".join(left)}</left><right>{lanes}</right></laneSection>{sections}</lanes></road></OpenDRIVE>"""


def car(name: str, extra: str = "", *, category: str = "car", length: object = 5, width: object = 2) -> str:
    return f"""<ScenarioObject name="{name}"><Vehicle name="v" vehicleCategory="{category}"><BoundingBox>
<Center x="{AHEAD}" y="0" z="0.7"/><Dimensions length="{length}" width="{width}" height="1.5"/></BoundingBox></Vehicle>
{extra}</ScenarioObject>"""


CONTROLLER = '<ObjectController><Controller name="AV"><Properties/></Controller></ObjectController>'


def at(name: str, place: str, speed: object = 20, more: str = "") -> str:
    return f"""<Private entityRef="{name}"><PrivateAction><TeleportAction><Position>{place}</Position></TeleportAction>
</PrivateAction><PrivateAction>{speed_action(speed)}</PrivateAction>{more}</Private>"""


def on_lane(ident: int, s: float, road_id: str = "1") -> str:
    return f'<LanePosition roadId="{road_id}" laneId="{ident}" s="{s}"/>'


def speed_action(
    target: object, shape: str = "step", dimension: str = "time", value: object = 0, relative: str = ""
) -> str:
    goal = relative or f'<AbsoluteTargetSpeed value="{target}"/>'
    return f"""<LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="{shape}"
dynamicsDimension="{dimension}" value="{value}"/><SpeedActionTarget>{goal}</SpeedActionTarget></SpeedAction>
</LongitudinalAction>"""


def lane_change(to: int, shape: str = "cubic", dimension: str = "time", value: float = 4.0, offset: float = 0.0) -> str:
    return f"""<LateralAction><LaneChangeAction targetLaneOffset="{offset}"><LaneChangeActionDynamics
dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/><LaneChangeTarget><AbsoluteTargetLane value="{to}"/>
</LaneChangeTarget></LaneChangeAction></LateralAction>"""


def trajectory(vertices: Sequence[tuple[float | None, str]], timing: str = "absolute", offset: float = 0.0) -> str:
    stamps = ["" if t is None else f' time="{t}"' for t, _ in vertices]
    places = [f"><Position>{place}</Position></Vertex>" for _, place in vertices]
    points = "".join(f"<Vertex{stamp}{place}" for stamp, place in zip(stamps, places, strict=True))
    times = f'<Timing domainAbsoluteRelative="{timing}" scale="1" offset="{offset}"/>' if timing else "<None/>"
    return f"""<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory name="t" closed="false"><Shape><Polyline>
{points}</Polyline></Shape></Trajectory></TrajectoryRef><TimeReference>{times}</TimeReference><TrajectoryFollowingMode
followingMode="follow"/></FollowTrajectoryAction></RoutingAction>"""


def condition(inner: str, edge: str = "none", delay: object = 0, entity: str = "") -> str:
    if entity:
        inner = f"""<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{entity}"/>
</TriggeringEntities><EntityCondition>{inner}</EntityCondition></ByEntityCondition>"""
    else:
        inner = f"<ByValueCondition>{inner}</ByValueCondition>"
    return f'<Condition name="c" delay="{delay}" conditionEdge="{edge}">{inner}</Condition>'


def time_is(value: object, rule: str = "greaterThan") -> str:
    return condition(f'<SimulationTimeCondition value="{value}" rule="{rule}"/>')


def event(name: str, actions: str | Sequence[str], *conditions: str, priority: str = "parallel", count: int = 1) -> str:
    actions = [actions] if isinstance(actions, str) else actions
    whole = "".join(
        f'<Action name="{name}-{k}"><PrivateAction>{action}</PrivateAction></Action>'
        for k, action in enumerate(actions)
    )
    start = f"<StartTrigger><ConditionGroup>{''.join(conditions)}</ConditionGroup></StartTrigger>" if conditions else ""
    return f'<Event name="{name}" priority="{priority}" maximumExecutionCount="{count}">{whole}{start}</Event>'


def scenario(
    events: str = "", *, entities: str = "", init: str = "", actor: str = "B", stop: object = 10, version: str = "2",
    parameters: str = "", road_file: str = "road.xodr", act_stop: str = "",
) -> str:  # fmt: skip
    entities = entities or car("Ego") + car("B")
    init = init or at("Ego", on_lane(-2, 100)) + at("B", on_lane(-2, 130))
    story = f"""<Story name="s"><Act name="act"><ManeuverGroup name="g" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="{actor}"/></Actors><Maneuver name="m">{events}</Maneuver>
</ManeuverGroup><StartTrigger><ConditionGroup>{time_is(0)}</ConditionGroup></StartTrigger>{act_stop}</Act></Story>"""
    ending = f"<ConditionGroup>{time_is(stop)}</ConditionGroup>" if stop is not None else ""
    return f"""<?xml version="1.0" encoding="UTF-8"?><OpenSCENARIO><FileHeader revMajor="1" revMinor="{version}"
date="2026-11-25T00:00:00" description="a test" author="me"/>{parameters}<CatalogLocations/>
<RoadNetwork><LogicFile filepath="{road_file}"/></RoadNetwork><Entities>{entities}</Entities><Storyboard>
<Init><Actions>{init}</Actions></Init>{story if events else ""}<StopTrigger>{ending}</StopTrigger></Storyboard>
</OpenSCENARIO>"""


def read(tmp_path: Path, text: str, on: str = "", *, ego: str | None = None) -> MovingCase:
    (tmp_path / "road.xodr").write_text(on or road())
    (tmp_path / "case.xosc").write_text(text)
    return read_openscenario(tmp_path / "case.xosc", ego=ego)


def times(case: MovingCase) -> NDArray[np.float64]:
    return 0.1 * np.arange(len(case.poses))


# A whole file


def test_a_cut_in_is_played_as_it_is_written() -> None:
    case = read_openscenario(DATA / "cut_in.xosc")
    t = times(case)
    ego, other = case.poses[:, 0], case.poses[:, 1]
    assert case.name == "cut_in"
    assert (case.odd.n_lanes, case.odd.lane_width) == (3, 3.5)
    np.testing.assert_array_equal(case.length, [4.4, 4.8])  # one by a ParameterAssignment, one by the catalog
    assert len(t) == 161  # the stop trigger waits for 16 s
    # The road is turned by 0.5 rad and begins at (100, 50): x is its s. Ego's rear axle starts at s = 200 in lane -2.
    np.testing.assert_allclose(ego[:, X], 200.0 + AHEAD + 30.0 * t, atol=1e-6)
    np.testing.assert_allclose(ego[:, Y], 1.5 * 3.5, atol=1e-6)
    # The other begins 20 m behind and is 5 m/s faster: 12 m ahead at 6.4 s. Half a wave of 3 s, then 0.5 s, then 5 m/s2.
    began, ended = 6.4, 9.4
    u = np.clip((t - began) / (ended - began), 0.0, 1.0)
    rear = other[:, Y] - AHEAD * np.sin(other[:, HEADING])
    np.testing.assert_allclose(rear, 3.5 * (2.5 - 0.5 + 0.5 * np.cos(np.pi * u)), atol=0.02)
    np.testing.assert_allclose(other[:, SPEED], np.maximum(35.0 - 5.0 * np.maximum(t - 9.9, 0.0), 10.0), atol=0.1)
    assert other[60, LANE] == 2
    assert set(other[66:, LANE]) == {1.0}
    assert case.notes == (
        "three_lanes.xodr, line 4: lanes of road 7 that are not driven in the AV's direction are left out: 3 (driving), "
        "2 (driving), 1 (median), -4 (shoulder)",
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
    profile = """<LongitudinalAction><SpeedProfileAction followingMode="position"><SpeedProfileEntry speed="26" time="3"/>
<SpeedProfileEntry speed="20" time="2"/></SpeedProfileAction></LongitudinalAction>"""
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
        ('<LanePosition roadId="1" laneId="-1" s="50" offset="-1"><Orientation h="0.1" type="relative"/></LanePosition>', 50.0, 9.0, 0.1),
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


@pytest.mark.parametrize(
    ("inner", "entity", "edge", "delay", "when"),
    [
        ('<SimulationTimeCondition value="2" rule="greaterThan"/>', "", "none", 0, 2.0),
        ('<SimulationTimeCondition value="2" rule="equalTo"/>', "", "rising", 0, 2.0),
        ('<SimulationTimeCondition value="2" rule="greaterThan"/>', "", "rising", 1.5, 3.5),
        ('<SimulationTimeCondition value="0" rule="greaterOrEqual"/>', "", "rising", 0, 0.0),
        ('<RelativeDistanceCondition entityRef="B" value="9.5" freespace="false" relativeDistanceType="longitudinal" rule="lessThan"/>', "Ego", "none", 0, 2.1),
        ('<RelativeDistanceCondition entityRef="B" value="9.5" freespace="true" relativeDistanceType="longitudinal" rule="lessThan"/>', "Ego", "none", 0, 1.6),
        # 30 m apart at the start is more than 10: the edge is only when it is so again, on the other side.
        ('<RelativeDistanceCondition entityRef="B" value="10.5" freespace="false" relativeDistanceType="longitudinal" rule="greaterThan"/>', "Ego", "rising", 0, 4.1),
        ('<RelativeDistanceCondition entityRef="B" value="10.5" freespace="false" relativeDistanceType="longitudinal" rule="greaterThan"/>', "Ego", "falling", 0, 2.0),
        ('<RelativeDistanceCondition entityRef="B" value="4.7" freespace="false" relativeDistanceType="cartesianDistance" rule="lessThan"/>', "Ego", "none", 0, 2.8),
        ('<DistanceCondition value="39" freespace="false" rule="lessThan"><Position><LanePosition roadId="1" laneId="-2" s="200"/></Position></DistanceCondition>', "Ego", "none", 0, 2.1),
        ('<ReachPositionCondition tolerance="2"><Position><LanePosition roadId="1" laneId="-2" s="161"/></Position></ReachPositionCondition>', "Ego", "none", 0, 2.0),
        ('<TimeHeadwayCondition entityRef="B" value="0.49" freespace="false" coordinateSystem="road" rule="lessThan"/>', "Ego", "none", 0, 1.6),
        ('<TimeToCollisionCondition value="1.45" freespace="true" rule="lessThan"><TimeToCollisionConditionTarget><EntityRef entityRef="B"/></TimeToCollisionConditionTarget></TimeToCollisionCondition>', "Ego", "none", 0, 1.1),
        ('<TraveledDistanceCondition value="60"/>', "Ego", "none", 0, 2.0),
        ('<SpeedCondition value="25" rule="greaterThan"/>', "Ego", "none", 0, 0.0),
        ('<RelativeSpeedCondition entityRef="B" value="5" rule="greaterThan"/>', "Ego", "none", 0.5, 0.5),
        ('<StandStillCondition duration="1"/>', "Ego", "none", 0, math.inf),
        ('<StoryboardElementStateCondition storyboardElementType="act" storyboardElementRef="act" state="startTransition"/>', "", "none", 1, 1.0),
        ('<StoryboardElementStateCondition storyboardElementType="act" storyboardElementRef="s::act" state="runningState"/>', "", "rising", 0, 0.0),
    ],
)  # fmt: skip
def test_conditions(tmp_path: Path, inner: str, entity: str, edge: str, delay: float, when: float) -> None:
    events = event("go", speed_action(10, "step"), condition(inner, edge, delay, entity))
    case = read(tmp_path, scenario(events, init=EGO_FAST, stop=6))
    assert other_speed(case) == when
    assert case.notes == ()


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
    return condition(
        f'<StoryboardElementStateCondition storyboardElementType="{kind}" storyboardElementRef="{name}" state="{state}"/>'
    )


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
    comes = f'<EntityAction entityRef="C"><AddEntityAction><Position>{on_lane(-3, 50)}</Position></AddEntityAction></EntityAction>'
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
    near = '<RelativeDistanceCondition entityRef="B" value="9.5" freespace="false" relativeDistanceType="longitudinal" rule="lessThan"/>'
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


def test_which_one_is_the_av(tmp_path: Path) -> None:
    entities = car("A") + car("B", CONTROLLER, length=4)
    init = at("A", on_lane(-2, 100)) + at("B", on_lane(-2, 130))
    assert read(tmp_path, scenario(entities=entities, init=init, stop=1)).length[0] == 4.0
    assert read(tmp_path, scenario(entities=entities, init=init, stop=1), ego="A").length[0] == 5.0
    with pytest.raises(UnknownNameError, match='No entity "Aa". Did you mean "A"'):
        read(tmp_path, scenario(entities=entities, init=init), ego="Aa")
    with pytest.raises(InputError, match="Which entity is in the AV's seat"):
        read(tmp_path, scenario(entities=entities.replace(CONTROLLER, ""), init=init))


# Parameters and catalogs


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("${$v / 3.6}", 20.0), ("${($v + 1.5e1) % 7 * 2}", 6.0), ("${pow(2, 4) - -1}", 17.0), ("${max($v, 3) - min(1, 2) - 46}", 25.0),
        ("${round(4.5) + floor(1.9) + ceil(0.1) + sqrt(16)}", 11.0), ("${sign(-3) * -4}", 4.0), ("$v2", 18.0), (" $v2 ", 18.0),
    ],
)  # fmt: skip
def test_expressions(tmp_path: Path, expression: str, value: float) -> None:
    parameters = """<ParameterDeclarations><ParameterDeclaration name="v2" parameterType="double" value="${$v / 4}"/>
<ParameterDeclaration name="v" parameterType="double" value="72"/></ParameterDeclarations>"""
    init = at("Ego", on_lane(-2, 100), expression) + at("B", on_lane(-2, 130))
    assert read(tmp_path, scenario(init=init, parameters=parameters, stop=1)).poses[0, 0, SPEED] == pytest.approx(value)


@pytest.mark.parametrize(
    ("values", "expression", "message"),
    [
        ({"a": "$b", "b": "$a"}, "$a", "refers to itself"),
        ({"a": "${$a + 1}"}, "$a", "refers to itself"),
        ({"a": "1"}, "$c", 'parameter "c" is not declared'),
        ({"a": "1"}, "${$a / 0}", "cannot be computed"),
        ({"a": "1"}, "${__import__('os')}", "cannot be computed"),
        ({"a": "1"}, "${" + "(" * 500 + "1" + ")" * 500 + "}", "cannot be computed"),
        ({"a": "1"}, "${pow(10, 400)}", "cannot be computed"),
        ({"a": "x"}, "${$a + 1}", "cannot be computed"),
        ({"a": "1"}, "${1" + "+1" * 2000 + "}", "characters"),
        ({"a": "1"}, "twice $a", "neither a parameter"),
        ({"a": "fast"}, "$a", 'value of AbsoluteTargetSpeed is "fast"'),
    ],
)
def test_parameters_that_are_wrong(tmp_path: Path, values: dict[str, str], expression: str, message: str) -> None:
    declared = "".join(
        f'<ParameterDeclaration name="{n}" parameterType="double" value="{v}"/>' for n, v in values.items()
    )
    parameters = f"<ParameterDeclarations>{declared}</ParameterDeclarations>"
    text = scenario(init=at("Ego", on_lane(-2, 100), expression) + at("B", on_lane(-2, 130)), parameters=parameters)
    with pytest.raises(DataError, match=message):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "stated", ["/etc/passwd", "../../../../etc/passwd", "http://localhost/road.xodr", "file:///etc/hosts", "~/../../../root/x", "\0"]
)  # fmt: skip
def test_paths_stay_near_the_scenario(tmp_path: Path, stated: str) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    with pytest.raises(CornerForgeError) as caught:
        read(folder, scenario(road_file=stated.replace("\0", "&#1;")))
    assert "passwd" not in str(caught.value).partition('"')[0]


def test_roads_and_catalogs_beside_the_folder_are_read(tmp_path: Path) -> None:
    folder = tmp_path / "xosc"
    folder.mkdir()
    (tmp_path / "xodr").mkdir()
    (tmp_path / "xodr" / "r.xodr").write_text(road())
    text = scenario(road_file="../xodr/r.xodr", stop=1).replace("<CatalogLocations/>", "")
    assert read(folder, text).poses.shape == (11, 2, 7)
    (folder / "link").symlink_to("/etc")
    with pytest.raises(DataError, match="lies outside"):
        read(folder, text.replace("../xodr/r.xodr", "link/passwd"))


# Roads


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('<arc curvature="0.002"/>', "line 2: road 1 is not straight where the AV starts .arc, radius 500 m"),
        ('<spiral curvStart="0" curvEnd="0.01"/>', "not straight"),
        ('<paramPoly3 aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0" dV="300" pRange="normalized"/>', None),
        ('<paramPoly3 aU="0" bU="1" cU="0" dU="0" aV="0" bV="0.5" cV="0" dV="0" pRange="arcLength"/>', "not straight"),
        ('<poly3 a="0" b="0" c="0.002" d="0"/>', "not straight"),
        ('<arc curvature="0.0005"/>', None),
        ('<arc curvature="1e-9"/>', ""),
        ("", "no line, arc"),
    ],
)  # fmt: skip
def test_straight_roads_and_others(tmp_path: Path, shape: str, message: str | None) -> None:
    if message:
        with pytest.raises(DataError, match=message):
            read(tmp_path, scenario(stop=1), road(shape=shape))
        return
    case = read(tmp_path, scenario(stop=1), road(shape=shape))
    assert case.poses[0, 0, X] == pytest.approx(100.0 + AHEAD)
    bends = message is None
    assert any("it is read as straight" in note for note in case.notes) == bends
    if bends:  # then a point of the world is no place on it
        text = scenario(init=at("Ego", on_lane(-2, 100)) + at("B", '<WorldPosition x="120" y="-6"/>'), stop=1)
        assert any("B is nowhere on the road" in note for note in read(tmp_path, text, road(shape=shape)).notes)


def test_lanes_of_several_widths_and_sections(tmp_path: Path) -> None:
    right = [lane(-1, "shoulder", 1.5), lane(-2, width=3.5), lane(-3, width=3.75), lane(-4, "border")]
    later = f'<laneSection s="500"><right>{lane(-1, "shoulder", 1.5)}{lane(-2, width=3.5)}</right></laneSection>'
    case = read(tmp_path, scenario(stop=1), road(right=right, sections=later))
    assert case.odd.lane_width == pytest.approx(3.625)
    assert case.poses[0, 0, Y] == pytest.approx(3.75 + 1.75)
    told = " ".join(case.notes)
    for words in (
        "-1 (shoulder), -4 (border)",
        "3.75, 3.50 m wide; each counts as 3.62 m",
        "has other lanes or widths farther on",
    ):
        assert words in told
    with pytest.raises(DataError, match="differ too much in width"):
        read(tmp_path, scenario(), road(right=[lane(-1, width=2.5), lane(-2, width=6.0), lane(-3, width=2.5)]))
    with pytest.raises(DataError, match="no lane -2 there; it has: -1"):
        read(tmp_path, scenario(), road(right=[lane(-1)]))
    with pytest.raises(DataError, match="no lane to drive in"):
        read(tmp_path, scenario(), road(right=[lane(-1, "walking"), lane(-2, "biking")]))


def test_straight_roads_one_after_the_other(tmp_path: Path) -> None:
    second = road().split("<road", 1)[1].replace('id="1"', 'id="2"').replace('x="0"', 'x="3000"')
    chain = road().replace("</OpenDRIVE>", "<road" + second)
    init = at("Ego", on_lane(-2, 2990)) + at("B", on_lane(-2, 30, "2"))
    case = read(tmp_path, scenario(init=init, stop=2), chain)
    assert case.poses[0, 1, X] == pytest.approx(3030.0 + AHEAD)
    assert case.notes == ()
    past = read(
        tmp_path,
        scenario(init=init.replace('roadId="2" laneId="-2" s="30"', 'roadId="1" laneId="-2" s="2950"'), stop=2),
    )
    assert any(
        "Ego is beyond the straight stretch of the road (x = 0 to 3000 m) at 0.5 s" in note for note in past.notes
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('length="3000" rule', 'length="nan" rule', "length of road"),
        ('hdg="0.0"', 'hdg="inf"', "hdg of geometry"),
        ('<lane id="-2"', '<lane id="-1"', "two lanes -1"),
        ('<lane id="-2"', '<lane id="-7"', "lane -2 is missing"),
        ('<lane id="-2"', '<lane id="2"', "a lane on the right has id 2"),
        ('<width sOffset="0" a="4.0" b="0" c="0" d="0"/>', "", "has no width"),
        ("<lanes>", "<lanes/><lanes>", "no laneSection"),
        ("<road ", "<rode ", "no whole XML"),
        ("<planView>", "<planView/><planView>", "planView holds no geometry"),
    ],
)  # fmt: skip
def test_roads_that_are_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(CornerForgeError, match=message):
        read(tmp_path, scenario(), road().replace(old, new, 1))


def test_a_file_with_two_roads_of_one_id(tmp_path: Path) -> None:
    (tmp_path / "r.xodr").write_text(road().replace("</OpenDRIVE>", "<road" + road().split("<road", 1)[1]))
    with pytest.raises(DataError, match='two roads "1"'):
        read_opendrive(tmp_path / "r.xodr")


# What is not carried over, and what cannot be


def test_what_is_left_out_is_named_with_its_line(tmp_path: Path) -> None:
    keep = "<LongitudinalAction><LongitudinalDistanceAction entityRef='Ego' distance='9' continuous='true' freespace='true'/></LongitudinalAction>"
    events = "\n" + event("keep", keep, time_is(1)) + "\n\n" + event("go", speed_action(10), time_is(2))
    angle = condition('<AngleCondition angle="1" angleTolerance="1" angleType="heading"/>', entity="B")
    events += "\n" + event("turned", speed_action(5), angle)
    text = scenario(events)
    case = read(tmp_path, text)
    lines = {k + 1: line for k, line in enumerate(text.splitlines())}
    for tag, words in (("LongitudinalDistanceAction", "B goes on as it was"), ("AngleCondition", "it never holds")):
        (note,) = [note for note in case.notes if tag in note]
        assert words in note
        assert f"<{tag}" in lines[int(note.split("line ")[1].split(":")[0])]
    assert case.poses[-1, 1, SPEED] == 10.0


def test_a_case_of_which_nothing_is_left_is_refused(tmp_path: Path) -> None:
    synchronize = "<SynchronizeAction masterEntityRef='Ego'/>"
    with pytest.raises(
        DataError, match=r"nothing that moves its vehicles can be carried over: SynchronizeAction \(line"
    ):
        read(tmp_path, scenario(event("go", synchronize, time_is(1))))


def test_other_road_users_count_as_boxes(tmp_path: Path) -> None:
    walker = (
        car("P")
        .replace(
            '<Vehicle name="v" vehicleCategory="car">',
            '<Pedestrian name="p" mass="70" pedestrianCategory="pedestrian">',
        )
        .replace("</Vehicle>", "</Pedestrian>")
    )
    init = at("Ego", on_lane(-2, 100)) + at("B", on_lane(-1, 130)) + at("P", on_lane(-3, 200), 0)
    case = read(
        tmp_path,
        scenario(entities=car("Ego") + car("B", category="bus", length=12, width=2.5) + walker, init=init, stop=1),
    )
    assert case.kind.tolist() == [0, 1, 2]
    assert case.notes == ("case.xosc, line 7: P is a Pedestrian; it counts as a motorcycle of its size",)


BAD: list[tuple[str, str, str]] = [
    ('revMinor="2"', 'revMinor="7"', "OpenSCENARIO 1.7 is not read; 1.0 to 1.3 are"),
    ('revMajor="1"', 'revMajor="2"', "OpenSCENARIO 2.2 is not read"),
    ("<OpenSCENARIO>", "<OpenDRIVE>", "mismatched tag|not an OpenSCENARIO file"),
    ('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="300"/>', r'line \d+: value of AbsoluteTargetSpeed is "300"; allowed: 0 to 80 m/s'),
    ('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="-3"/>', "allowed: 0 to 80 m/s"),
    ('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="NaN"/>', "allowed: 0 to 80 m/s"),
    ('length="5"', 'length="0"', "length of Dimensions is \"0\"; allowed: 0.2 to 40 m"),
    ('width="2"', 'width="inf"', "width of Dimensions"),
    ('width="2"', 'width="2.9"', "odd.vehicle_width"),
    ('name="B"', 'name="Ego"', 'two entities "Ego"'),
    ('Private entityRef="B"', 'Private entityRef="Z"', 'no entity "Z"'),
    ('EntityRef entityRef="B"', 'EntityRef entityRef="Z"', 'no entity "Z"'),
    ('roadId="1"', 'roadId="../../x"', 'has no road "../../x"; it has: 1'),
    ('laneId="-2"', 'laneId="-2.5"', "no whole number"),
    ('laneId="-2"', 'laneId="0"', "has no lane 0"),
    (' s="100"', ' s="1e99"', "s of LanePosition"),
    ('dynamicsShape="step"', 'dynamicsShape="wavy"', 'dynamicsShape "wavy" is none of'),
    ('conditionEdge="none"', 'conditionEdge="sharp"', 'conditionEdge "sharp" is none of'),
    ('delay="0"', 'delay="-1"', "delay of Condition"),
    ('rule="greaterThan"', 'rule="about"', 'rule "about" is none of'),
    ("<LogicFile filepath=\"road.xodr\"/>", "", "names no LogicFile"),
    ('filepath="road.xodr"', 'filepath="nowhere.xodr"', "No file .*nowhere.xodr"),
    ("<Entities>", "<Entities/><Entities>", "no ScenarioObject"),
    ("<Storyboard>", "<Catalog/><Storybook>", "mismatched tag"),
    ("TeleportAction>", "TransportAction>", "is put nowhere in Init"),
    ("<BoundingBox>", "<Box>", "mismatched tag"),
    ('<LanePosition roadId="1" laneId="-2" s="100"/>', '<RelativeLanePosition entityRef="Ego" dLane="0" ds="1"/>', 'relative to "Ego"'),
    ('<LanePosition roadId="1" laneId="-2" s="100"/>', '<WorldPosition x="1e5" y="0"/>', "on no lane of a straight road"),
    ('<LanePosition roadId="1" laneId="-2" s="100"/>', '<GeoPosition latitude="1" longitude="2"/>', "where the AV starts is a GeoPosition"),
    ('<LanePosition roadId="1" laneId="-2" s="100"/>', '<WorldPosition x="100" y="-6" h="3.1"/>', "drives against the direction"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_files_that_are_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = scenario(event("go", speed_action(10), time_is(1)))
    assert old in text
    with pytest.raises(CornerForgeError, match=message) as caught:
        read(tmp_path, text.replace(old, new, 1 if "Action>" not in old else -1))
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([(0.0, 100), (-1.0, 120)], "time of Vertex"),
        ([(1.0, 100), (0.5, 120)], "times must rise"),
        ([(0.0, 100)], "two vertices at least"),
        ([(0.0, 100), (None, 120)], "1 of 2 vertices have a time"),
        ([(0.0, 100), (float("nan"), 120)], "time of Vertex"),
    ],
)
def test_trajectories_that_are_wrong(tmp_path: Path, vertices: list[tuple[float | None, float]], message: str) -> None:
    text = scenario(event("go", trajectory([(t, on_lane(-2, s)) for t, s in vertices]), time_is(1)))
    with pytest.raises(DataError, match=message):
        read(tmp_path, text)


def test_too_many_vehicles(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are 10,001 entities; up to 200 are read"):
        read(tmp_path, scenario(entities=car("Ego") + "".join(car(f"v{k}") for k in range(10_000))))


def test_impossible_speeds_of_trajectories(tmp_path: Path) -> None:
    leap = trajectory([(0.0, on_lane(-2, 100)), (1.0, on_lane(-2, 400))])
    with pytest.raises(InputError, match="drives at 300 m/s; up to 80 m/s"):
        read(tmp_path, scenario(event("go", leap, time_is(0)), stop=2))


def test_circles_of_places_and_catalogs(tmp_path: Path) -> None:
    circle = at("Ego", '<RelativeLanePosition entityRef="B" dLane="0" ds="1"/>') + at(
        "B", '<RelativeLanePosition entityRef="Ego" dLane="0" ds="1"/>'
    )
    with pytest.raises(DataError, match="which has no place of its own"):
        read(tmp_path, scenario(init=circle))
    reference = '<ScenarioObject name="Ego"><CatalogReference catalogName="cars" entryName="saloon"/></ScenarioObject>'
    with pytest.raises(DataError, match='no entry "saloon" in a catalog "cars"'):
        read(tmp_path, scenario(entities=reference + car("B")))


def test_nothing_ends_it(tmp_path: Path) -> None:
    """A story that waits for ever is cut, and so is one with no storyboard at all."""
    far = '<TraveledDistanceCondition value="999999"/>'
    case = read(tmp_path, scenario(event("go", speed_action(10), condition(far, entity="Ego")), stop=None))
    assert len(case.poses) in (601, 602)
    assert any("nothing begins or ends for 60 s" in note for note in case.notes)
    assert len(read(tmp_path, scenario(stop=None)).poses) == 201


def test_names_with_path_parts(tmp_path: Path) -> None:
    (tmp_path / "road.xodr").write_text(road())
    odd = tmp_path / "a b;..c%2F.xosc"
    odd.write_text(
        scenario(stop=1).replace('name="B"', 'name="../../b"').replace('entityRef="B"', 'entityRef="../../b"')
    )
    case = read_openscenario(odd)
    assert case.name == "a-b-c-2F"
    assert case.facts["vehicles"] == "Ego, ../../b"


def test_damaged_files_give_one_clear_error(tmp_path: Path) -> None:
    """600 files with random damage: read, or refused by an error of ours; nothing else, and never for long."""
    draw = random.Random(20)
    good = (DATA / "cut_in.xosc").read_text()
    plain = road().replace('id="1"', 'id="7"').replace("three", "two")
    (tmp_path / "Catalogs").mkdir()
    (tmp_path / "Catalogs" / "cars.xosc").write_bytes((DATA / "Catalogs" / "cars.xosc").read_bytes())
    words = [
        "",
        "0",
        "-1",
        "1e308",
        "nan",
        "$kmh",
        "${1/0}",
        "Ego",
        "Other",
        "<a/>",
        '"',
        "&lt;",
        "../x",
        "act",
        "16",
        "é",
    ]
    read_ones = refused = 0
    for k in range(600):
        text = list(good)
        for _ in range(draw.randint(1, 3)):
            place = draw.randrange(len(text))
            quotes = [i for i, c in enumerate(text) if c == '"']
            if k % 2 and len(quotes) > 10:  # another value for an attribute
                i = draw.randrange(len(quotes) - 1)
                text[quotes[i] + 1 : quotes[i + 1]] = draw.choice(words)
            elif k % 3:
                del text[place : place + draw.randint(1, 200)]
            else:
                text[place:place] = draw.choice(words)
        (tmp_path / "three_lanes.xodr").write_text(plain if k % 7 else plain[: draw.randrange(len(plain))])
        (tmp_path / "case.xosc").write_text("".join(text))
        try:
            case = read_openscenario(tmp_path / "case.xosc")
        except CornerForgeError:
            refused += 1
        else:
            assert np.isfinite(case.poses[0, 0]).all()
            read_ones += 1
    assert read_ones > 20
    assert refused > 200


def test_half_files(tmp_path: Path) -> None:
    text = scenario(event("go", speed_action(10), time_is(1)))
    (tmp_path / "road.xodr").write_text(road())
    for share in (0.0, 0.1, 0.5, 0.99):
        (tmp_path / "case.xosc").write_text(text[: int(share * len(text))])
        with pytest.raises(FileFormatError, match="no whole XML file"):
            read_openscenario(tmp_path / "case.xosc")
