"""Reference drivers that would have prevented a crash in the AV's place (ADR 39; `counterfactual.careful`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer, check_number
from cornerforge.analysis.avoidability import AvoidParams, manoeuvres_of, problem_of
from cornerforge.analysis.site_avoid import careful_at_site, manoeuvre_at_site, poses_on_route
from cornerforge.analysis.site_case import SiteCase, site_case
from cornerforge.counterfactual import (
    MANOEUVRES,
    Judgements,
    JudgeScratch,
    Manoeuvres,
    allocate_judge_scratch,
    allocate_judgements,
    judge_cases,
    no_tracks,
)
from cornerforge.drivers.careful import CAREFUL, HOLDS
from cornerforge.errors import InputError
from cornerforge.fields import Field
from cornerforge.recordings import Recordings, recordings_of
from cornerforge.types import FRAME_S, Odd, Scenario
from cornerforge.work import Rooms, in_order

__all__ = [
    "CAREFULLY",
    "MOST",
    "NOT_JUDGED",
    "PREVENTED_COLUMNS",
    "PREVENTION",
    "PREVENTIONS",
    "REACTIONS_S",
    "Driven",
    "Prevented",
    "Prevention",
    "driven_by",
    "prevented_at",
    "prevented_by",
    "prevention_of",
]

_CHUNK = 256
_NOBODY = "nobody"
_OWN = -1.0
_HARD = 3.0
"""Braking of a reference driver from which the AV's braking was not for nothing [m/s2]."""
MOST = 3
"""Reference drivers, of four, that speak for a careful driver: one or two of them differ too much from the others."""

REACTIONS_S = (0.0, 0.5, 0.75, 1.0, 1.5)
"""Reaction times that are compared [s]."""


PREVENTIONS: dict[str, str] = {
    "by braking": "a careful driver would have prevented it by braking: at least three of four models do, or the AV's "
    "motion alone tells that it braked too late; at a site the one model that there is",
    "by leaving it out": "a careful driver would have kept lane, speed and distance instead of what the AV began",
    "another speed": "the speed that the AV then had would have been enough, which no care would have told",
    "models differ": "some of four models of a careful driver would have prevented it: one or two, or more where the "
    "AV's rear was struck",
    "nobody": "no model of a careful driver would have prevented it",
    "not judged": "it cannot be judged",
}
"""What would have prevented a crash, and its meaning."""
PREVENTION = tuple(PREVENTIONS)
CAREFULLY, NOT_JUDGED = PREVENTION[:2], PREVENTION[-1]
"""The ways in which a careful driver prevents."""


def _column(driver: str) -> str:
    return driver.replace("-", "_")


PREVENTED_COLUMNS: tuple[Field, ...] = (
    Field("manoeuvre", "string", "", f"What led to it: {', '.join(MANOEUVRES)} (`counterfactual.begin`); null: it "
          "cannot be judged.", nullable=True),
    Field("prevented_by", "string", "", f"Reference drivers that would have prevented it, of {', '.join(CAREFUL)}; "
          f'"{_NOBODY}": none; null: it cannot be judged.', nullable=True),
    Field("prevention", "string", "", f"What would have prevented it: {', '.join(PREVENTION)}."),
    Field("held_speed_prevents", "bool", "", "Would it have been prevented by holding the speed, without any braking? "
          "null: it cannot be judged.", nullable=True),
    *(Field(f"least_ttc_{_column(name)}_s", "float64", "s", f"Least time to collision of {name} in the AV's place; "
            "null: it never closes in on a vehicle in front.", (0.0, float("inf")), nullable=True) for name in CAREFUL),
    *(Field(f"braking_{_column(name)}_mps2", "float64", "m/s2", f"Hardest braking of {name} in the AV's place; "
            "null: it cannot be judged.", (0.0, 1e3), nullable=True) for name in CAREFUL),
)  # fmt: skip
"""Columns of `Prevention.columns`."""


