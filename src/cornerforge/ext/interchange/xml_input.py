"""XML files from anywhere, read safely: elements that know their line, and no way to reach beyond the file.

Nothing is fetched and nothing is expanded: a file that declares a document type, an entity or another file is refused,
because these declarations can expand without limit or read other files. Size, depth and number of elements are limited.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from cornerforge._files import reason
from cornerforge.errors import DataError, FileFormatError, InputError

__all__ = ["Element", "read_xml"]

_MOST_BYTES = 64 * 2**20
_MOST_ELEMENTS = 1_000_000
_DEEPEST = 64
"""Elements in elements: real files have some 20 levels."""
_PIECE = 2**18
_SHOWN = 40
"""Longest value that is repeated in a message [characters]."""


@dataclass(slots=True, eq=False)
class Element:
    """An element of an XML file.

    Attributes:
        tag: Its name, without a namespace's prefix.
        attributes: By name, without prefixes.
        line: Line in its file, the first is 1.
        file: Name of its file, without folders.
        children: In the order of the file.
        text: What stands in it before, between and after its children, without white space around.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    file: str
    children: list[Element] = field(default_factory=list)
    text: str = ""

    @property
    def place(self) -> str:
        """Where it stands, for messages."""
        return f"{self.file}, line {self.line}"

    def child(self, *path: str) -> Element | None:
        """Find the first child of a name, and the first child of a name in that, and so on; None: there is none."""
        found = self
        for tag in path:
            for child in found.children:
                if child.tag == tag:
                    found = child
                    break
            else:
                return None
        return found

    def need(self, *path: str) -> Element:
        """Find what `child` finds.

        Raises:
            DataError: There is none.
        """
        found = self.child(*path)
        if found is None:
            self.fault(f"{self.tag} lacks {'/'.join(path)}")
        return found

    def all(self, *tags: str) -> Iterator[Element]:
        """Go through the children of these names, in the order of the file."""
        return (child for child in self.children if child.tag in tags)

    def string(self, name: str, default: str | None = None) -> str:
        """Give an attribute.

        Raises:
            DataError: It is not there, and there is no default.
        """
        value = self.attributes.get(name, default)
        if value is None:
            self.fault(f"{self.tag} lacks {name}")
        return value

    def number(
        self, name: str | None, default: float | None = None, *, low: float = -1e9, high: float = 1e9, unit: str = ""
    ) -> float:
        """Give an attribute, or the text if `name` is None, as a finite number in [low, high].

        Raises:
            DataError: It is not there and there is no default, it is no number, or lies outside.
        """
        given = self.text or None if name is None else self.attributes.get(name)
        if given is None and default is not None:
            return default
        what = self.tag if name is None else f"{name} of {self.tag}"
        if given is None:
            self.fault(f"{what} is missing")
        try:
            value = float(given)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            shown = given if len(given) <= _SHOWN else f"{given[:_SHOWN]}..."
            tail = f" {unit}" if unit else ""
            self.fault(f'{what} is "{shown}"; allowed: {low:.10g} to {high:.10g}{tail}')
        return value

    def integer(self, name: str | None, default: int | None = None, *, low: int, high: int) -> int:
        """Give an attribute, or the text if `name` is None, as a whole number in [low, high].

        Raises:
            DataError: It is not there and there is no default, it is no whole number, or lies outside.
        """
        value = self.number(name, default, low=low, high=high)
        if value != int(value):
            self.fault(f"{self.tag if name is None else f'{name} of {self.tag}'} is {value:g}, no whole number")
        return int(value)

    def fault(self, what: str) -> NoReturn:
        """Raise a DataError that says what is wrong with this element, and where it stands."""
        raise DataError(f"{self.place}: {what}.")


