"""docs/formats.md, and that it forgets no file."""

from __future__ import annotations

from collections.abc import Callable

from formats_page import formats_markdown


def test_the_page_is_made_of_what_readers_check(golden: Callable[[str, str], None]) -> None:
    """docs/formats.md."""
    golden("../../docs/formats.md", formats_markdown())
