"""Reading trajectory tables: CSV, plain or gzip, into columns of numbers; every row left out is counted and named."""

from __future__ import annotations

import gzip
import hashlib
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from numpy.typing import NDArray

from cornerforge.errors import DataError
from cornerforge.ext.calibrate.dialects import Dialect, dialect_of, number_form
from cornerforge.ext.calibrate.layouts import FCD_XML

__all__ = ["BadRows", "Table", "file_sha256", "read_header", "read_table"]

Floats = NDArray[np.float64]

_NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*$"
"""Form of a number; "nan" and "inf" are not numbers."""


@dataclass
class BadRows:
    """Rows of one file that were left out: reason -> (count, the file's line of the first; the header is line 1).

    A row that has several faults is counted once, under the first found.
    """

    reasons: dict[str, tuple[int, int]] = field(default_factory=dict)

    def add(self, reason: str, lines: Iterable[int]) -> None:
        """Count these lines of the file under `reason`."""
        numbers = [int(line) for line in lines]
        if numbers:
            count, first = self.reasons.get(reason, (0, numbers[0]))
            self.reasons[reason] = (count + len(numbers), min(first, *numbers))

    @property
    def total(self) -> int:
        """Rows left out."""
        return sum(count for count, _ in self.reasons.values())


@dataclass
class Table:
    """Columns of a file, by our names, all of the same length; `drop` takes rows out and names why.

    Attributes:
        name: File name, for messages.
        numbers: Columns of numbers; NaN where the file has none.
        texts: Columns of names, coded 0, 1, ... in order of the sorted names; -1 where empty.
        line: The row's line in the file, shape (n,).
        part: Number of the part of its track, rising along the rows, shape (n,); all 0 where tracks are whole.
        bad: The rows left out so far.
        rows_read: Rows in the file, the bad ones too.
        notes: How its numbers were read, where that is not plain.
    """

    name: str
    numbers: dict[str, Floats]
    texts: dict[str, NDArray[np.int64]]
    labels: dict[str, list[str]]
    line: NDArray[np.int64]
    part: NDArray[np.int64]
    bad: BadRows
    rows_read: int
    notes: list[str]

    def drop(self, reason: str, mask: NDArray[np.bool_]) -> None:
        """Take out the rows where `mask`, shape (n,), is true."""
        if mask.any():
            self.bad.add(reason, self.line[mask])
            self.take(np.flatnonzero(~mask))

    def take(self, order: NDArray[np.int64]) -> None:
        """Keep these rows, in this order."""
        self.numbers = {name: values[order] for name, values in self.numbers.items()}
        self.texts = {name: values[order] for name, values in self.texts.items()}
        self.line, self.part = self.line[order], self.part[order]


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, in hex digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _simple(name: str) -> str:
    """Unify a column name: names differ in case and hyphens between releases of the same data."""
    return name.strip().strip('"').lower().replace("-", "_").replace(" ", "_")


def _is_number(text: str) -> bool:
    return re.match(_NUMBER, text) is not None


def _opened(path: Path) -> pa.NativeFile:
    """Open the file's text, unpacked if gzip; by its absolute path, as Arrow reads a leading ~ as the home folder."""
    return pa.input_stream(str(path.absolute()), compression="detect")


def read_header(path: Path) -> list[str]:
    """Column names of a CSV file (gzip if its name ends so), in small letters, `-` and blanks as `_`.

    Raises:
        DataError: The file is missing, empty, or not readable.
    """
    return _header(path)[0]


def _header(path: Path) -> tuple[list[str], Dialect, int]:
    """Return column names, how the file is written, and the line in which the names stand."""
    if not path.is_file():
        is_folder = path.is_dir()
        raise DataError(f"{path} is a folder; name the files in it." if is_folder else f"No trajectory file {path}.")
    try:
        with _opened(path) as stream:
            head = stream.read(65536)
    except OSError as error:
        raise _unreadable(path, error) from error
    dialect, lines, before = dialect_of(head)
    line = lines[0].strip()
    if not line:
        raise DataError(f"Trajectory file {path} is empty.")
    if line.startswith("<"):
        is_fcd = b"fcd-export" in head.replace(b"\0", b"")
        raise DataError(
            FCD_XML.refusal(path) if is_fcd else f"Trajectory file {path} is XML; trajectories are read from tables."
        )
    if any(ord(sign) < 32 and sign != "\t" for sign in line):
        raise DataError(f"Trajectory file {path} is no text; unpack it, or save it as a table of text (CSV).")
    names, first = dialect.split(lines[0]), dialect.split(lines[1]) if len(lines) > 1 else []
    words = [word for name in names for word in name.replace(",", " ").split()]
    if words and all(_is_number(word) for word in words):
        raise DataError(
            f"Trajectory file {path} begins with numbers; line {before + 1} must name the columns, with commas between."
        )
    if len(names) == 1:
        raise DataError(
            f"Trajectory file {path} has one field in line {before + 1}; put commas, semicolons or tabs between fields."
        )
    if len(first) == len(names) + 1 and not first[-1].strip():
        names.append("")  # a delimiter ends each row, but not the header
    return [_simple(name) for name in names], dialect, before + 1


