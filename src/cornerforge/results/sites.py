"""Result of `site import`, `site check` and `site show`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import meant
from cornerforge.results.html import Result

__all__ = ["RouteTold", "SiteTold"]


class RouteTold(Result):
    """One route of a site."""

    name: Annotated[str, meant("From where to where.")]
    turn: Annotated[str, meant("straight, left, right or back; walk: it is of people.")]
    length_m: Annotated[float, meant("Its length.", "m")]
    stop_m: Annotated[float, meant("Where its stop line is.", "m")]
    signal: Annotated[int, meant("Place of its letter in the states; -1: no signal.")]
    zones: Annotated[int, meant("Zones that it has with others.")]
    yields_to: Annotated[int, meant("Other routes that go first.")]


class SiteTold(Result):
    """A junction: its routes, its zones and the programme of its signals."""

    name: Annotated[str, meant("Its name.")]
    routes: Annotated[tuple[RouteTold, ...], meant("Its routes, of vehicles first.")]
    zones: Annotated[dict[str, int], meant("How many zones of each kind: cross, merge, diverge, shared, weave.")]
    programme_s: Annotated[float, meant("How long the programme of the signals lasts; 0: no signals.", "s")]
    phases: Annotated[int, meant("Its phases.")]
    notes: Annotated[tuple[str, ...], meant("What its source holds and it does not.")]
    faults: Annotated[tuple[str, ...], meant("Why it cannot be driven; none: it can.")]
    files: Annotated[tuple[str, ...], meant("Files that were written.")]
