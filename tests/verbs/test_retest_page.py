"""The page of `retest`: the answer first, and both versions on one clock, as they really drive."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import Page, browse, needs_browser

import cornerforge
from cornerforge.errors import OutputError
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.library import CaseLibrary
from cornerforge.report.text import signed
from cornerforge.results import Retested
from cornerforge.verbs.cases import experiment_with
from cornerforge.world_options import WorldOptions

pytestmark = pytest.mark.full

NEW = "idm-mobil-d2rl"


@pytest.fixture(scope="module")
def made(swerve_library: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Retested]:
    """The page of a retest, and its result."""
    file = tmp_path_factory.mktemp("page") / "retest.html"
    return file, cornerforge.retest(swerve_library, av=NEW, page=file)


def touches(side: dict[str, Any], frame: int) -> bool:
    def box(vehicle: dict[str, Any]) -> Box:
        x, y, h = (vehicle[key][frame - vehicle["from"]] for key in ("x", "y", "h"))
        return Box(x, y, h, vehicle["length"], vehicle["width"])

    return bool(boxes_overlap(*(box(side["vehicles"][index]) for index in (0, side["partner"]))))


def test_both_versions_begin_alike_and_end_as_they_are_said_to(made: tuple[Path, Retested]) -> None:
    file, result = made
    cases = Page(file).data("cases")
    kinds = [case["kind"] for case in cases]
    assert kinds == sorted(kinds, key=["new", "still crashing", "fixed"].index)
    assert {"still crashing", "fixed"} <= set(kinds)
    for case in cases:
        old, new = case["old"], case["new"]
        assert old["first"] == new["first"] == case["first"]
        assert case["frames"] == max(old["frames"], new["frames"])
        for key in ("x", "y", "v"):
            assert old["vehicles"][0][key][0] == pytest.approx(new["vehicles"][0][key][0], abs=2e-3)
        crashed = [side["crash"] is not None for side in (old, new)]
        assert crashed == {"new": [False, True], "still crashing": [True, True], "fixed": [True, False]}[case["kind"]]
        for side in (old, new):
            if side["crash"] is not None:
                assert touches(side, side["crash"])
                assert not touches(side, side["crash"] - 1)
    speeds = [case["impact"] for case in cases if case["kind"] == "fixed"]
    assert speeds == sorted(speeds, reverse=True)
    assert kinds.count("new") == min(16, result.new_crashes)


def test_the_recordings_are_those_of_the_two_avs(made: tuple[Path, Retested], swerve_library: Path) -> None:
    library = CaseLibrary.open(swerve_library)
    of = {one.case: one.recorded for one in made[1].each}
    new = experiment_with(library, WorldOptions(av=NEW)).recorder()
    seen = set()
    for case in Page(made[0]).data("cases"):
        seen.add(case["drive"])
        if case["drive"] == "others who react":
            driven = new.record(*map(int, case["id"].split(":")))
            assert of.get(case["id"]) != case["kind"], "shown with others as recorded where that is of its kind"
            shown = case["new"]["vehicles"][0]
            expected = driven.x[case["first"] :, 0] - driven.x[0, 0]
            assert np.array(shown["x"]) == pytest.approx(expected, abs=1e-3)
        if case["id"] in of:
            stored = library.scenario(case["id"]).scenario
            expected = stored.x[case["first"] :, 0] - stored.x[0, 0]
            assert np.array(case["old"]["vehicles"][0]["x"]) == pytest.approx(expected, abs=2e-3)
    assert seen == {"others as recorded", "others who react"}


def test_the_page_answers_first_and_fetches_nothing(made: tuple[Path, Retested]) -> None:
    file, result = made
    page = Page(file)
    text = " ".join(page.text.split())
    assert result.reacting is not None
    assert f"{result.reacting.baseline_crashes} → {result.reacting.av_crashes} crashes" in text
    assert result.reacting.verdict == "open"
    assert text.index("Not clear yet") < text.index("Both versions in the same case")
    assert result.interval95 is not None
    assert f"95 % interval {signed(result.interval95[0])} to {signed(result.interval95[1])}" in text
    links = [value for _, attrs in page.tags for name, value in attrs.items() if name in ("src", "href")]
    assert links
    assert all(str(link).startswith("#") for link in links)
    assert file.stat().st_size < 6_000_000


STEPS = """
const seen = [];
const step = (id) => { if (id) document.getElementById(id).click();
  const names = ["clock", "old-state", "new-state", "old-av", "new-av"];
  seen.push(names.map((name) => document.getElementById(name).textContent)); };
