"""Pictures of README and docs are of today's version and traffic, and all of them are there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cornerforge
from cornerforge.ndd.model import default_model_path, load_model, model_hash

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "docs" / "gallery"
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")


def test_the_pictures_are_of_today() -> None:
    made = json.loads((PLACE / "made.json").read_text(encoding="utf-8"))
    assert made == {"version": cornerforge.__version__, "traffic": model_hash(load_model(default_model_path()))}, (
        "make gallery"
    )


def test_sixteen_cases_of_four_avs_and_five_origins_are_filmed() -> None:
    films = re.findall(r'src="gallery/([a-z-]+)-(natural|bounded|free|ramp|queue)-(\d+)\.webm', PAGE)
    assert len(films) == len(set(films)) == 16
    assert len({(av, origin) for av, origin, _ in films}) == 13
    assert len({(av, test) for av, _, test in films}) == 16, "no test is shown twice"
    for parts in films:
        content = (PLACE / f"{'-'.join(parts)}.webm").read_bytes()
        assert content[:4] == b"\x1a\x45\xdf\xa3"  # EBML
        assert len(content) > 10_000
    assert {path.name for path in PLACE.iterdir()} == {f"{'-'.join(one)}.webm" for one in films} | {
        "natural.png", "bounded.png", "free.png", "ramp.png", "queue.png", "made.json",
    }  # fmt: skip
