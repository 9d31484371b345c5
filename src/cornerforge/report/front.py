"""The first screen in words: what crashes, how often, would a careful driver prevent it, what to see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.conduct import NO_CONDUCT
from cornerforge.analysis.flaw import FLAWS
from cornerforge.analysis.prevented import CAREFULLY, NOT_JUDGED, PREVENTION
from cornerforge.intervals import binomial_interval, share_interval, weighted_interval
from cornerforge.report import text
from cornerforge.report.kinds import kind_in_words
from cornerforge.report.natural_cases import NaturalCases
from cornerforge.report.road import RoadRate
from cornerforge.results import Analysed
from cornerforge.results.analysis import Natural, NaturalKind, OwnDoing

__all__ = ["Answer", "Front", "Known", "Look", "front_of", "how_often"]

DRIVERS = {
    False: "by the AV's own motion, or by three of four models of a careful driver",
    True: "by a model of a careful driver, which keeps the rules and sees through no vehicle",
}


@dataclass(frozen=True)
class Answer:
    """An answer of the first screen: its question, the answer in short, and what it rests on."""

    question: str
    short: str
    text: str
    warning: str = ""


@dataclass(frozen=True)
class Look:
    """The case to watch first: its name in its library, what kind it is, and why this one.

    Attributes:
        case_id: Its name in its library.
        is_natural: It is a natural case.
        title: Its kind, in words.
        often, interval: How often this kind happens on the road, and the interval with n; "" where it is not known.
        why: Why this case.
    """

    case_id: str
    is_natural: bool
    title: str
    often: str
    interval: str
    why: str


@dataclass(frozen=True)
class Front:
    """The first screen, and what the section on careful drivers says of the page's library ("": nothing)."""

    answers: tuple[Answer, ...]
    look: Look | None
    careful: str


@dataclass(frozen=True)
class Known:
    """Content of the first screen.

    Attributes:
        analysis: Analysis of the page's library.
        natural: Analysis of natural cases, or None; the same as `analysis` where the library is natural.
        kinds: How often natural kinds happen, as parts of `road` (`road.on_road`).
        cases: The natural cases.
        road: How often the AV crashes on the road; None: not known.
        adversary: Whether an adversary made the cases of `analysis`.
        unseen: In how many crashes the AV had lost sight of the other vehicle, as a sentence; "" for none.
        at_site: The AV drives over a junction.
    """

    analysis: Analysed
    natural: Analysed | None
    kinds: Natural | None
    cases: NaturalCases | None
    road: RoadRate | None
    adversary: bool
    unseen: str = ""
    at_site: bool = False


def front_of(known: Known) -> Front:
    """Make the first screen."""
    own = _prevented(known, own=True)
    return Front(
        (
            _what(known),
            how_often(known.road, known.kinds, adversary=known.adversary, at_site=known.at_site),
            _careful(known),
        ),
        _look(known),
        "" if own is None else f"{text.share(own[0].share)} {_parts(own, 'cases', at_site=known.at_site)}",
    )


def _range(low: float, high: float) -> str:
    return f"95 %: {text.share_range(low, high)}"


def _what(known: Known) -> Answer:
    """Say what the AV does wrong; or that nothing was found, and what happens most."""
    question = "What does it do wrong?"
    told: list[tuple[OwnDoing, str]] = []
    if known.natural is not None and known.natural.own_doing is not None:
        told.append((known.natural.own_doing, "crashes in natural traffic"))
    if known.natural is not known.analysis and known.analysis.own_doing is not None:
        told.append((known.analysis.own_doing, _made(known)))
    for doing, kind in told:
        if doing.flaws:
            return Answer(question, f"It {FLAWS[doing.flaws[0].flaw]}", _flaws(doing, kind) + known.unseen)
    if not told:
        return Answer(question, "Nobody has looked", _most(known))
    n = " and ".join(f"{text.count(sum(doing.conducts.values()))} {kind}" for doing, kind in told)
    wrong = sum(sum(doing.conducts.values()) - doing.conducts.get(NO_CONDUCT, 0) for doing, _ in told)
    some = f" In {text.count(wrong)} of them it did something wrong, too few to name a flaw." if wrong else ""
    return Answer(question, "No flaw of its own was found", f"in n = {n}.{some}{known.unseen} {_most(known)}")


def _made(known: Known) -> str:
    return "crashes that an adversary caused" if known.adversary else "crashes"


