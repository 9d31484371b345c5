"""Pictures of README and docs, and a gallery: sixteen cases of four AVs, filmed.

    .venv/bin/python supply/gallery.py --demo out/demo
    .venv/bin/python supply/gallery.py --only ramp queue

Fills out/gallery with libraries and their analyses (what the same code left there stays; what other code left is
refused: remove it), and writes films, three stills, docs/gallery.md, and pictures of the pages of the demo.
`docs/gallery/made.json` says of which version and traffic all are.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imageio_ffmpeg import get_ffmpeg_exe

import cornerforge
from cornerforge.analysis.mechanism import mechanism_of
from cornerforge.library import CaseLibrary
from cornerforge.ndd.model import default_model_path, load_model, model_hash
from cornerforge.report.kinds import kind_in_words
from cornerforge.report.text import capital

ROOT = Path(__file__).resolve().parents[1]
PAGE, PLACE = ROOT / "docs" / "gallery.md", ROOT / "docs" / "gallery"
AVS = {
    "idm-mobil": "a good driver",
    "flawed-brakes-late": "brakes late, on purpose",
    "flawed-not-behind": "does not look behind when it changes lanes, on purpose",
    "flawed-merges-blind": "merges without a look, on purpose",
}
"""AV -> what it is."""
ORIGINS = {
    "natural": "Natural traffic: nobody attacks.",
    "bounded": "A bounded adversary: it steers one vehicle within what drivers do, with a budget of 20 nats.",
    "free": "A free adversary: it steers one vehicle as physics allows.",
    "ramp": "From a ramp: natural traffic where a lane ends.",
    "queue": "The end of a queue: natural traffic that stops.",
}
ROADS: dict[str, dict[str, Any]] = {"ramp": {"road": "on-ramp", "task": "ramp"}, "queue": {"traffic": "queue"}}
"""Origins on other roads and in other traffic than free one on the straight road."""
SHOWN = {origin: {"idm-mobil": 2, "flawed-brakes-late": 1, "flawed-not-behind": 1} for origin in list(ORIGINS)[:3]}
SHOWN |= {"ramp": {"idm-mobil": 1, "flawed-merges-blind": 1}, "queue": {"idm-mobil": 1, "flawed-brakes-late": 1}}
"""How many cases of each origin and AV are shown."""
PORT = 8158
DECISIONS, CASES, NATURAL_TESTS, RARE_TESTS, TREES = 600_000, 300, 4_000, 40_000, 500_000


@dataclass(frozen=True)
class Shown:
    """A case of the gallery."""

    av: str
    origin: str
    library: Path
    case_id: str
    title: str
    text: str

    @property
    def film(self) -> str:
        """Name the file of its film."""
        return f"{self.av}-{self.origin}-{self.case_id.partition(':')[2]}.webm"


def library_of(av: str, origin: str, folder: Path) -> Path:
    """Fill the library of an AV and an origin, unless it is there."""
    place = folder / av / origin
    if origin == "natural" and av == "idm-mobil":  # it crashes too rarely to be counted
        if not (place / "rate.json").exists():
            cornerforge.rate(av=av, out=place, method="splitting", max_tests=TREES, resume=True)
        return place / "weighted"
    if origin == "natural" or origin in ROADS:
        tests = RARE_TESTS if av == "idm-mobil" else NATURAL_TESTS
        cornerforge.simulate(av=av, tests=tests, out=place, resume=True, **ROADS.get(origin, {}))
        return place
    policy = folder / av / f"{origin}.safetensors"
    if not policy.exists():
        budget = 20.0 if origin == "bounded" else None
        cornerforge.train(av=av, decisions=DECISIONS, budget=budget, tests=256, out=policy)
    cornerforge.generate(av=av, policy=policy, cases=CASES, out=place, resume=True)
    return place


def chosen(av: str, origin: str, library: Path, before: set[str]) -> list[Shown]:
    """Choose the cases of most value, of different kinds, and none of tests that were shown before."""
    analysis = library.with_name(f"{library.name}-analysis")
    if not (analysis / "analysis.json").exists():
        cornerforge.analyse(library, out=analysis)
    top = json.loads((analysis / "analysis.json").read_text(encoding="utf-8"))["value"]["top"]
    cases, found = CaseLibrary.open(library), dict[str, Shown]()
    for one in top:
        if one["case_id"] in before:
            continue
        kind = mechanism_of(cases.scenario(one["case_id"]).scenario).name
        found.setdefault(kind, Shown(av, origin, library, one["case_id"], capital(kind_in_words(kind)), one["text"]))
    return list(found.values())[: SHOWN[origin][av]]


def card(shown: Shown) -> str:
    """Write a case as a part of the page."""
    place = shown.library.relative_to(ROOT)
    key = "natural" if shown.origin == "natural" or shown.origin in ROADS else "adversary"
    return f"""### {shown.title}

