"""A straight road: parallel lanes of one width, numbered from 0 at the right edge (y = 0); x grows with the traffic.

The scalar kernels take record arrays of vehicles (`sim.world.VEHICLE`, or frames of a recording) and slots, not
numbers, so that a curved road can read more fields of a vehicle. `along` does the same for NumPy arrays.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel
from cornerforge.perception import PERFECT, PerceptionNumbers, numbers_of_perception
from cornerforge.road.lanes import LaneTable, av_lanes_at, lane_table
from cornerforge.site.tables import NO_SITE, site_numbers

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cornerforge.types import Odd

__all__ = [
    "STATED",
    "LawFactors",
    "RoadNumbers",
    "ahead_by",
    "along",
    "begin_along",
    "distance_left",
    "driven",
    "gap",
    "go_along",
    "go_further",
    "half_lengths",
    "half_widths",
    "lane_bits",
    "lane_centre",
    "lane_of",
    "part_right",
    "road_numbers",
    "truck_share_in",
    "way_from",
]


class LawFactors(NamedTuple):
    """Factors of numbers of the stated laws of merging and of stopping: all 1 but in a drawn model.

    They are those of the BVs: an AV under test stays what it is. Their widths: `ext.calibrate.uncertainty`.

    Attributes:
        urgent_time: Of `lanes.URGENT_TIME`.
        accepts_braking, accepts_time: Of the braking and the time gap of `sim.merging.pressed_chance`.
        lets_in: Of the share of drivers that let others in.
        looks_again: Of `sim.merging.LOOKS_AGAIN`.
        stops_with: Of the braking with which drivers come to a stop behind what stops (`sim.braking`).
        own, theirs: Of the braking that `sim.braking.safely_behind` expects of a driver and of its lead.
        warned: Of the braking from which on a driver does not begin to look away.
    """

    urgent_time: float = 1.0
    accepts_braking: float = 1.0
    accepts_time: float = 1.0
    lets_in: float = 1.0
    looks_again: float = 1.0
    stops_with: float = 1.0
    own: float = 1.0
    theirs: float = 1.0
    warned: float = 1.0


STATED = LawFactors()


class RoadNumbers(NamedTuple):
    """`Odd` as kernels take it; units as there.

    Attributes:
        length, width: Length and width of a car [m].
        longest, widest: Size of the largest class that may occur [m].
        one_size: Only cars may occur.
        truck_lanes: Lanes that trucks change to, counted from the right: of three or more all but the leftmost.
        ramp_time: 1 / `Odd.max_jerk`: how long a change of the acceleration takes [s per m/s2], 0: no time.
        lanes: Lanes that begin and end.
        limited: Not every action is possible for every vehicle: there are trucks, or traffic stops.
        av_lanes: Lanes in which the AV may start, a bit mask.
        av_exits: The AV is to take the exit.
        stops: Traffic comes to a stop here, at the end of a lane or of a queue: drivers know how to follow at all
            speeds, and brake as hard as they must.
        queue: There is a queue ahead of the AV.
        spacing: `Odd.spacing`.
        law: Factors of the laws by which BVs merge and stop; not read where lanes go on and none stops.
        perception: What the AV perceives.
        site: The site, (1,) of `site.tables.SITE`; none on a road.
    """

    n_lanes: int
    lane_width: float
    length: float
    width: float
    max_speed: float
    lane_change_duration: float
    max_lateral_acceleration: float
    test_length: float
    max_decisions: int
    av_start: float
    traffic_length: float
    av_substeps: int
    truck_share: float
    motorcycle_share: float
    ignored_rear: float
    longest: float
    widest: float
    one_size: bool
    same_duration: bool
    max_jerk: float
    ramp_time: float
    slower_right: float
    truck_lanes: int
    lanes: LaneTable
    limited: bool
    av_lanes: int
    av_exits: bool
    stops: bool
    queue: bool
    spacing: float
    law: LawFactors = STATED
    perception: PerceptionNumbers = PERFECT
    site: NDArray[np.void] = NO_SITE


def road_numbers(odd: Odd) -> RoadNumbers:
    """Make the constants of an ODD for the kernels."""
    lanes = lane_table(odd)
    one_size = len(odd.sizes_on_road) == 1 and odd.site is None
    return RoadNumbers(
        odd.n_lanes,
        odd.lane_width,
        odd.vehicle_length,
        odd.vehicle_width,
        odd.max_speed,
        odd.lane_change_duration,
        odd.max_lateral_acceleration,
        odd.test_length,
        int(np.ceil(odd.time_limit)),
        odd.av_start,
        odd.traffic_length,
        odd.av_substeps,
        odd.truck_share,
        odd.motorcycle_share,
        odd.ignored_rear,
        max(length for length, _ in odd.sizes_on_road),
        max(width for _, width in odd.sizes_on_road),
        one_size,
        odd.same_duration,
        odd.max_jerk,
        1.0 / odd.max_jerk,
        odd.slower_right,
        odd.n_lanes - 1 if odd.truck_share > 0.0 and odd.n_lanes > 2 else odd.n_lanes,
        lanes,
        not one_size or lanes.varied or odd.traffic != "free",
        sum(1 << lane for lane in av_lanes_at(odd, odd.av_start)),
        odd.task == "exit",
        lanes.varied or odd.traffic != "free",
        odd.traffic == "queue",
        odd.spacing,
        perception=numbers_of_perception(odd.perception),
        site=site_of(odd),
    )


def site_of(odd: Odd) -> NDArray[np.void]:
    """Make the record of an ODD's site; none of a road."""
    if odd.site is None or odd.laws is None or odd.demand is None:
        return NO_SITE
    return site_numbers(odd.site, odd.laws, odd.demand, odd.time_limit)


