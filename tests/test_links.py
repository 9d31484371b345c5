"""A stranger's folder may hold links: none is written through, at whatever name a command writes."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from folder_snapshot import snapshot
from output_places import FOLDER, OUTPUTS, stand_ins

from cornerforge._locks import lock_of
from cornerforge.cli import main
from cornerforge.ext.explorer import serve
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.ext.explorer.server import Door
from cornerforge.foreign.av_log import AvLog
from cornerforge.verbs.make_report import make_report

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What words of `OUTPUTS` stand for."""
    return stand_ins(tmp_path_factory.mktemp("inputs"))


_HEARD: list[set[str]] = []
"""Sets that hear every name that is opened, made or renamed; several are open within each other."""


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if _HEARD and event in ("open", "os.mkdir", "os.rename"):
        _HEARD[-1].update(os.fsdecode(one) for one in arguments[:2] if isinstance(one, str | bytes))


sys.addaudithook(_hear)


@contextmanager
def names_made(below: Path) -> Iterator[set[str]]:
    """Give, afterwards, all names below a folder that were opened, made or renamed, locks and parts included."""
    heard: set[str] = set()
    made: set[str] = set()
    _HEARD.append(heard)
    try:
        yield made
    finally:
        _HEARD.pop()
        for name in heard:
            if os.path.isabs(name) and Path(name).is_relative_to(below) and Path(name) != below:
                made.add(Path(name).relative_to(below).as_posix())
        made.update(snapshot(below))


def foreseen(names: set[str]) -> set[str]:
    """Names that a stranger can foresee: those that are made, and the names of parts in all versions."""
    known = {re.sub(r"\.[0-9a-f]{8}\.part$", ".part", name) for name in names}
    files = {name for name in known if not name.endswith((".part", ".lock"))}
    parts = {Path(name).with_name(f".{Path(name).name}{end}").as_posix() for name in files for end in (".part", ".tmp")}
    return known | parts


def lay_links(place: Path, names: set[str], victims: Path, folders: set[str]) -> None:
    """Put a link at each name: to a file of the user's, or to a folder."""
    for name in sorted(names, key=lambda one: one.count("/")):
        link, victim = place / name, victims / name.replace("/", "+")
        if os.path.lexists(link) or any(parent.is_symlink() for parent in link.parents if parent != place):
            continue
        if name in folders:
            victim.mkdir()
            (victim / "mine").write_text("mine", encoding="utf-8")
        else:
            victim.write_text("mine", encoding="utf-8")
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(victim)


def _serve_for_a_moment(exhibit: Exhibit, door: Door, up: Callable[[], None]) -> None:
    up()
    exhibit.close()
    door.listening.close()


@pytest.mark.parametrize("given", [one for one in OUTPUTS if not one.startswith(("run", "reproduce", "plaus"))])
def test_no_command_writes_through_a_link(
    given: str,
    words: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Run the command once to learn the names that it makes, then with links at these names."""
    kind, ending = OUTPUTS[given]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cornerforge.ext.explorer.server.serve_exhibit", _serve_for_a_moment)  # where the page is built
    args = [words.get(word, word) for word in given.split()]
    small = {"rate": ["--max-tests", "200"], "train": ["--decisions", "64"], "train-av": ["--tests", "50"]}
    args[1:1] = small.get(args[0], [])

    def run(place: Path) -> int:
        return main([*args, str(place), "--quiet"])

    clean = tmp_path / "clean"
    clean.mkdir()
    with names_made(clean) as names:
        run(clean / f"place{ending}")
    made = {name for name in names if (clean / name).is_dir() and "/" in name}
    wanted = foreseen(names) - {f"place{ending}"}
    wanted.add(lock_of(Path(f"place{ending}"), is_folder=kind == FOLDER).as_posix())
    dirty, victims = tmp_path / "dirty", tmp_path / "victims"
    dirty.mkdir()
    victims.mkdir()
    lay_links(dirty, wanted, victims, made)
    before = snapshot(victims)
    assert len(before) >= 1
    run(dirty / f"place{ending}")
    assert snapshot(victims) == before


def _with_links(made: Path, place: Path, victims: Path) -> None:
    """Copy an output folder with each of its files as a link, and links at the names of parts and locks."""
    shutil.copytree(made, place)
    for file in sorted(path for path in place.rglob("*") if path.is_file()):
        name = file.relative_to(place).as_posix()
        victim = victims / name.replace("/", "+")
        file.rename(victim)
        file.symlink_to(victim)
    names = {path.relative_to(place).as_posix() for path in place.rglob("*")} | {".cornerforge.lock"}
    lay_links(place, foreseen(names), victims, set())


RESUMED = {
    "generate": ["generate", "--policy", "swerve", "--cases", "6", "--resume", "--out"],
    "simulate": ["simulate", "--av", "flawed-not-behind", "--tests", "400", "--resume", "--out"],
    "rate": ["rate", "--av", "flawed-not-behind", "--max-tests", "400", "--resume", "--out"],
}


@pytest.mark.parametrize("verb", RESUMED)
@pytest.mark.parametrize("locked", [False, True])
def test_going_on_with_a_strangers_folder_writes_through_no_link(verb: str, locked: bool, tmp_path: Path) -> None:
    """Each file of the work before is a link; the lock is one too, or is not there."""
    made, place, victims = tmp_path / "made", tmp_path / "place", tmp_path / "victims"
    first = [word if word != "6" else "3" for word in RESUMED[verb]]
    assert main([*first, str(made), "--quiet"]) == 0
    victims.mkdir()
    _with_links(made, place, victims)
    if not locked:
        (place / ".cornerforge.lock").unlink()
    before = snapshot(victims)
    main([*RESUMED[verb], str(place), "--quiet"])
    assert snapshot(victims) == before


def test_looking_at_a_strangers_library_writes_through_no_link(
    words: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What `serve` does behind the page: an analysis beside the library, whose name a stranger knows."""

    pack, victims = tmp_path / "pack", tmp_path / "victims"
    shutil.copytree(words["LIB"], pack / "library")
    victims.mkdir()
    lay_links(pack, {"library-analysis", "report.html", ".report.html.part"}, victims, {"library-analysis"})
    before = snapshot(victims)
    found = serve._sources(pack / "library")
    exhibit = Exhibit("library", [(one.source, one.analysis) for one in found], Driving((), found[0].source))
    monkeypatch.setattr(serve, "_warm_up", lambda *_: None)
    serve._behind(exhibit, found, 1, Event())
    exhibit.close()
    assert "library-analysis is a link" in " ".join(exhibit.warnings)
    make_report(pack / "library", out=pack)
    assert snapshot(victims) == before


def test_what_an_av_prints_is_written_through_no_link(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("mine", encoding="utf-8")
    (tmp_path / "av.log").symlink_to(other)
    log = AvLog(most=100)
    log.keep_in(tmp_path / "av.log")
    log.write(b"x" * 10)
    log.write(b"x" * 1000)
    assert other.read_text(encoding="utf-8") == "mine"
