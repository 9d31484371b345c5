"""Kernels are compiled whole: what is called from Python once, what it calls only as parts of it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.caching import NullCache

import cornerforge._jit
from cornerforge import _kernel_cache
from cornerforge._jit import announce_compiling, inlined_kernel, kernel, kernel_by_code
from cornerforge._kernel_content import content_hash
from cornerforge._kernel_parts import _PartLibrary

CACHED = """
import numpy as np
from cornerforge.geometry import Box, boxes_overlap
boxes_overlap(Box(0.0, 0.0, 0.0, 5.0, 2.0), Box(4.0, 0.0, 0.0, 5.0, 2.0))
print(sum(boxes_overlap.stats.cache_hits.values()), sum(boxes_overlap.stats.cache_misses.values()))
"""


@inlined_kernel
def _doubled(values, i):
    return 2.0 * values[i]


@kernel
def _first(values):
    return _doubled(values, 0) + 1.0


@kernel
def _chosen(values, i):
    if i > 7:
        raise ValueError("no such value")
    return _doubled(values, i) - _doubled(values, 1)


@kernel
def _all(values, i):
    return _first(values) * _chosen(values, i)


@kernel
def _seldom(values):
    return values[0] - 1.0


@inlined_kernel
def _often(values):
    return _seldom(values) + values[1]


@kernel
def _both(values):
    return _often(values)


@kernel
def _second(values):
    return values[1]


_CODES = {"doubled": 7, "seldom": 2, "second": 4}
_by_code = kernel_by_code(_CODES, {"seldom": _seldom, "second": _second, "doubled": _first})


@kernel
def _asked(values, code):
    return _by_code(code, values)


_each: Any
for _each in (_doubled, _first, _chosen, _all, _seldom, _often, _both, _second, _asked):
    _each._cache = NullCache()  # compiled anew in every session, also in the second one of a checkout


def _versions(function: Any) -> tuple[int, int]:
    """How often it was compiled as a program, and as a part of one."""
    return len(function.overloads), len(function._part.overloads)


def test_a_program_calls_its_parts_and_python_calls_any_of_them() -> None:
    """Three levels, one part reached on two ways: values as by hand, wherever the call comes from."""
    values = np.array([3.0, 5.0, 11.0])

    assert _all(values, 2) == (2 * 3.0 + 1.0) * (2 * 11.0 - 2 * 5.0)
    assert _versions(_all) == (1, 0)
    for part in (_first, _chosen, _doubled):
        assert _versions(part) == (0, 1), "no machine code of its own, and one version for 0, 1 and i"

    assert _first(values) == 7.0
    assert _doubled(values, 1) == 10.0
    assert _first(values.astype(np.float32)) == 7.0


def test_only_an_inlined_kernel_is_melted_into_its_callers() -> None:
    """Numba hands `forceinline` on to whatever it compiles on the way: a plain kernel must not take it over."""

    def is_melted(part: Any) -> bool:
        (version,) = part._part.overloads.values()
        lowered = version.library._final_module.get_function(version.fndesc.mangled_name)
        return any(b"alwaysinline" in each for each in lowered.attributes)

    assert _both(np.array([3.0, 5.0])) == 7.0
    assert is_melted(_often)
    assert not is_melted(_seldom)


class _Links(list[Any]):
    """A list that counts how often it is walked through."""

    walks = 0

    def __iter__(self) -> Iterator[Any]:
        self.walks += 1
        return super().__iter__()


class _Linked(_PartLibrary):
    """A library without code."""

    def __init__(self, links: list[Any]) -> None:
        self.links = self._linking_libraries = _Links(links)


def test_what_a_part_links_is_asked_once_of_each() -> None:
    """Each part links all that its parts link: a walk along every way takes 2^n steps, a minute for this simulator."""
    parts: list[_Linked] = []
    for _ in range(12):
        parts.append(_Linked(parts[:]))

    assert set(parts[-1].closure()) == set(parts)
    assert [part.links.walks for part in parts] == [1] * 12


def test_a_part_that_raises_reaches_python() -> None:
    """The exception comes out of the program that the part is in."""
    with pytest.raises(ValueError, match="no such value"):
        _all(np.ones(3), 8)


def test_compiling_is_announced_once() -> None:
    """Said when the first kernel is compiled, not for those after it and not for what is there."""
    said = []
    with announce_compiling(lambda: said.append("compiling")):
        assert said == []
        _first(np.ones(3, np.int64))
        _doubled(np.ones(3, np.int64), 0)
        assert said == ["compiling"]
    _first(np.ones(3, np.int32))
    assert said == ["compiling"], "said of what is compiled within the block only"


def test_a_code_finds_its_kernel() -> None:
    values = np.array([3.0, 5.0, 11.0])
    assert [_asked(values, _CODES[name]) for name in ("doubled", "seldom", "second")] == [7.0, 2.0, 5.0]


@pytest.mark.parametrize(
    ("codes", "kernels", "named"),
    [
        (_CODES, {"seldom": _seldom, "second": _second}, "doubled: declared and without a kernel"),
        ({"seldom": 2}, {"seldom": _seldom, "second": _second}, "second: .*a kernel that is not declared"),
        ({"seldom": 2, "second": 2}, {"seldom": _seldom, "second": _second}, "the same code: .*second"),
    ],
)
def test_a_forgotten_kernel_is_an_error_and_not_another_kernel(codes: Any, kernels: Any, named: str) -> None:
    with pytest.raises(LookupError, match=named):
        kernel_by_code(codes, kernels)


def test_machine_code_is_kept_for_the_next_process(tmp_path: Path) -> None:
    """The second process reads what the first compiled."""
    seen = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", CACHED], capture_output=True, text=True, check=True,
            env={"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[1] / "src")},
        )  # fmt: skip
        seen.append(done.stdout.split())
    assert seen == [["0", "1"], ["1", "0"]]


# --- places that cannot be written, files that are not what was written ---


def _run_cached(**environment: str) -> tuple[list[str], str]:
    """The words that the program prints which calls one kernel, and its standard error."""
    done = subprocess.run(
        [sys.executable, "-B", "-c", CACHED], capture_output=True, text=True, check=True,
        env={"PYTHONPATH": str(Path(__file__).parents[1] / "src"), **environment},
    )  # fmt: skip
    return done.stdout.split(), done.stderr


@pytest.mark.full
def test_a_program_without_any_writable_place_compiles_for_itself(tmp_path: Path) -> None:
    """Package and home are read-only; a file where a folder should be stops root too."""
    package = Path(cornerforge._jit.__file__).parent
    copy = shutil.copytree(package, tmp_path / "src" / "cornerforge", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").write_text("no folder")
    (tmp_path / "home").write_text("no folder")
    words, said = _run_cached(PYTHONPATH=str(tmp_path / "src"), HOME=str(tmp_path / "home"))
    assert (words, said) == (["0", "1"], "")


def test_a_user_without_a_home_has_the_package_s_place_only(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    assert list(_kernel_cache._places()) == [Path(_kernel_cache.__file__).parent / "__pycache__"]


@pytest.mark.full
def test_a_folder_that_is_filled_and_read_only_is_read(tmp_path: Path) -> None:
    """What a container has compiled into its image is used, though nothing can be written there."""
    package = Path(cornerforge._jit.__file__).parent
    copy = shutil.copytree(package, tmp_path / "src" / "cornerforge", ignore=shutil.ignore_patterns("__pycache__"))
    place = {"PYTHONPATH": str(tmp_path / "src"), "HOME": str(tmp_path / "home")}
    assert _run_cached(**place)[0] == ["0", "1"]
    shutil.move(tmp_path / "home" / ".cache" / "cornerforge" / "kernels", copy / "kernels")
    shutil.rmtree(tmp_path / "home")
    (tmp_path / "home").write_text("no folder")
    (copy / "__pycache__").mkdir(exist_ok=True)
    (copy / "__pycache__" / "kernels").write_text("no folder")
    assert _run_cached(**place) == (["1", "0"], "")


@pytest.mark.full
def test_a_full_disk_costs_time_and_nothing_else(tmp_path: Path) -> None:
    """What cannot be kept is compiled again by the next process; one line says so."""
    limited = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))\n" + CACHED
    done = subprocess.run(
        [sys.executable, "-B", "-c", limited], capture_output=True, text=True, check=True,
        env={"PYTHONPATH": str(Path(__file__).parents[1] / "src"), "NUMBA_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    assert done.stdout.split() == ["0", "1"]
    assert done.stderr.count("Machine code cannot be kept in") == 1
    assert _run_cached(NUMBA_CACHE_DIR=str(tmp_path))[0] == ["0", "1"]


def _tripled(values: Any) -> float:
    return 3.0 * values[0]


def _emptied(file: Path) -> None:
    file.write_bytes(b"")


def _halved(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _flipped(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def _other(file: Path) -> None:
    file.write_bytes(b"\x80\x04X\x05\x00\x00\x00hello.")


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _endless(file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


@pytest.fixture
def kept_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own for machine code."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    _kernel_cache.cache_folder.cache_clear()
    yield tmp_path / "kernels"
    _kernel_cache.cache_folder.cache_clear()


@pytest.mark.parametrize("damage", [_emptied, _halved, _flipped, _other, _pipe, _endless])
def test_a_damaged_file_is_dropped_and_compiled_anew(damage: Callable[[Path], None], kept_there: Path) -> None:
    """A new kernel object reads the files as a new process would; a flipped bit of machine code is never run."""
    hits = []
    for run in range(4):
        if run == 2:
            for file in kept_there.glob("*.nbc"):
                damage(file)
        tripled: Any = kernel(_tripled)
        assert tripled(np.ones(2)) == 3.0
        hits.append(sum(tripled.stats.cache_hits.values()))
    assert hits == [0, 1, 0, 1]


def test_machine_code_in_use_stays(kept_there: Path) -> None:
    """Time of change says when a file was used last; what nothing has used for a month goes."""
    assert kernel(_tripled)(np.ones(2)) == 3.0
    (ours,) = kept_there.glob("*.nbc")
    for name, days in (("ours", 400), ("another_s", 20), ("gone", 40)):
        file = ours if name == "ours" else kept_there / f"{name}.nbc"
        file.touch()
        then = time.time() - 86400.0 * days
        os.utime(file, (then, then))
    assert kernel(_tripled)(np.ones(2)) == 3.0  # read, and so marked
    _kernel_cache._remove_unused.cache_clear()  # a process tidies once
    assert kernel(_tripled)(np.ones(2, np.int8)) == 3.0  # kept, and so tidied
    assert len([*kept_there.iterdir()]) == 3
    assert not (kept_there / "gone.nbc").exists()
    assert ours.stat().st_mtime > time.time() - 3600.0


# --- what a name of machine code depends on ---

ROOMS = {
    "low.py": """
