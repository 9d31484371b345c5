"""Foreign AVs through the real command line: the example, libraries, rates, check-av, and refusals."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import pytest
from stage_lines import without_stages

from cornerforge.cli import main
from cornerforge.cli.output import compiling_text
from cornerforge.experiment import forecast
from cornerforge.foreign import driver
from cornerforge.foreign.process import AvProcess

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("in_memory")]


Capture = pytest.CaptureFixture[str]
EXAMPLE = Path(__file__).parents[2] / "examples" / "my_av.py"
STRANGERS = Path(__file__).parents[1] / "avs_of_a_stranger"


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copy(EXAMPLE, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(capsys: Capture, *arguments: object) -> tuple[int, dict[str, Any], str]:
    capsys.readouterr()
    status = main([*map(str, arguments), "--json"])
    captured = capsys.readouterr()
    said = without_stages(
        captured.err.replace(f"{compiling_text()}\n", "")
    )  # depends on what earlier tests have compiled
    return status, json.loads(captured.out) if captured.out else {}, said


def test_the_example_is_short() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) < 30


@pytest.mark.processes
def test_the_example_simulates_generates_and_replays(example: Path, capsys: Capture) -> None:  # noqa: ARG001
    status, natural, err = call(capsys, "simulate", "--av", "my_av:MyAv", "--tests", 400, "--seed", 1)
    assert (status, err) == (0, "")
    assert natural["tests"] == 400
    assert natural["av_faults"] == 0
    assert natural["crashes_per_test"] < 0.05  # a time gap of 1.5 s is enough for natural traffic
    status, filled, _ = call(
        capsys, "generate", "--policy", "swerve", "--cases", 30, "--av", "my_av:MyAv", "--out", "lib"
    )
    assert status == 0
    assert filled["cases"] == 30
    status, again, _ = call(capsys, "replay", "lib", "all", "--check")
    assert (status, again["identical"], again["cases"]) == (0, True, 30)
    identity = json.loads(Path("lib/provenance.json").read_text(encoding="utf-8"))["identity"]
    assert identity["av"] == "my_av:MyAv"
    assert len(identity["av_hash"]) == 16
    with Path("my_av.py").open("a", encoding="utf-8") as file:
        file.write("# another AV\n")
    status, _, err = call(capsys, "replay", "lib", "all", "--check")
    assert status == 2
    assert "av_hash" in err


@pytest.mark.processes
@pytest.mark.filterwarnings("ignore")  # of Stable-Baselines3 itself
def test_a_network_drives_as_it_was_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    """The .zip and the .onnx of one policy, which always brakes fully: the same tests, once its numbers are known."""
    torch, sb3 = pytest.importorskip("torch"), pytest.importorskip("stable_baselines3")
    pytest.importorskip("onnxruntime")
    import gymnasium

    from cornerforge.ext.gym import DRIVING_ID

    monkeypatch.chdir(tmp_path)
    model = sb3.PPO("MlpPolicy", gymnasium.make(DRIVING_ID, actions="box"), device="cpu", seed=0)
    with torch.no_grad():
        model.policy.action_net.weight.zero_()
        model.policy.action_net.bias.copy_(torch.tensor([-5.0, 0.0]))
    model.save("brake.zip")

    class Cut(torch.nn.Module):  # type: ignore[name-defined]
        def __init__(self) -> None:
            super().__init__()
            self.policy = model.policy

        def forward(self, observation: Any) -> Any:
            return self.policy(observation, deterministic=True)[0].clamp(-1.0, 1.0)

    torch.onnx.export(Cut(), (torch.zeros(1, 13, 8),), "brake.onnx", opset_version=17, dynamo=False)
    status, _, err = call(capsys, "check-av", "brake.onnx")
    assert status == 2
    assert "brake.onnx gives -1 to 0. Is the first" in err
    driven = [
        call(capsys, "simulate", "--tests", 8, "--av", *av)[1]
        for av in (["brake.zip"], ["brake.onnx", "--av-actions", "box"], ["brake.onnx", "--av-actions", "si"])
    ]
    assert driven[0]["digest"] == driven[1]["digest"] != driven[2]["digest"]
    assert len({one["av_hash"] for one in driven if "av_hash" in one}) in (0, 3)
    found = {one["name"]: one for one in call(capsys, "check-av", "brake.zip", "--tests", 2)[1]["checks"]}
    assert found["read as"]["found"].startswith("two numbers of Box(-1, 1)")
    assert re.match(
        r"they differ by \S+ at most on \d+ views, to stable-baselines3", found["its maker's answers"]["found"]
    )
    assert found["its maker's answers"]["verdict"] == "ok"
    assert "units" not in found
    found = {one["name"]: one for one in call(capsys, "check-av", "brake.onnx", "--av-actions", "si")[1]["checks"]}
    assert found["units"]["verdict"] == "warn"
    status, _, err = call(capsys, "simulate", "--av", "rl", "--av-actions", "si", "--tests", 1)
    assert (status, "av_actions is for AVs that are not built in" in err) == (2, True)


def test_crashes_of_simulate_are_stored(avs: Path, capsys: Capture) -> None:  # noqa: ARG001
    arguments = ("simulate", "--av", "avs:Accelerates", "--tests", 150, "--stats")
    _, counted, _ = call(capsys, *arguments)
    _, stored, _ = call(capsys, *arguments, "--out", "lib")
    assert stored["cases"] == stored["av_crashes"] == counted["av_crashes"] > 10
    assert stored["digest"] == counted["digest"]
    assert counted["distributions"]["speed"]["n"] > 1000
    assert call(capsys, "replay", "lib", "all", "--check")[1]["identical"]


def test_a_random_av_is_named_when_its_case_does_not_come_again(avs: Path, capsys: Capture) -> None:  # noqa: ARG001
    status, made, err = call(
        capsys, "generate", "--policy", "swerve", "--cases", 3, "--av", "avs:Random", "--out", "lib"
    )
    assert (status, made.get("cases")) == (0, 3), (err, made)
    status, again, err = call(capsys, "replay", "lib", "all", "--check")
    assert status == 1
    assert again["identical"] is False
    assert "avs:Random is not deterministic" in err


def test_the_rate_of_a_foreign_av(avs: Path, capsys: Capture) -> None:  # noqa: ARG001
    arguments = ("rate", "--av", "avs:Accelerates", "--max-tests", 200, "--target-rhw", 0.01)
    status, first, _ = call(capsys, *arguments, "--out", "out")
    assert status == 0
    assert first["tests"] == 200
    assert first["av_crashes"] == sum(first["crash_types"].values()) > 10
    assert call(capsys, *arguments)[1]["digest"] == first["digest"]


def test_spoiled_tests_do_not_count(avs: Path, capsys: Capture) -> None:  # noqa: ARG001
    _, good, _ = call(capsys, "simulate", "--av", "avs:Good", "--tests", 200)
    status, bad, _ = call(capsys, "simulate", "--av", "avs:Raises", "--tests", 200)
    assert status == 0
    assert bad["av_faults"] >= 2
    assert bad["tests"] == 200 - bad["av_faults"]
    assert good["av_faults"] == 0
    _, filled, _ = call(capsys, "simulate", "--av", "avs:Raises", "--tests", 200, "--out", "lib")
    assert (filled["tests"], filled["av_faults"]) == (bad["tests"], bad["av_faults"])
    capsys.readouterr()
    assert main(["simulate", "--av", "avs:Raises", "--tests", "200"]) == 0
    assert f"{bad['av_faults']} tests left out, because the AV raised" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["simulate", "--av", "gone:Av"], "No module gone"),
        (["simulate", "--av", "gone.onnx"], "No AV file gone.onnx"),
        (["simulate", "--av", "avs:AlwaysRaises"], "spoiled 2"),
        (["simulate", "--av", "avs:AlwaysRaises", "--tests", "5"], "spoiled every one of 5 tests"),
        (["simulate", "--av", "avs:AlwaysRaises", "--tests", "5", "--out", "lib"], "spoiled every one of 5 tests"),
        (["simulate", "--av", "avs:Good", "--av-timeout", "0"], "av_timeout = 0.0 s is out of range"),
        (["generate", "--av", "avs:AlwaysRaises", "--policy", "swerve", "--out", "lib"], "spoiled 2"),
        (["train", "--av", "avs:AlwaysRaises", "--out", "p.safetensors"], "spoiled 2"),
        (["run", "--av", "avs:AlwaysRaises", "--out", "all"], "spoiled 2"),
        (["train", "--av", "gone:Av", "--out", "p.safetensors"], "No module gone"),
        (["check-av", "idm-mobil"], "is a built-in name or none"),
        (["check-av", "avs:np"], "is a module, not a class"),
    ],
)
def test_bad_avs_are_refused_in_plain_lines(avs: Path, capsys: Capture, arguments: list[str], text: str) -> None:  # noqa: ARG001
    status, result, err = call(capsys, *arguments)
    assert status == 2
    assert result == {}
    assert text in err
    assert "Traceback" not in err
    assert len(err.splitlines()) <= 2 + (arguments[0] == "run")  # a forecast comes first


# --- check-av ---


def verdicts(result: dict[str, Any]) -> dict[str, str]:
    return {check["name"]: check["verdict"] for check in result["checks"]}


def test_the_example_passes_check_av(example: Path, capsys: Capture) -> None:  # noqa: ARG001
    status, result, err = call(capsys, "check-av", "my_av:MyAv", "--tests", 64)
    assert (status, err) == (0, "")
    assert result["passed"]
    assert set(verdicts(result).values()) == {"ok"}
    assert [entry["worlds"] for entry in result["speed"]] == [1, 64, 256]
    assert all(entry["decisions_per_second"] > 0.0 for entry in result["speed"])
    capsys.readouterr()
    assert main(["check-av", "my_av:MyAv", "--tests", "8"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("my_av:MyAv (class, ")
    assert len(lines) == 2 + len(result["checks"]) + 3 + 1
    assert " tests/h, " in lines[-1]
    assert "training against it (2,500,000 decisions) would take about" in lines[-1]
    assert result["does"]["batch"] > 1


@pytest.mark.parametrize(("name", "verdict"), [("CutInSleeper", "warn"), ("Cautious", "ok")])
def test_check_av_remarks_that_a_vehicle_is_heeded_only_in_mid_lane(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch, name: str, verdict: str
) -> None:
    monkeypatch.syspath_prepend(str(STRANGERS))
    _, result, _ = call(capsys, "check-av", f"strangers:{name}", "--tests", 8)
    assert verdicts(result)["one comes in from the left, its side over the line"] == verdict


@pytest.mark.parametrize(
    ("name", "check", "verdict"),
    [
        ("RaisesAtOnce", "empty road", "FAIL"),
        ("Neighbours", "order of worlds", "FAIL"),
        ("Random", "repeats", "warn"),
        ("Accelerates", "lead stands still", "warn"),
        ("Accelerates", "tests in natural traffic", "warn"),
        ("Nan", "tests in natural traffic", "FAIL"),
        ("AlwaysRaises", "tests in natural traffic", "FAIL"),
    ],
)
def test_check_av_finds(avs: Path, capsys: Capture, name: str, check: str, verdict: str) -> None:  # noqa: ARG001
    status, result, _ = call(capsys, "check-av", f"avs:{name}", "--tests", 150)
    assert verdicts(result)[check] == verdict
    assert status == (0 if "FAIL" not in verdicts(result).values() else 1)
    assert result["passed"] == (status == 0)


@pytest.mark.processes
def test_check_av_of_an_av_that_hangs_ends_soon(avs: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    """One limit for the first answer, and no trial after it."""
    limits: list[float] = []
    monkeypatch.setattr(driver, "FIRST_TIMEOUT", 3.0)
    asked = AvProcess._ask

    def noted(self: AvProcess, kind: bytes, timeout: float, *parts: bytes, driving: int = 1) -> bytearray:
        limits.append(timeout)
        return asked(self, kind, timeout, *parts, driving=driving)

    monkeypatch.setattr(AvProcess, "_ask", noted)
    status, result, _ = call(capsys, "check-av", "avs:HangsAtOnce", "--av-timeout", 1)
    assert status == 1
    assert verdicts(result) == {"loads": "ok", "first questions": "FAIL", "tests in natural traffic": "FAIL"}
    assert "gave no answer within 3 s; nothing else was tried" in result["checks"][1]["found"]
    assert result["does"] is None
    assert len(limits) <= 4  # loading, setting up, and questions


SLEEPY = """
import numpy as np

