"""Cases as ASAM OpenSCENARIO XML, versions 1.0 to 1.3, for players and simulators.

Positions are of the rear axle's centre, as the standard wants it: x and y in metres on the axes of `opendrive.write_road`, headings in radians
counter-clockwise. Numbers have six decimals, so a box read back is within a thousandth of a millimetre of the recorded one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge._files import writing
from cornerforge.errors import InputError
from cornerforge.interchange.cases import Fact, OutCase
from cornerforge.interchange.opendrive import lane_id, write_road_once
from cornerforge.interchange.relative import Manoeuvre, manoeuvre_of
from cornerforge.types import CAR, FRAME_S, MOTORCYCLE, TRUCK, Scenario

__all__ = ["AV_NAME", "MODES", "NO_DATE", "VERSIONS", "reference_behind", "write_openscenario"]

VERSIONS: Final = ("1.0", "1.1", "1.2", "1.3")
MODES: Final = ("recorded", "controller", "relative")
AV_NAME: Final = "Ego"
"""Name of the AV; the others are BV and their slot."""
NO_DATE: Final = "1970-01-01T00:00:00Z"
"""The standard wants a date. This one says that there is none: the same case gives the same bytes on any day."""
_AFTER_CONTACT = 5
"""Frames that go on after a contact; more would drive boxes through each other."""
_AFTER_END = 30
"""Frames for which the others go on after the record, where another AV drives."""
_COLLISION_S = 0.5
"""How long a test goes on after a contact of another AV [s]."""
_MARGIN = 20.0
_NAME = re.compile(r"[A-Za-z0-9_-]{1,200}")
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class _Build:
    """What a class of vehicles is built like, as usual: no record says it.

    Attributes:
        category: Its word in OpenSCENARIO.
        wheelbase: Distance between the axles over the length; the box's centre is in the middle between them.
        height: [m].
        mass: [kg].
        wheel: Diameter of its wheels [m].
    """

    category: str
    wheelbase: float
    height: float
    mass: float
    wheel: float


_BUILDS: Mapping[int, _Build] = {
    CAR: _Build("car", 0.56, 1.5, 1500.0, 0.65),
    TRUCK: _Build("truck", 0.6, 4.0, 30000.0, 1.0),
    MOTORCYCLE: _Build("motorbike", 0.64, 1.6, 300.0, 0.6),
}


@dataclass(frozen=True)
class _Track:
    """A vehicle while it is there: frames from `first` on, at least one.

    Attributes:
        name: Of the entity.
        column: In the scenario.
        first: Its first frame.
        x, y, heading: Of its reference point [m], [rad], (F,).
        speed: At its first frame, along its way [m/s].
        leaves: It is gone before the end.
    """

    name: str
    column: int
    first: int
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    speed: float
    leaves: bool

    @property
    def last(self) -> int:
        return self.first + self.x.size - 1


def reference_behind(kind: int, length: float) -> float:
    """Say how far the reference point, the rear axle's centre, is behind the box's centre [m].

    >>> reference_behind(CAR, 5.0)
    1.4000000000000001
    """
    return 0.5 * _BUILDS[kind].wheelbase * length


def write_openscenario(
    case: OutCase, folder: Path, *, version: str = "1.2", mode: str = "recorded", controller: str = "AV", date: str = NO_DATE
) -> tuple[str, ...]:  # fmt: skip
    """Write a case as OpenSCENARIO XML, and its road as OpenDRIVE beside it.

    Modes:

    - `recorded`: All vehicles follow what was recorded, a vertex each 0.1 s, in absolute time. After a contact all go straight on
      for 0.5 s, at the speed they had; then the storyboard stops.
    - `controller`: The AV has its start state, its speed and a controller of the user's, which the file names and activates; the rest is
      the user's. The others drive as recorded, and then straight on for 3 s at their last speed. The storyboard stops after that, or 0.5 s after the
      AV's first contact.
    - `relative`: As `controller`, but the last manoeuvre of the AV's crash partner before the contact begins when the AV is where the recorded one was relative to it: in front of the AV at the recorded time gap (bumper to
      bumper, over the AV's speed), beside or behind it at the recorded distance between reference points. Until then the
      partner drives as recorded, and goes straight on at its speed if the AV is late; if the AV never comes as near, the
      manoeuvre never begins. Kept: where the partner is until then, the order of its lane changes and their duration, an
      aborted one included, and its speed at each second. Lost: the quintic shape of a lane change (half a wave of a
      cosine here, as far across at its middle), accelerations within a second, and that the manoeuvre belongs to a
      time. Where the recorded gap was passed before the manoeuvre began, a second condition wants the recorded time of that to be over.
      All others drive as recorded. If the AV met nobody, or its partner neither changed lanes nor braked, the property `relative_manoeuvre` says
      none, and the file is as in `controller`.

    A vehicle that comes later is added then, one that goes is deleted; one that comes again is another entity. Indicators
    are written from version 1.2 on, while a vehicle is not yet in the lane it goes to, but not for an AV with a controller. (The schema of 1.2 wants an animation and a light of the user's own beside each
    light: both are there, named "none".) Masses are written from 1.1 on. Heights, axles and masses are those usual in a class.

    Args:
        case: The case.
        folder: Where its files go; it is made.
        version: Of OpenSCENARIO, one of `VERSIONS`.
        mode: One of `MODES`.
        controller: Name of the user's controller, where there is one.
        date: When it was written, in ISO 8601.

    Returns:
        Names of its files: the scenario and its road, which all cases of the same road share.

    Raises:
        InputError: The version or mode is not known, the case's name is no file name, or a number is not finite.
        OutputError: A file cannot be written.
    """
    check_in("OpenSCENARIO version", version, VERSIONS)
    check_in("mode of OpenSCENARIO", mode, MODES)
    if not _NAME.fullmatch(case.name):
        raise InputError(
            f"{case.name!r} cannot be the name of a case's file; use letters, digits, - and _, at most 200 of them."
        )
    if not controller.strip():
        raise InputError("The controller of the AV has no name; give it one.")
    writer = _Writer(case, int(version[2:]), mode, controller, date)
    first, last = writer.reach
    road = write_road_once(case.scenario.odd, folder, first, last)
    file = f"{case.name}.xosc"
    text = writer.text(road)
    with writing(folder / file, "the scenario") as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return file, road


class _Writer:
    """Makes the text of one file.

    Args:
        case, mode, controller, date: As `write_openscenario` has them.
        minor: Minor version of OpenSCENARIO.
    """

    def __init__(self, case: OutCase, minor: int, mode: str, controller: str, date: str) -> None:
        scenario = case.scenario
        self.case, self.scenario, self.minor, self.date = case, scenario, minor, date
        self.controller = None if mode == "recorded" else controller
        self.behind = np.array(
            [reference_behind(int(kind), float(length)) for kind, length in zip(scenario.kind, scenario.length, strict=True)]
        )  # fmt: skip
        self.relative = mode == "relative"
        self.manoeuvre = manoeuvre_of(scenario, self.behind) if self.relative else None
        more = _AFTER_END if self.controller is not None else (_AFTER_CONTACT if scenario.crash is not None else 0)
        self.end = len(scenario.x) - 1 + more
        self.tracks = _tracks(scenario, self.behind, more, self.manoeuvre)
        self.priority = "overwrite" if minor < 2 else "override"

    @property
    def reach(self) -> tuple[float, float]:
        """From where to where there are vehicles [m], with some road before and behind."""
        return (
            min(float(track.x.min()) for track in self.tracks) - _MARGIN,
            max(float(track.x.max()) for track in self.tracks) + _MARGIN,
        )

    def text(self, road: str) -> str:
        facts = _properties(self._facts())
        in_header = f"<Properties>{facts}</Properties>" if self.minor >= 2 else ""
        entities = "".join(self._entity(track, "" if self.minor >= 2 else facts) for track in self.tracks)
        init = "".join(self._init(track) for track in self.tracks if track.first == 0)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSCENARIO>
<FileHeader revMajor="1" revMinor="{self.minor}" date={_quoted(self.date)} author="cornerforge" \
description={_quoted(f"Case {self.case.name}")}>{in_header}</FileHeader>
<CatalogLocations/>
<RoadNetwork><LogicFile filepath={_quoted(road)}/></RoadNetwork>
<Entities>
{entities}</Entities>
<Storyboard>
<Init><Actions>
{init}</Actions></Init>
{self._story()}{self._stop()}</Storyboard>
</OpenSCENARIO>
"""

    def _facts(self) -> Iterable[tuple[str, Fact]]:
        yield from self.case.facts.items()
        if self.scenario.crash is not None:
            yield "contact_s", self.scenario.crash.time
        yield "recorded_s", round(FRAME_S * (len(self.scenario.x) - 1), 1)
        if self.relative:
            manoeuvre = self.manoeuvre
            yield "relative_manoeuvre", "none" if manoeuvre is None else manoeuvre.kind
            if manoeuvre is not None:
                yield "relative_begin_s", round(FRAME_S * manoeuvre.begin, 1)
                yield "relative_measure", manoeuvre.trigger.measure

    # Entities

    def _entity(self, track: _Track, facts: str) -> str:
        scenario, column = self.scenario, track.column
        build = _BUILDS[int(scenario.kind[column])]
        length, width = float(scenario.length[column]), float(scenario.width[column])
        mass = f' mass="{build.mass:g}"' if self.minor >= 1 else ""
        axle = f'maxSteering="0.5" trackWidth="{0.8 * width:g}" wheelDiameter="{build.wheel:g}" positionZ="{build.wheel / 2:g}"'
        fastest = max(scenario.odd.max_speed, 1.2 * track.speed)
        is_driven = column == 0 and self.controller is not None
        return f"""<ScenarioObject name="{track.name}"><Vehicle name="{build.category}" vehicleCategory="{build.category}"{mass}>
<BoundingBox><Center x="{self.behind[column]:.6f}" y="0" z="{build.height / 2:g}"/>\
<Dimensions width="{width:.6f}" length="{length:.6f}" height="{build.height:g}"/></BoundingBox>
<Performance maxSpeed="{fastest:.3f}" maxAcceleration="10" maxDeceleration="12"/>
<Axles><FrontAxle positionX="{2.0 * self.behind[column]:.6f}" {axle}/><RearAxle positionX="0" {axle}/></Axles>
<Properties><Property name="slot" value="{int(scenario.slot[column])}"/>{facts if column == 0 else ""}</Properties></Vehicle>\
{self._object_controller() if is_driven else ""}</ScenarioObject>
"""

    def _object_controller(self) -> str:
        name = _quoted(self.controller or "")
        outer = f" name={name}" if self.minor >= 3 else ""
        kind = ' controllerType="movement"' if self.minor >= 2 else ""
        return (
            f"<ObjectController{outer}><Controller name={name}{kind}>"
            '<Properties><Property name="placeholder" value="true"/></Properties></Controller></ObjectController>'
        )

    # What is so at the start

    def _init(self, track: _Track) -> str:
        driven = track.column == 0 and self.controller is not None
        then = self._activate() if driven else self._follow(track)
        return f"""<Private entityRef="{track.name}">
<PrivateAction><TeleportAction>{_position(track, 0)}</TeleportAction></PrivateAction>
<PrivateAction>{_speed_action(track.speed)}</PrivateAction>
{then}</Private>
"""

    def _activate(self) -> str:
        attribute = {2: "controllerRef", 3: "objectControllerRef"}.get(self.minor)
        named = f" {attribute}={_quoted(self.controller or '')}" if attribute else ""
        action = f'<ActivateControllerAction{named} longitudinal="true" lateral="true"/>'
        if self.minor >= 1:
            action = f"<ControllerAction>{action}</ControllerAction>"
        return f"<PrivateAction>{action}</PrivateAction>\n"

    def _follow(self, track: _Track) -> str:
        """Follow a track in absolute time; a vehicle that is there for one frame only has no way to follow."""
        if track.x.size < 2:
            return ""
        frames = np.arange(track.first, track.last + 1)
        rows = np.stack([FRAME_S * frames, track.x, track.y, track.heading], axis=1)
        vertices = (_VERTEX * len(rows)) % tuple(rows.ravel().tolist())
        trajectory = f"""<Trajectory name="{track.name}-trajectory" closed="false"><Shape><Polyline>
{vertices}</Polyline></Shape></Trajectory>"""
        if self.minor >= 1:
            trajectory = f"<TrajectoryRef>{trajectory}</TrajectoryRef>"
        return f"""<PrivateAction><RoutingAction><FollowTrajectoryAction>{trajectory}
<TimeReference><Timing domainAbsoluteRelative="absolute" scale="1" offset="0"/></TimeReference>\
<TrajectoryFollowingMode followingMode="follow"/>
</FollowTrajectoryAction></RoutingAction></PrivateAction>
"""

    # What happens later

    def _story(self) -> str:
        groups = []
        for track in self.tracks:
            events = [*self._comes_and_goes(track), *self._relative_events(track), *self._indicator_events(track)]
            if events:
                groups.append(_group(track.name, "".join(events)))
        if not groups:
            groups = [_group(AV_NAME, "")]
        return f"""<Story name="story"><Act name="act">
{"".join(groups)}<StartTrigger>{_when(_after(-1.0))}</StartTrigger></Act></Story>
"""

    def _comes_and_goes(self, track: _Track) -> Iterable[str]:
        if track.first > 0:
            actions = [
                f'<GlobalAction><EntityAction entityRef="{track.name}"><AddEntityAction>{_position(track, 0)}</AddEntityAction>'
                "</EntityAction></GlobalAction>",
                f"<PrivateAction>{_speed_action(track.speed)}</PrivateAction>",
                self._follow(track),
            ]
            yield self._event(f"{track.name}-comes", actions, _after(FRAME_S * (track.first - 0.5)))
        if track.leaves:
            gone = f'<GlobalAction><EntityAction entityRef="{track.name}"><DeleteEntityAction/></EntityAction></GlobalAction>'
            yield self._event(f"{track.name}-goes", [gone], _after(FRAME_S * (track.last + 0.5)))

    def _indicator_events(self, track: _Track) -> Iterable[str]:
        moved = self.manoeuvre is not None and track.column == self.manoeuvre.column
        if self.minor < 2 or (track.column == 0 and self.controller is not None):
            return
        for frame, side, state in _indicators(self.scenario, track):
            if moved and self.manoeuvre is not None and frame >= self.manoeuvre.begin:
                return
            name = f"{track.name}-{side}-{state}-{frame}"
            yield self._event(name, [self._light(side, state)], _after(FRAME_S * (frame - 0.5)), priority="parallel")

    def _light(self, side: str, state: str) -> str:
        own, animation = "", ""
        if self.minor == 2:
            own = '<UserDefinedLight userDefinedLightType="none"/>'
            animation = (
                '<AnimationAction><AnimationType><UserDefinedAnimation userDefinedAnimationType="none"/></AnimationType>'
                "</AnimationAction>"
            )
        mode = "flashing" if state == "on" else "off"
        return (
            f'<PrivateAction><AppearanceAction><LightStateAction><LightType><VehicleLight vehicleLightType="indicator{side}"/>{own}'
            f'</LightType><LightState mode="{mode}"/></LightStateAction>{animation}</AppearanceAction></PrivateAction>'
        )

    def _relative_events(self, track: _Track) -> Iterable[str]:
        manoeuvre = self.manoeuvre
        if manoeuvre is None or track.column != manoeuvre.column:
            return
        begins = f"{track.name}-begins"
        parts: list[tuple[float, str]] = []
        for change in manoeuvre.lanes:
            lane = lane_id(change.lane, self.scenario.odd.n_lanes)
            parts.append((change.delay, _lane_change_action(lane, change.duration)))
        parts += [(part.delay, _speed_action(part.speed, part.duration)) for part in manoeuvre.speeds]
        first = [f"<PrivateAction>{action}</PrivateAction>" for delay, action in parts if delay == 0.0]
        yield self._event(begins, first, *self._begin(track, manoeuvre))
        for number, (delay, action) in enumerate(part for part in parts if part[0] > 0.0):
            then = _condition(
                f'<ByValueCondition><StoryboardElementStateCondition storyboardElementType="event" storyboardElementRef="{begins}" '
                'state="startTransition"/></ByValueCondition>',
                delay=delay,
            )
            goes_on = [f"<PrivateAction>{action}</PrivateAction>"]
            yield self._event(f"{track.name}-goes-on-{number + 1}", goes_on, then, priority="parallel")

    def _begin(self, track: _Track, manoeuvre: Manoeuvre) -> list[str]:
        """Make the conditions under which the manoeuvre begins; all must be met."""
        trigger = manoeuvre.trigger
        system = ' coordinateSystem="road" relativeDistanceType="longitudinal"' if self.minor >= 1 else ' alongRoute="true"'
        if trigger.measure == "time gap":
            met = (
                f'<TimeHeadwayCondition entityRef="{track.name}" freespace="true" rule="{trigger.rule}" '
                f'value="{trigger.value:.6f}"{system}/>'
            )
        else:
            road = ' coordinateSystem="road"' if self.minor >= 1 else ""
            met = (
                f'<RelativeDistanceCondition entityRef="{track.name}" freespace="false" relativeDistanceType="longitudinal" '
                f'rule="{trigger.rule}" value="{trigger.value:.6f}"{road}/>'
            )
        conditions = [_condition(_of_the_av(met))]
        if trigger.not_before is not None:
            conditions.append(_after(trigger.not_before))
        return conditions

    def _event(self, name: str, actions: Iterable[str], *conditions: str, priority: str = "") -> str:
        named = (f'<Action name="{name}-{number}">\n{action}</Action>\n' for number, action in enumerate(actions) if action)
        return f"""<Event name="{name}" priority="{priority or self.priority}" maximumExecutionCount="1">
{"".join(named)}<StartTrigger>{_when(*conditions)}</StartTrigger></Event>
"""

    def _stop(self) -> str:
        groups = [_when(_after(FRAME_S * self.end))]
        if self.controller is not None:
            met = '<CollisionCondition><ByType type="vehicle"/></CollisionCondition>'
            groups.append(_when(_condition(_of_the_av(met), delay=_COLLISION_S)))
        return f"<StopTrigger>{''.join(groups)}</StopTrigger>\n"


