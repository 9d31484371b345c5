"""The explorer as somebody uses it, in a browser without a GPU."""

from __future__ import annotations

import io
import re
import shutil
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pytest
from browser_session import Opener, Server, serve, until
from PIL import Image

pytestmark = pytest.mark.browser

FIRST = "The most frequent crash that a careful driver would have prevented"


def shown(page: Any) -> tuple[int, int]:
    """Cases that pass the filters, and all cases."""
    line = page.locator(".counted").text_content()
    found = re.match(r"([\d,]+) of ([\d,]+) cases", line)
    assert found is not None, line
    few, all_ = (int(part.replace(",", "")) for part in found.groups())
    return few, all_


def ready(page: Any) -> Any:
    page.get_by_role("heading", name=FIRST).wait_for()
    until(page, "/^[1-9]/.test(document.querySelector('.counted')?.textContent)")
    return page


def watching(page: Any) -> Any:
    """The watched case, once it is there."""
    page.locator(".watch").get_by_role("slider", name="Time").wait_for()
    return page.locator(".watch")


def seconds(page: Any) -> float:
    return float(page.locator(".watch").get_by_role("timer").inner_text().split(" s")[0])


def first_case(page: Any) -> str:
    """Key of the case of the first card."""
    found = re.search(r"Case (\S+) at the contact", page.get_by_role("img").first.get_attribute("aria-label"))
    assert found is not None
    return found.group(1)


def test_a_newcomer_plays_the_most_frequent_preventable_natural_crash(server: Server, look: Opener) -> None:
    """Without reading anything: it is the first thing on the page, in sight, with the first button that says Play."""
    page = ready(look(server.url))
    play = page.get_by_role("button", name="Play").first
    box = play.bounding_box()
    assert box["y"] + box["height"] <= 720
    assert FIRST in play.get_attribute("aria-label")
    play.click()
    page.get_by_role("button", name="Pause").wait_for()
    before = seconds(page)
    page.get_by_role("button", name="Play", exact=True).wait_for()  # it has come to its end
    assert seconds(page) > before
    assert page.locator(".watch").get_by_role("timer").inner_text().endswith("contact")
    assert "case=natural/" in page.url
    assert "by braking" in page.locator(".watch").inner_text()


def test_filters_narrow_all_views_and_the_link_shows_the_same_again(server: Server, look: Opener) -> None:
    page = ready(look(server.url + "#f.source=adversary"))
    all_ = shown(page)
    box = page.get_by_role("region", name="Filters").get_by_role("checkbox", name="a careful driver, by braking")
    expected = int(re.sub(r"\D", "", box.evaluate("box => box.closest('label').innerText")))
    box.check()
    until(page, f"document.querySelector('.counted').textContent.startsWith('{expected:,} of')")
    assert 0 < expected < all_[0]
    page.keyboard.press("j")  # the checkbox has the focus
    page.keyboard.press("Enter")
    until(page, "location.hash.includes('case=')")
    page.keyboard.press("Escape")
    until(page, "!location.hash.includes('case=')")
    grid = page.get_by_role("grid")
    assert int(grid.get_attribute("aria-rowcount")) == expected + 1
    assert all("a careful driver" in text for text in grid.get_by_role("row").all_inner_texts()[1:])
    until(page, "location.hash.includes('f.prevention=')")
    again = ready(look(page.url))
    until(again, f"document.querySelector('.counted').textContent.startsWith('{expected:,} of')")
    assert again.get_by_role("region", name="Filters").get_by_role("checkbox", checked=True).count() == 1


def test_the_lasso_chooses_what_it_encloses(server: Server, look: Opener) -> None:
    page = ready(look(server.url))
    all_ = shown(page)[0]
    page.get_by_role("button", name="Lasso").click()
    box = page.get_by_role("application").bounding_box()
    left, top, right, bottom = box["x"] + 5, box["y"] + 5, box["x"] + box["width"] / 2, box["y"] + box["height"] - 5
    page.mouse.move(left, top)
    page.mouse.down()
    for x, y in ((right, top), (right, bottom), (left, bottom), (left, top)):
        page.mouse.move(x, y, steps=6)
    page.mouse.up()
    until(page, "location.hash.includes('lasso=')")
    until(page, f"!document.querySelector('.counted').textContent.startsWith('{all_:,} of')")
    half = shown(page)[0]
    assert 0 < half < all_
    again = ready(look(page.url))
    until(again, f"document.querySelector('.counted').textContent.startsWith('{half:,} of')")


