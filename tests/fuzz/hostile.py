"""Hostile words: output paths and SQL, as a command line gets them; options have a module of their own."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

__all__ = ["hostile_av", "hostile_av_files", "hostile_paths", "hostile_sql", "plain_av", "plain_path"]


def _take(rng: np.random.Generator, of: Any) -> Any:
    return of[int(rng.integers(len(of)))]


def _split(line: str) -> list[str]:
    import shlex

    return shlex.split(line)


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
    "replay lib 0:8 --out", "retest lib --threads 1 --junit",
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


_PLACES = ("act", "setup", "__init__", "import")


@functools.cache
def hostile_av_files() -> dict[str, str]:
    """Give modules whose class `Av` does what no AV should, by file name."""
    from foreign.hostile_avs import FAULTS, HANGS, HARMLESS, module

    codes = [*HARMLESS.values(), *(code for code, _ in FAULTS.values()), *HANGS.values()]
    return {"plain.py": module("pass", "act")} | {
        f"hostile_{k}_{n}.py": module(code, place) for k, code in enumerate(codes) for n, place in enumerate(_PLACES)
    }


def hostile_av(rng: np.random.Generator) -> list[str]:
    """Draw a command that drives with such an AV."""
    name = _take(rng, sorted(hostile_av_files())).removesuffix(".py")
    command = _take(rng, (
        "simulate --tests 8", "simulate --tests 8 --out sim", "retest lib", "check-av",
        "generate --policy lane-changer --cases 1 --out o",
    ))  # fmt: skip
    words = _split(f"{command} --av {name}:Av --av-timeout 1 --av-memory 1 --json")
    return words if words[0] == "check-av" else [*words, "--threads", "1"]


def plain_av(words: list[str]) -> list[str]:
    """A drawn command with an AV that only brakes."""
    return ["plain:Av" if word.endswith(":Av") else word for word in words]


def plain_path(words: list[str]) -> list[str]:
    """A drawn command with a place that is right."""
    return [*words[:-1], "plain" if not words[0].startswith(("replay", "train", "figure")) else "plain.svg"]
