"""The ground truth of natural crash rates: long counts, which any machine can continue.

    .venv/bin/python benchmarks/ground_truth.py --minutes 30 --write docs/results.md

Counts whole blocks of tests for a fixed list of settings (`--list`), in order, from where the committed ledger and the
working folder are. A stop at any moment (Ctrl-C, kill, end of `--minutes`) loses the block in progress; Ctrl-C and the
end write the ledger too. Commit `benchmarks/ground_truth.json` and another machine goes on from it; counts of another
model, AV, road, simulation code or seed are refused.

After a change of the simulation code that should leave all outcomes as they are, `--same-bits` takes an entry over if
this code drives its first block to the same digest and each of its crashes to the same crash again; the entry then
names the old code among its `earlier_simulations`. If a digest or a crash differs, the entry is refused and kept.
What a crash is called, its type and mechanism, is that of today's rules then.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from document import MarkedBlock
from ground_truth_settings import SETTINGS, Setting
from ground_truth_tables import render
from ledger import Entry, furthest, read_entry, read_ledger, simulation_hash, write_entry, write_ledger

from cornerforge.errors import CornerForgeError, InputError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import config_hash
from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.variations import varied_model
from cornerforge.ndd.model import default_model_path, load_model, save_model
from cornerforge.rates.crashes import NaturalCrashes
from cornerforge.rates.exposure import SAMPLE_TESTS, bv_travel
from cornerforge.rates.monte_carlo import BLOCK, Block, drive_block
from cornerforge.sim.runner import warm_up

SEED = 0
IN_DOCUMENT = MarkedBlock("benchmarks/ground_truth.py")
LEDGER = Path(__file__).parent / "ground_truth.json"
_SAY_SECONDS = 20.0
_NAMES = ("crash_type", "mechanism")
"""Columns of a crash that depend on how crashes are named, not on how vehicles drive."""


@dataclass(frozen=True)
class Session:
    """How this session works.

    Attributes:
        out: Working folder: an entry of each setting after every block, and the models of the variations.
        data: Trajectory files for variations that need a fit.
        threads: Pool size; does not change the result.
        until: Moment of `time.monotonic` at which no new block is begun.
        most: Largest number of tests per setting, for a trial.
        restart: Forget entries of other hashes.
        same_bits: Take over entries of other simulation code that drives the same.
    """

    out: Path
    data: Sequence[Path]
    threads: int
    until: float
    most: int | None
    restart: bool
    same_bits: bool

    def wanted(self, setting: Setting) -> int:
        return setting.tests if self.most is None else min(setting.tests, self.most)


def prepare(setting: Setting, session: Session) -> tuple[Experiment, dict[str, Any]]:
    """Return the run of a setting, and the identity that counts must share to be added."""
    model = None
    if setting.variation is not None:
        varied = varied_model(load_model(default_model_path()), [setting.variation], session.data)
        model = session.out / "models" / f"{setting.name}.npz"
        model.parent.mkdir(parents=True, exist_ok=True)
        save_model(varied, model)
    run = experiment(av=setting.av, lanes=setting.lanes, model=model)
    return run, _identity(run)


def _identity(run: Experiment) -> dict[str, Any]:
    """Return what names a count of natural traffic, without adversaries: their new options keep counts valid."""
    names = run.identity(SEED)
    kept = {key: names[key] for key in ("seed", "odd", "lanes", "av", "av_hash", "model_hash")}
    return {**kept, "road_hash": config_hash(asdict(run.odd)), "simulation": simulation_hash()}


def take_up(setting: Setting, known: Entry | None, session: Session) -> tuple[Experiment, Entry]:
    """The run of a setting and its entry so far, the further one of ledger and working folder.

    With `session.same_bits` the entry may be of other simulation code; `count` then compares before it goes on.

    Raises:
        InputError: One of them was counted with something else.
    """
    run, identity = prepare(setting, session)
    place = _place(setting, session)
    sources = {f"The ledger's entry {setting.name}": known, str(place): _readable(place, session)}
    return run, furthest(sources, identity, restart=session.restart, same_bits=session.same_bits)


def _place(setting: Setting, session: Session) -> Path:
    return session.out / f"{setting.name}.json"


def count(setting: Setting, run: Experiment, entry: Entry, session: Session) -> Iterable[Entry]:
    """Go on with one setting; yields its entry at the start and after every block.

    Raises:
        InputError: This machine, or this code, computes other bits than the one that began.
    """
    compared = entry.identity["simulation"] != simulation_hash()
    if compared:
        entry = _taken_over(setting, run, entry, session)
    yield entry
    if entry.counts.tests >= session.wanted(setting) or time.monotonic() >= session.until:
        return
    warm_up(run.setting, run.slots)
    if entry.counts.tests and not compared:
        _check_bits(setting, run, entry, session)
    if entry.travel is None:
        travel = bv_travel(run.setting, run.slots, seed=SEED, tests=SAMPLE_TESTS, threads=session.threads)
        entry = replace(entry, travel=travel)
    crashes = NaturalCrashes(run, SEED)
    while entry.counts.tests < session.wanted(setting) and time.monotonic() < session.until:
        block = _block(run, entry.counts.tests, session)
        if entry.counts.tests == 0:
            entry = replace(entry, first_block=block.digest)
        for test in block.crashed:
            entry = _with_crash(entry, test, crashes)
        entry = replace(entry, counts=entry.counts.plus(block))
        write_entry(_place(setting, session), entry)
        yield entry


def _readable(place: Path, session: Session) -> Entry | None:
    """The working folder's entry; what cannot be read counts as absent when starting anew."""
    try:
        return read_entry(place)
    except CornerForgeError:
        if not session.restart:
            raise
        return None


