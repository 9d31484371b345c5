"""The command line: what it prints where, its exit status, and what bad input leaves behind (nothing)."""

from __future__ import annotations

import importlib
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from folder_snapshot import snapshot

from cornerforge.adversary.config import PRESETS
from cornerforge.adversary.policy_file import Policy, save_policy
from cornerforge.cli import app, main
from cornerforge.cli.output import Bars
from cornerforge.drivers.policy import n_weights

run_module = importlib.import_module("cornerforge.pipeline.run")

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a library, a policy and a trajectory file; read only."""
    folder = tmp_path_factory.mktemp("files")
    assert main(["generate", "--policy", "swerve", "--cases", "40", "--out", str(folder / "library"), "--quiet"]) == 0
    shape = PRESETS["fast"].network
    save_policy(Policy(np.zeros(n_weights(shape), np.float32), shape, False, {}), folder / "policy.safetensors")
    rows = []
    for f in range(12):
        split = "test" if f % 5 == 0 else "train"
        for i in range(121):
            rows.append(f"1,{f},999,{0.1 * i:.1f},{25 + 0.3 * np.sin(i / 20 + f):.4f},25.0,{40 + f}.0,{split}")
    header = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"
    (folder / "pairs.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    bad = [row.replace("25.0", "nan" if i % 2 else "1e9") for i, row in enumerate(rows)]
    (folder / "bad_numbers.csv").write_text("\n".join([header, *bad]) + "\n", encoding="utf-8")
    return folder


def call(capsys: Capture, *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of a call."""
    capsys.readouterr()
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


# --- help ---


def all_commands() -> list[list[str]]:
    def walk(command: Any, path: list[str]) -> Iterator[list[str]]:
        yield path
        for name, child in getattr(command, "commands", {}).items():
            yield from walk(child, [*path, name])

    return list(walk(typer.main.get_command(app), []))


