"""Options of the verbs, and how their commands are made; light to import, because `--help` needs it."""

from __future__ import annotations

from cornerforge.verbs.options import cases, driving, learning, whole

__all__ = ["COMMANDS"]

COMMANDS = (*whole.COMMANDS, *driving.COMMANDS, *learning.COMMANDS, *cases.COMMANDS)
"""Commands of the core, in the order in which help lists them."""
