"""`analyse` finds kinds of crash, typical and rare cases, and judges avoidability, fault and value of each case."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.output import open_output, provenance, write_json
from cornerforge.fields import SHORTFALL
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.natural import is_natural, natural_weights
from cornerforge.rates.judges import LEAD_S, has_way_out, judges_of
from cornerforge.rates.natural import natural_shares
from cornerforge.results import Analysed, as_json, from_json
from cornerforge.results.analysis import Natural
from cornerforge.verbs.options.cases import Analyse
from cornerforge.work.progress import Progress

if TYPE_CHECKING:
    import pyarrow as pa

    from cornerforge.analysis import Analysis
    from cornerforge.analysis.value import Value

__all__ = ["ANALYSIS_FILES", "DEFAULT_LOOKS", "analyse"]

DEFAULT_LOOKS = 2000
"""Default number of cases drawn for the search for ways out: it takes a few seconds on two cores."""
ANALYSIS_FILES = ("analysis.json", "cases.parquet", "points.parquet", "witnesses.parquet")
"""What an analysis leaves in its folder, besides `provenance.json`."""
_TOP = 10
_BY_BRAKING = ", by braking"
_SHOWING = 5
"""Cases that are shown for a flaw."""


@verb(Analyse)
def analyse(options: Analyse) -> Analysed:
    """Analyse a library (paper, "Corner case analysis"), and judge its cases: measures, fault, avoidability, value.

    Returns:
        What `cornerforge analyse --json` prints: clusters, typical and rare cases, ways out, faults, values; of
        natural cases how often each kind happens, too.

    Raises:
        CornerForgeError: The library cannot be read or is empty, or an argument is out of range.
    """
    from cornerforge.analysis import analyse as analyse_history
    from cornerforge.analysis.site_case import in_av_frame

    check_integer("seed", options.seed, low=0, high=2**32 - 1)
    looks = _looks(options.avoidability)
    n_threads = check_threads(options.threads)
    cases = CaseLibrary.open(Path(options.library))
    if len(cases) == 0:
        fill = f"cornerforge generate --out {options.library} --resume"
        if is_natural(cases):
            place = Path(options.library).parent
            fill += f"; if rate made it, with: cornerforge rate --out {place} --resume, and more tests"
        raise InputError(f"The library {options.library} holds no cases yet; fill it with: {fill}")
    weights = natural_weights(cases)
    purpose = options.purpose or ("attack" if weights is None else "road")
    if purpose == "road" and weights is None:
        raise InputError(
            f"The cases of {options.library} come from an adversary, so nothing says how often they happen on the "
            "road; use purpose attack, or a library that rate or generate makes from natural traffic."
        )
    identity = {
        **cases.identity, "cases": len(cases), "steps": options.steps, "analysis_seed": options.seed,
        "avoidability": str(options.avoidability), "reaction": float(options.reaction), "purpose": purpose,
    }  # fmt: skip
    if options.out is not None:
        open_output(Path(options.out), identity, resume=True)
    options.progress("analyse", 0, len(cases))
    ids, history = cases.history()
    if cases.odd.site is not None:  # so that features, and faces of the contact, mean what they do on roads
        history = in_av_frame(history)
    length, width = cases.sizes()
    found = analyse_history(
        ids, history, steps=options.steps, seed=options.seed, vehicle_length=length, vehicle_width=width
    )
    told = found.to_json()
    drawn = _draw(found.case_ids, looks, options.seed)
    chosen = drawn | _outstanding(found) if looks != 0 else drawn
    table, witnesses, reacting, value = _judge(
        cases, found, chosen, options.reaction, n_threads, options.progress, told["seconds"]
    )
    natural = by_case = None
    if weights is not None:
        by_case = np.array([weights[case] for case in found.case_ids])
        natural = _natural(cases, found, table, drawn, options.reaction, by_case)
    doing, showing = _own_doing(found, table, value, by_case)
    first = value.best(_TOP).tolist()
    if purpose == "road" and natural is not None:
        typical = _most_frequent(found, natural)
        first = [*showing, *(row for row in typical if row not in showing)][:_TOP]
    told |= _judged(found, table, drawn, options.reaction) | {
        "judges": _compared(found, table, drawn, options.reaction, reacting),
        "own_doing": doing,
        "value": {"weights": value.weights, "top": _top(cases, found, table, value, first)}, "purpose": purpose,
    }  # fmt: skip
    analysed = replace(from_json(Analysed, told), natural=natural)
    if options.out is not None:
        _write(Path(options.out), analysed, found, table, witnesses)
        write_json(Path(options.out) / "provenance.json", provenance(identity, round(analysed.seconds["total"], 3)))
    return analysed


def _looks(avoidability: int | str) -> int | None:
    """Return how many cases to draw; None for all.

    Raises:
        InputError: It is neither a number nor "all" nor "none".
    """
    if avoidability == "all":
        return None
    if avoidability == "none":
        return 0
    try:
        number = int(avoidability)
    except ValueError:
        raise InputError(
            f'avoidability = {avoidability!r} is not allowed; a number of cases, "all" or "none".'
        ) from None
    return check_integer("avoidability", number, low=0, high=10**9)


def _draw(ids: tuple[str, ...], looks: int | None, seed: int) -> frozenset[str]:
    if looks is None or looks >= len(ids):
        return frozenset(ids)
    rows = np.random.default_rng([seed, 20]).choice(len(ids), size=looks, replace=False)
    return frozenset(ids[row] for row in rows)


def _outstanding(found: Analysis) -> frozenset[str]:
    """Return the ids of the typical and rare cases."""
    return frozenset(found.rare).union(*(one.typical for one in found.clusters))


def _judge(
    cases: CaseLibrary, found: Analysis, chosen: frozenset[str], reaction: float, threads: int, progress: Progress,
    seconds: dict[str, float],
) -> tuple[pa.Table, pa.Table, dict[str, NDArray[np.bool_]], Value]:  # fmt: skip
    """Judge case by case, in the order of the analysis; add the time that each part took to `seconds`.

    Returns:
        The table; ways out; of each case that was looked at what drivers would have prevented, `CaseTable.reacting`;
        the values.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    from cornerforge.analysis.avoidability import AvoidParams
    from cornerforge.analysis.case_table import ShardReading, read_shards, values_of, with_mechanism

    begin = time.perf_counter()
    reading = ShardReading(
        cases.odd, chosen, AvoidParams(delay_s=float(reaction), steers=bool(cases.identity.get("av_steers"))), threads
    )
    parts, done = [], 0
    for part in read_shards(cases.shards(), reading):
        parts.append(part)
        done += part.table.num_rows
        progress("judge", done, len(cases))
    if not parts:
        raise InputError(f"No shard of {cases.path} can be read; generate the library again.")
    table = pa.concat_tables([part.table for part in parts])
    rows = pc.index_in(pa.array(found.case_ids, pa.string()), value_set=table.column("case_id").combine_chunks())
    if rows.null_count:
        raise InputError(
            f"The trajectories of {rows.null_count} case(s) of {cases.path} are damaged; generate the library again: "
            "with the same command and seed its cases are the same."
        )
    missing = table.column(SHORTFALL[0].name).null_count
    if missing:
        warnings.warn(
            f"{missing} of {table.num_rows} cases of {cases.path} do not say how natural their acts were, so "
            f"{', '.join(field.name for field in SHORTFALL)} are null for them; generate the library again to have it.",
            stacklevel=3,
        )
    recorded = ((case.scalars["case_id"], case.scenario) for case in cases.scenarios(found.case_ids))
    table = with_mechanism(table.take(rows), recorded)
    table, value = values_of(table, found.projection.points)
    seconds["judge"] = time.perf_counter() - begin
    seconds["total"] += seconds["judge"]
    reacting = {
        case: row
        for part in parts
        for case, row in zip(part.witnesses.column("case_id").to_pylist(), part.reacting, strict=True)
    }
    return table, pa.concat_tables([part.witnesses for part in parts]), reacting, value


