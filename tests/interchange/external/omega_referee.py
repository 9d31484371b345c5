"""Reads OSI traces with omega-prime, validates them, and writes each again as MCAP.

Run with the Python of an environment that has omega-prime, with a folder of traces and one for what it writes; prints
one JSON object: for each file the fault that its validation found, the host vehicle, and all rows (time [ns], id, x, y,
yaw, speed along x, length, width).
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import Any

warnings.simplefilter("ignore")
_COLUMNS = ["total_nanos", "idx", "x", "y", "yaw", "vel_x", "length", "width"]


def look(path: Path, again: Path) -> dict[str, Any]:
    import omega_prime
    from pandera.errors import SchemaErrors

    try:
        recording = omega_prime.Recording.from_file(path, validate=True, apply_proj=False)
    except SchemaErrors as error:
        return {"fault": str(error)}
    recording.to_mcap(str(again / f"{path.stem}-{path.suffix[1:]}.mcap"))
    return {"fault": None, "host": recording.host_vehicle_idx, "rows": recording.df.select(_COLUMNS).rows()}


def main() -> None:
    folder, again = map(Path, sys.argv[1:])
    print(json.dumps({path.name: look(path, again) for path in sorted(folder.glob("case*.*"))}))


if __name__ == "__main__":
    main()
