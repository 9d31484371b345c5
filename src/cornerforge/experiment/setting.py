"""Building what the simulator takes (model, AV, ODD, adversary) from names and files."""

from __future__ import annotations

import hashlib
import shlex
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cornerforge._checks import check_integer, check_number
from cornerforge.drivers.avs import AvModel, av_hash, av_named, numbers_of_av
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.execution import default_threads, is_spread
from cornerforge.experiment.av_file import av_of
from cornerforge.experiment.named_avs import remember
from cornerforge.experiment.output import config_hash
from cornerforge.experiment.policy_file import Policy, check_budget, load_policy, policy_hash, policy_numbers
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.interpreter import Confines
from cornerforge.foreign.loaders import is_foreign
from cornerforge.foreign.recorder import ForeignRecorder
from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash
from cornerforge.road.straight import road_numbers
from cornerforge.sim import (
    ADVERSARIES,
    BUILT_IN,
    IDM_BVS,
    NATURALISTIC,
    NO_CAST,
    RECORDED,
    STEERED,
    Controllers,
    DriveChunk,
    Recorder,
    ScriptDriver,
    Setting,
    budget_units,
    cast_of,
    drive_chunk,
    n_slots,
    warm_up,
)
from cornerforge.types import Odd, odd_named
from cornerforge.world_options import WorldOptions

__all__ = [
    "AV_LOG",
    "RECORDED_AV",
    "TEMPERATURE",
    "Experiment",
    "check_av_options",
    "check_threads",
    "experiment",
    "road_of",
    "temperature_of",
]

RECORDED_AV = "recorded"
"""Name of the AV of cases on rails in which whatever was in its seat moves as it was recorded."""
AV_LOG = "av.log"
"""File in an output folder that keeps what a foreign AV prints."""
TEMPERATURE = 0.05
"""Temperature of `softmax` without a number [units of Q]: actions with nearly equal Q are taken nearly as often."""


