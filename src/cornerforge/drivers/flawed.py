"""AVs made bad on purpose, one flaw each: statements about an AV's crashes can be checked against them.

Each flaw is one that real software had: a threshold of time to collision too small, a gap check that looks ahead only,
a sensor that sees nothing on one side, a tracker that drops what it has followed for some time, a planner that takes
back its own decisions, a time gap too short; where lanes end, a merge without a gap check, a planner that waits at the
end for a road without traffic, one that keeps its right of way. Without its flaw each is `idm-mobil`.
"""

from __future__ import annotations

from dataclasses import dataclass

from cornerforge._checks import check_in

__all__ = [
    "BLIND_SIDE", "BLOCKS", "FLAWS", "FORGETS", "HESITATES", "LATE", "MERGES_BLIND", "NOT_BEHIND", "STOPS_AT_END",
    "TOO_CLOSE", "FlawParams",
]  # fmt: skip

LATE, NOT_BEHIND, BLIND_SIDE, FORGETS, HESITATES, TOO_CLOSE, MERGES_BLIND, STOPS_AT_END, BLOCKS = range(9)
FLAWS = {
    "brakes-late": LATE,
    "not-behind": NOT_BEHIND,
    "not-left": BLIND_SIDE,
    "forgets": FORGETS,
    "hesitates": HESITATES,
    "too-close": TOO_CLOSE,
    "merges-blind": MERGES_BLIND,
    "stops-at-end": STOPS_AT_END,
    "blocks-mergers": BLOCKS,
}
"""Name and code of each flaw."""


@dataclass(frozen=True)
class FlawParams:
    """Flaw of an AV of kind "flawed".

    Attributes:
        flaw: A name of `FLAWS`. "brakes-late": it notices a vehicle ahead only when it would reach it within 1 s.
            "not-behind": it does not look behind when it changes lanes. "not-left": it sees no vehicle with its centre
            more than 1 m to its left. "forgets": it drops a vehicle from its list 2 s after it came within 100 m.
            "hesitates": when it has left its lane, it returns to it, without looking. "too-close": it overlooks no
            vehicle, but its IDM has a short time gap. "merges-blind": it leaves a lane that ends as soon as it may,
            whatever is in the next one. "stops-at-end": it stops where its lane ends, and looks for a gap only when it
            has stood for 5 s. "blocks-mergers": it speeds up beside a vehicle whose lane ends, and does not heed it.

    Raises:
        InputError: The flaw is unknown.
    """

    flaw: str = "brakes-late"

    def __post_init__(self) -> None:
        check_in("flawed.flaw", self.flaw, tuple(FLAWS))
