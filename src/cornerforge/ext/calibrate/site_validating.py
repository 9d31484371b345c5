"""`site validate`: what drivers and people do in tests at a site, beside the data and publications."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._options import verb
from cornerforge.experiment.counting import drive_tests
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.experiment.sites import laws_named
from cornerforge.ext.calibrate.options import SiteValidate
from cornerforge.ext.calibrate.site_data import owners, read_site_data, words
from cornerforge.ext.calibrate.site_measures import Measured, measures
from cornerforge.ext.calibrate.site_people import STATES, Gaps, Walks, critical_gap, share, walks_of
from cornerforge.ext.calibrate.tables import Table
from cornerforge.intervals import binomial_interval, poisson_interval
from cornerforge.results.site_laws import SiteBar, SiteValidated
from cornerforge.results.stating import as_json
from cornerforge.sim import Tally, outcome
from cornerforge.site.laws import ERRORS, Laws
from cornerforge.work.files import write_json
from cornerforge.work.progress import NO_PROGRESS
from cornerforge.world_options import WorldOptions

__all__ = [
    "ERRORS_OFF", "bars_of", "crashed", "priorities", "right_of_way_taken", "site_did_not_pass", "site_validate",
    "site_validation_text",
]  # fmt: skip

ERRORS_OFF: Mapping[str, Any] = {**dict.fromkeys(ERRORS, 0.0), "gap_error": 0.01}
"""Laws with which nobody errs."""
_AV = "idm-yield"
_TURNS = "vehicles=250,people=0,left=1"
_CRITICAL, _FOLLOW_UP = 4.87, 2.73
"""Means of permissive left turns [s]: Claros et al. (2021), 2,500 drivers at 45 approaches, abstract read."""
_WITHIN, _WALKING, _HEADWAY = 1.3, 0.10, 0.05
_FEWEST = 20
_TAKEN, _MORE = 20_000, 10
"""Tests with right of way taken, at most, and how many times as many crashes they should have."""
_VEHICLES = ((0, 0), (1, 1), (2, 3), (4, 99))


def _measured(run: Experiment, count: int, seed: int) -> Measured:
    recorder = run.recorder()
    zones = run.setting.road.site[0]["zone"]
    return measures((recorder.record(seed, test) for test in range(count)), zones)


@verb(SiteValidate)
def site_validate(options: SiteValidate) -> SiteValidated:
    """Compare what drivers and people do at a site with data and publications.

    Returns:
        What `cornerforge site validate --json` prints. `passed` means that no bar is missed that could be judged.

    Raises:
        CornerForgeError: Input or files are not right.
    """
    tables = read_site_data(Path(options.data))
    laws = laws_named(options.site_laws)
    with tempfile.TemporaryDirectory() as folder:

        def at(traffic: str | None, changed: Laws) -> Experiment:
            file = Path(folder) / "laws.json"
            write_json(file, as_json(changed))
            return experiment(WorldOptions(site=options.site, av=_AV, site_traffic=traffic, site_laws=str(file)))

        natural = at(None, laws)
        options.progress("validate: traffic", 0, 4)
        people = _measured(natural, options.recordings, options.seed)
        options.progress("validate: left turns", 1, 4)
        turning = _measured(at(_TURNS, laws), options.recordings, options.seed)
        options.progress("validate: right of way", 2, 4)
        few = min(options.tests, _TAKEN)
        runs, how = (natural, right_of_way_taken(natural)), (options.seed, options.threads)
        true, taken = (crashed(run, few, *how) for run in runs)
        options.progress("validate: without errors", 3, 4)
        crashes = crashed(at(None, replace(laws, **ERRORS_OFF)), options.tests, *how)
    bars = [
        *bars_of(people, tables),
        *_of_turns(turning),
        priorities(true, taken, few),
        _bar(
            "tests that crash, without errors", "", (crashes, *poisson_interval(crashes)), options.tests, None,
            "none in 1e6 tests", bool(crashes == 0),
        ),
    ]  # fmt: skip
    return SiteValidated(
        site=options.site, bars=tuple(bars), passed=all(bar.holds is not False for bar in bars),
        notes=(
            "The AV is no one of those that are measured; it drives among them.",
            "Following is measured by site fit (docs/sites.md): gap after 5 s against a fairly fitted IDM.",
            f"Left turns are measured in heavier traffic ({_TURNS}), so that there is one to wait for.",
        ),
    )  # fmt: skip


def crashed(run: Experiment, tests: int, seed: int, threads: int | None = None) -> int:
    """Count the tests in which the AV crashed, or others did."""
    run.warm_up()
    driven = drive_tests(
        run, Tally(), "validate", seed=seed, first=0, tests=tests, threads=threads, progress=NO_PROGRESS
    )
    return sum(int(((out.code == outcome.AV_CRASH) | (out.bv_crashes > 0)).sum()) for _, out in driven)


def right_of_way_taken(run: Experiment) -> Experiment:
    """Let those that must yield to vehicles, the AV too, think that they go first; the others know what is true.

    Two drivers think so then. Were the table turned for all, they would agree, as where people drive on the left.
    """
    site = run.setting.road.site.copy()
    zones = site[0]["zone"][:, : site[0]["vehicle_routes"]]
    must = (zones["yields"] != 0) & (zones["goes_first"] == 0)
    zones["yields"][must], zones["goes_first"][must] = 0, 1
    return replace(run, setting=run.setting._replace(road=run.setting.road._replace(site=site)))


def priorities(true: int, taken: int, tests: int) -> SiteBar:
    """Hold tests that crash with right of way taken against those with the true one, of as many: a negative control."""
    low, high = poisson_interval(taken)
    least, most = (_MORE * end for end in poisson_interval(true))
    holds = True if low >= most else False if high < least else None
    bar = f"at least {_MORE} times the {true} with true priorities"
    return _bar("tests that crash, right of way taken", "", (taken, low, high), tests, None, bar, holds)


def _bar(
    name: str, unit: str, found: Sequence[float], n: int, data: Sequence[float] | None, bar: str, holds: bool | None
) -> SiteBar:
    value, *ends = map(float, found)
    return SiteBar(
        measure=name, unit=unit, simulated=round(value, 4), interval95=(round(ends[0], 4), round(ends[1], 4)), n=n,
        data=None if data is None else round(float(data[0]), 4),
        data_interval95=None if data is None or len(data) < 3 else (round(float(data[1]), 4), round(float(data[2]), 4)),
        bar=bar, holds=holds,
    )  # fmt: skip


def _share(hit: NDArray[np.bool_]) -> tuple[float, float, float]:
    return (float(hit.mean()), *binomial_interval(int(hit.sum()), hit.size)) if hit.size else (0.0, 0.0, 1.0)


def bars_of(seen: Measured, tables: Mapping[str, Table]) -> list[SiteBar]:
    """Compare what people and those that meet them did with the data that there are.

    A bar that fewer than 20 rows could judge holds neither way (None).
    """
    facts = walks_of(tables["utah_ped_crossings"]) if "utah_ped_crossings" in tables else None
    return [*_of_meetings(seen, tables), *([] if facts is None else [*_of_kerbs(seen, facts), *_of_walks(seen, facts)])]


def _of_meetings(seen: Measured, tables: Mapping[str, Table]) -> list[SiteBar]:
    table = tables.get("utah_right_turn_conflicts")
    if table is None:
        return []
    time, state, signal = (
        table.numbers["encroachment_time"],
        words(table, "pedcp_ped"),
        owners(words(table, "signal.id")),
    )
    seconds = np.array([meeting.seconds for meeting in seen.meetings])
    light = np.array([meeting.light for meeting in seen.meetings])
    bars = []
    for name, code in zip(STATES, (2, 1, 0), strict=True):
        data = share(time[state == name] < 0, signal[state == name])
        ours = seconds[light == code] < 0
        bars.append(
            _bar(
                f"vehicle first, {name}", "", _share(ours), ours.size, (data.value, data.low, data.high),
                "inside the interval of the data",
                None if ours.size < _FEWEST else bool(data.low <= ours.mean() <= data.high),
            )
        )  # fmt: skip
    for most in (3, 5):
        near = np.abs(time) <= 10
        data = share(np.abs(time[near]) <= most, signal[near])
        ours = np.abs(np.rint(seconds[light >= 0])) <= most  # the data are of signals
        ratio = ours.mean() / data.value if ours.size else np.nan
        bars.append(
            _bar(
                f"encroachment time at most {most} s, of 10 s", "", _share(ours), ours.size,
                (data.value, data.low, data.high), f"within a factor {_WITHIN}",
                None if ours.size < _FEWEST else bool(1.0 / _WITHIN <= ratio <= _WITHIN),
            )
        )  # fmt: skip
    return bars


def _of_kerbs(seen: Measured, facts: Walks) -> list[SiteBar]:
    left = np.array([kerb.left for kerb in seen.kerbs], dtype=np.bool_)
    vehicles = np.array([kerb.vehicles for kerb in seen.kerbs], dtype=np.int64)
    bars = []
    for data, (low, high) in zip(facts.leave, ((0, 99), *_VEHICLES), strict=True):
        ours = left[(vehicles >= low) & (vehicles <= high)]
        name = "" if high - low == 99 else f", {low if low == high else f'{low} to {high}'} vehicles in 10 s"
        bars.append(
            _bar(
                f"leaves on don't walk{name.replace(' to 99', ' and more')}", "", _share(ours), ours.size,
                (data.value, data.low, data.high), "inside the interval of the data",
                None if ours.size < _FEWEST else bool(data.low <= ours.mean() <= data.high),
            )
        )  # fmt: skip
    return bars


def _of_walks(seen: Measured, facts: Walks) -> list[SiteBar]:
    walks = np.sort(seen.walks)
    bars = []
    for q, data in zip((0.05, 0.15, 0.5, 0.85, 0.95), facts.speeds[1:-1], strict=True):
        n = walks.size
        found = (np.nan,) * 3 if n == 0 else np.quantile(
            walks, np.clip([q, *(q + side * 1.96 * np.sqrt(q * (1.0 - q) / n) for side in (-1, 1))], 0.0, 1.0)
        )  # fmt: skip
        bars.append(
            _bar(
                f"walking speed, {100 * q:.0f} % quantile", "m/s", found, n, (data.value, data.low, data.high),
                "within 10 %",
                None if n < _FEWEST else bool(abs(found[0] / data.value - 1.0) <= _WALKING),
            )
        )  # fmt: skip
    return bars


def _of_turns(seen: Measured) -> list[SiteBar]:
    bars = []
    if len(seen.turns) >= _FEWEST:
        pairs = np.array([(turn.missed, turn.taken) for turn in seen.turns])
        found = critical_gap(Gaps(pairs[:, 0], pairs[:, 1], np.arange(len(pairs))))
        mean = np.exp(0.5 * found.spread.value**2)
        ours = (found.median.value * mean, found.median.low * mean, found.median.high * mean)
        bars.append(
            _bar(
                "critical headway of left turns, mean", "s", ours, len(pairs), (_CRITICAL,), "within 5 %",
                bool(abs(ours[0] / _CRITICAL - 1.0) <= _HEADWAY),
            )
        )  # fmt: skip
    if len(seen.follow_up) >= _FEWEST:
        times = np.array(seen.follow_up)
        error = 1.96 * times.std(ddof=1) / np.sqrt(times.size)
        bars.append(
            _bar(
                "follow-up headway of left turns, mean", "s",
                (times.mean(), times.mean() - error, times.mean() + error), times.size, (_FOLLOW_UP,), "about this",
                None,
            )
        )  # fmt: skip
    return bars


def site_validation_text(result: SiteValidated) -> str:
    """Tell the result of `site_validate` in text: each measure, the data, and whether its bar holds."""
    lines = [f"Site {result.site}: measured in the simulation, with 95 % intervals, beside the data"]
    for bar in result.bars:
        data = "" if bar.data is None else f"; data {bar.data:g}"
        data += "" if bar.data_interval95 is None else f" ({bar.data_interval95[0]:g} to {bar.data_interval95[1]:g})"
        verdict = {True: "holds", False: "MISSED", None: "not judged"}[bar.holds]
        lines.append(
            f"{bar.measure:<45} {bar.simulated:g} ({bar.interval95[0]:g} to {bar.interval95[1]:g}) {bar.unit}, "
            f"n {bar.n:,}{data}; {bar.bar}: {verdict}"
        )
    return "\n".join(
        [*lines, *(f"Note: {note}" for note in result.notes), "Passed." if result.passed else "NOT passed."]
    )


def site_did_not_pass(found: SiteValidated) -> str | None:
    """Say that the command fails, which its text has told already; None if it passed."""
    return None if found.passed else ""
