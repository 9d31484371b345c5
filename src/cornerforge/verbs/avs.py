"""`avs` lists the built-in AVs."""

from __future__ import annotations

from cornerforge._options import verb
from cornerforge.drivers.avs import AVS
from cornerforge.results import Avs
from cornerforge.results.avs import AvAbout
from cornerforge.verbs.options.driving import ListAvs

__all__ = ["avs"]


@verb(ListAvs, writes=False)
def avs(_: ListAvs) -> Avs:
    """List the built-in AVs, as `cornerforge avs --json` prints them."""
    return Avs(avs=tuple(AvAbout(name=model.name, about=model.about) for model in AVS.values()))
