"""The paper's figures and tables, made again: what it says, what ours are, and how far they are apart.

`reproduce.ITEMS` lists the items. An item computes from a `Bench`, which keeps trained adversaries and
measurements, so that items share them and an interrupted `cornerforge.reproduce` goes on.
"""

from __future__ import annotations

__all__: list[str] = []
