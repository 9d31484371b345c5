"""Training loop of the adversary: worlds act in compiled kernels on one core while PyTorch learns on the other.

Everything follows the number of decisions: acting uses the weights as they were when the iteration began, learning
uses the transitions of the iterations before. So the weights depend on seed and configuration only, not on speed or
threads; nor on interruptions: a checkpoint holds all that an iteration changes. What learns is `learner.Learner`.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from types import FrameType
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._schema import meant
from cornerforge.adversary.checkpoint import CheckpointFile, TrainingState
from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.learner import below
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds import (
    CrashCases,
    Exploring,
    ForeignCollector,
    Transitions,
    Verdict,
    allocate_actors,
    collect,
    reward_numbers,
    start_worlds,
)
from cornerforge.drivers.policy import PolicyNumbers
from cornerforge.errors import FileFormatError, InputError, MissingExtraError
from cornerforge.foreign.driver import ForeignAv
from cornerforge.results.learning import TrainingPoint
from cornerforge.sim import (
    Setting,
    allocate_scratch,
    controllers,
    keep_nothing,
    naming_tests,
    observe,
    warn_of_left_out,
)

try:
    import torch
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

__all__ = ["TRAINING_TESTS", "Actor", "CurvePoint", "TrainResult", "train_adversary", "train_in"]

TRAINING_TESTS = 1 << 40
"""Number of the first training test; evaluation and generation use tests far from these."""
_POINT_EVERY = 50
"""Iterations between two points of the training curve, at first."""
_MOST_POINTS = 1000
"""At this many points of the curve pairs of neighbours are joined, and later points come half as often."""


class CurvePoint(TrainingPoint):
    """A point of the curve of a training that runs, hence with its time."""

    seconds: Annotated[float, meant("Wall-clock so far.", "s")]


@dataclass
class TrainResult:
    """Result of a training: weights for `drivers.policy`, the curve, and totals."""

    weights: NDArray[np.float32]
    decisions: int
    updates: int
    seconds: float
    curve: list[CurvePoint] = field(default_factory=list)


def _joined(first: CurvePoint, second: CurvePoint) -> CurvePoint:
    """Join two neighbouring points."""
    tests = first.tests + second.tests

    def share(name: str) -> float | None:
        counts = [p.tests * getattr(p, name) for p in (first, second) if getattr(p, name) is not None]
        return sum(counts) / tests if counts else None

    return replace(
        second, tests=tests, crashes_per_test=share("crashes_per_test"), paid_per_test=share("paid_per_test")
    )


class Actor(Protocol):
    """Worlds that produce transitions.

    Attributes:
        finished: Counts so far, int64 (3 or more,): tests, AV crashes, one of the actor's own, and paid
            tests if it counts them.
    """

    finished: NDArray[np.int64]

    def warm_up(self, exploring: Exploring) -> None:
        """Load the kernels that `act` calls, or compile them (once per installation); moves nobody."""

    def act(self, exploring: Exploring, out: Transitions) -> Transitions:
        """Make one decision in every world; what it gives may lie in `out`, and is copied before the next call."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that `act` changes and needs again, by name; views."""

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` gave."""


class _Actor:
    """The worlds that produce transitions of the adversary, with an AV that decides inside the kernels."""

    def __init__(self, setting: Setting, slots: int, config: TrainConfig, seed: int, verdict: Verdict | None) -> None:
        self._setting, self._seed = setting, seed
        self._reward = reward_numbers(config.reward, config.delay_s)
        if self._reward.by_case != (verdict is not None):
            raise InputError(
                f"Only a reward that is judged by cases takes a verdict, and needs it; got {config.reward}."
            )
        self._cases = None if verdict is None else CrashCases(setting, slots, verdict)
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._keep = keep_nothing(slots)
        self._actors = allocate_actors(config.worlds, setting, slots, observe.N_OBSERVATION)
        self.finished = self._actors.finished.view(np.int64)
        with naming_tests(self._actors.worlds):
            start_worlds(seed, TRAINING_TESTS, setting, self._scratch, self._keep, self._actors)

    def warm_up(self, exploring: Exploring) -> None:
        """Load the kernels that `act` calls, or compile them (once per installation); moves nobody."""
        self._collect(0, exploring, allocate_transitions(1))

    def act(self, exploring: Exploring, out: Transitions) -> Transitions:
        """Make one decision in every world; returns `out`."""
        self._collect(len(self._actors.allowed), exploring, out)
        if self._cases is not None:
            paid = self._cases.judge(self._actors.worlds, self._actors.history)
            out.reward[paid] = 1.0
            self._actors.finished["paid"] += int((paid >= exploring.guided).sum())
        return out

    def _collect(self, n: int, exploring: Exploring, out: Transitions) -> None:
        """Make one decision in each of the first n worlds."""
        with naming_tests(self._actors.worlds):
            collect(n, exploring, self._setting, self._reward, self._actors, self._scratch, self._keep, out)
        warn_of_left_out(self._scratch)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that `act` changes and needs again, by name; views."""
        actors = self._actors
        return {
            **{f"worlds.{name}": array for name, array in actors.worlds.arrays().items()},
            "observation": actors.observation,
            "allowed": actors.allowed,
            "actions": actors.history.action,
            "finished": self.finished,
        }

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` gave."""
        for name, ours in _Actor.arrays(self).items():
            ours[...] = saved[name]


class _OutsideActor(_Actor):
    """The same worlds with an AV from outside, which a collector asks."""

    def __init__(
        self, setting: Setting, slots: int, config: TrainConfig, seed: int, verdict: Verdict | None, av: ForeignAv,
        threads: int,
    ) -> None:  # fmt: skip
        super().__init__(setting, slots, config, seed, verdict)
        self._collector = ForeignCollector(av, setting, slots, self._actors, threads)

    def warm_up(self, exploring: Exploring) -> None:
        self._collector.warm_up(exploring, self._reward, allocate_transitions(1))

    def _collect(self, n: int, exploring: Exploring, out: Transitions) -> None:  # noqa: ARG002
        self._collector.collect(exploring, self._reward, out)

    def arrays(self) -> dict[str, NDArray[Any]]:
        return super().arrays() | self._collector.arrays()

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        super().restore(saved)
        self._collector.restore(self._seed, saved)

    def close(self) -> None:
        """End the AV's processes."""
        self._collector.close()


