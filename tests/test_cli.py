"""The command line: what it prints where, its exit status, and what bad input leaves behind (nothing)."""

from __future__ import annotations

import importlib
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from edited_files import write_object
from folder_snapshot import snapshot
from stage_lines import LINE, without_stages

import cornerforge._kernel_cache
from cornerforge import ext
from cornerforge._jit import kernel
from cornerforge._words import few_digits
from cornerforge.adversary.config import PRESETS
from cornerforge.cli import app, main
from cornerforge.cli.output import Bars, compiling_text, run_command
from cornerforge.cli.start import _showing_once
from cornerforge.drivers.avs import AVS
from cornerforge.drivers.policy import n_weights
from cornerforge.errors import InputError
from cornerforge.experiment.policy_file import Policy, save_policy
from cornerforge.ext.calibrate.layouts import DATA_FORMATS
from cornerforge.ext.paper.bench import REPRODUCE_EFFORTS
from cornerforge.ext.paper.reproduce import ITEMS
from cornerforge.report import judged
from cornerforge.types import ODDS
from cornerforge.verbs.options import COMMANDS
from cornerforge.work.stages import Stages
from cornerforge.world_options import PLAIN_ADVERSARIES, REWARD_NAMES

run_module = importlib.import_module("cornerforge.verbs.run")

Capture = pytest.CaptureFixture[str]
shell = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a library, a policy and a trajectory file; read only."""
    folder = tmp_path_factory.mktemp("files")
    assert main(["generate", "--policy", "swerve", "--cases", "40", "--out", str(folder / "library"), "--quiet"]) == 0
    assert main(["analyse", str(folder / "library"), "--out", str(folder / "analysis"), "--quiet"]) == 0
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
    """Exit status, standard output and standard error of a call, but for the line on compiling."""
    capsys.readouterr()
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, without_stages(captured.err.replace(f"{compiling_text()}\n", ""))


# --- help ---


GROUPS = [[], ["ndd"], ["suite"], ["cases"], ["road"], ["site"]]


def all_commands() -> list[list[str]]:
    def walk(command: Any, path: list[str]) -> Iterator[list[str]]:
        yield path
        for name, child in getattr(command, "commands", {}).items():
            yield from walk(child, [*path, name])

    return list(walk(typer.main.get_command(app), []))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", all_commands(), ids=lambda path: " ".join(path) or "cornerforge")
def test_every_command_helps(command: list[str], capsys: Capture) -> None:
    status, out, err = call(capsys, *command, "--help")
    assert status == 0
    assert "Usage" in out
    assert " ," not in out  # what stands in brackets would be taken for markup, and vanish
    assert err == ""


def examples(command: Any) -> list[str]:
    """Command lines at the end of a command's help."""
    head, *lines = command.epilog.split("\n")
    assert head == ("Example:" if len(lines) == 1 else "Examples:")
    return lines


