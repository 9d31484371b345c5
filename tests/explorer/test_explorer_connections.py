"""Connections that ask for nothing, or never end asking, keep nobody else from the page."""

from __future__ import annotations

import resource
import socket
import time
from pathlib import Path

import pytest
from explorer.conftest import Running, get, started, stopped

from cornerforge.ext.explorer.connections import WAIT_S

pytestmark = pytest.mark.full


def half_open(running: Running, begun: bytes) -> socket.socket:
    made = socket.create_connection(("127.0.0.1", running.port), timeout=60)
    made.sendall(begun)
    return made


POST = b"POST /api/sql HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{"


@pytest.mark.parametrize("begun", [b"", b"GET / HTTP/1.1\r\n", POST], ids=["nothing", "head", "body"])
def test_300_half_open_connections_with_256_files_leave_it_serving(place: Path, begun: bytes) -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, before[1]))  # which the server inherits
    try:
        running = started(place, "--port", 0)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    begun = begun.replace(b"%d", b"%d" % running.port)
    kept = [half_open(running, begun) for _ in range(300)]
    begin = time.monotonic()
    assert b"<title>page</title>" in get(running, "")
    assert time.monotonic() - begin < WAIT_S
    status, told = stopped(running)
    assert status == 0
    warned = [line for line in told.splitlines() if not line.startswith("Compiling")]
    assert warned == ["Warning: There are too many connections; the ones that ask for nothing are closed."]
    for one in kept:
        one.close()


def test_a_request_that_does_not_end_is_ended(server: Running) -> None:
    slow = half_open(server, b"GET / HTTP/1.1\r\nHost: a\r\n")
    begin = time.monotonic()
    slow.settimeout(1.0)
    while time.monotonic() - begin < 3 * WAIT_S:
        try:
            slow.sendall(b"X: a\r\n")
            assert slow.recv(10) == b""
            break
        except TimeoutError:
            continue
        except ConnectionError:
            break
    assert WAIT_S / 2 < time.monotonic() - begin < 3 * WAIT_S
    slow.close()
