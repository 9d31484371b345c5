"""Kill commands at random moments, resume them, and compare with undisturbed ones: nothing may be lost or doubled.

Each case is one command. It is killed once or more (mostly SIGKILL, also SIGINT and SIGTERM; at a random moment, or
just when it changes a file), given again with `--resume`, and at the end compared with the same command that nobody
disturbed: same cases, same numbers, same files, and none besides. Further cases run on a small file system or under a
limit of file sizes, which end in a full disk until room is made, and in two processes that begin at the same moment.

Commands run in children of this process, which has imported the package before: a fork starts at once.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # the made-up recordings of the tests

VOLATILE = ("seconds", "written", "acceleration", "reason", "cost", "kept")
"""What no two runs share, since it comes from times; so does what ends in _seconds or _per_second. `kept` says whether
a finished policy was there, as after a kill in the measuring that follows."""
SIGNALS = (signal.SIGKILL,) * 6 + (signal.SIGINT,) * 2 + (signal.SIGTERM,)
REFUSALS = ("is being written by", "which is being written by", "holds results already", "exists already",
            "is there already", "holds a library of this run already", "holds an unfinished training")  # fmt: skip
LONGEST_S = 300.0


@dataclass(frozen=True)
class Job:
    """A command.

    Attributes:
        words: The command line; OUT stands for the place of the output, IN for the folder of inputs.
        out: Name of the output in a folder of its own; what is beside it counts too.
        resumes: It has `--resume`; without, its output is removed before it is given again, unless it `repeats`.
        repeats: The same command may be given again without that.
    """

    words: str
    out: str = "out"
    resumes: bool = False
    repeats: bool = False

    def line(self, known: Mapping[str, str], *, again: bool) -> list[str]:
        """Give the words, with what some stand for."""
        words = [known.get(word, word.replace("IN/", f"{known['IN']}/")) for word in self.words.split()]
        return [*words, "--json", *(("--resume",) if again and self.resumes else ())]


JOBS = {
    "generate": Job("generate --policy swerve --cases 150 --out OUT", resumes=True),
    "simulate": Job("simulate --bv swerve --tests 150 --stats --out OUT", resumes=True),
    "rate mc": Job(
        "rate --method mc --av flawed-not-behind --max-tests 6000 --target-rhw 0.001 --out OUT", resumes=True
    ),
    "rate splitting": Job("rate --method splitting --max-tests 9000 --target-rhw 0.01 --out OUT", resumes=True),
    "rate is": Job("rate --method is --max-tests 9000 --target-rhw 0.01 --out OUT", resumes=True),
    "train": Job("train --decisions 12288 --tests 64 --out OUT", out="p.safetensors", resumes=True),
    "train-av": Job("train-av --decisions 4096 --tests 64 --overwrite --out OUT", out="av.safetensors", resumes=True),
    "analyse": Job("analyse IN/library --out OUT", repeats=True),
    "report": Job("report IN/library --out OUT", repeats=True),
    "figure": Job("figure IN/library --out OUT", repeats=False),
    "plausibility": Job("plausibility --budget 20 --seeds 1 --decisions 2048 --tests 64 --out OUT", resumes=True),
    "shrink": Job("shrink IN/few all --out OUT", resumes=True),
    "export": Job("export IN/library all --to csv --out OUT", resumes=True),
    "export openscenario": Job("export IN/few all --to openscenario --out OUT", resumes=True),
    "import": Job("import IN/tables/one.csv IN/tables/two.csv --out OUT"),
    "cases from-data": Job("cases from-data IN/clips.csv --av idm-mobil --out OUT"),
    "suite build": Job("suite build IN/library --size 5 --zoo idm-mobil --zoo rss-cautious --out OUT"),
    "suite run": Job("suite run aeb --out OUT"),
    "r157": Job("r157 --family deceleration --out OUT"),
    "retest": Job("retest IN/few --av rss-cautious --junit OUT", out="junit.xml"),
    "replay": Job("replay IN/few CASE --video OUT", out="film.gif"),
    "ndd show": Job("ndd show --out OUT", repeats=True),
    "ndd fit": Job("ndd fit IN/pairs.csv --format pairs --out OUT", out="model.npz", repeats=True),
    "run": Job("run --effort quick --threads 2 --out OUT", resumes=True),
    "reproduce": Job("reproduce --effort quick --figure figure3 --out OUT", resumes=True),
}  # fmt: skip
QUICK = ("simulate", "analyse", "rate mc")
"""What is killed within `make test-slow`."""


# Small parts of work


def make_small() -> None:
    """Cut work into smaller parts, in this process and so in its children: a case then takes seconds, not minutes."""
    from importlib import import_module

    from cornerforge.adversary import checkpoint

    checkpoint.CheckpointFile.__init__.__kwdefaults__ = {"every_seconds": 0.05}
    checkpoint._WRITING_SHARE = 0
    for name, value in import_module("small_trees").SMALL["rates.teaching"].items():
        setattr(import_module("cornerforge.rates.teaching"), name, value)
    places = ("verbs.rate", "rates.plain", "rates.splitting")
    rate, plain, splitting = (import_module(f"cornerforge.{name}") for name in places)
    plain._BLOCK, plain._STORE_SECONDS, plain._SHARD_CASES = 1_000, 0.2, 20  # type: ignore[attr-defined]
    rate.PLAIN_TESTS = 2_000  # type: ignore[attr-defined]
    rate.TREES = splitting.TREES = 1_000  # type: ignore[attr-defined]
    filling = import_module("cornerforge.library.filling")
    filling._SHARD_CASES, filling._COMMIT_SECONDS = 40, 0.05  # type: ignore[attr-defined]
    run, reproduce = import_module("cornerforge.verbs.run"), import_module("cornerforge.ext.paper.bench")
    run.EFFORTS["quick"] = run.Effort(
        nde_tests=2_000, natural_tests=3_000, natural_rhw=0.3, decisions=6_144, evaluation_tests=64, exposure_tests=64,
        cases=60,
    )  # fmt: skip
    quick = reproduce.REPRODUCE_EFFORTS["quick"]
    reproduce.REPRODUCE_EFFORTS["quick"] = replace(
        quick, decisions=4_096, bounded_decisions=4_096, tests=64, natural_tests=1_000, typed=10, miles=5.0, cases=20
    )


def make_inputs(folder: Path) -> dict[str, str]:
    """Make what commands read; returns what further words stand for."""
    from recorded_files import clips_file, motorway

    import cornerforge
    from cornerforge.library import CaseLibrary

    cornerforge.generate(policy="swerve", cases=60, out=folder / "library", seed=5)
    cornerforge.generate(policy="swerve", cases=4, out=folder / "few", seed=6)
    cornerforge.export(folder / "few", "all", to="csv", out=folder / "tables")
    tables = sorted((folder / "tables").glob("*.csv"))
    for name, table in zip(("one", "two"), tables, strict=False):
        table.rename(table.with_name(f"{name}.csv"))
    clips_file(folder / "clips.csv", motorway())
    rows = ["period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"]
    for f in range(12):
        speed = 25 + 0.3 * np.sin(np.arange(121) / 20 + f)
        split = "test" if f % 5 == 0 else "train"
        rows += [f"1,{f},999,{0.1 * i:.1f},{v:.4f},25.0,{40 + f}.0,{split}" for i, v in enumerate(speed)]
    (folder / "pairs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    ids = CaseLibrary.open(folder / "few").scalars(["case_id"])["case_id"].to_pylist()
    return {"CASE": ids[0]}


# A child


@dataclass
class Child:
    """A command that runs in a process of its own."""

    pid: int
    said: Path
    printed: Path
    status: int | None = None

    def is_over(self) -> bool:
        """Say whether it has ended."""
        if self.status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.status = os.waitstatus_to_exitcode(status)
        return self.status is not None

    def wait(self, most: float = LONGEST_S) -> int:
        """Wait for its end; a command that hangs is killed, and named."""
        end = time.monotonic() + most
        while not self.is_over():
            if time.monotonic() > end:
                self.kill(signal.SIGKILL)
                raise TimeoutError(f"no end within {most:.0f} s: {self.said.read_text()}")
            time.sleep(0.002)
        assert self.status is not None
        return self.status

    def kill(self, number: int) -> None:
        """End it; with SIGKILL its whole group."""
        if not self.is_over():
            if number == signal.SIGKILL:
                os.killpg(self.pid, number)
            else:
                os.kill(self.pid, number)

    def result(self) -> Any:
        """Give what it printed as JSON; None: nothing."""
        text = self.printed.read_text()
        return json.loads(text) if text.strip() else None


def start(words: Sequence[str], notes: Path, *, most_bytes: int | None = None) -> Child:
    """Start a command in a child of this process."""
    notes.mkdir(parents=True, exist_ok=True)
    number = len(list(notes.iterdir()))
    said, printed = notes / f"{number}.err", notes / f"{number}.out"
    said.touch()
    printed.touch()  # here, so that another child that starts now takes another number
    pid = os.fork()
    if pid:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.setpgid(pid, pid)
        return Child(pid, said, printed)
    status = 99
    try:
        os.setpgid(0, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number, file in ((1, printed), (2, said)):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = (io.TextIOWrapper(os.fdopen(n, "wb", closefd=False)) for n in (1, 2))
        if most_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, resource.RLIM_INFINITY))
        sys.argv = ["cornerforge", *words]
        from cornerforge.cli import main

        status = main(list(words))
        sys.stdout.flush()
        sys.stderr.flush()
    except KeyboardInterrupt:
        status = 130
    except BaseException:  # the parent reads it
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(status)


# What a command left


def plain(content: Any) -> Any:
    """Leave out of JSON what no two runs share."""
    if isinstance(content, dict):
        return {
            name: plain(value)
            for name, value in content.items()
            if name not in VOLATILE and not name.endswith(("_seconds", "_per_second"))
        }
    return [plain(one) for one in content] if isinstance(content, list) else content


def _content(path: Path) -> Any:
    """Give a file's content as it is compared; of pages and provenances only that they are there."""
    if path.name.endswith("provenance.json") or path.suffix == ".html":
        return path.stat().st_size > 0
    if path.suffix == ".json":
        content = plain(json.loads(path.read_bytes()))
        return {name: value for name, value in content.items() if name != "sha256"}  # over times too
    if path.suffix == ".xml":
        return path.read_bytes().split(b'time="')[0]
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as arrays:
            names = [name for name in arrays if name not in ("numbers", "checksums") and not name.endswith("seconds")]
            return {name: (arrays[name].dtype.str, arrays[name].tobytes()) for name in names}
    return path.read_bytes()


