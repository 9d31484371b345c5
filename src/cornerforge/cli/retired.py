"""Options that are gone, each with what to use instead."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["EFFORTS_ONCE", "RETIRED", "retired_among"]

RETIRED = {
    "av-sandbox": "start cornerforge itself in bubblewrap or a container; docs/foreign-avs.md says how",
    "sarif": "write JUnit XML with --junit FILE, or take the object of --json",
}
"""By long name without dashes: what to use instead."""
EFFORTS_ONCE = ("quick", "standard", "paper", "full")
"""Words that `--budget` took for an effort; it names a likelihood in nats."""


def retired_among(words: Sequence[str]) -> str | None:
    """Say what to use instead of the first word of a command line that is gone; None: none is.

    >>> retired_among(["--tests", "5", "--sarif=a.sarif"])
    '--sarif is gone since 0.2: write JUnit XML with --junit FILE, or take the object of --json.'
    >>> retired_among(["--budget", "quick"])
    '--budget names a likelihood in nats; the amount of work is --effort quick.'
    """
    for place, word in enumerate(words):
        option, equals, value = word.partition("=")
        if option.startswith("--") and option[2:] in RETIRED:
            return f"{option} is gone since 0.2: {RETIRED[option[2:]]}."
        told = value if equals else next(iter(words[place + 1 : place + 2]), "")
        if option == "--budget" and told in EFFORTS_ONCE:
            return f"--budget names a likelihood in nats; the amount of work is --effort {told}."
    return None
