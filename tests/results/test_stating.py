"""Results: every field says its unit and meaning, and a result and its JSON are the same."""

from __future__ import annotations

import dataclasses
import importlib
import json
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import cornerforge
from cornerforge import results
from cornerforge.errors import FileFormatError
from cornerforge.results import FILES, VERBS, NaturalRate, NddValidated, Queried, RunDone, Simulated, as_json, from_json
from cornerforge.results.analysis import Cluster
from cornerforge.results.learning import TrainingCurve
from cornerforge.results.rates import Rate
from cornerforge.results.reading import JsonFile
from cornerforge.results.stating import results_markdown
from cornerforge.results.validation import TrafficDistances

MODULES = [importlib.import_module(f"{results.__name__}.{one.name}") for one in pkgutil.iter_modules(results.__path__)]
CLASSES = [
    thing
    for module in MODULES
    for name in module.__all__
    if isinstance(thing := getattr(module, name), type) and thing is not JsonFile
]
KINDS = [pytest.param(kind, id=kind.__name__) for kind in CLASSES]
RATE = Rate(
    tests=2, crashes_per_test=0.5, interval95=(0.0, 1.0), crashes_per_mile=None, interval95_per_mile=None, miles=0.0
)


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_says_its_unit_and_meaning(kind: type) -> None:
    assert kind.__doc__
    for one in dataclasses.fields(kind):
        assert set(one.metadata) - {"within", "each", "or_empty"} == {"unit", "meaning"}, one.name
        assert "within" not in one.metadata or "0 to 1" in one.metadata["meaning"], one.name
        assert one.metadata["meaning"].endswith("."), one.name
        assert "|" not in one.metadata["meaning"] + one.metadata["unit"], f"{one.name} would break the table"
        assert one.default in (None, dataclasses.MISSING), "a field that may be missing is None then"
        may_be_null = one.default is not None and ("None" in str(one.type) or "Any" in str(one.type))
        assert ("null" in one.metadata["meaning"]) == may_be_null, f"{one.name}: say when it is null"


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers())
DISTANCES = st.builds(TrafficDistances, **{one.name: st.just({}) for one in dataclasses.fields(TrafficDistances)})
DRAWN: dict[type, st.SearchStrategy[Any]] = {
    Queried: st.builds(Queried, rows=st.lists(st.lists(VALUES).map(tuple)).map(tuple)),
    TrainingCurve: st.builds(TrainingCurve, config=st.dictionaries(st.text(), VALUES)),
    # Its largest parts stay empty, or Hypothesis finds it too large; they are drawn as classes of their own.
    NddValidated: st.builds(NddValidated, distances=DISTANCES, traffic=st.just(())),
    RunDone: st.builds(
        RunDone,
        natural=st.builds(NaturalRate, model_uncertainty=st.none()),
        natural_cases=st.none(),
        baselines=st.just(()),
    ),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_a_result_comes_back_from_its_json(kind: type, data: st.DataObject) -> None:
    made: Any = data.draw(DRAWN.get(kind, st.from_type(kind)))
    text = json.dumps(as_json(made))
    back: Any = from_json(kind, json.loads(text))
    assert repr(back) == repr(made)  # NaN is not equal to itself
    assert json.dumps(as_json(back)) == text


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


def test_every_verb_returns_its_class() -> None:
    """By their signatures; `report` is the package of pages and `import` a word of Python: these have other names."""
    named = {"report": "make_report", "import": "import_cases"}
    for verb, kind in VERBS.items():
        name = named.get(verb, verb.replace("-", "_").replace(" ", "_"))
        said = getattr(cornerforge, name).__annotations__["return"]
        assert said == kind.__name__


def test_the_documentation_is_made_of_the_code(golden: Callable[[str, str], None]) -> None:
    """docs/results-json.md."""
    golden("../../docs/results-json.md", results_markdown(VERBS, FILES))


def test_the_documentation_says_types_units_and_parts() -> None:
    @dataclass(frozen=True)
    class Outer:
        """One thing."""

        parts: tuple[Cluster, ...] = dataclasses.field(metadata={"unit": "m", "meaning": "Parts."})
        pair: tuple[float, float] | None = dataclasses.field(metadata={"unit": "", "meaning": "Null: none."})
        late: int | None = dataclasses.field(default=None, metadata={"unit": "s", "meaning": "Late."})

    Outer.__annotations__ = {
        "parts": tuple[Cluster, ...], "pair": tuple[float, float] | None, "late": int | None,
    }  # fmt: skip
    lines = results_markdown({"try": Outer}, {}).splitlines()
    assert "## `try`" in lines
    assert "| `parts` | list of [Cluster](#cluster) | m | Parts. |" in lines
    assert "| `pair` | [number, number] or null |  | Null: none. |" in lines
    assert "| `late` | integer, may be missing | s | Late. |" in lines
    assert lines.count("### Cluster") == 1


def test_a_verbs_keys_are_in_the_page() -> None:
    page = results_markdown(VERBS, FILES)
    section = page.split("## `simulate`")[1].split("\n## ")[0]
    for one in dataclasses.fields(Simulated):
        assert f"| `{one.name}` |" in section
