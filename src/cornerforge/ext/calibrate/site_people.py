"""People at crossings: how fast they walk, which gaps they take, and who goes first where a vehicle turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.site_data import interval_of, kept_apart, owners, quantiles, words
from cornerforge.ext.calibrate.tables import Table
from cornerforge.site.laws import WALK_SHARES

__all__ = [
    "STATES", "Critical", "EncounterFit", "Found", "Gaps", "Walks", "critical_gap", "encounter_chances",
    "encounters_of", "fit_encounters", "gaps_of", "step_back_of", "walks_of",
]  # fmt: skip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FEET = 0.3048
STATES = ("Walk", "FDW", "SDW")
"""States of the pedestrian signal as the person comes to the conflict point: walk, flashing and solid don't walk."""
_LONGEST = 10
"""Encroachment times are fitted up to so many seconds; beyond them hardly any pair was noted."""
_FINE = 20
"""Cells of a second in which the model is summed."""
_YIELDS = ("Stopped and waited for the vehicle", "Slowed down to avoid collision")
_SOLID = "Solid Don't Walk"
_TRAFFIC = ((0, 0), (1, 1), (2, 3), (4, 99))
_EARLY = 2.5
"""Who leaves less than this before walk only starts early [s]: a third of those that leave on don't walk do."""
_LONG = 30.0
"""Waits for a gap count up to so long [s]: beyond it a few people would count most."""
_RATES = (1e-3, 1.0)
"""Least and most impatience that is looked for [1/s]."""


@dataclass(frozen=True)
class Found:
    """A number with its 95 % interval over groups, and how many rows and groups it is of."""

    value: float
    low: float
    high: float
    n: int
    groups: int


def _found(value: float, interval: Floats, n: int, groups: int) -> Found:
    return Found(float(value), float(interval[0]), float(interval[1]), n, groups)


def share(hit: NDArray[np.bool_], owner: Ints) -> Found:
    """Share of rows that are hit, with its interval over owners, (n,) each; n at least 1."""
    groups = int(owner.max()) + 1
    hits, rows = np.bincount(owner, hit, groups), np.bincount(owner, minlength=groups)
    with np.errstate(invalid="ignore"):  # a resample may hold none of the rows
        interval = interval_of(lambda w: (w @ hits) / (w @ rows), groups)
    return _found(hit.mean(), interval, hit.size, groups)


@dataclass(frozen=True)
class Walks:
    """Facts of people at signals.

    Attributes:
        speeds: At `WALK_SHARES` [m/s]; the ends are the 1 and 99 % quantiles.
        changes: Chance in a second that somebody changes the speed.
        leave: Share that leaves on solid don't walk, of those that came on it: of all, and with 0, 1, 2-3, 4 or more
            vehicles in the next 10 s.
        takes: Share that leaves more than 2.5 s before walk, with no vehicle in the next 10 s.
        patience: Mean time [s] after which it gives up to wait for a gap.
        early: Share that leaves up to 2.5 s before walk, of those that then still wait.
        apart: The speeds at signals kept apart, and those at the others, at 5, 15, 50, 85 and 95 %; how many the first
            are of.
    """

    speeds: tuple[Found, ...]
    changes: Found
    leave: tuple[Found, ...]
    takes: Found
    patience: Found
    early: Found
    apart: tuple[tuple[float, ...], tuple[float, ...], int]


def walks_of(table: Table) -> Walks | None:
    """Measure walking and disobedience in Utah's crossings; bicycles are left out. None with too few rows."""
    n = table.numbers
    signal = owners(words(table, "signal"))
    groups = int(signal.max()) + 1
    timed = (n["cross_sec"] > 0) & (n["crossdist"] > 0) & (words(table, "otherbicycle") == "False")
    owner, seconds = signal[timed], n["cross_sec"][timed]
    speed = n["crossdist"][timed] * _FEET / seconds
    came = (words(table, "timewaitarr_ped_status") == _SOLID) & (words(table, "timecurbdep_ped_status") != "")
    left = words(table, "timecurbdep_ped_status") == _SOLID
    vehicles = n["vehiclesnext10"]
    masks = [came, *(came & (vehicles >= a) & (vehicles <= b) for a, b in _TRAFFIC)]
    in_gap = left & (n["timecurbdep_sec_next_walk"] > _EARLY)
    waits = came & ~in_gap & (n["timewaitclean"] > _EARLY)
    apart = kept_apart(owner)
    busy = came & (vehicles > 0)
    few = not (in_gap & busy & ~np.isnan(n["timewaitclean"])).any() or not waits.any()
    if few or not (apart.any() and (~apart).any() and all(m.any() for m in masks)):
        return None
    shares = [0.01, *WALK_SHARES[1:-1], 0.99]
    at = quantiles(speed, np.ones(speed.size), shares)
    low, high = interval_of(lambda w: quantiles(speed, w[owner], shares), groups)
    speeds = tuple(_found(v, np.array(ends), speed.size, groups) for v, *ends in zip(at, low, high, strict=True))
    changed = words(table, "crossbehspeed")[timed] == "True"
    hits, time = np.bincount(owner, changed, groups), np.bincount(owner, seconds, groups)
    changes = _found(
        hits.sum() / time.sum(), interval_of(lambda w: (w @ hits) / (w @ time), groups), int(changed.sum()), groups
    )
    here, there = (
        tuple(map(float, quantiles(speed[part], np.ones(int(part.sum())), shares[1:-1]))) for part in (apart, ~apart)
    )
    leaves, takes = tuple(share(left[m], signal[m]) for m in masks), share(in_gap[masks[1]], signal[masks[1]])
    patience = _patience(n["timewaitclean"], in_gap, masks[1], busy, signal)
    early = share(left[waits], signal[waits])
    return Walks(speeds, changes, leaves, takes, patience, early, (here, there, int(apart.sum())))


