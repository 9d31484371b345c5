"""Ctrl-C ends the program in one line with status 130, from the first moment on."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.full

PROGRAM = "import sys; from cornerforge.__main__ import main; print(flush=True); sys.exit(main())"


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0])
def test_at_any_moment(delay: float) -> None:
    command = [sys.executable, "-c", PROGRAM, "simulate", "--tests", "1000000000"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    lines = [line for line in told.splitlines() if not line.startswith("Compiling")]
    assert (process.returncode, lines) == (130, ["cornerforge: interrupted."])
