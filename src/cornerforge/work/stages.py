"""Stages of a job: each finished one leaves a file, so a job that was killed goes on with the stages that are left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cornerforge._schema import read
from cornerforge.results import as_json
from cornerforge.work.files import read_json_file, write_json
from cornerforge.work.progress import NO_PROGRESS, Progress, begin_part

__all__ = ["Stage", "Stages"]

T = TypeVar("T")


@dataclass(frozen=True)
class Stage:
    """One stage of a job.

    Attributes:
        name: Name of the stage.
        kind: Type of its result.
        work: Function that does the work and returns the result.
        after: Names of the stages that must be done first.
        makes: Function, called after those: names the files that the stage makes in the output folder.
        is_kept: Function, called after those: whether the result gets a file; without one each run makes it anew.
        title: Name for people; "": the name.
    """

    name: str
    kind: type[Any]
    work: Callable[[], Any]
    after: tuple[str, ...] = ()
    makes: Callable[[], Sequence[str]] = tuple
    is_kept: Callable[[], bool] = lambda: True
    title: str = ""


class Stages:
    """Runner of stages: each runs once; `stages/NAME.json` holds its result and appears only when it is complete.

    Args:
        out: The output folder.
        progress: Told which stage begins, if `of` is given.
        of: Number of stages; None: not known.
    """

    def __init__(self, out: Path, progress: Progress = NO_PROGRESS, of: int | None = None) -> None:
        self._out, self._progress, self._of, self._begun = out, progress, of, 0

    def go(self, stages: Sequence[Stage], found: dict[str, Any]) -> None:
        """Do all stages; the next is always the first in the list whose `after` is done.

        Args:
            stages: The stages.
            found: Filled with the results, by name.
        """
        left = list(stages)
        while left:
            stage = next(one for one in left if found.keys() >= set(one.after))
            left.remove(stage)
            if stage.is_kept():
                found[stage.name] = self.do(stage.name, stage.kind, stage.work, stage.makes(), stage.title)
            else:
                self.begin(stage.title or stage.name)
                found[stage.name] = stage.work()

    def do(self, name: str, kind: type[T], work: Callable[[], T], makes: Sequence[str] = (), title: str = "") -> T:
        """Give the result of a stage, from its file if it is there; else do the work and leave the file.

        Args:
            name: Name of the stage.
            kind: Type of its result.
            work: Function that does the work.
            makes: Files that it makes in the output folder; while one is missing, the stage is not finished.
            title: Name for people; "": the name.

        Raises:
            FileFormatError: The file is damaged.
        """
        self.begin(title or name)
        path = self._out / "stages" / f"{name}.json"
        if not all(file.exists() for file in (path, *(self._out / made for made in makes))):
            write_json(path, as_json(work()))
        # A resumed run reads the result from the file, so this run goes on with the same values.
        return read(kind, read_json_file(path), f"{path} is damaged", "remove it, or choose another place.")

    def begin(self, title: str) -> None:
        """Tell the progress that the next stage begins, and its name for people; `do` and `go` call it for theirs."""
        self._begun += 1
        if self._of is not None:
            begin_part(self._progress, self._begun, self._of, title)
