"""Options of the world: said once, the same in every verb and command."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest
import typer

import cornerforge
from cornerforge._options import options_of
from cornerforge.cli import app
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.process import DEFAULT_TIMEOUT
from cornerforge.world_options import (
    AdversaryEnvOptions,
    AvAloneOptions,
    AvAskedOptions,
    AvOptions,
    AvProcessOptions,
    DrivingEnvOptions,
    RoadOptions,
    WorldOptions,
)

NAMES = {one.name for one in fields(WorldOptions)}
# Here the AV is "recorded" unless one is named, or it is an argument.
OTHER_AV = {"check-av", "import", "cases from-data", "retest"}
# The model of `ndd` is what they show, check or fill; `plausibility` takes several budgets; that of `reproduce` is of
# its bounded adversaries alone.
OWN = {
    "plausibility": {"budget"}, "reproduce": {"budget"}, "ndd import": {"model"}, "ndd show": {"model"},
    "ndd validate": {"model"}, "import": {"road"}, "road import": {"road"}, "road check": {"road"},
    "road show": {"road"}, "site check": {"site"}, "site show": {"site"},
    "site validate": {"site", "site_traffic", "site_laws"},
}  # fmt: skip


def names(options: type) -> set[str]:
    return {one.name for one in fields(options)}


def test_parts_of_a_world_are_options_of_the_world() -> None:
    asked = {"av_timeout", "av_python", "av_memory", "av_actions", "av_statistics"}
    road = {"odd", "lanes", "road", "task", "traffic", "perception", "model", "site", "site_traffic", "site_laws"}
    assert names(RoadOptions) == road
    assert names(AvProcessOptions) == asked
    assert names(AvAskedOptions) == asked | {"av_batch", "av_processes"}
    assert names(AvAloneOptions) == names(AvAskedOptions) | {"av"}
    assert names(AvOptions) == names(AvAloneOptions) | road == NAMES - {"bounded", "budget", "budget_of", "steer_from"}
    assert names(DrivingEnvOptions) == road | {"bounded"}
    assert names(AdversaryEnvOptions) == names(DrivingEnvOptions) | asked | {"av"}
    assert WorldOptions().av_timeout == DEFAULT_TIMEOUT


def test_a_part_of_a_world_is_the_world_with_defaults() -> None:
    assert RoadOptions(lanes=4).world() == WorldOptions(lanes=4)
    assert AvProcessOptions(av_timeout=2.0).world() == WorldOptions(av_timeout=2.0)


def commands() -> dict[str, Any]:
    program: Any = typer.main.get_command(app)
    found: dict[str, Any] = {}
    for name, command in program.commands.items():
        below = getattr(command, "commands", None)
        found |= {name: command} if below is None else {f"{name} {one}": child for one, child in below.items()}
    return found


def test_every_command_has_the_defaults_and_the_help_of_the_options() -> None:
    meant = {one.name: (one, option) for one, _, option in options_of(WorldOptions)}
    seen = set()
    for name, command in commands().items():
        for parameter in command.params:
            own = parameter.name in OWN.get(name, ()) or (parameter.name == "av" and name in OTHER_AV)
            if parameter.name not in NAMES or own:
                continue
            one, option = meant[parameter.name]
            assert parameter.default == one.default, name
            assert parameter.help.startswith((option.description or "").rstrip(".")), name
            seen.add((name, parameter.name))
    assert len(seen) > 100


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
