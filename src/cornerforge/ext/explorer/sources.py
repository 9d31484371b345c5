"""Where the explorer's cases come from: libraries, and the analyses beside them."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa

from cornerforge.analysis.avoidability import WayOut
from cornerforge.analysis.stored import CASES_FILE, POINTS_FILE, WITNESSES_FILE, read_analysed
from cornerforge.errors import FileFormatError
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.results import Analysed
from cornerforge.results.stating import from_file

__all__ = ["FILES", "Analysis", "Source", "read_analysis"]

FILES = ("analysis.json", CASES_FILE, POINTS_FILE, WITNESSES_FILE)
"""Files of a finished analysis."""
_WAYS_OUT = ("case_id", "latest_any_s", "witness_x_m", "witness_y_m", "witness_speed_mps", "witness_heading_rad")


@dataclass(frozen=True)
class Source:
    """One library.

    Attributes:
        name: "natural", "adversary" or "scripted"; begins the keys of its cases.
        label: For people.
        cases: The library, opened.
        natural: Its cases come from natural traffic.
        weights: Crashes per test that each case stands for, by its id; None: not natural.
        replay: Command that drives its cases again, without the case.
    """

    name: str
    label: str
    cases: CaseLibrary
    natural: bool
    weights: Mapping[str, float] | None
    replay: str
    _reading: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    def stored(self, case_id: str) -> StoredCase:
        """Read a case.

        Raises:
            FileFormatError: It lies in a damaged file.
        """
        with self._reading:
            return self.cases.scenario(case_id)


@dataclass(frozen=True)
class Analysis:
    """Files that `analyse` wrote about a library.

    Attributes:
        folder: Where it is.
        command: What writes it again.
        found: What its `analysis.json` says.
        cases: Its `cases.parquet`.
    """

    folder: Path
    command: str
    found: Analysed
    cases: pa.Table

    @cached_property
    def _ways_out(self) -> tuple[dict[str, int], pa.Table]:
        table = read_analysed(self.folder / WITNESSES_FILE, self.command, _WAYS_OUT)
        return {name: row for row, name in enumerate(table["case_id"].to_pylist())}, table

    def way_out(self, case_id: str) -> WayOut | None:
        """Give the AV's way out of a case; None if none is known. The file is read when one is first asked for.

        Raises:
            FileFormatError: The file of ways out is missing or damaged.
        """
        rows, motions = self._ways_out
        if (row := rows.get(case_id)) is None:
            return None
        _, begin_s, *motion = (motions[name][row].as_py() for name in motions.column_names)
        if begin_s is None or not motion[0]:
            return None
        return WayOut(begin_s, *(np.array(values, np.float64) for values in motion))


def read_analysis(folder: Path, library: Path) -> Analysis:
    """Read the analysis of a library.

    Raises:
        FileFormatError: A file is missing or damaged; the message names it and what writes it again.
    """
    command = f"cornerforge analyse {library} --out {folder}"
    found = from_file(Analysed, folder / "analysis.json", command)
    table = read_analysed(folder / CASES_FILE, command)
    missing = {"case_id", "pc1", "pc2", "cluster"} - set(table.column_names)
    if missing:
        raise FileFormatError(
            f"{folder / CASES_FILE} lacks the column {sorted(missing)[0]}; write it again with: {command}"
        )
    return Analysis(folder, command, found, table)
