"""Kinds of input: which seed is damaged where, and the doors through which the program reads it.

A door is a command line, run by `cornerforge.cli.main` as the program does, or a reader of the library, called as the
program calls it. A command line works in the folder of the input; the paths in it are relative.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.cached import with_cache
from fuzz.calls import hostile_call, plain_call
from fuzz.damage import Recipe, could_notice, drawn
from fuzz.hostile import hostile_av, hostile_paths, hostile_sql, plain_av, plain_path
from fuzz.options import hostile_options, plain_options

__all__ = ["CONTROL", "KINDS", "Door", "Kind", "draw_input"]

Answer = Any
"""What a door gives: comparable by its text as JSON."""


@dataclass(frozen=True)
class Door:
    """A way to read.

    Attributes:
        name: Of the door.
        argv: The command line, or a function without arguments that reads from the working directory.
        share: How often it is taken, beside the kind's other doors.
        free: Patterns of file, damage and column or array ("lib place.*") that it need not tell: it makes anew what it
            misses, or leaves values to a later reader.
        unread: Patterns of files that it does not read.
    """

    name: str
    argv: str | Callable[[], Answer]
    share: float = 1.0
    free: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes:
        name: Of the kind.
        row: The row of the table (that of the first measurement) in which it is counted.
        seed: The seed that is damaged.
        files: Patterns of the files and folders that are damaged.
        doors: Ways to read it.
        share: How many of 1,000 inputs are of it.
        free: Patterns of places in documents ("name.of.key") that no reader could doubt: free text, times, names; after
            an @ of damage ("@place.*") that leaves what may be meant so; or of a file, as those of a door.
        words: Draws the words of a command line instead of damage.
        plain: Makes of these words ones with nothing odd, which are tried first: what is slow only once, such as
            compiling, shall not look like a hang.
        waits: A pipe may be meant (`--config <(...)`), and waiting for its writer is right: none is put there.
    """

    name: str
    row: str
    seed: str
    files: tuple[str, ...]
    doors: tuple[Door, ...]
    share: float
    free: tuple[str, ...] = ()
    words: Callable[[np.random.Generator], list[str]] | None = None
    plain: Callable[[list[str]], list[str]] | None = None
    waits: bool = False

    def matters(self, recipe: Recipe, door: Door) -> bool:
        """Tell whether a reader of this kind could notice the damage, and need tell it."""
        keys = (
            [*recipe["path"][:-1], "surplus"]
            if recipe["op"] == "json.add" and "path" in recipe
            else recipe.get("path", ())
        )
        at = ".".join(str(key) for key in keys)
        where = f"{recipe['file']} {recipe['op']} {recipe.get('column', recipe.get('array', at))}".strip()
        place = at or f"@{recipe['op']}"
        if "*" in door.free or any(fnmatch(recipe["file"], one) for one in door.unread):
            return False
        if recipe.get("checked"):
            return could_notice(recipe)
        free = any(fnmatch(name, one) for name in (where, place) for one in (*door.free, *self.free))
        return could_notice(recipe) and not free


# --- Readers called by themselves: fast ---


