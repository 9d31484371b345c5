"""Actions of OpenSCENARIO files, made into motion of their vehicles."""

from __future__ import annotations

import math
from collections.abc import Callable

from cornerforge.ext.interchange.xml_input import Element
from cornerforge.ext.interchange.xosc_conditions import World
from cornerforge.ext.interchange.xosc_motion import (
    SHAPES,
    Body,
    Profile,
    Ramp,
    Shape,
    Sideways,
    Spot,
    Trajectory,
    duration_of,
)
from cornerforge.ext.interchange.xosc_parameters import Catalogs
from cornerforge.ext.interchange.xosc_places import Places, UnsupportedError

__all__ = ["MOTIONS", "SUPPORTED", "Actions", "Running", "leaf_of"]

Running = Callable[[], bool]
"""Asks whether what an action began still goes on."""
_FASTEST = 80.0
_LONG = 1e6
_MOST_VERTICES = 200_000
SUPPORTED = (
    "TeleportAction, SpeedAction, SpeedProfileAction, LaneChangeAction, LaneOffsetAction and FollowTrajectoryAction "
    "with a Polyline"
)
"""Actions that are carried over, for messages."""
_HARMLESS = frozenset({"VisibilityAction", "AppearanceAction", "LightStateAction", "AnimationAction"})
MOTIONS = frozenset({
    "TeleportAction", "SpeedAction", "SpeedProfileAction", "LongitudinalDistanceAction", "LaneChangeAction",
    "LaneOffsetAction", "LateralDistanceAction", "FollowTrajectoryAction", "AssignRouteAction", "AcquirePositionAction",
    "SynchronizeAction", "RandomRouteAction",
})  # fmt: skip
"""Actions that move a vehicle, read or not."""
_HOLDERS = frozenset(
    {"LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction", "EntityAction", "AppearanceAction"}
)


def leaf_of(action: Element) -> Element:
    """The element that says what to do, of a PrivateAction, GlobalAction or UserDefinedAction."""
    leaf = action.children[0] if action.children else action
    while leaf.tag in _HOLDERS and leaf.children:
        leaf = leaf.children[0]
    return leaf


