"""Every output of every command belongs to one call at a time: whoever comes second is told so, and changes nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
from folder_snapshot import snapshot
from output_places import FILE, FOLDER, OUTPUTS, stand_ins

from cornerforge._locks import claim_file, claim_folder, claims
from cornerforge.cli import app, main
from cornerforge.cli.output import compiling_text


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What words of `OUTPUTS` stand for."""
    return stand_ins(tmp_path_factory.mktemp("inputs"))


@contextmanager
def held(kind: str, place: Path) -> Iterator[None]:
    """Let another thread hold a place."""
    has, end = threading.Event(), threading.Event()

    def hold() -> None:
        with claims():
            (claim_folder if kind == FOLDER else claim_file)(place)
            has.set()
            end.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    assert has.wait(60)
    try:
        yield
    finally:
        end.set()
        thread.join()


def test_every_command_is_listed() -> None:
    def walk(command: Any, path: tuple[str, ...]) -> Iterator[str]:
        for name, child in getattr(command, "commands", {}).items():
            yield from walk(child, (*path, name))
        if path and not hasattr(command, "commands"):
            options = {"--out", "--picture", "--video", "--junit", "--page"}
            yield from (f"{' '.join(path)} {word}" for one in command.params for word in options & {*one.opts})

    wanted = set(walk(typer.main.get_command(app), ()))
    assert len(wanted) > 30
    groups = ("ndd", "suite", "cases", "road", "site")
    each = [given.split() for given in OUTPUTS]
    listed = {" ".join([*words[: 2 if words[0] in groups else 1], words[-1]]) for words in each}
    assert wanted <= listed


@pytest.mark.sampled(3)
@pytest.mark.parametrize("given", OUTPUTS)
def test_a_second_call_is_refused_in_one_line_and_changes_nothing(
    given: str, words: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind, ending = OUTPUTS[given]
    place = tmp_path / f"place{ending}"
    if given == "report":  # of a run, whose page is written into its folder
        place.mkdir()
        (place / "summary.json").write_text("{}", encoding="utf-8")
    with held(kind, place):
        before = snapshot(tmp_path)
        status = main([words.get(word, word) for word in given.split()] + [str(place)])
        assert snapshot(tmp_path) == before
    said = capsys.readouterr().err.replace(f"{compiling_text()}\n", "")
    assert status == 2
    assert said.count("\n") == 1
    assert f"{place} is being written by another call in this process since" in said
    assert said.endswith("wait, or choose another place.\n")


def test_init_holds_each_of_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with held(FILE, tmp_path / "README.md"):
        assert main(["init", str(tmp_path)]) == 2
    assert "README.md is being written by" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