def _judged(found: Analysis, table: pa.Table, drawn: frozenset[str], reaction: float) -> dict[str, Any]:
    """Return the keys that judging adds to an analysis."""
    from cornerforge.analysis.coverage import coverage_of

    is_drawn = np.array([case in drawn for case in found.case_ids], np.bool_)
    labels, index = _labels(table, is_drawn)
    looked = is_drawn if index is not None else np.ones(len(found.case_ids), np.bool_)
    impact = _column(table, "impact_speed_mps")
    grid = coverage_of(found.crash_types.code[looked], impact[looked], index, labels)
    return {
        "fault": _counts(_strings(table, "fault")),
        "fault_rules": _counts(_strings(table, "fault_rule")),
        "severity": {
            name: {str(q): float(np.quantile(_column(table, name), q / 100.0)) for q in (5, 50, 95, 99)}
            for name in ("impact_speed_mps", "av_delta_v_mps", "av_injury_probability")
        },
        "avoidability": _avoidability(table, is_drawn, reaction),
        "prevented": _prevented(table),
        "coverage": grid.to_json(),
    }


def _column(table: pa.Table, name: str) -> NDArray[np.float64]:
    return np.array(table.column(name).to_numpy(zero_copy_only=False), np.float64)


def _strings(table: pa.Table, name: str) -> list[str | None]:
    values: list[str | None] = table.column(name).to_pylist()
    return values


