"""Measures and safe distances against their definitions, driven out: two bodies in steps of 1 ms, on 10,000 inputs.

Nothing here knows a closed formula. A body keeps an acceleration during its response time, which is a number of whole
steps, and then brakes until it stands. Speeds are exact at each step and positions are summed by the trapezoid, so that
a stop within a step is wrong by a / 8 dt^2, and a greatest approach between two steps too: 1e-4 m for all together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge import metrics
from cornerforge.drivers import rss as rss_drivers
from cornerforge.drivers.careful import CAREFUL, Threat, braking_demanded
from cornerforge.drivers.rss import RssNumbers, rss_braking
from cornerforge.metrics import bbd, crash_mode, delta_v, drac, pet, rss_lateral, rss_longitudinal, rss_margin, thw, ttc
from cornerforge.metrics.injury import CRASH_MODES
from cornerforge.metrics.risk import contact_time

Numbers: TypeAlias = NDArray[np.float64]

N = 10_000
STEP = 1e-3
NEAR = 1e-4
"""Tolerance of a distance [m]; see the text of the module."""


@dataclass(frozen=True)
class Body:
    """Motion along one axis; arrays or numbers in SI units, and the response time in steps."""

    speed: Any
    response: Any = 0
    acceleration: Any = 0.0
    braking: Any = 0.0


def driven(behind: Body, ahead: Body, seconds: float) -> tuple[Numbers, Numbers]:
    """Drive two bodies; give how much the first gains on the second at most, and in the end [m]."""

    def both(name: str) -> Numbers:
        return np.stack([np.broadcast_to(getattr(one, name), N) for one in (behind, ahead)]).astype(np.float64)

    speeds, responses, gains, stops = (
        both("speed"),
        both("response"),
        STEP * both("acceleration"),
        STEP * both("braking"),
    )
    gained, most, rate, cut = np.zeros(N), np.zeros(N), speeds[0] - speeds[1], np.empty((2, N))
    last = responses.max()
    for k in range(round(seconds / STEP)):
        np.minimum(np.maximum(speeds, -stops, out=cut), stops, out=cut)
        speeds -= cut if k >= last else np.where(k < responses, -gains, cut)
        gained += rate
        np.subtract(speeds[0], speeds[1], out=rate)
        gained += rate
        np.maximum(most, gained, out=most)
        if k > last and k % 256 == 0 and not speeds.any():
            break
    return 0.5 * STEP * most, 0.5 * STEP * gained


def uniform(rng: np.random.Generator, low: float, high: float) -> Numbers:
    """Draw numbers, a tenth of them at each end of the range and a tenth the nearest whole ones."""
    drawn = rng.uniform(low, high, N)
    kind = rng.integers(0, 10, N)
    return np.select([kind == 0, kind == 1, kind == 2], [np.full(N, low), np.full(N, high), np.round(drawn)], drawn)


def steps(rng: np.random.Generator, longest: float) -> NDArray[np.int64]:
    return np.round(uniform(rng, 0.0, longest) / STEP).astype(np.int64)


def longitudinal(rng: np.random.Generator) -> None:
    rear, lead = uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0)
    response, gain = steps(rng, 2.0), uniform(rng, 0.0, 3.0)
    own, other = uniform(rng, 3.0, 10.0), uniform(rng, 3.0, 10.0)
    most, end = driven(Body(rear, response, gain, own), Body(lead, 0, 0.0, other), 18.0)
    found = rss_longitudinal(rear, lead, response * STEP, gain, own, other)
    np.testing.assert_allclose(found, most, atol=NEAR)
    assert (most > end + 0.1).sum() > 500, "what the paper's lemma does not see is among the draws"
    distance = uniform(rng, -5.0, 100.0)
    margin = rss_margin(distance, found)
    np.testing.assert_allclose(margin, distance - most, atol=NEAR)


def lateral(rng: np.random.Generator) -> None:
    a, b = uniform(rng, -3.0, 3.0), uniform(rng, -3.0, 3.0)
    response_a, response_b = steps(rng, 2.0), steps(rng, 2.0)
    gain, brakes = uniform(rng, 0.0, 1.5), uniform(rng, 0.5, 4.0)
    most, end = driven(Body(a, response_a, gain, brakes), Body(-b, response_b, -gain, brakes), 14.0)
    found = rss_lateral(a, b, response_a * STEP, response_b * STEP, gain, brakes, 0.1)
    np.testing.assert_allclose(found, 0.1 + most, atol=NEAR)
    assert (most > np.maximum(end, 0.0) + 0.01).sum() > 200, "what the paper's definition does not see is there too"


def deceleration_rate(rng: np.random.Generator) -> None:
    distance, rear, lead = uniform(rng, 1.0, 100.0), uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0)
    found = drac(distance, lead - rear)
    most, _ = driven(Body(rear, braking=found), Body(lead), 10.0)
    takes_longer = (rear - lead) > 10.0 * found
    np.testing.assert_allclose(most[~takes_longer], np.where(rear > lead, distance, 0.0)[~takes_longer], atol=2e-4)
    assert (most <= distance + 2e-4).all()
    assert ((found > 0.0) == (rear > lead)).all()


def times(rng: np.random.Generator) -> None:
    """Time to collision and headway: no contact a step before, contact a step after."""
    distance, rear, lead = uniform(rng, 0.0, 100.0), uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0)
    for found, other in ((ttc(distance, lead - rear), lead), (thw(distance, rear), 0.0 * lead)):
        last = 5.0
        touched = np.where(distance <= 0.0, 0.0, np.inf)
        gained = np.zeros(N)
        for k in range(round(last / STEP)):
            gained += STEP * (rear - other)
            np.minimum(touched, np.where(gained >= distance, (k + 1) * STEP, np.inf), out=touched)
        soon = found < last - STEP
        assert 0.2 < soon.mean() < 0.9
        np.testing.assert_allclose(touched[soon], found[soon], atol=1.001 * STEP)
        assert (touched[found > last + STEP] == np.inf).all()
    assert (ttc(-distance, lead - rear) == 0.0).all()
    assert (thw(np.inf, rear) == np.inf).all()


def encroachment(rng: np.random.Generator) -> None:
    """Two vehicles cross an area; each is there while any part of it is. One in ten never comes, one in ten stays."""
    moments: list[Numbers] = []
    entered, left = np.full((2, N), np.inf), np.full((2, N), -np.inf)
    width = uniform(rng, 1.0, 5.0)
    for i in range(2):
        before, speed, length = uniform(rng, 0.0, 20.0), uniform(rng, 5.0, 30.0), uniform(rng, 2.0, 10.0)
        comes, stays = rng.random(N) > 0.1, rng.random(N) < 0.1
        moments.append(np.where(comes, before / speed, np.inf))
        moments.append(np.where(comes & ~stays, (before + width + length) / speed, np.inf))
        for k in range(7_500):
            front = k * STEP * speed - before
            inside = comes & (front >= 0.0) & (stays | (front - length <= width))
            np.copyto(entered[i], k * STEP, where=inside & (left[i] < 0.0))
            np.copyto(left[i], k * STEP, where=inside)
    found = pet(*moments)
    second, met = entered.max(0), np.isfinite(entered).all(0)
    of_first = np.where(entered[0] <= entered[1], left[0], left[1])
    np.testing.assert_allclose(found[met], np.maximum(0.0, second - of_first)[met], atol=2.001 * STEP)
    assert (found[~met] == np.inf).all()
    assert ((found == 0.0).mean() > 0.1) & (((found > 0.0) & met).mean() > 0.1)


def corners(length: Any, width: Any, heading: Numbers) -> Numbers:
    """Corners of boxes about their centres, (4, N, 2)."""
    along, across = np.stack([np.cos(heading), np.sin(heading)], -1), np.stack([-np.sin(heading), np.cos(heading)], -1)
    half = [0.5 * np.broadcast_to(size, heading.shape)[:, None] for size in (length, width)]
    return np.stack([i * half[0] * along + j * half[1] * across for i in (-1, 1) for j in (-1, 1)])


def bumpers(rng: np.random.Generator) -> None:
    x, other, length = uniform(rng, -50.0, 50.0), uniform(rng, -50.0, 50.0), uniform(rng, 1.0, 20.0)
    straight = np.zeros(N)
    front = (x + corners(5.0, 2.0, straight)[:, :, 0]).max(0)
    rear = (other + corners(length, 2.5, straight)[:, :, 0]).min(0)
    np.testing.assert_allclose(bbd(x, other, 5.0, length), rear - front, atol=1e-12)
    turned = [corners(5.0, 2.0, rng.uniform(-np.pi / 4, np.pi / 4, N))[:, :, 0] for _ in range(2)]
    wrong = bbd(x, other, 5.0, 5.0) - ((other + turned[1]).min(0) - (x + turned[0]).max(0))
    assert 0.3 < np.abs(wrong).max() <= 2.0 * 0.2


def touch(offset: Numbers, a: Numbers, b: Numbers) -> NDArray[np.bool_]:
    """Say which boxes overlap: no half plane holds all differences of their corners."""
    difference = (offset + b[:, None] - a[None]).reshape(16, -1, 2)
    angle = np.sort(np.arctan2(difference[..., 1], difference[..., 0]), axis=0)
    gaps = np.diff(np.concatenate([angle, angle[:1] + 2.0 * np.pi]), axis=0)
    return np.asarray(gaps.max(0) < np.pi)


def boxes(rng: np.random.Generator) -> None:
    """First contact in the plane: none at 100 moments before, one right after; else none within 10 s."""
    offset, velocity = rng.uniform(-25.0, 25.0, (N, 2)), rng.uniform(-10.0, 10.0, (N, 2))
    velocity[rng.random(N) < 0.05] = 0.0
    a, b = (np.where(rng.random(N) < 0.3, 0.0, rng.uniform(-np.pi, np.pi, N)) for _ in range(2))
    found = contact_time(offset, velocity, a, b, (5.0, 12.0), (2.0, 2.5))
    shapes = corners(5.0, 2.0, a), corners(12.0, 2.5, b)
    touches = np.isfinite(found)
    assert 0.1 < touches.mean() < 0.9
    assert touch(offset, *shapes)[found == 0.0].all()
    for share in np.linspace(0.0, 1.0, 100, endpoint=False):
        until = np.where(touches, found, 10.0)
        early = until * share < found - 1e-9
        assert not touch(offset + velocity * (until * share)[:, None], *shapes)[early].any()
    reached = touch(offset + velocity * np.where(touches, found + STEP, 0.0)[:, None], *shapes)
    # Corners that only graze each other are in contact for less than a step.
    assert reached[touches].mean() > 0.995


def impact(rng: np.random.Generator) -> None:
    """Small impulses across the faces press the two together until they no longer close in, and part them again.

    Poisson: parting gives `restitution` times the impulse of closing in. Coulomb: each impulse across brings at most
    `friction` times as much along, against the sliding.
    """
    closing, sliding = uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0)
    own, other = uniform(rng, 500.0, 4e4), uniform(rng, 500.0, 4e4)
    bounce, grip = uniform(rng, 0.0, 1.0), uniform(rng, 0.0, 1.5)
    found = delta_v(closing, sliding, own, other, bounce, grip)
    per_impulse = 1.0 / own + 1.0 / other
    n = 500
    piece = closing / per_impulse / n
    across, along, slides = np.zeros(N), np.zeros(N), sliding.copy()
    for k in range(2 * n):
        now = piece if k < n else bounce * piece
        pull = np.minimum(grip * now, slides / per_impulse)
        across, along, slides = across + now / own, along + pull / own, slides - pull * per_impulse
    np.testing.assert_allclose(found, (across, along), rtol=1e-9, atol=1e-9)


def modes(rng: np.random.Generator) -> None:
    """Frontal, near side, rear, far side: the one of four directions that is least away, on a full turn of the head."""
    direction = rng.uniform(-20.0, 20.0, N)
    force = np.stack([np.cos(direction), np.sin(direction)])
    axes = {"frontal": (1, 0), "near side": (0, 1), "far side": (0, -1), "rear": (-1, 0)}
    nearest = np.argmax([np.array(axes[name]) @ force for name in CRASH_MODES], axis=0)
    assert (crash_mode(direction) == nearest).all()


def needed_braking(rng: np.random.Generator) -> None:
    """The driver's braking: the least at which it does not touch a lead that brakes, unless a limit says otherwise."""
    speed, lead, gap = uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0), uniform(rng, 0.5, 60.0)
    least, braked = uniform(rng, 0.5, 8.0), uniform(rng, 2.0, 12.0)
    assumed = [RssNumbers(0.3, 2.0, float(a), float(b), 1.0, 1.0, 6.0) for a, b in zip(least, braked, strict=True)]
    found = np.array(
        [rss_braking(*one) for one in zip(speed.tolist(), gap.tolist(), lead.tolist(), assumed, strict=True)]
    )
    brakes = found > 0.0
    most, end = driven(Body(speed, braking=np.where(brakes, found, 8.0)), Body(lead, braking=braked), 20.0)
    assert (most <= gap + NEAR)[brakes & (found < 8.0)].all()
    exact = brakes & (found < 8.0) & (found > least) & (speed < 20.0 * found)
    np.testing.assert_allclose(most[exact], gap[exact], atol=NEAR)
    assert (exact & (most > end + 0.1)).sum() > 50
    needed = rss_longitudinal(speed, lead, 0.3, 2.0, least, braked)
    assert (brakes == (gap < needed)).all()