def _patience(
    waited: Floats, in_gap: NDArray[np.bool_], free: NDArray[np.bool_], busy: NDArray[np.bool_], signal: Ints
) -> Found:
    """Find the mean patience [s] of people with vehicles about, of whom as many would leave as where there are none.

    One who left after t seconds stands for exp(t / patience) people, of whom the others had given up by then.

    Args:
        waited: How long each person waited [s], NaN if not known.
        in_gap: It left on don't walk, and not just before walk.
        free, busy: It came on don't walk, with no vehicle in the next 10 s, with some.
        signal: Where it was.
    """
    from scipy.optimize import brentq

    groups = int(signal.max()) + 1
    known = in_gap & busy & ~np.isnan(waited)
    time, of = np.minimum(waited[known], _LONG), signal[known]
    would, alone, others, left = (
        np.bincount(signal[mask], minlength=groups) for mask in (in_gap & free, free, busy, in_gap & busy)
    )

    def found(weight: Floats) -> float:
        if not (weight @ alone and weight @ left and weight[of].sum()):
            return np.nan
        wanted = (weight @ would) / (weight @ alone) * (weight @ others) / (weight @ left)

        def missing(rate: float) -> float:
            stand_for = float(weight[of] @ np.exp(rate * time)) / float(weight[of].sum())
            return stand_for - float(wanted)

        least, most = _RATES
        rate = least if missing(least) > 0.0 else most if missing(most) < 0.0 else brentq(missing, least, most)
        return float(1.0 / rate)

    return _found(found(np.ones(groups)), interval_of(found, groups), int(known.sum()), groups)


@dataclass(frozen=True)
class Gaps:
    """Largest gap that was let pass and gap that was taken [s], with the person's number: shape (n,) each."""

    missed: Floats
    taken: Floats
    person: Ints

    def of(self, rows: NDArray[np.bool_]) -> Gaps:
        """Keep some rows."""
        return Gaps(self.missed[rows], self.taken[rows], self.person[rows])


@dataclass(frozen=True)
class Critical:
    """Median critical gap [s], standard deviation of its log, and how many took a smaller gap than they let pass."""

    median: Found
    spread: Found
    inconsistent: int


def gaps_of(table: Table, country: str) -> Gaps:
    """Gaps at crossings without zebra in one country (DE, JP), near lane; 0 missed where the first gap was taken."""
    kept = words(table, "country") == country
    kept &= np.isin(words(table, "trialtype"), ("baseline", "hansi")) & (words(table, "environment") == "Crossing")
    kept &= (words(table, "dropout") == "False") & (words(table, "timeout") == "False")
    missed, taken = (table.numbers[f"s_cargap_near_{name}"] for name in ("largestmissed", "taken"))
    kept &= (taken > 0.0) & (taken < 25.0) & (missed >= 0.0)
    return Gaps(missed[kept], taken[kept], owners(words(table, "vpn")[kept]))


def critical_gap(gaps: Gaps) -> Critical:
    """Fit a log-normal critical gap by maximum likelihood: it lies between the largest missed and the taken gap.

    Gaps taken that are not larger than one that was let pass are left out and counted.

    Source: Troutbeck (1992), as recommended by Brilon, Koenig and Troutbeck (1999); recalled.
    """
    from scipy.optimize import minimize
    from scipy.special import ndtr

    fine = gaps.missed < gaps.taken
    person = owners(gaps.person[fine])
    low, high = np.log(np.maximum(gaps.missed[fine], 1e-3)), np.log(gaps.taken[fine])

    def fitted(weight: Floats, begin: Floats) -> Floats:
        of_row = weight[person]

        def loss(x: Floats) -> float:
            spread = np.exp(x[1])
            chance = ndtr((high - x[0]) / spread) - ndtr((low - x[0]) / spread)
            return -float(of_row @ np.log(np.maximum(chance, 1e-12)))

        return np.asarray(minimize(loss, begin, method="L-BFGS-B", bounds=[(-1.0, 3.0), (-3.5, 0.5)]).x)

    groups = int(person.max()) + 1
    x = fitted(np.ones(groups), np.array([1.5, -1.3]))
    ends = np.exp(interval_of(lambda w: fitted(w, x), groups))
    found = [_found(np.exp(x[k]), ends[:, k], int(fine.sum()), groups) for k in (0, 1)]
    return Critical(found[0], found[1], int((~fine).sum()))