def _learning_rate(config: TrainConfig, decisions: int, share_of_time: float = 0.0) -> float:
    """Let the rate fall as a cosine from first to final over the planned decisions, or over the time if shorter."""
    done = min(1.0, max(decisions / config.decisions, share_of_time))
    share = 0.5 * (1.0 + float(np.cos(np.pi * done)))
    return config.final_learning_rate + (config.learning_rate - config.final_learning_rate) * share


def train_adversary(
    setting: Setting,
    slots: int,
    config: TrainConfig,
    *,
    av: ForeignAv | None = None,
    verdict: Verdict | None = None,
    seed: int = 0,
    threads: int = 2,
    max_seconds: float | None = None,
    progress: Callable[[CurvePoint], None] | None = None,
    checkpoint: CheckpointFile | None = None,
) -> TrainResult:
    """Learn to make the AV crash by controlling the BV nearest to it (paper, equations 5 to 9).

    Args:
        setting: The run; its adversary and policy are replaced by the learning one, its mask (`bounded`) is used.
        slots: Vehicle slots per world.
        config: Hyperparameters; `config.decisions` says how long, rounded up to whole iterations.
        av: The AV, if it is a foreign one and the setting's AV is OUTSIDE. Tests in which it fails are in its `faults`.
        verdict: Which crashes are paid for, under a reward that is judged by cases; None: under any other.
        seed: Determines tests, exploration, initial weights and batches.
        threads: 1 acts and learns by turns, more do both at once; the result is the same.
        max_seconds: Stop earlier after this time [s], over which the learning rate falls; then the result depends on
            the machine's speed.
        progress: Called with each new point of the curve.
        checkpoint: File for the state, written now and then and on Ctrl-C. If it exists, training continues from it,
            to the same result as without the stop; seconds count on. Remove it once the result is safe.

    Returns:
        Final weights and the training curve.

    Raises:
        InputError: The seed is out of range, the checkpoint is of another training, or the verdict does not go with
            the reward.
        FileFormatError: The checkpoint is damaged.
        OutputError: The checkpoint cannot be written.
        AvFaultError: The foreign AV failed in too many tests.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)

    with ExitStack() as stack:

        def worlds(numbers: PolicyNumbers) -> Actor:
            learnt = setting.with_drivers(critical=controllers.TOLD, policy=numbers)
            if av is None:
                return _Actor(learnt, slots, config, seed, verdict)
            return stack.enter_context(closing(_OutsideActor(learnt, slots, config, seed, verdict, av, threads)))

        return train_in(worlds, config, seed, threads, max_seconds, progress, checkpoint)


def train_in(
    worlds: Callable[[PolicyNumbers], Actor], config: TrainConfig, seed: int, threads: int, max_seconds: float | None,
    progress: Callable[[CurvePoint], None] | None, checkpoint: CheckpointFile | None,
) -> TrainResult:  # fmt: skip
    """Do the same for any driver in any worlds; `worlds` makes them for the network's first weights."""
    n_torch = torch.get_num_threads()
    torch.set_num_threads(1)  # one core for learning: results do not depend on the machine's number of cores
    try:
        return _train(worlds, config, seed, threads, max_seconds, progress, checkpoint)
    finally:
        torch.set_num_threads(n_torch)