def context_of(words: list[str], *, read: bool) -> Any:
    """Typer's context of a command; with `read` the words after its name are parsed, else left out."""
    context: Any = typer.main.get_command(app).make_context("cornerforge", [], resilient_parsing=True)
    while words and words[0] in getattr(context.command, "commands", {}):
        name, *words = words
        command = context.command.commands[name]
        last = read and not hasattr(command, "commands")
        context = (
            command.make_context(name, words, parent=context)
            if last
            else type(context)(command, info_name=name, parent=context)
        )
    return context


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", all_commands(), ids=lambda path: " ".join(path) or "cornerforge")
def test_every_help_has_an_example_whose_words_are_known(
    command: list[str], capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cornerforge.toml").write_text("", encoding="utf-8")
    shown = call(capsys, *command, "--help")[1]
    lines = examples(context_of(command, read=False).command)
    assert 1 <= len(lines) <= 2
    for line in lines:
        assert line in shown, "too long for a line of help"
        first, *words = shlex.split(line)
        assert first == "cornerforge"
        assert words[: len(command)] == command
        assert context_of(words, read=True).params, "an option of it does not exist, or one is missing"


def test_the_workflow_file_calls_what_there_is() -> None:
    yaml = pytest.importorskip("yaml")
    file = Path(__file__).parents[1] / "examples" / "ci" / "retest.yml"
    steps = yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"]["retest"]["steps"]
    (line,) = (step["run"] for step in steps if step.get("run", "").startswith("cornerforge "))
    assert context_of(shlex.split(line)[1:], read=True).params["junit"] == Path("retest.xml")


def test_an_example_with_a_wrong_option_would_be_found() -> None:
    with pytest.raises(Exception, match="No such option"):
        context_of(shlex.split("simulate --test 5"), read=True)


@pytest.mark.full
def test_a_shell_completes_names_that_the_program_knows() -> None:
    def completed(command: str, option: str, begun: str = "") -> set[str]:
        context = context_of(command.split(), read=False)
        (one,) = (one for one in context.command.params if f"--{option}" in one.opts)
        return {item.value for item in one.shell_complete(context, begun)}

    assert completed("run", "effort") == set(run_module.EFFORTS)
    assert completed("reproduce", "effort") == set(REPRODUCE_EFFORTS)
    assert completed("reproduce", "figure") == set(ITEMS)
    assert completed("train", "preset") == set(PRESETS)
    assert completed("train", "reward") == set(REWARD_NAMES)
    with pytest.raises(InputError, match=f"Known: {', '.join(sorted(completed('rate', 'method')))}"):
        cornerforge.rate(method="?")
    assert completed("ndd fit", "format") == set(DATA_FORMATS)
    assert completed("generate", "policy") == set(PLAIN_ADVERSARIES)
    assert completed("simulate", "bv", "s") == {"swerve"}
    for command in ("run", "simulate", "train", "generate", "rate"):
        assert completed(command, "av") == set(AVS)
        assert completed(command, "odd") == set(ODDS)
        assert completed(command, "av", "rl") == {name for name in AVS if name.startswith("rl")}


@shell
def test_completion_works_as_a_shell_asks_for_it(tmp_path: Path) -> None:
    """The script of --show-completion, run by bash as when Tab is pressed."""
    (tmp_path / "cornerforge").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m cornerforge "$@"\n')
    (tmp_path / "cornerforge").chmod(0o755)
    pressed = (
        'eval "$(cornerforge --show-completion bash)"; COMP_WORDS=(cornerforge run --effort st); COMP_CWORD=3; '
        '_cornerforge_completion cornerforge; echo "${COMPREPLY[@]}"'
    )
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    command = ["bash", "-c", pressed]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, "PATH": path})
    assert (done.stdout, done.stderr) == ("standard\n", "")


KEPT = "interrupted; what was finished is kept: the same command with --resume goes on."


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["generate"], KEPT),
        (["analyse"], "interrupted."),
        (["ndd", "fit"], "interrupted."),
        (["rate"], "interrupted."),
        (
            ["rate", "--out", "folder"],
            KEPT,
        ),
        (["simulate"], "interrupted."),
        (
            ["simulate", "--out=folder"],
            KEPT,
        ),
        (["run"], KEPT),
    ],
)
def test_an_interrupt_promises_what_the_command_does(
    command: list[str], said: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(typer.Typer, "__call__", interrupted)
    assert call(capsys, *command, "--quiet") == (130, "", f"cornerforge: {said}\n")


def test_commands_name_functions_that_are_there() -> None:
    for told in (*COMMANDS, *ext.commands()):
        for place in (told.verb, told.says, told.fails):
            module, _, name = place.partition(":")
            assert not place or callable(getattr(importlib.import_module(f"cornerforge.{module}"), name)), place


def test_the_promised_commands_are_there() -> None:
    promised = ("run", "simulate", "train", "generate", "analyse", "replay", "query", "figure")
    below_ndd = {"ndd fit", "ndd import", "ndd show", "ndd validate"}
    assert {*promised, *below_ndd, "avs"} <= {" ".join(path) for path in all_commands()}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", [path for path in all_commands() if path not in GROUPS], ids=" ".join)
def test_every_command_takes_the_common_options(command: list[str], capsys: Capture) -> None:
    _, out, _ = call(capsys, *command, "--help")
    for option in ("--quiet", "--json", "--debug", "--out"):
        assert option in out
    assert "<bool>" not in out, "an option without a value shows none"


@pytest.mark.parametrize("command", GROUPS, ids=["cornerforge", "ndd", "suite", "cases", "road", "site"])
def test_no_command_shows_what_there_is(command: list[str], capsys: Capture) -> None:
    status, out, err = call(capsys, *command)
    assert (status, err) == (2, "")
    assert out.strip() == call(capsys, *command, "--help")[1].strip()


def test_the_version_can_be_asked_for(capsys: Capture) -> None:
    assert call(capsys, "--version") == (0, f"cornerforge {cornerforge.__version__}\n", "")


@pytest.mark.full
@pytest.mark.parametrize("command", ["replay {f}/library 0:0 --check", "query {f}/library 'select 1'", "avs"])
def test_commands_without_files_of_their_own_can_write_their_object(
    command: str, files: Path, tmp_path: Path, capsys: Capture
) -> None:
    case = call(capsys, "query", files / "library", "select min(case_id) from cases", "--json")[1]
    given = words(command.replace("0:0", json.loads(case)["rows"][0][0]), files, tmp_path)
    status, out, _ = call(capsys, *given, "--json", "--out", tmp_path / "object.json")
    assert status == 0
    assert json.loads((tmp_path / "object.json").read_text(encoding="utf-8")) == json.loads(out)


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


@pytest.mark.full
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
    "reproduce": ("reproduce --figure table1 --effort quick --out {n}/paper", {"items", "out", "page", "seconds"}),
    "query": ("query {f}/library 'select case_id, n_vehicles from cases limit 2'", {"columns", "rows"}),
    "query an analysis": ("query {f}/analysis 'select case_id, value from cases order by value limit 2'", {"rows"}),
    "figure": ("figure {f}/library 0:0 --times -1,0 --out {n}/a.pdf", {"figures"}),
    "variety": ("variety {f}/library", {"rows"}),
    "avs": ("avs", {"avs"}),
    "ndd fit": ("ndd fit {f}/pairs.csv --format pairs --out {n}/m.npz", FIT),
    "ndd show": ("ndd show", {"model_hash", "following", "free_flow", "lane_change", "initial", "counted", "figures"}),
    "ndd fit, format guessed": ("ndd fit {f}/pairs.csv --out {n}/m.npz", FIT | {"format"}),
}


