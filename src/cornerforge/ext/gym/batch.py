"""Batches of worlds that an agent drives, shared by single and vector environments."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_integer
from cornerforge._words import shown
from cornerforge.adversary.verdicts import verdict_of
from cornerforge.adversary.worlds import (
    FINISHED,
    Actors,
    CrashCases,
    Group,
    RewardNumbers,
    Verdict,
    agents,
    allocate_history,
    reward_numbers,
)
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.setting import experiment
from cornerforge.ext.gym.raster import top_view
from cornerforge.ext.gym.spaces import N_SITE, ClosedError, ResetNeededError, av_commands, flat_scene
from cornerforge.foreign.networks import SIZES
from cornerforge.foreign.session import context_of
from cornerforge.sim import (
    Scratch,
    World,
    allocate_scratch,
    av_view,
    controllers,
    keep_nothing,
    naming_tests,
    outcome,
    warn_of_left_out,
)
from cornerforge.types import FRAME_S
from cornerforge.world_options import WorldOptions

__all__ = [
    "FIRST_TEST",
    "OUTCOMES",
    "AvBatch",
    "Batch",
    "BvBatch",
    "adversary_batch",
    "check_render_mode",
    "check_seed",
    "driving_batch",
    "read_options",
]

FIRST_TEST = 1 << 40
"""Number of the first test after `reset(seed=...)`: where training takes its tests too, far from the tests of
`simulate`, `generate` and evaluations, so that no agent is measured on tests that it learnt from."""
MAX_TEST = 1 << 62
OUTCOMES = {
    outcome.COMPLETED: "completed",
    outcome.AV_CRASH: "av-crash",
    outcome.BV_CRASH: "bv-crash",
    outcome.TIME_UP: "time-up",
    outcome.LEFT_ROAD: "left-road",
    agents.NOBODY_LEFT: "nobody-left",
    outcome.AV_FAULT: "av-fault",
}
"""How a test ends: the AV drove its length; the AV crashed; the controlled BV crashed with another BV; the time limit;
no BV is left; an AV from outside raised, hung, or gave no usable answer, and the test does not count."""
_ACT_EVERY = (1, 2, 5, 10)
_WORLDS_PER_THREAD = 64
"""Least number of worlds for each thread."""


def check_render_mode(render_mode: str, batch: Batch) -> None:
    """Check that a batch can be drawn so.

    Raises:
        InputError: The mode is not known, or the worlds are at a site.
    """
    check_in("render_mode", render_mode, ("rgb_array",))
    if batch.run.odd.site is not None:
        raise InputError(f"render_mode = {render_mode!r} draws roads only; leave it out at a site.")


def check_seed(seed: Any) -> int:
    """Return a seed that may name tests.

    Raises:
        InputError: It is no whole number from 0 to 2^63 - 1.
    """
    return check_integer("seed", seed, low=0, high=2**63 - 1)


def read_options(options: Mapping[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """A copy of the options of `reset`.

    Raises:
        InputError: They are no dictionary.
        UnknownNameError: One is not known.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InputError(f"options = {shown(options)} is not allowed; give None or a dictionary.")
    for name in options:
        if name not in known:
            raise UnknownNameError("option of reset", name, known)
    return dict(options)


