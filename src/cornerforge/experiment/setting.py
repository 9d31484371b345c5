"""Building what the simulator takes (model, AV, ODD, adversary) from names and files."""

from __future__ import annotations

import hashlib
import shlex
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cornerforge._checks import check_integer, check_number
from cornerforge._words import spoken as spoken_time
from cornerforge.drivers.avs import AvModel, av_hash, numbers_of_av
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import AvFaultError, InputError, UnknownNameError
from cornerforge.execution import default_threads, is_spread
from cornerforge.experiment.av_file import RECORDED_AV, av_of
from cornerforge.experiment.output import config_hash
from cornerforge.experiment.policy_file import Policy, check_budget, load_policy, policy_hash, policy_numbers
from cornerforge.foreign.driver import Fault, ForeignAv
from cornerforge.foreign.recorder import ForeignRecorder, ScriptedSeconds
from cornerforge.foreign.session import answers_per_second, answers_per_test
from cornerforge.foreign.spec import AvSpec, spec_of
from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash
from cornerforge.road.straight import road_numbers
from cornerforge.sim import (
    ADVERSARIES,
    AS_LEARNED,
    BUILT_IN,
    IDM_BVS,
    NATURALISTIC,
    NO_CAST,
    OUTSIDE,
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

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim import Script
    from cornerforge.types import Scenario

__all__ = [
    "AV_LOG",
    "RECORDED_AV",
    "TEMPERATURE",
    "Experiment",
    "check_threads",
    "experiment",
    "road_of",
    "temperature_of",
]

AV_LOG = "av.log"
"""File in an output folder that keeps what a foreign AV prints."""
TEMPERATURE = 0.05
"""Temperature of `softmax` without a number [units of Q]: actions with nearly equal Q are taken nearly as often."""


@dataclass(frozen=True)
class Experiment:
    """Everything constant in a run, under the user's names and in the form for kernels.

    Its AV decides inside the kernels. With one from outside, `experiment` makes a subclass whose methods answer for
    that AV, so that callers need not ask which it is.

    Attributes:
        odd, av, model: The world. For a foreign AV `av` is idm-mobil under the foreign AV's name: tests start with at
            least the desired gap of idm-mobil.
        bv: How BVs drive: "nde", "idm", a plain adversary's name, or "policy".
        bounded: The NDD-bounded mask is on (in a mixture: for every policy).
        policies: The adversary's policies when `bv` is "policy"; each test is driven by one of them.
        budget: Likelihood budget of a test [nats]; None: no limit, or not the same for all policies.
        acting: How policies act: "greedy", "softmax:T", or "learned", where one of them learnt to draw its actions.
        setting: The kernels' form of all this. A foreign AV is OUTSIDE in it also if it steers: only the AV itself
            says so, when it is opened (`opened_setting`).
        slots: Vehicle slots per world.
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

    @property
    def asked(self) -> ForeignAv | None:
        """The foreign AV; None if the AV decides inside the kernels."""
        return None

    @property
    def faults(self) -> Mapping[tuple[int, int], Fault]:
        """Tests that a foreign AV spoiled, by (seed, test)."""
        return {}

    @property
    def av_hash(self) -> str:
        """Hash of the AV: of its parameters, or of a foreign AV's source or file."""
        return config_hash({"av": RECORDED_AV}) if self.av.name == RECORDED_AV else av_hash(self.av)

    @property
    def av_steers(self) -> bool:
        """Does the AV steer or follow trajectories, instead of ordering lanes?"""
        return self.opened_setting.who.av == STEERED

    @property
    def opened_setting(self) -> Setting:
        """The setting with what a foreign AV says of itself."""
        return self.setting

    @property
    def drive(self) -> DriveChunk:
        """Return the function that drives a range of tests."""
        return drive_chunk

    def processes(self, threads: int | None) -> int:
        """Return how many ranges of tests are driven at the same time: as many as threads, or processes of the AV."""
        return check_threads(threads)

    def range_size(self, usual: int, tests: int, threads: int | None) -> int:  # noqa: ARG002
        """Return how many tests are driven as one range: `usual`, or fewer of a slow AV, so that all processes work."""
        return usual

    def seconds_of(self, threads: int | None, *, tests: float = 0.0, decisions: float = 0.0) -> float:  # noqa: ARG002
        """Say how long a foreign AV takes for a job [s], about; 0 for a built-in one.

        The job is tests, taken to be driven to their ends, and decisions of a training. More processes than cores are
        taken to help no further.
        """
        return 0.0

    def pace_text(self, threads: int | None) -> str:  # noqa: ARG002
        """Say how fast a foreign AV is: its time for an answer, worlds together, processes."""
        return f"{self.av.name} is built in"

    def cost(self, cpu_seconds: float, seconds: float) -> tuple[float, str]:  # noqa: ARG002
        """Say what work cost [s] and of what: a foreign AV needs time that is not this program's."""
        return cpu_seconds, "of CPU time"

    def answered(self) -> Callable[[], int] | None:
        """Return what counts the answers of a slow AV from outside, for `moving`; None for all others."""
        return None

    def warm_up(self) -> None:
        """Load the compiled kernels, or compile them (once per installation), so that timings leave it out."""
        warm_up(self.setting, self.slots)

    def rest(self) -> None:
        """End the processes of a foreign AV; when it drives again, new ones are started."""

    def keep_printed(self, file: Path) -> None:
        """Keep what a foreign AV prints, and its tracebacks, in a file, unless they have another one already."""

    def keep_scripts(self, *, anew: bool = False) -> None:
        """Keep what a foreign AV answers in tests that crash from now on; `anew`: earlier tests are forgotten."""

    def repeats(self, seed: int, test: int) -> bool:  # noqa: ARG002
        """Does the AV drive a test in the same way twice more?"""
        return True

    def check_not_all_spoiled(self, valid: int, tests: int) -> None:
        """Check that at least one of `tests` tests is valid.

        Raises:
            AvFaultError: The foreign AV failed in all of them.
        """

    def recorder(self) -> Recorder:
        """Return the recorder of tests; it serves one thread."""
        return Recorder(self.setting, self.odd)

    def script_driver(self) -> ScriptDriver:
        """Return the driver of scripts, with the run's AV; it serves one thread."""
        return ScriptDriver(self.setting, self.odd, self.asked)

    def branch_recorder(self) -> Callable[[Script, NDArray[np.float64]], Scenario]:
        """Return what records a branch of a tree by its script and a foreign AV's answers (A, W), in one thread."""
        driver = self.script_driver()
        return lambda script, answers: driver.record(script)[0]  # noqa: ARG005

    def stepper(self) -> ScriptedSeconds | None:
        """Return what drives a test of a foreign AV second by second, for `rates.attention`; None for all others."""
        return None

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


@dataclass(frozen=True)
class _OutsideExperiment(Experiment):
    """An experiment with an AV from outside, which takes its own time, prints, and may fail."""

    outside: ForeignAv

    @property
    def asked(self) -> ForeignAv:
        return self.outside

    @property
    def faults(self) -> Mapping[tuple[int, int], Fault]:
        return self.outside.faults

    @property
    def av_hash(self) -> str:
        return self.outside.hash

    @property
    def opened_setting(self) -> Setting:
        return self.outside.steering(self.setting)

    @property
    def drive(self) -> DriveChunk:
        return self.outside

    def processes(self, threads: int | None) -> int:
        n = super().processes(threads)
        return self.outside.spec.processes or n

    def range_size(self, usual: int, tests: int, threads: int | None) -> int:
        av, answers = self.outside, answers_per_test(self.setting)
        return av.pace.range_size(usual, av.batch, tests, self.processes(threads), answers)

    def seconds_of(self, threads: int | None, *, tests: float = 0.0, decisions: float = 0.0) -> float:
        av, processes = self.outside, min(self.processes(threads), default_threads())
        each = av.pace.seconds_per_answer(av.batch)
        seconds = tests * answers_per_test(self.setting) * each / max(1.0, min(processes, tests))
        group = av.group_size(512, processes)
        asked = decisions * answers_per_second(self.setting)
        return seconds + asked * av.pace.seconds_per_answer(group) / max(1, min(processes, -(-512 // group)))

    def pace_text(self, threads: int | None) -> str:
        av, n = self.outside, self.processes(threads)
        together = "one world at a time" if av.batch == 1 else f"{av.batch} worlds at a time"
        return (
            f"{av.name} takes about {spoken_time(av.answer_seconds)} for an answer (measured), {together}, "
            f"in {n} {'process' if n == 1 else 'processes'}"
        )

    def cost(self, cpu_seconds: float, seconds: float) -> tuple[float, str]:  # noqa: ARG002
        return seconds, "by the clock"

    def answered(self) -> Callable[[], int] | None:
        pace = self.outside.pace
        return None if pace.usual(self.outside.batch) < 0.05 else lambda: pace.answers

    def warm_up(self) -> None:
        self.outside.warm_up(self.setting, self.slots)

    def rest(self) -> None:
        self.outside.close()

    def keep_printed(self, file: Path) -> None:
        self.outside.log.keep_in(file)

    def keep_scripts(self, *, anew: bool = False) -> None:
        self.outside.keep_scripts(anew=anew)

    def repeats(self, seed: int, test: int) -> bool:
        return self.outside.repeats(self.setting, self.slots, seed, test)

    def check_not_all_spoiled(self, valid: int, tests: int) -> None:
        if valid == 0 and tests > 0 and self.faults:
            fault = next(iter(self.faults.values()))
            error = AvFaultError(
                f"The AV {self.av.name} spoiled every one of {tests} tests. In test {fault.test} it {fault.message}. "
                f"Correct the AV; to look closer: {self.outside.closer()}"
            )
            raise self.outside.explained(error, fault.message)

    def recorder(self) -> ForeignRecorder:
        return ForeignRecorder(self.outside, self.setting, self.odd)

    def branch_recorder(self) -> Callable[[Script, NDArray[np.float64]], Scenario]:
        record = self.recorder().record_branch
        return lambda script, answers: record(script.seed, script.test, script.action, answers)

    def stepper(self) -> ScriptedSeconds:
        return ScriptedSeconds(self.outside, self.slots)


def check_threads(threads: int | None) -> int:
    """Return the number of threads to use; None means all cores.

    Raises:
        InputError: It is below 1.
    """
    return default_threads() if threads is None else check_integer("threads", threads, low=1, high=1024)


def _joint_hash(policies: Sequence[Policy]) -> str | None:
    """Hash a policy, or the policies of a mixture in their order; None without a policy."""
    hashes = [policy_hash(policy) for policy in policies]
    if len(hashes) <= 1:
        return hashes[0] if hashes else None
    return hashlib.sha256(" ".join(hashes).encode()).hexdigest()[:16]


def temperature_of(acting: str, policies: Sequence[Policy] = ()) -> float:
    """Return the temperature of policies [units of Q or of logits].

    0 for "greedy", T for "softmax:T", `TEMPERATURE` for "softmax", AS_LEARNED for "learned", or 0 if all are greedy.

    Raises:
        UnknownNameError: The name is none of these.
        InputError: T is not a number in [0.0001, 100].

    >>> temperature_of("greedy"), temperature_of("softmax:0.2")
    (0.0, 0.2)
    """
    draws = any(policy.head != "greedy" for policy in policies)
    without_number = {"learned": AS_LEARNED if draws else 0.0, "greedy": 0.0}
    if acting in without_number:
        return without_number[acting]
    name, colon, number = acting.partition(":")
    if name != "softmax":
        raise UnknownNameError("way to act", acting, (*without_number, "softmax", "softmax:T"))
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


def _check_av(spec: AvSpec, *, takes_foreign: bool, takes_recorded: bool) -> None:
    """Check that the AV may be used here, and as it is asked.

    Raises:
        InputError: It may not.
    """
    if spec.is_outside and not takes_foreign:
        raise InputError(
            f"The AV {spec.name} is not built in, and built-in ones only are taken here. To train an adversary against "
            f"it: cornerforge train --av {shlex.quote(spec.name)} --out P.safetensors"
        )
    if spec.name == RECORDED_AV and not takes_recorded:
        raise InputError(
            f"{RECORDED_AV} is no AV that could drive on its own: it is what was in the AV's seat of a case."
        )
    for name in ("python", "memory"):
        if getattr(spec.confines, name) is not None and not spec.is_outside:
            raise InputError(f"av_{name} is for AVs that are not built in; {spec.name} is. Leave it out.")
    if spec.is_outside and is_spread():
        raise InputError(
            f"The AV {spec.name} is not built in, so it drives on this machine alone; leave out --engine ray."
        )


def experiment(
    world: WorldOptions | None = None,
    *,
    bv: str | Path | Sequence[str | Path] = "nde",
    policy: Policy | Sequence[Policy] | None = None,
    acting: str = "learned",
    takes_foreign: bool = False,
    takes_recorded: bool = False,
    seed: int = 0,
    road: Odd | None = None,
    **keywords: Any,
) -> Experiment:
    """Build the experiment of a run; an AV from outside is not started before something is asked of it.

    Args:
        world: The world; None for the default one.
        bv: "nde", "idm", a plain adversary ("uniform", "lane-changer", "swerve"), or the path of a policy file; several
            paths: each test is driven by one of these policies, drawn at random.
        policy: One or more policies in memory instead of paths in `bv`.
        acting: How a policy acts: "learned", as its head says, "greedy", "softmax" or "softmax:T" (see
            `temperature_of`).
        takes_foreign: A foreign AV is allowed.
        takes_recorded: The AV may be RECORDED_AV: whatever was in its seat, as it was recorded; for cases on rails.
        seed: Seed that a foreign AV is told.
        road: ODD instead of the one that `world` names; a library has one of its own.
        keywords: Values that replace fields of `world`.

    Raises:
        UnknownNameError, InputError: A name or number is not known or out of range.
        FileFormatError: A file is missing, damaged or of another version.
    """
    world = replace(world or WorldOptions(), **keywords)
    model, bounded, budget = world.model, world.bounded, world.budget
    road = road or road_of(world)
    spec, av_model = spec_of(world), av_of(world.av)
    _check_av(spec, takes_foreign=takes_foreign, takes_recorded=takes_recorded)
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
    temperature = temperature_of(acting, policies)
    if temperature > 0.0 and not policies:
        raise InputError(f"acting = {acting!r} needs a policy; {driver} has its own way. Give a policy file.")
    numbers = [policy_numbers(p) for p in policies]
    setting = Setting(
        road=road_numbers(road),
        av=numbers_of_av(av_model),
        tables=tables_of(ndd),
        who=Controllers(
            av=RECORDED if world.av == RECORDED_AV else OUTSIDE if spec.is_outside else BUILT_IN,
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
    spoken = {0.0: "greedy", AS_LEARNED: "learned"}.get(temperature, f"softmax:{temperature:g}")
    run = Experiment(road, av_model, ndd, driver, bounded, policies, budget, spoken, setting, n_slots(road))
    return _OutsideExperiment(**vars(run), outside=ForeignAv(spec, road, seed=seed)) if spec.is_outside else run
