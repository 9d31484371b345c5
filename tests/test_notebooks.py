"""The notebooks: each is short, is committed with its outputs, and says the same when it is run again."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError
from notebooks import FOLDER, executed, texts, tidied
from site_pages import ROOT, file_of, page_of, shown_notebook, target_of

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def test_there_are_six_in_their_order() -> None:
    assert [path.name[:2] for path in NOTEBOOKS] == ["1-", "2-", "3-", "4-", "5-", "6-"]


@each
def test_a_notebook_is_short_tidy_and_has_its_outputs(path: Path) -> None:
    notebook = read(path)
    assert len(notebook.cells) <= 15
    assert notebook.cells[0].source.startswith("# ")
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1)), "run: make notebooks"
    assert all(cell.outputs for cell in code)
    assert not [one for cell in code for one in cell.outputs if one.output_type == "error"]
    assert tidied(copy.deepcopy(notebook)) == notebook, "run: make notebooks"


@each
def test_links_of_a_notebook_lead_to_files(path: Path) -> None:
    name = path.relative_to(ROOT).as_posix()
    assert file_of(page_of(name)) == name
    for cell in read(path).cells:
        for link in [part.partition(")")[0] for part in cell.source.split("](")[1:] if cell.cell_type == "markdown"]:
            target = target_of(link, name)
            assert target is None or (ROOT / target).is_file(), link


def test_a_notebook_becomes_a_page_with_its_outputs() -> None:
    printed = {"output_type": "stream", "name": "stdout", "text": ["0.1 < 1\n"]}
    table = {"output_type": "execute_result", "data": {"text/html": ["<table>", "</table>"]}}
    picture = {"output_type": "display_data", "data": {"image/png": "QUJD\n"}}
    page = shown_notebook(
        "docs/notebooks/x.ipynb",
        {
            "cells": [
                {
                    "cell_type": "markdown",
                    "source": ["# Title\n", "[a](2-b.ipynb), [c](../adr/0001-record-decisions.md)"],
                },
                {"cell_type": "code", "source": "a][0]", "outputs": [printed, table, picture]},
            ]
        },
    )
    assert page.startswith("# Title\n[a](2-b.md), [c](../adr/0001-record-decisions.md)\n\n")
    assert '<a href="x.ipynb" download>' in page
    assert "```python\na][0]\n```\n\n" in page
    assert '<div class="output"><pre>0.1 &lt; 1\n</pre></div>' in page
    assert '<div class="output"><table></table></div>' in page
    assert 'src="data:image/png;base64,QUJD">' in page


@pytest.mark.full
@each
def test_a_notebook_says_the_same_when_it_is_run_again(path: Path, tmp_path: Path) -> None:
    assert texts(executed(path, tmp_path)) == texts(read(path)), "if that is meant: make notebooks"


@pytest.mark.full
def test_a_cell_that_fails_is_a_failure(tmp_path: Path) -> None:
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("print(1)\n1 / 0")])
    nbformat.write(notebook, tmp_path / "bad.ipynb")
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        executed(tmp_path / "bad.ipynb", tmp_path)
