from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

import cornerforge
from cornerforge._checksums import read_arrays, write_arrays, write_tensors
from cornerforge.cli import main
from cornerforge.errors import InputError
from cornerforge.experiment.av_file import rl_av_path
from cornerforge.experiment.output import write_json
from cornerforge.ndd.model import default_model_path


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a file of each kind that is no library."""
    (tmp_path / "model.npz").write_bytes(default_model_path().read_bytes())
    (tmp_path / "av.safetensors").write_bytes(rl_av_path().read_bytes())
    write_json(tmp_path / "summary.json", {"crashes": 12})
    (tmp_path / "page.html").write_text("<p>", encoding="utf-8")
    return tmp_path


def test_whole_files_are_counted(place: Path) -> None:
    (place / "by-hand.json").write_text("{}", encoding="utf-8")
    found = cornerforge.verify(place)
    assert (found.whole, found.damaged, found.other) == (3, (), 1)
    assert found.without_checksum == (str(place / "by-hand.json"),)
    assert cornerforge.verify(place / "model.npz").whole == 1


def test_a_changed_value_is_named_and_the_command_fails(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = place / "summary.json"
    file.write_text(file.read_text(encoding="utf-8").replace("12", "3"), encoding="utf-8")
    weights = bytearray((place / "av.safetensors").read_bytes())
    weights[-50] ^= 4
    (place / "av.safetensors").write_bytes(weights)
    assert main(["verify", str(place), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert [Path(one["file"]).name for one in found["damaged"]] == ["av.safetensors", "summary.json"]
    assert main(["verify", str(place)]) == 1
    out = capsys.readouterr().out
    assert "has been changed since it was written" in out
    assert "1 whole, 2 damaged" in out


def test_values_are_checked_too(place: Path) -> None:
    arrays = read_arrays(place / "model.npz", "model")
    write_arrays(place / "model.npz", arrays | {"lc_base": arrays["lc_base"] + 2.0})
    [damaged] = cornerforge.verify(place / "model.npz").damaged
    assert "lc_base" in damaged.fault


def test_checkpoints_are_read_and_weights_of_others_are_not(place: Path) -> None:
    write_tensors(
        place / "p.safetensors.checkpoint", "cornerforge_checkpoint", {}, {"a": np.zeros(3)}, "the checkpoint"
    )
    (place / "theirs.safetensors").write_bytes(save({"layer": np.zeros(3)}))
    found = cornerforge.verify(place)
    assert (found.whole, found.damaged, found.other) == (4, (), 2)
    content = bytearray((place / "p.safetensors.checkpoint").read_bytes())
    content[-1] ^= 1
    (place / "p.safetensors.checkpoint").write_bytes(content)
    [damaged] = cornerforge.verify(place).damaged
    assert damaged.file.endswith(".checkpoint")


def test_nothing_at_a_place_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="There is nothing at"):
        cornerforge.verify([tmp_path, tmp_path / "no"])
