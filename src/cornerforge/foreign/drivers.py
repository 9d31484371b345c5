"""Drivers of AVs within their process: they show the AV views or scenes, and make one array of its answers.

Needs Python and NumPy only.
"""

from __future__ import annotations

import os
import traceback
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.foreign import site_scene
from cornerforge.foreign.interface import ANSWERS, AT_SITES, NEAREST, VIEW_SHAPE, Av, AvContext, PlannerForAll
from cornerforge.foreign.scene import COLUMNS, Scenes
from cornerforge.foreign.site_scene import SiteScenes

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

__all__ = [
    "Driver",
    "EndedError",
    "UnusableError",
    "WorldDriver",
    "WrongAvError",
    "described",
    "driver_of",
    "numbers_of",
    "poses_of",
    "traced",
]

_POSE = 5
_MOST_TRACE = 100_000
_LEAST_POSE = 3


class UnusableError(Exception):
    """The AV's answer is no array of numbers of the right shape."""


class EndedError(Exception):
    """The program that is the AV has ended, or does not talk any more."""


class WrongAvError(Exception):
    """The AV says something of itself that cannot be."""


def described(error: BaseException) -> str:
    """Put an exception into one line, with file and line of the AV's own code that raised it."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    where = f" ({os.path.basename(frames[-1].filename)}:{frames[-1].lineno})" if frames else ""
    try:
        text = " ".join(str(error).split())[:300]
    except Exception:  # its own text raises
        text = "?"
    return f"{type(error).__name__}({text}){where}"


def traced(error: BaseException) -> str:
    """Write the whole traceback of an exception of the AV's own code, with its causes, but for the calling frame."""
    below = None if error.__traceback__ is None else error.__traceback__.tb_next
    lines = traceback.format_exception(type(error), error, below or error.__traceback__)
    return "".join(lines)[-_MOST_TRACE:]


def _array_of(answer: Any, name: str) -> NDArray[Any]:
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:
        raise UnusableError(f"{name} returned a {type(answer).__name__} that is no array ({error})") from error
    if array.dtype.kind not in "fiu":
        raise UnusableError(f"{name} returned an array of type {array.dtype}; allowed: real numbers")
    return array


def numbers_of(answer: Any, shape: tuple[int, ...], name: str = "act") -> NDArray[np.float64]:
    """Turn an AV's answer into float64 of a shape.

    Raises:
        UnusableError: The answer is no array of real numbers of that shape.
    """
    array = _array_of(answer, name)
    if array.shape != shape:
        wanted = ", ".join(map(str, shape))
        raise UnusableError(f"{name} returned an array of shape {array.shape}; expected ({wanted})")
    return np.ascontiguousarray(array, dtype=np.float64)


def poses_of(answer: Any, leading: tuple[int, ...], name: str) -> NDArray[np.float64]:
    """Turn trajectories (*leading, M, 3 to 5) into (*leading, M, 5); what is not given is NaN.

    Raises:
        UnusableError: They are of another shape.
    """
    array = _array_of(answer, name)
    if array.ndim != len(leading) + 2 or array.shape[: len(leading)] != leading:
        wanted = ", ".join([*map(str, leading), "M", "3 to 5"])
        raise UnusableError(f"{name} returned an array of shape {array.shape}; a trajectory is ({wanted})")
    m, columns = array.shape[-2:]
    if m < 2 or not _LEAST_POSE <= columns <= _POSE:
        raise UnusableError(
            f"{name} returned a trajectory of {m} poses with {columns} numbers each; expected at least 2 poses of "
            "time, x, y, and if you like heading and speed"
        )
    out = np.full((*leading, m, _POSE), np.nan)
    out[..., :columns] = array
    return out


