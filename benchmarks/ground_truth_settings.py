"""What the ground truth is counted for: a fixed list of settings. A variation changes one number of the model."""

from __future__ import annotations

from dataclasses import dataclass

from cornerforge.ext.calibrate.variations import Variation

__all__ = ["SETTINGS", "Setting"]


@dataclass(frozen=True)
class Setting:
    """One count.

    Attributes:
        name: Of the entry in the ledger.
        av, lanes: What drives where.
        tests: How many are wanted.
        variation: None for the shipped model.
    """

    name: str
    av: str
    lanes: int
    tests: int
    variation: Variation | None = None


_TESTS = {("idm-mobil", 3): 300_000_000}
_BASE = tuple(
    Setting(f"{av}-{lanes}-lanes", av, lanes, _TESTS.get((av, lanes), 100_000_000))
    for av in ("idm-mobil", "idm-mobil-d2rl", "idm-mobil-blind")
    for lanes in (3, 2)
)
_SENSITIVITY_TESTS = 10_000_000
_VARIED: tuple[tuple[str, str, tuple[float, ...]], ...] = (
    ("model", "overlook", (0.0, 0.5, 2.0, 10.0)),
    ("model", "overlook_conflict", (0.0, 0.5, 2.0, 10.0)),
    ("memory", "away", (0.0, 0.5, 2.0)),
    ("initial", "signal_share", (0.0, 1.5)),
    ("initial", "desire_share", (0.5, 1.5)),
    ("initial", "noise_spread", (0.0, 2.0)),
    ("initial", "vigilance_sigma", (0.0, 1.5)),
    ("fit", "prior_strength", (50.0, 1000.0)),
    ("safe", "response", (0.75, 1.5)),
    ("law", "spread", (0.8, 1.25)),
    ("law", "degrees", (0.6, 3.0)),
    ("lane_change", "rate", (0.5, 2.0)),
    ("lane_change", "rear_reaction", (0.5, 1.5)),
)
"""Part, field, factors (for "fit" values). The shipped model, factor 1 and strength 200, is the base setting."""


def _varied() -> tuple[Setting, ...]:
    variations = [Variation(part, name, factor) for part, name, factors in _VARIED for factor in factors]
    return tuple(
        Setting(f"{v.part}-{v.field}-{v.factor:g}".replace("_", "-"), "idm-mobil", 3, _SENSITIVITY_TESTS, v)
        for v in variations
    )


SETTINGS: tuple[Setting, ...] = (*_BASE, *_varied())
"""In the order of their importance."""
