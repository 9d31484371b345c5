"""The built-in automated vehicles under test, by name."""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass

from cornerforge.drivers.idm import IdmParams
from cornerforge.drivers.mobil import MobilParams
from cornerforge.errors import UnknownNameError

__all__ = ["AVS", "AvModel", "av_hash", "av_named"]


@dataclass(frozen=True)
class AvModel:
    """An AV that follows the IDM and changes lanes after MOBIL.

    Attributes:
        name: What the command line calls it.
        about: One line for people.
        idm, mobil: Parameters.
        sees_intentions: It takes a vehicle that is entering a lane for one that is in it, and gives way to one that
        enters its
            own target lane from the other side; False is the plain model, which goes by lane centres.
    """

    name: str
    about: str
    idm: IdmParams
    mobil: MobilParams
    sees_intentions: bool = True


_D2RL = IdmParams(
    max_acceleration=1.5, comfortable_braking=2.0, standstill_gap=2.0, time_gap=1.2, desired_speed=33.3, max_braking=4.0
)

AVS: dict[str, AvModel] = {
    model.name: model
    for model in (
        AvModel(
            "idm-mobil",
            "IDM and MOBIL as the paper's group uses them (NADE); sees who enters a lane",
            IdmParams(),
            MobilParams(),
        ),
        AvModel("idm-mobil-d2rl", "the same with the parameters of D2RL: closer and faster", _D2RL, MobilParams()),
        AvModel(
            "idm-mobil-blind",
            "idm-mobil that goes by lane centres and sees nobody's intention",
            IdmParams(),
            MobilParams(),
            False,
        ),
    )
}
"""All built-in AVs."""


def av_named(name: str) -> AvModel:
    """Look up a built-in AV.

    Raises:
        UnknownNameError: There is none of that name; the nearest is suggested.
    """
    if name not in AVS:
        raise UnknownNameError("AV", name, AVS)
    return AVS[name]


def av_hash(model: AvModel) -> str:
    """SHA-256 (first 16 hex digits) over what decides how it drives; its name and description left out."""
    numbers = (*astuple(model.idm), *astuple(model.mobil), model.sees_intentions)
    return hashlib.sha256(repr(numbers).encode()).hexdigest()[:16]