def words(text: str, files: Path, new: Path) -> list[str]:
    """Split as a shell does, with the folders put in."""
    return [word.format(f=files, n=new) for word in shlex.split(text)]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", GOOD)
def test_json_is_one_object_and_nothing_else(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    text, keys = GOOD[name]
    status, out, err = call(capsys, *words(text, files, tmp_path), "--json")
    assert status == 0
    assert err == ""  # no terminal: no progress bars
    assert out.endswith("}\n")
    assert out.count("\n") == 1
    assert keys <= set(json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON")))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", GOOD)
def test_text_for_people(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    status, out, err = call(capsys, *words(GOOD[name][0], files, tmp_path))
    assert status == 0
    assert err == ""
    assert out.strip()
    assert "{" not in out or name == "simulate --stats"


@pytest.mark.sampled(1)
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


@pytest.mark.full
def test_run_makes_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    tiny = run_module.Effort(
        nde_tests=200,
        natural_tests=200,
        natural_rhw=0.3,
        decisions=120_000,
        evaluation_tests=200,
        exposure_tests=100,
        cases=12,
    )
    monkeypatch.setitem(run_module.EFFORTS, "quick", tiny)
    command = ["run", "--effort", "quick", "--out", tmp_path / "out", "--seed", "2", "--json"]
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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("run --budget quick", "--budget names a likelihood in nats; the amount of work is --effort quick."),
        ("reproduce --budget=full", "--budget names a likelihood in nats; the amount of work is --effort full."),
        ("simulate --av-sandbox", "--av-sandbox is gone since 0.2: start cornerforge itself in bubblewrap"),
        ("retest lib --av rl --sarif a.sarif", "--sarif is gone since 0.2: write JUnit XML"),
    ],
)
def test_what_is_gone_says_what_to_use(words: str, told: str, capsys: Capture) -> None:
    status, out, err = call(capsys, *words.split())
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert told in err


def test_a_config_file_that_names_what_is_gone_is_told(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "old.toml").write_text("av-sandbox = true\n", encoding="utf-8")
    status, _, err = call(capsys, "simulate", "--config", tmp_path / "old.toml")
    assert (status, err.count("\n")) == (2, 1)
    assert "av-sandbox is gone since 0.2: start cornerforge itself in bubblewrap" in err


@pytest.mark.parametrize("words", [words for words in all_commands() if words not in GROUPS], ids=" ".join)
def test_every_command_takes_a_seed_and_threads(words: list[str], capsys: Capture) -> None:
    """Scripts need not know which commands draw or compute."""
    for option in ("seed", "threads"):
        status, out, err = call(capsys, *words, f"--{option}=many")
        assert (status, out) == (2, "")
        assert option in err
        assert "No such option" not in err


