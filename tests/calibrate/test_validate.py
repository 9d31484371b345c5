"""`ndd validate`: what it returns and prints, and the exit status of a model that does not pass."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.cli import main
from cornerforge.cli.output import compiling_text
from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError, MissingExtraError
from cornerforge.ext.calibrate.validating import validation_text
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.results import NddValidated, as_json, from_json

pytestmark = pytest.mark.full

HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"
FACT_KEYS = {
    "theme", "when", "fact", "unit", "published", "source", "found", "n", "interval95", "allowed", "within",
}  # fmt: skip
MILES = 2_000
"""A quick look: too short to bound crashes, so nothing passes."""


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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("validation") / "out"


@pytest.fixture(scope="module")
def found(pairs: Path, folder: Path) -> NddValidated:
    return cornerforge.ndd_validate(default_model_path(), against=[pairs], data_format="pairs", miles=MILES, out=folder)


def test_the_promised_keys_are_there_and_are_json(found: NddValidated) -> None:
    again = json.loads(json.dumps(as_json(found), allow_nan=False))
    assert {"log_likelihood_per_decision", "distances", "facts", "passed", "one_step_ahead", "traffic"} <= set(again)
    for part in ("law", "table", "law_on_grid"):
        score = again["log_likelihood_per_decision"]["pairs.csv"][part]
        assert {"decisions", "vehicles", "model", "interval95", "baselines", "model_minus"} <= set(score)
        assert set(score["model_minus"]) == {"idm", "idm_fast", "raw_table", "uniform"}
        far = again["distances"]["acceleration"]["pairs.csv"][part]
        assert {"wasserstein", "wasserstein_interval95", "kolmogorov_smirnov"} <= set(far)
    assert from_json(NddValidated, again) == found
    quantities = {
        "speed", "gap", "time_gap", "range_rate", "acceleration", "acceleration_following", "acceleration_free",
        "ttc_share_below", "lane_changes_per_mile", "accepted_lead_gap", "accepted_rear_gap",
    }  # fmt: skip
    assert set(again["distances"]) == quantities
    assert all(set(files) == {"pairs.csv"} for files in again["distances"].values())
    for fact in again["facts"]:
        assert set(fact) - {"crashes", "miles"} == FACT_KEYS
    whens = ["0-2 s", "5-7 s", "10-12 s", "30-32 s", "60-62 s"]
    assert [part["when"] for part in again["traffic"]] == whens
    assert {fact["when"] for fact in again["facts"] if fact["theme"] == "drift"} == set(whens)
    assert {fact["theme"] for fact in again["facts"]} == {"drift", "crashes", "cut-ins", "persistence", "merging"}
    assert {fact["theme"] for fact in again["facts"]} <= set(again["themes"])
    assert sum(part["miles"] for part in again["traffic"]) >= MILES


def test_the_verdict_is_that_of_scores_and_facts(found: NddValidated) -> None:
    gates = [
        found.log_likelihood_per_decision["pairs.csv"][part].model_minus[name].interval95[0] > 0.0
        for part in ("law", "table")
        for name in ("idm", "uniform")
    ]
    assert found.passed == (all(gates) and all(fact.within is not False for fact in found.facts))
    crashes = [fact for fact in found.facts if fact.crashes is not None]
    assert [fact.when for fact in crashes] == ["0-62 s", "0-2 s", "2-10 s", "10-30 s", "30-62 s"]
    assert crashes[0].within is False  # too few miles, and a note says so
    assert any("even no crash at all does not show" in note for note in found.notes)


def test_the_folder_holds_the_page_and_what_it_was_made_of(found: NddValidated, folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert {"validation.json", "validation.html", "provenance.json", "facts.png", "traffic.png"} <= names
    assert json.loads((folder / "validation.json").read_text()) == json.loads(json.dumps(with_checksum(as_json(found))))
    page = (folder / "validation.html").read_text()
    assert page.count("<img ") == sum(name.endswith(".png") for name in names)
    assert "http" not in page
    for fact in found.facts:
        assert escape(fact.fact) in page
    assert "<td>time gap, 5 % [s]</td>" in page
    assert "<td>lane changes per vehicle-mile</td>" in page
    for theme in found.themes.values():
        assert (theme.title in page) == any(found.themes[fact.theme] == theme for fact in found.facts)
    assert page.count('class="bad"') >= sum(fact.within is False for fact in found.facts)
    assert all(escape(fact.source) in page for fact in found.facts)
    for name in names:
        if name.endswith(".png"):
            assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_the_same_again_gives_the_same_page_and_another_seed_is_refused(
    pairs: Path, found: NddValidated, folder: Path
) -> None:
    first = (folder / "validation.html").read_bytes()
    again = cornerforge.ndd_validate(
        default_model_path(), against=[pairs], data_format="pairs", miles=MILES, out=folder, threads=1
    )
    assert replace(again, seconds=0) == replace(found, seconds=0)
    assert (folder / "validation.html").read_bytes() == first
    with pytest.raises(InputError, match="seed"):
        cornerforge.ndd_validate(
            default_model_path(), against=[pairs], data_format="pairs", miles=MILES, out=folder, seed=1
        )


def test_text_names_what_is_outside(found: NddValidated) -> None:
    text = validation_text(found)
    outside = [fact for fact in found.facts if fact.within is False]
    drift = sum(fact.theme == "drift" for fact in outside)
    lines = [line for line in text.splitlines() if line.startswith("  ") and "(!" not in line]
    assert sum(line.count("!") for line in lines) == drift >= 2
    assert text.count("OUTSIDE") == len(outside) - drift >= 2
    assert text.endswith("NOT passed.")
    fine = tuple(replace(fact, within=None if fact.within is None else True) for fact in found.facts)
    fine_text = validation_text(replace(found, facts=fine))
    assert "OUTSIDE" not in fine_text
    assert fine_text.count("!") == 1  # which says what it means
    assert validation_text(replace(found, passed=True)).endswith("\nPassed.")
    assert max(map(len, text.splitlines()[:80])) < 400


def test_a_mirrored_model_does_not_pass_and_is_status_1(
    pairs: Path, mirrored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["ndd", "validate", str(mirrored), "--against", str(pairs), "--format", "pairs", "--miles", "500"]
    assert main([*call, "--json"]) == 1
    captured = capsys.readouterr()
    wrong = json.loads(captured.out)
    assert captured.err.replace(f"{compiling_text()}\n", "") == ""
    assert wrong["passed"] is False
    assert wrong["log_likelihood_per_decision"]["pairs.csv"]["table"]["model_minus"]["uniform"]["interval95"][1] < 0.0
    outside = [fact["fact"] for fact in wrong["facts"] if fact["within"] is False]
    assert "range rate, sd" in outside or "time gap, 50 %" in outside


def test_several_files_follow_one_against(pairs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    second = tmp_path / "second.csv"
    second.write_text(pairs.read_text().replace("999,", "998,"))
    call = ["ndd", "validate", str(default_model_path()), "--against", str(pairs), str(second), "--format", "pairs"]
    call += ["--miles", "200"]
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
        (lambda _: {"miles": 10.0}, InputError, "miles = 10"),
        (lambda _: {"seed": -1}, InputError, "seed = -1"),
        (lambda _: {"threads": 0}, InputError, "threads = 0"),
    ],
    ids=["model", "file", "no file", "format", "miles", "seed", "threads"],
)
def test_bad_input_is_named(
    pairs: Path, change: Callable[[Path], dict[str, Any]], error: type[CornerForgeError], message: str
) -> None:
    good = {"model": default_model_path(), "against": [pairs], "data_format": "pairs"}
    with pytest.raises(error, match=message):
        cornerforge.ndd_validate(**{**good, **change(pairs)})


def test_without_matplotlib_the_page_is_refused_before_any_work(
    pairs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"matplotlib.*cornerforge\[report\]"):
        cornerforge.ndd_validate(
            default_model_path(), against=[pairs], data_format="pairs", miles=MILES, out=tmp_path / "out"
        )
    assert not (tmp_path / "out").exists()
