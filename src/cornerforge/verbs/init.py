"""`init` writes a folder to start from: an AV, the config of a run, and a README."""

from __future__ import annotations

from pathlib import Path

from cornerforge._options import verb
from cornerforge.experiment.output import check_new_file, write_text
from cornerforge.results import Initialised
from cornerforge.verbs.options.whole import Init

__all__ = ["FILES", "init"]

FILES = {"my_av.py": "my_av.py.txt", "cornerforge.toml": "cornerforge.toml", "README.md": "README.md"}
"""Files that `init` writes, and where their text lies in the folder `start` beside this module."""


@verb(Init)
def init(options: Init) -> Initialised:
    """Write a folder to start from: an AV class, a config for `cornerforge run --config`, and a README of ten lines.

    Returns:
        What `cornerforge init --json` prints: the files.

    Raises:
        OutputError: One of the files is there already, or cannot be written; then none is left.
        InputError: The path is no valid text.
    """
    place = Path(options.folder)
    texts = {
        place / name: (Path(__file__).parent / "start" / source).read_text("utf-8") for name, source in FILES.items()
    }
    for path in texts:
        check_new_file(path)
    written: list[Path] = []
    try:
        for path, text in texts.items():
            write_text(path, text)
            written.append(path)
    except BaseException:
        for path in written:
            path.unlink(missing_ok=True)
        raise
    return Initialised(files=tuple(map(str, texts)))
