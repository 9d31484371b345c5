"""Answers to an assessor's ten questions, each a sentence with the claims that it rests on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cornerforge.errors import InputError
from cornerforge.ext.evidence.against_people import DIFFERENCES, TRUE_RATIOS, compare_kind, miles_needed
from cornerforge.ext.evidence.benchmarks import PERSONS, matching
from cornerforge.ext.evidence.kinds import HOW
from cornerforge.ext.evidence.material import Material
from cornerforge.ext.evidence.odd import odd_as_tested
from cornerforge.ext.evidence.questions import QUESTIONS
from cornerforge.report import text
from cornerforge.report.front import front_of, how_often
from cornerforge.results import Regulated
from cornerforge.results.evidence import Answered, Evidence, Finding
from cornerforge.results.validation import FactFound
from cornerforge.types import METRES_PER_MILE

__all__ = ["evidence_of"]

_CHANCE, _MODEL = "chance", "chance and model"
_Answer = tuple[str, list[Finding], list[str]]
"""The answer in short, its claims (none: it is not covered), and what is not covered."""


def evidence_of(m: Material) -> Evidence:
    """Answer all questions from the material."""
    made = []
    for number, (question, answer) in enumerate(zip(QUESTIONS, _ANSWERS, strict=True), start=1):
        short, claims, gaps = answer(m)
        made.append(
            Answered(
                number=number,
                question=question.asks,
                asked_by=question.clauses,
                answer=short,
                covered=bool(claims),
                findings=tuple(replace(one, command=one.command or m.command) for one in claims),
                not_covered=tuple(gaps),
            )
        )
    return Evidence(
        av=m.summary.av,
        version=m.summary.version,
        answers=tuple(made),
        odd=odd_as_tested(m.odd),
        kinds=m.kinds,
        files=m.files,
    )


def _nothing(why: str) -> _Answer:
    return f"Not covered, because {why}", [], []


def _odd(m: Material) -> _Answer:
    rows = odd_as_tested(m.odd)
    driven, rate = [row for row in rows if row.driven], m.summary.natural
    claims = [
        Finding(
            said=f"{len(driven)} of {len(rows)} attributes of the ODD are in the tests; "
            f"{sum(r.varied for r in rows)} of "
            "them varied from test to test.",
            value=float(len(driven)),
            n=len(rows),
            how="Attributes in the groups of ISO 34503 (scenery, environment, dynamic elements); the list is this "
            "tool's.",
        )
    ]
    if rate is not None:
        claims.append(
            Finding(
                said=f"{text.count(rate.plain_tests)} natural tests as recorded drivers drive them, "
                f"{text.count(rate.miles)} miles of the AV.",
                value=rate.miles,
                unit="miles",
                n=rate.plain_tests,
                how="Tests without branching and without an adversary.",
            )
        )
    short = f"{len(driven)} of {len(rows)} attributes, on one road, in {m.odd.traffic} traffic"
    return short, claims, [f"{row.attribute}: nothing of it is in the simulator." for row in rows if not row.driven]


_NO_NATURAL = "no natural crash was analysed"


def _frequency(m: Material) -> _Answer:
    if not m.kinds:
        return _nothing(_NO_NATURAL)
    claims = [
        Finding(
            said=f"{one.kind}: {text.rate(one.per_million_miles, 2)} per million miles "
            f"(95 %: {text.interval(*one.interval95, 2)}; n = {text.count(one.cases)}).",
            value=one.per_million_miles,
            unit="1/1e6 miles",
            n=one.cases,
            interval95=one.interval95,
            covers=_CHANCE,
            how=HOW["frequency"],
        )
        for one in m.kinds
    ]
    gaps = ["Scenarios that end without a crash are not counted."]
    if m.known.natural is not None:
        seen = m.known.natural.coverage
        gaps.append(
            f"Kinds not seen yet: the next natural crash is of a new kind with a chance of "
            f"{text.share(seen.unseen_kind_chance)} (95 %: {text.share_range(*seen.unseen_kind_interval95)}; "
            f"n = {text.count(seen.cases)})."
        )
    return f"{len(m.kinds)} kinds of natural crash; most often: {m.kinds[0].kind}", claims, gaps


def _criticality(m: Material) -> _Answer:
    if not m.kinds:
        return _nothing(_NO_NATURAL)
    claims = []
    for one in m.kinds:
        parts = [
            said
            for value, said in (
                (one.delta_v, f"delta-v {one.delta_v or 0.0:.1f} m/s"),
                (one.serious, f"chance of a serious injury {text.share(one.serious or 0.0)}"),
                (one.ttc_1s, f"TTC 1 s before contact {one.ttc_1s or 0.0:.1f} s"),
            )
            if value is not None
        ]
        said = f"{one.kind}: {', '.join(parts)}; n = {text.count(one.cases)}."
        claims.append(Finding(said=said, value=one.delta_v, unit="m/s", n=one.cases, how=HOW["criticality"]))
    hardest = max(m.kinds, key=lambda one: one.serious or 0.0)
    return f"Hardest in the mean: {hardest.kind}", claims, ["Critical moments without contact are not graded here."]


def _complexity(m: Material) -> _Answer:
    claims = [
        Finding(
            said=f"{one.kind}: {one.involved:.1f} vehicles take part, with {one.acts:.1f} acts; "
            f"n = {text.count(one.cases)}.",
            value=one.involved,
            unit="vehicles",
            n=one.cases,
            how=HOW["complexity"],
        )
        for one in m.kinds
        if one.involved is not None
    ]
    if not claims:
        return _nothing(_NO_NATURAL)
    most = max(m.kinds, key=lambda one: one.acts or 0.0)
    return (
        f"Most acts: {most.kind} ({most.acts:.1f})",
        claims,
        ["The measure is ours: ISO 34505 leaves it to its user."],
    )


def _how_often(m: Material) -> _Answer:
    if m.road is None:
        return _nothing("no natural rate was measured; cornerforge rate does it")
    card, kinds = how_often(m.road, None, adversary=m.known.adversary), m.known.kinds
    claims = [
        Finding(
            said=f"{card.short} {card.text}",
            value=1e6 / m.road.miles if m.road.miles else None,
            unit="touches per 1e6 miles",
            interval95=(1e6 / m.road.high if m.road.high else 0.0, 1e6 / m.road.low),
            covers=_CHANCE,
            how=f"From {m.road.basis}. A touch is any contact; it need not do damage.",
        )
    ]
    gaps = [f"Not to be trusted yet: {doubt}" for doubt in m.road.doubts]
    drawn = _drawn_models(m)
    if drawn is None:
        gaps.append(
            "The traffic model's own uncertainty is not in the interval: cornerforge rate --model-draws 20 --out "
            "FOLDER, "
            "then --beside FOLDER."
        )
    else:
        claims.append(drawn)
    if kinds is not None:
        serious = kinds.serious_injuries
        ends = (0.0 if serious.interval95_miles[1] == 0.0 else 1e6 / serious.interval95_miles[1],
                1e6 / serious.interval95_miles[0])  # fmt: skip
        often = 1e6 / serious.miles_between
        claims.append(
            Finding(
                said=f"With a serious injury in the AV (MAIS 3 or more): {text.rate(often, 2)} per million miles "
                f"(95 %: {text.interval(*ends, 2)}; n = {text.count(kinds.all.cases)} crashes).",
                value=often,
                unit="1/1e6 miles",
                n=kinds.all.cases,
                interval95=ends,
                covers=_CHANCE,
                how="Sum over the crashes of the chance of MAIS 3 or more by delta-v.",
            )
        )
        claims.append(_per_hour(m, often, ends))
    against, why = _people(m)
    return card.short, claims + against, gaps + why


_INDICATIVE = 1e-7
"""Fatalities per hour of operation: an indicative criterion (Regulation (EU) 2022/1426, Annex II 7.1.1, footnote)."""


def _per_hour(m: Material, often: float, ends: tuple[float, float]) -> Finding:
    """Hold serious injuries per million miles against the EU's indicative criterion, at the fastest that is driven."""
    speed = 3600.0 * m.odd.max_speed / METRES_PER_MILE
    hourly, low, high = (1e-6 * speed * rate for rate in (often, *ends))
    hours, _ = miles_needed(_INDICATIVE)
    return Finding(
        said=f"That is at most {text.rate(hourly, 2)} per hour of driving (95 %: {text.interval(low, high, 2)}). "
        f"The EU names {text.rate(_INDICATIVE, 1)} fatalities per hour of operation as an indicative criterion. A "
        "serious injury is more frequent than a death, and deaths outside of the AV are not counted. To show that "
        f"criterion with a confidence of 95 % takes {text.rate(hours, 2)} hours without a death, at that speed "
        f"{text.miles(hours * speed)}.",
        value=hourly,
        unit="1/h",
        interval95=(low, high),
        covers=_CHANCE,
        how="Regulation (EU) 2022/1426, Annex II 7.1.1, footnote (for comparable transport services; other measures "
        f"are allowed). Hours: rule of three. No driving time is stored: all miles count as driven at "
        f"{m.odd.max_speed:g} m/s, the largest speed of any vehicle.",
    )


