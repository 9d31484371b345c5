"""An AV that is a policy of Gymnasium: an object with `predict`, for observations of `cornerforge/Driving-v0`.

Needs Python and NumPy only, and what the policy needs.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.foreign.drivers import Driver, UnusableError, WrongAvError, described, traced
from cornerforge.foreign.interface import VIEW_SHAPE
from cornerforge.foreign.networks import ACTIONS, BLOCK, FLAT, N_ACTIONS, SIZES, answers_of_index, form_of, is_scaled

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

__all__ = ["PolicyDriver", "answers_of_predicted"]

_ALLOWED = f"an action of Discrete({N_ACTIONS}), or of Box(-1, 1, (2,))"
_SB3 = ("stable_baselines3", "sb3_contrib")


def answers_of_predicted(actions: Any, rows: int, form: str | None = None) -> NDArray[np.float64]:
    """Turn actions of `cornerforge/Driving-v0` into accelerations [m/s2] and lane orders, (rows, 2).

    Args:
        actions: Whole numbers from 0 to 32, (rows,) or (rows, 1), or two numbers, (rows, 2).
        rows: How many.
        form: What two numbers are, a name of `networks.ACTIONS`; None: of Box(-1, 1), if none lies beyond.

    Raises:
        UnusableError: They are none.

    >>> answers_of_predicted([0, 32], 2)
    array([[0., 1.],
           [2., 0.]])
    >>> answers_of_predicted([[-0.5, -0.9]], 1)
    array([[-4., -1.]])
    """
    try:
        array = np.asarray(actions)
    except (TypeError, ValueError, RuntimeError) as error:
        raise UnusableError(f"predict gave a {type(actions).__name__}; expected {_ALLOWED}") from error
    is_whole = array.dtype.kind in "iu" or (array.dtype.kind == "f" and form == "number")
    if is_whole and array.shape in ((rows,), (rows, 1)):
        answers = answers_of_index(array)
        wrong = np.isnan(answers[:, 0])
        if wrong.any():
            raise UnusableError(f"predict gave the action {array[wrong].flat[0]}; allowed: 0 to {N_ACTIONS - 1}")
        return answers
    if array.dtype.kind not in "iuf" or array.shape != (rows, 2) or form == "number":
        shape = array.shape[1:] if array.shape[:1] == (rows,) else array.shape
        raise UnusableError(f"predict gave an array of type {array.dtype} and shape {shape}; expected {_ALLOWED}")
    most = float(np.max(np.abs(array), initial=0.0))
    if form is None and most > 1.0:
        raise UnusableError(
            f"predict gave {most:.4g}, which is beyond Box(-1, 1); say --av-actions box to cut there, or --av-actions "
            "si if the first number is in m/s2"
        )
    return ACTIONS[form or "box"][1](array)


class PolicyDriver(Driver):
    """Asks a policy world by world; one of Stable-Baselines3 without a memory in blocks of worlds.

    It has no other memory than the state that it gives and takes: `predict(observation, state=...)`.

    Args:
        policy: An object with `predict(observation)`, which gives an action, or a pair of an action and a state; it is
            asked with `deterministic=True`, `state` and `episode_start` where it takes them. A model of
            Stable-Baselines3 with a VecNormalize sees what this makes of the view.
        form: What two numbers that it gives are, a name of `networks.ACTIONS`; None: as its action space says.

    Raises:
        WrongAvError: Its observations or actions are others.
    """

    def __init__(self, policy: Any, form: str | None = None) -> None:
        super().__init__(policy)
        try:
            takes = dict(inspect.signature(policy.predict).parameters)
        except (TypeError, ValueError):  # code that is compiled
            takes = {}
        takes_any = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in takes.values())
        self._how: dict[str, Any] = {"deterministic": True} if takes_any or "deterministic" in takes else {}
        self._takes_state, self._takes_start = "state" in takes, "episode_start" in takes
        shape = getattr(getattr(policy, "observation_space", None), "shape", None)
        if shape is not None and tuple(shape) not in (VIEW_SHAPE, FLAT):
            raise WrongAvError(
                f"it observes {tuple(shape)}; an AV's view is {VIEW_SHAPE}, or flattened {FLAT}. A stack of views "
                "(VecFrameStack) is made within predict, from the state that it gives and takes"
            )
        self._shape = VIEW_SHAPE if shape is None else tuple(shape)
        high = getattr(getattr(policy, "observation_space", None), "high", None)
        self._scaled = high is not None and is_scaled(np.asarray(high))
        self._form = form
        acted: Any = getattr(policy, "action_space", None)
        if form is None and hasattr(acted, "low"):
            self._form = form_of(acted.low, acted.high)
            if self._form is None:
                raise WrongAvError(
                    f"its action space is {acted}; an AV's is Box(-1, 1, (2,)) or Box([-8, -1], [2, 1]). If it means "
                    "one of these: --av-actions box, or si"
                )
        # what has a predict of its own may normalise there
        own = getattr(getattr(type(policy), "predict", None), "__module__", "").partition(".")[0] in _SB3
        wrapped = policy.get_vec_normalize_env() if own and hasattr(policy, "get_vec_normalize_env") else None
        self._normalised: Callable[[Any], Any] = wrapped.normalize_obs if wrapped is not None else lambda seen: seen
        self._states: dict[int, Any] = {}
        self._in_blocks = False
        if any(one.__module__.partition(".")[0] in _SB3 for one in type(policy).__mro__):
            self._in_blocks = self._predict(np.zeros((BLOCK, *self._shape), np.float32), None)[1] is None
            self._takes_state = not self._in_blocks
        self.about["remembers"] = "yes" if self._takes_state else "no"

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: ARG002 - see below
        """Forget the states of some worlds; no policy takes seeds."""
        for b in worlds.tolist():
            self._states.pop(b, None)

    def _predict(self, observation: NDArray[np.float32], state: Any) -> tuple[Any, Any]:
        """Ask for actions, and for the state after them."""
        how = dict(self._how)
        if self._takes_state:
            how["state"] = state
            if self._takes_start:
                how["episode_start"] = np.array([state is None])
        given = self.av.predict(self._normalised(observation), **how)
        return given if isinstance(given, tuple) and len(given) == 2 else (given, None)

    def answer(self, seen: NDArray[Any]) -> NDArray[np.float64]:
        """Ask the policy."""
        rows, shown = len(seen), seen / SIZES if self._scaled else seen
        answers = np.zeros((rows, 2))
        self.failed, self.traces = {}, {}
        if self._in_blocks:
            padded = np.zeros((-(-rows // BLOCK) * BLOCK, *self._shape), np.float32)
            padded[:rows] = shown.reshape(rows, *self._shape)
            for k in range(0, len(padded), BLOCK):
                block = answers_of_predicted(self._predict(padded[k : k + BLOCK], None)[0], BLOCK, self._form)
                answers[k : k + BLOCK] = block[: rows - k]
            return answers
        for b in np.flatnonzero(seen[:, 0, 0] == 1.0).tolist():
            try:
                observation = shown[b].reshape(self._shape).copy()
                action, self._states[b] = self._predict(observation, self._states.get(b))
                answers[b] = answers_of_predicted(np.asarray(action)[None], 1, self._form)[0]
            except UnusableError as error:
                self.failed[b] = "answer", f"gave no usable answer: {error}"
            except Exception as error:  # whatever the user's code raises ends this world's test only
                self.failed[b] = "raised", f"raised {described(error)}"
                self.traces[self.failed[b][1]] = traced(error)
        answers[list(self.failed)] = np.nan
        return answers
