"""Reading a page of the report: attributes, scripts and text; and running it in a browser."""

from __future__ import annotations

import json
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

__all__ = ["Page", "browse", "needs_browser"]

CHROMIUM = "chromium"
needs_browser = pytest.mark.browser


def browse(url: str, profile: Path) -> str:
    """The page's document after its scripts ran; a complaint of the browser is a failure."""
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    flags += ["--disable-component-update", "--disable-sync", "--enable-logging=stderr", "--virtual-time-budget=8000"]
    command = [str(CHROMIUM), *flags, f"--user-data-dir={profile}", "--dump-dom", url]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    # A blocked request, a script error or a violated policy would be written to the console.
    assert "CONSOLE" not in done.stderr
    return done.stdout


class Page(HTMLParser):
    """Attributes, scripts by id or place, and visible text of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[str | None, str]] = []
        self.style = self.text = ""
        self._inside = ""
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append((dict(attrs).get("id"), ""))

    def handle_endtag(self, tag: str) -> None:
        self._inside = "" if tag in ("script", "style") else self._inside

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts[-1] = (self.scripts[-1][0], self.scripts[-1][1] + data)
        elif self._inside == "style":
            self.style += data
        else:
            self.text += data

    def data(self, name: str) -> Any:
        return json.loads(next(script for found, script in self.scripts if found == name))
