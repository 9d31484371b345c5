"""The built-in automated vehicles under test, by name."""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.drivers.careful import CAREFUL, CarefulParams
from cornerforge.drivers.flawed import FLAWS, FlawParams
from cornerforge.drivers.idm import IdmNumbers, IdmParams
from cornerforge.drivers.mobil import MobilNumbers, MobilParams
from cornerforge.drivers.policy import NO_POLICY, NetworkShape, PolicyNumbers, numbers_of_network
from cornerforge.drivers.rss import RssNumbers, RssParams
from cornerforge.drivers.sight import Sight, SightNumbers, numbers_of_sight
from cornerforge.errors import InputError, UnknownNameError

__all__ = [
    "AVS", "AV_KINDS", "MANNERS", "ROAD_AVS", "SITE_AVS", "AvLaw", "AvModel", "AvNetwork", "AvNumbers", "Manner",
    "av_hash", "av_named", "numbers_of_av",
]  # fmt: skip


class AvLaw(NamedTuple):
    """The facts of an AV's law that the simulator relies on; no field has a default, so no fact can be forgotten.

    Attributes:
        code: The number by which kernels know the law.
        hardest_braking, strongest_acceleration: The law never commands more [m/s2], above 0; None: the limits of its
            IDM parameters. With too small a number the simulator misses contacts.
        sees_everybody: The law looks at more than its nearest neighbours in each lane. If this is wrongly False, it
            sees some vehicles where they were when the second began.
        parameters: Fields of `AvModel` that the law uses, besides IDM and MOBIL. `av_hash` covers them, and an AV of
            another law may not be given them.
    """

    code: int
    hardest_braking: float | None
    strongest_acceleration: float | None
    sees_everybody: bool
    parameters: tuple[str, ...]


AV_KINDS = {
    "plain": AvLaw(0, None, None, sees_everybody=False, parameters=()),
    "watchful": AvLaw(1, None, None, sees_everybody=False, parameters=()),
    "cautious": AvLaw(2, 12.0, 10.0, sees_everybody=False, parameters=("rss",)),
    "learned": AvLaw(3, 12.0, 10.0, sees_everybody=True, parameters=("network",)),
    "careful": AvLaw(4, 8.0, None, sees_everybody=True, parameters=("careful",)),
    "flawed": AvLaw(5, None, None, sees_everybody=True, parameters=("flawed",)),
    "junction": AvLaw(6, 8.0, 3.0, sees_everybody=True, parameters=("junction", "rss")),
}
"""The laws by which an AV decides (docs/adr/0009-built-in-avs.md).

plain: IDM and MOBIL. watchful: the same, and it watches both sides while it changes lanes, and evades a vehicle that
comes into its lane beside it. cautious: it keeps RSS distances. learned: a Q-network. careful: a reference driver of UN
R157 and others (docs/adr/0039-reference-drivers.md), which keeps its lane. flawed: IDM and MOBIL with one flaw of
perception or decision (`drivers.flawed`). junction: at sites only, on its route (`sim.site.av`).
"""


class Manner(NamedTuple):
    """How an AV drives at a site, beside the laws of people there.

    Attributes:
        headway, gaps, to_people: Its factors of people's median time gap, critical gap and gap left to people.
        creeps: It edges forward where it should wait.
        rss: It drives by RSS too (`AvModel.rss`).
    """

    headway: float
    gaps: float
    to_people: float
    creeps: bool = False
    rss: bool = False


MANNERS = {
    "yield": Manner(1.2, 1.3, 2.0),
    "rss": Manner(1.2, 1.3, 2.0, rss=True),
    "creep": Manner(1.0, 0.8, 0.6, creeps=True),
}
"""Manners of driving at a site; kernels know them by their numbers, since more numbers would slow all AVs."""


@dataclass(frozen=True)
class JunctionParams:
    """Name of the manner of an AV at a site, one of `MANNERS`.

    Raises:
        InputError: It is none of them.
    """

    manner: str = "yield"

    def __post_init__(self) -> None:
        check_in("junction.manner", self.manner, tuple(MANNERS))


@dataclass(frozen=True)
class AvNetwork:
    """The network of a learned AV.

    Attributes:
        shape: Shape of the network.
        weights: Flat, in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,).
        features_version: Version of the observation that it learned on (`sim.av_features.AV_FEATURES_VERSION`).
    """

    shape: NetworkShape
    weights: NDArray[np.float32] = field(repr=False, compare=False)
    features_version: int


