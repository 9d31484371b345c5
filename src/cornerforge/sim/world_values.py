"""Allowed values of a world; kernels trust them, and use some of them as indices."""

from __future__ import annotations

import numpy as np

from cornerforge.fields import SIZES
from cornerforge.sim.outcome import AV_FAULT, IDLE, UNDRAWN
from cornerforge.sim.world import ALL_OF_THEM, COMES, GONE, MAX_BRANCH, NO_ACTION, NO_VEHICLE, UNKNOWN, World
from cornerforge.site.tables import MAX_ROUTES
from cornerforge.types import CLASSES, MAX_LANES, N_ACTIONS

__all__ = ["world_fault"]

_MOST_BITS = 62
"""A route, and a bit mask of lanes, is any number with fewer bits."""
_REAL = (-1e6, 1e6)
_COUNT = (0, 2**63 - 1)
_ANY = (-np.inf, np.inf)
_YES_OR_NO = (0, 1)
_ACTION = (NO_ACTION, N_ACTIONS - 1)
_TENTHS = (0, 10**6)
_WITHIN: dict[str, tuple[float, float]] = {
    "vehicles.present": _YES_OR_NO,
    "vehicles.action": _ACTION,
    "vehicles.length": SIZES,
    "vehicles.width": SIZES,
    "vehicles.kind": (0, len(CLASSES) - 1),
    "vehicles.quantile": (0, 1),
    "vehicles.habit": (0, 1),
    "vehicles.signals": (0, 3),
    "vehicles.away": _YES_OR_NO,
    "vehicles.noise": (-1, 1),
    "noticed": _TENTHS,
    "state.branch": (0, MAX_BRANCH),
    "state.substep": (0, 9),
    "state.outcome": (IDLE, max(AV_FAULT, UNDRAWN)),
    "state.frame": (-1, 10**6),
    "state.decisions": (0, 10**5),
    "state.bv_has_answered": _YES_OR_NO,
    "state.bv_action": _ACTION,
    "state.travel": (0, 1e9),
    "av.has_answered": _YES_OR_NO,
    "av.steers": _YES_OR_NO,
    "av.alarmed": _TENTHS,
    "seen.as_what": (0, 2),
    "agents.route": (0, MAX_ROUTES - 1),
    "agents.stage": (COMES, GONE),
    **dict.fromkeys(("agents.enters", "agents.free", "agents.stops", "agents.most", "agents.ratio"), _ANY),
    "agents.goes": (0, 1),
}
"""Ranges by array and field; others are real numbers within a thousand kilometres, or numbers of things."""


def world_fault(world: World, n_lanes: int = MAX_LANES) -> str | None:
    """Say the first value of a world that none can have, or None; what is not in use may be anything.

    Args:
        world: One world, not a batch.
        n_lanes: Lanes of its road, 1 to `MAX_LANES`; where that is not known, the most. At a site it is not read.
    """
    slots, pairs = world.vehicles.size, len(world.pairs)
    slot, no_slot = (0, slots - 1), (NO_VEHICLE, slots - 1)
    if world.agents.size:
        n_lanes = _MOST_BITS
    within = _WITHIN | {
        **dict.fromkeys(("vehicles.target_lane", "av.lane", "seen.target_lane"), (0, n_lanes - 1)),
        **dict.fromkeys(("vehicles.lanes", "seen.lanes"), (0, 2**n_lanes - 1)),
        **{f"state.{name}": (0, slots) for name in ("n_vehicles", "n_current", "n_seen")},
        **{f"state.{name}": no_slot for name in ("controlled", "slot_a", "slot_b", "hidden")},
        "state.n_pairs": (0, pairs),
        "order": slot,
        "current": slot,
        "pairs": slot,
        "agents.overlooks": (ALL_OF_THEM, slots - 1),
        **dict.fromkeys(("agents.heeds", "agents.for_whom"), no_slot),
        **dict.fromkeys(("av.lead", "av.rear"), (UNKNOWN, slots - 1)),
    }
    state = world.state[0]
    in_use = {
        **dict.fromkeys(("vehicles", "noticed", "seen", "order", "agents"), state["n_vehicles"]),
        "current": state["n_current"],
        "pairs": state["n_pairs"],
    }
    for name in ("state", *(name for name in World._fields if name != "state")):
        array = getattr(world, name)[: in_use.get(name)]
        for field in array.dtype.names or ("",):
            place = f"{name}.{field}" if field else name
            values = array[field] if field else array
            low, high = within.get(place, _REAL if values.dtype.kind == "f" else _COUNT)
            wrong = np.argwhere(~((values >= low) & (values <= high)))
            if wrong.size:
                at = tuple(wrong[0].tolist())
                return f"{place}{list(at)} is {values[at].item()!r}; it must be {low:g} to {high:g}"
    if state["n_seen"] > state["n_current"]:
        return f"state.n_seen is {state['n_seen']}; it must be at most state.n_current, {state['n_current']}"
    return None
