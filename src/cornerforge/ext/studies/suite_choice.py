"""Choice of a small suite: it finds what the whole set finds, and ranks AVs as the whole set does (ADR 43).

S cases were driven by A AVs. A *finding* is an AV that crashes in a case; more telling is one that crashes in a case in
which another AV does not: the two differ in something that this case shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import InputError

__all__ = [
    "Chosen", "LeftOut", "apfd", "cases_needed", "choose", "clear_order", "findings", "leave_one_out", "rank_agreement",
]  # fmt: skip

_Z95 = 1.959964


@dataclass(frozen=True)
class Chosen:
    """A suite.

    Attributes:
        cases: Rows of the matrix, in the order in which they were chosen.
        wanted, found: Findings of all cases together, and of these.
        clear, in_order: Pairs of AVs with a clear order in all cases, and the pairs in the same order in these.
        agreement: `rank_agreement` of these with all cases; None: all AVs crash equally often.
    """

    cases: tuple[int, ...]
    wanted: int
    found: int
    clear: int
    in_order: int
    agreement: float | None


@dataclass(frozen=True)
class LeftOut:
    """A suite that was chosen without one AV, against random sets of as many cases.

    Attributes:
        av: Index of the AV that was left out.
        cases: Size of the suite.
        pairs: AVs from which all cases tell it apart: it crashes in one in which they do not.
        clear: AVs that clearly crash more or less often than it in all cases.
        share_of_all: Its crashes per case, in all cases.
        known: What the suite knows of it: does it crash, how many of `pairs` it is told apart from, its crashes per
            case, by how many places its place among all AVs differs from that in all cases, and how many of `clear`
            are on the right side of it, (5,).
        random: The same of random sets, (R, 5).
        early: How early the suite, in its order, shows what it shows of the AV (`apfd`); None: nothing.
        random_early: The same of the suite in random orders, (R,); NaN where None.
    """

    av: int
    cases: int
    pairs: int
    clear: int
    share_of_all: float
    known: NDArray[np.float64]
    random: NDArray[np.float64]
    early: float | None
    random_early: NDArray[np.float64]


def findings(crashes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Findings of each case, (S, A + A * A): that an AV crashes; that AV i crashes and AV j does not, at A + i * A + j.

    Args:
        crashes: Did the AV crash in the case, (S, A).

    >>> findings(np.array([[True, False]])).astype(int).tolist()
    [[1, 0, 0, 1, 0, 0]]
    """
    apart = crashes[:, :, None] & ~crashes[:, None, :]
    return np.concatenate([crashes, apart.reshape(len(crashes), -1)], axis=1)


def apfd(shows: NDArray[np.bool_]) -> float | None:
    """Average percentage of faults detected by cases in their order, 0 to 1: the higher, the earlier they show all.

    Args:
        shows: Does the case show the fault, (S, F). Faults that no case shows do not count.

    Returns:
        1 - mean first place / S + 1 / (2 S); None: no case shows a fault.

    Source: Rothermel, Untch, Chu and Harrold (2001), "Prioritizing test cases for regression testing".

    >>> apfd(np.array([[True, False], [False, True]]))
    0.5
    """
    known = shows[:, shows.any(axis=0)]
    if known.size == 0:
        return None
    return float(1.0 - (known.argmax(axis=0) + 1).mean() / len(shows) + 0.5 / len(shows))


def cases_needed(shows: NDArray[np.bool_]) -> int:
    """Count the first cases that show all that all show, `shows` as for `apfd`; 0 if they show nothing."""
    known = shows[:, shows.any(axis=0)]
    return int(known.argmax(axis=0).max()) + 1 if known.size else 0


def rank_agreement(crashes: NDArray[np.bool_], cases: Sequence[int] | NDArray[np.intp]) -> float | None:
    """Kendall's tau-b between the AVs' crashes in some cases and in all; None: on one side they crash equally often.

    >>> both = np.array([[True, True], [True, False], [True, False]])
    >>> rank_agreement(both, [1]), rank_agreement(both, [0])
    (1.0, None)
    """
    from scipy.stats import kendalltau

    some, whole = crashes[np.asarray(cases, np.intp)].sum(axis=0), crashes.sum(axis=0)
    if np.ptp(some) == 0 or np.ptp(whole) == 0:
        return None
    return round(float(kendalltau(some, whole).statistic), 12)


