"""Work on a real Ray cluster of two machines (processes of this one): the same bits, whoever dies."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from folder_snapshot import snapshot

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import EngineError, InputError
from cornerforge.experiment.setting import experiment
from cornerforge.library import CaseLibrary
from cornerforge.rates.branching import danger
from cornerforge.rates.branching.drive import drive_trees
from cornerforge.rates.branching.population import Plan
from cornerforge.rates.teaching import plan_of, tilted_plan_of
from cornerforge.work import cluster as cluster_module
from cornerforge.work import cpu_seconds, engine, in_order
from cornerforge.work.worker import work_on

pytestmark = pytest.mark.full

_STORE = 80_000_000


@pytest.fixture(scope="module")
def machines() -> Iterator[Any]:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    from ray.cluster_utils import Cluster

    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers do not know the tests
    one: dict[str, Any] = {"num_cpus": 1, "object_store_memory": _STORE}
    made = Cluster(initialize_head=True, head_node_args={**one, "include_dashboard": False})
    made.add_node(**one)
    made.wait_for_nodes()
    yield made
    ray.shutdown()
    made.shutdown()


def workers_at_work() -> list[int]:
    """Process ids of Ray's workers that are at work on a task of ours."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            name = place.read_bytes()
        except OSError:
            continue  # it has ended meanwhile
        if name.startswith(b"ray::task"):
            found.append(int(place.parent.name))
    return found


def where(first: int, count: int) -> tuple[int, list[int]]:
    time.sleep(0.02)
    return os.getpid(), list(range(first, first + count))


def where_with(_: object, first: int, count: int) -> tuple[int, list[int]]:
    return where(first, count)


def test_ranges_come_in_order_from_other_processes(machines: Any) -> None:
    with engine("ray", address=machines.address):
        parts = list(in_order(where, 5, 100, chunk=3, threads=1))
    assert [number for _, some in parts for number in some] == list(range(5, 105))
    pids = {pid for pid, _ in parts}
    assert len(pids) == 2
    assert os.getpid() not in pids


def test_errors_warnings_and_cpu_time_come_back(machines: Any) -> None:
    def warn(first: int, count: int) -> int:
        warnings.warn("said by a worker", UserWarning, stacklevel=1)
        return sum(range(2_000_000)) + first + count

    def refuse(first: int, count: int) -> int:
        raise InputError(f"not {first}, {count}")

    with engine("ray", address=machines.address):
        before = cpu_seconds() - time.process_time()
        with pytest.warns(UserWarning, match="said by a worker"):
            assert len(list(in_order(warn, 0, 4, chunk=1, threads=1))) == 4
        assert cpu_seconds() - time.process_time() - before > 0.01
        with pytest.raises(InputError, match="not 0, 2"):
            list(in_order(refuse, 0, 4, chunk=2, threads=1))
        with pytest.raises(EngineError, match=r"cannot be sent to other machines .* leave out --engine ray"):
            list(in_order(partial(where_with, threading.Lock()), 0, 4, chunk=2, threads=1))


@pytest.mark.slow
def test_all_verbs_give_the_same(machines: Any, tmp_path: Path) -> None:
    def all_of_it(out: Path) -> tuple[Any, ...]:
        simulated = cornerforge.simulate(tests=3000, stats=True, seed=4)
        filled = cornerforge.generate(policy="swerve", cases=60, out=out / "lib", seed=5)
        analysed = cornerforge.analyse(out / "lib", out=out / "analysis")
        counted = cornerforge.rate(method="mc", max_tests=70_000, seed=6)
        ways = CaseLibrary.open(out / "lib")
        plausible = cornerforge.plausibility(
            out=out / "plausible", budgets=(20.0,), seeds=1, decisions=2_048, tests=600, seed=7
        )
        policies = [replace(run, seconds=0.0) for row in plausible.rows for run in row.runs]
        return (
            simulated.digest, simulated.distributions, filled.cases, filled.tests, analysed.avoidability,
            analysed.fault, counted.digest, len(ways), snapshot(out / "lib" / "shards"), policies, plausible.natural,
        )  # fmt: skip

    here = all_of_it(tmp_path / "here")
    with cornerforge.engine("ray", address=machines.address):
        there = all_of_it(tmp_path / "there")
    assert here == there


@pytest.mark.parametrize("how", [plan_of, tilted_plan_of])
def test_weighted_tests_are_the_same(machines: Any, how: Callable[[danger.Network, float], Plan]) -> None:
    run = experiment(av="idm-mobil", lanes=2)
    plan = how(danger.untaught(1e-4), 1e-4)

    def grown() -> Any:
        return drive_trees(run.setting, run.slots, plan, seed=3, first=0, tests=1000, threads=2, learning=True)

    here = grown()
    with engine("ray", address=machines.address):
        there = grown()
    assert here.trees.tobytes() == there.trees.tobytes()
    assert here.actions.tobytes() == there.actions.tobytes()
    assert here.training.seen.tobytes() == there.training.seen.tobytes()
    assert there.cpu_seconds > 0.0


def test_other_code_on_a_machine_is_refused(machines: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "code_hash", lambda: "0123456789abcdef")
    with (
        engine("ray", address=machines.address),
        pytest.raises(EngineError, match=r"has another version of cornerforge \(code .* here 0123456789abcdef\)"),
    ):
        list(in_order(where, 0, 4, chunk=1, threads=1))


def test_work_goes_on_after_a_worker_and_a_machine_died(machines: Any) -> None:
    """Last, because the machine does not come back."""
    here = cornerforge.simulate(tests=150_000, seed=8)
    killed: list[int] = []

    def kill(stage: str, done: float, total: float) -> None:  # noqa: ARG001
        if not killed and done > 0.1 * total:
            killed.extend(workers_at_work()[:1])  # on a busy machine none may be at work at this moment
            for worker in killed:
                os.kill(worker, signal.SIGKILL)
        elif len(killed) == 1 and done > 0.4 * total:
            killed.append(0)
            machines.remove_node(machines.list_all_nodes()[-1], allow_graceful=False)

    with engine("ray", address=machines.address):
        there = cornerforge.simulate(tests=150_000, seed=8, progress=kill)
    assert len(killed) == 2
    assert here.digest == there.digest


def test_a_cluster_that_is_not_there_is_told_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    assert main(["simulate", "--tests", "10", "--engine", "ray", "--address", f"127.0.0.1:{port}"]) == 2
    told = capsys.readouterr().err.strip()
    assert "\n" not in told
    assert f"No Ray cluster answers at 127.0.0.1:{port}" in told
    assert "ray start --head" in told


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--engine", "rey"], "ray"),
        (["--address", "127.0.0.1:6379"], "needs the engine ray"),
        (["--engine", "ray", "--threads", "0"], "threads"),
    ],
)
def test_wrong_options_are_told(given: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--tests", "10", *given]) == 2
    assert told in capsys.readouterr().err


def test_an_av_from_outside_stays_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cornerforge.experiment.setting.is_spread", lambda: True)
    with pytest.raises(InputError, match="drives on this machine alone; leave out --engine ray"):
        cornerforge.simulate(tests=10, av="some_module:Planner")


def test_a_worker_keeps_few_works() -> None:
    import pickle

    from cornerforge.work import worker
    from cornerforge.work.code import code_hash

    for name in ("a", "b", "c"):
        done = work_on(code_hash(), name, lambda: pickle.dumps(where), [(0, 2)])
        assert done.results[0][1] == [0, 1]
    assert len(worker._kept) <= 2
