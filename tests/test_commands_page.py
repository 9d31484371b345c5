"""The page of all commands, and that it forgets none."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable

from commands_page import commands_markdown


def test_the_page_is_made_of_the_program(golden: Callable[[str, str], None]) -> None:
    """docs/commands.md."""
    golden("../../docs/commands.md", commands_markdown())


def test_the_page_has_what_help_has() -> None:
    """Help as the program prints it, in a process of its own; the page is made from its declarations."""
    page = commands_markdown()
    for command in ("simulate", "ndd fit"):
        words = [sys.executable, "-m", "cornerforge", *command.split(), "--help"]
        said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        options = set(re.findall(r"^[│* ]*(--[a-z-]*[a-z])(?![\w-])", said, flags=re.MULTILINE))
        assert len(options) > 5
        (part,) = re.findall(rf"^## {command}\n(.*?)(?=^## |\Z)", page, flags=re.MULTILINE | re.DOTALL)
        shared = page.partition("## What all commands take")[2].partition("\n## ")[0]
        missing = {option for option in options if f"`{option}`" not in part + shared}
        assert not missing, f"{command}: {missing}"
