"""The case file: one JSON that holds a driving case whole, to be mailed, kept beside an AV's tests, and driven.

`case_content.py` says what a file holds, and checks what is read. Numbers come back as the same bits.
"""

from __future__ import annotations

import importlib.metadata
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from cornerforge._files import check_regular, reason, writing
from cornerforge._locks import claim_file, claims
from cornerforge._schema import check_value, parse, read
from cornerforge.drivers.rails import POSE_NUMBERS, X
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.library.case_content import (
    FORMAT,
    VERSION,
    CaseContent,
    HappenedContent,
    PosesContent,
    StartContent,
    VehicleContent,
)
from cornerforge.library.out_case import Fact, MovingCase, plain_facts, plain_text, recorded_script
from cornerforge.sim import Script, n_slots, scripted
from cornerforge.types import CLASSES, FRAME_S, SUBSTEPS, Odd

__all__ = [
    "CaseFile",
    "Happened",
    "case_text",
    "is_case_file",
    "of_moving",
    "read_case_file",
    "write_case_file",
]

MOST_BYTES = 64_000_000
_BODY = ("length", "width", "kind")
_UNITS = {
    "x": "m", "y": "m", "speed": "mps", "lateral_speed": "mps", "heading": "rad", "acceleration": "mps2", "clock": "s",
    "duration": "s", "desired_speed": "mps", "change_time": "s",
}  # fmt: skip
_START = {
    name: f"{name}_{_UNITS[name]}" if name in _UNITS else name for name in scripted.START_FIELDS if name not in _BODY
}
"""Field of a start -> its name in the file."""
_AGENT_UNITS = {"s": "m", "enters": "s", "cleared": "m", "lights": "s", "resumes": "s"}
_AGENT = {name: f"{name}_{_AGENT_UNITS[name]}" if name in _AGENT_UNITS else name for name in scripted.AGENT_FIELDS}
"""Field of a start at a site -> its name in the file."""
_WHOLE = ("target_lane", "lanes", "signals", "away")
_SERIES = ("x_m", "y_m", "speed_mps", "lateral_speed_mps", "heading_rad", "acceleration_mps2", "lane")
"""Names of the columns of a pose, in their order (`drivers.rails`)."""
_POSE = ("x_m", "y_m", "speed_mps", "heading_rad")
_AT_START = ("x_m", "y_m", "speed_mps")
_SAME = 1e-6
_LEAST_CHANGE_S = 0.1
_LONGEST_NOTE, _MOST_NOTES, _LONGEST_LICENCE = 1_000, 10_000, 4_000
_LINE = 700
"""An object that needs more characters is spread over lines."""


@dataclass(frozen=True)
class Happened:
    """Outcome of a case.

    Attributes:
        frame: Frame (0.1 s) of the contact, counted from the start; None: the AV touched no vehicle.
        partner: Slot of the other vehicle; None without contact.
        pose: [x m, y m, speed m/s, heading rad] of the AV and the other in the frame of contact, float64 (2, 4); None
            without contact.
    """

    frame: int | None = None
    partner: int | None = None
    pose: NDArray[np.float64] | None = None

    @property
    def crashed(self) -> bool:
        """Was there a contact?"""
        return self.frame is not None


@dataclass(frozen=True)
class CaseFile:
    """A case as its file holds it.

    Attributes:
        name: Letters, digits, - and _.
        odd: Road and limits.
        script: The start, and how the others move: by their actions (`poses` is None), or on rails.
        av: Name of the AV that was in it; "recorded": the recorded vehicle in its place; None: not known.
        av_hash: Its hash; None: not known.
        happened: What became of it with that AV; None: not known.
        recorded: What the AV did, frame by frame from the start on, float64 (T, POSE_NUMBERS), where others act; None:
            not known. On rails this is column 0 of the script's poses.
        model: Hash of the naturalistic model that the others' actions depend on; None: the actions depend on no model.
        licence: What may be done with it.
        facts: What else is known.
        notes: What could not be carried over.
        made_by: Program that wrote the file; "" for the cornerforge that writes it.
    """

    name: str
    odd: Odd
    script: Script
    av: str | None = None
    av_hash: str | None = None
    happened: Happened | None = None
    recorded: NDArray[np.float64] | None = None
    model: str | None = None
    licence: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    made_by: str = ""

    @property
    def on_rails(self) -> bool:
        """Do the others move on rails, independent of the AV?"""
        return self.script.poses is not None

    @property
    def av_is_recorded(self) -> bool:
        """Can the case be driven with the recorded motion in the AV's place?"""
        return self.script.poses is not None and bool(np.isfinite(self.script.poses[:2, 0]).all())


