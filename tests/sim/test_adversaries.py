from __future__ import annotations

import numpy as np
import pytest
from hand_built import Car, world_of
from statistical_bounds import l1_bound, l1_distance

from cornerforge.drivers.policy import HEADS, NO_POLICY, NetworkShape, PolicyNumbers, n_weights
from cornerforge.sim.adversaries import choose_action
from cornerforge.sim.controllers import (
    ADVERSARIES,
    AS_LEARNED,
    POLICY,
    Controllers,
    Mask,
    cast_index,
    cast_of,
    critical_of,
)
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.scratch import ChoiceScratch, allocate_scratch
from cornerforge.sim.world import World

N = 50_000
WORLD = [Car(400.0, 1, 30.0), Car(420.0, 2, 30.0)]
SEED = 9


def scratch_for(policy: PolicyNumbers) -> ChoiceScratch:
    return allocate_scratch(3, policy).choice


def choices(
    kind: str,
    allowed: list[int],
    n: int,
    *,
    epsilon: float = 0.0,
    world: World | None = None,
    policy: PolicyNumbers = NO_POLICY,
) -> np.ndarray:
    """Counts of the actions chosen over n tests."""
    world = world or world_of(WORLD)
    scratch = scratch_for(policy)
    scratch.allowed[allowed] = True
    counts = np.zeros(33, dtype=np.int64)
    world.state["seed"] = SEED
    for test in range(n):
        world.state["test"] = test
        counts[choose_action(world, 1, ADVERSARIES[kind], epsilon, 0.0, policy, scratch)[0]] += 1
    return counts


def spread(actions: list[int], share: float = 1.0) -> np.ndarray:
    p = np.zeros(33)
    p[actions] = share / len(actions)
    return p


def constant_policy(favourite: int) -> PolicyNumbers:
    shape = NetworkShape(N_OBSERVATION, 1, 0, 1)
    weights = np.zeros(n_weights(shape), dtype=np.float32)
    weights[-33 + favourite] = 1.0
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("allowed", [list(range(33)), [0, 1, 5, 30], [2, 3, 4], [17]])
def test_uniform_takes_any_allowed_action_alike(allowed: list[int]) -> None:
    # H0: independent uniform draws; n = 50,000 sees an L1 error of 0.04.
    counts = choices("uniform", allowed, N)
    assert l1_distance(counts, spread(allowed)) <= l1_bound(33, N, comparisons=4)
    assert counts.sum() == counts[allowed].sum()
    if len(allowed) > 1:  # negative control: one action left out
        assert l1_distance(counts, spread(allowed[1:])) > l1_bound(33, N, comparisons=4)


def test_the_lane_changer_changes_two_times_in_three() -> None:
    accelerations = list(range(2, 33))
    counts = choices("lane-changer", list(range(33)), N)
    expected = spread([0, 1], 2.0 / 3.0) + spread(accelerations, 1.0 / 3.0)
    assert l1_distance(counts, expected) <= l1_bound(33, N, comparisons=3)
    only_left = choices("lane-changer", [0, *accelerations], N)
    assert l1_distance(only_left, spread([0], 2.0 / 3.0) + spread(accelerations, 1.0 / 3.0)) <= l1_bound(33, N, 3)
    none = choices("lane-changer", accelerations, N)
    assert l1_distance(none, spread(accelerations)) <= l1_bound(33, N, comparisons=3)
    assert l1_distance(counts, spread(list(range(33)))) > l1_bound(33, N)  # negative control


def test_the_policy_takes_its_best_allowed_action_and_explores_by_epsilon() -> None:
    policy = constant_policy(12)
    assert choices("policy", list(range(33)), 100, policy=policy)[12] == 100
    assert (
        choices("policy", [3, 9], 100, policy=policy)[3] == 100
    )  # its favourite is forbidden: the first of the equals
    explored = choices("policy", list(range(33)), N, policy=policy, epsilon=0.25)
    expected = 0.75 * spread([12]) + 0.25 * spread(list(range(33)))
    assert l1_distance(explored, expected) <= l1_bound(33, N)
    assert l1_distance(explored, 0.8 * spread([12]) + 0.2 * spread(list(range(33)))) > l1_bound(33, N)


