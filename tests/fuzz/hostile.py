"""Hostile words: options, output paths and SQL, as a command line gets them."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["hostile_options", "hostile_paths", "hostile_sql", "plain_commands"]

_WORLD = (
    "--av",
    "--odd",
    "--lanes",
    "--model",
    "--bounded",
    "--budget",
    "--av-timeout",
    "--av-batch",
    "--av-processes",
    "--av-python",
)
_COMMANDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "simulate": ("simulate --tests 2 --threads 1", (*_WORLD, "--tests", "--bv", "--policy", "--acting", "--stats",
    "--resume", "--config", "--seed", "--threads", "--quiet", "--json", "--out")),
    "rate": ("rate --method mc --max-tests 50 --threads 1", (*_WORLD, "--method", "--target-rhw", "--max-tests",
    "--model-draws", "--seed", "--threads", "--resume")),
    "generate": ("generate --policy lane-changer --cases 1 --out o --threads 1", (*_WORLD, "--policy", "--cases",
    "--acting", "--seed", "--threads", "--engine", "--address")),
    "analyse": ("analyse lib --out o --threads 1", ("--steps", "--avoidability", "--reaction", "--for", "--seed",
    "--threads")),
    "replay": ("replay lib 0:8", ("--check", "--picture", "--video", "--seed", "--threads", "--out")),
    "retest": ("retest lib --threads 1", ("--av", "--baseline", "--natural-tests", "--junit", "--sarif", "--page",
    "--count", "--seed", "--threads")),
    "export": ("export lib 0:8 --to csv --out o", ("--to", "--version", "--mode", "--resume", "--seed")),
    "variety": ("variety lib --threads 1", ("--policy", "--tests", "--acting", "--av", "--odd", "--lanes", "--model",
    "--budget", "--seed")),
    "shrink": ("shrink lib 0:8 --out o", ("--resume", "--av-timeout", "--av-python", "--seed")),
    "query": ('query lib "select 1"', ("--seed", "--threads", "--out")),
    "figure": ("figure lib 0:8 --out f.svg", ("--times", "--figure", "--format", "--width", "--list", "--seed")),
    "ndd show": ("ndd show", ("--model", "--out", "--seed")),
    "train": ("train --out p.safetensors --decisions 512 --tests 8 --threads 1", ("--preset", "--reward", "--delay",
    "--minutes", "--seed", "--decisions", "--tests")),
    "avs": ("avs", ("--json", "--seed", "--all")),
    "check-av": ("check-av idm-mobil", ("--av-timeout", "--av-batch", "--av-processes", "--av-python", "--seed")),
}  # fmt: skip
_WORDS = (
    "", " ", "-1", "0", "1", "2", "7", "nan", "inf", "-inf", "1e308", "1e-300", "1e3", "1" + "0" * 40, "0x10", "1_0",
    "1,5", "\u0663", "x", "true",
    "None", "null", "[]", "--", "-", "--seed", "a b", "é", "\u202e", "\n", "a\nb", "\t", "..", "/", ".", "lib", "full",
    "/dev/null",
    "/dev/zero", "default", "idm-mobil", "idm-mobi", "softmax:", "softmax:0", "softmax:nan", "softmax:-1",
    "softmax:1e999", "x.py:Y", ":", "cmd:", "cmd: ", "cmd: false",
    "x.onnx", "x.zip", "x.safetensors", "os:system", "lib/model.npz", "lib/manifest.json", "a" * 5000, "%s", "{}",
    "$HOME", "~", "~nobody/x", "\ud800", "nde,nde",
)  # fmt: skip
_MUCH = {"--tests", "--max-tests", "--cases", "--decisions", "--natural-tests", "--model-draws", "--minutes"}
"""Options that may be large and right: then the work is long, and no fault."""


def _take(rng: np.random.Generator, of: Any) -> Any:
    return of[int(rng.integers(len(of)))]


def _split(line: str) -> list[str]:
    import shlex

    return shlex.split(line)


def hostile_options(rng: np.random.Generator) -> list[str]:
    """Draw a command with one or two options that are odd."""
    line, options = _COMMANDS[_take(rng, sorted(_COMMANDS))]
    words = _split(line)
    for _ in range(1 + (rng.random() < 0.2)):
        option, word = _take(rng, options), _take(rng, _WORDS)
        if option in _MUCH and word in ("1e3", "1e308", "1_0"):
            word = "-1"
        match int(rng.integers(5)):
            case 0:
                words += [f"{option}={word}"]
            case 1:
                words += [option]
            case 2:
                at = int(rng.integers(1, len(words) + 1))
                words[at:at] = [word]
            case _:
                words += [option, word]
    return words


_PATHS = (
    "", ".", "..", "/", "/dev/null", "/dev/full", "/dev/zero/x", "/proc/x", "full", "full/file", "full/file/x", "loop",
    "loop/x", "dangling", "dangling/x",
    "fifo", "fifo/x", "lib", "lib/manifest.json", "lib/x", "a" * 300, "a/" * 200 + "x", "a" * 5000, "x\ny", "x:y",
    "-x", "~/nowhere/x", "~nobody/x", "\ud800", "x\\y", "é" * 60, " ",
    "x/", "x/.", "x//y", "x.npz", "x.safetensors", "x.html", "x.json", "x.svg", "x.csv", "x.xml", "x.parquet", ".x",
    "x.part", "con", "http://x/y", "s3://x", "file:///tmp/nowhere/x", "\t", "x\x7f",
)  # fmt: skip
_WRITERS = (
    "simulate --tests 300 --bv lane-changer --threads 1 --out",
    "generate --policy lane-changer --cases 1 --threads 1 --out", "rate --method mc --max-tests 50 --threads 1 --out",
    "analyse lib --threads 1 --out", "report lib --threads 1 --out", "replay lib 0:8 --picture",
    "replay lib 0:8 --out", "retest lib --threads 1 --junit", "retest lib --threads 1 --sarif",
    "retest lib --threads 1 --page", "retest lib --threads 1 --out", "export lib all --to csv --out",
    "export lib all --to openscenario --out", "shrink lib 0:8 --out", "query lib 'select 1' --out",
    "figure lib --out", "figure lib 0:8 --out", "init", "train --decisions 512 --tests 8 --threads 1 --out",
    "ndd show --out", "suite build lib --zoo rl --zoo idm-mobil --threads 1 --out", "variety lib --threads 1 --out",
)  # fmt: skip


def hostile_paths(rng: np.random.Generator) -> list[str]:
    """Draw a command that writes, and an odd place to write to."""
    return [*_split(_take(rng, _WRITERS)), _take(rng, _PATHS)]


_QUERIES = (
    "select * from cases", "select count(*), avg(crash_time_s) from cases group by crash_kind",
    "select case_id from cases order by 1 limit 3",
    "with a as (select * from cases) select a.* from a join cases using (case_id)", "describe cases",
    "select unnest(range(10)) from cases",
)  # fmt: skip
_PIECES = (
    ";", "--", "'", '"', "(", ")", "NaN::float", "null", "1/0", "*", "drop table cases", "copy cases to 'x.csv'",
    "read_csv('/etc/passwd')", "attach 'x.db'", "install httpfs",
    "select", "from", "'\\x00'", "\x00", "\ud800", "é", "9" * 400, "repeat('x', 1000)", "union all", "pragma version",
    "set memory_limit='1GB'", "cases", "[]", "{}", "::date", "interval 1 year",
)  # fmt: skip


def hostile_sql(rng: np.random.Generator) -> list[str]:
    """Draw a query with odd pieces."""
    words = _take(rng, _QUERIES).split(" ")
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(words) + 1))
        words[at : at + int(rng.integers(2))] = [_take(rng, _PIECES)]
    return ["query", "lib", " ".join(words), "--json"]


def plain_commands() -> list[list[str]]:
    """Every command whose options are tried, with nothing odd."""
    return [_split(line) for line, _ in _COMMANDS.values()]
