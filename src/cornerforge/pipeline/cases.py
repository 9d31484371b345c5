"""`analyse`, `replay` and `query`: what is done with a library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._checks import check_integer
from cornerforge.adversary.policy_file import load_policy
from cornerforge.errors import FileFormatError, InputError
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.pipeline.generate import MODEL_FILE, POLICY_FILE
from cornerforge.pipeline.output import code_hash, provenance, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, experiment
from cornerforge.sim.recorder import Recorder, scenario_digest
from cornerforge.types import Scenario

__all__ = ["analyse", "query", "replay"]

_TRACKS = ("x", "y", "speed", "heading", "acceleration")


def analyse(
    library: Path | str,
    *,
    steps: int = 1,
    out: Path | str | None = None,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """Features, PCA, DBSCAN, K-means, crash types, typical and rare cases of a library (paper, "Corner case analysis").

    Args:
        library: The library's folder.
        steps: Seconds before the crash that the features cover, 1 to 15.
        out: Folder for `analysis.json` and `points.parquet`; None for none.
        seed: Of K-means' starts.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge analyse --json` prints.

    Raises:
        CornerForgeError: The library cannot be read or is empty, or an argument is out of range.
    """
    from cornerforge.analysis import analyse as analyse_history

    check_integer("steps", steps, low=1, high=15)
    cases = CaseLibrary.open(Path(library))
    if len(cases) == 0:
        raise InputError(
            f"The library {library} holds no cases yet; fill it with: cornerforge generate --out {library} --resume"
        )
    progress("analyse", 0, 1)
    ids, history = cases.history()
    result = analyse_history(
        ids,
        history,
        steps=steps,
        seed=seed,
        vehicle_length=cases.odd.vehicle_length,
        vehicle_width=cases.odd.vehicle_width,
    )
    progress("analyse", 1, 1)
    summary = result.to_json()
    if out is not None:
        _write_analysis(Path(out), summary, result.points, cases)
    return summary


def _write_analysis(out: Path, summary: dict[str, Any], points: dict[str, Any], cases: CaseLibrary) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    write_json(out / "analysis.json", summary)
    part = out / ".points.parquet.part"
    pq.write_table(pa.table({name: pa.array(values) for name, values in points.items()}), part)
    part.replace(out / "points.parquet")
    write_json(out / "provenance.json", provenance(cases.identity))


def _experiment_of(cases: CaseLibrary) -> Experiment:
    """The experiment that made a library, from its identity and the files beside it.

    Raises:
        FileFormatError: A file is missing or is not the one of the library.
    """
    identity = cases.identity
    has_policy = identity["policy_hash"] is not None
    run = experiment(
        av=str(identity["av"]),
        odd=str(identity["odd"]),
        lanes=int(str(identity["lanes"])),
        model=cases.path / MODEL_FILE,
        bv=str(identity["bv"]),
        policy=load_policy(cases.path / POLICY_FILE) if has_policy else None,
        bounded=bool(identity["bounded"]),
    )
    for key, value in run.identity(int(str(identity["seed"]))).items():
        if identity[key] != value:
            raise FileFormatError(
                f"The library {cases.path} was made with {key} = {identity[key]!r}, but what is here gives {value!r}; "
                "put the original file back, or install the version that made it."
            )
    return run


def _same(driven: Scenario, stored: StoredCase) -> bool:
    """Is the driven test the stored one: all numbers at full precision by digest, the stored ones by value?"""
    if scenario_digest(driven) != stored.scalars["trajectory_digest"]:
        return False
    columns = np.searchsorted(driven.slot, stored.scenario.slot)
    return all(
        np.array_equal(
            getattr(driven, name)[:, columns].astype(np.float32),
            getattr(stored.scenario, name).astype(np.float32),
            equal_nan=True,
        )
        for name in _TRACKS
    )


def replay(library: Path | str, case: str, *, check: bool = False, progress: Progress = NO_PROGRESS) -> dict[str, Any]:
    """Drive a case again from its seed.

    Args:
        library: The library's folder.
        case: Case id, or "all".
        check: Also compare with what is stored.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge replay --json` prints; `identical` is None unless checked. For "all" also `cases`
        and the ids that `differ`.

    Raises:
        CornerForgeError: No such case, or the library, its policy or model cannot be read.
    """
    cases = CaseLibrary.open(Path(library))
    run = _experiment_of(cases)
    recorder = Recorder(run.setting, run.odd)
    ids = cases.scalars(["case_id"])["case_id"].to_pylist() if case == "all" else [case]
    differ: list[str] = []
    crash_time = None
    for done, case_id in enumerate(ids):
        stored = cases.scenario(case_id)
        driven = recorder.record(stored.scenario.seed, stored.scenario.test)
        crash_time = None if driven.crash is None else driven.crash.time
        if check and not _same(driven, stored):
            differ.append(case_id)
        progress("replay", done + 1, len(ids))
    summary: dict[str, Any] = {
        "case": case,
        "crash_time_s": crash_time if case != "all" else None,
        "identical": not differ if check else None,
    }
    if case == "all":
        summary |= {"cases": len(ids), "differ": differ}
    if differ and cases.identity.get("code") != code_hash():
        summary["note"] = "The library was made by other code; install the version that made it to see the same."
    return summary


def query(library: Path | str, sql: str) -> dict[str, Any]:
    """SQL over a library (table `cases`, key `case_id`), read only.

    Raises:
        CornerForgeError: The library cannot be read, or the SQL is wrong.
    """
    columns, rows = CaseLibrary.open(Path(library)).query(sql)
    return {"columns": columns, "rows": [list(row) for row in rows]}
