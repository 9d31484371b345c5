"""PCA, DBSCAN, K-means and the choice of valuable cases, each alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.cluster import DBSCAN
from sklearn.decomposition import PCA

from cornerforge.analysis.dbscan import choose_min_samples, dbscan, knee, neighbour_distance, split
from cornerforge.analysis.kmeans import choose_k, cluster
from cornerforge.analysis.pca import project
from cornerforge.analysis.valuable import rare_cases, typical_cases


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


def test_projection_is_that_of_the_singular_values_up_to_sign() -> None:
    values = np.random.default_rng(1).normal(size=(300, 6)) * [3.0, 1.0, 1.0, 2.0, 1.0, 0.5]
    found, reference = project(values), PCA(2).fit(values)
    assert np.abs(found.loadings) == pytest.approx(np.abs(reference.components_))
    assert found.explained_variance == pytest.approx(reference.explained_variance_ratio_)
    assert np.abs(found.points) == pytest.approx(np.abs(reference.transform(values)))


def test_largest_loading_is_positive_whatever_the_sign_of_the_data() -> None:
    values = np.random.default_rng(2).normal(size=(100, 5)) * [1.0, 2.0, 3.0, 4.0, 5.0]
    for data in (values, -values):
        loadings = project(data).loadings
        assert (loadings[np.arange(2), np.abs(loadings).argmax(axis=1)] > 0.0).all()
    assert project(-values).points == pytest.approx(-project(values).points)


def test_equal_loadings_take_the_first_as_positive() -> None:
    line = np.linspace(-1.0, 1.0, 50)
    loadings = project(np.column_stack([line, -line, 0.0 * line])).loadings[0]
    assert loadings == pytest.approx([np.sqrt(0.5), -np.sqrt(0.5), 0.0])


def test_alike_cases_project_to_the_origin() -> None:
    found = project(np.zeros((5, 5)))
    assert not found.points.any()
    assert not found.explained_variance.any()


# --- density


def assert_same_as_reference(points: np.ndarray, eps: float, min_samples: int) -> None:
    distance = neighbour_distance(points, min_samples)
    found = dbscan(points, eps, distance)
    reference = DBSCAN(eps=eps, min_samples=min_samples).fit(points)
    is_core = np.zeros(len(points), np.bool_)
    is_core[reference.core_sample_indices_] = True
    assert ((distance <= eps) == is_core).all()
    assert ((found == -1) == (reference.labels_ == -1)).all()
    pairs = set(zip(found[is_core].tolist(), reference.labels_[is_core].tolist(), strict=True))
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    sizes = np.bincount(found[found >= 0])
    assert (sizes[:-1] >= sizes[1:]).all()
    for row in np.flatnonzero(~is_core & (found >= 0)):
        near = np.hypot(*(points - points[row]).T) <= eps
        assert found[row] in found[near & is_core]


@pytest.mark.parametrize("eps", [0.05, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("n", [20, 200, 2000])
def test_clusters_are_those_of_scikit_learn(n: int, eps: float) -> None:
    for points in [*shapes(n).values(), blobs([n // 2, n // 4, n // 4])]:
        assert_same_as_reference(points, eps + 1e-7, choose_min_samples(n))


@settings(deadline=None)
@given(
    cells=arrays(np.int8, st.tuples(st.integers(4, 60), st.just(2)), elements=st.integers(-6, 6)),
    eps=st.sampled_from([0.5, 1.2, 1.7, 2.3]),
)
def test_clusters_are_those_of_scikit_learn_on_grids_lines_and_copies(cells: np.ndarray, eps: float) -> None:
    assert_same_as_reference(cells.astype(np.float64), eps, 4)


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
    found = dbscan(np.arange(20.0).reshape(10, 2) ** 2, 0.1, np.full(10, 1.0))
    assert (found == -1).all()


# --- K-means


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


@pytest.mark.parametrize("n", [12, 60, 3000])
@pytest.mark.parametrize("shape", shapes(10))
def test_no_structure_is_one_cluster(shape: str, n: int) -> None:
    assert choose_k(shapes(n)[shape]) == 1


def test_few_or_repeated_points_are_one_cluster() -> None:
    assert choose_k(blobs([5, 4])) == 1
    assert choose_k(np.zeros((50, 2))) == 1
    assert len(cluster(np.array([[1.0, 2.0]])).centres) == 1


def test_same_seed_same_clusters() -> None:
    points = blobs([900, 500, 300], spread=1.5)
    one, other = cluster(points, seed=7), cluster(points, seed=7)
    assert one.labels.tobytes() == other.labels.tobytes()
    assert one.centres.tobytes() == other.centres.tobytes()


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
