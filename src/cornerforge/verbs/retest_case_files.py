"""Case files as `retest` takes them: which there are, what they say of the old AV, and the pairs of its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cornerforge.errors import AvFaultError, CornerForgeError, InputError
from cornerforge.experiment.output import IDENTITY
from cornerforge.foreign.spec import AvSpec, with_av
from cornerforge.library.case_file import CaseFile, is_case_file, read_case_file
from cornerforge.library.manifest import MANIFEST
from cornerforge.report.comparison import AS_RECORDED, Pair
from cornerforge.types import Scenario
from cornerforge.verbs.drive_case import CaseDriver, striker_of_file, strikes
from cornerforge.world_options import WorldOptions

__all__ = ["FILES_RULE", "file_says", "holds_case_files", "pairs_of_files", "read_case_files"]

_MOST = {"new": 16, "still crashing": 8, "fixed": 6}
FILES_RULE = (
    "At most 30 cases: of the new crashes the first 16, of those that still crash 8, of the fixed ones 6, in the order "
    "of the files' names. A fixed case is there only if the old AV is at hand: as the baseline, or built in."
)


def holds_case_files(place: Path) -> bool:
    """Is this a case file, or a folder of case files, and not a library?"""
    if place.suffix == ".json" and not place.is_dir():
        return True
    return place.is_dir() and not (place / MANIFEST).exists() and any(map(is_case_file, _json_in(place)))


def _json_in(folder: Path) -> list[Path]:
    """The .json files of a folder but for what verbs say of a folder, by name."""
    return sorted(path for path in folder.glob("*.json") if path.name != IDENTITY)


def read_case_files(place: Path) -> tuple[dict[str, CaseFile], str | None]:
    """Read a case file, or those of a folder.

    Returns:
        The cases by the files' names without the ending, in this order; and which other .json files were left out, as
        a sentence; None: none.

    Raises:
        FileFormatError: Something in a case file is wrong, or a file that was named is none.
    """
    if not place.is_dir():
        return {place.stem: read_case_file(place)}, None
    found = {path: is_case_file(path) for path in _json_in(place)}
    others = [path.name for path, is_one in found.items() if not is_one]
    several = f"{', '.join(others[:10])}{', ...' if len(others) > 10 else ''} {'are' if len(others) > 1 else 'is'}"
    note = f"Left out: {several} no case file{'s' if len(others) > 1 else ''}." if others else None
    return {path.stem: read_case_file(path) for path, is_one in found.items() if is_one}, note


def file_says(name: str, case: CaseFile, count: str) -> bool:
    """Did the old AV crash, as the file says, in a crash that counts?

    Raises:
        InputError: The file does not say it.
    """
    if case.happened is None:
        raise InputError(
            f"Case file {name} does not say what became of the case, so there is nothing to compare with; name an AV "
            f"with --baseline{', such as recorded: what was in its seat' if case.av_is_recorded else ''}."
        )
    return case.happened.crashed if count == "any" else strikes(striker_of_file(case), count)


def pairs_of_files(
    files: Mapping[str, CaseFile], kinds: Mapping[str, str], new: CaseDriver, old: CaseDriver | None,
    options: WorldOptions, models: Sequence[Path],
) -> list[Pair]:  # fmt: skip
    """Choose cases as FILES_RULE says, and record both versions in them. A drive in which an AV fails is left out."""
    pairs = []
    for kind, most in _MOST.items():
        for name in [one for one, its in kinds.items() if its == kind][:most]:
            before = _before(files[name], old, options, models)
            if before is None and kind == "fixed":
                continue
            try:
                pairs.append(Pair(name, kind, AS_RECORDED, before, new.record(files[name])))
            except AvFaultError:
                continue
    return pairs


def _before(case: CaseFile, old: CaseDriver | None, options: WorldOptions, models: Sequence[Path]) -> Scenario | None:
    """Recording of the old AV; None where it is not at hand."""
    try:
        if old is not None:
            return old.record(case)
        if case.av is None or AvSpec(case.av).is_outside:
            return None
        with CaseDriver(with_av(options, case.av), models) as maker:
            return maker.record(case)
    except CornerForgeError:
        return None
