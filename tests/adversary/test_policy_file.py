"""Policy files: what was written comes back, and nothing else is taken for a policy."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save

from cornerforge._checksums import NoChecksumError, write_tensors
from cornerforge.drivers.policy import HEADS, NetworkShape, n_weights
from cornerforge.errors import FileFormatError, OutputError
from cornerforge.experiment.policy_file import Policy, load_policy, policy_hash, policy_numbers, save_policy
from cornerforge.sim.controllers import Mask
from cornerforge.sim.observe import N_OBSERVATION

SHAPE = NetworkShape(N_OBSERVATION, 2, 1, 8)


@pytest.fixture
def policy(seed: int) -> Policy:
    weights = np.random.default_rng(seed).standard_normal(n_weights(SHAPE)).astype(np.float32)
    return Policy(weights, SHAPE, True, {"seed": 3, "curve": [{"loss": None, "tests": 7}]})


def parts(path: Path) -> tuple[np.ndarray, dict[str, Any]]:
    """Weights, and the header without its checksum."""
    with safe_open(path, framework="numpy") as file:
        header = json.loads(file.metadata()["cornerforge"])
        return file.get_tensor("weights"), {key: value for key, value in header.items() if key != "sha256"}


def test_round_trip(policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "new" / "p.safetensors"
    save_policy(policy, path)
    loaded = load_policy(path)
    assert np.array_equal(loaded.weights, policy.weights)
    assert (loaded.shape, loaded.bounded, loaded.about) == (policy.shape, policy.bounded, policy.about)
    assert policy_hash(loaded) == policy_hash(policy)
    assert policy_numbers(loaded).weights.dtype == np.float32
    assert [entry.name for entry in path.parent.iterdir()] == ["p.safetensors"]
    assert (loaded.budget, loaded.head) == (None, "greedy")
    save_policy(replace(policy, budget=4.5), path)
    assert load_policy(path).budget == 4.5
    save_policy(replace(policy, budget=4.5, budget_of="excess", steers_from=5), path)
    assert (load_policy(path).budget_of, load_policy(path).steers_from) == ("excess", 5)
    assert load_policy(path).mask == Mask(1, 4_500_001, 1, 5)
    save_policy(replace(policy, head="softmax"), path)
    assert parts(path)[1]["head"] == load_policy(path).head == "softmax"
    assert policy_numbers(load_policy(path)).head == HEADS["softmax"]
    save_policy(policy, path)
    first = path.read_bytes()
    save_policy(loaded, path)
    assert path.read_bytes() == first


def test_the_hash_is_of_what_decides_how_it_acts(policy: Policy) -> None:
    changed = policy.weights.copy()
    changed[5] = np.nextafter(changed[5], np.float32(np.inf))
    hashes = {
        policy_hash(policy),
        policy_hash(Policy(changed, SHAPE, True, policy.about)),
        policy_hash(Policy(policy.weights, SHAPE, False, policy.about)),
    }
    hashes |= {policy_hash(replace(policy, budget=budget)) for budget in (0.0, 5.0, 6.0)}
    hashes.add(policy_hash(replace(policy, head="softmax")))
    hashes |= {
        policy_hash(replace(policy, budget=5.0, budget_of="excess")),
        policy_hash(replace(policy, steers_from=5)),
    }
    assert len(hashes) == 9
    assert policy_hash(Policy(policy.weights, SHAPE, True, {})) == policy_hash(policy)


def test_a_policy_of_the_observation_before_is_read_where_it_meant_the_same(policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    for budget in (None, 10.0, 10.5):
        save_policy(replace(policy, budget=budget), path)
        path.write_bytes(changed_header(path, observation_version=2))
        if budget == 10.5:
            with pytest.raises(FileFormatError, match="observation version 2"):
                load_policy(path)
        else:
            assert policy_hash(load_policy(path)) == policy_hash(replace(policy, budget=budget))


def changed_header(path: Path, **changes: object) -> bytes:
    weights, header = parts(path)
    write_tensors(path, "cornerforge", header | changes, {"weights": weights}, "it")
    return path.read_bytes()


def changed_weights(path: Path, weights: np.ndarray) -> bytes:
    write_tensors(path, "cornerforge", parts(path)[1], {"weights": weights}, "it")
    return path.read_bytes()


def test_a_file_of_version_1_is_greedy_and_has_the_hash_that_it_had(policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    save_policy(policy, path)
    weights, header = parts(path)
    del header["head"]
    write_tensors(path, "cornerforge", header | {"schema_version": 1}, {"weights": weights}, "it")
    old = load_policy(path)
    assert old.head == "greedy"
    shape = " ".join(str(number) for number in (2, N_OBSERVATION, 2, 1, 8))
    told = f"{shape} True None".encode() + policy.weights.astype("<f4").tobytes()
    assert policy_hash(old) == hashlib.sha256(told).hexdigest()[:16]


def with_nan(path: Path) -> bytes:
    weights = parts(path)[0].copy()
    weights[3] = np.nan
    return changed_weights(path, weights)


def test_any_changed_bit_is_noticed(policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    save_policy(policy, path)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for bit in rng.integers(0, 8 * len(whole), 200).tolist():
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with pytest.raises(FileFormatError):
            load_policy(path)


def test_a_policy_without_checksum_is_refused(policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    save_policy(policy, path)
    weights, header = parts(path)
    path.write_bytes(save({"weights": weights}, metadata={"cornerforge": json.dumps(header)}))
    with pytest.raises(NoChecksumError, match=r"carries no checksum.*cornerforge migrate"):
        load_policy(path)


NETWORK = {"n_inputs": N_OBSERVATION, "n_shared": 2, "n_stream": 1, "width": 8}
DAMAGES = {
    "empty": (lambda _: b"", "damaged"),
    "text": (lambda _: b"weights, please\n" * 40, "damaged"),
    "truncated": (lambda p: p.read_bytes()[:-40], "damaged"),
    "header cut": (lambda p: p.read_bytes()[:30], "damaged"),
    "foreign safetensors": (lambda _: save({"weights": np.zeros(4, np.float32)}), "no policy of cornerforge"),
    "no weights": (
        lambda _: save({"w": np.zeros(4, np.float32)}, metadata={"cornerforge": "{}"}),
        "no checksum",
    ),
    "header no JSON": (lambda p: save({"weights": parts(p)[0]}, metadata={"cornerforge": "{"}), "damaged"),
    "header a list": (lambda p: save({"weights": parts(p)[0]}, metadata={"cornerforge": "[]"}), "no JSON object"),
    "newer schema": (lambda p: changed_header(p, schema_version=4), "schema version 4"),
    "unknown head": (lambda p: changed_header(p, head="softmacks"), 'Did you mean "softmax"'),
    "head a number": (lambda p: changed_header(p, head=1), "head"),
    "other observation": (lambda p: changed_header(p, observation_version=99), "observation version 99"),
    "older observation": (lambda p: changed_header(p, observation_version=1), "Train it again"),
    "negative budget": (lambda p: changed_header(p, budget=-1.0), "budget"),
    "budget a text": (lambda p: changed_header(p, budget="much"), "budget"),
    "budget without a bound": (lambda p: changed_header(p, bounded=False, budget=3.0), "bounded adversary only"),
    "fewer inputs": (lambda p: changed_header(p, network=NETWORK | {"n_inputs": 39}), "39 entries"),
    "unknown layer": (lambda p: changed_header(p, network=NETWORK | {"n_heads": 4}), "n_heads"),
    "giant network": (lambda p: changed_header(p, network=NETWORK | {"width": 10**9}), "width"),
    "other width": (lambda p: changed_header(p, network=NETWORK | {"width": 9}), "do not fit"),
    "not a number": (with_nan, "not finite"),
    "too few weights": (lambda p: changed_weights(p, parts(p)[0][:-1]), "do not fit"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_no_whole_policy_is_refused(damage: str, policy: Policy, tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    save_policy(policy, path)
    make, reason = DAMAGES[damage]
    path.write_bytes(make(path))
    with pytest.raises(FileFormatError, match=reason) as caught:
        load_policy(path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cornerforge train"):
        load_policy(tmp_path / "none.safetensors")


def test_a_place_that_cannot_be_written_is_named(policy: Policy, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="Cannot write"):
        save_policy(policy, tmp_path / "file" / "p.safetensors")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="Cannot write"):
        save_policy(policy, tmp_path / "folder")
    assert {entry.name for entry in tmp_path.iterdir()} == {"file", "folder"}
