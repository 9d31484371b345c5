"""Reading PDF files that matplotlib made, without another program."""

from __future__ import annotations

import re
import zlib
from typing import NamedTuple

__all__ = ["Pdf", "read_pdf"]


class Pdf(NamedTuple):
    """What matters of a page: size [in], kinds of fonts, embedded fonts, sizes of text [pt], date or program."""

    size: tuple[float, float]
    fonts: set[str]
    embedded: int
    points: set[float]
    says_when: bool


def read_pdf(content: bytes) -> Pdf:
    """Read the first page."""
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", content)
    assert content.startswith(b"%PDF")
    assert box is not None
    drawn = b""
    for stream in re.findall(rb"(?<!end)stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL):
        try:
            drawn += zlib.decompress(stream)
        except zlib.error:
            continue
    return Pdf(
        (float(box[1]) / 72.0, float(box[2]) / 72.0),
        {kind.decode() for kind in re.findall(rb"/Subtype /(Type\d|TrueType|CIDFontType\d)", content)},
        len(re.findall(rb"/FontFile2", content)),
        {float(size) for size in re.findall(rb"/F\d+ ([\d.]+) Tf", drawn)},
        any(word in content for word in (b"/CreationDate", b"/Producer", b"/Creator")),
    )