_LIKE = {
    "MAIS 3 or more": ("injuries of MAIS 3 or more, deaths among them,", "Persons are counted there, not vehicles"),
    "any injury": ("any injury", "Any injury is more frequent than a serious one"),
}
"""What a published rate is of, and why serious injuries in the AV over it are a lower bound."""


def _people(m: Material) -> tuple[list[Finding], list[str]]:
    """Hold serious injuries against people's rates on freeways; give the claims and what they leave open."""
    if m.known.kinds is None:
        return [], ["People's rates: no natural crash was analysed, so there is nothing to hold against them."]
    claims = []
    for row in (*matching("freeway", "MAIS 3 or more", unit=PERSONS), *matching("freeway", "any injury")):
        try:
            found = compare_kind(row, m.known.kinds.serious_injuries)
        except InputError as error:
            return [], [f"People's rates: {error}"]
        outcome, why = _LIKE[row.outcome]
        needed = ", ".join(f"{miles_needed(row.rate, ratio)[0]:.1f} at {ratio:g}" for ratio in (0.0, *TRUE_RATIOS))
        claims.append(
            Finding(
                said=f"Serious injuries in the AV are {text.rate(found.ratio, 2)} times as frequent as {outcome} "
                f"of people on freeways of {row.place} ({row.rate:.3g} {row.unit} per million miles; 95 %: "
                f"{text.interval(found.low, found.high, 2)}). {why}: so a "
                "lower bound. To show an AV no worse than these people takes so many million miles, by its true rate "
                f"over theirs: {needed}.",
                value=found.ratio,
                n=m.known.kinds.all.cases,
                interval95=(found.low, found.high),
                covers=_CHANCE,
                how=f"{row.source} ({row.doi}; {row.where}). Miles: exact Poisson test, 95 % confidence, 80 % power.",
            )
        )
    return claims, [DIFFERENCES]


