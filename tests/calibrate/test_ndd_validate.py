"""Validation: the right model beats the baselines, a wrong one does not, and intervals mean what they say."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.errors import DataError, FileFormatError, InputError
from cornerforge.ext.calibrate.laws import bin_probabilities
from cornerforge.ext.calibrate.validate import Validation, better, passed, stated_law, validate_readings
from cornerforge.ndd import default_model_path, load_model, read_decisions
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import NddModel
from cornerforge.results.validation import BaselineDifference
from cornerforge.types import ACCELERATIONS

HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"


def shipped() -> NddModel:
    """The shipped model without its memory: `followers` have none."""
    return replace(load_model(default_model_path()), memory=Memory())


def followers(path: Path, vehicles: int = 80, seed: int = 3, split: str | None = None, speed: float = 26.0) -> Path:
    """Followers, 15 s each, who draw each second's acceleration from the shipped model's table (nearest grid point)."""
    table = shipped().following.astype(np.float64)
    rng = np.random.default_rng(seed)
    rows = []
    for follower in range(vehicles):
        v, lead, gap = speed + rng.uniform(-2.0, 2.0), speed + rng.uniform(-2.0, 2.0), rng.uniform(15.0, 60.0)
        label = split or ("test" if follower % 2 else "train")
        for t in range(16):
            rows.append(f"1,{follower},999,{t}.0,{v:.5f},{lead:.5f},{gap:.5f},{label}")
            place = np.rint([v - 20.0, gap, lead - v + 10.0]).astype(int).clip(0, [20, 115, 18])
            p = table[tuple(place)]
            after = max(v + rng.choice(ACCELERATIONS, p=p / p.sum()), 0.0)
            gap = max(gap + lead - (v + after) / 2.0, 2.0)
            v, lead = after, max(lead + 0.3 * rng.standard_normal(), 0.0)
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


def validate(model: NddModel, *paths: Path) -> Validation:
    return validate_readings(model, read_decisions(paths, "pairs"))


def mirrored(model: NddModel) -> NddModel:
    """A model that brakes where the true one speeds up: its accelerations are turned round within the 31 bins."""
    return replace(model, following=np.ascontiguousarray(model.following[..., ::-1]))


def test_the_law_that_made_the_data_beats_every_baseline(tmp_path: Path) -> None:
    found = validate(shipped(), followers(tmp_path / "p.csv"))
    assert found.passed
    for part, score in found.files["p.csv"].items():
        assert score.decisions == 40 * 15
        assert score.vehicles == 40
        for name, versus in score.model_minus.items():
            assert versus.interval95[0] < versus.difference < versus.interval95[1], name
            assert versus.difference == pytest.approx(score.model - score.baselines[name])
        assert score.baselines["uniform"] == pytest.approx(-np.log(31.0))
        assert better(score.model_minus["raw_table"])
        assert found.accelerations["p.csv"][part].kolmogorov_smirnov < 0.1


def test_a_mirrored_table_fails_and_lies_far_from_the_data(tmp_path: Path) -> None:
    path = followers(tmp_path / "p.csv")
    right, wrong = validate(shipped(), path), validate(mirrored(shipped()), path)
    assert not wrong.passed
    assert not passed(wrong.files["p.csv"]["table"])
    assert wrong.files["p.csv"]["law"] == right.files["p.csv"]["law"]
    off, near = (one.accelerations["p.csv"]["table"] for one in (wrong, right))
    assert off.wasserstein > 5.0 * near.wasserstein
    assert off.kolmogorov_smirnov > 0.5


def test_a_wrong_stated_law_fails(tmp_path: Path) -> None:
    model = shipped()
    stated = json.loads(json.dumps(dict(model.provenance)))
    stated["following"]["law"]["spread"] = 3.0
    found = validate(replace(model, provenance=stated), followers(tmp_path / "p.csv"))
    assert not passed(found.files["p.csv"]["law"])
    assert passed(found.files["p.csv"]["table"])
    assert not found.passed


def test_slow_traffic_is_scored_by_the_law_alone(tmp_path: Path) -> None:
    found = validate(shipped(), followers(tmp_path / "slow.csv", speed=10.0))
    assert set(found.files["slow.csv"]) == {"law"}
    assert any("table is not scored" in note for note in found.notes)


@pytest.mark.full
def test_a_model_without_a_stated_law_is_scored_on_its_grid_alone(tmp_path: Path) -> None:
    model = replace(shipped(), provenance={})
    found = validate(model, followers(tmp_path / "p.csv"))
    assert set(found.files["p.csv"]) == {"table", "table_without_past"}
    assert any("states no following law" in note for note in found.notes)
    with pytest.raises(DataError, match=r"slow\.csv.*19\.5 m/s.*fewer than 10 vehicles"):
        validate(model, followers(tmp_path / "slow.csv", speed=10.0))


@pytest.mark.full
def test_the_baseline_never_sees_what_is_scored(tmp_path: Path) -> None:
    path = followers(tmp_path / "p.csv")
    without = replace(shipped(), provenance={})  # a model that holds no IDMs of its own
    first = validate(without, path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.endswith("test") or int(line.split(",")[1]) < 40))
    assert validate(without, path).idms == first.idms


def test_the_idms_are_those_of_the_models_training_data(tmp_path: Path) -> None:
    """Whatever file is scored, with or without a part to fit on."""
    path = followers(tmp_path / "p.csv", split="train")
    found = validate(shipped(), path)
    stated = shipped().provenance["idm"]
    assert {name: asdict(idm) for name, idm in found.idms.items()} == stated
    assert set(found.files["p.csv"]["law"].baselines) == {"idm", "idm_fast", "raw_table", "uniform"}
    wrong = replace(shipped(), provenance={**shipped().provenance, "idm": {"idm": {"speed": 1.0}}})
    with pytest.raises(FileFormatError, match="no usable IDM"):
        validate(wrong, path)


def test_the_past_counts_as_the_memory_says(tmp_path: Path) -> None:
    """A model without memory does not look at the past; one with memory is misled by drivers who have none."""
    path = followers(tmp_path / "p.csv")
    model = load_model(default_model_path())
    parts = validate(model, path).files["p.csv"]
    forgetful = validate(shipped(), path).files["p.csv"]
    assert forgetful["table"].model == forgetful["table_without_past"].model == parts["table_without_past"].model
    assert parts["table"].model < parts["table_without_past"].model  # these drivers have no memory


def test_a_file_that_holds_nothing_out_is_scored_whole_and_says_so(tmp_path: Path) -> None:
    path = followers(tmp_path / "p.csv", split="train")
    found = validate(shipped(), path)
    assert found.files["p.csv"]["law"].decisions == 80 * 15
    assert any("all its decisions are scored" in note for note in found.notes)
    none = validate(replace(shipped(), provenance={}), path)
    assert any("Only 0 decisions are left to fit the IDM" in note for note in none.notes)
    [reading] = read_decisions([path], "pairs")
    seen = replace(shipped(), provenance={"files": [{"name": "p.csv", "sha256": reading.sha256}]})
    assert any("are no evidence" in note for note in validate_readings(seen, [reading]).notes)


def test_files_of_one_name_are_kept_apart(tmp_path: Path) -> None:
    paths = []
    for folder, seed in (("a", 1), ("b", 2)):
        (tmp_path / folder).mkdir()
        paths.append(followers(tmp_path / folder / "p.csv", seed=seed))
    assert set(validate(shipped(), *paths).files) == {str(path) for path in paths}


def test_bad_input_is_named(tmp_path: Path) -> None:
    path = followers(tmp_path / "p.csv")
    with pytest.raises(InputError, match="at least one"):
        validate(shipped())
    with pytest.raises(InputError, match="the same file"):
        validate(shipped(), path, path)
    with pytest.raises(DataError, match="fewer than 10 vehicles"):
        validate(shipped(), followers(tmp_path / "few.csv", vehicles=9))
    for wrong in ({"law": {}, "nonsense": 1.0}, {"law": {"pull": "much"}}, {}, "none", {"law": {"pull": float("nan")}}):
        with pytest.raises(FileFormatError, match="no usable following law"):
            stated_law(replace(shipped(), provenance={"following": wrong}))


def test_the_stated_law_is_the_one_that_the_tables_were_made_from() -> None:
    law = stated_law(shipped())
    assert law is not None
    state = np.array([30.0]), np.array([40.0]), np.array([-2.0])
    rows = bin_probabilities(law.mean(*state), law.scale(*state), law.degrees)[0]
    np.testing.assert_allclose(shipped().following[10, 40, 8], rows, atol=0.01)


def test_better_needs_the_whole_interval() -> None:
    for ends, is_better in (((0.01, 0.2), True), ((-0.01, 0.2), False), ((-0.2, -0.01), False)):
        assert better(BaselineDifference(difference=sum(ends) / 2, interval95=ends)) == is_better
