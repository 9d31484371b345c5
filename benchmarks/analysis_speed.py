"""How fast the analysis is, and how much memory it takes, beside scikit-learn's.

    python benchmarks/analysis_speed.py [--cases 50000] [--rows 1000000]

Prints Markdown. Seconds are process CPU time of the whole call, the best of three; the million rows run once, in a
fresh process whose largest memory is asked from the system. Nothing here is random but the data, whose seed is fixed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable

import numpy as np
from measuring import table
from numpy.typing import NDArray

from cornerforge.analysis import analyse
from cornerforge.analysis.dbscan import choose_eps, choose_min_samples, dbscan
from cornerforge.analysis.features import scaling_of
from cornerforge.analysis.grouping import group_features, load
from cornerforge.analysis.pca import project

_REPETITIONS = 3


def synthetic_features(n: int, steps: int = 1) -> NDArray[np.float64]:
    """Features like those of crashes: four kinds, heavy tails, correlated over the seconds; shape (n, 5 x steps)."""
    rng = np.random.default_rng(0)
    centre = np.array([[2.0, 3.0, -2.0, 0.0, -0.05], [8.0, 0.0, -6.0, 0.0, 0.0], [-9.0, 0.0, 7.0, 0.0, 0.0],
                       [1.0, -3.0, 1.0, 0.06, 0.0]])  # fmt: skip
    kind = rng.choice(4, n, p=[0.55, 0.2, 0.2, 0.05])
    values = np.repeat(centre[kind], steps, axis=0).reshape(n, 5 * steps)
    values += np.tile(rng.standard_t(4, (n, 5)) * [1.5, 0.4, 1.5, 0.01, 0.02], steps)
    return values


def synthetic_history(n: int) -> NDArray[np.float32]:
    """Histories with these features at every second, and a contact: the BV's side against the AV's; (n, 16, 2, 4)."""
    features = synthetic_features(n)
    history = np.zeros((n, 16, 2, 4), np.float32)
    history[:, :, 0, 2] = 30.0
    history[:, :, 1, :3] = features[:, None, :3]
    history[:, :, 0, 3], history[:, :, 1, 3] = features[:, None, 3], features[:, None, 4]
    history[:, :, 1, 2] += 30.0
    history[:, 0] = [[0.0, 0.0, 30.0, 0.0], [0.0, 1.95, 30.0, -0.02]]
    return history


def best(work: Callable[[], object]) -> float:
    """Seconds of CPU of the quickest of three calls."""
    taken = []
    for _ in range(_REPETITIONS):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return min(taken)


def stages(cases: int) -> str:
    """Each stage on features of `cases` cases, ours and scikit-learn's."""
    from sklearn.cluster import DBSCAN
    from sklearn.decomposition import PCA
    from threadpoolctl import threadpool_limits

    load()
    values = synthetic_features(cases, 15)
    scores = (values - values.mean(axis=0)) / values.std(axis=0)
    points = project(values, scaling_of(values)).points
    min_samples = choose_min_samples(cases)
    eps = choose_eps(points, min_samples)
    with threadpool_limits(limits=1):
        pairs = {
            "PCA of 75 features (ours with the z-scores)": (
                lambda: project(values, scaling_of(values)), lambda: PCA(2).fit_transform(scores),
            ),
            "DBSCAN at half the chosen eps": (
                lambda: dbscan(points, 0.5 * eps, min_samples),
                lambda: DBSCAN(eps=0.5 * eps, min_samples=min_samples).fit(points),
            ),
        }  # fmt: skip
        rows = []
        for name, (ours, theirs) in pairs.items():
            a, b = best(ours), best(theirs)
            rows.append([name, f"{a:.3f}", f"{b:.3f}", f"{a / b:.2f}"])
    rows.append(["choosing eps", f"{best(lambda: choose_eps(points, min_samples)):.3f}", "", ""])
    return table([f"{cases:,} cases", "ours [s]", "scikit-learn [s]", "ratio"], rows)


def whole(cases: int) -> str:
    """From histories to valuable cases."""
    history = synthetic_history(cases)
    ids = [f"0:{number}" for number in range(cases)]
    load()
    rows = [[f"analyse, {k} s", f"{best(lambda k=k: analyse(ids, history, steps=k)):.2f}"] for k in (1, 15)]  # type: ignore[misc]
    return table([f"{cases:,} cases, features to valuable cases", "ours [s]"], rows)


def _large(rows: int, steps: int, answer: multiprocessing.queues.Queue[tuple[float, float, float]]) -> None:
    values = synthetic_features(rows, steps)
    load()
    cpu, wall = time.process_time(), time.perf_counter()
    group_features(values)
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9
    answer.put((time.process_time() - cpu, time.perf_counter() - wall, peak))


def large(rows: int) -> str:
    """A million rows of features, each length of history in a process of its own."""
    context = multiprocessing.get_context("spawn")
    cells = []
    for steps in (1, 15):
        answer: multiprocessing.queues.Queue[tuple[float, float, float]] = context.Queue()
        process = context.Process(target=_large, args=(rows, steps, answer))
        process.start()
        cpu, wall, peak = answer.get()
        process.join()
        cells.append([f"{5 * steps} features", f"{cpu:.1f}", f"{wall:.1f}", f"{peak:.2f}"])
    return table([f"{rows:,} rows", "CPU [s]", "wall [s]", "largest memory, data included [GB]"], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=50_000)
    parser.add_argument("--rows", type=int, default=1_000_000)
    chosen = parser.parse_args()
    for part in (stages(chosen.cases), whole(chosen.cases), large(chosen.rows)):
        print(part, end="\n\n", flush=True)


if __name__ == "__main__":
    main()
