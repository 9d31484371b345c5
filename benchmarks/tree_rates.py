"""Natural rates of the ground truth's settings by trees of tests, beside their counts, and how far numbers move them.

    .venv/bin/python benchmarks/tree_rates.py --only "idm-mobil-*-lanes" --write docs/results.md

An AV on a road is taught once and driven until its interval is narrow enough. A setting that varies the model uses the
network that the shipped model taught, and has so many trees: what the network says changes no rate
(`rates.branching`), and doubts tell if it served badly. Results go into a ledger, one entry a setting; what is there of
the same code is not run again. Entries of trees that branched otherwise stay, marked, until their setting is asked for.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from time import process_time
from typing import Any

from document import MarkedBlock
from ground_truth import LEDGER
from ground_truth_settings import SETTINGS, Setting
from ledger import read_ledger, simulation_hash, trees_hash
from measuring import table

from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import read_json_file, write_json
from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.variations import varied_model
from cornerforge.ndd import default_model_path, load_model, save_model
from cornerforge.rates import binomial_interval
from cornerforge.rates.splitting import Splitting, kind_rates
from cornerforge.rates.weighted import LARGEST_SHARE, LEAST_EFFECTIVE
from cornerforge.sim import simulate
from cornerforge.work.progress import NO_PROGRESS

OURS = Path(__file__).with_name("tree_rates.json")
IN_DOCUMENT = MarkedBlock("benchmarks/tree_rates.py")
SEED = 1
_VARIED_TREES = 300_000
_COUNTED_TESTS = 60_000
_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Rated:
    """A setting's rate by trees, per test.

    Attributes:
        rate, error, counted_tests, effective, largest, tail, doubts: As of `WeightedRate`.
        interval: The one that holds however often one looks; (0, 0) without a crash.
        trees, cpu_seconds: Of the estimate.
        teaching_cpu_seconds: Of the network, shared by all variations.
        mechanisms: Shares of the rate.
        identity: What was driven.
    """

    rate: float
    error: float
    counted_tests: float
    interval: tuple[float, float]
    trees: int
    effective: float
    largest: float
    tail: float | None
    doubts: list[str]
    teaching_cpu_seconds: float
    cpu_seconds: float
    mechanisms: dict[str, float]
    identity: dict[str, str]


def rated(setting: Setting, out: Path, data: list[Path], *, threads: int, target: float, most: int) -> Rated:
    """Drive the trees of a setting."""
    run = _run(setting, out, data)
    trees = out / f"trees-{trees_hash()}"
    place = trees / setting.name
    if setting.variation is not None:
        taught = trees / f"{setting.av}-{setting.lanes}-lanes" / "taught.npz"
        if taught.exists() and not (place / "taught.npz").exists():
            place.mkdir(parents=True, exist_ok=True)
            shutil.copy(taught, place)
    split = Splitting(run, SEED, place, threads=threads, progress=NO_PROGRESS)
    split.start()
    if setting.variation is None:
        split.drive(target, most)
    else:
        split.drive(1e-9, _VARIED_TREES)
    found = split.rate
    picked = split.picked() if found.rate > 0.0 and setting.variation is None else []
    kinds = kind_rates(picked, "mechanism", found) if picked else {}
    return Rated(
        rate=found.rate,
        error=found.error,
        counted_tests=found.counted_tests,
        interval=split.interval if found.rate > 0.0 else (0.0, 0.0),
        trees=found.n,
        effective=found.effective,
        largest=found.largest,
        tail=found.tail,
        doubts=list(found.doubts),
        teaching_cpu_seconds=round(split.taught.cpu_seconds, 1),
        cpu_seconds=round(split.cost.cpu_seconds, 1),
        mechanisms={name: kind.crashes_per_test / found.rate for name, kind in kinds.items()},
        identity=_identity(run),
    )


def _run(setting: Setting, out: Path, data: list[Path]) -> Experiment:
    model = None
    if setting.variation is not None:
        model = out / "models" / f"{setting.name}.npz"
        save_model(varied_model(load_model(default_model_path()), [setting.variation], data), model)
    return experiment(av=setting.av, lanes=setting.lanes, model=model)


def _identity(run: Experiment) -> dict[str, str]:
    names = run.identity(SEED)
    own = {key: str(names[key]) for key in ("av_hash", "model_hash")}
    return {**own, "simulation": simulation_hash(), "trees": trees_hash()}


def _simulations_of_the_same_bits() -> set[str]:
    """Hashes of the simulation code that drives as today's does, as far as the ledger of counts has checked it."""
    now, entry = simulation_hash(), read_ledger(LEDGER).get("idm-mobil-3-lanes")
    if entry is None or entry.identity["simulation"] != now:
        return {now}
    return {now, *entry.earlier_simulations}


def _is_of_today(entry: Mapping[str, Any] | None) -> bool:
    """Are an entry's trees the same as now?"""
    return entry is not None and entry["identity"].get("trees") == trees_hash()


def _mark(ours: Rated) -> str:
    return "" if _is_of_today(asdict(ours)) else " \\*"


