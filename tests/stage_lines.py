"""What long commands say on standard error where there is no terminal: a line for each stage that has ended."""

from __future__ import annotations

import re

LINE = re.compile(r"^stage (\d+)(?: of (\d+))?: ([^,\n]+), (\d+(?:\.\d)?) s(?:; next: (.+))?\n", flags=re.MULTILINE)

_HOW_FAR = re.compile(r"^stage .* after .*\n", flags=re.MULTILINE)
"""What a stage that lasts says every minute."""


def without_stages(err: str) -> str:
    """Standard error without these lines."""
    return _HOW_FAR.sub("", LINE.sub("", err))
