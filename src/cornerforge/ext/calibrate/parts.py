"""Source of each part of a fitted model: the user's files, or the prior, and why."""

from __future__ import annotations

import math

import numpy as np

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.traits import FEWEST_DRIVERS as FEWEST_LONG
from cornerforge.ext.calibrate.traits import SHORTEST, NoiseSpread
from cornerforge.ndd.grids import SPEED_GRID
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.model import GAPS
from cornerforge.results.naturalistic import FittedLaneChanges, FittedPart

__all__ = ["FEWEST_DRIVERS", "FITTED", "IN_PART", "PRIOR", "parts_of"]

FITTED, IN_PART, PRIOR = "fitted", "fitted in part", "prior"
"""Sources of a part. In part: the files and the prior together."""
FEWEST_DRIVERS = 20
"""Least number of drivers; with fewer the part is reported as too few."""


def parts_of(
    training: Decisions,
    *,
    too_few: str,
    fast: int,
    counted: int,
    counted_free: int,
    strength: float,
    changes: FittedLaneChanges,
    noise: NoiseSpread,
) -> tuple[FittedPart, ...]:
    """Say of every part of a model where it comes from.

    Args:
        training: The decisions that were fitted on, at least one.
        too_few: Why the car-following law is the shipped one; empty if it was fitted.
        fast: Decisions at motorway speeds to which the noise there was fitted; 0: it is the prior.
        counted: Decisions counted into the following table.
        counted_free: The same for the free-flow table.
        strength: Weight of the prior, in pseudo-decisions per state.
        changes: Where the lane changes come from.
        noise: How far drivers differ in their noise level.
    """
    following = np.isfinite(training.gap)
    followers = int(np.unique(training.vehicle[following]).size)
    law = (
        f"Maximum likelihood over {int(following.sum()):,} decisions of {followers:,} drivers, at all speeds."
        + (f" {followers} are too few to stand for all." if followers < FEWEST_DRIVERS else "")
    )  # fmt: skip
    calmed = f"fitted to {fast:,} decisions." if fast else "a share of the law's, as free driving is calmer."
    data = f"{changes.changes:,} changes in {changes.seconds:,} seconds at risk; how"
    wish, gaps = (
        (IN_PART, f"{data} the wish depends on the own leader's speed is the prior."),
        (IN_PART, f"{data} gaps depend on closing speeds is the prior."),
    )
    if not changes.fitted:
        wish = gaps = PRIOR, f"{changes.why[:1].upper()}{changes.why[1:]}."
    rows = (
        ("car-following law", PRIOR if too_few else FITTED, too_few or law),
        (
            "response near the leader", IN_PART if fast else PRIOR,
            "Recorded drivers are far from danger; its constants keep simulated traffic at the published facts. From "
            "24 m/s on it also replaces the law's pull to a time gap, even where these files reach; its noise there is "
            + calmed,
        ),
        ("following table", *_counts("the car-following law with that response", counted, strength)),
        ("free driving", *_counts("published facts (IVBSS)", counted_free, strength)),
        (
            "memory", PRIOR,
            "Smoothing, without which no speed can be taken from positions, makes accelerations of one driver more "
            "alike from second to second than they were.",
        ),
        ("noise level", *_noise(noise)),
        (
            "desired speeds", PRIOR,
            "Most tracks are too short to tell what speed a driver wants from how fast it may go just now.",
        ),
        ("lane changes", *wish),
        ("gap acceptance", *gaps),
        ("turning back", PRIOR, "Who begins a change and turns back cannot be told from who never began."),
        (
            "duration of lane changes", PRIOR,
            "Published (mean 5 to 6.3 s, from 0.05 m off the old centre to 0.05 m off the new one). "
            "When a change begins and ends is a matter of thresholds on positions across the "
            "road, which few files have with that precision.",
        ),
        ("traffic at the start", PRIOR, _start(training)),
        ("indicators", PRIOR, "Published: half of all lane changes are announced. No file tells them."),
        (
            "looking away, overlooking", PRIOR,
            "Set so that simulated drivers crash no more often than police reports say: trajectories do not tell what "
            "a driver saw, nor how drivers differ in it. The crash rate depends on it.",
        ),
    )  # fmt: skip
    return tuple(FittedPart(name=name, source=source, why=why) for name, source, why in rows)


def _counts(prior: str, counted: int, strength: float) -> tuple[str, str]:
    """Say how many decisions a table counts; the grid begins at 19.5 m/s."""
    if counted == 0:
        return PRIOR, f"No decision from 19.5 m/s on; all of it is {prior}."
    return IN_PART, f"{counted:,} decisions from 19.5 m/s on, and {prior}, worth {strength:g} decisions in each state."


def _noise(noise: NoiseSpread) -> tuple[str, str]:
    followers = f"{noise.drivers:,} drivers were seen behind a leader for {SHORTEST} s and more"
    if not noise.fitted:
        return PRIOR, f"{followers}, and at least {FEWEST_LONG} are needed."
    low, high = noise.interval95
    return FITTED, (
        f"{followers}. One standard deviation between them is a factor of {math.exp(noise.spread):.2f} "
        f"({math.exp(low):.2f} to {math.exp(high):.2f}) of the odds of an acceleration in the outer quarters."
    )


def _start(training: Decisions) -> str:
    """Compare the files' speeds and time gaps with the start's, which they do not change."""
    start = InitialState()
    fast = training.where(training.speed >= SPEED_GRID.lower)
    why = (
        "Published distributions (IVBSS). The laws that keep them for a minute, free driving and the pull towards a "
        "time gap, are prior too, so traffic that began otherwise would drift back."
    )
    if not fast.size:
        return f"{why} These files have no decision from {SPEED_GRID.lower:g} m/s on."
    near = fast.gap <= GAPS[-1]
    middle = float(np.median(fast.gap[near] / fast.speed[near])) if near.any() else float("nan")
    gaps = f", median time gap {middle:.2f} s (start {start.time_gap_shift + start.time_gap_median:.2f} s)"
    return (
        f"{why} These files, from {SPEED_GRID.lower:g} m/s on: mean speed {fast.speed.mean():.1f} m/s (start "
        f"{start.speed_mean:.1f} m/s), standard deviation {fast.speed.std():.1f} m/s (start "
        f"{float(np.hypot(start.stream_sd, start.speed_sd)):.1f} m/s){gaps if near.any() else ''}."
    )