class Batch(ABC):
    """B worlds, each with its own seed and running test.

    Args:
        run: The world; `run.setting` is used as it is.
        n: B.
        threads: Number of threads that share the worlds; None for all cores, but no fewer than 64 worlds each.
            Changes no result.

    Attributes:
        run: As given.
        seeds, tests: Seed and number of each world's test, int64 (B,).
        is_seeded: Worlds with a seed that was given or drawn, bool (B,).
        is_over: Worlds without a running test, bool (B,).
        outcome: int64 (B,), codes as in OUTCOMES, 0 while running.
        worlds: Their states.
    """

    observation: NDArray[np.float32]
    reward: NDArray[np.float64]

    def __init__(
        self, run: Experiment, n: int, threads: int | None, cores: int, driven: agents.BvAgents | agents.AvAgents
    ) -> None:
        self.run = run
        self.n = n
        self.worlds: World = driven.worlds
        self.seeds, self.tests, self.outcome = driven.seeds, driven.tests, driven.outcome
        self.tests[:] = FIRST_TEST - 1
        self.is_seeded = np.zeros(n, dtype=np.bool_)
        self.is_over = np.ones(n, dtype=np.bool_)
        wished = cores if threads is None else check_integer("threads", threads, low=1, high=1024)
        most = n if threads is not None else n // _WORLDS_PER_THREAD
        count = max(1, min(wished, most))
        edges = [n * k // count for k in range(count + 1)]
        self._parts = list(itertools.pairwise(edges))
        self._scratch = [allocate_scratch(run.slots, run.setting.who.policy) for _ in self._parts]
        self._keep = keep_nothing(run.slots)
        self._pool = ThreadPoolExecutor(count) if count > 1 else None
        self._is_closed = self._is_busy = False

    def _share(self, work: Callable[[int, int, Scratch, int], None]) -> None:
        """Let the threads work on their ranges of worlds: `work(begin, end, scratch, number)`."""
        if self._pool is None:
            work(0, self.n, self._scratch[0], 0)
        else:
            waiting = [
                self._pool.submit(work, begin, end, self._scratch[k], k) for k, (begin, end) in enumerate(self._parts)
            ]
            for future in waiting:
                future.result()
        for scratch in self._scratch:
            warn_of_left_out(scratch)

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        self._is_closed = True
        if self._pool is not None:
            self._pool.shutdown()

    def __getstate__(self) -> dict[str, Any]:
        """State that a copy takes over.

        Raises:
            InputError: Threads or processes work on the worlds, and they cannot be copied.
        """
        if self._pool is not None or self.run.asked is not None:
            raise InputError(
                "An environment with several threads, or with an AV from outside, cannot be copied; make another one."
            )
        return vars(self)

    def check_open(self) -> None:
        """Check that the worlds can be used now.

        Kernels run beside Python, so that a second thread could look at worlds, or move them, while the first one does.

        Raises:
            ClosedError: `close` was called.
            InputError: Another thread is at work.
        """
        if self._is_closed:
            raise ClosedError("The environment is closed; make another one.")
        if self._is_busy:
            raise InputError("Another thread is using this environment now; give each thread one of its own.")

    def check_begun(self) -> None:
        """Check that there is something to see in each world.

        Raises:
            ClosedError, InputError: As `check_open`.
            ResetNeededError: A world has not had a test yet.
        """
        self.check_open()
        if not self.is_seeded.all():
            raise ResetNeededError("No test has begun; call reset() first.")

    def pictures(self, render_mode: str | None) -> list[NDArray[np.uint8]] | None:
        """Draw the road around each AV from above (`raster.top_view`); None, with a warning, without a render mode.

        Raises:
            ClosedError, InputError, ResetNeededError: As `check_begun`.
        """
        self.check_open()
        if render_mode is None:  # as Gymnasium's own environments do
            gymnasium.logger.warn(
                'There is no picture without a render mode; make the environment with render_mode="rgb_array".'
            )
            return None
        self.check_begun()
        return [top_view(self.worlds, b, self.run.odd) for b in range(self.n)]

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other threads out (`check_open`)."""
        self._is_busy = True
        try:
            yield
        finally:
            self._is_busy = False

    def name(self, b: int, seed: int | None, test: int | None, draw: Callable[[], int]) -> None:
        """Set the test that world b begins next: of another seed, of another number, or the next of its own.

        Args:
            b: The world.
            seed: A seed, after which tests count from FIRST_TEST on; None to go on.
            test: A test number; None for the next.
            draw: Function that gives a seed when none was ever given.
        """
        if seed is not None or not self.is_seeded[b]:
            self.seeds[b] = check_seed(draw() if seed is None else seed)
            self.tests[b] = FIRST_TEST - 1
            self.is_seeded[b] = True
        self.tests[b] = self.tests[b] + 1 if test is None else check_integer("test", test, low=0, high=MAX_TEST)

    def begin(self, chosen: NDArray[np.bool_]) -> None:
        """Put the chosen worlds, bool (B,), at the start of the tests that `tests` names.

        Raises:
            InputError: A test and many after it have no BV to control.
            UndrawableError: The traffic of a test cannot be drawn.
        """
        with self._alone(), naming_tests(self.worlds):
            self.is_over[chosen] = True
            self._start(chosen)
        self.outcome[chosen] = outcome.RUNNING
        self.is_over[chosen] = False
        self.reward[chosen] = 0.0

    def step(self, actions: NDArray[np.generic], chosen: NDArray[np.bool_]) -> None:
        """One decision of the chosen worlds, none of which may be over; `actions` are checked, of shape (B, ...)."""
        with self._alone():
            self._advance(actions, chosen)
            self._note_ends(chosen)

    def _note_ends(self, chosen: NDArray[np.bool_]) -> None:
        self.is_over[chosen] = self.outcome[chosen] != outcome.RUNNING

    def case(self, b: int) -> str:
        """Give the name of world b's test, `seed:test`."""
        return f"{self.seeds[b]}:{self.tests[b]}"

    def time(self) -> NDArray[np.float64]:
        """Give the times at which the tests ended [s], (B,); meaningless where they run."""
        return np.asarray(np.round(self.worlds.state["frame"][:, 0] * FRAME_S, 1))

    @property
    @abstractmethod
    def truncated(self) -> NDArray[np.bool_]:
        """Mark worlds with a test that was cut off, bool (B,): Gymnasium's `truncated`."""

    @abstractmethod
    def extra(self) -> dict[str, NDArray[Any]]:
        """Give further entries of `info` for the present moment: fresh arrays with a leading axis B."""

    @abstractmethod
    def acted(self) -> dict[str, NDArray[Any]]:
        """Give further entries of `info` after a step: fresh arrays (B,)."""

    @abstractmethod
    def _start(self, chosen: NDArray[np.bool_]) -> None: ...

    @abstractmethod
    def _advance(self, actions: NDArray[np.generic], chosen: NDArray[np.bool_]) -> None: ...


class BvBatch(Batch):
    """Worlds in which the agent is the BV nearest to the AV.

    Args:
        run, n, threads, cores: As for `Batch`.
        reward: Which crashes give the agent its reward.
        verdict: Which crashes are paid for, under a reward that is judged by cases.

    Attributes:
        observation: float32 (B, N_OBSERVATION).
        allowed: Action mask, bool (B, 33).
    """

    def __init__(
        self, run: Experiment, n: int, threads: int | None, cores: int, reward: RewardNumbers,
        verdict: Verdict | None = None,
    ) -> None:  # fmt: skip
        self._agents = agents.allocate_bv_agents(n, run.slots, run.setting.road)
        super().__init__(run, n, threads, cores, self._agents)
        self._setting = run.opened_setting.with_drivers(critical=controllers.TOLD)
        self._pays = reward
        self._cases = None if verdict is None else CrashCases(self._setting, run.slots, verdict)
        done = allocate_history(n, run.setting, run.slots)
        scratch = (allocate_history(0, run.setting, run.slots) for _ in self._parts[1:])
        self._histories = [done, *(own._replace(action=done.action, crashed=done.crashed) for own in scratch)]
        self._outside = None
        if run.asked is not None:
            none = np.zeros((n, 0), dtype=np.float32), self._agents.allowed, np.zeros(1, dtype=FINISHED)
            actors = Actors(self._agents.worlds, done, *none)
            self._outside = Group(run.asked, self._setting, run.slots, actors, np.arange(n), n)
        self.observation, self.allowed, self.reward = (
            self._agents.observation,
            self._agents.allowed,
            self._agents.reward,
        )

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Mark worlds that the time limit, or a fault of an AV from outside, cut off."""
        return np.asarray((self.outcome == outcome.TIME_UP) | (self.outcome == outcome.AV_FAULT))

    def extra(self) -> dict[str, NDArray[Any]]:
        """The action mask, int8 (B, 33), as Gymnasium's `Discrete.sample` takes it."""
        return {"action_mask": self.allowed.astype(np.int8)}

    def acted(self) -> dict[str, NDArray[Any]]:
        """The action carried out."""
        return {"action": self._agents.action.copy()}

    def close(self) -> None:
        """End the threads, and the processes of an AV from outside."""
        super().close()
        if self._outside is not None:
            self._outside.close()
        self.run.rest()

    def _start(self, chosen: NDArray[np.bool_]) -> None:
        self._agents.chosen[:] = chosen

        def work(begin: int, end: int, s: Scratch, k: int) -> None:  # noqa: ARG001
            agents.start_as_bv(begin, end, self._setting, self._agents, s, self._keep)

        self._share(work)
        self._histories[0].answered[chosen] = 0

    def _advance(self, actions: NDArray[np.generic], chosen: NDArray[np.bool_]) -> None:
        self._agents.chosen[:] = chosen
        self._agents.action[:] = actions
        if self._outside is not None:
            done, s = self._histories[0], self._scratch[0]
            agents.begin_step_as_bv(0, self.n, self._agents, done)
            self._outside.drive_second(np.flatnonzero(chosen))
            agents.end_step_as_bv(0, self.n, self._setting, self._pays, self._agents, done, s)
            warn_of_left_out(s)
        else:

            def work(begin: int, end: int, s: Scratch, k: int) -> None:
                own = self._histories[k]
                agents.step_as_bv(begin, end, self._setting, self._pays, self._agents, own, s, self._keep)

            self._share(work)
        if self._cases is not None:
            self.reward[self._cases.judge(self.worlds, self._histories[0])] = 1.0


class AvBatch(Batch):
    """Worlds in which the agent is the AV.

    Args:
        run, n, threads, cores: As for `Batch`; `run.setting.road.av_substeps` is 1, 2, 5 or 10.
        box: Actions are pairs of numbers, at a site one, instead of indices (`spaces.av_commands`).
        scaled: Observations are divided by `networks.SIZES`, at a site by `spaces.SITE_SIZES`.

    Attributes:
        observation: float32 (B, VIEW_ROWS, VIEW_COLUMNS); at a site (B, N_SITE).
    """

    def __init__(
        self, run: Experiment, n: int, threads: int | None, cores: int, *, box: bool, scaled: bool = False
    ) -> None:
        self._agents = agents.allocate_av_agents(n, run.slots, run.setting.road)
        super().__init__(run, n, threads, cores, self._agents)
        self._setting = run.setting.with_drivers(av=controllers.OUTSIDE)
        self._box, self._scaled = box, scaled
        self._site = run.odd.site
        self.observation = self._agents.seen.copy() if scaled else self._agents.seen
        if self._site is not None:
            self.observation = np.zeros((n, N_SITE), dtype=np.float32)
            self._lengths = np.array([route.length for route in self._site.routes])
        self.reward = np.zeros(n)
        self._context = context_of(run.odd, batch=n, seed=0)

    @property
    def truncated(self) -> NDArray[np.bool_]:
        """Mark worlds that the time limit or a crash between BVs cut off."""
        return np.asarray((self.outcome == outcome.TIME_UP) | (self.outcome == outcome.BV_CRASH))

    def extra(self) -> dict[str, NDArray[Any]]:
        """Where lanes end, the way after which the AV must have left each [m], (B, lanes): `lane_ends_in`."""
        if not self._context.lanes:
            return {}
        x = self._context.test_length - self._agents.seen[:, 0, av_view.AHEAD, None]
        return {"lane_ends_in": self._context.lane_ends_in(np.arange(self._context.n_lanes), x)}

    def acted(self) -> dict[str, NDArray[Any]]:
        """Metres driven in this step."""
        return {"metres": self._agents.metres.copy()}

    def _start(self, chosen: NDArray[np.bool_]) -> None:
        self._agents.chosen[:] = chosen

        def work(begin: int, end: int, s: Scratch, k: int) -> None:  # noqa: ARG001
            agents.start_as_av(begin, end, self._setting, self._agents, s)

        self._share(work)
        self._see()

    def _advance(self, actions: NDArray[np.generic], chosen: NDArray[np.bool_]) -> None:
        command, order = av_commands(actions, box=self._box, at_site=self._site is not None)
        self._drive(command, order, chosen)

    def drive(self, command: NDArray[np.float64], order: NDArray[np.int64], chosen: NDArray[np.bool_]) -> None:
        """Step by acceleration [m/s2] and lane order (`sim.actions.ordered_lane`), each (B,); else as `step`."""
        self._drive(command, order, chosen)
        self._note_ends(chosen)

    def _see(self) -> None:
        if self._site is not None:
            self.observation[:] = flat_scene(self._agents.seen, scaled=self._scaled)
        elif self._scaled:
            np.divide(self._agents.seen, SIZES, out=self.observation)

    def _drive(self, command: NDArray[np.float64], order: NDArray[np.int64], chosen: NDArray[np.bool_]) -> None:
        self._agents.chosen[:] = chosen
        self._agents.command[:] = command
        self._agents.order[:] = order

        def work(begin: int, end: int, s: Scratch, k: int) -> None:  # noqa: ARG001
            agents.drive_on_as_av(begin, end, self._setting, self._agents, s, self._keep)

        self._share(work)
        self._see()
        lengths = self.run.setting.road.test_length
        if self._site is not None:
            lengths = self._lengths[self.worlds.agents["route"][:, 0]]
        self.reward[:] = self._agents.metres / lengths - (self.outcome == outcome.AV_CRASH)


def adversary_batch(n: int, threads: int | None, world: WorldOptions, *, reward: str, delay: float = 1.0) -> BvBatch:
    """Make the worlds for `Adversary-v0`; arguments as for `AdversaryEnv`."""
    pays = reward_numbers(reward, delay)
    # The agent chooses the actions of the controlled BV from the start of a test on; an adversary is named so that the
    # mask may be bounded.
    run = experiment(world, bv="uniform", takes_foreign=True, steer_from=0)
    return BvBatch(run, n, threads, check_threads(None), pays, verdict_of(reward, run))


def driving_batch(
    n: int, threads: int | None, world: WorldOptions, *, bv: str, box: bool, act_every: int | None, scaled: bool = False
) -> AvBatch:
    """Make the worlds for `Driving-v0`; arguments as for `DrivingEnv`."""
    if world.site is not None:  # the AV is the agent; one that may stand at a site is named in its place
        world = replace(world, av="idm-yield")
    run = experiment(world, bv=bv)
    if act_every is not None:
        if act_every not in _ACT_EVERY:
            raise InputError(f"act_every = {act_every!r} is not allowed; one of 1, 2, 5 or 10 tenths of a second.")
        road = run.setting.road._replace(av_substeps=act_every)
        run = replace(run, odd=replace(run.odd, av_substeps=act_every), setting=run.setting._replace(road=road))
    return AvBatch(run, n, threads, check_threads(None), box=box, scaled=scaled)
