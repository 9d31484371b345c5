"""The tutorial on one's own data: its commands run as they stand there, with fewer recordings and miles."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from pages_as_run import ROOT, run

pytestmark = pytest.mark.full

TUTORIAL = ROOT / "docs" / "tutorial-your-own-data.md"
SMALLER = {
    "--recordings 24": "--recordings 3", "--recordings 6": "--recordings 1", "--out validation": "--out v --miles 2e5",
    "--out truth-validation": "--out t --miles 2e5",
}  # fmt: skip


def commands() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


def smaller(command: str) -> str:
    for here, instead in SMALLER.items():
        command = command.replace(here, instead)
    return command


def test_the_commands_are_those_that_are_run_here() -> None:
    starts = [" ".join(command.split()[:3]) for command in commands()]
    assert starts == [
        "python examples/highd_like.py mine", "python examples/highd_like.py unseen", "cornerforge ndd fit",
        "cornerforge ndd validate", "cornerforge ndd validate", "cornerforge ndd show", "cornerforge run --model",
    ]  # fmt: skip


def test_a_folder_is_fitted_and_shown_as_the_tutorial_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The known drivers are found in about 200 changes: 4.9 standard deviations, and the biases that the page tells."""
    monkeypatch.chdir(tmp_path)
    make, _, fit, _, _, show, _ = map(smaller, commands())
    assert run(make, tmp_path, monkeypatch) == 0
    assert "3 recordings in mine" in capsys.readouterr().out
    assert run(fit, tmp_path, monkeypatch, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "highd"
    assert {part["name"]: part["source"] for part in found["parts"]}["lane changes"] == "fitted in part"
    numbers = found["lane_changes"]["numbers"]
    for name, truth, bias in (("rate", 0.0266, 0.11), ("rear_standstill", 6.0, 0.25)):
        low, high = numbers[name]["interval95"]
        spread = math.log(high / low) / (2 * 1.96)
        assert abs(math.log(numbers[name]["estimate"] / truth)) < 4.9 * spread + bias, name
    assert numbers["rate"]["interval95"][0] > 0.0133  # the control: the prior's rate is found to be wrong
    assert run(show, tmp_path, monkeypatch) == 0
    assert "gap behind accepted by half" in capsys.readouterr().out


@pytest.mark.slow
def test_all_commands_of_the_tutorial_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    codes = [run(smaller(command), tmp_path, monkeypatch) for command in commands()]
    assert [code for command, code in zip(commands(), codes, strict=True) if "validate" not in command] == [0] * 5
    assert {code for command, code in zip(commands(), codes, strict=True) if "validate" in command} <= {0, 1}
    assert "NOT passed." in capsys.readouterr().out  # these drivers change lanes twice as often as published
    assert (tmp_path / "out" / "mine" / "report.html").is_file()
