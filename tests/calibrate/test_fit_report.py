"""The fit report: what is data and what is prior, a map of what was counted, and what other choices would change."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.ext.calibrate.lane_fit import not_fitted
from cornerforge.ext.calibrate.parts import FITTED, PRIOR
from cornerforge.ext.calibrate.sensitivity import fit_sensitivity, traffic_crashes
from cornerforge.ext.calibrate.shown import counted_states
from cornerforge.ndd import FitReport, write_fit_report
from cornerforge.ndd.model import NddModel
from cornerforge.results.naturalistic import FittedPart, FitTraffic, FitVariant

PARTS = (
    FittedPart(name="car-following law", source=FITTED, why="1,234 decisions <all>"),
    FittedPart(name="memory", source=PRIOR, why="Smoothing."),
)
HEADER = "track,leader_track,t_s,y_m,spacing_m"


def report_of(model: NddModel, sensitivity: tuple[FitVariant, ...] = ()) -> FitReport:
    stated = counted_states(model)
    counted = np.zeros((21, 116, 19), dtype=np.int64) if stated is None else stated
    return FitReport(
        rows_read=100, rows_used=99, bad_rows={}, decisions_fitted=1234, decisions_on_grid=int(counted.sum()),
        states=int((counted > 0).sum()), states_total=counted.size, data_share_of_states=8e-5,
        data_share_where_data=0.01, speed_99_percent=22.5, held_out_log_likelihood={}, notes=("A note.",),
        parts=PARTS, sensitivity=sensitivity, lane_changes=not_fitted("no file was looked at"),
    )  # fmt: skip


def page_of(model: NddModel, path: Path, sensitivity: tuple[FitVariant, ...] = ()) -> str:
    write_fit_report(report_of(model, sensitivity), model, path)
    return path.read_text(encoding="utf-8")


def test_the_page_says_what_is_data_what_is_prior_and_where_it_extrapolates(model: NddModel, tmp_path: Path) -> None:
    page = page_of(model, tmp_path / "r.html")
    counted = counted_states(model)
    assert counted is not None
    fastest = 20 + int(np.flatnonzero(counted.sum(axis=(1, 2)))[-1])
    assert f"No decision at all was counted above {fastest} m/s" in page
    assert "<td>car-following law</td><td>fitted</td><td>1,234 decisions &lt;all&gt;</td>" in page
    assert "<td>memory</td><td>prior</td><td>Smoothing.</td>" in page
    assert "Not fitted: no file was looked at." in page
    assert page.count("<img ") == 1
    assert "Not studied for this fit" in page
    assert "src=" not in page.replace('src="data:', "")


def test_the_same_numbers_give_the_same_bytes(model: NddModel, tmp_path: Path) -> None:
    assert page_of(model, tmp_path / "a.html") == page_of(model, tmp_path / "b.html")


def test_a_model_without_counts_and_a_machine_without_matplotlib_still_get_a_page(
    model: NddModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = page_of(replace(model, provenance={}), tmp_path / "bare.html")
    assert "0 decisions were counted" in bare
    assert "No decision at all" not in bare
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    page = page_of(model, tmp_path / "plain.html")
    assert "<img " not in page
    assert "No map: This needs matplotlib" in page


def tracks_file(path: Path) -> Path:
    """Forty pairs at about 25 m/s, 20 s at 10 Hz with noisy positions, half of them late in the recording."""
    rng = np.random.default_rng(1)
    rows = []
    for pair in range(40):
        start = 0.0 if pair < 20 else 30.0
        lead, follow, speed, acceleration = 0.0, -45.0, 25.0, 0.0
        for tick in range(201):
            t = start + tick / 10.0
            if tick % 10 == 0:
                acceleration = 0.3 * (25.0 - speed) + 0.4 * rng.standard_normal()
            speed += 0.1 * acceleration
            lead += 2.5
            follow += 0.1 * speed
            noisy = follow + 0.1 * rng.standard_normal()
            rows.append(f"{2 * pair},,{t:.1f},{lead:.4f},")
            rows.append(f"{2 * pair + 1},{2 * pair},{t:.1f},{noisy:.4f},{lead - noisy:.4f}")
    rows.sort(key=lambda row: (int(row.split(",")[0]), float(row.split(",")[2])))
    path.write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[FitVariant, ...]:
    path = tracks_file(tmp_path_factory.mktemp("t") / "t.csv")
    return fit_sensitivity([path], "tracks", strengths=[50.0, 200.0], window_factors=[0.6])


@pytest.mark.full
def test_a_study_fits_each_choice_once_and_scores_the_same_decisions(study: tuple[FitVariant, ...]) -> None:
    assert [row.variant for row in study] == ["as fitted", "prior strength 50", "smoothing windows x 0.6"]
    for row in study:
        assert set(row.held_out) == {"t.csv"}
        assert all(value < 0.0 for value in vars(row.held_out["t.csv"]).values())
        assert all(sd > 0.0 for _, sd in row.probes)
    fitted, weaker = (study[k].held_out["t.csv"] for k in (0, 1))
    assert weaker.law == fitted.law  # the prior's strength does not move the law, only the table
    assert weaker.table != fitted.table


@pytest.mark.full
def test_a_shorter_window_leaves_more_noise_in_the_spread(study: tuple[FitVariant, ...]) -> None:
    sd = {row.variant: row.probes[0][1] for row in study}
    assert sd["smoothing windows x 0.6"] > sd["as fitted"]


@pytest.mark.full
def test_the_page_shows_the_study(model: NddModel, study: tuple[FitVariant, ...], tmp_path: Path) -> None:
    page = page_of(model, tmp_path / "s.html", study)
    assert "Not studied" not in page
    for row in study:
        assert row.variant in page
    assert f"{study[0].held_out['t.csv'].law:.3f}" in page


def test_held_out_scores_are_told_by_law_and_speed(model: NddModel, tmp_path: Path) -> None:
    row = {"decisions": 300, "uniform": -3.434, "log": -2.1, "idm": -2.2, "model": -2.11}
    fast = {"table_decisions": 40, "table": -2.345, "log_on_grid": -2.3, "idm_on_grid": -2.4, "model_on_grid": -2.35}
    report = replace(report_of(model), held_out_log_likelihood={"slow.csv": row, "fast.csv": {**row, **fast}})
    write_fit_report(report, model, tmp_path / "h.html")
    page = (tmp_path / "h.html").read_text(encoding="utf-8")
    slow, both = page.split("fast.csv")
    assert "fitted stochastic IDM</td><td>-2.200</td></tr>" in slow
    assert "fitted stochastic IDM</td><td>-2.200</td><td>-2.400</td>" in both
    assert "table, with the counts</td><td></td><td>-2.345</td>" in both
    assert "all 300 decisions" in slow
    assert "table, with the counts" not in slow
    assert "the 40 from 19.5 m/s" in both


@pytest.mark.full
def test_a_driven_study_says_how_far_the_crash_rate_moves(model: NddModel, tmp_path: Path) -> None:
    driven: list[NddModel] = []

    def drive(name: str, variant: NddModel) -> FitTraffic:
        driven.append(variant)
        return traffic_crashes(name, variant, tests=512)

    path = tracks_file(tmp_path / "t.csv")
    study = fit_sensitivity([path], "tracks", strengths=[50.0], window_factors=[], drive=drive)
    assert [row.variant for row in study] == [
        "as fitted", "prior strength 50", "overlooking x 0", "overlooking x 10",
    ]  # fmt: skip
    assert [v.overlook / driven[0].overlook for v in driven] == pytest.approx([1.0, 1.0, 0.0, 10.0])
    assert [v.overlook_conflict / driven[0].overlook_conflict for v in driven] == pytest.approx([1.0, 1.0, 0.0, 10.0])
    traffic = study[0].traffic
    assert traffic is not None
    assert traffic.tests == 512
    assert traffic.bv_miles == pytest.approx(512 * 5.0, rel=0.2)  # 20 BVs for 400 m; the AV drives about as they do
    assert traffic.av_interval95[0] <= traffic.av_crashes_per_test <= traffic.av_interval95[1]
    assert traffic.bv_interval95[0] <= traffic.bv_crashes_per_mile <= traffic.bv_interval95[1]
    page = page_of(model, tmp_path / "d.html", study)
    assert "How far the crash rate moves" in page
    assert page.count("in 512 tests") == 4