@dataclass(frozen=True)
class Experiment:
    """Everything constant in a run, under the user's names and in the form for kernels.

    Attributes:
        odd, av, model: The world. For a foreign AV `av` is idm-mobil under the foreign AV's name: tests start with at
            least the desired gap of idm-mobil.
        bv: How BVs drive: "nde", "idm", a plain adversary's name, or "policy".
        bounded: The NDD-bounded mask is on (in a mixture: for every policy).
        policies: The adversary's policies when `bv` is "policy"; each test is driven by one of them.
        budget: Likelihood budget of a test [nats]; None: no limit, or not the same for all policies.
        acting: How policies act: "greedy" or "softmax:T".
        setting: The kernels' form of all this.
        slots: Vehicle slots per world.
        foreign: The foreign AV; None for a built-in AV.
    """

    odd: Odd
    av: AvModel
    model: NddModel
    bv: str
    bounded: bool
    policies: tuple[Policy, ...]
    budget: float | None
    acting: str
    setting: Setting
    slots: int
    foreign: ForeignAv | None = None

    @property
    def av_hash(self) -> str:
        """Hash of the AV: of its parameters, or of a foreign AV's source or file."""
        if self.av.name == RECORDED_AV:
            return config_hash({"av": RECORDED_AV})
        return av_hash(self.av) if self.foreign is None else self.foreign.hash

    @property
    def av_steers(self) -> bool:
        """Does the AV steer or follow trajectories, instead of ordering lanes?"""
        return self.setting.who.av == STEERED

    @property
    def drive(self) -> DriveChunk:
        """Return the function that drives a range of tests."""
        return drive_chunk if self.foreign is None else self.foreign

    def processes(self, threads: int | None) -> int:
        """Return how many ranges of tests are driven at the same time: as many as threads, or processes of the AV."""
        n = check_threads(threads)
        return n if self.foreign is None else self.foreign.processes or n

    def range_size(self, usual: int, tests: int, threads: int | None) -> int:
        """Return how many tests are driven as one range: `usual`, or fewer of a slow AV, so that all processes work."""
        if self.foreign is None:
            return usual
        return self.foreign.range_size(usual, self.setting, tests, self.processes(threads))

    def answered(self) -> Callable[[], int] | None:
        """Return what counts the answers of a slow AV from outside, for `moving`; None for all others."""
        if self.foreign is None or self.foreign.pace.usual(self.foreign.batch) < 0.05:
            return None
        pace = self.foreign.pace
        return lambda: pace.answers

    def warm_up(self) -> None:
        """Load the compiled kernels, or compile them (once per installation), so that timings leave it out."""
        if self.foreign is not None:
            self.foreign.warm_up(self.setting, self.slots)
        else:
            warm_up(self.setting, self.slots)

    def rest(self) -> None:
        """End the processes of a foreign AV; when it drives again, new ones are started."""
        if self.foreign is not None:
            self.foreign.close()

    def keep_printed(self, file: Path) -> None:
        """Keep what a foreign AV prints, and its tracebacks, in a file, unless they have another one already."""
        if self.foreign is not None:
            self.foreign.log.keep_in(file)

    def recorder(self) -> Recorder:
        """Return the recorder of tests; it serves one thread."""
        if self.foreign is not None:
            return ForeignRecorder(self.foreign, self.setting, self.odd)
        return Recorder(self.setting, self.odd)

    def script_driver(self) -> ScriptDriver:
        """Return the driver of scripts, with the run's AV; it serves one thread."""
        return ScriptDriver(self.setting, self.odd, self.foreign)

    @property
    def policy(self) -> Policy | None:
        """The first policy; None if no policy drives."""
        return self.policies[0] if self.policies else None

    def identity(self, seed: int) -> dict[str, str | int | float | bool | None]:
        """Return what names a test, with its number: seed, names, and hashes of settings, model, policy and AV."""
        return {
            "seed": seed,
            "odd": self.odd.name,
            "lanes": self.odd.n_lanes,
            "av": self.av.name,
            "av_hash": self.av_hash,
            "model_hash": model_hash(self.model),
            "bv": self.bv,
            "bounded": self.bounded,
            "budget": self.budget,
            "acting": self.acting,
            "policies": len(self.policies),
            "policy_hash": _joint_hash(self.policies),
            **({"av_steers": True} if self.av_steers else {}),
            # Hashes come last: where two runs differ, messages name the first key, and a setting says more than a hash.
            "config_hash": config_hash(
                {
                    "odd": self.odd.stated(),
                    "bv": self.bv,
                    "bounded": self.bounded,
                    "budget": self.budget,
                    "acting": self.acting,
                }
            ),
        }


def check_threads(threads: int | None) -> int:
    """Return the number of threads to use; None means all cores.

    Raises:
        InputError: It is below 1.
    """
    return default_threads() if threads is None else check_integer("threads", threads, low=1, high=1024)


def check_av_options(world: WorldOptions) -> None:
    """Check how a foreign AV is asked: its time for an answer [s], worlds together, and processes.

    Raises:
        InputError: A number is out of range.
    """
    check_number("av_timeout", world.av_timeout, low=0.01, high=3600.0, unit="s")
    if world.av_batch is not None:
        check_integer("av_batch", world.av_batch, low=1, high=65_536)
    if world.av_processes is not None:
        check_integer("av_processes", world.av_processes, low=1, high=1024)


def confines_of(world: WorldOptions) -> Confines:
    """Say in what the processes of a foreign AV run."""
    return Confines(world.av_python, world.av_memory)


def _joint_hash(policies: Sequence[Policy]) -> str | None:
    """Hash a policy, or the policies of a mixture in their order; None without a policy."""
    hashes = [policy_hash(policy) for policy in policies]
    if len(hashes) <= 1:
        return hashes[0] if hashes else None
    return hashlib.sha256(" ".join(hashes).encode()).hexdigest()[:16]


