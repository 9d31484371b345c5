"""Kernels of DBSCAN in the plane: points sorted into square cells, in linear memory.

A cell is 0.7 eps wide, so its diagonal is shorter than eps: points in one cell are neighbours, a cell that holds
`min_samples` points holds cores only, and the cores of a cell are in one cluster. Two cells with indices more than 2
apart hold no neighbours. So cores, clusters and noise follow from looking at most two cells far. (The idea is
Gunawan's, 2013.) Every distance is compared as dx dx + dy dy <= eps eps, as scikit-learn's k-d tree does it.

Cells are sorted by column, then row, so that the cells of one column from two below to two above a cell lie side by
side; `first` holds where these five runs begin and only moves forward.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cornerforge._jit import kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["CELL_WIDTH", "Cells", "attach_border", "join_cells", "mark_cores"]

CELL_WIDTH = 0.7
"""Width of a cell in units of eps: below 1 / sqrt(2) by a hundredth, more than any rounding error."""


class Cells(NamedTuple):
    """S points sorted into C cells.

    Attributes:
        points: Sorted by cell, shape (S, 2).
        start: First point of each cell, and S, shape (C + 1,).
        column, row: Indices of each cell, sorted by column, then row, shape (C,).
        eps: Radius of a neighbourhood.
    """

    points: NDArray[np.float64]
    start: NDArray[np.int64]
    column: NDArray[np.int64]
    row: NDArray[np.int64]
    eps: float


_REACH = 2
_COLUMNS = 2 * _REACH + 1


@kernel
def _advance(first: NDArray[np.int64], column: NDArray[np.int64], row: NDArray[np.int64], cell: int) -> None:
    """Move each of the five runs to its first cell that is near `cell`."""
    for offset in range(_COLUMNS):
        x, y = column[cell] + offset - _REACH, row[cell] - _REACH
        at = first[offset]
        while at < len(column) and (column[at] < x or (column[at] == x and row[at] < y)):
            at += 1
        first[offset] = at


@kernel
def _is_near(column: NDArray[np.int64], row: NDArray[np.int64], cell: int, offset: int, other: int) -> bool:
    """Does the run of neighbours of `cell` in the column `offset` hold the cell `other`?"""
    return other < len(column) and column[other] == column[cell] + offset - _REACH and row[other] <= row[cell] + _REACH


@kernel
def mark_cores(
    cells: Cells,
    min_samples: int,
    first: NDArray[np.int64],
    is_core: NDArray[np.bool_],
) -> None:
    """Mark the points that have `min_samples` points within eps, themselves included.

    Args:
        cells: The points.
        min_samples: At least 1.
        first: Scratch, zeros, shape (5,).
        is_core: Result, shape (S,).
    """
    points, start, column, row, eps = cells
    reach = eps * eps
    for cell in range(len(column)):
        _advance(first, column, row, cell)
        inside = start[cell + 1] - start[cell]
        for i in range(start[cell], start[cell + 1]):
            found = inside
            for offset in range(_COLUMNS):
                other = first[offset]
                while found < min_samples and _is_near(column, row, cell, offset, other):
                    j = start[other]
                    while other != cell and j < start[other + 1] and found < min_samples:
                        dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                        if dx * dx + dy * dy <= reach:
                            found += 1
                        j += 1
                    other += 1
            is_core[i] = found >= min_samples


@kernel
def _root(parent: NDArray[np.int64], cell: int) -> int:
    """Find the representative of a cell's cluster, halving paths on the way."""
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@kernel
def _to_box(points: NDArray[np.float64], i: int, box: NDArray[np.float64], cell: int) -> float:
    """Squared distance of a point to the box [x low, x high, y low, y high] of a cell's cores."""
    dx = max(box[cell, 0] - points[i, 0], points[i, 0] - box[cell, 1], 0.0)
    dy = max(box[cell, 2] - points[i, 1], points[i, 1] - box[cell, 3], 0.0)
    return float(dx * dx + dy * dy)