@pytest.mark.parametrize(
    ("bv", "allowed", "action"),
    [
        (Car(399.0, 2, 30.0), range(33), 1),  # level, on the left: into the AV's lane
        (Car(399.0, 0, 30.0), range(33), 0),  # level, on the right
        (Car(399.0, 3, 30.0), range(33), 1),  # two lanes off: one nearer
        (Car(430.0, 1, 30.0), range(33), 0),  # in its lane, far: out to the left
        (Car(430.0, 1, 30.0), range(1, 33), 1),  # or to the right
        (Car(430.0, 2, 30.0), range(33), 2),  # ahead in the next lane: let it come
        (Car(370.0, 2, 30.0), range(33), 32),  # behind: catch up
        (Car(404.0, 2, 30.0), range(33), 2 + 10),  # 5 m too far ahead: 0.4 * -5 = -2.0
        (Car(404.0, 2, 30.0), [0, 1, 31], 31),  # the nearest allowed
        (Car(404.0, 2, 30.0), [0, 1], 0),  # none: the first allowed
    ],
)
def test_swerve(bv: Car, allowed: list[int], action: int) -> None:
    counts = choices("swerve", list(allowed), 3, world=world_of([Car(400.0, 1, 30.0), bv]))
    assert counts[action] == 3


def test_choices_of_another_vehicle_are_other_draws() -> None:
    world = world_of([*WORLD, Car(440.0, 0, 30.0)])
    scratch = scratch_for(NO_POLICY)
    scratch.allowed[:] = True
    uniform = ADVERSARIES["uniform"]
    world.state["seed"] = SEED
    chosen: list[list[int]] = [[], []]
    for test in range(50):
        world.state["test"] = test
        for slot in (1, 2):
            chosen[slot - 1].append(choose_action(world, slot, uniform, 0.0, 0.0, NO_POLICY, scratch)[0])
    assert chosen[0] != chosen[1]


# Policies that act at random, and mixtures


def valued_policy(values: np.ndarray) -> PolicyNumbers:
    """Q differs from `values` by the same number for all actions, whatever is seen."""
    shape = NetworkShape(N_OBSERVATION, 1, 0, 1)
    weights = np.zeros(n_weights(shape), dtype=np.float32)
    weights[-33:] = values
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("allowed", [list(range(33)), [0, 1, 5, 30], [17]])
@pytest.mark.parametrize("temperature", [0.0, 0.1, 1.0])
def test_a_policy_draws_by_its_values_among_the_allowed(allowed: list[int], temperature: float) -> None:
    # H0: independent draws with P(a) proportional to exp(Q / T); n = 50,000 sees an L1 error of 0.04.
    values = np.random.default_rng(3).uniform(0.0, 1.0, 33).astype(np.float32)
    policy = valued_policy(values)
    world = world_of(WORLD)
    scratch = scratch_for(policy)
    scratch.allowed[allowed] = True
    expected = np.zeros(33)
    q = values[allowed].astype(np.float64)
    if temperature == 0.0:
        expected[allowed[int(q.argmax())]] = 1.0
    else:
        weights = np.exp((q - q.max()) / temperature)
        expected[allowed] = weights / weights.sum()
    counts = np.zeros(33, dtype=np.int64)
    world.state["seed"] = SEED
    for test in range(N):
        world.state["test"] = test
        action, log_prob = choose_action(world, 1, POLICY, 0.0, temperature, policy, scratch)
        counts[action] += 1
        assert log_prob == pytest.approx(np.log(expected[action]), abs=1e-5)
    bound = l1_bound(33, N, comparisons=9)
    assert l1_distance(counts, expected) <= bound
    if temperature > 0.0 and len(allowed) == 33:  # negative control: another temperature
        other = np.exp((values.astype(np.float64) - values.max()) / (1.5 * temperature))
        assert l1_distance(counts, other / other.sum()) > bound


