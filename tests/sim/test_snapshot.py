"""A world can be stopped, copied, stored and taken up again anywhere, to the same bit; a branch has another future."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.lib.recfunctions import drop_fields
from sim.test_digests import DRIVERS, Bvs

from cornerforge.errors import FileFormatError, InputError
from cornerforge.ndd.model import NddModel
from cornerforge.sim.actions import ordered_lane
from cornerforge.sim.controllers import OUTSIDE
from cornerforge.sim.keep import keep_nothing, keep_whole_test
from cornerforge.sim.loop import AV_MUST_ANSWER, MILESTONE, NEVER, OVER, advance, answer_as_av
from cornerforge.sim.outcome import Outcomes, allocate_outcomes, write_outcome
from cornerforge.sim.runner import Tally, drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.snapshot import branch_of, copy_of, packed, unpacked
from cornerforge.sim.statistics import EVERYBODY, Counts, allocate_counts
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import World, allocate_worlds, n_slots, world_of
from cornerforge.types import Odd

TESTS = 1000
SEED = 21
LONGEST = 14
"""Seconds of an ordinary test, about; later cuts would find it over."""


def fresh_world(setting: Setting, test: int) -> World:
    world = world_of(allocate_worlds(1, n_slots(setting.road)))
    reset_world(world, SEED, test, setting)
    return world


def digest(out: Outcomes) -> str:
    tally = Tally()
    tally.add(out, allocate_counts())
    return tally.digest.hexdigest()


def stored(world: World, setting: Setting) -> World:
    """Through bytes; what was left is spoiled, so that nothing can lean on it."""
    taken_up = unpacked(packed(world), setting)
    for array in world:
        array.view(np.uint8)[:] = 0xAB
    return taken_up


@pytest.mark.sampled(4)
@pytest.mark.parametrize("bvs", DRIVERS, ids=[bvs.name for bvs in DRIVERS])
def test_a_test_that_was_cut_at_a_random_second_ends_as_the_uncut_one(model: NddModel, bvs: Bvs) -> None:
    tests = TESTS // len(DRIVERS)
    setting, slots = bvs.setting(model, Odd(), "idm-mobil-watchful"), n_slots(Odd())
    rng = np.random.default_rng([SEED, DRIVERS.index(bvs)])
    out, counts, cut = allocate_outcomes(tests), allocate_counts(), 0
    for test in range(tests):
        world = fresh_world(setting, test)
        keep = keep_nothing(slots, counts=counts, census=EVERYBODY)
        reason = MILESTONE
        for second in sorted(rng.integers(0, LONGEST, 2)):
            reason = advance(world, setting, allocate_scratch(slots, setting.who.policy), keep, int(second))
            cut += reason == MILESTONE
            world = stored(world, setting)
        if reason != OVER:
            assert advance(world, setting, allocate_scratch(slots, setting.who.policy), keep, NEVER) == OVER
        write_outcome(world, out, test, setting.road)
    whole: tuple[Outcomes, Counts] = drive_chunk(setting, slots, SEED, 0, tests, True)
    assert digest(out) == digest(whole[0])
    for ours, theirs in zip(counts, whole[1], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert cut > tests // 2


@pytest.mark.full
def test_a_test_can_be_left_within_a_second_too(model: NddModel) -> None:
    """Where an AV outside is asked, every 0.1 s, the world goes through bytes."""
    setting = DRIVERS[7].setting(model, Odd(), "idm-mobil").with_drivers(av=OUTSIDE)
    slots = n_slots(Odd())
    rng = np.random.default_rng(SEED)
    for test in range(20):
        ends = []
        answers = rng.normal(0.0, 1.0, 700), rng.integers(-40, 40, 700)
        for store in (False, True):
            world, k = fresh_world(setting, test), 0
            scratch, keep = allocate_scratch(slots, setting.who.policy), keep_nothing(slots)
            while advance(world, setting, scratch, keep, NEVER) == AV_MUST_ANSWER:
                if store and k % 3 == 1:
                    world, scratch = stored(world, setting), allocate_scratch(slots, setting.who.policy)
                side = int(answers[1][k]) if abs(answers[1][k]) <= 1 else 0
                answer_as_av(world, answers[0][k], ordered_lane(world, 0, side, setting.road))
                k += 1
            ends.append(packed(world))
        assert ends[0] == ends[1]
        assert k > 10


def test_a_branch_has_the_same_past_and_another_future(model: NddModel) -> None:
    setting, slots = DRIVERS[0].setting(model, Odd(), "idm-mobil"), n_slots(Odd())
    rng = np.random.default_rng(SEED)
    others = 0
    for test in range(100):
        second = int(rng.integers(1, 8))
        world = fresh_world(setting, test)
        scratch = allocate_scratch(slots, setting.who.policy)
        past = keep_whole_test(setting, slots)
        assert advance(world, setting, scratch, past, second) == MILESTONE
        futures = []
        for branch in (0, 0, 1, 2):
            copy, keep = branch_of(world, branch), keep_whole_test(setting, slots)
            keep.recording[:] = past.recording
            advance(copy, setting, scratch, keep, second + 3)
            futures.append(keep.recording.copy())
        same, again, one, two = (future[: 10 * second + 1] for future in futures)
        for other in (again, one, two):
            np.testing.assert_array_equal(same[: 10 * second], other[: 10 * second])
        np.testing.assert_array_equal(futures[0], futures[1])
        others += all((a != b).any() for a, b in ((futures[0], futures[2]), (futures[2], futures[3])))
    assert others == 100  # some twenty vehicles draw accelerations from many: all the same has no chance


def test_a_copy_has_a_memory_of_its_own(model: NddModel) -> None:
    setting = DRIVERS[0].setting(model, Odd(), "idm-mobil")
    world = fresh_world(setting, 0)
    before = packed(world)
    copy = copy_of(world)
    advance(copy, setting, allocate_scratch(n_slots(Odd()), setting.who.policy), keep_nothing(n_slots(Odd())), NEVER)
    assert packed(world) == before
    assert packed(copy) != before


def test_what_is_no_world_is_refused(model: NddModel) -> None:
    world = fresh_world(DRIVERS[0].setting(model, Odd(), "idm-mobil"), 0)
    content = packed(world)
    for wrong, text in (
        (b"", "no stored world"),
        (content[:-5], "damaged"),
        (content[:400] + b"x" + content[401:], "damaged"),
    ):
        with pytest.raises(FileFormatError, match=text):
            unpacked(wrong)
    with pytest.raises(InputError, match="branch"):
        branch_of(world, 65_536)


def with_head(content: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """A stored world with another first line, and a checksum that fits it."""
    magic, head, rest = content[:-32].split(b"\n", 2)
    header = json.loads(head)
    changed = change(header)
    body = magic + b"\n" + (changed if isinstance(changed, bytes) else json.dumps(header).encode()) + b"\n" + rest
    return body + hashlib.sha256(body).digest()


def cut(content: bytes) -> bytes:
    """A stored world without its last number, and a checksum that fits."""
    return content[:-40] + hashlib.sha256(content[:-40]).digest()


def test_a_world_with_other_fields_is_refused_in_one_line(model: NddModel) -> None:
    world = fresh_world(DRIVERS[0].setting(model, Odd(), "idm-mobil"), 0)
    content = packed(world)
    assert packed(unpacked(with_head(content, lambda _: None))) == content
    fewer = world._replace(vehicles=drop_fields(world.vehicles, "kind", usemask=False))
    other_type = world._replace(order=world.order.astype(np.int32))
    for wrong, text in (
        (packed(fewer), "other fields"),
        (packed(other_type), "other fields"),
        (packed(world._replace(pairs=np.zeros((8, 2), dtype=np.int16))), "other fields"),
        (packed(allocate_worlds(3, 10)), "several"),
        (cut(content), "other fields"),
        (with_head(content, lambda head: head["arrays"].pop("seen")), "other fields"),
        (with_head(content, lambda head: head.update(arrays={"x": 1})), "other fields"),
        (with_head(content, lambda head: head.update(arrays=[])), "other fields"),
        (with_head(content, lambda head: head["arrays"]["vehicles"].update(shape=[])), "other fields"),
        (with_head(content, lambda head: head["arrays"]["vehicles"].update(shape=[-1])), "other fields"),
        (with_head(content, lambda head: head["arrays"]["vehicles"].update(shape=[10**15])), "other fields"),
        (with_head(content, lambda head: head["arrays"]["vehicles"].update(shape=[float("inf")])), "cannot be read"),
        (with_head(content, lambda head: head.update(schema_version=1)), "schema version 1;"),
        (with_head(content, lambda head: head.pop("schema_version")), "cannot be read"),
        (with_head(content, lambda _: b"not json"), "cannot be read"),
        (with_head(content, lambda _: b"[1]"), "cannot be read"),
        (with_head(content, lambda _: b"\xff"), "cannot be read"),
    ):
        with pytest.raises(FileFormatError, match=text) as refused:
            unpacked(wrong)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("vehicles.x", np.nan),
        ("vehicles.speed", np.inf),
        ("vehicles.target_lane", 99),
        ("vehicles.action", 33),
        ("vehicles.kind", -1),
        ("vehicles.length", 0.0),
        ("state.n_vehicles", 50),
        ("state.controlled", 49),
        ("state.outcome", 8),
        ("state.test", -1),
        ("av.controls", np.nan),
        ("state.n_seen", 49),
        ("order", 49),
        ("pairs", -1),
        ("av.lead", 49),
        ("seen.y", np.nan),
    ],
)
def test_a_value_that_no_world_has_is_refused(model: NddModel, place: str, value: float) -> None:
    world = fresh_world(DRIVERS[0].setting(model, Odd(), "idm-mobil"), 0)
    world.state["n_pairs"], world.pairs[0] = 1, (0, 1)
    assert packed(unpacked(packed(world))) == packed(world)
    array, _, field = place.partition(".")
    values = world._asdict()[array]
    values = values[field] if field else values
    values[(0,) * values.ndim] = value
    with pytest.raises(FileFormatError, match=rf"damaged: {place}.* is .*; it must be "):
        unpacked(packed(world))


def test_a_lane_that_the_road_lacks_is_refused_where_the_road_is_known(model: NddModel) -> None:
    setting = DRIVERS[0].setting(model, Odd(n_lanes=2), "idm-mobil")
    world = fresh_world(setting, 0)
    world.vehicles["target_lane"][1] = 2
    assert packed(unpacked(packed(world))) == packed(world)
    with pytest.raises(FileFormatError, match=r"damaged: vehicles.target_lane\[1\] is 2; it must be 0 to 1"):
        unpacked(packed(world), setting)


def test_a_world_of_another_road_is_refused_where_it_is_driven_on(model: NddModel) -> None:
    setting = DRIVERS[0].setting(model, Odd(), "idm-mobil")
    content = packed(fresh_world(setting, 0))
    assert packed(unpacked(content, setting)) == content
    for other in (Odd(n_lanes=2), Odd(n_lanes=4), Odd(traffic_length=1200.0)):
        with pytest.raises(InputError, match="49 vehicle slots"):
            unpacked(content, DRIVERS[0].setting(model, other, "idm-mobil"))
