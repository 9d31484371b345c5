"""Results of learning as text: `train`, `train-av`."""

from __future__ import annotations

from cornerforge.results import Trained, TrainedAv
from cornerforge.verbs.sentences.numbers import rate_text, training_fault_text, yield_text

__all__ = ["train_av_text", "train_text"]


def train_text(found: Trained) -> str:
    """Write the yields of the adversary and of plain ones, and where the policy is."""
    lines = [yield_text(found, "Adversary", found.reward)]
    lines += [yield_text(one, f"{one.name:>21}", found.reward) for one in found.baselines]
    lines += training_fault_text(found.av_faults)
    return "\n".join([*lines, f"{found.decisions:,} decisions in {found.seconds:.0f} s; policy: {found.out}"])


def train_av_text(found: TrainedAv) -> str:
    """Write how often the AV crashes in natural traffic, how fast it drives, and where it is."""
    return "\n".join(
        [
            rate_text(found, "Natural traffic"),
            f"Mean speed {found.mean_speed:.1f} m/s",
            f"{found.decisions:,} s of driving in {found.seconds:.0f} s; AV: {found.out}",
        ]
    )
