"""From names and files to what the simulator takes: the model, the AV, the ODD, the adversary."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from cornerforge._checks import check_integer
from cornerforge.adversary.policy_file import Policy, load_policy, policy_hash, policy_numbers
from cornerforge.drivers.avs import AvModel, av_hash, av_named
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.foreign.driver import ForeignAv, ForeignRecorder
from cornerforge.foreign.loaders import is_foreign
from cornerforge.foreign.process import DEFAULT_TIMEOUT
from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash
from cornerforge.pipeline.output import config_hash
from cornerforge.sim.adversaries import ADVERSARIES
from cornerforge.sim.decide import IDM_BVS
from cornerforge.sim.drive import Setting
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import DriveChunk, default_threads, drive_chunk, warm_up
from cornerforge.sim.world import av_numbers, n_slots, road_numbers
from cornerforge.types import Odd, odd_named

__all__ = ["Experiment", "check_threads", "experiment"]


@dataclass(frozen=True)
class Experiment:
    """Everything constant in a run, by its user's names and as the kernels take it.

    Attributes:
        odd, av, model: The world. For a foreign AV `av` is idm-mobil under the foreign one's name: tests start at no
            less than its desired gap.
        bv: How BVs drive: "nde", "idm", a plain adversary's name, or "policy".
        bounded: The NDD-bounded mask is on.
        policy: The adversary's policy when `bv` is "policy".
        setting: The kernels' form of all this.
        slots: Vehicle slots per world.
        foreign: The AV, when it is not a built-in one.
    """

    odd: Odd
    av: AvModel
    model: NddModel
    bv: str
    bounded: bool
    policy: Policy | None
    setting: Setting
    slots: int
    foreign: ForeignAv | None = None

    @property
    def drive(self) -> DriveChunk:
        """Who drives a range of tests."""
        return drive_chunk if self.foreign is None else self.foreign

    def warm_up(self) -> None:
        """Load the compiled kernels, or compile them (once per installation), so that timings do not count it."""
        if self.foreign is not None:
            self.foreign.warm_up(self.setting, self.slots)
        else:
            warm_up(self.setting, self.slots)

    def recorder(self) -> Recorder:
        """Who records a test; serves one thread."""
        if self.foreign is not None:
            return ForeignRecorder(self.foreign, self.setting, self.odd)
        return Recorder(self.setting, self.odd)

    def identity(self, seed: int) -> dict[str, str | int | float | bool | None]:
        """What names a test together with its number: seed, names, and hashes of settings, model, policy and AV."""
        return {
            "seed": seed,
            "odd": self.odd.name,
            "lanes": self.odd.n_lanes,
            "av": self.av.name,
            "av_hash": av_hash(self.av) if self.foreign is None else self.foreign.hash,
            "model_hash": model_hash(self.model),
            "bv": self.bv,
            "bounded": self.bounded,
            "policy_hash": None if self.policy is None else policy_hash(self.policy),
            # Last: where two runs differ, messages name the first key, and a setting says more than its hash.
            "config_hash": config_hash({"odd": asdict(self.odd), "bv": self.bv, "bounded": self.bounded}),
        }


def check_threads(threads: int | None) -> int:
    """The number of threads to use; None means all cores.

    Raises:
        InputError: It is below 1.
    """
    return default_threads() if threads is None else check_integer("threads", threads, low=1, high=1024)


def experiment(
    *,
    av: str = "idm-mobil",
    odd: str = "default",
    lanes: int | None = None,
    model: Path | None = None,
    bv: str = "nde",
    policy: Policy | None = None,
    bounded: bool = False,
    takes_foreign: bool = False,
    seed: int = 0,
    av_timeout: float = DEFAULT_TIMEOUT,
) -> Experiment:
    """Put a run together.

    Args:
        av: Name of a built-in AV, or a foreign one: `module:Class`, an `.onnx` or a Stable-Baselines3 `.zip` file.
        odd: Name of an ODD.
        lanes: Number of lanes, 2 to 6; None for the ODD's own.
        model: Model file; None for the one that ships with the package.
        bv: "nde", "idm", a plain adversary ("uniform", "lane-changer", "swerve"), or the path of a policy file.
        policy: A policy in memory instead of a path in `bv`.
        bounded: Mask actions that the naturalistic model calls impossible; a policy brings its own answer.
        takes_foreign: A foreign AV may be given.
        seed: Told to a foreign AV.
        av_timeout: How long it may take for an answer [s].

    Raises:
        UnknownNameError, InputError: A name or number is not known or out of range.
        AvFaultError: The foreign AV fails at once.
        FileFormatError: A file is missing, damaged or of another version.
    """
    road = odd_named(odd)
    if lanes is not None:
        road = replace(road, n_lanes=lanes)
    if is_foreign(av) and not takes_foreign:
        raise InputError(
            f"The AV {av} is not built in, and this command takes built-in ones only. What you can do: train on a "
            f"built-in AV, then: cornerforge generate --policy P.safetensors --av {av}"
        )
    av_model = replace(av_named("idm-mobil"), name=av) if is_foreign(av) else av_named(av)
    ndd = load_model(default_model_path() if model is None else model)
    known = ("nde", "idm", *(name for name in ADVERSARIES if name not in ("nobody", "policy")))
    if policy is None and bv not in known:
        if not (bv.endswith(".safetensors") or Path(bv).exists()):
            raise UnknownNameError("driver of background vehicles", bv, (*known, "FILE.safetensors"))
        policy = load_policy(Path(bv))
    if policy is not None:
        bv, bounded = "policy", policy.bounded
    if bounded and bv in ("nde", "idm"):
        raise InputError(f"bounded needs an adversary; {bv} has none. Train one with: cornerforge train --bounded")
    code = 0 if bv in ("nde", "idm") else ADVERSARIES[bv]
    setting = Setting(
        road_numbers(road),
        av_numbers(av_model.idm, av_model.mobil, sees_intentions=av_model.sees_intentions),
        tables_of(ndd),
        IDM_BVS if bv == "idm" else 0,
        code,
        int(bounded),
        NO_POLICY if policy is None else policy_numbers(policy),
    )
    foreign = ForeignAv(av, road, seed=seed, timeout=av_timeout) if is_foreign(av) else None
    return Experiment(road, av_model, ndd, bv, bounded, policy, setting, n_slots(road), foreign)