def of_moving(case: MovingCase, *, set_speed: float | None = None, licence: str = "") -> CaseFile:
    """Make the file's case of a moving one: the others on rails, and what the AV did as long as it was recorded.

    Facts, notes and the licence are cut to what a file can hold (`cases.plain_facts`).

    Args:
        case: The case.
        set_speed: Speed that an AV is set to drive [m/s]; None: as `cases.script_of` says.
        licence: What may be done with it.

    Raises:
        InputError: The AV is not there in the first frame.
    """
    script = recorded_script(case, set_speed=set_speed)
    av = "recorded" if case.av_is_recorded else None
    notes = tuple(plain_text(note, _LONGEST_NOTE) for note in case.notes[:_MOST_NOTES])
    return CaseFile(
        case.name, case.odd, script, av, facts=plain_facts(case.facts), notes=notes,
        licence=plain_text(licence, _LONGEST_LICENCE),
    )  # fmt: skip


@claims()
def write_case_file(case: CaseFile, path: Path | str, *, overwrite: bool = False) -> Path:
    """Write a case file, whole or not at all.

    Args:
        case: The case.
        path: New file, .json.
        overwrite: It may be there already.

    Raises:
        OutputError: The file is there already, or cannot be written.
        InputError: The case has something that no case file can hold.
    """
    check_value("case", case, CaseFile)
    check_value("path", path, Path | str)
    check_value("overwrite", overwrite, bool)
    path = Path(path)
    if path.suffix != ".json":
        raise InputError(f"{path}: the name of a case file ends in .json; name it so.")
    text = case_text(case)
    claim_file(path)
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already; remove it, or choose another place.")
    with writing(path, "the case file") as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return path


def case_text(case: CaseFile) -> str:
    """Make the text of a case file.

    Raises:
        InputError: The case has something that no case file can hold.
    """
    content = _content(case)
    try:
        _checked(content, f"Case {case.name!r} cannot be written as a case file")
    except FileFormatError as error:
        raise InputError(str(error)) from None
    return _dump(content, "") + "\n"


def read_case_file(path: Path | str) -> CaseFile:
    """Read a case file.

    Raises:
        FileFormatError: It cannot be read, is no case file, is of another version, or something in it is wrong: the
            message says what, where, and what it must be.
    """
    check_value("path", path, Path | str)
    path = Path(path)
    try:
        check_regular(path)
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FileFormatError(f"Cannot read the case file {path}: {reason(error)}.") from error
    if len(content) > MOST_BYTES:
        raise FileFormatError(f"{path} has more than {MOST_BYTES // 1_000_000} MB; no case file is so large.")
    try:
        parsed = parse(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise FileFormatError(f"{path} is no case file: it is no text in UTF-8; save it as such.") from None
    except ValueError as error:
        raise FileFormatError(f"{path} is no case file: {error}.") from None
    _check_kind(parsed, path)
    return _case_of(*_checked(parsed, str(path)))


def is_case_file(path: Path) -> bool:
    """Is this a case file by its field `format`? One that is damaged or cannot be read is still taken for one."""
    try:
        check_regular(path)
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        found = json.loads(content)
    except OSError:
        return True
    except (ValueError, RecursionError):
        return FORMAT.encode() in content
    return isinstance(found, dict) and found.get("format") == FORMAT


def _check_kind(parsed: Any, path: Path) -> None:
    """Refuse another format or version.

    Raises:
        FileFormatError: It is one.
    """
    if not isinstance(parsed, dict) or parsed.get("format") != FORMAT:
        raise FileFormatError(f'{path} is no case file: it has no "format": "{FORMAT}".')
    version = parsed.get("version")
    if version != VERSION or isinstance(version, bool):
        newer = isinstance(version, int) and version > VERSION
        raise FileFormatError(
            f"{path} is a case file of version {version!r}; this cornerforge reads version {VERSION}"
            f"{': upgrade cornerforge' if newer else ''}."
        )


# Writing


def _content(case: CaseFile) -> dict[str, Any]:
    """Make what the file holds as JSON values."""
    script, rails = case.script, case.on_rails
    if (script.hidden >= 0).any():
        raise InputError(
            f"In {case.name} an adversary made the AV lose sight of a vehicle, which a case file cannot say; keep the "
            "library."
        )
    poses = script.poses
    set_speed = float(script.start[0]["desired_speed"])
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": case.name,
        "made_by": case.made_by or f"cornerforge {importlib.metadata.version('cornerforge')}",
        "licence": case.licence,
        "model": case.model,
        "notes": list(case.notes),
        "facts": dict(case.facts),
        "av": {"name": case.av, "hash": case.av_hash},
        "happened": None if case.happened is None else _happened(case.happened),
        "road": {name: _number(v) if isinstance(v, float) else v for name, v in case.odd.stated().items()},
        "seed": int(script.seed),
        "test": int(script.test),
        "others": "rails" if rails else "act",
        "seconds": len(script.action),
        "set_speed_mps": _number(set_speed) if rails and set_speed > 0.0 else None,
        "frames": None if poses is None else len(poses),
        "vehicles": [_vehicle(case, column) for column in range(script.slot.size)],
    }


