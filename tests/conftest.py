"""What all tests share: the seed, the hypothesis profiles, and the checked-in expectations.

`seed` is fixed, so that a failure is a failure for everybody; `make test-slow` draws one and prints it. `golden`
compares a text with a file below `tests/golden/`; `make golden` writes these files again.
"""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest

if TYPE_CHECKING:
    from cornerforge.ndd.model import NddModel

pytest_plugins = ["made_once"]
collect_ignore = ["without_posix"]
"""Imported, it takes from Python what only POSIX has; `test_without_posix.py` gives it to processes of its own."""
GOLDEN = Path(__file__).parent / "golden"
FIXED_SEED = 20_210_206

# No deadline: the first example of a compiled kernel waits for the compiler.
hypothesis.settings.register_profile("quick", deadline=None, derandomize=True, max_examples=20)
hypothesis.settings.register_profile("full", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.register_profile("slow", deadline=None, max_examples=500, print_blob=True)
hypothesis.settings.load_profile("quick")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", default=str(FIXED_SEED), help='seed of the statistical tests, or "random"')
    parser.addoption("--write-golden", action="store_true", help="write the golden files instead of comparing")
    parser.addoption("--ledger", help="folder for a line of JSON a test: its time, kernels compiled, processes started")


def pytest_configure(config: pytest.Config) -> None:
    # AVs that tests name are not kept as if this user had named them (`foreign.named_avs`).
    state = tempfile.mkdtemp(prefix="cornerforge-tests-")
    config.add_cleanup(lambda: shutil.rmtree(state, ignore_errors=True))
    os.environ["XDG_STATE_HOME"] = state
    # A background job of a shell ignores Ctrl-C, and so would all programs that tests start and interrupt.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if folder := config.getoption("--ledger"):
        from costs import Ledger

        worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
        config.pluginmanager.register(Ledger(Path(folder) / f"{worker}.jsonl"))
    if config.getoption("--seed") == "random":
        config.option.seed = str(secrets.randbelow(2**31))


def pytest_report_header(config: pytest.Config) -> str:
    return f"cornerforge: --seed {config.getoption('--seed')}"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    sampled: dict[tuple[str, str], list[pytest.Item]] = {}
    for item in items:
        if "golden" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.golden)
        if item.get_closest_marker("sampled"):
            sampled.setdefault((item.path.as_posix(), getattr(item, "originalname", item.name)), []).append(item)
    for versions in sampled.values():
        for item in not_sampled(versions):
            item.add_marker(pytest.mark.full)


def not_sampled(versions: list[pytest.Item]) -> list[pytest.Item]:
    """List those of a test's parameters that `make test` leaves to `make test-full`: it runs some, spread evenly."""
    marker = versions[0].get_closest_marker("sampled")
    assert marker is not None
    kept = {round(i * (len(versions) - 1) / max(marker.args[0] - 1, 1)) for i in range(marker.args[0])}
    return [item for i, item in enumerate(versions) if i not in kept]


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    """Seed for tests that sample: fixed by default, drawn anew and printed by `make test-slow`."""
    return int(request.config.getoption("--seed"))


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """`golden(name, text)`: the text must be that of `tests/golden/name`, byte for byte."""

    def compare(name: str, text: str) -> None:
        path = (GOLDEN / name).resolve()
        if request.config.getoption("--write-golden"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
        assert path.is_file(), f"{path.name} is missing; write it with: make golden"
        assert text == path.read_text(encoding="utf-8"), f"{path.name} differs; if that is meant: make golden"

    return compare


@pytest.fixture(scope="session")
def model() -> NddModel:
    """The shipped naturalistic model."""
    from cornerforge.ndd.model import default_model_path, load_model

    return load_model(default_model_path())


@pytest.fixture(scope="session")
def reckless(model: NddModel) -> NddModel:
    """A model in which more happens."""
    from hand_built import reckless_drivers

    return reckless_drivers(model)


@pytest.fixture
def in_memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """AVs from outside are asked in this Python (`foreign.av_in_memory`), but for tests marked `processes`."""
    if request.node.get_closest_marker("processes"):
        yield
        return
    from foreign.av_in_memory import patched

    with patched():
        yield


@pytest.fixture(autouse=True, scope="session")
def temporary_files(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Files that are kept for a person to read, such as what an AV printed that failed, go with those of the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("temporary")))
        yield
