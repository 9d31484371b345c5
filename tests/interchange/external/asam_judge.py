"""Lets ASAM's quality checkers judge files, and scenariogeneration read them.

Run with the Python of an environment that has asam-qc-openscenarioxml, asam-qc-opendrive and scenariogeneration, with a
folder and names of cases: prints one JSON object for the .xosc and .xodr files: how many checkers had their say, all
that they found, and, of these cases, what the other reader could not read; it needs a second for a case. All runs of
the checkers are in one process: starting one takes another second.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import logging
import sys
from pathlib import Path
from typing import Any

_CHECKERS = {".xosc": "qc_openscenario", ".xodr": "qc_opendrive"}


def judged(path: Path) -> dict[str, Any]:
    from qc_baselib import Configuration, Result, StatusType

    package = _CHECKERS[path.suffix]
    main, bundle = (importlib.import_module(f"{package}.{part}") for part in ("main", "constants"))
    config, result = Configuration(), Result()
    config.set_config_param("InputFile", str(path))
    result.register_checker_bundle(
        name=bundle.BUNDLE_NAME, description="", version=bundle.BUNDLE_VERSION, summary=""
    )  # fmt: skip
    result.set_result_version(version=bundle.BUNDLE_VERSION)
    main.run_checks(config, result)
    names = result.get_checker_ids(bundle.BUNDLE_NAME)
    states = {name: result.get_checker_status(name) for name in names}
    return {
        "completed": sum(state == StatusType.COMPLETED for state in states.values()),
        "failed": [name for name, state in states.items() if state == StatusType.ERROR],
        "issues": [
            [issue.rule_uid, issue.description, *(str(place.description) for place in issue.locations)]
            for name in names
            for issue in result.get_issues(bundle.BUNDLE_NAME, name)
        ],
    }


def unread(path: Path) -> str:
    """Say what another reader could not read; empty: nothing."""
    from scenariogeneration import xosc

    try:
        with contextlib.redirect_stdout(io.StringIO()):
            xosc.ParseOpenScenario(str(path))
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def main(folder: Path, names: list[str]) -> None:
    logging.disable(logging.CRITICAL)
    found = {}
    for path in sorted(folder.rglob("*.xo*")):
        read = path.suffix == ".xosc" and path.stem in names
        found[str(path.relative_to(folder))] = judged(path) | {"read": read, "unread": unread(path) if read else ""}
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
