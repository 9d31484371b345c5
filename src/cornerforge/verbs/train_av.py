"""`train-av` trains an AV and measures how often it crashes in natural traffic that it never saw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cornerforge._options import verb
from cornerforge.drivers.avs import AvNetwork, av_hash
from cornerforge.errors import InputError
from cornerforge.experiment.av_file import load_av, save_av
from cornerforge.experiment.counting import rate_summary, simulate_experiment
from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.output import check_new_file
from cornerforge.experiment.setting import experiment
from cornerforge.results import TrainedAv
from cornerforge.sim import av_features
from cornerforge.verbs.options.learning import TrainAv
from cornerforge.verbs.train import EVALUATION_TESTS, about_training, checkpoint_beside, curve_report

__all__ = ["train_av"]


@verb(TrainAv)
def train_av(options: TrainAv) -> TrainedAv:
    """Train an AV (dueling double DQN) and write it; `--av OUT` then drives it.

    Returns:
        What `cornerforge train-av --json` prints: how often the AV crashes in natural traffic, and where its file is.

    Raises:
        CornerForgeError: Input, files or output place are not right, or PyTorch is missing.
    """
    from cornerforge.adversary.train_av import AV_TRAINING
    from cornerforge.adversary.train_av import train_av as learn

    path = Path(options.out)
    config = AV_TRAINING
    if options.decisions is not None:
        config = replace(config, decisions=options.decisions)
    if path.suffix != ".safetensors":
        raise InputError(f"{path} does not end in .safetensors, by which --av knows an AV's file; add the ending.")
    check_new_file(path, overwrite=options.overwrite)
    world = options.world()
    run = experiment(world)
    checkpoint = checkpoint_beside(path, run, config, options.seed)
    check_new_file(checkpoint.path, overwrite=True)
    if not options.resume:
        checkpoint.check_absent()
    max_seconds = None if options.minutes is None else 60.0 * options.minutes

    result = learn(
        run.setting, run.slots, config, seed=options.seed, threads=check_threads(options.threads),
        max_seconds=max_seconds, progress=curve_report(options.progress, config, max_seconds), checkpoint=checkpoint,
    )  # fmt: skip
    network = AvNetwork(config.network, result.weights, av_features.AV_FEATURES_VERSION)
    about = about_training(run, config, result, options.seed)
    save_av(network, {name: value for name, value in about.items() if name not in ("av", "av_hash")}, path)
    checkpoint.remove()
    trained = experiment(world, av=str(path))
    tally, _ = simulate_experiment(
        trained,
        tests=options.tests,
        seed=options.seed,
        first=EVALUATION_TESTS,
        threads=options.threads,
        progress=options.progress,
        stage="evaluate",
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