class Actions:
    """Starts actions.

    Args:
        world: What they act on.
        catalogs: For trajectories that stand in one.
    """

    def __init__(self, world: World, catalogs: Catalogs) -> None:
        self.world, self.catalogs = world, catalogs
        self.places: Places = world.places
        self.carried = 0
        self.paths_begun = False
        """How many actions that move a vehicle were carried over."""
        self._starts: dict[str, Callable[[Element, Body], Running | None]] = {
            "TeleportAction": self._teleport,
            "SpeedAction": self._speed,
            "SpeedProfileAction": self._speed_profile,
            "LaneChangeAction": self._lane_change,
            "LaneOffsetAction": self._lane_offset,
            "FollowTrajectoryAction": self._follow,
        }

    def start(self, leaf: Element, body: Body) -> Running | None:
        """Start an action of a vehicle now; None: it is over at once, or is not carried over, which is noted.

        Raises:
            DataError: A number of it cannot be.
        """
        if leaf.tag in _HARMLESS:
            self.world.leave_out(UnsupportedError(leaf, "it moves nothing"))
            return None
        start = self._starts.get(leaf.tag)
        if start is None:
            why = f"{body.name} goes on as it was; {SUPPORTED} are read" if leaf.tag in MOTIONS else ""
            self.world.leave_out(UnsupportedError(leaf, why))
            return None
        if not body.present and leaf.tag not in ("TeleportAction", "FollowTrajectoryAction", "SpeedAction"):
            self.world.leave_out(UnsupportedError(leaf, f"{body.name} is not there"))
            return None
        try:
            body.advance(self.world.time)
            running = start(leaf, body)
        except UnsupportedError as why_not:
            self.world.leave_out(why_not)
            return None
        self.carried += 1
        body.start(self.world.time)
        return running

    def _teleport(self, element: Element, body: Body) -> None:
        body.put(self.places.spot(element.need("Position")), self.world.time)
        body.path = body.way = None
        body.lane = None

    def _speed(self, element: Element, body: Body) -> Running | None:
        shape, dimension, value = _dynamics(element.need("SpeedActionDynamics"))
        goal = element.need("SpeedActionTarget")
        absolute, relative = goal.child("AbsoluteTargetSpeed"), goal.child("RelativeTargetSpeed")
        follows = False
        if absolute is not None:
            fixed = absolute.number("value", low=0.0, high=_FASTEST, unit="m/s")
        elif relative is not None:
            moving = self._relative_speed(relative)
            fixed, follows = moving(), relative.attributes.get("continuous", "false") == "true"
        else:
            goal.fault("it names no target")
        change = fixed - body.speed
        extent, _ = duration_of(abs(change), shape, dimension, value, max(0.5 * (fixed + body.speed), 1e-3))
        target = moving if follows else lambda: fixed
        law = Ramp(self.world.time, body.speed, target, shape, extent, follows)
        body.law = law
        return lambda: body.law is law

    def _relative_speed(self, element: Element) -> Callable[[], float]:
        other = self.places.body(element)
        value = element.number("value", low=-_LONG, high=_LONG)
        if element.attributes.get("speedTargetValueType", "delta") == "factor":
            return lambda: max(0.0, other.speed * value)
        return lambda: max(0.0, other.speed + value)

    def _speed_profile(self, element: Element, body: Body) -> Running:
        if "entityRef" in element.attributes:
            raise UnsupportedError(element, "profiles relative to another vehicle are not read")
        times, speeds = [0.0], [body.speed]
        for entry in element.all("SpeedProfileEntry"):
            if "time" not in entry.attributes:
                raise UnsupportedError(entry, "entries without a time are not read")
            times.append(times[-1] + entry.number("time", low=0.0, high=_LONG, unit="s"))
            speeds.append(entry.number("speed", low=0.0, high=_FASTEST, unit="m/s"))
        if len(times) == 1:
            element.fault("it has no SpeedProfileEntry")
        law = Profile(self.world.time, times, speeds)
        body.law = law
        return lambda: body.law is law

    def _lane_change(self, element: Element, body: Body) -> Running | None:
        goal = element.need("LaneChangeTarget")
        absolute, relative = goal.child("AbsoluteTargetLane"), goal.child("RelativeTargetLane")
        frame = self.places.frame
        if absolute is not None:
            ident = absolute.integer("value", low=-1000, high=1000)
            if ident not in frame.lanes:
                raise UnsupportedError(element, f"lane {ident} is none of the AV's direction")
            lane = frame.lanes.index(ident)
        elif relative is not None:
            by = relative.integer("value", low=-1000, high=1000)
            lane = self.places.lane_beside(self.places.body(relative), by, relative)
        else:
            goal.fault("it names no target")
        offset = element.number("targetLaneOffset", 0.0, low=-100.0, high=100.0, unit="m")
        after = self.places.lane_y(lane) + frame.along * offset
        shape, dimension, value = _dynamics(element.need("LaneChangeActionDynamics"))
        extent, by_distance = duration_of(abs(after - body.y), shape, dimension, value, 0.0)
        body.lane = lane
        return self._go_aside(body, after, shape, extent, by_distance)

    def _lane_offset(self, element: Element, body: Body) -> Running | None:
        goal = element.need("LaneOffsetTarget")
        absolute, relative = goal.child("AbsoluteTargetLaneOffset"), goal.child("RelativeTargetLaneOffset")
        frame = self.places.frame
        target = absolute if absolute is not None else relative
        if target is None:
            goal.fault("it names no target")
        value = target.number("value", low=-100.0, high=100.0, unit="m")
        lane = frame.lane_of(body.y) if body.lane is None else body.lane
        after = self.places.lane_y(lane) + frame.along * value
        if relative is not None:
            other = self.places.body(relative)
            after += other.y - self.places.lane_y(frame.lane_of(other.y))
        dynamics = element.need("LaneOffsetActionDynamics")
        shape = _shape(dynamics)
        most = dynamics.number("maxLateralAcc", math.inf, low=1e-3, high=math.inf, unit="m/s2")
        bend = shape.curvature if math.isfinite(shape.curvature) else SHAPES["sinusoidal"].curvature
        extent = 0.0 if shape.slope == math.inf else math.sqrt(bend * abs(after - body.y) / most)
        return self._go_aside(body, after, shape, extent, False)

    def _go_aside(self, body: Body, after: float, shape: Shape, extent: float, by_distance: bool) -> Running:
        body.path = None
        way = Sideways(0.0 if by_distance else self.world.time, body.y, after, shape, extent, by_distance)
        body.way = way
        return lambda: body.way is way

    def _follow(self, element: Element, body: Body) -> Running:
        holder = element.child("TrajectoryRef") or element
        trajectory, reference = holder.child("Trajectory"), holder.child("CatalogReference")
        if trajectory is None and reference is not None:
            trajectory = self.catalogs.entry(reference)
        if trajectory is None:
            element.fault("it names no Trajectory")
        line = trajectory.child("Shape", "Polyline")
        if line is None:
            shape = trajectory.child("Shape")
            kind = shape.children[0].tag if shape is not None and shape.children else "nothing"
            raise UnsupportedError(element, f"its shape is a {kind}; {body.name} goes on as it was; Polylines are read")
        spots, times = self._vertices(line)
        timing = element.child("TimeReference", "Timing")
        if timing is None:
            times = []
        path = Trajectory(spots, _stretched(times, timing, self.world.time), all(spot.turned for spot in spots))
        if len(path.times) == 0:
            path.gone = element.number("initialDistanceOffset", 0.0, low=0.0, high=_LONG, unit="m")
        body.path, body.way, body.lane = path, None, None
        self.paths_begun = True
        if not body.present:
            body.put(spots[0], self.world.time)
        return lambda: body.path is path

    def _vertices(self, line: Element) -> tuple[list[Spot], list[float]]:
        spots: list[Spot] = []
        times: list[float] = []
        for vertex in line.all("Vertex"):
            spots.append(self.places.spot(vertex.need("Position")))
            if "time" in vertex.attributes:
                times.append(vertex.number("time", low=0.0, high=_LONG, unit="s"))
                if len(times) > 1 and times[-1] < times[-2]:
                    vertex.fault(f"its time is {times[-1]:g} s, after one of {times[-2]:g} s; times must rise")
        if times and len(times) != len(spots):
            line.fault(f"{len(times)} of {len(spots)} vertices have a time; all or none can have one")
        if len(spots) < 2:
            line.fault("a Polyline needs two vertices at least")
        if len(spots) > _MOST_VERTICES:
            line.fault(f"there are {len(spots):,} vertices; up to {_MOST_VERTICES:,} are read")
        return spots, times


def _stretched(times: list[float], timing: Element | None, now: float) -> list[float]:
    """Times of the scenario of those of a trajectory's vertices."""
    if timing is None or not times:
        return []
    offset = timing.number("offset", low=-_LONG, high=_LONG, unit="s")
    scale = timing.number("scale", low=1e-6, high=_LONG)
    begin = offset + (now if timing.string("domainAbsoluteRelative") == "relative" else 0.0)
    return [begin + scale * time for time in times]


def _shape(element: Element) -> Shape:
    name = element.string("dynamicsShape")
    if name not in SHAPES:
        element.fault(f'dynamicsShape "{name[:40]}" is none of {", ".join(SHAPES)}')
    return SHAPES[name]


def _dynamics(element: Element) -> tuple[Shape, str, float]:
    dimension = element.string("dynamicsDimension")
    if dimension not in ("time", "distance", "rate"):
        element.fault(f'dynamicsDimension "{dimension[:40]}" is none of time, distance, rate')
    value = element.number("value", low=-_LONG if dimension == "rate" else 0.0, high=_LONG)
    return _shape(element), dimension, value