def render(found: Mapping[str, Rated], plain_cpu_seconds: Mapping[str, float]) -> str:
    """All tables; `plain_cpu_seconds`: of a plain test, by setting."""
    counted = read_ledger(LEDGER)
    base = [setting for setting in SETTINGS if setting.variation is None and setting.name in found]
    varied = [setting for setting in SETTINGS if setting.variation is not None and setting.name in found]
    rows = []
    for setting in base:
        ours = found[setting.name]
        low, high = ours.interval
        counts = counted[setting.name].counts if setting.name in counted else None
        if counts is None or counts.tests == 0:
            by_counting, apart = "not counted yet", ""
        else:
            rate, interval = counts.av_crashes / counts.tests, binomial_interval(counts.av_crashes, counts.tests)
            by_counting = f"{rate:.3g} ({interval[0]:.2e} to {interval[1]:.2e}), {counts.av_crashes} crashes"
            apart = f"{(ours.rate - rate) / math.hypot(ours.error, math.sqrt(ours.rate / counts.tests)):+.1f}"
        by_counting_s = plain_cpu_seconds[setting.name] * ours.counted_tests
        faster = by_counting_s / (ours.teaching_cpu_seconds + ours.cpu_seconds)
        without = by_counting_s / ours.cpu_seconds
        rows.append(
            [
                f"{setting.av}, {setting.lanes} lanes{_mark(ours)}", f"{ours.rate:.3g} ({low:.2e} to {high:.2e})",
                f"{ours.trees:,}", f"{ours.effective:,.0f}", f"{ours.largest:.3f}",
                "" if ours.tail is None else f"{ours.tail:.2f}", by_counting, apart,
                f"{ours.teaching_cpu_seconds:.0f} + {ours.cpu_seconds:.0f}", f"{faster:,.0f}", f"{without:,.0f}",
                "; ".join(ours.doubts) or "none",
            ]
        )  # fmt: skip
    head = [
        "AV", "per test by trees (95 %)", "trees", "effective", "largest", "tail index", "by counting (95 %)",
        "sd apart",
        "CPU [s]: teaching + trees", "counting takes x", "without teaching x", "doubts",
    ]  # fmt: skip
    parts = [
        "### The same by trees",
        table(head, rows),
        "A plain test costs "
        + ", ".join(f"{1e6 * plain_cpu_seconds[setting.name]:.0f}" for setting in base)
        + " us of CPU, in the order of the rows. \\*: of trees that branched otherwise, before their last change.",
    ]
    if varied:
        whole = found[f"{varied[0].av}-{varied[0].lanes}-lanes"]
        rows = []
        for setting in varied:
            ours = found[setting.name]
            times = ours.rate / whole.rate
            off = _Z95 * times * math.hypot(ours.error / max(ours.rate, 1e-300), whole.error / whole.rate)
            assert setting.variation is not None
            rows.append(
                [
                    f"{setting.variation.text}{_mark(ours)}", f"{ours.rate:.3g} +- {_Z95 * ours.error:.1g}",
                    f"{times:.2f} ({max(0.0, times - off):.2f} to {times + off:.2f})", f"{ours.effective:,.0f}",
                    f"{ours.largest:.2f}",
                ]
            )  # fmt: skip
        parts += [
            "### How far each number of the model moves the rate, by trees",
            table(["changed", "per test (95 %)", "times the shipped model's (95 %)", "effective", "largest"], rows),
            f"{_VARIED_TREES:,} trees each, of the same tests. Rows with fewer than {LEAST_EFFECTIVE:.0f} effective "
            f"trees, or one of more than {LARGEST_SHARE:g} of the sum, are in doubt (too narrow).",
        ]
    return "\n\n".join(parts)


def _plain_cost(setting: Setting) -> float:
    """Measure the CPU time of a plain test [s], the least of three; alone on the machine."""
    run = experiment(av=setting.av, lanes=setting.lanes)
    run.warm_up()
    taken = []
    for _ in range(3):
        begun = process_time()
        simulate(run.setting, run.slots, seed=SEED, tests=_COUNTED_TESTS, threads=1)
        taken.append((process_time() - begun) / _COUNTED_TESTS)
    return min(taken)


def main() -> int:
    parser = argparse.ArgumentParser(description="Natural rates of the ground truth's settings by trees of tests.")
    parser.add_argument("--only", action="append", metavar="NAME", help="this setting; * stands for any text")
    parser.add_argument("--target", type=float, default=0.15, help="relative half-width of the settings without change")
    parser.add_argument("--most", type=int, default=2_000_000, help="trees of one setting at most")
    parser.add_argument("--data", nargs="+", type=Path, default=[], help="trajectory files, for variations of the fit")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=Path("out/tree-rates"), help="working folder")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    given = parser.parse_args()
    if given.write and (fault := IN_DOCUMENT.missing_in(given.write)):
        parser.error(fault)
    kept: dict[str, Any] = read_json_file(OURS) if OURS.exists() else {"found": {}}
    same = _simulations_of_the_same_bits()
    kept["found"] = {name: entry for name, entry in kept["found"].items() if entry["identity"]["simulation"] in same}
    for setting in SETTINGS:
        wanted = any(fnmatch(setting.name, pattern) for pattern in given.only or ["*"])
        needs_data = setting.variation is not None and setting.variation.part == "fit" and not given.data
        if not wanted or needs_data or _is_of_today(kept["found"].get(setting.name)):
            continue
        ours = rated(
            setting, given.out, given.data, threads=check_threads(given.threads), target=given.target, most=given.most
        )
        kept["found"][setting.name] = asdict(ours)
        write_json(OURS, kept)
        print(json.dumps({"setting": setting.name, **asdict(ours)}), file=sys.stderr, flush=True)
    found = {name: Rated(**values) for name, values in kept["found"].items()}
    plain = kept.setdefault("plain_cpu_seconds", {})
    for setting in SETTINGS:
        if setting.variation is None and setting.name in found and setting.name not in plain:
            plain[setting.name] = _plain_cost(setting)
    write_json(OURS, kept)
    block = render(found, plain)
    IN_DOCUMENT.publish(block, given.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
