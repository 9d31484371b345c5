"""A few of the kills of `make kill`, within `make test-slow`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_a_few_kills_lose_and_double_nothing(seed: int) -> None:
    script = Path(__file__).with_name("killing.py")
    words = [sys.executable, str(script), "--quick", "--kills", "10", "--seed", str(seed)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-1]
    assert re.fullmatch(r"\d\d kills in \d+ s; lost, doubled, different, left over or failed: 0", last)
