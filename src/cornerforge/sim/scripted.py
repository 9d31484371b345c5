"""Scripted drives: a world starts from given vehicles, the BVs follow a script, the AV decides by itself.

Seed and number name a test because its start and its BVs' decisions are drawn from them. A case that has been changed
(`analysis/shrink.py`) has no name of that kind: a script gives every vehicle's start and every BV's actions. Rules,
motion and contacts are as in natural tests, in the same kernels, so the script of a recorded crash of the AV gives that
crash again, bit for bit. Instead of actions the others may have rails (`rails`): then they move as those say.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from cornerforge._checks import check_integer
from cornerforge._jit import kernel
from cornerforge.errors import AvFaultError, InputError
from cornerforge.fields import POSE
from cornerforge.sim import lockstep
from cornerforge.sim.controllers import HIDDEN, LIKELIEST, NOBODY, RAILS, RECORDED, SCRIPTED, STEERED
from cornerforge.sim.keep import Keep, keep_nothing
from cornerforge.sim.loop import AV_MUST_ANSWER, MILESTONE, advance
from cornerforge.sim.outcome import AV_CRASH, RUNNING
from cornerforge.sim.perception import begin_to_remember
from cornerforge.sim.rails import NO_RAILS, Rails, put_on_rails, rails_of, set_speed_of
from cornerforge.sim.recorder import Recording
from cornerforge.sim.scratch import warn_of_left_out
from cornerforge.sim.step import record_frame
from cornerforge.sim.traffic import clear_world, reset_world
from cornerforge.sim.world import AGENT, COMES, NO_ACTION, VEHICLE, all_current
from cornerforge.types import N_ACTIONS, SUBSTEPS, Odd, Scenario

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager

    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "AGENT_FIELDS",
    "AT_SITE",
    "NATURAL",
    "SITE_FIELDS",
    "START_FIELDS",
    "TRAITS",
    "Asked",
    "Ending",
    "Script",
    "ScriptDriver",
    "average_traits",
    "scripted_start",
    "start_values",
]

NATURAL = NO_ACTION
"""Entry of a script: the likeliest action of the naturalistic model in the present state (the lowest index of several
equally likely). In recordings it stands where a vehicle is absent, and means nothing."""

TRAITS = ("quantile", "habit", "desired_speed", "change_time", "signals", "away", "noise", "inattention")
"""Traits of a driver; starts that were stored before drivers had them lack these fields (`average_traits`)."""
_MOST_FAULTS = 20
_LEAST_SIZE, _MOST_SIZE = (0.5, 0.3), (30.0, 4.0)
"""Length and width [m] that a vehicle on rails may have."""
_FOLLOWING = ("x_held", "speed_held", "present", "action", "commanded", "acceleration_held")
START_FIELDS = tuple(name for name in VEHICLE.names or () if name not in _FOLLOWING)
"""Fields of `world.VEHICLE` that make a start, as files hold them: a new one goes to the end. The others follow: a
vehicle that starts is present, has decided nothing yet, and decides at that moment."""
AT_SITE = np.dtype([*VEHICLE.descr, *AGENT.descr, ("lights", "f8")])
"""A vehicle or person at the start of a script at a site; `lights` is the time of the signals then [s], for all one."""
AGENT_FIELDS = (
    "present", "s", "route", "stage", "marks", "enters", "headway", "gaps", "manners", "cleared", "overlooks", "heeds",
    "lights", "resumes",
)  # fmt: skip
"""Fields of AT_SITE that make a start besides START_FIELDS; how an agent sees the world follows from the world."""
SITE_FIELDS = (*START_FIELDS, *AGENT_FIELDS)
"""Fields that make a start at a site, as files hold them."""


def average_traits(speed: NDArray[np.float64], change_time: float) -> NDArray[np.float64]:
    """Make the TRAITS of unknown drivers, (N, 8).

    They have medians; each desires the speed that it has, sets its indicator, looks at the road, is as noisy as all and
    looks away as often.

    Args:
        speed: Speed of each [m/s], (N,).
        change_time: How long their lane changes take [s].
    """
    half = np.full(speed.size, 0.5)
    none, one = np.zeros(speed.size), np.ones(speed.size)
    return np.stack([half, half, speed, np.full(speed.size, change_time), one, none, none, one], axis=1)


@dataclass(frozen=True)
class Script:
    """A start and the BVs' actions from there on; nothing is drawn.

    Attributes:
        slot: Names of the vehicles, int16 (N,), ascending, at least one; the first is 0, the AV.
        start: States of all vehicles, (N,) of `world.VEHICLE`, at a site of AT_SITE; make them with `scripted_start`.
            At a site those are among them that come later.
        action: Action index of each vehicle at each decision (1 s apart), int8 (K, N), K at least 1; NATURAL for the
            likeliest. The AV's column is ignored: the AV decides by itself.
        seed, test: Its name, of which an AV from outside is told a number (`foreign.driver.seeds_of`).
        poses: Rails of the others, float64 (F, N, POSE_NUMBERS), with at least 10 K + 1 frames; None: the others follow
            their actions. The AV's own, column 0, are read only where it drives as recorded. On rails `action` says
            only how long the script is, and `desired_speed` of the AV's start, if it is above 0, at which speed the AV
            is set to drive [m/s].
        hidden: Slot that the AV loses in the second of each decision (`Scenario.hidden_slots`), -1 for none, int16
            (H,); in later ones it loses none so.
    """

    slot: NDArray[np.int16]
    start: NDArray[np.void]
    action: NDArray[np.int8]
    seed: int = 0
    test: int = 0
    poses: NDArray[np.float64] | None = None
    hidden: NDArray[np.int16] = field(default_factory=lambda: np.empty(0, dtype=np.int16))

    def __post_init__(self) -> None:
        n = self.slot.size
        if self.slot.shape != (n,) or n == 0 or self.slot[0] != 0 or (np.diff(self.slot) <= 0).any():
            raise InputError(f"slot = {self.slot.tolist()}: slots must ascend from 0, the AV.")
        if self.start.dtype not in (VEHICLE, AT_SITE) or self.start.shape != (n,):
            raise InputError(f"start has shape {self.start.shape} of {self.start.dtype}; allowed: ({n},) of VEHICLE.")
        if self.action.ndim != 2 or self.action.shape[0] == 0 or self.action.shape[1] != n:
            raise InputError(f"action has shape {self.action.shape}; allowed: (decisions, {n}), at least one decision.")
        if self.action.min() < NATURAL or self.action.max() >= N_ACTIONS:
            raise InputError(f"action must lie in [{NATURAL}, {N_ACTIONS - 1}]; it goes from {self.action.min()} to "
                             f"{self.action.max()}.")  # fmt: skip
        if self.poses is not None and len(self.poses) <= SUBSTEPS * len(self.action):
            raise InputError(
                f"A script of {len(self.action)} s needs {SUBSTEPS * len(self.action) + 1} frames on rails; it has "
                f"{len(self.poses)}."
            )
        if self.poses is not None:
            rails_of(self.start[None], self.poses[None])

    def of(self, columns: NDArray[np.bool_]) -> Script:
        """Take the script of some vehicles only, bool (N,); the AV must be one of them."""
        poses = None if self.poses is None else self.poses[:, columns]
        return replace(
            self, slot=self.slot[columns], start=self.start[columns], action=self.action[:, columns], poses=poses
        )


@dataclass(frozen=True)
class Ending:
    """How a scripted drive ended.

    Attributes:
        pose: [x m, y m, speed m/s, heading rad] of the AV and its crash partner in the frame of contact, float64
            (2, 4); None without a crash of the AV.
        partner: Slot of the crash partner, -1 without a crash of the AV.
        frame: Frame (0.1 s) of the contact, counted from the start; 0 without a crash of the AV.
        bv_crashes: Crashes between BVs.
        failed: An AV from outside failed before it was over, so that nothing is known of the rest.
    """

    pose: NDArray[np.float64] | None
    partner: int
    frame: int
    bv_crashes: int
    failed: bool = False


class Asked(Protocol):
    """An AV outside the kernels that can be asked about a test of one's own making."""

    @property
    def controller(self) -> int:
        """OUTSIDE or STEERED."""

    def in_test(
        self, slots: int, seed: int, test: int, set_speed: float
    ) -> AbstractContextManager[tuple[NDArray[Any], Callable[[], NDArray[np.float64]]]]:
        """Let it begin a test of this name: it remembers nothing of before, and is set to drive at a speed [m/s].

        Returns:
            Where what it sees goes, (1, rows, columns), and what asks it about that: it returns its answer, (1, W), or
            raises AvFaultError.
        """


