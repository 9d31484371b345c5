"""Factors of the stated laws: each changes traffic where its law holds, none the AV, none a road without these laws."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hand_built import setting_of

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ndd.model import NddModel
from cornerforge.road.lanes import side_to_leave
from cornerforge.road.straight import STATED, LawFactors
from cornerforge.sim.av import merge
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import advance
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.runner import Tally, drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import allocate_worlds, n_slots, world_of
from cornerforge.types import ODDS, Odd

ON_RAMP = odd_on(Odd(), road_named("on-ramp"))
QUEUE = Odd(traffic="queue")
FAR = LawFactors(*(0.5 for _ in LawFactors._fields))
HOLDS = [(name, QUEUE if name == "warned" else ON_RAMP) for name in LawFactors._fields]


def under(setting: Setting, law: LawFactors) -> Setting:
    return setting._replace(road=setting.road._replace(law=law))


def digest(setting: Setting, odd: Odd, tests: int = 600) -> str:
    tally = Tally()
    tally.add(*drive_chunk(setting, n_slots(odd), 4, 0, tests, False))
    return tally.digest.hexdigest()


@pytest.mark.parametrize(("name", "odd"), HOLDS)
def test_each_number_changes_traffic(model: NddModel, name: str, odd: Odd) -> None:
    careless = replace(model, overlook=0.5, memory=replace(model.memory, away=0.1))
    setting = setting_of(careless, odd)
    assert digest(under(setting, STATED._replace(**{name: 0.5})), odd) != digest(setting, odd)


@pytest.mark.parametrize("odd", [ODDS["default"], ODDS["mixed"], odd_on(Odd(), road_named("curves"))])
def test_free_traffic_where_lanes_go_on_reads_none(model: NddModel, odd: Odd) -> None:
    setting = setting_of(model, odd)
    assert digest(under(setting, FAR), odd) == digest(setting, odd)


def test_the_av_keeps_its_law(model: NddModel) -> None:
    odd = odd_on(Odd(), road_named("on-ramp"), "ramp")
    setting, slots = setting_of(model, odd), n_slots(odd)
    world, scratch, keep = world_of(allocate_worlds(1, slots)), allocate_scratch(slots, NO_POLICY), keep_nothing(slots)
    other, acts, differ = under(setting, FAR).road, 0, 0
    for test in range(60):
        reset_world(world, 6, test, setting)
        advance(world, setting, scratch, keep, 6)
        if world.state["outcome"][0] != RUNNING:
            continue
        v = world.vehicles
        lane = int(v["target_lane"][0])
        stated = merge(world, 0.0, lane, setting.av, setting.road)
        assert stated == merge(world, 0.0, lane, setting.av, other)
        acts += stated != (0.0, lane)
        differ += any(
            side_to_leave(v, i, setting.road) != side_to_leave(v, i, other)
            for i in range(1, int(world.state["n_vehicles"][0])) if v["present"][i]
        )  # fmt: skip
    assert acts > 10
    assert differ > 10, "or nothing is seen of the factors"
