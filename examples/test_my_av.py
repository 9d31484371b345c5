"""Test your AV in stored cases, with pytest: `pytest examples/test_my_av.py` (docs/interchange.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from cornerforge.pytest_plugin import MarkedCase


@pytest.mark.cornerforge("cases/*.json", av="my_av.py:MyAv")
def test_my_av_does_not_crash(case: MarkedCase) -> None:
    case.check()