def left_by(folder: Path) -> dict[str, Any]:
    """Give all files below a folder, hidden ones too, with what is compared of them."""
    files = (path for path in sorted(folder.rglob("*")) if not path.is_dir())
    return {path.relative_to(folder).as_posix(): _content(path) for path in files}


def cases_in(folder: Path) -> Counter[str]:
    """Count the cases of all libraries below a folder by their names."""
    from cornerforge.library import CaseLibrary

    found: Counter[str] = Counter()
    for manifest in folder.rglob("manifest.json"):
        library = CaseLibrary.open(manifest.parent)
        for case in library.scalars(["case_id"])["case_id"].to_pylist() if len(library) else ():
            found[f"{manifest.parent.relative_to(folder)}:{case}"] += 1
    return found


@dataclass(frozen=True)
class Undisturbed:
    """A command that nobody disturbed.

    Attributes:
        files, printed, cases: What it left, in the form in which it is compared.
        seconds: How long it took [s].
        changes: How often it changed files.
        largest, total: Its largest file, and all [bytes].
    """

    files: dict[str, Any]
    printed: Any
    cases: Counter[str]
    seconds: float
    changes: int
    largest: int
    total: int


@dataclass
class Count:
    """What became of a command's cases."""

    cases: int = 0
    kills: int = 0
    resumes: int = 0
    refused: int = 0
    lost: int = 0
    doubled: int = 0
    different: int = 0
    leftovers: int = 0
    is_broken: bool = False
    faults: list[str] = field(default_factory=list)

    @property
    def bad(self) -> int:
        """Everything that must not be."""
        return self.lost + self.doubled + self.different + self.leftovers + len(self.faults)

    def fault(self, what: str, status: int | None, said: str) -> None:
        """Note an end that should not be."""
        self.faults.append(f"{what}: status {status}: {said}")
        print(f"    {self.faults[-1]}", flush=True)

    def compare(self, place: Path, printed: Any, wanted: Undisturbed, what: str) -> None:
        """Compare a case with the undisturbed command."""
        self.cases += 1
        found, cases = left_by(place), cases_in(place)
        doubled = sum((cases - wanted.cases).values())
        lost = sum((wanted.cases - cases).values())
        more = sorted(found.keys() - wanted.files.keys())
        differing = sorted(name for name in wanted.files if found.get(name) != wanted.files[name])
        if printed is not None and plain(printed) != wanted.printed:
            differing.append("what it printed")
        self.lost += lost
        self.doubled += doubled
        self.leftovers += len(more)
        self.different += bool(differing)
        for name, number in (("lost", lost), ("doubled", doubled), ("left over", more), ("different", differing)):
            if number:
                print(f"    {what}: {name}: {number}", flush=True)