@kernel
def _touch(
    points: NDArray[np.float64],
    start: NDArray[np.int64],
    is_core: NDArray[np.bool_],
    box: NDArray[np.float64],
    reach: float,
    one: int,
    other: int,
) -> bool:
    """Is a core of one cell within eps of a core of the other?"""
    for i in range(start[one], start[one + 1]):
        if is_core[i] and _to_box(points, i, box, other) <= reach:
            for j in range(start[other], start[other + 1]):
                dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                if is_core[j] and dx * dx + dy * dy <= reach:
                    return True
    return False


@kernel
def join_cells(
    cells: Cells,
    is_core: NDArray[np.bool_],
    first: NDArray[np.int64],
    box: NDArray[np.float64],
    cluster: NDArray[np.int64],
) -> None:
    """Give cells the same cluster if a chain of cores, each within eps of the next, connects them.

    Args:
        cells: The points.
        is_core: Result of `mark_cores`.
        first: Scratch, zeros, shape (5,).
        box: Scratch, shape (C, 4).
        cluster: Result, shape (C,): the same number for cells of one cluster, -1 for cells without a core.
    """
    points, start, column, row, eps = cells
    reach = eps * eps
    for cell in range(len(column)):
        cluster[cell] = -1
        for i in range(start[cell], start[cell + 1]):
            if is_core[i]:
                x, y = points[i, 0], points[i, 1]
                if cluster[cell] < 0:
                    cluster[cell] = cell
                    box[cell, 0], box[cell, 1], box[cell, 2], box[cell, 3] = x, x, y, y
                box[cell, 0], box[cell, 1] = min(box[cell, 0], x), max(box[cell, 1], x)
                box[cell, 2], box[cell, 3] = min(box[cell, 2], y), max(box[cell, 3], y)
    for cell in range(len(column)):
        _advance(first, column, row, cell)
        if cluster[cell] < 0:
            continue
        for offset in range(_COLUMNS):
            other = first[offset]
            while _is_near(column, row, cell, offset, other) and other < cell:
                if cluster[other] >= 0:
                    a, b = _root(cluster, cell), _root(cluster, other)
                    if a != b and _touch(points, start, is_core, box, reach, cell, other):
                        cluster[max(a, b)] = min(a, b)
                other += 1
    for cell in range(len(column)):
        if cluster[cell] >= 0:
            cluster[cell] = _root(cluster, cell)


@kernel
def attach_border(
    cells: Cells,
    is_core: NDArray[np.bool_],
    cluster: NDArray[np.int64],
    first: NDArray[np.int64],
    label: NDArray[np.int64],
) -> None:
    """Give every point its cluster: a core its cell's, another point the nearest core's within eps, else -1.

    Of equally near cores the one with the smaller x, then y, decides, so that the order of the points does not.

    Args:
        cells: The points.
        is_core, cluster: Results of `mark_cores` and `join_cells`.
        first: Scratch, zeros, shape (5,).
        label: Result, shape (S,).
    """
    points, start, column, row, eps = cells
    for cell in range(len(column)):
        _advance(first, column, row, cell)
        for i in range(start[cell], start[cell + 1]):
            label[i] = cluster[cell] if is_core[i] else -1
            nearest, best = -1, eps * eps
            for offset in range(_COLUMNS):
                other = first[offset]
                while not is_core[i] and _is_near(column, row, cell, offset, other):
                    for j in range(start[other], start[other + 1]):
                        dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                        distance = dx * dx + dy * dy
                        is_first = nearest < 0 or (
                            points[j, 0] < points[nearest, 0]
                            or (points[j, 0] == points[nearest, 0] and points[j, 1] < points[nearest, 1])
                        )
                        if is_core[j] and (distance < best or (distance == best and is_first)):
                            nearest, best = j, distance
                            label[i] = cluster[other]
                    other += 1
