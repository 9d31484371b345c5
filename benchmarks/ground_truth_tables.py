"""The ledger as Markdown."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from ground_truth_settings import Setting
from ledger import Entry
from measuring import table

from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.rates import binomial_interval, poisson_interval, rate_ratio_interval
from cornerforge.rates.crashes import crash_tables

__all__ = ["render"]

_CIRCUMSTANCES = {
    "at_start": "within 4 s of the start",
    "rare_action": "partner's rarest action in the last 5 s has an attentive chance below 1e-3",
    "overlooked": "partner's lane change overlooked a neighbour (more likely than not)",
    "looked_away": "partner's driver looked away in the last 5 s",
}
_WINDOWS = (0, 2, 4, 6, 8, 10)
"""Bounds of times into a test [s] for which crashes are counted apart."""
_ENOUGH_FOR_TIMES = 40


def render(entries: Mapping[str, Entry], settings: Sequence[Setting]) -> str:
    """All tables; settings without tests are named at the end."""
    known = [(setting, entries[setting.name]) for setting in settings if setting.name in entries]
    counted = [(setting, entry) for setting, entry in known if entry.counts.tests]
    base = [pair for pair in counted if pair[0].variation is None]
    varied = [pair for pair in counted if pair[0].variation is not None]
    missing = [setting.name for setting in settings if setting.name not in {s.name for s, _ in counted}]
    parts = [_head(counted)] if counted else ["The ledger is empty: nothing has been counted yet."]
    if base:
        parts += ["### Natural crash rates", _rates(base), _cost(base)]
        parts += ["### Crash types", _types(base), "### What dominates", _mechanisms(base)]
        parts += ["### When in a test", _times(base)]
    if varied:
        parts += ["### How far the prior and overlooking move the rate", _sensitivity(varied, entries, settings)]
    if missing and counted:
        parts.append(f"Not counted yet: {', '.join(f'`{name}`' for name in missing)}.")
    return "\n\n".join(parts)


def _head(counted: Sequence[tuple[Setting, Entry]]) -> str:
    identities = [entry.identity for _, entry in counted]
    codes = ", ".join(f"`{code}`" for code in sorted({str(identity["simulation"]) for identity in identities}))
    shipped = {str(e.identity["model_hash"]) for s, e in counted if s.variation is None}
    models = ", ".join(f"`{name}`" for name in sorted(shipped)) or "varied ones only"
    mixed = " **Settings differ in code or model; compare with care.**" if len(shipped) > 1 or "," in codes else ""
    return (
        f"Seed {identities[0]['seed']}, tests of 400 m, 4 s lane changes; simulation code {codes}, "
        f"model {models}.{mixed}\n"
        "Intervals are exact 95 % (Clopper-Pearson per test, Poisson for BV-BV crashes). Miles of BVs come from a\n"
        "sample of tests and are good to some tenths of a percent."
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2e}" if value else "0"


def _interval(low: float, high: float | None) -> str:
    return f"{_number(low)} to {'no bound' if high is None else _number(high)}"


def _bv_rate(entry: Entry) -> str:
    miles = entry.counts.tests * (entry.travel.miles_per_test if entry.travel else 0.0)
    if miles == 0.0:
        return "-"
    low, high = poisson_interval(entry.counts.bv_crashes)
    return f"{_number(entry.counts.bv_crashes / miles)} ({_interval(low / miles, high / miles)})"


def _rates(pairs: Sequence[tuple[Setting, Entry]]) -> str:
    rows = []
    for setting, entry in pairs:
        counts = entry.counts
        low, high = binomial_interval(counts.av_crashes, counts.tests)
        rate, per_mile = counts.av_crashes / counts.tests, counts.tests / counts.miles
        rows.append(
            [
                f"{setting.av}, {setting.lanes} lanes",
                f"{counts.tests:,}",
                f"{counts.av_crashes:,}",
                f"{_number(rate)} ({_interval(low, high)})",
                f"{_number(rate * per_mile)} ({_interval(low * per_mile, high * per_mile)})",
                _bv_rate(entry),
            ]
        )
    return table(
        ["AV", "tests", "AV crashes", "per test (95 %)", "per mile of the AV (95 %)", "BV-BV per BV-mile (95 %)"], rows
    )


def _cost(pairs: Sequence[tuple[Setting, Entry]]) -> str:
    rows = []
    for setting, entry in pairs:
        counts = entry.counts
        share = 100.0 * counts.tests / setting.tests
        rows.append(
            [
                f"{setting.av}, {setting.lanes} lanes",
                f"{share:.0f} %",
                f"{counts.seconds / 3600.0:.2f}",
                f"{counts.cpu_seconds / 3600.0:.2f}",
                f"{counts.tests / counts.cpu_seconds:,.0f}" if counts.cpu_seconds else "-",
                f"{234_212_252 / counts.tests * counts.cpu_seconds / 3600.0:.1f}",
                f"`{counts.digest[:16]}`",
            ]
        )
    head = [
        "AV",
        "done",
        "wall-clock [h]",
        "core-hours",
        "tests/s a core",
        "core-hours for 234,212,252 tests",
        "digest",
    ]
    return table(head, rows)


def _share(n: int, whole: int) -> str:
    return f"{n:,} ({100.0 * n / whole:.0f} %)" if n else "-"


def _types(pairs: Sequence[tuple[Setting, Entry]]) -> str:
    tables = [crash_tables(entry.crashes, at_site=False)["crash_types"] for _, entry in pairs]
    rows = [
        [kind, *(_share(t[kind], e.counts.av_crashes) for t, (_, e) in zip(tables, pairs, strict=True))]
        for kind in tables[0]
        if any(t[kind] for t in tables)
    ]
    return table(["crash type", *(f"{s.av}, {s.lanes} lanes" for s, _ in pairs)], rows)


def _mechanisms(pairs: Sequence[tuple[Setting, Entry]]) -> str:
    tables = [crash_tables(entry.crashes, at_site=False) for _, entry in pairs]
    whole = [entry.counts.av_crashes for _, entry in pairs]
    total = {name: sum(t["mechanisms"][name] for t in tables) for name in MECHANISMS}
    rows = [
        [MECHANISMS[name], *(_share(t["mechanisms"][name], n) for t, n in zip(tables, whole, strict=True))]
        for name in sorted(total, key=lambda name: -total[name])
        if total[name]
    ]
    rows += [
        [f"*{text}*", *(_share(getattr(t["crash_circumstances"], key), n) for t, n in zip(tables, whole, strict=True))]
        for key, text in _CIRCUMSTANCES.items()
    ]
    note = (
        "The rules that tell these apart stand in `analysis/mechanism.py`; rows in italics overlap with all others.\n"
        "A library of natural crashes (`rate --out`) holds them as columns for `cornerforge query`."
    )
    return f"{table(['mechanism', *(f'{s.av}, {s.lanes} lanes' for s, _ in pairs)], rows)}\n\n{note}"


def _times(pairs: Sequence[tuple[Setting, Entry]]) -> str:
    """Crashes per second of a test: no test that does not crash is over before the last of the windows ends."""
    enough = [(s, e) for s, e in pairs if e.counts.av_crashes >= _ENOUGH_FOR_TIMES]
    if not enough:
        return "No setting has crashes enough to tell when in a test they happen."
    rows = [
        [f"{low} to {high} s", *(_hazard(entry, low, high) for _, entry in enough)]
        for low, high in itertools.pairwise(_WINDOWS)
    ]
    last = _WINDOWS[-1]
    late = [[crash for crash in entry.crashes if crash["time"] > last] for _, entry in enough]
    rows.append([f"after {last} s", *(f"{len(crashes):,}" for crashes in late)])
    note = (
        "Crashes, and how many per second and 1e6 tests with the 95 % interval (Poisson). Nobody drives faster than\n"
        f"40 m/s, so every test of 400 m without a crash lasts {last} s at least; after that some are over."
    )
    return f"{table(['time into the test', *(f'{s.av}, {s.lanes} lanes' for s, _ in enough)], rows)}\n\n{note}"


def _hazard(entry: Entry, low: float, high: float) -> str:
    n = sum(low < crash["time"] <= high for crash in entry.crashes)
    exposure = (high - low) * entry.counts.tests / 1e6
    bounds = poisson_interval(n)
    return f"{n:,}: {n / exposure:.3f} ({bounds[0] / exposure:.3f} to {bounds[1] / exposure:.3f})"


def _same_tests(entry: Entry, base: Entry | None) -> str:
    """How many of the shipped model's crashes in the tests that both drove happen here too."""
    if base is None:
        return "-"
    theirs = {crash["test"] for crash in base.crashes if crash["test"] < entry.counts.tests}
    ours = {crash["test"] for crash in entry.crashes}
    return f"{len(theirs & ours)} of {len(theirs)}"


