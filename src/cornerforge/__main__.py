"""The program `cornerforge`, also as `python -m cornerforge`: the command line, which Ctrl-C ends in one line."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line and return its exit status, as `cornerforge.cli.main`; Ctrl-C amid imports is 130 too."""
    try:
        from cornerforge.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("cornerforge: interrupted.\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
