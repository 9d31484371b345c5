"""`generate`, `replay`, `query`, `analyse`: libraries survive kills, cases happen again, foreign places stay whole."""

from __future__ import annotations

import importlib
import json
import math
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from edited_files import write_object
from folder_snapshot import snapshot
from reference.records import append, case_record

import cornerforge
from cornerforge._checksums import with_checksum
from cornerforge.adversary.config import PRESETS
from cornerforge.drivers.policy import n_weights
from cornerforge.errors import CornerForgeError, FileFormatError, InputError, OutputError, UnknownNameError
from cornerforge.experiment.policy_file import Policy, load_policy, policy_hash, save_policy
from cornerforge.experiment.setting import experiment
from cornerforge.library import CaseLibrary
from cornerforge.ndd.model import model_hash
from cornerforge.results import Queried, Replayed, as_json
from cornerforge.sim.controllers import cast_index
from cornerforge.sim.recorder import Recorder
from cornerforge.types import Odd
from cornerforge.work.progress import NO_PROGRESS
from cornerforge.world_options import STEER_FROM

pytestmark = pytest.mark.full

filling = importlib.import_module("cornerforge.library.filling")
WHAT = ["case_id", "trajectory_digest", "crash_time_s", "log_prob_nde"]


def table(path: Path) -> pa.Table:
    return CaseLibrary.open(path).scalars(WHAT)


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "cornerforge", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A test runner in the background passes "ignore Ctrl-C" on to its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def wait_for_cases(library: Path, more_than: int, process: subprocess.Popen[str]) -> None:
    """Until a library has committed more cases than that; fails if the process ends before."""
    while process.poll() is None:
        if (library / "manifest.json").exists() and len(CaseLibrary.open(library)) > more_than:
            return
        time.sleep(0.01)
    pytest.fail(f"ended before it was to be killed: {process.stderr.read() if process.stderr else ''}")


def copied(library: Path, to: Path) -> Path:
    to.mkdir()
    for file in library.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


# --- generate ---


def test_cases_do_not_depend_on_threads(tmp_path: Path) -> None:
    for threads in (1, 2):
        cornerforge.generate(policy="lane-changer", cases=30, out=tmp_path / str(threads), threads=threads, seed=8)
    names = ["manifest.json", "cases-000000.parquet", "tracks-000000.parquet", "model.npz"]
    one, two = (snapshot(tmp_path / threads) for threads in "12")
    assert {name: one[name] for name in names} == {name: two[name] for name in names}


