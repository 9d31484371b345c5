"""The result of `report --evidence`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = ["Answered", "AttributeTested", "Evidence", "Finding", "KindOfCrash"]

_N = meant("Events, cases or checks behind it; missing: it is no count.")


class Finding(Result):
    """A claim, the number that carries it, and what makes it again."""

    said: Annotated[str, meant("The claim, in a sentence, with unit, n and interval.")]
    value: Annotated[float | None, meant("Its number; missing: it has none.", "`unit`")] = None
    unit: Annotated[str | None, meant("Of `value`; missing: it is a share or a count, or there is none.")] = None
    n: Annotated[Whole | None, _N] = None
    interval95: Annotated[Interval | None, meant("95 % interval of `value`; missing: none is known.", "`unit`")] = None
    covers: Annotated[
        str | None, meant('What the interval is of: "chance" or "chance and model"; missing: there is none.')
    ] = None
    how: Annotated[str, meant("How it is computed.")]
    command: Annotated[str | None, meant("What makes it again; missing: the command of the run.")] = None


class AttributeTested(Result):
    """An attribute of the operational design domain (after ISO 34503), and what was driven of it."""

    attribute: Annotated[str, meant("Its name.")]
    driven: Annotated[str, meant('What was driven; "" if nothing of it is in the simulator.')]
    varied: Annotated[bool, meant("Whether it varied between tests.")]


class KindOfCrash(Result):
    """One kind of natural crash: how often, how hard, how involved, and whether care would have prevented it."""

    kind: Annotated[str, meant("What led to it, in words.")]
    cases: Annotated[Whole, meant("Cases of this kind.")]
    per_million_miles: Annotated[float, meant("Frequency.", "1/1e6 miles")]
    interval95: Annotated[Interval, meant("Interval of `per_million_miles`, of chance alone.", "1/1e6 miles")]
    prevented: Annotated[Share | None, meant("Share that a careful driver prevents, 0 to 1; null: none was judged.")]
    ttc_1s: Annotated[float | None, meant("Median TTC with the partner 1 s before contact; null: rarely closing.", "s")]
    delta_v: Annotated[float | None, meant("Median change of the AV's velocity; null: not known.", "m/s")]
    serious: Annotated[
        float | None, meant("Mean chance of a serious injury in the AV (MAIS 3 or more), 0 to 1; null: not known.")
    ]
    involved: Annotated[float | None, meant("Mean number of vehicles that take part; null: not counted.")]
    acts: Annotated[float | None, meant("Mean number of their acts: lane changes and hard braking; null: likewise.")]


class Answered(Result):
    """A question of an assessor, and its answer."""

    number: Annotated[Whole, meant("From 1.")]
    question: Annotated[str, meant("The question.")]
    asked_by: Annotated[tuple[str, ...], meant("Clauses that ask it, each with its document.")]
    answer: Annotated[str, meant('The answer in short; or "Not covered, because" and why.')]
    covered: Annotated[bool, meant("Whether these artefacts answer it.")]
    findings: Annotated[tuple[Finding, ...], meant("The claims that the answer rests on.")]
    not_covered: Annotated[tuple[str, ...], meant("What of it is not covered, and why.")]


class Evidence(Result):
    """Evidence for an assessment of an AV, question by question; no statement of conformity."""

    av: Annotated[str, meant("Name of the AV.")]
    version: Annotated[str, meant("Version of cornerforge that made the results.")]
    answers: Annotated[tuple[Answered, ...], meant("By question.")]
    odd: Annotated[tuple[AttributeTested, ...], meant("The operational design domain as tested.")]
    kinds: Annotated[tuple[KindOfCrash, ...], meant("Natural crashes by kind, most frequent first.")]
    files: Annotated[dict[str, str], meant("SHA-256 of the files that it was made of, by path.")]