def step_back_of(table: Table) -> Found | None:
    """Chance in a second that a person on the road steps back from a vehicle that comes on.

    Of trials that ended in a step back or a collision, the share with a step back is 1 - (1 - p)^T; T is their median
    time on the near lane. None without a step back.
    """
    back, hit = table.numbers["stepbacks"] > 0, words(table, "collision") == "True"
    tried = (back | hit) & ~np.isin(words(table, "trialtype"), ("familiarization", "training"))
    time = table.numbers["n_time"][tried]
    if not back[tried].any() or not (time > 0).any():
        return None
    seconds = float(np.median(time[time > 0]))
    found = share(back[tried], owners(words(table, "country")[tried], words(table, "vpn")[tried]))
    value, low, high = (1.0 - (1.0 - s) ** (1.0 / seconds) for s in (found.value, found.low, found.high))
    return Found(value, low, high, found.n, found.groups)


@dataclass(frozen=True)
class EncounterFit:
    """Laws of who goes first, fitted to right-turning vehicles against people.

    Attributes:
        values: Name -> number: to_people and gives_way in seconds, their spreads, and both by state of the signal.
        expected: By state, chances of the 3 x 10 outcomes of `encounter_chances`.
        counted: By state, how often each was seen.
        vehicle_first, within_3: Shares seen: of all, then by state.
        apart: Mean log-likelihood of an encounter at signals kept apart: by the law, and by the shares of the other
            signals; and how many encounters and signals.
        left_out: Encounters without a signal for people, or beyond 10 s, or at the same time.
    """

    values: dict[str, Found]
    expected: Floats
    counted: Floats
    vehicle_first: tuple[Found, ...]
    within_3: tuple[Found, ...]
    apart: tuple[float, float, int, int]
    left_out: int


def encounters_of(table: Table) -> tuple[Floats, Ints, Ints, Ints]:
    """Count encounters by signal, state, outcome and time: (signals, 3, 3, 10); and rows' state, time and signal.

    Outcomes: the vehicle goes first and the person waited or slowed down for it; it goes first otherwise; the person
    goes first. Rows have state -1 where people have no signal.
    """
    time = np.rint(table.numbers["encroachment_time"]).astype(np.int64)
    state = np.array([STATES.index(s) if s in STATES else -1 for s in words(table, "pedcp_ped")])
    signal = owners(words(table, "signal.id"))
    outcome = np.where(time > 0, 2, np.where(np.isin(words(table, "ped.reaction"), _YIELDS), 0, 1))
    fits = (state >= 0) & (np.abs(time) >= 1) & (np.abs(time) <= _LONGEST)
    counts = np.zeros((int(signal.max()) + 1, 3, 3, _LONGEST))
    np.add.at(counts, (signal[fits], state[fits], outcome[fits], np.abs(time[fits]) - 1), 1.0)
    return counts, state, time, signal


def encounter_chances(driver: Floats, person: Floats, after_driver: Floats, after_person: Floats) -> Floats:
    """Chances of outcomes (as in `encounters_of`) and of encroachment times 1 to 10 s, shape (3, 10), sum 1.

    Undisturbed, the vehicle would come to the conflict point before or after the person, by any time alike. If it would
    be first by less than the driver's critical gap, the driver lets the person go; if it would be second by less than
    the person's, the person lets the vehicle go. Else all goes on undisturbed, and the encroachment time is that
    difference. After one yields it is log-normal.

    Args:
        driver, person: Log of the median critical gap, and its standard deviation, shape (2,).
        after_driver, after_person: The same of the encroachment time after the one yielded.
    """
    from scipy.special import ndtr

    edge = np.linspace(0.0, _LONGEST + 0.5, round((_LONGEST + 0.5) * _FINE) + 1)
    middle = np.log(0.5 * (edge[1:] + edge[:-1]))
    second = np.rint(np.exp(middle)).astype(np.int64)

    def accepts(law: Floats) -> Floats:
        return np.asarray(ndtr((middle - law[0]) / law[1]))

    def times(law: Floats) -> Floats:
        below = ndtr((np.log(np.maximum(edge, 1e-9)) - law[0]) / law[1])
        return np.asarray(np.diff(below) / max(float(below[-1]), 1e-9))

    goes, walks = accepts(driver), accepts(person)
    fine = [
        (1.0 - walks).sum() * times(after_person),
        goes,
        walks + (1.0 - goes).sum() * times(after_driver),
    ]
    found = np.array([np.bincount(second, row, _LONGEST + 1)[1 : _LONGEST + 1] for row in fine])
    return np.asarray(found / found.sum())