def temperature_of(acting: str) -> float:
    """Return the temperature [units of Q]: 0 for "greedy", T for "softmax:T", `TEMPERATURE` for "softmax".

    Raises:
        UnknownNameError: The name is neither greedy nor softmax.
        InputError: T is not a number in [0.0001, 100].

    >>> temperature_of("greedy"), temperature_of("softmax:0.2")
    (0.0, 0.2)
    """
    name, colon, number = acting.partition(":")
    if name not in ("greedy", "softmax") or (name == "greedy" and colon):
        raise UnknownNameError("way to act", acting, ("greedy", "softmax", "softmax:T"))
    if name == "greedy":
        return 0.0
    if not colon:
        return TEMPERATURE
    try:
        temperature = float(number)
    except ValueError as error:
        raise InputError(f"acting = {acting!r}: {number!r} is no number; write for example softmax:0.1.") from error
    return check_number("temperature", temperature, low=1e-4, high=100.0)


def _load_policies(bv: Sequence[str], known: Sequence[str]) -> tuple[Policy, ...]:
    """Load policies from files.

    Raises:
        UnknownNameError, InputError: A name is no file of a policy.
        FileFormatError: A file is missing, damaged or of another version.
    """
    policies = []
    for name in bv:
        if name in known:
            raise InputError(f"A mixture is of policy files; {name} is none. Leave it out, or give it alone.")
        if not (name.endswith(".safetensors") or Path(name).exists()):
            raise UnknownNameError("driver of background vehicles", name, (*known, "FILE.safetensors"))
        policies.append(load_policy(Path(name)))
    return tuple(policies)


def _warn_of_another_world(policy: Policy, name: str, road: Odd, ndd: NddModel) -> None:
    """Warn if a policy was trained with another model or on another highway; it drives here all the same.

    Another AV causes no warning: policies are made to be tried on other AVs. A policy without a record of its world,
    for example one of Stable-Baselines3, causes none either.
    """
    odd = policy.about.get("odd")
    theirs = dict(odd) if isinstance(odd, dict) else {}
    ours = {"name": road.name, "n_lanes": road.n_lanes, "model": model_hash(ndd)}
    theirs["model"] = policy.about.get("model_hash", ours["model"])
    words = {"name": "ODD", "n_lanes": "lanes", "model": "naturalistic model"}
    other = [f"{words[key]} {theirs[key]}, here {here}" for key, here in ours.items() if theirs.get(key, here) != here]
    if other:
        warnings.warn(
            f"The policy {name} learned in another world ({'; '.join(other)}) and may be worse in this one; to learn "
            "here: cornerforge train.",
            stacklevel=3,
        )


def road_of(world: WorldOptions) -> Odd:
    """Return the ODD that a user names.

    Raises:
        UnknownNameError, InputError: There is no ODD of that name, or it cannot have that many lanes.
    """
    odd = odd_named(world.odd)
    return odd if world.lanes is None else replace(odd, n_lanes=world.lanes)


