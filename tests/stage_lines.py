"""What long commands say on standard error where there is no terminal: a line for each stage that has ended."""

from __future__ import annotations

import re

LINE = re.compile(r"^stage (\d+)(?: of (\d+))?: ([^,\n]+), (\d+(?:\.\d)?) s\n", flags=re.MULTILINE)


def without_stages(err: str) -> str:
    """Standard error without these lines."""
    return LINE.sub("", err)
