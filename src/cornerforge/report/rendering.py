"""Parts that all pages share: templates, the policy that lets nothing be fetched, and writing a page whole."""

from __future__ import annotations

import base64
import hashlib
import re
from importlib import resources
from pathlib import Path
from typing import Any

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError, printable
from cornerforge.report import text

__all__ = ["PLAYER", "content_policy", "environment", "template", "write_page"]

PLAYER = "pages.js"
"""The script of the pages that play cases, for `template`; made of `web/src/pages/` by `make web`."""


def environment() -> Any:
    """Make the environment of the pages' templates.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise MissingExtraError("jinja2", "report") from None
    # StrictUndefined: a name that the template misspells is an error, not an empty place on the page.
    pages = jinja2.Environment(
        loader=jinja2.PackageLoader("cornerforge.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False, "ensure_ascii": False}
    pages.filters |= {
        "rate": text.rate,
        "miles": text.miles,
        "miles_range": text.miles_range,
        "count": text.count,
        "duration": text.duration,
    }
    pages.filters |= {"plain": text.plain, "capital": text.capital}
    pages.filters |= {"share": text.share, "sentence": text.sentence, "signed": text.signed}
    return pages


def template(name: str) -> str:
    """Read a file of the pages, such as a style sheet."""
    return resources.files("cornerforge.report").joinpath("templates", name).read_text(encoding="utf-8")


def content_policy(scripts: list[str]) -> str:
    """Content security policy: nothing is fetched, and only these scripts run, with any name of a case."""
    digests = (hashlib.sha256(script.encode("utf-8")).digest() for script in scripts)
    sources = " ".join(f"'sha256-{base64.b64encode(digest).decode('ascii')}'" for digest in digests) or "'none'"
    rest = "style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
    return f"default-src 'none'; script-src {sources}; {rest}"


def write_page(page: str, file: Path) -> Path:
    """Write a page whole or not at all, and return its path; what is not seen is escaped, but in scripts.

    Raises:
        OutputError: It cannot be written.
    """
    parts = re.split("(<script.*?</script>)", page, flags=re.DOTALL)
    page = "".join(part if index % 2 else printable(part) for index, part in enumerate(parts))
    with writing(file) as part:
        part.write_text(page, encoding="utf-8", newline="\n")
    return file
