"""The functions behind the commands: each takes names and files, and returns the object that the command prints.

A module for each command or a few; the package `cornerforge` gives the functions themselves.
"""

from __future__ import annotations

__all__: list[str] = []
