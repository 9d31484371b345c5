"""The whole analysis on crashes of planted kinds, on structureless ones and on degenerate input."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from cornerforge.analysis import CRASH_TYPES, analyse
from cornerforge.errors import InputError, MissingExtraError

KINDS = ("swerve from the left", "AV into a slower one", "BV from behind")
SHARES = (0.6, 0.3, 0.1)


def crashes(n: int, kinds: tuple[int, ...] = (0, 1, 2), seed: int = 0) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Crashes of constant velocity, driven backwards from a contact; returns ids, histories and the planted kind."""
    rng = np.random.default_rng(seed)
    weight = np.array(SHARES)[list(kinds)]
    kind = rng.choice(kinds, n, p=weight / weight.sum())
    is_swerve, is_rammed = kind == 0, kind == 2
    contact_x = np.where(is_swerve, rng.uniform(-1.0, 1.0, n), np.where(is_rammed, -4.8, 4.8))
    contact_y = np.where(is_swerve, 1.95, rng.normal(0.0, 0.1, n))
    closing = np.where(is_swerve, 0.0, np.where(is_rammed, 8.0, -8.0)) + rng.normal(0.0, 0.5, n)
    drift = np.where(is_swerve, rng.normal(1.5, 0.1, n), 0.0)
    av_speed = rng.normal(30.0, 1.0, n)
    k = np.arange(16.0)
    history = np.zeros((n, 16, 2, 4))
    history[:, :, 0, 0] = 800.0 - av_speed[:, None] * k
    history[:, :, 0, 1] = 6.0
    history[:, :, 0, 2] = av_speed[:, None]
    history[:, :, 1, 0] = history[:, :, 0, 0] + contact_x[:, None] - closing[:, None] * k
    history[:, :, 1, 1] = 6.0 + contact_y[:, None] + drift[:, None] * np.minimum(k, 2.0)
    history[:, :, 1, 2] = (av_speed + closing)[:, None]
    history[:, :, 1, 3] = np.where(k < 2, -np.arctan2(drift, av_speed + closing)[:, None], 0.0)
    return [f"{seed}:{i}" for i in range(n)], history, kind


def test_planted_kinds_are_found() -> None:
    ids, history, kind = crashes(900)
    result = analyse(ids, history)
    assert result.note is None
    cluster_of_kind = [np.bincount(result.cluster_index[kind == k]).argmax() for k in range(3)]
    assert len(set(cluster_of_kind)) == 3
    for k, index in enumerate(cluster_of_kind):
        assert (kind[result.cluster_index == index] == k).mean() > 0.99
        assert (result.cluster_index[kind == k] == index).mean() > 0.8
    expected = {0: "sideswipe", 1: "rear-end by AV", 2: "rear-end by BV"}
    assert result.crash_types.names == [expected[k] for k in kind.tolist()]


def test_crash_types_take_each_vehicles_own_size() -> None:
    ids, history, kind = crashes(60, kinds=(1, 2))
    away = np.where(kind == 1, 5.75, -5.75)  # half of what a truck is longer
    trucks = history.copy()
    trucks[:, :, 1, 0] += away[:, None]
    length = np.tile([5.0, 16.5], (60, 1))
    cars = analyse(ids, history).crash_types.names
    found = analyse(ids, trucks, vehicle_length=length, vehicle_width=np.tile([2.0, 2.55], (60, 1)))
    assert found.crash_types.names == cars
    trucks[:7, 5:] = np.nan  # shorter cases are left out together with their sizes
    length[:7, 1] = 5.0
    kept = analyse(
        ids, trucks, steps=6, vehicle_length=length, vehicle_width=np.tile([2.0, 2.55], (60, 1)), short="exclude"
    )
    assert kept.crash_types.names == cars[7:]
    with pytest.raises(InputError, match="m apart at the contact"):
        analyse(ids, trucks)


def test_planted_outliers_are_rare_and_farthest_first() -> None:
    ids, history, _ = crashes(600)
    history[100, 1:, 1, 0] -= 60.0
    history[200, 1:, 0, 3] = 0.5
    result = analyse(ids, history)
    assert {"0:100", "0:200"} <= set(result.rare[:2])
    assert not result.is_majority[[100, 200]].any()


def test_structureless_crashes_are_one_cluster_of_the_majority() -> None:
    ids, history, _ = crashes(800, kinds=(1,))
    result = analyse(ids, history)
    assert result.is_majority.mean() > 0.95
    assert [one.group for one in result.clusters].count("majority") == 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("steps", [1, 5, 15])
