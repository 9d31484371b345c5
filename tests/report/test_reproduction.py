"""The page of `reproduce`: made from `items.json` alone, whole, safe against texts in it, the same each time."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from edited_files import write_object

from cornerforge.errors import FileFormatError
from cornerforge.ext.paper.reproduce import ITEMS
from cornerforge.ext.paper.reproduction import RENDERERS, write_reproduction

pytestmark = pytest.mark.full

TYPES = {"rear-end by AV": 1, "rear-end by BV": 3, "head-on": 0, "sideswipe": 6, "angle": 0}


def a_row(what: str = "crashes", **more: Any) -> dict[str, Any]:
    return {"what": what, "paper": 0.286, "ours": 0.9, "interval": [0.8, 0.95], "unit": "crashes per test", "note": "",
            **more}  # fmt: skip


def a_cell(trained_on: str | None, bounded: bool, av: str) -> dict[str, Any]:
    name = "swerve" if trained_on is None else f"{trained_on}.crash"
    return {
        "adversary": "swerve" if trained_on is None else "learned", "trained_on": trained_on, "bounded": bounded,
        "av": av, "net_per_test": 0.5,
        "paper": None if trained_on is None or bounded else 0.286, "typed": 10, "crash_types": TYPES,
        "key": f"{name}.{'bounded' if bounded else 'free'}",
    }  # fmt: skip


def drawable() -> dict[str, dict[str, Any]]:
    """`data` of each item that has pictures, in the shape that the items give."""
    curve = {"name": "preset fast, seed 0", "decisions": [1e5, 2e5], "seconds": [3.0, 6.0], "epsilon": [1.0, 0.5],
             "crashes_per_test": [0.1, 0.6], "low": [0.05, 0.5], "high": [0.2, 0.7]}  # fmt: skip
    quantity = {"unit": "m", "edges": [0.0, 2.0, 4.0], "counts": {"natural": [1, 4], "adversary": [5, 0]}}
    names = ("bbd_front", "bbd_rear", "ttc_front", "ttc_rear")
    group = {"name": "idm-mobil, unbounded", "av": "idm-mobil", "bounded": False, "crashes": 10,
             "shares": [0.1, 0.3, 0.0, 0.6, 0.0], "intervals": [[0.0, 0.9]] * 5}  # fmt: skip
    nothing = {"name": "idm-mobil, bounded", "av": "idm-mobil", "bounded": True, "crashes": 0,
               "shares": [None] * 5, "intervals": [None] * 5}  # fmt: skip
    avs = ["idm-mobil", "idm-mobil-d2rl"]
    period = {"steps": 1, "cases": 40, "minority": 2, "explained": 0.7,
              "points": {"majority": [[0.0, 1.0], [0.1, 0.9]], "minority": []}}  # fmt: skip
    cluster = {
        "letter": "A",
        "group": "majority",
        "size": 2,
        "points": [[0.0, 1.0], [0.1, 0.9]],
        "typical": [[0.0, 1.0]],
    }
    at = {"eps_factor": 1.0, "eps": 0.3, "min_samples": 4, "majority_share": 0.9, "noise_share": 0.1,
          "dense_clusters": 1, "agreement": 1.0}  # fmt: skip
    clusters = {
        "clusters": [cluster, cluster | {"letter": "B", "group": "minority"}], "rare": [], "explained": [0.5, 0.2],
        "silhouettes": {"majority": {"k": 1, "silhouettes": {"2": 0.4}, "bound": 0.5},
                        "minority": {"k": 1, "silhouettes": {}, "bound": None}},
        "density": {"eps": 0.3, "min_samples": 4, "rank": [0.0, 1.0], "distance": [0.0, 0.5],
                    "sensitivity": [at, at | {"eps_factor": 2.0}]},
    }  # fmt: skip
    moment = {
        "before": 0.0,
        "av": [0.0, 2.0, 0.0, 5.0, 2.0],
        "bv": [4.9, 2.0, 0.1, 5.0, 2.0],
        "others": [[-20.0, 6.0, 0.0, 16.5, 2.55]],
    }
    example = {"title": "A (majority, 2 cases)", "case": "0:1", "mechanism": "av-rear", "happened": "BV brakes",
               "lanes": 3, "lane_width": 4.0,
               "moments": [moment | {"before": 1.0, "bv": None, "others": []}, moment]}  # fmt: skip
    return {
        "figure7": {"worlds": [{"name": name, "periods": [period] * 3} for name in ("unbounded", "bounded")]},
        "figure8": clusters,
        "figure10": {},  # no library: crashes were too rare
        "figure6": {"examples": [example]},
        "figure9": {"examples": [example] * 3},
        "figure11": {},
        "figure2": {"curves": [curve], "levels": {"swerve": 0.7},
                    "paper": {"seconds": 345_600.0, "crashes_per_test": 0.286}},
        "figure3": {"quantities": {name: quantity | {"label": name} for name in names},
                    "miles": {"natural": 50.0, "adversary": 51.0}},
        "figure5": {"groups": [group, nothing], "types": list(TYPES)},
        "matrix": {"cells": [a_cell(on, b, av) for b in (False, True) for on in (None, "idm-mobil") for av in avs],
                   "avs": avs, "natural": {}},
    }  # fmt: skip


def write_items(folder: Path, **changes: Any) -> Path:
    items = []
    for name in ITEMS:
        about = {"id": name, "title": f"Item {name}", "place": "Figure", "says": "something", "notes": ["A note."]}
        items.append({**about, **a_row(), "rows": [a_row(), a_row(paper=None, interval=None)],
                      "data": drawable().get(name, {}), "seconds": 0.5, **changes})  # fmt: skip
    write_object(folder / "items.json", {"effort": "quick", "seed": 0, "items": items})
    made = {"cornerforge": "0", "command": "cornerforge reproduce", "identity": {"seed": 0}, "machine": {"cores": 2}}
    write_object(folder / "provenance.json", made)
    return folder


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


def test_renderers_are_of_items() -> None:
    assert set(RENDERERS) <= set(ITEMS)
    assert set(RENDERERS) == set(drawable())


def test_each_item_has_its_section_pictures_and_numbers(tmp_path: Path) -> None:
    page = write_reproduction(write_items(tmp_path)).read_text(encoding="utf-8")
    tags = Tags(page)
    assert [a.get("id") for tag, a in tags.found if tag == "section"] == [*ITEMS, "made"]
    pictures = [a for tag, a in tags.found if tag == "img"]
    assert len(pictures) == 11  # one each, two of Figure 7, of Figure 8 and of the matrix, none without a library
    assert all((a["src"] or "").startswith("data:image/png;base64,") and a["alt"] for a in pictures)
    assert "the paper 0.286, ours 0.900 crashes per test (95 % interval 0.800 to 0.950)" in tags.text
    assert {entry.name for entry in (tmp_path / "figures").iterdir()} == {
        f"{name}.{ending}"
        for name in (
            "figure2",
            "figure3",
            "figure5",
            "figure6",
            "figure7",
            "figure7-bounded",
            "figure8",
            "figure8-choices",
            "figure9",
            "matrix",
            "matrix-types",
        )
        for ending in ("png", "svg")
    }


def test_the_page_needs_nothing_else_and_runs_nothing(tmp_path: Path) -> None:
    page = write_reproduction(write_items(tmp_path)).read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page)
    assert "<script" not in page
    assert "default-src 'none'" in page


def test_texts_are_shown_not_taken_for_markup(tmp_path: Path) -> None:
    page = write_reproduction(write_items(tmp_path, notes=["<img src=x onerror=alert(1)>"])).read_text(encoding="utf-8")
    assert "<img src=x" not in page
    assert "&lt;img src=x" in page


def test_same_numbers_same_bytes(tmp_path: Path) -> None:
    one, two = (tmp_path / name for name in ("one", "two"))
    for folder in (one, two):
        folder.mkdir()
        write_reproduction(write_items(folder))
    for name in ("index.html", *(f"figures/{entry.name}" for entry in (one / "figures").iterdir())):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"items\.json is missing"):
        write_reproduction(tmp_path)
    write_items(tmp_path)
    content = json.loads((tmp_path / "items.json").read_text(encoding="utf-8"))
    del content["items"][0]["rows"]
    write_object(tmp_path / "items.json", content)
    with pytest.raises(FileFormatError, match=r"items\[0\]\.rows.*missing"):
        write_reproduction(tmp_path)
    assert not (tmp_path / "index.html").exists()
