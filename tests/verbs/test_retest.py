"""`retest`: another AV in the cases of a library, against what it does where nobody looks at libraries."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from edited_files import write_object

import cornerforge
from cornerforge import cli
from cornerforge.errors import InputError, OutputError
from cornerforge.library import CaseLibrary
from cornerforge.results import Retested
from cornerforge.verbs.retest import _Both
from cornerforge.verbs.retest_files import write_junit
from cornerforge.verbs.sentences.retest import retest_text

pytestmark = pytest.mark.full

HEEDLESS = """
import numpy as np

class Heedless:
    def act(self, view):
        return np.tile([2.0, 0.0], (len(view), 1))
"""


def crashed(av: str, out: Path, tests: int) -> set[int]:
    """Tests of the swerve library's traffic in which an AV crashes, from a library of its own."""
    cornerforge.simulate(av=av, bv="swerve", tests=tests, seed=seed_of(out.parent / "seed"), out=out)
    return set(CaseLibrary.open(out).scalars(["test"])["test"].to_pylist())


def seed_of(file: Path) -> int:
    return int(file.read_text(encoding="utf-8"))


@pytest.fixture
def place(swerve_library: Path, tmp_path: Path) -> Path:
    """A folder that knows the seed of the library."""
    seed = CaseLibrary.open(swerve_library).identity["seed"]
    (tmp_path / "seed").write_text(str(seed), encoding="utf-8")
    return tmp_path


def test_the_same_av_crashes_in_the_same_cases(swerve_library: Path) -> None:
    said = cornerforge.retest(swerve_library, av="idm-mobil")
    assert said.reacting is not None
    assert (said.fixed, said.still_crashing, said.new_crashes) == (0, said.cases, 0)
    assert said.reacting.tests == CaseLibrary.open(swerve_library).next_test
    assert said.recorded.still_crashing >= 0.95 * said.cases  # who is 150 m away was not stored
    assert not said.got_worse
    assert said.reacting.verdict in ("open", "alike")
    assert said.natural is None
    assert said.same_av
    assert said.recorded.fixed == 0
    assert "the same AV" in retest_text(said)
    assert "nothing is compared, only driven again" in retest_text(said)


def test_what_rounding_takes_is_not_called_fixed(swerve_library: Path, tmp_path: Path) -> None:
    said = cornerforge.retest(swerve_library, av="idm-mobil")
    new, old = np.ones(said.cases, np.int64), np.ones(said.cases, np.int64)
    new[:5] = 0
    both = _Both(new, old, picked=True, same=True)
    each = tuple(replace(one, recorded=kind, reacting=None) for one, kind in zip(said.each, both.kinds(), strict=True))
    said = replace(said, recorded=both.compared(), reacting=None, each=each)
    assert f"{said.cases:,} cases: of the same AV 5 do not come again: rounding of scripts, ADR 40" in retest_text(said)
    assert (said.recorded.fixed, said.recorded.rounded) == (0, 5)
    write_junit(tmp_path / "found.xml", said)
    text = (tmp_path / "found.xml").read_text(encoding="utf-8")
    assert "fixed" not in text
    assert text.count("rounding of its script, ADR 40") == 5


def test_the_av_must_be_named(swerve_library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["retest", str(swerve_library)]) == 2
    assert capsys.readouterr().err == "cornerforge: Missing option '--av'. (see: cornerforge retest --help)\n"
    with pytest.raises(TypeError, match="missing a required argument: 'av'"):
        cornerforge.retest(swerve_library)  # type: ignore[call-arg]


def test_another_av_crashes_where_it_crashes_without_the_library(swerve_library: Path, place: Path) -> None:
    library = CaseLibrary.open(swerve_library)
    old = set(library.scalars(["test"])["test"].to_pylist())
    new = crashed("idm-mobil-d2rl", place / "other", library.next_test)
    said = cornerforge.retest(swerve_library, av="idm-mobil-d2rl")
    assert (said.fixed, said.still_crashing, said.new_crashes) == (len(old - new), len(old & new), len(new - old))
    assert said.fixed > 0
    assert said.rate_difference == (len(new) - len(old)) / library.next_test
    assert said.interval95 is not None
    assert said.interval95[0] < said.rate_difference < said.interval95[1]
    for one in said.each:
        assert (one.reacting == "fixed") == (int(one.case.partition(":")[2]) in old - new)
    assert said.note is None, "nobody has learned against either"
    # the library's own AV, driven again, is the same baseline
    again = cornerforge.retest(swerve_library, av="idm-mobil-d2rl", baseline="idm-mobil", natural_tests=3_000)
    assert again.reacting == said.reacting
    assert again.natural is not None
    assert again.natural.tests == 3_000
    assert again.natural.verdict == "open"