@dataclass(frozen=True)
class AvModel:
    """A built-in AV: a law of `AV_KINDS` and its parameters.

    Attributes:
        name: Its name on the command line.
        about: One line for people.
        idm, mobil: Parameters; the IDM's also decide how near to its lead the AV starts a test.
        sight: Which lanes another vehicle is in for it, and from when on it gives way to a vehicle that enters its own
            target lane from the other side.
        kind: One of `AV_KINDS`.
        rss: Safe distances, for the cautious kind.
        network: The network, for the learned kind; None until its file is read (`experiment.av_file`).
        careful: Which reference driver, for the careful kind.
        flawed: Which flaw, for the flawed kind.
        junction: How it drives at sites, for the junction kind.

    Raises:
        InputError: The kind is not known, or parameters are given by which it does not drive.
    """

    name: str
    about: str
    idm: IdmParams
    mobil: MobilParams
    sight: Sight = field(default_factory=Sight)
    kind: str = "plain"
    rss: RssParams = field(default_factory=RssParams)
    network: AvNetwork | None = None
    careful: CarefulParams = field(default_factory=CarefulParams)
    flawed: FlawParams = field(default_factory=FlawParams)
    junction: JunctionParams = field(default_factory=JunctionParams)

    def __post_init__(self) -> None:
        check_in("av.kind", self.kind, tuple(AV_KINDS))
        for own in (one for one in fields(self) if one.name not in _COMMON):
            usual = own.default_factory() if callable(own.default_factory) else own.default
            if own.name not in AV_KINDS[self.kind].parameters and getattr(self, own.name) != usual:
                raise InputError(
                    f"av.{own.name} is given, but an AV of kind {self.kind} does not drive by it; name it in the "
                    "`parameters` of that law in AV_KINDS, or leave it out."
                )


_COMMON = ("name", "about", "idm", "mobil", "sight", "kind")
"""Fields of `AvModel` that every kind uses; the others belong to single kinds (`AvLaw.parameters`)."""


_D2RL = IdmParams(
    max_acceleration=1.5, comfortable_braking=2.0, standstill_gap=2.0, time_gap=1.2, desired_speed=33.3, max_braking=4.0
)
_GENTLE = IdmParams(max_braking=2.0)
"""How reference drivers drive without danger: harder braking is left to what they do when they see danger."""
_AFTER_PERCEPTION = Sight(perception_time=0.4)
"""UN R157: its careful driver begins to react 0.4 s after a cut-in can be seen."""

AVS: dict[str, AvModel] = {
    model.name: model
    for model in (
        AvModel(
            "idm-mobil",
            "IDM and MOBIL with the numbers of the paper's group (NADE); sees vehicles that move into a lane",
            IdmParams(),
            MobilParams(),
        ),
        AvModel(
            "idm-mobil-oracle",
            "idm-mobil that knows others' lane changes when they are decided, as the paper's group has it",
            IdmParams(),
            MobilParams(),
            Sight("decision"),
        ),
        AvModel(
            "idm-mobil-d2rl",
            "idm-mobil-oracle with the parameters of D2RL: closer and faster",
            _D2RL,
            MobilParams(),
            Sight("decision"),
        ),
        AvModel(
            "idm-mobil-blind",
            "idm-mobil that goes by lane centres and sees nobody's lane change",
            IdmParams(),
            MobilParams(),
            Sight("centre"),
        ),
        AvModel(
            "idm-mobil-watchful",
            "idm-mobil that watches both sides while changing lanes, and evades who cuts in beside it",
            IdmParams(),
            MobilParams(),
            _AFTER_PERCEPTION,
            kind="watchful",
        ),
        AvModel(
            "rss-cautious",
            "keeps RSS distances ahead, and to both neighbours when it changes lanes; brakes with up to 8 m/s2",
            IdmParams(),
            MobilParams(),
            _AFTER_PERCEPTION,
            kind="cautious",
        ),
        AvModel(
            "rl",
            "a Q-network that `cornerforge train-av` trained; decides twice a second",
            IdmParams(),
            MobilParams(),
            kind="learned",
        ),
        *(
            AvModel(
                name, f"reference driver: {about}", _GENTLE, MobilParams(), kind="careful", careful=CarefulParams(name)
            )
            for name, about in {
                "cc-human": "the competent and careful human of UN R157; brakes late, keeps its lane",
                "reg157": "what UN R157 demands of a cut-in's victim at least; keeps its lane",
                "rss-brake": "brakes where a distance of RSS is violated; keeps its lane",
                "fsm": "the fuzzy safety model of UN R157; brakes early, keeps its lane",
            }.items()
        ),
        *(
            AvModel(
                f"flawed-{flaw}",
                f"made bad on purpose: idm-mobil that {about}",
                IdmParams(time_gap=0.2, standstill_gap=1.0) if flaw == "too-close" else IdmParams(),
                MobilParams(),
                kind="flawed",
                flawed=FlawParams(flaw),
            )
            for flaw, about in {
                "brakes-late": "heeds a vehicle ahead only when it would reach it within 1 s",
                "not-behind": "looks for nobody behind it when it changes lanes",
                "not-left": "sees nobody to its left",
                "too-close": "follows with a time gap of 0.2 s",
                "forgets": "drops a vehicle from its list 2 s after it came near",
                "hesitates": "returns to its lane, without looking, when it has left it",
                "merges-blind": "leaves a lane that ends without looking at the next one",
                "stops-at-end": "stops where its lane ends, and waits there before it looks for a gap",
                "blocks-mergers": "speeds up beside a vehicle whose lane ends, instead of letting it in",
            }.items()
        ),
        *(
            AvModel(name, f"at sites only: {about}", _GENTLE, MobilParams(), kind="junction", junction=params)
            for name, about, params in (
                ("idm-yield", "follows by the IDM and takes gaps somewhat longer than people's", JunctionParams()),
                (
                    "rss-yield",
                    "keeps RSS distances, and enters only where none that goes first could come",
                    JunctionParams("rss"),
                ),
                (
                    "creep",
                    "made bad on purpose: edges a metre into others' ways, takes short gaps, leaves people little room",
                    JunctionParams("creep"),
                ),
            )
        ),
    )
}
"""All built-in AVs."""
SITE_AVS = tuple(name for name, model in AVS.items() if model.kind == "junction")
"""Names of those that drive at sites, and nowhere else."""
ROAD_AVS = tuple(name for name in AVS if name not in SITE_AVS)
"""Names of those that drive on roads, and nowhere else."""


