"""Weighted tests: particles that split where it is dangerous, or tests that are drawn from proposals.

A *particle* is a world with a weight. Copies share the weight of what was copied, and what is drawn from a proposal is
weighted by its density, so the sum of the weights of all crashes has the crash rate as its mean, for any estimate of
the danger (docs/adr/0030-natural-rates.md). In the order of reading: `danger` (how dangerous a BV is to the AV), `acts`
(what BVs may do in a second), `branches` (of which exactly one happens), `population` (plan, pool of particles,
terminal states), `splitting` (copies) and `tilt` (proposals), `training_data` (what the danger is trained with),
`schedule` and `foreign` (AVs outside the kernels), `drive` (ranges of tests, in threads).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.rates.branching import danger
    from cornerforge.rates.branching.drive import BUILT_IN_TREES, DrivenTrees, TrainingTable, TreeDriver, drive_trees
    from cornerforge.rates.branching.foreign import ForeignTrees
    from cornerforge.rates.branching.population import Plan, Tilt, tree_of

__all__ = [
    "BUILT_IN_TREES", "DrivenTrees", "ForeignTrees", "Plan", "Tilt", "TrainingTable", "TreeDriver", "danger",
    "drive_trees", "tree_of",
]  # fmt: skip

_PLACES: dict[str, tuple[str, ...]] = {
    "": ("danger",),
    "drive": ("BUILT_IN_TREES", "DrivenTrees", "TrainingTable", "TreeDriver", "drive_trees"),
    "foreign": ("ForeignTrees",),
    "population": ("Plan", "Tilt", "tree_of"),
}  # fmt: skip
"""Module -> the names that it gives; modules given as a whole stand under the empty name."""

__getattr__ = door(__name__, {name: module for module, names in _PLACES.items() for name in names})