def _drawn_models(m: Material) -> Finding | None:
    """Give the rate's interval with the traffic model's own uncertainty; None if no models were drawn."""
    drawn = None if m.rate is None else m.rate.model_uncertainty
    if m.rate is None or drawn is None or drawn.interval95_per_mile is None or not m.rate.crashes_per_mile:
        return None
    ends = (1e6 * drawn.interval95_per_mile[0], 1e6 * drawn.interval95_per_mile[1])
    return Finding(
        said=f"With the traffic model's own uncertainty: {text.interval(*ends, 2)} touches per million miles (95 %; "
        f"{drawn.draws} models drawn, between which the rate varies by {text.share(drawn.cv)} of its mean).",
        value=1e6 * m.rate.crashes_per_mile,
        unit="touches per 1e6 miles",
        n=drawn.draws,
        interval95=ends,
        covers=_MODEL,
        how="Rates in models drawn about the fitted one, as far as the recordings allow (docs/adr/0034).",
        command=f"cornerforge rate --av {m.summary.av} --model-draws {drawn.draws}",
    )


def _careful(m: Material) -> _Answer:
    claims, gaps = [], []
    card = front_of(m.known).answers[2]
    said = (m.known.natural or m.known.analysis).prevented
    if said is not None and said.careful is not None:
        claims.append(
            Finding(
                said=f"{card.short} {card.text}",
                value=said.careful.share,
                n=said.cases,
                interval95=said.careful.interval95,
                covers=_CHANCE,
                how="Three of four published models of a careful driver (UN R157, RSS, FSM) brake in time in the AV's "
                "place, or the AV's own mistake is left out. `value` counts cases; the sentence weighs natural "
                "ones by how "
                "often they happen.",
            )
        )
    claims += [_suite(one) for one in m.beside.regulated]
    for suite, what in (("r157", "UN R157"), ("aeb", "tests of emergency braking (UN R152, Euro NCAP)")):
        if suite not in {one.suite for one in m.beside.regulated}:
            gaps.append(f"Scenarios of {what}: cornerforge suite run {suite} --out FOLDER, then --beside FOLDER.")
    return card.short if said is not None else "Not covered, because no crash was judged", claims, gaps


