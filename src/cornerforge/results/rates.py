"""Parts of several results: a crash rate with its intervals and tests."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result

__all__ = ["Counted", "Interval", "Rate", "Yield"]

Interval = tuple[float, float]
"""Low and high of a 95 % interval."""


class Counted(Result):
    """How often the AV crashes in a test, with what it is counted over."""

    tests: Annotated[
        Whole, meant("Tests (AV drives of 400 m) that count; those that an AV from outside spoiled do not.")
    ]
    crashes_per_test: Annotated[Share, meant("Share of the tests in which the AV crashed, 0 to 1.", "per test")]
    interval95: Annotated[
        Interval,
        meant("Exact interval of `crashes_per_test` (Clopper-Pearson); low is 0 with no crash.", "per test"),
    ]

    @property
    def is_bound(self) -> bool:
        """True if no crash was seen: the rate is known only to lie below the upper end of its interval."""
        return self.crashes_per_test == 0.0

    @property
    def bound(self) -> float:
        """Upper end of the 95 % interval, which is all that is known when no crash was seen."""
        return self.interval95[1]

    @property
    def digits(self) -> int:
        """Number of significant digits to show: the third is noise unless there are hundreds of crashes."""
        return 3 if self.crashes_per_test * self.tests >= 100.0 else 2


class Rate(Counted):
    """How often the AV crashes, per test and per mile, with what it is counted over."""

    crashes_per_mile: Annotated[float | None, meant("Crashes per mile of the AV; null: it drove none.", "per mile")]
    interval95_per_mile: Annotated[
        Interval | None, meant("`interval95` per mile at the miles driven; null: it drove none.", "per mile")
    ]
    miles: Annotated[float, meant("Distance that the AV drove in all tests.", "miles")]
    crashes_per_million_entering: Annotated[
        float | None,
        meant(
            "At a site: crashes of the AV per million times that it enters, which it does once a test; so a test is "
            "one crossing of the site. Missing: on a road.",
            "per million",
        ),
    ] = None
    interval95_per_million_entering: Annotated[
        Interval | None, meant("`interval95` in this unit; missing: likewise.", "per million")
    ] = None
    crashes_per_vehicle_km: Annotated[
        float | None,
        meant(
            "At a site: crashes per kilometre that the AV drove on its approaches, over it and behind; missing: on a "
            "road, or it drove none.",
            "per km",
        ),
    ] = None
    interval95_per_vehicle_km: Annotated[
        Interval | None, meant("`interval95` in this unit; missing: likewise.", "per km")
    ] = None


class Yield(Rate):
    """How often an adversary makes the AV crash, how often so that braking helps, and who strikes."""

    avoidable_per_test: Annotated[
        Share | None,
        meant(
            "Share of the tests with a crash that braking in time would have avoided, 0 to 1; null: at a site, where "
            "it is not judged.",
            "per test",
        ),
    ]
    avoidable_interval95: Annotated[
        Interval | None,
        meant("Exact interval of `avoidable_per_test`; low is 0 with none; null: likewise.", "per test"),
    ]
    striking_share: Annotated[
        Share | None, meant("Share of the crashes in which the AV struck, 0 to 1; null: no crash.")
    ]
    striking_interval95: Annotated[Interval | None, meant("Exact interval of `striking_share`; null: no crash.")]
    paid_per_test: Annotated[
        Share | None,
        meant(
            "Share of the tests with a crash that the reward pays for, 0 to 1; missing: the reward is not judged "
            "by cases.",
            "per test",
        ),
    ] = None
    paid_interval95: Annotated[
        Interval | None, meant("Exact interval of `paid_per_test`; missing: likewise.", "per test")
    ] = None
    strictly_paid_per_test: Annotated[
        Share | None,
        meant(
            "The same by a stricter reading, 0 to 1. preventable: the driver's braking was needed, holding the speed "
            "from the manoeuvre's begin would not have been enough; own-fault: the AV alone was at fault. Missing: "
            "likewise.",
            "per test",
        ),
    ] = None
