"""All items, in the order of the page. A new one: a module beside this, a line here, a renderer in the report."""

from __future__ import annotations

from cornerforge.ext.paper.clusters import FIGURE8, FIGURE10
from cornerforge.ext.paper.examples import FIGURE9, FIGURE11
from cornerforge.ext.paper.figure2 import FIGURE2
from cornerforge.ext.paper.figure3 import FIGURE3
from cornerforge.ext.paper.figure5 import FIGURE5
from cornerforge.ext.paper.figure6 import FIGURE6
from cornerforge.ext.paper.figure7 import FIGURE7
from cornerforge.ext.paper.item import Item
from cornerforge.ext.paper.matrix import MATRIX
from cornerforge.ext.paper.table1 import TABLE1
from cornerforge.ext.paper.timings import TIMINGS

__all__ = ["ITEMS"]

ITEMS: dict[str, Item] = {
    item.id: item
    for item in (
        TABLE1, FIGURE2, FIGURE3, FIGURE5, FIGURE6, FIGURE7, FIGURE8, FIGURE9, FIGURE10, FIGURE11, MATRIX, TIMINGS,
    )
}  # fmt: skip