def test_a_seed_changes_nothing_where_nothing_is_drawn(tmp_path: Path, capsys: Capture) -> None:
    first, second = (call(capsys, "avs", "--json", *more) for more in ((), ("--seed", "3", "--threads=2")))
    assert first == second
    assert first[0] == 0
    status, _, err = call(capsys, "init", tmp_path / "new", "--threads", "0")
    assert (status, err.count("\n")) == (2, 1)
    assert "threads = 0 is out of range" in err


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


@pytest.mark.full
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


def test_a_bar_of_slow_work_shows_more_than_a_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rich.progress.Task.speed", 0.125)
    bars = Bars(quiet=False)
    bars.show = True
    try:
        bars("simulate", 1.0, 100.0)
        assert bars._bars is not None
        assert bars._bars.tasks[0].fields["rate"] == "0.12/s"
    finally:
        bars.stop()


def test_stages_are_told_in_lines_where_no_terminal_shows_bars(files: Path, tmp_path: Path, capsys: Capture) -> None:
    """A line for each stage of a long command on standard error; the object on standard output is alone."""
    capsys.readouterr()
    asked = ["analyse", str(files / "library"), "--out", str(tmp_path / "a"), "--json"]
    assert main(asked) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["clusters"]
    assert [found[:3] for found in LINE.findall(said.err)] == [("1", "", "analyse"), ("2", "", "judge")]
    assert without_stages(said.err) == ""
    assert main([*asked, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_stages_of_a_run_are_numbered(tmp_path: Path, capsys: Capture) -> None:
    """Those too that are there already."""
    bars = Bars(quiet=False, lines=True)
    for _ in range(2):
        once = Stages(tmp_path, bars, of=3).do

        def work(name: str) -> Named:
            bars(name, 1.0, 1.0)
            return Named(name)

        assert [once(name, Named, partial(work, name)).name for name in ("one", "two")] == ["one", "two"]
    bars.stop(finished=True)
    said = LINE.findall(capsys.readouterr().err)
    assert [found[:3] for found in said] == [("1", "3", "one"), ("2", "3", "two")]
    assert said[0][4] == "two"


@dataclass(frozen=True)
class Named:
    name: str


LINES = {
    "generate": ("generate --policy swerve --cases 3 --out {n}/l", ["generate"]),
    "report": ("report {f}/library --out {n}/page --avoidability 3", ["analyse", "judge", "report"]),
    "rate": ("rate --method mc --max-tests 100", ["rate"]),
    "train": ("train --decisions 4096 --tests 64 --out {n}/p.safetensors", ["train", "evaluate"]),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", LINES)
def test_long_commands_tell_their_stages(name: str, files: Path, tmp_path: Path, capsys: Capture) -> None:
    text, stages = LINES[name]
    capsys.readouterr()
    main(words(text, files, tmp_path))
    said = LINE.findall(capsys.readouterr().err)
    assert [found[2] for found in said][: len(stages)] == stages
    assert [found[0] for found in said] == [str(number + 1) for number in range(len(said))]


def test_short_commands_tell_no_stages(files: Path, tmp_path: Path, capsys: Capture) -> None:
    capsys.readouterr()
    assert main(words("shrink {f}/library --cases 1 --out {n}/s", files, tmp_path)) in (0, 2)
    assert not LINE.findall(capsys.readouterr().err)


def test_lines_say_time_part_and_name(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """What passes before the first report of a stage belongs to it, and a stage that was stopped is not told.

    A long stage says every minute how far it is.
    """
    now = 0.0
    monkeypatch.setattr("cornerforge.cli.output.time.monotonic", lambda: now)
    bars = Bars(quiet=False, lines=True)
    now = 2.0
    bars.begin_part(3, 7, "training")
    now = 3.0
    bars.tell()  # too early
    for moment, done in ((4.0, 0.0), (40.0, 1.0), (62.0, 2.5), (100.0, 5.0), (122.0, 5.0)):
        now = moment
        bars(f"train ({done})", done, 10.0)
    now = 183.0
    bars.tell()  # nothing was reported since
    now = 202.0
    bars.begin_part(4, 7, "yield")
    bars("evaluate", 1.0, 10.0)
    now = 218.0
    bars("judge", 1.0, 10.0)
    bars.begin_part(5, 7, "cases")
    now = 290.0
    bars.tell()  # nothing was reported of this stage yet
    bars.stop()
    assert capsys.readouterr().err == (
        "stage 3 of 7: train, 25 % after 60 s, about 3 min left\n"
        "stage 3 of 7: train, 50 % after 2 min, about 2 min left\n"
        "stage 3 of 7: train, 50 % after 3 min, about 3 min left\n"
        "stage 3 of 7: train, 200 s; next: yield\nstage 4 of 7: evaluate, 16 s\n"
        "stage 4 of 7: judge, 0.0 s; next: cases\n"
        "stage 5 of 7: cases, after 72 s\n"
    )


def test_compiling_is_said_without_a_terminal_too(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One line on standard error, whatever is compiled; none with --quiet; another where nothing can be kept."""
    monkeypatch.setattr(cornerforge._kernel_cache, "cache_folder", lambda: "")

    @kernel
    def two(values: Any) -> float:
        return values[0] + values[1]

    @dataclass
    class Sum:
        sum: float

    def work(_: object, __: object) -> Sum:
        return Sum(two(np.ones(2, kinds.pop())))

    kinds = [np.int64, np.int32, np.int16, np.int8]
    run_command(work, str, as_json=True, quiet=False)
    run_command(work, str, as_json=True, quiet=True)
    captured = capsys.readouterr()
    assert captured.out == '{"sum": 2}\n' * 2
    assert captured.err.count("\n") == 1
    assert "NUMBA_CACHE_DIR" in captured.err
    monkeypatch.setattr(cornerforge._kernel_cache, "cache_folder", lambda: str(tmp_path))
    run_command(work, str, as_json=False, quiet=False)
    assert "then it is kept" in capsys.readouterr().err


def test_a_slow_speed_keeps_its_digits() -> None:
    assert [few_digits(speed) for speed in (40337.4, 12.3, 0.4321, 0.0)] == ["40,337", "12", "0.43", "0"]


# --- exit status 1 ---


@pytest.mark.full
def test_a_case_that_happens_differently_is_status_1(
    files: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same library, replayed by a program whose adversary is bounded, though the library's was not."""
    cases = importlib.import_module("cornerforge.verbs.cases")
    honest = cases.experiment_of

    def other(*arguments: Any, **asked: Any) -> Any:
        run = honest(*arguments, **asked)
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
    write_object(new / "library" / "manifest.json", manifest | {"schema_version": 99})


def corrupt_files(files: Path, new: Path) -> None:
    (new / "p.safetensors").write_bytes((files / "policy.safetensors").read_bytes()[:5000])
    (new / "m.npz").write_bytes((files / "library" / "model.npz").read_bytes()[:5000])
    (new / "library").mkdir()
    (new / "library" / "manifest.json").write_text('{"format": "corn', encoding="utf-8")


def something_else(_: Path, new: Path) -> None:
    (new / "thesis").mkdir()
    (new / "thesis" / "chapter1.tex").write_text("It was a dark night", encoding="utf-8")
    (new / "notes.txt").write_text("mine", encoding="utf-8")


def a_run(_: Path, new: Path) -> None:
    (new / "run" / "library").mkdir(parents=True)
    (new / "run" / "analysis").mkdir()


def nothing(_: Path, __: Path) -> None:
    pass


# Name: what lies there before, the call, what the message must hold.
BAD: dict[str, tuple[Callable[[Path, Path], None], str, str]] = {
    "unknown command": (nothing, "simulat", 'simulate'),
    "unknown option": (nothing, "simulate --test 5", "--tests"),
    "no number": (nothing, "simulate --tests many", "--tests"),
    "missing option": (nothing, "train", "--out"),
    "missing argument": (nothing, "analyse", "LIB"),
    "unknown AV": (nothing, "simulate --av idm-mobl", 'Did you mean "idm-mobil"'),
    "unknown BV": (nothing, "simulate --bv swerv", 'Did you mean "swerve"'),
    "unknown ODD": (nothing, "simulate --odd defalt", 'Did you mean "default"'),
    "a budget that is no number": (nothing, "run --budget quik --out {n}/out", "--budget"),
    "unknown effort": (nothing, "run --effort quik --out {n}/out", 'Did you mean "quick"'),
    "unknown effort, reproduce": (nothing, "reproduce --effort ful --out {n}/out", 'Did you mean "full"'),
    "negative budget": (nothing, "run --budget -3 --out {n}/out", "budget = -3"),
    "unknown figure": (nothing, "reproduce --figure table1 figur2 --out {n}/out", 'Did you mean "figure2"'),
    "negative seed, reproduce": (nothing, "reproduce --seed -1 --out {n}/out", "seed = -1"),
    "no policy for figure 2": (nothing, "reproduce --paper-policy {n}/p.safetensors --out {n}/out", "p.safetensors"),
    "reproduce into something else": (something_else, "reproduce --figure table1 --out {n}/thesis", "chapter1.tex"),
    "nothing can be written, reproduce": (
        something_else, "reproduce --figure table1 --out {n}/notes.txt/o", "notes.txt",
    ),
    "unknown preset": (nothing, "train --preset papr --out {n}/p.safetensors", 'Did you mean "paper"'),
    "unknown format": (nothing, "ndd fit {f}/pairs.csv --format pears --out {n}/m.npz", 'Did you mean "pairs"'),
    "unknown case": (nothing, "replay {f}/library 0:99999", 'No case "0:99999"'),
    "idle lanes": (nothing, "variety {f}/library --lanes 0", "lanes = 0"),
    "idle AV": (nothing, "variety {f}/library --av rl", "av = 'rl'"),
    "idle threads": (nothing, "avs --threads 0", "threads = 0"),
    "idle seed": (nothing, "query {f}/library 'select 1' --seed -1", "seed = -1"),
    "nothing to resume, simulate": (nothing, "simulate --tests 10 --resume", "--out"),
    "nothing to resume, rate": (nothing, "rate --max-tests 10 --resume", "--out"),
    "time for an answer": (nothing, "check-av no_such:Av --av-timeout nan", "av_timeout = nan"),
    "endless time for an answer": (nothing, "check-av no_such:Av --av-timeout 1e308", "av_timeout = 1e+308"),
    "time of a built-in AV": (nothing, "simulate --tests 10 --av-timeout -1", "av_timeout = -1"),
    "an AV file without its ending": (nothing, "train-av --decisions 600 --out {n}/my_av", ".safetensors"),
    "the root as a file": (nothing, "train --decisions 600 --out /", "/ is a folder"),
    "a run instead of a library": (a_run, "query {n}/run 'select 1'", "run/library or "),
    "neither library nor analysis": (something_else, "query {n}/thesis 'select 1'", "no case library"),
    "a file that is there, query": (something_else, "query {f}/library 'select 1' --out {n}/notes.txt", "notes.txt"),
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


@pytest.mark.sampled(6)
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
    assert out == ""
    assert (snapshot(tmp_path), snapshot(files)) == before


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_is_one_plain_line_and_leaves_no_half_file(files: Path, tmp_path: Path) -> None:
    import resource

    def no_file_above_4_kb() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    done = subprocess.run(
        [sys.executable, "-B", "-m", "cornerforge", "analyse", str(files / "library"), "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=no_file_above_4_kb,
    )
    assert (done.returncode, done.stdout) == (2, "")
    told = [line for line in done.stderr.splitlines() if not line.startswith("stage ")]
    assert len(told) == 1
    assert told[0].startswith("cornerforge: Cannot write")
    left = {entry.name for entry in (tmp_path / "out").iterdir()}
    assert "provenance.json" in left
    assert "analysis.json" not in left, "it is written last"
    assert not [name for name in left if name.startswith(".")], "parts, or a lock"


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


# --- streams that are closed, words that are no text, interrupts ---


def in_a_shell(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What a shell makes of a line, with `cornerforge` for this one."""
    line = text.replace("cornerforge", f"{shlex.quote(sys.executable)} -m cornerforge")
    return subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False, cwd=folder)


@pytest.mark.full
@shell
@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("avs 2>&-", 0), ("avs >&-", 0), ("avs >&- 2>&- <&-", 0), ("avs --threads 0 2>&-", 2),
        ("simulate --tests 20 --out library >&- 2>&-", 0),
    ],
)  # fmt: skip
def test_a_closed_stream_is_no_failed_gate(line: str, status: int, tmp_path: Path) -> None:
    """What would be printed there goes nowhere, least of all into a file that got the stream's number."""
    done = in_a_shell(f"cornerforge {line}", tmp_path)
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    for file in tmp_path.glob("library/*.json"):
        json.loads(file.read_text(encoding="utf-8"))


@pytest.mark.full
@shell
@pytest.mark.parametrize("line", ["avs", "--help", "avs --json", "no-such-command 2>&1"])
def test_a_reader_that_leaves_ends_it_as_it_ends_other_programs(line: str, tmp_path: Path) -> None:
    """141, 128 + SIGPIPE, without a word; 1 would be a failed gate."""
    done = in_a_shell(f"exec 3>status; (sleep 0.5; cornerforge {line}; echo $? >&3) | true", tmp_path)
    assert (tmp_path / "status").read_text().split() == ["141"]
    assert done.stderr == ""


def test_a_name_that_is_no_text_is_refused_before_the_work(tmp_path: Path, capsys: Capture) -> None:
    status, out, err = call(capsys, "simulate", "--tests", 50, "--out", f"{tmp_path}/l\udcff")
    assert (status, out) == (2, "")
    assert "\\udcff" in err
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="no UTF-8"):
        cornerforge.rate(max_tests=50, out=f"{tmp_path}/l\udcff")
    with pytest.raises(InputError, match="no UTF-8"):
        cornerforge.train(decisions=600, out=f"{tmp_path}/l\udcff.safetensors")


def test_a_file_that_ends_early_is_no_interrupt(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Typer takes the one for the other."""

    def cut_off(*_: object, **__: object) -> dict[str, Any]:
        raise EOFError("Ran out of input")

    monkeypatch.setattr("cornerforge.verbs.avs.avs", cut_off)
    with pytest.raises(EOFError, match="Ran out"):
        call(capsys, "avs")


@pytest.mark.full
@shell
def test_a_query_can_be_interrupted(files: Path, tmp_path: Path) -> None:
    """DuckDB reports Ctrl-C as an error of its own."""
    endless = "select count(*) from range(100000000000) t(i), cases where i % 7 = crash_time_s"
    command = [sys.executable, "-c", INTERRUPTED, "query", str(files / "library"), endless]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cornerforge: interrupted.\n")


INTERRUPTED = """
import os, signal, sys, threading
from cornerforge.cli import main
from cornerforge.library import query, store
honest = query.run_sql
def soon(*arguments, **limits):
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    return honest(*arguments, **limits)
store.run_sql = soon
sys.exit(main())
"""


# --- places with odd names ---


@pytest.mark.full
def test_a_path_means_the_same_to_all_who_write(
    files: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A colon makes no address of it, and ~ in quotes is a folder of that name: expanding it is the shell's part."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    names = {"analysis.json", "cases.parquet", "points.parquet", "provenance.json", "witnesses.parquet"}
    for place in ("an-2026-11-22T10:30", "~/an"):
        assert call(capsys, "analyse", files / "library", "--out", place)[0] == 0
        assert {path.name for path in (tmp_path / place).iterdir()} == names
        assert call(capsys, "query", place, "select count(*) from cases")[1] == "count_star()\n40\n"
        assert len(judged.read_table(Path(place) / "cases.parquet", ["case_id"], "analyse")["case_id"]) == 40
    trajectories = Path("~") / "pairs:1.csv"
    trajectories.write_bytes((files / "pairs.csv").read_bytes())
    assert call(capsys, "ndd", "fit", trajectories, "--out", "~/m:1.npz", "--quiet")[0] == 0
    assert not list((tmp_path / "home").iterdir())


@pytest.mark.full
def test_a_run_into_a_place_with_a_colon_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    tiny = run_module.Effort(
        nde_tests=200,
        natural_tests=200,
        natural_rhw=0.3,
        decisions=60_000,
        evaluation_tests=200,
        exposure_tests=100,
        cases=8,
    )
    monkeypatch.setitem(run_module.EFFORTS, "quick", tiny)
    monkeypatch.chdir(tmp_path)
    assert call(capsys, "run", "--out", "run-2026-11-22T10:30", "--quiet") == (0, "", "")
    assert call(capsys, "run", "--out", "run-2026-11-22T10:30", "--quiet", "--resume") == (0, "", "")
    assert Path("run-2026-11-22T10:30/report.html").stat().st_size > 100_000


def test_a_warning_is_shown_once(capsys: Capture) -> None:
    show = _showing_once()
    for text in ("Road: far.", "Road: far.", "Traffic is dense."):
        show(UserWarning(text), UserWarning, "file.py", 1)
    assert capsys.readouterr().err == "Warning: Road: far.\nWarning: Traffic is dense.\n"
