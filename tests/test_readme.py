"""The start page: short, and its lines of Python print what it says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_page_is_read_in_ten_minutes() -> None:
    assert len(PAGE.splitlines()) <= 100
    (lines,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    assert len(lines.splitlines()) <= 8


@pytest.mark.full
def test_its_lines_print_what_it_says(tmp_path: Path) -> None:
    (lines, said) = re.findall(r"```python\n(.*?)```\n\n```\n(.*?)```", PAGE, flags=re.DOTALL)[0]
    done = subprocess.run([sys.executable, "-c", lines], cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.stdout == said, done.stderr
    assert (tmp_path / "page" / "report.html").is_file()
