"""Site: routes of vehicles and people across a junction, in the world's plane, with who yields and the signals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from cornerforge._schema import meant

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SITE_FILES", "STEP", "TURNS", "Phase", "Route", "Site", "Turn", "headings_of", "with_amber"]

Turn = Literal["straight", "left", "right", "back", "walk"]
SITE_FILES = {
    name: Path(__file__).with_name(f"{name}.json")
    for name in ("mcity-signal", "mcity-crossing", "mcity-two-lanes", "mcity-roundabout")
}
"""Sites that come with cornerforge, of the Mcity test facility: junction NODE_18, its programme of signals mended; the
crosswalk between junctions at J5 and NODE_27; that over two lanes that lead one way at NODE_19; and its roundabout of
four arms. From the University of Michigan's network (mcity/TeraSim, Apache-2.0, `mcity.LICENSE.txt`); notes in each say
what differs from it."""
TURNS: tuple[Turn, ...] = ("straight", "left", "right", "back", "walk")
"""Where a route leads from its approach; "walk": it is of people."""
STEP = 1.0
"""Distance of the points of a route of vehicles [m]; the last one may be nearer."""


@dataclass(frozen=True)
class Route:
    """A way across the junction, from an approach to an exit, or from kerb to kerb.

    Attributes:
        points: Its middle, x and y in the world's plane [m].
        stop, leaves: Where along it the stop line is, and where it leaves the junction [m]; of people 0 and its end.
        limits: Speed limits before the stop line, and behind it [m/s]; of people none matters.
        signal: Index of its letter in the states of the signals; -1: none.
        yields_to: Indices of routes that go first where neither has a red light.
        yields_at: For each of them how far along this route the middle of the junction is in which they go first [m];
            empty: wherever they meet.
    """

    name: Annotated[str, meant("From where to where.")]
    approach: Annotated[str, meant("Where it comes from.")]
    exit: Annotated[str, meant("Where it leads.")]
    turn: Annotated[Turn, meant("Where it leads from its approach; walk: it is of people.")]
    points: Annotated[tuple[tuple[float, float], ...], meant("Its middle, east and north.", "m")]
    width: Annotated[float, meant("Of its lane.", "m", 0.5, 10)]
    stop: Annotated[float, meant("Where its stop line is.", "m", 0)]
    leaves: Annotated[float, meant("Where it leaves the junction.", "m", 0)]
    limits: Annotated[tuple[float, float], meant("Before the stop line, and behind it.", "m/s")]
    signal: Annotated[int, meant("Place of its letter in the states; -1: no signal.", "", -1, 255)]
    yields_to: Annotated[tuple[int, ...], meant("Routes that go first where neither has a red light.")] = ()
    yields_at: Annotated[tuple[float, ...], meant("For each of them where along this one; none: anywhere.", "m")] = ()

    @cached_property
    def line(self) -> NDArray[np.float64]:
        """The points, (P, 2) [m]."""
        return np.array(self.points, dtype=np.float64)

    @cached_property
    def along(self) -> NDArray[np.float64]:
        """Distance of each point from the first one along the route, (P,) [m]."""
        return np.append(0.0, np.cumsum(np.hypot(*np.diff(self.line, axis=0).T)))

    @property
    def length(self) -> float:
        """Length of all of it [m]."""
        return float(self.along[-1])


@dataclass(frozen=True)
class Phase:
    """A part of the programme of the signals: for each its letter.

    G goes, g goes after those to whom it yields, y and r as amber and red.
    """

    seconds: Annotated[float, meant("How long it lasts.", "s", 0.1, 1000)]
    states: Annotated[str, meant("A letter for each signal: G, g, y or r.")]


@dataclass(frozen=True)
class Site:
    """A junction, or several as one.

    Attributes:
        routes: Of vehicles first, then of people.
        programme: Phases of the signals, which repeat; none: there are no signals.
        notes: What its source holds and it does not.
    """

    name: Annotated[str, meant("For readers.")]
    routes: Annotated[tuple[Route, ...], meant("Of vehicles first, then of people.")]
    programme: Annotated[tuple[Phase, ...], meant("Phases of the signals, which repeat.")] = ()
    notes: Annotated[tuple[str, ...], meant("What its source holds and it does not.")] = ()

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Indices of the routes of vehicles."""
        return tuple(k for k, route in enumerate(self.routes) if route.turn != "walk")

    @property
    def people(self) -> tuple[int, ...]:
        """Indices of the routes of people."""
        return tuple(k for k, route in enumerate(self.routes) if route.turn == "walk")


def headings_of(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the direction of a line at each of its points, (P,) [rad], continuous: the mean of both sides."""
    ways = np.diff(line, axis=0)
    of_parts = np.unwrap(np.arctan2(ways[:, 1], ways[:, 0]))
    if of_parts.size == 1:
        return np.repeat(of_parts, 2)
    return np.concatenate([of_parts[:1], 0.5 * (of_parts[1:] + of_parts[:-1]), of_parts[-1:]])


def with_amber(site: Site) -> Site:
    """Give each green for vehicles that ends without amber one, in the phase behind it, if another is amber there.

    The notes name each signal that was mended.
    """
    states = [list(phase.states) for phase in site.programme]
    notes, of_cars = list(site.notes), {site.routes[k].signal for k in site.vehicles}
    for k, letters in enumerate(states):
        behind = states[(k + 1) % len(states)]
        for signal, letter in enumerate(letters):
            if signal in of_cars and letter in "Gg" and behind[signal] == "r" and "y" in behind:
                behind[signal] = "y"
                notes.append(
                    f"signal {signal} went from green to red; it is amber in phase {(k + 1) % len(states)} now"
                )
    phases = (replace(one, states="".join(letters)) for one, letters in zip(site.programme, states, strict=True))
    return replace(site, programme=tuple(phases), notes=tuple(notes))
