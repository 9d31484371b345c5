"""Every output place of every command line, and the inputs that these lines need."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cornerforge.cli import main
from cornerforge.library import CaseLibrary
from cornerforge.ndd import default_model_path

__all__ = ["FILE", "FOLDER", "OUTPUTS", "pairs_file", "stand_ins"]

FOLDER, FILE = "folder", "file"
OUTPUTS = {
    "run --out": (FOLDER, ""),
    "run --hours 0.01 --out": (FOLDER, ""),
    "reproduce --out": (FOLDER, ""),
    "simulate --tests 10 --out": (FOLDER, ""),
    "rate --out": (FOLDER, ""),
    "train --out": (FILE, ".safetensors"),
    "train-av --out": (FILE, ".safetensors"),
    "generate --policy swerve --cases 3 --out": (FOLDER, ""),
    "analyse LIB --out": (FOLDER, ""),
    "migrate LIB --out": (FOLDER, ""),
    "verify LIB --out": (FILE, ".json"),
    "report LIB --out": (FOLDER, ""),
    "report": (FOLDER, ""),
    "figure LIB --out": (FOLDER, ""),
    "figure LIB CASE --out": (FILE, ".svg"),
    "shrink LIB CASE --out": (FOLDER, ""),
    "replay LIB CASE --picture": (FILE, ".svg"),
    "replay LIB CASE --video": (FILE, ".gif"),
    "replay LIB CASE --out": (FILE, ".json"),
    "retest LIB --av rss-cautious --junit": (FILE, ".xml"),
    "retest LIB --av rss-cautious --page": (FILE, ".html"),
    "retest LIB --av rss-cautious --out": (FILE, ".json"),
    "suite build LIB --size 2 --out": (FOLDER, ""),
    "suite run aeb --family braking --out": (FOLDER, ""),
    "suite run aeb --family braking --junit": (FILE, ".xml"),
    "r157 --family cut-in --out": (FOLDER, ""),
    "export LIB CASE --to json --out": (FOLDER, ""),
    "import TABLE --out": (FOLDER, ""),
    "cases from-data TABLE --out": (FOLDER, ""),
    "plausibility --out": (FOLDER, ""),
    "ndd fit PAIRS --format pairs --out": (FILE, ".npz"),
    "ndd validate MODEL --against PAIRS --format pairs --out": (FOLDER, ""),
    "ndd show --out": (FOLDER, ""),
    "ndd import DATA --out": (FILE, ".npz"),
    "road import XODR --out": (FILE, ".json"),
    "road check on-ramp --out": (FILE, ".json"),
    "road show on-ramp --out": (FILE, ".svg"),
    "site import NET --junction NODE_24 --out": (FILE, ".json"),
    "site check SITE --out": (FILE, ".json"),
    "site show SITE --out": (FILE, ".svg"),
    "site fit --data URBAN --out": (FILE, ".json"),
    "site validate mcity-signal --data URBAN --recordings 1 --tests 1 --out": (FILE, ".json"),
    "init my-av --out": (FILE, ".json"),
    "serve LIB --port 0 --out": (FILE, ".json"),
    "avs --out": (FILE, ".json"),
    "check-av my_av:MyAv --out": (FILE, ".json"),
    "query LIB SQL --out": (FILE, ".json"),
    "variety LIB --out": (FILE, ".json"),
}  # fmt: skip
"""Command lines whose next word is the place, and what is made there."""


def pairs_file(folder: Path) -> None:
    """Write the trajectories of 12 followers, some of them held out, as `pairs.csv`."""
    rows = ["period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"]
    for f in range(30):
        split = "test" if f % 2 == 0 else "train"
        speed = 25 + 0.3 * np.sin(np.arange(121) / 20 + f)
        rows += [f"1,{f},999,{0.1 * i:.1f},{v:.4f},25.0,{40 + f}.0,{split}" for i, v in enumerate(speed)]
    (folder / "pairs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def stand_ins(folder: Path) -> dict[str, str]:
    """Make, in a folder, what words of `OUTPUTS` stand for."""
    library = folder / "library"
    assert main(["generate", "--policy", "swerve", "--cases", "3", "--out", str(library), "--quiet"]) == 0
    pairs_file(folder)
    (folder / "dut_pet_events.csv").write_text("clip,dt\na,1.0\nb,-2.0\n", encoding="utf-8")
    net, site = Path(__file__).parent / "interchange" / "data" / "mcity.net.xml.gz", folder / "site.json"
    assert main(["site", "import", str(net), "--junction", "NODE_24", "--out", str(site), "--quiet"]) == 0
    case = CaseLibrary.open(library).scalars(["case_id"])["case_id"][0].as_py()
    return {
        "LIB": str(library), "CASE": case, "PAIRS": str(folder / "pairs.csv"), "TABLE": str(folder / "pairs.csv"),
        "MODEL": str(default_model_path()), "DATA": str(folder), "SQL": "select 1 from cases",
        "NET": str(net), "SITE": str(site), "URBAN": str(folder),
        "XODR": str(Path(__file__).parent / "interchange" / "data" / "three_lanes.xodr"),
    }  # fmt: skip
