"""A test whose traffic cannot be drawn ends whatever drives it, with its name; nothing is drawn for ever."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.adversary.worlds.drive_bv import allocate_actors, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.errors import InputError, UndrawableError
from cornerforge.experiment.setting import experiment
from cornerforge.ext.gym.batch import BvBatch
from cornerforge.library.harvester import Harvester
from cornerforge.ndd.model import NddModel
from cornerforge.rates.branching.danger import untaught
from cornerforge.rates.branching.drive import drive_trees
from cornerforge.rates.branching.population import Plan
from cornerforge.sim import (
    Recorder,
    Setting,
    allocate_scratch,
    allocate_worlds,
    controllers,
    keep_nothing,
    observe,
    reset_world,
    simulate,
    world_of,
)
from cornerforge.sim.outcome import RUNNING, UNDRAWN
from cornerforge.sim.world import n_slots

ODD = WIDE
SLOTS = n_slots(ODD)

IMPOSSIBLE = {
    "speeds in a row": {"speed_low": 40.0, "speed_high": 20.0},
    "vehicles in a row": {"follow_share": 1.0, "time_gap_median": 1e4},
}


def with_initial(setting: Setting, **changed: float) -> Setting:
    """As no model that loads has it."""
    tables = setting.tables
    return setting._replace(tables=tables._replace(initial=tables.initial._replace(**changed)))


@pytest.fixture(params=IMPOSSIBLE)
def what(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def impossible(model: NddModel, what: str) -> Setting:
    return with_initial(setting_of(model, ODD), **IMPOSSIBLE[what])


def test_a_world_says_that_its_traffic_was_not_drawn(model: NddModel, impossible: Setting, what: str) -> None:
    world, fresh = (world_of(allocate_worlds(1, SLOTS)) for _ in range(2))
    with pytest.raises(UndrawableError, match=f"cannot be drawn: 10,000 {what}"):
        reset_world(world, 3, 7, impossible)
    assert world.state["outcome"][0] == UNDRAWN
    possible = setting_of(model, ODD)
    reset_world(world, 3, 8, possible)
    reset_world(fresh, 3, 8, possible)
    assert world.state["outcome"][0] == RUNNING
    count = int(fresh.state["n_vehicles"][0])
    assert world.state.tobytes() == fresh.state.tobytes()
    assert world.vehicles[["x", "y", "speed"]][:count].tolist() == fresh.vehicles[["x", "y", "speed"]][:count].tolist()


def _by_simulate(setting: Setting) -> None:
    simulate(setting, SLOTS, seed=3, tests=4, first=7, threads=2)


def _by_harvest(setting: Setting) -> None:
    Harvester(setting, SLOTS).harvest(3, 7, 4)


def _by_recording(setting: Setting) -> None:
    Recorder(setting, ODD).record(3, 7)


def _by_trees(setting: Setting) -> None:
    plan = Plan(1e-6, 1e-9, 0.1, 0.01, 1, 30.0, 2.0, untaught(1e-6))
    drive_trees(setting, SLOTS, plan, seed=3, first=7, tests=2, threads=1)


@pytest.mark.parametrize("drive", [_by_simulate, _by_harvest, _by_recording, _by_trees])
def test_whatever_drives_it_names_the_test(impossible: Setting, drive: Callable[[Setting], None]) -> None:
    with pytest.raises(UndrawableError, match="Test 3:7: The traffic at the start of a test cannot be drawn") as said:
        drive(impossible)
    assert "\n" not in str(said.value)


def test_an_environment_names_it_and_goes_on_with_other_tests() -> None:
    run = experiment(bv="uniform")
    batch = BvBatch(run, 2, 1, 1, reward_numbers("crash"))
    possible, chosen = batch._setting, np.array([False, True])
    batch._setting = with_initial(possible, **IMPOSSIBLE["speeds in a row"])
    batch.name(1, 5, 3, lambda: 0)
    with pytest.raises(UndrawableError, match="Test 5:3: "):
        batch.begin(chosen)
    assert batch.is_over.all()
    batch._setting = possible
    batch.begin(chosen)
    assert batch.is_over.tolist() == [True, False]


def test_training_in_empty_lanes_ends(model: NddModel) -> None:
    """It went from test to test for ever."""
    setting = setting_of(model, ODD).with_drivers(critical=controllers.TOLD)
    empty = setting._replace(road=setting.road._replace(av_start=0.0, traffic_length=-1000.0))
    actors = allocate_actors(2, setting, SLOTS, observe.N_OBSERVATION)
    scratch = allocate_scratch(SLOTS, setting.who.policy)
    with pytest.raises(InputError, match="no background vehicle to control in 1000 tests"):
        start_worlds(1, 0, empty, scratch, keep_nothing(SLOTS), actors)
