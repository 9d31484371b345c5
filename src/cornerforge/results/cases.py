"""Results of `replay`, `query`, `shrink`, `variety` and `plausibility`."""

from __future__ import annotations

from typing import Annotated, Any

from cornerforge._schema import Whole, meant
from cornerforge._words import shown
from cornerforge.errors import InputError, one_line
from cornerforge.results.html import Result, html_of, html_table
from cornerforge.results.learning import AV_FAULTS, BOUNDED, BUDGET, POLICY_HASH
from cornerforge.results.rates import Interval, Yield

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


class Replayed(Result):
    """A case, or all cases, driven again."""

    case: Annotated[str, meant('Case id, or "all".')]
    crash_time_s: Annotated[
        float | None, meant("First contact, since the start of the test; null: there was none, or all cases.", "s")
    ]
    identical: Annotated[bool | None, meant("Is it what is stored, to the bit? null: not checked.")]
    cases: Annotated[Whole | None, meant("Cases driven; for all cases.")] = None
    differ: Annotated[tuple[str, ...] | None, meant("Ids of those that differ; for all cases.")] = None
    note: Annotated[str | None, meant("Why the first may differ, where that is known.")] = None
    picture: Annotated[str | None, meant("File of the picture; with `--picture`.")] = None
    video: Annotated[str | None, meant("File of the film; with `--video`.")] = None


class Queried(Result):
    """A table: the answer to SQL."""

    columns: Annotated[tuple[str, ...], meant("Names of the columns.")]
    rows: Annotated[
        tuple[tuple[Any, ...], ...],
        meant("Values of each row; NaN and infinity are null, times and the like their text."),
    ]

    def _repr_html_(self) -> str:
        rows = (tuple(map(html_of, row)) for row in self.rows)
        return html_table(self.columns, rows, f"{len(self.rows):,} rows of {len(self.columns)} columns")

    def to_arrow(self) -> Any:
        """Make a `pyarrow.Table`, which polars and DuckDB read.

        Raises:
            InputError: A column mixes types, or has a whole number of 2^63 or more.
        """
        import pyarrow as pa

        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        made = []
        for name, values in zip(self.columns, columns, strict=True):
            try:
                made.append(pa.array(values))
            except (pa.ArrowException, OverflowError) as error:
                raise InputError(f"The column {shown(name)} is no column of Arrow: {one_line(str(error))}") from None
        return pa.Table.from_arrays(made, names=list(self.columns))

    def to_pandas(self) -> Any:
        """Make a `pandas.DataFrame`; pandas must be installed.

        Raises:
            InputError: As for `to_arrow`.
        """
        return self.to_arrow().to_pandas()


class CaseSize(Result):
    """How large a case is."""

    vehicles: Annotated[Whole, meant("Vehicles in it, the AV among them.")]
    decisions: Annotated[Whole, meant("Decisions, one a second.")]
    seconds: Annotated[float, meant("From its start to the crash.", "s")]
    deviating_actions: Annotated[Whole, meant("Actions of BVs that are not the likeliest.")]
    log_prob_nde: Annotated[
        float | None, meant("ln P(critical BV's actions) in the NDE; null: an action is impossible.")
    ]


class MedianSize(Result):
    """Medians over cases."""

    vehicles: Annotated[float, meant("Vehicles in a case.")]
    decisions: Annotated[float, meant("Decisions, one a second.")]
    seconds: Annotated[float, meant("From its start to the crash.", "s")]
    deviating_actions: Annotated[float, meant("Actions of BVs that are not the likeliest.")]


class CaseMedians(Result):
    """How much smaller cases became."""

    before: Annotated[MedianSize, meant("Of the whole cases.")]
    after: Annotated[MedianSize, meant("Of the shrunk ones.")]


class ShrunkCase(Result):
    """A case before and after."""

    case: Annotated[str, meant("Case id, the same in both libraries.")]
    crash_type: Annotated[str, meant("Name of its crash type, the same before and after.")]
    striker: Annotated[str, meant("Who struck: av, bv or mutual; the same before and after.")]
    cause: Annotated[
        str, meant("Whose driving makes the crash, found with natural drivers instead: bvs, av or nobody.")
    ]
    before: Annotated[CaseSize, meant("The whole case.")]
    after: Annotated[CaseSize, meant("The shrunk one.")]


