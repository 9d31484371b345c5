"""The repository as a whole: versions agree, links lead somewhere, no large files, no private paths, idle imports."""

from __future__ import annotations

import ast
import importlib.metadata
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
MADE = {".git", "out", "build", "dist", "site", "static", "node_modules", "cornerforge-out", "__pycache__"}
LARGE_BYTES = 500_000
MAY_BE_LARGE = {"src/cornerforge/ndd/default_model.npz"}
PROBE = Path(__file__).with_name("import_probe.py")


def project_files() -> Iterator[Path]:
    """Every file that belongs to the project; what tools leave behind is left out."""
    folders = [ROOT]
    while folders:
        for path in sorted(folders.pop().iterdir()):
            made = path.name in MADE or path.name.startswith(".venv")
            if made or path.name.endswith((".egg-info", "_cache")) or path.name == ".hypothesis":
                continue
            if path.is_dir():
                folders.append(path)
            else:
                yield path


def project_texts() -> Iterator[tuple[Path, str]]:
    for path in project_files():
        try:
            yield path, path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue


# --- versions ---


def test_one_version_everywhere() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", changelog, flags=re.MULTILINE)
    cited = re.search(r'^version: "?([^"\n]+)"?$', (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert released, "CHANGELOG.md has no section `## [x.y.z]`"
    assert released[0] == declared, "the newest section of CHANGELOG.md is not the version of pyproject.toml"
    assert cited is not None
    assert cited.group(1) == declared, "CITATION.cff cites another version than pyproject.toml declares"
    assert importlib.metadata.version("cornerforge") == declared, "stale installation; run: make setup"


def bounds_and_pins(pyproject: str, constraints: str) -> tuple[dict[str, Version], dict[str, Version]]:
    """Lowest versions that pyproject.toml asks for, and the versions that are tested together; by canonical name."""
    project = tomllib.loads(pyproject)["project"]
    lines = [*project["dependencies"], *(line for lines in project["optional-dependencies"].values() for line in lines)]
    wanted = [Requirement(line) for line in lines]
    bounds: dict[str, Version] = {
        canonicalize_name(one.name): Version(limit.version)
        for one in wanted
        for limit in one.specifier
        if limit.operator in (">=", "==")
    }
    pins = [Requirement(line) for line in constraints.splitlines() if line and not line.startswith("#")]
    return bounds, {canonicalize_name(pin.name): Version(next(iter(pin.specifier)).version) for pin in pins}


def above(bounds: dict[str, Version], pins: dict[str, Version]) -> list[str]:
    """Packages that are not pinned, or pinned below what is asked for."""
    return [name for name, low in bounds.items() if name not in pins or low > pins[name]]


def test_no_lower_bound_is_above_what_is_tested() -> None:
    """And none allows a NumPy that today's pyarrow refuses: its 1.26 ended in a traceback."""
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    bounds, pins = bounds_and_pins(pyproject, (ROOT / "constraints.txt").read_text(encoding="utf-8"))
    assert len(bounds) >= 20
    assert not above(bounds, pins)
    assert bounds["numpy"] >= Version("2.0")
    raised = pyproject.replace(f'"numba>={bounds["numba"]}"', '"numba>=99"')
    assert above(bounds_and_pins(raised, (ROOT / "constraints.txt").read_text(encoding="utf-8"))[0], pins) == ["numba"]


# --- files ---

# Folders at the root of somebody's machine. A relative path (../shared) or a word (frame/work) does not match.
MACHINE_PATH = re.compile(r"(?<![\w.}*)~-])/(?:home|root|Users|work|farm|mnt|opt)/[\w.]")


@pytest.mark.parametrize(
    ("text", "is_machine_path"),
    [
        ("see " + "/home" + "/ann/data.csv", True),
        ("cp '" + "/wo" + "rk/x' .", True),
        ("../work/x", False),
        ("frame/work/x", False),
    ],
)
def test_machine_paths_are_recognised(text: str, is_machine_path: bool) -> None:
    assert bool(MACHINE_PATH.search(text)) is is_machine_path


def test_no_path_of_one_machine_is_kept() -> None:
    hits = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path, text in project_texts()
        for number, line in enumerate(text.splitlines(), 1)
        if MACHINE_PATH.search(line)
    ]
    assert not hits


def test_no_large_file_but_the_fitted_model() -> None:
    large = {path.relative_to(ROOT).as_posix() for path in project_files() if path.stat().st_size > LARGE_BYTES}
    assert not large - MAY_BE_LARGE


# --- documents ---


def anchors(text: str) -> set[str]:
    """The anchors of a Markdown file's headings, as the usual renderers make them."""
    headings = re.findall(r"^#+ +(.+?) *$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(path: Path, text: str) -> list[str]:
    """Relative links of a Markdown file that lead nowhere."""
    broken = []
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"[a-z]+:", link):
            continue
        place, _, anchor = link.partition("#")
        target = (path.parent / place).resolve() if place else path
        if not target.exists():
            broken.append(f"{path.name}: {link}")
        elif anchor and anchor not in anchors(target.read_text(encoding="utf-8") if place else text):
            broken.append(f"{path.name}: {link} (no such heading)")
    return broken


def test_links_in_documents_lead_somewhere() -> None:
    documents = [(path, text) for path, text in project_texts() if path.suffix == ".md"]
    assert len(documents) >= 6
    assert not [link for path, text in documents for link in broken_links(path, text)]


def test_a_broken_link_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A title, here\n", encoding="utf-8")
    text = "# Top\n[a](page.md#a-title-here) [b](page.md#gone) [c](gone.md) [d](#top) [e](https://example.org)"
    (tmp_path / "index.md").write_text(text, encoding="utf-8")
    assert broken_links(tmp_path / "index.md", text) == [
        "index.md: page.md#gone (no such heading)",
        "index.md: gone.md",
    ]


PAPER_ROW = re.compile(r"^\|(.+)\|\s*(done|partly|planned|not ours)\s*\|\s*$")


def has_code(place: Path) -> bool:
    """A source file that holds something, or a folder with one."""
    return any(path.is_file() and path.stat().st_size > 0 for path in [place, *place.glob("*.py")])


def test_the_paper_map_names_code_that_exists() -> None:
    """Each row says where a claim of the paper stands; a place that is called done must be there."""
    text = (ROOT / "docs" / "paper-map.md").read_text(encoding="utf-8")
    rows = [match for line in text.splitlines() if (match := PAPER_ROW.match(line))]
    assert len(rows) >= 50
    missing = []
    for match in rows:
        cells, state = match.groups()
        places = re.findall(r"`((?:\w+/)*\w+\.py|(?:\w+/)+)`", cells)
        places += re.findall(r"`(tests/[\w/]+\.py)`", cells)
        if state == "done":
            assert places, f"done, but names no place: {cells.strip()}"
        if state in {"done", "partly"}:
            bases = (ROOT, ROOT / "src" / "cornerforge")
            missing += [place for place in places if not any(has_code(base / place) for base in bases)]
    assert not missing


def test_every_equation_figure_and_table_of_the_paper_is_mapped() -> None:
    text = (ROOT / "docs" / "paper-map.md").read_text(encoding="utf-8")
    wanted = [f"Eq. {n}" for n in range(1, 13)] + [f"Fig. {n}" for n in range(1, 12)] + ["Table 1"]
    assert not [name for name in wanted if not re.search(rf"^\| {name}\b", text, flags=re.MULTILINE)]


# --- imports ---


def probe(package: str, only: str, cwd: Path, search: Path) -> dict[str, list[str]]:
    """Import in a fresh Python and report what that did (see import_probe.py)."""
    command = [sys.executable, "-P", str(PROBE), package, only, str(search)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=True)
    assert not done.stderr
    report: dict[str, list[str]] = json.loads(done.stdout.splitlines()[-1])
    report["printed"] = done.stdout.splitlines()[:-1]
    return report


def test_importing_everything_reads_no_file_prints_nothing_and_compiles_nothing(tmp_path: Path) -> None:
    report = probe("cornerforge", "all", tmp_path, ROOT / "src")
    assert len(report["imported"]) > 20
    assert not report["opened"], "an import opened a file"
    assert not report["printed"], "an import printed"
    assert not report["compiled"], "an import compiled a kernel"
    assert not list(tmp_path.iterdir()), "an import wrote a file"


def test_an_import_that_reads_a_file_and_prints_is_seen(tmp_path: Path) -> None:
    package = tmp_path / "rude"
    package.mkdir()
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "table.txt").write_text("1", encoding="utf-8")
    (package / "data.py").write_text(
        "from pathlib import Path\nDATA = Path(__file__).with_name('table.txt').read_text()\nprint('hello')\n",
        encoding="utf-8",
    )
    report = probe("rude", "all", tmp_path, tmp_path)
    assert [Path(name).name for name in report["opened"]] == ["table.txt"]
    assert report["printed"] == ["hello"]


