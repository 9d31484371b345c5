"""What users may rely on: names that the doors of cornerforge (its packages, its modules) give, in a checked-in list.

A name that appears or goes changes the list, hence the diff that a reviewer reads. `make golden` writes it again. What
a module within a package has in its `__all__` is for the other packages, and may change without a word; so may names
that a module outside these packages leaves out of its `__all__`.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from pathlib import Path

import pytest

import cornerforge

LISTED = Path(__file__).parent / "public_api.txt"


def public_modules() -> list[str]:
    found = pkgutil.walk_packages(cornerforge.__path__, prefix="cornerforge.")
    names = ["cornerforge", *(module.name for module in found)]
    return sorted(name for name in names if not any(part.startswith("_") for part in name.split(".")))


def doors() -> list[str]:
    return [name for name in public_modules() if name.count(".") <= 1]


def names_of(modules: list[str]) -> list[str]:
    return sorted(
        f"{module}.{name}" for module in modules for name in getattr(importlib.import_module(module), "__all__", ())
    )


def promised() -> list[str]:
    """What the doors promise to programs of others: all of `__all__`, or of it `FOR_PROGRAMS` where a door says so."""
    narrow = {name: getattr(importlib.import_module(name), "FOR_PROGRAMS", None) for name in doors()}
    return sorted(
        name
        for name in names_of(doors())
        for chosen in [narrow[name.rpartition(".")[0]]]
        if chosen is None or name.rpartition(".")[2] in chosen
    )


@pytest.mark.golden
def test_public_names_are_those_of_the_list(request: pytest.FixtureRequest) -> None:
    names = promised()
    if request.config.getoption("--write-golden"):
        LISTED.write_text("\n".join(names) + "\n", encoding="utf-8")
    listed = LISTED.read_text(encoding="utf-8").split()
    added = sorted(set(names) - set(listed))
    gone = sorted(set(listed) - set(names))
    assert not added, f"public, but not in {LISTED.name}: {added}; if that is meant: make golden"
    assert not gone, (
        f"in {LISTED.name}, but no longer public: {gone}; if that is meant: make golden and a changelog line"
    )


@pytest.mark.parametrize("name", public_modules())
def test_every_module_says_what_is_public(name: str) -> None:
    module = importlib.import_module(name)
    source = Path(str(module.__file__)).read_text(encoding="utf-8")
    if not source.strip():
        return  # an empty package file offers nothing
    exported = module.__all__
    assert isinstance(exported, (list, tuple))
    assert len(set(exported)) == len(exported), f"{name}.__all__ names something twice"
    missing = [entry for entry in exported if not hasattr(module, entry)]
    assert not missing, f"{name}.__all__ names what is not there: {missing}"
    assert not [entry for entry in exported if entry.startswith("_") and entry != "__version__"]


def test_every_public_name_has_a_docstring() -> None:
    bare = []
    for dotted in names_of(public_modules()):
        module, name = dotted.rsplit(".", 1)
        thing = getattr(importlib.import_module(module), name)
        is_code = inspect.isclass(thing) or inspect.isroutine(thing) or hasattr(thing, "py_func")  # the last: kernels
        if is_code and not (getattr(thing, "__doc__", None) or "").strip():
            bare.append(dotted)
    assert not bare


def test_a_user_finds_the_verbs_and_reads_what_they_take() -> None:
    """Names are listed before they are loaded, and a signature says types alone, a verb's own options first."""
    assert dir(cornerforge) == sorted(cornerforge.__all__)
    taken = inspect.signature(cornerforge.simulate)
    assert list(taken.parameters)[:3] == ["tests", "bv", "acting"]
    assert {"av", "odd", "lanes"} < taken.parameters.keys()
    assert "Annotated" not in str(taken)
