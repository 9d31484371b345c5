"""Run by test_project.py in a Python of its own: import modules and report, as one line of JSON, what that did.

Arguments: package or module; "all" (with every module below it) or "one"; folder to import from.
"""

from __future__ import annotations

import importlib
import json
import pkgutil
import sys
from pathlib import Path


def main(name: str, only: str, search: str) -> None:
    sys.path.insert(0, search)
    sys.dont_write_bytecode = True
    watched = (str(Path(search).resolve()), str(Path.cwd()))
    opened: list[str] = []

    def note(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str):
            path = str(Path(arguments[0]).absolute())
            # Python's own reading of sources, and Numba's test whether it may write its cache, are no reading of data;
            # .egg-info is where an editable install keeps entry points, which torch looks through.
            if (
                path.startswith(watched)
                and "__pycache__" not in path
                and ".egg-info" not in path
                and not path.endswith((".py", ".pyc"))
            ):
                opened.append(path)

    sys.addaudithook(note)
    module = importlib.import_module(name)
    names = [name]
    if only == "all":
        names += [found.name for found in pkgutil.walk_packages(module.__path__, prefix=f"{name}.")]
        names = [found for found in names if not found.endswith("__main__")]
    modules = [importlib.import_module(found) for found in names]
    kernels = {
        f"{thing.__module__}.{thing.__name__}": thing
        for module in modules
        for thing in vars(module).values()
        if type(thing).__name__ == "CPUDispatcher"
    }
    compiled = [found for found, kernel in kernels.items() if kernel.signatures]
    loaded = sorted(found for found in sys.modules if found.count(".") < 2)
    print(json.dumps({"imported": names, "opened": opened, "compiled": compiled, "loaded": loaded}))


if __name__ == "__main__":
    main(*sys.argv[1:])
