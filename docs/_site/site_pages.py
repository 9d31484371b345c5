"""Pages of the site that are not written as pages, and links to what stands outside docs/; mkdocs.yml names this file.

Notebooks become pages with the outputs that they are committed with. README.md, CONTRIBUTING.md, SECURITY.md and
CHANGELOG.md become pages, the Python interface is made from docstrings for the names of tests/public_api.txt, and a
link from a page to another file of the project leads to a page that shows the file.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Callable, Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
WHOLE_PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
}
LANGUAGES = {".py": "python", ".cff": "yaml", ".toml": "toml"}
LINK = re.compile(r"(\]\()([^)\s]+)(\))")
FENCE = re.compile(r"(^```.*?^```|`[^`\n]+`)", flags=re.MULTILINE | re.DOTALL)


# --- links ---


def page_of(path: str) -> str:
    """Where the site shows a file of the project: its page below docs/."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/").replace(".ipynb", ".md")
    return WHOLE_PAGES.get(path, f"source/{path}.md")


def file_of(page: str) -> str:
    """The file of the project that a page shows; the reverse of `page_of`."""
    for path, shown in WHOLE_PAGES.items():
        if shown == page:
            return path
    if page.startswith("notebooks/"):
        return f"docs/{page.removesuffix('.md')}.ipynb"
    return page.removeprefix("source/").removesuffix(".md") if page.startswith("source/") else f"docs/{page}"


def target_of(link: str, path: str) -> str | None:
    """The file of the project that a link in the file `path` leads to; None for one to elsewhere or to a heading."""
    place = link.partition("#")[0]
    if not place or re.match(r"[a-z]+:", link):
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(path), place))


def with_links_of_the_site(text: str, path: str) -> str:
    """A file's text, its links led from its page to the pages of what they name; code is left as it is."""
    here = posixpath.dirname(page_of(path))

    def led(match: re.Match[str]) -> str:
        target = target_of(match[2], path)
        if target is None:
            return match[0]
        _, mark, heading = match[2].partition("#")
        return f"{match[1]}{posixpath.relpath(page_of(target), here or '.')}{mark}{heading}{match[3]}"

    parts = FENCE.split(text)
    # We write no links of the form [text][name]; two brackets are a shape of numbers, and stay brackets.
    return "".join(part if part.startswith("`") else LINK.sub(led, part).replace("][", "]\\[") for part in parts)


def files_outside(texts: dict[str, str]) -> list[str]:
    """Files outside docs/ that these texts (by path) lead to and that are no pages of their own."""
    found = {
        target
        for path, text in texts.items()
        for part in FENCE.split(text)
        if not part.startswith("`")
        for match in LINK.finditer(part)
        if (target := target_of(match[2], path)) and not target.startswith("docs/") and target not in WHOLE_PAGES
    }
    return sorted(found)


# --- pages ---


def shown_file(path: str) -> str:
    """The page of a file that is not written as a page."""
    name = Path(path)
    language = LANGUAGES.get(name.suffix, "text")
    return f"# {name.name}\n\n`{path}`\n\n````{language}\n{(ROOT / path).read_text(encoding='utf-8')}````\n"


def notebooks() -> dict[str, Any]:
    """The notebooks by path, in their order."""
    found = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
    return {path.relative_to(ROOT).as_posix(): json.loads(path.read_text(encoding="utf-8")) for path in found}


def text_of_notebook(notebook: Mapping[str, Any]) -> str:
    """What is written between the code."""
    return "\n\n".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown")


def shown_notebook(path: str, notebook: Mapping[str, Any]) -> str:
    """The page of a notebook: its text, its code, and what the code printed and showed."""
    name = posixpath.basename(path)
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(with_links_of_the_site(source, path))
        else:
            parts += [f"```python\n{source}\n```", *map(shown_output, cell["outputs"])]
    parts.insert(1, f'To run it yourself: <a href="{name}" download>{name}</a>.')
    return "\n\n".join(parts) + "\n"


def shown_output(output: Mapping[str, Any]) -> str:
    data = output.get("data", {})
    if "text/html" in data:
        return f'<div class="output">{"".join(data["text/html"])}</div>'
    if "image/png" in data:
        picture = "".join(data["image/png"]).replace("\n", "")
        return f'<div class="output"><img alt="What the code above draws" src="data:image/png;base64,{picture}"></div>'
    return f'<div class="output"><pre>{escape("".join(output.get("text") or data["text/plain"]))}</pre></div>'