def _block(run: Experiment, first: int, session: Session) -> Block:
    return drive_block(run.setting, run.slots, seed=SEED, first=first, tests=BLOCK, threads=session.threads)


def _taken_over(setting: Setting, run: Experiment, entry: Entry, session: Session) -> Entry:
    """An entry of other simulation code as one of this code, which drives the same.

    Raises:
        InputError: The first block or a crash differs.
    """
    taken = entry.driven_by(simulation_hash())
    if entry.counts.tests == 0:
        return taken
    warm_up(run.setting, run.slots)
    if _block(run, 0, session).digest != entry.first_block:
        raise _other_bits(setting, f"tests 0 to {BLOCK - 1} come out otherwise")
    crashes = NaturalCrashes(run, SEED)
    studied = []
    for crash in entry.crashes:
        test = crash["test"]
        try:
            again = _with_crash(Entry(taken.identity), test, crashes).crashes[0]
        except InputError as error:
            raise _other_bits(setting, f"test {test} does not end in a crash") from error
        other = [name for name in crash if name not in _NAMES and crash[name] != again[name]]
        if other:
            named = ", ".join(f"{name} {crash[name]} (here {again[name]})" for name in other)
            raise _other_bits(setting, f"the crash of test {test} has other {named}")
        studied.append(again)
    taken = replace(taken, crashes=tuple(studied))
    write_entry(_place(setting, session), taken)
    return taken


def _with_crash(entry: Entry, test: int, crashes: NaturalCrashes) -> Entry:
    scenario, study = crashes.record(test)
    assert scenario.crash is not None  # or there were nothing to study
    return entry.with_crash(test, scenario.crash.time, study)


def _other_bits(setting: Setting, what: str) -> InputError:
    return InputError(
        f"{setting.name}: with this simulation code {what}, unlike in the ledger, so its counts are not taken over. "
        "Go back to that version, or begin the setting anew with --restart."
    )


def _check_bits(setting: Setting, run: Experiment, entry: Entry, session: Session) -> None:
    """Drive the first block again: another processor or library might compute other bits, and hashes do not see it."""
    if _block(run, 0, session).digest != entry.first_block:
        raise InputError(
            f"{setting.name}: tests 0 to {BLOCK - 1} come out otherwise on this machine than in the ledger, though all "
            "hashes agree. Go on where it was counted, or begin the setting anew in another --ledger and --out."
        )


