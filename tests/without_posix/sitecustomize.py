"""A Python without what only POSIX has: with this folder on PYTHONPATH each Python that starts loses it (Windows)."""

from __future__ import annotations

import importlib.abc
import os
import select
import signal
import sys

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty")
FUNCTIONS = {
    os: (
        "fork",
        "forkpty",
        "killpg",
        "setsid",
        "getpgid",
        "setpgid",
        "getuid",
        "geteuid",
        "sched_getaffinity",
        "mkfifo",
    ),
    select: ("poll", "epoll"),
    signal: ("SIGALRM", "SIGHUP", "SIGCHLD", "SIGSTOP", "SIGCONT", "SIGUSR1", "alarm", "setitimer"),
}


class Missing(importlib.abc.MetaPathFinder):
    """Finds no module of POSIX."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Refuse what Windows lacks, and leave all else to others."""
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


import filelock  # noqa: E402, F401 - it asks for the platform, and has a way of its own on Windows

for gone in MODULES:
    sys.modules.pop(gone, None)
sys.meta_path.insert(0, Missing())
for module, names in FUNCTIONS.items():
    for gone in names:
        if hasattr(module, gone):
            delattr(module, gone)
