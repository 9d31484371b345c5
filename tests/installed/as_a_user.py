"""What `make wheel` does with a fresh installation that has the core dependencies only: what a user does first.

Run by the Python of that installation, which has no tools for tests:
.venv-wheel/bin/python -I tests/installed/as_a_user.py
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "my_av.py"
DATA = [
    "py.typed", "cli/front_page.json", "ndd/default_model.npz", "drivers/rl_av.safetensors", "rates/danger.npz",
    "report/templates/report.html.j2", "ext/evidence/benchmarks.csv",
]  # fmt: skip
# Of each extra a module that the core does without.
EXTRAS = {
    "analysis": "sklearn", "gym": "gymnasium", "learn": "torch", "onnx": "onnxruntime", "query": "duckdb", "ray": "ray",
    "report": "plotly", "sb3": "stable_baselines3", "video": "imageio_ffmpeg",
}  # fmt: skip
Program = Callable[..., subprocess.CompletedProcess[str]]


def program_in(folder: Path) -> Program:
    """The installed program, run in `folder`; nothing but its own installation is searched for modules."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def program(*words: str, status: int = 0) -> subprocess.CompletedProcess[str]:
        command = [str(Path(sys.executable).with_name("cornerforge")), *words]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == status, f"{' '.join(words)}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr, done.stderr
        return done

    return program


def check_place() -> None:
    """The package that is imported is the installed one, whole, and no extra is there."""
    package = importlib.import_module("cornerforge")
    place = Path(str(package.__file__)).parent
    assert place.is_relative_to(Path(sys.prefix).resolve()), f"imported from {place}, not from {sys.prefix}"
    assert sys.prefix != sys.base_prefix, "not in an environment of its own"
    assert not [name for name in DATA if not (place / name).is_file()]
    there = [extra for extra, module in EXTRAS.items() if importlib.util.find_spec(module)]
    assert not there, f"the core brings the extras {there}"
    for name in package.__all__:
        assert getattr(package, name), name  # every verb is there without any extra


def check_program(program: Program) -> None:
    assert program("--version").stdout.strip() == f"cornerforge {importlib.metadata.version('cornerforge')}"
    assert "idm-mobil" in program("avs").stdout
    assert "simulate" in program("--help").stdout


def check_driving(program: Program) -> None:
    """Tests are driven, stored, and driven again to the bit."""
    driven = json.loads(program("simulate", "--bv", "swerve", "--tests", "100", "--out", "lib", "--json").stdout)
    assert driven["tests"] == 100
    assert driven["av_crashes"] > 20, driven  # it is some 70
    again = json.loads(program("replay", "lib", "all", "--check", "--json").stdout)
    assert again["identical"]
    assert again["cases"] == driven["av_crashes"]


def check_own_av(program: Program, folder: Path) -> None:
    """An AV of the user's own, in a process of its own."""
    (folder / EXAMPLE.name).write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    own = json.loads(program("simulate", "--av", "my_av:MyAv", "--bv", "swerve", "--tests", "50", "--json").stdout)
    assert own["av_crashes"] > 10, own  # it is some 40
    assert own["av_faults"] == 0


def check_missing_extras(program: Program) -> None:
    """What needs an extra says which, in one line, and how to install it."""
    for extra, words in {
        "learn": ["train", "--out", "policy.safetensors"],
        "query": ["query", "lib", "select count(*) from cases"],
        "analysis": ["analyse", "lib"],
        "ray": ["simulate", "--engine", "ray"],
        "onnx": ["simulate", "--av", "net.onnx"],
        "video": ["replay", "lib", "0:0", "--video", "crash.mp4"],
    }.items():
        said = program(*words, status=2).stderr.strip()
        assert f'pip install "cornerforge[{extra}]"' in said, said
        assert len(said.splitlines()) == 1, said


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = program_in(folder)
        check_place()
        check_program(program)
        with ThreadPoolExecutor() as both:  # each waits for a compiler of its own
            for check in [both.submit(check_driving, program), both.submit(check_own_av, program, folder)]:
                check.result()
        (folder / "net.onnx").write_bytes(b"not looked at")
        check_missing_extras(program)
    print("The installation works with its core dependencies alone.")


if __name__ == "__main__":
    main()