@pytest.mark.parametrize("module", ["cornerforge", "cornerforge.cli"])
def test_starting_is_light(module: str, tmp_path: Path) -> None:
    """`cornerforge --help` must not wait for libraries that only one command needs."""
    report = probe(module, "one", tmp_path, ROOT / "src")
    heavy = {"torch", "sklearn", "plotly", "duckdb", "jinja2", "pyarrow", "scipy.optimize"}
    assert not heavy & set(report["loaded"])


def test_the_installed_program_is_there() -> None:
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="cornerforge")
    assert callable(entry.load())


WEAK = {"who", "whom", "whose", "which", "what", "it", "its", "they", "them", "their", "this", "that", "these", "those"}
WEAK |= {"such", "as", "of", "in", "on", "at", "by", "for", "from", "with", "without", "to", "into", "under", "over"}
WEAK |= {"between", "within", "about", "after", "before", "until"}


def test_no_docstring_begins_with_a_pronoun_or_a_preposition() -> None:
    """First sentences have a noun or a verb first, so that they can be read alone."""
    found = []
    for path in sorted((ROOT / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                first = re.match(r"\W*(\w+)", ast.get_docstring(node) or "")
                if first is not None and first[1].lower() in WEAK:
                    found.append(f"{path.name}:{getattr(node, 'lineno', 1)}: {first[1]}")
    assert found == []
