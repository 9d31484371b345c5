"""A server of the explorer, and what a page in the browser complained of."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Opener = Callable[..., Any]


@dataclass
class Server:
    """A server of the explorer; `stop` ends it as Ctrl-C does."""

    process: subprocess.Popen[str]
    url: str

    def stop(self) -> None:
        self.process.send_signal(2)
        self.process.wait(20)
        assert self.process.stdout is not None
        self.process.stdout.close()


def serve(place: Path) -> Server:
    words = [sys.executable, "-m", "cornerforge", "serve", str(place), "--port", "0", "--json"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONUNBUFFERED": "1"})
    assert process.stdout is not None
    return Server(process, json.loads(process.stdout.readline())["url"])


@dataclass
class Complaints:
    """What a page wrote to its console as warning or error, or threw, and what it asked of other machines."""

    lines: list[str] = field(default_factory=list)

    def listen(self, page: Any, home: str) -> None:
        """Note what a page says from now on; `home` is where it may ask."""

        def said(one: Any) -> None:
            if one.type in ("error", "warning"):
                self.lines.append(one.text)

        def asked(one: Any) -> None:
            if one.url.startswith(("http", "ws")) and not one.url.startswith(home):
                self.lines.append(f"asks {one.url}")

        page.on("console", said)
        page.on("pageerror", lambda error: self.lines.append(str(error)))
        page.on("request", asked)


def until(page: Any, condition: str) -> None:
    """Wait, at most 20 s, until a condition in JavaScript holds; Playwright itself needs `eval`, which is forbidden."""
    for _ in range(400):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"never true: {condition}")
