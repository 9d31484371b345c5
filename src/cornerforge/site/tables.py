"""Sites as kernels take them: one record with routes, places along them, zones, signals and laws; poses by place."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from functools import lru_cache
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.errors import InputError
from cornerforge.site.laws import ERRORS, Demand, Laws
from cornerforge.site.network import TURNS, Route, Site, headings_of
from cornerforge.site.zones import BODY, PERSON, Zone, zones_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "CHANGE_TIME", "CROSS", "DIVERGE", "GREEN", "MAX_PHASES", "MAX_PLACES", "MAX_ROUTES", "MEETINGS", "MERGE",
    "NOISE_CELLS", "NO_SITE", "NO_ZONE", "RED", "SHARED", "SITE", "SLOW_WALK", "WALK", "WARM_UP", "WEAVE", "YELLOW",
    "approaches", "at_site", "beside", "letter_at", "longer", "mapped", "nearest_place", "place_of", "pose_at",
    "seen_from", "site_numbers", "slots_at", "speed_at", "walk_letter", "when_green", "without_errors",
]  # fmt: skip

MAX_ROUTES, MAX_PLACES, MAX_PHASES = 64, 512, 32
"""Most routes of a site, places along a route, and phases of its signals."""
MEETINGS = 2
"""Most zones of two routes."""
NOISE_CELLS = 21
"""Accelerations about the law's that noise may lead to, the law's own in the middle."""
NO_ZONE, CROSS, MERGE, DIVERGE, SHARED, WEAVE = range(6)
"""Kinds of zones of two routes."""
RED, YELLOW, GREEN, YIELDING_GREEN = range(4)
"""Letters of signals."""
WALK = TURNS.index("walk")
_LETTERS = {"r": RED, "y": YELLOW, "G": GREEN, "g": YIELDING_GREEN}
_KINDS = {"cross": CROSS, "merge": MERGE, "diverge": DIVERGE, "shared": SHARED, "weave": WEAVE}
WARM_UP = 40.0
"""Traffic drives so long before the AV comes [s]."""
_FREE = 0.5
"""A vehicle that waits at a line is so far from where it would be in the way [m]."""
_ROOM_TO_WAIT = 1.0
"""A vehicle may wait between two zones that are so far apart along its route [m]."""
ACCELERATION_STEP = 0.2
"""Step between the accelerations that a vehicle can choose [m/s2]."""
_BRAKES = 1.5
"""Braking with which a limit or a turn ahead is met [m/s2]."""

_WIDEST, _LONGEST = 2.3, 7.5
"""Zones are those of vehicles of this width [m], and as delivery trucks of this length sweep them [m]."""
SLOW_WALK, CHANGE_TIME = 1.07, 4.0
"""Walking speed of slow people [m/s], and the time in which signals change [s]; see `walk_letter`."""
_BODY, _PERSON = BODY[0], PERSON[0]

_PLACE = np.dtype([("x", "f8"), ("y", "f8"), ("heading", "f8"), ("curvature", "f8"), ("speed", "f8")])
_ROUTE = np.dtype(
    [
        ("places", "i8"),  # count of its places, evenly apart
        ("step", "f8"),  # their distance [m]
        ("length", "f8"),  # [m]
        ("stop", "f8"),  # where the stop line is; of people 0 [m]
        ("leaves", "f8"),  # where it leaves the junction [m]
        ("limit", "f8"),  # of speed before the stop line [m/s]
        ("turn", "i8"),  # index of TURNS
        ("signal", "i8"),  # -1: none
        ("approach", "i8"),  # number of the lane, or kerb, that it begins on
        ("weight", "f8"),  # share of the vehicles of its approach
    ]
)
_ZONE = np.dtype(
    [
        ("kind", "i8"),
        ("begin", "f8"),  # of the stretch along the own route [m]
        ("end", "f8"),
        ("other_begin", "f8"),  # of the stretch along the other route [m]
        ("other_end", "f8"),
        ("yields", "i8"),  # the own route yields to the other
        ("goes_first", "i8"),  # the other yields to the own
        ("until", "f8"),  # where the chain of zones without room to wait between them ends, along the own route [m]
    ]
)
_NUMBERS = [one.name for one in fields(Laws) if one.name != "walks"]
SITE = np.dtype(
    [
        ("routes", "i8"),
        ("vehicle_routes", "i8"),  # they come first
        ("approaches", "i8"),
        ("phases", "i8"),
        ("slots", "i8"),  # of a world: vehicles and people that may come in a test
        ("cycle", "f8"),  # length of the programme [s], 0: no signals
        ("route", _ROUTE, (MAX_ROUTES,)),
        ("place", _PLACE, (MAX_ROUTES, MAX_PLACES)),
        ("zone", _ZONE, (MAX_ROUTES, MAX_ROUTES, MEETINGS)),
        ("phase_ends", "f8", (MAX_PHASES,)),
        ("letters", "i1", (MAX_PHASES, MAX_ROUTES)),
        ("walks", "f8", (7,)),
        *((name, "f8") for name in _NUMBERS),
        *((one.name, "f8") for one in fields(Demand)),
        ("noise_shares", "f8", (NOISE_CELLS,)),  # of accelerations about the law's, one step apart
    ],
    align=True,
)
"""A site, its laws and its demand."""
NO_SITE: NDArray[np.void] = np.zeros(0, dtype=SITE)
"""A road in place of a site."""


@lru_cache(maxsize=4)
def site_numbers(site: Site, laws: Laws, demand: Demand, seconds: float) -> NDArray[np.void]:
    """Make the record of a site for the kernels, (1,) of `SITE`; tests last `seconds` [s] at most.

    Raises:
        InputError: It has more routes, phases or metres of a route than kernels take, or no route of vehicles.
    """
    longest = max(route.length for route in site.routes)
    for what, count, most in (
        ("routes", len(site.routes), MAX_ROUTES),
        ("phases", len(site.programme), MAX_PHASES),
        ("metres of a route", math.ceil(longest) + 1, MAX_PLACES),
        ("signals", max((len(phase.states) for phase in site.programme), default=0), MAX_ROUTES),
    ):
        if count > most:
            raise InputError(f"The site {site.name} has {count} {what}; at most {most} can be driven.")
    if not site.vehicles or site.vehicles != tuple(range(len(site.vehicles))):
        raise InputError(f"The site {site.name} needs routes of vehicles, before those of people.")
    out = np.zeros(1, dtype=SITE)
    one = out[0]
    for part in (laws, demand):
        for name in (field.name for field in fields(part)):
            one[name] = getattr(part, name)
    one["routes"], one["vehicle_routes"], one["phases"] = len(site.routes), len(site.vehicles), len(site.programme)
    one["slots"] = slots_at(site, demand, seconds)
    one["noise_shares"] = _noise_shares(laws.noise)
    starts = approaches(site)
    one["approaches"] = max(starts) + 1
    for k in range(len(site.routes)):
        _fill_route(one, site, k, starts, laws, demand)
    for k, phase in enumerate(site.programme):
        one["phase_ends"][k] = sum(earlier.seconds for earlier in site.programme[: k + 1])
        one["letters"][k, : len(phase.states)] = [_LETTERS[letter] for letter in phase.states]
    one["cycle"] = one["phase_ends"][len(site.programme) - 1] if site.programme else 0.0
    _fill_zones(one, site)
    return out


def approaches(site: Site) -> tuple[int, ...]:
    """Number the lanes, and kerbs, on which routes begin: for each route its number, those of vehicles first."""
    numbers: dict[tuple[str, tuple[float, float]], int] = {}
    return tuple(numbers.setdefault((route.approach, route.points[0]), len(numbers)) for route in site.routes)


def slots_at(site: Site, demand: Demand, seconds: float) -> int:
    """Compute how many slots a world needs, so that arrivals fit but once in 1e9 tests; the AV has one of them."""
    starts = approaches(site)
    lanes = len({starts[k] for k in site.vehicles})
    kerbs = len({starts[k] for k in site.people})
    mean = (lanes * demand.vehicles + kerbs * demand.people) * (WARM_UP + seconds) / 3600.0
    return 2 + math.ceil(mean + 6.0 * math.sqrt(mean) + 6.0)


def _fill_route(one: NDArray[np.void], site: Site, k: int, starts: tuple[int, ...], laws: Laws, demand: Demand) -> None:
    route, row = site.routes[k], one["route"][k]
    count = max(2, math.ceil(route.length) + 1)
    at = np.linspace(0.0, route.length, count)
    row["places"], row["step"], row["length"] = count, at[1], route.length
    row["stop"], row["leaves"], row["limit"] = route.stop, route.leaves, route.limits[0]
    row["turn"], row["signal"], row["approach"] = TURNS.index(route.turn), route.signal, starts[k]
    usual = {"left": demand.left, "right": demand.right, "back": 0.02 * demand.left}
    ways = [other.turn for other, start in zip(site.routes, starts, strict=True) if start == starts[k]]
    all_ways = sum(usual.get(turn, 1.0) for turn in ways)
    row["weight"] = usual.get(route.turn, 1.0) / all_ways if all_ways > 0.0 else 1.0 / len(ways)
    headings = np.interp(at, route.along, headings_of(route.line))
    places = one["place"][k]
    places["x"][:count], places["y"][:count] = (np.interp(at, route.along, values) for values in route.line.T)
    places["heading"][:count] = headings
    bend = np.gradient(headings, at) if count > 2 else np.zeros(count)
    places["curvature"][:count] = np.convolve(np.pad(bend, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    limits = np.where(at < route.stop, route.limits[0], route.limits[1])
    turns = np.sqrt(laws.lateral / np.maximum(np.abs(places["curvature"][:count]), 1e-9))
    speeds = np.minimum(limits, turns)
    for n in range(count - 2, -1, -1):  # so that it can brake for what is ahead
        speeds[n] = min(speeds[n], math.sqrt(speeds[n + 1] ** 2 + 2.0 * _BRAKES * at[1]))
    places["speed"][:count] = speeds


def _noise_shares(sd: float) -> NDArray[np.float64]:
    """Cut a normal distribution of the standard deviation [m/s2] into cells as wide as the step of accelerations.

    What lies beyond 2.5 standard deviations is left out.
    """
    steps = np.arange(NOISE_CELLS) - NOISE_CELLS // 2
    if sd == 0.0:
        alone: NDArray[np.float64] = (steps == 0).astype(np.float64)
        return alone
    edges = np.clip((np.append(steps, steps[-1] + 1) - 0.5) * ACCELERATION_STEP / sd, -2.5, 2.5)
    shares: NDArray[np.float64] = np.diff([NormalDist().cdf(edge) for edge in edges.tolist()])
    shares /= shares.sum()
    return shares


def _fill_zones(one: NDArray[np.void], site: Site) -> None:
    for zone in _zones_of_all(site):
        for own, other, stretch, others, yields, first in (
            (zone.first, zone.second, zone.of_first, zone.of_second, zone.first_yields, zone.second_yields),
            (zone.second, zone.first, zone.of_second, zone.of_first, zone.second_yields, zone.first_yields),
        ):
            met = one["zone"][own, other]
            known = int((met["kind"] != NO_ZONE).sum())
            if known == MEETINGS:
                raise InputError(
                    f"Routes {site.routes[own].name} and {site.routes[other].name} of {site.name} meet more than "
                    f"{MEETINGS} times, which cannot be driven."
                )
            met[known] = (_KINDS[zone.kind], *stretch, *others, yields, first, 0.0)
    for own in range(len(site.routes)):
        _fill_chains(one, own)
    for own in site.vehicles:
        _clear_line(one, own)


def _zones_of_all(site: Site) -> list[Zone]:
    """Find the zones of cars, made longer where trucks, which swing out, touch more than their length explains."""
    pairs: dict[tuple[int, int], list[Zone]] = {}
    for zone in zones_of(site, _WIDEST):
        pairs.setdefault((zone.first, zone.second), []).append(zone)
    for zone in zones_of(site, _WIDEST, _LONGEST):
        known = pairs.setdefault((zone.first, zone.second), [])
        swings = replace(
            zone,
            of_first=_inside(zone.of_first, site.routes[zone.first]),
            of_second=_inside(zone.of_second, site.routes[zone.second]),
        )
        met = [
            k
            for k, one in enumerate(known)
            if _meet(one.of_first, zone.of_first) and _meet(one.of_second, zone.of_second)
        ]
        if not met:
            known.append(swings)
            continue
        first, last = met[0], met[-1]
        known[first] = _lengthened(known[first], swings, at_begin=True)
        known[last] = _lengthened(known[last], swings, at_begin=False)
    return [zone for known in pairs.values() for zone in known]


def _inside(stretch: tuple[float, float], route: Route) -> tuple[float, float]:
    """Shorten a stretch of trucks by what their ends reach farther; that of a person's route stays."""
    if route.turn == "walk":
        return stretch
    more = 0.5 * (_LONGEST - _BODY) - _FREE  # in a bend, a car is not where the middle of a truck is
    begin = stretch[0] + more if stretch[0] > 0.0 else 0.0
    end = stretch[1] - more if stretch[1] < route.length else stretch[1]
    return begin, max(begin, end)