def test_an_action_far_worse_is_never_drawn_and_nothing_overflows() -> None:
    policy = valued_policy(np.linspace(-1e6, 1e6, 33).astype(np.float32))
    scratch = scratch_for(policy)
    scratch.allowed[:30] = True
    world = world_of(WORLD)
    world.state["seed"] = SEED
    for test in range(100):
        world.state["test"] = test
        assert choose_action(world, 1, POLICY, 0.0, 1e-4, policy, scratch) == (29, 0.0)


@pytest.mark.parametrize(("head", "temperature"), [("greedy", 0.0), ("softmax", 1.0)])
def test_a_policy_that_acts_as_it_learned_does_what_its_head_says(head: str, temperature: float) -> None:
    policy = valued_policy(np.random.default_rng(3).uniform(0.0, 1.0, 33).astype(np.float32))
    own = policy._replace(head=HEADS[head])
    scratch, world = scratch_for(policy), world_of(WORLD)
    scratch.allowed[::2] = True
    world.state["seed"] = SEED
    chosen = set()
    for test in range(200):
        world.state["test"] = test
        found = choose_action(world, 1, POLICY, 0.0, AS_LEARNED, own, scratch)
        assert found == choose_action(world, 1, POLICY, 0.0, temperature, policy, scratch)
        chosen.add(found[0])
    assert (len(chosen) > 1) == (head == "softmax")


def test_each_test_of_a_mixture_draws_its_policy_alike() -> None:
    # H0: independent, uniform over 3; n = 50,000 sees an L1 error of 0.03.
    drawn = np.array([cast_index(4, test, 3) for test in range(N)])
    bound = l1_bound(3, N, comparisons=2)
    assert l1_distance(np.bincount(drawn, minlength=3), np.full(3, 1.0 / 3.0)) <= bound
    pairs = np.bincount(3 * drawn[:-1] + drawn[1:], minlength=9)  # neighbours know nothing of each other
    assert l1_distance(pairs, np.full(9, 1.0 / 9.0)) <= 2.0 * l1_bound(9, N // 2)
    assert l1_distance(np.bincount(drawn, minlength=3), np.array([0.4, 0.3, 0.3])) > bound  # negative control
    assert {cast_index(4, test, 1) for test in range(50)} == {0}
    assert [cast_index(5, test, 3) for test in range(50)] != drawn[:50].tolist()


def test_a_mixture_holds_its_policies_whole() -> None:
    policies = [constant_policy(favourite) for favourite in (3, 12, 30)]
    policies[1] = policies[1]._replace(head=HEADS["softmax"])
    masks = [Mask(0, 0), Mask(1, 0, 0, 3), Mask(1, 7, 1, 5)]
    cast = cast_of(policies, masks)
    # As Python: a view that a kernel gives out would come back as the whole array.
    as_python = cast._replace(members=cast.members.view(np.recarray))
    test_of = {cast_index(SEED, test, 3): test for test in range(50)}
    assert sorted(test_of) == [0, 1, 2]
    found = []
    for index, policy in enumerate(policies):
        who = Controllers(cast=as_python, policy=NO_POLICY, bounded=5, budget=5)  # these three are not looked at
        member, mask = critical_of.py_func(SEED, test_of[index], who)  # type: ignore[attr-defined]
        np.testing.assert_array_equal(member.weights, policy.weights)
        assert member[1:] == policy[1:]
        compiled = critical_of(SEED, test_of[index], who._replace(cast=cast))
        assert (compiled[0][1:], compiled[1]) == (policy[1:], mask)
        found.append(mask)
    assert found == masks


def test_a_single_policy_drives_every_test() -> None:
    who = Controllers(policy=constant_policy(12), bounded=1, budget=7, excess=1, steers_from=4)
    for test in range(20):
        policy, mask = critical_of(SEED, test, who)
        assert (policy[1:], mask) == (who.policy[1:], Mask(1, 7, 1, 4))
        np.testing.assert_array_equal(policy.weights, who.policy.weights)