def work(chosen: Sequence[Setting], entries: dict[str, Entry], session: Session) -> None:
    """Go on with all chosen settings, in order; `entries` is kept up to date, so that a stop loses nothing.

    All entries are checked before the first setting is driven, so that errors come at once and not after a night.
    """
    taken = [(setting, *take_up(setting, entries.get(setting.name), session)) for setting in chosen]
    for setting, run, begun in taken:
        said = 0.0
        for entry in count(setting, run, begun, session):
            if entry.counts.tests:
                entries[setting.name] = entry
            if time.monotonic() - said > _SAY_SECONDS:
                said = time.monotonic()
                _say(setting, entry, session)
        _say(setting, entry, session)


def _say(setting: Setting, entry: Entry, session: Session) -> None:
    done, wanted, counts = entry.counts.tests, session.wanted(setting), entry.counts
    speed = counts.tests / counts.seconds if counts.seconds else 0.0
    left = f"; {speed:,.0f} tests/s, {max(0, wanted - done) / speed / 60.0:.0f} min left" if speed else ""
    print(
        f"{setting.name}: {done:,} of {wanted:,} tests, {counts.av_crashes} crashes, {counts.bv_crashes} between BVs"
        + left,
        file=sys.stderr,
        flush=True,
    )


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Count natural crashes for a fixed list of settings.")
    parser.add_argument("--list", action="store_true", help="name the settings and how far each is, and stop")
    parser.add_argument("--only", action="append", metavar="NAME", help="this setting; * stands for any text")
    parser.add_argument("--minutes", type=float, help="begin no block after this time; default: until all is done")
    parser.add_argument("--threads", type=int, help="default: all cores; does not change results")
    parser.add_argument("--tests", type=int, help="at most so many tests a setting, for a trial (whole blocks)")
    parser.add_argument("--data", nargs="+", type=Path, default=[], help="trajectory files, for variations of the fit")
    parser.add_argument("--out", type=Path, default=Path("out/ground-truth"), help="working folder")
    parser.add_argument("--ledger", type=Path, default=LEDGER, help="the committed ledger")
    stale = parser.add_mutually_exclusive_group()
    stale.add_argument("--restart", action="store_true", help="forget counts of the chosen settings of other hashes")
    stale.add_argument("--same-bits", action="store_true", help="take over counts of other code that drives the same")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    parsed = parser.parse_args(arguments)
    patterns = parsed.only or ["*"]
    parsed.chosen = [setting for setting in SETTINGS if any(fnmatch(setting.name, p) for p in patterns)]
    if not parsed.chosen:
        parser.error(f"no setting is named {' or '.join(patterns)}; --list names them.")
    if (parsed.minutes is not None and parsed.minutes <= 0.0) or (parsed.tests is not None and parsed.tests < 1):
        parser.error("--minutes and --tests must be above 0.")
    if parsed.write and (fault := IN_DOCUMENT.missing_in(parsed.write)):
        parser.error(fault)
    return parsed


def _without_data(chosen: Sequence[Setting], given: argparse.Namespace) -> list[Setting]:
    """Leave out, with a word, settings that need a fit when no data are named and they were not asked for by name."""
    needy = [s for s in chosen if s.variation is not None and s.variation.part == "fit" and not given.data]
    if needy and not given.only:
        print(f"left out without --data: {', '.join(s.name for s in needy)}", file=sys.stderr)
        return [setting for setting in chosen if setting not in needy]
    return list(chosen)


def main(arguments: Sequence[str] | None = None) -> int:
    """Work through a slice; returns the exit status, as the command line of cornerforge has it."""
    given = _arguments(arguments)
    try:
        entries = read_ledger(given.ledger)
        if given.list:
            for setting in given.chosen:
                done = entries[setting.name].counts.tests if setting.name in entries else 0
                print(f"{setting.name:<32}{done:>14,} of {setting.tests:>12,} tests")
            return 0
        until = time.monotonic() + 60.0 * given.minutes if given.minutes else float("inf")
        threads = check_threads(given.threads)
        session = Session(given.out, given.data, threads, until, given.tests, given.restart, given.same_bits)
        status = 0
        try:
            work(_without_data(given.chosen, given), entries, session)
        except KeyboardInterrupt:
            print("interrupted; finished blocks are kept.", file=sys.stderr)
            status = 130
        finally:
            write_ledger(given.ledger, entries)
        block = render(entries, SETTINGS)
        IN_DOCUMENT.publish(block, given.write)
        return status
    except CornerForgeError as error:
        print(f"ground_truth: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
