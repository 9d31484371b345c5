"""The road: where lanes lie, how far one vehicle is ahead of another, and what lies between two bumpers.

Only this room computes with positions along the road (`x`); a lint rule in the tests keeps such arithmetic out of all
others, so that another kind of road has one place to go to. Today there is one kind, `straight`.
"""

from cornerforge.road import straight

__all__ = ["straight"]