class Av:
    def act(self, view):
        if (view[:, 0, 3] == 0.0).any():
            import time
            time.sleep(60)
        return np.zeros((len(view), 2))
"""


def test_check_av_stops_when_it_hangs_again_and_again(avs: Path, capsys: Capture) -> None:
    (avs / "sleepy.py").write_text(SLEEPY, encoding="utf-8")
    status, result, _ = call(capsys, "check-av", "sleepy:Av", "--av-timeout", 0.5)
    assert status == 1
    found = [check["found"] for check in result["checks"] if check["verdict"] == "FAIL"]
    assert sum("gave no answer" in text for text in found) <= 2
    assert any("gave no answer" in text for text in found)
    assert found[-1] == "not driven, because it hangs"


SLOW = """
import time
import numpy as np

class Av:
    def act(self, view):
        driving = view[:, 0, 0] == 1.0
        end = time.perf_counter() + 0.02 * np.count_nonzero(driving)
        while time.perf_counter() < end:
            pass
        return np.stack([np.where(driving, 0.3 * (30.0 - view[:, 0, 3]), 0.0), np.zeros(len(view))], axis=1)
"""


def test_long_jobs_are_announced_with_what_was_measured(
    avs: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (avs / "slow.py").write_text(SLOW, encoding="utf-8")
    arguments = ("simulate", "--av", "slow:Av", "--bv", "swerve", "--tests", 2, "--av-processes", 2)
    monkeypatch.setattr(forecast, "LONG_SECONDS", 0.0)
    status, result, err = call(capsys, *arguments)
    assert status == 0
    assert len(err.splitlines()) == 1
    told = r"slow:Av takes about \S+ m?s for an answer \(measured\), (one world|\d+ worlds) at a time, in 2 processes: "
    assert re.match(told + r"driving 2 tests will take about \S+ \S+\.$", err)
    assert call(capsys, *arguments, "--quiet")[2] == ""
    monkeypatch.setattr(forecast, "LONG_SECONDS", 1e9)
    assert call(capsys, *arguments)[1:] == ({**result, **dict.fromkeys(TIMES, ANY)}, "")


TIMES = ("seconds", "tests_per_second", "world_steps_per_second")


IN_A_FILE = """
from beside import REST