document.querySelector('a.play[data-case="ID"]').click(); document.getElementById("play").click(); step();
step("to-crash"); step("back"); step("to-crash"); step("forward");
document.body.dataset.seen = JSON.stringify(seen);
"""


@needs_browser
def test_both_move_on_one_clock(made: tuple[Path, Retested], tmp_path: Path) -> None:
    browse(made[0].as_uri(), tmp_path / "profile")  # no complaint under the page's own policy
    case = next(case for case in Page(made[0]).data("cases") if case["kind"] == "fixed")
    text = re.sub(r"<meta http-equiv[^>]*>", "", made[0].read_text(encoding="utf-8"))
    steps = STEPS.replace("ID", case["id"])
    file = tmp_path / "steps.html"
    file.write_text(text.replace("</body>", f"<script>{steps}</script></body>"), encoding="utf-8")
    found = re.search(r'data-seen="([^"]*)"', browse(file.as_uri(), tmp_path / "profile"))
    assert found is not None
    begun, crash, before, again, after = json.loads(html.unescape(found[1]))
    frame = case["crash"]

    def speed(side: str, at: int) -> str:
        return f"{case[side]['vehicles'][0]['v'][at]:.1f} m/s"

    def clock(at: int) -> str:
        return f"{(case['first'] + at) * 0.1:.1f} s"

    assert begun == [clock(0), "driving", "driving", speed("old", 0), speed("new", 0)]
    assert crash == again == [clock(frame), "contact", "driving", speed("old", frame), speed("new", frame)]
    assert before == [clock(frame - 1), "driving", "driving", speed("old", frame - 1), speed("new", frame - 1)]
    # the old version's test is over, so it stands still while the new one drives on
    assert after == [clock(frame + 1), "contact", "driving", speed("old", frame), speed("new", frame + 1)]


@pytest.mark.usefixtures("in_memory")
def test_natural_crashes_of_a_worse_av_come_first(
    swerve_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An AV from outside that heeds nobody."""
    monkeypatch.chdir(tmp_path)
    heedless = "import numpy as np\nclass Heedless:\n    def act(self, view):\n"
    heedless += "        return np.tile([2.0, 0.0], (len(view), 1))\n"
    (tmp_path / "heedless.py").write_text(heedless, encoding="utf-8")
    said = cornerforge.retest(swerve_library, av="heedless:Heedless", baseline=NEW, natural_tests=500, page="out.html")
    page = Page(tmp_path / "out.html")
    assert said.natural is not None
    assert said.got_worse
    assert "No: it crashes more often." in page.text
    cases = page.data("cases")
    natural = [case for case in cases if case["drive"] == "natural traffic"]
    assert len(natural) == min(16, said.natural.new_crashes)
    assert all(case["id"] == f"natural/{case['title'].split()[1][:-1]}" for case in natural)
    assert len({case["id"] for case in cases}) == len(cases)
    assert all(case["old"]["crash"] is None and case["new"]["crash"] is not None for case in natural)


def test_a_page_is_not_written_over(swerve_library: Path, tmp_path: Path) -> None:
    (tmp_path / "there.html").touch()
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.retest(swerve_library, av=NEW, page=tmp_path / "there.html")
