"""Long work is bounded, and ends when the server does."""

from __future__ import annotations

import json
import signal
import threading
import time
from pathlib import Path
from urllib.error import HTTPError

import pytest
from explorer.conftest import Running, asked, get, sent, started, stopped

from cornerforge.ext.explorer.room import MOST, Room, UnavailableError

pytestmark = pytest.mark.full

ENDLESS = "(select sum(x.range * y.range) from range(10000000) x, range(10000000) y) > 0"


def in_background(*asks: tuple[Running, str, str]) -> list[threading.Thread]:
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


def test_many_films_leave_the_server_free(place: Path) -> None:
    """It says no to most, and answers all else meanwhile."""
    running = started(place, "--port", 0)
    refused: list[str] = []

    def take() -> None:
        try:
            get(running, "api/case/adversary/3:0/download/gif")
        except HTTPError as error:
            refused.append(f"{error.code} {json.load(error)['error']}")
        except OSError:
            pass

    asking = [threading.Thread(target=take) for _ in range(45)]
    for thread in asking:
        thread.start()
    begin = time.monotonic()
    while len(refused) < 45 - MOST:
        assert time.monotonic() < begin + 20.0
        time.sleep(0.1)
    assert len(refused) < 45
    assert set(refused) == {"503 Too many videos are asked for at once; try again in a moment."}
    begin = time.monotonic()
    assert asked(running, "api/about")["name"] == "run"
    assert time.monotonic() - begin < 5.0
    assert stopped(running) == (0, "")
    for thread in asking:
        thread.join()
    assert refused[-1] == "503 The server is ending."


def test_a_room_is_for_one_at_a_time() -> None:
    room, inside, most = Room("tests"), 0, 0

    def work() -> None:
        nonlocal inside, most
        with room.turn():
            inside += 1
            most = max(most, inside)
            time.sleep(0.01)
            inside -= 1

    threads = [threading.Thread(target=work) for _ in range(MOST)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (most, inside) == (1, 0)
    room.close()
    with pytest.raises(UnavailableError, match="ending"), room.turn():
        pass
