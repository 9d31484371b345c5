"""`rate --model-draws`: a second interval that takes the model's own uncertainty in, kept draw by draw."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from edited_files import write_object

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.cli import main
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.calibrate.uncertainty import LAWS, drawn_laws, drawn_model, drawn_variations
from cornerforge.ext.calibrate.variations import Variation, varied_model
from cornerforge.ext.studies import model_draws
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.results import NaturalRate, as_json
from cornerforge.verbs.sentences.rates import model_text

pytestmark = pytest.mark.full

DRAWS = 6


@pytest.fixture(scope="module")
def careless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped model with drivers who change lanes and overlook others often, and that its provenance explains."""
    path = tmp_path_factory.mktemp("careless") / "careless.npz"
    often = [Variation("lane_change", "rate", 8.0), Variation("lane_change", "overlook", 13.0)]
    save_model(varied_model(load_model(default_model_path()), often), path)
    return path


@pytest.fixture(scope="module")
def world(careless: Path) -> dict[str, Any]:
    return {"av": "idm-mobil-blind", "odd": "paper", "lanes": 2, "seed": 3, "model": careless}


@pytest.fixture(autouse=True)
def small(small_trees: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001 - it patches
    """Few trees of each model."""
    monkeypatch.setattr(model_draws, "_TREES_EACH", 500)
    monkeypatch.setattr(model_draws, "_TRAFFIC_TESTS", 2_000)


def untimed(found: NaturalRate) -> dict[str, Any]:
    """The result without times."""
    content = as_json(found)
    for name in ("seconds", "cpu_seconds", "tests_per_second", "acceleration", "effort", "reason"):
        del content[name]
    if "model_uncertainty" in content:
        del content["model_uncertainty"]["cost"]["cpu_seconds"]
    return content


def test_counted_draws_widen_the_interval_and_are_what_their_models_crash(
    world: dict[str, Any], tmp_path: Path
) -> None:
    given = {**world, "method": "mc", "max_tests": 20_000, "target_rhw": 0.001}
    alone = cornerforge.rate(**given)
    found = cornerforge.rate(**given, model_draws=DRAWS, out=tmp_path / "r")
    assert alone.model_uncertainty is None
    assert found.interval95 == alone.interval95
    model = found.model_uncertainty
    assert model is not None
    assert model.draws == DRAWS
    assert model.interval95[0] < found.interval95[0] < found.interval95[1] < model.interval95[1]
    assert model.interval95_per_mile is not None
    ratio = found.interval95_per_mile[1] / found.interval95[1]  # type: ignore[index]
    assert model.interval95_per_mile == pytest.approx([end * ratio for end in model.interval95])
    assert 0.0 <= model.cv_interval95[0] <= model.cv <= model.cv_interval95[1]
    assert model.tests_each == 16_384, "as many as give about 25 crashes"
    assert model.cost.tests == DRAWS * model.tests_each
    assert json.loads((tmp_path / "r" / "rate.json").read_text()) == json.loads(
        json.dumps(with_checksum(as_json(found)))
    )

    # A draw says which model it drove, and counts what this model's tests crash.
    kept = json.loads((tmp_path / "r" / "draws" / "0002.json").read_text())
    shipped = load_model(world["model"])
    assert kept["factors"]["lane_change.rate"] == {
        (v.part, v.field): v.factor for v in drawn_variations(shipped, 3, 2)
    }["lane_change", "rate"]  # fmt: skip
    save_model(drawn_model(shipped, 3, 2), tmp_path / "drawn.npz")
    seed = int(np.random.SeedSequence([3, 3, 2]).generate_state(1, np.uint64)[0] >> np.uint64(1))
    counted = cornerforge.simulate(**{**world, "model": tmp_path / "drawn.npz", "seed": seed}, tests=model.tests_each)
    assert kept["rate"] == pytest.approx(counted.crashes_per_test)
    assert counted.av_crashes > 0, "or the test shows nothing"


def test_draws_on_an_on_ramp_draw_its_laws_too(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {"av": world["av"], "road": "on-ramp", "seed": 3, "model": world["model"]}
    given |= {"method": "mc", "max_tests": 4_000, "target_rhw": 0.001, "model_draws": 5}

    def kept(name: str) -> list[dict[str, Any]]:
        cornerforge.rate(**given, out=tmp_path / name)
        return [json.loads(path.read_text()) for path in sorted((tmp_path / name / "draws").iterdir())]

    with_laws = kept("with")
    monkeypatch.setattr(model_draws, "drawn_laws", lambda *_: {})
    without = kept("without")
    for one, other in zip(with_laws, without, strict=True):
        laws = set(one["factors"]) - set(other["factors"])
        assert laws == {f"{row.part}.{row.field}" for row in LAWS}
        assert one["model_hash"] == other["model_hash"]
    assert [one["bv_crashes"] for one in with_laws] != [one["bv_crashes"] for one in without]
    monkeypatch.setattr(model_draws, "drawn_laws", drawn_laws)
    before = {**with_laws[2], "factors": without[2]["factors"], "bv_crashes": 10**6}  # of a version without laws
    write_object(tmp_path / "with" / "draws" / "0002.json", before)
    given["resume"] = True
    assert [one["bv_crashes"] for one in kept("with")] == [one["bv_crashes"] for one in with_laws], "driven again"


def test_a_stop_loses_one_draw_and_damage_is_told(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {**world, "method": "mc", "max_tests": 4_000, "target_rhw": 0.001, "model_draws": DRAWS}
    whole = cornerforge.rate(**given)
    driven: list[int] = []
    drive = model_draws._driven

    def stopped(run: Any, seed: int, k: int, *others: Any) -> Any:
        if len(driven) == 3:
            raise KeyboardInterrupt
        driven.append(k)
        return drive(run, seed, k, *others)

    monkeypatch.setattr(model_draws, "_driven", stopped)
    with pytest.raises(KeyboardInterrupt):
        cornerforge.rate(**given, out=tmp_path / "r")
    assert "model_uncertainty" not in json.loads((tmp_path / "r" / "rate.json").read_text())
    assert len(list((tmp_path / "r" / "draws").iterdir())) == 3
    monkeypatch.setattr(model_draws, "_driven", drive)
    again: list[int] = []

    def noted(run: Any, seed: int, k: int, *others: Any) -> Any:
        again.append(k)
        return drive(run, seed, k, *others)

    monkeypatch.setattr(model_draws, "_driven", noted)
    resumed = cornerforge.rate(**given, out=tmp_path / "r", resume=True)
    assert (driven, again) == ([0, 1, 2], [3, 4, 5])
    assert untimed(resumed) == untimed(whole)
    more = cornerforge.rate(**{**given, "model_draws": DRAWS + 1}, out=tmp_path / "r", resume=True)
    assert again[-1] == DRAWS
    assert more.model_uncertainty is not None
    assert more.model_uncertainty.draws == DRAWS + 1

    place = tmp_path / "r" / "draws" / "0001.json"
    sound = json.loads(place.read_text())
    for content in ({}, {**sound, "rate": -1.0}):
        write_object(place, content)
        with pytest.raises(FileFormatError, match=r"0001\.json is damaged"):
            cornerforge.rate(**given, out=tmp_path / "r", resume=True)
    write_object(place, {**sound, "method": "splitting"})
    assert untimed(cornerforge.rate(**given, out=tmp_path / "r", resume=True)) == untimed(whole)


def test_drawn_models_grow_trees(world: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A network taught for the model in use grows those of others: rates agree with what their tests count."""
    given = {**world, "method": "splitting", "max_tests": 6_500, "target_rhw": 0.001}
    found = cornerforge.rate(**given, model_draws=DRAWS, out=tmp_path / "r")
    model = found.model_uncertainty
    assert model is not None
    assert model.tests_each == 500
    assert model.interval95[0] < found.interval95[0] < found.interval95[1] < model.interval95[1]
    one = cornerforge.rate(**given, model_draws=DRAWS, threads=1)
    assert untimed(one) == untimed(found)
    kept = [json.loads(path.read_text()) for path in sorted((tmp_path / "r" / "draws").iterdir())]
    shipped = load_model(world["model"])
    off = []
    for k, draw in enumerate(kept):
        save_model(drawn_model(shipped, 3, k), tmp_path / "drawn.npz")
        counted = cornerforge.simulate(**{**world, "model": tmp_path / "drawn.npz"}, tests=8_000)
        error = (draw["error"] ** 2 + counted.crashes_per_test / 8_000) ** 0.5
        off.append((draw["rate"] - counted.crashes_per_test) / error)
        assert draw["rate"] > 0.0
    assert max(map(abs, off)) < 6.0
    words = [f"--{name.replace('_', '-')}={value}" for name, value in given.items()]
    assert main(["rate", *words, f"--model-draws={DRAWS}", "--out", str(tmp_path / "r"), "--resume"]) in (0, 1)
    said = capsys.readouterr().out
    assert "With the model's own uncertainty: once in " in said
    assert f"{DRAWS} drawn models ({DRAWS}.0 effective: BVs must crash as people do), 500 trees each: " in said
    assert "so none is held to that" in said, "these drivers are reckless"


@pytest.mark.parametrize("method", ["mc", "splitting"])
@pytest.mark.usefixtures("in_memory")
def test_an_av_from_outside_drives_drawn_models_too(
    world: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    (tmp_path / "outside.py").write_text(
        "import numpy as np\n\n\nclass Still:\n    def act(self, view):\n        return np.zeros((len(view), 2))\n"
    )
    monkeypatch.chdir(tmp_path)
    most = 3_000 if method == "mc" else 1_400
    monkeypatch.setattr(importlib.import_module("cornerforge.verbs.rate"), "PLAIN_TESTS", 400)
    monkeypatch.setattr(model_draws, "_TREES_EACH", 60)
    found = cornerforge.rate(
        **{**world, "av": "outside:Still"}, method=method, max_tests=most, target_rhw=0.001, model_draws=5,
        out=tmp_path / "r",
    )  # fmt: skip
    assert found.method == method
    assert found.model_uncertainty is not None
    assert found.model_uncertainty.draws == 5
    rates = {json.loads(path.read_text())["rate"] for path in (tmp_path / "r" / "draws").iterdir()}
    assert len(rates) == 5, "each model is another one"


def test_the_text_says_what_the_interval_leaves_out(world: dict[str, Any]) -> None:
    found = cornerforge.rate(**world, method="mc", max_tests=2_000, target_rhw=0.001)
    (line,) = model_text(found)
    assert "sampling alone" in line
    assert "--model-draws 30" in line
    assert model_text(replace(found, crashes_per_test=0.0)) == []


def test_no_crash_no_draws(tmp_path: Path) -> None:
    found = cornerforge.rate(method="mc", max_tests=500, model_draws=DRAWS, out=tmp_path / "r")
    assert found.crashes_per_test == 0.0
    assert found.model_uncertainty is None
    assert not (tmp_path / "r" / "draws").exists()


def test_what_cannot_be_drawn_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    by_hand = replace(load_model(default_model_path()), lc_base=np.full(21, 0.2, dtype=np.float32))
    save_model(by_hand, tmp_path / "by_hand.npz")
    for wrong, words in (
        ({"model_draws": 3}, "model_draws = 3"),
        ({"model_draws": -1}, "model_draws"),
        ({"model_draws": 30, "model": tmp_path / "by_hand.npz"}, "lc_base is not what its provenance says"),
        (
            {"model_draws": 30, "model": replace(by_hand, provenance={"format": "ivbss"})},
            "leave out --model-draws",
        ),
    ):
        given: dict[str, Any] = {"max_tests": 500, "out": tmp_path / "r", **wrong}
        with pytest.raises(InputError, match=words):
            cornerforge.rate(**given)
        assert not (tmp_path / "r").exists()