def _sensitivity(
    varied: Sequence[tuple[Setting, Entry]], entries: Mapping[str, Entry], settings: Sequence[Setting]
) -> str:
    bases = {(s.av, s.lanes): entries.get(s.name) for s in settings if s.variation is None}
    rows = []
    for setting, entry in varied:
        base = bases.get((setting.av, setting.lanes))
        counts = entry.counts
        low, high = binomial_interval(counts.av_crashes, counts.tests)
        ratio = "-"
        if base is not None and base.counts.av_crashes:
            compared = rate_ratio_interval(counts.av_crashes, counts.tests, base.counts.av_crashes, base.counts.tests)
            times = counts.av_crashes / counts.tests / (base.counts.av_crashes / base.counts.tests)
            ratio = f"{times:.2f} ({compared[0]:.2f} to {compared[1]:.2f})"
        what = setting.variation.text if setting.variation else ""
        rows.append(
            [
                what,
                f"{counts.tests:,}",
                f"{counts.av_crashes:,}",
                f"{_number(counts.av_crashes / counts.tests)} ({_interval(low, high)})",
                ratio,
                _same_tests(entry, base),
                _bv_rate(entry),
            ]
        )
    head = [
        "changed",
        "tests",
        "AV crashes",
        "per test (95 %)",
        "times the shipped model's (95 %)",
        "of the shipped model's crashes in these tests, here too",
        "BV-BV per BV-mile",
    ]
    note = (
        "Each row changes one number of the shipped model and counts the same tests of the same seed, so that the\n"
        "interval of the ratio, which takes both counts for independent, is wider than it need be; the column behind\n"
        "it says how many tests end in a crash under both models."
    )
    return f"{table(head, rows)}\n\n{note}"