_VERTEX = (
    '<Vertex time="%.1f"><Position><WorldPosition x="%.6f" y="%.6f" z="0" h="%.8f"/></Position></Vertex>\n'
)  # fmt: skip


def _tracks(
    scenario: Scenario, behind: NDArray[np.float64], more: int, manoeuvre: Manoeuvre | None
) -> list[_Track]:
    """Cut the recorded motion into vehicles that are there without a break."""
    tracks = []
    for column in range(scenario.slot.size):
        edges = np.flatnonzero(np.diff(scenario.present[:, column].astype(np.int8), prepend=0, append=0))
        for number, (start, stop) in enumerate(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)):
            slot = int(scenario.slot[column])
            name = AV_NAME if column == 0 else f"BV{slot}"
            tracks.append(_track(scenario, column, f"{name}-{number + 1}" if number else name, start, stop, more, behind, manoeuvre))
    return tracks


def _track(
    scenario: Scenario, column: int, name: str, start: int, stop: int, more: int, behind: NDArray[np.float64],
    manoeuvre: Manoeuvre | None,
) -> _Track:  # fmt: skip
    x, y, heading, speed = (
        values[start:stop, column] for values in (scenario.x, scenario.y, scenario.heading, scenario.speed)
    )
    if not all(np.isfinite(values).all() for values in (x, y, heading, speed)):
        raise InputError(f"Vehicle {int(scenario.slot[column])} is somewhere at no finite place, heading or speed; leave it out.")
    if manoeuvre is not None and manoeuvre.column == column:
        kept = manoeuvre.begin + 1
        x, y, heading = _straight_on(x[:kept], y[:kept], heading[:kept], float(speed[kept - 1]), x.size - kept + more, turns=True)
    elif stop == len(scenario.x):
        x, y, heading = _straight_on(x, y, heading, float(speed[-1]), more)
    off = behind[column]
    return _Track(
        name, column, start, x - off * np.cos(heading), y - off * np.sin(heading), heading,
        float(speed[0] / np.cos(heading[0])), stop < len(scenario.x),
    )  # fmt: skip


