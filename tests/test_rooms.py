"""Packages with a door: a module outside takes only what the package's `__init__` gives.

That is the names of its `__all__`, and those of its modules that it lists as MODULES.
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import cornerforge

PACKAGE = Path(cornerforge.__file__).parent
INNER = ["cornerforge.adversary.worlds", "cornerforge.counterfactual", "cornerforge.rates.branching", "cornerforge.sim"]
"""Rooms with names at the door only."""
OPEN = [
    f"cornerforge.{room}"
    for room in ("adversary", "experiment", "ext.evidence", "ext.pictures", "foreign", "ndd", "rates", "road")
]
"""Rooms with modules that are doors too; the names at their own doors are for programs."""
ROOMS = [*INNER, *OPEN]


def folder_of(room: str) -> Path:
    return PACKAGE.joinpath(*room.split(".")[1:])


def modules_outside(room: str) -> Iterator[Path]:
    folder = folder_of(room)
    assert (folder / "__init__.py").is_file()
    return (path for path in sorted(PACKAGE.rglob("*.py")) if folder not in path.parents)


@cache
def nodes_of(source: str) -> list[ast.AST]:
    """The imports, texts and attributes of names in a module, in any order."""
    of_names = (ast.Import, ast.ImportFrom, ast.Constant, ast.Attribute)
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, of_names)]


@cache
def given_by_modules(room: str) -> set[str]:
    """Full names that the door's MODULES give, in rooms within them too."""
    found = set[str]()
    for module in getattr(importlib.import_module(room), "MODULES", ()):
        inner = importlib.import_module(f"{room}.{module}")
        found |= {f"{inner.__name__}.{name}" for name in inner.__all__} | given_by_modules(inner.__name__)
    return found


def breaches(source: str, room: str) -> list[str]:
    """What a module outside `room` takes past its door, in the order of the lines.

    A module that the door gives is a door of its own: only the names of its `__all__` are taken from it.
    """
    nodes = nodes_of(source)
    given = importlib.import_module(room)
    found: list[tuple[int, str]] = []
    whole: dict[str, ModuleType] = {}
    for node in nodes:
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
                    if name not in given_by_modules(room):
                        found.append((node.lineno, name))
                elif node.module != room:
                    continue
                elif one.name not in given.__all__:
                    found.append((node.lineno, name))
                elif isinstance(getattr(given, one.name), ModuleType):
                    whole[one.asname or one.name] = getattr(given, one.name)
    for node in nodes:
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
    imports = (node for node in nodes_of(source) if isinstance(node, ast.ImportFrom) and node.module == room)
    return {one.name for node in imports for one in node.names}


@pytest.mark.parametrize("room", [*OPEN, "cornerforge.sim"])
def test_a_door_says_what_it_gives_is_for(room: str) -> None:
    given = importlib.import_module(room)
    said = str(given.__doc__)
    for name in getattr(given, "MODULES", ()) or given.__all__:
        assert re.search(rf"`([\w.]+\.)?{name}(\.\w+)?`", said), f"the docstring does not say what {name} is for"


@pytest.mark.parametrize("room", INNER)
def test_a_door_gives_nothing_that_no_room_takes(room: str) -> None:
    given = importlib.import_module(room)
    used = set[str]().union(*(taken(path.read_text(encoding="utf-8"), room) for path in modules_outside(room)))
    assert set(given.__all__) - used <= set(getattr(given, "FOR_PROGRAMS", ())), (
        "take these out of `__all__` of its __init__.py"
    )


@pytest.mark.parametrize("room", OPEN)
def test_other_rooms_use_each_module_at_a_door(room: str) -> None:
    sources = [path.read_text(encoding="utf-8") for path in modules_outside(room)]
    for module in importlib.import_module(room).MODULES:
        assert any(taken(source, f"{room}.{module}") for source in sources), f"take {module} out of MODULES"