class _Training:
    """State of a training: all that an iteration changes."""

    def __init__(self, worlds: Callable[[PolicyNumbers], Actor], config: TrainConfig, seed: int) -> None:
        self._config = config
        self._learner = config.make_learner(seed)
        exploring = self._learner.exploring(0)
        self._actor = worlds(exploring.policy)
        self._buffer = allocate_transitions(config.worlds)
        self._seen = np.zeros_like(self._actor.finished)
        self.point_every = _POINT_EVERY
        self.result = TrainResult(exploring.policy.weights, 0, 0, 0.0)
        self._actor.warm_up(exploring)

    def iterate(self, pool: ThreadPoolExecutor, threads: int, share_of_time: float) -> None:
        """Make one decision in each world, and the updates that are due."""
        config, learner, decisions = self._config, self._learner, self.result.decisions
        acting = pool.submit(self._actor.act, learner.exploring(decisions), self._buffer)
        if threads == 1:
            acting.result()
        learner.learn(_learning_rate(config, decisions, share_of_time))
        learner.note(acting.result())
        self.result.decisions += config.worlds

    def add_point(self) -> CurvePoint:
        """Add the running point to the curve."""
        result, finished = self.result, self._actor.finished
        tests, crashes, _, *paid = (int(n) for n in finished - self._seen)
        self._seen[:] = finished
        rate = crashes / tests if tests else None
        paid_rate = paid[0] / tests if tests and paid else None
        point = CurvePoint(
            decisions=result.decisions, seconds=round(result.seconds, 3), updates=self._learner.updates,
            **self._learner.point(result.decisions - self._config.worlds),
            tests=tests, crashes_per_test=rate, paid_per_test=paid_rate,
        )  # fmt: skip
        result.curve.append(point)
        if len(result.curve) == _MOST_POINTS:
            result.curve[:] = [_joined(*pair) for pair in zip(result.curve[::2], result.curve[1::2], strict=True)]
            self.point_every *= 2
        return point

    def finish(self) -> TrainResult:
        """Give the result, with the present weights."""
        self.result.weights = self._learner.exploring(self.result.decisions).policy.weights
        self.result.updates = self._learner.updates
        return self.result

    def state(self) -> TrainingState:
        """Give the state between two iterations; its arrays are views."""
        result = self.result
        arrays = {f"actor.{name}": array for name, array in self._actor.arrays().items()}
        arrays |= {"seen": self._seen, **{f"learner.{name}": a for name, a in self._learner.arrays().items()}}
        values = {
            "decisions": result.decisions,
            "seconds": result.seconds,
            "point_every": self.point_every,
            "curve": [asdict(point) for point in result.curve],
            "learner": self._learner.values(),
        }
        return TrainingState(arrays, values)

    def restore(self, saved: TrainingState) -> None:
        """Restore the state that `state` gave."""
        values = saved.values
        self._actor.restore(below("actor", saved.arrays))
        self._learner.restore(below("learner", saved.arrays), values["learner"])
        self._seen[:] = saved.arrays["seen"]
        self.point_every = values["point_every"]
        self.result.decisions = values["decisions"]
        self.result.seconds = values["seconds"]
        self.result.curve = [CurvePoint(**point) for point in values["curve"]]


def _take_up(training: _Training, checkpoint: CheckpointFile) -> None:
    """Restore the state of the checkpoint, if there is one."""
    saved = checkpoint.read()
    if saved is None:
        return
    try:
        training.restore(saved)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:  # PyTorch's for a wrong shape is the last
        raise FileFormatError(
            f"Checkpoint {checkpoint.path} does not fit this training ({error}); remove it to begin again."
        ) from error


@contextmanager
def _interrupt_held(wanted: bool) -> Iterator[Callable[[], bool]]:
    """Hold back Ctrl-C if wanted; gives a function that says whether it came.

    Within an iteration the weights are newer than the memory, so no state can be written there. A second Ctrl-C goes
    through at once. Only Python's own handler is replaced, and only in the main thread, where interrupts arrive.
    """
    came = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not (wanted and main and before is signal.default_int_handler):
        yield came.is_set
        return

    def note(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        signal.signal(signal.SIGINT, before)
        came.set()

    signal.signal(signal.SIGINT, note)
    try:
        yield came.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def _train(
    worlds: Callable[[PolicyNumbers], Actor], config: TrainConfig, seed: int, threads: int, max_seconds: float | None,
    progress: Callable[[CurvePoint], None] | None, checkpoint: CheckpointFile | None,
) -> TrainResult:  # fmt: skip
    training = _Training(worlds, config, seed)
    if checkpoint is not None:
        _take_up(training, checkpoint)
    result = training.result
    start = time.perf_counter() - result.seconds  # the time to compile kernels is not the training's
    iterations = -(-config.decisions // config.worlds)
    with ThreadPoolExecutor(1) as pool, _interrupt_held(checkpoint is not None) as interrupted:
        for iteration in range(result.decisions // config.worlds, iterations):
            training.iterate(pool, threads, result.seconds / max_seconds if max_seconds else 0.0)
            result.seconds = time.perf_counter() - start
            last = iteration == iterations - 1 or (max_seconds is not None and result.seconds >= max_seconds)
            try:
                if last or (iteration + 1) % training.point_every == 0:
                    point = training.add_point()
                    if progress is not None:
                        progress(point)
                if interrupted():
                    raise KeyboardInterrupt
            except KeyboardInterrupt:
                if checkpoint is not None:
                    checkpoint.write(training.state())
                raise
            if last:
                break
            if checkpoint is not None and checkpoint.is_due():
                checkpoint.write(training.state())
    return training.finish()
