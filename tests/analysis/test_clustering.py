"""PCA, DBSCAN, K-means and the choice of valuable cases, each alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import cdist
from sklearn.cluster import DBSCAN
from sklearn.decomposition import PCA
from sklearn.metrics import silhouette_score

from cornerforge.analysis.dbscan import (
    choose_eps,
    choose_min_samples,
    dbscan,
    knee,
    majority_of,
    neighbour_distance,
    split,
)
from cornerforge.analysis.features import scaling_of
from cornerforge.analysis.kmeans import choose_k, cluster, k_means_in, mean_silhouette
from cornerforge.analysis.pca import Projection, project
from cornerforge.analysis.sensitivity import split_sensitivity
from cornerforge.analysis.valuable import rare_cases, typical_cases
from cornerforge.errors import InputError


def blobs(sizes: list[int], spread: float = 0.4, seed: int = 0) -> np.ndarray:
    centres = np.array([[0.0, 0.0], [6.0, 1.0], [-2.0, 6.0], [7.0, -7.0]])[: len(sizes)]
    rng = np.random.default_rng(seed)
    return np.concatenate([c + rng.normal(0.0, spread, (n, 2)) for c, n in zip(centres, sizes, strict=True)])


def shapes(n: int) -> dict[str, np.ndarray]:
    """Clouds of n points without clusters."""
    rng = np.random.default_rng(n)
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    return {
        "round": rng.normal(size=(n, 2)),
        "oval": rng.normal(size=(n, 2)) * [3.0, 0.7],
        "rectangle": rng.uniform(size=(n, 2)) * [3.0, 1.0],
        "line": rng.uniform(size=(n, 2)) * [3.0, 0.01],
        "disc": np.sqrt(rng.uniform(size=(n, 1))) * np.column_stack([np.cos(turn), np.sin(turn)]),
    }


# --- principal components


def projected(values: np.ndarray) -> Projection:
    return project(values, scaling_of(values))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("n", [5, 300, 70_000])
def test_projection_is_that_of_scikit_learn_up_to_sign(n: int) -> None:
    """70,000 rows are more than one block."""
    values = np.random.default_rng(1).normal(5.0, 1.0, (n, 6)) * [3.0, 1.0, 1.0, 2.0, 1.0, 0.5]
    values[:, 1] += 2.0 * values[:, 0]
    values[:, 4] -= 0.5 * values[:, 3]
    found = projected(values)
    scores = (values - values.mean(axis=0)) / values.std(axis=0)
    reference = PCA(2, svd_solver="full").fit(scores)
    assert np.abs(found.loadings) == pytest.approx(np.abs(reference.components_), abs=1e-9)
    assert found.explained_variance == pytest.approx(reference.explained_variance_ratio_)
    assert np.abs(found.points) == pytest.approx(np.abs(reference.transform(scores)), abs=1e-9)


def test_largest_loading_is_positive_whatever_the_sign_of_the_data() -> None:
    values = np.random.default_rng(2).normal(size=(100, 5)) @ np.triu(np.ones((5, 5)))
    for data in (values, -values):
        loadings = projected(data).loadings
        assert (loadings[np.arange(2), np.abs(loadings).argmax(axis=1)] > 0.0).all()
    assert projected(-values).points == pytest.approx(-projected(values).points)


def test_equal_loadings_take_the_first_as_positive() -> None:
    line = np.linspace(-1.0, 1.0, 50)
    found = projected(np.column_stack([line, -line, 0.0 * line]))
    assert found.loadings[0] == pytest.approx([np.sqrt(0.5), -np.sqrt(0.5), 0.0])
    assert found.explained_variance == pytest.approx([1.0, 0.0])


def test_alike_cases_project_to_the_origin() -> None:
    found = projected(np.full((5, 5), 0.1))
    assert not found.points.any()
    assert not found.explained_variance.any()


# --- density


def assert_same_as_reference(points: np.ndarray, eps: float, min_samples: int) -> None:
    """Same cores, noise and partition of the cores up to names; a border point is in a cluster that reaches it.

    scikit-learn's k-d tree, because its brute force, the default for a dozen points, rounds distances.
    """
    found = dbscan(points, eps, min_samples)
    reference = DBSCAN(eps=eps, min_samples=min_samples, algorithm="kd_tree").fit(points)
    is_core = np.zeros(len(points), np.bool_)
    is_core[reference.core_sample_indices_] = True
    assert ((found == -1) == (reference.labels_ == -1)).all()
    pairs = set(zip(found[is_core].tolist(), reference.labels_[is_core].tolist(), strict=True))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    sizes = np.bincount(found[found >= 0])
    assert (sizes > 0).all()
    assert (sizes[:-1] >= sizes[1:]).all()
    for row in np.flatnonzero(~is_core & (found >= 0)):
        square = ((points - points[row]) ** 2).sum(axis=1)
        square[~is_core] = np.inf
        assert found[row] in found[square == square.min()]
        assert square.min() <= eps * eps


def clouds(seed: int) -> dict[str, np.ndarray]:
    """Clouds of a random number of points, with what makes neighbourhoods hard."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(10, 400))
    turn = rng.uniform(0.0, 2.0 * np.pi)
    line = rng.normal(size=(n, 1)) * [np.cos(turn), np.sin(turn)]
    return {
        "heavy tails": rng.standard_t(1.2, size=(n, 2)),
        "copies": np.repeat(rng.normal(size=(n // 5 + 1, 2)), 5, axis=0),
        "mostly one place": np.concatenate([np.zeros((n, 2)), rng.normal(size=(n // 4 + 1, 2))]),
        "on a line": line,
        "on an axis": np.column_stack([rng.normal(size=n), np.zeros(n)]),
        "ring and core": np.concatenate([0.2 * rng.normal(size=(n, 2)), _ring(rng, n)]),
        "far from the origin": 1e5 + rng.normal(size=(n, 2)),
        "scales apart": np.concatenate([1e-4 * rng.normal(size=(n, 2)), 1e3 * rng.normal(size=(n, 2))]),
    }


def _ring(rng: np.random.Generator, n: int) -> np.ndarray:
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    return 2.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + 0.02 * rng.normal(size=(n, 2))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("eps", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("n", [20, 200, 2000])
def test_clusters_are_those_of_scikit_learn(n: int, eps: float) -> None:
    for points in [*shapes(n).values(), blobs([n // 2, n // 4, n // 4])]:
        assert_same_as_reference(points, eps, choose_min_samples(n))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", range(8))
def test_clusters_are_those_of_scikit_learn_on_hard_clouds(number: int, seed: int) -> None:
    for points in clouds(seed + number).values():
        chosen = choose_eps(points, 4)
        for eps in (0.5 * chosen, chosen, 0.1, 1.0):
            for min_samples in (1, 4, 11):
                assert_same_as_reference(points, eps, min_samples)


@given(
    cells=arrays(np.int8, st.tuples(st.integers(1, 60), st.just(2)), elements=st.integers(-6, 6)),
    square=st.sampled_from([1.0, 2.0, 4.0, 5.0, 8.0, 13.0, 25.0]),
    unit=st.sampled_from([1.0, 0.1, 1.0 / 3.0, 1e-3]),
    min_samples=st.integers(1, 9),
)
def test_ties_at_exactly_eps_are_decided_as_scikit_learn_does(
    cells: np.ndarray, square: float, unit: float, min_samples: int
) -> None:
    """On a grid, eps is the distance of many pairs, up to rounding; with copies and points on one line."""
    assert_same_as_reference(cells * unit, float(np.sqrt(square)) * unit, min_samples)


def test_a_neighbour_at_exactly_eps_counts() -> None:
    pair = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert dbscan(pair, 5.0, 2).tolist() == [0, 0]
    assert dbscan(pair, np.nextafter(5.0, 0.0), 2).tolist() == [-1, -1]


@given(
    points=arrays(np.float64, st.tuples(st.integers(2, 40), st.just(2)), elements=st.floats(-3.0, 3.0, width=32)),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_order_of_points_changes_no_cluster(points: np.ndarray, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(len(points))
    one, other = dbscan(points, 0.7, 3)[order], dbscan(points[order], 0.7, 3)
    pairs = set(zip(one.tolist(), other.tolist(), strict=True))  # equal sizes may exchange their numbers
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    assert ((one == -1) == (other == -1)).all()


@pytest.mark.parametrize("eps", [0.0, -1.0, np.nan, np.inf, 1e-13])
def test_a_radius_out_of_range_is_named(eps: float) -> None:
    with pytest.raises(InputError, match=r"eps = .* is out of range"):
        dbscan(np.array([[0.0, 0.0], [1.0, 1.0]]), eps, 2)


def test_points_that_are_no_numbers_are_named() -> None:
    with pytest.raises(InputError, match=r"points\[1, 0\] = nan is not finite"):
        dbscan(np.array([[0.0, 0.0], [np.nan, 1.0]]), 1.0, 2)
    assert dbscan(np.empty((0, 2)), 1.0, 2).size == 0


@given(cells=arrays(np.int8, st.tuples(st.integers(1, 40), st.just(2)), elements=st.integers(-3, 3)), data=st.data())
def test_neighbour_distance_counts_copies(cells: np.ndarray, data: st.DataObject) -> None:
    points = cells.astype(np.float64)
    k = data.draw(st.integers(1, len(points)))
    every = np.sqrt(((points[:, None] - points) ** 2).sum(axis=2))
    assert neighbour_distance(points, k).tolist() == np.sort(every, axis=1)[:, k - 1].tolist()


# --- sensitivity


def test_sensitivity_holds_the_chosen_split_and_grows_with_eps() -> None:
    points = np.concatenate([blobs([700, 200, 60]), np.array([[20.0, 20.0], [-15.0, 3.0]])])
    chosen = split(points)
    found = split_sensitivity(points, chosen)
    (same,) = [one for one in found if (one.eps_factor, one.min_samples) == (1.0, chosen.min_samples)]
    assert (same.agreement, same.majority_share) == (1.0, chosen.is_majority.mean())
    assert same.dense_clusters == chosen.labels.max() + 1
    for min_samples in {one.min_samples for one in found}:
        noise = [one.noise_share for one in found if one.min_samples == min_samples]
        assert noise == sorted(noise, reverse=True)
    assert {one.min_samples for one in found} == {4, 7, 14}


def test_sensitivity_refuses_factors_and_points_that_do_not_fit() -> None:
    points = blobs([50])
    chosen = split(points)
    with pytest.raises(InputError, match="above 0"):
        split_sensitivity(points, chosen, eps_factors=[0.0, 1.0])
    with pytest.raises(InputError, match="of 50 points, not of these 20"):
        split_sensitivity(points[:20], chosen)


def test_knee_of_a_bent_line() -> None:
    assert knee(np.concatenate([np.linspace(0.0, 1.0, 91), np.linspace(2.0, 10.0, 9)])) == 90
    assert knee(np.ones(5)) == 4


def test_planted_majority_minority_and_outliers() -> None:
    outliers = np.array([[20.0, 20.0], [-15.0, 3.0], [3.0, -14.0]])
    points = np.concatenate([blobs([700, 200, 60]), outliers])
    found = split(points)
    assert found.is_majority[:900].mean() > 0.97
    assert not found.is_majority[900:].any()
    assert (found.labels[-3:] == -1).all()
    assert (np.bincount(found.labels[found.labels >= 0])[:3] >= [680, 190, 50]).all()


@pytest.mark.parametrize("n", [200, 2000])
@pytest.mark.parametrize("shape", shapes(10))
def test_no_structure_is_one_majority(shape: str, n: int) -> None:
    found = split(shapes(n)[shape])
    assert np.bincount(found.labels[found.labels >= 0])[0] > 0.95 * n
    assert found.is_majority.mean() > 0.95


def test_mostly_identical_cases_do_not_make_the_others_noise_of_radius_zero() -> None:
    points = np.concatenate([np.zeros((500, 2)), np.random.default_rng(0).normal(5.0, 0.1, (60, 2))])
    found = split(points)
    assert found.eps > 0.0
    assert found.is_majority[:500].all()
    assert (found.labels[500:] >= 0).mean() > 0.8


def test_without_any_dense_place_everything_is_the_majority() -> None:
    found = dbscan(np.arange(20.0).reshape(10, 2) ** 2, 0.1, 2)
    assert (found == -1).all()
    assert majority_of(found).all()


# --- K-means


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("sizes", "k"), [([300, 200], 2), ([300, 100, 50], 3), ([60, 60, 60, 60], 4), ([10, 10], 2)])
def test_planted_number_of_clusters(sizes: list[int], k: int) -> None:
    points = blobs(sizes)
    found = cluster(points)
    assert len(found.centres) == k
    truth = np.repeat(np.arange(k), sizes)
    assert len(set(zip(truth.tolist(), found.labels.tolist(), strict=True))) == k
    counts = np.bincount(found.labels)
    assert (counts[:-1] >= counts[1:]).all()
    for index, centre in enumerate(found.centres):
        assert centre == pytest.approx(points[found.labels == index].mean(axis=0))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("n", [12, 60, 3000])
@pytest.mark.parametrize("shape", shapes(10))
def test_no_structure_is_one_cluster(shape: str, n: int) -> None:
    assert choose_k(shapes(n)[shape]).k == 1


def test_few_or_repeated_points_are_one_cluster() -> None:
    assert choose_k(blobs([5, 4])).k == 1
    assert choose_k(np.zeros((50, 2))).k == 1
    assert len(cluster(np.array([[1.0, 2.0]])).centres) == 1


def test_same_seed_same_clusters() -> None:
    points = blobs([900, 500, 300], spread=1.5)
    one, other = cluster(points, seed=7), cluster(points, seed=7)
    assert one.labels.tobytes() == other.labels.tobytes()
    assert one.centres.tobytes() == other.centres.tobytes()


@pytest.mark.full
def test_the_choice_is_shown() -> None:
    choice = choose_k(blobs([300, 100, 50]))
    assert choice.bound is not None
    assert choice.scores[1] == max(choice.scores) > choice.bound
    assert choice.to_json()["silhouettes"]["3"] == choice.scores[1]
    flat = choose_k(shapes(3000)["disc"])
    assert flat.bound is not None
    assert max(flat.scores) <= flat.bound
    assert choose_k(blobs([5])).to_json() == {"k": 1, "silhouettes": {}, "bound": None}


@given(
    points=arrays(np.float64, st.tuples(st.integers(5, 40), st.just(2)), elements=st.floats(-9.0, 9.0, width=32)),
    k=st.integers(2, 4),
    data=st.data(),
)
def test_silhouette_is_that_of_scikit_learn(points: np.ndarray, k: int, data: st.DataObject) -> None:
    labels = np.concatenate([np.arange(k), data.draw(arrays(np.intp, len(points) - k, elements=st.integers(0, k - 1)))])
    every = cdist(points, points)
    # By the same distances: its own, of points that nearly coincide, are wrong by 1e-8.
    theirs = silhouette_score(every, labels, metric="precomputed")
    assert mean_silhouette(every, labels, k) == pytest.approx(theirs, abs=1e-9)


def test_many_points_are_clustered_as_few_are() -> None:
    """Above 10,000 points the starts are compared on a subsample; centres are still means of all."""
    points = blobs([9_000, 5_000, 2_000])
    labels, centres = k_means_in(points, 3)
    assert np.bincount(labels).tolist() == [9_000, 5_000, 2_000]
    for index, centre in enumerate(centres):
        assert centre == pytest.approx(points[labels == index].mean(axis=0))


# --- valuable cases


def test_typical_are_nearest_to_the_centre() -> None:
    points = np.array([[0.0, 3.0], [0.0, 1.0], [0.0, -1.0], [0.0, 0.5], [9.0, 0.0], [9.0, 2.0]])
    labels = np.array([0, 0, 0, 0, 1, 1])
    assert typical_cases(points, labels, np.array([[0.0, 0.0], [9.0, 1.5]])) == [[3, 1, 2], [5, 4]]


def test_rare_are_outliers_farthest_from_the_majority() -> None:
    points = np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 0.0], [11.0, 0.0], [0.0, 30.0], [40.0, 0.0]])
    is_majority = np.array([True, True, False, False, False, False])
    is_noise = np.array([False, False, True, True, True, False])
    assert rare_cases(points, is_noise, is_majority) == [4, 2, 3]
    assert rare_cases(points, np.zeros(6, np.bool_), np.ones(6, np.bool_)) == []
