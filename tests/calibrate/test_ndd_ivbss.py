"""Import of the published arrays: every documented form, the way back from our own model, and damage named."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import FileFormatError
from cornerforge.ext.calibrate.ivbss import import_arrays
from cornerforge.ext.calibrate.ivbss_initial import fit_gaps, fit_speeds, gap_law, speed_law
from cornerforge.ext.calibrate.ivbss_tables import checked_cumulative, checked_rows
from cornerforge.ndd import default_model_path, load_model
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import GAPS, RANGE_RATES, NddModel
from cornerforge.results.naturalistic import ImportReport

Floats = NDArray[np.float64]
STATES = GAPS.size * RANGE_RATES.size


@pytest.fixture(scope="module")
def ours() -> NddModel:
    return load_model(default_model_path())


@pytest.fixture(scope="module")
def other(ours: NddModel) -> NddModel:
    """A model unlike the shipped one in all that can be imported: it stands for the authors' data."""
    rng = np.random.default_rng(7)
    following = rng.dirichlet(np.full(31, 0.5), size=(21, 116, 19)).astype(np.float32)
    accept = rng.uniform(0.0, 1.0, (2, 116, 19)).astype(np.float32)
    initial = replace(
        ours.initial,
        speed_mean=28.5,
        stream_sd=0.0,
        speed_sd=3.0,
        time_gap_shift=0.0,
        time_gap_median=1.3,
        time_gap_sigma=0.5,
        rr_scale=1.1,
        rr_exponent=0.4,
    )
    return replace(
        ours,
        following=following,
        free=rng.dirichlet(np.full(31, 0.5), size=21).astype(np.float32),
        lc_base=rng.uniform(0.001, 0.02, 21).astype(np.float32),
        lc_desire=rng.uniform(0.2, 5.0, (116, 19)).astype(np.float32),
        lc_accept_lead=accept[0],
        lc_accept_rear=accept[1],
        initial=initial,
    )


def with_keep(change: Floats, sides: int = 1) -> Floats:
    """(change, keep), or (left, keep, right)."""
    keep = 1.0 - sides * change
    return np.stack([change, keep] if sides == 1 else [change, keep, change], axis=-1)


def coordinate_list(path: Path, coords: Any, change: Floats, shape: tuple[int, ...]) -> None:
    """As the package `sparse` writes a table of the last axis (change, keep)."""
    n = change.size
    both = np.concatenate([np.vstack([coords, np.full(n, k)]) for k in (0, 1)], axis=1)
    data = np.concatenate([change, 1.0 - change])
    np.savez_compressed(path, coords=both, data=data, shape=np.array((*shape, 2)), fill_value=np.array(0.0))


def some_cells(model: NddModel, accept: NDArray[np.float32], seed: int) -> tuple[Any, Floats]:
    """Cells (speed, leader, neighbour): all states of the neighbour, each with 3 speeds and leaders drawn."""
    rng = np.random.default_rng(seed)
    second = np.repeat(np.arange(STATES), 3)
    speed, first = rng.integers(0, 21, second.size), rng.integers(0, STATES, second.size)
    wish = model.lc_base.astype(float)[speed] * model.lc_desire.astype(float).reshape(-1)[first]
    cells = np.stack([speed, *np.divmod(first, 19), *np.divmod(second, 19)])
    return cells, wish * accept.astype(float).reshape(-1)[second]


def exported(model: NddModel, folder: Path) -> Path:
    """A model as the published arrays, by the documented definitions."""
    for name in ("CF", "FF", "LC", "Initialization"):
        (folder / name).mkdir(parents=True)
    np.save(folder / "CF" / "Optimized_CF_pdf_array.npy", np.moveaxis(model.following.astype(float), 0, 2))
    np.save(folder / "FF" / "Optimized_FF_pdf_array.npy", model.free.astype(float))
    alone = model.lc_base.astype(float)[:, None, None] * model.lc_desire.astype(float)
    places = np.indices(alone.shape).reshape(3, -1)
    coordinate_list(folder / "LC" / "10106_10620_OL_pdf_smoothed_tmp.npz", places, alone.reshape(-1), alone.shape)
    shape = (21, 116, 19, 116, 19)
    for kind, accept, seed in (("SLC", model.lc_accept_lead, 1), ("CI", model.lc_accept_rear, 2)):
        coordinate_list(folder / "LC" / f"10119_10630_{kind}_pdf_tmp.npz", *some_cells(model, accept, seed), shape)
    cells, _ = some_cells(model, model.lc_accept_rear, 3)
    lead, rear = cells[1] * 19 + cells[2], cells[3] * 19 + cells[4]
    both = model.lc_base[cells[0]] * model.lc_accept_lead.reshape(-1)[lead] * model.lc_accept_rear.reshape(-1)[rear]
    coordinate_list(folder / "LC" / "10119_10630_DLC_pdf_tmp.npz", cells, 0.5 * both.astype(float), shape)
    np.save(folder / "Initialization" / "speed_CDF.npy", np.cumsum(speed_law(model.initial)))
    joint = gap_law(model.initial).reshape(21, STATES)
    np.save(folder / "Initialization" / "Optimized_presum_list_forward.npy", np.cumsum(joint, axis=1))
    return folder