def _flaws(doing: OwnDoing, kind: str) -> str:
    first, n = doing.flaws[0], sum(doing.conducts.values())
    words = (
        f"In {text.share(first.share)} of its {kind} ({_range(*first.interval95)}; {text.count(first.cases)} of "
        f"n = {text.count(n)})."
    )
    words += f" {first.detail}" if first.detail else ""
    if len(doing.flaws) > 1:
        words += f" It also {'; '.join(f'{FLAWS[one.flaw]} ({text.share(one.share)})' for one in doing.flaws[1:])}."
    return words


def _most(known: Known) -> str:
    """Say what happens most."""
    if known.kinds is not None and known.kinds.mechanisms:
        name, kind = next(iter(known.kinds.mechanisms.items()))
        return f"Most often: {kind_in_words(name)} ({text.share(kind.share)} of natural crashes)."
    found = known.kinds.crash_types if known.kinds is not None else {}
    if found:
        name, share = next((name, kind.share) for name, kind in found.items())
    else:
        types = known.analysis.crash_types
        name = max(types, key=lambda kind: types[kind])
        share = types[name] / sum(types.values())
    return f"Most crashes are of the type “{text.plain(name)}” ({text.share(share)})."


_OTHERS = (
    "another vehicle in natural traffic, as recorded drivers drive",
    "a vehicle or a person in natural traffic, by stated laws of driving and walking",
)


def how_often(road: RoadRate | None, kinds: Natural | None, *, adversary: bool, at_site: bool = False) -> Answer:
    """Say how often the AV touches a vehicle on a road, and how often that injures somebody in it seriously.

    Args:
        road: What is known of it; None: nothing.
        kinds: Its parts; None: not known.
        adversary: An adversary made the crashes that the page is about.
        at_site: The AV drives over a junction.
    """
    question = "How often at such a junction?" if at_site else "How often on a road?"
    if road is None:
        made = "An adversary made these crashes" if adversary else "These are no crashes of natural traffic"
        return Answer(question, "Not known", f"{made}: they show how the AV can crash, not how often it does.")
    if road.miles is None:
        where = f" in {text.miles(road.driven)}" if road.driven is not None else ""
        return Answer(question, f"No crash seen{where}", f"so {road.words} (95 %; {road.basis}).", _doubt(road))
    short, also = road.words, f"95 %: {road.interval}"
    if road.doubts and road.high is not None:  # a single number would seem to be known
        short, also = f"once in {road.interval}", f"95 %; best estimate: {road.words}"
    return Answer(
        question,
        text.capital(short),
        f"it touches {_OTHERS[at_site]} ({also}; from {road.basis}).{_injuries(kinds, at_site=at_site)}",
        _doubt(road),
    )


def _injuries(kinds: Natural | None, *, at_site: bool) -> str:
    if kinds is None:
        return ""
    serious = kinds.serious_injuries
    low, high = (1e6 / end for end in reversed(serious.interval95_miles))
    whose = "in the AV (MAIS 3 or more, by delta-v)"
    if at_site:
        whose += " or of a person on foot (AIS 4 or more, by the AV's speed)"
    return (
        f" With a serious injury {whose}: {text.rate(1e6 / serious.miles_between, 2)} "
        f"per million miles (95 %: {text.interval(low, high, 2)})."
    )


def _doubt(road: RoadRate) -> str:
    return "Not to be trusted yet" if road.doubts else ""


@dataclass(frozen=True)
class _Share:
    share: float
    low: float
    high: float
    n: int

    @property
    def words(self) -> str:
        return f"{_range(self.low, self.high)}; n = {text.count(self.n)}"


def _natural_share(cases: NaturalCases, some: NDArray[np.bool_]) -> _Share:
    weight, judged = cases.weight, cases.judged
    low, high = share_interval(weight[judged & some], weight[judged])
    return _Share(float(weight[judged & some].sum() / weight[judged].sum()), low, high, int(judged.sum()))


def _ways_out(known: Known) -> _Share | None:
    """Share of crashes that left a way out so long after the manoeuvre began as `judges.lead` says."""
    found, kinds = known.natural or known.analysis, known.kinds
    if found.judges is None:
        return None
    lead, n = found.judges.lead, found.judges.cases
    weighs = known.cases is not None and float(np.ptp(known.cases.weight)) > 0.0
    if kinds is None or kinds.avoidable is None or not weighs:
        return _Share(lead.share, *lead.interval95, n)
    low, high = (min(1.0, end / kinds.all.crashes_per_test) for end in kinds.avoidable.interval95)
    return _Share(kinds.avoidable.share, low, high, n)


_Prevented = tuple[_Share, float, float]


