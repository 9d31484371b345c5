"""What this machine makes of the same inputs, printed; `test_same_bits.py` runs it in unlike surroundings.

python tests/bits_of_this_machine.py functions
python tests/bits_of_this_machine.py tests NUMBER
python tests/bits_of_this_machine.py cases
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from hand_built import setting_of

from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, n_weights
from cornerforge.ndd.model import default_model_path, load_model, model_hash
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.recorder import Recorder, scenario_digest
from cornerforge.sim.runner import crashed_tests, drive_chunk, simulate
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import n_slots
from cornerforge.types import Odd

__all__ = ["recorded_cases"]

SEED = 20_261_122
CASES_PER_KIND = 12
_ODD = Odd()


def _policy() -> PolicyNumbers:
    """A network of random weights, drawn by a generator that is the same everywhere, on a grid that sums keep exact."""
    shape = NetworkShape(N_OBSERVATION, 2, 1, 16)
    weights = np.random.default_rng(7).integers(-64, 65, n_weights(shape)) / 256.0
    return PolicyNumbers(weights.astype(np.float32), shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


def _kinds(odd: Odd) -> Iterator[tuple[str, Setting]]:
    """Between them they use every elementary function."""
    model = load_model(default_model_path())
    yield "swerve", setting_of(model, odd, adversary="swerve")
    yield "bounded with a budget", setting_of(model, odd, adversary="lane-changer", bounded=True, budget=12.0)
    yield (
        "policy by chance",
        setting_of(model, odd, adversary="policy", policy=_policy()).with_drivers(temperature=0.3),
    )
    yield "nobody", setting_of(model, odd)


def library_bits() -> str:
    """Hash of what the C library gives for exp, log, sin, cos and atan: it differs where the library does."""
    points = np.random.default_rng(1).uniform(0.01, 5.0, 20_000).tolist()
    values = [f(x) for x in points for f in (math.exp, math.log, math.sin, math.cos, math.atan)]
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()


def function_bits() -> str:
    """Hash of our own for the same, compiled here and now."""
    from cornerforge._elementary import atan, exp, log, sin_cos
    from cornerforge._philox import normal_pair

    points = np.random.default_rng(1).uniform(0.01, 5.0, 20_000).tolist()
    values = [value for x in points for value in (exp(x), exp(-40.0 * x), log(x), *sin_cos(3.0 * x), atan(x))]
    words = np.random.default_rng(2).integers(0, 2**32, (2000, 2), dtype=np.uint64)
    values += [z for a, b in words for z in normal_pair(a, b)]
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()


def test_bits(tests: int) -> str:
    """Digest of the outcomes of so many tests, a line for each kind."""
    each = tests // 4
    slots = n_slots(_ODD)
    return "\n".join(
        f"{kind}: {simulate(setting, slots, seed=SEED, tests=each).digest.hexdigest()}"
        for kind, setting in _kinds(_ODD)
    )


def recorded_cases() -> str:
    """The first crashes of each kind (the first tests where there are none), recorded: a line with digests of each.

    The first digest is over all motion, the second over the probabilities of what the critical BV did.
    """
    lines = [f"naturalistic model {model_hash(load_model(default_model_path()))[:32]}"]
    slots = n_slots(_ODD)
    at_once = replace(_ODD, max_jerk=math.inf)
    kinds = [(kind, _ODD, setting) for kind, setting in _kinds(_ODD)]
    kinds += [(f"{kind}, no limit of jerk", at_once, setting) for kind, setting in _kinds(at_once)]
    for kind, odd, setting in kinds:
        out, _ = drive_chunk(setting, slots, SEED, 0, 400, False)
        tests = crashed_tests(0, out)[:CASES_PER_KIND] or [0, 1, 2]
        recorder = Recorder(setting, odd)
        for test in tests:
            scenario = recorder.record(SEED, test)
            chances = hashlib.sha256(scenario.log_prob_nde.tobytes())
            lines.append(f"{kind} {SEED}:{test} {scenario_digest(scenario)[:32]} {chances.hexdigest()[:32]}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    what = sys.argv[1]
    print(library_bits())
    if what == "functions":
        print(function_bits())
    elif what == "tests":
        print(test_bits(int(sys.argv[2])))
    else:
        print(recorded_cases(), end="")