def test_counts_and_provenance(swerve_library: Path) -> None:
    library = CaseLibrary.open(swerve_library)
    assert len(library) == library.crashes == 60
    assert library.finished
    last = library.scalars(["test"])["test"].to_pylist()[-1]
    assert library.tests == last + 1  # the test of the last case is the last counted
    made = json.loads((swerve_library / "provenance.json").read_text(encoding="utf-8"))
    assert made["identity"] == library.identity
    assert {"seed", "config_hash", "model_hash", "policy_hash", "av_hash", "code"} <= set(made["identity"])
    assert {"cornerforge", "command", "written", "seconds", "machine"} <= set(made)


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three shards, written in one go."""
    path = tmp_path_factory.mktemp("unbroken") / "library"
    cornerforge.generate(policy="swerve", cases=9300, out=path, seed=1)
    return path


def test_a_library_goes_on_after_kills_as_if_nothing_had_happened(unbroken: Path, tmp_path: Path) -> None:
    """Shards hold 1000 cases; the process is killed right after its first shard, and again after its second."""
    library = tmp_path / "killed"
    command = ["generate", "--policy", "swerve", "--cases", "9300", "--seed", "1", "--out", str(library), "--resume"]
    for cases in (0, 1000):
        process = start(*command)
        wait_for_cases(library, cases, process)
        process.kill()
        process.communicate()
        assert 1000 <= len(CaseLibrary.open(library)) < 9300
        assert not CaseLibrary.open(library).finished
    resumed = cornerforge.generate(policy="swerve", cases=9300, out=library, seed=1, resume=True)
    assert resumed.cases == 9300
    files, expected = snapshot(library), snapshot(unbroken)
    del files["provenance.json"], expected["provenance.json"]  # it tells the time
    assert files == expected


def test_ctrl_c_exits_130_and_keeps_what_was_recorded(unbroken: Path, tmp_path: Path) -> None:
    library = tmp_path / "library"
    process = start(
        "generate", "--policy", "swerve", "--cases", "100000", "--seed", "1", "--out", str(library), "--json"
    )
    wait_for_cases(library, 0, process)
    time.sleep(0.3)  # into the second shard
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert err == "cornerforge: interrupted; what was finished is kept: the same command with --resume goes on.\n"
    kept = len(CaseLibrary.open(library))
    assert kept > 1000
    assert not CaseLibrary.open(library).finished
    resumed = cornerforge.generate(policy="swerve", cases=kept + 5, out=library, seed=1, resume=True)
    assert resumed.cases == kept + 5
    both = min(kept + 5, 9300)
    assert table(library).slice(0, both).equals(table(unbroken).slice(0, both))
    full = {name for name in snapshot(library) if name.startswith(("cases-", "tracks-"))} & set(snapshot(unbroken))
    for name in sorted(full)[:2]:
        assert snapshot(library)[name] == snapshot(unbroken)[name]


def test_resuming_a_finished_library_changes_no_case(swerve_library: Path, tmp_path: Path) -> None:
    library = copied(swerve_library, tmp_path / "library")
    assert cornerforge.generate(policy="swerve", cases=60, out=library, seed=5, resume=True).cases == 60
    assert cornerforge.generate(policy="swerve", cases=9, out=library, seed=5, resume=True).cases == 60
    assert table(library).equals(table(swerve_library))


def test_rare_crashes_are_committed_by_the_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long before a shard is full, progress is committed, so that a kill does not lose hours."""
    monkeypatch.setattr(filling, "_COMMIT_SECONDS", 0.0)
    seen = []

    def watch(stage: str, done: float, total: float) -> None:
        if stage == "store":
            assert total == 3000
            seen.append((done, CaseLibrary.open(tmp_path / "library").next_test))

    cornerforge.simulate(tests=3000, bv="uniform", out=tmp_path / "library", progress=watch)
    assert seen[0] == (128, 0)
    assert seen[1] == (256, 128)
    monkeypatch.undo()
    cornerforge.simulate(tests=3000, bv="uniform", out=tmp_path / "other")
    files, others = snapshot(tmp_path / "library"), snapshot(tmp_path / "other")
    del files["provenance.json"], others["provenance.json"]  # it tells the time
    assert files == others


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"seed": 6}, "seed"),
        ({"policy": "lane-changer"}, "bv"),
        ({"odd": "swift"}, "odd"),
        ({"bounded": True}, "bounded"),
        ({"budget": 3.0}, "bounded"),
    ],
)
def test_a_library_of_another_run_is_refused_by_name_and_untouched(
    changes: dict[str, object], named: str, swerve_library: Path
) -> None:
    before = snapshot(swerve_library)
    arguments = {"policy": "swerve", "cases": 80, "seed": 5, "resume": True} | changes
    with pytest.raises(InputError, match=named):
        cornerforge.generate(out=swerve_library, **arguments)  # type: ignore[arg-type]
    assert snapshot(swerve_library) == before


def test_without_resume_a_library_is_not_touched(swerve_library: Path) -> None:
    before = snapshot(swerve_library)
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.generate(policy="swerve", cases=60, out=swerve_library, seed=5)
    assert snapshot(swerve_library) == before


