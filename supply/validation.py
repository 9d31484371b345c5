"""Validate the shipped traffic model against the recordings, and keep its checks for `report --evidence`."""

from __future__ import annotations

import sys
from pathlib import Path

from cornerforge import ndd_validate
from cornerforge.experiment.output import write_json
from cornerforge.ndd.model import default_model_path
from cornerforge.results import as_json

DATA = Path(__file__).parents[2] / "shared" / "data"
FILES = ("ngsim_i80_car_following_pairs.csv.gz", "ngsim_i80_hov_lane.csv.gz", "ngsim_us101_clips.csv.gz")


def main(out: Path) -> None:
    """Write the checks to `out`; it takes some minutes on two cores."""
    found = ndd_validate(
        default_model_path(), against=[DATA / name for name in FILES], data_format="ngsim", miles=1.2e6
    )
    facts = as_json(found)["facts"]
    write_json(out, {"model_hash": found.model_hash, "miles": 1.2e6, "facts": facts})
    judged = [fact["within"] for fact in facts if fact["within"] is not None]
    print(f"{sum(judged)} of {len(judged)} checks pass, written to {out}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
