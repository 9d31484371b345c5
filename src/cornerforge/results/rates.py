"""Parts of several results: a crash rate with its intervals and tests."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.stating import meant, share

__all__ = ["INTERVAL95", "PER_TEST", "TESTS", "Interval", "Rate", "Yield"]

Interval = tuple[float, float]
"""Low and high of a 95 % interval."""

TESTS = meant("Tests (AV drives of 400 m) that count; those that an AV from outside spoiled do not.")
PER_TEST = share("Share of the tests in which the AV crashed, 0 to 1.", "per test")
INTERVAL95 = meant("Exact interval of `crashes_per_test` (Clopper-Pearson); low is 0 with no crash.", "per test")


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How often the AV crashes, per test and per mile, with what it is counted over."""

    tests: int = field(metadata=TESTS)
    crashes_per_test: float = field(metadata=PER_TEST)
    interval95: Interval = field(metadata=INTERVAL95)
    crashes_per_mile: float | None = field(
        metadata=meant("Crashes per mile of the AV; null: it drove none.", "per mile")
    )
    interval95_per_mile: Interval | None = field(
        metadata=meant("`interval95` per mile at the miles driven; null: it drove none.", "per mile")
    )
    miles: float = field(metadata=meant("Distance that the AV drove in all tests.", "miles"))


@dataclass(frozen=True, kw_only=True)
class Yield(Rate):
    """How often an adversary makes the AV crash, how often so that braking helps, and who strikes."""

    avoidable_per_test: float = field(
        metadata=share("Share of the tests with a crash that braking in time would have avoided, 0 to 1.", "per test")
    )
    avoidable_interval95: Interval = field(
        metadata=meant("Exact interval of `avoidable_per_test`; low is 0 with none.", "per test")
    )
    striking_share: float | None = field(
        metadata=share("Share of the crashes in which the AV struck, 0 to 1; null: no crash.")
    )
    striking_interval95: Interval | None = field(metadata=meant("Exact interval of `striking_share`; null: no crash."))
    paid_per_test: float | None = field(
        default=None,
        metadata=share(
            "Share of the tests with a crash that the reward pays for, 0 to 1; missing: the reward is not judged "
            "by cases.",
            "per test",
        ),
    )
    paid_interval95: Interval | None = field(
        default=None, metadata=meant("Exact interval of `paid_per_test`; missing: likewise.", "per test")
    )
    strictly_paid_per_test: float | None = field(
        default=None,
        metadata=share(
            "The same by a stricter reading, 0 to 1. preventable: the driver's braking was needed, holding the speed "
            "from the manoeuvre's begin would not have been enough; own-fault: the AV alone was at fault. Missing: "
            "likewise.",
            "per test",
        ),
    )
