"""What `ndd show` says of a model: numbers against plain loops and the definitions, figures, and no matplotlib."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import FileFormatError, InputError, MissingExtraError, OutputError
from cornerforge.ext.calibrate.show import show_text
from cornerforge.ext.calibrate.shown import counted_states, key_numbers, mean_and_sd, quantiles
from cornerforge.ndd import default_model_path, save_model
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.results import NddShown, from_json
from cornerforge.types import ACCELERATIONS

needs_matplotlib = pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs the extra report")
HOLD = int(np.flatnonzero(ACCELERATIONS == 0.0)[0])


def certain(model: NddModel) -> NddModel:
    """Everybody holds the speed, wants no lane change, refuses every gap; the provenance is empty."""
    one = np.eye(31, dtype=np.float32)[HOLD]
    none = np.zeros((116, 19), dtype=np.float32)
    return replace(
        model,
        following=np.broadcast_to(one, (21, 116, 19, 31)).copy(),
        free=np.broadcast_to(one, (21, 31)).copy(),
        lc_desire=none,
        lc_accept_lead=none,
        lc_accept_rear=none,
        provenance={},
    )


def test_mean_and_sd_by_hand() -> None:
    rows = np.zeros((2, 31), dtype=np.float32)
    rows[0, 0] = rows[0, 30] = 0.5  # -4 and 2
    rows[1, HOLD] = 1.0
    mean, sd = mean_and_sd(rows)
    np.testing.assert_allclose(mean, [-1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(sd, [3.0, 0.0], atol=1e-12)


@given(st.lists(st.tuples(st.floats(-50.0, 50.0), st.floats(0.01, 1.0)), min_size=1, max_size=30))
def test_quantiles_hold_their_share(pairs: list[tuple[float, float]]) -> None:
    values, weights = np.array([v for v, _ in pairs]), np.array([w for _, w in pairs])
    share = weights / weights.sum()
    for percent, point in quantiles(values, weights).items():
        assert share[values <= point].sum() >= percent / 100.0 - 1e-9
        assert share[values < point].sum() <= percent / 100.0 + 1e-9


def test_numbers_are_those_of_the_tables(model: NddModel) -> None:
    numbers = key_numbers(model)
    following = numbers["following"]
    for i, speed in enumerate(following["speed_mps"]):
        for j, gap in enumerate(following["gap_m"]):
            for k, rate in enumerate(following["range_rate_mps"]):
                row = model.following[int(speed - 20), int(gap), int(rate + 10)].astype(float)
                mean = sum(p * a for p, a in zip(row, ACCELERATIONS, strict=True))
                sd = sum(p * (a - mean) ** 2 for p, a in zip(row, ACCELERATIONS, strict=True)) ** 0.5
                assert following["mean_mps2"][i][j][k] == pytest.approx(mean, abs=1e-4)
                assert following["sd_mps2"][i][j][k] == pytest.approx(sd, abs=1e-4)
    free = numbers["free_flow"]
    assert free["share_braking_1_mps2"][10] == pytest.approx(float(model.free[10, :16].sum()), abs=1e-6)  # -4 ... -1
    change = numbers["lane_change"]
    assert change["gap_accepted_half_rear_m"][change["range_rate_mps"].index(-4.0)] is None  # beyond the grid
    half = change["gap_accepted_half_lead_m"][change["range_rate_mps"].index(-4.0)]
    column = model.lc_accept_lead[:, int(np.searchsorted(RANGE_RATES, -4.0))]
    assert column[int(half)] >= 0.5 > column[int(half) - 1]
    assert set(change["gap_always_refused_rear_m"]) == {None}  # any gap may be accepted
    refused = change["gap_turned_back_for_m"][change["range_rate_mps"].index(-4.0)]
    turned = model.lc_turn_back[:, int(np.searchsorted(RANGE_RATES, -4.0))]
    assert turned[int(refused)] == 1.0 > turned[int(refused) + 1]
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers


def test_counted_decisions_are_those_of_the_provenance(model: NddModel) -> None:
    counted: Any = model.provenance["counted"]
    counts = counted_states(model)
    assert counts is not None
    assert counts.shape == (SPEEDS.size, GAPS.size, RANGE_RATES.size)
    assert counts.sum() == sum(counted["decisions"])
    assert counts.reshape(-1)[counted["state"][0]] == counted["decisions"][0]
    numbers = key_numbers(model)["counted"]
    assert numbers["following_states"] == len(counted["state"])
    assert sum(numbers["following_decisions_by_speed"]) == counts.sum()


@pytest.mark.parametrize(
    "counted",
    [
        {"state": [1, 2]},
        {"state": [10**9], "decisions": [1]},
        {"state": [-1], "decisions": [1]},
        {"state": [1, 2], "decisions": [1]},
        {"state": ["a"], "decisions": [1]},
        {"state": -1e308, "decisions": [1]},
        "many",
    ],
)
def test_unusable_counts_are_refused(model: NddModel, counted: object) -> None:
    with pytest.raises(FileFormatError, match="no usable counts"):
        key_numbers(replace(model, provenance={"counted": counted}))


def test_a_provenance_without_counts_is_said_so(model: NddModel) -> None:
    numbers = key_numbers(replace(model, provenance={}))
    assert numbers["counted"] is None
    assert "Counted decisions: not stated." in show_text(
        from_json(NddShown, {"model_hash": "", "model": "", "figures": [], **numbers})
    )


def test_a_model_of_certainties_has_no_spread_and_no_gap_that_is_accepted(model: NddModel) -> None:
    numbers = key_numbers(certain(model))
    assert numbers["support"]["following_states_with_one"] == 21 * 116 * 19
    assert numbers["support"]["following_states_that_allow_hardest_braking"] == 0.0
    assert np.ptp(numbers["following"]["sd_mps2"]) == 0.0
    assert set(numbers["lane_change"]["gap_accepted_half_lead_m"]) == {None}
    assert set(numbers["lane_change"]["gap_always_refused_rear_m"]) == {115.0}


def test_the_command_prints_numbers_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ndd", "show"]) == 0
    text = capsys.readouterr().out
    assert "NGSIM, US DOT FHWA" in text
    assert "Free flow, model (published)" in text
    assert main(["ndd", "show", str(default_model_path()), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"] == []
    assert main(["ndd", "show", str(tmp_path / "none.npz")]) == 2
    assert "No model file" in capsys.readouterr().err


def test_without_matplotlib_the_message_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r'matplotlib.*pip install "cornerforge\[report\]"'):
        cornerforge.ndd_show(out=tmp_path / "figures")
    assert not (tmp_path / "figures").exists()


@pytest.mark.full
@needs_matplotlib
def test_figures_are_drawn_and_drawn_again_to_the_same_bytes(tmp_path: Path, model: NddModel) -> None:
    result = cornerforge.ndd_show(out=tmp_path / "f")
    first = {path.name: path.read_bytes() for path in (tmp_path / "f").iterdir()}
    assert len(result.figures) == 7
    assert all(first[Path(name).name].startswith(b"\x89PNG") for name in result.figures)
    assert {"numbers.json", "provenance.json"} <= set(first)
    again = cornerforge.ndd_show(out=tmp_path / "f")
    assert all(Path(name).read_bytes() == first[Path(name).name] for name in again.figures)
    other = tmp_path / "other.npz"
    save_model(certain(model), other)
    with pytest.raises(InputError, match="holds a run with model"):
        cornerforge.ndd_show(other, out=tmp_path / "f")
    assert len(cornerforge.ndd_show(other, out=tmp_path / "g").figures) == 7


@needs_matplotlib
def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match=r"thesis\.tex"):
        cornerforge.ndd_show(out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
