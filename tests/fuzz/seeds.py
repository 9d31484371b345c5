"""Seeds: small whole files of every kind, made by the program itself, once per session."""

from __future__ import annotations

import importlib
import os
import shutil
import tomllib
import warnings
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from recorded_files import clips_file, highd_files, motorway, ngsim_file, tgsim_file, written
from small_trees import small_trees

import cornerforge
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.drivers.policy import NetworkShape, n_weights
from cornerforge.experiment.av_file import rl_av_path
from cornerforge.experiment.policy_file import Policy, save_policy
from cornerforge.library import CaseLibrary
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.sim import observe

__all__ = ["SEEDS", "TINY_RUN", "seed_folder"]

_DATA = Path(__file__).parents[1] / "interchange" / "data"
SEEDS: dict[str, Callable[[Path], None]] = {}
TINY_RUN: dict[str, Any] = {
    "nde_tests": 200, "natural_tests": 300, "natural_rhw": 0.3, "decisions": 1024, "evaluation_tests": 100,
    "exposure_tests": 100, "cases": 6,
}  # fmt: skip
"""Size of a run."""


def _seed(name: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    def keep(make: Callable[[Path], None]) -> Callable[[Path], None]:
        SEEDS[name] = make
        return make

    return keep


def seed_folder(root: Path, name: str) -> Path:
    """Make a seed if it is not there yet, and return its folder."""
    folder = root / name
    if not folder.exists():
        part = root / f".{name}.{os.getpid()}"
        part.mkdir(parents=True)
        try:
            with chdir(part), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                SEEDS[name](root)
            part.rename(folder)
        except BaseException:
            shutil.rmtree(part)
            if not folder.exists():  # another worker may have been faster
                raise
    return folder


def _library(out: str = "lib", cases: int = 6, **more: Any) -> None:
    cornerforge.generate(policy=["lane-changer"], cases=cases, out=out, threads=1, **more)


@_seed("model")
def _model(_: Path) -> None:
    shutil.copy(default_model_path(), "m.npz")


@_seed("policy")
def _policy(_: Path) -> None:
    shape = NetworkShape(observe.N_OBSERVATION, 1, 1, 8)
    weights = np.random.default_rng(1).normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    save_policy(Policy(weights, shape, True, {"about": "drawn", "reward": "crash"}, 8.0), Path("p.safetensors"))


@_seed("av")
def _av(_: Path) -> None:
    shutil.copy(rl_av_path(), "a.safetensors")


@_seed("library")
def _plain_library(_: Path) -> None:
    _library()


@_seed("analysed")
def _analysed(root: Path) -> None:
    shutil.copytree(seed_folder(root, "library") / "lib", "lib")
    cornerforge.analyse("lib", out="lib-analysis", threads=1)


@_seed("rate")
def _rate(_: Path) -> None:
    cornerforge.rate(method="mc", max_tests=300, out="rate", threads=1, av="flawed-not-behind")


@_seed("trees")
def _trees(_: Path) -> None:
    with small_trees():
        cornerforge.rate(method="splitting", max_tests=6000, out="rate", threads=1, av="flawed-not-behind")


@_seed("run")
def _run(_: Path) -> None:
    run = importlib.import_module("cornerforge.verbs.run")
    with patch.dict(run.EFFORTS, quick=run.Effort(**TINY_RUN)):
        cornerforge.run(effort="quick", out="run", seed=2, threads=1, av="flawed-not-behind")


@_seed("checkpoint")
def _checkpoint(_: Path) -> None:
    class EnoughError(Exception):
        """It has gone far enough."""

    write = CheckpointFile.write

    def once(file: CheckpointFile, state: Any) -> None:
        write(file, state)
        raise EnoughError

    with patch.multiple(CheckpointFile, is_due=lambda _: True, write=once):
        try:
            cornerforge.train(out="p.safetensors", decisions=2048, tests=20, threads=1)
        except EnoughError:
            return
    raise AssertionError("the training wrote no checkpoint")


@_seed("tracks")
def _tracks(_: Path) -> None:
    tracks = motorway()
    ngsim_file(Path("ngsim.csv"), tracks)
    clips_file(Path("clips.csv"), tracks)
    tgsim_file(Path("tgsim.csv"), tracks)
    highd_files(Path(), tracks)
    time = [(who, i, 0.1 * i) for who in (1, 2) for i in range(61)]
    pairs = [
        f"{who},{who + 10},{t:.1f},{25.0 + 0.01 * i:.3f},{24.5 + 0.02 * i:.3f},{30.0 - 0.03 * i:.3f}"
        for who, i, t in time
    ]
    written(Path("pairs.csv"), "follower,leader,t_s,v_mps,vl_mps,gap_m", pairs)
    leaders = [
        f"{who},{3 - who if who == 1 else ''},{t:.1f},{25.0 * t + 40.0 * (who - 1):.3f},{40.0 if who == 1 else ''}"
        for who, _, t in time
    ]
    written(Path("leaders.csv"), "track,leader_track,t_s,y_m,spacing_m", leaders)


@_seed("ivbss")
def _ivbss(_: Path) -> None:
    test = importlib.import_module("calibrate.test_ndd_ivbss")
    test.exported(load_model(default_model_path()), Path("NDD_DATA"))


@_seed("scenarios")
def _scenarios(root: Path) -> None:
    shutil.copytree(_DATA, "traces")
    library = seed_folder(root, "library") / "lib"
    first = str(CaseLibrary.open(library).scalars(["case_id"]).column(0)[0])
    formats = ("mcap", "commonroad", "csv", "parquet")
    for to in formats:
        cornerforge.export(library, [first], to=to, out=to)
    for place in map(Path, formats):
        for file in sorted(place.rglob("*")):
            if file.is_file() and file.name != "provenance.json":
                named = file.name.replace(":", "_").replace(first.replace(":", "-"), "0-8")  # whichever case is first
                file.rename(file.with_name(named))


@_seed("case-file")
def _case_file(root: Path) -> None:
    found = seed_folder(root, "scenarios")
    cornerforge.import_cases([found / "traces" / "cut_in.osi"], out="imported")


@_seed("config")
def _config(_: Path) -> None:
    Path("c.toml").write_text(
        'tests = 20\nav = "idm-mobil"\nodd = "swift"\nlanes = 2\nbv = ["lane-changer"]\nseed = 3\nthreads = 1\n'
        'stats = true\nbounded = false\nacting = "greedy"\nav-timeout = 2.5\n',
        encoding="utf-8",
    )
    assert tomllib.loads(Path("c.toml").read_text(encoding="utf-8"))


@_seed("suite")
def _suite(root: Path) -> None:
    cornerforge.suite_build(
        [seed_folder(root, "library") / "lib"], out="suite", zoo=["idm-mobil", "flawed-not-behind", "rl"], threads=1
    )


@_seed("network")
def _network(_: Path) -> None:
    test = importlib.import_module("foreign.test_network_files")
    test.onnx_file(Path("n.onnx"), 2)
    test.model_of("PPO", "raw", (13, 8), policy_kwargs={"net_arch": [8]}).save("s.zip")
    test.normaliser(Path("s_vecnormalize.pkl"))


@_seed("everything")
def _everything(root: Path) -> None:
    parts = (
        ("library", "lib"),
        ("policy", "p.safetensors"),
        ("tracks", "ngsim.csv"),
        ("case-file", "imported"),
        ("scenarios", "traces"),
    )
    for seed, name in parts:
        whole = seed_folder(root, seed) / name
        if whole.is_dir():
            shutil.copytree(whole, name)
        else:
            shutil.copy(whole, name)


@_seed("hostile-avs")
def _hostile_avs(root: Path) -> None:
    from fuzz.hostile import hostile_av_files

    shutil.copytree(seed_folder(root, "library") / "lib", "lib")
    for name, text in hostile_av_files().items():
        Path(name).write_text(text, encoding="utf-8")


@_seed("kernel-cache")
def _kernel_cache(_: Path) -> None:
    from fuzz.cached import with_cache

    with_cache()


@_seed("nothing")
def _nothing(_: Path) -> None:
    Path("full").mkdir()
    Path("full/file").write_text("x", encoding="utf-8")
    Path("loop").symlink_to("loop")
    Path("dangling").symlink_to("nowhere")
    os.mkfifo("fifo")


@_seed("snapshot")
def _snapshot(_: Path) -> None:
    from cornerforge.experiment.setting import experiment
    from cornerforge.sim.snapshot import packed
    from cornerforge.sim.traffic import reset_world
    from cornerforge.sim.world import allocate_worlds, n_slots, world_of
    from cornerforge.world_options import WorldOptions

    setting = experiment(WorldOptions()).setting
    world = world_of(allocate_worlds(1, n_slots(setting.road)))
    reset_world(world, 3, 5, setting)
    Path("w.world").write_bytes(packed(world))
