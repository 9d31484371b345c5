"""The storyboard of an OpenSCENARIO file, played: its elements in their states, a hundred moments a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cornerforge.ext.interchange.xml_input import Element
from cornerforge.ext.interchange.xosc_actions import MOTIONS, Actions, Running, leaf_of
from cornerforge.ext.interchange.xosc_conditions import Trigger
from cornerforge.ext.interchange.xosc_motion import Body
from cornerforge.ext.interchange.xosc_parameters import Catalogs
from cornerforge.ext.interchange.xosc_places import Places, UnsupportedError

__all__ = ["Moment", "Storyboard"]

_STEPS_PER_S = 100
_STEPS_PER_FRAME = 10
_LONGEST_S = 300
_IDLE_S = 60
"""Time from the last change of the storyboard to the cut of the play, if nothing else ends it [s]."""
_ALONE_S = 20
"""How long vehicles drive for which the file has no storyboard [s]."""
_STANDBY, _RUNNING, _COMPLETE = "standbyState", "runningState", "completeState"
_MOST_ELEMENTS = 20_000
_MOST_WORK = 3_000_000
"""How often conditions are looked at, all together; real files need up to some hundred thousand looks."""


class Moment(NamedTuple):
    """A vehicle in a frame: middle of its box, heading, speed along the road, lane it is told to take."""

    x: float
    y: float
    heading: float
    speed: float
    lane: int | None
    stated: bool  # by a trajectory, which has no speed of its own
    leaps: int  # so far


@dataclass(eq=False)
class _Node:
    """An element of the storyboard in its state."""

    kind: str
    name: str
    element: Element
    parts: list[_Node] = field(default_factory=list)
    state: str = _STANDBY
    transition: str = ""
    step: int = -9
    trigger: Trigger | None = None
    stop: Trigger | None = None
    runs: int = 0
    spent: bool = False
    actors: Sequence[Body] = ()
    going: list[tuple[_Node, list[Running]]] = field(default_factory=list)

    def go(self, state: str, transition: str, step: int) -> None:
        self.state, self.transition, self.step = state, transition, step


class Storyboard:
    """Plays a storyboard; it is also the world at which conditions look.

    Args:
        element: Storyboard, parameters put.
        places, bodies, catalogs: Places, bodies and catalogs of the file.
        parameters: Values of its parameters, for conditions.
    """

    def __init__(
        self,
        element: Element,
        places: Places,
        bodies: Mapping[str, Body],
        catalogs: Catalogs,
        parameters: Mapping[str, str],
    ) -> None:
        self.time, self.step = 0.0, 0
        self.bodies, self.places, self.parameters = bodies, places, parameters
        self.element, self.catalogs = element, catalogs
        self.notes: dict[str, None] = {}
        self.actions = Actions(self, catalogs)
        self.nodes: dict[tuple[str, str], list[_Node]] = {}
        self.selections: dict[str, list[str]] = {}
        self.last_change = self.work = 0
        self.acts: list[tuple[_Node, _Node]] = []
        self.waiting: list[tuple[_Node, _Node]] = []
        self.running: list[_Node] = []

    # What conditions ask

    def state(self, kind: str, name: str, wanted: str, element: Element) -> bool:
        """Is an element of the storyboard in a state, or has it just changed to it?"""
        nodes = self.nodes.get((kind, name)) or self.nodes.get((kind, name.rpartition("::")[2].strip()))
        if not nodes:
            element.fault(f'there is no {kind[:40]} "{name[:40]}" in the storyboard')
        if wanted in (_STANDBY, _RUNNING, _COMPLETE):
            return any(node.state == wanted for node in nodes)
        return any(node.transition == wanted and self.step - node.step <= 1 for node in nodes)

    def leave_out(self, why: UnsupportedError) -> None:
        """Note what is not carried over."""
        self.note(str(why))

    def note(self, text: str) -> None:
        """Note something once."""
        self.notes.setdefault(text)

    # The elements

    def build(self) -> None:
        """Read the whole storyboard.

        Raises:
            DataError: It is not as it should be.
        """
        for story in self.element.all("Story"):
            top = self._node("story", story)
            for part in story.all("Act"):
                node = self._node("act", part)
                top.parts.append(node)
                self.acts.append((top, node))
                node.parts = [self._group(group) for group in part.all("ManeuverGroup")]
        for _, act in self.acts:
            act.trigger, act.stop = (
                self._trigger(act.element, "StartTrigger"),
                self._trigger(act.element, "StopTrigger"),
            )
            for group in act.parts:
                for maneuver in group.parts:
                    for event in maneuver.parts:
                        event.trigger = self._trigger(event.element, "StartTrigger")
        self.stop = self._trigger(self.element, "StopTrigger")

    def _node(self, kind: str, element: Element) -> _Node:
        node = _Node(kind, element.attributes.get("name", ""), element)
        self.nodes.setdefault((kind, node.name), []).append(node)
        if sum(map(len, self.nodes.values())) > _MOST_ELEMENTS:
            element.fault(f"the storyboard has more than {_MOST_ELEMENTS:,} elements")
        return node

    def _trigger(self, element: Element, tag: str) -> Trigger | None:
        found = element.child(tag)
        if found is None:
            return None
        trigger = Trigger(found, self, 1.0 / _STEPS_PER_S)
        if not trigger.groups and tag == "StartTrigger":
            self.note(f"{found.place}: this StartTrigger has no condition; {element.tag} never begins")
        return trigger

    def _group(self, element: Element) -> _Node:
        node = self._node("maneuverGroup", element)
        if element.integer("maximumExecutionCount", 1, low=0, high=10**9) > 1:
            self.note(f"{element.place}: this ManeuverGroup runs once, not as often as its maximumExecutionCount says")
        actors = self._actors(element.need("Actors"))
        for part in element.all("Maneuver", "CatalogReference"):
            maneuver = self.catalogs.entry(part) if part.tag == "CatalogReference" else part
            inner = self._node("maneuver", maneuver)
            node.parts.append(inner)
            for event in maneuver.all("Event"):
                inner.parts.append(self._event(event, actors))
        return node

    def _event(self, element: Element, actors: Sequence[Body]) -> _Node:
        node = self._node("event", element)
        node.actors = actors
        for action in element.all("Action"):
            node.parts.append(self._node("action", action))
            for part in action.children:
                leaf = leaf_of(part)
                if part.tag == "PrivateAction" and leaf.tag in MOTIONS and not actors:
                    self.note(f"{leaf.place}: {leaf.tag} is left out: it has no actors")
        return node

    def _actors(self, element: Element) -> list[Body]:
        if element.attributes.get("selectTriggeringEntities") == "true":
            self.note(f"{element.place}: selectTriggeringEntities is left out; the actors that are named act")
        names: list[str] = []
        for part in element.all("EntityRef"):
            name = part.string("entityRef")
            names += self.selections.get(name, [name])
        for name in names:
            if name not in self.bodies:
                element.fault(f'there is no entity "{name[:40]}"')
        return [self.bodies[name] for name in names]

    def told(self, body: Body) -> bool:
        """Does an event have an action that moves this vehicle?"""
        return any(
            body in event.actors and leaf_of(part).tag in MOTIONS
            for event in self._events()
            for action in event.parts
            for part in action.element.all("PrivateAction")
        )

    def _events(self) -> list[_Node]:
        return [
            event for _, act in self.acts for group in act.parts for maneuver in group.parts for event in maneuver.parts
        ]

    # The play

    def play(self) -> list[list[Moment | None]]:
        """Let time pass until the storyboard ends; give all vehicles in every frame, in the order of `bodies`."""
        bodies = list(self.bodies.values())
        frames: list[list[Moment | None]] = []
        while True:
            over = self._look()
            if self.step % _STEPS_PER_FRAME == 0:
                frames.append([_moment(body) for body in bodies])
            if over or self._idle():
                break
            self._pass_on(bodies)
        for event in self._events():
            if event.runs == 0:
                self.note(f"{event.element.place}: this Event does not begin before the end")
        return frames

    def _pass_on(self, bodies: Sequence[Body]) -> None:
        watched = any(event.trigger is not None and event.trigger.looks_at_vehicles for event, _ in self.waiting)
        watched = watched or any(
            trigger is not None and trigger.looks_at_vehicles
            for _, act in self.acts
            if act.state != _COMPLETE
            for trigger in (act.trigger, act.stop)
        )
        watched = watched or (self.stop is not None and self.stop.looks_at_vehicles)
        self.step += 1
        self.time = self.step / _STEPS_PER_S
        at_frame = self.step % _STEPS_PER_FRAME == 0
        for body in bodies:
            if watched or at_frame or not body.timed:
                body.advance(self.time)

    def _idle(self) -> bool:
        """Is there nothing left to wait for? Says why, if that is not the storyboard's own end."""
        if self.time >= _LONGEST_S:
            self.note(f"{self.element.place}: the storyboard goes on after {_LONGEST_S} s; it is cut there")
            return True
        moving = any(body.path is not None or body.way is not None for body in self.bodies.values())
        if all(act.state == _COMPLETE for _, act in self.acts) and not (self.stop and self.stop.groups):
            if self.acts:
                return not moving
            if not moving and (self.time >= _ALONE_S or self.actions.paths_begun):
                return True
        if self.step - self.last_change > _IDLE_S * _STEPS_PER_S and not moving and self.time >= _IDLE_S:
            self.note(f"{self.element.place}: nothing begins or ends for {_IDLE_S} s; the storyboard is cut there")
            return True
        return False

    def _look(self) -> bool:
        """Let elements end and begin; true if the whole storyboard ends."""
        for event in list(self.running):
            self._end_actions(event)
        for top, act in self.acts:
            if act.state == _RUNNING:
                self._end_parts(act)
            if act.state == _RUNNING and act.stop is not None and act.stop.holds():
                self._stop(act)
            if act.state == _STANDBY and (act.trigger is None or act.trigger.holds()):
                self._begin(top, act)
            if top.state == _RUNNING and all(part.state == _COMPLETE for part in top.parts):
                top.go(_COMPLETE, "endTransition", self.step)
        for event, maneuver in self.waiting:
            if event.spent or event.state != _STANDBY:
                continue
            self.work += 1 if event.trigger is None else event.trigger.size
            if event.trigger is None or event.trigger.holds():
                self._start(event, maneuver)
        self.waiting = [(event, maneuver) for event, maneuver in self.waiting if not event.spent]
        if self.work > _MOST_WORK:
            self.element.fault(f"its conditions are too many to wait for ({self.work:,} looks in {self.time:.1f} s)")
        return self.stop is not None and self.stop.holds()

    def _begin(self, top: _Node, act: _Node) -> None:
        if top.state == _STANDBY:
            top.go(_RUNNING, "startTransition", self.step)
        act.go(_RUNNING, "startTransition", self.step)
        self.last_change = self.step
        for body in self.bodies.values():
            body.advance(self.time)
        for group in act.parts:
            group.go(_RUNNING, "startTransition", self.step)
            for maneuver in group.parts:
                maneuver.go(_RUNNING, "startTransition", self.step)
                self.waiting += [(event, maneuver) for event in maneuver.parts]

    def _start(self, event: _Node, maneuver: _Node) -> None:
        priority = event.element.attributes.get("priority", "parallel")
        others = [other for other in maneuver.parts if other.state == _RUNNING]
        most = event.element.integer("maximumExecutionCount", 1, low=0, high=10**9)
        event.runs += 1
        self.last_change = self.step
        event.spent = event.runs >= most
        if priority == "skip" and others:
            event.go(_COMPLETE if event.spent else _STANDBY, "skipTransition", self.step)
            return
        if priority in ("overwrite", "override"):
            for other in others:
                self._finish(other, "stopTransition")
        event.go(_RUNNING, "startTransition", self.step)
        for action in event.parts:
            action.go(_RUNNING, "startTransition", self.step)
            event.going.append((action, self._do(action.element, event.actors)))
        self.running.append(event)
        self._end_actions(event)

    def _do(self, action: Element, actors: Sequence[Body]) -> list[Running]:
        going = []
        for part in action.children:
            leaf = leaf_of(part)
            if part.tag == "PrivateAction":
                for body in actors:
                    running = self.actions.start(leaf, body)
                    if running is not None:
                        going.append(running)
            else:
                self.act_globally(part, leaf)
        return going

    def act_globally(self, part: Element, leaf: Element) -> None:
        """Do what concerns no actor: vehicles come or go; all else is noted."""
        holder = part.child("EntityAction")
        if holder is None or leaf.tag not in ("AddEntityAction", "DeleteEntityAction"):
            self.leave_out(UnsupportedError(leaf))
            return
        name = holder.string("entityRef")
        if name not in self.bodies:
            holder.fault(f'there is no entity "{name[:40]}"')
        body = self.bodies[name]
        if leaf.tag == "DeleteEntityAction":
            body.present, body.path, body.way, body.law = False, None, None, None
            return
        try:
            body.put(self.places.spot(leaf.need("Position")), self.time)
        except UnsupportedError as why:
            self.leave_out(why)

    def _end_actions(self, event: _Node) -> None:
        for action, going in event.going:
            if action.state == _RUNNING and not any(goes_on() for goes_on in going):
                action.go(_COMPLETE, "endTransition", self.step)
                self.last_change = self.step
        if all(action.state == _COMPLETE for action in event.parts):
            self._finish(event, "endTransition")

    def _finish(self, event: _Node, transition: str) -> None:
        for action, _ in event.going:
            if action.state == _RUNNING:
                action.go(_COMPLETE, transition, self.step)
        event.going = []
        self.running.remove(event)
        self.last_change = self.step
        event.go(_COMPLETE if event.spent else _STANDBY, transition, self.step)

    def _end_parts(self, act: _Node) -> None:
        for group in act.parts:
            for maneuver in group.parts:
                self._complete(maneuver)
            self._complete(group)
        self._complete(act)

    def _complete(self, node: _Node) -> None:
        if node.state == _RUNNING and all(part.state == _COMPLETE for part in node.parts):
            node.go(_COMPLETE, "endTransition", self.step)
            self.last_change = self.step

    def _stop(self, act: _Node) -> None:
        for group in act.parts:
            for maneuver in group.parts:
                for event in maneuver.parts:
                    event.spent = True
                    if event.state == _RUNNING:
                        self._finish(event, "stopTransition")
                    event.state = _COMPLETE
                maneuver.go(_COMPLETE, "stopTransition", self.step)
            group.go(_COMPLETE, "stopTransition", self.step)
        act.go(_COMPLETE, "stopTransition", self.step)
        self.last_change = self.step


def _moment(body: Body) -> Moment | None:
    if not body.present:
        return None
    x, y = body.middle
    return Moment(x, y, body.heading, body.along_road, body.lane, body.path is not None, body.leaps)
