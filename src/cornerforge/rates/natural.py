"""How often the cases of a library happen in natural traffic, kind by kind.

Cases of natural traffic have a weight (`library.natural`): the crashes per test that each stands for. Counted cases all
have the same weight; cases of trees (`splitting`) have it in the column `weight`. Cases of an adversary have no weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cornerforge.intervals import weighted_interval
from cornerforge.results.analysis import Natural, NaturalKind
from cornerforge.types import METRES_PER_MILE

if TYPE_CHECKING:
    from cornerforge.types import Odd

__all__ = ["Kinds", "natural_shares"]


Kinds = Sequence[str | None]
"""Kind of each case, None: not known."""


class _Rates:
    """Rates of kinds in a library with weights (S,)."""

    def __init__(self, weights: NDArray[np.float64], odd: Odd) -> None:
        self.weights = weights
        self._largest = float(weights.max())
        self._whole = float(weights.sum())
        self._miles = odd.test_length / METRES_PER_MILE

    def of(self, weights: NDArray[np.float64], largest: float | None = None) -> NaturalKind:
        """Give the rate of some cases, with their weights; `largest`: largest weight possible, None: the library's."""
        rate = float(weights.sum())
        low, high = weighted_interval(weights, self._largest if largest is None else largest)
        return NaturalKind(
            cases=weights.size,
            share=min(1.0, rate / self._whole),
            crashes_per_test=rate,
            interval95=(low, high),
            miles_between=self._miles / rate,
            interval95_miles=(self._miles / high, self._miles / low),
        )

    def by(self, kinds: Kinds) -> dict[str, NaturalKind]:
        """Give the rate of each kind, the most frequent first."""
        names = np.array([name or "" for name in kinds], np.str_)
        found = {str(name): self.of(self.weights[names == name]) for name in np.unique(names[names != ""])}
        return dict(sorted(found.items(), key=lambda item: -item[1].crashes_per_test))


def natural_shares(
    weights: NDArray[np.float64],
    odd: Odd,
    *,
    kinds: Mapping[str, Kinds],
    prevented: Mapping[str, NDArray[np.bool_]],
    avoidable: NDArray[np.bool_],
    avoidable_after_s: float,
    looked_at: NDArray[np.bool_],
    injury: NDArray[np.float64],
) -> Natural:
    """Compute natural rates of all kinds.

    Args:
        weights: Weights of the cases, above 0, shape (S,).
        odd: Road and rules of the library.
        kinds: "clusters", "crash_types", "mechanisms", "fault" and "conducts": what each case is.
        prevented: Whether a reference driver, by name, would have prevented each case, shape (S,).
        avoidable: Whether a way out was found, shape (S,).
        avoidable_after_s: How long after the begin of the manoeuvre it may begin [s].
        looked_at: Whether the case was drawn for that, shape (S,).
        injury: Chance of a serious injury in the AV, shape (S,).
    """
    rates = _Rates(weights, odd)
    ways: NaturalKind | None = None
    if (avoidable & looked_at).any():  # the drawn cases stand for all
        drawn = weights * weights.sum() / weights[looked_at].sum()
        ways = rates.of(drawn[avoidable & looked_at], float(drawn.max()))
    return Natural(
        effective_cases=float(weights.sum() ** 2 / (weights * weights).sum()),
        all=rates.of(weights),
        clusters=rates.by(kinds["clusters"]),
        crash_types=rates.by(kinds["crash_types"]),
        mechanisms=rates.by(kinds["mechanisms"]),
        fault=rates.by(kinds["fault"]),
        prevented_by={name: rates.of(weights[cases]) for name, cases in prevented.items() if cases.any()},
        avoidable=ways,
        avoidable_after_s=avoidable_after_s,
        conducts=rates.by(kinds["conducts"]),
        serious_injuries=rates.of(weights * injury, float((weights * injury).max())),
    )
