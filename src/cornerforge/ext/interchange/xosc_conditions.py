"""Triggers of OpenSCENARIO files: when what begins.

Moments are sampled. A condition on the time of the simulation holds from that time on, whether the file says "greater
than" or "greater or equal": the first moment after 0 is 0 here. A condition with an edge does not hold when it is
looked at for the first time, as the standard says, except if it is one on time or on the state of the storyboard.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from cornerforge.ext.interchange.xml_input import Element
from cornerforge.ext.interchange.xosc_motion import Body
from cornerforge.ext.interchange.xosc_places import Places, UnsupportedError

__all__ = ["RULES", "Trigger", "World"]

_LONG = 1e6
_SOON = 1e-9
_AT_ONCE = frozenset({"SimulationTimeCondition", "StoryboardElementStateCondition", "ParameterCondition"})
_LONGITUDINAL, _LATERAL = ("longitudinal", "lateral")

Question = Callable[[], bool]
RULES: dict[str, Callable[[float, float], bool]] = {
    "greaterThan": lambda a, b: a > b,
    "greaterOrEqual": lambda a, b: a >= b,
    "lessThan": lambda a, b: a < b,
    "lessOrEqual": lambda a, b: a <= b,
    "equalTo": lambda a, b: a == b,
    "notEqualTo": lambda a, b: a != b,
}
"""Rules of comparison."""


class World(Protocol):
    """State that conditions look at.

    Attributes:
        time: Time of the simulation [s].
        step: Number of the moment, for transitions.
        bodies: All vehicles by name.
        places: Positions.
        parameters: Values of the file's parameters.
    """

    time: float
    step: int
    bodies: Mapping[str, Body]
    places: Places
    parameters: Mapping[str, str]

    def state(self, kind: str, name: str, wanted: str, element: Element) -> bool:
        """Is an element of the storyboard in a state, or has it just changed to it?"""

    def leave_out(self, why: UnsupportedError) -> None:
        """Note what is not carried over."""


class _Compared:
    """Compares a number that changes with a fixed one; "equal" holds also in the moment in which it is passed."""

    def __init__(self, element: Element, *, low: float = -_LONG, high: float = _LONG, unit: str = "") -> None:
        rule = element.attributes.get("rule", "greaterThan")
        if rule not in RULES:
            element.fault(f'rule "{rule[:40]}" is none of {", ".join(RULES)}')
        self.equal = rule in ("equalTo", "notEqualTo")
        self.negated = rule == "notEqualTo"
        self.rule = RULES[rule]
        self.value = element.number("value", low=low, high=high, unit=unit)
        self.before: float | None = None

    def holds(self, number: float) -> bool:
        if not self.equal:
            return self.rule(number, self.value)
        off, before = number - self.value, self.before
        self.before = off
        passed = abs(off) < _SOON or (before is not None and off * before < 0.0)
        return passed != self.negated


class Trigger:
    """A trigger: one of its groups of conditions must hold, each of the group's conditions at once.

    Args:
        element: StartTrigger or StopTrigger.
        world: What it looks at.
        step_s: Time between two looks [s].
    """

    def __init__(self, element: Element, world: World, step_s: float) -> None:
        self.groups = [
            [_Condition(part, world, step_s) for part in group.all("Condition")]
            for group in element.all("ConditionGroup")
        ]
        self.groups = [group for group in self.groups if group]
        self.looks_at_vehicles = any(condition.looks_at_vehicles for group in self.groups for condition in group)
        """Does it depend on where vehicles are?"""
        self.size = sum(map(len, self.groups))
        """Number of its conditions."""

    def holds(self) -> bool:
        """Look whether it holds now; to be asked at every moment while it is waited for."""
        result = False
        for group in self.groups:
            looked = [condition.holds() for condition in group]  # all of them: edges are between moments
            result = result or all(looked)
        return result


class _Condition:
    def __init__(self, element: Element, world: World, step_s: float) -> None:
        self.edge = element.attributes.get("conditionEdge", "none")
        if self.edge not in ("none", "rising", "falling", "risingOrFalling"):
            element.fault(f'conditionEdge "{self.edge[:40]}" is none of none, rising, falling, risingOrFalling')
        delay = element.number("delay", 0.0, low=0.0, high=_LONG, unit="s")
        self.delay = math.ceil(delay / step_s - 1e-6)
        self.late: deque[bool] = deque()
        self.before: bool | None = None
        self.looks_at_vehicles = element.child("ByEntityCondition") is not None
        self.asked: Question = lambda: False
        try:
            kind, self.asked = _question(element, world)
            if kind in _AT_ONCE:
                self.before = False
        except UnsupportedError as why:
            world.leave_out(why)

    def holds(self) -> bool:
        now, before = self.asked(), self.before
        self.before = now
        rises, falls = before is False and now, before is True and not now
        result = {"none": now, "rising": rises, "falling": falls, "risingOrFalling": rises or falls}[self.edge]
        if self.delay == 0:
            return result
        self.late.append(result)
        return self.late.popleft() if len(self.late) > self.delay else False


def _question(element: Element, world: World) -> tuple[str, Question]:
    by_value, by_entity = element.child("ByValueCondition"), element.child("ByEntityCondition")
    if by_value is not None and by_value.children:
        condition = by_value.children[0]
        if condition.tag not in _BY_VALUE:
            raise UnsupportedError(condition, "it never holds")
        return condition.tag, _BY_VALUE[condition.tag](condition, world)
    if by_entity is None:
        return element.fault(f'condition "{element.attributes.get("name", "")[:40]}" asks for nothing')
    whole = by_entity.need("EntityCondition")
    condition = whole.children[0] if whole.children else whole
    if condition.tag not in _BY_ENTITY:
        raise UnsupportedError(condition, "it never holds")
    triggering = by_entity.need("TriggeringEntities")
    names = [part.string("entityRef") for part in triggering.all("EntityRef")]
    for name in names:
        if name not in world.bodies:
            triggering.fault(f'there is no entity "{name[:40]}"')
    rule: Callable[[Iterable[bool]], bool] = (
        all if triggering.attributes.get("triggeringEntitiesRule") == "all" else any
    )
    asked = [(world.bodies[name], _BY_ENTITY[condition.tag](condition, world)) for name in names]

    def holds() -> bool:
        try:
            looked = [body.present and ask(body) for body, ask in asked]  # all of them, as above
            return rule(looked)
        except UnsupportedError as why:
            world.leave_out(why)
            return False

    return condition.tag, holds


def _simulation_time(element: Element, world: World) -> Question:
    value = element.number("value", low=-_LONG, high=_LONG, unit="s")
    rule = element.attributes.get("rule", "greaterThan")
    if rule not in RULES:
        element.fault(f'rule "{rule[:40]}" is none of {", ".join(RULES)}')
    if rule in ("greaterThan", "greaterOrEqual"):
        return lambda: world.time >= value - _SOON
    if rule in ("lessThan", "lessOrEqual"):
        return lambda: world.time < value - _SOON
    passed = _Compared(element)
    return lambda: passed.holds(world.time)


def _element_state(element: Element, world: World) -> Question:
    kind, name = element.string("storyboardElementType"), element.string("storyboardElementRef")
    wanted = element.string("state")
    return lambda: world.state(kind, name, wanted, element)


def _parameter(element: Element, world: World) -> Question:
    name, value = element.string("parameterRef").lstrip("$"), element.string("value")
    rule = element.string("rule")
    if name not in world.parameters:
        element.fault(f'parameter "{name[:40]}" is not declared')
    is_value = world.parameters[name]
    try:
        holds = RULES.get(rule, RULES["equalTo"])(float(is_value), float(value))
    except ValueError:
        holds = (is_value == value) != (rule == "notEqualTo")
    return lambda: holds


def _gap(a: Body, x: float, y: float, ends: tuple[float, float], width: float, element: Element) -> float:
    """Distance of a vehicle from a place, or from the box of another there, as a condition states it [m]."""
    free = element.attributes.get("freespace", "false") == "true"
    system = element.attributes.get("coordinateSystem", "entity")
    kind = element.attributes.get("relativeDistanceType", "")
    if element.attributes.get("alongRoute") == "true" and not kind:
        kind = _LONGITUDINAL
    dx, dy = x - a.x, y - a.y
    if system == "entity" and kind in (_LONGITUDINAL, _LATERAL):
        cos, sin = math.cos(a.heading), math.sin(a.heading)
        dx, dy = dx * cos + dy * sin, dy * cos - dx * sin
    front, rear = a.ends
    along = max(0.0, (dx - front - ends[1]) if dx > 0.0 else (-dx - rear - ends[0])) if free else abs(dx)
    across = max(0.0, abs(dy) - 0.5 * (a.width + width)) if free else abs(dy)
    if kind == _LONGITUDINAL:
        return along
    return across if kind == _LATERAL else math.hypot(along, across)


def _to_body(a: Body, b: Body, element: Element) -> float:
    return _gap(a, b.x, b.y, b.ends, b.width, element)


def _relative_distance(element: Element, world: World) -> Callable[[Body], bool]:
    compared = _Compared(element, unit="m")
    return lambda a: compared.holds(_to_body(a, world.places.body(element), element))


def _distance(element: Element, world: World) -> Callable[[Body], bool]:
    compared, position = _Compared(element, unit="m"), element.need("Position")

    def holds(a: Body) -> bool:
        spot = world.places.spot(position)
        return compared.holds(_gap(a, spot.x, spot.y, (0.0, 0.0), 0.0, element))

    return holds


def _time_headway(element: Element, world: World) -> Callable[[Body], bool]:
    compared = _Compared(element, unit="s")
    if "relativeDistanceType" not in element.attributes:
        element.attributes["relativeDistanceType"] = _LONGITUDINAL

    def holds(a: Body) -> bool:
        gap = _to_body(a, world.places.body(element), element)
        return compared.holds(gap / a.speed if a.speed > _SOON else math.inf)

    return holds


def _time_to_collision(element: Element, world: World) -> Callable[[Body], bool]:
    compared, target = _Compared(element, unit="s"), element.need("TimeToCollisionConditionTarget")
    reference, position = target.child("EntityRef"), target.child("Position")
    if "relativeDistanceType" not in element.attributes:
        element.attributes["relativeDistanceType"] = _LONGITUDINAL

    def holds(a: Body) -> bool:
        if reference is not None:
            b = world.places.body(reference)
            x, y, ends, width, speed = b.x, b.y, b.ends, b.width, b.along_road
        elif position is not None:
            spot = world.places.spot(position)
            x, y, ends, width, speed = spot.x, spot.y, (0.0, 0.0), 0.0, 0.0
        else:
            return False
        closing = (a.along_road - speed) * (1.0 if x > a.x else -1.0)
        gap = _gap(a, x, y, ends, width, element)
        return compared.holds(gap / closing if closing > _SOON else math.inf)

    return holds


def _reach(element: Element, world: World) -> Callable[[Body], bool]:
    within, position = element.number("tolerance", low=0.0, high=_LONG, unit="m"), element.need("Position")

    def holds(a: Body) -> bool:
        spot = world.places.spot(position)
        return math.hypot(spot.x - a.x, spot.y - a.y) <= within

    return holds


def _speed(element: Element, _: World) -> Callable[[Body], bool]:
    compared = _Compared(element, unit="m/s")
    along = element.attributes.get("direction", _LONGITUDINAL)
    if along != _LONGITUDINAL:
        raise UnsupportedError(element, f"direction {along[:40]}; it never holds")
    return lambda a: compared.holds(a.speed)


def _relative_speed(element: Element, world: World) -> Callable[[Body], bool]:
    compared = _Compared(element, unit="m/s")
    return lambda a: compared.holds(a.speed - world.places.body(element).speed)


def _acceleration(element: Element, _: World) -> Callable[[Body], bool]:
    compared = _Compared(element, unit="m/s2")
    return lambda a: compared.holds(a.acceleration)


def _travelled(element: Element, _: World) -> Callable[[Body], bool]:
    value = element.number("value", low=0.0, high=_LONG, unit="m")
    return lambda a: a.travelled >= value - _SOON


def _standstill(element: Element, _: World) -> Callable[[Body], bool]:
    duration = element.number("duration", low=0.0, high=_LONG, unit="s")
    return lambda a: a.stands > 0.0 and a.stands >= duration - _SOON


def _collision(element: Element, world: World) -> Callable[[Body], bool]:
    reference = element.child("EntityRef")
    if reference is not None:
        return lambda a: _touch(a, world.places.body(reference))
    return lambda a: any(b is not a and b.present and _touch(a, b) for b in world.bodies.values())


def _touch(a: Body, b: Body) -> bool:
    """Whether two boxes overlap; always False for an AV with unknown motion."""
    if a.unknown or b.unknown:
        return False
    (ax, ay), (bx, by) = a.middle, b.middle
    dx, dy = bx - ax, by - ay
    for body in (a, b):
        for turn in (0.0, 0.5 * math.pi):
            cos, sin = math.cos(body.heading + turn), math.sin(body.heading + turn)
            reach = sum(
                0.5 * other.length * abs(math.cos(other.heading) * cos + math.sin(other.heading) * sin)
                + 0.5 * other.width * abs(math.cos(other.heading) * sin - math.sin(other.heading) * cos)
                for other in (a, b)
            )
            if abs(dx * cos + dy * sin) > reach:
                return False
    return True


_BY_VALUE: dict[str, Callable[[Element, World], Question]] = {
    "SimulationTimeCondition": _simulation_time,
    "StoryboardElementStateCondition": _element_state,
    "ParameterCondition": _parameter,
}
_BY_ENTITY: dict[str, Callable[[Element, World], Callable[[Body], bool]]] = {
    "AccelerationCondition": _acceleration,
    "CollisionCondition": _collision,
    "DistanceCondition": _distance,
    "ReachPositionCondition": _reach,
    "RelativeDistanceCondition": _relative_distance,
    "RelativeSpeedCondition": _relative_speed,
    "SpeedCondition": _speed,
    "StandStillCondition": _standstill,
    "TimeHeadwayCondition": _time_headway,
    "TimeToCollisionCondition": _time_to_collision,
    "TraveledDistanceCondition": _travelled,
}
