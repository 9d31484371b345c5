"""The site of the documentation: where its links lead, and what a page may load. `make docs` builds it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from site_check import faults
from site_pages import ROOT, file_of, files_outside, page_of, page_of_module, promised, with_links_of_the_site

GOOD = '<link rel="canonical" href="https://example.org/"><a href="https://example.org">a</a><img src="images/a.png">'


@pytest.mark.parametrize(
    ("path", "link", "led"),
    [
        ("README.md", "docs/design.md#the-world", "design.md#the-world"),
        ("docs/design.md", "../CONTRIBUTING.md", "contributing.md"),
        ("docs/adr/0018-impact.md", "../../examples/my_av.py", "../source/examples/my_av.py.md"),
        ("docs/adr/0001-record-decisions.md", "template.md", "template.md"),
        ("README.md", "docs/notebooks/1-first-run.ipynb", "notebooks/1-first-run.md"),
        ("docs/commands.md", "#run", "#run"),
        ("docs/many-machines.md", "https://docs.ray.io", "https://docs.ray.io"),
    ],
)  # fmt: skip
def test_links_lead_to_pages(path: str, link: str, led: str) -> None:
    assert with_links_of_the_site(f"see [it]({link}).", path) == f"see [it]({led})."


def test_code_is_left_as_it_is() -> None:
    text = "`[a](docs/b.md)`\n\n```\n[a](docs/b.md)\n```\n"
    assert with_links_of_the_site(text, "README.md") == text


def test_files_outside_are_found_and_are_there() -> None:
    texts = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    }
    outside = files_outside(texts)
    assert "examples/my_av.py" in outside
    assert not [path for path in outside if not (ROOT / path).is_file()]
    assert all(file_of(page_of(path)) == path for path in [*texts, *outside])


def test_the_navigation_names_every_page() -> None:
    """`mkdocs build --strict` refuses a page without a place, too; this is quicker."""
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    named = set(re.findall(r"[\w/-]+\.md", navigation))
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    assert pages <= named
    assert not [
        name for name in named - pages if not name.startswith(("index", "contributing", "security", "changelog"))
    ]


def test_the_python_interface_is_that_of_the_list() -> None:
    names = {f"{module}.{name}" for module, given in promised().items() for name in given}
    assert "cornerforge.simulate" in names
    assert "cornerforge.metrics.ttc" in names
    griffe = pytest.importorskip("griffe", reason="`make docs` has it")
    package = griffe.load("cornerforge", search_paths=[str(ROOT / "src")])
    assert "::: cornerforge.metrics.ttc.ttc" in page_of_module(package, "cornerforge.metrics", ["ttc"])


@pytest.mark.parametrize(
    "bad",
    [
        '<script src="https://example.org/a.js"></script>',
        '<link rel="stylesheet" href="//example.org/a.css">',
        '<img src="http://example.org/a.png">',
        "<style>@import 'https://example.org/a.css';</style>",
        '<p style="background: url(https://example.org/a.png)">',
    ],
)
def test_what_is_loaded_from_elsewhere_is_seen(bad: str, tmp_path: Path) -> None:
    (tmp_path / "good.html").write_text(GOOD, encoding="utf-8")
    (tmp_path / "good.css").write_text("a { background: url(images/a.png); }", encoding="utf-8")
    assert not list(faults(tmp_path))
    (tmp_path / "bad.html").write_text(GOOD + bad, encoding="utf-8")
    (found,) = faults(tmp_path)
    assert found.startswith("bad.html: ")
