"""An experiment: everything constant in a run, and what its AV can be asked, built in or from outside."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cornerforge._checks import check_integer
from cornerforge._words import spoken as spoken_time
from cornerforge.drivers.avs import AvModel, av_hash
from cornerforge.errors import AvFaultError
from cornerforge.experiment.av_file import RECORDED_AV
from cornerforge.experiment.output import config_hash
from cornerforge.experiment.policy_file import Policy, policy_hash
from cornerforge.foreign.driver import Fault, ForeignAv
from cornerforge.foreign.recorder import ForeignRecorder, ScriptedSeconds
from cornerforge.foreign.session import answers_per_second, answers_per_test
from cornerforge.ndd.model import NddModel, model_hash
from cornerforge.sim import Recorder, ScriptDriver, Setting, controllers, runner
from cornerforge.types import Odd
from cornerforge.work import default_threads

__all__ = ["Experiment", "check_threads", "with_outside_av"]

_TRIAL_SECONDS, _TRIAL_WORTH = 2.0, 20.0
"""Before a job of an AV from outside that takes `_TRIAL_WORTH` or more, a trial of so long says how fast it is [s]."""


@dataclass(frozen=True)
class Experiment:
    """Everything constant in a run, under the user's names and in the form for kernels.

    Its AV decides inside the kernels. With one from outside, `with_outside_av` makes a subclass whose methods answer
    for that AV, so that callers need not ask which it is.

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
        return self.opened_setting.who.av == controllers.STEERED

    @property
    def opened_setting(self) -> Setting:
        """The setting with what a foreign AV says of itself."""
        return self.setting

    @property
    def drive(self) -> runner.DriveChunk:
        """Return the function that drives a range of tests."""
        return runner.drive_chunk

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
        runner.warm_up(self.setting, self.slots)

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

    def branch_recorder(self) -> ScriptDriver | ForeignRecorder:
        """Return the recorder of branches of trees (`record_branch`); it serves one thread."""
        return self.script_driver()

    def stepper(self) -> ScriptedSeconds | None:
        """Return what drives a test of a foreign AV second by second, for `rates.attention`; None for all others."""
        return None

    @property
    def policy(self) -> Policy | None:
        """The first policy; None if no policy drives."""
        return self.policies[0] if self.policies else None

    def identity(self, seed: int) -> dict[str, str | int | float | bool | None]:
        """Return what names a test, with its number: seed, names, and hashes of settings, model, policy and AV."""
        who = self.setting.who
        mask = {"budget_of": "excess" if who.excess else None, "steers_from": who.steers_from}
        mask = {key: value for key, value in mask.items() if value and self.bv != "nde"}  # as it always was: not named
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
            **mask,
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
                    **mask,
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
    def drive(self) -> runner.DriveChunk:
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
        seconds += asked * av.pace.seconds_per_answer(group) / max(1, min(processes, -(-512 // group)))
        if seconds >= _TRIAL_WORTH and av.pace.slower is None:
            self._try(processes, each)
        return seconds * (av.pace.slower or 1.0)

    def _try(self, processes: int, each: float) -> None:
        """Drive tests for about `_TRIAL_SECONDS`, to see how long they take; none if one alone takes longer."""
        tests = int(processes * _TRIAL_SECONDS / (answers_per_test(self.setting) * each))
        if tests >= processes:
            self.warm_up()
            tests = min(tests, 4 * self.outside.batch * processes)
            with self.outside.on_trial():
                for _ in runner.simulate_chunks(
                    self.setting, self.slots, seed=self.outside.seed, first=0, tests=tests, threads=processes,
                    counting=False, chunk=-(-tests // processes), drive=self.drive,
                ):  # fmt: skip
                    pass
            self.outside.pace.slower = self.outside.pace.slower or 1.0  # an AV that failed is not tried again

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

    def branch_recorder(self) -> ForeignRecorder:
        return self.recorder()

    def stepper(self) -> ScriptedSeconds:
        return ScriptedSeconds(self.outside, self.slots)


def with_outside_av(run: Experiment, av: ForeignAv) -> Experiment:
    """Copy an experiment whose setting says OUTSIDE, with the AV from outside that drives in it."""
    return _OutsideExperiment(**vars(run), outside=av)


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
