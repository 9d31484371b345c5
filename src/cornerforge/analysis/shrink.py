"""The smallest form of a crash: fewest vehicles, shortest window, most natural actions (rules: ADR 0016)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.crash_types import CRASH_TYPES, STRIKERS, classify_crashes
from cornerforge.analysis.ddmin import ddmin
from cornerforge.errors import InputError
from cornerforge.sim import Script, ScriptDriver, scripted
from cornerforge.types import FRAME_S, Scenario

__all__ = ["AFTERMATH_S", "AV", "BVS", "CAUSES", "NOBODY", "STEERS_M_PER_S", "Reproducer", "Shrunk", "Size", "shrink"]

BVS, AV, NOBODY = CAUSES = ("bvs", "av", "nobody")
"""Cause of the crash. BVS: no crash happens when all BVs drive naturally instead. Else AV: no crash happens when the AV
drives naturally too. Else NOBODY."""

AFTERMATH_S = 5
"""A start is lost if natural driving from it ends in a crash of the AV within the window or so long after it [s]."""

STEERS_M_PER_S = 0.1
"""Up to this speed across the road an AV that steers keeps its lane [m/s]."""

_DECISION_FRAMES = round(1.0 / FRAME_S)


@dataclass(frozen=True)
class Size:
    """How large a case is.

    Attributes:
        vehicles: Number of vehicles, the AV among them.
        decisions: Number of seconds begun.
        seconds: From the start to the contact.
        deviating_actions: Actions of all BVs that were not the naturalistic model's likeliest in their state.
        log_prob_nde: ln P(the critical BV's actions) in the NDE; -inf where one is impossible.
    """

    vehicles: int
    decisions: int
    seconds: float
    deviating_actions: int
    log_prob_nde: float


@dataclass(frozen=True)
class Shrunk:
    """A case and its smallest form.

    Attributes:
        script: The smallest form, every action named.
        crash_type: Name of its type, equal to the case's.
        striker: The striker, as in the case.
        cause: One of CAUSES.
        before, after: Sizes of the case and of its smallest form.
        drives: Scripts driven to find it.
    """

    script: Script
    crash_type: str
    striker: str
    cause: str
    before: Size
    after: Size
    drives: int


class Reproducer:
    """Decides whether a script shows a given crash from a start at which the crash is not yet certain.

    The AV crashes with the same BV, with the same type and striker, no later than in the case, and no more BVs crash
    into each other. At the start no vehicle moves across the road, as at the start of every test, and the start is
    not lost: with natural drivers the AV would not crash. Without this the shortest window of every crash would be the
    instant before contact, which shows nothing of how the crash came about. On rails the others cannot drive otherwise,
    and may move across the road at the start: a recording begins anywhere. So there the cause is AV or NOBODY.

    Args:
        driver: Drives scripts.
        script: The whole case, ending in a crash of the AV.

    Attributes:
        ending: How the case ends.
        kind: Crash partner (slot), type code, striker index.
        cause: One of CAUSES; it says which drivers are replaced by natural ones to see whether a start is lost;
            with NOBODY no start counts as lost.

    Raises:
        InputError: The script does not end in a crash of the AV.
    """

    def __init__(self, driver: ScriptDriver, script: Script) -> None:
        self._driver = driver
        self._most = driver.max_decisions
        self.ending = driver.drive(script)
        kind = self._kind(script, self.ending)
        if kind is None:
            raise InputError("This does not end in a crash of the AV; only such cases can be made smaller.")
        self.kind = kind
        for self.cause in CAUSES if script.poses is None else (AV, NOBODY):
            if not self.is_lost(script):
                break

    def _kind(self, script: Script, ending: scripted.Ending) -> tuple[int, int, int] | None:
        if ending.pose is None:
            return None
        # Rounded as the library stores it, so that an analysis of the library sees the same type.
        pose = ending.pose.astype(np.float32)[None]
        pair = script.start[[0, int(np.flatnonzero(script.slot == ending.partner)[0])]][None]
        found = classify_crashes(pose, pair["length"], pair["width"])
        return ending.partner, int(found.code[0]), int(found.striker[0])

    def crashes_alike(self, script: Script) -> bool:
        """Say whether it ends in the same crash, no later, with no more crashes between BVs than the case has."""
        ending = self._driver.drive(script)
        is_no_more = ending.frame <= self.ending.frame and ending.bv_crashes <= self.ending.bv_crashes
        return is_no_more and self._kind(script, ending) == self.kind

    def is_lost(self, script: Script) -> bool:
        """Say whether the AV would crash, with any vehicle, if natural drivers drove from this start on.

        True also where an AV from outside fails by then: nothing is known.
        """
        if self.cause == NOBODY:
            return False
        decisions = min(len(script.action) + AFTERMATH_S, self._most)
        if script.poses is not None:
            decisions = min(decisions, (len(script.poses) - 1) // _DECISION_FRAMES)
        natural = np.full((decisions, script.slot.size), scripted.NATURAL, dtype=np.int8)
        ending = self._driver.drive(replace(script, action=natural), av_is_natural=self.cause == AV)
        return ending.failed or ending.pose is not None

    def shows(self, script: Script) -> bool:
        """Say whether a script fulfils all of these conditions."""
        # A vehicle that stopped in the middle of a lane change is settled too; it may stand there for a long time.
        across = np.abs(script.start["lateral_speed"])
        if self._driver.av_steers:  # it is never exactly parallel to the road
            across[0] = max(across[0] - STEERS_M_PER_S, 0.0)
        is_settled = script.poses is not None or not across.any()
        return is_settled and self.crashes_alike(script) and not self.is_lost(script)


def shrink(driver: ScriptDriver, script: Script) -> Shrunk:
    """Make a crash of the AV as small as it gets.

    In turn, until nothing changes: leave out vehicles; start later; replace actions of BVs by the naturalistic
    model's likeliest; replace actions that still deviate by likelier ones. After every step `Reproducer` still accepts
    the script. At the end both the vehicles and the deviating actions are 1-minimal, and no later start is accepted.
    Where the others are on rails only vehicles and the start can change.

    Args:
        driver: Drives scripts; what it recorded last is then the smallest form.
        script: The case; it ends in a crash of the AV.

    Raises:
        InputError: The script does not end in a crash of the AV.
    """
    first = driver.drives
    whole, chances = driver.record(script)
    case = Reproducer(driver, script)
    search = _Search(driver, case)
    small = _cut(script, case.ending.frame)
    while True:
        before = small
        if small.poses is not None:
            small = search.latest_start(search.fewest_vehicles(small))
            small = _cut(small, driver.drive(small).frame)
            if _equal(before, small):
                break
            continue
        # The remaining vehicles go on as recorded, or naturally without the others: one may work where the other fails.
        small = search.fewest_vehicles(search.named(small))
        small = search.fewest_vehicles(search.naturally(small))
        small = search.naturally(search.latest_start(small))
        small = search.softened(search.fewest_actions(small))
        small = _cut(small, driver.drive(small).frame)
        if _equal(before, small):
            break
    scenario, small_chances = driver.record(small)
    decides = small.poses is None
    _, code, striker = case.kind
    return Shrunk(
        script=replace(small, action=scenario.action),
        crash_type=CRASH_TYPES[code],
        striker=STRIKERS[striker],
        cause=case.cause,
        before=_size(whole, chances if decides else None),
        after=_size(scenario, small_chances if decides else None),
        drives=driver.drives - first,
    )


class _Search:
    """The single steps: each turns a script that `case` accepts into another that it accepts."""

    def __init__(self, driver: ScriptDriver, case: Reproducer) -> None:
        self._driver = driver
        self._case = case

    def fewest_vehicles(self, script: Script) -> Script:
        """Leave out BVs other than the crash partner."""
        needed = (script.slot == 0) | (script.slot == self._case.kind[0])

        def only(kept: list[int]) -> Script:
            columns = needed.copy()
            columns[kept] = True
            return script.of(columns)

        return only(ddmin(np.flatnonzero(~needed).tolist(), lambda kept: self._case.shows(only(kept))))

    def latest_start(self, script: Script) -> Script:
        """Start as late as possible; from the given start if the cause is NOBODY, because then no start says more."""
        if self._case.cause == NOBODY:
            return script
        for decisions in range(len(script.action) - 1, 0, -1):
            later = self._driver.later(script, decisions)
            if later is not None and self._case.shows(later):
                return later
        return script

    def named(self, script: Script) -> Script:
        """Name all actions; what happens stays the same."""
        return replace(script, action=self._driver.record(script)[0].action)

    def naturally(self, script: Script) -> Script:
        """Name only those actions that deviate; what happens stays the same."""
        deviating = self._deviating(script)
        return replace(script, action=np.where(deviating, script.action, scripted.NATURAL).astype(np.int8))

    def fewest_actions(self, script: Script) -> Script:
        """Replace deviating actions of BVs by the likeliest."""
        named = [tuple(place) for place in np.argwhere(script.action != scripted.NATURAL).tolist()]

        def only(kept: list[tuple[int, ...]]) -> Script:
            action = np.full_like(script.action, scripted.NATURAL)
            for place in kept:
                action[place] = script.action[place]
            return replace(script, action=action)

        return only(ddmin(named, lambda kept: self._case.shows(only(kept))))

    def softened(self, script: Script) -> Script:
        """Replace each deviating action by the likeliest that `case` accepts, the earliest first."""
        for k, i in np.argwhere(script.action != scripted.NATURAL).tolist():
            _, chances = self._driver.record(script)
            p = chances[k, i]
            for action in np.argsort(-p, kind="stable").tolist():
                if p[action] <= p[script.action[k, i]]:
                    break
                changed = script.action.copy()
                changed[k, i] = action
                other = replace(script, action=changed)
                if self._case.shows(other):
                    script = other
                    break
        return script

    def _deviating(self, script: Script) -> NDArray[np.bool_]:
        """Mark actions of the script that are named and not the likeliest in their state, bool (K, N)."""
        scenario, chances = self._driver.record(script)
        deviating = np.zeros(script.action.shape, dtype=np.bool_)
        deviating[: len(scenario.action)] = _deviations(scenario, chances)
        return np.asarray(deviating & (script.action != scripted.NATURAL), np.bool_)


def _deviations(scenario: Scenario, chances: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark decisions of BVs that were not the likeliest, bool (K, N)."""
    decided = scenario.action >= 0
    decided[:, 0] = False
    likeliest = np.where(np.isnan(chances), -1.0, chances).argmax(axis=2)[: len(decided)]
    return np.asarray(decided & (scenario.action != likeliest), np.bool_)


def _size(scenario: Scenario, chances: NDArray[np.float64] | None) -> Size:
    """Say how large a case is; without chances, on rails, no vehicle decides."""
    assert scenario.crash is not None  # `Reproducer` has looked
    return Size(
        vehicles=scenario.slot.size,
        decisions=len(scenario.action),
        seconds=scenario.crash.time,
        deviating_actions=0 if chances is None else int(_deviations(scenario, chances).sum()),
        log_prob_nde=float(scenario.log_prob_nde.sum()),
    )


def _cut(script: Script, frame: int) -> Script:
    """Remove the decisions after the contact."""
    return replace(script, action=script.action[: math.ceil(frame / _DECISION_FRAMES)])


def _equal(a: Script, b: Script) -> bool:
    return (
        np.array_equal(a.slot, b.slot) and np.array_equal(a.action, b.action) and a.start.tobytes() == b.start.tobytes()
    )
