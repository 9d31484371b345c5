"""Connections of the explorer: how many there may be, and how long one may be without a whole request."""

from __future__ import annotations

import asyncio
import sys
import warnings
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["BACKLOG", "WAIT_S", "Connection"]

BACKLOG = 16
"""Connections that the system keeps until they are taken, all at once."""
WAIT_S = 10
"""Longest time for a request, and between two: a connection that takes longer is closed [s]."""
_MOST = 128
"""Most connections; fewer where the system allows few open files."""


def _most() -> int:
    """Give the most connections that leave three quarters of this process's files for other things."""
    if sys.platform == "win32":
        return _MOST
    import resource

    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _MOST if allowed == resource.RLIM_INFINITY else max(1, min(_MOST, allowed // 4))


class Connection(H11Protocol):
    """One connection. Where there are too many, the one closes that has waited longest for a request's end."""

    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Begin to wait for a request, and make room for it."""
        super().connection_made(transport)
        self._wait()
        if len(self.connections) > _most():
            warnings.warn("There are too many connections; the ones that ask for nothing are closed.", stacklevel=1)
            others = [one for one in self.connections if isinstance(one, Connection) and one is not self]
            oldest = min((one for one in others if one._waiting), key=lambda one: one._until, default=self)
            oldest._close()

    def data_received(self, data: bytes) -> None:
        """Take a part of a request."""
        super().data_received(data)
        self._wait()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._end_wait()
        super().connection_lost(exc)

    @property
    def _until(self) -> float:
        return self._waiting.when() if self._waiting else 0.0

    def _wait(self) -> None:
        if self.conn.their_state not in (h11.IDLE, h11.SEND_BODY):
            self._end_wait()
        elif self._waiting is None and not self.transport.is_closing():
            self._waiting = self.loop.call_later(WAIT_S, self._close)

    def _end_wait(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _close(self) -> None:
        self._end_wait()
        self.connections.discard(self)
        self.transport.abort()