def _digest(*values: Any) -> str:
    found = hashlib.sha256()
    for value in values:
        found.update(np.ascontiguousarray(value).tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return found.hexdigest()


def _model() -> Answer:
    from cornerforge.ndd.model import load_model, model_hash

    return model_hash(load_model(Path("m.npz")))


def _policy() -> Answer:
    from cornerforge.experiment.policy_file import load_policy, policy_hash

    policy = load_policy(Path("p.safetensors"))
    return [policy_hash(policy), dict(policy.about)]


def _av() -> Answer:
    from cornerforge.drivers.avs import av_hash
    from cornerforge.experiment.av_file import load_av

    return av_hash(load_av(Path("a.safetensors")))


def _checkpoint() -> Answer:
    from fuzz.parts import parts_of

    from cornerforge.adversary.checkpoint import CheckpointFile

    path = Path("p.safetensors.checkpoint")
    seed = parts_of(Path("whole.safetensors"))
    (header,) = seed.documents.values()
    state = CheckpointFile(path, header["identity"]).read()
    if state is None:
        return None
    return [_digest(*state.arrays.values()), sorted(state.arrays), state.values]


def _library(folder: str = "lib") -> Callable[[], Answer]:
    def read() -> Answer:
        from cornerforge.library import CaseLibrary

        library = CaseLibrary.open(folder)
        cases = library.scalars().to_pylist()
        ids, history = library.history()
        stored = [
            (s.scenario.x, s.scenario.speed, s.scenario.action, repr(s.script))
            for s in library.scenarios([c["case_id"] for c in cases])
        ]
        return [
            cases,
            ids,
            _digest(history, *(part for one in stored for part in one)),
            library.damaged,
            str(library.identity),
            library.tests,
        ]

    return read


def _decisions(*names: str, layout: str | None = None) -> Callable[[], Answer]:
    def read() -> Answer:
        from cornerforge.ext.calibrate.readers import read_decisions

        found = read_decisions([Path(name) for name in names], layout)
        return [[_digest(*vars(r.decisions).values()), repr(r.table.bad), r.table.rows_read, r.notes] for r in found]

    return read


def _traffic(*names: str) -> Callable[[], Answer]:
    def read() -> Answer:
        from cornerforge.ext.interchange.recorded_traffic import read_traffic

        return _digest(repr(read_traffic([Path(name) for name in names])))

    return read


def _moving(reader: str, name: str) -> Callable[[], Answer]:
    def read() -> Answer:
        import importlib

        read_one = getattr(
            importlib.import_module(f"cornerforge.ext.interchange.{reader}"),
            reader if reader != "tables" else "read_table",
        )
        case = read_one(Path(name))
        return _digest(*(repr(v) if not isinstance(v, np.ndarray) else v for v in vars(case).values()))

    return read


def _read_case() -> Answer:
    from cornerforge import read_case_file
    from cornerforge.library.case_file import case_text

    return case_text(read_case_file("imported/cases/cut_in.json"))


def _snapshot() -> Answer:
    from cornerforge._files import read_bytes, reason
    from cornerforge.errors import FileFormatError
    from cornerforge.sim.snapshot import packed, unpacked

    try:
        content = read_bytes(Path("w.world"))
    except OSError as error:  # who calls it reads the file
        raise FileFormatError(f"w.world {reason(error)}") from error
    return _digest(packed(unpacked(content)))


def _exhibit(place: str) -> Callable[[], Answer]:
    """What `serve` reads before it listens, and its first answers."""

    def read() -> Answer:
        import importlib

        verb = importlib.import_module("cornerforge.ext.explorer.serve")
        from cornerforge._files import real_path
        from cornerforge.ext.explorer.driving import Driving
        from cornerforge.ext.explorer.exhibit import Exhibit

        given = real_path(Path(place))
        found = verb._sources(given)
        told = verb._warnings(given, found)
        for line in told:
            warnings.warn(line, stacklevel=1)
        driving = Driving((), found[0].source)
        with_closing = Exhibit("x", [(one.source, one.analysis) for one in found], driving, told)
        try:
            return json.loads(json.dumps([with_closing.about(), told], default=repr))
        finally:
            with_closing.close()

    return read


# --- Readers that fail on purpose, for the test of the judge ---


def _hangs() -> Answer:
    while _damaged():
        pass


def _leaves() -> Answer:
    if _damaged():
        Path(".c.json.part").write_text("", encoding="utf-8")


def _raises() -> Answer:
    if _damaged():
        raise ZeroDivisionError("on purpose")


def _dies() -> Answer:
    if _damaged():
        os.kill(os.getpid(), signal.SIGSEGV)


def _damaged() -> bool:
    return "such" in Path("c.toml").read_text(encoding="utf-8")


CONTROL = Kind(
    "control", "", "config", ("c.toml",),
    (Door("believes", _damaged), Door("hangs", _hangs), Door("leaves", _leaves), Door("raises", _raises), Door("dies",
    _dies)), 0,
)  # fmt: skip


# --- The kinds ---

_ONE = "--threads 1 --json"
_LICENCE = ("*/model.npz place.missing",)
"""The model tells the licence, if it is there."""
_LIBRARY_DOORS = (
    Door("read", _library(), 60, unread=("lib/provenance.json", "lib/model.npz")),
    Door("replay", "replay lib all --check --json", 3),
    Door("query", 'query lib "select * from cases" --json', 0.7),
    Door("analyse", f"analyse lib --out an {_ONE}", 3),
    Door("report", f"report lib --out page {_ONE}", 0.6),
    Door("openscenario", "export lib all --to openscenario --out x --json", 1, _LICENCE),
    Door("commonroad", "export lib all --to commonroad --out x --json", 1, _LICENCE),
    Door("csv", "export lib all --to csv --out x --json", 1, _LICENCE),
    Door("parquet", "export lib all --to parquet --out x --json", 1, _LICENCE),
    Door("retest", f"retest lib --av idm-mobil {_ONE}", 2),
    Door("variety", f"variety lib {_ONE}", 2),
    Door("shrink", "shrink lib 0:8 --out shr --json", 0.3),
    Door("resume", f"generate --policy lane-changer --cases 6 --out lib --resume {_ONE}", 1, ("lib place.*",)),
    Door("suite", f"suite build lib --out suite --zoo idm-mobil --zoo rl {_ONE}", 0.5),
    Door("serve", _exhibit("lib"), 0.5),
)
KINDS = (
    Kind("model", "model files", "model", ("m.npz",), (
        Door("read", _model, 20), Door("simulate", f"simulate --tests 2 --model m.npz {_ONE}"),
        Door("show", f"ndd show m.npz {_ONE}"),
    ), 90),
    Kind("policy", "policies and AV files", "policy", ("p.safetensors",), (
        Door("read", _policy, 20), Door("simulate", f"simulate --tests 8 --bv p.safetensors {_ONE}"),
        Door("softmax", f"simulate --tests 8 --bv p.safetensors --acting softmax:1 {_ONE}"),
    ), 120),
    Kind("av", "policies and AV files", "av", ("a.safetensors",), (
        Door("read", _av, 20), Door("simulate", f"simulate --tests 8 --av a.safetensors {_ONE}"),
    ), 90),
    Kind("checkpoint", "checkpoints and snapshots", "checkpoint", ("p.safetensors.checkpoint",), (
        Door("read", _checkpoint, 6, ("* place.missing", "* place.dangling", "* place.loop")),
        Door("resume", f"train --out p.safetensors --decisions 2048 --tests 20 --resume {_ONE}", 0.5),
    ), 15),
    Kind("snapshot", "checkpoints and snapshots", "snapshot", ("w.world",), (Door("read", _snapshot),), 80),
    Kind("library", "library", "library", ("lib", "lib/*"), _LIBRARY_DOORS, 180),
    Kind("scripted library", "library", "case-file", ("imported/library/*",), (
        Door("read", _library("imported/library"), 20, unread=("*/provenance.json", "*/model.npz")),
        Door("replay", "replay imported/library all --check --json", 2),
        Door("analyse", f"analyse imported/library --out an {_ONE}", 2),
        Door("retest", f"retest imported/library --av idm-mobil {_ONE}", 1),
        Door("openscenario", "export imported/library all --to openscenario --out x --json", 1, _LICENCE),
    ), 80),
    Kind("analysis", "folders", "analysed", ("lib-analysis", "lib-analysis/*"), (
        Door("query", 'query lib-analysis "select * from cases" --json', 2, (),
        ("*/provenance.json", "*/points.parquet", "*/witnesses.parquet")),
        Door("serve", _exhibit("lib"), 3,
        free=("*",)),
        Door("figure", "figure lib --out f --json", 0.03),
        Door("again", f"analyse lib --out lib-analysis {_ONE}", 1, free=("*",)),
    ), 35),
    Kind("rate folder", "folders", "rate", ("rate", "rate/*", "rate/library/*"), (
        Door("resume", f"rate --method mc --max-tests 300 --av flawed-not-behind --out rate --resume {_ONE}", 2,
        ("rate place.*", "rate/library* place.*"), ("rate/rate.json", "rate/library/model.npz")),  # written again
        Door("report", f"report rate --out page {_ONE}", 0.2), Door("serve", _exhibit("rate"), 4),
    ), 30),
    Kind("trees folder", "folders", "trees", ("rate", "rate/*", "rate/trees", "rate/trees/*", "rate/weighted/*"), (
        Door("resume", f"rate --method splitting --max-tests 6000 --av flawed-not-behind --out rate --resume {_ONE}",
        1, (), ("rate/rate.json",)),
        Door("report", f"report rate --out page {_ONE}", 0.1), Door("serve", _exhibit("rate"), 4),
        Door("replay", "replay rate/weighted all --check --json", 0.1),
    ), 14),
    Kind("run folder", "folders", "run", ("run", "run/*", "run/*/*"), (
        Door("resume", f"run --effort quick --seed 2 --av flawed-not-behind --out run --resume {_ONE}", 0.4,
        ("* place.missing", "* place.dangling", "run place.folder", "run/library place.folder",
        "run/*analysis place.folder"),
        ("run/exposure.json", "run/summary.json")),  # which it writes again
        Door("report", f"report run {_ONE}", 1, ("run/report.html place.*",)),  # which it writes
        Door("serve", _exhibit("run"), 4,
        ("run/*analysis place.*", "run/*analysis/* place.*", "run/*provenance.json *", "run/stages*"),
        ("run/*analysis/provenance.json",)),  # it analyses anew
    ), 24),
    Kind("suite", "folders", "suite", ("suite", "suite/*"), (
        Door("retest", f"retest suite --av idm-mobil {_ONE}"), Door("read", _library("suite"), 3),
    ), 20),
    Kind("ngsim", "trajectories", "tracks", ("ngsim.csv",), (Door("read", _decisions("ngsim.csv"), 10), Door("scene",
    _traffic("ngsim.csv"), 2), Door("cases", f"cases from-data ngsim.csv --out x {_ONE}", 0.1)), 60),
    Kind("clips", "trajectories", "tracks", ("clips.csv",), (Door("read", _decisions("clips.csv"), 10), Door("scene",
    _traffic("clips.csv"), 2), Door("cases", f"cases from-data clips.csv --out x {_ONE}", 0.1)), 60),
    Kind("tgsim", "trajectories", "tracks", ("tgsim.csv",), (Door("read", _decisions("tgsim.csv"), 6), Door("scene",
    _traffic("tgsim.csv"), 2)), 60),
    Kind("highd", "trajectories", "tracks", ("01_*.csv",), (Door("read", _decisions("01_tracks.csv"), 6), Door("scene",
    _traffic("01_tracks.csv"), 2)), 60, ("*Meta.csv place.missing",)),  # it may be missing
    Kind("pairs", "trajectories", "tracks", ("pairs.csv",), (Door("read", _decisions("pairs.csv"), 6), Door("fit",
    f"ndd fit pairs.csv --out new.npz {_ONE}", 0.05)), 60),
    Kind("leaders", "trajectories", "tracks", ("leaders.csv",), (Door("read", _decisions("leaders.csv")),), 60),
    Kind("ivbss", "IVBSS arrays", "ivbss", ("NDD_DATA", "NDD_DATA/*", "NDD_DATA/*/*"), (Door("import",
    f"ndd import NDD_DATA --out new.npz {_ONE}"),), 2, ("@place.*", "* array.dtype*", "* array.add*",
    # The two may be missing, and what holds no change is not used; what does not sum to 1 is counted in the answer.
    "* array.drop shape", "* array.shape shape", "* array.drop fill_value", "* array.shape fill_value",
    "* array.cell data")),
    Kind("osi", "scenarios of other tools", "scenarios", ("traces/*",), (
        Door("read", _moving("read_osi", "traces/cut_in.osi"), 8), Door("import",
        "import traces/cut_in.osi --out x --json", 0.4),
    ), 130, ("*.xodr place.*",)),  # without its road, lanes are those of the traffic
    Kind("mcap", "scenarios of other tools", "scenarios", ("mcap/*",), (
        Door("read", _moving("read_osi", "mcap/case-0-8.mcap")),
    ), 20, ("*.xodr place.*",)),
    Kind("commonroad", "scenarios of other tools", "scenarios", ("commonroad/*.xml",), (
        Door("read", _moving("read_commonroad", "commonroad/case-0-8.xml"), 8), Door("import",
        "import commonroad/case-0-8.xml --out x --json", 0.4),
    ), 35),
    Kind("csv cases", "scenarios of other tools", "scenarios", ("csv/*.csv",), (
        Door("read", _moving("tables", "csv/case-0-8.csv"), 8), Door("import",
        "import csv/case-0-8.csv --out x --json", 0.4),
    ), 60),
    Kind("parquet cases", "scenarios of other tools", "scenarios", ("parquet/*.parquet",), (
        Door("read", _moving("tables", "parquet/case-0-8.parquet"), 8), Door("import",
        "import parquet/case-0-8.parquet --out x --json", 0.4),
    ), 60, ("* table.add *", "* table.type *", "* table.less *")),  # people write them: no checksums, any type
    Kind("case file", "case files", "case-file", ("imported/cases", "imported/cases/*.json"), (
        Door("read", _read_case, 12), Door("retest", f"retest imported/cases --av idm-mobil {_ONE}", 1),
    ), 150, ("facts*", "name", "made_by", "licence", "*description*", "notes*", "* json.drop vehicles.*.start.*",
    "av.name", "* json.drop vehicles.*.poses", "* json.set vehicles.*.poses.x_m.*",  # unknown, or not there
    "* json.drop road.*", "road.name")),
    Kind(
        "config", "options", "config", ("c.toml",), (Door("simulate", "simulate --config c.toml --json",
        free=("* place.empty", "* place.null", "* place.zero")),), 60,
        waits=True,
    ),
    Kind("options", "options", "everything", (), (Door("words", ""),), 32, words=hostile_options, plain=plain_options),
    # These wait for processes or disks, so they are a small share; `--kind` tries more of one.
    Kind("output paths", "output paths", "library", (), (Door("words", ""),), 2, words=hostile_paths,
    plain=plain_path),
    Kind("sql", "SQL", "library", (), (Door("words", ""),), 5, words=hostile_sql),
    Kind("interface", "Python interface and environments", "library", (), (Door("call", ""),), 50, words=hostile_call,
    plain=plain_call),
    Kind("hostile AV", "AV classes", "hostile-avs", (), (Door("words", ""),), 0.1, words=hostile_av,
    plain=plain_av),
    Kind("kernel cache", "kernel cache", "kernel-cache", ("cache/*", "cache/*/*"), (
        Door("call", with_cache, free=("*",)),
    ), 8),
    Kind("network", "ONNX and SB3", "network", ("n.onnx", "s.zip", "s_vecnormalize.pkl"), (
        Door("onnx", f"simulate --tests 2 --av n.onnx --av-statistics none --av-processes 1 {_ONE}",
        unread=("s*",)), Door("sb3",
        f"simulate --tests 2 --av s.zip --av-statistics s_vecnormalize.pkl --av-processes 1 {_ONE}", 0.3),
    ), 0.5),
)  # fmt: skip


def _damaged_files(seed: Path, kind: Kind) -> Sequence[str]:
    return sorted({str(path.relative_to(seed)) for pattern in kind.files for path in seed.glob(pattern)})


def draw_input(rng: np.random.Generator, kind: Kind, seed: Path) -> dict[str, Any]:
    """Draw an input of a kind: an object of JSON that says all of it.

    Args:
        rng: Where from.
        kind: The kind.
        seed: Folder of its seed.
    """
    shares = np.array([door.share for door in kind.doors])
    door = kind.doors[int(rng.choice(len(shares), p=shares / shares.sum()))]
    if kind.words is not None:
        return {"kind": kind.name, "door": door.name, "words": kind.words(rng)}
    files = _damaged_files(seed, kind)
    assert files, f"{kind.name}: the seed has none of {kind.files}"
    recipes: list[Recipe] = []
    wanted = 1 + (rng.random() < 0.1)
    for _ in range(20):
        if len(recipes) == wanted:
            break
        name = files[int(rng.integers(len(files)))]
        if not any(name.startswith(recipe["file"]) or recipe["file"].startswith(name) for recipe in recipes):
            recipe = drawn(rng, seed / name, name)
            if not (kind.waits and recipe["op"] == "place.fifo"):
                recipes.append(recipe)
    return {"kind": kind.name, "door": door.name, "damage": recipes}
