"""`variety` counts the kinds of crash in libraries, or in equally many tests of several ways to generate."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.setting import experiment
from cornerforge.ext.studies.options import Variety
from cornerforge.fields import HISTORY_SHAPE
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import harvest_tests
from cornerforge.results import Varied, from_json
from cornerforge.results.cases import VarietyRow
from cornerforge.sim import outcome
from cornerforge.work.progress import Progress
from cornerforge.world_options import WorldOptions

__all__ = ["VARIETY_TESTS", "variety"]

VARIETY_TESTS = (1 << 41) + (1 << 40)
"""Number of the first test on which ways to generate are compared: far from training and evaluation tests."""


@verb(Variety, writes=False)
def variety(options: Variety) -> Varied:
    """Count the kinds of crash in libraries, or in the same tests driven by policies: greedy, at random, and mixed.

    Returns:
        What `cornerforge variety --json` prints: a row for each library, or each way to generate.

    Raises:
        CornerForgeError: Input or files are not right.
    """
    check_integer("seed", options.seed, low=0, high=2**32 - 1)
    n_threads = check_threads(options.threads)
    world = options.world()
    if bool(options.libraries) == bool(options.policies):
        raise InputError("Give either libraries or policies: cornerforge variety LIB..., or --policy FILE...")
    if options.libraries:
        _refuse_idle({"acting": options.acting} | asdict(world), {"acting": "softmax"} | asdict(WorldOptions()))
        return Varied(rows=tuple(_library_row(Path(path), options.seed) for path in options.libraries))
    if options.acting == "greedy":
        raise InputError("Greedy acting is shown anyway; give how to act at random: --acting softmax:0.1")
    ways = [([name], way) for name in options.policies for way in ("greedy", options.acting)]
    if len(options.policies) > 1:
        ways += [(list(options.policies), way) for way in ("greedy", options.acting)]
    rows: list[VarietyRow] = []
    for names, way in ways:
        run = experiment(world, bv=[str(name) for name in names], acting=way, takes_foreign=True, seed=options.seed)
        if not rows:
            forecast(
                run, options.threads, f"driving {len(ways) * options.tests:,} tests", tests=len(ways) * options.tests
            )
        what = names[0] if len(names) == 1 else f"mixture of {len(names)}"
        rows.append(
            _generated_row(run, f"{what}, {run.acting}", options.tests, options.seed, n_threads, options.progress)
        )
    return Varied(rows=tuple(rows), first_test=VARIETY_TESTS)


def _refuse_idle(given: dict[str, Any], usual: dict[str, Any]) -> None:
    """Refuse arguments that only policies need.

    Raises:
        InputError: An argument has another value than its default.
    """
    for name, value in given.items():
        if value != usual[name]:
            raise InputError(f"{name} = {value!r} has no effect on libraries; give it with --policy FILE.")


def _row(
    name: str, tests: int, crashes: int, pose: NDArray[np.float64], size: tuple[NDArray[np.float64], ...], seed: int
) -> VarietyRow:
    from cornerforge.analysis.variety import crash_cells, variety_of

    interval = binomial_interval(crashes, tests) if tests else (0.0, 1.0)
    rate: dict[str, Any] = {
        "name": name,
        "tests": tests,
        "av_crashes": crashes,
        "crashes_per_test": crashes / tests if tests else None,
        "interval95": interval,
    }
    if len(pose) == 0:
        return VarietyRow(**rate, cases=0, filled=0, entropy=None, effective=None, cells={})
    cell, names = crash_cells(pose, vehicle_length=size[0], vehicle_width=size[1])
    return from_json(VarietyRow, {**rate, **variety_of(cell, names, seed=seed).to_json()})


def _library_row(path: Path, seed: int) -> VarietyRow:
    library = CaseLibrary.open(path)
    history = library.history()[1]
    return _row(str(path), library.tests, library.crashes, history[:, 0], library.sizes(), seed)


def _generated_row(run: Experiment, name: str, tests: int, seed: int, threads: int, progress: Progress) -> VarietyRow:
    poses, sizes, valid = [], [], 0
    for done, harvested in harvest_tests(run, seed, VARIETY_TESTS, tests, threads):
        flat = harvested.cases.column("history").combine_chunks().flatten().to_numpy()
        poses.append(flat.reshape(-1, *HISTORY_SHAPE)[:, 0].astype(np.float64))
        sizes.append(np.stack([harvested.cases.column(f"bv_{side}_m").to_numpy() for side in ("length", "width")]))
        valid += int((harvested.outcomes.code != outcome.AV_FAULT).sum())
        progress(f"variety ({name})", done, tests)
    run.check_not_all_spoiled(valid, tests)
    pose, partner = np.concatenate(poses), np.concatenate(sizes, axis=1)
    of_car = (run.odd.vehicle_length, run.odd.vehicle_width)
    size = tuple(np.stack([np.full(len(pose), car), bv], axis=1) for car, bv in zip(of_car, partner, strict=True))
    return _row(name, valid, len(pose), pose, size, seed)


def variety_text(result: Varied) -> str:
    """Write the rows as text, with the fullest cells of each."""
    lines = []
    for row in result.rows:
        yielded = "" if row.crashes_per_test is None else f"{row.crashes_per_test:.3f} crashes per test; "
        lines.append(f"{row.name}: {yielded}{row.cases:,} cases in {row.filled} cells")
        if row.entropy_interval95 is not None:
            low, high = row.entropy_interval95
            lines[-1] += (
                f" (of {row.possible}), entropy {row.entropy:.2f} nats ({low:.2f} to {high:.2f}), "
                f"as varied as {row.effective:.1f} equal cells; next case of a new kind: {row.unseen:.2%}"
            )
            fullest = list(row.cells.items())[:5]
            lines.append("    " + ", ".join(f"{name} {n:,}" for name, n in fullest))
    return "\n".join(lines)
