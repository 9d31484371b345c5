"""Policy files: weights and what they are for, in safetensors (no pickle, no PyTorch needed)."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_is_json, check_number
from cornerforge._checksums import read_tensors, weights_of, write_tensors
from cornerforge._schema import Closed, Whole, meant, read
from cornerforge.drivers.policy import HEADS, NetworkShape, PolicyNumbers, n_weights, numbers_of_network
from cornerforge.errors import FileFormatError, InputError
from cornerforge.sim import controllers, observe
from cornerforge.world_options import BUDGETS

__all__ = [
    "MAX_BUDGET",
    "POLICY_SCHEMA",
    "Policy",
    "PolicyHeader",
    "check_budget",
    "load_policy",
    "policy_hash",
    "policy_numbers",
    "save_policy",
]

POLICY_SCHEMA = 3
MAX_BUDGET = 1e6
"""Largest likelihood budget [nats], far above any shortfall of a test; a larger one is a mistake for "no limit"."""
_KEY = "cornerforge"


class PolicyHeader(Closed, frozen=True):
    """Header of a policy; the weights are the array `weights`, float32."""

    schema_version: Annotated[Whole, meant("Version of the file.")]
    observation_version: Annotated[Whole, meant("Version of the observation that it was trained for.")]
    network: Annotated[NetworkShape, meant("Its shape: n_inputs, n_shared, n_stream and width.")]
    bounded: Annotated[bool, meant("It takes only actions that the naturalistic model can take.")]
    budget: (
        Annotated[
            float, meant("Likelihood budget; null: no limit, and where it is not bounded.", "nats", 0.0, MAX_BUDGET)
        ]
        | None
    )
    about: Annotated[dict[str, Any], meant("How it was trained: free text and numbers that nothing depends on.")]
    head: Annotated[
        str, meant('How it acts: "greedy", or "softmax": drawn with odds exp(value). Version 1 lacks it and is greedy.')
    ] = "greedy"
    budget_of: Annotated[
        str, meant('What the budget limits: "shortfall" or "excess". Versions 1 and 2 lack it: shortfall.')
    ] = BUDGETS[0]
    steers_from: Annotated[Whole, meant("Second from which it steers. Versions 1 and 2 lack it: 0.", "s")] = 0

    def __post_init__(self) -> None:
        check_budget(self.budget, bounded=self.bounded)
        check_in("budget_of", self.budget_of, BUDGETS)
        check_in("head", self.head, tuple(HEADS))


@dataclass(frozen=True)
class Policy:
    """A learned adversary.

    Attributes:
        weights: Flat, in the layout of `drivers.policy.PolicyNumbers`, float32.
        shape: The network.
        bounded: It learned with the NDD-bounded mask and acts with it.
        about: How it was made: preset, hyperparameters, seed, ODD, AV and model hashes, curve; JSON-compatible.
        budget: Likelihood budget of a test [nats] that it learned and acts with, 0 to `MAX_BUDGET`; None: no limit.
            Only where it is bounded.
        head: How it acts, a name of `drivers.policy.HEADS`.
        budget_of: What the budget limits, a name of `world_options.BUDGETS`.
        steers_from: Second of a test from which it steers, at least 0.
    """

    weights: NDArray[np.float32]
    shape: NetworkShape
    bounded: bool
    about: Mapping[str, object]
    budget: float | None = None
    head: str = "greedy"
    budget_of: str = BUDGETS[0]
    steers_from: int = 0

    @property
    def mask(self) -> controllers.Mask:
        """Mask, as kernels take it."""
        excess = int(self.budget_of == "excess")
        return controllers.Mask(int(self.bounded), observe.budget_units(self.budget), excess, self.steers_from)


def check_budget(budget: float | None, *, bounded: bool) -> float | None:
    """Return a likelihood budget [nats] after checking it; None: no limit.

    Raises:
        InputError: It is out of range, or limits nothing because the adversary is not bounded.
    """
    if budget is None:
        return None
    if not bounded:
        raise InputError(f"budget = {budget} limits a bounded adversary only; bound it, or leave the budget out.")
    return check_number("budget", budget, low=0.0, high=MAX_BUDGET, unit="nats")


def policy_numbers(policy: Policy) -> PolicyNumbers:
    """Make what kernels take of a policy."""
    return numbers_of_network(policy.weights, policy.shape, policy.head)


def policy_hash(policy: Policy) -> str:
    """Compute SHA-256 (first 16 hex digits) over what decides how it acts: shape, mask, head and weights."""
    s = policy.shape
    mask = f"{policy.bounded} {policy.budget}"
    # A hash stays what it was when there were no other observations, heads, budgets and starts.
    more = ((policy.head, "greedy"), (policy.budget_of, BUDGETS[0]), (policy.steers_from, 0))
    mask += "".join(f" {value}" for value, usual in more if value != usual)
    facts = f"2 {s.n_inputs} {s.n_shared} {s.n_stream} {s.width} {mask}"
    return hashlib.sha256(facts.encode() + policy.weights.astype("<f4").tobytes()).hexdigest()[:16]


def save_policy(policy: Policy, path: Path) -> None:
    """Write a policy whole, or not at all.

    Raises:
        InputError: `about` is not JSON.
        OutputError: It cannot be written; nothing is left of it then.
    """
    header = {
        "schema_version": POLICY_SCHEMA,
        "observation_version": observe.OBSERVATION_VERSION,
        "network": structs.asdict(policy.shape),
        "head": policy.head,
        "bounded": policy.bounded,
        "budget": policy.budget,
        "budget_of": policy.budget_of,
        "steers_from": policy.steers_from,
        "about": check_is_json("about", policy.about),
    }
    write_tensors(path, _KEY, header, {"weights": policy.weights}, "the policy")


def load_policy(path: Path) -> Policy:
    """Read a policy file.

    Raises:
        FileFormatError: Missing, damaged, no policy of cornerforge, of another schema, or made for another observation.
    """
    if not path.is_file():
        raise FileFormatError(f"No policy file {path}; make one with: cornerforge train --out {path}")
    header, tensors = read_tensors(path, _KEY, "policy")
    _check_versions(header, path)
    told = read(PolicyHeader, header, f"Policy file {path} is damaged")
    weights = weights_of(path, tensors, n_weights(told.network), "policy")
    return Policy(
        weights, told.network, told.bounded, told.about, told.budget, told.head, told.budget_of, told.steers_from
    )


def _check_versions(header: Mapping[str, object], path: Path) -> None:
    schema = header.get("schema_version")
    if schema not in range(1, POLICY_SCHEMA + 1):
        raise FileFormatError(
            f"Policy file {path} has schema version {schema}; this cornerforge reads 1 to {POLICY_SCHEMA}."
        )
    version = header.get("observation_version")
    network = header.get("network")
    inputs = network.get("n_inputs") if isinstance(network, dict) else None
    budget = header.get("budget")
    # Version 2 showed 10 nats of what is left; up to there it is as version 3.
    is_alike = version == 2 and (not isinstance(budget, (int, float)) or budget <= 10.0)
    if not (version == observe.OBSERVATION_VERSION or is_alike) or inputs != observe.N_OBSERVATION:
        raise FileFormatError(
            f"Policy file {path} was trained for observation version {version} with {inputs} entries; "
            f"this cornerforge has version {observe.OBSERVATION_VERSION} with {observe.N_OBSERVATION}. Train it again."
        )