def scripted_start(fields: NDArray[np.float64]) -> NDArray[np.void]:
    """Make states for `Script.start` from values of START_FIELDS, float64 (N, len(START_FIELDS)), or of SITE_FIELDS.

    Raises:
        InputError: The shape is wrong, or a value is not finite.
    """
    at_site = fields.ndim == 2 and fields.shape[1] == len(SITE_FIELDS)
    names = SITE_FIELDS if at_site else START_FIELDS
    if fields.ndim != 2 or fields.shape[1] != len(names) or not np.isfinite(fields).all():
        raise InputError(f"A start is finite numbers of shape (vehicles, {len(START_FIELDS)}); this is {fields.shape}.")
    start = np.zeros(len(fields), dtype=AT_SITE if at_site else VEHICLE)
    start["present"] = 1
    for name, values in zip(names, fields.T, strict=True):
        start[name] = values
    start["x_held"], start["speed_held"] = start["s" if at_site else "x"], start["speed"]
    start["commanded"] = start["acceleration_held"] = start["acceleration"]
    start["action"] = -1
    return start


def start_values(start: NDArray[np.void]) -> NDArray[np.float64]:
    """Give what `scripted_start` makes states of, float64 (N, fields)."""
    names = SITE_FIELDS if start.dtype == AT_SITE else START_FIELDS
    return np.stack([start[name].astype(np.float64) for name in names], axis=1)


