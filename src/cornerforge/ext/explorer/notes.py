"""Labels and notes on cases, in a file beside the library that people can read, copy and put under version control."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cornerforge._files import read_bytes, real_path, reason, writing
from cornerforge.errors import FileFormatError, InputError, OutputError

__all__ = ["keep_note", "notes_file", "read_notes"]

_FORMAT, _VERSION = "cornerforge notes", 1
_LONGEST_LABEL, _LONGEST_NOTE, _MOST_LABELS = 40, 10_000, 50


def notes_file(library: Path) -> Path:
    """Name the file of a library's notes: LIB-notes.json."""
    library = real_path(library)  # . and .. have no name
    return library.parent / f"{library.name}-notes.json"


def read_notes(file: Path) -> dict[str, dict[str, Any]]:
    """Read the notes: of each case id "labels" and "note"; none where there is no file.

    Raises:
        FileFormatError: The file is damaged, or of a later version.
    """
    try:
        content = json.loads(read_bytes(file).decode())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise FileFormatError(f"{file} is damaged ({error}); it is left as it is: mend it, or move it away.") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT or content.get("version") != _VERSION:
        raise FileFormatError(
            f"{file} holds no notes of version {_VERSION}; it is left as it is: move it away, or upgrade cornerforge."
        )
    notes: Any = content.get("notes")
    try:
        return {case: dict(zip(("labels", "note"), _checked(**one), strict=True)) for case, one in notes.items()}
    except (AttributeError, TypeError, InputError) as error:
        raise FileFormatError(f"{file} is damaged ({error}); it is left as it is: mend it, or move it away.") from None


def keep_note(file: Path, case_id: str, labels: Any, note: Any) -> dict[str, Any]:
    """Keep labels and a note of a case, and all others as they are in the file by now; both empty: keep none.

    Returns:
        What is kept of the case.

    Raises:
        InputError: They are no texts, or too long.
        FileFormatError: The file is damaged; it is not touched.
        OutputError: It cannot be written.
    """
    kept = dict(zip(("labels", "note"), _checked(labels, note), strict=True))
    with _alone(file.parent):
        notes = read_notes(file)
        notes.pop(case_id, None)
        if kept["labels"] or kept["note"]:
            notes[case_id] = kept
        content = {"format": _FORMAT, "version": _VERSION, "notes": notes}
        with writing(file, "the notes") as part:
            part.write_text(json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")
    return kept


def _checked(labels: Any, note: Any) -> tuple[list[str], str]:
    """Return labels and note as they are stored.

    Raises:
        InputError: They are no texts, or too long.
    """
    if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
        raise InputError("Labels are a list of texts.")
    if not isinstance(note, str) or len(note) > _LONGEST_NOTE:
        raise InputError(f"A note is a text of at most {_LONGEST_NOTE:,} characters.")
    named = list(dict.fromkeys(label.strip() for label in labels))
    if len(named) > _MOST_LABELS or not all(0 < len(label) <= _LONGEST_LABEL for label in named):
        raise InputError(f"A case has at most {_MOST_LABELS} labels, each of 1 to {_LONGEST_LABEL} characters.")
    try:
        "".join([*named, note]).encode("utf-8")
    except UnicodeEncodeError:
        raise InputError("A label or note holds half a character (a lone surrogate); write it again.") from None
    return named, note


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process writes notes in a folder; where the system cannot lock a folder, do not wait."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    try:
        held = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise OutputError(f"Cannot write notes into {folder}: {reason(error)}.") from error
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)