@pytest.mark.parametrize("command", all_commands(), ids=lambda path: " ".join(path) or "cornerforge")
def test_every_command_helps(command: list[str], capsys: Capture) -> None:
    status, out, err = call(capsys, *command, "--help")
    assert status == 0
    assert "Usage" in out
    assert " ," not in out  # what stands in brackets would be taken for markup, and vanish
    assert err == ""


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["generate"], "interrupted; what was finished is kept."),
        (["analyse"], "interrupted."),
        (["ndd", "fit"], "interrupted."),
    ],
)
def test_an_interrupt_promises_what_the_command_does(
    command: list[str], said: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(typer.Typer, "__call__", interrupted)
    assert call(capsys, *command, "--quiet") == (130, "", f"cornerforge: {said}\n")


def test_the_promised_commands_are_there() -> None:
    promised = ("run", "simulate", "train", "generate", "analyse", "replay", "query")
    below_ndd = {"ndd fit", "ndd import", "ndd show", "ndd validate"}
    assert {*promised, *below_ndd, "avs"} <= {" ".join(path) for path in all_commands()}


@pytest.mark.parametrize("command", [path for path in all_commands() if path not in ([], ["ndd"])], ids=" ".join)
def test_every_command_takes_the_common_options(command: list[str], capsys: Capture) -> None:
    _, out, _ = call(capsys, *command, "--help")
    for option in ("--quiet", "--json", "--debug", "--seed", "--threads"):
        assert option in out


def test_help_is_quick_because_nothing_heavy_is_imported(tmp_path: Path) -> None:
    code = (
        "import sys; from cornerforge.cli import main; status = main(['--help']);"
        "heavy = {'numpy', 'torch', 'pyarrow', 'numba', 'scipy', 'sklearn', 'duckdb', 'plotly'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert "Usage" in done.stdout
    assert not list(tmp_path.iterdir())


def test_python_m_cornerforge_is_the_command_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "cornerforge", "avs", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
    assert "idm-mobil" in [av["name"] for av in json.loads(done.stdout)["avs"]]
    assert done.stderr == ""


# --- what is printed ---

RATE = {"tests", "crashes_per_test", "crashes_per_mile", "interval95"}
SIMULATE = RATE | {
    "av_crashes", "bv_crashes", "miles", "seconds", "world_steps", "world_steps_per_second", "tests_per_second",
    "digest",
}  # fmt: skip
TRAIN = {"decisions", "seconds", "crashes_per_test", "interval95", "out"}
GENERATE = {"cases", "tests", "crashes_per_test", "interval95", "seconds", "library"}
ANALYSE = {
    "cases", "features", "explained_variance", "majority", "minority", "clusters", "rare", "crash_types", "seconds",
}  # fmt: skip
FIT = {"rows_read", "rows_used", "states", "held_out_log_likelihood", "out"}

# Name: the call, with {f} for the folder of files and {n} for a new one; keys that the interface promises.
GOOD: dict[str, tuple[str, set[str]]] = {
    "simulate": ("simulate --tests 200", SIMULATE),
    "simulate --stats": ("simulate --tests 200 --bv idm --lanes 2 --stats", SIMULATE | {"distributions"}),
    "simulate --out": ("simulate --tests 60 --bv swerve --out {n}/library", SIMULATE),
    "simulate a policy": ("simulate --tests 60 --bv {f}/policy.safetensors", SIMULATE),
    "train": ("train --decisions 600 --out {n}/p.safetensors", TRAIN),
    "generate": ("generate --policy lane-changer --cases 5 --out {n}/library", GENERATE),
    "analyse": ("analyse {f}/library --steps 2 --out {n}/analysis", ANALYSE),
    "replay": ("replay {f}/library all --check", {"case", "crash_time_s", "identical"}),
    "reproduce": ("reproduce --figure table1 --budget quick --out {n}/paper", {"items", "out", "page", "seconds"}),
    "query": ("query {f}/library 'select case_id, n_vehicles from cases limit 2'", {"columns", "rows"}),
    "avs": ("avs", {"avs"}),
    "ndd fit": ("ndd fit {f}/pairs.csv --format pairs --out {n}/m.npz", FIT),
    "ndd show": ("ndd show", {"model_hash", "following", "free_flow", "lane_change", "initial", "counted", "figures"}),
    "ndd fit, format guessed": ("ndd fit {f}/pairs.csv --out {n}/m.npz", FIT | {"format"}),
}


def words(text: str, files: Path, new: Path) -> list[str]:
    """Split as a shell does, with the folders put in."""
    return [word.format(f=files, n=new) for word in shlex.split(text)]


@pytest.mark.parametrize("name", GOOD)
def test_json_is_one_object_and_nothing_else(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    text, keys = GOOD[name]
    status, out, err = call(capsys, *words(text, files, tmp_path), "--json")
    assert status == 0
    assert err == ""  # no terminal: no progress bars
    assert out.endswith("}\n")
    assert out.count("\n") == 1
    assert keys <= set(json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON")))


@pytest.mark.parametrize("name", GOOD)
def test_text_for_people(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    status, out, err = call(capsys, *words(GOOD[name][0], files, tmp_path))
    assert status == 0
    assert err == ""
    assert out.strip()
    assert "{" not in out or name == "simulate --stats"


@pytest.mark.parametrize("name", ["simulate", "generate", "analyse", "replay", "query", "avs"])
def test_quiet_prints_nothing(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    assert call(capsys, *words(GOOD[name][0], files, tmp_path), "--quiet") == (0, "", "")


def test_statistics_have_all_the_promised_keys(capsys: Capture) -> None:
    found = json.loads(call(capsys, "simulate", "--tests", 100, "--stats", "--json")[1])["distributions"]
    for quantity in ("speed", "gap", "time_gap", "range_rate", "acceleration"):
        assert {"n", "mean", "sd", "quantiles"} <= set(found[quantity])
        assert set(found[quantity]["quantiles"]) == {"1", "5", "25", "50", "75", "95", "99"}
    assert {"3", "5", "10", "20"} <= set(found["ttc_share_below"])
    assert found["lane_changes_per_mile"] >= 0.0


def test_one_test_alone_has_statistics_too(capsys: Capture) -> None:
    status, out, _ = call(capsys, "simulate", "--tests", 1, "--stats", "--json", "--threads", 1)
    assert status == 0
    assert json.loads(out)["tests"] == 1


def test_analysis_names_clusters_and_cases(files: Path, capsys: Capture) -> None:
    found = json.loads(call(capsys, "analyse", files / "library", "--json")[1])
    assert all({"id", "size", "typical"} <= set(cluster) for cluster in found["clusters"])
    assert set(found["seconds"]) >= {"features", "pca", "dbscan", "kmeans"}


def test_run_makes_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    tiny = run_module.Budget(nde_tests=200, decisions=120_000, evaluation_tests=200, exposure_tests=100, cases=12)
    monkeypatch.setitem(run_module.BUDGETS, "quick", tiny)
    command = ["run", "--budget", "quick", "--out", tmp_path / "out", "--seed", "2", "--json"]
    status, out, err = call(capsys, *command)
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert {"out", "nde", "train", "generate", "analyse", "seconds"} <= set(summary)
    assert set(summary["nde"]) >= SIMULATE
    assert set(summary["train"]) >= TRAIN - {"out"}
    assert set(summary["generate"]) >= GENERATE
    assert set(summary["analyse"]) >= ANALYSE
    for name in ("policy.safetensors", "library", "analysis", "report.html", "summary.json", "provenance.json"):
        assert (tmp_path / "out" / name).exists()
    status, out, err = call(capsys, *command, "--resume")
    assert status == 0
    assert {**json.loads(out), "seconds": 0} == {**summary, "seconds": 0}
    status, out, _ = call(capsys, *command[:-1], "--resume")
    assert "Report: " in out


def on_a_terminal(*arguments: str) -> tuple[str, str]:
    """Standard output, and what appears on standard error when that is a terminal."""
    reader, writer = os.openpty()
    command = [sys.executable, "-m", "cornerforge", *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=writer, text=True, check=True)
    os.write(writer, b"END")
    os.close(writer)
    shown = b""
    while not shown.endswith(b"END"):
        shown += os.read(reader, 65_536)
    os.close(reader)
    return done.stdout, shown.removesuffix(b"END").decode()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a POSIX terminal")
def test_a_terminal_sees_progress_with_rate_and_standard_output_stays_clean() -> None:
    command = ("simulate", "--tests", "2000", "--json")
    out, shown = on_a_terminal(*command)
    assert json.loads(out)["tests"] == 2000
    assert "simulate" in shown
    assert "2000/2000" in shown
    assert "/s" in shown
    assert on_a_terminal(*command, "--quiet")[1] == ""


def test_one_bar_serves_a_stage_whose_note_changes_and_old_work_is_no_speed() -> None:
    bars = Bars(quiet=False)
    bars.show = True
    try:
        for stage, done in (("rate (3 crashes)", 500.0), ("rate (3 crashes)", 500.0), ("rate (4 crashes)", 600.0)):
            bars(stage, done, 1000.0)
        assert bars._bars is not None
        (bar,) = bars._bars.tasks
        assert (bar.description, bar.completed, bar.total) == ("rate (4 crashes)", 600.0, 1000.0)
        assert sum(sample.completed for sample in bar._progress) == 100.0, "what the speed is made of: this session"
    finally:
        bars.stop()


# --- exit status 1 ---


def test_a_case_that_happens_differently_is_status_1(
    files: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same library, replayed by a program whose adversary is bounded, though the library's was not."""
    cases = importlib.import_module("cornerforge.pipeline.cases")
    honest = cases.experiment_of

    def other(*arguments: Any) -> Any:
        run = honest(*arguments)
        return run.__class__(**{**vars(run), "setting": run.setting.with_drivers(bounded=1)})

    monkeypatch.setattr(cases, "experiment_of", other)
    status, out, _ = call(capsys, "replay", files / "library", "all", "--check", "--json")
    assert status == 1
    found = json.loads(out)
    assert found["identical"] is False
    assert found["differ"]
    assert call(capsys, "replay", files / "library", "all", "--json")[0] == 0  # nothing compared


# --- exit status 2 ---


def newer_library(files: Path, new: Path) -> None:
    (new / "library").mkdir()
    manifest = json.loads((files / "library" / "manifest.json").read_text(encoding="utf-8"))
    (new / "library" / "manifest.json").write_text(json.dumps(manifest | {"schema_version": 99}), encoding="utf-8")


def corrupt_files(files: Path, new: Path) -> None:
    (new / "p.safetensors").write_bytes((files / "policy.safetensors").read_bytes()[:5000])
    (new / "m.npz").write_bytes((files / "library" / "model.npz").read_bytes()[:5000])
    (new / "library").mkdir()
    (new / "library" / "manifest.json").write_text('{"format": "corn', encoding="utf-8")


def something_else(_: Path, new: Path) -> None:
    (new / "thesis").mkdir()
    (new / "thesis" / "chapter1.tex").write_text("It was a dark night", encoding="utf-8")
    (new / "notes.txt").write_text("mine", encoding="utf-8")


def nothing(_: Path, __: Path) -> None:
    pass


# Name: what lies there before, the call, what the message must hold.
BAD: dict[str, tuple[Callable[[Path, Path], None], str, str]] = {
    "unknown command": (nothing, "simulat", 'simulate'),
    "no command": (nothing, "", "--help"),
    "no command below ndd": (nothing, "ndd", "ndd --help"),
    "unknown option": (nothing, "simulate --test 5", "--tests"),
    "no number": (nothing, "simulate --tests many", "--tests"),
    "missing option": (nothing, "train", "--out"),
    "missing argument": (nothing, "analyse", "LIB"),
    "unknown AV": (nothing, "simulate --av idm-mobl", 'Did you mean "idm-mobil"'),
    "unknown BV": (nothing, "simulate --bv swerv", 'Did you mean "swerve"'),
    "unknown ODD": (nothing, "simulate --odd defalt", 'Did you mean "default"'),
    "unknown budget": (nothing, "run --budget quik --out {n}/out", 'Did you mean "quick"'),
    "unknown figure": (nothing, "reproduce --figure table1 figur2 --out {n}/out", 'Did you mean "figure2"'),
    "unknown budget, reproduce": (nothing, "reproduce --budget ful --out {n}/out", 'Did you mean "full"'),
    "negative seed, reproduce": (nothing, "reproduce --seed -1 --out {n}/out", "seed = -1"),
    "no policy for figure 2": (nothing, "reproduce --paper-policy {n}/p.safetensors --out {n}/out", "p.safetensors"),
    "reproduce into something else": (something_else, "reproduce --figure table1 --out {n}/thesis", "chapter1.tex"),
    "nothing can be written, reproduce": (
        something_else, "reproduce --figure table1 --out {n}/notes.txt/o", "notes.txt",
    ),
    "unknown preset": (nothing, "train --preset papr --out {n}/p.safetensors", 'Did you mean "paper"'),
    "unknown format": (nothing, "ndd fit {f}/pairs.csv --format pears --out {n}/m.npz", 'Did you mean "pairs"'),
    "unknown case": (nothing, "replay {f}/library 0:99999", 'No case "0:99999"'),
    "no case id": (nothing, "replay {f}/library first", "first"),
    "no tests": (nothing, "simulate --tests 0", "tests = 0"),
    "no cases": (nothing, "generate --policy swerve --cases 0 --out {n}/library", "cases = 0"),
    "negative cases": (nothing, "generate --policy swerve --cases -5 --out {n}/library", "cases = -5"),
    "negative seed": (nothing, "simulate --seed -1", "seed = -1"),
    "negative seed, generate": (nothing, "generate --policy swerve --out {n}/library --seed -1", "seed = -1"),
    "negative seed, train": (nothing, "train --out {n}/p.safetensors --seed -1", "seed = -1"),
    "negative seed, run": (nothing, "run --out {n}/out --seed -1", "seed = -1"),
    "negative seed, analyse": (nothing, "analyse {f}/library --seed -1 --out {n}/analysis", "seed = -1"),
    "giant seed": (nothing, "simulate --seed 99999999999999999999", "seed = 99999999999999999999"),
    "no threads": (nothing, "generate --policy swerve --threads 0 --out {n}/library", "threads = 0"),
    "one lane": (nothing, "simulate --lanes 1", "lanes = 1"),
    "no steps": (nothing, "analyse {f}/library --steps 0", "steps = 0"),
    "endless minutes": (nothing, "train --minutes nan --out {n}/p.safetensors", "minutes = nan"),
    "strength out of range": (
        nothing, "ndd fit {f}/pairs.csv --format pairs --out {n}/m.npz --prior-strength -1", "prior_strength",
    ),
    "missing model": (nothing, "simulate --model {n}/none.npz", "none.npz"),
    "missing policy": (nothing, "generate --policy {n}/none.safetensors --out {n}/library", "none.safetensors"),
    "missing library": (nothing, "analyse {n}/none", "none"),
    "missing trajectories": (nothing, "ndd fit {n}/none.csv --format pairs --out {n}/m.npz", "none.csv"),
    "corrupt policy": (corrupt_files, "generate --policy {n}/p.safetensors --out {n}/new", "p.safetensors"),
    "corrupt policy, resumed": (corrupt_files, "train --resume --decisions 9 --out {n}/p.safetensors", "p.safetensors"),
    "corrupt model": (corrupt_files, "simulate --model {n}/m.npz", "m.npz"),
    "corrupt library": (corrupt_files, "query {n}/library 'select 1'", "manifest.json"),
    "policy for a model": (nothing, "simulate --model {f}/policy.safetensors", "policy.safetensors"),
    "model for a policy": (nothing, "simulate --bv {f}/library/model.npz", "model.npz"),
    "folder for a policy": (nothing, "simulate --bv {f}/library", "library"),
    "trajectories of another format": (nothing, "ndd fit {f}/pairs.csv --format highd --out {n}/m.npz", "pairs.csv"),
    "NaN and numbers out of range": (
        nothing, "ndd fit {f}/bad_numbers.csv --format pairs --out {n}/m.npz", "bad_numbers.csv",
    ),
    "newer library": (newer_library, "query {n}/library 'select 1'", "schema 99"),
    "newer library, analysed": (newer_library, "analyse {n}/library", "schema 99"),
    "newer library, resumed": (newer_library, "generate --policy swerve --resume --out {n}/library", "schema 99"),
    "wrong SQL": (nothing, "query {f}/library 'select nonsense from cases'", "nonsense"),
    "SQL that writes": (nothing, "query {f}/library 'create table t (i int)'", "SELECT"),
    "SQL that writes a file": (nothing, "query {f}/library \"copy cases to '{n}/x.csv'\"", "SELECT"),
    "run over something else": (something_else, "run --out {n}/thesis", "chapter1.tex"),
    "run over something else, resumed": (something_else, "run --resume --out {n}/thesis", "chapter1.tex"),
    "run into a file": (something_else, "run --out {n}/notes.txt", "notes.txt"),
    "library over something else": (something_else, "generate --policy swerve --out {n}/thesis", "chapter1.tex"),
    "library into a file": (something_else, "generate --policy swerve --out {n}/notes.txt", "notes.txt"),
    "analysis over something else": (something_else, "analyse {f}/library --out {n}/thesis", "chapter1.tex"),
    "policy over something else": (something_else, "train --out {n}/notes.txt", "notes.txt"),
    "policy onto a folder": (something_else, "train --out {n}/thesis", "thesis"),
    "model over something else": (
        something_else, "ndd fit {f}/pairs.csv --format pairs --out {n}/notes.txt", "notes.txt",
    ),
    "model onto a folder": (something_else, "ndd fit {f}/pairs.csv --format pairs --out {n}/thesis", "thesis"),
    "nothing can be written, run": (something_else, "run --out {n}/notes.txt/out", "notes.txt"),
    "nothing can be written, simulate": (something_else, "simulate --out {n}/notes.txt/library", "notes.txt"),
    "nothing can be written, train": (something_else, "train --out {n}/notes.txt/p.safetensors", "notes.txt"),
    "nothing can be written, generate": (something_else, "generate --policy swerve --out {n}/notes.txt/l", "notes.txt"),
    "nothing can be written, analyse": (something_else, "analyse {f}/library --out {n}/notes.txt/a", "notes.txt"),
    "nothing can be written, fit": (
        something_else, "ndd fit {f}/pairs.csv --format pairs --out {n}/notes.txt/m.npz", "notes.txt",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_plain_line_and_harms_nothing(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    prepare, text, message = BAD[name]
    prepare(files, tmp_path)
    before = snapshot(tmp_path), snapshot(files)
    status, out, err = call(capsys, *words(text, files, tmp_path))
    assert status == 2
    assert err.startswith("cornerforge: ")
    assert 1 <= err.count("\n") <= 2
    assert err.endswith("\n")
    assert "Traceback" not in err
    assert message in err
    assert out == "" or name.startswith("no command")  # those show the help
    assert (snapshot(tmp_path), snapshot(files)) == before


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_is_one_plain_line_and_leaves_no_half_file(files: Path, tmp_path: Path) -> None:
    import resource

    def no_file_above_1_kb() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))

    done = subprocess.run(
        [sys.executable, "-B", "-m", "cornerforge", "analyse", str(files / "library"), "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=no_file_above_1_kb,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("cornerforge: Cannot write")
    assert done.stderr.count("\n") == 1
    assert [entry.name for entry in (tmp_path / "out").iterdir()] == ["provenance.json"]


def test_bad_input_with_json_leaves_standard_output_empty(capsys: Capture) -> None:
    status, out, err = call(capsys, "simulate", "--tests", 0, "--json", "--quiet")
    assert (status, out) == (2, "")
    assert err.startswith("cornerforge: tests = 0")


def test_debug_shows_the_traceback_too(capsys: Capture) -> None:
    status, out, err = call(capsys, "simulate", "--tests", 0, "--debug")
    assert (status, out) == (2, "")
    assert err.startswith("Traceback")
    assert "InputError" in err
    assert err.splitlines()[-1].startswith("cornerforge: tests = 0")


def test_a_damaged_shard_is_a_warning_on_standard_error(files: Path, tmp_path: Path, capsys: Capture) -> None:
    library = tmp_path / "library"
    library.mkdir()
    for file in (files / "library").iterdir():
        (library / file.name).write_bytes(file.read_bytes())
    shard = library / "cases-000000.parquet"
    shard.write_bytes(shard.read_bytes()[:-100])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warnings.filters", [])  # as outside of tests, where warnings are no errors
        status, out, err = call(capsys, "query", library, "select count(*) from cases", "--json")
    assert status == 0
    assert json.loads(out)["rows"] == [[0]]
    assert err.startswith("Warning: ")
    assert "cases-000000.parquet" in err
    assert err.count("\n") == 1
