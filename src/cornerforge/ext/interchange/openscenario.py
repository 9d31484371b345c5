"""Cases as ASAM OpenSCENARIO XML, versions 1.0 to 1.3, for players and simulators.

Positions are of the rear axle's centre, as the standard wants it: x and y in metres on the axes of the road's file,
headings in radians counter-clockwise. Numbers have six decimals, so a box that is read back is within a hundredth of a
millimetre of the recorded one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge._files import writing
from cornerforge.errors import InputError
from cornerforge.ext.interchange import openscenario_elements as xosc
from cornerforge.ext.interchange.opendrive import lane_id, write_road_once
from cornerforge.ext.interchange.opendrive_lanes import in_world, is_straight
from cornerforge.ext.interchange.relative import Manoeuvre, Trigger, manoeuvre_of
from cornerforge.library.out_case import Fact, OutCase, check_name
from cornerforge.types import CAR, FRAME_S, MOTORCYCLE, TRUCK, Scenario

__all__ = ["AV_NAME", "MODES", "NO_DATE", "VERSIONS", "reference_behind", "write_openscenario"]

VERSIONS: Final = ("1.0", "1.1", "1.2", "1.3")
MODES: Final = ("recorded", "controller", "relative")
AV_NAME: Final = "Ego"
"""Name of the AV; the others are BV and their slot."""
NO_DATE: Final = "1970-01-01T00:00:00Z"
"""The standard wants a date. This constant stands for no date: the same case gives the same bytes on any day."""
_AFTER_CONTACT = 5
"""Frames that go on after a contact; more would drive boxes through each other."""
_AFTER_END = 30
"""Frames for which the others go on after the record, where another AV drives."""
_COLLISION_S = 0.5
"""How long a test goes on after a contact of another AV [s]."""
_MARGIN = 20.0
"""The least road before the last vehicle and after the first [m]."""
_SIDES: Mapping[int, str] = {1: "Left", -1: "Right"}


@dataclass(frozen=True)
class _Build:
    """How vehicles of a class are built, as usual: no record says it.

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
        name: Name of the entity.
        column: In the scenario.
        first: Its first frame.
        x, y, heading: Pose of its reference point [m], [rad], (F,).
        speed: At its first frame, along its way [m/s].
        reach: From where to where its reference point comes, as x of the simulator [m].
        leaves: It is gone before the end.
    """

    name: str
    column: int
    first: int
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    speed: float
    reach: tuple[float, float]
    leaves: bool

    @property
    def last(self) -> int:
        return self.first + self.x.size - 1

    @property
    def start(self) -> str:
        return xosc.position(self.x[0], self.y[0], self.heading[0])


def reference_behind(kind: int, length: float) -> float:
    """Say how far the reference point, the rear axle's centre, is behind the box's centre [m].

    >>> round(reference_behind(CAR, 5.0), 6)
    1.4
    """
    return 0.5 * _BUILDS[kind].wheelbase * length


def write_openscenario(
    case: OutCase,
    folder: Path,
    *,
    version: str = "1.2",
    mode: str = "recorded",
    controller: str = "AV",
    date: str = NO_DATE,
) -> tuple[str, ...]:
    """Write a case as OpenSCENARIO XML, and its road as OpenDRIVE beside it.

    Modes:

    - `recorded`: All vehicles follow what was recorded, a vertex each 0.1 s, in absolute time. After a contact they go
      straight on for 0.5 s, at the speeds they had; then the storyboard stops.
    - `controller`: The AV has its start state, its speed and a controller, which the file names and activates; the rest
      is the user's. The others drive as recorded, and then straight on for 3 s at their last speeds. The storyboard
      stops after that, or 0.5 s after the AV's first contact.
    - `relative`: As `controller`, but the last manoeuvre of the AV's crash partner before the contact begins when the
      AV is where the recorded one was, relative to it: at the recorded time gap (bumper to bumper, over the AV's
      speed) if the partner is ahead, else at the recorded distance along the road between reference points. Until then
      the partner drives as recorded, and goes straight on at its speed if the AV is late; if the AV never comes as
      near, the manoeuvre never begins.
      Kept: where the partner is until then; its lane changes in their order, an aborted one too, and how long they
      take; its speed at each second. Lost: the quintic shape of a lane change (here half a wave of a cosine, as far
      across at its middle), accelerations within a second, and the times. Where the same gap occurred before the
      recorded begin too, a second condition wants the time of that to be over.
      All others drive as recorded. If the AV met no vehicle, or its partner neither changed lanes nor braked, the
      property `relative_manoeuvre` says "none", and the file is as in `controller`.

    A vehicle that comes later is added then, one that goes is deleted; one that comes again is another entity.
    Indicators are written from version 1.2 on, while a vehicle is not in the lane it goes to, but not for an AV with a
    controller. The schema of 1.2 wants an animation and a light of the user's own beside each light, the schema of 1.3
    wants one of them: in 1.2 both are there, named "none", and esmini then leaves out the light. Masses are written
    from 1.1 on. Heights, axles and masses are those usual in a class.

    Args:
        case: The case.
        folder: Where its files go; it is made.
        version: Version of OpenSCENARIO, one of `VERSIONS`.
        mode: One of `MODES`.
        controller: Name of the user's controller, where there is one.
        date: When it was written, in ISO 8601.

    Returns:
        Names of its files: the scenario, and its road, which all cases on the same road share.

    Raises:
        InputError: The version or mode is not known, the case's name is no file name, a number is not finite, the AV is
            not there in the first frame, the date is invalid, or OpenDRIVE or the mode cannot hold the road.
        OutputError: A file cannot be written.
    """
    check_in("OpenSCENARIO version", version, VERSIONS)
    check_in("mode of OpenSCENARIO", mode, MODES)
    check_name(case.name)
    if not controller.strip():
        raise InputError("The controller of the AV has no name; give it one.")
    on = case.scenario.odd.road
    if mode == "relative" and on is not None and not is_straight(on):
        raise InputError(
            f"The mode relative measures along straight lanes of one width, and the road {on.name} has others; use "
            "recorded or controller."
        )
    if not case.scenario.present[0, 0]:
        raise InputError(f"Case {case.name}: the AV is not there in the first frame.")
    _check_date(date)
    writer = _Writer(case, int(version[2:]), mode, controller, date)
    road = write_road_once(case.scenario.odd, folder, *writer.reach)
    file = f"{case.name}.xosc"
    text = writer.text(road)
    with writing(folder / file, "the scenario") as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return file, road


def _check_date(date: str) -> None:
    try:
        if len(date) < len("2026-01-01T00:00:00"):
            raise ValueError
        datetime.fromisoformat(date)
    except ValueError:
        raise InputError(f'date = "{date}" is no time; write it like 2026-01-31T12:00:00.') from None


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
            [reference_behind(int(k), float(length)) for k, length in zip(scenario.kind, scenario.length, strict=True)]
        )
        self.relative = mode == "relative"
        self.manoeuvre = manoeuvre_of(scenario, self.behind) if self.relative else None
        more = _AFTER_END if self.controller is not None else (_AFTER_CONTACT if scenario.crash is not None else 0)
        self.end = len(scenario.x) - 1 + more
        self.tracks = _tracks(scenario, self.behind, more, self.manoeuvre)
        self.override = "overwrite" if minor < 2 else "override"

    @property
    def reach(self) -> tuple[float, float]:
        """Stretch of road with vehicles [m], with some road before and behind."""
        return (
            min(track.reach[0] for track in self.tracks) - _MARGIN,
            max(track.reach[1] for track in self.tracks) + _MARGIN,
        )

    def text(self, road: str) -> str:
        facts = xosc.properties(self._facts())
        in_header = f"<Properties>{facts}</Properties>" if self.minor >= 2 else ""
        entities = "".join(self._entity(track, "" if self.minor >= 2 else facts) for track in self.tracks)
        init = "".join(self._init(track) for track in self.tracks if track.first == 0)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSCENARIO>
<FileHeader revMajor="1" revMinor="{self.minor}" date={xosc.quoted(self.date)} author="cornerforge" \
description={xosc.quoted(f"Case {self.case.name}")}>{in_header}</FileHeader>
<CatalogLocations/>
<RoadNetwork><LogicFile filepath={xosc.quoted(road)}/></RoadNetwork>
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
            yield "contact_s", float(self.scenario.crash.time)
        yield "recorded_s", round(FRAME_S * (len(self.scenario.x) - 1), 1)
        if self.relative:
            yield "relative_manoeuvre", "none" if self.manoeuvre is None else self.manoeuvre.kind
        if self.manoeuvre is not None:
            yield "relative_begin_s", round(FRAME_S * self.manoeuvre.begin, 1)
            yield "relative_measure", self.manoeuvre.trigger.measure

    # Entities

    def _entity(self, track: _Track, facts: str) -> str:
        scenario, column = self.scenario, track.column
        build = _BUILDS[int(scenario.kind[column])]
        length, width = float(scenario.length[column]), float(scenario.width[column])
        mass = f' mass="{build.mass:g}"' if self.minor >= 1 else ""
        axle = (
            f'maxSteering="0.5" trackWidth="{0.8 * width:g}" wheelDiameter="{build.wheel:g}" '
            f'positionZ="{0.5 * build.wheel:g}"'
        )
        fastest = max(scenario.odd.max_speed, 1.2 * track.speed)
        slot = f'<Property name="slot" value="{int(scenario.slot[column])}"/>'
        own = (facts, self._object_controller()) if column == 0 else ("", "")
        return f"""<ScenarioObject name="{track.name}">\
