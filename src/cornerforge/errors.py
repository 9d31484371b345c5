"""The exceptions of cornerforge, one tree.

```
CornerForgeError                     all errors that the user can correct; the command line prints one line, status 2
├── InputError (ValueError)          an argument or option is outside what is allowed
├── UnknownNameError (InputError)    no such AV, ODD, format, command; carries the nearest known name
│   └── UnknownCaseError             no such case in a library
├── DataError (ValueError)           a trajectory file holds something that cannot be used
├── FileFormatError (ValueError)     a model, policy or library file is damaged, foreign, or of another schema
├── OutputError (OSError)            the output place cannot be written or holds something else
├── EngineError (RuntimeError)        a cluster is not there, broke down, or has other versions
├── MissingExtraError (ImportError)  an optional dependency is not installed
├── ReplayError (RuntimeError)       a stored case did not happen again
├── UndrawableError (RuntimeError)   the traffic at the start of a test cannot be drawn from the model
└── AvFaultError (RuntimeError)      an AV from outside raised, hung, ended, or gave no usable answer
```
"""

from __future__ import annotations

import difflib
import re
import shlex
import unicodedata
from collections.abc import Iterable, Sequence

__all__ = [
    "AvFaultError",
    "CornerForgeError",
    "DataError",
    "EngineError",
    "FileFormatError",
    "InputError",
    "MissingExtraError",
    "OutputError",
    "ReplayError",
    "UndrawableError",
    "UnknownCaseError",
    "UnknownNameError",
    "one_line",
    "printable",
]


_LONGEST = 2_000
"""Most characters of a message: names in it come from users and files, and can be of any length."""


def printable(text: str) -> str:
    r"""Write a text so that no terminal and no page obeys it: characters that people do not see become escapes.

    New lines, tabs and spaces of any width stay.

    >>> printable("a\x1b[2J b\u202ec\n")
    'a\\x1b[2J b\\u202ec\n'
    """
    return re.sub(r"[^ -~\n\t]", _seen, text)


def _seen(found: re.Match[str]) -> str:
    one = found[0]
    return one if one.isprintable() or unicodedata.category(one) == "Zs" else ascii(one)[1:-1]


def one_line(text: str) -> str:
    r"""Make one line that can be printed anywhere of a text that may hold anything, such as the name of a file.

    >>> one_line("no file a\x1b[2J: it ends here\nand here")
    'no file a\\x1b[2J: it ends here\\nand here'
    """
    line = "".join(one if one.isprintable() else ascii(one)[1:-1] for one in _cut(text))
    return _cut(line)  # again: a character that cannot be printed has become up to ten


def _cut(text: str) -> str:
    half = (_LONGEST - 5) // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"


class CornerForgeError(Exception):
    """Base of all errors that a user can cause and correct; its text is one line that can be printed anywhere."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class InputError(CornerForgeError, ValueError):
    """An argument or option lies outside what is allowed."""


class UnknownNameError(InputError):
    """A name is not known; the message suggests the nearest ones.

    Args:
        kind: What was asked for, such as "AV".
        name: The name that is not known.
        known: All known names.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        near = difflib.get_close_matches(str(name)[:200], names, n=1, cutoff=0.4)
        hint = f'Did you mean "{near[0]}"?' if near else f"Known: {', '.join(names)}."
        super().__init__(f'No {kind} "{name}". {hint}')


class UnknownCaseError(UnknownNameError):
    """A library does not hold a case; the message names the nearest ones and says how to list all.

    Args:
        name: The case id.
        near: Ids of a few cases, the nearest first.
        cases: Number of cases in the library.
        library: Its folder.
        is_near: Whether the first of `near` is probably what the user meant.
    """

    def __init__(self, name: str, near: Sequence[str], cases: int, library: str, *, is_near: bool) -> None:
        meant = f' Did you mean "{near[0]}"?' if is_near else ""
        others = f" and {cases - len(near):,} others" if cases > len(near) else ""
        listed = f'cornerforge query {shlex.quote(library)} "select case_id from cases"'
        InputError.__init__(
            self, f'No case "{name}".{meant} Known: {", ".join(near)}{others}; to list them: {listed}'
        )  # fmt: skip


class DataError(CornerForgeError, ValueError):
    """A trajectory file cannot be used as it is."""


class FileFormatError(CornerForgeError, ValueError):
    """A model, policy or library file is damaged, foreign, or of another schema."""


class OutputError(CornerForgeError, OSError):
    """The output place cannot be written, or holds something that is not ours."""


class EngineError(CornerForgeError, RuntimeError):
    """A cluster of machines is not there, broke down, or has other versions than this machine."""


class MissingExtraError(CornerForgeError, ImportError):
    """An optional dependency is missing.

    Args:
        package: The package that could not be imported.
        extra: The extra of cornerforge that installs it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f'This needs {package}; install it with: pip install "cornerforge[{extra}]"')


class ReplayError(CornerForgeError, RuntimeError):
    """A stored case, driven again from its seed, did not happen as stored."""


class UndrawableError(CornerForgeError, RuntimeError):
    """The traffic at the start of a test cannot be drawn from the naturalistic model: no result may rest on it."""


class AvFaultError(CornerForgeError, RuntimeError):
    """An AV from outside raised, hung, ended its process, or gave no usable answer."""
