"""Which traffic a model may begin tests with: the declared ranges, and whether it can be drawn at all."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

from cornerforge._checksums import read_arrays, write_arrays
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.errors import FileFormatError
from cornerforge.experiment.setting import experiment
from cornerforge.ndd.initial import LEAST_ACCEPTED, InitialState, accepted_share, check_initial
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import NddModel, default_model_path, load_model
from cornerforge.sim import allocate_worlds, reset_world, simulate, world_of

HOSTILE = (math.nan, math.inf, 0, 1e-308, 10**400, "0.5")
DRIVEN = 10


def test_every_number_has_a_range_that_holds_its_default(model: NddModel) -> None:
    for part in (model, Memory(), InitialState()):
        declared = get_type_hints(type(part), include_extras=True)
        numbers = [one.name for one in fields(part) if isinstance(getattr(part, one.name), float)]
        assert numbers
        for name in numbers:
            (said,) = declared[name].__metadata__
            assert said.ge <= getattr(part, name) <= said.le, name


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"speed_low": 30.0, "speed_mean": 30.0, "speed_high": 30.0}, r"speed_sd = 1\.8 m/s about speed_low = 30"),
        ({"speed_low": 30.0, "speed_mean": 30.0, "speed_high": 30.05}, r"1\.1 % of draws .* speed_high = 30\.05"),
        ({"follow_share": 1.0, "time_gap_median": 10.0, "time_gap_sigma": 0.01}, r"above free_gap_low \(free_gap_low"),
        ({"follow_share": 1.0, "free_gap_low": 5.0}, "a follower's gap above free_gap_low"),
        ({"follow_share": 1.0, "time_gap_shift": 0.0, "time_gap_median": 0.01, "time_gap_sigma": 0.0}, "below 1 m"),
        ({"follow_share": 1.0, "min_ttc": 20.0, "speed_sd": 5.0, "rr_scale": 25.0}, r"below min_ttc \(min_ttc = 20"),
    ],
)
def test_what_can_hardly_be_drawn_is_refused_with_its_numbers(
    model: NddModel, changed: dict[str, float], named: str
) -> None:
    with pytest.raises(FileFormatError, match=named) as refused:
        replace(model, initial=replace(model.initial, **changed))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"speed_mean": 5.0}, r"speed_low = 20\.0 is above speed_mean = 5\.0"),
        ({"speed_low": 40.0, "speed_high": 20.0}, r"speed_mean = 30\.05 is above speed_high = 20\.0"),
        ({"free_gap_low": 1e4}, r"free_gap_low = 10000\.0 m is out of range; allowed: 1\.0 to 1000\.0 m"),
        ({"change_low": 20.0}, r"change_low = 20\.0 is above change_high"),
        ({"vigilance_sigma": 1.6}, r"vigilance_sigma = 1\.6 is out of range"),
        ({"min_ttc": "2"}, r"min_ttc = '2' is not allowed; give a number"),
    ],
)
def test_a_number_of_no_highway_is_refused_by_name(model: NddModel, changed: dict[str, float], named: str) -> None:
    with pytest.raises(FileFormatError, match=f"Model number {named}"):
        replace(model, initial=replace(model.initial, **changed))


@pytest.mark.parametrize("follow_share", [0.0, 0.682, 1.0])
def test_as_many_draws_suit_as_are_reckoned(model: NddModel, seed: int, follow_share: float) -> None:
    """Draws of the kernels: 1 for the lane, 1 for the mean, 1 to begin each other lane; the rest are of vehicles.

    With almost one speed for all, each vehicle beside another is drawn in one state.
    """
    law = replace(
        model.initial, stream_sd=0.0, speed_sd=0.01, time_gap_median=2.0, follow_share=follow_share, free_gap_low=90.0
    )
    run = experiment(model=replace(model, initial=law))
    world, vehicles, draws, tests = world_of(allocate_worlds(1, run.slots)), 0, 0, 2000
    state = world.state[0]
    for test in range(tests):
        reset_world(world, seed, test, run.setting)
        # One vehicle more than there is room for is drawn at each end of the AV's lane and at the front of the others.
        vehicles += int(state["n_vehicles"]) - 1 + 2 + (run.odd.n_lanes - 1)
        draws += int(state["draw"]) - 2 - (run.odd.n_lanes - 1)
    speeds = tests * run.odd.n_lanes  # of them none is refused
    share, _ = accepted_share(law, np.array([law.speed_mean]), law.speed_mean, ahead=True)
    found = vehicles / (draws - speeds)
    # H0: independent draws with this chance to suit; unit: a draw. Equally frequent values are exact to 1 / 24.
    assert abs(found - share[0]) < 0.04
    assert abs(found - 1.1 * share[0]) > 0.04 or follow_share == 0.0  # negative control


def test_the_bound_is_never_met_at_the_least_share() -> None:
    assert (1.0 - LEAST_ACCEPTED) ** 10_000 < 1e-80
    check_initial(InitialState())


def _places(header: dict[str, object]) -> Iterator[tuple[dict[str, object], str]]:
    for part in (header, header["memory"], header["initial"]):
        assert isinstance(part, dict)
        yield from ((part, name) for name, value in list(part.items()) if isinstance(value, (int, float)))


def _made(model: NddModel, header: dict[str, Any]) -> NddModel | str:
    """The model with a file's numbers, or why it is refused."""
    try:
        return replace(
            model,
            **{one: header[one] for one in ("free_pull", "lc_desire_free", "overlook", "overlook_conflict")},
            memory=Memory(**header["memory"]),
            initial=InitialState(**header["initial"]),
        )
    except FileFormatError as error:
        return str(error)


@pytest.mark.full
def test_hostile_numbers_are_refused_in_a_line_or_drive(tmp_path: Path, model: NddModel) -> None:
    """Each number of the file becomes each hostile value: no traceback, no hang, and no test that comes to nothing."""
    content = read_arrays(default_model_path(), "model")
    text = str(content["header"])
    run, path = experiment(model=model), tmp_path / "model.npz"
    refused = loaded = 0
    for k, value in itertools.product(range(len(list(_places(json.loads(text))))), HOSTILE):
        header = json.loads(text)
        part, name = list(_places(header))[k]
        if name == "schema_version":
            continue
        part[name] = value
        found = _made(model, header)
        if isinstance(found, str):
            assert "\n" not in found
            assert name in found or "memory" in found or "Hardly any" in found
            refused += 1
            if refused % 40 == 0:  # by the file too
                write_arrays(path, content | {"header": np.array(json.dumps(header))}, "the model")
                with pytest.raises(FileFormatError, match=r"model\.npz: .*" + name):
                    load_model(path)
        else:
            loaded += 1
            setting = run.setting._replace(tables=tables_of(found))
            tally = simulate(setting, run.slots, seed=1, tests=DRIVEN)
            assert tally.tests == DRIVEN
            assert tally.miles > 0.1
    assert refused > 100
    assert loaded > 20
