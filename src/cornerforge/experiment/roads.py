"""Roads by their names, and road files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cornerforge._checks import check_in
from cornerforge.errors import FileFormatError, InputError, UnknownNameError
from cornerforge.results.stating import as_json, from_file
from cornerforge.road.lanes import av_lanes_at, lane_table
from cornerforge.road.network import Lane, Road, faults_of
from cornerforge.road.shipped import ROAD_FILES, SHIPPED
from cornerforge.types import Odd
from cornerforge.work.files import write_json

__all__ = ["TASKS", "odd_on", "read_road", "road_in_words", "road_named", "write_road_file"]

TASKS = {"through": "drives through", "ramp": "comes from the ramp", "exit": "takes the exit"}
"""What an AV may have to do, in words."""
_TRAFFIC = {
    "dense": "Traffic is dense, 14 m/s in the mean.",
    "queue": "Traffic drives freely up to the end of a queue that crawls at 0 to 8 m/s.",
}
"""Traffic that stops, in words."""
_BEFORE_BEGIN, _BEFORE_END, _BEFORE_EXIT, _ON_RAMP, _AFTER = 250.0, 500.0, 500.0, 150.0, 100.0
_SHORTEST, _LONGEST = 400.0, 1000.0


def odd_on(odd: Odd, road: Road, task: str = "through") -> Odd:
    """Put an ODD's traffic and AV on a road, before the first place at which its lanes change.

    The AV starts 250 m before a lane begins, 500 m before one ends or an exit begins, and on a ramp 150 m before it
    meets the road; on a road whose lanes go on, where it does without a road. The drive ends 100 m after the last
    change, after 400 m to 1 km; beyond a road's ends its lanes go on straight.

    Raises:
        InputError: The road has not what the task needs, or no lane in which the AV could start.
    """
    check_in("task", task, tuple(TASKS))
    if task != "through" and not _mouths(road, task):
        raise InputError(
            f"task = {task!r} needs {'an on-ramp' if task == 'ramp' else 'an exit'}; {road.name} has none."
        )
    begins = [lane.begin for lane in road.lanes if lane.begin > 0.0 and lane.kind not in ("ramp", "closed")]
    ends = [lane.end for lane in road.lanes if lane.end < road.length and road.open_after(lane) is None
            and lane.kind not in ("ramp", "closed")]  # fmt: skip
    if task == "ramp":
        start = _mouths(road, task)[0].begin - _ON_RAMP
    elif task == "exit":
        start = _mouths(road, task)[0].begin - _BEFORE_EXIT
    else:
        early = min(odd.av_start, road.length - _SHORTEST)
        start = min([*(s - _BEFORE_BEGIN for s in begins), *(s - _BEFORE_END for s in ends)], default=early)
    start = max(0.0, start)
    exits = [lane.end for lane in road.lanes if lane.kind == "deceleration"]
    last = max([*begins, *ends, *exits], default=start)
    length = min(max(last + _AFTER - start, _SHORTEST), _LONGEST)
    found = replace(
        odd,
        n_lanes=road.slots,
        lane_width=road.lane_width,
        road=road,
        road_at=start - odd.av_start,
        task=task,
        test_length=length,
    )
    if not av_lanes_at(found, found.av_start):
        raise InputError(f"{road.name} has no lane at {start:.0f} m in which the AV could start; cut it with --from.")
    return found


def road_in_words(odd: Odd) -> str:
    """Say on which road and in which traffic an ODD's AV drives and what it perceives, and what is not known of them.

    "" for free traffic on the straight road that is seen perfectly.

    >>> road_in_words(Odd())
    ''
    """
    told = [] if odd.road is None else [f"Road: {odd.road.name}; the AV {TASKS[odd.task]}."]
    told += [_TRAFFIC[odd.traffic]] if odd.traffic in _TRAFFIC else []
    ends = lane_table(odd).varied
    if ends:
        told.append("Where lanes end the other drivers merge by a stated law that was not fitted to recordings.")
    if ends or odd.traffic in _TRAFFIC:
        told.append("How often the AV crashes there is less certain than its interval says (docs/roads.md).")
    if odd.perception is not None:
        told.append(f"The AV perceives imperfectly: {odd.perception.in_words()} (docs/perception.md).")
    return " ".join(told)


def _mouths(road: Road, task: str) -> list[Lane]:
    """Give the lanes in which a ramp meets the road, or the exit begins, in the order of travel."""
    after_ramp = {(one.slot, one.end) for one in road.lanes if one.kind == "ramp"}
    found = [
        lane for lane in road.lanes
        if (lane.kind == "deceleration" if task == "exit" else (lane.slot, lane.begin) in after_ramp)
    ]  # fmt: skip
    return sorted(found, key=lambda lane: lane.begin)


def read_road(name: str | Path) -> Road:
    """Give a road by its name, or read it from a file that `road import` has written, whatever is wrong with it.

    Raises:
        UnknownNameError: No road and no file has this name.
        FileFormatError: The file is damaged, or holds no road of ours.
    """
    if str(name) in SHIPPED:
        return SHIPPED[str(name)]()
    file = ROAD_FILES.get(str(name), Path(name))
    if not file.is_file():
        raise UnknownNameError("road", str(name), [*SHIPPED, *ROAD_FILES])
    if str(name).endswith((".xodr", ".xml", ".xml.gz")):
        raise FileFormatError(f"{name} is no road file yet; make one: cornerforge road import {name} --out ROAD.json")
    road = from_file(Road, file, "cornerforge road import")
    try:
        road.line  # noqa: B018
    except InputError as error:
        raise FileFormatError(f"{name}: {error} Write it again with: cornerforge road import") from error
    return road


def road_named(name: str | Path) -> Road:
    """Give a road that can be driven, as `read_road`.

    Raises:
        UnknownNameError, FileFormatError: As there.
        InputError: The road cannot be driven.
    """
    road = read_road(name)
    if faults := faults_of(road):
        raise InputError(f"{name}: {'; '.join(faults)}.")
    return road


def write_road_file(road: Road, path: Path) -> None:
    """Write a road as JSON with a checksum.

    Raises:
        OutputError: It cannot be written.
    """
    write_json(path, as_json(road))