_BEGIN = np.array([1.1, 1.1, -0.7, 0.6, 0.6, 0.6, -0.7, 1.6, -1.2, 1.4, -0.7])
_ENDS = (
    [(-1.5, 2.3)] * 2
    + [(-2.0, 0.3)]
    + [(-2.3, 2.0)] * 3
    + [(-2.0, 0.3), (0.0, 2.3), (-2.0, 0.3), (0.0, 2.3), (-2.0, 0.3)]
)


def _by_state(x: Floats) -> Floats:
    """Chances by state, (3, 3, 10), of the fit's 11 numbers; a driver's gap is the same on walk and flashing."""
    after_driver, after_person = np.array([x[7], np.exp(x[8])]), np.array([x[9], np.exp(x[10])])
    spread, own = np.exp(x[2]), np.exp(x[6])
    gaps = ((x[0], x[3]), (x[0], x[4]), (x[1], x[5]))
    return np.array(
        [encounter_chances(np.array([d, spread]), np.array([p, own]), after_driver, after_person) for d, p in gaps]
    )


def _fitted(counts: Floats, begin: Floats) -> Floats:
    from scipy.optimize import minimize

    def loss(x: Floats) -> float:
        return -float((counts * np.log(_by_state(x) + 1e-9)).sum())

    return np.asarray(minimize(loss, begin, method="L-BFGS-B", bounds=_ENDS).x)


def _named(x: Floats) -> dict[str, float]:
    places = {
        "to_people": 0, "to_people on solid": 1, "to_people_spread": 2, "gives_way": 3, "gives_way on flashing": 4,
        "gives_way on solid": 5, "gives_way_spread": 6, "after_people": 7,
        "time after a person yields": 9,
    }  # fmt: skip
    return {name: float(np.exp(x[k])) for name, k in places.items()}


def fit_encounters(table: Table) -> EncounterFit | None:
    """Fit to_people and gives_way by maximum likelihood, with intervals over signals.

    None if a state has fewer than 30 encounters, there are fewer than 4 signals, or no person lets a vehicle go.
    """
    counts, state, time, signal = encounters_of(table)
    groups, total = len(counts), counts.sum(axis=0)
    if total.sum(axis=(1, 2)).min() < 30 or not total[:, 0].any() or groups < 4:
        return None
    x = min((_fitted(total, _BEGIN + shift) for shift in (0.0, 0.3, -0.3)), key=lambda y: -_score(total, y))
    ends = interval_of(lambda w: np.array([*_named(_fitted(np.tensordot(w, counts, 1), x)).values()]), groups)
    values = {name: _found(v, ends[:, k], round(total.sum()), groups) for k, (name, v) in enumerate(_named(x).items())}
    yielded = counts[:, :, 0].sum(axis=1)
    behind = interval_of(lambda w: np.array([_middle(w @ yielded)]), groups)[:, 0]
    values["after_vehicles"] = _found(_middle(yielded.sum(axis=0)), behind, round(yielded.sum()), groups)
    apart = kept_apart(np.arange(groups))
    seen, unseen = counts[~apart].sum(axis=0), counts[apart].sum(axis=0)
    plain = (seen + 1.0) / (seen + 1.0).sum(axis=(1, 2), keepdims=True)
    n = max(1.0, unseen.sum())
    parts = [np.ones(time.size, bool), *(state == k for k in range(3))]
    return EncounterFit(
        values, _by_state(x), total,
        tuple(share(time[part] < 0, signal[part]) for part in parts),
        tuple(share(np.abs(time[part]) <= 3, signal[part]) for part in parts),
        (_score(unseen, _fitted(seen, x)) / n, float((unseen * np.log(plain)).sum()) / n, round(n), int(apart.sum())),
        time.size - round(total.sum()),
    )  # fmt: skip


def _middle(counts: Floats) -> float:
    """Median of times that are noted as whole seconds from 1 on, of how often each was: (10,); NaN if none was."""
    if not counts.any():
        return float("nan")
    below = np.concatenate([[0.0], np.cumsum(counts)])
    return float(np.interp(0.5 * below[-1], below, np.arange(below.size) + 0.5))


def _score(counts: Floats, x: Floats) -> float:
    """Log-likelihood of counts (3, 3, 10)."""
    return float((counts * np.log(_by_state(x) + 1e-9)).sum())