class Driver:
    """An AV in its process, whatever its interface.

    Attributes:
        about: What the simulator must know: its `form` ("view" for interface 1, else one of `ANSWERS`), how many other
            vehicles it sees (`objects`, -1: all), and if it `remembers` what it saw before in a test ("yes", "no").
        failed: Worlds in which it failed at the last question, though not in others: what ("raised" or "answer") and
            how.
        traces: For each such way to fail the AV's traceback, where there is one.
    """

    def __init__(self, av: Any) -> None:
        self.av = av
        self.failed: dict[int, tuple[str, str]] = {}
        self.traces: dict[str, str] = {}
        self.about: dict[str, str] = {"form": "view", "objects": "", "remembers": "yes" if _resets(av) else "no"}

    def setup(self, context: AvContext) -> None:
        """Tell the AV its world."""
        self.context = context
        if hasattr(self.av, "setup"):
            self.av.setup(context)

    def close(self) -> None:
        """Give up what the AV holds outside this process."""

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Tell it that tests begin."""
        if hasattr(self.av, "reset"):
            self.av.reset(worlds, seeds)

    def answer(self, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ask it; `seen` holds all numbers of the views, in bytes as they came (`dtype`, `shape`)."""
        return numbers_of(self.av.act(seen), (self.context.batch, 2))

    def seen(self, content: memoryview) -> NDArray[Any]:
        """Make the array that the AV sees of its bytes."""
        return np.frombuffer(content, np.float32).reshape(self.context.batch, *VIEW_SHAPE)


def _resets(av: Any) -> bool:
    """May the AV remember what it saw in a test? Without a `reset` of its own it could not forget it either."""
    own = getattr(type(av), "reset", None)
    return own is not None and own is not Av.reset and own is not PlannerForAll.reset


