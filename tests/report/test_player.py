"""A case in a notebook: a page of its own in a frame, which plays the recording and asks nothing from elsewhere."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

from crashes_by_hand import MIDDLE, Car, crash
from html_page import Page, browse, needs_browser

import cornerforge
from cornerforge.experiment.roads import road_named
from cornerforge.ext.pictures.player import player
from cornerforge.library import CaseLibrary
from cornerforge.report.cases import case_data
from cornerforge.types import Scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
STRUCK = crash(Car(0.0, MIDDLE, 25.0), Car(40.0, MIDDLE, 15.0))


class Frames(HTMLParser):
    """Attributes of the frames, and of nothing else."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[dict[str, str | None]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag == "iframe"
        self.found.append(dict(attrs))


def page_of(html: str, file: Path) -> Page:
    (frame,) = Frames(html).found
    assert frame["sandbox"] == "allow-scripts"  # it cannot reach the notebook
    file.write_text(frame["srcdoc"] or "", encoding="utf-8")
    return Page(file)


def test_the_frame_holds_the_recording_and_what_happened(tmp_path: Path) -> None:
    page = page_of(player("0:7", STRUCK), tmp_path / "page.html")
    (case,) = page.data("cases")
    assert case["vehicles"] == case_data("0:7", STRUCK)["vehicles"]
    assert case["crash"] == round(10.0 * STRUCK.crash.time) if STRUCK.crash else False
    assert "The AV runs into the rear" in page.text
    assert "Case 0:7: crash after 3." in page.text
    assert "at 25.0 m/s, strikes the car in slot 1, at 15.0 m/s" in page.text


def test_a_name_of_a_case_is_text_and_nothing_is_loaded(tmp_path: Path) -> None:
    name = '</script><img src="https://example.org">'
    page = page_of(player(name, STRUCK), tmp_path / "page.html")
    assert f"Case {name}: " in page.text
    assert page.data("cases")[0]["id"] == name
    assert not [values for tag, values in page.tags if tag in ("img", "link", "iframe") or values.get("src")]


def test_a_case_of_a_library_plays_and_says_in_a_line_what_it_is(swerve_library: Path, tmp_path: Path) -> None:
    library = CaseLibrary.open(swerve_library)
    case_id = library.scalars(["case_id"])["case_id"][0].as_py()
    case = library.scenario(case_id)
    assert page_of(case._repr_html_(), tmp_path / "page.html").data("cases")[0]["id"] == case_id
    assert repr(case).startswith(f"<case {case_id}: crash after ")
    told = library._repr_html_()
    assert f"<td>cases</td><td>{len(library):,}</td>" in told
    assert "<td>bv</td><td>swerve</td>" in told


def test_a_driven_case_plays_also_without_a_crash(tmp_path: Path) -> None:
    driven = cornerforge.drive_case(EXAMPLES / "cases" / "hard-braking.json", av="rss-cautious")
    page = page_of(driven._repr_html_(), tmp_path / "page.html")
    (case,) = page.data("cases")
    assert case["id"] == driven.case
    assert (driven.crashed, case["crash"]) == (False, None)
    assert "The AV does not crash" in page.text
    assert "Case hard-braking: no crash of the AV in 9.0 s" in page.text


@needs_browser
def test_the_frame_is_drawn_by_a_browser(tmp_path: Path) -> None:
    page_of(player("0:7", STRUCK), tmp_path / "page.html")
    (tmp_path / "notebook.html").write_text(player("0:7", STRUCK), encoding="utf-8")
    assert "<iframe" in browse((tmp_path / "notebook.html").as_uri(), tmp_path / "profile")
    document = browse((tmp_path / "page.html").as_uri(), tmp_path / "profile")
    canvas = document.partition('id="look-road"')[2].partition(">")[0]
    assert "width=" in canvas  # the script has set it


COUNTS = """
setTimeout(() => {
  const canvas = document.getElementById("look-road");
  const pixels = canvas.getContext("2d").getImageData(Math.floor(0.97 * canvas.width), 0, 1, canvas.height).data;
  let same = 0;
  for (let i = 0; i < pixels.length; i += 4) same += [0, 1, 2].every((k) => pixels[i + k] === pixels[k]);
  document.body.dataset.verge = (4 * same) / pixels.length;
}, 1000);
"""


def verge(scenario: Scenario, folder: Path) -> float:
    """The share of grass at the right end of the picture, where the AV is going."""
    page_of(player("0:7", scenario), folder / "page.html")
    # The policy forbids foreign scripts, so it goes for the sake of the script that counts.
    text = re.sub(r"<meta http-equiv[^>]*>", "", (folder / "page.html").read_text(encoding="utf-8"))
    (folder / "page.html").write_text(text.replace("</body>", f"<script>{COUNTS}</script></body>"), encoding="utf-8")
    found = re.search(r'data-verge="([^"]*)"', browse((folder / "page.html").as_uri(), folder / "profile"))
    assert found is not None
    return float(found[1])


@needs_browser
def test_a_browser_draws_grass_where_no_lane_is(tmp_path: Path) -> None:
    whole = STRUCK.odd
    road = replace(road_named("lane-drop"), lane_width=whole.lane_width)
    ended = replace(whole, road=road, road_at=1000.0)  # its right lane ended 100 m before the AV starts
    shares = [verge(replace(STRUCK, odd=odd), tmp_path) for odd in (whole, ended)]
    height = whole.n_lanes * whole.lane_width
    assert 0.05 < shares[0] < 0.5
    assert shares[1] - shares[0] > 0.5 * (1.0 - shares[0]) * whole.lane_width / height
