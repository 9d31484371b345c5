"""Docstrings as pages want them; mkdocs.yml names this file as an extension of Griffe, which reads the docstrings.

An example (`>>> ...` up to an empty line) stands bare at the end of our docstrings. Markdown would take its signs for
quotations and links, so it is put between fences.
"""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension

EXAMPLE = re.compile(r"^( *)>>> .*?(?=\n\s*\n|\Z)", flags=re.MULTILINE | re.DOTALL)
OPTIONS = (
    "It is called with keywords: the options of the [command of this name](../commands.html), if there is one, with "
    "`_` for `-`. The class of its one parameter here says what each is; arguments of the command come first and need "
    "no keyword."
)


def with_fences(text: str) -> str:
    return EXAMPLE.sub(lambda found: f"\n{found[1]}```pycon\n{found[0].rstrip()}\n{found[1]}```", text)


class Examples(Extension):
    """Puts the examples of all docstrings between fences."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = with_fences(obj.docstring.value)
            if any(str(one.value).startswith("verb(") for one in getattr(obj, "decorators", ())):
                obj.docstring.value = f"{obj.docstring.value}\n\n{OPTIONS}"
