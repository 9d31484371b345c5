"""The user's options for the world of a test: their types, defaults and explanations stand here and nowhere else.

Options of verbs inherit from these classes, so `simulate(tests=1000, lanes=4)` and `--lanes 4` mean the same. The
module is light to import, because `--help` needs it.
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cornerforge._options import Options
from cornerforge._schema import meant

if TYPE_CHECKING:
    from cornerforge.ndd.model import NddModel
else:  # classes are told by their names, so that the module need not be imported
    NddModel = type("NddModel", (), {})

__all__ = [
    "BUDGETS",
    "LEARNERS",
    "PLAIN_ADVERSARIES",
    "REWARD_NAMES",
    "STEER_FROM",
    "AdversaryEnvOptions",
    "AvAloneOptions",
    "AvAskedOptions",
    "AvOptions",
    "AvProcessOptions",
    "DrivingEnvOptions",
    "RoadOptions",
    "WorldOptions",
]

PLAIN_ADVERSARIES = ("uniform", "lane-changer", "swerve", "dart-out", "red-runner", "turns-across", "cuts-in")
"""Adversaries that have not learned, on roads or at sites; `sim.controllers.ADVERSARIES` says what they do."""
REWARD_NAMES = ("crash", "striking", "avoidable", "preventable", "preventable-by-braking", "own-fault", "own-doing")
"""Names of `adversary.worlds.rewards.REWARDS`, which says what they pay for."""

LEARNERS = ("dqn", "ppo")
"""Names of learners, as help names them; each is the file of that name in `adversary/`."""


BUDGETS = ("shortfall", "excess")
"""What a likelihood budget limits (`sim.observe.price_from`)."""
STEER_FROM = 5
"""Second from which a bounded adversary steers unless told otherwise; the start of a test tells until then (ADR 71)."""


class _World(Options):
    """Some options of a world; the others are as by default."""

    def world(self) -> WorldOptions:
        """Give the options of the world alone; those that these lack have their defaults."""
        own = {one.name for one in fields(self)}
        return WorldOptions(**{one.name: getattr(self, one.name) for one in fields(WorldOptions) if one.name in own})


class RoadOptions(_World):
    """The road and its traffic."""

    odd: Annotated[
        str,
        meant("default (4 s lane change), swift (2.5 s), paper (1 s) or mixed (4 s; trucks too).", near=("odd",)),
    ] = "default"
    lanes: Annotated[int | None, meant("Lanes, 2 to 6; 3 by default.")] = None
    road: Annotated[
        str | None,
        meant(
            "Road (`cornerforge road show` draws it): on-ramp, exit, weaving, lane-drop, work-zone, curves, e6mini, or "
            "a FILE of `road import`; straight by default.",
            near=("on-ramp", "exit", "weaving", "lane-drop", "work-zone", "curves", "e6mini", "straight"),
            metavar="NAME|FILE",
        ),
    ] = None
    task: Annotated[
        str,
        meant(
            "What the AV is to do on that road: drive through, come from the ramp, or take the exit.",
            choices=("through", "ramp", "exit"),
        ),
    ] = "through"
    traffic: Annotated[
        str,
        meant(
            "How the others drive: freely, densely, or up to the end of a queue.", choices=("free", "dense", "queue")
        ),
    ] = "free"
    perception: Annotated[
        str | None,
        meant(
            "What the AV perceives of the others, such as latency=0.2,range=120,dropout=0.01,noise=0.3,occlusion "
            "(s, m, chance a second, m); everything at once by default.",
            metavar="WHAT",
        ),
    ] = None
    site: Annotated[
        str | None,
        meant(
            "Junction instead of a road (`cornerforge site show` draws it): mcity-signal, mcity-crossing, "
            "mcity-two-lanes, mcity-roundabout, or a FILE of `site import`.",
            near=("mcity-signal", "mcity-crossing", "mcity-two-lanes", "mcity-roundabout"),
            metavar="NAME|FILE",
        ),
    ] = None
    site_traffic: Annotated[
        str | None,
        meant(
            "How many come to a site, such as vehicles=300,people=60,trucks=0.1: an hour and lane, an hour and end of "
            "a crosswalk, share.",
            metavar="WHAT",
        ),
    ] = None
    site_laws: Annotated[
        str | None, meant("How people drive and walk at a site: a file of `site fit`; the shipped one by default.")
    ] = None
    model: Annotated[Path | str | NddModel | None, meant("Naturalistic model; the shipped one by default.")] = None


class AvProcessOptions(_World):
    """The process in which an AV from outside runs, and its time."""

    av_timeout: Annotated[
        float,
        meant(
            "Seconds that an AV which is not built in may take for the answer in one world.",
            low=0.01, high=3600.0, unit="s",
        ),
    ] = 5.0  # fmt: skip
    av_python: Annotated[
        str | None, meant("Python in which an AV from outside runs, such as env/bin/python; it needs NumPy only.")
    ] = None
    av_memory: Annotated[
        float | None,
        meant(
            "GB that a process of an AV from outside may take; half of the machine's by default.",
            unit="GB",
            more="0.25 to 1e6.",
        ),
    ] = None
    av_actions: Annotated[
        str | None,
        meant(
            "What an .onnx file, or predict, answers by where that is not clear: box (two numbers of Box(-1, 1)), si "
            "(m/s2 and a lane wish) or number (of one of the 33 actions).",
            choices=("box", "si", "number"),
        ),
    ] = None
    av_statistics: Annotated[
        str | None,
        meant("File of VecNormalize, or of NumPy, for a network; or none. The one beside an SB3 .zip by default."),
    ] = None


class AvAskedOptions(AvProcessOptions):
    """How an AV from outside is asked."""

    av_batch: Annotated[
        int | None,
        meant(
            "Worlds that an AV from outside is asked about together; chosen by its speed by default.",
            low=1,
            high=65_536,
        ),
    ] = None
    av_processes: Annotated[
        int | None,
        meant("Processes of an AV from outside at the same time; as many as threads by default.", low=1, high=1024),
    ] = None


class _Av(_World):
    """The AV."""

    av: Annotated[
        str,
        meant(
            "AV under test: a name (`cornerforge avs` lists them), module:Class, file.py:Class, "
            '"cmd: ./program", or an .onnx or SB3 .zip file.',
            near=("av",),
        ),
    ] = "idm-mobil"


class AvAloneOptions(_Av, AvAskedOptions):
    """The AV, on a road that is known."""


class AvOptions(_Av, RoadOptions, AvAskedOptions):
    """The AV, the road and its traffic."""


class _Mask(_World):
    """The mask of an adversary."""

    bounded: Annotated[
        bool, meant("Only actions that the naturalistic model calls possible.", more="A policy brings its own answer.")
    ] = False


class _Budget(_Mask):
    """The mask and the likelihood budget of an adversary."""

    budget: Annotated[
        float | None,
        meant(
            "Likelihood budget of a test in nats, such as 5: how far the actions may fall short of the likeliest "
            "ones. Implies --bounded.",
            unit="nats",
            more="0 or more; it overrides a policy's own. None: no limit, or the policy's own.",
        ),
    ] = None
    budget_of: Annotated[
        str, meant("What --budget limits: shortfall behind the likeliest, or excess over natural.", choices=BUDGETS)
    ] = BUDGETS[0]
    steer_from: Annotated[
        int | None,
        meant("Second from which it steers; 5 if bounded, else 0, or the policy's own.", low=0, high=60, unit="s"),
    ] = None


class DrivingEnvOptions(_Mask, RoadOptions):
    """The world of `cornerforge/Driving-v0`, whose AV is the agent."""


class AdversaryEnvOptions(_Av, DrivingEnvOptions, AvProcessOptions):
    """The world of `cornerforge/Adversary-v0`, whose adversary is the agent."""


class WorldOptions(_Av, RoadOptions, _Budget, AvAskedOptions):
    """The world of a test, with an adversary; `experiment.setting.experiment` checks names and files."""

    def without_mask(self) -> WorldOptions:
        """Copy the world without what `bounded` and its kin say: for a policy, which brings its own."""
        return replace(self.world(), bounded=False, budget=None, budget_of=BUDGETS[0], steer_from=None)

    def driven_by(self, built_in: str) -> WorldOptions:
        """Copy the world with a built-in AV, without what only AVs from outside are asked with."""
        return replace(self, av=built_in, av_python=None, av_memory=None, av_actions=None, av_statistics=None)

    def av_keywords(self) -> dict[str, Any]:
        """Give the options as keywords of verbs without an adversary: all but its own."""
        return {one.name: getattr(self, one.name) for one in fields(AvOptions)}
