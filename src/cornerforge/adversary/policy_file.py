"""Policy files: weights and what they are for, in safetensors (no pickle, no PyTorch needed)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cornerforge._checks import check_json, check_number
from cornerforge._files import writing
from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, n_weights
from cornerforge.errors import FileFormatError, InputError
from cornerforge.sim import N_OBSERVATION, OBSERVATION_VERSION

__all__ = [
    "MAX_BUDGET",
    "POLICY_SCHEMA",
    "Policy",
    "check_budget",
    "load_policy",
    "policy_hash",
    "policy_numbers",
    "save_policy",
]

POLICY_SCHEMA = 1
MAX_BUDGET = 1e6
"""Largest likelihood budget [nats], far above any shortfall of a test; a larger one is a mistake for "no limit"."""


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
    """

    weights: NDArray[np.float32]
    shape: NetworkShape
    bounded: bool
    about: Mapping[str, object]
    budget: float | None = None


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
    """The policy as kernels take it."""
    s = policy.shape
    return PolicyNumbers(policy.weights, s.n_inputs, s.n_shared, s.n_stream, s.width)


def policy_hash(policy: Policy) -> str:
    """SHA-256 (first 16 hex digits) over what decides how it acts: shape, mask and weights."""
    s = policy.shape
    mask = f"{policy.bounded} {policy.budget}"
    head = f"{OBSERVATION_VERSION} {s.n_inputs} {s.n_shared} {s.n_stream} {s.width} {mask}"
    return hashlib.sha256(head.encode() + policy.weights.astype("<f4").tobytes()).hexdigest()[:16]


def save_policy(policy: Policy, path: Path) -> None:
    """Write a policy to a file beside, then rename it, so that a reader never sees half of it.

    Raises:
        InputError: `about` is not JSON.
        OutputError: It cannot be written; nothing is left of it then.
    """
    header = {
        "schema_version": POLICY_SCHEMA,
        "observation_version": OBSERVATION_VERSION,
        "network": asdict(policy.shape),
        "bounded": policy.bounded,
        "budget": policy.budget,
        "about": check_json("about", policy.about),
    }
    # Not its own `save_file`: that gives the file to its owner only and reports a full disk as a fault of the format.
    content = save({"weights": policy.weights}, metadata={"cornerforge": json.dumps(header, sort_keys=True)})
    with writing(path, "the policy") as part:
        part.write_bytes(content)


def load_policy(path: Path) -> Policy:
    """Read a policy file.

    Raises:
        FileFormatError: Missing, damaged, no policy of cornerforge, of another schema, or made for another observation.
    """
    if not path.is_file():
        raise FileFormatError(f"No policy file {path}; make one with: cornerforge train --out {path}")
    try:
        with safe_open(path, framework="numpy") as file:
            text = (file.metadata() or {}).get("cornerforge")
            if text is None:
                raise FileFormatError(f"{path} is a safetensors file but no policy of cornerforge.")
            header = json.loads(text)
            if not isinstance(header, dict):
                raise FileFormatError(f"{path}: its header is no JSON object, so it is no policy of cornerforge.")
            weights = file.get_tensor("weights")
        _check_versions(header, path)
        shape = NetworkShape(**header["network"])
        bounded = bool(header["bounded"])
        budget = check_budget(header["budget"], bounded=bounded)
        # A copy: what the file gives may not be writable, which kernels would take for another type.
        policy = Policy(np.array(weights, dtype=np.float32), shape, bounded, header["about"], budget)
    except (SafetensorError, OSError, KeyError, TypeError, json.JSONDecodeError, InputError) as error:
        raise FileFormatError(
            f"Policy file {path} is damaged or no policy ({type(error).__name__}: {error})."
        ) from error
    if policy.weights.shape != (n_weights(shape),) or not np.isfinite(policy.weights).all():
        raise FileFormatError(
            f"Policy file {path}: {policy.weights.size} weights do not fit its network, or are not finite."
        )
    return policy


def _check_versions(header: Mapping[str, object], path: Path) -> None:
    schema = header.get("schema_version")
    if schema != POLICY_SCHEMA:
        raise FileFormatError(
            f"Policy file {path} has schema version {schema}; this cornerforge reads {POLICY_SCHEMA}."
        )
    version = header.get("observation_version")
    network = header.get("network")
    inputs = network.get("n_inputs") if isinstance(network, dict) else None
    if version != OBSERVATION_VERSION or inputs != N_OBSERVATION:
        raise FileFormatError(
            f"Policy file {path} was trained for observation version {version} with {inputs} entries; "
            f"this cornerforge has version {OBSERVATION_VERSION} with {N_OBSERVATION}. Train it again."
        )