@pytest.fixture(scope="module")
def published(other: NddModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(other, tmp_path_factory.mktemp("source") / "NDD_DATA")


@pytest.fixture(scope="module")
def imported(published: Path, ours: NddModel) -> tuple[NddModel, ImportReport]:
    return import_arrays(published.parent, ours)


def test_what_was_written_comes_back(imported: tuple[NddModel, ImportReport], other: NddModel, ours: NddModel) -> None:
    model, report = imported
    np.testing.assert_allclose(model.following, other.following, rtol=2e-6, atol=1e-9)
    np.testing.assert_allclose(model.free, other.free, rtol=2e-6, atol=1e-9)
    assert ((model.following > 0) == (other.following > 0)).all()
    product, wanted = (m.lc_base[:, None, None] * m.lc_desire for m in (model, other))
    np.testing.assert_allclose(product, wanted, rtol=1e-5)
    assert model.lc_desire.mean() == pytest.approx(ours.lc_desire.mean(), rel=1e-5)  # the scale is our own
    np.testing.assert_allclose(model.lc_accept_lead, other.lc_accept_lead, atol=1e-5)
    np.testing.assert_allclose(model.lc_accept_rear, other.lc_accept_rear, atol=1e-5)
    for name in ("speed_mean", "speed_sd", "time_gap_median", "time_gap_sigma", "rr_scale", "rr_exponent"):
        assert getattr(model.initial, name) == pytest.approx(getattr(other.initial, name), rel=2e-3), name
    assert report.missing == ()
    for role in ("lc_alone", "lc_lead", "lc_rear", "lc_both", "initial_speed", "initial_gap"):
        assert float(report.files[role]["misfit"]) < 1e-3, role
    assert report.files["following"]["empty"] == 0


def test_our_own_model_comes_back_table_for_table(ours: NddModel, tmp_path: Path) -> None:
    theirs = replace(
        ours.initial, stream_sd=0.0, speed_sd=3.3, time_gap_shift=0.0, desire_share=0.0, change_median=0.0,
        signal_share=1.0, noise_spread=0.0, vigilance_sigma=0.0,
    )  # fmt: skip
    ours = replace(ours, initial=theirs)
    model, _ = import_arrays(exported(ours, tmp_path / "NDD_DATA"), ours)
    np.testing.assert_array_equal(model.following, ours.following)
    np.testing.assert_array_equal(model.free, ours.free)
    for name in ("lc_base", "lc_desire", "lc_accept_lead", "lc_accept_rear"):
        np.testing.assert_allclose(getattr(model, name), getattr(ours, name), rtol=1e-5, atol=1e-7)
    for name, value in vars(ours.initial).items():
        assert getattr(model.initial, name) == pytest.approx(value, rel=2e-3), name


def test_the_other_names_axes_and_whole_tables_are_read_too(other: NddModel, ours: NddModel, tmp_path: Path) -> None:
    np.save(tmp_path / "CF_pdf_array.npy", other.following)  # our order of axes
    np.save(tmp_path / "FF_pdf_array.npy", other.free)
    change = other.lc_base.astype(float)[:, None, None] * other.lc_desire.astype(float)
    np.save(tmp_path / "Lane_change_no_adjacent_vehicle_pdf.npy", with_keep(change, sides=2))
    model, report = import_arrays(tmp_path, ours)
    np.testing.assert_array_equal(model.following, other.following)
    np.testing.assert_allclose(model.lc_base[:, None, None] * model.lc_desire, change, rtol=1e-5)
    np.testing.assert_array_equal(model.lc_accept_lead, ours.lc_accept_lead)
    assert model.initial.time_gap_sigma == ours.initial.time_gap_sigma
    # their drivers have no memory, no desired speeds, do not turn back, and no test has a stream of its own
    assert model.memory == Memory()
    assert (model.free_pull, model.initial.desire_share, model.initial.stream_sd) == (0.0, 0.0, 0.0)
    assert model.initial.speed_sd == pytest.approx(np.hypot(ours.initial.stream_sd, ours.initial.speed_sd))
    assert not model.lc_turn_back.any()
    assert (model.initial.change_median, model.initial.signal_share) == (0.0, 1.0)
    assert (model.initial.noise_spread, model.initial.vigilance_sigma) == (0.0, 0.0)
    assert (ours.overlook, model.overlook) == (8e-4, 1e-4)
    assert report.missing == ("lc_lead", "lc_rear", "lc_both", "initial_speed", "initial_gap")
    assert "lane changes: acceptance of the adjacent vehicle behind (no file)" in report.filled
    assert "start: speeds (no file)" in report.filled


def test_states_without_data_are_ours_and_counted(other: NddModel, ours: NddModel, tmp_path: Path) -> None:
    following = np.moveaxis(other.following.astype(float), 0, 2).copy()
    following[:50] = 0.0  # no data below 50 m
    np.save(tmp_path / "CF_pdf_array.npy", following)
    change = other.lc_base.astype(float)[:, None, None] * other.lc_desire.astype(float)
    table = with_keep(change)
    table[:4] = 0.0  # no data below 24 m/s,
    table[:, 100:] = 0.0  # and none from 100 m on
    np.save(tmp_path / "x_OL_pdf.npy", table)
    model, report = import_arrays(tmp_path, ours)
    np.testing.assert_array_equal(model.following[:, :50], ours.following[:, :50])
    np.testing.assert_allclose(model.following[:, 50:], other.following[:, 50:], rtol=2e-6, atol=1e-9)
    assert report.files["following"]["empty"] == 50 * 19 * 21
    np.testing.assert_array_equal(model.lc_base[:4], ours.lc_base[:4])
    np.testing.assert_array_equal(model.lc_desire[100:], ours.lc_desire[100:])
    np.testing.assert_allclose(model.lc_base[4:, None, None] * model.lc_desire[:100], change[4:, :100], rtol=1e-5)
    found = report.files["lc_alone"]
    assert (found["speeds_filled"], found["states_filled"], found["cells"]) == (4, 16 * 19, 17 * 100 * 19)
    assert "lane change, no adjacent vehicle: 304 state(s) without data" in report.filled


def test_a_table_that_is_no_product_keeps_its_sums_and_says_what_is_lost(ours: NddModel, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    change = rng.uniform(0.0, 0.05, (21, 116, 19))
    np.save(tmp_path / "OL_pdf.npy", with_keep(change))
    model, report = import_arrays(tmp_path, ours)
    product = model.lc_base.astype(float)[:, None, None] * model.lc_desire
    np.testing.assert_allclose(product.sum(axis=(1, 2)), change.sum(axis=(1, 2)), rtol=1e-5)
    np.testing.assert_allclose(product.sum(axis=0), change.sum(axis=0), rtol=1e-5)
    assert report.files["lc_alone"]["misfit"] == pytest.approx(np.abs(product - change).sum() / change.sum(), rel=1e-4)
    assert float(report.files["lc_alone"]["misfit"]) > 0.3


def test_an_acceptance_above_1_is_clipped_and_counted(ours: NddModel, tmp_path: Path) -> None:
    second = np.arange(STATES)
    cells = np.stack([np.full(STATES, 5), np.full(STATES, 30), np.full(STATES, 9), *np.divmod(second, 19)])
    wish = float(ours.lc_base[5]) * float(ours.lc_desire[30, 9])
    factor = np.where(second < 100, 3.0, 0.25)
    coordinate_list(tmp_path / "SLC_pdf.npz", cells, wish * factor, (21, 116, 19, 116, 19))
    model, report = import_arrays(tmp_path, ours)
    np.testing.assert_allclose(model.lc_accept_lead.reshape(-1)[:100], 1.0)
    np.testing.assert_allclose(model.lc_accept_lead.reshape(-1)[100:], 0.25, rtol=1e-5)
    assert report.files["lc_lead"]["clipped"] == 100


def test_a_table_of_no_lane_changes_makes_none(ours: NddModel, tmp_path: Path) -> None:
    np.save(tmp_path / "OL_pdf.npy", with_keep(np.zeros((21, 116, 19))))
    model, report = import_arrays(tmp_path, ours)
    assert (model.lc_base == 0.0).all()
    assert report.files["lc_alone"]["misfit"] == 0.0


# --- rows ---


def test_rows_near_1_are_divided_and_counted_and_far_ones_refused() -> None:
    table = np.full((4, 3), 1.0 / 3.0)
    table[1] *= 1.005
    table[2] = 0.0
    table[3, 0] -= 1e-10
    rows, known, counts = checked_rows("x.npy", table)
    np.testing.assert_allclose(rows[[0, 1, 3]].sum(axis=1), 1.0, atol=1e-9)
    assert known.tolist() == [True, True, False, True]
    assert counts == {"rows": 4, "empty": 1, "renormalised": 1}
    table[1] *= 1.01
    with pytest.raises(FileFormatError, match=r"x\.npy: 1 of 4 rows do not sum to 1 within 0\.01, the first at \[1\]"):
        checked_rows("x.npy", table)


@given(data=st.data())
def test_what_has_been_checked_sums_to_1_and_keeps_its_zeros(data: st.DataObject) -> None:
    numbers = st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5)
    table = np.array(data.draw(st.lists(numbers, min_size=1, max_size=6)))
    table[table < 1e-6] = 0.0
    total = table.sum(axis=1, keepdims=True)
    table = np.divide(table, total, out=np.zeros_like(table), where=total > 0.0)
    table *= data.draw(st.floats(0.9901, 1.0099))
    rows, known, counts = checked_rows("x.npy", table)
    np.testing.assert_allclose(rows.sum(axis=1), known.astype(float), atol=2e-6)
    assert ((rows > 0.0) == (table > 0.0)).all()
    assert counts["empty"] == int((total == 0.0).sum())


def test_cumulative_rows_are_taken_apart() -> None:
    rows, known, counts = checked_cumulative("x.npy", np.array([[0.25, 0.25, 1.0], [0.0, 0.0, 0.0], [np.nan] * 3]))
    np.testing.assert_allclose(rows, [[0.25, 0.0, 0.75], [0.0] * 3, [0.0] * 3])
    assert (known.tolist(), counts["empty"]) == ([True, False, False], 2)
    with pytest.raises(FileFormatError, match=r"fall 1 time\(s\), first after \[0, 1\]"):
        checked_cumulative("x.npy", np.array([[0.2, 0.6, 0.5, 1.0]]))


# --- initial state ---


def test_the_law_of_the_start_is_a_distribution_within_its_limits() -> None:
    initial = replace(InitialState(), min_ttc=5.0)
    law = gap_law(initial)
    np.testing.assert_allclose(law.sum(axis=(1, 2)), 1.0)
    assert (law[:, 0] == 0.0).all()
    assert (law[:, :50, 0] == 0.0).all()  # closing by 10 m/s needs 50 m for a TTC of 5 s
    assert law[10, 50, 0] > 0.0
    assert (law[0, :, :10] == 0.0).all()  # nobody is slower than 20 m/s
    np.testing.assert_allclose(speed_law(initial).sum(), 1.0)


def test_the_law_of_the_start_is_what_the_simulator_draws() -> None:
    """Against a plain drawing of `InitialState` as its docstring defines it."""
    rng, v = np.random.default_rng(5), 28.0
    initial = InitialState()
    share = initial.stream_sd**2 / (initial.stream_sd**2 + initial.speed_sd**2)  # of the variance; so m given v:
    mean = initial.speed_mean + share * (v - initial.speed_mean)
    mean = mean + initial.speed_sd * np.sqrt(share) * rng.standard_normal(400_000)
    z = rng.standard_normal(400_000)
    gap = v * (initial.time_gap_shift + initial.time_gap_median * np.exp(initial.time_gap_sigma * z))
    s = np.minimum(initial.rr_scale * (gap / 20.0) ** initial.rr_exponent, initial.speed_sd)
    kept = np.sqrt(1.0 - (s / initial.speed_sd) ** 2)
    rate = (kept - 1.0) * (v - mean) + s * rng.standard_normal(gap.size)
    inside = (gap > 0.5) & (gap < 115.5) & (gap >= -initial.min_ttc * rate) & (v + rate >= 20.0) & (v + rate <= 40.0)
    counts, *_ = np.histogram2d(
        gap[inside], rate[inside], bins=[np.append(GAPS[1:] - 0.5, 115.5), np.append(RANGE_RATES - 0.5, 8.5)]
    )
    # Cells at a limit are cut through, which the grid cannot follow; n = 4e5 leaves about 0.02 of noise.
    assert 0.5 * np.abs(counts / counts.sum() - gap_law(initial)[8, 1:]).sum() < 0.04


def test_speeds_of_the_table_are_reported_as_they_are() -> None:
    table = np.zeros(21)
    table[[8, 12]] = 0.5  # 28 and 32 m/s
    _, found = fit_speeds(table, InitialState())
    assert (found["mean"], found["sd"]) == (30.0, 2.0)
    assert found["misfit"] > 0.3


def test_what_the_limits_of_the_start_rule_out_is_counted() -> None:
    initial = InitialState()
    table = 0.9 * gap_law(initial)
    table[:, 10, 0] += 0.1  # TTC 1 s
    fitted, found = fit_gaps(table, speed_law(initial), initial)
    assert found["impossible"] == pytest.approx(0.1)
    assert fitted.time_gap_median == pytest.approx(initial.time_gap_median, rel=1e-3)


# --- damage ---


def free(folder: Path, change: Callable[[Floats], Floats]) -> None:
    np.save(folder / "FF_pdf_array.npy", change(np.full((21, 31), 1.0 / 31.0)))


def set_at(value: float) -> Callable[[Floats], Floats]:
    def change(table: Floats) -> Floats:
        table[3, 4] = table[7, 1] = value
        return table

    return change


def listed(folder: Path, **parts: Any) -> None:
    good = {"coords": np.array([[0], [3], [4], [0]]), "data": np.array([0.5]), "shape": np.array([21, 116, 19, 2])}
    np.savez(folder / "OL_pdf.npz", **{key: value for key, value in {**good, **parts}.items() if value is not None})


def pickled(folder: Path) -> None:
    with (folder / "CF_pdf_array.pkl").open("wb") as file:
        pickle.dump([1.0], file)


def objects(folder: Path) -> None:
    np.save(folder / "speed_CDF.npy", np.array([0.5, None], dtype=object), allow_pickle=True)


def pickle_by_another_name(folder: Path) -> None:
    (folder / "speed_CDF.npy").write_bytes(pickle.dumps([0.5]))


def objects_in_a_list(folder: Path) -> None:
    np.savez(folder / "OL_pdf.npz", coords=np.array([None], dtype=object), data=np.ones(1))


def two_of_a_kind(folder: Path) -> None:
    listed(folder)
    np.savez(folder / "new_OL_pdf.npz")


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "nothing": (lambda _: None, "holds none of the published arrays"),
    "pickle": (pickled, r"CF_pdf_array\.pkl is a pickle.*not loaded.*convert it"),
    "array of objects": (objects, r"speed_CDF\.npy is a pickle, or an array of Python objects"),
    "pickle by another name": (pickle_by_another_name, r"speed_CDF\.npy is a pickle"),
    "objects in a list": (objects_in_a_list, r"OL_pdf\.npz is a pickle, or an array of Python objects"),
    "NaN": (lambda f: free(f, set_at(np.nan)), r"FF_pdf_array\.npy holds 2 NaN.*and 0 negative.*first at \[3, 4\]"),
    "negative": (lambda f: free(f, set_at(-0.5)), r"0 NaN or infinite and 2 negative number\(s\), .* at \[3, 4\]"),
    "counts": (lambda f: free(f, lambda t: 100.0 * t), r"21 of 21 rows do not sum to 1.*\[0\] with 100"),
    "shape": (lambda f: free(f, lambda t: t[:20]), r"FF_pdf_array\.npy has shape \(20, 31\); expected \(21, 31\)"),
    "following's shape": (
        lambda f: np.save(f / "CF_pdf_array.npy", np.zeros((116, 21, 19, 31))),
        r"shape \(116, 21, 19, 31\); expected \(116, 19, 21, 31\) or \(21, 116, 19, 31\)",
    ),
    "text": (lambda f: np.save(f / "speed_CDF.npy", np.array(["a"])), "no array of numbers"),
    "cut off": (lambda f: (f / "speed_CDF.npy").write_bytes(b"\x93NUMPY\x01\x00"), r"speed_CDF\.npy is damaged"),
    "no zip": (lambda f: (f / "OL_pdf.npz").write_bytes(b"PK\x03\x04rest"), r"OL_pdf\.npz is damaged"),
    "two of a kind": (
        two_of_a_kind, r"2 files for lane change, no adjacent vehicle: OL_pdf\.npz, new_OL_pdf\.npz; leave one",
    ),
    "another sparse form": (lambda f: listed(f, coords=None), "no coordinate list.*coordinate form"),
    "coordinates outside": (
        lambda f: listed(f, coords=np.array([[0], [116], [4], [0]])), r"1 of 1 coordinates lie outside",
    ),
    "coordinates and data differ": (lambda f: listed(f, data=np.ones(2)), r"expected \(4, k\) and \(k,\)"),
    "filled with something": (lambda f: listed(f, fill_value=np.array(0.1)), r"fill_value is 0\.1"),
    "lane-change shape": (lambda f: listed(f, shape=np.array([21, 116, 19, 5])), r"expected \(21, 116, 19, 2\) or"),
    "lane-change counts": (lambda f: listed(f, data=np.array([7.0])), r"above 1, the first at \[0, 3, 4\] with 7"),
    "negative chance": (lambda f: listed(f, data=np.array([-0.5])), r"1 negative number"),
    "falling": (lambda f: np.save(f / "speed_CDF.npy", np.linspace(1.0, 0.0, 21)), "cumulative probabilities fall 20"),
    "not up to 1": (lambda f: np.save(f / "speed_CDF.npy", np.linspace(0.0, 0.5, 21)), "do not sum to 1"),
    "no speeds": (lambda f: np.save(f / "speed_CDF.npy", np.zeros(21)), "all zeros"),
    "no gaps": (lambda f: np.save(f / "presum_list_forward.npy", np.zeros((21, STATES))), "all zeros"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_damage_is_named(name: str, ours: NddModel, tmp_path: Path) -> None:
    make, message = BAD[name]
    make(tmp_path)
    with pytest.raises(FileFormatError, match=message):
        import_arrays(tmp_path, ours)


def test_the_preferred_of_two_names_is_taken_and_the_other_named(ours: NddModel, tmp_path: Path) -> None:
    np.save(tmp_path / "Optimized_FF_pdf_array.npy", np.full((21, 31), 1.0 / 31.0))
    np.save(tmp_path / "FF_pdf_array.npy", np.eye(21, 31))
    model, report = import_arrays(tmp_path, ours)
    np.testing.assert_allclose(model.free, 1.0 / 31.0, rtol=1e-6)
    assert report.unused == ("FF_pdf_array.npy",)


# --- the command ---


@pytest.mark.full
def test_the_command_writes_model_and_report_and_the_same_bytes_again(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.npz"
    assert main(["ndd", "import", str(published), "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["out"] == str(out)
    assert set(result["files"]) >= {"following", "free", "lc_alone", "initial_speed"}
    written = json.loads((tmp_path / "m.report.json").read_text())
    assert written["files"] == result["files"]
    model = load_model(out)
    assert model.provenance["format"] == "ivbss"
    assert "source" not in json.dumps(dict(model.provenance))  # no folders
    first = out.read_bytes()
    cornerforge.ndd_import(published, out=out)
    assert out.read_bytes() == first


def test_the_command_prints_what_is_whose(ours: NddModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "FF_pdf_array.npy", ours.free)
    assert main(["ndd", "import", str(tmp_path), "--out", str(tmp_path / "m.npz")]) == 0
    text = capsys.readouterr().out
    assert "FF_pdf_array.npy: rows 21, empty 0" in text
    assert "ours          following: all states (no file)" in text
    assert "ours          overlook (in no published array)" in text
    assert main(["ndd", "import", str(tmp_path / "none"), "--out", str(tmp_path / "m.npz")]) == 2
    assert "No folder" in capsys.readouterr().err
