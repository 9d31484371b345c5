"""Where the explorer's cases come from: libraries, and the analyses beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from cornerforge.analysis.stored import CASES_FILE, POINTS_FILE, WITNESSES_FILE, read_analysed
from cornerforge.errors import FileFormatError
from cornerforge.library import CaseLibrary
from cornerforge.results import Analysed
from cornerforge.results.stating import from_file

__all__ = ["FILES", "Analysis", "Source", "read_analysis", "read_ways_out"]

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


@dataclass(frozen=True)
class Analysis:
    """Files that `analyse` wrote about a library.

    Attributes:
        folder: Where it is.
        found: What its `analysis.json` says.
        cases: Its `cases.parquet`.
    """

    folder: Path
    found: Analysed
    cases: pa.Table


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
    return Analysis(folder, found, table)


def read_ways_out(folder: Path, library: Path) -> pa.Table:
    """Read the ways out of an analysis: `case_id`, when it begins, and the motion.

    Raises:
        FileFormatError: The file is missing or damaged.
    """
    return read_analysed(folder / WITNESSES_FILE, f"cornerforge analyse {library} --out {folder}", _WAYS_OUT)