def _straight_on(
    x: NDArray[np.float64], y: NDArray[np.float64], heading: NDArray[np.float64], speed: float, more: int,
    *, turns: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Let a vehicle go on for some frames, on its heading; `turns`: along the road."""
    ahead = FRAME_S * speed * np.arange(1, more + 1)
    last = 0.0 if turns else heading[-1]
    return (
        np.concatenate([x, x[-1] + ahead]),
        np.concatenate([y, y[-1] + ahead * np.tan(last)]),
        np.concatenate([heading, np.full(more, last)]),
    )


def _indicators(scenario: Scenario, track: _Track) -> Iterable[tuple[int, str, str]]:
    """Say at which frame which indicator goes on or off, while a vehicle is not in the lane it goes to."""
    until = min(track.last, len(scenario.x) - 1) + 1
    target = scenario.target_lane[track.first : until, track.column].astype(np.int64)
    lane = np.floor(scenario.y[track.first : until, track.column] / scenario.odd.lane_width).astype(np.int64)
    side = np.sign(target - lane)
    shown = 0
    for frame in np.flatnonzero(np.diff(side, prepend=0)).tolist():
        if shown:
            yield track.first + frame, _SIDES[shown], "off"
        shown = int(side[frame])
        if shown:
            yield track.first + frame, _SIDES[shown], "on"


_SIDES: Mapping[int, str] = {1: "Left", -1: "Right"}


def _quoted(text: str) -> str:
    """Write a text as the value of an attribute; what no XML can hold, and a $ at its begin, which would name a parameter, go."""
    return quoteattr(_NO_XML.sub("\ufffd", f" {text}" if text.startswith("$") else text))


def _properties(facts: Iterable[tuple[str, Fact]]) -> str:
    return "".join(
        f"<Property name={_quoted(name)} value={_quoted(_stated(value))}/>" for name, value in facts if value is not None
    )


def _stated(value: Fact) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _position(track: _Track, frame: int) -> str:
    x, y, heading = track.x[frame], track.y[frame], track.heading[frame]
    return f'<Position><WorldPosition x="{x:.6f}" y="{y:.6f}" z="0" h="{heading:.8f}"/></Position>'


def _speed_action(speed: float, duration: float | None = None) -> str:
    dynamics = (
        'dynamicsShape="step" dynamicsDimension="time" value="0"' if duration is None
        else f'dynamicsShape="linear" dynamicsDimension="time" value="{duration:.1f}"'
    )  # fmt: skip
    return (
        f"<LongitudinalAction><SpeedAction><SpeedActionDynamics {dynamics}/><SpeedActionTarget>"
        f'<AbsoluteTargetSpeed value="{speed:.6f}"/></SpeedActionTarget></SpeedAction></LongitudinalAction>'
    )


def _lane_change_action(lane: int, duration: float) -> str:
    return (
        '<LateralAction><LaneChangeAction><LaneChangeActionDynamics dynamicsShape="sinusoidal" dynamicsDimension="time" '
        f'value="{duration:.3f}"/><LaneChangeTarget><AbsoluteTargetLane value="{lane}"/></LaneChangeTarget>'
        "</LaneChangeAction></LateralAction>"
    )


def _group(name: str, events: str) -> str:
    manoeuvre = f'<Maneuver name="{name}-manoeuvre">\n{events}</Maneuver>' if events else ""
    return f"""<ManeuverGroup name="{name}-group" maximumExecutionCount="1"><Actors selectTriggeringEntities="false">\
<EntityRef entityRef="{name}"/></Actors>{manoeuvre}</ManeuverGroup>
"""


def _when(*conditions: str) -> str:
    return f"<ConditionGroup>{''.join(conditions)}</ConditionGroup>"


def _condition(what: str, *, delay: float = 0.0) -> str:
    return f'<Condition name="condition" delay="{delay:g}" conditionEdge="none">{what}</Condition>'


def _after(time: float) -> str:
    """Make the condition that a time [s] is over; 1.0 knows no "at least", and a step may miss a time by its last bit."""
    return (
        '<Condition name="time" delay="0" conditionEdge="none"><ByValueCondition>'
        f'<SimulationTimeCondition rule="greaterThan" value="{time:.2f}"/></ByValueCondition></Condition>'
    )


def _of_the_av(condition: str) -> str:
    return (
        f'<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{AV_NAME}"/>'
        f"</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"
    )