def clear_order(crashes: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Order of two AVs by crashes in the same cases: 1 the first crashes more, -1 the second, 0 not clear; (A, A).

    Clear: McNemar's test tells them apart at 5 %.

    >>> clear_order(np.array([[True, False]] * 4 + [[True, True]])).tolist()
    [[0, 1], [-1, 0]]
    """
    only = crashes.T.astype(np.int64) @ (~crashes).astype(np.int64)  # cases in which AV i crashes and AV j does not
    difference = only - only.T
    return np.where(np.abs(difference) > _Z95 * np.sqrt(only + only.T), np.sign(difference), 0).astype(np.int8)


def choose(crashes: NDArray[np.bool_], severity: NDArray[np.float64], size: int) -> Chosen:
    """Choose at most `size` cases.

    First the cases with the most findings not covered yet (greedy set cover), until all are covered; then always the
    case that brings the AVs' shares of crashes nearest to those in all cases (sum of squares). Of equals the most
    severe. The suite is the shortest beginning of this list that finds all that the list finds and, as every longer
    beginning does, has as many pairs of AVs in order as the list, among the pairs with a clear order in all cases.

    Args:
        crashes: Did the AV crash in the case, (S, A).
        severity: Severity of the case, (S,): higher is more severe.
        size: At least 1.

    Raises:
        InputError: No AV crashes in any case, or a shape is wrong.
    """
    check_integer("size", size, low=1)
    if crashes.ndim != 2 or severity.shape != (len(crashes),):
        raise InputError(f"crashes has shape {crashes.shape}, severity {severity.shape}; allowed: (S, A) and (S,).")
    if not crashes.any():
        raise InputError("No AV crashes in any of the cases, so there is nothing that a suite could find.")
    order = _ordered(crashes, severity, min(size, len(crashes)))
    finds = findings(crashes)
    known = np.logical_or.accumulate(finds[order], axis=0).sum(axis=1)
    complete = int(np.argmax(known == known[-1]))
    clear = clear_order(crashes)
    totals = np.cumsum(crashes[order], axis=0)
    in_order = np.array([_in_order(clear, total) for total in totals])
    behind = np.flatnonzero(in_order < in_order[-1])
    end = max(complete, 0 if behind.size == 0 else int(behind[-1]) + 1) + 1
    return Chosen(
        cases=tuple(order[:end]),
        wanted=int(finds.any(axis=0).sum()),
        found=int(known[end - 1]),
        clear=int((clear > 0).sum()),
        in_order=int(in_order[end - 1]),
        agreement=rank_agreement(crashes, order[:end]),
    )


def _in_order(clear: NDArray[np.int8], crashes: NDArray[np.int64]) -> int:
    """How many clear pairs are in the same order by the AVs' crashes, (A,)."""
    return int(((clear > 0) & (crashes[:, None] > crashes[None, :])).sum())


def _ordered(crashes: NDArray[np.bool_], severity: NDArray[np.float64], size: int) -> list[int]:
    """The first `size` cases in the order of choice."""
    finds = findings(crashes)
    goal = crashes.mean(axis=0)
    left = np.ones(len(crashes), np.bool_)
    open_ = finds.any(axis=0)
    total = np.zeros(crashes.shape[1])
    order: list[int] = []
    for n in range(1, size + 1):
        fresh = finds[:, open_].sum(axis=1) if open_.any() else np.zeros(len(crashes), np.intp)
        distance = (((total + crashes) / n - goal) ** 2).sum(axis=1)
        # Most that is new first, then nearest, then most severe, then first; rounded, so that equals stay equal.
        rank = np.lexsort((np.arange(len(crashes)), -severity, np.round(distance, 12), -fresh, ~left))
        best = int(rank[0])
        order.append(best)
        left[best] = False
        open_ &= ~finds[best]
        total += crashes[best]
    return order


def leave_one_out(
    crashes: NDArray[np.bool_], severity: NDArray[np.float64], size: int, *, seed: int = 0, random_sets: int = 200
) -> list[LeftOut]:
    """Choose a suite without each AV, and say what it knows of that AV.

    AVs that crash in no case are passed over, and so is an AV if the suite would be empty without it.

    Args:
        crashes, severity, size: As for `choose`.
        seed: Seed of the random sets.
        random_sets: Random sets of as many cases, for each AV, at least 1.
    """
    check_integer("random_sets", random_sets, low=1)
    clear = clear_order(crashes)
    found = []
    for av in range(crashes.shape[1]):
        others = np.delete(crashes, av, axis=1)
        if not crashes[:, av].any() or others.size == 0 or not others.any():
            continue
        suite = np.array(choose(others, severity, size).cases)
        rng = np.random.default_rng([seed, av])
        sets = [rng.choice(len(crashes), suite.size, replace=False) for _ in range(random_sets)]
        known, whole = (_known_of(crashes, clear[av], av, rows) for rows in (suite, np.arange(len(crashes))))
        random = np.stack([_known_of(crashes, clear[av], av, rows) for rows in sets])
        shown = np.column_stack([crashes[suite, av], crashes[suite, av, None] & ~others[suite]])  # its findings
        orders = [apfd(shown[rng.permutation(suite.size)]) for _ in range(random_sets)]
        found.append(
            LeftOut(
                av, suite.size, int(whole[1]), int(whole[4]), float(whole[2]), known, random, apfd(shown),
                np.array([np.nan if one is None else one for one in orders]),
            )
        )  # fmt: skip
    return found


def _known_of(
    crashes: NDArray[np.bool_], clear: NDArray[np.int8], av: int, cases: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Knowledge of an AV in cases (see `LeftOut.known`), (5,); `clear` is its row of `clear_order`."""
    some = crashes[cases]
    apart = (some[:, [av]] & ~some).any(axis=0).sum()
    places = [_place(part.mean(axis=0), av) for part in (some, crashes)]
    total = some.sum(axis=0)
    right = ((clear != 0) & (np.sign(total[av] - total) == clear)).sum()
    return np.array([some[:, av].any(), apart, some[:, av].mean(), abs(places[0] - places[1]), right], np.float64)


def _place(shares: NDArray[np.float64], av: int) -> float:
    """Rank of an AV among all, 0 for the AV that crashes least; equals share their mean."""
    return float((shares < shares[av]).sum() + 0.5 * ((shares == shares[av]).sum() - 1))
