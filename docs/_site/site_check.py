"""What `make docs` checks of the built site (python docs/_site/site_check.py SITE): it loads nothing from elsewhere.

A link that a reader may follow is no fault; a script, a style, a font, a picture or a frame of another host is one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "link": "href"}
ELSEWHERE = re.compile(r"^(?:[a-z]+:)?//", flags=re.IGNORECASE)
IN_STYLE = re.compile(r"""(?:url\(\s*|@import\s+)["']?((?:[a-z]+:)?//[^"')\s]+)""", flags=re.IGNORECASE)


class Loads(HTMLParser):
    """Collects what a page loads from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        place = values.get(LOADS.get(tag, "")) or ""
        if ELSEWHERE.match(place) and not (tag == "link" and values.get("rel") in {"canonical", "next", "prev"}):
            self.found.append(f"<{tag}> {place}")
        self.found += IN_STYLE.findall(values.get("style") or "")


def loaded_from_elsewhere(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".css":
        return IN_STYLE.findall(text)
    loads = Loads()
    loads.feed(text)
    styles = re.findall(r"<style\b[^>]*>(.*?)</style>", text, flags=re.DOTALL)
    return loads.found + [place for style in styles for place in IN_STYLE.findall(style)]


def faults(site: Path) -> Iterator[str]:
    for path in sorted(site.rglob("*")):
        if path.suffix in {".html", ".css"}:
            yield from (f"{path.relative_to(site)}: {place}" for place in loaded_from_elsewhere(path))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    n_pages = sum(1 for _ in folder.rglob("*.html"))
    wrong = list(faults(folder))
    print("\n".join(wrong) or f"{n_pages} pages; none loads anything from elsewhere.")
    sys.exit(bool(wrong) or n_pages < 60)
