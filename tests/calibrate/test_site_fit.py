"""`site fit` on made-up drivers and people with known laws, and what is shipped of it."""

from __future__ import annotations

import gzip
import os
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from statistical_bounds import l1_bound, l1_distance

import cornerforge
from cornerforge.errors import DataError, InputError
from cornerforge.ext.calibrate.site_data import (
    SITE_FILES,
    interval_of,
    kept_apart,
    owners,
    quantiles,
    read_site_data,
    words,
)
from cornerforge.ext.calibrate.site_fit import laws_of, site_fit_text
from cornerforge.ext.calibrate.site_following import fit_following, following_of, turning_of
from cornerforge.ext.calibrate.site_people import (
    Gaps,
    critical_gap,
    encounter_chances,
    encounters_of,
    fit_encounters,
    gaps_of,
    share,
    step_back_of,
    walks_of,
)
from cornerforge.ext.calibrate.site_published import PUBLISHED
from cornerforge.results.stating import as_json, from_file
from cornerforge.site.laws import LAWS_FILE, WALK_SHARES, Laws

Floats = NDArray[np.float64]

DATA = Path(os.environ.get("CORNERFORGE_DATA", Path(__file__).parents[2].parent / "shared" / "data")) / "urban"
PAGE = Path(__file__).parents[2] / "docs" / "sites.md"

HEADWAY, STANDSTILL, ACCELERATION, BRAKING = 1.3, 2.4, 1.5, 1.8
DRIVER, PERSON = (np.log(3.0), 0.5), (np.log(1.8), 0.5)
AFTER_DRIVER, AFTER_PERSON = (np.log(5.0), 0.25), (np.log(4.0), 0.5)


def write(folder: Path, name: str, columns: dict[str, list[object]]) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.csv"
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n", encoding="utf-8")
    return path


def street(folder: Path, drivers: int, spread: float = 0.0, seed: int = 3) -> float:
    """Write pairs on a slanted street, followers that drive by the IDM, and somebody nearer in the lane beside.

    Gives the standard deviation of log headway that these drivers happen to have.
    """
    rng = np.random.default_rng(seed)
    rows: list[tuple[object, ...]] = []
    heading, drawn = 0.7, []
    for k in range(drivers):
        headway = HEADWAY * np.exp(spread * rng.standard_normal())
        drawn.append(np.log(headway))
        time = np.arange(101) / 10
        begin, swing = rng.uniform(3.0, 11.0), rng.uniform(1.0, 3.0)
        lead_v = np.maximum(0.0, begin + swing * np.sin(time * rng.uniform(0.3, 0.9)))
        lead_x = 60.0 + np.concatenate([[0.0], np.cumsum(0.05 * (lead_v[1:] + lead_v[:-1]))])
        v, gap = begin, STANDSTILL + begin * headway * rng.uniform(0.9, 1.4)
        x = lead_x[0] - gap - 4.5
        for i, t in enumerate(time):
            beside = (x + 3.0 + 0.1 * i, 3.5, v)
            for name, (along, aside, speed) in enumerate([(lead_x[i], 0.0, lead_v[i]), (x, 0.0, v), beside]):
                where = (
                    along * np.cos(heading) - aside * np.sin(heading),
                    along * np.sin(heading) + aside * np.cos(heading),
                )
                rows.append((f"USA_Town-1_{k}_T-1", 10 * k + name, t, *where, heading, speed, 4.5))
            wish = STANDSTILL + max(0.0, v * headway + v * (v - lead_v[i]) / (2.0 * np.sqrt(ACCELERATION * BRAKING)))
            a = ACCELERATION * (1.0 - (v / 15.65) ** 4 - (wish / max(lead_x[i] - x - 4.5, 0.1)) ** 2)
            faster = max(0.0, v + 0.1 * float(np.clip(a, -8.0, ACCELERATION)))
            x, v = x + 0.05 * (v + faster), faster
    names = ("scenario", "id", "t", "x", "y", "heading", "v", "length")
    write(folder, "ngsim_lankershim_clips", dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)))
    return float(np.std(drawn, ddof=1))


