"""Several seeds' yields as one number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from cornerforge.intervals import binomial_interval

__all__ = ["pooled"]


def pooled(judged: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The mean yield over seeds, with an interval that covers every seed's.

    Args:
        judged: What `Bench.judged` gave for each seed, at least one, of equal numbers of tests.

    Returns:
        `crashes_per_test`, the mean; `interval95`, from the lowest to the highest end of the seeds' exact intervals (so
        its lower end belongs to the worst seed); `tests`, `crashes`, `avoidable`, `struck`, `typed`, `crash_types` and
        `strikers` summed; the same mean and interval as `avoidable_per_test` and `avoidable_interval95` for avoidable
        crashes; `seeds`, each seed's own yield.
    """
    shares = [rate["crashes_per_test"] for rate in judged]
    ends = [rate["interval95"] for rate in judged]
    sums = {name: sum(rate[name] for rate in judged) for name in ("tests", "crashes", "avoidable", "struck", "typed")}
    avoidable = [binomial_interval(rate["avoidable"], rate["tests"]) for rate in judged]
    tables: dict[str, dict[str, int]] = {}
    for name in ("crash_types", "strikers"):
        total: Counter[str] = Counter()
        for rate in judged:
            total.update(rate[name])
        tables[name] = {key: total[key] for key in judged[0][name]}
    return {
        "crashes_per_test": sum(shares) / len(shares),
        "interval95": (min(low for low, _ in ends), max(high for _, high in ends)),
        "avoidable_per_test": sum(rate["avoidable"] / rate["tests"] for rate in judged) / len(judged),
        "avoidable_interval95": (min(low for low, _ in avoidable), max(high for _, high in avoidable)),
        **sums,
        **tables,
        "seeds": shares,
    }