class _ForAll(Driver):
    """An AV of interface 2 that answers for all worlds at once."""

    def __init__(self, av: Any) -> None:
        super().__init__(av)
        self.form = getattr(av, "answers", "lane")
        at_site = self.form == AT_SITES
        self._columns, self._scenes = (site_scene.COLUMNS, SiteScenes) if at_site else (len(COLUMNS), Scenes)
        objects = getattr(av, "objects", site_scene.AGENTS if at_site else NEAREST)
        self.history = getattr(av, "history", 0)
        if self.form not in ANSWERS:
            raise WrongAvError(f"its attribute answers is {self.form!r}; allowed: {', '.join(ANSWERS)}")
        if objects is not None and (not isinstance(objects, int) or objects < 0):
            raise WrongAvError(f"its attribute objects is {objects!r}; allowed: a number, or None for all")
        if not isinstance(self.history, int) or not 0 <= self.history <= 1000:
            raise WrongAvError(f"its attribute history is {self.history!r}; allowed: 0 to 1000 scenes")
        remembers = self.about["remembers"] == "yes" or self.history > 0
        self.about = {
            "form": self.form, "objects": str(-1 if objects is None else objects),
            "remembers": "yes" if remembers else "no",
        }  # fmt: skip
        self._before: list[NDArray[np.float64]] = []

    def seen(self, content: memoryview) -> NDArray[Any]:
        return np.frombuffer(content, np.float64).reshape(self.context.batch, -1, self._columns)

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        for table in self._before:
            table[worlds] = 0.0
        super().reset(worlds, seeds)

    def answer(self, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        before = tuple(self._scenes(table, self.context) for table in self._before)
        answer = self.decide(self._scenes(seen, self.context, before))
        if self.history:
            self._before = [seen.copy(), *self._before[: self.history - 1]]
        return answer

    def decide(self, scenes: Any) -> NDArray[np.float64]:
        """Ask the AV."""
        return self._read(self.av.act(scenes), (self.context.batch,), "act")

    def _read(self, given: Any, leading: tuple[int, ...], name: str) -> NDArray[np.float64]:
        """Make of an answer what is sent, (*leading, 2) or (*leading, M, 5); of an acceleration a pair with 0.

        Raises:
            UnusableError: It is of another shape.
        """
        if self.form == "trajectory":
            return poses_of(given, leading, name)
        if self.form == AT_SITES:
            pairs = np.zeros((*leading, 2))
            pairs[..., 0] = numbers_of(given, leading, name).reshape(leading)
            return pairs
        return numbers_of(given, (*leading, 2), name)


class WorldDriver(_ForAll, ABC):
    """An AV of interface 2 whose answers come world by world, so that one may fail without the others."""

    @abstractmethod
    def given(self, scenes: Any) -> dict[int, NDArray[np.float64]]:
        """Ask for the answers in the worlds that drive, (2,) or (M, 5); those that fail go into `failed`."""

    def decide(self, scenes: Any) -> NDArray[np.float64]:
        """Ask the AV; rows of worlds in which it fails are NaN."""
        self.failed, self.traces = {}, {}
        given = self.given(scenes)
        if self.form != "trajectory":
            answers = np.full((self.context.batch, 2), np.nan)
        else:
            most = max((len(plan) for plan in given.values()), default=2)
            answers = np.full((self.context.batch, most, _POSE), np.nan)
        for b, answer in given.items():
            answers[b, : len(answer)] = answer
        return answers


class _OneByOne(WorldDriver):
    """An AV of interface 2 that plans for one world at a time; each world has an instance, unless it has no memory."""

    def __init__(self, av: Any, make: Callable[[], Any]) -> None:
        super().__init__(av)
        self._make = make
        self._forgets = not getattr(av, "memory", True)
        self._resets = hasattr(av, "reset")
        self.about["remembers"] = "no" if self._forgets and self.history == 0 else "yes"
        self._of: dict[int, Any] = {}

    def _made(self, *, anew: bool) -> Any:
        av = self._make() if anew else self.av
        if hasattr(av, "setup"):
            av.setup(self.context)
        return av

    def setup(self, context: AvContext) -> None:
        self.context = context
        self._of = {}
        self.av = self._made(anew=False)

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        for table in self._before:
            table[worlds] = 0.0
        if self._forgets:
            return
        for b, seed in zip(worlds.tolist(), seeds.tolist()):  # noqa: B905 - for Python 3.9
            if not self._resets:
                self._of.pop(b, None)
                continue
            if b not in self._of:
                self._of[b] = self._made(anew=True)
            self._of[b].reset(seed)

    def _planner(self, b: int) -> Any:
        if self._forgets:
            return self.av
        if b not in self._of:
            self._of[b] = self._made(anew=True)
        return self._of[b]

    def given(self, scenes: Any) -> dict[int, NDArray[np.float64]]:
        asked = np.flatnonzero(scenes.running).tolist()
        return {b: answer for b in asked if (answer := self._answer_in(b, scenes)) is not None}

    def _answer_in(self, b: int, scenes: Any) -> NDArray[np.float64] | None:
        """Ask the planner of one world; None if it fails."""
        try:
            return self._read(self._planner(b).plan(scenes.scene(b)), (), "plan")
        except UnusableError as error:
            self.failed[b] = "answer", f"gave no usable answer: {error}"
        except Exception as error:  # whatever the user's code raises ends this world's test only
            self.failed[b] = "raised", f"raised {described(error)}"
            self.traces[self.failed[b][1]] = traced(error)
        self._of.pop(b, None)
        return None


def driver_of(av: Any, make: Callable[[], Any] | None = None) -> Driver:
    """Find out which interface an AV has.

    Args:
        av: The AV.
        make: Makes another one; None: its class does.

    Raises:
        WrongAvError: It says something of itself that cannot be.
    """
    if callable(getattr(av, "plan", None)) and not callable(getattr(av, "act", None)):
        return _OneByOne(av, make or type(av))
    interface = getattr(av, "interface", 1)
    if interface not in (1, 2):
        raise WrongAvError(f"its attribute interface is {interface!r}; allowed: 1, 2")
    return Driver(av) if interface == 1 else _ForAll(av)
