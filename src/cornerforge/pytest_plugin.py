"""Plugin of pytest: a marker that runs a test of one's own AV in case files.

```python
@pytest.mark.cornerforge("cases/*.json", av="my_av.py:MyAv")
def test_my_av(case):
    case.check()
```

The test runs once for each file, which `case` stands for. Importing this module loads nothing of cornerforge: tests of
others, in the same environment, do not get slower.
"""

from __future__ import annotations

import contextlib
import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pytest

    from cornerforge.library.case_file import CaseFile
    from cornerforge.verbs.drive_case import CaseDriver, DrivenCase

__all__ = ["MarkedCase", "pytest_configure", "pytest_generate_tests", "pytest_unconfigure"]

MARKER = "cornerforge"
_ABOUT = (
    f"{MARKER}(files, ..., av): run the test once for each case file that a pattern such as cases/*.json finds, "
    "relative to the test's folder; the argument `case` drives it"
)
_DRIVERS: dict[tuple[Any, ...], CaseDriver] = {}
"""One for each AV and how it is asked: its process is started once."""
_MOST_DRIVERS = 4


@dataclass(frozen=True)
class MarkedCase:
    """A case file in a test.

    Attributes:
        path: The file.
        av: The AV of the marker; None: no AV was named.
        folder: Folder of the test: where a module of an AV is looked for first.
        asked: How an AV from outside is asked.
    """

    path: Path
    av: str | None
    folder: Path
    asked: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the file, without its ending."""
        return self.path.stem

    def read(self) -> CaseFile:
        """Read the file; the test fails if it is no case file, or something in it is wrong."""
        from cornerforge.library.case_file import read_case_file

        with _failing():
            return read_case_file(self.path)

    def drive(self, av: str | None = None) -> DrivenCase:
        """Drive the case; the test fails if the file is wrong, the AV is unknown, or it gives no usable answer.

        Args:
            av: Another AV than the marker's; "recorded": the vehicle that was recorded in the AV's place.
        """
        return self._drive(av or self.av, "any")

    def _drive(self, av: str | None, count: str) -> DrivenCase:
        from dataclasses import replace

        from cornerforge.errors import InputError
        from cornerforge.foreign.loaders import from_folder, looking_in
        from cornerforge.verbs.drive_case import check_count, driven_with

        with _failing(), looking_in(self.folder):
            check_count(count)
            if av is None:
                raise InputError(f'Name the AV: @pytest.mark.{MARKER}("cases/*.json", av="my_av.py:MyAv").')
            spec = from_folder(av, self.folder)
            driver = _driver_of(spec, self.folder, self.path.parent, self.asked)
            shown = spec if spec == av else from_folder(av, _below_here(self.folder))
            return replace(driven_with(driver, self.read(), shown), seen=self._command(shown, spec == av))

    def check(self, av: str | None = None, *, count: str = "any") -> DrivenCase:
        """Drive the case, and let the test fail if the AV crashes.

        Args:
            av: As for `drive`.
            count: Which crashes count: "any", or "av": those in which the AV strikes, alone or as the other does.
        """
        import pytest

        driven = self._drive(av or self.av, count)
        if driven.counts(count):
            said = self.read()
            before = "" if said.happened is None else f"\nAs the file says, {said.av or 'the AV'} {_said(said)}."
            pytest.fail(
                f"Case {_short(self.path)}, AV {driven.av}: {driven.words}.{before}\nTo see it: {driven.seen}",
                pytrace=False,
            )
        return driven

    def _command(self, spec: str, is_module: bool) -> str:
        is_far = is_module and ":" in spec and self.folder != Path.cwd()
        found = f"PYTHONPATH={shlex.quote(_short(self.folder))} " if is_far else ""
        return f"{found}cornerforge retest {shlex.quote(_short(self.path))} --av {shlex.quote(spec)} --page seen.html"


def _said(case: CaseFile) -> str:
    frame = None if case.happened is None else case.happened.frame
    return "did not crash" if frame is None else f"crashed after {frame / 10:.1f} s"


def _below_here(path: Path) -> Path:
    """The path from here, if it is below."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def _short(path: Path) -> str:
    return str(_below_here(path))


@contextlib.contextmanager
def _failing() -> Iterator[None]:
    """Let the test fail in a line or a few where what the user gave is wrong, or the AV fails."""
    import pytest

    from cornerforge.errors import CornerForgeError

    try:
        yield
    except CornerForgeError as error:
        said = str(error)
    else:
        return
    pytest.fail(said, pytrace=False)


def _driver_of(spec: str, place: Path, models: Path, asked: dict[str, Any]) -> CaseDriver:
    from cornerforge.verbs.drive_case import CaseDriver
    from cornerforge.world_options import WorldOptions

    key = (spec, place, models, *sorted(asked.items()))
    if key not in _DRIVERS:
        while len(_DRIVERS) >= _MOST_DRIVERS:
            _DRIVERS.pop(next(iter(_DRIVERS))).close()
        _DRIVERS[key] = CaseDriver(WorldOptions(av=spec, **asked), [models])
    return _DRIVERS[key]


# Hooks


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line("markers", _ABOUT)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a marked test once for each case file."""
    marker = metafunc.definition.get_closest_marker(MARKER)
    if marker is None:
        return
    import pytest

    from cornerforge.world_options import AvAloneOptions

    where = f"@pytest.mark.{MARKER} of {metafunc.definition.nodeid}"
    known = sorted(AvAloneOptions.__dataclass_fields__)
    unknown = [name for name in marker.kwargs if name not in known]
    if unknown:
        pytest.fail(f"{where}: {unknown[0]} is not known; known: {', '.join(known)}.", pytrace=False)
    if "case" not in metafunc.fixturenames:
        pytest.fail(f"{where}: the test must take the argument `case`.", pytrace=False)
    folder = metafunc.definition.path.parent
    files = _files(folder, marker.args)
    if isinstance(files, str):
        pytest.fail(f"{where}: {files}", pytrace=False)
    asked = {name: value for name, value in marker.kwargs.items() if name != "av"}
    cases = [MarkedCase(file, marker.kwargs.get("av"), folder, asked) for file in files]
    metafunc.parametrize("case", cases, ids=[_short_id(file, folder) for file in files])


def _files(folder: Path, patterns: Sequence[Any]) -> list[Path] | str:
    """Find case files; or say what is wrong with the patterns."""
    if not patterns or not all(isinstance(pattern, str) and pattern for pattern in patterns):
        return 'name case files, such as "cases/*.json".'
    from cornerforge.experiment.output import IDENTITY

    found: set[Path] = set()
    for pattern in patterns:
        whole = Path(pattern)
        start = Path(whole.anchor) if whole.is_absolute() else folder
        rest = str(whole.relative_to(whole.anchor)) if whole.is_absolute() else pattern
        here = {Path(os.path.abspath(path)) for path in start.glob(rest) if path.is_file()}
        if whole.name != IDENTITY:  # what `export` says of its folder
            here = {path for path in here if path.name != IDENTITY}
        if not here:
            return f"no file {pattern} (looked in {folder})."
        found |= here
    return sorted(found)


def _short_id(file: Path, folder: Path) -> str:
    """Id of a test: where the file is, without its ending."""
    shown = file.relative_to(folder) if file.is_relative_to(folder) else file
    return shown.with_suffix("").as_posix()


def pytest_unconfigure() -> None:
    """End the processes of AVs."""
    while _DRIVERS:
        _DRIVERS.popitem()[1].close()