def _own(table: pa.Table) -> NDArray[np.bool_]:
    """Mark the cases in which the AV itself began the manoeuvre that led to the crash."""
    from cornerforge.counterfactual import OWN_MANOEUVRES

    return np.array([value in OWN_MANOEUVRES for value in _strings(table, "manoeuvre")], np.bool_)


def _counts(values: list[str | None]) -> dict[str, int]:
    names, counts = np.unique([value for value in values if value is not None], return_counts=True)
    return {str(names[k]): int(counts[k]) for k in np.argsort(-counts, kind="stable")}


def _labels(table: pa.Table, is_drawn: NDArray[np.bool_]) -> tuple[tuple[str, ...], NDArray[np.int64] | None]:
    """Return label names and each drawn case's label; no labels when nothing was drawn or a case has none."""
    from cornerforge.analysis.avoidability import LABELS

    names = tuple(LABELS)
    given = [value for value, chosen in zip(_strings(table, "avoidability"), is_drawn, strict=True) if chosen]
    if not given or None in given:
        return (), None
    return names, np.array([names.index(str(value)) for value in given], np.int64)


def _avoidability(table: pa.Table, is_drawn: NDArray[np.bool_], reaction: float) -> dict[str, Any] | None:
    """Count the labels of the drawn cases; None when nothing was drawn."""
    from cornerforge.analysis.avoidability import LABELS

    n = int(is_drawn.sum())
    if n == 0:
        return None
    labels = [value for value, chosen in zip(_strings(table, "avoidability"), is_drawn, strict=True) if chosen]
    counts = {name: labels.count(name) for name in LABELS}
    ways = n - counts["unavoidable"] - counts["undecided"] - labels.count(None)
    times = _column(table, "time_to_react_s")[is_drawn]
    times = times[np.isfinite(times)]
    return {
        "cases": n,
        "reaction_s": float(reaction),
        "labels": counts,
        "not_judged": labels.count(None),
        "avoidable_share": ways / n,
        "interval95": list(binomial_interval(ways, n)),
        "median_time_to_react_s": float(np.median(times)) if times.size else None,
    }


