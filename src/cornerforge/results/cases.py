"""Results of `replay`, `query`, `shrink`, `variety` and `plausibility`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from cornerforge.results.learning import AV_FAULTS, BOUNDED, BUDGET, POLICY_HASH
from cornerforge.results.rates import Interval, Yield
from cornerforge.results.stating import meant

__all__ = [
    "CaseMedians",
    "CaseSize",
    "MedianSize",
    "NaturalPlausibility",
    "Plausibility",
    "PlausibilityRow",
    "PlausibilityRun",
    "Queried",
    "Replayed",
    "ShrunkCase",
    "ShrunkLibrary",
    "Varied",
    "VarietyRow",
]


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """A case, or all cases, driven again."""

    case: str = field(metadata=meant('Case id, or "all".'))
    crash_time_s: float | None = field(
        metadata=meant("First contact, since the start of the test; null: there was none, or all cases.", "s")
    )
    identical: bool | None = field(metadata=meant("Is it what is stored, to the bit? null: not checked."))
    cases: int | None = field(default=None, metadata=meant("Cases driven; for all cases."))
    differ: tuple[str, ...] | None = field(default=None, metadata=meant("Ids of those that differ; for all cases."))
    note: str | None = field(default=None, metadata=meant("Why the first may differ, where that is known."))
    picture: str | None = field(default=None, metadata=meant("File of the picture; with `--picture`."))
    video: str | None = field(default=None, metadata=meant("File of the film; with `--video`."))


@dataclass(frozen=True, kw_only=True)
class Queried:
    """A table: the answer to SQL."""

    columns: tuple[str, ...] = field(metadata=meant("Names of the columns."))
    rows: tuple[tuple[Any, ...], ...] = field(
        metadata=meant("Values of each row; NaN and infinity are null, times and the like their text.")
    )


@dataclass(frozen=True, kw_only=True)
class CaseSize:
    """How large a case is."""

    vehicles: int = field(metadata=meant("Vehicles in it, the AV among them."))
    decisions: int = field(metadata=meant("Decisions, one a second."))
    seconds: float = field(metadata=meant("From its start to the crash.", "s"))
    deviating_actions: int = field(metadata=meant("Actions of BVs that are not the likeliest."))
    log_prob_nde: float | None = field(
        metadata=meant("ln P(critical BV's actions) in the NDE; null: an action is impossible.")
    )


@dataclass(frozen=True, kw_only=True)
class MedianSize:
    """Medians over cases."""

    vehicles: float = field(metadata=meant("Vehicles in a case."))
    decisions: float = field(metadata=meant("Decisions, one a second."))
    seconds: float = field(metadata=meant("From its start to the crash.", "s"))
    deviating_actions: float = field(metadata=meant("Actions of BVs that are not the likeliest."))


@dataclass(frozen=True, kw_only=True)
class CaseMedians:
    """How much smaller cases became."""

    before: MedianSize = field(metadata=meant("Of the whole cases."))
    after: MedianSize = field(metadata=meant("Of the shrunk ones."))


@dataclass(frozen=True, kw_only=True)
class ShrunkCase:
    """A case before and after."""

    case: str = field(metadata=meant("Case id, the same in both libraries."))
    crash_type: str = field(metadata=meant("Name of its crash type, the same before and after."))
    striker: str = field(metadata=meant("Who struck: av, bv or mutual; the same before and after."))
    cause: str = field(
        metadata=meant("Whose driving makes the crash, found with natural drivers instead: bvs, av or nobody.")
    )
    before: CaseSize = field(metadata=meant("The whole case."))
    after: CaseSize = field(metadata=meant("The shrunk one."))


@dataclass(frozen=True, kw_only=True)
class ShrunkLibrary:
    """The smallest forms of cases."""

    library: str = field(metadata=meant("Folder of the library of shrunk cases."))
    seconds: float = field(metadata=meant("Wall-clock of the work.", "s"))
    cases: tuple[ShrunkCase, ...] = field(metadata=meant("The cases that were asked for, ascending by test."))
    median: CaseMedians = field(metadata=meant("Medians over these."))


@dataclass(frozen=True, kw_only=True)
class VarietyRow:
    """How many kinds of crash a library holds, or a way to generate gives."""

    name: str = field(metadata=meant("The library, or policy and how it acts."))
    tests: int = field(metadata=meant("Tests driven."))
    av_crashes: int = field(metadata=meant("Tests that ended in a crash of the AV."))
    crashes_per_test: float | None = field(metadata=meant("Share of them, 0 to 1; null: no tests.", "per test"))
    interval95: Interval = field(metadata=meant("Its exact interval; 0 to 1 without tests.", "per test"))
    cases: int = field(metadata=meant("Cases that were put into cells."))
    filled: int = field(metadata=meant("Cells with a case."))
    possible: int | None = field(default=None, metadata=meant("Cells that there are; only with cases."))
    entropy: float | None = field(metadata=meant("Shannon's, of the shares of cells; null: no cases.", "nats"))
    entropy_interval95: Interval | None = field(
        default=None, metadata=meant("Its interval by bootstrap; only with cases.", "nats")
    )
    effective: float | None = field(metadata=meant("Number of equal cells that are as varied; null: no cases."))
    unseen: float | None = field(
        default=None, metadata=meant("Chance that the next case is of a new cell, 0 to 1; only with cases.")
    )
    unseen_interval95: Interval | None = field(default=None, metadata=meant("Its interval; only with cases."))
    cells: dict[str, int] = field(metadata=meant("Cases of each filled cell, fullest first."))


@dataclass(frozen=True, kw_only=True)
class Varied:
    """Kinds of crash, a row for each library or way to generate."""

    rows: tuple[VarietyRow, ...] = field(metadata=meant("In the order of the command line."))
    first_test: int | None = field(default=None, metadata=meant("Number of the first test; with `--policy`."))


@dataclass(frozen=True, kw_only=True)
class _PlausibilityTraining:
    """Identity of a training."""

    train_seed: int = field(metadata=meant("Seed of the training."))
    decisions: int = field(metadata=meant("Decisions learnt from."))
    seconds: float = field(metadata=meant("Wall-clock of the training.", "s"))
    policy_hash: str = field(metadata=POLICY_HASH)
    av_faults: int = field(metadata=AV_FAULTS)


@dataclass(frozen=True, kw_only=True)
class PlausibilityRun(Yield, _PlausibilityTraining):
    """One policy: its yield, and how plausible its part in the crashes is."""

    log_prob_per_decision: float | None = field(
        metadata=meant("Mean ln P(action) in the NDE, in crashes; null: one was impossible, or no crash.", "nats")
    )
    shortfall_per_test: float | None = field(
        metadata=meant("How far its possible actions fall short of the likeliest, in a crash; null: no crash.", "nats")
    )
    implausible_per_test: float | None = field(
        metadata=meant("Decisions that no natural driver makes, not even in error, in a crash; null: no crash.")
    )


@dataclass(frozen=True, kw_only=True)
class PlausibilityRow:
    """The policies of one budget."""

    budget: float | None = field(metadata=BUDGET)
    bounded: bool = field(metadata=BOUNDED)
    runs: tuple[PlausibilityRun, ...] = field(metadata=meant("One for each training seed."))


@dataclass(frozen=True, kw_only=True)
class NaturalPlausibility:
    """The same of natural drivers: the BV nearest to the AV in each second, over whole tests."""

    tests: int = field(metadata=meant("Tests driven."))
    log_prob_per_decision: float = field(metadata=meant("Mean ln P(action) in the NDE.", "nats"))
    shortfall_per_test: float = field(
        metadata=meant("How far their possible actions fall short of the likeliest, in a test.", "nats")
    )


@dataclass(frozen=True, kw_only=True)
class Plausibility:
    """Yield against plausibility."""

    rows: tuple[PlausibilityRow, ...] = field(
        metadata=meant("From the tightest budget to none (bounded), and to no mask at all (not bounded).")
    )
    natural: NaturalPlausibility = field(metadata=meant("Natural drivers."))
    out: str = field(metadata=meant("Folder of policies, curve and figure."))
    tests: int = field(metadata=meant("Evaluation tests of each policy."))
