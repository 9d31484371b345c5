"""The flaw that an AV's crashes show: what it does wrong most, in words, from the conduct in each case (`conduct.py`).

One crash can come from one wrong act; a flaw shows in many. Two facts need many cases: all overlooked vehicles were on
one side; in lane changes the AV overlooked many vehicles behind it and none ahead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.conduct import CONDUCTS, IN_SHORT, NO_CONDUCT, Conduct
from cornerforge.intervals import share_interval
from cornerforge.results.analysis import OwnDoing

__all__ = ["FLAWS", "Flaw", "flaws_of", "headline", "in_words"]

FLAWS: dict[str, str] = {
    "hesitates": "hesitates between lanes",
    "not-behind": "does not look behind when it changes lanes",
    "not-beside": "does not look beside when it changes lanes",
    "not-left": "does not see its left side",
    "not-right": "does not see its right side",
    "brakes-late": "brakes late for vehicles ahead",
    "brakes-weakly": "brakes too weakly for vehicles ahead",
    "forgets": "forgets vehicles ahead that it had heeded",
    "does-not-brake": "does not brake for vehicles ahead",
    "too-close": "keeps too little distance",
    "brakes-hard": "brakes hard for nothing",
    "late-at-cut-ins": "brakes late when others cut in",
    "brakes-too-little": "brakes too late or too little, now this way and now that",
    "merges-blind": "merges without a look",
    "blocks-mergers": "does not let merging vehicles in",
    "stops-at-end": "stops where its lane ends, although there are gaps",
    "runs-red": "runs red lights",
    "does-not-yield": "does not give way to vehicles that go first",
    "does-not-yield-to-people": "does not give way to people on crosswalks",
    "enters-blocked": "drives into junctions that others have not left",
    "drives-on": "does not brake for what is in its way",
    "overlooks-hidden-people": "overlooks people that come out from behind a vehicle",
    "overlooks-hidden": "overlooks vehicles that come out from behind another",
}
"""Name of each flaw, and what the AV does, after "This AV"."""

_NOTHING = "Nothing was found that is this AV's own doing"

LEAST_CASES, LEAST_SHARE = 3, 0.01
"""A flaw shows in at least so many cases, and surely (95 % interval) in more than this share of all crashes."""
_CHANGES, _INTO_REAR = ("not-behind", "not-beside", "cuts-in"), ("stops-heeding", "does-not-brake")
_REACTS = ("reacts-late",)
_ALONE = (
    "hesitates",
    "brakes-late",
    "brakes-weakly",
    "too-close",
    "brakes-hard",
    "merges-blind",
    "blocks-mergers",
    "stops-at-end",
    "runs-red",
    "does-not-yield",
    "does-not-yield-to-people",
    "enters-blocked",
    "drives-on",
    "overlooks-hidden-people",
    "overlooks-hidden",
)
_GROUPS = (*((name,) for name in _ALONE), _CHANGES, _INTO_REAR, _REACTS)
_BRAKES_TOO_LITTLE = ("brakes-late", "brakes-weakly", *_INTO_REAR, *_REACTS)
"""Looked at as one where no group alone shows a flaw."""
_MANY, _HALF, _NEARLY_ALL = 0.2, 0.5, 0.8
"""Shares of the cases of a group in which one of its conducts must show to name the flaw."""
_ONE_SIDE, _SIDED_CASES = 0.95, 8
_LEFT, _RIGHT = 1, 2


@dataclass(frozen=True)
class Flaw:
    """One flaw and the cases that show it.

    Attributes:
        name: A key of `FLAWS`.
        cases: Rows of the cases, ascending.
        share: Share of all crashes, by weight, 0 to 1.
        interval95: Interval of the share.
        detail: Sentences on what the cases show, each kind with its number, and on which side the other was where it
            was nearly always the same; "" where that is one kind and no side.
    """

    name: str
    cases: NDArray[np.intp]
    share: float
    interval95: tuple[float, float]
    detail: str


def flaws_of(conduct: Conduct, weights: NDArray[np.float64] | None = None) -> list[Flaw]:
    """Name the flaws that S cases show, the one with the largest share first; empty: none stands out.

    Args:
        conduct: Conduct of the cases.
        weights: How often each happens, above 0, shape (S,); None: equal weights.
    """
    weight = np.ones(conduct.code.size) if weights is None else weights
    names = np.array(list(CONDUCTS))[conduct.code]
    found: dict[str, NDArray[np.intp]] = {}
    for group in (*_GROUPS, _BRAKES_TOO_LITTLE):
        if group is _BRAKES_TOO_LITTLE and found:
            break
        rows = np.flatnonzero(np.isin(names, group))
        if rows.size >= LEAST_CASES and share_interval(weight[rows], weight)[0] > LEAST_SHARE:
            name = _name(group, names, conduct, rows, weight)
            found[name] = np.union1d(found.get(name, rows), rows)
    flaws = [_flaw(name, rows, weight, conduct) for name, rows in found.items()]
    return sorted(flaws, key=lambda flaw: -flaw.share)


def _flaw(name: str, rows: NDArray[np.intp], weight: NDArray[np.float64], conduct: Conduct) -> Flaw:
    """Make a flaw of the cases that show it."""
    share = float(weight[rows].sum() / weight.sum())
    return Flaw(name, rows, share, share_interval(weight[rows], weight), " ".join(_details(name, rows, conduct)))


def _details(name: str, rows: NDArray[np.intp], conduct: Conduct) -> Iterator[str]:
    """Say what the cases of a flaw are, and where the other was; both are counts of cases."""
    codes, counts = np.unique(conduct.code[rows], return_counts=True)
    if codes.size > 1:
        order, words = np.argsort(-counts, kind="stable"), list(IN_SHORT.values())
        yield f"{_in_row([f'in {counts[k]:,} it {words[codes[k]]}' for k in order])}.".capitalize()
    for side, words_of_side in ((_LEFT, "left"), (_RIGHT, "right")):
        beside = int((conduct.side[rows] == side).sum())
        if rows.size >= _SIDED_CASES and beside >= _ONE_SIDE * rows.size and name not in ("not-left", "not-right"):
            yield f"The other was on its {words_of_side} in {beside:,} of {rows.size:,}."


def _in_row(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def in_words(flaws: Sequence[Flaw], conduct: Conduct, *, natural: bool) -> str:
    """Say in a sentence or two what the AV does wrong, or that nothing was found.

    Args:
        flaws: Result of `flaws_of`.
        conduct: Conduct of the cases.
        natural: They are natural cases, and shares are by how often each happens.
    """
    n, wrong = conduct.code.size, int((conduct.code != list(CONDUCTS).index(NO_CONDUCT)).sum())
    kind = "natural crashes" if natural else "crashes"
    if not flaws:
        kind = kind if n != 1 else kind.removesuffix("es")
        some = f" In {wrong:,} of them it did something wrong, too few to name a flaw." if wrong else ""
        return f"{_NOTHING}, in {n:,} {kind}.{some}"
    first = flaws[0]
    low, high = first.interval95
    text = (
        f"This AV {FLAWS[first.name]}, in {_percent(first.share)} of its {kind} (95 % interval "
        f"{_percent(low)} to {_percent(high)}; {first.cases.size:,} of {n:,} cases)."
    )
    text += f" {first.detail}" if first.detail else ""
    if len(flaws) > 1:
        text += f" It also {'; '.join(f'{FLAWS[one.name]} ({_percent(one.share)})' for one in flaws[1:])}."
    return text


def headline(natural: OwnDoing | None, adversary: OwnDoing | None) -> str:
    """Say first what matters most: the flaw that natural crashes show, else the one that an adversary found, else none.

    Args:
        natural: What natural cases show; None without natural cases.
        adversary: What the cases of an adversary show; None without them. One of the two must be given.
    """
    told = [one for one in (natural, adversary) if one is not None]
    flawed = [one for one in told if one.flaws]
    if not flawed:
        return told[0].text if len(told) == 1 else _nothing_in(*told)
    text = flawed[0].text
    if len(flawed) == 2 and flawed[1].flaws[0].flaw != flawed[0].flaws[0].flaw:
        one = flawed[1].flaws[0]
        text += f" In the crashes that the adversary caused it {FLAWS[one.flaw]} ({_percent(one.share)} of them)."
    return text


def _nothing_in(natural: OwnDoing, adversary: OwnDoing) -> str:
    """Say that neither natural cases nor an adversary's cases show a flaw."""
    n, m = (sum(one.conducts.values()) for one in (natural, adversary))
    wrong = n + m - sum(one.conducts.get(NO_CONDUCT, 0) for one in (natural, adversary))
    text = f"{_NOTHING}: not in {n:,} natural crashes, nor in {m:,} that an adversary caused."
    return text + (f" In {wrong:,} of them it did something wrong, too few to name a flaw." if wrong else "")


