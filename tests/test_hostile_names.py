"""Control characters and direction marks in names and texts of files reach no terminal and no page as they are."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from output_places import stand_ins

from cornerforge._checksums import read_arrays, write_arrays
from cornerforge.cli import main
from cornerforge.cli.output import Bars
from cornerforge.errors import printable
from cornerforge.ndd import default_model_path

pytestmark = pytest.mark.full

MARKS = "\x1b]0;owned\x07\x9b2J\u202egpj\u2066x\u2069\u200f\u200e"
NAME = f"evil{MARKS}"
COMMANDS = [
    "query LIB TEXT",
    "report LIB --out OUT",
    "figure LIB --out OUT",
    "retest LIB --av rss-cautious --page OUT.html",
    "shrink LIB CASE --out OUT",
    "suite build LIB --size 2 --out OUT",
    "export LIB CASE --to json --out OUT",
    "variety LIB",
    "generate --policy swerve --cases 3 --out OUT",
    "generate --policy swerve --cases 3 --out LIB",
    "ndd show MODEL",
    "ndd show MODEL --out OUT",
    "ndd fit PAIRS --format pairs --out OUT.npz",
    "import PAIRS --out OUT",
    "migrate LIB --out OUT",
    "init NAME --out OUT.json",
    "check-av NAME.py:Av",
    "simulate --tests 1 --av NAME",
    "simulate --tests 1 --model NAME",
    "run --config NAME",
]
"""Command lines that print the name of a place, of a file, or what a file says."""


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files with a hostile name, a model with a hostile text."""
    folder = tmp_path_factory.mktemp("hostile")
    found = stand_ins(folder)
    for word, name in (("LIB", f"lib-{NAME}"), ("PAIRS", f"{NAME}.csv")):
        (shutil.copytree if word == "LIB" else shutil.copy)(found[word], folder / name)
        found[word] = str(folder / name)
    arrays = read_arrays(default_model_path(), "model")
    said = json.loads(str(arrays["header"]))
    origin = said["provenance"] | {"attribution": NAME, "licence": NAME, "files": [NAME]}
    arrays["header"] = np.array(json.dumps(said | {"provenance": origin}))
    found["MODEL"] = str(folder / f"{NAME}.npz")
    write_arrays(Path(found["MODEL"]), arrays)
    return found | {"NAME": NAME, "TEXT": f"select '{NAME}' as \"{NAME}\" from cases"}


@pytest.mark.parametrize("line", COMMANDS)
def test_no_command_prints_them(
    line: str, words: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    known = words | {"OUT": f"out{NAME}"}
    given = [known.get(word, word.replace("OUT", known["OUT"]).replace("NAME", NAME)) for word in line.split()]
    assert main(given) in (0, 1, 2)
    told = "".join(capsys.readouterr())
    assert "\\u202e" in told, "it prints no name"
    assert printable(told) == told
    for page in tmp_path.rglob("*.html"):
        text = re.sub("(?s)<script.*?</script>", "", page.read_text(encoding="utf-8"))
        assert not set("\x1b\x07\x9b\u202e\u2066\u2069\u200f\u200e") & set(text)


def test_progress_is_escaped_too(capsys: pytest.CaptureFixture[str]) -> None:
    bars = Bars(quiet=False, lines=True)
    bars(f"reading {NAME}", 1, 2)
    bars.stop(finished=True)
    told = capsys.readouterr().err
    assert "evil\\x1b" in told
    assert printable(told) == told