def read_xml(path: Path, *, root: str, what: str) -> Element:
    """Read an XML file, packed if its name ends in .gz.

    Args:
        path: The file.
        root: Name that its outermost element must have.
        what: What it should be, for messages, for example "an OpenSCENARIO file".

    Raises:
        InputError: The file is missing, or it cannot be read.
        FileFormatError: It is no whole XML file, has another root, declares a document type or entities, or is too
            large, too deep, or has too many elements.
    """
    reader = _Reader(path.name, root, what)
    try:
        if not path.is_file():
            raise InputError(f"No file {path}.")
        size = path.stat().st_size
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            while size <= _MOST_BYTES and (piece := file.read(_PIECE)):
                reader.take(piece)
                size = max(size, file.tell())
        if size > _MOST_BYTES:
            raise FileFormatError(
                f"{path.name} has {size / 2**20:.0f} MB; up to {_MOST_BYTES / 2**20:.0f} MB are read. Cut it in parts."
            )
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FileFormatError(f"{path.name} is no whole gzip file ({error}); fetch it again.") from error
    except OSError as error:
        raise InputError(f"Cannot read {path}: {reason(error)}.") from error
    except ValueError as error:  # a name with a NUL, for one
        if isinstance(error, (InputError, FileFormatError)):
            raise
        raise InputError(f"Cannot read {str(path)!r}: {error}.") from error
    return reader.end()


class _Reader:
    """Builds elements from what the parser meets."""

    def __init__(self, name: str, root: str, what: str) -> None:
        self.name, self.root, self.what = name, root, what
        self.open: list[Element] = []
        self.texts: list[list[str]] = []
        self.top: Element | None = None
        self.elements = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._declared
        self.parser.EntityDeclHandler = self._declared
        self.parser.UnparsedEntityDeclHandler = self._declared
        self.parser.ExternalEntityRefHandler = self._declared

    def take(self, piece: bytes, *, last: bool = False) -> None:
        """Read on."""
        try:
            self.parser.Parse(piece, last)
        except expat.ExpatError as error:
            unfinished = last and (self.open or self.top is None)
            hint = "is it cut off? Fetch it again" if unfinished else "mend it, or fetch it again"
            fault = f"this is no whole XML file ({expat.ErrorString(error.code)}); {hint}"
            raise FileFormatError(f"{self.name}, line {error.lineno}: {fault}.") from None
        except (LookupError, UnicodeError) as error:
            self._fault(f"the file's encoding cannot be read ({error}); save it as UTF-8")
        except ValueError as error:
            if isinstance(error, FileFormatError):
                raise
            self._fault(f"the file's encoding cannot be read ({error}); save it as UTF-8")

    def end(self) -> Element:
        """Give the outermost element of the whole file."""
        self.take(b"", last=True)
        assert self.top is not None  # the parser takes no file without an element
        return self.top

    def _fault(self, what: str) -> NoReturn:
        raise FileFormatError(f"{self.name}, line {self.parser.CurrentLineNumber}: {what}.") from None

    def _declared(self, *_: object) -> NoReturn:
        self._fault("it declares a document type or entities, which are not read, for safety; take that out")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        tag = tag.rpartition(":")[2]
        self.elements += 1
        if not self.open and tag != self.root:
            self._fault(f"this is not {self.what}: it begins with <{tag[:_SHOWN]}>, not with <{self.root}>")
        if len(self.open) >= _DEEPEST:
            self._fault(f"elements stand in one another more than {_DEEPEST} deep; no such file is read")
        if self.elements > _MOST_ELEMENTS:
            self._fault(f"there are more than {_MOST_ELEMENTS:,} elements; cut the file into parts")
        plain = {name.rpartition(":")[2]: value for name, value in attributes.items()}
        element = Element(tag, plain, self.parser.CurrentLineNumber, self.name)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.top = element
        self.open.append(element)
        self.texts.append([])

    def _end(self, _: str) -> None:
        self.open.pop().text = "".join(self.texts.pop()).strip()

    def _text(self, text: str) -> None:
        if self.texts:
            self.texts[-1].append(text)
