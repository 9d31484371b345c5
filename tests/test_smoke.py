"""Each verb once, on what the others wrote: exit status, one JSON object, and the keys that people script against."""

from __future__ import annotations

import importlib
import json
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
import typer
from artefacts import artefact, made_once
from fuzz.seeds import TINY_RUN
from output_places import pairs_file
from small_trees import small_trees

from cornerforge.cli import app, main
from cornerforge.library import CaseLibrary

RATE = {"method", "crashes_per_test", "crashes_per_mile", "interval95", "relative_half_width", "tests", "seconds"}
SIMULATED = {
    "tests",
    "av_crashes",
    "bv_crashes",
    "crashes_per_test",
    "crashes_per_mile",
    "interval95",
    "miles",
    "digest",
}
SMOKE: dict[str, set[str]] = {
    "avs": {"avs"},
    "init new": {"files"},
    "simulate --tests 200 --stats": SIMULATED | {"distributions", "world_steps", "tests_per_second"},
    "rate --method mc --av flawed-not-behind --max-tests 300 --out r": RATE | {"effective_sample_size", "acceleration"},
    "rate --method splitting --av flawed-not-behind --max-tests 6000": RATE,
    "train --decisions 1024 --tests 50 --out p.safetensors": {"decisions", "seconds", "crashes_per_test", "interval95"},
    "train --learner ppo --decisions 16896 --tests 50 --out q.safetensors": {"updates", "crashes_per_test", "out"},
    "train-av --decisions 1024 --tests 50 --out a.safetensors": {"decisions", "out"},
    "generate --policy swerve --cases 4 --out lib": {"cases", "tests", "crashes_per_test", "interval95", "library"},
    "run --effort quick --av flawed-not-behind --out run": {"out", "nde", "train", "generate", "analyse", "seconds"},
    "analyse LIB --out found": {
        "cases", "features", "explained_variance", "majority", "minority", "clusters", "rare", "crash_types", "seconds",
    },
    "report RUN --out page": {"report"},
    "figure LIB CASE --out strip.svg": {"figures"},
    "shrink LIB CASE --out less": {"cases"},
    "replay LIB CASE --check": {"case", "crash_time_s", "identical"},
    "retest LIB --av rss-cautious": {"cases", "fixed", "still_crashing", "new_crashes", "rate_difference"},
    "suite run aeb --family braking --out aeb": {"suite", "scenarios", "tests", "beyond_allowed"},
    "r157 --family deceleration --out r157": {"scenarios", "failed", "failed_but_prevented_by"},
    "query LIB 'select count(*) from cases'": {"columns", "rows"},
    "verify LIB": {"whole"},
    "migrate LIB --out again": {"library"},
    "variety LIB": set(),
    "export LIB CASE --to json --out files": {"files"},
    "import TRACE --out imported": {"cases", "refused"},
    "cases from-data NGSIM --format ngsim --cases 2 --out moments": {"cases", "libraries"},
    "suite build LIB --size 2 --zoo idm-mobil --zoo flawed-not-behind --out suite": {"cases", "out"},
    "ndd fit PAIRS --format pairs --lane-changes prior --out m.npz": {
        "rows_read", "rows_used", "states", "held_out_log_likelihood", "out",
    },
    "ndd validate MODEL --against PAIRS --format pairs --miles 300": {"log_likelihood_per_decision", "passed"},
    "ndd show": set(),
    "road check weaving": set(),
    "road show curves": set(),
    "ndd import IVBSS --out m.npz": {"out"},
}  # fmt: skip
"""Command lines and keys of their objects; one line at least for each verb."""
ELSEWHERE = {
    "serve": "tests/explorer",
    "reproduce": "tests/paper/test_reproduce.py",
    "plausibility": "tests/verbs",
    "check-av": "tests/foreign",
    "road import": "tests/interchange/test_road_import.py",
    "site fit": "tests/calibrate/test_site_fit.py",
    "site validate": "tests/sim/test_site_validate.py",
    **dict.fromkeys(("site import", "site check", "site show"), "tests/interchange/test_sites.py"),
}
"""Verbs that take long or need processes, and where they are tested."""


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[str]:
    for name, child in getattr(command, "commands", {}).items():
        yield from leaves(child, (*path, name))
    if path and not hasattr(command, "commands"):
        yield " ".join(path)


def test_every_verb_is_here_or_elsewhere() -> None:
    verbs = set(leaves(typer.main.get_command(app)))
    assert {
        verb for verb in verbs if any(f"{line} ".startswith(f"{verb} ") for line in SMOKE)
    } | ELSEWHERE.keys() == verbs


@pytest.fixture(scope="module")
def words() -> dict[str, str]:
    """What the capital words of the lines stand for."""
    library = artefact("library") / "lib"
    return {
        "LIB": str(library), "CASE": str(CaseLibrary.open(library).scalars(["case_id"])["case_id"][0].as_py()),
        "RUN": str(artefact("run") / "run"), "TRACE": str(artefact("scenarios") / "traces" / "cut_in.osi"),
        "NGSIM": str(artefact("tracks") / "ngsim.csv"), "PAIRS": str(made_once("pairs", pairs_file) / "pairs.csv"),
        "MODEL": str(artefact("model") / "m.npz"), "IVBSS": str(artefact("ivbss") / "NDD_DATA"),
    }  # fmt: skip


@pytest.mark.parametrize("line", SMOKE)
def test_a_verb_does_its_work(
    line: str,
    words: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    if line.startswith("report"):  # it writes an analysis beside, and a page within
        shutil.copytree(words["RUN"], tmp_path / "RUN")
        words = {**words, "RUN": "RUN"}
    run = importlib.import_module("cornerforge.verbs.run")
    with small_trees(), patch.dict(run.EFFORTS, quick=run.Effort(**TINY_RUN)):
        status = main([*(words.get(word, word) for word in shlex.split(line)), "--json"])
    said = capsys.readouterr()
    assert status in ((0, 1) if line.startswith(("rate", "retest", "ndd validate", "r157")) else (0,)), said.err
    told = json.loads(said.out)
    assert SMOKE[line] <= told.keys()