def encounters(folder: Path, n: int, seed: int = 5) -> Path:
    """Tell `n` stories at 12 signals: undisturbed arrival, two critical gaps, and what follows if one yields."""
    rng = np.random.default_rng(seed)
    columns: dict[str, list[object]] = {k: [] for k in ("Signal.ID", "PEDCP_ped", "Ped.Reaction", "Encroachment_Time")}
    while len(columns["Signal.ID"]) < n:
        by = rng.uniform(-10.5, 10.5)  # how much earlier the vehicle would come
        gap, own = (np.exp(m + s * rng.standard_normal()) for m, s in (DRIVER, PERSON))
        waits = ""
        if 0 < by < gap:
            time = np.exp(AFTER_DRIVER[0] + AFTER_DRIVER[1] * rng.standard_normal())
        elif by <= 0 and -by < own:
            time, waits = (
                -np.exp(AFTER_PERSON[0] + AFTER_PERSON[1] * rng.standard_normal()),
                "Stopped and waited for the vehicle",
            )
        else:
            time = -by
        if not 0.5 <= abs(time) < 10.5:
            continue
        columns["Signal.ID"].append(100 + len(columns["Signal.ID"]) % 12)
        columns["PEDCP_ped"].append(("Walk", "FDW", "SDW")[rng.integers(3)])
        columns["Ped.Reaction"].append(waits or "No obvious reaction")
        columns["Encroachment_Time"].append(int(np.sign(time) * np.floor(abs(time) + 0.5)))
    return write(folder, "utah_right_turn_conflicts", columns)


def test_followers_are_found_by_geometry_and_their_numbers_come_back(tmp_path: Path) -> None:
    street(tmp_path, 24)
    runs = following_of(read_site_data(tmp_path)["ngsim_lankershim_clips"])
    assert runs.driver.size == 24  # not the leader, not the car beside, whose way is free
    fit = fit_following(runs)
    assert fit is not None
    true = {"headway": HEADWAY, "standstill": STANDSTILL, "acceleration": ACCELERATION, "braking": BRAKING}
    assert {name: fit.values[name] for name in true} == pytest.approx(true, rel=0.02)
    assert fit.values["noise"] < 0.1
    assert fit.values["headway_spread"] < 0.15
    scores = fit.scores
    assert scores["fairly fitted IDM"].error < 0.05
    assert scores["published IDM for towns"].error > 10 * scores["fairly fitted IDM"].error
    assert scores["published IDM for towns"].beside[0] > 0.0


@pytest.mark.full
def test_drivers_that_differ_are_told_from_those_that_do_not(tmp_path: Path) -> None:
    street(tmp_path / "alike", 60)
    drawn = street(tmp_path / "differ", 60, 0.4)
    fits = {
        name: fit_following(following_of(read_site_data(tmp_path / name)["ngsim_lankershim_clips"]))
        for name in ("alike", "differ")
    }
    assert fits["alike"] is not None
    assert fits["differ"] is not None
    low, high = fits["differ"].intervals["headway_spread"]
    assert low < drawn < high
    assert fits["alike"].intervals["headway_spread"][1] < low


def test_a_few_drivers_are_too_few(tmp_path: Path) -> None:
    street(tmp_path, 5)
    tables, said = read_site_data(tmp_path), list[str]()
    assert fit_following(following_of(tables["ngsim_lankershim_clips"])) is None
    assert turning_of(tables["ngsim_lankershim_clips"]) is None
    laws, result, _ = laws_of(tables, said.append)
    assert laws.headway == PUBLISHED["headway"].value
    assert any("too few drivers" in note for note in result.notes)
    assert said == ["ngsim_lankershim_clips"]


