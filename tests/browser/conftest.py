"""A run, a server that shows it, and Chromium to look at it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from browser_session import Complaints, Opener, Server, serve

playwright = pytest.importorskip("playwright.sync_api", reason="make test-browser installs it")

FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
"""No GPU: what holds here holds on a machine without one."""
AV = "flawed-brakes-late"
"""It crashes in natural traffic so often that a fraction of a second of driving gives hundreds of cases."""


def cornerforge(*words: str) -> None:
    done = subprocess.run([sys.executable, "-m", "cornerforge", *words, "--quiet"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The libraries and analyses of a run: natural crashes of an AV that brakes late, and those of an adversary."""
    place = tmp_path_factory.mktemp("run")
    natural, attack = place / "natural" / "library", place / "library"
    cornerforge("simulate", "--av", AV, "--tests", "3000", "--out", str(natural))
    cornerforge("analyse", str(natural), "--out", str(place / "natural" / "analysis"))
    cornerforge("generate", "--av", AV, "--policy", "swerve", "--cases", "300", "--out", str(attack))
    cornerforge("analyse", str(attack), "--out", str(place / "analysis"))
    return place


@pytest.fixture(scope="session")
def server(run: Path) -> Iterator[Server]:
    started = serve(run)
    # Kernels that were not compiled before take a minute; tests then wait for the page only.
    with urlopen(f"{started.url}api/about") as answer:
        case = json.load(answer)["start"][0]["case"]
    with urlopen(f"{started.url}api/case/{case}/with/idm-mobil", timeout=300) as answer:
        assert answer.status == 200
    yield started
    started.stop()


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("there is no program chromium; make test-browser installs it")
    with playwright.sync_playwright() as session:
        browser = session.chromium.launch(executable_path=program, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def look(chromium: Any, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Opener]:
    """Open a page; at the end of the test nothing may have complained. A failed test leaves a picture.

    `look(url, width=1280, height=720, dark=False, allowed=())`: complaints that contain one of `allowed` are expected.
    """
    contexts: list[Any] = []
    expected: list[str] = []
    complaints = Complaints()

    def opened(
        url: str, width: int = 1280, height: int = 720, dark: bool = False, allowed: tuple[str, ...] = ()
    ) -> Any:
        context = chromium.new_context(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light", has_touch=width < 600
        )
        context.set_default_timeout(20_000)
        contexts.append(context)
        expected.extend(allowed)
        page = context.new_page()
        complaints.listen(page, url.split("#")[0].rsplit("/", 1)[0])
        page.goto(url)
        return page

    yield opened
    for k, context in enumerate(contexts):
        for page in context.pages:
            page.screenshot(path=str(tmp_path / f"{request.node.name[:40]}-{k}.png"))
        context.close()
    assert not [line for line in complaints.lines if not any(part in line for part in expected)]
