"""Small OpenSCENARIO and OpenDRIVE files for tests, in pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import X
from cornerforge.ext.interchange.read_openscenario import read_openscenario
from cornerforge.library.out_case import MovingCase

AHEAD = 1.4
"""Of a box's middle from its rear axle, in the files of these tests [m]."""


def lane(ident: int, kind: str = "driving", width: float = 4.0) -> str:
    return f'<lane id="{ident}" type="{kind}"><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'


def road(
    *, heading: float = 0.0, shape: str = "<line/>", right: Sequence[str] = (), left: Sequence[str] = (),
    rule: str = "RHT", sections: str = "",
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
dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/><LaneChangeTarget>
<AbsoluteTargetLane value="{to}"/></LaneChangeTarget></LaneChangeAction></LateralAction>"""


def trajectory(vertices: Sequence[tuple[float | None, str]], timing: str = "absolute", offset: float = 0.0) -> str:
    stamps = ["" if t is None else f' time="{t}"' for t, _ in vertices]
    places = [f"><Position>{place}</Position></Vertex>" for _, place in vertices]
    points = "".join(f"<Vertex{stamp}{place}" for stamp, place in zip(stamps, places, strict=True))
    times = f'<Timing domainAbsoluteRelative="{timing}" scale="1" offset="{offset}"/>' if timing else "<None/>"
    return f"""<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory name="t" closed="false">
<Shape><Polyline>{points}</Polyline></Shape></Trajectory></TrajectoryRef><TimeReference>{times}</TimeReference>
<TrajectoryFollowingMode followingMode="follow"/></FollowTrajectoryAction></RoutingAction>"""


def condition(inner: str, edge: str = "none", delay: object = 0, entity: str = "") -> str:
    if entity:
        inner = f"""<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any">
<EntityRef entityRef="{entity}"/></TriggeringEntities><EntityCondition>{inner}</EntityCondition></ByEntityCondition>"""
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
    """Read a case, with the x of its file."""
    (tmp_path / "road.xodr").write_text(on or road())
    (tmp_path / "case.xosc").write_text(text)
    return as_in_file(read_openscenario(tmp_path / "case.xosc", ego=ego))


def as_in_file(case: MovingCase) -> MovingCase:
    start = case.facts["start_x_m"]
    assert isinstance(start, float)
    poses = case.poses.copy()
    poses[:, :, X] += start
    return replace(case, poses=poses)


def times(case: MovingCase) -> NDArray[np.float64]:
    return np.arange(len(case.poses), dtype=np.float64) * 0.1


def apart(value: float, rule: str, *, of: str = "B", free: str = "false", kind: str = "longitudinal") -> str:
    return f"""<RelativeDistanceCondition entityRef="{of}" value="{value}" freespace="{free}"
relativeDistanceType="{kind}" rule="{rule}"/>"""


def in_state(name: str, state: str = "completeState", kind: str = "event") -> str:
    return f"""<StoryboardElementStateCondition storyboardElementType="{kind}" storyboardElementRef="{name}"
state="{state}"/>"""
