"""The ledger of the ground truth: it goes on, refuses to mix, and its models change one number only."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from edited_files import write_object

import cornerforge
from cornerforge._kernel_content import functions_reached
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.calibrate.variations import Variation
from cornerforge.rates.crashes import CrashStudy
from cornerforge.rates.exposure import BvTravel
from cornerforge.rates.monte_carlo import Block, MonteCarlo
from cornerforge.sim.drive import drive_range

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

import ground_truth  # noqa: E402
import ledger  # noqa: E402
from ground_truth import IN_DOCUMENT  # noqa: E402
from ground_truth_settings import SETTINGS, Setting  # noqa: E402
from ground_truth_tables import render  # noqa: E402
from ledger import (  # noqa: E402
    Entry,
    agree,
    furthest,
    read_entry,
    read_ledger,
    simulation_hash,
    write_ledger,
)

pytestmark = pytest.mark.full

IDENTITY = {"seed": 0, "av_hash": "a", "model_hash": "m", "simulation": "s"}


def some_entry(blocks: int = 2, identity: dict[str, Any] | None = None) -> Entry:
    """One crash in the third test of each block of 100."""
    entry = Entry(IDENTITY if identity is None else identity, first_block="ab", travel=BvTravel(9.2, 0.003, 4096))
    for k in range(blocks):
        block = Block(100, 2, 1300, 40_000_000, 1.5, 2.5, (100 * k + 2,), f"digest {k}")
        study = CrashStudy("sideswipe", "bv-side", k == 0, 1.23456e-7, True, True, False)
        entry = replace(entry.with_crash(100 * k + 2, 2.5 * k + 0.51, study), counts=entry.counts.plus(block))
    return entry


# --- the file ---


def test_a_ledger_comes_back_as_it_was(tmp_path: Path) -> None:
    entries = {"b": some_entry(3), "a": Entry({"seed": 0}), "c": some_entry().driven_by("new").driven_by("newest")}
    write_ledger(tmp_path / "l.json", entries)
    found = read_ledger(tmp_path / "l.json")
    assert found == entries
    assert found["b"].crashes[1] == {
        "test": 102, "time": 3.0, "crash_type": "sideswipe", "mechanism": "bv-side", "at_start": False,
        "rarest_chance": 1.23e-7, "rare_action": True, "overlooked": True, "looked_away": False,
    }  # fmt: skip
    first = (tmp_path / "l.json").read_bytes()
    write_ledger(tmp_path / "l.json", found)
    assert (tmp_path / "l.json").read_bytes() == first
    json.loads(first)
    assert first.decode().count("\n[") == 5, "a line for each crash"
    assert found["c"].earlier_simulations == ("s", "new")
    older = first.decode().replace(', "looked_away"]', "]").replace(", false]", "]")  # from before drivers looked away
    write_object(tmp_path / "old.json", json.loads(older))
    assert read_ledger(tmp_path / "old.json") == entries
    write_ledger(tmp_path / "none.json", {})
    assert read_ledger(tmp_path / "none.json") == {} == read_ledger(tmp_path / "missing.json")


def test_damage_and_other_schemas_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "l.json"
    write_ledger(path, {"x": some_entry()})
    whole = json.loads(path.read_text())
    entry = whole["settings"]["x"]
    for spoiled in (
        {**entry, "crashes": entry["crashes"][:1]},
        {**entry, "counts": {"tests": 5}},
        {**entry, "crashes": [[*row[:3], "sorcery", *row[4:]] for row in entry["crashes"]]},
        {key: value for key, value in entry.items() if key != "identity"},
    ):
        write_object(path, {"schema": 1, "settings": {"x": spoiled}})
        with pytest.raises(FileFormatError, match="x is no entry of a ledger"):
            read_ledger(path)
    write_object(path, {**whole, "schema": 99})
    with pytest.raises(FileFormatError, match="schema 1"):
        read_ledger(path)
    assert read_entry(tmp_path / "absent.json") is None


# --- going on ---


def test_the_furthest_entry_of_the_same_hashes_is_taken() -> None:
    short, long = some_entry(1), some_entry(4)
    for order in ((short, long), (long, short), (None, long)):
        assert furthest({"one": order[0], "two": order[1]}, IDENTITY, restart=False) is long
    assert furthest({"one": None}, IDENTITY, restart=False).counts == MonteCarlo()


@pytest.mark.parametrize("key", ["model_hash", "av_hash", "simulation", "seed"])
def test_counts_of_other_hashes_are_refused_by_name(key: str) -> None:
    other = {**IDENTITY, key: "other"}
    with pytest.raises(InputError, match=f"two was counted with other {key}") as refused:
        furthest({"one": some_entry(), "two": some_entry(3, other)}, IDENTITY, restart=False)
    assert [name for name in IDENTITY if name != key and name in str(refused.value)] == []
    assert furthest({"one": some_entry(), "two": some_entry(3, other)}, IDENTITY, restart=True).counts.tests == 200
    agree(some_entry(), IDENTITY, "here")
    with pytest.raises(InputError, match="new_key"):
        agree(some_entry(), {**IDENTITY, "new_key": 1}, "here")


def package_with(tmp_path: Path, name: str, code: str) -> Path:
    package = tmp_path / name
    (package / "sim").mkdir(parents=True)
    (package / "sim" / "step.py").write_text(code)
    (package / "cli.py").write_text(f"print({name!r})")
    return package


def test_only_what_decides_outcomes_changes_the_simulation_hash(tmp_path: Path) -> None:
    def hashed(name: str, code: str) -> str:
        return simulation_hash(package_with(tmp_path, name, code))

    plain = hashed("a", '"""A."""\nX = 1\n\ndef f(a: int) -> int:\n    """Doc."""\n    return a + X\n')
    assert hashed("b", 'X = 1  # why\n"""What."""\n\n\ndef f(a: int) -> int:\n    return a + X\n') == plain
    assert hashed("c", "X = 2\n\ndef f(a: int) -> int:\n    return a + X\n") != plain
    assert hashed("d", "X = 1\n\ndef f(a: int) -> int:\n    return a - X\n") != plain
    assert len(simulation_hash()) == 16


def test_all_that_drives_tests_counts() -> None:
    package = Path(cornerforge.__file__).parent
    counted = {path for pattern in ledger._SIMULATION for path in package.glob(pattern)}
    reached = {Path(getattr(one, "py_func", one).__code__.co_filename) for one in functions_reached(drive_range)}
    assert len(reached) > 20
    assert reached <= counted


# --- really counting ---


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Setting:
    setting = Setting("blind", "idm-mobil-blind", 3, 12_000)
    monkeypatch.setattr(ground_truth, "BLOCK", 3_000)
    monkeypatch.setattr(ground_truth, "SAMPLE_TESTS", 256)
    monkeypatch.setattr(ground_truth, "SETTINGS", (setting,))
    return setting


@pytest.fixture
def crashing(small: Setting, monkeypatch: pytest.MonkeyPatch) -> Setting:
    """Drivers who overlook 3 of 10 neighbours: 15 crashes in the 12,000 tests; the shipped model has none in them."""
    setting = replace(small, variation=Variation("model", "overlook", 200.0))
    monkeypatch.setattr(ground_truth, "SETTINGS", (setting,))
    return setting


def run(tmp_path: Path, name: str, *more: str) -> int:
    return ground_truth.main(
        ["--threads", "1", "--out", str(tmp_path / name), "--ledger", str(tmp_path / f"{name}.json"), *more]
    )


def untimed(entry: Entry) -> Entry:
    return replace(entry, counts=replace(entry.counts, seconds=0.0, cpu_seconds=0.0))


def test_a_ledger_alone_is_enough_to_go_on(crashing: Setting, tmp_path: Path) -> None:
    """Two sessions, the second on a machine that has the ledger only, give what one session gives."""
    assert run(tmp_path, "whole") == 0
    assert run(tmp_path, "first", "--tests", "5000") == 0  # two blocks
    assert read_ledger(tmp_path / "first.json")[crashing.name].counts.tests == 6_000
    (tmp_path / "second.json").write_bytes((tmp_path / "first.json").read_bytes())
    assert run(tmp_path, "second") == 0
    whole, second = (read_ledger(tmp_path / f"{name}.json")[crashing.name] for name in ("whole", "second"))
    assert whole.counts.tests == 12_000
    assert whole.counts.av_crashes == len(whole.crashes) > 0
    assert untimed(second) == untimed(whole)
    working = read_entry(tmp_path / "second" / "blind.json")
    assert working is not None
    assert untimed(working) == untimed(second)


def test_a_stop_keeps_finished_blocks(small: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = ground_truth.drive_block, []

    def interrupted(*a: Any, **k: Any) -> Block:
        calls.append(k["first"])
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*a, **k)

    monkeypatch.setattr(ground_truth, "drive_block", interrupted)
    assert run(tmp_path, "r") == 130
    assert read_ledger(tmp_path / "r.json")[small.name].counts.tests == 6_000
    (tmp_path / "r.json").unlink()  # as after a kill: the working folder alone
    assert run(tmp_path, "r") == 0
    assert calls[3:] == [0, 6_000, 9_000], "the first block once more, to compare bits, then on"
    assert read_ledger(tmp_path / "r.json")[small.name].counts.tests == 12_000


def test_other_code_and_other_bits_are_refused(
    small: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "r", "--tests", "1") == 0
    entry = read_ledger(tmp_path / "r.json")[small.name]
    write_ledger(tmp_path / "bits.json", {small.name: replace(entry, first_block="00")})
    assert run(tmp_path, "bits") == 2
    assert "come out otherwise on this machine" in capsys.readouterr().err
    monkeypatch.setattr(ground_truth, "simulation_hash", lambda: "other")
    assert run(tmp_path, "r") == 2
    text = capsys.readouterr().err
    assert "simulation" in text
    assert "--restart" in text
    assert read_ledger(tmp_path / "r.json")[small.name] == entry, "nothing is lost by a refusal"
    assert run(tmp_path, "r", "--tests", "1", "--restart") == 0
    again = read_ledger(tmp_path / "r.json")[small.name]
    assert (again.identity["simulation"], again.counts.tests) == ("other", 3_000)


def other_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground_truth, "simulation_hash", lambda: "rewritten")


def test_rewritten_code_of_the_same_bits_takes_an_entry_over(
    crashing: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "whole") == 0
    whole = read_ledger(tmp_path / "whole.json")[crashing.name]
    assert run(tmp_path, "r", "--tests", "5000") == 0
    before = read_ledger(tmp_path / "r.json")[crashing.name]
    assert before.counts.av_crashes > 0, "no crash to compare"
    other_code(monkeypatch)
    assert run(tmp_path, "r") == 2
    assert "--same-bits" in capsys.readouterr().err
    assert run(tmp_path, "r", "--same-bits", "--tests", "5000") == 0
    after = read_ledger(tmp_path / "r.json")[crashing.name]
    assert after == before.driven_by("rewritten"), "taken over, though nothing was left to count"
    assert after.identity == {**before.identity, "simulation": "rewritten"}
    assert after.earlier_simulations == (before.identity["simulation"],)
    assert run(tmp_path, "r") == 0, "it is an entry like any other now"
    named = replace(before, crashes=tuple({**crash, "mechanism": "other"} for crash in before.crashes))
    write_ledger(tmp_path / "named.json", {crashing.name: named})
    assert run(tmp_path, "named", "--same-bits", "--tests", "5000") == 0
    assert read_ledger(tmp_path / "named.json")[crashing.name] == after, "named by today's rules"
    assert untimed(read_ledger(tmp_path / "r.json")[crashing.name]) == untimed(whole.driven_by("rewritten"))


SPOILED = {
    "first block": (lambda entry: replace(entry, first_block="00"), "tests 0 to 2999 come out otherwise"),
    "a column": (
        lambda entry: replace(entry, crashes=({**entry.crashes[0], "overlooked": None}, *entry.crashes[1:])),
        "has other overlooked None",
    ),
    "no crash": (
        lambda entry: replace(entry, crashes=({**entry.crashes[0], "test": 0}, *entry.crashes[1:])),
        "test 0 does not end in a crash",
    ),
}


@pytest.mark.parametrize("what", SPOILED)
def test_rewritten_code_of_other_bits_is_refused(
    what: str, crashing: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "r", "--tests", "5000") == 0
    spoil, words = SPOILED[what]
    spoiled = spoil(read_ledger(tmp_path / "r.json")[crashing.name])
    write_ledger(tmp_path / "s.json", {crashing.name: spoiled})
    written = (tmp_path / "s.json").read_bytes()
    other_code(monkeypatch)
    assert run(tmp_path, "s", "--same-bits") == 2
    text = capsys.readouterr().err
    assert words in text
    assert "--restart" in text
    assert (tmp_path / "s.json").read_bytes() == written, "nothing is lost by a refusal"


def test_only_other_simulation_code_is_taken_over() -> None:
    assert (
        furthest({"one": some_entry()}, {**IDENTITY, "simulation": "new"}, restart=False, same_bits=True)
        == some_entry()
    )
    with pytest.raises(InputError, match="av_hash"):
        furthest({"one": some_entry()}, {**IDENTITY, "av_hash": "b"}, restart=False, same_bits=True)
    with pytest.raises(InputError, match="av_hash") as refused:
        furthest(
            {"one": some_entry()}, {**IDENTITY, "av_hash": "b", "simulation": "new"}, restart=False, same_bits=True
        )
    assert "--same-bits" not in str(refused.value), "it would not help"


@pytest.mark.usefixtures("small")
def test_tables_go_between_the_marks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# Results\n{IN_DOCUMENT.begin}\nwhat was there\n{IN_DOCUMENT.end}\nafter\n")
    assert run(tmp_path, "r", "--tests", "1", "--write", str(page)) == 0
    text = page.read_text()
    assert text.startswith(f"# Results\n{IN_DOCUMENT.begin}\n")
    assert text.endswith(f"{IN_DOCUMENT.end}\nafter\n")
    assert "| idm-mobil-blind, 3 lanes | 3,000 |" in text
    assert "what was there" not in text
    page.write_text("no marks")
    with pytest.raises(SystemExit):
        run(tmp_path, "r", "--write", str(page))
    assert IN_DOCUMENT.begin in capsys.readouterr().err


# --- tables ---


def test_tables_hold_what_can_be_reckoned_by_hand() -> None:
    base, varied = SETTINGS[0], next(s for s in SETTINGS if s.name == "model-overlook-10")
    few, many = some_entry(1), some_entry(1)
    many = replace(many, counts=replace(many.counts, tests=50))
    text = render({base.name: few, varied.name: many}, SETTINGS)
    assert "| idm-mobil, 3 lanes | 100 | 1 | 1.00e-02 (2.53e-04 to 5.45e-02) |" in text  # Clopper-Pearson, 1 of 100
    assert "| sideswipe | 1 (100 %) |" in text
    assert "| BV changes lanes into the side of the AV | 1 (100 %) |" in text
    # 2 BV-BV crashes in 920 BV-miles
    assert "2.17e-03 (2.63e-04 to 7.85e-03)" in text
    # 1 of 50 against 1 of 100: ratio 2, and 1 of 2 has the interval 0.0126 to 0.9874
    row = next(line for line in text.splitlines() if line.startswith("| overlook x 10 |"))
    assert "2.00 (0.03 to 156.99) | 1 of 1 |" in row
    assert "`idm-mobil-2-lanes`" in text.splitlines()[-1]
    assert render({}, SETTINGS).startswith("The ledger is empty")


def test_the_committed_ledger_can_be_read_and_names_settings_of_the_list() -> None:
    entries = read_ledger(ground_truth.LEDGER)
    assert set(entries) <= {setting.name for setting in SETTINGS}
    assert math.isfinite(sum(entry.counts.seconds for entry in entries.values()))


def test_the_list_is_the_one_that_was_asked_for() -> None:
    names = [setting.name for setting in SETTINGS]
    assert len(set(names)) == len(names)
    wanted = {(s.av, s.lanes): s.tests for s in SETTINGS if s.variation is None}
    assert wanted[("idm-mobil", 3)] >= 3e8
    assert min(wanted[(av, n)] for av in ("idm-mobil", "idm-mobil-d2rl") for n in (2, 3)) >= 1e8
    assert {("idm-mobil-blind", 2), ("idm-mobil-blind", 3)} < set(wanted)
    factors = {name: {s.variation.factor for s in SETTINGS if s.variation and s.variation.field == name}
               for name in ("overlook", "overlook_conflict", "prior_strength")}  # fmt: skip
    assert factors["overlook"] == factors["overlook_conflict"] == {0.0, 0.5, 2.0, 10.0}
    assert factors["prior_strength"] == {50.0, 1000.0}


def test_crashes_are_counted_by_their_time_into_the_test() -> None:
    assert "crashes enough" in render({SETTINGS[0].name: some_entry(39)}, SETTINGS)
    text = render({SETTINGS[0].name: some_entry(40)}, SETTINGS)  # at 0.5, 3.0, 5.5, 8.0, 10.5 s, ... of 4,000 tests
    for row in ("| 0 to 2 s | 1: 125.000 (3.165 to 696.45", "| 6 to 8 s | 1: 125.000", "| 8 to 10 s | 0: 0.000"):
        assert row in text
    assert "| after 10 s | 36 |" in text
