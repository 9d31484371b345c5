"""Rooms for long work: one job at a time runs in each, few wait, and all can be stopped."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from cornerforge.errors import CornerForgeError

__all__ = ["MOST", "Room", "UnavailableError"]

MOST = 8
"""Jobs in one room, the running one included. One page asks at most six questions at once; three rooms leave 16 of the
server's 40 threads for quick answers."""


class UnavailableError(CornerForgeError):
    """The room is full, or the server ends."""


class Room:
    """Where one kind of long work is done, one after the other.

    Args:
        what: The work, for the message that the room is full.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._changed = threading.Condition()
        self._inside, self._works, self._closed = 0, False, False

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Wait for one's turn; it is the other's when this is left.

        Raises:
            UnavailableError: The room is full, or was closed.
        """
        with self._changed:
            self.check()
            if self._inside >= MOST:
                raise UnavailableError(f"Too many {self._what} are asked for at once; try again in a moment.")
            self._inside += 1
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or not self._works)
                self.check()
                self._works = True
            try:
                yield
            finally:
                with self._changed:
                    self._works = False
                    self._changed.notify()
        finally:
            with self._changed:
                self._inside -= 1

    def check(self) -> None:
        """Go on, unless the room was closed; long work asks this now and then.

        Raises:
            UnavailableError: It was closed.
        """
        if self._closed:
            raise UnavailableError("The server is ending.")

    def close(self) -> None:
        """Admit no request any more, send away the waiting ones, and tell a running one when it asks."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