def _percent(share: float) -> str:
    if share < 0.1:
        return f"{100.0 * share:.2g} %"
    return f"{100.0 * share:.{1 if 0.99 <= share < 1.0 else 0}f} %"


def _name(
    group: tuple[str, ...],
    names: NDArray[np.str_],
    conduct: Conduct,
    rows: NDArray[np.intp],
    weight: NDArray[np.float64],
) -> str:
    """Name the flaw of a group of conducts."""

    def share_of(which: NDArray[np.bool_]) -> float:
        return float(weight[rows[which]].sum() / weight[rows].sum())

    if group is _REACTS:
        return "brakes-late" if share_of(conduct.side[rows] == 0) > _HALF else "late-at-cut-ins"
    if group is _BRAKES_TOO_LITTLE:
        return "brakes-too-little"
    if len(group) == 1:
        return group[0]

    if share_of(names[rows] == "cuts-in") >= _NEARLY_ALL:
        return "too-close"
    sides = conduct.side[rows]
    seen = share_of(names[rows] == "not-beside") >= _MANY or group is _INTO_REAR
    if seen and rows.size >= _SIDED_CASES:
        for side, name in ((_LEFT, "not-left"), (_RIGHT, "not-right")):
            if share_of(sides == side) >= _ONE_SIDE:
                return name
    if group is _CHANGES:
        return "not-beside" if seen else "not-behind"
    return "forgets" if share_of(names[rows] == "stops-heeding") >= _MANY else "does-not-brake"
