"""How fast the explorer is: `cornerforge serve` and its page in Chromium without a graphics card.

    .venv/bin/python benchmarks/explorer_speed.py out/demo/library --cases 50000 --points 100000

Makes two libraries of so many cases, by copying those of LIB and of its analysis beside it (out/demo/analysis) under
other names, and measures, each with the machine otherwise idle: from the start of the program to all columns that the
page asks for, beside reading the same columns with pyarrow in a fresh Python; a case; its reference drivers; from a
click to the picture; memory; and of the larger library frames a second while the map is zoomed and moved. Prints
Markdown. Wants `make web` and what `make test-browser` installs.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from measuring import table

from cornerforge.library import CaseLibrary

FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
COLUMNS = (
    "pc1", "pc2", "cluster", "crash_type", "prevention", "way_out", "impact_speed_mps", "striker", "fault",
    "fault_rule", "conduct", "av_lane", "bv_kind", "value",
)  # fmt: skip
SHARD = 1000
SECONDS = 5.0

ZOOM = """async (seconds) => {
  const map = document.querySelector("[role=application]"), at = map.getBoundingClientRect();
  const begin = performance.now();
  for (let n = 0; ; n++) {
    const now = await new Promise(requestAnimationFrame);
    if (now - begin > 1000 * seconds) return n / seconds;
    map.dispatchEvent(new WheelEvent("wheel", { deltaY: -60 * Math.sin(n / 25), bubbles: true, cancelable: true,
      clientX: at.x + 0.45 * at.width, clientY: at.y + 0.5 * at.height }));
  }
}"""
"""Frames a second while the map is zoomed in and out."""
CLICK = """async (row) => {
  const begin = performance.now();
  performance.clearMarks("case drawn");
  document.querySelectorAll("[role=grid] [role=rowgroup] [role=row]")[row].click();
  while (performance.getEntriesByName("case drawn").length === 0) {
    if (performance.now() - begin > 20000) throw new Error("no case was drawn");
    await new Promise((done) => setTimeout(done, 1));
  }
  return performance.now() - begin;
}"""
"""Milliseconds from a click on a row of the list to the picture of its case."""


def renamed(rows: pa.Table, copy: int, step: int) -> pa.Table:
    """The same cases under other names: their tests are `step` higher for each copy."""
    tests = [int(case.partition(":")[2]) + copy * step for case in rows["case_id"].to_pylist()]
    seeds = [case.partition(":")[0] for case in rows["case_id"].to_pylist()]
    names = pa.array([f"{seed}:{test}" for seed, test in zip(seeds, tests, strict=True)], rows["case_id"].type)
    rows = rows.set_column(rows.schema.get_field_index("case_id"), rows.schema.field("case_id"), names)
    if "test" in rows.column_names:
        field = rows.schema.field("test")
        rows = rows.set_column(rows.schema.get_field_index("test"), field, pa.array(tests, field.type))
    return rows


def copied(library: Path, cases: int, to: Path) -> Path:
    """Make a library of so many cases, and its analysis beside it, by copying."""
    source, analysis = CaseLibrary.open(library), library.parent / "analysis"
    copies, step = -(-cases // len(source)), source.next_test
    rows, tracks = (pa.concat_tables(parts) for parts in zip(*source.shards(), strict=True))
    new = CaseLibrary.create(to / "library", source.identity, source.odd)
    for copy in range(copies):
        few = min(len(source), cases - copy * len(source))
        some, motion = (renamed(part.slice(0, few), copy, step) for part in (rows, tracks))
        new.fill(
            some, motion, next_test=(copy + 1) * step, tests=(copy + 1) * step,
            crashes=copy * len(source) + few, shard_cases=SHARD,
        )  # fmt: skip
    new.finish()
    shutil.copytree(analysis, to / "analysis")
    for name in ("cases.parquet", "points.parquet", "witnesses.parquet"):
        one = pq.read_table(analysis / name)
        many = pa.concat_tables([renamed(one, copy, step) for copy in range(copies)])
        pq.write_table(many if one.num_rows < len(source) else many.slice(0, cases), to / "analysis" / name)
    made = json.loads((to / "analysis" / "provenance.json").read_text(encoding="utf-8"))
    made["identity"]["cases"] = cases
    (to / "analysis" / "provenance.json").write_text(json.dumps(made), encoding="utf-8")
    return to / "library"


class Server:
    """The explorer of a library; knows how long it took from its start until the page's columns were there."""

    def __init__(self, library: Path) -> None:
        begin = time.perf_counter()
        words = [sys.executable, "-m", "cornerforge", "serve", str(library), "--port", "0", "--json"]
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.url = str(json.loads(self._process.stdout.readline())["url"])
        table = self.columns()
        self.seconds_to_open = time.perf_counter() - begin
        self.cases = table["case_id"].to_pylist()
        self.source = str(table["source"][0])

    def columns(self) -> pa.Table:
        with urlopen(f"{self.url}api/columns?names={','.join(COLUMNS)}") as answer:
            return pa.ipc.open_stream(answer.read()).read_all()

    def milliseconds(self, path: str) -> float:
        begin = time.perf_counter()
        with urlopen(self.url + path) as answer:
            answer.read()
        return 1000.0 * (time.perf_counter() - begin)

    def megabytes(self) -> float:
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="utf-8")
        return int(status.partition("VmHWM:")[2].split()[0]) / 1024.0

    def stop(self) -> None:
        self._process.send_signal(2)
        self._process.wait(30)


