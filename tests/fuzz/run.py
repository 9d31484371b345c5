"""`make fuzz`: damaged and hostile inputs of every kind, drawn from a seed, on all cores.

Each input that fails is written into `tests/fuzz/found/`, with how to try it again. Exit status 1 if there is one.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import secrets
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1])]

from fuzz.kinds import KINDS, draw_input  # noqa: E402
from fuzz.seeds import seed_folder  # noqa: E402
from fuzz.workers import Worker  # noqa: E402

FOUND = Path(__file__).parent / "found"
BAD = ("silent", "traceback", "hang", "memory", "partial", "lines", "survivor", "stale", "broken")
COLUMNS = ("same", "refused", "told", "other", "silent", "traceback", "hang", "memory", "partial", "lines",
           "survivor")  # fmt: skip


class _Work:
    """Inputs that are still to be run, and what came of the others."""

    def __init__(self, seeds: Path, seed: int, inputs: int, seconds: float, kinds: list[str]) -> None:
        self._seeds, self._seed, self._most = seeds, seed, inputs
        self._end = time.monotonic() + seconds
        self._lock = threading.Lock()
        self._next = 0
        self._kinds = [kind for kind in KINDS if not kinds or kind.name in kinds]
        self._shares = np.array([kind.share for kind in self._kinds])
        self.counts: dict[str, Counter[str]] = defaultdict(Counter)
        self.seconds: dict[tuple[str, str], float] = defaultdict(float)
        self.seen: Counter[str] = Counter()

    def next(self) -> dict[str, Any] | None:
        """Draw the next input; None when it is enough."""
        with self._lock:
            i, self._next = self._next, self._next + 1
        if i >= self._most or time.monotonic() > self._end:
            return None
        rng = np.random.default_rng([self._seed, i])
        kind = self._kinds[int(rng.choice(len(self._kinds), p=self._shares / self._shares.sum()))]
        return {"seed": self._seed, "number": i, **draw_input(rng, kind, seed_folder(self._seeds, kind.seed))}

    def keep(self, one: dict[str, Any], outcome: tuple[str, str], seconds: float) -> None:
        """Count an outcome; write down an input that failed, one for each way to fail."""
        what, detail = outcome
        with self._lock:
            self.counts[one["kind"]][what] += 1
            self.seconds[one["kind"], one["door"]] += seconds
            if what not in BAD:
                return
            way = f"{what}: {_way(one, what, detail)} ({one['kind']})"
            self.seen[way] += 1
            if self.seen[way] > 3:
                return
            FOUND.mkdir(exist_ok=True)
            name = hashlib.sha256(json.dumps(one, sort_keys=True).encode()).hexdigest()[:12]
            content = {
                **one,
                "outcome": what,
                "detail": detail,
                "again": f"python -m fuzz.run --again tests/fuzz/found/{name}.json",
            }
            (FOUND / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _way(one: dict[str, Any], what: str, detail: str) -> str:
    """Name the way in which an input failed, for counting: the frame; of a silent one, what was damaged."""
    if what != "silent":
        return (
            re.sub(r"'.*|(?<=: ).*", "", detail.replace("\n", " "))[:120]
            if what in ("traceback", "memory", "hang")
            else detail[:110]
        )
    damaged = [
        f"{r['file']} {r['op']} {r.get('array', r.get('column', '.'.join(map(str, r.get('path', ())))))}"
        for r in one["damage"]
    ]
    return f"{one['door']}, {'; '.join(damaged)} {one['damage'][0].get('value', '')}"


def _again(files: list[Path], seeds: Path, room: Path) -> int:
    """Run inputs that were written down, and say what comes of each."""
    worker, bad = Worker(seeds, room, 0), 0
    for file in files:
        one = json.loads(file.read_text(encoding="utf-8"))
        what, detail = worker.run(one)
        bad += what in BAD
        print(f"{file}: {what} {detail}")
    worker.stop()
    return int(bad > 0)


def _table(work: _Work, seconds: float, workers: int) -> None:
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for kind in KINDS:
        rows[kind.row].update(work.counts.get(kind.name, Counter()))
        rows["all"].update(work.counts.get(kind.name, Counter()))
    rows["all"] = rows.pop("all")
    print(f"{'':36}{'inputs':>8}" + "".join(f"{name:>10}" for name in COLUMNS))
    for name, counts in rows.items():
        if counts.total():
            print(f"{name:36}{counts.total():>8}" + "".join(f"{counts[c] or '':>10}" for c in COLUMNS))
    print(f"{rows['all'].total() / seconds:.1f} inputs a second, {workers} processes, {seconds:.0f} s")


def main() -> int:
    """Run; the exit status is 1 if an input failed."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", default="random")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kind", action="append", default=[], choices=[kind.name for kind in KINDS])
    parser.add_argument("--seeds", type=Path, help="keep the whole files here, for other calls")
    parser.add_argument("--again", type=Path, nargs="+", help="inputs that were written down")
    parser.add_argument("--slow", action="store_true", help="tell how long the doors take")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(
        prefix="fuzz-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    ) as room:
        seeds = (given.seeds or Path(room) / "seeds").resolve()
        if given.again:
            return _again(given.again, seeds, Path(room))
        seed = secrets.randbelow(2**31) if given.seed == "random" else int(given.seed)
        print(f"fuzz: seed {seed}, {given.workers} workers", flush=True)
        begun = time.monotonic()
        chosen = [kind for kind in KINDS if not given.kind or kind.name in given.kind]
        for kind in chosen:
            seed_folder(seeds, kind.seed)
        print(f"seeds: {time.monotonic() - begun:.0f} s", flush=True)
        begun = time.monotonic()
        work = _Work(seeds, seed, given.inputs, given.seconds, given.kind)

        def go(number: int) -> None:
            worker = Worker(seeds, Path(room), number)
            while (one := work.next()) is not None:
                began = time.monotonic()
                work.keep(one, worker.run(one), time.monotonic() - began)
            worker.stop()

        threads = [threading.Thread(target=go, args=(number,)) for number in range(given.workers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        _table(work, time.monotonic() - begun, given.workers)
        for way, count in work.seen.most_common():
            print(f"{count:6} {way[:230]}")
        if given.slow:
            for (name, door), spent in sorted(work.seconds.items(), key=lambda one: -one[1])[:40]:
                print(f"{spent:8.1f} s {name} {door}")
        return int(bool(work.seen))


if __name__ == "__main__":
    sys.exit(main())