def _happened(happened: Happened) -> dict[str, Any]:
    if happened.frame is None or happened.pose is None:
        return {"contact": False}
    av, other = ({n: _number(v) for n, v in zip(_POSE, row, strict=True)} for row in happened.pose.tolist())
    return {
        "contact": True, "time_s": _number(round(FRAME_S * happened.frame, 1)), "partner": happened.partner, "av": av,
        "other": other,
    }  # fmt: skip


def _vehicle(case: CaseFile, column: int) -> dict[str, Any]:
    script = case.script
    state = script.start[column]
    start: dict[str, Any] = {
        shown: int(state[name]) if name in _WHOLE else _number(state[name])
        for name, shown in _START.items()
        if not _is_left_out(name, float(state[name]))
        and not (case.on_rails and column == 0 and name == "desired_speed")
    }
    if script.start.dtype == scripted.AT_SITE:
        start["at_site"] = {shown: _number(state[name]) for name, shown in _AGENT.items()}
    content: dict[str, Any] = {
        "slot": int(script.slot[column]),
        "class": CLASSES[int(state["kind"])].name,
        "length_m": _number(state["length"]),
        "width_m": _number(state["width"]),
        "start": start,
    }
    if column > 0 and not case.on_rails:
        content["actions"] = _short(script.action[:, column].tolist())
    poses = script.poses[:, column] if script.poses is not None else None
    if column == 0 and poses is None:
        poses = case.recorded
    if poses is not None and np.isfinite(poses[:, X]).any():
        content["poses"] = _poses(poses, of_float32=column == 0 and not case.on_rails)
    return content


def _is_left_out(name: str, value: float) -> bool:
    """Is it what a reader takes anyway? -0.0 is not."""
    return name not in ("x", "y", "speed", "lanes") and value == 0.0 and math.copysign(1.0, value) > 0.0


def _poses(poses: NDArray[np.float64], *, of_float32: bool) -> dict[str, Any]:
    there = np.flatnonzero(np.isfinite(poses[:, X]))
    first, end = int(there[0]), int(there[-1]) + 1
    number = _number32 if of_float32 else _number
    found: dict[str, Any] = {"first_frame": first, "frames": end - first}
    for index, name in enumerate(_SERIES):
        values = poses[first:end, index].tolist()
        found[name] = _short([None if math.isnan(value) else number(value) for value in values])
    return found


def _short(values: list[Any]) -> Any:
    """One value for a list of equal ones; a list that knows -0.0 from 0.0 stays a list."""
    first = values[0]
    if first is None or any(repr(value) != repr(first) for value in values):
        return values
    return first


def _number(value: Any) -> int | float:
    """The shortest number that is the same bits as a float64: whole ones without a point."""
    number = float(value)
    is_whole = number.is_integer() and abs(number) < 1e15 and not (number == 0.0 and math.copysign(1.0, number) < 0.0)
    return int(number) if is_whole else number


def _number32(value: Any) -> int | float:
    """The shortest number that is the same bits as a float32."""
    short = float(str(np.float32(value)))
    return _number(short if np.float32(short) == np.float32(value) else value)


def _dump(value: Any, indent: str) -> str:
    """Write JSON for people: what is short, and each list of numbers, in one line."""
    line = json.dumps(value, ensure_ascii=False, allow_nan=False)
    inner = indent + " "
    if isinstance(value, dict) and (len(line) > _LINE or not indent):
        parts = [f"{json.dumps(key)}: {_dump(one, inner)}" for key, one in value.items()]
        return "{\n" + ",\n".join(inner + part for part in parts) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(one, dict) for one in value):
        return "[\n" + ",\n".join(inner + _dump(one, inner) for one in value) + f"\n{indent}]"
    return line


# Reading


