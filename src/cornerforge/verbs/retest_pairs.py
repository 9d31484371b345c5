"""Cases of a retest that its page plays, and what both versions do in them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from cornerforge.analysis.contact import impact_speed
from cornerforge.errors import AvFaultError, CornerForgeError
from cornerforge.experiment.experiments import Experiment
from cornerforge.library import CaseLibrary
from cornerforge.report.comparison import AS_RECORDED, NATURAL, REACTING, Pair
from cornerforge.types import Scenario
from cornerforge.verbs.cases import experiment_of
from cornerforge.verbs.stored_cases import StoredScripts
from cornerforge.work.progress import Progress

__all__ = ["RULE", "Driven", "pairs_of"]

_MOST = {"new": 16, "still crashing": 8, "fixed": 6}
"""Most cases on the page of each kind."""
RULE = (
    "At most 30 cases: of the new crashes the first 16, natural ones first, then in the order of the tests; of those "
    "that still crash 8, and of the fixed ones 6, with the highest relative speed at contact in the stored crash. In "
    "each kind that speed gives the order. A case is shown with others as recorded, unless it is of its kind only with "
    "others who react."
)


@dataclass(frozen=True)
class Driven:
    """Outcomes of the tests of one drive, and both AVs in it.

    Attributes:
        kinds: What became of each test, by its case id, in the order of the tests.
        new, old: The runs; `old` is None where it is not at hand.
    """

    kinds: Mapping[str, str]
    new: Experiment
    old: Experiment | None


def pairs_of(
    cases: CaseLibrary,
    recorded: Driven,
    reacting: Driven | None,
    natural: Driven | None,
    progress: Progress,
) -> list[Pair]:
    """Choose cases as RULE says, and record both versions in them, in reading order.

    Where no baseline drives, the old version's recordings are those of the library; a test that it holds no case of is
    driven with the AV that made it, if that is built in. A test in which an AV from outside fails is left out.
    """
    old = None if recorded.old is not None or reacting is None else _maker(cases)
    chosen = _chosen(cases, recorded, reacting, natural)
    stored = set(recorded.kinds)
    record: dict[str, Callable[[str], tuple[Scenario | None, Scenario]]] = {AS_RECORDED: _scripted(cases, recorded)}
    if reacting is not None:
        record[REACTING] = _tests(cases, stored, reacting, reacting.old or old)
    if natural is not None:
        record[NATURAL] = _tests(cases, set(), natural, natural.old)
    pairs = []
    for done, (case, kind, drive) in enumerate(chosen):
        try:
            before, now = record[drive](case)
        except AvFaultError:
            continue
        pairs.append(Pair(case, kind, drive, before, now))
        progress("cases of the page", done + 1, len(chosen))
    order = list(_MOST)
    return sorted(pairs, key=lambda pair: (order.index(pair.kind), -pair.impact_mps))


def _maker(cases: CaseLibrary) -> Experiment | None:
    """The run that made the library; None if its AV is from outside or is not the one of that name any more."""
    try:
        return experiment_of(cases, takes_foreign=False)
    except CornerForgeError:
        return None


def _chosen(
    cases: CaseLibrary, recorded: Driven, reacting: Driven | None, natural: Driven | None
) -> list[tuple[str, str, str]]:
    """Case, kind and drive of each that is shown."""
    drives = [(AS_RECORDED, recorded.kinds), (REACTING, {} if reacting is None else reacting.kinds)]
    found: dict[str, dict[str, str]] = {kind: {} for kind in _MOST}  # kind -> case -> drive
    for drive, kinds in drives:
        for case, kind in kinds.items():
            if kind in found:
                found[kind].setdefault(case, drive)
    ids, history = cases.history()
    impact = dict(zip(ids, impact_speed(history[:, 0]).tolist(), strict=True))
    fresh = [] if natural is None else [(case, NATURAL) for case, kind in natural.kinds.items() if kind == "new"]
    fresh += sorted(found["new"].items(), key=lambda one: int(one[0].partition(":")[2]))
    chosen = [(case, "new", drive) for case, drive in fresh[: _MOST["new"]]]
    known = set(found["new"])  # a case is of the worst kind that it is of in either drive
    for kind in ("still crashing", "fixed"):
        stored = [case for case in found[kind] if case in impact and case not in known]
        stored.sort(key=lambda case: -impact[case])
        chosen += [(case, kind, found[kind][case]) for case in stored[: _MOST[kind]]]
        known |= set(found[kind])
    return chosen


def _scripted(cases: CaseLibrary, driven: Driven) -> Callable[[str], tuple[Scenario | None, Scenario]]:
    """Make what records a case with others as recorded."""
    scripts, new = StoredScripts(cases, driven.new), driven.new.script_driver()
    old = None if driven.old is None else driven.old.script_driver()

    def record(case: str) -> tuple[Scenario | None, Scenario]:
        stored = cases.scenario(case)
        script = scripts.of(stored)
        return stored.scenario if old is None else old.record(script)[0], new.record(script)[0]

    return record


def _tests(
    cases: CaseLibrary, stored: Collection[str], driven: Driven, old: Experiment | None
) -> Callable[[str], tuple[Scenario | None, Scenario]]:
    """Make what records a test of a seed; without a baseline the stored recording is the old version's."""
    new = driven.new.recorder()
    before = None if old is None else old.recorder()

    def record(case: str) -> tuple[Scenario | None, Scenario]:
        seed, test = (int(part) for part in case.split(":"))
        now = new.record(seed, test)
        if driven.old is None and case in stored:
            return cases.scenario(case).scenario, now
        return None if before is None else before.record(seed, test), now

    return record
