"""benchmarks/reproduction.py writes what `items.json` says, and only between its marks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from document import MarkedBlock
from reproduction import IN_DOCUMENT, main


def row(what: str, paper: Any, ours: Any, interval: list[float] | None, unit: str = "") -> dict[str, Any]:
    return {"what": what, "paper": paper, "ours": ours, "interval": interval, "unit": unit, "note": "so"}


def cell(adversary: str, trained_on: str | None, bounded: bool, net: float) -> dict[str, Any]:
    return {
        "adversary": adversary, "trained_on": trained_on, "reward": "crash" if trained_on else None,
        "bounded": bounded, "av": "idm-mobil", "net_per_test": net, "net_interval95": [net - 0.01, net + 0.01],
        "avoidable_per_test": net / 2.0, "avoidable_interval95": [0.0, net],
        "paper": 0.286 if trained_on and not bounded else None,
    }  # fmt: skip


@pytest.fixture
def reproduction(tmp_path: Path) -> Path:
    about = {"place": "Figure 0", "says": "something"}
    natural = {"idm-mobil": {"crashes_per_test": 1.5e-4, "tests": 20_000, "interval95": [3.1e-5, 4.4e-4]}}
    cells = [cell("swerve", None, False, 0.7), cell("learned", "idm-mobil", False, 0.95),
             cell("swerve", None, True, 0.005), cell("learned", "idm-mobil", True, 0.1)]  # fmt: skip
    timing = row("time", 345_600.0, 1.5, None, "s")
    headline, unknown = row("yield", 0.286, 0.95, [0.94, 0.96]), row("nothing", None, None, None, "s")
    items = [
        {**about, **headline, "id": "figure2", "title": "Training", "rows": [headline, timing, unknown]},
        {**about, **headline, "id": "matrix", "title": "Matrix", "rows": [headline],
         "data": {"avs": ["idm-mobil"], "natural": natural, "cells": cells}},
    ]  # fmt: skip
    (tmp_path / "items.json").write_text(json.dumps({"effort": "quick", "seed": 0, "items": items}))
    (tmp_path / "provenance.json").write_text(json.dumps({"identity": {"code": "c0de", "model_hash": "m0de1"}}))
    return tmp_path


def test_every_number_stands_beside_the_papers(reproduction: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(reproduction), "--rows"]) == 0
    text = capsys.readouterr().out
    assert "| yield | 0.286 | 0.95 | 0.94 to 0.96 | so |" in text
    assert "| time | 345,600 | 1.5 s |  | so |" in text
    assert "nothing" not in text
    assert "Matrix" not in text
    assert main([str(reproduction)]) == 0
    text = capsys.readouterr().out
    assert "| Training: yield | 0.286 | 0.95 | 0.94 to 0.96 | so |" in text
    assert "| time |" not in text
    assert "| `idm-mobil` | 3 of 20,000 | 3.1e-05 to 4.4e-04 |" in text
    assert "| swerve | 0.7 (0.69 to 0.71) |" in text
    assert "| on `idm-mobil`, crash | 0.95 (0.94 to 0.96) [paper 0.286] |" in text
    assert "| on `idm-mobil`, crash | 0.1 (0.09 to 0.11) |" in text  # bounded: the paper reports none
    assert "| swerve | 0.005 (0 to 0.015) |" in text  # a rate is not negative
    assert "`c0de`" in text
    assert "1 training(s)" in text


def test_only_the_block_is_written(reproduction: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = reproduction / "page.md"
    page.write_text(f"before\n{IN_DOCUMENT.begin}\nold\n{IN_DOCUMENT.end}\nafter\n")
    assert main([str(reproduction), "--write", str(page)]) == 0
    text = page.read_text()
    assert text.startswith(f"before\n{IN_DOCUMENT.begin}\nEffort")
    assert text.endswith(f"{IN_DOCUMENT.end}\nafter\n")
    assert "old" not in text
    page.write_text("no marks")
    with pytest.raises(SystemExit):
        main([str(reproduction), "--write", str(page)])
    assert IN_DOCUMENT.begin in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([str(reproduction / "nothing")])
    assert "cornerforge reproduce" in capsys.readouterr().err


def test_marks_in_the_wrong_order_are_no_block(tmp_path: Path) -> None:
    block = MarkedBlock("benchmarks/some.py")
    page = tmp_path / "page.md"
    page.write_text(f"{block.end}\n{block.begin}\n")
    assert "benchmarks/some.py" in str(block.missing_in(page))
    page.write_text(f"{block.begin}\n{block.end}\n")
    assert block.missing_in(page) is None
    assert block.replace_in(f"a{block.begin}b{block.end}c", "new") == f"a{block.begin}\nnew\n{block.end}c"
