"""Gymnasium spaces of what agents see and do, with finite bounds that follow from the ODD."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import error, spaces
from numpy.typing import NDArray

from cornerforge._words import shown
from cornerforge.errors import InputError
from cornerforge.foreign.networks import SIZES, answers_of_box, answers_of_index
from cornerforge.adversary.worlds import agents
from cornerforge.sim import av_scene, av_view, neighbours, observe
from cornerforge.site.tables import MAX_PLACES
from cornerforge.types import CLASSES, FIRST_ACCELERATION, HIGHEST_COMMAND, LOWEST_COMMAND, N_ACTIONS, Odd

__all__ = [
    "N_SITE",
    "SITE_SIZES",
    "ClosedError",
    "InvalidActionError",
    "ResetNeededError",
    "adversary_observations",
    "av_commands",
    "checked",
    "driving_actions",
    "driving_observations",
    "flat_scene",
    "numbers_of",
    "one_of_33",
]


class ResetNeededError(InputError, error.ResetNeeded):
    """No test runs: it has not begun, or it has ended."""


class InvalidActionError(InputError, error.InvalidAction):
    """An action is not one of the action space."""


class ClosedError(InputError, error.ClosedEnvironmentError):
    """The environment was closed."""


N_SITE = agents.SITE_ROWS * av_scene.SITE_COLUMNS
"""Numbers of an observation of the AV at a site."""
SITE_SIZES = np.ones((agents.SITE_ROWS, av_scene.SITE_COLUMNS), dtype=np.float32)
"""Usual sizes of the entries of what an AV sees at a site, by which `cornerforge/Driving-v0` divides them."""
SITE_SIZES[0] = SITE_SIZES[av_scene.FIRST_AGENT :] = 1.0, 1.0, 5.0, 2.0, 30.0, 30.0, 1.0, 10.0, 10.0, 1.0
SITE_SIZES[1, :5] = 30.0, 4.0, 30.0, 1.0, 100.0
SITE_SIZES[2 : av_scene.FIRST_AGENT, :5] = 30.0, 30.0, 1.0, 10.0, 0.1
_MOST_AT_SITE = 10.0
"""Bound of what an adversary sees at a site, whose entries are of order 1."""
_LATERAL_SPEED = 25.0
"""Bound above the lateral speed of any lane change [m/s], even of one that is aborted and begun again all the time."""


def adversary_observations(odd: Odd) -> spaces.Box:
    """Give the space of `sim.observe.observe`: float32 (N_OBSERVATION,), bounds in its own scaled units."""
    if odd.site is not None:
        return spaces.Box(-_MOST_AT_SITE, _MOST_AT_SITE, (observe.N_OBSERVATION,), dtype=np.float32)
    speed, width, lanes = odd.max_speed / 10.0, odd.n_lanes * odd.lane_width / 4.0, odd.n_lanes - 1.0
    low, high = np.zeros(observe.N_OBSERVATION), np.ones(observe.N_OBSERVATION)
    limits = {2: width, 3: _LATERAL_SPEED / 2.0, 4: 4.0, 8: width, 9: _LATERAL_SPEED / 2.0}
    limits |= {12: 3.0, 13: 3.0, 14: width, 15: speed, 16: lanes}
    for place in range(observe.N_OWN, observe.N_OBSERVATION, 5):
        limits |= {place: 3.0, place + 1: width, place + 2: speed, place + 3: lanes}
    for place, limit in limits.items():
        low[place], high[place] = -limit, limit
    low[0], high[0] = -odd.max_speed / 400.0, odd.test_length / 400.0
    low[[1, 7]], high[[1, 7]] = -3.0, speed - 3.0
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def driving_observations(odd: Odd, *, scaled: bool) -> spaces.Box:
    """Give the space of `sim.av_view.view_of_av`: float32 (VIEW_ROWS, VIEW_COLUMNS), in SI units or over `SIZES`.

    At a site that of `flat_scene`, float32 (N_SITE,).
    """
    if odd.site is not None:
        return _scenes(odd, scaled=scaled)
    width = odd.n_lanes * odd.lane_width
    lanes = odd.n_lanes - 1.0
    low, high = np.zeros((av_view.VIEW_ROWS, av_view.VIEW_COLUMNS)), np.ones((av_view.VIEW_ROWS, av_view.VIEW_COLUMNS))
    low[:], high[:] = (
        [0.0, -neighbours.SIGHT, -width, 0.0, -_LATERAL_SPEED, LOWEST_COMMAND, 0.0, 0.0],
        [1.0, neighbours.SIGHT, width, odd.max_speed, _LATERAL_SPEED, HIGHEST_COMMAND, lanes, 1.0],
    )
    low[0, 1:3] = -odd.max_speed, 0.0
    high[0, 1:3] = odd.test_length, width
    sizes = SIZES if scaled else np.float32(1.0)
    return spaces.Box(low.astype(np.float32) / sizes, high.astype(np.float32) / sizes, dtype=np.float32)


def _scenes(odd: Odd, *, scaled: bool) -> spaces.Box:
    first, top, far = av_scene.FIRST_AGENT, odd.max_speed, neighbours.SIGHT
    high = np.zeros((agents.SITE_ROWS, av_scene.SITE_COLUMNS))
    agent = [1.0, len(CLASSES) - 1.0, 30.0, 5.0, far, far, 4.0, top, top, 1.0]
    high[0], high[first:] = agent, agent
    high[1, :5] = odd.time_limit, -LOWEST_COMMAND, MAX_PLACES, 4.0, MAX_PLACES
    high[2:first, :5] = 60.0, 60.0, 4.0, top, 1.0
    low = -high
    low[0, :4] = low[first:, :4] = 0.0
    low[1, [0, 3]] = low[2:first, 3] = 0.0
    sizes = SITE_SIZES if scaled else np.float32(1.0)
    return spaces.Box((low.astype(np.float32) / sizes).ravel(), (high.astype(np.float32) / sizes).ravel())


def flat_scene(seen: NDArray[np.float32], *, scaled: bool) -> NDArray[np.float32]:
    """Flatten what an AV sees at a site, (B, agents.SITE_ROWS, SITE_COLUMNS) of `sim.site.scene`, to (B, N_SITE).

    In place of an agent's number stands 1, and 0 where there is none; `scaled`: divided by `SITE_SIZES`.
    """
    shown = seen.copy()
    shown[:, av_scene.FIRST_AGENT :, 0] = seen[:, av_scene.FIRST_AGENT :, 0] >= 0.0
    shown[:, av_scene.FIRST_AGENT :, 0] *= seen[:, :1, av_scene.LENGTH] > 0.0
    return (shown / SITE_SIZES if scaled else shown).reshape(len(seen), N_SITE)


def one_of_33() -> spaces.Discrete:
    """Give the action set of all BVs, `types.ACTIONS`: two lane changes, which hold the speed, and 31 accelerations."""
    return spaces.Discrete(N_ACTIONS)


def driving_actions(kind: str, *, at_site: bool = False) -> spaces.Space[NDArray[np.float32]] | spaces.Discrete:
    """The action space of the AV: "discrete", the 33 actions of BVs, or "box", two numbers in [-1, 1] (`av_commands`).

    At a site the 31 accelerations among them, or one number.

    Raises:
        InputError: The name is neither.
    """
    if kind == "discrete":
        return spaces.Discrete(N_ACTIONS - FIRST_ACCELERATION) if at_site else one_of_33()
    if kind == "box":
        return spaces.Box(-1.0, 1.0, (1 if at_site else 2,), dtype=np.float32)
    raise InputError(f'actions = {kind!r} is not known; allowed: "discrete" or "box".')


def av_commands(
    actions: NDArray[Any], *, box: bool, at_site: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Give acceleration [m/s2] and lane order (1 left, 0 keep, -1 right) of B actions, each of shape (B,).

    Args:
        actions: Indices, (B,), or for `box` float (B, 2): the first number times 8 m/s2 where it is negative and times
            2 m/s2 where it is positive, so that 0 holds the speed; the second above 1/3 changes to the left, below -1/3
            to the right. Numbers beyond [-1, 1] are cut.
        box: Whether the actions are for `box`.
        at_site: They are accelerations alone: indices of the 31, or float (B, 1).
    """
    if at_site:
        actions = np.pad(actions, ((0, 0), (0, 1))) if box else actions + FIRST_ACCELERATION
    answers = answers_of_box(actions) if box else answers_of_index(actions)
    return answers[:, 0], answers[:, 1].astype(np.int64)


