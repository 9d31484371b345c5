"""Opening the port and serving: loopback by default, a token otherwise."""

from __future__ import annotations

import errno
import ipaddress
import logging
import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import uvicorn

from cornerforge._checks import check_integer
from cornerforge._files import reason
from cornerforge.errors import InputError, OutputError
from cornerforge.ext.explorer.app import Guard, explorer_app, read_page
from cornerforge.ext.explorer.connections import BACKLOG, WAIT_S, Connection
from cornerforge.ext.explorer.exhibit import Exhibit

__all__ = ["PORT", "Door", "open_door", "serve_exhibit"]

PORT = 8157
"""The usual port; the next free one is taken instead where it was not asked for."""
_TRIES = 50


@dataclass(frozen=True)
class Door:
    """Where the explorer listens.

    Attributes:
        listening: The socket.
        host, port: Parts of the address.
        token: Every request needs it; None on loopback.
        usual: The port is the requested one or the usual one.
    """

    listening: socket.socket
    host: str
    port: int
    token: str | None
    usual: bool

    @property
    def url(self) -> str:
        """The whole address, with the token; this machine's name where it listens at all its addresses."""
        host = socket.gethostname() if _address_of(self.listening).is_unspecified else self.host
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self.port}/" + ("" if self.token is None else f"?token={self.token}")

    @property
    def hosts(self) -> frozenset[str] | None:
        """Allowed values of a request's Host; None: any, since a cookie is needed."""
        if self.token is not None:
            return None
        own = (f"[{name}]" if ":" in name else name for name in (self.host.lower(), str(_address_of(self.listening))))
        names = {"127.0.0.1", "localhost", "[::1]", *own}
        return frozenset({f"{name}:{self.port}" for name in names} | (names if self.port == 80 else set()))


def _address_of(listening: socket.socket) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    return ipaddress.ip_address(str(listening.getsockname()[0]))


def open_door(host: str, port: int | None) -> Door:
    """Listen.

    Args:
        host: Name or address of this machine.
        port: 0 for any free one; None for the usual one, or the next that is free.

    Raises:
        InputError: The port is out of range, or the host is not of this machine.
        OutputError: The port is taken.
    """
    first = PORT if port is None else check_integer("port", port, low=0, high=65535)
    try:
        family, kind, number, _, address = socket.getaddrinfo(
            host, first, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"{host!r} is no address of this machine ({error}); 127.0.0.1 is.") from None
    for tried in range(first, min(first + (_TRIES if port is None else 1), 65536)):
        listening = socket.socket(family, kind, number)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind((address[0], tried, *address[2:]))
            listening.listen(BACKLOG)
        except OSError as error:
            listening.close()
            if error.errno == errno.EADDRINUSE:
                continue
            raise OutputError(
                f"Cannot listen at {host}:{tried}: {reason(error)}; choose another --host or --port."
            ) from None
        token = None if _address_of(listening).is_loopback else secrets.token_urlsafe(24)
        return Door(listening, host, int(listening.getsockname()[1]), token, port is not None or tried == first)
    taken = f"Port {first} is" if port is not None else f"The ports {first} to {first + _TRIES - 1} are"
    raise OutputError(f"{taken} taken by another program; choose another with --port, 0 for any free one.")


class _Server(uvicorn.Server):
    """Ends the exhibit's long work first, so that every question has its answer before the server ends."""

    def __init__(self, config: uvicorn.Config, exhibit: Exhibit) -> None:
        super().__init__(config)
        self._exhibit = exhibit

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        # Connections are cut off here on purpose.
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL + 1)
        self._exhibit.close()
        await super().shutdown(sockets)


@contextmanager
def _ending_alike() -> Iterator[None]:
    """Let SIGTERM end the program as Ctrl-C does, by KeyboardInterrupt; in another thread than the main one, do not."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def serve_exhibit(exhibit: Exhibit, door: Door, up: Callable[[], None]) -> None:
    """Serve until Ctrl-C, or until the process is asked to end; the exhibit is closed then.

    Args:
        exhibit: What is shown.
        door: From `open_door`.
        up: Called once; from then on requests are answered.

    Raises:
        OutputError: The page was not built.
    """
    try:
        config = uvicorn.Config(
            _guarded(exhibit, door), http=Connection, ws="none", lifespan="off", loop="asyncio", interface="asgi3",
            log_config=None, access_log=False, server_header=False, date_header=False, proxy_headers=False,
            backlog=BACKLOG, timeout_keep_alive=WAIT_S, timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=32 * 1024,
        )  # fmt: skip
        logging.getLogger("uvicorn.error").setLevel(logging.ERROR)  # no line for each malformed request
        with _ending_alike(), suppress(KeyboardInterrupt):
            up()
            _Server(config, exhibit).run(sockets=[door.listening])
    finally:
        exhibit.close()
        door.listening.close()


def _guarded(exhibit: Exhibit, door: Door) -> Guard:
    page = read_page()
    if "index.html" not in page:
        raise OutputError(
            "This installation lacks the explorer's page, which is built with Node.js: run `make web` in the checkout, "
            "and install from there again. A wheel (`make wheel`) has it."
        )
    return Guard(explorer_app(exhibit, page), door.hosts, door.token, door.port)
