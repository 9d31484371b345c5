"""The operational design domain as tested, attribute by attribute, in the groups of ISO 34503."""

from __future__ import annotations

from cornerforge.experiment.roads import TASKS
from cornerforge.report import text
from cornerforge.results.evidence import AttributeTested
from cornerforge.road.lanes import lane_table
from cornerforge.types import TRAFFIC, Odd

__all__ = ["odd_as_tested"]


def _perception(odd: Odd) -> str:
    """Say what the AV perceives."""
    if odd.perception is None:
        return "perfect, but for what the AV's own program leaves out"
    return f"imperfect, by a stated law: {odd.perception.in_words()}"


def odd_as_tested(odd: Odd) -> tuple[AttributeTested, ...]:
    """List the attributes of an operational design domain, and what was driven of each; "" if nothing was."""
    road, ends = odd.road, lane_table(odd).varied
    sharpest = 0.0 if road is None else max(abs(piece.curvature) for piece in road.pieces)
    users = [f"cars of {odd.vehicle_length:g} m x {odd.vehicle_width:g} m"]
    users += [
        f"{name} ({text.share(share)})"
        for name, share in (("trucks", odd.truck_share), ("motorcycles", odd.motorcycle_share))
        if share
    ]
    slowest = 20 if odd.traffic == "free" and not ends else 0
    rows = (
        ("Road type", "motorway, one direction of travel", False),
        ("Lanes", f"{odd.n_lanes} of {odd.lane_width:g} m" + ("" if road is None else f", road {road.name}"), False),
        ("Lanes that begin or end", "yes" if ends else "none", False),
        ("Curves", f"radius {1.0 / sharpest:,.0f} m and more" if sharpest else "straight", False),
        ("Gradients and superelevation", "", False),
        ("Road surface", "dry: brakes up to 8 m/s²", False),
        ("Signs, signals and temporary structures", "", False),
        ("Weather and visibility", "", False),
        ("Light", "", False),
        ("Connectivity and positioning", "", False),
        ("Density of traffic", f"{odd.traffic}, room for a vehicle every {TRAFFIC[odd.traffic]:g} m of a lane", True),
        ("Speeds of others", f"{slowest} to {odd.max_speed:g} m/s", True),
        ("Vehicles", ", ".join(users), len(users) > 1),
        ("Behaviour of others", "following, lane changes, looking away, overlooking, giving way late", True),
        ("People, animals and objects on the road", "", False),
        ("Task of the AV", f"{TASKS[odd.task]}; {odd.test_length:g} m a test", False),
        ("Perception of the AV", _perception(odd), odd.perception is not None and odd.perception.is_random),
        ("Faults of the AV's hardware", "", False),
    )
    return tuple(AttributeTested(attribute=name, driven=driven, varied=varied) for name, driven, varied in rows)