def promised() -> dict[str, list[str]]:
    """The names of the Python interface, by the module that gives them."""
    modules: dict[str, list[str]] = {}
    for dotted in (ROOT / "tests" / "public_api.txt").read_text(encoding="utf-8").split():
        module, _, name = dotted.rpartition(".")
        modules.setdefault(module, []).append(name)
    return modules


def place_of(package: Any, module: str, name: str) -> str | None:
    """The name under which mkdocstrings finds what a module gives.

    None where one line defines several names (`CAR, TRUCK = 0, 1`): it finds none of them.
    """
    from griffe import AliasResolutionError

    dotted = f"{module}.{name}"
    try:
        found = package[dotted.removeprefix("cornerforge.")]
        target = found.final_target if found.is_alias else found
    except (AliasResolutionError, KeyError):
        return None
    hides_its_module = target.is_module and name in target.members
    return f"{dotted}.{name}" if hides_its_module else dotted


def page_of_module(package: Any, module: str, names: list[str]) -> str:
    """A page on what a module gives; the text itself is made from docstrings by mkdocstrings."""
    names = [name for name in names if name != "__version__"]
    places = {name: place_of(package, module, name) for name in names}
    described = [f"::: {place}" for place in places.values() if place]
    codes = [name for name, place in places.items() if not place]
    if codes:
        described.append("## Codes\n\n" + ", ".join(f"`{name}`" for name in codes) + ": whole numbers.")
    options = ["members: false", "show_root_heading: false", "show_root_toc_entry: false"]
    about = f"::: {module}\n    options:\n" + "".join(f"      {option}\n" for option in options)
    return f"# {module}\n\n{about}\n" + "\n\n".join(described) + "\n"


def title_of(text: str) -> str:
    return text.partition("\n")[0].removeprefix("# ").strip()


def made_pages() -> Iterator[tuple[str, str]]:
    """All pages that are not files below docs/: name and text."""
    from griffe import load

    texts = {path: (ROOT / path).read_text(encoding="utf-8") for path in WHOLE_PAGES}
    for path in sorted((ROOT / "docs").rglob("*.md")):
        texts[path.relative_to(ROOT).as_posix()] = path.read_text(encoding="utf-8")
    texts |= {path: text_of_notebook(notebook) for path, notebook in notebooks().items()}
    yield from ((page, with_links_of_the_site(texts[path], path)) for path, page in WHOLE_PAGES.items())
    yield from ((page_of(path), shown_notebook(path, notebook)) for path, notebook in notebooks().items())
    yield from ((page_of(path), shown_file(path)) for path in files_outside(texts))
    package = load("cornerforge", search_paths=[str(ROOT / "src")])
    yield from ((f"python/{name}.md", page_of_module(package, name, given)) for name, given in promised().items())


def filled(nav: Any, lists: dict[str, list[Any]]) -> Any:
    """The navigation, with lists in the place of their names."""
    if isinstance(nav, list):
        return [filled(part, lists) for part in nav]
    if isinstance(nav, dict):
        return {title: filled(part, lists) for title, part in nav.items()}
    return lists.get(nav, nav)


# --- what MkDocs calls ---


def on_config(config: Any) -> Any:
    records = sorted((ROOT / "docs" / "adr").glob("0*.md"))
    lists: dict[str, list[Any]] = {
        "ADRS": [
            {title_of(path.read_text(encoding="utf-8")).removeprefix("ADR "): f"adr/{path.name}"} for path in records
        ],
        "NOTEBOOKS": [{title_of(text_of_notebook(one)): page_of(path)} for path, one in notebooks().items()],
        "PYTHON": [{module: f"python/{module}.md"} for module in promised()],
    }
    config.nav = filled(config.nav, lists)
    return config


def on_files(files: Any, config: Any) -> Any:
    from mkdocs.structure.files import File

    generated: Callable[..., Any] = File.generated
    for name, text in made_pages():
        files.append(generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links of pages in docs/ that name files outside it; pages that were made above are done already."""
    if page.file.generated_by is not None:
        return markdown
    return with_links_of_the_site(markdown, f"docs/{page.file.src_uri}")