@pytest.mark.parametrize("resume", [False, True])
def test_a_folder_of_something_else_is_not_touched(resume: bool, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter 1", encoding="utf-8")
    with pytest.raises(OutputError, match=r"thesis\.tex"):
        cornerforge.generate(policy="swerve", cases=5, out=tmp_path, resume=resume)
    assert snapshot(tmp_path) == {"thesis.tex": b"chapter 1"}


@pytest.mark.parametrize(
    "arguments",
    [
        {"cases": 0},
        {"seed": -1},
        {"threads": 0},
        {"policy": "nde"},
        {"policy": "swerv"},
        {"av": "none"},
        {"lanes": 1},
        {"budget": -1.0},
        {"budget": float("nan")},
        {"acting": "softmax"},
        {"policy": ["swerve", "uniform"]},
    ],
)
def test_wrong_arguments_make_no_library(arguments: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        cornerforge.generate(**{"policy": "swerve", "cases": 5, "out": tmp_path / "library"} | arguments)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_an_adversary_too_weak_is_said_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filling, "_MAX_TESTS_PER_CASE", 3)
    with pytest.raises(InputError, match=r"0 of 1 cases after 3 tests"):
        cornerforge.generate(policy="uniform", bounded=True, cases=1, out=tmp_path / "library")


# --- replay ---


def test_every_case_happens_again(swerve_library: Path) -> None:
    found = cornerforge.replay(swerve_library, "all", check=True)
    assert found == Replayed(case="all", crash_time_s=None, identical=True, cases=60, differ=())


def test_cases_of_before_jerk_had_a_limit_happen_again(tmp_path: Path) -> None:
    """Manifests of then do not state one, and mean none; driven with today's limit the same tests are others."""
    early = tmp_path / "early"
    run = experiment(bv="swerve", road=Odd(max_jerk=math.inf))
    filling.fill_library(run, early, seed=5, cases=5, threads=1, resume=False, progress=NO_PROGRESS)
    assert "max_jerk" not in json.loads((early / "manifest.json").read_text())["odd"]
    assert cornerforge.replay(early, "all", check=True).identical is True
    cornerforge.shrink(early, "all", out=tmp_path / "shrunk")
    assert cornerforge.replay(tmp_path / "shrunk", "all", check=True).identical is True
    cornerforge.generate(policy="swerve", cases=5, out=tmp_path / "late", seed=5)
    then, now = (CaseLibrary.open(tmp_path / name).scalars(["av_max_acceleration_mps2"]) for name in ("early", "late"))
    assert then != now


def test_a_policys_cases_happen_again(some_policy: Path, tmp_path: Path) -> None:
    """The library keeps policy and model beside it, so it can be moved and played elsewhere."""
    cornerforge.generate(policy=some_policy, cases=3, out=tmp_path / "library", odd="paper", seed=2)
    (tmp_path / "library").rename(tmp_path / "moved")
    assert cornerforge.replay(tmp_path / "moved", "all", check=True).identical is True


def more_policies(folder: Path, n: int, **changes: object) -> list[Path]:
    """Policy files with random weights, each another."""
    shape = PRESETS["fast"].network
    paths = []
    for k in range(n):
        weights = np.random.default_rng(100 + k).normal(0.0, 0.1, n_weights(shape)).astype(np.float32)
        paths.append(folder / f"random-{k}.safetensors")
        save_policy(replace(Policy(weights, shape, False, {}), **changes), paths[-1])  # type: ignore[arg-type]
    return paths


def column(library: Path, name: str) -> list[object]:
    values: list[object] = CaseLibrary.open(library).scalars([name])[name].to_pylist()
    return values


def test_a_mixture_says_which_policy_drove_and_happens_again(tmp_path: Path) -> None:
    policies = more_policies(tmp_path, 3)
    library = tmp_path / "library"
    cornerforge.generate(policy=policies, cases=40, out=library, odd="paper", acting="softmax:0.2", seed=2)
    hashes = [policy_hash(load_policy(path)) for path in policies]
    tests = column(library, "test")
    assert column(library, "policy") == [hashes[cast_index(2, test, 3)] for test in tests]  # type: ignore[arg-type]
    assert len(set(column(library, "policy"))) == 3
    assert all(value < 0.0 for value in column(library, "log_prob_policy"))  # type: ignore[operator]
    for path in policies:
        path.unlink()
    assert cornerforge.replay(library, "all", check=True).identical is True
    one = {name: CaseLibrary.open(library).identity[name] for name in ("policies", "acting", "bv", "budget")}
    assert one == {"policies": 3, "acting": "softmax:0.2", "bv": "policy", "budget": None}


def test_a_test_of_a_mixture_is_that_of_its_policy_alone(tmp_path: Path) -> None:
    policies = more_policies(tmp_path, 2)
    cornerforge.simulate(bv=policies, tests=300, out=tmp_path / "both", odd="paper", seed=2)
    digests = dict(zip(column(tmp_path / "both", "test"), column(tmp_path / "both", "trajectory_digest"), strict=True))
    found = {}
    for k, path in enumerate(policies):
        cornerforge.simulate(bv=[path], tests=300, out=tmp_path / str(k), odd="paper", seed=2)
        alone = tmp_path / str(k)
        for test, digest in zip(column(alone, "test"), column(alone, "trajectory_digest"), strict=True):
            if cast_index(2, test, 2) == k:  # type: ignore[arg-type]
                found[test] = digest
    assert len(found) > 5
    assert found == digests


def test_acting_at_random_is_another_library_and_greedy_has_no_doubt(some_policy: Path, tmp_path: Path) -> None:
    for name, acting in (("greedy", "greedy"), ("soft", "softmax:0.05"), ("again", "softmax:0.05")):
        cornerforge.generate(policy=some_policy, cases=20, out=tmp_path / name, odd="paper", acting=acting)
    assert set(column(tmp_path / "greedy", "log_prob_policy")) == {0.0}
    assert column(tmp_path / "soft", "trajectory_digest") == column(tmp_path / "again", "trajectory_digest")
    assert column(tmp_path / "soft", "trajectory_digest") != column(tmp_path / "greedy", "trajectory_digest")
    with pytest.raises(InputError, match="acting is"):
        cornerforge.generate(
            policy=some_policy, cases=30, out=tmp_path / "soft", odd="paper", acting="softmax:0.06", resume=True
        )


@pytest.mark.parametrize(
    ("budget", "kind", "start"), [(3.0, "shortfall", 0), (15.0, "shortfall", None), (9.0, "excess", None)]
)
def test_no_case_exceeds_its_budget(budget: float, kind: str, start: int | None, tmp_path: Path) -> None:
    found = cornerforge.simulate(
        bv="swerve", odd="paper", budget=budget, budget_of=kind, steer_from=start, tests=9000, out=tmp_path / "library"
    )
    assert found.cases is not None
    assert found.cases >= 3
    spent = column(tmp_path / "library", f"{kind}_nats")
    assert all(0.0 <= value <= budget for value in spent)  # type: ignore[operator]
    assert max(spent) > 0.8 * budget  # type: ignore[type-var, operator]
    first = STEER_FROM if start is None else start
    told = CaseLibrary.open(tmp_path / "library").identity
    assert (told.get("budget_of", "shortfall"), told.get("steers_from", 0)) == (kind, first)
    for actions in column(tmp_path / "library", "critical_bv_action"):
        assert (np.array(actions)[:first] == -1).all()  # natural drivers have the road to themselves
        assert (np.array(actions)[first:] >= 0).all()
    assert set(column(tmp_path / "library", "n_implausible")) == {0}
    assert cornerforge.replay(tmp_path / "library", "all", check=True).identical is True


def test_a_budget_goes_before_what_a_policy_brings(tmp_path: Path) -> None:
    (policy,) = more_policies(tmp_path, 1, bounded=True, budget=20.0)
    own, tighter = (experiment(bv=policy, budget=budget) for budget in (None, 2.0))
    assert (own.bounded, own.budget, own.setting.who.budget) == (True, 20.0, 20_000_001)
    assert (tighter.bounded, tighter.budget, tighter.setting.who.budget) == (True, 2.0, 2_000_001)
    assert own.identity(0)["policy_hash"] != tighter.identity(0)["policy_hash"]
    later = experiment(bv=policy, budget=2.0, budget_of="excess", steer_from=3)
    assert later.setting.who[6:8] == (1, 3)
    assert (later.identity(0)["budget_of"], later.identity(0)["steers_from"]) == ("excess", 3)
    assert later.identity(0)["policy_hash"] != tighter.identity(0)["policy_hash"]


def test_when_an_adversary_steers() -> None:
    for keywords, first in (
        ({"bv": "nde"}, 0), ({"bv": "swerve"}, 0), ({"bv": "swerve", "bounded": True}, STEER_FROM),
        ({"bv": "swerve", "budget": 5.0, "steer_from": 2}, 2), ({"bv": "swerve", "steer_from": 2}, 2),
    ):  # fmt: skip
        run = experiment(**keywords)
        assert run.setting.who.steers_from == run.identity(0).get("steers_from", 0) == first
    with pytest.raises(InputError, match="steer_from needs an adversary; nde has none"):
        experiment(steer_from=3)
    with pytest.raises(InputError, match="give the budget too"):
        experiment(bv="swerve", bounded=True, budget_of="excess")


def test_one_case(swerve_library: Path) -> None:
    case = table(swerve_library).slice(7, 1).to_pylist()[0]
    found = cornerforge.replay(swerve_library, case["case_id"])
    assert as_json(found) == {"case": case["case_id"], "crash_time_s": case["crash_time_s"], "identical": None}
    assert cornerforge.replay(swerve_library, case["case_id"], check=True).identical is True


@pytest.mark.parametrize(("name", "begin"), [("a.png", b"\x89PNG"), ("a.SVG", b"<?xml")])
def test_a_case_as_a_picture(swerve_library: Path, tmp_path: Path, name: str, begin: bytes) -> None:
    case = table(swerve_library)["case_id"][7].as_py()
    place = tmp_path / "new" / name
    assert cornerforge.replay(swerve_library, case, picture=place).picture == str(place)
    first = place.read_bytes()
    assert first.startswith(begin)
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.replay(swerve_library, case, picture=place)
    cornerforge.replay(swerve_library, table(swerve_library)["case_id"][8].as_py(), picture=place.with_name(f"b{name}"))
    assert place.with_name(f"b{name}").read_bytes() != first


@pytest.mark.parametrize(("case", "name", "why"), [("all", "a.png", "one case"), ("5:1", "a.jpg", "nor in .svg")])
def test_what_cannot_be_a_picture_is_told_first(
    swerve_library: Path, tmp_path: Path, case: str, name: str, why: str
) -> None:
    with pytest.raises(InputError, match=why):
        cornerforge.replay(swerve_library, case, picture=tmp_path / name)


def test_negative_control_a_case_that_did_not_happen_is_found(tmp_path: Path) -> None:
    """One frame of one vehicle is moved by a tenth of a millimetre: stored at full precision in the digest only."""
    run = experiment(bv="swerve")
    identity = run.identity(5)
    library = CaseLibrary.create(tmp_path / "library", identity, run.odd)
    cornerforge.generate(policy="swerve", cases=1, out=tmp_path / "model", seed=5)
    (tmp_path / "library" / "model.npz").write_bytes((tmp_path / "model" / "model.npz").read_bytes())
    test = CaseLibrary.open(tmp_path / "model").scalars(["test"])["test"].to_pylist()[0]
    scenario = Recorder(run.setting, run.odd).record(5, test)
    append(library, [case_record(scenario, trajectory_digest="0" * 64)], next_test=test + 1, tests=test + 1, crashes=1)
    found = cornerforge.replay(tmp_path / "library", "all", check=True)
    assert (found.identical, found.differ) == (False, (f"5:{test}",))
    assert found.note is not None  # the identity says nothing of the code, so it may have been another


def test_unknown_case_and_unknown_library(swerve_library: Path, tmp_path: Path) -> None:
    last = max(CaseLibrary.open(swerve_library).scalars(["test"])["test"].to_pylist())
    with pytest.raises(UnknownNameError, match=f'Did you mean "5:{last}"'):
        cornerforge.replay(swerve_library, f"5:{last}9")
    with pytest.raises(UnknownNameError, match=f"Known: 5:{last}"):
        cornerforge.replay(swerve_library, "5:999999")
    with pytest.raises(FileFormatError, match="no case library"):
        cornerforge.replay(tmp_path / "none", "0:1")


@pytest.mark.parametrize(
    ("world", "model", "told"),
    [
        ({"odd": "swift"}, None, "ODD default, here swift"),
        ({"lanes": 2}, None, "lanes 3, here 2"),
        ({}, "of-another", "naturalistic model of-another, here"),
        ({}, None, None),
    ],
)
def test_a_policy_from_another_world_is_said_to_be_one(
    world: dict[str, Any], model: str | None, told: str | None, some_policy: Path, tmp_path: Path,
    recwarn: pytest.WarningsRecorder,
) -> None:  # fmt: skip
    here = experiment()
    about = {"odd": asdict(here.odd), "model_hash": model or model_hash(here.model)}
    save_policy(replace(load_policy(some_policy), about=about), tmp_path / "from.safetensors")
    cornerforge.simulate(bv=str(tmp_path / "from.safetensors"), tests=2, **world)
    messages = [str(w.message) for w in recwarn]
    assert len(messages) == (told is not None)
    assert told is None or told in messages[0]


def test_a_library_with_another_model_does_not_replay(swerve_library: Path, tmp_path: Path) -> None:
    library = copied(swerve_library, tmp_path / "library")
    (library / "model.npz").unlink()
    with pytest.raises(FileFormatError, match=r"model\.npz"):
        cornerforge.replay(library, "all")


def test_an_empty_library_is_not_called_identical(swerve_library: Path, tmp_path: Path) -> None:
    library = tmp_path / "library"
    shutil.copytree(swerve_library, library)
    for shard in [*library.glob("cases-*.parquet"), *library.glob("tracks-*.parquet")]:
        shard.unlink()
    manifest = json.loads((library / "manifest.json").read_text())
    manifest["shards"] = []
    write_object(library / "manifest.json", manifest)
    with pytest.raises(InputError, match="no cases yet"):
        cornerforge.replay(library, "all", check=True)


def test_a_library_that_was_not_generated_does_not_replay(tmp_path: Path) -> None:
    CaseLibrary.create(tmp_path / "library", {"seed": 0}, experiment().odd)
    with pytest.raises(FileFormatError, match="does not say its av"):
        cornerforge.replay(tmp_path / "library", "all")


def test_a_library_of_a_newer_schema_is_refused(swerve_library: Path, tmp_path: Path) -> None:
    library = copied(swerve_library, tmp_path / "library")
    manifest = json.loads((library / "manifest.json").read_text(encoding="utf-8"))
    write_object(library / "manifest.json", manifest | {"schema_version": 99})
    before = snapshot(library)
    for work in (
        lambda: cornerforge.replay(library, "all"),
        lambda: cornerforge.analyse(library),
        lambda: cornerforge.query(library, "select 1"),
        lambda: cornerforge.generate(policy="swerve", cases=70, out=library, seed=5, resume=True),
    ):
        with pytest.raises(FileFormatError, match="schema 99"):
            work()
    assert snapshot(library) == before


# --- query ---


def test_query_answers_in_plain_values(swerve_library: Path) -> None:
    assert cornerforge.query(swerve_library, "select count(*) as n from cases") == Queried(
        columns=("n",), rows=((60,),)
    )
    rows = cornerforge.query(
        swerve_library,
        "select 1.5, 'nan'::double, 'inf'::float, date '2021-02-06', null, true, [1, 2], {'a': 0.5}, 2::hugeint, 'x'",
    ).rows
    assert rows == ((1.5, None, None, "2021-02-06", None, True, [1, 2], {"a": 0.5}, 2, "x"),)
    everything = cornerforge.query(swerve_library, "select * from cases order by test")
    assert len(json.loads(json.dumps(as_json(everything), allow_nan=False))["rows"]) == 60


@pytest.mark.parametrize(
    "sql", ["selec 1", "drop table cases", "select * from 'manifest.json'", "", "select nope from cases"]
)
def test_a_query_that_cannot_be_answered_is_one_line(sql: str, swerve_library: Path) -> None:
    with pytest.raises(InputError) as caught:
        cornerforge.query(swerve_library, sql)
    assert "\n" not in str(caught.value)


# --- analyse ---


def test_analyse_counts_every_case_once(swerve_library: Path, tmp_path: Path) -> None:
    found = cornerforge.analyse(swerve_library, steps=3, out=tmp_path / "analysis", seed=2)
    assert found.cases == found.majority + found.minority == 60
    assert sum(found.crash_types.values()) == sum(cluster.size for cluster in found.clusters) == 60
    assert len(found.features) == 15
    ids = set(table(swerve_library)["case_id"].to_pylist())
    assert {case for cluster in found.clusters for case in cluster.typical} <= ids
    assert set(found.rare) <= ids
    written = json.loads((tmp_path / "analysis" / "analysis.json").read_text(encoding="utf-8"))
    assert written == with_checksum(as_json(found))
    identity = json.loads((tmp_path / "analysis" / "provenance.json").read_text(encoding="utf-8"))["identity"]
    assert (identity["steps"], identity["analysis_seed"], identity["cases"]) == (3, 2, 60)


def test_analyse_again_into_the_same_place(swerve_library: Path, tmp_path: Path) -> None:
    first = cornerforge.analyse(swerve_library, out=tmp_path)
    second = cornerforge.analyse(swerve_library, out=tmp_path)
    assert replace(first, seconds={}) == replace(second, seconds={})
    with pytest.raises(InputError, match="steps"):
        cornerforge.analyse(swerve_library, steps=2, out=tmp_path)


def test_analyse_of_an_empty_library_says_how_to_fill_it(tmp_path: Path) -> None:
    cornerforge.simulate(tests=5, out=tmp_path / "library")
    with pytest.raises(InputError, match="holds no cases yet"):
        cornerforge.analyse(tmp_path / "library", out=tmp_path / "analysis")
    assert not (tmp_path / "analysis").exists()


@pytest.mark.parametrize("arguments", [{"steps": 0}, {"steps": 16}, {"seed": -1}, {"seed": 2**32}])
def test_analyse_out_of_range(arguments: dict[str, int], swerve_library: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="out of range"):
        cornerforge.analyse(swerve_library, out=tmp_path / "analysis", **arguments)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_analyse_does_not_write_over_something_else(swerve_library: Path) -> None:
    before = snapshot(swerve_library)
    with pytest.raises(CornerForgeError):
        cornerforge.analyse(swerve_library, out=swerve_library)
    assert snapshot(swerve_library) == before