<Vehicle name="{build.category}" vehicleCategory="{build.category}"{mass}>
<BoundingBox><Center x="{self.behind[column]:.6f}" y="0" z="{0.5 * build.height:g}"/>\
<Dimensions width="{width:.6f}" length="{length:.6f}" height="{build.height:g}"/></BoundingBox>
<Performance maxSpeed="{fastest:.3f}" maxAcceleration="10" maxDeceleration="12"/>
<Axles><FrontAxle positionX="{2.0 * self.behind[column]:.6f}" {axle}/><RearAxle positionX="0" {axle}/></Axles>
<Properties>{slot}{own[0]}</Properties></Vehicle>{own[1]}</ScenarioObject>
"""

    def _object_controller(self) -> str:
        if self.controller is None:
            return ""
        name = xosc.quoted(self.controller)
        outer = f" name={name}" if self.minor >= 3 else ""
        kind = ' controllerType="movement"' if self.minor >= 2 else ""
        return (
            f"<ObjectController{outer}><Controller name={name}{kind}>"
            '<Properties><Property name="placeholder" value="true"/></Properties></Controller></ObjectController>'
        )

    # State at the start

    def _init(self, track: _Track) -> str:
        driven = track.column == 0 and self.controller is not None
        teleport = xosc.private(f"<TeleportAction>{track.start}</TeleportAction>")
        then = self._activate() if driven else self._follow(track)
        return f"""<Private entityRef="{track.name}">
{teleport}{xosc.speed_change(track.speed)}{then}</Private>
"""

    def _activate(self) -> str:
        attribute = {2: "controllerRef", 3: "objectControllerRef"}.get(self.minor)
        named = f" {attribute}={xosc.quoted(self.controller or '')}" if attribute else ""
        action = f'<ActivateControllerAction{named} longitudinal="true" lateral="true"/>'
        return xosc.private(f"<ControllerAction>{action}</ControllerAction>" if self.minor >= 1 else action)

    def _follow(self, track: _Track) -> str:
        """Follow a track in absolute time; a vehicle that is there for one frame only has no way to follow."""
        if track.x.size < 2:
            return ""
        frames = np.arange(track.first, track.last + 1)
        rows = np.stack([FRAME_S * frames, track.x, track.y, track.heading], axis=1)
        vertices = (xosc.VERTEX * len(rows)) % tuple(rows.ravel().tolist())
        trajectory = f"""<Trajectory name="{track.name}-trajectory" closed="false"><Shape><Polyline>
{vertices}</Polyline></Shape></Trajectory>"""
        if self.minor >= 1:
            trajectory = f"<TrajectoryRef>{trajectory}</TrajectoryRef>"
        return xosc.private(f"""<RoutingAction><FollowTrajectoryAction>{trajectory}
