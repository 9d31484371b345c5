"""Cases as recordings for the Rerun viewer (.rrd): vehicles as boxes over time, lanes as lines, and plots.

Entities: `road/lines`; `road/av`, `road/other` and `road/vehicle_N`, N the slot; `plots/speed_mps/av` and `.../other`,
`plots/acceleration_mps2/...`, `plots/gap_m`; `facts`. Axes are ours: x along the road, y to the left, z up; boxes are
1.5 m high. The other is the vehicle that the AV touches, or the nearest one.

Needs rerun-sdk, which takes half a gigabyte: `cornerforge[rerun]`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError
from cornerforge.library.out_case import OutCase
from cornerforge.types import CLASSES, FRAME_S, Scenario

__all__ = ["write_rerun"]

_HEIGHT = 1.5
_BEYOND = 50.0
"""How far lines go on behind and ahead of all vehicles [m]."""
_AV, _OTHER, _REST, _LINE = (46, 111, 196), (209, 73, 44), (150, 150, 150), (200, 200, 200)
_TIMELINE = "time"


def write_rerun(case: OutCase, path: Path) -> None:
    """Write a case as a recording.

    Args:
        case: The case; the recording gets its name.
        path: The file, which ends in .rrd.

    Raises:
        MissingExtraError: rerun-sdk is not installed.
        OutputError: The file cannot be written.
    """
    try:
        import rerun
        import rerun.blueprint as views
    except ImportError as error:
        raise MissingExtraError("rerun-sdk", "rerun") from error
    plan = views.Blueprint(
        views.Vertical(
            views.Spatial3DView(origin="road", name="Road"),
            views.Horizontal(
                *(views.TimeSeriesView(origin=f"plots/{name}", name=name) for name in _plotted(case.scenario))
            ),
        ),
        views.TextDocumentView(origin="facts", name="Facts"),
    )
    with writing(path, "the recording") as part:
        recording = rerun.RecordingStream("cornerforge", recording_id=case.name)
        recording.save(part, default_blueprint=plan)
        _log(rerun, recording, case)
        recording.disconnect()  # writes what is left


def _log(rerun: Any, recording: Any, case: OutCase) -> None:
    scenario = case.scenario
    recording.log("road", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("road/lines", rerun.LineStrips3D(_lines(scenario), colors=_LINE, radii=0.06), static=True)
    known = [f"| {name} | {value} |" for name, value in case.facts.items() if value is not None]
    text = "\n".join([f"# {case.name}", "", "| fact | value |", "| --- | --- |", *known])
    recording.log("facts", rerun.TextDocument(text, media_type="text/markdown"), static=True)
    other = _other(scenario)
    for column in range(scenario.slot.size):
        _log_vehicle(rerun, recording, scenario, column, other)
    times = FRAME_S * np.arange(len(scenario.x))
    for group, lines in _plotted(scenario).items():
        for name, values in lines.items():
            there = np.isfinite(values)
            rerun.send_columns(
                f"plots/{group}/{name}" if name else f"plots/{group}",
                indexes=[rerun.TimeColumn(_TIMELINE, duration=times[there])],
                columns=rerun.Scalars.columns(scalars=values[there]),
                recording=recording,
            )


def _log_vehicle(rerun: Any, recording: Any, scenario: Scenario, column: int, other: int | None) -> None:
    """Log a vehicle's box at each frame that it is there, and that it is gone after that."""
    frames = np.flatnonzero(scenario.present[:, column])
    slot = int(scenario.slot[column])
    name, colour = ("av", _AV) if column == 0 else ("other", _OTHER) if column == other else (f"vehicle_{slot}", _REST)
    entity = f"road/{name}"
    label = f"{name} ({CLASSES[scenario.kind[column]].name})"
    recording.log(entity, rerun.Boxes3D.from_fields(colors=colour, labels=label, show_labels=False), static=True)
    half = 0.5 * np.array([scenario.length[column], scenario.width[column], _HEIGHT])
    turn = 0.5 * scenario.heading[frames, column]
    none = np.zeros(frames.size)
    place = scenario.x[frames, column], scenario.y[frames, column], none + half[2]
    rerun.send_columns(
        entity,
        indexes=[rerun.TimeColumn(_TIMELINE, duration=FRAME_S * frames)],
        columns=rerun.Boxes3D.columns(
            centers=np.stack(place, axis=1),
            half_sizes=np.tile(half, (frames.size, 1)),
            quaternions=np.stack([none, none, np.sin(turn), np.cos(turn)], axis=1),
        ),
        recording=recording,
    )
    gone = np.setdiff1d(frames + 1, frames)
    for frame in gone[gone < len(scenario.x)]:
        recording.set_time(_TIMELINE, duration=FRAME_S * int(frame))
        recording.log(entity, rerun.Clear(recursive=False))
    recording.reset_time()


def _lines(scenario: Scenario) -> NDArray[np.float64]:
    """Make the edges of the lanes, (lanes + 1, 2, 3) [m]."""
    along = scenario.x[scenario.present]
    across = scenario.odd.lane_width * np.arange(scenario.odd.n_lanes + 1)
    lines = np.zeros((across.size, 2, 3))
    lines[:, :, 0] = along.min() - _BEYOND, along.max() + _BEYOND
    lines[:, :, 1] = across[:, None]
    return lines


def _other(scenario: Scenario) -> int | None:
    """Find the column of the vehicle that the AV touches, or of the nearest one; None: it is alone."""
    if scenario.partner is not None or scenario.slot.size == 1:
        return scenario.partner
    apart = np.hypot(scenario.x[:, 1:] - scenario.x[:, :1], scenario.y[:, 1:] - scenario.y[:, :1])
    return 1 + int(np.nanargmin(np.where(scenario.present[:, 1:], apart, np.inf).min(axis=0)))


def _plotted(scenario: Scenario) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Make the plotted series: group to name to values (T,), NaN for missing values."""
    other = _other(scenario)
    plotted: dict[str, dict[str, NDArray[np.float64]]] = {
        "speed_mps": {"av": scenario.speed[:, 0]},
        "acceleration_mps2": {"av": scenario.acceleration[:, 0]},
    }
    if other is not None:
        there = scenario.present[:, other]
        plotted["speed_mps"]["other"] = np.where(there, scenario.speed[:, other], np.nan)
        plotted["acceleration_mps2"]["other"] = np.where(there, scenario.acceleration[:, other], np.nan)
        apart = np.abs(scenario.x[:, other] - scenario.x[:, 0]) - 0.5 * (scenario.length[0] + scenario.length[other])
        plotted["gap_m"] = {"": np.where(there, apart, np.nan)}
    return plotted
