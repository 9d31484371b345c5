"""The road: where lanes lie, how far one vehicle is ahead of another, and what lies between two bumpers.

Only this package computes with positions along the road (`x`): a test keeps this arithmetic out of all others, so
another kind of road has one place to go to. `straight` is this arithmetic along one line, `lanes` lanes that end, for
kernels. `network` and `reference` are roads with curves and lanes that end, `shipped` those that come with cornerforge
(docs/roads.md).

`straight` has scalar kernels of a vehicle record and a slot, and the same for arrays.
"""

from cornerforge.road import straight

__all__ = ["straight"]

MODULES = ("lanes", "network", "reference", "shipped", "straight")
"""Modules from which other rooms import too."""
