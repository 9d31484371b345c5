"""`train-av` trains an AV and measures how often it crashes in natural traffic that it never saw."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Unpack

from cornerforge._arguments import checked
from cornerforge._checks import check_integer, check_number
from cornerforge._locks import claims
from cornerforge.drivers.avs import AvNetwork, av_hash
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.av_file import load_av, save_av
from cornerforge.experiment.counting import rate_summary, simulate_experiment
from cornerforge.experiment.output import check_new_file, code_hash, version
from cornerforge.experiment.setting import check_threads, experiment
from cornerforge.ndd.model import model_hash
from cornerforge.results import TrainedAv
from cornerforge.sim import AV_FEATURES_VERSION
from cornerforge.verbs.train import EVALUATION_TESTS, canonical_curve, checkpoint_beside, curve_report
from cornerforge.world_options import RoadKeywords, WorldOptions

__all__ = ["train_av"]


@checked
@claims()
def train_av(
    *,
    out: Path | str,
    decisions: int | None = None,
    minutes: float | None = None,
    tests: int = 20_000,
    overwrite: bool = False,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[RoadKeywords],
) -> TrainedAv:
    """Train an AV (dueling double DQN) and write it; `--av OUT` then drives it.

    Args:
        out: AV file, `.safetensors`; must not exist unless `overwrite`.
        decisions: Seconds of driving to learn from; None for the default. The same seed and decisions give the same
            weights.
        minutes: Stop after this time [min]; the result then depends on the machine's speed.
        tests: Tests in natural traffic to measure it on.
        overwrite: Replace an existing file.
        resume: Go on with a stopped training of the same command (its state is in `OUT.checkpoint`); the weights are
            the same as without the stop, unless `minutes` ends it.
        seed: 0 or more.
        threads: None for all cores; does not change the weights.
        progress: Told how far it is.
        world: The world to learn in, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge train-av --json` prints: how often the AV crashes in natural traffic, and where its file is.

    Raises:
        CornerForgeError: Input, files or output place are not right, or PyTorch is missing.
    """
    from cornerforge.adversary.train_av import AV_TRAINING
    from cornerforge.adversary.train_av import train_av as learn

    path = Path(out)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("tests", tests, low=1, high=10**9)
    config = AV_TRAINING
    if decisions is not None:
        config = replace(config, decisions=check_integer("decisions", decisions, low=1, high=10**12))
    if minutes is not None:
        check_number("minutes", minutes, low=0.01, high=1e5, unit="min")
    if path.suffix != ".safetensors":
        raise InputError(f"{path} does not end in .safetensors, by which --av knows an AV's file; add the ending.")
    check_new_file(path, overwrite=overwrite)
    options = WorldOptions(**world)
    run = experiment(options)
    checkpoint = checkpoint_beside(path, run, config, seed)
    check_new_file(checkpoint.path, overwrite=True)
    if not resume:
        checkpoint.check_absent()
    max_seconds = None if minutes is None else 60.0 * minutes

    result = learn(
        run.setting, run.slots, config, seed=seed, threads=check_threads(threads), max_seconds=max_seconds,
        progress=curve_report(progress, config, max_seconds), checkpoint=checkpoint,
    )  # fmt: skip
    network = AvNetwork(config.network, result.weights, AV_FEATURES_VERSION)
    about = {
        "cornerforge": version(),
        "code": code_hash(),
        "train": asdict(config),
        "seed": seed,
        "odd": run.odd.stated(),
        "model_hash": model_hash(run.model),
        "decisions": result.decisions,
        "updates": result.updates,
        "curve": canonical_curve(result),
    }
    save_av(network, about, path)
    checkpoint.remove()
    trained = experiment(options, av=str(path))
    tally, _ = simulate_experiment(
        trained, tests=tests, seed=seed, first=EVALUATION_TESTS, threads=threads, progress=progress, stage="evaluate"
    )
    return TrainedAv(
        decisions=result.decisions,
        updates=result.updates,
        seconds=round(result.seconds, 3),
        **vars(rate_summary(tally.av_crashes, tally.tests, tally.miles)),
        mean_speed=round(tally.millimetres / 1000.0 / tally.decisions, 3),
        av_hash=av_hash(load_av(path)),
        out=str(path),
    )