@pytest.mark.usefixtures("in_memory")
def test_an_av_that_got_worse_fails_the_command(
    swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An AV from outside that heeds nobody."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heedless.py").write_text(HEEDLESS, encoding="utf-8")
    xml = tmp_path / "found.xml"
    words = [
        "retest",
        str(swerve_library),
        "--av",
        "heedless:Heedless",
        "--baseline",
        "idm-mobil-d2rl",
        "--natural-tests",
        "2000",
    ]
    assert cli.main([*words, "--junit", str(xml), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["got_worse"]
    assert said["natural"]["verdict"] == "worse"
    assert said["natural"]["verdict_after"] < 100
    assert said["natural"]["interval95"][0] > 0.3
    suite = ElementTree.parse(xml).getroot()
    new = [one["case"] for one in said["each"] if "new" in (one["recorded"], one["reacting"])]
    assert [case.get("name") for case in suite if case.find("failure") is not None] == [f"case {case}" for case in new]
    assert (int(suite.get("failures") or 0), int(suite.get("tests") or 0)) == (len(new), said["cases"])
    # it is not written over, and that is said before anything is driven
    assert cli.main([*words, "--junit", str(xml)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert cli.main(words) == 1
    text = capsys.readouterr().out
    assert "It got WORSE." in text
    assert "others who react" in text


def test_shrunk_cases_are_driven_as_their_scripts_say(swerve_library: Path, tmp_path: Path) -> None:
    ids = CaseLibrary.open(swerve_library).scalars(["case_id"])["case_id"].to_pylist()[:6]
    cornerforge.shrink(swerve_library, ids, out=tmp_path / "small")
    said = cornerforge.retest(tmp_path / "small", av="idm-mobil")
    assert said.reacting is None
    assert said.recorded.still_crashing == said.still_crashing == len(ids)
    assert (said.rate_difference, said.interval95, said.got_worse) == (None, None, False)


def test_threads_change_nothing(swerve_library: Path) -> None:
    def told(threads: int) -> Retested:
        return cornerforge.retest(swerve_library, av="rss-cautious", threads=threads)

    assert told(1).each == told(2).each


def test_bad_input_is_named(swerve_library: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--baseline"):
        cornerforge.retest(swerve_library, av="rl", natural_tests=100)
    (tmp_path / "empty").mkdir()
    library = CaseLibrary.open(swerve_library)
    CaseLibrary.create(tmp_path / "none", library.identity, library.odd)
    with pytest.raises(InputError, match="holds no cases yet"):
        cornerforge.retest(tmp_path / "none", av="rl")
    with pytest.raises(InputError, match="is named for two files"):
        cornerforge.retest(swerve_library, av="rl", junit=tmp_path / "x", page=str(tmp_path / "x"))
    assert not (tmp_path / "x").exists()
    with pytest.raises(InputError, match="rl is both the AV and the baseline"):
        cornerforge.retest(swerve_library, av="rl", baseline="rl")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="Cannot write"):
        cornerforge.retest(swerve_library, av="rl", junit=tmp_path / "file" / "x.xml")
    with pytest.raises(InputError, match="No module nowhere"):  # a Python is for the one AV that is not built in
        cornerforge.retest(swerve_library, av="rl", baseline="nowhere:Av", av_python=sys.executable)


def test_it_needs_to_know_where_the_old_av_crashed(swerve_library: Path, tmp_path: Path) -> None:
    for file in swerve_library.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    manifest["crashes"] += 1
    write_object(tmp_path / "manifest.json", manifest)
    with pytest.raises(InputError, match=r"holds 60 of 61 crashes.* --baseline idm-mobil"):
        cornerforge.retest(tmp_path, av="rl")


FAILS = """
import numpy as np

class Fails:
    def reset(self, worlds, seeds):
        self.bad = getattr(self, "bad", np.zeros(70000, bool))
        self.bad[worlds] = seeds % 16 == 0
    def act(self, view):
        answers = np.zeros((len(view), 2))
        answers[self.bad[: len(view)] & (view[:, 0, 0] == 1), 0] = np.nan
        return answers
"""


@pytest.mark.usefixtures("in_memory")
def test_a_test_that_the_av_spoils_is_not_fixed(
    swerve_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fails.py").write_text(FAILS, encoding="utf-8")
    said = cornerforge.retest(swerve_library, av="fails:Fails", junit="found.xml")
    assert said.reacting is not None
    assert said.reacting.left_out > 0
    failed = [one for one in said.each if one.reacting == "failed"]
    assert all(one.recorded == "failed" for one in failed)
    assert said.recorded.left_out == len(failed)
    library = CaseLibrary.open(swerve_library)
    assert said.reacting.tests + said.reacting.left_out == library.next_test
    assert ElementTree.parse("found.xml").getroot().get("errors") == str(len(failed))