@dataclass(frozen=True)
class Prevented:
    """Outcome of one crash with a reference driver in the AV's place.

    Attributes:
        prevented: No vehicle touches it until the horizon, and from there it can stop.
        by_holding: Holding the speed alone is enough, so that no braking has prevented it.
        reacts_s: When it sees danger first, before the contact; negative: after it; None: never.
        least_ttc_s: Least time to collision with a vehicle in front; inf where it never closes in.
        braking_mps2: Its hardest braking, at least 0.
    """

    prevented: bool
    by_holding: bool
    reacts_s: float | None = field(metadata={"unit": "s"})
    least_ttc_s: float = field(metadata={"unit": "s"})
    braking_mps2: float = field(metadata={"unit": "m/s2"})


@dataclass(frozen=True)
class Driven:
    """How a reference driver moves in the AV's place in one crash.

    Attributes:
        prevented: What it makes of the crash.
        begin_s: When it takes over, before the contact.
        track: Every 0.1 s from then on [x m, y m, speed m/s, heading rad], until the contact of the recording, or until
            it is touched before that; (W, 4).
    """

    prevented: Prevented
    begin_s: float = field(metadata={"unit": "s"})
    track: NDArray[np.float64]


@dataclass(frozen=True)
class Prevention:
    """Outcomes of C cases with the reference drivers; columns in the order of `CAREFUL`.

    Attributes:
        judged: False where the recording cannot be judged, (C,).
        manoeuvre: What led to the crash, its place in `counterfactual.MANOEUVRES`, int64 (C,).
        prevented: (C, drivers), False where not judged.
        held: Prevented by holding the speed alone, (C,), False where not judged.
        least_ttc: [s], inf where it never closes in, (C, drivers).
        braking: Hardest braking [m/s2], (C, drivers).
        reacts: Where at least `MOST` of them prevent it by braking: frames before the contact at which the last of
            these saw danger; else -1, int64 (C,).
        calm: At least `MOST` of them saw no danger before the contact, (C,).
    """

    judged: NDArray[np.bool_]
    manoeuvre: NDArray[np.int64]
    prevented: NDArray[np.bool_]
    held: NDArray[np.bool_]
    least_ttc: NDArray[np.float64]
    braking: NDArray[np.float64]
    reacts: NDArray[np.int64]
    calm: NDArray[np.bool_]

    @property
    def needless(self) -> NDArray[np.bool_]:
        """Mark the cases in which the AV's speed would have been enough and no driver braked hard, bool (C,)."""
        return np.asarray(self.held & self.calm & (self.braking.max(axis=1) < _HARD))

    def ways(self, slow: NDArray[np.bool_], begun: NDArray[np.bool_]) -> NDArray[np.str_]:
        """Say of each case what would have prevented it, one of `PREVENTION`, (C,).

        Args:
            slow: Cases in which the AV braked too late, too weakly or not at all (`analysis.conduct`), (C,).
            begun: Cases in which it did something wrong that it could have left out, (C,).
        """
        some = self.prevented.any(axis=1)
        found = np.where(self.held, PREVENTION[2], np.where(some, PREVENTION[3], PREVENTION[4]))
        found = np.where(begun & (self.held | some), PREVENTION[1], found)
        found = np.where(slow, PREVENTION[0], found)
        return np.asarray(np.where(self.judged, found, NOT_JUDGED), np.str_)

    def columns(self, slow: NDArray[np.bool_], begun: NDArray[np.bool_]) -> dict[str, Any]:
        """Make the values of `PREVENTED_COLUMNS`; NaN stands for null. Arguments as for `ways`."""
        names, manoeuvres = list(CAREFUL), list(MANOEUVRES)
        said = [
            (", ".join(n for n, yes in zip(names, row, strict=True) if yes) or _NOBODY) if judged else None
            for row, judged in zip(self.prevented.tolist(), self.judged.tolist(), strict=True)
        ]
        ttc = np.where(self.judged[:, None] & np.isfinite(self.least_ttc), self.least_ttc, np.nan)
        braking = np.where(self.judged[:, None], self.braking, np.nan)
        return {
            "manoeuvre": [
                manoeuvres[code] if judged else None
                for code, judged in zip(self.manoeuvre.tolist(), self.judged.tolist(), strict=True)
            ],
            "prevented_by": said,
            "prevention": self.ways(slow, begun),
            "held_speed_prevents": [
                held if judged else None for held, judged in zip(self.held.tolist(), self.judged.tolist(), strict=True)
            ],
            **{f"least_ttc_{_column(name)}_s": ttc[:, k] for k, name in enumerate(names)},
            **{f"braking_{_column(name)}_mps2": braking[:, k] for k, name in enumerate(names)},
        }


