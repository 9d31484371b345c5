"""Delta debugging: the smallest part of a list that still shows an effect (Zeller and Hildebrandt 2002)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

__all__ = ["ddmin"]

T = TypeVar("T")


def ddmin(items: Sequence[T], shows: Callable[[list[T]], bool]) -> list[T]:
    """Leave out items that the effect does not need, in ever smaller pieces, until no single item can be left out.

    Args:
        items: A list that shows the effect; the order is kept.
        shows: Does this part show the effect? Called with parts only, never with all of `items`; with the empty part
            first, which in many uses is the answer.

    Returns:
        A 1-minimal part: leaving out any one item of it loses the effect. It need not be the smallest there is, which
        would take an exponential number of questions.

    Source: Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE TSE 28 (2002), section 3.2.
    >>> ddmin(range(100), lambda part: 17 in part and 80 in part)
    [17, 80]
    """
    kept = list(items)
    if kept and shows([]):
        return []
    pieces = 2
    while len(kept) >= 2:
        ends = [len(kept) * k // pieces for k in range(pieces + 1)]
        cuts = list(itertools.pairwise(ends))
        piece = next((kept[a:b] for a, b in cuts if shows(kept[a:b])), None)
        if piece is not None:
            kept, pieces = piece, 2
            continue
        # With two pieces the rest of one is the other, which was asked about.
        rests = (kept[:a] + kept[b:] for a, b in (cuts if pieces > 2 else ()))
        rest = next((rest for rest in rests if shows(rest)), None)
        if rest is not None:
            kept, pieces = rest, max(pieces - 1, 2)
        elif pieces < len(kept):
            pieces = min(2 * pieces, len(kept))
        else:
            break
    return kept