def _checked(content: Any, place: str) -> tuple[CaseContent, Odd]:
    """Give what a file holds, and its road, if all of it fits together.

    Raises:
        FileFormatError: It does not.
    """
    case = read(CaseContent, content, place)
    try:
        odd = Odd.of_stated(msgspec.to_builtins(case.road))
    except InputError as error:
        raise FileFormatError(f"{place}: {error}") from error
    for fault in _faults(case, odd):
        raise FileFormatError(f"{place}: {fault}.")
    return case, odd


def _faults(content: CaseContent, odd: Odd) -> Iterator[str]:
    vehicles = content.vehicles
    slots = [one.slot for one in vehicles]
    if slots[0] != 0 or any(b <= a for a, b in itertools.pairwise(slots)):
        yield f"the slots of the vehicles are {slots[:10]}; they must ascend from 0, the AV"
    rails, seconds, frames = content.others == "rails", content.seconds, content.frames
    if rails and (frames is None or frames <= SUBSTEPS * seconds):
        yield f"frames is {frames}; rails of {seconds} s must have at least {SUBSTEPS * seconds + 1}"
    if not rails and (frames is not None or content.set_speed_mps is not None):
        yield "frames and set_speed_mps are for others on rails; where they act, both must be null"
    if seconds > math.ceil(odd.time_limit):
        yield f"seconds is {seconds}; it must not be above the road's time_limit, {odd.time_limit:g}"
    if len(vehicles) > (room := n_slots(odd)):
        yield (
            f"vehicles has {len(vehicles):,} entries; a road of {odd.n_lanes} lanes with a traffic_length of "
            f"{odd.traffic_length:g} m has room for {room:,}"
        )
    for index, one in enumerate(vehicles):
        yield from _vehicle_faults(one, f"vehicles[{index}]", content, odd)
    yield from _happened_faults(content, slots)


def _happened_faults(content: CaseContent, slots: Sequence[int]) -> Iterator[str]:
    happened, frames = content.happened, content.frames
    if happened is not None:
        is_contact = happened.contact
        rest = [
            name for name in ("time_s", "partner", "av", "other") if (getattr(happened, name) is UNSET) == is_contact
        ]
        if rest:
            yield f"happened.contact is {is_contact}, so happened must {'' if is_contact else 'not '}have {rest[0]}"
        elif is_contact and happened.partner not in slots[1:]:
            yield f"happened.partner is {happened.partner}; no other vehicle has this slot"
        longest = FRAME_S * (SUBSTEPS * content.seconds if frames is None else frames - 1)
        if happened.time_s is not UNSET and happened.time_s > longest + _SAME:
            yield f"happened.time_s is {happened.time_s:g}; it must be at most {longest:g}, the length of the case"


def _vehicle_faults(one: VehicleContent, place: str, content: CaseContent, odd: Odd) -> Iterator[str]:
    lanes = odd.n_lanes if odd.site is None else len(odd.site.routes)
    rails, is_av = content.others == "rails", one.slot == 0
    start, actions, poses = one.start, one.actions, one.poses
    if (start.at_site is UNSET) != (odd.site is None):
        yield f"{place}.start must {'not ' if odd.site is None else ''}have at_site"
    elif start.at_site is not UNSET and start.at_site.route >= lanes:
        yield f"{place}.start.at_site.route is {start.at_site.route}; the site has {lanes} routes"
    if start.target_lane >= lanes or start.lanes >= 1 << lanes:
        yield f"{place}.start names a lane that the road does not have: it has {lanes}"
    if is_av and start.speed_mps < 0.0:
        yield f"{place}.start.speed_mps is {start.speed_mps:g}; that of the AV must be 0 or more"
    if (is_av or not rails) and start.change_time_s < _LEAST_CHANGE_S:
        yield f"{place}.start.change_time_s is {start.change_time_s:g}; a change takes {_LEAST_CHANGE_S:g} s or more"
    if (not rails and not is_av) != (actions is not UNSET):
        yield f"{place}: actions stand where others act and nowhere else, and not with the AV"
    if rails and not is_av and poses is UNSET:
        yield f"{place} lacks poses: it is on rails"
    if not rails and not is_av and poses is not UNSET:
        yield f"{place} has poses, but it is not on rails"
    if isinstance(actions, list) and len(actions) != content.seconds:
        yield f"{place}.actions has {len(actions)} entries; it must have {content.seconds}, one a second"
    if poses is not UNSET:
        yield from _pose_faults(poses, f"{place}.poses", content.frames, lanes)
        if is_av and poses.first_frame != 0:
            yield f"{place}.poses.first_frame is {poses.first_frame}; that of the AV must be 0"
        if rails:
            yield from _start_faults(start, poses, place)