def demanded(driver: str, speed: Numbers, lead: Numbers, gap: Numbers, acceleration: Any = 0.0) -> Numbers:
    each = np.broadcast_arrays(speed, np.broadcast_to(acceleration, N), gap, lead)
    return np.array([
        braking_demanded(CAREFUL[driver], v, a, Threat(g, g + 10.0, 0.0, 0.0, w))
        for v, a, g, w in zip(*(one.tolist() for one in each), strict=True)
    ])  # fmt: skip


def careful(rng: np.random.Generator) -> None:
    """Where three reference drivers begin to see danger, against a vehicle that keeps its speed or brakes.

    `cc-human`: contact within 2 s at constant speeds (UN R157, Annex 4, Appendix 3). `reg157`: one that reacts within
    0.35 s and a step and brakes with 6 m/s2 would touch (5.2.5.2). `rss-brake`: definition 1 of RSS; 0.75 s, 3, 6 and
    6 m/s2.
    """
    speed, lead = uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0)
    worst = {
        "cc-human": driven(Body(speed), Body(lead), 2.0),
        "reg157": driven(Body(speed, 450, 0.0, 6.0), Body(lead), 8.0),
        "rss-brake": driven(Body(speed, 750, 3.0, 6.0), Body(lead, braking=6.0), 9.0),
    }
    for driver, (most, _) in worst.items():
        assert (demanded(driver, speed, lead, most - NEAR) > 0.0)[most > NEAR].all(), driver
        assert (demanded(driver, speed, lead, most + NEAR) == 0.0).all(), driver


