"""Crash rates and their uncertainty.

Programs take intervals here. Ways to a rate: `plain` and `monte_carlo` (counting), `splitting` (weighted tests, of
`branching`, a room of its own; `teaching` its network), `weighted` (means of weights), `paired` (two AVs), `exposure`
(per mile of BVs). What it hangs on: `natural` and `crashes` (kinds of cases), `judges`, `model_uncertainty`.
"""

from __future__ import annotations

from cornerforge.intervals import binomial_interval, poisson_interval, rate_ratio_interval, weighted_interval

__all__ = ["binomial_interval", "poisson_interval", "rate_ratio_interval", "weighted_interval"]

MODULES = (
    "branching", "crashes", "exposure", "judges", "model_uncertainty", "monte_carlo", "natural", "paired", "plain",
    "splitting", "teaching", "weighted",
)  # fmt: skip
"""Modules from which other rooms import too."""
