"""Crash rates and their uncertainty.

Programs take intervals here. `plain` and `monte_carlo` count crashes; `splitting` takes weighted tests (`branching`
drives them, `teaching` trains its network), `weighted` their mean; `paired` compares two AVs; `exposure` counts miles
of BVs; `natural` and `crashes` tell kinds of crash; `people`: how often people crash; `judges`,
`model_uncertainty`: how far to trust the results.
"""

from __future__ import annotations

from cornerforge.intervals import binomial_interval, poisson_interval, rate_ratio_interval, weighted_interval

__all__ = ["binomial_interval", "poisson_interval", "rate_ratio_interval", "weighted_interval"]

MODULES = (
    "branching", "crashes", "exposure", "judges", "model_uncertainty", "monte_carlo", "natural", "paired", "people",
    "plain", "splitting", "teaching", "weighted",
)  # fmt: skip
"""Modules from which other packages import too."""
