"""The protocol of a learner: what it gives the worlds, what it takes from them, and what is kept of it.

A learner is independent of the worlds that it learns from. It must be deterministic: the same seed and the same calls
give the same weights, also when its state was kept and restored between two calls. A new one is a file of `adversary/`
that gives `PRESETS` and `make_learner(config, seed)`, and a name in `world_options.LEARNERS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.worlds import Exploring, Transitions

__all__ = ["Learner", "below"]


class Learner(Protocol):
    """Learns a network from transitions.

    PyTorch is set to one thread while a learner is at work: more gain nothing on networks this small, and results would
    depend on how many there are.

    Attributes:
        updates: Steps of the optimiser so far.
    """

    updates: int

    def exploring(self, decisions: int) -> Exploring:
        """Give the network with which worlds act now, and how they explore, after so many decisions.

        Its weights are a copy: worlds act with them while the learner learns.
        """

    def learn(self, learning_rate: float) -> None:
        """Do the steps that are due after what was noted so far; none may be."""

    def note(self, batch: Transitions) -> None:
        """Take one decision of each world, in the order of worlds, and copy what is needed of it."""

    def point(self, decisions: int) -> dict[str, float | None]:
        """Give what a point of the training curve says of the learner: fields of `TrainingPoint`."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that changes and is an array, by name; views."""

    def values(self) -> dict[str, Any]:
        """Give the rest of the state, JSON-compatible."""

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Take over the state that `arrays` and `values` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit.
        """


def below(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Select the arrays whose name begins with `prefix.`, without it."""
    return {name.removeprefix(f"{prefix}."): a for name, a in arrays.items() if name.startswith(f"{prefix}.")}
