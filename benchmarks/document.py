"""Blocks of a document that programs write: the lines between two marks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cornerforge.experiment.output import write_text

__all__ = ["MarkedBlock"]


@dataclass(frozen=True)
class MarkedBlock:
    """What one program writes.

    Attributes:
        writer: The program, as a path from the repository's root.
    """

    writer: str

    @property
    def begin(self) -> str:
        """The mark before it."""
        return f"<!-- begin: {self.writer} writes this -->"

    @property
    def end(self) -> str:
        """The mark after it."""
        return f"<!-- end: {self.writer} -->"

    def missing_in(self, path: Path) -> str | None:
        """What is wrong if the document does not have both marks, in this order; None if it has."""
        text = path.read_text("utf-8") if path.is_file() else ""
        if 0 <= text.find(self.begin) < text.find(self.end):
            return None
        return f"{path} has no lines {self.begin} and {self.end}; put them where the numbers shall stand."

    def replace_in(self, document: str, content: str) -> str:
        """The document with the text between the marks replaced."""
        before, rest = document.split(self.begin, 1)
        _, after = rest.split(self.end, 1)
        return f"{before}{self.begin}\n{content.strip()}\n{self.end}{after}"

    def publish(self, content: str, path: Path | None) -> None:
        """Print the text, and write it between the marks of a document if one is named."""
        print(content)
        if path is not None:
            write_text(path, self.replace_in(path.read_text("utf-8"), content))