class AvNumbers(NamedTuple):
    """The AV under test as kernels take it.

    Attributes:
        idm, mobil: Parameters of the built-in AV.
        sight: As in `AvModel`.
        kind: Code of its law.
        rss, network, careful, flaw, junction: Parameters of the cautious, the learned, the careful, the flawed and the
            junction kind.
        hardest_braking, strongest_acceleration: It never commands more [m/s2].
        sees_everybody: 1 if it looks at more than its nearest neighbours in each lane.
    """

    idm: IdmNumbers
    mobil: MobilNumbers
    sight: SightNumbers
    kind: int
    rss: RssNumbers
    network: PolicyNumbers
    careful: int
    flaw: int
    junction: int
    hardest_braking: float
    strongest_acceleration: float
    sees_everybody: int


def numbers_of_av(model: AvModel) -> AvNumbers:
    """Make the constants of a built-in AV for the kernels; a learned AV without its network cannot drive with them."""
    law = AV_KINDS[model.kind]
    network = NO_POLICY
    if model.network is not None:
        network = numbers_of_network(model.network.weights, model.network.shape)
    return AvNumbers(
        IdmNumbers(*astuple(model.idm)),
        MobilNumbers(*astuple(model.mobil)),
        numbers_of_sight(model.sight),
        law.code,
        RssNumbers(*astuple(model.rss)),
        network,
        CAREFUL[model.careful.driver],
        FLAWS[model.flawed.flaw],
        list(MANNERS).index(model.junction.manner),
        hardest_braking=model.idm.max_braking if law.hardest_braking is None else law.hardest_braking,
        strongest_acceleration=model.idm.max_acceleration
        if law.strongest_acceleration is None
        else law.strongest_acceleration,
        # A polite AV asks how its follower would drive, hence sees through other vehicles' eyes too.
        sees_everybody=int(law.sees_everybody or model.mobil.politeness > 0.0),
    )


def av_named(name: str) -> AvModel:
    """Look up a built-in AV.

    Raises:
        UnknownNameError: No AV has that name; the nearest is suggested.
    """
    if name not in AVS:
        raise UnknownNameError("AV", name, AVS)
    return AVS[name]


def _numbers_of(parameters: Any) -> tuple[object, ...]:
    """List the numbers that decide how an AV drives, in one law's parameters."""
    if isinstance(parameters, AvNetwork):
        weights = hashlib.sha256(parameters.weights.astype("<f4").tobytes()).hexdigest()
        return (*structs.astuple(parameters.shape), parameters.features_version, weights)
    return () if parameters is None else astuple(parameters)


def av_hash(model: AvModel) -> str:
    """Compute SHA-256 (first 16 hex digits) over all that decides how an AV drives; name and description left out."""
    # Hashes of AVs that could drive in earlier versions are as they were: sight was a bool there, every kind plain.
    sight = {"decision": True, "centre": False}.get(model.sight.by, astuple(model.sight))
    numbers: tuple[object, ...] = (*astuple(model.idm), *astuple(model.mobil), sight)
    if model.kind != "plain":
        numbers += (model.kind,)
    for name in AV_KINDS[model.kind].parameters:
        numbers += _numbers_of(getattr(model, name))
    return hashlib.sha256(repr(numbers).encode()).hexdigest()[:16]
