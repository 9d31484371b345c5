"""How often natural cases happen: `analyse` on crashes of natural traffic, counted or weighted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import InputError
from cornerforge.rates import poisson_interval
from cornerforge.rates.natural import natural_shares
from cornerforge.results import Analysed
from cornerforge.types import Odd

MILES = 400.0 / 1609.344
"""Of one test at full length."""


@pytest.fixture(scope="module")
def counted(
    reckless_model: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, cornerforge.results.NaturalRate]:
    """Crashes of counted natural tests, in a world in which they are frequent."""
    folder = tmp_path_factory.mktemp("counted") / "rate"
    return folder / "library", cornerforge.rate(
        odd="paper", lanes=2, model=reckless_model, method="mc", max_tests=40_000, target_rhw=0.001, seed=3, out=folder
    )


@pytest.fixture(scope="module")
def analysed(counted: tuple[Path, cornerforge.results.NaturalRate]) -> Analysed:
    return cornerforge.analyse(counted[0], avoidability=20)


@pytest.mark.full
def test_counted_cases_have_the_rates_that_were_counted(
    counted: tuple[Path, cornerforge.results.NaturalRate], analysed: Analysed
) -> None:
    found, natural = counted[1], analysed.natural
    crashes = sum(found.crash_types.values())
    assert natural is not None
    assert natural.effective_cases == pytest.approx(analysed.cases)
    assert natural.all.cases == analysed.cases > 50
    assert natural.all.crashes_per_test == pytest.approx(found.crashes_per_test)
    assert natural.all.miles_between == pytest.approx(MILES / found.crashes_per_test)
    if analysed.cases == crashes:
        assert natural.all.interval95 == pytest.approx([end / found.tests for end in poisson_interval(crashes)])
    shares = {name: kind.share for name, kind in natural.crash_types.items()}
    assert shares == pytest.approx({name: n / analysed.cases for name, n in analysed.crash_types.items() if n})
    assert set(natural.mechanisms) == {name for name, n in found.mechanisms.items() if n}
    for kinds in (natural.clusters, natural.crash_types, natural.mechanisms, natural.fault):
        rates = [kind.crashes_per_test for kind in kinds.values()]
        assert sum(rates) == pytest.approx(found.crashes_per_test)
        assert rates == sorted(rates, reverse=True)
    assert natural.avoidable is not None
    assert natural.avoidable_after_s == 1.0
    assert analysed.judges is not None
    assert natural.avoidable.share == pytest.approx(analysed.judges.lead.share)
    assert natural.avoidable.cases == round(20 * natural.avoidable.share)
    assert 0.0 < natural.serious_injuries.share < analysed.severity["av_injury_probability"]["99"]


@pytest.mark.full
def test_typical_cases_of_what_happens_most_come_first(
    counted: tuple[Path, cornerforge.results.NaturalRate], analysed: Analysed
) -> None:
    assert analysed.natural is not None
    typical = {str(cluster.id): cluster.typical for cluster in analysed.clusters}
    first = [typical[name][0] for name in analysed.natural.clusters][:10]
    shown = [one.case_id for one in analysed.value.top]
    assert analysed.purpose == "road"
    assert shown[: len(first)] == first
    attack = cornerforge.analyse(counted[0], avoidability=20, purpose="attack")
    values = [one.value for one in attack.value.top]
    assert values == sorted(values, reverse=True)
    assert attack.natural == analysed.natural


def test_weights_make_the_shares() -> None:
    weights = np.array([4e-7, 1e-7, 1e-7, 2e-7])
    found = natural_shares(
        weights,
        Odd(),
        kinds={
            "clusters": ["0", "0", "1", "1"],
            "crash_types": ["angle", "sideswipe", "sideswipe", "sideswipe"],
            "mechanisms": [None, None, None, None],
            "fault": ["bv", "bv", "av", "bv"],
            "conducts": ["none", "brakes-late", "none", "none"],
        },
        prevented={"fsm": np.array([True, False, True, False]), "fsm, by braking": np.zeros(4, np.bool_)},
        avoidable=np.array([True, True, True, True]),
        avoidable_after_s=0.5,
        looked_at=np.array([False, True, False, True]),
        injury=np.array([0.0, 0.0, 0.5, 0.0]),
    )
    assert found.effective_cases == pytest.approx(64 / 22)
    assert found.all.crashes_per_test == pytest.approx(8e-7)
    assert list(found.clusters) == ["0", "1"]
    assert found.crash_types["angle"].share == pytest.approx(0.5)
    assert found.crash_types["sideswipe"].cases == 3
    assert found.crash_types["sideswipe"].miles_between == pytest.approx(MILES / 4e-7)
    low, high = found.crash_types["angle"].interval95
    # One crash seen, which weighs 4e-7: Garwood's interval of one.
    assert (low / 4e-7, high / 4e-7) == pytest.approx(poisson_interval(1))
    assert found.mechanisms == {}
    assert found.fault["av"].share == pytest.approx(0.125)
    assert found.conducts is not None
    assert found.conducts["brakes-late"].cases == 1
    assert found.prevented_by is not None
    assert found.prevented_by["fsm"].share == pytest.approx(0.625)
    assert list(found.prevented_by) == ["fsm"]
    assert found.avoidable is not None
    assert found.avoidable_after_s == 0.5
    assert found.avoidable.crashes_per_test == pytest.approx(8e-7)  # both that were drawn, which stand for all
    assert found.serious_injuries.crashes_per_test == pytest.approx(0.5e-7)


def test_without_a_drawn_way_out_nothing_is_said_of_avoidable() -> None:
    nobody = np.zeros(2, np.bool_)
    kinds = {name: ["0", "0"] for name in ("clusters", "crash_types", "mechanisms", "fault", "conducts")}
    found = natural_shares(
        np.full(2, 1e-7), Odd(), kinds=kinds, prevented={}, avoidable=nobody, avoidable_after_s=1.0, looked_at=nobody,
        injury=np.full(2, 0.1),
    )  # fmt: skip
    assert found.avoidable is None


def test_a_rate_without_crashes_says_how_to_get_some(tmp_path: Path) -> None:
    assert cornerforge.rate(max_tests=50, out=tmp_path / "r").crashes_per_test == 0.0
    with pytest.raises(InputError, match=r"cornerforge rate --out .*/r --resume, and more tests"):
        cornerforge.analyse(tmp_path / "r" / "library")


@pytest.mark.full
def test_cases_of_an_adversary_have_no_natural_rate(swerve_library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain = cornerforge.analyse(swerve_library, avoidability="none")
    assert (plain.natural, plain.purpose) == (None, "attack")
    with pytest.raises(InputError, match="come from an adversary"):
        cornerforge.analyse(swerve_library, purpose="road")
    assert main(["analyse", str(swerve_library), "--for", "rode"]) == 2
    assert "purpose" in capsys.readouterr().err


@pytest.mark.full
def test_the_command_line_tells_how_often(
    counted: tuple[Path, cornerforge.results.NaturalRate], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["analyse", str(counted[0]), "--avoidability", "20", "--quiet", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["purpose"] == "road"
    assert told["natural"]["all"]["share"] == pytest.approx(1.0)
    assert main(["analyse", str(counted[0]), "--avoidability", "20"]) == 0
    text = capsys.readouterr().out
    for words in (
        "In natural traffic a touch once in ",
        "effective cases",
        "%  mechanism ",
        "typical of what happens",
    ):
        assert words in text
    assert main(["analyse", str(counted[0]), "--avoidability", "20", "--for", "attack"]) == 0
    assert "typical of what happens" not in capsys.readouterr().out
