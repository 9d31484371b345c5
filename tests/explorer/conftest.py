"""A run's folder with crashes of an adversary and "natural" ones, their analyses, and a server that shows it."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest

import cornerforge
from cornerforge.experiment.setting import experiment
from cornerforge.ext.explorer import serve as verb
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.library import CaseLibrary
from cornerforge.library.shards import encode_tables
from cornerforge.world_options import WorldOptions

CANARY = "canary-7f1c: no answer may hold this"

BRAKES = """
import numpy as np
class Brakes:
    def act(self, view):
        return np.stack([np.full(len(view), -4.0), np.zeros(len(view))], axis=1)
"""
"""An AV of one's own, in a file of its own."""

WITH_A_PAGE = """
import sys
from cornerforge.ext.explorer import server
server.read_page = lambda: {"index.html": b"<!DOCTYPE html><title>page</title>", "explorer.js": b"1;\\n"}
from cornerforge.cli import main
sys.exit(main(sys.argv[1:]))
"""
"""The program, with a page that no Node has built."""


def as_natural(library: Path, to: Path, tests: int) -> Path:
    """Store the cases of a library as if natural traffic had made them in so many tests."""
    cases = CaseLibrary.open(library)
    seed = int(str(cases.identity["seed"]))
    identity = {**cases.identity, **experiment(WorldOptions(), bv="nde").identity(seed)}
    new = CaseLibrary.create(to, identity, cases.odd)
    for rows, tracks in cases.shards():
        new.append_shard(encode_tables(rows, tracks), next_test=tests, tests=tests, crashes=len(cases))
    new.finish()
    shutil.copy(library / "model.npz", to / "model.npz")
    return to


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `run` leaves it, with 40 cases of an adversary and 30 natural ones; and beside it a secret."""
    folder = tmp_path_factory.mktemp("explorer") / "run"
    cornerforge.generate(policy="swerve", cases=40, out=folder / "library", seed=3)
    cornerforge.analyse(folder / "library", out=folder / "analysis")
    cornerforge.generate(policy="lane-changer", cases=30, out=folder / "made", seed=4)
    as_natural(folder / "made", folder / "natural" / "library", 10**6)
    shutil.rmtree(folder / "made")
    cornerforge.analyse(folder / "natural" / "library", out=folder / "natural" / "analysis")
    for secret in (folder / "secret.txt", folder.parent / "secret.txt", folder / "library" / "secret.txt"):
        secret.write_text(CANARY, encoding="utf-8")
    return folder


@dataclass(frozen=True)
class Running:
    """A server in another process."""

    process: subprocess.Popen[str]
    errors: IO[str]
    url: str
    port: int


def started(*arguments: object) -> Running:
    """Start the program, and wait until it says where it is; its errors go into a file, which is never full."""
    errors = TemporaryFile("w+")  # noqa: SIM115  closed by `stopped`
    command = [sys.executable, "-c", WITH_A_PAGE, "serve", *map(str, arguments), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    errors.seek(0)
    assert line, errors.read()
    told = json.loads(line)
    return Running(process, errors, told["url"], urlsplit(told["url"]).port or 0)


def stopped(running: Running, by: signal.Signals = signal.SIGINT) -> tuple[int, str]:
    """End it as Ctrl-C does; exit status, and what it wrote to standard error."""
    running.process.send_signal(by)
    running.process.communicate(timeout=60)
    with running.errors:
        running.errors.seek(0)
        return running.process.returncode, running.errors.read()


@pytest.fixture(scope="module")
def server(place: Path) -> Iterator[Running]:
    running = started(place, "--port", 0)
    yield running
    if running.process.poll() is None:
        stopped(running)


def get(server: Running, path: str) -> bytes:
    with urlopen(server.url + path) as answer:
        content: bytes = answer.read()
    return content


def asked(server: Running, path: str) -> Any:
    return json.loads(get(server, path))


def sent(server: Running, method: str, path: str, content: Any) -> bytes:
    body, kind = json.dumps(content).encode(), {"Content-Type": "application/json"}
    with urlopen(Request(server.url + path, body, kind, method=method)) as answer:
        got: bytes = answer.read()
    return got


@pytest.fixture(scope="module")
def exhibit(place: Path) -> Iterator[Exhibit]:
    found = verb._sources(place)
    made = Exhibit("run", [(one.source, one.analysis) for one in found], Driving((), found[0].source))
    yield made
    made.close()
