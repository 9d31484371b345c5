"""Hostile calls of the Python interface and of environments: one argument is of another kind, or out of range."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import cornerforge

__all__ = ["call", "hostile_call", "plain_call"]

VALUES: dict[str, Callable[[], Any]] = {
    "none": lambda: None, "true": lambda: True, "minus": lambda: -1, "nil": lambda: 0, "two": lambda: 2,
    "half": lambda: 0.5, "nan": lambda: float("nan"),
    "inf": lambda: float("inf"), "huge": lambda: 10**40, "negative zero": lambda: -0.0, "text": lambda: "x",
    "empty": lambda: "", "surrogate": lambda: "\ud800", "nul": lambda: "a\x00b",
    "bytes": lambda: b"x", "list": list, "nested": lambda: [[1], [2, "x"]], "dict": dict, "tuple": lambda: (1, 2),
    "set": lambda: {1}, "object": object, "class": lambda: Path,
    "path": lambda: Path("lib"), "nowhere": lambda: Path("nowhere"), "array": lambda: np.zeros(3),
    "scalar array": lambda: np.array(3), "int8": lambda: np.int8(-3), "float32": lambda: np.float32(2.0),
    "nan array": lambda: np.full(4, np.nan), "object array": lambda: np.array([None, "x"], dtype=object),
    "complex": lambda: 1j, "function": lambda: print, "iterator": lambda: iter([1]), "text list": lambda: ["x", "y"],
}  # fmt: skip
INTERFACE: dict[str, dict[str, Any]] = {
    "simulate": {"tests": 2, "threads": 1}, "rate": {"method": "mc", "max_tests": 50, "threads": 1},
    "query": {"library": "lib", "sql": "select 1"}, "avs": {},
    "replay": {"library": "lib", "case": "0:8"}, "export": {"library": "lib", "cases": ["0:8"], "to": "csv",
    "out": "x"}, "analyse": {"library": "lib", "out": "an", "threads": 1},
    "generate": {"policy": "lane-changer", "cases": 1, "out": "o", "threads": 1}, "retest": {"library": "lib",
    "av": "idm-mobil", "threads": 1}, "variety": {"libraries": ["lib"], "threads": 1},
    "ndd_show": {}, "read_case_file": {"path": "lib/manifest.json"}, "shrink": {"library": "lib", "cases": ["0:8"],
    "out": "s"}, "figure": {"place": "lib", "out": "f"},
    "make_report": {"place": "lib", "out": "page", "threads": 1}, "import_cases": {"files": ["lib/manifest.json"],
    "out": "i"}, "init": {"folder": "new"}, "ndd_fit": {"files": ["lib/manifest.json"], "out": "n.npz"},
}  # fmt: skip
"""Functions and what makes a small call of each; names of arguments are checked against the signature when drawn."""
_ENVIRONMENTS = (
    "reset.seed",
    "reset.options",
    "reset.options.test",
    "step",
    "vector.step",
    "vector.reset.seed",
    "make.bv",
    "make.odd",
    "make.lanes",
    "make.actions",
    "make.model",
    "make.act_every",
)


def _arguments(name: str) -> list[str]:
    """Names of a function's arguments, without those that take functions."""
    return [one for one in inspect.signature(getattr(cornerforge, name)).parameters if one not in ("progress", "up")]


def hostile_call(rng: np.random.Generator) -> list[str]:
    """Draw a call: the function, and as JSON the argument that is odd and the name of its value."""
    value = sorted(VALUES)[int(rng.integers(len(VALUES)))]
    if rng.random() < 0.4:
        return [f"env {_ENVIRONMENTS[int(rng.integers(len(_ENVIRONMENTS)))]}", json.dumps({"value": value})]
    name = sorted(INTERFACE)[int(rng.integers(len(INTERFACE)))]
    known = _arguments(name)
    if not known:
        return [name, "{}"]
    return [name, json.dumps({known[int(rng.integers(len(known)))]: value})]


def call(name: str, odd: str) -> Any:
    """Make a drawn call and return its answer as text."""
    changed = {key: VALUES[value]() for key, value in json.loads(odd).items()}
    if name.startswith("env "):
        return _environment(name.removeprefix("env "), changed["value"])
    function = getattr(cornerforge, name)
    arguments = {**INTERFACE[name], **changed}
    given = inspect.signature(function).parameters
    first = [arguments.pop(p.name) for p in given.values() if p.kind is p.POSITIONAL_OR_KEYWORD and p.name in arguments]
    return repr(function(*first, **arguments))[:200]


def _environment(what: str, value: Any) -> Any:
    import gymnasium

    import cornerforge.envs  # noqa: F401

    name = "cornerforge/Driving-v0"
    if what.startswith("make."):
        env: Any = gymnasium.make(name, **{what.removeprefix("make."): value})
        return repr(env.reset(seed=1)[1])
    if what.startswith("vector"):
        vector: Any = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
        if what == "vector.reset.seed":
            return repr(vector.reset(seed=value)[1])
        vector.reset(seed=1)
        return repr(vector.step(value)[1])
    env = gymnasium.make(name, disable_env_checker=True)
    match what:
        case "reset.seed":
            return repr(env.reset(seed=value)[1])
        case "reset.options":
            return repr(env.reset(seed=1, options=value)[1])
        case "reset.options.test":
            return repr(env.reset(seed=1, options={"test": value})[1])
    env.reset(seed=1)
    return repr(env.step(value)[1])


def plain_call(words: list[str]) -> list[str]:
    """A drawn call with nothing odd."""
    if not words[0].startswith("env "):
        return [words[0], "{}"]
    plain = {"env step": "array", "env vector.step": "array", "env make.bv": "text"}
    return [words[0], json.dumps({"value": plain.get(words[0], "two")})]
