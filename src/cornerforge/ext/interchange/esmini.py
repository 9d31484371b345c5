"""OpenSCENARIO files, played by esmini where that program is installed.

The file comes from anyone: esmini gets a new folder as its working directory and as its home, writes its trace and its
log there, and is ended after a time.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.read_osi import read_osi
from cornerforge.ext.interchange.xml_input import read_xml
from cornerforge.library.out_case import MovingCase

__all__ = ["play_openscenario"]

_PROGRAM = "esmini"
_STEP_S = 0.01
_SHOWN, _READ = 200, 10_000


def play_openscenario(path: Path, *, ego: str | None = None, road: Path | None = None, seconds: float) -> MovingCase:
    """Let esmini play an OpenSCENARIO file, and read the trace that it writes.

    Args:
        path: The scenario.
        ego: As for `read_osi`.
        road: Its OpenDRIVE road; None: the one that the scenario names, beside it.
        seconds: How long esmini may take [s].

    Raises:
        InputError: esmini is not installed, or the scenario is missing.
        FileFormatError: The scenario is no XML, or the trace is damaged.
        DataError: esmini fails or takes longer, or what it plays cannot be read (`read_osi`).
    """
    top = read_xml(path, root="OpenSCENARIO", what="an OpenSCENARIO file")
    program = shutil.which(_PROGRAM)
    if program is None:
        raise InputError(
            f"{path.name}: scenarios are played by esmini, which is not on the PATH. Install it, or import the trace "
            "(.osi, .mcap) that another player writes of it: esmini --headless --fixed_timestep 0.01 --osc FILE.xosc "
            "--osi_file FILE.osi"
        )
    network = top.child("RoadNetwork", "LogicFile")
    named = path.parent / (network.attributes.get("filepath", "") if network is not None else "")
    road = road or (named if named.suffix == ".xodr" and named.is_file() else None)
    with tempfile.TemporaryDirectory(prefix="cornerforge-") as folder:
        trace = Path(folder) / f"{path.stem}.osi"
        words = [
            program, "--osc", str(path.absolute()), "--headless", "--fixed_timestep", str(_STEP_S), "--osi_file",
            str(trace),
        ]  # fmt: skip
        places = dict.fromkeys(("HOME", "TMPDIR", "TMP", "TEMP"), folder)
        with (Path(folder) / "said").open("w+b") as said:
            try:
                player = subprocess.Popen(
                    words, cwd=folder, env={**os.environ, **places}, stdin=subprocess.DEVNULL, stdout=said,
                    stderr=subprocess.STDOUT, start_new_session=True,
                )  # fmt: skip
            except OSError as error:
                raise InputError(f"{path.name}: esmini cannot be run ({error.strerror}).") from None
            try:
                status = player.wait(seconds)
            except subprocess.TimeoutExpired:
                raise DataError(
                    f"{path.name}: esmini has not ended after {seconds:g} s; allow more (play-seconds), or give a "
                    "scenario that ends."
                ) from None
            finally:
                with suppress(ProcessLookupError, PermissionError):  # and what it started: it may be a script
                    os.killpg(player.pid, signal.SIGKILL) if os.name == "posix" else player.kill()
                player.wait()
            said.seek(-min(_READ, said.tell()), os.SEEK_END)
            last = said.read().decode("utf-8", "replace").strip().rpartition("\n")[2] or "no word"
        if status or not trace.is_file():
            ended = f"status {status}" if status else "status 0 and wrote no trace"
            raise DataError(f"{path.name}: esmini ended with {ended}: {last[:_SHOWN]}")
        case = read_osi(trace, ego=ego, road=road)
    return replace(case, facts={**case.facts, "source": path.name, "format": f"OpenSCENARIO, {case.facts['format']}"})
