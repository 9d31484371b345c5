"""Settings and worlds that tests of the simulator build by hand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cornerforge.drivers.avs import AvModel, av_named, numbers_of_av
from cornerforge.drivers.naturalistic import NddTables, tables_of
from cornerforge.drivers.policy import NO_POLICY, PolicyNumbers
from cornerforge.geometry import path_at
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import RoadNumbers, lane_bits, road_numbers
from cornerforge.sim.actions import hold, start_lane_change
from cornerforge.sim.controllers import ADVERSARIES, IDM_BVS, NATURALISTIC, Controllers
from cornerforge.sim.motion import move_vehicle, path_of
from cornerforge.sim.observe import budget_units
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.scripted import TRAITS
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import NO_VEHICLE, World, all_current, allocate_worlds
from cornerforge.sim.world import world_of as world_of_batch
from cornerforge.types import Odd

__all__ = ["WIDE", "Car", "change_lane", "glide", "reckless_drivers", "setting_of", "world_of"]

WIDE = Odd(lane_width=4.0)
"""Road on which worlds by hand stand: centres of its lanes are at 2, 6 and 10 m."""
_tables: dict[object, tuple[NddModel, NddTables]] = {}
_MOST_TABLES = 8


class Car(NamedTuple):
    """A vehicle that keeps its lane; the last eight fields are its driver's (`sim.world.VEHICLE`)."""

    x: float
    lane: int
    speed: float
    present: bool = True
    quantile: float = 0.5
    habit: float = 0.5
    desired_speed: float = 0.0
    change_time: float = 4.0
    signals: bool = True
    away: bool = False
    noise: float = 0.0
    inattention: float = 1.0


def reckless_drivers(model: NddModel) -> NddModel:
    """The same drivers, but they change lanes often, overlook what is beside them and start at unlike speeds.

    Much happens in few tests, and draws are refused that the shipped model hardly ever makes.
    """
    initial = replace(model.initial, speed_sd=3.5, rr_scale=3.0, min_ttc=8.0)
    base = np.full(21, 0.2, dtype=np.float32)
    return replace(model, lc_base=base, overlook=0.5, overlook_conflict=0.5, initial=initial)


def setting_of(
    model: NddModel,
    odd: Odd | None = None,
    *,
    av: AvModel | None = None,
    adversary: str | None = None,
    bounded: bool = False,
    idm_bvs: bool = False,
    policy: PolicyNumbers = NO_POLICY,
    budget: float | None = None,
) -> Setting:
    """A run as the kernels take it; a model's tables are prepared once (kept with it, so that its id stays its own)."""
    road = road_numbers(odd or WIDE)
    key = (id(model), road.stops, road.spacing)
    if key not in _tables:
        _tables[key] = model, tables_of(model, stops=road.stops, traffic=(odd or WIDE).traffic)
        if len(_tables) > _MOST_TABLES:  # the oldest: a model and its tables take 17 MB
            del _tables[next(iter(_tables))]
    av = av or av_named("idm-mobil")
    return Setting(
        road=road,
        av=numbers_of_av(av),
        tables=_tables[key][1],
        who=Controllers(
            critical=ADVERSARIES[adversary or "nobody"],
            others=IDM_BVS if idm_bvs else NATURALISTIC,
            bounded=int(bounded),
            policy=policy,
            budget=budget_units(budget) if bounded else 0,
        ),
    )


def world_of(cars: Iterable[Car]) -> World:
    """A world of these cars in the centres of lanes of `WIDE`, the first is the AV. Absent cars are poisoned."""
    cars = list(cars)
    batch = allocate_worlds(1, len(cars))
    world = world_of_batch(batch)
    for vehicle, car in zip(world.vehicles, cars, strict=True):
        if car.present:
            vehicle["x"], vehicle["y"], vehicle["speed"] = car.x, 4.0 * car.lane + 2.0, car.speed
            vehicle["target_lane"], vehicle["lanes"] = car.lane, 1 << car.lane
            vehicle["present"], vehicle["action"] = 1, -1
            for name in TRAITS:
                vehicle[name] = getattr(car, name)
        else:
            for name in ("x", "y", "speed", "lateral_speed", "heading", "acceleration", "clock", "duration"):
                vehicle[name] = np.nan
            vehicle["lanes"], vehicle["action"] = 0b111111, 0
    world.order[:] = np.arange(len(cars))
    world.state["n_vehicles"] = len(cars)
    world.state["controlled"] = NO_VEHICLE
    world.state["outcome"] = RUNNING
    all_current(world)
    return world


def change_lane(world: World, slot: int, lane: int, road: RoadNumbers, *, ago: float = 0.0) -> None:
    """Put a vehicle on its way into a lane, `ago` seconds after the begin; its place along the road stays."""
    start_lane_change(world, slot, lane, road)
    v = world.vehicles
    v["clock"][slot] = ago
    v["y"][slot], v["lateral_speed"][slot], _ = path_at(path_of(v, slot), ago)
    v["lanes"][slot] = lane_bits(v["y"][slot], 0.5 * v["width"][slot], lane, road.lane_width)


def glide(world: World, slot: int, road: RoadNumbers) -> None:
    """0.1 s more of one vehicle at the acceleration that it has."""
    hold(world.vehicles, slot, world.vehicles["acceleration"][slot], road)
    move_vehicle(world.vehicles, slot, 0.1, road)