def fuzzy(rng: np.random.Generator) -> None:
    """`fsm` (Mattas et al. 2020): the critical measure, against a vehicle that keeps its speed, and the proactive one.

    Each is 0 where braking with 4 m/s2 after 0.75 s is enough, and 1 where 6 m/s2 are not. The proactive one looks at
    the end, when both stand, the one ahead after 7 m/s2, and keeps 2 m.
    """
    speed, lead, gap = uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 40.0), uniform(rng, 0.0, 100.0)
    acceleration = uniform(rng, -4.0, 2.0)

    def membership(value: Numbers, safe: Numbers, unsafe: Numbers) -> Numbers:
        return np.clip((safe - value) / np.maximum(safe - unsafe, 1e-9), 0.0, 1.0)

    least, hard = (driven(Body(speed, 750, acceleration, b), Body(lead), 13.0)[0] for b in (4.0, 6.0))
    critical = np.where(speed > lead, membership(gap, least, hard), 0.0)
    soft, firm = (driven(Body(speed, 750, 0.0, b), Body(lead, braking=7.0), 11.0)[1] for b in (4.0, 6.0))
    proactive = membership(gap - 2.0, soft + 2.0, firm)
    expected = np.where(critical > 0.0, 4.0 + 2.0 * critical, 4.0 * proactive)
    clear = (np.abs(gap - least) > 2.0 * NEAR) & (np.abs(gap - hard) > 2.0 * NEAR)
    found = demanded("fsm", speed, lead, gap, acceleration)
    np.testing.assert_allclose(found[clear], expected[clear], atol=1e-2)
    assert clear.mean() > 0.9