def test_json_agrees_with_itself_and_with_the_points(steps: int) -> None:
    ids, history, _ = crashes(400)
    history[::3, 4:] = np.nan
    result = analyse(ids, history, steps=steps)
    found = json.loads(json.dumps(result.to_json(), allow_nan=False))
    points = result.points
    assert found["cases"] == 400 == found["majority"] + found["minority"]
    assert found["padded"] == (134 if steps > 3 else 0)
    assert len(found["features"]) == 5 * steps == len(found["loadings"])
    assert 0.0 < sum(found["explained_variance"]) <= 1.0 + 1e-12
    assert list(found["crash_types"]) == list(CRASH_TYPES.values())
    assert sum(found["crash_types"].values()) == sum(found["striker"].values()) == 400
    assert {"features", "pca", "dbscan", "kmeans", "valuable", "total"} <= set(found["seconds"])
    assert [c["id"] for c in found["clusters"]] == list(range(len(found["clusters"])))
    for one in found["clusters"]:
        members = points["cluster"] == one["id"]
        assert one["size"] == members.sum() == sum(one["crash_types"].values())
        assert set(points["group"][members]) == {one["group"]}
        assert set(one["typical"]) <= set(points["case_id"][members])
        assert len(one["typical"]) == min(3, one["size"])


@pytest.mark.full
def test_same_input_same_answer_and_order_of_cases_does_not_matter_to_the_split() -> None:
    ids, history, _ = crashes(500)
    one, other = analyse(ids, history).to_json(), analyse(ids, history).to_json()
    assert one.pop("seconds").keys() == other.pop("seconds").keys()
    assert one == other
    order = np.random.default_rng(1).permutation(500)
    shuffled = analyse([ids[i] for i in order], history[order])
    assert dict(zip(shuffled.case_ids, shuffled.is_majority, strict=True)) == dict(
        zip(ids, analyse(ids, history).is_majority, strict=True)
    )


@pytest.mark.parametrize("n", [1, 2, 9])
def test_few_cases_are_one_cluster_with_a_note(n: int) -> None:
    ids, history, _ = crashes(n)
    found = analyse(ids, history).to_json()
    assert f"Only {n} case(s)" in found["note"]
    assert (found["majority"], found["minority"], found["rare"], found["eps"]) == (n, 0, [], None)
    assert [(c["size"], c["group"], len(c["typical"])) for c in found["clusters"]] == [(n, "majority", min(n, 3))]
    json.dumps(found, allow_nan=False)


def test_identical_cases_are_one_cluster_with_a_note() -> None:
    _, history, _ = crashes(1)
    found = analyse([str(i) for i in range(50)], np.repeat(history, 50, axis=0)).to_json()
    assert "same features" in found["note"]
    assert [c["typical"] for c in found["clusters"]] == [["0", "1", "2"]]
    assert found["explained_variance"] == [0.0, 0.0]


def test_cases_on_one_line_do_not_break_the_triangulation() -> None:
    _, history, _ = crashes(1)
    history = np.repeat(history, 60, axis=0)
    history[:, 1, 1, 0] += np.linspace(0.0, 3.0, 60)
    result = analyse([str(i) for i in range(60)], history)
    assert result.is_majority.mean() > 0.9


def test_cases_that_crash_at_once_and_excluded_ones() -> None:
    ids, history, _ = crashes(30)
    history[:12, 1:] = np.nan
    assert analyse(ids, history).to_json()["padded"] == 12
    excluded = analyse(ids, history, short="exclude")
    assert excluded.case_ids == tuple(ids[12:])
    assert (excluded.to_json()["cases"], excluded.to_json()["excluded"]) == (18, 12)
    history[:, 1:] = np.nan
    with pytest.raises(InputError, match="No case lasts 1 s"):
        analyse(ids, history, short="exclude")


def test_bad_input_is_named() -> None:
    ids, history, _ = crashes(3)
    with pytest.raises(InputError, match="no cases to analyse"):
        analyse([], history[:0])
    with pytest.raises(InputError, match="2 case ids for 3 histories"):
        analyse(ids[:2], history)
    with pytest.raises(InputError, match="1 case ids occur more than once"):
        analyse([ids[0], ids[0], ids[2]], history)
    with pytest.raises(InputError, match="seed = -1"):
        analyse(ids, history, seed=-1)


def test_missing_scikit_learn_names_its_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    ids, history, _ = crashes(3)
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(MissingExtraError, match=r'pip install "cornerforge\[analysis\]"'):
        analyse(ids, history)


def test_importing_the_package_does_not_import_scikit_learn() -> None:
    code = "import sys, cornerforge.analysis; sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
