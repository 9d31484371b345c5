"""A model whose numbers cannot be right is refused where it enters."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge._checksums import read_arrays, write_arrays
from cornerforge.errors import FileFormatError
from cornerforge.ndd.model import default_model_path, load_model

IMPOSSIBLE = {
    "free_pull": 1.5,
    "lc_desire_free": -0.1,
    "overlook": float("nan"),
    "memory.near": -0.1,
    "memory.far": 0.95,  # with the weight `near` above 1
    "memory.near_width": 0.0,
    "memory.habit_width": 1.2,
    "initial.speed_sd": 0.0,
    "initial.stream_sd": float("inf"),
    "initial.desire_share": 1.1,
    "initial.time_gap_shift": -0.2,
    "initial.noise_spread": 2.5,
    "initial.vigilance_sigma": 1.6,
    "initial.speed_low": 50.0,
    "initial.free_gap_low": 400.0,
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_an_impossible_number_is_refused_by_name(tmp_path: Path, name: str) -> None:
    content = read_arrays(default_model_path(), "model")
    header = json.loads(str(content["header"]))
    *where, last = name.split(".")
    (header[where[0]] if where else header)[last] = IMPOSSIBLE[name]
    path = tmp_path / "model.npz"
    write_arrays(path, content | {"header": np.array(json.dumps(header))}, "the model")
    with pytest.raises(FileFormatError, match=last) as refused:
        load_model(path)
    assert str(path) in str(refused.value)


def test_a_model_made_in_python_is_held_to_the_same() -> None:
    model = load_model(default_model_path())
    with pytest.raises(
        FileFormatError, match=r"Model number stream_sd = -1\.0 m/s is out of range; allowed: 0\.0 to 10"
    ):
        replace(model, initial=replace(model.initial, stream_sd=-1.0))
