"""Packages with a door: a module outside takes only the names that the package's `__all__` gives."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import cornerforge

PACKAGE = Path(cornerforge.__file__).parent
ROOMS = ["cornerforge.adversary.worlds", "cornerforge.counterfactual", "cornerforge.rates.branching", "cornerforge.sim"]


def folder_of(room: str) -> Path:
    return PACKAGE.joinpath(*room.split(".")[1:])


def modules_outside(room: str) -> Iterator[Path]:
    folder = folder_of(room)
    assert (folder / "__init__.py").is_file()
    return (path for path in sorted(PACKAGE.rglob("*.py")) if folder not in path.parents)


def breaches(source: str, room: str) -> list[str]:
    """What a module outside `room` takes past its door, in the order of the lines.

    A module that the door gives is a door of its own: only the names of its `__all__` are taken from it.
    """
    tree = ast.parse(source)
    given = importlib.import_module(room)
    found: list[tuple[int, str]] = []
    whole: dict[str, ModuleType] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, one.name) for one in node.names if f"{one.name}.".startswith(f"{room}.")]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith(f"{room}."):
            found.append((node.lineno, node.value))  # for importlib
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                found.append((node.lineno, "a relative import"))
            for one in node.names:
                name = f"{node.module}.{one.name}"
                if name == room or str(node.module).startswith(f"{room}."):
                    found.append((node.lineno, name))
                elif node.module != room:
                    continue
                elif one.name not in given.__all__:
                    found.append((node.lineno, name))
                elif isinstance(getattr(given, one.name), ModuleType):
                    whole[one.asname or one.name] = getattr(given, one.name)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in whole:
            module = whole[node.value.id]
            if node.attr not in module.__all__:
                found.append((node.lineno, f"{module.__name__}.{node.attr}"))
    return [what for _, what in sorted(found)]


@pytest.mark.parametrize("room", ROOMS)
def test_other_rooms_come_in_by_the_door(room: str) -> None:
    past = {
        str(path.relative_to(PACKAGE)): found
        for path in modules_outside(room)
        if (found := breaches(path.read_text(encoding="utf-8"), room))
    }
    assert not past, f"import these by `from {room} import ...`, after `__all__` of its __init__.py gives them"


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from cornerforge.sim import World", []),
        ("from cornerforge.sim import lockstep\nlockstep.see", []),
        ("from cornerforge.simulator import World", []),
        ("from cornerforge.sim.world import World", ["cornerforge.sim.world.World"]),
        ("def f():\n    from cornerforge.sim.world import World", ["cornerforge.sim.world.World"]),
        ("from cornerforge.sim import world", ["cornerforge.sim.world"]),
        ("from cornerforge.sim import no_such_name", ["cornerforge.sim.no_such_name"]),
        ("import cornerforge.sim.world", ["cornerforge.sim.world"]),
        ("import cornerforge.sim as s", ["cornerforge.sim"]),
        ("from cornerforge import sim", ["cornerforge.sim"]),
        ("from ..sim import world", ["a relative import"]),
        ("importlib.import_module('cornerforge.sim.world')", ["cornerforge.sim.world"]),
        ("from cornerforge.sim import lockstep as a\na.kernel", ["cornerforge.sim.lockstep.kernel"]),
    ],
)
def test_a_way_past_the_door_is_seen(source: str, found: list[str]) -> None:
    assert breaches(source, "cornerforge.sim") == found


@pytest.mark.parametrize("room", ROOMS)
def test_a_name_never_means_two_things(room: str) -> None:
    """A function under the name of a module would be the module, once that is imported."""
    given = importlib.import_module(room)
    inside = {path.stem for path in folder_of(room).glob("*.py")}
    for name in inside & set(given.__all__):
        assert getattr(given, name) is importlib.import_module(f"{room}.{name}")


def taken(source: str, room: str) -> set[str]:
    """The names that a module takes from a room's door."""
    imports = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom) and node.module == room)
    return {one.name for node in imports for one in node.names}


@pytest.mark.parametrize("room", ROOMS)
def test_a_door_gives_nothing_that_no_room_takes(room: str) -> None:
    given = importlib.import_module(room)
    used = set[str]().union(*(taken(path.read_text(encoding="utf-8"), room) for path in modules_outside(room)))
    assert set(given.__all__) - used <= set(getattr(given, "FOR_PROGRAMS", ())), (
        "take these out of `__all__` of its __init__.py"
    )