<TimeReference><Timing domainAbsoluteRelative="absolute" scale="1" offset="0"/></TimeReference>\
<TrajectoryFollowingMode followingMode="follow"/>
</FollowTrajectoryAction></RoutingAction>""")

    # What happens later

    def _story(self) -> str:
        events = {track.name: "".join(self._events(track)) for track in self.tracks}
        groups = [xosc.group(name, text) for name, text in events.items() if text] or [xosc.group(AV_NAME, "")]
        return f"""<Story name="story"><Act name="act">
{"".join(groups)}<StartTrigger>{xosc.all_of(xosc.after(-1.0))}</StartTrigger></Act></Story>
"""

    def _events(self, track: _Track) -> Iterable[str]:
        yield from self._comes_and_goes(track)
        lights = list(self._lights(track))
        if self.manoeuvre is not None and track.column == self.manoeuvre.column:
            begin = self.manoeuvre.begin
            later = [(frame, name, light) for frame, name, light in lights if frame >= begin]
            yield from self._manoeuvre_events(track, self.manoeuvre, later)
            lights = lights[: len(lights) - len(later)]
        for frame, name, light in lights:
            yield self._event(name, [light], xosc.after(FRAME_S * (frame - 0.5)), priority="parallel")

    def _comes_and_goes(self, track: _Track) -> Iterable[str]:
        entity = f'<GlobalAction><EntityAction entityRef="{track.name}">%s</EntityAction></GlobalAction>\n'
        if track.first > 0:
            comes = entity % f"<AddEntityAction>{track.start}</AddEntityAction>"
            actions = [comes, xosc.speed_change(track.speed), self._follow(track)]
            yield self._event(f"{track.name}-comes", actions, xosc.after(FRAME_S * (track.first - 0.5)))
        if track.leaves:
            goes = entity % "<DeleteEntityAction/>"
            yield self._event(f"{track.name}-goes", [goes], xosc.after(FRAME_S * (track.last + 0.5)))

    def _lights(self, track: _Track) -> Iterable[tuple[int, str, str]]:
        """Say at which frame which indicator goes on or off: frame, name of the event, action."""
        if self.minor < 2 or (track.column == 0 and self.controller is not None):
            return
        own, animation = "", ""
        if self.minor == 2:
            own = '<UserDefinedLight userDefinedLightType="none"/>'
            animation = (
                '<AnimationAction><AnimationType><UserDefinedAnimation userDefinedAnimationType="none"/>'
                '</AnimationType><AnimationState state="0"/></AnimationAction>'
            )
        for frame, side, is_on in _indicators(self.scenario, track):
            light = xosc.private(
                f'<AppearanceAction><LightStateAction><LightType><VehicleLight vehicleLightType="indicator{side}"/>'
                f'{own}</LightType><LightState mode="{"flashing" if is_on else "off"}"/></LightStateAction>'
                f"{animation}</AppearanceAction>"
            )
            yield frame, f"{track.name}-{side}-{'on' if is_on else 'off'}-{frame}", light

    def _manoeuvre_events(
        self, track: _Track, manoeuvre: Manoeuvre, lights: Iterable[tuple[int, str, str]]
    ) -> Iterable[str]:
        lanes = self.scenario.odd.n_lanes
        parts = [
            *(
                (part.delay, xosc.lane_change(lane_id(part.lane, lanes), part.offset, part.duration))
                for part in manoeuvre.lanes
            ),
            *((part.delay, xosc.speed_change(part.speed, part.duration)) for part in manoeuvre.speeds),
            *((FRAME_S * (frame - manoeuvre.begin), light) for frame, _, light in lights),
        ]
        begins = f"{track.name}-begins"
        first = [action for delay, action in parts if delay == 0.0]
        yield self._event(begins, first, *self._begin(track.name, manoeuvre.trigger))
        for number, (delay, action) in enumerate(part for part in parts if part[0] > 0.0):
            then = xosc.event_has_begun(begins, delay)
            yield self._event(f"{track.name}-goes-on-{number + 1}", [action], then, priority="parallel")

    def _begin(self, partner: str, trigger: Trigger) -> list[str]:
        """Make the conditions under which the manoeuvre begins; all must be met."""
        compared = f'rule="{trigger.rule}" value="{trigger.value:.6f}"'
        system = ' coordinateSystem="road"' if self.minor >= 1 else ""
        if trigger.measure == "time gap":
            along = f'{system} relativeDistanceType="longitudinal"' if self.minor >= 1 else ' alongRoute="true"'
            met = f'<TimeHeadwayCondition entityRef="{partner}" freespace="true" {compared}{along}/>'
        else:
            along = f'{system} relativeDistanceType="longitudinal"'
            met = f'<RelativeDistanceCondition entityRef="{partner}" freespace="false" {compared}{along}/>'
        conditions = [xosc.of_entity(AV_NAME, met)]
        if trigger.not_before is not None:
            conditions.append(xosc.after(trigger.not_before))
        return conditions

    def _event(self, name: str, actions: Iterable[str], *conditions: str, priority: str = "") -> str:
        named = (
            f'<Action name="{name}-{number}">{action}</Action>\n' for number, action in enumerate(actions) if action
        )
        return f"""<Event name="{name}" priority="{priority or self.override}" maximumExecutionCount="1">
{"".join(named)}<StartTrigger>{xosc.all_of(*conditions)}</StartTrigger></Event>
"""

    def _stop(self) -> str:
        groups = [xosc.all_of(xosc.after(FRAME_S * self.end))]
        if self.controller is not None:
            met = '<CollisionCondition><ByType type="vehicle"/></CollisionCondition>'
            groups.append(xosc.all_of(xosc.of_entity(AV_NAME, met, delay=_COLLISION_S)))
        return f"<StopTrigger>{''.join(groups)}</StopTrigger>\n"


def _tracks(scenario: Scenario, behind: NDArray[np.float64], more: int, manoeuvre: Manoeuvre | None) -> list[_Track]:
    """Cut the recorded motion into vehicles that are there without a break; they go on for `more` frames."""
    tracks = []
    for column in range(scenario.slot.size):
        begin = manoeuvre.begin if manoeuvre is not None and manoeuvre.column == column else None
        edges = np.flatnonzero(np.diff(scenario.present[:, column].astype(np.int8), prepend=0, append=0)).tolist()
        name = AV_NAME if column == 0 else f"BV{int(scenario.slot[column])}"
        for number, (start, stop) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
            here = slice(start, stop)
            x, y, heading, speed = _motion(scenario, column, here)
            if begin is not None:
                missing = x.size - begin - 1 + more
                x, y = x[: begin + 1], y[: begin + 1]
                x, y, heading = _straight_on(x, y, heading[: begin + 1], float(speed[begin]), missing, along_road=True)
            elif stop == len(scenario.x):
                x, y, heading = _straight_on(x, y, heading, float(speed[-1]), more)
            along = x - behind[column] * np.cos(heading)
            reach = float(along.min()), float(along.max())
            along_its_way = float(speed[0] / np.cos(heading[0]))
            x, y, heading, _, _, stretch = in_world(scenario.odd, x, y, heading)
            x, y = x - behind[column] * np.cos(heading), y - behind[column] * np.sin(heading)
            speed_there = along_its_way * float(stretch[0])
            own_name = f"{name}-{number + 1}" if number else name
            leaves = stop < len(scenario.x)
            tracks.append(_Track(own_name, column, start, x, y, heading, speed_there, reach, leaves))
    return tracks


def _motion(scenario: Scenario, column: int, here: slice) -> list[NDArray[np.float64]]:
    """Take x, y, heading and speed of a vehicle from the record.

    Raises:
        InputError: One is not finite where the vehicle is said to be there.
    """
    motion = [values[here, column] for values in (scenario.x, scenario.y, scenario.heading, scenario.speed)]
    if not all(np.isfinite(values).all() for values in motion):
        raise InputError(
            f"Vehicle {int(scenario.slot[column])} has no finite place, heading or speed at a time when it is there; "
            "mend the case, or leave the vehicle out."
        )
    return motion


def _straight_on(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    heading: NDArray[np.float64],
    speed: float,
    more: int,
    *,
    along_road: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Let a vehicle go on for some frames at its speed, on its heading or along the road."""
    way = FRAME_S * speed * np.arange(1, more + 1)
    last = 0.0 if along_road else float(heading[-1])
    return (
        np.concatenate([x, x[-1] + way]),
        np.concatenate([y, y[-1] + way * np.tan(last)]),
        np.concatenate([heading, np.full(more, last)]),
    )


def _indicators(scenario: Scenario, track: _Track) -> Iterable[tuple[int, str, bool]]:
    """Say at which frame which indicator goes on or off, while a vehicle is not in the lane it goes to."""
    here = slice(track.first, min(track.last + 1, len(scenario.x)))
    target = scenario.target_lane[here, track.column].astype(np.int64)
    lane = np.floor(scenario.y[here, track.column] / scenario.odd.lane_width).astype(np.int64)
    side = np.sign(target - lane)
    shown = 0
    for frame in np.flatnonzero(np.diff(side, prepend=0)).tolist():
        if shown:
            yield track.first + frame, _SIDES[shown], False
        shown = int(side[frame])
        if shown:
            yield track.first + frame, _SIDES[shown], True