<video controls muted loop preload="metadata" width="100%" src="gallery/{shown.film}#t=3"></video>

`{shown.av}`, {AVS[shown.av]}. {shown.text[0].upper()}{shown.text[1:]}.

[Open it in the explorer](http://127.0.0.1:8157/#case={key}/{shown.case_id}) while `cornerforge serve {place}` runs.
"""


def encode(*words: str) -> None:
    """Call ffmpeg."""
    subprocess.run([get_ffmpeg_exe(), "-loglevel", "error", *words], check=True)


def write_still(shown: Shown, path: Path) -> None:
    """Take the last picture of a film."""
    encode("-sseof", "-0.2", "-i", str(PLACE / shown.film), "-frames:v", "1", "-vf", "scale=640:-2", "-y", str(path))


def write_film(shown: Shown, path: Path) -> None:
    """Film a case, in a size for the docs."""
    with tempfile.TemporaryDirectory() as place:
        large = Path(place) / "large.mp4"
        cornerforge.replay(shown.library, shown.case_id, video=large)
        smaller = ["-vf", "scale=960:-2", "-c:v", "libvpx-vp9", "-crf", "42", "-b:v", "0", "-cpu-used", "4"]
        exact = ["-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact"]
        encode("-i", str(large), *exact, *smaller, "-row-mt", "1", "-r", "20", "-y", str(path))


def write_screens(demo: Path) -> None:
    """Take pictures of the report and of the explorer of a run."""
    from playwright.sync_api import sync_playwright

    images = ROOT / "docs" / "images"
    command = [sys.executable, "-m", "cornerforge", "serve", str(demo), "--port", str(PORT), "--quiet"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as server, sync_playwright() as session:
        assert server.stdout is not None
        server.stdout.readline()  # it listens
        browser = session.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 770})
        for url, name in (
            ((demo / "report.html").resolve().as_uri(), "report"),
            (f"http://127.0.0.1:{PORT}/", "explorer"),
        ):
            page.goto(url, wait_until="networkidle")
            page.wait_for_timeout(2_000)
            page.screenshot(path=images / f"{name}.png")
        browser.close()
        server.terminate()


def main() -> None:
    """Make libraries, films, stills, pictures and the page."""
    options = argparse.ArgumentParser(description="Make the pictures of README and docs, and the gallery.")
    options.add_argument("--demo", type=Path, default=ROOT / "out" / "demo", help="folder that `make demo` filled")
    options.add_argument("--only", nargs="+", choices=ORIGINS, help="make these parts of the gallery alone, no pages")
    given = options.parse_args()
    folder, wanted = ROOT / "out" / "gallery", given.only or list(ORIGINS)
    all_shown: list[Shown] = []
    for origin in wanted:
        for av in SHOWN[origin]:
            print(f"{av}, {origin}", file=sys.stderr, flush=True)
            before = {one.case_id for one in all_shown if one.av == av}
            all_shown += chosen(av, origin, library_of(av, origin, folder), before)
    PLACE.mkdir(exist_ok=True)
    for old in PLACE.iterdir():
        if given.only is None or any(f"-{origin}-" in old.name or old.stem == origin for origin in wanted):
            old.unlink()
    for shown in all_shown:
        print(f"film {shown.film}", file=sys.stderr, flush=True)
        write_film(shown, PLACE / shown.film)
    for origin in wanted:
        write_still(next(one for one in all_shown if one.origin == origin), PLACE / f"{origin}.png")
    parts = dict(part.split("\n", 1) for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:])
    for origin in wanted:
        title, words = ORIGINS[origin].partition(":")[0], ORIGINS[origin]
        parts[title] = f"\n{words}\n\n" + "\n".join(card(one) for one in all_shown if one.origin == origin)
    titles = [words.partition(":")[0] for words in ORIGINS.values()]
    PAGE.write_text(
        "# Gallery\n\nSixteen cases of four AVs, chosen by the program: of each library the cases of most value, of "
        "different kinds. The films are in real time and to scale, and stand at the contact. `make gallery` makes "
        "the libraries, the films and this page.\n"
        + "".join(f"\n## {title}\n{parts[title].rstrip()}\n" for title in titles),
        encoding="utf-8",
    )
    if given.only is None:
        write_screens(given.demo)
    made = {"version": cornerforge.__version__, "traffic": model_hash(load_model(default_model_path()))}
    (PLACE / "made.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