from cornerforge._jit import inlined_kernel, kernel, shared_kernel
FACTOR = 2.0
@inlined_kernel
def scaled(x):
    return FACTOR * x
@kernel
def shifted(x):
    return max(x, 1.0) + 1.0
@shared_kernel
def squared(x):
    return x * x
""",
    "left.py": """
from rooms.low import scaled, shifted
from cornerforge._jit import kernel
@kernel
def left(x):
    \"\"\"Left.\"\"\"
    return shifted(scaled(x))
""",
    "right.py": """
from rooms.low import squared
from cornerforge._jit import kernel
@kernel
def right(x):
    return squared(x) + 2.0
""",
}
ASKED = """
from rooms.left import left
from rooms.right import right
from rooms.low import scaled, shifted, squared
compiled = (left, right, squared, scaled._part, shifted._part)
print(left(3.0), right(3.0), *(sum(k.stats.cache_misses.values()) for k in compiled))
"""


def asked_of(cache: Path, place: Path, edited: dict[str, str]) -> str:
    """Values of the kernels of sources in a folder, how many of them were compiled, and how many of their parts."""
    (place / "rooms").mkdir(parents=True, exist_ok=True)
    for name, source in {**ROOMS, **edited}.items():
        (place / "rooms" / name).write_text(source, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-B", "-c", ASKED], capture_output=True, text=True, check=True,
        env={
            "PYTHONPATH": os.pathsep.join([str(place), str(Path(__file__).parents[1] / "src")]),
            "NUMBA_CACHE_DIR": str(cache),
        },
    )  # fmt: skip
    return done.stdout.strip()


@pytest.fixture
def rooms(machine_code_of_rooms: Path, tmp_path: Path) -> Path:
    """A copy of the machine code of the sources as they stand."""
    return shutil.copytree(machine_code_of_rooms, tmp_path / "cache")


@pytest.fixture(scope="module")
def machine_code_of_rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cache = tmp_path_factory.mktemp("rooms") / "cache"
    assert asked_of(cache, tmp_path_factory.mktemp("first"), {}) == "7.0 11.0 1 1 1 1 1"
    return cache


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("room", "old", "new", "said"),
    [
        ("low.py", "FACTOR = 2.0", "FACTOR = 5.0", "16.0 11.0 1 0 0 1 0"),  # a constant
        ("low.py", "FACTOR * x", "FACTOR * x * x", "19.0 11.0 1 0 0 1 0"),  # a part
        ("low.py", "return x * x", "return x + x", "7.0 8.0 0 1 1 0 0"),  # a shared kernel
        ("low.py", "@inlined_kernel", "@kernel", "7.0 11.0 1 0 0 1 0"),  # how it is compiled
        ("left.py", "shifted(scaled(x))", "scaled(shifted(x))", "8.0 11.0 1 0 0 0 0"),  # an entry of parts
        ("right.py", "2.0", "4.0", "7.0 13.0 0 1 0 0 0"),  # an entry
        ("left.py", "Left.", "To the left.", "7.0 11.0 0 0 0 0 0"),  # a docstring
        ("left.py", "@kernel", "# why\n\n@kernel", "7.0 11.0 0 0 0 0 0"),  # a comment; all lines move
    ],
)
def test_an_edit_costs_exactly_the_kernels_and_parts_that_reach_it(
    rooms: Path, room: str, old: str, new: str, said: str, tmp_path: Path
) -> None:
    assert asked_of(rooms, tmp_path / "edited", {room: ROOMS[room].replace(old, new)}) == said


def test_a_damaged_part_is_compiled_anew(rooms: Path, tmp_path: Path) -> None:
    """Half a file of one part, and no program that holds it."""
    for file in rooms.rglob("left.left-*.nbc"):
        file.unlink()
    (part,) = (file for file in rooms.rglob("low.scaled-*.nbc"))
    part.write_bytes(part.read_bytes()[: part.stat().st_size // 2])
    assert asked_of(rooms, tmp_path / "damaged", {}) == "7.0 11.0 1 0 0 1 0"
    assert asked_of(rooms, tmp_path / "damaged", {}) == "7.0 11.0 0 0 0 0 0"


def test_the_same_sources_in_another_place_cost_nothing(rooms: Path, tmp_path: Path) -> None:
    """A clone, and a branch that is switched back."""
    assert asked_of(rooms, tmp_path / "clone", {}) == "7.0 11.0 0 0 0 0 0"
    asked_of(rooms, tmp_path / "branch", {"low.py": ROOMS["low.py"].replace("2.0", "7.0")})
    assert asked_of(rooms, tmp_path / "branch", {}) == "7.0 11.0 0 0 0 0 0"


def test_a_global_whose_content_cannot_be_told_is_an_error() -> None:
    def reads(x: float) -> float:
        return x + len(_UNTOLD)

    with pytest.raises(TypeError, match=r"reads reads _UNTOLD, of the type dict".removeprefix("reads ")):
        content_hash(reads)


_UNTOLD = {"a": 1}