def _suite(found: Regulated) -> Finding:
    tests = sum(one.verdict == "touched" for one in found.tests)
    own = (
        f" Of the {len(found.tests)} tests that the protocols demand it touches in {tests}, in {found.beyond_allowed} "
    )
    own += "faster than UN R152 allows an AEB."
    return Finding(
        said=f"The AV fails in {text.count(found.failed)} of {text.count(found.scenarios)} scenarios of the suite "
        f"{found.suite}; in {text.count(found.failed_but_prevented_by_all)} of these each reference driver passes."
        f"{own if found.tests else ''}",
        value=found.share_failed,
        n=found.scenarios,
        how="Grids of speeds, gaps and manoeuvres; a grid is no sample, so there is no interval.",
        command=f"cornerforge suite run {found.suite} --av {found.av}",
    )


def _unknown(m: Material) -> _Answer:
    made = m.summary.generate
    if made is None:
        return _nothing("no adversary searched; cornerforge run does it")
    seen, flaw = m.artefacts.analysis.coverage, front_of(m.known).answers[0]
    kinds, chance = len(seen.cells), text.share(seen.unseen_kind_chance)
    how = "bounded to what natural drivers do" if m.summary.bounded else "free to do what a vehicle can"
    claims = [
        Finding(
            said=f"An adversary, {how}, made the AV crash in {text.share(made.crashes_per_test)} of "
            f"{text.count(made.tests)} tests (95 %: {text.share_range(*made.interval95)}); {text.count(made.cases)} "
            "cases "
            "are kept.",
            value=made.crashes_per_test,
            unit="per test",
            n=made.tests,
            interval95=made.interval95,
            covers=_CHANCE,
            how="A dueling DQN controls the vehicle nearest to the AV.",
        ),
        Finding(
            said=f"The cases are of {kinds} of {kinds + len(seen.empty)} kinds; the next case is of a new kind with a "
            f"chance of {chance} (95 %: {text.share_range(*seen.unseen_kind_interval95)}).",
            value=seen.unseen_kind_chance,
            n=seen.cases,
            interval95=seen.unseen_kind_interval95,
            covers=_CHANCE,
            how="Kinds by crash type, avoidability and impact speed; the chance of a new one after Good and Turing.",
        ),
        Finding(said=f"{flaw.short}: {flaw.text}", how="What the AV itself did wrong, case by case."),
    ]
    short = f"{kinds} kinds of crash found; the next case is of a new kind with a chance of {chance}"
    return short, claims, ["Hazards outside of the ODD as tested (question 1) cannot be found by this search."]


def _missed(fact: FactFound) -> str:
    found = "not seen" if fact.found is None else f"{text.rate(fact.found)} {fact.unit}".rstrip()
    allowed = "" if fact.allowed is None else f", allowed {text.interval(*fact.allowed)}"
    return f"Missed: {fact.fact} ({fact.when}): {found}{allowed}; n = {text.count(fact.n)}."