class ShrunkLibrary(Result):
    """The smallest forms of cases."""

    library: Annotated[str, meant("Folder of the library of shrunk cases.")]
    seconds: Annotated[float, meant("Wall-clock of the work.", "s")]
    cases: Annotated[tuple[ShrunkCase, ...], meant("The cases that were asked for, ascending by test.")]
    median: Annotated[CaseMedians, meant("Medians over these.")]


class VarietyRow(Result):
    """How many kinds of crash a library holds, or a way to generate gives."""

    name: Annotated[str, meant("The library, or policy and how it acts.")]
    tests: Annotated[Whole, meant("Tests driven.")]
    av_crashes: Annotated[Whole, meant("Tests that ended in a crash of the AV.")]
    crashes_per_test: Annotated[float | None, meant("Share of them, 0 to 1; null: no tests.", "per test")]
    interval95: Annotated[Interval, meant("Its exact interval; 0 to 1 without tests.", "per test")]
    cases: Annotated[Whole, meant("Cases that were put into cells.")]
    filled: Annotated[Whole, meant("Cells with a case.")]
    possible: Annotated[Whole | None, meant("Cells that there are; only with cases.")] = None
    entropy: Annotated[float | None, meant("Shannon's, of the shares of cells; null: no cases.", "nats")]
    entropy_interval95: Annotated[Interval | None, meant("Its interval by bootstrap; only with cases.", "nats")] = None
    effective: Annotated[float | None, meant("Number of equal cells that are as varied; null: no cases.")]
    unseen: Annotated[float | None, meant("Chance that the next case is of a new cell, 0 to 1; only with cases.")] = (
        None
    )
    unseen_interval95: Annotated[Interval | None, meant("Its interval; only with cases.")] = None
    cells: Annotated[dict[str, Whole], meant("Cases of each filled cell, fullest first.")]


class Varied(Result):
    """Kinds of crash, a row for each library or way to generate."""

    rows: Annotated[tuple[VarietyRow, ...], meant("In the order of the command line.")]
    first_test: Annotated[Whole | None, meant("Number of the first test; with `--policy`.")] = None


class _PlausibilityTraining(Result):
    """Identity of a training."""

    train_seed: Annotated[Whole, meant("Seed of the training.")]
    decisions: Annotated[Whole, meant("Decisions learnt from.")]
    seconds: Annotated[float, meant("Wall-clock of the training.", "s")]
    policy_hash: Annotated[str, POLICY_HASH]
    av_faults: Annotated[Whole, AV_FAULTS]


class PlausibilityRun(Yield, _PlausibilityTraining):
    """One policy: its yield, and how plausible its part in the crashes is."""

    log_prob_per_decision: Annotated[
        float | None, meant("Mean ln P(action) in the NDE, in crashes; null: one was impossible, or no crash.", "nats")
    ]
    shortfall_per_test: Annotated[
        float | None,
        meant("How far its possible actions fall short of the likeliest, in a crash; null: no crash.", "nats"),
    ]
    implausible_per_test: Annotated[
        float | None, meant("Decisions that no natural driver makes, not even in error, in a crash; null: no crash.")
    ]


class PlausibilityRow(Result):
    """The policies of one budget."""

    budget: Annotated[float | None, BUDGET]
    bounded: Annotated[bool, BOUNDED]
    runs: Annotated[tuple[PlausibilityRun, ...], meant("One for each training seed.")]


class NaturalPlausibility(Result):
    """The same of natural drivers: the BV nearest to the AV in each second, over whole tests."""

    tests: Annotated[Whole, meant("Tests driven.")]
    log_prob_per_decision: Annotated[float, meant("Mean ln P(action) in the NDE.", "nats")]
    shortfall_per_test: Annotated[
        float, meant("How far their possible actions fall short of the likeliest, in a test.", "nats")
    ]


class Plausibility(Result):
    """Yield against plausibility."""

    rows: Annotated[
        tuple[PlausibilityRow, ...],
        meant("From the tightest budget to none (bounded), and to no mask at all (not bounded)."),
    ]
    natural: Annotated[NaturalPlausibility, meant("Natural drivers.")]
    out: Annotated[str, meant("Folder of policies, curve and figure.")]
    tests: Annotated[Whole, meant("Evaluation tests of each policy.")]
