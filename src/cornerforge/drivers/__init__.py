"""Driver models: parameters and kernels that map what a vehicle faces to an acceleration, a gain or an action.

Programs take the parameters here: `AVS` and `av_named` (built-in AVs by name), `AvLaw` and `AvModel` (what one is made
of), `IdmParams`, `MobilParams`, `RssParams`, and `NetworkShape` of a policy. Other packages take the rest from the
module of each law.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.drivers.avs import AVS, AvLaw, AvModel, av_named
    from cornerforge.drivers.idm import IdmParams
    from cornerforge.drivers.mobil import MobilParams
    from cornerforge.drivers.policy import NetworkShape
    from cornerforge.drivers.rss import RssParams

__all__ = ["AVS", "AvLaw", "AvModel", "IdmParams", "MobilParams", "NetworkShape", "RssParams", "av_named"]

__getattr__ = door(
    __name__,
    dict.fromkeys(("AVS", "AvLaw", "AvModel", "av_named"), "avs")
    | {"IdmParams": "idm", "MobilParams": "mobil", "NetworkShape": "policy", "RssParams": "rss"},
)