class Mine:
    def act(self, view):
        return REST.repeat(len(view), axis=0)


class Wreck:
    def act(self, view):
        return missing_name
"""


@pytest.fixture
def av_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of AVs below the current folder, with a module beside it, called like one of Python's own."""
    place = tmp_path / "my avs"
    place.mkdir()
    (place / "json.py").write_text(IN_A_FILE, encoding="utf-8")
    (place / "beside.py").write_text("import numpy\n\nREST = numpy.zeros((1, 2))\n", encoding="utf-8")
    (place / "none.py").write_text("HERE = 3\n", encoding="utf-8")
    (place / "broken.py").write_text("import no_such_thing\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return place


@pytest.mark.processes
def test_an_av_is_named_by_its_file(av_files: Path, capsys: Capture) -> None:
    for spec in ("my avs/json.py:Mine", f"{av_files}/json.py:Mine"):
        status, found, err = call(capsys, "simulate", "--av", spec, "--tests", 4)
        assert (status, found["tests"], found["av_faults"], err) == (0, 4, 0, "")
    (av_files / "c.toml").write_text('av = "json.py:Mine"\n', encoding="utf-8")
    status, found, _ = call(capsys, "simulate", "--config", "my avs/c.toml", "--tests", 4)
    assert (status, found["tests"], found["av_faults"]) == (0, 4, 0)


WRONG_FILES = {
    "my avs/gone.py:Mine": "No AV file my avs/gone.py for the AV my avs/gone.py:Mine (looked in /",
    "my avs/json.py:Min": 'No class in json.py "Min". Did you mean "Mine"?',
    "my avs/json.py:": 'No class in json.py "". Known: Mine, Wreck.',
    "my avs/none.py:Mine": 'No class "Mine" in none.py, which has none.',
    "my avs/broken.py:Mine": "Importing my avs/broken.py for the AV my avs/broken.py:Mine failed: ModuleNotFoundError",
    "my avs/json.py:REST": "my avs/json.py:REST is a ndarray, not a class",
}


@pytest.mark.parametrize("spec", WRONG_FILES)
def test_a_wrong_file_of_an_av_is_told(av_files: Path, capsys: Capture, spec: str) -> None:  # noqa: ARG001
    status, _, err = call(capsys, "simulate", "--av", spec, "--tests", 4)
    assert status == 2
    assert WRONG_FILES[spec] in err
    assert len(err.strip().splitlines()) == 1
