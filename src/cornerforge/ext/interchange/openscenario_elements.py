"""Elements of OpenSCENARIO XML as text: what all versions write alike."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.sax.saxutils import escape

from cornerforge.library.out_case import Fact

__all__ = [
    "VERTEX",
    "after",
    "all_of",
    "condition",
    "event_has_begun",
    "group",
    "lane_change",
    "of_entity",
    "position",
    "private",
    "properties",
    "quoted",
    "speed_change",
]

VERTEX = '<Vertex time="%.1f"><Position><WorldPosition x="%.6f" y="%.6f" z="0" h="%.8f"/></Position></Vertex>\n'
_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ESCAPES = {'"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def quoted(text: str) -> str:
    r"""Write a text as the value of an attribute.

    What no XML can hold becomes U+FFFD. A $ at the begin would name a parameter; a space goes before it.

    >>> print(quoted('a "b" & <c>'), quoted("$d"), quoted("e\x00f") == quoted("e\ufffdf"))
    "a &quot;b&quot; &amp; &lt;c&gt;" " $d" True
    """
    text = _NO_XML.sub("\ufffd", f" {text}" if text.startswith("$") else text)
    return f'"{escape(text, _ESCAPES)}"'


def properties(facts: Iterable[tuple[str, Fact]]) -> str:
    """Write facts as properties; unknown ones are left out.

    >>> properties([("seed", 3), ("likely", True), ("made_by", None)])
    '<Property name="seed" value="3"/><Property name="likely" value="true"/>'
    """
    known = ((name, value) for name, value in facts if value is not None)
    return "".join(f"<Property name={quoted(name)} value={quoted(_stated(value))}/>" for name, value in known)


def _stated(value: Fact) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def position(x: float, y: float, heading: float) -> str:
    """Write a position in the world [m], [rad]."""
    return f'<Position><WorldPosition x="{x:.6f}" y="{y:.6f}" z="0" h="{heading:.8f}"/></Position>'


def private(action: str) -> str:
    """Write an action of one vehicle."""
    return f"<PrivateAction>{action}</PrivateAction>\n"


def speed_change(speed: float, duration: float | None = None) -> str:
    """Write how a vehicle comes to a speed [m/s]: evenly within a duration [s], or at once."""
    shape, value = ("step", "0") if duration is None else ("linear", f"{duration:.1f}")
    return private(
        "<LongitudinalAction><SpeedAction>"
        f'<SpeedActionDynamics dynamicsShape="{shape}" dynamicsDimension="time" value="{value}"/>'
        f'<SpeedActionTarget><AbsoluteTargetSpeed value="{speed:.6f}"/></SpeedActionTarget>'
        "</SpeedAction></LongitudinalAction>"
    )


def lane_change(lane: int, offset: float, duration: float) -> str:
    """Write a change to a lane of the road's file, `offset` [m] left of its middle, within a duration [s].

    It goes like half a wave of a cosine.
    """
    return private(
        f'<LateralAction><LaneChangeAction targetLaneOffset="{offset:.6f}">'
        f'<LaneChangeActionDynamics dynamicsShape="sinusoidal" dynamicsDimension="time" value="{duration:.3f}"/>'
        f'<LaneChangeTarget><AbsoluteTargetLane value="{lane}"/></LaneChangeTarget>'
        "</LaneChangeAction></LateralAction>"
    )


def group(name: str, events: str) -> str:
    """Write what a vehicle does after the start; nothing, if there are no events."""
    manoeuvre = f'<Maneuver name="{name}-manoeuvre">\n{events}</Maneuver>' if events else ""
    return (
        f'<ManeuverGroup name="{name}-group" maximumExecutionCount="1"><Actors selectTriggeringEntities="false">'
        f'<EntityRef entityRef="{name}"/></Actors>{manoeuvre}</ManeuverGroup>\n'
    )


def all_of(*conditions: str) -> str:
    """Write that all these conditions must be met."""
    return f"<ConditionGroup>{''.join(conditions)}</ConditionGroup>"


def condition(what: str, *, name: str = "condition", delay: float = 0.0) -> str:
    """Write a condition; `delay`: that it was met so many seconds ago."""
    return f'<Condition name="{name}" delay="{delay:g}" conditionEdge="none">{what}</Condition>'


def after(time: float) -> str:
    """Write the condition that a time [s] is over.

    Version 1.0 knows no "at least", and a player's clock may miss a step's time by its last bit: say a time between
    two steps.
    """
    over = f'<SimulationTimeCondition rule="greaterThan" value="{time:.2f}"/>'
    return condition(f"<ByValueCondition>{over}</ByValueCondition>", name="time")


def event_has_begun(event: str, delay: float) -> str:
    """Write the condition that an event began so many seconds ago."""
    begun = (
        f'<StoryboardElementStateCondition storyboardElementType="event" storyboardElementRef="{event}" '
        'state="startTransition"/>'
    )
    return condition(f"<ByValueCondition>{begun}</ByValueCondition>", delay=round(delay, 1))


def of_entity(name: str, what: str, *, delay: float = 0.0) -> str:
    """Write a condition on a vehicle."""
    return condition(
        f'<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{name}"/>'
        f"</TriggeringEntities><EntityCondition>{what}</EntityCondition></ByEntityCondition>",
        delay=delay,
    )
