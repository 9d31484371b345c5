"""Long work is bounded, and ends when the server does."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path

import pytest
from explorer.conftest import Running, started, stopped
from explorer.test_explorer import get, sent

ENDLESS = "(select sum(x.range * y.range) from range(10000000) x, range(10000000) y) > 0"


def in_background(*asks: tuple[str, ...]) -> list[threading.Thread]:
    """Ask at the same time; answers and errors are passed over."""

    def ask(running: Running, path: str, where: str) -> None:
        try:
            if where:
                sent(running, "POST", path, {"where": where})
            else:
                get(running, path)
        except OSError:
            pass

    threads = [threading.Thread(target=ask, args=one) for one in asks]
    for thread in threads:
        thread.start()
    return threads


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_at_once_whatever_it_is_at(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: signal.Signals
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    running = started(place, "--port", 0)
    film = (running, "api/case/adversary/3:0/download/gif", "")
    asking = in_background(*[film] * 4, *[(running, "api/sql", ENDLESS)] * 4)
    end = time.monotonic() + 30.0
    while not list(tmp_path.rglob("*.gif*")):  # a film is begun
        assert time.monotonic() < end
        time.sleep(0.02)
    begin = time.monotonic()
    assert stopped(running, by) == (0, "")
    assert time.monotonic() - begin < 10.0
    for thread in asking:
        thread.join(timeout=10)
        assert not thread.is_alive()
    assert list(tmp_path.iterdir()) == []
