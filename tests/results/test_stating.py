"""Results: every field says its unit and meaning, and a result and its JSON are the same."""

from __future__ import annotations

import dataclasses
import importlib
import math
import pkgutil
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

import pytest
from results_page import FILES, classes_of_results, results_markdown

import cornerforge
from cornerforge import results
from cornerforge._schema import meant, unit_of
from cornerforge.errors import FileFormatError
from cornerforge.results import Simulated, as_json, from_json
from cornerforge.results.analysis import Cluster
from cornerforge.results.rates import Rate

MODULES = [importlib.import_module(f"{results.__name__}.{one.name}") for one in pkgutil.iter_modules(results.__path__)]
CLASSES = [
    thing
    for module in MODULES
    for name, thing in vars(module).items()
    if isinstance(thing, type) and thing.__module__ == module.__name__ and not name.startswith("_")
]
KINDS = [pytest.param(kind, id=kind.__name__) for kind in CLASSES]
RATE = Rate(
    tests=2, crashes_per_test=0.5, interval95=(0.0, 1.0), crashes_per_mile=None, interval95_per_mile=None, miles=0.0
)


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_says_its_unit_and_meaning(kind: type) -> None:
    assert kind.__doc__
    hints, declared = get_type_hints(kind), get_type_hints(kind, include_extras=True)
    for one in dataclasses.fields(kind):
        said = declared[one.name].__metadata__[-1]
        assert not re.match(r"Annotated\[\s*Share\b", str(one.type)) or "0 to 1" in said.description, one.name
        assert said.description.endswith("."), one.name
        assert "|" not in said.description + unit_of(said), f"{one.name} would break the table"
        assert one.default in (None, dataclasses.MISSING), "a field that may be missing is None then"
        may_be_null = one.default is not None and any(
            word in str(hints[one.name]) for word in ("None", "Optional", "Any")
        )
        assert ("null" in said.description) == may_be_null, f"{one.name}: say when it is null"


def test_what_is_no_number_comes_back_from_python() -> None:
    none = dataclasses.replace(RATE, miles=math.nan)
    assert repr(from_json(Rate, as_json(none))) == repr(none)


@pytest.mark.parametrize("kind", KINDS)
def test_keys_are_the_fields_in_their_order(kind: type) -> None:
    made = kind(**dict.fromkeys((one.name for one in dataclasses.fields(kind)), "x"))
    assert list(as_json(made)) == [one.name for one in dataclasses.fields(kind)]


def test_what_is_none_is_null_but_for_what_may_be_missing() -> None:
    assert as_json(RATE)["crashes_per_mile"] is None
    assert as_json(RATE)["interval95"] == [0.0, 1.0]
    counted = cornerforge.simulate(tests=2)
    assert counted.distributions is None
    assert not {"distributions", "cases", "library"} & set(as_json(counted))
    stored = dataclasses.replace(counted, cases=0, library="")
    assert (as_json(stored)["cases"], as_json(stored)["library"]) == (0, "")


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content.pop("tests"),
        lambda content: content.update(more=1),
        lambda content: content.update(interval95=3),
        lambda content: content.update(interval95=[1.0]),
    ],
)
def test_what_is_no_result_is_refused(damage: Callable[[dict[str, Any]], object]) -> None:
    content = as_json(RATE)
    damage(content)
    with pytest.raises(FileFormatError, match="no Rate"):
        from_json(Rate, content)


def test_results_are_not_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        RATE.tests = 3  # type: ignore[misc]


def test_the_documentation_is_made_of_the_code(golden: Callable[[str, str], None]) -> None:
    """docs/results-json.md."""
    golden("../../docs/results-json.md", results_markdown(classes_of_results(), FILES))


def test_the_documentation_says_types_units_and_parts() -> None:
    @dataclass(frozen=True)
    class Outer:
        """One thing."""

        parts: Annotated[tuple[Cluster, ...], meant("Parts.", "m")]
        pair: Annotated[tuple[float, float] | None, meant("Null: none.")]
        late: Annotated[int | None, meant("Late.", "s")] = None

    lines = results_markdown({"try": Outer}, {}).splitlines()
    assert "## `try`" in lines
    assert "| `parts` | list of [Cluster](#cluster) | m | Parts. |" in lines
    assert "| `pair` | [number, number] or null |  | Null: none. |" in lines
    assert "| `late` | integer, may be missing | s | Late. |" in lines
    assert lines.count("### Cluster") == 1


def test_a_verbs_keys_are_in_the_page() -> None:
    page = results_markdown(classes_of_results(), FILES)
    section = page.split("## `simulate`")[1].split("\n## ")[0]
    for one in dataclasses.fields(Simulated):
        assert f"| `{one.name}` |" in section
