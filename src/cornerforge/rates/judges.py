"""The judges of crashes against each other, and how much hangs on how fast the AV, or a reference driver, reacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cornerforge.intervals import binomial_interval
from cornerforge.results.analysis import Judges, ShareAtReaction

if TYPE_CHECKING:
    from numpy.typing import NDArray


__all__ = ["LEAD_S", "has_way_out", "judges_of"]

LEAD_S = 1.0
"""Reaction time of the share of avoidable crashes that is reported first [s], unless the user gave one: with 0 s, so
with foresight, nearly every crash is avoidable."""
_SLIVER = 1e-6


def has_way_out(time_to_react: NDArray[np.float64], own: NDArray[np.bool_], after: float) -> NDArray[np.bool_]:
    """Say which cases had a way out that may begin `after` seconds after the manoeuvre began, or later.

    Args:
        time_to_react: From the manoeuvre's begin to the last way out [s]; NaN without a way out.
        own: Cases in which the AV itself began the manoeuvre: it can leave it out, and needs no time to react.
        after: Reaction time [s].
    """
    return np.asarray(time_to_react >= np.where(own, 0.0, after) - _SLIVER)


def judges_of(
    time_to_react: NDArray[np.float64], own: NDArray[np.bool_], drivers: Mapping[str, NDArray[np.bool_]],
    held: NDArray[np.bool_], reacting: NDArray[np.bool_], lead_s: float = LEAD_S,
) -> Judges | None:  # fmt: skip
    """Compare the judges of C cases, which all of them judged.

    Args:
        time_to_react, own: As for `has_way_out`, (C,).
        drivers: Which of the cases each of D reference drivers would have prevented, (C,) each.
        held: Cases that holding the speed would have prevented, (C,).
        reacting: As `analysis.prevented.prevented_at` gives it, (C, reactions, D).
        lead_s: Reaction time of the share that is reported first [s].

    Returns:
        None without cases.
    """
    from cornerforge.analysis.prevented import REACTIONS_S

    n = time_to_react.size
    if n == 0:
        return None
    says = {name: np.asarray(cases) for name, cases in drivers.items()}
    says |= {f"way out after {after:g} s": has_way_out(time_to_react, own, after) for after in (0.75, LEAD_S)}
    says["holding the speed"] = held

    def share(after: float, cases: NDArray[np.bool_]) -> ShareAtReaction:
        k = int(cases.sum())
        return ShareAtReaction(reaction_s=after, cases=k, share=k / n, interval95=binomial_interval(k, n))

    return Judges(
        cases=n,
        both={a: {b: int((x & y).sum()) for b, y in says.items()} for a, x in says.items()},
        agreement={a: {b: float((x == y).mean()) for b, y in says.items()} for a, x in says.items()},
        avoidable=tuple(share(after, has_way_out(time_to_react, own, after)) for after in REACTIONS_S),
        lead=share(lead_s, has_way_out(time_to_react, own, lead_s)),
        prevented={
            name: tuple(share(after, reacting[:, row, k]) for row, after in enumerate(REACTIONS_S))
            for k, name in enumerate(drivers)
        },
    )