def test_a_click_on_the_map_shows_the_case_under_it(server: Server, look: Opener) -> None:
    page = ready(look(server.url + "#f.source=natural"))
    place = page.get_by_role("application").bounding_box()
    tip = page.locator(".tip")
    for i in range(800):  # over the map until there is a point under the pointer
        across, up = (i % 40) / 39, (i // 40) / 19
        page.mouse.move(
            place["x"] + place["width"] * (0.05 + 0.9 * across), place["y"] + place["height"] * (0.1 + 0.8 * up)
        )
        if tip.count():
            break
    named = tip.locator("b").inner_text()
    page.mouse.down()
    page.mouse.up()
    until(page, "location.hash.includes('case=')")
    watching(page)
    assert f"case={named}&" in unquote(page.url) + "&"


def test_sql_filters_and_says_what_is_wrong(server: Server, look: Opener) -> None:
    page = ready(look(server.url, allowed=("400",)))
    all_ = shown(page)[0]
    page.get_by_text("SQL, for experts").click()
    box = page.get_by_role("textbox", name="Condition in SQL")
    box.fill("crash_time_s > 8")
    box.press("Control+Enter")
    until(page, "location.hash.includes('sql=')")
    until(page, f"!document.querySelector('.counted').textContent.startsWith('{all_:,} of')")
    assert 0 < shown(page)[0] < all_
    box.fill("no_such_column > 8")
    box.press("Control+Enter")
    page.get_by_text("no_such_column").filter(visible=True).first.wait_for()


def test_a_case_beside_the_same_with_another_av_in_step(server: Server, look: Opener) -> None:
    page = ready(look(server.url))
    page.get_by_role("button", name="Play").first.click()
    case = watching(page)
    case.locator("select:has(option[value='av:idm-mobil'])").select_option("av:idm-mobil")
    until(page, "document.querySelectorAll('.watch canvas[data-view]').length === 2")
    until(page, "decodeURIComponent(location.hash).includes('beside=av:idm-mobil')")
    again = look(page.url)
    until(again, "document.querySelectorAll('.watch canvas[data-view]').length === 2")
    again.keyboard.press("End")
    pictures = again.locator(".watch canvas[data-view]")
    of_the_first, of_the_other = (pictures.nth(k) for k in (0, 1))
    assert "flawed-brakes-late" in of_the_first.evaluate("picture => picture.closest('figure').textContent")
    assert "idm-mobil" in of_the_other.evaluate("picture => picture.closest('figure').textContent")
    assert of_the_first.screenshot() != of_the_other.screenshot(), "two AVs, two drives"
    assert again.locator(".watch").get_by_role("slider", name="Time").count() == 1, "one clock for both"


def colours(picture: bytes) -> int:
    """How many colours cover at least a thousandth of a picture."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    counts = image.getcolors(image.width * image.height) or []
    return sum(1 for n, _ in counts if 1000 * n >= image.width * image.height)


def test_three_dimensions_come_without_a_graphics_card(server: Server, look: Opener) -> None:
    key = first_case(ready(look(server.url)))
    page = look(f"{server.url}#case={quote(key, safe='/:')}&t=crash&camera=chase", allowed=("WebGL", "GPU stall"))
    drawn = page.locator(".watch canvas[data-view], .watch [data-view=chase] canvas").first
    drawn.wait_for()
    seen = 0
    for _ in range(100):
        seen = colours(drawn.screenshot())
        if seen >= 5:
            break
        page.wait_for_timeout(100)
    assert seen >= 5, "road, lines, verge, the AV, the other"


@pytest.mark.parametrize("wrong", ["natural/0:999999999", "nowhere/0:1", "../../etc/passwd", "natural/%00"])
def test_a_bad_link_is_said_and_the_page_goes_on(server: Server, look: Opener, wrong: str) -> None:
    page = ready(look(f"{server.url}#case={wrong}&f.nothing=1&colour=none&t=x", allowed=("404", "400")))
    said = page.locator(".banners")
    said.get_by_text("a case that is not here").wait_for()
    assert "a column that is not here: none" in said.inner_text()
    page.get_by_role("button", name="Play").first.click()
    assert watching(page).is_visible()


@pytest.mark.parametrize("dark", [False, True])
def test_a_phone_shows_all_of_it_without_scrolling_sideways(server: Server, look: Opener, dark: bool) -> None:
    page = ready(look(server.url, width=390, height=844, dark=dark))
    wide = "document.documentElement.scrollWidth"
    assert page.evaluate(wide) <= 390
    page.get_by_role("button", name="Play").first.click()
    watching(page)
    assert page.evaluate(wide) <= 390
    for tab in ("Map", "List", "Filters"):
        page.get_by_role("tab", name=tab).or_(page.get_by_role("button", name=tab, exact=True)).first.click()
        assert page.evaluate(wide) <= 390
    light = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(int(part) for part in re.findall(r"\d+", light)[:3]) < 200) is dark


def test_the_keyboard_reaches_everything(server: Server, look: Opener) -> None:
    page = ready(look(server.url))
    page.keyboard.press("?")
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="hidden")
    page.keyboard.press("j")
    page.keyboard.press("Enter")
    watching(page)
    page.keyboard.press("Space")
    page.get_by_role("button", name="Pause").wait_for()
    page.keyboard.press("Space")
    at = seconds(page)
    page.keyboard.press("ArrowRight")
    until(page, f"!document.querySelector('.watch [role=timer]').textContent.startsWith('{at:.1f} s')")
    assert seconds(page) == pytest.approx(at + 0.1, abs=0.051)
    page.keyboard.press("Escape")
    page.locator(".watch").wait_for(state="detached")


def test_a_library_without_analysis_gets_one_while_it_is_looked_at(look: Opener, run: Path, tmp_path: Path) -> None:
    shutil.copytree(run / "library", tmp_path / "bare")
    bare = serve(tmp_path / "bare")
    try:
        page = look(bare.url, allowed=("ERR_CONNECTION_REFUSED",))  # asks on until the page is closed
        until(page, "/^300 of 300/.test(document.querySelector('.counted')?.textContent)")
        page.get_by_role("button", name="Play").first.wait_for(timeout=100_000)
        assert (tmp_path / "bare-analysis" / "analysis.json").is_file()
    finally:
        bare.stop()


def test_a_server_that_is_gone_is_said(look: Opener, run: Path) -> None:
    gone = serve(run)
    page = ready(look(gone.url, allowed=("ERR_CONNECTION_REFUSED", "Failed to fetch", "Failed to load")))
    gone.stop()
    page.get_by_role("grid").get_by_role("row").nth(1).click()
    told = page.get_by_role("alert").filter(has_text="server").first
    told.wait_for()
    assert "Try again" in told.inner_text()
