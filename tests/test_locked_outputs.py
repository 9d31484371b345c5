"""Every output of every command belongs to one call at a time: whoever comes second is told so, and changes nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from folder_snapshot import snapshot

from cornerforge._locks import claim_file, claim_folder, claims
from cornerforge.cli import app, main
from cornerforge.cli.output import compiling_text
from cornerforge.ndd import default_model_path

FOLDER, FILE = "folder", "file"
OUTPUTS = {
    "run --out": (FOLDER, ""),
    "run --hours 0.01 --out": (FOLDER, ""),
    "reproduce --out": (FOLDER, ""),
    "simulate --tests 10 --out": (FOLDER, ""),
    "rate --out": (FOLDER, ""),
    "train --out": (FILE, ".safetensors"),
    "train-av --out": (FILE, ".safetensors"),
    "generate --policy swerve --cases 3 --out": (FOLDER, ""),
    "analyse LIB --out": (FOLDER, ""),
    "migrate LIB --out": (FOLDER, ""),
    "verify LIB --out": (FILE, ".json"),
    "report LIB --out": (FOLDER, ""),
    "report": (FOLDER, ""),
    "figure LIB --out": (FOLDER, ""),
    "figure LIB CASE --out": (FILE, ".svg"),
    "shrink LIB CASE --out": (FOLDER, ""),
    "replay LIB CASE --picture": (FILE, ".svg"),
    "replay LIB CASE --video": (FILE, ".gif"),
    "replay LIB CASE --out": (FILE, ".json"),
    "retest LIB --av rss-cautious --junit": (FILE, ".xml"),
    "retest LIB --av rss-cautious --sarif": (FILE, ".sarif"),
    "retest LIB --av rss-cautious --page": (FILE, ".html"),
    "retest LIB --av rss-cautious --out": (FILE, ".json"),
    "suite build LIB --size 2 --out": (FOLDER, ""),
    "r157 --family cut-in --out": (FOLDER, ""),
    "export LIB CASE --to json --out": (FOLDER, ""),
    "import TABLE --out": (FOLDER, ""),
    "cases from-data TABLE --out": (FOLDER, ""),
    "plausibility --out": (FOLDER, ""),
    "ndd fit PAIRS --format pairs --out": (FILE, ".npz"),
    "ndd validate MODEL --against PAIRS --format pairs --out": (FOLDER, ""),
    "ndd show --out": (FOLDER, ""),
    "ndd import DATA --out": (FILE, ".npz"),
    "init my-av --out": (FILE, ".json"),
    "serve LIB --port 0 --out": (FILE, ".json"),
    "avs --out": (FILE, ".json"),
    "check-av my_av:MyAv --out": (FILE, ".json"),
    "query LIB SQL --out": (FILE, ".json"),
    "variety LIB --out": (FILE, ".json"),
}  # fmt: skip
"""Command lines whose next word is the place, and what is made there."""


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What words of `OUTPUTS` stand for."""
    folder = tmp_path_factory.mktemp("inputs")
    library = folder / "library"
    assert main(["generate", "--policy", "swerve", "--cases", "3", "--out", str(library), "--quiet"]) == 0
    rows = ["period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"]
    for f in range(12):
        split = "test" if f % 5 == 0 else "train"
        speed = 25 + 0.3 * np.sin(np.arange(121) / 20 + f)
        rows += [f"1,{f},999,{0.1 * i:.1f},{v:.4f},25.0,{40 + f}.0,{split}" for i, v in enumerate(speed)]
    (folder / "pairs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    from cornerforge.library import CaseLibrary

    case = CaseLibrary.open(library).scalars(["case_id"])["case_id"][0].as_py()
    return {
        "LIB": str(library), "CASE": case, "PAIRS": str(folder / "pairs.csv"), "TABLE": str(folder / "pairs.csv"),
        "MODEL": str(default_model_path()), "DATA": str(folder), "SQL": "select 1 from cases",
    }  # fmt: skip


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
            options = {"--out", "--picture", "--video", "--junit", "--sarif", "--page"}
            yield from (f"{' '.join(path)} {word}" for one in command.params for word in options & {*one.opts})

    wanted = set(walk(typer.main.get_command(app), ()))
    assert len(wanted) > 30
    groups = ("ndd", "suite", "cases")
    each = [given.split() for given in OUTPUTS]
    listed = {" ".join([*words[: 2 if words[0] in groups else 1], words[-1]]) for words in each}
    assert wanted <= listed


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