def prevention_of(
    recordings: Recordings, problems: list[str | None], odd: Odd, params: AvoidParams, *,
    reaction_s: float | None = None, threads: int = 1,
) -> Prevention:  # fmt: skip
    """Let each reference driver drive in the AV's place in each case; at a site `cc-human` alone (`site_avoid`).

    Args:
        recordings: Recordings of the cases.
        problems: Why a case cannot be judged (`avoidability.problem_of`); None: it can.
        odd: Road and rules of all of them.
        params: `horizon_s`, `others` and `steers` are read.
        reaction_s: Time from seeing danger to braking, of all drivers, 0 to 5; None: each has its own.
        threads: Size of the pool; does not change the result.

    Raises:
        InputError: A number is out of range.
    """
    check_integer("threads", threads, low=1, high=1024)
    reaction = _OWN if reaction_s is None else check_number("reaction_s", reaction_s, low=0.0, high=5.0, unit="s")
    judged = np.array([problem is None for problem in problems], np.bool_)
    if odd.site is not None:
        return _at_site(recordings, judged, odd, params, reaction_s)
    out = allocate_judgements(0)
    if recordings.n_cases:
        recordings = recordings._replace(partner=np.where(judged, recordings.partner, 0))
        manoeuvres = manoeuvres_of(odd, params)
        frames, vehicles = int(recordings.frames.max()), int(recordings.vehicles.max())
        rooms = Rooms(partial(allocate_judge_scratch, manoeuvres, frames, vehicles))
        judge = partial(_judge_range, recordings, manoeuvres, float(reaction), rooms)
        parts = list(in_order(judge, 0, recordings.n_cases, chunk=_CHUNK, threads=threads))
        out = Judgements(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    untouched = (out.touched < 0) & judged[:, None]
    brakes = untouched[:, :HOLDS] & ~untouched[:, HOLDS:] & (out.reacted[:, :HOLDS] >= 0)
    seen = recordings.last - np.where(brakes, out.reacted[:, :HOLDS], -1).max(axis=1, initial=-1)
    return Prevention(
        judged, out.manoeuvre, untouched[:, :HOLDS], untouched[:, HOLDS], out.least_ttc[:, :HOLDS],
        out.braking[:, :HOLDS], np.where(brakes.sum(axis=1) >= MOST, np.maximum(seen, 0), -1),
        ((out.reacted[:, :HOLDS] < 0) | (out.reacted[:, :HOLDS] > recordings.last[:, None])).sum(axis=1) >= MOST,
    )  # fmt: skip


def _at_site(
    recordings: Recordings, judged: NDArray[np.bool_], odd: Odd, params: AvoidParams, reaction_s: float | None
) -> Prevention:  # fmt: skip
    """Let the careful driver of sites drive; the others know lanes, prevent nothing, and have null numbers."""
    n, driver = recordings.n_cases, CAREFUL["cc-human"]
    none = np.zeros(n, np.bool_)
    out = Prevention(
        judged, np.zeros(n, np.int64), np.zeros((n, len(CAREFUL)), np.bool_), none.copy(),
        np.full((n, len(CAREFUL)), np.inf), np.full((n, len(CAREFUL)), np.nan), np.full(n, -1), none,
    )  # fmt: skip
    for k, block in enumerate(recordings.blocks(1)):
        if judged[k]:
            case = site_case(block, odd)
            found = careful_at_site(case, params, reaction_s)
            out.manoeuvre[k] = manoeuvre_at_site(case)[0]
            out.prevented[k, driver], out.held[k] = found.prevents, found.holds
            out.braking[k, driver] = found.braking_mps2
            if found.brakes and not found.holds:
                out.reacts[k] = case.last - found.sees
    return out


def prevented_at(
    recordings: Recordings, problems: list[str | None], odd: Odd, params: AvoidParams, *, threads: int = 1
) -> NDArray[np.bool_]:
    """Say of C cases which of D reference drivers would have prevented it, had they reacted as fast as `REACTIONS_S`.

    Arguments as for `prevention_of`.

    Returns:
        Shape (C, reactions, D), False where a case cannot be judged. A driver sees danger by its own rule all the same.
    """
    each = [
        prevention_of(recordings, problems, odd, params, reaction_s=reaction, threads=threads).prevented
        for reaction in REACTIONS_S
    ]
    return np.stack(each, axis=1)


def _judge_range(
    recordings: Recordings, manoeuvres: Manoeuvres, reaction: float, rooms: Rooms[JudgeScratch], first: int, count: int
) -> Judgements:
    out = allocate_judgements(count)
    with rooms.lend() as scratch:
        judge_cases(recordings, first, first + count, manoeuvres, reaction, scratch, out, no_tracks(count))
    return out


def prevented_by(scenario: Scenario, params: AvoidParams | None = None) -> dict[str, Prevented]:
    """Let each reference driver drive in the AV's place in one recorded crash.

    It takes over when the manoeuvre that led to the crash began, or earlier, where it sees danger while the AV nears
    the vehicle that it will run into. It holds its speed until it sees danger, and then brakes on the path that the AV
    was on; the others drive as recorded, and after the contact as for the ways out (ADR 14).

    Args:
        scenario: Recording of a test that ended in a crash of the AV; vehicles that never came near may be missing.
        params: `horizon_s`, `others` and `steers` are read; None: the defaults.

    Returns:
        By name of the driver (`drivers.careful.CAREFUL`).

    Raises:
        InputError: As `avoidability.avoidability`.
    """
    return {name: drive.prevented for name, drive in driven_by(scenario, params).items()}


def _driven_at_site(case: SiteCase, params: AvoidParams) -> Driven:
    """Let the careful driver of sites drive, and keep how it moves."""
    found = careful_at_site(case, params)
    reacts = None if found.sees < 0 else round((case.last - found.sees) * FRAME_S, 1)
    begin = case.last if found.begin < 0 else found.begin
    track = poses_on_route(case, found.track[: case.last - begin + 1])
    told = Prevented(found.prevents, found.holds, reacts, np.inf, found.braking_mps2)
    return Driven(told, round((case.last - begin) * FRAME_S, 1), track)


def driven_by(scenario: Scenario, params: AvoidParams | None = None) -> dict[str, Driven]:
    """Let each reference driver drive as `prevented_by` does, and keep how it moves; arguments and errors as there."""
    recordings = recordings_of(scenario)
    problem = problem_of(recordings, -1, scenario.odd)
    if problem is not None:
        raise InputError(f"Test {recordings.case_ids[0]}: {problem}.")
    if scenario.odd.site is not None:
        return {"cc-human": _driven_at_site(site_case(recordings, scenario.odd), params or AvoidParams())}
    m = manoeuvres_of(scenario.odd, params or AvoidParams())
    out, last = allocate_judgements(1), int(recordings.last[0])
    scratch = allocate_judge_scratch(m, int(recordings.frames[0]), int(recordings.vehicles[0]))
    tracks = np.full((*no_tracks(1).shape[:2], last + 1, 4), np.nan)
    judge_cases(recordings, 0, 1, m, _OWN, scratch, out, tracks)

    def drive(k: int) -> Driven:
        begin = int(out.begin[0, k])
        touched = int(out.touched[0, k])
        reacted = None if out.reacted[0, k] < 0 else round((last - int(out.reacted[0, k])) * FRAME_S, 1)
        end = last if touched < 0 else min(last, touched)
        return Driven(
            Prevented(
                prevented=touched < 0,
                by_holding=bool(out.touched[0, HOLDS] < 0),
                reacts_s=reacted,
                least_ttc_s=float(out.least_ttc[0, k]),
                braking_mps2=float(out.braking[0, k]),
            ),
            begin_s=round((last - begin) * FRAME_S, 1),
            track=tracks[0, k, : end - begin + 1],
        )

    return {name: drive(k) for name, k in CAREFUL.items()}