def _with_losses(script: Script) -> NDArray[np.int8]:
    """Make the actions of a script as kernels take them (`Controllers.script`)."""
    action = np.array(script.action, order="C")
    for second, name in enumerate(script.hidden[: len(action)].tolist()):
        action[second, script.slot == name] += HIDDEN
    return action


def _sizes(script: Script) -> list[tuple[float, float]]:
    """Length and width of each vehicle [m]."""
    sizes: list[tuple[float, float]] = script.start[["length", "width"]].tolist()
    return sizes


def _fit(setting: Setting, sizes: Sequence[tuple[float, float]]) -> Setting:
    """Let the road hold vehicles of these sizes, if its cars have others."""
    road = setting.road
    if set(sizes) == {(road.length, road.width)}:
        return setting
    return setting._replace(
        road=road._replace(
            longest=max(road.longest, *(length for length, _ in sizes)),
            widest=max(road.widest, *(width for _, width in sizes)),
            one_size=False,
        )
    )


@kernel
def _put(w: World, script: tuple[int, int], start: NDArray[np.void], road: RoadNumbers) -> None:
    """Put a world at a start; `script`: seed and number of the test, which what the AV perceives is drawn of."""
    clear_world(w, script[0], script[1], 0)
    for i in range(start.size):
        w.vehicles[i] = start[i]
        w.order[i] = i
    w.state[0].n_vehicles = start.size
    all_current(w)
    if road.perception.late > 0:
        begin_to_remember(w, road)


def _put_at_site(w: World, script: Script) -> None:
    """Put a world at a start at a site."""
    clear_world(w, script.seed, script.test, 0)
    n = script.start.size
    for array in (w.vehicles, w.agents):
        for name in array.dtype.names or ():
            array[name][:n] = script.start[name]
    w.state["n_vehicles"], w.state["clock"] = n, script.start["lights"][0]
    all_current(w)


@kernel
def _put_on_rails(w: World, seed: int, rails: Rails, road: RoadNumbers) -> None:
    """Put a world at the start of a script on rails, the first test of a seed there."""
    clear_world(w, seed, rails.first, 0)
    put_on_rails(w, rails, road)
    if road.perception.late > 0:
        begin_to_remember(w, road)


@kernel
def _go_on(w: World, setting: Setting, s: Scratch, keep: Keep) -> int:
    """Drive on until an AV outside must answer, or the script or the test ends; returns what `advance` does.

    The outcome is RUNNING if the script ended first.
    """
    state = w.state[0]
    reason = advance(w, setting, s, keep, setting.who.script.shape[0])
    if reason == MILESTONE:
        state.frame = SUBSTEPS * state.decisions
        record_frame(w, state.frame, keep.recording)
    return reason