def _meet(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[1] and other[0] <= one[1]


def _lengthened(zone: Zone, swings: Zone, *, at_begin: bool) -> Zone:
    """Lengthen a zone at its begin or end to that of trucks; on both routes alike where they have one lane."""
    a, b = zone.of_first, zone.of_second
    if not at_begin:
        return replace(
            zone, of_first=(a[0], max(a[1], swings.of_first[1])), of_second=(b[0], max(b[1], swings.of_second[1]))
        )
    begins = min(a[0], swings.of_first[0]), min(b[0], swings.of_second[0])
    if zone.kind != "cross":
        more = min(max(a[0] - begins[0], b[0] - begins[1]), a[0], b[0])
        begins = a[0] - more, b[0] - more
    return replace(zone, of_first=(begins[0], a[1]), of_second=(begins[1], b[1]))


def _fill_chains(one: NDArray[np.void], own: int) -> None:
    """Note for each zone of a route where the last one ends that follows without room to wait between them."""
    rows = one["zone"][own].reshape(-1)
    meet = sorted((row for row in rows if row["kind"] in (CROSS, MERGE, WEAVE)), key=lambda row: -row["begin"])
    behind: list[NDArray[np.void]] = []
    for row in meet:  # from the last to the first
        follows = [later for later in behind if later["begin"] < row["end"] + _ROOM_TO_WAIT]
        row["until"] = max([row["end"], *(later["until"] for later in follows)])
        behind.append(row)


def _clear_line(one: NDArray[np.void], own: int) -> None:
    """Draw the stop line of a route back, so that a truck which waits there stands outside the zones about the line."""
    row = one["route"][own]
    for zone in one["zone"][own].reshape(-1):
        if zone["kind"] in (CROSS, MERGE, WEAVE) and row["stop"] - _BODY < zone["begin"]:
            row["stop"] = min(row["stop"], zone["begin"] + 0.5 * _BODY - _FREE)


def without_errors(site: NDArray[np.void]) -> NDArray[np.void]:
    """Copy a site's record, (1,) of `SITE` or (0,), with all chances of human errors 0."""
    copied = site.copy()
    for name in ERRORS:
        copied[name] = 0.0
    return copied


@inlined_kernel
def at_site(site: NDArray[np.void]) -> bool:
    """Is there a site, and not a road?"""
    return site.size > 0


@inlined_kernel
def place_of(site: NDArray[np.void], route: int, s: float) -> tuple[int, float]:
    """Find the place of a route before s [m] and the part of the way to the next one, both within the route."""
    row = site[0].route[route]
    steps = max(0.0, min(s, row.length)) / row.step
    k = min(math.floor(steps), row.places - 2)
    return k, steps - k


@inlined_kernel
def pose_at(site: NDArray[np.void], route: int, s: float) -> tuple[float, float, float]:
    """Compute x, y [m] and heading [rad] at s [m] of a route; beyond its ends those of the ends."""
    k, part = place_of(site, route, s)
    here, after = site[0].place[route, k], site[0].place[route, k + 1]
    return (
        here.x + part * (after.x - here.x),
        here.y + part * (after.y - here.y),
        here.heading + part * (after.heading - here.heading),
    )


@inlined_kernel
def beside(pose: tuple[float, float, float], aside: float) -> tuple[float, float, float]:
    """Move a pose, x, y [m] and heading [rad], to its left [m]."""
    x, y, heading = pose
    sine, cosine = sin_cos(heading)
    return x - aside * sine, y + aside * cosine, heading


@inlined_kernel
def seen_from(one: Any, other: Any) -> tuple[float, float]:
    """Say how far ahead of one record with x, y and heading another is, and how far to its left [m]."""
    sine, cosine = sin_cos(one.heading)
    dx, dy = other.x - one.x, other.y - one.y
    return dx * cosine + dy * sine, dy * cosine - dx * sine


@kernel
def nearest_place(site: NDArray[np.void], route: int, x: float, y: float) -> float:
    """Find how far along a route [m] its point nearest to a place is, x and y [m]."""
    row, places = site[0].route[route], site[0].place[route]
    best, found = np.inf, 0.0
    for k in range(row.places - 1):
        one, after = places[k], places[k + 1]
        dx, dy = after.x - one.x, after.y - one.y
        part = ((x - one.x) * dx + (y - one.y) * dy) / (dx * dx + dy * dy)
        part = max(0.0, min(part, 1.0))
        off_x, off_y = one.x + part * dx - x, one.y + part * dy - y
        away = off_x * off_x + off_y * off_y
        if away < best:
            best, found = away, (k + part) * row.step
    return found


@inlined_kernel
def speed_at(site: NDArray[np.void], route: int, s: float) -> float:
    """Compute the speed at s [m] of a route that limits and turns there and ahead allow [m/s]."""
    k, part = place_of(site, route, s)
    here, after = site[0].place[route, k], site[0].place[route, k + 1]
    speed: float = here.speed + part * (after.speed - here.speed)
    return speed


@inlined_kernel
def letter_at(site: NDArray[np.void], route: int, clock: float) -> int:
    """Look up the light of a route at a time of the programme [s]; green without a signal."""
    one = site[0]
    signal = one.route[route].signal
    if signal < 0 or one.phases == 0:
        return GREEN
    time = clock % one.cycle
    phase = 0
    while phase < one.phases - 1 and time >= one.phase_ends[phase]:
        phase += 1
    letter: int = one.letters[phase, signal]
    return letter


@inlined_kernel
def when_green(site: NDArray[np.void], route: int, clock: float) -> float:
    """Compute for how long the light of a route has not been red or yellow [s]; +inf if it never is."""
    one = site[0]
    signal = one.route[route].signal
    if signal < 0 or one.phases == 0:
        return np.inf
    time: float = clock % one.cycle
    since = time
    for phase in range(one.phases):
        if one.phase_ends[phase] <= time and one.letters[phase, signal] <= YELLOW:
            since = time - one.phase_ends[phase]
    if since == time and one.letters[one.phases - 1, signal] > YELLOW:  # it began in the cycle before
        since += one.cycle - _last_end(one, signal)
    return since


@inlined_kernel
def _last_end(one: Any, signal: int) -> float:
    """Find where the last red or yellow phase of a signal ends [s]; 0 for none."""
    last: float = 0.0
    for phase in range(one.phases):
        if one.letters[phase, signal] <= YELLOW:
            last = one.phase_ends[phase]
    return last


@inlined_kernel
def walk_letter(site: NDArray[np.void], route: int, clock: float) -> int:
    """Look up the light of people: GREEN on Walk, YELLOW while Don't Walk flashes, RED else.

    It flashes for as long as a slow person, at 1.07 m/s (MUTCD 4E.06: 3.5 ft/s), needs to the other kerb, less the time
    in which the signals change, 4 s.
    """
    if letter_at(site, route, clock) < GREEN:
        return RED
    one = site[0]
    needed = one.route[route].length / SLOW_WALK - CHANGE_TIME
    if needed > 0.0 and letter_at(site, route, clock + needed) < GREEN:
        return YELLOW
    return GREEN


@inlined_kernel
def mapped(zone: Any, s: float) -> float:
    """Find the place along the own route that stands for s [m] along another which shares a lane with it in a zone.

    Both stretches of such a zone are equally long (`zones.Zone`).
    """
    place: float = zone.begin + (s - zone.other_begin)
    return place


@inlined_kernel
def longer(length: float, walks: bool) -> float:
    """Compute how much farther than the body of its zones one of a length [m] reaches from its middle [m]."""
    return 0.5 * (length - (_PERSON if walks else _BODY))
