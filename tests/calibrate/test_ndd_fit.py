"""The fit: data move the table, no data leave the prior, the same files give the same bytes, damage is named."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from cornerforge._checksums import write_arrays
from cornerforge.errors import DataError, FileFormatError, InputError, OutputError
from cornerforge.ext.calibrate.decisions import Decisions, concatenate
from cornerforge.ext.calibrate.fit import _calmed
from cornerforge.ext.calibrate.laws import FollowingLaw, LogLaw
from cornerforge.ext.calibrate.prior import SafeLaw, following_prior
from cornerforge.ext.calibrate.scores import grid_place, table_log_likelihood
from cornerforge.ndd import default_model_path, fit_model, load_model, model_hash, save_model, write_fit_report
from cornerforge.ndd.model import NddModel
from cornerforge.results import as_json
from cornerforge.types import ACCELERATIONS

HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"


def pairs_file(path: Path, followers: int = 60, seed: int = 1) -> Path:
    """Followers at about 25 m/s, each 12 s long, with accelerations drawn anew each second."""
    rng = np.random.default_rng(seed)
    rows = []
    for follower in range(followers):
        speed, gap, lead = rng.uniform(22.0, 28.0), rng.uniform(45.0, 75.0), 25.0
        split = "test" if follower % 5 == 0 else "train"
        for i in range(121):
            if i % 10 == 0:
                acceleration = 0.1 * (lead - speed) + 0.3 * rng.standard_normal()
            rows.append(f"1,{follower},999,{0.1 * i:.1f},{speed:.5f},{lead:.1f},{gap:.5f},{split}")
            gap += 0.1 * (lead - speed)
            speed += 0.1 * acceleration
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


def steady_file(path: Path, followers: int) -> Path:
    """Followers that hold 25 m/s, 40 m behind a leader of 25 m/s: one state only, always the same decision."""
    rows = [f"1,{f},999,{0.1 * i:.1f},25.0,25.0,40.0,train" for f in range(followers) for i in range(121)]
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


STEADY = (5, 40, 10)
HOLD = int(np.flatnonzero(ACCELERATIONS == 0.0)[0])


def test_data_move_the_table_by_the_stated_strength_and_leave_the_rest(tmp_path: Path) -> None:
    path = steady_file(
        tmp_path / "s.csv", followers=10
    )  # 120 decisions: too few to fit a law, which stays the shipped one
    model, report = fit_model([path], "pairs", prior_strength=120.0)
    prior = following_prior(SafeLaw(LogLaw()))
    wanted = (prior[STEADY] + np.eye(31)[HOLD]) / 2.0
    np.testing.assert_allclose(model.following[STEADY], wanted, atol=1e-3)
    others = np.ones(prior.shape[:3], dtype=bool)
    others[STEADY] = False
    np.testing.assert_allclose(model.following[others], prior[others], atol=1e-3)
    assert ((model.following[others] > 0) == (prior[others] > 0)).all()
    assert (report.states, report.decisions_on_grid) == (1, 120)
    assert "Only 120" in report.parts[0].why
    assert "80 too few" in report.parts[0].why


def test_a_stronger_prior_moves_less(tmp_path: Path) -> None:
    path = steady_file(tmp_path / "s.csv", followers=10)
    held = [
        float(fit_model([path], "pairs", prior_strength=strength)[0].following[STEADY][HOLD])
        for strength in (1.0, 100.0, 1e4)
    ]
    assert held[0] > 0.99
    assert held[0] > held[1] > held[2]


def test_what_was_observed_is_possible_even_outside_the_priors_support(tmp_path: Path) -> None:
    rows = [f"1,1,999,{0.1 * i:.1f},{max(30.0 - 0.38 * i, 0.0):.3f},40.0,100.0,train" for i in range(21)]
    path = tmp_path / "hard.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    model, _ = fit_model([path], "pairs")
    prior = following_prior(SafeLaw(LogLaw()))
    place = (10, 100, 18)  # 30 m/s, 100 m, opening by 10 (grid: 8) m/s: nobody brakes by 3.8 m/s2 here
    assert prior[place][1] == 0.0
    assert model.following[place][1] == pytest.approx(1.0 / 201.0, rel=1e-3)


@pytest.mark.full
def test_the_report_counts_and_scores(tmp_path: Path) -> None:
    path = pairs_file(tmp_path / "p.csv")
    said: list[str] = []
    model, report = fit_model([path], "pairs", progress=said.append)
    told = json.loads(json.dumps(as_json(report)))
    assert (told["rows_read"], told["rows_used"], told["bad_rows"]) == (7260, 7260, {"p.csv": {}})
    score = told["held_out_log_likelihood"]["p.csv"]
    assert score["decisions"] == 12 * 12
    assert score["log"] > score["idm"] > score["uniform"]
    assert score["uniform"] == pytest.approx(-3.434, abs=1e-3)
    assert 0.0 < report.data_share_of_states < report.data_share_where_data < 1.0
    assert len(said) >= 3
    assert model.provenance["files"][0]["decisions_held_out"] == 12 * 12  # type: ignore[index]


@pytest.mark.full
def test_test_rows_never_reach_the_fit(tmp_path: Path) -> None:
    path = pairs_file(tmp_path / "p.csv")
    lines = path.read_text().splitlines()
    model, _ = fit_model([path], "pairs")
    path.write_text("\n".join(line for line in lines if not line.endswith("test")) + "\n")
    assert model_hash(fit_model([path], "pairs")[0]) == model_hash(model)


@pytest.mark.full
def test_a_second_fit_gives_the_same_bytes_whatever_the_order(tmp_path: Path) -> None:
    first, second = pairs_file(tmp_path / "a.csv", 30), pairs_file(tmp_path / "b.csv", 30, seed=2)
    digests = set()
    for number, paths in enumerate(([first, second], [second, first])):
        out = tmp_path / f"model{number}.npz"
        model, report = fit_model(paths, "pairs")
        save_model(model, out)
        write_fit_report(report, model, out.with_suffix(".html"))
        pages = out.with_suffix(".html").read_bytes()
        digests.add((hashlib.sha256(out.read_bytes()).hexdigest(), hashlib.sha256(pages).hexdigest()))
        assert str(tmp_path).encode() not in pages
    assert len(digests) == 1
    assert str(tmp_path) not in json.dumps(dict(load_model(out).provenance))


@pytest.mark.full
def test_drivers_without_noise_give_a_model_and_a_warning(tmp_path: Path) -> None:
    """As in simulated trajectories: the fitted spread is far below a step between two accelerations."""
    rows = []
    for follower in range(30):
        speed, gap, lead = 22.0 + 0.2 * follower, 30.0 + follower, 25.0
        for tick in range(201):
            rows.append(f"1,{follower},999,{0.1 * tick:.1f},{speed:.5f},{lead},{gap:.5f},train")
            acceleration = LogLaw().mean(np.array([speed]), np.array([gap]), np.array([lead - speed]))[0]
            speed, gap = speed + 0.1 * acceleration, gap + 0.1 * (lead - speed)
    path = tmp_path / "clean.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    model, report = fit_model([path], "pairs")
    np.testing.assert_allclose(model.following.sum(axis=-1), 1.0, atol=1e-3)
    assert any("far less than drivers do" in note for note in report.notes)


def test_nothing_to_fit_on_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one"):
        fit_model([], "pairs")
    path = steady_file(tmp_path / "s.csv", 1)
    with pytest.raises(InputError, match="same file"):
        fit_model([path, path], "pairs")
    with pytest.raises(InputError, match="prior_strength"):
        fit_model([path], "pairs", prior_strength=0.0)
    path.write_text(path.read_text().replace("train", "test"))
    with pytest.raises(DataError, match=r"No decision is left.* make 12 decision.s., all held out"):
        fit_model([path], "pairs")
    alone = tmp_path / "alone.csv"
    alone.write_text(
        "track,leader_track,t_s,y_m,spacing_m\n" + "".join(f"1,77,{k / 10},{2.5 * k},30\n" for k in range(200))
    )
    with pytest.raises(DataError, match=r"200 usable of 200 row.s. make no decision.*leader's rows in the same file"):
        fit_model([alone], "tracks")


def shipped() -> NddModel:
    return load_model(default_model_path())


def test_the_shipped_model_loads_and_keeps_its_promises() -> None:
    model = shipped()
    assert default_model_path().stat().st_size < 5_000_000
    np.testing.assert_allclose(model.following.sum(axis=-1, dtype=np.float64), 1.0, atol=1e-6)
    assert (model.following == 0.0).mean() > 0.2
    assert (model.overlook, model.overlook_conflict) == (8e-4, 1e-4)
    text = json.dumps(dict(model.provenance))
    assert "NGSIM, US DOT FHWA" in text
    assert "/" not in "".join(file["name"] for file in model.provenance["files"])  # type: ignore[attr-defined]


def test_the_shipped_model_was_made_from_the_shared_files() -> None:
    folder = Path(__file__).parents[3] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the trajectory files are not here")
    for file in shipped().provenance["files"]:  # type: ignore[attr-defined]
        assert hashlib.sha256((folder / file["name"]).read_bytes()).hexdigest() == file["sha256"]


def test_a_model_comes_back_as_it_was_saved(tmp_path: Path) -> None:
    model = shipped()
    save_model(model, tmp_path / "m.npz")
    again = load_model(tmp_path / "m.npz")
    assert model_hash(again) == model_hash(model)
    assert again.provenance == model.provenance
    assert again.initial == model.initial


# NumPy itself leaves the file open when what should be an archive is none.
def test_damaged_foreign_and_missing_models_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"No model file .*none\.npz"):
        load_model(tmp_path / "none.npz")
    whole = default_model_path().read_bytes()
    for name, content in (("cut.npz", whole[: len(whole) // 2]), ("text.npz", b"hello"), ("empty.npz", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileFormatError, match=name):
            load_model(tmp_path / name)
    write_arrays(tmp_path / "other.npz", {"header": np.array('{"schema_version": 99}')})
    with pytest.raises(FileFormatError, match="schema version 99"):
        load_model(tmp_path / "other.npz")


def test_a_report_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    model, report = fit_model([steady_file(tmp_path / "s.csv", 2)], "pairs")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"report\.html"):
        write_fit_report(report, model, tmp_path / "file" / "report.html")


def decisions(speed: list[float], gap: list[float], range_rate: list[float]) -> Decisions:
    n = len(speed)
    return Decisions(
        np.array(speed), np.array(gap), np.array(range_rate), np.zeros(n), np.arange(n), np.zeros(n, dtype=bool)
    )


def test_states_are_looked_up_as_the_simulator_does() -> None:
    some = decisions([19.5, 19.4, 30.0, 30.0, 30.0], [0.6, 50.0, 116.0, np.inf, 104.0], [0.5, 0.0, -10.0, 0.0, -20.0])
    speed, gap, range_rate, on_grid, is_free = grid_place(some)
    assert on_grid.tolist() == [True, False, True, True, True]
    assert is_free.tolist() == [False, False, True, True, False]
    assert (speed[0], gap[0], range_rate[0]) == (0, 1, 11)
    assert (gap[4], range_rate[4]) == (29, 0)  # 4 + 100 / 4 m at the grid's 10 m/s


def test_the_tables_score_is_the_mean_log_probability() -> None:
    model = shipped()
    some = decisions([30.0, 30.0, 10.0], [40.0, np.inf, 40.0], [0.0, 0.0, 0.0])
    score, n = table_log_likelihood(model, some)
    wanted = np.log(model.following[10, 40, 10, HOLD].astype(float)) + np.log(model.free[10, HOLD].astype(float))
    assert n == 2
    assert score == pytest.approx(wanted / 2.0)


def test_joined_decisions_keep_their_vehicles_apart() -> None:
    both = concatenate([decisions([1.0, 2.0], [9.0, 9.0], [0.0, 0.0]), decisions([3.0], [9.0], [0.0])])
    assert both.vehicle.tolist() == [0, 1, 2]
    assert both.speed.tolist() == [1.0, 2.0, 3.0]


def _motorway_drivers(calm: float, fast: int) -> Decisions:
    """10,000 decisions of a law at 18 m/s, and `fast` at 30 m/s of the same safe law with a share of its noise."""
    rng = np.random.default_rng(5)
    law = LogLaw()
    speed = np.concatenate([np.full(10_000, 18.0), np.full(fast, 30.0)])
    gap = speed * rng.uniform(1.0, 2.5, speed.size)
    range_rate = rng.normal(0.0, 0.8, speed.size)
    drives: FollowingLaw = SafeLaw(law, calm=calm)
    noise = rng.standard_t(law.degrees, speed.size) * drives.scale(speed, gap, range_rate)
    acceleration = drives.mean(speed, gap, range_rate) + noise
    return Decisions(speed, gap, range_rate, acceleration, np.arange(speed.size), np.zeros(speed.size, dtype=bool))


def test_noise_at_motorway_speeds_is_fitted_where_there_are_decisions() -> None:
    # At 2,000 decisions the standard error of a scale of Student-t noise is 2 %; twice that is the tolerance.
    for calm in (0.64, 1.1):
        found, n = _calmed(SafeLaw(LogLaw()), _motorway_drivers(calm, 2000))
        assert found.calm == pytest.approx(calm, rel=0.04)
        assert n == 2000


def test_with_few_fast_decisions_the_prior_says_how_calm_motorways_are() -> None:
    assert _calmed(SafeLaw(LogLaw()), _motorway_drivers(1.1, 199)) == (SafeLaw(LogLaw()), 0)
