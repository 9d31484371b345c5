"""Inputs that failed once: each is answered, or refused in one line, and leaves nothing half made.

An entry of `corpus/` is a recipe: the seed is made by the program of today, then damaged. `make fuzz` finds new ones.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fuzz.damage import could_notice, done, drawn
from fuzz.judge import FAILURES
from fuzz.kinds import KINDS, draw_input
from fuzz.parts import parts_of, write_parts
from fuzz.seeds import seed_folder
from fuzz.workers import Worker

pytestmark = pytest.mark.full

CORPUS = sorted((Path(__file__).parent / "corpus").glob("*.json"))


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("seeds")


@pytest.fixture(scope="module")
def worker(seeds: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    one = Worker(seeds, tmp_path_factory.mktemp("room"), 0)
    yield one
    one.stop()


@pytest.mark.parametrize("file", CORPUS, ids=[file.stem for file in CORPUS])
def test_what_failed_once_does_not_fail_again(file: Path, worker: Worker) -> None:
    outcome, detail = worker.run(json.loads(file.read_text(encoding="utf-8")))
    assert outcome not in (*FAILURES, "stale", "broken"), detail


def test_the_judge_sees_what_is_wrong(seeds: Path, tmp_path: Path) -> None:
    """A control: readers that believe another text, leave half a file, raise, end the process, never end."""
    worker = Worker(seeds, tmp_path, 1, cpu_s=2.0)
    damage = [{"file": "c.toml", "op": "place.text"}]
    wanted = {"believes": "silent", "leaves": "partial", "raises": "traceback", "dies": "traceback", "hangs": "hang"}
    found = {door: worker.run({"kind": "control", "door": door, "damage": damage})[0] for door in wanted}
    worker.stop()
    assert found == wanted


@pytest.mark.parametrize("name", ["model", "tracks", "config"])
def test_a_recipe_is_json_and_makes_the_same_damage_again(name: str, seeds: Path, tmp_path: Path) -> None:
    folder = seed_folder(seeds, name)
    kind = next(kind for kind in KINDS if kind.seed == name and kind.words is None)
    for number in range(20):
        drawn_twice = [draw_input(np.random.default_rng([5, number]), kind, folder) for _ in range(2)]
        assert drawn_twice[0] == drawn_twice[1] == json.loads(json.dumps(drawn_twice[0]))
    whole = next(path for path in sorted(folder.rglob("*")) if path.is_file())
    for number in range(20):
        recipe = drawn(np.random.default_rng([6, number]), whole, "f" + whole.suffix)
        contents = []
        for copy in ("a", "b"):
            place = tmp_path / copy
            place.mkdir(exist_ok=True)
            (place / recipe["file"]).unlink(missing_ok=True)
            (place / recipe["file"]).write_bytes(whole.read_bytes())
            if not recipe["op"].startswith("place."):
                done(place, recipe)
            contents.append((place / recipe["file"]).read_bytes())
        assert contents[0] == contents[1]


def test_a_file_put_together_again_is_the_same_to_its_reader(seeds: Path, tmp_path: Path) -> None:
    from cornerforge.experiment.policy_file import load_policy, policy_hash

    whole = seed_folder(seeds, "policy") / "p.safetensors"
    write_parts(tmp_path / whole.name, parts_of(whole).copied())
    assert policy_hash(load_policy(tmp_path / whole.name)) == policy_hash(load_policy(whole))


def test_what_nobody_could_notice() -> None:
    """A number that may be meant so, without a checksum; not one that cannot be meant."""
    one = {"file": "x.json", "op": "json.set", "path": ["a"]}
    assert not could_notice(one | {"value": "0.5"})
    assert could_notice(one | {"value": "NaN"})
    assert could_notice(one | {"value": "0.5", "checked": True})