@kernel
def _answer(w: World, answer: NDArray[np.float64], setting: Setting) -> None:
    lockstep.answer_with(w, answer, setting)


class ScriptDriver(Recording):
    """Drives scripts in the world of one run; keeps its buffers, so one driver serves one thread.

    Args:
        setting: The run; its adversary, if any, is ignored.
        odd: The ODD that `setting.road` was made of.
        av: The AV from outside that drives; None: the built-in one of the setting.

    Raises (all that drives):
        InputError: The script has more vehicles or decisions than a test can have, or a vehicle of a size that does
            not occur in the ODD: contacts and bounds of motion know its sizes only. On rails any size from
            0.5 x 0.3 to 30 x 4 m will do.
        AvFaultError: An AV from outside fails; `drive` raises it when that happens 20 times in a row.
    """

    def __init__(self, setting: Setting, odd: Odd, av: Asked | None = None) -> None:
        super().__init__(setting, odd)
        self._av = av
        self._nothing = keep_nothing(self._world.order.size)
        self.max_decisions = int(setting.road.max_decisions)
        """Largest number of decisions of a script."""
        self.drives = 0
        """Scripts driven so far."""
        self._faults = 0  # in a row

    @property
    def av_steers(self) -> bool:
        """Does the AV steer, so that it hardly ever moves exactly along the road?"""
        return self._av is not None and self._av.controller == STEERED

    def _check(self, script: Script) -> None:
        check_integer("vehicles of a script", script.slot.size, low=1, high=self._world.order.size)
        check_integer("decisions of a script", len(script.action), low=1, high=self._setting.road.max_decisions)
        if self._odd.site is not None:
            if script.start.dtype != AT_SITE or script.poses is not None:
                raise InputError("At a site a script has a start of AT_SITE and no rails.")
            return
        allowed = self._odd.sizes_on_road
        for slot, size in zip(script.slot, _sizes(script), strict=True):
            if script.poses is not None and not all(
                low <= one <= most for low, one, most in zip(_LEAST_SIZE, size, _MOST_SIZE, strict=True)
            ):
                raise InputError(
                    f"Vehicle {slot} of the script is {size[0]:g} m long and {size[1]:g} m wide; allowed: "
                    f"{_LEAST_SIZE[0]:g} to {_MOST_SIZE[0]:g} m long, {_LEAST_SIZE[1]:g} to {_MOST_SIZE[1]:g} m wide."
                )
            if script.poses is None and size not in allowed:
                raise InputError(
                    f"Vehicle {slot} of the script is {size[0]:g} m long and {size[1]:g} m wide; allowed in ODD "
                    f"{self._odd.name}: {', '.join(f'{length:g} x {width:g} m' for length, width in allowed)}. Give it "
                    "one of these sizes, or drive it in an ODD with its class."
                )

    def _drive(self, script: Script, av_is_natural: bool, keep: Keep) -> None:
        self._check(script)
        self.drives += 1
        av = self._setting.who.av if self._av is None else self._av.controller
        if av == RECORDED and (script.poses is None or not np.isfinite(script.poses[:, 0]).all()):
            raise InputError(
                "The script does not say what the AV did, so it cannot drive as recorded; name another AV."
            )
        rails = NO_RAILS if script.poses is None else rails_of(script.start[None], script.poses[None], script.test)
        drivers = self._setting.with_drivers(
            av=LIKELIEST if av_is_natural else av,
            critical=NOBODY,
            others=SCRIPTED if script.poses is None else RAILS,
            script=_with_losses(script),
            rails=rails,
        )
        if script.poses is not None:
            drivers = _fit(drivers, _sizes(script))
            if (speed := set_speed_of(script.start)) is not None:
                drivers = drivers.with_set_speed(speed)
        if self._odd.site is not None:
            _put_at_site(self._world, script)
        elif script.poses is None:
            _put(self._world, (script.seed, script.test), script.start, drivers.road)
        else:
            _put_on_rails(self._world, script.seed, rails, drivers.road)
        if self._av is None or av_is_natural:
            _go_on(self._world, drivers, self._scratch, keep)
        else:
            self._drive_asking(self._av, script, drivers, keep)
        warn_of_left_out(self._scratch)

    def _drive_asking(self, av: Asked, script: Script, drivers: Setting, keep: Keep) -> None:
        set_speed = float(drivers.av.idm.desired_speed)
        with av.in_test(self._world.vehicles.size, script.seed, script.test, set_speed) as (views, ask):
            batch = lockstep.Batch(self._worlds, views)
            while _go_on(self._world, drivers, self._scratch, keep) == AV_MUST_ANSWER:
                lockstep.see(batch, drivers, self._scratch)
                _answer(self._world, ask()[0], drivers)

    def drive(self, script: Script, *, av_is_natural: bool = False) -> Ending:
        """Drive a script and say how it ended.

        Args:
            script: The script.
            av_is_natural: The AV too takes the likeliest action of the naturalistic model, once a second.
        """
        try:
            self._drive(script, av_is_natural, self._nothing)
        except AvFaultError:
            self._faults += 1
            if self._faults >= _MOST_FAULTS:
                raise
            return Ending(None, -1, 0, 0, failed=True)
        if not av_is_natural:
            self._faults = 0
        state = self._world.state[0]
        if state["outcome"] != AV_CRASH:
            return Ending(None, -1, 0, int(state["bv_crashes"]))
        pair = self._world.vehicles[[0, state["slot_b"]]]
        pose = np.stack([pair[name] for name in POSE], axis=1)
        return Ending(pose, int(script.slot[state["slot_b"]]), int(state["frame"]), int(state["bv_crashes"]))

    def record(self, script: Script, *, av_is_natural: bool = False) -> tuple[Scenario, NDArray[np.float64]]:
        """Drive a script and keep everything; `keep` then makes a case of it.

        Args:
            script: The script.
            av_is_natural: As for `drive`.

        Returns:
            The recording, and P(action) of each BV at each decision under the naturalistic model, float64 (K, N, 33);
            NaN where it is absent, for the AV, and after the end.
        """
        chances = np.full((len(script.action), script.slot.size, N_ACTIONS), np.nan)
        self._forget()
        self._drive(script, av_is_natural, self._keep._replace(chances=chances))
        self._driven(script.seed, script.test, script.slot)
        return self.scenario(), chances

    def record_branch(self, script: Script, answers: NDArray[np.float64]) -> Scenario:  # noqa: ARG002
        """Drive a branch of a test's tree and keep everything; a built-in AV needs no answers, (A, W)."""
        return self.record(script)[0]

    def start_of_test(self, seed: int, test: int) -> NDArray[np.void]:
        """Make the states of all vehicles at the start of a test, (N,) of `world.VEHICLE`; none changes lanes there.

        At a site of AT_SITE, with all that come in the test.
        """
        reset_world(self._world, seed, test, self._setting)
        return self._states(int(self._world.state["n_vehicles"][0]), 0)

    def _states(self, n: int, later: int) -> NDArray[np.void]:
        """Copy the states of the first n vehicles, (N,); at a site as of a test that begins `later` seconds later."""
        w = self._world
        if self._odd.site is None:
            return w.vehicles[:n].copy()
        states = np.zeros(n, dtype=AT_SITE)
        for array in (w.vehicles, w.agents):
            for name in array.dtype.names or ():
                states[name] = array[name][:n]
        states["lights"] = w.state["clock"][0] + later
        states["enters"] -= later
        states["resumes"] -= later
        for name in set(AGENT.names or ()) - set(AGENT_FIELDS):
            states[name] = 0
        return states

    def later(self, script: Script, decisions: int) -> Script | None:
        """Make the script that starts where this one is after some decisions, 0 or more; None if it is over by then.

        Vehicles taken off the road by then are left out. An AV that decides by the present state alone (all built-in
        AVs do) goes on from there as it did; one that remembers begins there without memory.
        """
        if decisions == 0:
            return script
        check_integer("decisions", decisions, low=0, high=len(script.action) - 1)
        if (
            self.drive(replace(script, action=script.action[:decisions])).failed
            or self._world.state["outcome"][0] != RUNNING
        ):
            return None
        states = self._states(script.slot.size, decisions)
        there = states["present"] == 1
        if self._odd.site is not None:
            there |= states["stage"] == COMES
        start = scripted_start(start_values(states[there]))
        poses = None if script.poses is None else script.poses[SUBSTEPS * decisions :, there]
        return replace(
            script,
            slot=script.slot[there],
            start=start,
            action=script.action[decisions:, there],
            poses=poses,
            hidden=script.hidden[decisions:],
        )
