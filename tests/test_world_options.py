"""Options of the world: said once, the same in every verb and command."""

from __future__ import annotations

import importlib
import inspect
from dataclasses import fields
from typing import Any

import pytest
import typer

import cornerforge
from cornerforge.cli import app
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.process import DEFAULT_TIMEOUT
from cornerforge.world_options import (
    AdversaryEnvKeywords,
    AvAloneKeywords,
    AvAskedKeywords,
    AvKeywords,
    AvProcessKeywords,
    DrivingEnvKeywords,
    RoadKeywords,
    WorldKeywords,
    WorldOptions,
)

NAMES = {one.name for one in fields(WorldOptions)}
VERBS = {
    "simulate": WorldKeywords, "generate": WorldKeywords, "train": WorldKeywords, "variety": WorldKeywords,
    "run": WorldKeywords, "rate": AvKeywords, "r157": AvKeywords, "plausibility": AvKeywords, "check_av": AvKeywords,
    "train_av": RoadKeywords, "reproduce": RoadKeywords, "retest": AvAloneKeywords,
    "drive_case": AvAloneKeywords, "import_cases": AvAloneKeywords, "cases_from_data": AvAloneKeywords,
    "suite_build": AvAskedKeywords, "replay": AvProcessKeywords, "shrink": AvProcessKeywords,
}  # fmt: skip
# The model of `ndd` is what they show, check or fill.
OWN = {f"ndd_{name}": {"model"} for name in ("import", "show", "validate")}
OF_COMMANDS = {"plausibility": {"budget"}}
# Here nobody need drive: the AV is "recorded" unless one is named.
OF_COMMANDS |= {"import-cases": {"av"}, "cases-from-data": {"av"}}


def test_keywords_are_the_options() -> None:
    assert set(WorldKeywords.__annotations__) == NAMES
    assert set(AvKeywords.__annotations__) == NAMES - {"bounded", "budget"}
    assert set(RoadKeywords.__annotations__) == {"odd", "lanes", "model"}
    assert set(DrivingEnvKeywords.__annotations__) == {"odd", "lanes", "model", "bounded"}
    own = {"av", "av_timeout", "av_python", "av_memory"}
    assert set(AdversaryEnvKeywords.__annotations__) == {"odd", "lanes", "model", "bounded"} | own
    assert WorldOptions().av_timeout == DEFAULT_TIMEOUT


@pytest.mark.parametrize("name", [name for name in cornerforge.__all__ if name != "__version__"])
def test_no_verb_declares_an_option_of_the_world_again(name: str) -> None:
    parameters = inspect.signature(getattr(cornerforge, name)).parameters
    assert NAMES & set(parameters) == OWN.get(name, set())
    rest = [one for one in parameters.values() if one.kind is inspect.Parameter.VAR_KEYWORD]
    assert [one.annotation for one in rest] == ([f"Unpack[{VERBS[name].__name__}]"] if name in VERBS else [])


@pytest.mark.parametrize(("name", "keywords"), [("Adversary", AdversaryEnvKeywords), ("Driving", DrivingEnvKeywords)])
@pytest.mark.parametrize("module", ["single.{}Env", "vector.{}VectorEnv"])
def test_no_environment_declares_an_option_of_the_world_again(name: str, keywords: Any, module: str) -> None:
    place, kind = module.format(name).split(".")
    parameters = inspect.signature(getattr(importlib.import_module(f"cornerforge.ext.gym.{place}"), kind)).parameters
    assert not NAMES & set(parameters)
    assert parameters["world"].annotation == f"Unpack[{keywords.__name__}]"


def test_an_option_has_one_type() -> None:
    for keywords in (AdversaryEnvKeywords, DrivingEnvKeywords):
        assert keywords.__annotations__.items() <= WorldKeywords.__annotations__.items()


def commands() -> dict[str, Any]:
    program: Any = typer.main.get_command(app)
    found = {name: command for name, command in program.commands.items() if name not in ("ndd", "suite", "cases")}
    found["import-cases"] = found.pop("import")
    return found | {
        "suite-build": program.commands["suite"].commands["build"],
        "cases-from-data": program.commands["cases"].commands["from-data"],
    }


def test_every_command_has_the_defaults_and_the_help_of_the_options() -> None:
    seen = set()
    for name, command in commands().items():
        for parameter in command.params:
            own = parameter.param_type_name == "argument" or parameter.name in OF_COMMANDS.get(name, ())
            if parameter.name not in NAMES or own:
                continue
            (one,) = (one for one in fields(WorldOptions) if one.name == parameter.name)
            assert (parameter.default, parameter.help) == (one.default, one.metadata["help"]), name
            seen.add((name, parameter.name))
    assert len(seen) > 35
    for name, keywords in VERBS.items():
        if name == "drive_case":
            continue  # a function for tests of one's own; the command is retest
        command = name.replace("_", "-")
        missing = set(keywords.__annotations__) - {option for command_, option in seen if command_ == command}
        allowed = {"check-av": {"av", "model"}, "variety": {"bounded"}, "r157": {"model"}}
        allowed |= {"import-cases": {"av"}, "cases-from-data": {"av"}}
        assert missing == allowed.get(command, set()), command


def test_keywords_go_before_the_world_and_unknown_ones_are_refused() -> None:
    world = WorldOptions(lanes=4, odd="swift")
    run = experiment(world, odd="paper")
    assert (run.odd.n_lanes, run.odd.name) == (4, "paper")
    assert experiment(world).odd.name == "swift"
    rate: Any = cornerforge.rate  # mypy would refuse these, too
    with pytest.raises(TypeError, match="lane"):
        rate(max_tests=10, lane=4)
    with pytest.raises(TypeError, match="bounded"):
        rate(max_tests=10, bounded=True)


def test_without_mask_leaves_the_rest() -> None:
    world = WorldOptions(av="rl", lanes=2, bounded=True, budget=5.0)
    assert world.without_mask() == WorldOptions(av="rl", lanes=2)