DRIVEN: dict[str, tuple[Callable[[np.random.Generator], None], set[str]]] = {
    "RSS, along": (longitudinal, {"rss_longitudinal", "rss_margin"}),
    "RSS, across": (lateral, {"rss_lateral"}),
    "RSS, braking": (needed_braking, {"rss_braking"}),
    "DRAC": (deceleration_rate, {"drac"}),
    "TTC and headway": (times, {"ttc", "thw"}),
    "PET": (encroachment, {"pet"}),
    "BBD": (bumpers, {"bbd"}),
    "TTC in the plane": (boxes, {"contact_time"}),
    "delta-v": (impact, {"delta_v"}),
    "crash mode": (modes, {"crash_mode"}),
    "reference drivers": (careful, {"braking_demanded"}),
    "fsm": (fuzzy, {"braking_demanded"}),
}
"""What is driven out -> the check, and the functions that it holds."""


@pytest.mark.full
@pytest.mark.parametrize("name", DRIVEN)
def test_it_holds_when_driven_out(name: str, seed: int) -> None:
    DRIVEN[name][0](np.random.default_rng(seed))


def test_no_measure_is_left_out() -> None:
    # A published curve is no motion: test_impact.py. The distance of the kernel has the bits of that of arrays:
    # test_safe_distances.py.
    held = set().union(*(names for _, names in DRIVEN.values()))
    public = set(metrics.__all__) | {name for name in rss_drivers.__all__ if name.startswith("rss")}
    assert public - held == {"injury_probability", "rss_distance"}
    assert held - public == {"contact_time", "braking_demanded"}