def numbers_of(actions: object) -> NDArray[Any]:
    """Make an array of given actions; from input that is no array, such as a ragged list, one of objects.

    >>> numbers_of([1, 2]).dtype.kind, numbers_of([[1], [1, 2]]).dtype.kind
    ('i', 'O')
    """
    try:
        return np.asarray(actions)
    except ValueError:
        return np.array(None, dtype=object)


def checked(name: str, given: object, space: spaces.Space[Any], worlds: tuple[int, ...] = ()) -> NDArray[Any]:
    """Give actions as an array.

    Args:
        name: For the message.
        given: One action of the space, or as many as there are worlds.
        space: The action space of one world.
        worlds: (B,), or () for one action.

    Raises:
        InvalidActionError: They are something else.
    """
    array, number = numbers_of(given), "a whole number" if not worlds else f"{worlds[0]} whole numbers"
    right = array.shape == (*worlds, *(space.shape or ()))
    if isinstance(space, spaces.Discrete):
        right = right and array.dtype.kind in "iu" and bool(((array >= 0) & (array < space.n)).all())
        allowed = f"{number} from 0 to {space.n - 1}"
    else:
        right = right and array.dtype.kind in "iuf" and bool(np.isfinite(array).all())
        allowed = f"{(*worlds, *(space.shape or ()))} finite numbers from -1 to 1"
    if not right:
        raise InvalidActionError(f"{name} = {shown(given)} is not allowed; give {allowed}.")
    return array