def read_plainly(library: Path) -> float:
    """Seconds that a fresh Python takes to read the files of the columns with pyarrow, and nothing else."""
    code = (
        "import sys, glob, pyarrow.parquet as pq\n"
        "[pq.read_table(one) for one in glob.glob(sys.argv[1] + '/cases-*.parquet')]\n"
        "[pq.read_table(one) for one in glob.glob(sys.argv[1] + '/../analysis/*.parquet')]\n"
    )
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code, str(library)], check=True)
    return time.perf_counter() - begin


def in_chromium(server: Server, clicks: int) -> tuple[float, list[float]]:
    """Frames a second while the map is zoomed, and milliseconds from clicks to pictures."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as session:
        browser = session.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(server.url)
        page.locator("[role=grid] [role=rowgroup] [role=row]").first.wait_for()
        page.wait_for_timeout(3000)
        frames = float(page.evaluate(ZOOM, SECONDS))
        waits = []
        for click in range(clicks):
            waits.append(float(page.evaluate(CLICK, 1 + click % 8)))
            page.keyboard.press("Escape")
            page.wait_for_timeout(500)
        browser.close()
    return frames, waits


def quantiles(values: list[float]) -> str:
    return f"{np.median(values):.0f} ms; 95 of 100: {np.quantile(values, 0.95):.0f} ms (n = {len(values)})"


def measured(library: Path, repetitions: int) -> list[tuple[str, str]]:
    opened, plainly = [], []
    for _ in range(repetitions):
        server = Server(library)
        opened.append(server.seconds_to_open)
        server.stop()
        plainly.append(read_plainly(library))
    server = Server(library)
    time.sleep(60.0)  # until the kernels are loaded behind the page
    some = np.random.default_rng(0).choice(server.cases, 200)
    cases = [server.milliseconds(f"api/case/{server.source}/{case}") for case in some]
    ghosts = [server.milliseconds(f"api/case/{server.source}/{case}/ghosts") for case in some[:50]]
    frames, clicks = in_chromium(server, 24)
    memory = server.megabytes()
    n = len(server.cases)
    server.stop()
    ratio = float(np.median(np.array(opened) / np.array(plainly)))
    return [
        ("cases", f"{n:,}"),
        ("start to columns", f"{min(opened):.2f} to {max(opened):.2f} s (n = {repetitions})"),
        ("the same over reading its files with pyarrow", f"{ratio:.1f}"),
        ("a case", quantiles(cases)),
        ("its reference drivers", quantiles(ghosts)),
        ("click to picture", quantiles(clicks)),
        ("frames/s while zooming", f"{frames:.0f}"),
        ("memory, most", f"{memory:.0f} MB"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the explorer.")
    parser.add_argument("library", type=Path, help="a library of an adversary with its analysis beside it")
    parser.add_argument("--cases", type=int, default=50_000)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--repetitions", type=int, default=5)
    given = parser.parse_args()
    found = []
    for size in (given.cases, given.points):
        with tempfile.TemporaryDirectory() as folder:
            found.append(measured(copied(given.library, size, Path(folder) / "big"), given.repetitions))
    rows = [(name, one, other) for (name, one), (_, other) in zip(*found, strict=True)]
    print(table(("", "smaller", "larger"), rows))


if __name__ == "__main__":
    main()