def _start_faults(start: StartContent, poses: PosesContent, place: str) -> Iterator[str]:
    """Compare where a vehicle on rails starts with the first frame in which it is there."""
    for name in _AT_START:
        said, at_start = getattr(poses, name), getattr(start, name)
        there = next((value for value in (said if isinstance(said, list) else [said]) if value is not None), at_start)
        if abs(there - at_start) > _SAME:
            yield f"{place}.start.{name} is {at_start:g}; it must be {there:g}, as in the first frame of its poses"


def _pose_faults(poses: PosesContent, place: str, frames: int | None, lanes: int) -> Iterator[str]:
    first, count = poses.first_frame, poses.frames
    if frames is not None and first + count > frames:
        yield f"{place} ends after frame {frames - 1}, the last one"
    there: list[bool] | None = None
    for name in _SERIES:
        said = getattr(poses, name)
        values = said if isinstance(said, list) else [said] * count
        if len(values) != count:
            yield f"{place}.{name} has {len(values)} entries; it must have {count}, one a frame"
        now = [value is not None for value in values]
        if not any(now):
            yield f"{place}.{name} is null in all frames; the vehicle must be somewhere in one of them"
        if isinstance(said, list):
            if there is not None and now != there:
                yield f"{place}.{name} is null in other frames than the series before it"
            there = now
        if name == "lane" and any(v is not None and (v != int(v) or not 0 <= v < lanes) for v in values):
            yield f"{place}.lane must be a whole number from 0 to {lanes - 1}"


def _case_of(content: CaseContent, odd: Odd) -> CaseFile:
    vehicles, happened = content.vehicles, content.happened
    start = scripted.scripted_start(np.array([_start_of(one) for one in vehicles], dtype=np.float64))
    action = np.full((content.seconds, len(vehicles)), scripted.NATURAL, dtype=np.int8)
    poses = None
    recorded = None
    if content.frames is not None:
        start[0]["desired_speed"] = content.set_speed_mps or 0.0
        poses = np.stack([_poses_of(one.poses, content.frames) for one in vehicles], axis=1)
    else:
        for column, one in enumerate(vehicles[1:], start=1):
            action[:, column] = np.asarray(one.actions)
        of_av = vehicles[0].poses
        if of_av is not UNSET:
            recorded = _poses_of(of_av, of_av.first_frame + of_av.frames).astype(np.float32).astype(np.float64)
    slot = np.array([one.slot for one in vehicles], dtype=np.int16)
    return CaseFile(
        name=content.name,
        odd=odd,
        script=Script(slot, start, action, content.seed, content.test, poses),
        av=content.av.name,
        av_hash=content.av.hash,
        happened=None if happened is None else _happened_of(happened),
        recorded=recorded,
        model=content.model,
        licence=content.licence,
        facts=content.facts,
        notes=tuple(content.notes),
        made_by=content.made_by,
    )


def _start_of(one: VehicleContent) -> list[float]:
    kind = next(index for index, road_user in enumerate(CLASSES) if road_user.name == one.kind)
    body = {"length": one.length_m, "width": one.width_m, "kind": kind}
    found = [float(body[name] if name in body else getattr(one.start, _START[name])) for name in scripted.START_FIELDS]
    agent = one.start.at_site
    return found + ([] if agent is UNSET else [float(getattr(agent, _AGENT[name])) for name in scripted.AGENT_FIELDS])


def _poses_of(one: PosesContent | UnsetType, frames: int) -> NDArray[np.float64]:
    """Poses of a vehicle, (frames, POSE_NUMBERS); NaN where it is absent."""
    poses = np.full((frames, POSE_NUMBERS), np.nan)
    if one is UNSET:
        return poses
    for index, name in enumerate(_SERIES):
        values = np.array(getattr(one, name), dtype=np.float64)  # null becomes NaN
        poses[one.first_frame : one.first_frame + one.frames, index] = values
    # A series that stays the same says nothing of when the vehicle is there.
    poses[np.isnan(poses).any(axis=1)] = np.nan
    return poses


def _happened_of(happened: HappenedContent) -> Happened:
    if happened.time_s is UNSET or happened.partner is UNSET:
        return Happened()
    pose = np.array([[getattr(who, name) for name in _POSE] for who in (happened.av, happened.other)])
    return Happened(round(happened.time_s / FRAME_S), happened.partner, pose)