def _credibility(m: Material) -> _Answer:
    claims, gaps = [], []
    for one in m.beside.validations:
        judged = [fact for fact in one.facts if fact.within is not None]
        passed = sum(bool(fact.within) for fact in judged)
        claims.append(
            Finding(
                said=f"{passed} of {len(judged)} checks of the traffic model against recordings and published facts "
                "pass.",
                value=passed / max(1, len(judged)),
                n=len(judged),
                how="Each check has its source and its allowed range on the page of ndd validate.",
                command="cornerforge ndd validate MODEL --against RECORDINGS --out FOLDER",
            )
        )
        gaps += [_missed(fact) for fact in judged if not fact.within]
    if not claims:
        gaps.append("Validation of the traffic model: cornerforge ndd validate --out FOLDER, then --beside FOLDER.")
    drawn = _drawn_models(m)
    claims += [drawn] if drawn is not None else []
    gaps.append(f"The AV's {_not_modelled(m)} are not modelled: its decisions alone are tested.")
    return claims[0].said if claims else "Not covered, because no validation lies beside", claims, gaps


def _not_modelled(m: Material) -> str:
    """Name what is missing of the AV besides its decisions."""
    if m.odd.perception is None:
        return "sensors, actuators and hardware"
    return "sensors, but for the stated errors of what it perceives, its actuators and its hardware"


def _traceable(m: Material) -> _Answer:
    own = m.artefacts.provenance.get("identity", {})
    names = {
        "code": "simulator's code",
        "model_hash": "traffic model",
        "config_hash": "ODD and options",
        "av_hash": "AV",
    }
    hashes = ", ".join(f"{what} {own[key]}" for key, what in names.items() if own.get(key))
    claims = [
        Finding(
            said=f"Made by cornerforge {m.summary.version}, seed {m.summary.seed}: {hashes}.",
            how="Hashes of all that decides a result; the same ones give the same bits, on any number of threads.",
        ),
        Finding(
            said=f"{text.count(m.verified.whole)} files are as they were written, {len(m.verified.damaged)} are "
            "damaged.",
            value=float(len(m.verified.damaged)),
            n=m.verified.whole + len(m.verified.damaged),
            how="SHA-256 and allowed values of each file.",
            command=f"cornerforge verify {m.artefacts.out}",
        ),
        Finding(
            said="Each case can be driven again from its seed, to the bit.",
            how="Digest over all vehicles at full precision.",
            command=f"cornerforge replay {m.artefacts.library} all --check",
        ),
    ]
    gaps = [f"Damaged: {one.file}: {one.fault}" for one in m.verified.damaged]
    gaps.append("An AV from outside is named by the hash of its file; what that loads is not in it.")
    return (
        f"Version, seed and hashes of code, traffic model, options and AV; {len(m.files)} files by SHA-256",
        claims,
        gaps,
    )


def _limits(m: Material) -> _Answer:
    claims = [
        Finding(
            said=f"Against {one.baseline}: {text.count(one.fixed)} cases fixed, {text.count(one.new_crashes)} new "
            "crashes, "
            f"{text.count(one.still_crashing)} still crash; it {'got' if one.got_worse else 'did not get'} worse.",
            value=float(one.new_crashes),
            n=one.cases,
            how="The same tests with both versions.",
            command=f"cornerforge retest {one.library} --av {one.av}",
        )
        for one in m.beside.retested
    ]
    gaps = (
        [] if claims else ["An earlier version: cornerforge retest LIB --av NEW --out retest.json, then --beside it."]
    )
    missing = [row.attribute.lower() for row in odd_as_tested(m.odd) if not row.driven]
    gaps.append(f"Not tested: {'; '.join(missing)}.")
    gaps.append("Monitoring in service and the interplay with the AV's users are outside of this tool.")
    return claims[0].said if claims else "Not covered, because no earlier version was compared", claims, gaps


_ANSWERS: tuple[Callable[[Material], _Answer], ...] = (
    _odd, _frequency, _criticality, _complexity, _how_often, _careful, _unknown, _credibility, _traceable, _limits,
)  # fmt: skip