# Lanes


@inlined_kernel
def lane_of(y: float, lane_width: float) -> int:
    """Find the lane that holds y [m]; negative or too large beyond the road's edges."""
    return math.floor(y / lane_width)


@inlined_kernel
def lane_centre(lane: int, lane_width: float) -> float:
    """Compute the lateral position [m] of a lane's centre."""
    return (lane + 0.5) * lane_width


@inlined_kernel
def lane_bits(y: float, half_width: float, target_lane: int, lane_width: float) -> int:
    """Find the lanes that a vehicle occupies, as a bit mask: the lanes that its body touches, and its target lane.

    The heading is left out: in a lane change of 2.5 s and more it widens a car's body by less than 0.3 m.
    """
    low = lane_of(y - half_width, lane_width)
    high = lane_of(y + half_width, lane_width)
    bits = 1 << target_lane
    if low >= 0:
        bits |= 1 << low
    if high >= 0:
        bits |= 1 << high
    return bits


@inlined_kernel
def part_right(lane: int, road: RoadNumbers) -> float:
    """Compute how far right a lane is: 1 for the rightmost, 0 for the leftmost, in even steps between them."""
    return (road.n_lanes - 1 - lane) / (road.n_lanes - 1)


@inlined_kernel
def truck_share_in(lane: int, road: RoadNumbers) -> float:
    """Compute the share of trucks in a lane at the start; its mean over all lanes is `Odd.truck_share`.

    Of 2, 3, 4 lanes the rightmost has 100, 67, 50 % of the trucks; AASHTO (1993, Guide for Design of Pavement
    Structures) reckons with 80-100, 60-80, 50-75 % of the truck axles in the design lane.
    """
    return 2.0 * part_right(lane, road) * road.truck_share


# Along the road


@inlined_kernel
def ahead_by(v: NDArray[np.void], i: int, j: int) -> float:
    """Compute how far the centre of vehicle j is ahead of the centre of vehicle i [m]; negative: behind."""
    distance: float = v[j].x - v[i].x
    return distance


@inlined_kernel
def way_from(start: float, end: float) -> float:
    """Compute how far `end` is ahead of `start`, both positions along the road [m], in a kernel."""
    return end - start


def along(start: ArrayLike, end: ArrayLike) -> NDArray[np.float64]:
    """Compute how far `end` is ahead of `start`, both positions along the road [m]; for NumPy arrays and numbers."""
    return np.subtract(end, start)


@inlined_kernel
def half_lengths(v: NDArray[np.void], i: int, j: int) -> float:
    """Compute half the sum of two vehicles' lengths [m]: the distance of their centres when their bumpers touch."""
    half: float = 0.5 * (v[i].length + v[j].length)
    return half


@inlined_kernel
def half_widths(v: NDArray[np.void], i: int, j: int) -> float:
    """Compute half the sum of two vehicles' widths [m]."""
    half: float = 0.5 * (v[i].width + v[j].width)
    return half


@inlined_kernel
def gap(v: NDArray[np.void], rear: int, lead: int) -> float:
    """Compute the gap from the front bumper of `rear` to the rear bumper of `lead` [m]; negative: they overlap."""
    return ahead_by(v, rear, lead) - half_lengths(v, rear, lead)


@inlined_kernel
def begin_along(v: NDArray[np.void], i: int, ahead: float) -> None:
    """Note where vehicle i's acceleration begins: at a distance [m] ahead of where it is."""
    v[i].x_held = v[i].x + ahead


@inlined_kernel
def go_along(v: NDArray[np.void], i: int, distance: float) -> None:
    """Put vehicle i at a distance [m] ahead of where its acceleration began (`x_held`)."""
    v[i].x = v[i].x_held + distance


@inlined_kernel
def go_further(v: NDArray[np.void], i: int, distance: float) -> None:
    """Move vehicle i ahead by a distance [m]."""
    v[i].x = v[i].x + distance


@inlined_kernel
def driven(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Compute how far vehicle i is ahead of where the AV starts [m]."""
    distance: float = v[i].x - road.av_start
    return distance


@inlined_kernel
def distance_left(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Compute how far vehicle i is from where a test ends [m]; 0 or less: it has arrived."""
    distance: float = road.av_start + road.test_length - v[i].x
    return distance