def test_critical_gaps_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 4000
    person = np.repeat(np.arange(50), n // 50)
    own = np.exp(np.log(5.0) + 0.3 * rng.standard_normal(n))
    offered = rng.uniform(1.0, 14.0, (n, 40))
    takes = (offered > own[:, None]).argmax(axis=1)
    missed = np.array([max([0.0, *row[:k]]) for row, k in zip(offered, takes, strict=True)])
    found = critical_gap(Gaps(missed, offered[np.arange(n), takes], person))
    assert found.inconsistent == 0
    assert found.median.value == pytest.approx(5.0, rel=0.03)
    assert found.spread.value == pytest.approx(0.3, rel=0.1)
    assert found.median.low < found.median.value < found.median.high < 1.1 * found.median.value
    later = critical_gap(Gaps(missed, offered[np.arange(n), takes] + 1.0, person))
    assert later.median.low > found.median.high  # negative control


def test_the_closed_form_of_an_encounter_is_what_its_story_gives(tmp_path: Path, seed: int) -> None:
    encounters(tmp_path, 20_000, seed)
    counts = encounters_of(read_site_data(tmp_path)["utah_right_turn_conflicts"])[0].sum(axis=(0, 1))
    chances = [np.array(one) for one in (DRIVER, PERSON, AFTER_DRIVER, AFTER_PERSON)]
    expected = encounter_chances(*chances)
    assert expected.sum() == pytest.approx(1.0)
    bound = l1_bound(30, 20_000)
    assert l1_distance(counts.ravel(), expected.ravel()) < bound
    chances[0] = np.array([np.log(4.0), 0.5])
    assert l1_distance(counts.ravel(), encounter_chances(*chances).ravel()) > bound


def test_data_in_which_nobody_waits_are_too_few(tmp_path: Path) -> None:
    """No number is made of nothing: the laws stay at published values."""
    encounters(tmp_path, 400)
    path = tmp_path / "utah_right_turn_conflicts.csv"
    path.write_text(path.read_text().replace("Stopped and waited for the vehicle", "No obvious reaction"))
    assert fit_encounters(read_site_data(tmp_path)["utah_right_turn_conflicts"]) is None
    n = 80
    write(
        tmp_path, "utah_ped_crossings",
        {
            "Signal": [k % 8 for k in range(n)], "OtherBicycle": [False] * n, "CrossDist": [50] * n,
            "cross_sec": [10] * n, "VehiclesNext10": [k % 5 for k in range(n)], "CrossBehSpeed": [False] * n,
            "TimeWaitArr_ped_status": ["Solid Don't Walk"] * n, "TimeCurbDep_ped_status": ["Walk"] * n,
            "TimeWaitClean": [""] * n, "TimeCurbDep_sec_next_walk": [0] * n,
        },
    )  # fmt: skip
    assert walks_of(read_site_data(tmp_path)["utah_ped_crossings"]) is None


@pytest.mark.full
def test_laws_of_encounters_come_back_within_their_intervals(tmp_path: Path) -> None:
    encounters(tmp_path, 3000)
    fit = fit_encounters(read_site_data(tmp_path)["utah_right_turn_conflicts"])
    assert fit is not None
    for name, true in (("to_people", 3.0), ("gives_way", 1.8)):
        found = fit.values[name]
        assert found.low < true < found.high, name
        assert found.value == pytest.approx(true, rel=0.25), name
    assert fit.values["to_people"].low < fit.values["to_people on solid"].value < fit.values["to_people"].high * 1.3
    law, shares, n, signals = fit.apart
    assert (n, signals) == (750, 3)
    assert law > shares  # the law of the story beats a table of 30 shares


def test_walking_and_disobedience_are_counted(tmp_path: Path) -> None:
    solid, walk = "Solid Don't Walk", "Walk"
    n = 400
    seconds = [10 + k % 20 for k in range(n)]
    left = [k % 4 == 0 for k in range(n)]
    path = write(
        tmp_path, "utah_ped_crossings",
        {
            "Signal": [k % 8 for k in range(n)], "OtherBicycle": [k % 10 == 9 for k in range(n)],
            "CrossDist": [50] * n, "cross_sec": ["" if k % 50 == 0 else s for k, s in enumerate(seconds)],
            "VehiclesNext10": [(k // 4) % 6 for k in range(n)], "CrossBehSpeed": [k % 100 == 1 for k in range(n)],
            "TimeWaitArr_ped_status": [solid] * n, "TimeCurbDep_ped_status": [solid if one else walk for one in left],
            "TimeWaitClean": [5] * n, "TimeCurbDep_sec_next_walk": [2 if k // 24 % 2 else 9 for k in range(n)],
        },
    )  # fmt: skip
    found = walks_of(read_site_data(path.parent)["utah_ped_crossings"])
    assert found is not None
    kept = np.array([50 * 0.3048 / s for k, s in enumerate(seconds) if k % 50 and k % 10 != 9])
    assert [one.value for one in found.speeds[1:-1]] == pytest.approx(
        np.quantile(kept, WALK_SHARES[1:-1], method="inverted_cdf")
    )
    assert [one.value for one in found.leave] == pytest.approx([0.25] * 5)
    changed = sum(1 for k in range(n) if k % 100 == 1)
    time = sum(s for k, s in enumerate(seconds) if k % 50 and k % 10 != 9)
    assert found.changes.value == pytest.approx(changed / time)
    assert found.takes.value == pytest.approx(0.125, abs=0.01)  # of those that left half did so just before walk
    assert found.early.value == pytest.approx(0.125 / 0.875, abs=0.01)


def test_patience_comes_back_from_who_still_leaves_after_a_wait(tmp_path: Path, seed: int) -> None:
    """Four in ten take a gap; with vehicles about it comes late, and those whose patience ends before wait for walk."""
    rng = np.random.default_rng(seed)
    n = 8000
    busy, takes = rng.random(n) < 0.6, rng.random(n) < 0.4
    comes, patience = rng.uniform(1.0, 25.0, n) * busy, rng.exponential(12.0, n)
    leaves = takes & (comes <= patience)
    path = write(
        tmp_path, "utah_ped_crossings",
        {
            "Signal": [k % 20 for k in range(n)], "OtherBicycle": [False] * n, "CrossDist": [50] * n,
            "cross_sec": [10] * n, "CrossBehSpeed": [False] * n,
            "VehiclesNext10": [(1 + k % 5) * int(one) for k, one in enumerate(busy)],
            "TimeWaitArr_ped_status": ["Solid Don't Walk"] * n,
            "TimeCurbDep_ped_status": ["Solid Don't Walk" if one else "Walk" for one in leaves],
            "TimeWaitClean": list(np.where(leaves, comes, 30.0)), "TimeCurbDep_sec_next_walk": [20] * n,
        },
    )  # fmt: skip
    found = walks_of(read_site_data(path.parent)["utah_ped_crossings"])
    assert found is not None
    assert found.patience.n == np.count_nonzero(leaves & busy)
    assert found.patience.value == pytest.approx(12.0, rel=0.25)
    assert found.patience.low < found.patience.value < found.patience.high
    assert found.takes.value == pytest.approx(0.4, abs=0.05)


def test_step_backs_are_counted_over_the_time_on_the_lane(tmp_path: Path) -> None:
    n = 200
    path = write(
        tmp_path, "dfki_street_crossing",
        {
            "Country": ["DE"] * n, "VPN": [k % 20 for k in range(n)], "TrialType": ["baseline"] * n,
            "Environment": ["Crossing"] * n, "Dropout": [False] * n, "Timeout": [False] * n,
            "Collision": [k % 20 == 1 for k in range(n)], "Stepbacks": [int(k % 5 == 0) for k in range(n)],
            "N_Time": [2.0] * n, "S_CarGap_Near_LargestMissed": [2.0 + k % 3 for k in range(n)],
            "S_CarGap_Near_Taken": [5.0 + k % 7 for k in range(n)],
        },
    )  # fmt: skip
    table = read_site_data(path.parent)["dfki_street_crossing"]
    back = step_back_of(table)
    assert back is not None
    assert back.value == pytest.approx(1.0 - (1.0 - 40 / 50) ** 0.5)
    assert back.n == 50
    assert gaps_of(table, "JP").taken.size == 0
    assert gaps_of(table, "DE").taken.size == n


def test_quantiles_and_intervals_of_groups() -> None:
    values, weight = np.array([3.0, 1.0, 2.0, 9.0]), np.array([1.0, 1.0, 1.0, 0.0])
    assert quantiles(values, weight, [0.0, 0.34, 0.5, 1.0]).tolist() == [1.0, 2.0, 2.0, 3.0]
    owner = owners(np.array(["b", "a", "b", "c"]))
    assert owner.tolist() == [1, 0, 1, 2]
    assert kept_apart(np.arange(8)).sum() == 2
    rng = np.random.default_rng(1)
    hit, of = rng.random(400) < 0.3, np.repeat(np.arange(40), 10)
    found = share(hit, of)
    assert found.low < found.value < found.high
    assert found.value == hit.mean()
    alike = np.repeat(rng.random(40) < 0.3, 10)  # 40 groups whose members do the same tell less
    assert (
        np.diff(interval_of(lambda w: w @ np.bincount(of, alike) / (w @ np.bincount(of)), 40)) > found.high - found.low
    )


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        ("missing column", r"utah_ped_crossings\.csv lacks crossbehspeed, crossdist, .*people at signals"),
        ("cut off", r"dut_pet_events\.csv\.gz is cut off"),
        ("wrong fields", r"dut_pet_events\.csv: 1 row\(s\) with wrong number of fields, first in line 3"),
        ("no number", r"dut_pet_events\.csv: dt is no number, first in line 3"),
        ("nothing", "has none of the files"),
        ("no folder", "No folder"),
    ],
)
def test_damage_is_refused_by_name(tmp_path: Path, damage: str, says: str) -> None:
    folder = tmp_path / "data"
    if damage != "no folder":
        folder.mkdir()
    if damage == "missing column":
        write(folder, "utah_ped_crossings", {"Signal": [1], "cross_sec": [3]})
    elif damage == "cut off":
        text = "clip,dt\n" + "".join(f"a{k},{k}\n" for k in range(5000))
        (folder / "dut_pet_events.csv.gz").write_bytes(gzip.compress(text.encode())[:-200])
    elif damage == "wrong fields":
        (folder / "dut_pet_events.csv").write_text("clip,dt\na,1\nb\nc,2\n", encoding="utf-8")
    elif damage == "no number":
        (folder / "dut_pet_events.csv").write_text("clip,dt\na,1\nb,x\nc,2\n", encoding="utf-8")
    with pytest.raises(DataError, match=says):
        cornerforge.site_fit(data=folder, out=tmp_path / "laws.json")
    assert not (tmp_path / "laws.json").exists()


def test_a_missing_file_leaves_its_laws_at_published_values_by_name(tmp_path: Path) -> None:
    write(tmp_path / "data", "dut_pet_events", {"clip": ["a", "b"] * 10, "dt": [-2.0, 4.0] * 10})
    out, page = tmp_path / "laws.json", tmp_path / "fit.html"
    result = cornerforge.site_fit(data=tmp_path / "data", out=out, report=page)
    laws = from_file(Laws, out, "cornerforge site fit")
    for row in result.laws:
        value = getattr(laws, row.name)
        assert value == PUBLISHED[row.name].value, row.name
        assert row.rests_on in ("read", "recalled", "judged"), row.name
        assert row.span is not None, row.name
        middle = value[3] if isinstance(value, tuple) else value
        assert row.span[0] <= middle <= row.span[1], row.name
    assert len(result.notes) == len(SITE_FILES) - 1
    text, told = page.read_text(encoding="utf-8"), site_fit_text(result)
    for name in (file.name for file in SITE_FILES[:4]):
        assert f"{name} (" in text
        assert f"{name} (" in told
    assert result.facts[0].found == 0.5
    assert result.files == (str(out), str(page))


def test_shipped_laws_are_whole_and_the_page_tells_them() -> None:
    laws = from_file(Laws, LAWS_FILE, "cornerforge site fit")
    told = dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    values = as_json(laws)
    assert values.keys() <= told.keys()
    for name, value in values.items():
        numbers = [float(one) for one in re.findall(r"\d[\d.e-]*", told[name].split(" m")[0].split(" s")[0])]
        assert numbers == (value if isinstance(value, list) else [value]), name
    assert list(laws.walks) == sorted(laws.walks)
    assert len(laws.walks) == len(WALK_SHARES)
    assert laws != Laws()
    with pytest.raises(InputError, match=r"laws\.walks\[1\]"):
        Laws(walks=(0.7, 0.1, 1.3, 1.5, 1.9, 3.0, 4.0))


@pytest.mark.full
@pytest.mark.skipif(not DATA.is_dir(), reason=f"no data in {DATA.name}")
def test_shipped_laws_are_what_the_command_makes(tmp_path: Path) -> None:
    result = cornerforge.site_fit(data=DATA, out=tmp_path / "laws.json")
    made, shipped = (as_json(from_file(Laws, path, "")) for path in (tmp_path / "laws.json", LAWS_FILE))
    for name, value in made.items():
        assert value == pytest.approx(shipped[name], rel=2e-3), name
    by_fact = {one.fact: one for one in result.facts}
    for fact in by_fact.values():  # facts that were stated of the whole files
        if fact.stated is not None and fact.interval95 is not None and fact.fact != "within 3 s of each other, all":
            low, high = fact.interval95
            assert 0.9 * low <= fact.stated <= 1.1 * high, fact.fact
    beside = "the same minus that of the fairly fitted IDM, these laws"
    ends = by_fact[beside].interval95
    assert ends is not None
    assert ends[1] < 0.0
    assert words(read_site_data(DATA)["dut_pet_events"], "clip").size == by_fact["within 3 s of each other, the same"].n