def experiment(
    world: WorldOptions | None = None,
    *,
    bv: str | Path | Sequence[str | Path] = "nde",
    policy: Policy | Sequence[Policy] | None = None,
    acting: str = "greedy",
    takes_foreign: bool = False,
    takes_recorded: bool = False,
    seed: int = 0,
    road: Odd | None = None,
    **keywords: Any,
) -> Experiment:
    """Build the experiment of a run.

    Args:
        world: The world; None for the default one.
        bv: "nde", "idm", a plain adversary ("uniform", "lane-changer", "swerve"), or the path of a policy file; several
            paths: each test is driven by one of these policies, drawn at random.
        policy: One or more policies in memory instead of paths in `bv`.
        acting: How a policy acts: "greedy", "softmax" or "softmax:T" (see `temperature_of`).
        takes_foreign: A foreign AV is allowed.
        takes_recorded: The AV may be RECORDED_AV: whatever was in its seat, as it was recorded; for cases on rails.
        seed: Seed that a foreign AV is told.
        road: ODD instead of the one that `world` names; a library has one of its own.
        keywords: Values that replace fields of `world`.

    Raises:
        UnknownNameError, InputError: A name or number is not known or out of range.
        AvFaultError: The foreign AV fails at once.
        FileFormatError: A file is missing, damaged or of another version.
    """
    world = replace(world or WorldOptions(), **keywords)
    av, model, bounded, budget = world.av, world.model, world.bounded, world.budget
    check_av_options(world)
    road = road or road_of(world)
    if is_foreign(av) and not takes_foreign:
        raise InputError(
            f"The AV {av} is not built in, and built-in ones only are taken here. To train an adversary against it: "
            f"cornerforge train --av {shlex.quote(av)} --out P.safetensors"
        )
    if av == RECORDED_AV and not takes_recorded:
        raise InputError(
            f"{RECORDED_AV} is no AV that could drive on its own: it is what was in the AV's seat of a case."
        )
    for name in ("av_python", "av_memory"):
        if getattr(world, name) not in (None, False) and not is_foreign(av):
            raise InputError(f"{name} is for AVs that are not built in; {av} is. Leave it out.")
    if is_foreign(av) and is_spread():
        raise InputError(f"The AV {av} is not built in, so it drives on this machine alone; leave out --engine ray.")
    stands_in = is_foreign(av) or av == RECORDED_AV
    av_model = replace(av_named("idm-mobil"), name=av) if stands_in else av_of(av)
    ndd = model if isinstance(model, NddModel) else load_model(default_model_path() if model is None else Path(model))
    bounded = bounded or budget is not None
    budget = check_budget(budget, bounded=bounded)
    known = ("nde", "idm", *(name for name in ADVERSARIES if name not in ("nobody", "policy")))
    names = [str(name) for name in ([bv] if isinstance(bv, (str, Path)) else bv)]
    if not names:
        raise InputError("bv names nothing; give an adversary, a policy file, or a list of policy files.")
    policies: tuple[Policy, ...] = ()
    if policy is not None:
        policies = (policy,) if isinstance(policy, Policy) else tuple(policy)
    elif len(names) != 1 or names[0] not in known:
        policies = _load_policies(names, known)
        for file, loaded in zip(names, policies, strict=True):
            _warn_of_another_world(loaded, file, road, ndd)
    driver = "policy" if policies else names[0]
    if policies:
        if budget is not None:
            policies = tuple(replace(p, bounded=True, budget=budget) for p in policies)
        bounded = all(p.bounded for p in policies)
        budget = policies[0].budget if len({p.budget for p in policies}) == 1 else None
    if bounded and driver in ("nde", "idm"):
        raise InputError(f"bounded needs an adversary; {driver} has none. Train one with: cornerforge train --bounded")
    if bounded and (ndd.following > 0.0).all() and (ndd.free > 0.0).all():
        named = model_hash(ndd) if model is ndd else model
        raise InputError(
            f"The model {named} calls no acceleration impossible anywhere, so bounded would exclude nothing; fit one "
            "with: cornerforge ndd fit (it cuts what lies beyond its spread to 0), or leave out --bounded."
        )
    temperature = temperature_of(acting)
    if temperature > 0.0 and not policies:
        raise InputError(f"acting = {acting!r} needs a policy; {driver} has its own way. Give a policy file.")
    numbers = [policy_numbers(p) for p in policies]
    foreign = None
    if is_foreign(av):
        remember(av)
        foreign = ForeignAv(
            av,
            road,
            seed=seed,
            timeout=world.av_timeout,
            batch=world.av_batch,
            processes=world.av_processes,
            confines=confines_of(world),
        )
    setting = Setting(
        road=road_numbers(road),
        av=numbers_of_av(av_model),
        tables=tables_of(ndd),
        who=Controllers(
            av=RECORDED if av == RECORDED_AV else BUILT_IN if foreign is None else foreign.controller,
            critical=ADVERSARIES["nobody" if driver in ("nde", "idm") else driver],
            others=IDM_BVS if driver == "idm" else NATURALISTIC,
            bounded=int(bounded),
            policy=max(numbers, key=lambda p: p.width) if numbers else NO_POLICY,
            budget=budget_units(budget),
            temperature=temperature,
            cast=NO_CAST
            if len(policies) < 2
            else cast_of(numbers, [p.bounded for p in policies], [budget_units(p.budget) for p in policies]),
        ),
    )
    spoken = "greedy" if temperature == 0.0 else f"softmax:{temperature:g}"
    return Experiment(road, av_model, ndd, driver, bounded, policies, budget, spoken, setting, n_slots(road), foreign)