def _prevented_masks(table: pa.Table) -> dict[str, NDArray[np.bool_]]:
    """Mark the cases that each reference driver would have prevented: at all, and by braking."""
    from cornerforge.analysis.prevented import CAREFULLY

    said = [set() if names is None else set(names.split(", ")) for names in _strings(table, "prevented_by")]
    held = np.array([bool(value) for value in table.column("held_speed_prevents").to_pylist()], np.bool_)
    by = {name: np.array([name in names for names in said], np.bool_) for name in _drivers(table)}
    careful = {"a careful driver": np.isin(_ways(table), CAREFULLY)}
    return careful | by | {f"{name}{_BY_BRAKING}": cases & ~held for name, cases in by.items()}


def _drivers(table: pa.Table) -> list[str]:
    """Name the reference drivers that drove in a case; at a site those that know lanes did not, and are left out."""
    from cornerforge.drivers.careful import CAREFUL

    column = {name: table.column(f"braking_{name.replace('-', '_')}_mps2") for name in CAREFUL}
    return [name for name, braking in column.items() if braking.null_count < table.num_rows] or list(CAREFUL)


def _ways(table: pa.Table) -> NDArray[np.str_]:
    return np.array(_strings(table, "prevention"), np.str_)


def _prevented(table: pa.Table) -> dict[str, Any] | None:
    """Count what each reference driver would have prevented; None when no case could be judged."""
    from cornerforge.analysis.prevented import PREVENTION

    masks = _prevented_masks(table)
    n = table.num_rows - table.column("prevented_by").null_count
    if n == 0:
        return None

    def share(cases: NDArray[np.bool_], braking: NDArray[np.bool_]) -> dict[str, Any]:
        k = int(cases.sum())
        return {
            "cases": k,
            "share": k / n,
            "interval95": list(binomial_interval(k, n)),
            "by_braking": int(braking.sum()),
        }

    by = {name: (masks[name], masks[f"{name}{_BY_BRAKING}"]) for name in _drivers(table)}
    every, braked = (np.logical_or.reduce(part) for part in zip(*by.values(), strict=True))
    held = sum(bool(value) for value in table.column("held_speed_prevents").to_pylist())
    return {
        "cases": n,
        "by": {name: share(*pair) for name, pair in by.items()},
        "any": share(every, braked),
        "held": held,
        "careful": share(masks["a careful driver"], _ways(table) == PREVENTION[0]),
    }


def _compared(
    found: Analysis, table: pa.Table, drawn: frozenset[str], reaction: float, reacting: dict[str, NDArray[np.bool_]]
) -> dict[str, Any] | None:
    """Compare the judges on the drawn cases that all of them judged; None: there is none."""
    said, ways = _strings(table, "prevented_by"), _strings(table, "avoidability")
    rows = [
        row
        for row, case in enumerate(found.case_ids)
        if case in drawn and said[row] is not None and ways[row] not in (None, "undecided")
    ]
    masks, held = _prevented_masks(table), table.column("held_speed_prevents").to_pylist()
    compared = judges_of(
        _column(table, "time_to_react_s")[rows],
        _own(table)[rows],
        {name: masks[name][rows] for name in _drivers(table)},
        np.array([bool(held[row]) for row in rows], np.bool_),
        np.array([reacting[found.case_ids[row]] for row in rows], np.bool_),
        float(reaction) or LEAD_S,
    )
    return None if compared is None else as_json(compared)


def _own_doing(
    found: Analysis, table: pa.Table, value: Value, weights: NDArray[np.float64] | None
) -> tuple[dict[str, Any], list[int]]:
    """Say what the AV does wrong, and give the rows of the cases to show for the flaw that shows most.

    `weights`: how often each case happens in natural traffic; None: the cases come from an adversary.
    """
    from cornerforge.analysis.conduct import Conduct
    from cornerforge.analysis.flaw import flaws_of, in_words

    conduct = Conduct.of_columns(
        _strings(table, "conduct"), _strings(table, "conduct_side"), _column(table, "conduct_s")
    )
    flaws, shown = flaws_of(conduct, weights), []
    first: list[int] = []
    score = np.nan_to_num(value.score, nan=-1.0)
    for flaw in flaws:
        ranked = flaw.cases[np.argsort(-score[flaw.cases], kind="stable")[:_SHOWING]].tolist()
        first = first or ranked
        shown.append(
            {
                "flaw": flaw.name,
                "cases": flaw.cases.size,
                "share": flaw.share,
                "interval95": list(flaw.interval95),
                "typical": [found.case_ids[row] for row in ranked],
                "detail": flaw.detail or None,
            }
        )
    text = in_words(flaws, conduct, natural=weights is not None)
    return {"text": text, "flaws": shown, "conducts": _counts(_strings(table, "conduct"))}, first