SmallDisk = Callable[[int], contextlib.AbstractContextManager[Callable[[], None]]]
"""Mounts a file system of so many KiB; gives what makes it large."""


class Killer:
    """Kills commands.

    Args:
        work: A new folder.
        seed: Of all that is drawn.
    """

    def __init__(self, work: Path, seed: int) -> None:
        self.work, self.random = work, random.Random(seed)
        self.inputs = work / "in"
        self.inputs.mkdir(parents=True)
        self.words = make_inputs(self.inputs)

    def _line(self, job: Job, place: Path, *, again: bool = False) -> list[str]:
        known = {**self.words, "IN": str(self.inputs), "OUT": str(place / job.out)}
        return job.line(known, again=again)

    def _place(self) -> tuple[Path, Path]:
        """Make folders for a case's output and its notes; the output always has one path, because files name it."""
        place, notes = self.work / "case", self.work / "notes"
        for folder in (place, notes):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
        return place, notes

    def undisturbed(self, job: Job) -> Undisturbed:
        """Run a command twice undisturbed; the second time is the one that counts, as all kernels are there."""
        for last in (False, True):
            place, notes = self._place()
            begun = time.monotonic()
            child = start(self._line(job, place), notes)
            changes = _changes(place, child, None)
            seconds = time.monotonic() - begun
            if child.wait() not in (0, 1):
                raise RuntimeError(f"{job.words} ended with {child.status}: {child.said.read_text()}")
            now = Undisturbed(
                left_by(place), plain(child.result()), cases_in(place), seconds, changes,
                max((path.stat().st_size for path in place.rglob("*") if path.is_file()), default=0),
                sum(path.stat().st_size for path in place.rglob("*") if path.is_file()),
            )  # fmt: skip
            if not last:
                before = now
        if (now.files, now.printed) != (before.files, before.printed):
            names = [name for name in now.files if now.files[name] != before.files.get(name)]
            raise RuntimeError(f"{job.words}: two undisturbed runs differ in {names or 'what they print'}")
        return now

    def killed(self, job: Job, wanted: Undisturbed, count: Count, most: int) -> None:
        """Kill a command some times, and let it end."""
        place, notes = self._place()
        kills = min(most, 1 + int(self.random.expovariate(0.35)))
        how: list[str] = []
        for _ in range(kills):
            if how:
                self._again(job, place)
            child = start(self._line(job, place, again=bool(how)), notes)
            number = self.random.choice(SIGNALS)
            how.append(self._one_kill(child, place, wanted, number))
            count.kills += (child.status is not None and child.status < 0) or child.status == 130
            count.resumes += len(how) > 1
            if child.status in (0, 1):
                break
            if child.status == 2 or child.status == 99:
                count.fault(f"{job.words}: after {how}", child.status, child.said.read_text())
                return
        else:
            self._again(job, place)
            child = start(self._line(job, place, again=True), notes)
            child.wait()
            count.resumes += 1
        if child.status not in (0, 1):
            count.fault(f"{job.words}: resumed after {how}", child.status, child.said.read_text())
            return
        count.compare(place, child.result(), wanted, f"{job.words}: {how}")

    def _again(self, job: Job, place: Path) -> None:
        """Clear the output of a command that cannot be resumed; what a kill left beside it stays."""
        out = place / job.out
        if not job.resumes and not job.repeats:
            shutil.rmtree(out) if out.is_dir() else out.unlink(missing_ok=True)

    def _one_kill(self, child: Child, place: Path, wanted: Undisturbed, number: int) -> str:
        drawn = self.random.random()
        if drawn < 0.4 and wanted.changes:
            at = self.random.randint(1, wanted.changes)
            seen = _changes(place, child, at)
            how = f"{signal.Signals(number).name} at change {seen} of {wanted.changes}"
        else:
            share = self.random.random()
            share = share if drawn < 0.7 else 0.1 * share if drawn < 0.8 else 0.9 + 0.15 * share
            _sleep_with(child, share * wanted.seconds)
            how = f"{signal.Signals(number).name} at {share * wanted.seconds:.3f} of {wanted.seconds:.3f} s"
        child.kill(number)
        child.wait()
        return how

    def full(
        self,
        job: Job,
        wanted: Undisturbed,
        count: Count,
        *,
        small: SmallDisk | None,
    ) -> None:
        """Let a command run out of room, make room, and let it end."""
        place, notes = self._place()
        if small is None:
            most = self.random.randint(1_000, max(1_001, wanted.largest - 1))
            # Without --json: what it prints would be a file under the limit too.
            child = start(self._line(job, place)[:-1], notes, most_bytes=most)
            self._ran_out(child, place, count, f"{job.words}: files of at most {most} bytes")
            self._end(job, place, notes, wanted, count, f"files of at most {most} bytes")
            return
        size = self.random.randint(8, max(9, wanted.total // 1024))
        with small(size) as make_room:
            child = start(self._line(job, place), notes)
            self._ran_out(child, place, count, f"{job.words}: disk of {size} KiB")
            make_room()
            self._end(job, place, notes, wanted, count, f"disk of {size} KiB")

    def _ran_out(self, child: Child, place: Path, count: Count, what: str) -> None:
        """Check that a full disk is told in one line that names a file, and leaves no part of one."""
        status, said = child.wait(), child.said.read_text()
        parts = [path.name for path in place.rglob("*") if re.search(r"\.(part|tmp|lock)\b", path.name)]
        if parts:
            count.leftovers += len(parts)
            print(f"    {what}: left over: {parts}", flush=True)
        lines = [line for line in said.splitlines() if line.startswith("cornerforge: ") or "Traceback" in line]
        if status != 0 and (status != 2 or len(lines) != 1 or str(place) not in said or "make room" not in said):
            count.fault(what, status, said)
        count.refused += status == 2

    def _end(self, job: Job, place: Path, notes: Path, wanted: Undisturbed, count: Count, what: str) -> None:
        self._again(job, place)
        child = start(self._line(job, place, again=True), notes)
        status = child.wait()
        count.resumes += 1
        if status not in (0, 1):
            count.fault(f"{job.words}: resumed after {what}", status, child.said.read_text())
            return
        count.compare(place, child.result(), wanted, f"{job.words}: {what}")

    def both(self, job: Job, wanted: Undisturbed, count: Count) -> None:
        """Start a command twice at the same moment; sometimes kill the first, and the second takes over."""
        place, notes = self._place()
        first = start(self._line(job, place), notes)
        _sleep_with(first, self.random.choice((0.0, 0.0, self.random.random() * wanted.seconds)))
        if self.random.random() < 0.5:
            first.kill(signal.SIGKILL)
            first.wait()
            self._again(job, place)
        second = start(self._line(job, place, again=True), notes)
        ends = [child.wait() for child in (first, second)]
        what = f"{job.words}: two processes ended with {ends}"
        fair = sum(end in (0, 1) for end in ends)
        for child, end in zip((first, second), ends, strict=True):
            said = child.said.read_text()
            if end == 2 and any(words in said for words in REFUSALS):
                count.refused += 1
            elif end not in (0, 1, -signal.SIGKILL):
                count.fault(what, end, said)
        if not fair:
            count.fault(what, None, "nobody got it")
            return
        done = second if ends[1] in (0, 1) else first
        count.compare(place, None if fair > 1 else done.result(), wanted, what)


def _sleep_with(child: Child, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not child.is_over() and time.monotonic() < end:
        time.sleep(min(0.002, max(0.0, end - time.monotonic())))


def _changes(place: Path, child: Child, until: int | None) -> int:
    """Count changes of files below a folder until there were so many, or the command has ended."""
    seen, count = _state(place), 0
    while not child.is_over() and (until is None or count < until):
        now = _state(place)
        count += len(now ^ seen)
        seen = now
        time.sleep(0.0005)
    return count


def _state(place: Path) -> set[tuple[str, int]]:
    found: set[tuple[str, int]] = set()
    for folder, _, names in os.walk(place):
        for name in names:
            with contextlib.suppress(OSError):
                found.add((f"{folder}/{name}", os.stat(f"{folder}/{name}").st_mtime_ns))
    return found


def small_disk(place: Path) -> SmallDisk | None:
    """Return a way to mount a small file system there, or None: it is not allowed, or there is no `mount`."""

    def mount(*words: str) -> None:
        subprocess.run(["mount", *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    @contextlib.contextmanager
    def mounted(kibibytes: int) -> Iterator[Callable[[], None]]:
        mount("-t", "tmpfs", "-o", f"size={kibibytes}k", "tmpfs", str(place))
        try:
            yield lambda: mount("-o", "remount,size=1g", str(place))
        finally:
            subprocess.run(["umount", "-l", str(place)], check=True)

    place.mkdir(exist_ok=True)
    try:
        with mounted(64):
            return mounted
    except (OSError, subprocess.CalledProcessError):
        return None


def main() -> int:
    """Kill as many times as asked; exit status 1 if anything was lost, doubled, different or left over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=None, help="of what is drawn; drawn and printed by default")
    parser.add_argument("--minutes", type=float, default=None, help="stop after this time")
    parser.add_argument("--only", nargs="*", default=list(JOBS), choices=list(JOBS), metavar="COMMAND")
    parser.add_argument("--quick", action="store_true", help="the few commands that `make test-slow` kills")
    asked = parser.parse_args()
    seed = random.SystemRandom().randrange(2**31) if asked.seed is None else asked.seed
    names = list(QUICK) if asked.quick else asked.only
    print(f"make kill: {asked.kills} kills over {len(names)} commands, --seed {seed}", flush=True)
    begun = time.monotonic()
    make_small()
    with tempfile.TemporaryDirectory(prefix="cornerforge-kill-") as folder:
        counts = {name: Count() for name in names}
        with contextlib.suppress(KeyboardInterrupt):  # what was counted so far is told
            _all(Killer(Path(folder).resolve(), seed), counts, asked.kills, asked.minutes, begun)
    _table(counts)
    kills = sum(one.kills for one in counts.values())
    bad = sum(one.bad for one in counts.values())
    print(f"{kills} kills in {time.monotonic() - begun:.0f} s; lost, doubled, different, left over or failed: {bad}")
    return 1 if bad or (kills < asked.kills and asked.minutes is None) else 0


def _all(killer: Killer, counts: Mapping[str, Count], kills: int, minutes: float | None, begun: float) -> None:
    """Kill each command in turn until there are enough kills."""
    wanted: dict[str, Undisturbed] = {}
    small = small_disk(killer.work / "case")
    if small is None:
        print("No small file system can be mounted here: a full disk is tried by a limit of file sizes only.")
    while True:
        for name in counts:
            done = sum(one.kills for one in counts.values())
            if (
                done >= kills
                or all(one.is_broken for one in counts.values())
                or (minutes is not None and time.monotonic() - begun > 60.0 * minutes)
            ):
                return
            job, count = JOBS[name], counts[name]
            if count.is_broken:
                continue
            if name not in wanted:
                try:
                    wanted[name] = killer.undisturbed(job)
                except (RuntimeError, TimeoutError) as error:
                    count.is_broken = True
                    count.fault(job.words, None, str(error))
                    continue
                killer.full(job, wanted[name], count, small=None)
                if small is not None:
                    killer.full(job, wanted[name], count, small=small)
                killer.both(job, wanted[name], count)
            kind = killer.random.random()
            if kind < 0.06 and small is not None:
                killer.full(job, wanted[name], count, small=small)
            elif kind < 0.1:
                killer.full(job, wanted[name], count, small=None)
            elif kind < 0.17:
                killer.both(job, wanted[name], count)
            else:
                killer.killed(job, wanted[name], count, kills - done)
            print(f"  {done}: {name} ({wanted[name].seconds:.1f} s undisturbed), bad so far: "
                  f"{sum(one.bad for one in counts.values())}", flush=True)  # fmt: skip


def _table(counts: dict[str, Count]) -> None:
    heads = ("cases", "kills", "resumes", "refused", "lost", "doubled", "different", "leftovers", "failed")
    print(f"{'command':<22}" + "".join(f"{head:>11}" for head in heads))
    for name, one in counts.items():
        values = (one.cases, one.kills, one.resumes, one.refused, one.lost, one.doubled, one.different, one.leftovers,
                  len(one.faults))  # fmt: skip
        print(f"{name:<22}" + "".join(f"{value:>11}" for value in values))


if __name__ == "__main__":
    sys.exit(main())
