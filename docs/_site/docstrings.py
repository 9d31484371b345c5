"""Docstrings as pages want them; mkdocs.yml names this file as an extension of Griffe, which reads the docstrings.

An example (`>>> ...` up to an empty line) stands bare at the end of our docstrings. Markdown would take its signs for
quotations and links, so it is put between fences.
"""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension

EXAMPLE = re.compile(r"^( *)>>> .*?(?=\n\s*\n|\Z)", flags=re.MULTILINE | re.DOTALL)


def with_fences(text: str) -> str:
    return EXAMPLE.sub(lambda found: f"\n{found[1]}```pycon\n{found[0].rstrip()}\n{found[1]}```", text)


class Examples(Extension):
    """Puts the examples of all docstrings between fences."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = with_fences(obj.docstring.value)