def _natural(
    cases: CaseLibrary, found: Analysis, table: pa.Table, drawn: frozenset[str], reaction: float,
    weights: NDArray[np.float64],
) -> Natural:  # fmt: skip
    """Compute how often each kind happens in natural traffic; `weights`: of the cases, in the order of the analysis."""
    after = float(reaction) or LEAD_S
    return natural_shares(
        weights,
        cases.odd,
        kinds={
            "clusters": [str(number) for number in found.cluster_index.tolist()],
            "crash_types": found.crash_types.names,
            "mechanisms": _strings(table, "mechanism"),
            "fault": _strings(table, "fault"),
            "conducts": _strings(table, "conduct"),
        },
        prevented=_prevented_masks(table),
        avoidable=has_way_out(_column(table, "time_to_react_s"), _own(table), after),
        avoidable_after_s=after,
        looked_at=np.array([case in drawn for case in found.case_ids], np.bool_),
        injury=_column(table, "av_injury_probability"),
    )


def _most_frequent(found: Analysis, natural: Natural) -> list[int]:
    """Return the rows of the cases to show first: typical ones, of the most frequent cluster first, then the next."""
    typical = {str(cluster.id): cluster.typical for cluster in found.clusters}
    most = max(len(cases) for cases in typical.values())
    first = [typical[name][k] for k in range(most) for name in natural.clusters if k < len(typical[name])]
    place = {case: row for row, case in enumerate(found.case_ids)}
    return [place[case] for case in first[:_TOP]]


def _top(cases: CaseLibrary, found: Analysis, table: pa.Table, value: Value, rows: list[int]) -> list[dict[str, Any]]:
    """Return the cases of some rows, those with a value, each with a sentence."""
    import pyarrow as pa

    from cornerforge.analysis.in_words import avoidance_in_words, case_in_words

    rows = [row for row in rows if np.isfinite(value.score[row])]
    avoidance = table.take(pa.array(rows, pa.int64())).to_pylist()
    top = []
    for row, known in zip(rows, avoidance, strict=True):
        case_id = found.case_ids[row]
        avoided = avoidance_in_words(known["avoidability"], known["latest_any_s"], known["latest_braking_s"])
        words = case_in_words(cases.scenario(case_id).scenario, avoided)
        top.append(
            {
                "case_id": case_id,
                "value": float(value.score[row]),
                **{name: float(part[row]) for name, part in value.parts.items()},
                "crash_type": found.crash_types.names[row],
                "fault": known["fault"],
                "prevented_by": known["prevented_by"],
                "held_speed_prevents": known["held_speed_prevents"],
                "prevention": known["prevention"],
                "conduct": known["conduct"],
                "text": words,
            }
        )
    return top


def _write(out: Path, analysed: Analysed, found: Analysis, table: pa.Table, witnesses: pa.Table) -> None:
    import pyarrow as pa

    from cornerforge._table_checks import write_parquet

    points = pa.table({name: pa.array(values) for name, values in found.points.items()})
    everything = points
    for field in table.schema:
        if field.name != "case_id":
            everything = everything.append_column(field, table.column(field.name))
    for name, content in (("points", points), ("cases", everything), ("witnesses", witnesses)):
        write_parquet(out / f"{name}.parquet", content)
    write_json(out / "analysis.json", as_json(analysed))  # last: where it is, the others are too
