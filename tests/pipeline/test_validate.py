"""`ndd validate`: what it returns and prints, and the exit status of a model that does not pass."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge import pipeline
from cornerforge.cli import main
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.pipeline.validate import FACTS, compare_with_facts, validation_text

HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"
FACT_KEYS = {"fact", "unit", "found", "allowed", "within"}


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Followers at about 25 m/s who answer the range rate, with noise."""
    rng = np.random.default_rng(1)
    rows = []
    for follower in range(60):
        speed, lead, gap = rng.uniform(23.0, 27.0), 25.0, rng.uniform(30.0, 60.0)
        for t in range(13):
            rows.append(f"1,{follower},999,{t}.0,{speed:.4f},{lead},{gap:.4f},{'test' if follower % 2 else 'train'}")
            gap += lead - speed
            speed += 0.2 * (lead - speed) + 0.35 * rng.standard_normal()
    path = tmp_path_factory.mktemp("pairs") / "pairs.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def mirrored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model whose accelerations are turned round within the 31 bins."""
    model = load_model(default_model_path())
    path = tmp_path_factory.mktemp("mirrored") / "mirrored.npz"
    save_model(replace(model, following=np.ascontiguousarray(model.following[..., ::-1])), path)
    return path


@pytest.fixture(scope="module")
def found(pairs: Path) -> dict[str, Any]:
    return pipeline.ndd_validate(default_model_path(), against=[pairs], data_format="pairs")


def test_the_promised_keys_are_there_and_are_json(found: dict[str, Any]) -> None:
    again = json.loads(json.dumps(found, allow_nan=False))
    assert {"log_likelihood_per_decision", "distances", "facts", "passed"} <= set(again)
    for part in ("law", "table"):
        score = again["log_likelihood_per_decision"]["pairs.csv"][part]
        assert {"decisions", "vehicles", "model", "baselines", "model_minus"} <= set(score)
        assert set(score["model_minus"]) == {"idm", "raw_table", "uniform"}
        assert set(again["distances"]["acceleration"]["pairs.csv"][part]) == {"wasserstein", "kolmogorov_smirnov"}
    assert [set(fact) for fact in again["facts"]] == [FACT_KEYS] * len(FACTS)


def test_the_verdict_is_that_of_scores_and_facts(found: dict[str, Any]) -> None:
    gates = [
        score["model_minus"][name]["interval95"][0] > 0.0
        for score in found["log_likelihood_per_decision"]["pairs.csv"].values()
        for name in ("idm", "uniform")
    ]
    assert found["passed"] == (all(gates) and all(fact["within"] for fact in found["facts"]))


def test_the_facts_are_those_that_simulate_reports(found: dict[str, Any]) -> None:
    told = pipeline.simulate(tests=found["tests"], stats=True)["distributions"]
    assert found["facts"] == compare_with_facts(told)


def test_the_shipped_models_traffic_meets_the_facts(found: dict[str, Any]) -> None:
    assert [fact for fact in found["facts"] if not fact["within"]] == []


def exact() -> dict[str, Any]:
    """Distributions in the middle of everything that is allowed."""
    told: dict[str, Any] = {}
    for fact in FACTS:
        place = told
        for key in fact.path[:-1]:
            place = place.setdefault(key, {})
        place[fact.path[-1]] = (fact.low + fact.high) / 2.0
    return told


def test_every_fact_can_fail() -> None:
    assert all(row["within"] for row in compare_with_facts(exact()))
    for number, fact in enumerate(FACTS):
        for wrong in (fact.low * 0.999, fact.high * 1.001, None):
            told = exact()
            place = told
            for key in fact.path[:-1]:
                place = place[key]
            place[fact.path[-1]] = wrong
            outside = [i for i, row in enumerate(compare_with_facts(told)) if not row["within"]]
            assert outside == [number]


def test_distributions_of_nobody_meet_no_fact() -> None:
    nobody = {"time_gap": {"mean": None, "sd": None, "quantiles": {}}, "speed": {"mean": None}, "following_share": None}
    assert not any(row["within"] for row in compare_with_facts(nobody))


def test_text_names_what_is_outside(found: dict[str, Any]) -> None:
    text = validation_text(found)
    assert text.count("OUTSIDE") == sum(not fact["within"] for fact in found["facts"])
    wrong = {**found, "passed": False, "facts": compare_with_facts({})}
    assert validation_text(wrong).count("OUTSIDE") == len(FACTS)
    assert validation_text(wrong).endswith("NOT passed.")


def test_a_mirrored_model_does_not_pass_and_is_status_1(
    pairs: Path, mirrored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["ndd", "validate", str(mirrored), "--against", str(pairs), "--format", "pairs"]
    assert main([*call, "--json"]) == 1
    captured = capsys.readouterr()
    wrong = json.loads(captured.out)
    assert captured.err == ""
    assert wrong["passed"] is False
    assert wrong["log_likelihood_per_decision"]["pairs.csv"]["table"]["model_minus"]["uniform"]["interval95"][1] < 0.0
    assert not all(fact["within"] for fact in wrong["facts"])


def test_several_files_follow_one_against(pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    second = tmp_path / "second.csv"
    second.write_text(pairs.read_text().replace("999,", "998,"))
    call = ["ndd", "validate", str(default_model_path()), "--against", str(pairs), str(second), "--format", "pairs"]
    assert main([*call, "--quiet"]) in (0, 1)
    assert capsys.readouterr().out == ""
    main([*call, "--json"])
    assert set(json.loads(capsys.readouterr().out)["log_likelihood_per_decision"]) == {"pairs.csv", "second.csv"}


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda pairs: {"model": pairs.parent / "none.npz"}, FileFormatError, r"none\.npz"),
        (lambda pairs: {"against": [pairs.parent / "none.csv"]}, DataError, r"none\.csv"),
        (lambda _: {"against": []}, InputError, "--against"),
        (lambda _: {"data_format": "pears"}, InputError, "Did you mean"),
        (lambda _: {"seed": -1}, InputError, "seed = -1"),
        (lambda _: {"threads": 0}, InputError, "threads = 0"),
    ],
    ids=["model", "file", "no file", "format", "seed", "threads"],
)
def test_bad_input_is_named(
    pairs: Path, change: Callable[[Path], dict[str, Any]], error: type[CornerForgeError], message: str
) -> None:
    good = {"model": default_model_path(), "against": [pairs], "data_format": "pairs"}
    with pytest.raises(error, match=message):
        pipeline.ndd_validate(**{**good, **change(pairs)})