def _unreadable(path: Path, error: Exception) -> DataError:
    """Make the error for a file that could not be read to its end."""
    if path.suffix == ".gz":
        lines, cut = _whole_lines(path)
        if cut:
            return DataError(f"Trajectory file {path} is cut off after line {lines}; fetch it again.")
    return DataError(f"Trajectory file {path} cannot be read ({error}); is it damaged, or cut off?")


def _whole_lines(path: Path) -> tuple[int, bool]:
    """Whole lines of a gzip file before the place where it breaks, and whether it just ends there."""
    lines = 0
    try:
        with gzip.open(path, "rb") as file:
            while part := file.read(1 << 16):
                lines += part.count(b"\n")
    except EOFError:
        return lines, True
    except (OSError, zlib.error):
        return lines, False
    return lines, False


def read_table(path: Path, numbers: Mapping[str, tuple[str, float]], texts: Mapping[str, str]) -> Table:
    """Read named columns of a CSV file.

    Args:
        path: The file; gzip if its name ends in .gz.
        numbers: Our name -> (column in the file as `read_header` spells it, factor to SI units).
        texts: Our name -> column in the file.

    Returns:
        Rows in the order of the file; rows with a wrong number of fields are already left out and named.

    Raises:
        DataError: The file is empty, cut off or no CSV.
    """
    header, dialect, names_at = _header(path)
    wanted = [column for column, _ in numbers.values()] + list(texts.values())
    twice = sorted({column for column in wanted if header.count(column) > 1})
    if twice:
        raise DataError(f"Trajectory file {path} has two columns named {', '.join(twice)}; keep one of them.")
    broken: list[int] = []

    def note(row: pa.csv.InvalidRow) -> str:
        broken.append(int(row.number))
        return "skip"

    try:
        with _opened(path) as stream:
            content = pa.csv.read_csv(
                stream,
                read_options=pa.csv.ReadOptions(
                    column_names=header, skip_rows=names_at, use_threads=False, encoding=dialect.encoding
                ),
                parse_options=pa.csv.ParseOptions(
                    delimiter=dialect.delimiter, invalid_row_handler=note, ignore_empty_lines=False
                ),
                convert_options=pa.csv.ConvertOptions(
                    include_columns=wanted, column_types=dict.fromkeys(wanted, pa.string()), strings_can_be_null=False
                ),
            )
    except (pa.ArrowInvalid, OSError, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from error
    if content.num_rows == 0:
        fields = f" with the {len(header)} fields of its header (line {broken[0]} has others)" if broken else "s"
        raise DataError(f"Trajectory file {path} holds no row{fields}.")
    bad = BadRows()
    bad.add("wrong number of fields", broken)
    form = number_form([content[column] for column, _ in numbers.values()], dialect)
    coded = {name: _codes(content[column]) for name, column in texts.items()}
    return Table(
        name=path.name,
        numbers={name: _floats(form.plain(content[column])) * factor for name, (column, factor) in numbers.items()},
        texts={name: codes for name, (codes, _) in coded.items()},
        labels={name: labels for name, (_, labels) in coded.items()},
        line=_lines(names_at + 1, content.num_rows, broken),
        part=np.zeros(content.num_rows, dtype=np.int64),
        bad=bad,
        rows_read=content.num_rows + len(broken),
        notes=form.notes(path.name),
    )


def _lines(first: int, rows: int, broken: list[int]) -> NDArray[np.int64]:
    """Line numbers of the rows that were kept, where the lines `broken` were skipped."""
    every = np.arange(first, first + rows + len(broken), dtype=np.int64)
    return np.setdiff1d(every, np.array(broken, dtype=np.int64), assume_unique=True)[:rows]


def _floats(column: pa.ChunkedArray) -> Floats:
    """Turn text into numbers; NaN where it is no number."""
    fine = pc.match_substring_regex(column, _NUMBER)
    text = pc.if_else(fine, pc.utf8_trim_whitespace(column), pa.scalar(None, pa.string()))
    return np.asarray(pc.cast(text, pa.float64()).to_numpy(), dtype=np.float64)


def _codes(column: pa.ChunkedArray) -> tuple[NDArray[np.int64], list[str]]:
    """Turn text into numbers 0, 1, ... in the order of the sorted texts; -1 where empty.

    "12.0" counts as "12": tables that passed through floating point write vehicle numbers with ".0".
    """
    text = pc.replace_substring_regex(pc.utf8_trim_whitespace(column), r"^(\d+)\.0+$", r"\1")
    encoded = pc.dictionary_encode(text.combine_chunks())
    found = [str(text) for text in encoded.dictionary.to_pylist()]
    labels = sorted(text for text in found if text)
    rank = {text: number for number, text in enumerate(labels)}
    new = np.array([rank.get(text, -1) for text in found] or [-1], dtype=np.int64)
    return new[encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)], labels
