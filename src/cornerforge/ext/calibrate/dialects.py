"""How the text of a table is written: its encoding, what stands between fields, and the form of its numbers."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

__all__ = ["Dialect", "NumberForm", "dialect_of", "number_form"]

_MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_GROUPED = r"^\s*[+-]?[1-9]\d{{0,2}}({0}\d{{3}})+({1}\d*)?\s*$"
"""Form of a number with separators of thousands and of decimals."""
_PLAINLY_GROUPED = r"^\s*[+-]?[1-9]\d{{0,2}}(({0}\d{{3}})+{1}\d*|({0}\d{{3}}){{2,}})\s*$"
"""A grouped number that cannot be one with decimals only."""


@dataclass(frozen=True)
class Dialect:
    """How a table is written.

    Attributes:
        encoding: Python's name. Text without a sign of UTF-16 is Latin-1, which takes any byte: a damaged one spoils
            its row, not the file.
        delimiter: What stands between two fields: a comma, a semicolon or a tab.
    """

    encoding: str
    delimiter: str

    def split(self, line: str) -> list[str]:
        """Return the fields of a line; quotes are taken off."""
        return next(csv.reader([line], delimiter=self.delimiter), [])


def dialect_of(head: bytes) -> tuple[Dialect, list[str], int]:
    r"""Tell from the first bytes of a file how it is written; returns that, the lines, and how many come before these.

    Those before the header are empty, a comment (#), or a spreadsheet's word on the delimiter (sep=).

    >>> dialect_of("sep=;\r\nt_s;v_mps\r\n0;1,5".encode("utf-16"))
    (Dialect(encoding='utf-16-le', delimiter=';'), ['t_s;v_mps', '0;1,5'], 1)
    """
    mark, encoding = next(((mark, name) for mark, name in _MARKS if head.startswith(mark)), (b"", ""))
    start = head[len(mark) : len(mark) + 64]
    if not encoding.startswith("utf-16"):
        encoding = "latin1"
        if b"\0" in start:  # of letters, one byte in two is zero
            encoding = "utf-16-le" if start[1::2].count(0) >= start[::2].count(0) else "utf-16-be"
    text = head[len(mark) :].decode("utf-8" if encoding == "latin1" else encoding, errors="replace")
    lines = re.split(r"\r\n|\r|\n", text)
    begin = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith(("#", "sep="))), 0)
    return Dialect(encoding, max(",;\t", key=lines[begin].count)), lines[begin:], begin


@dataclass(frozen=True)
class NumberForm:
    """Separators of thousands ("": none) and of decimals, and a number with them for messages."""

    thousands: str
    decimal: str
    example: str

    def plain(self, column: pa.ChunkedArray) -> pa.ChunkedArray:
        """Write numbers with a decimal point and no other separator; what has another form is left as it is."""
        if self.thousands:
            grouped = pc.match_substring_regex(column, _form(_GROUPED, self.thousands, self.decimal))
            column = pc.if_else(grouped, pc.replace_substring(column, self.thousands, ""), column)
        return pc.replace_substring(column, ",", ".") if self.decimal == "," else column

    def notes(self, file: str) -> list[str]:
        """Say how commas were read; nothing where there is none."""
        if not self.example:
            return []
        meaning = "decimals" if self.decimal == "," else "thousands"
        return [f"{file}: commas in numbers, as in {self.example}, were read as separators of {meaning}."]


def number_form(columns: Sequence[pa.ChunkedArray], dialect: Dialect) -> NumberForm:
    """Tell what commas in the numbers of a file mean, for all its columns together.

    Numbers such as 1,234.5 and 1,234,567 say it. Where all are like 1,234, commas are of thousands in a file with
    commas between fields, else of decimals.
    """
    commas = [column.filter(pc.match_substring(column, ",")) for column in columns]
    text = pa.chunked_array([chunk for column in commas for chunk in column.chunks], pa.string())
    if not len(text):
        return NumberForm("", ".", "")

    def has(form: str, but: str = "^$") -> bool:
        found = pc.and_not(pc.match_substring_regex(text, form), pc.match_substring_regex(text, but))
        return bool(pc.any(found).as_py())

    is_grouped = has(_form(_PLAINLY_GROUPED, ",", ".")) or (
        dialect.delimiter == "," and not has(r"^\s*[+-]?\d*,\d+\s*$", _form(_GROUPED, ",", "."))
    )
    example = str(text[0].as_py()).strip()
    if is_grouped:
        return NumberForm(",", ".", example)
    return NumberForm("." if has(_form(_PLAINLY_GROUPED, ".", ",")) else "", ",", example)


def _form(pattern: str, thousands: str, decimal: str) -> str:
    return pattern.format(*(rf"\{one}" if one == "." else one for one in (thousands, decimal)))
