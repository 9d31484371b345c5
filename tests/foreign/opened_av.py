"""An AV from outside, described and opened in one go."""

from __future__ import annotations

from typing import Any

from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.spec import AvSpec
from cornerforge.types import Odd


def opened(name: str, odd: Odd, *, seed: int = 0, **asked: Any) -> ForeignAv:
    """Start an AV; `asked` as for `AvSpec`."""
    av = ForeignAv(AvSpec(name, **asked), odd, seed=seed)
    av.open()
    return av
