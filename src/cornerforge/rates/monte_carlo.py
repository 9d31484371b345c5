"""Natural crash rates by brute force: what a resumable count holds, and when it is enough."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from cornerforge.errors import FileFormatError
from cornerforge.rates.intervals import binomial_interval

__all__ = ["MonteCarlo", "relative_half_width"]


def relative_half_width(low: float, high: float, estimate: float) -> float | None:
    """Half the interval's width over the estimate; None where the estimate is 0.

    >>> relative_half_width(0.5, 1.5, 1.0)
    0.5
    """
    return None if estimate == 0.0 else 0.5 * (high - low) / estimate


@dataclass(frozen=True)
class MonteCarlo:
    """Counts of a brute-force run so far, over tests 0 .. `tests` - 1 of its seed.

    Attributes:
        tests, av_crashes, bv_crashes, world_steps: Counts; `bv_crashes` counts contacts between two BVs.
        millimetres: Distance that the AV drove [mm].
        seconds: Wall-clock spent, over all sessions [s].
        crashed: Numbers of the tests in which the AV crashed, rising.
        digest: Chain of SHA-256: each block's digest hashed onto the chain before it; the same for any resume.
    """

    tests: int = 0
    av_crashes: int = 0
    bv_crashes: int = 0
    world_steps: int = 0
    millimetres: int = 0
    seconds: float = 0.0
    crashed: tuple[int, ...] = field(default=())
    digest: str = ""

    def plus(
        self,
        *,
        tests: int,
        bv_crashes: int,
        world_steps: int,
        millimetres: int,
        seconds: float,
        crashed: tuple[int, ...],
        digest: str,
    ) -> MonteCarlo:
        """The counts after one more block of tests."""
        chain = hashlib.sha256((self.digest + digest).encode()).hexdigest()
        return replace(
            self,
            tests=self.tests + tests,
            av_crashes=self.av_crashes + len(crashed),
            bv_crashes=self.bv_crashes + bv_crashes,
            world_steps=self.world_steps + world_steps,
            millimetres=self.millimetres + millimetres,
            seconds=self.seconds + seconds,
            crashed=self.crashed + crashed,
            digest=chain,
        )

    def is_enough(self, target: float) -> bool:
        """Is the relative half-width of the exact 95 % interval at most `target`?"""
        if self.av_crashes == 0:
            return False
        low, high = binomial_interval(self.av_crashes, self.tests)
        width = relative_half_width(low, high, self.av_crashes / self.tests)
        return width is not None and width <= target

    def to_json(self) -> dict[str, Any]:
        """All counts, JSON-compatible."""
        return {**asdict(self), "crashed": list(self.crashed)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> MonteCarlo:
        """The inverse of `to_json`.

        Raises:
            FileFormatError: Keys are missing or unknown, or the counts contradict each other.
        """
        try:
            counts = cls(**{**content, "crashed": tuple(content["crashed"])})
        except (TypeError, KeyError) as error:
            raise FileFormatError(f"These are not the counts of a rate estimate ({error}).") from error
        if counts.av_crashes != len(counts.crashed) or counts.tests < counts.av_crashes:
            raise FileFormatError("The counts of this rate estimate contradict each other.")
        return counts