def _prevented(known: Known, *, own: bool) -> _Prevented | None:
    """Share of natural cases, or of the page's own, that a careful driver would have prevented; and its two parts."""
    cases = known.cases
    if cases is not None and cases.judged.any() and not (own and known.natural is not known.analysis):
        braking, left_out = (cases.prevention == how for how in CAREFULLY)
        one, *parts = (_natural_share(cases, some) for some in (braking | left_out, braking, left_out))
        return one, parts[0].share, parts[1].share
    found = known.analysis.prevented
    if (known.natural is not None and not own) or found is None or found.careful is None:
        return None
    n, k, braked = found.cases, found.careful.cases, found.careful.by_braking
    return _Share(k / n, *binomial_interval(k, n), n), braked / n, (k - braked) / n


def _parts(found: _Prevented, kind: str, *, at_site: bool) -> str:
    braking, left_out = map(text.share, found[1:])
    by = DRIVERS[at_site]
    return f"({found[0].words} {kind}; {by}): {braking} by braking, {left_out} by leaving out what the AV began."


def _careful(known: Known) -> Answer:
    question = "Would a careful driver have prevented it?"
    ways, prevented = _ways_out(known), _prevented(known, own=False)
    kind = "natural crashes" if known.natural is not None else _made(known)
    words, short = [], ""
    if prevented is not None:
        share = prevented[0].share
        short = f"In {text.share(share)} of them" if share > 0.0 else "None of them"
        words.append(_parts(prevented, kind, at_site=known.at_site))
    if ways is not None:
        reaction = (known.natural or known.analysis).judges.lead.reaction_s  # type: ignore[union-attr]
        does = "chooses its speed" if known.at_site else "brakes or steers"
        words.append(
            f"In hindsight, an AV that {does} as well as can be {text.rate(reaction, 2)} s after the "
            f"manoeuvre that led to it began could have avoided {text.share(ways.share)} ({ways.words})."
        )
        short = short or f"{text.share(ways.share)} could have been avoided"
    if not words:
        return Answer(question, "Nobody has looked", "cornerforge analyse says it, without --avoidability none.")
    return Answer(question, short, " ".join(words))


_HOW = {
    PREVENTION[0]: "that a careful driver would have prevented; in this case by braking.",
    PREVENTION[1]: "that a careful driver would have prevented; in this case by not beginning what the AV began.",
    "nobody": "of natural crash. A careful driver would have prevented none.",
    NOT_JUDGED: "of natural crash.",
}
"""Why a case is watched first, by what would have prevented it."""


def _part(cases: NaturalCases, rows: NDArray[np.intp], kind: NaturalKind | None) -> str:
    """Say how often the crashes of a kind happen that a case is typical of; "" where they are all of the kind."""
    if kind is None or rows.size == kind.cases:
        return ""
    miles_per_test = kind.miles_between * kind.crashes_per_test
    low, high = weighted_interval(cases.weight[rows], float(cases.weight.max()))
    between = miles_per_test / float(cases.weight[rows].sum())
    ends = text.miles_range(miles_per_test / high, miles_per_test / low)
    return (
        f" That is {text.count(rows.size)} of these {text.count(kind.cases)} crashes: once in {text.miles(between)} "
        f"(95 %: {ends})."
    )


def _look(known: Known) -> Look | None:
    """Choose what to watch first."""
    first = None if known.cases is None else known.cases.first()
    if first is not None and known.cases is not None:
        found, prevented = first
        kinds = known.kinds
        assert kinds is not None
        kind = kinds.mechanisms.get(found.kind)
        often = interval = ""
        if kind is not None:
            low, high = kind.interval95_miles
            often = f"once in {text.miles(kind.miles_between)}"
            interval = f"95 %: {text.miles_range(low, high)}; n = {text.count(kind.cases)} crashes"
        how = str(known.cases.prevention[found.row])
        if not prevented and known.cases.judged.any():
            how = "nobody"
        reason = f"Typical of the most frequent kind {_HOW[how]}" + _part(known.cases, found.rows, kind)
        title = kind_in_words(found.kind)
        return Look(known.cases.case_id[found.row], True, title, often, interval, reason)
    top = known.analysis.value.top
    if not top:
        return None
    said = text.capital(text.plain(text.sentence(top[0].text.split(";")[0])))
    if not known.adversary:
        return Look(top[0].case_id, False, said, "", "", "The crash of highest value among these cases.")
    none = "No natural crash was seen" if known.road is not None else "No natural crash is known"
    why = f"{none}. This is the crash of highest value that an adversary caused; how often it happens is not known."
    return Look(top[0].case_id, False, said, "", "", why)
