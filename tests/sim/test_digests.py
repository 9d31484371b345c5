"""The ground is pinned: 70,000 tests of every kind of driver in every ODD, by the digest of their outcomes.

A change that alters any outcome shows here first; it needs `make golden` and a changelog line that says so.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hand_built import setting_of

from cornerforge.drivers.avs import AVS
from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, n_weights
from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.sim.controllers import Mask, cast_of
from cornerforge.sim.observe import N_OBSERVATION, budget_units
from cornerforge.sim.runner import Tally, drive_chunk
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import n_slots
from cornerforge.types import ODDS, Odd

TESTS = 334
SEED = 9


def random_policy(seed: int, width: int = 16) -> PolicyNumbers:
    """A network of random weights; its Q lie so close together that many actions are tried."""
    shape = NetworkShape(N_OBSERVATION, 1, 1, width)
    weights = np.random.default_rng(seed).normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


@dataclass(frozen=True)
class Bvs:
    """Who drives the background vehicles, by its name in the list."""

    name: str
    adversary: str | None = None
    bounded: bool = False
    idm: bool = False
    budget: float | None = None
    temperature: float = 0.0
    mixture: tuple[float | None, ...] = field(default=())
    """Budgets of the policies of a mixture, the first of which is unbounded."""

    def setting(self, model: NddModel, odd: Odd, av: str) -> Setting:
        setting = setting_of(
            model, odd, av=av_of(av), adversary=self.adversary, bounded=self.bounded, idm_bvs=self.idm,
            policy=random_policy(1), budget=self.budget,
        )  # fmt: skip
        if self.mixture:
            members = [random_policy(k, width=8 * (k + 1)) for k in range(len(self.mixture))]
            masks = [Mask(int(k > 0), budget_units(budget)) for k, budget in enumerate(self.mixture)]
            widest = max(members, key=lambda member: member.width)
            cast = cast_of(members, masks)
            setting = setting.with_drivers(policy=widest, cast=cast)
        return setting.with_drivers(temperature=self.temperature)


DRIVERS = (
    Bvs("natural"),
    Bvs("idm", idm=True),
    Bvs("uniform", "uniform"),
    Bvs("lane-changer bounded", "lane-changer", bounded=True),
    Bvs("swerve", "swerve"),
    Bvs("policy", "policy"),
    Bvs("policy bounded", "policy", bounded=True),
    Bvs("policy with a budget", "policy", bounded=True, budget=6.0),
    Bvs("policy softmax", "policy", temperature=0.3),
    Bvs("mixture", "policy", mixture=(None, None, 4.0)),
)


def digest_of(setting: Setting, odd: Odd, tests: int) -> str:
    tally = Tally()
    tally.add(*drive_chunk(setting, n_slots(odd), SEED, 0, tests, False))
    return f"{tally.tests} {tally.av_crashes} {tally.digest.hexdigest()}"


def runs() -> list[tuple[Bvs, Odd, str]]:
    avs = [name for name, av in AVS.items() if av.kind != "junction"]  # those of sites drive on no road
    of_cars = [(bvs, odd, av) for bvs in DRIVERS for odd in ODDS.values() for av in avs if odd.name != "mixed"]
    return of_cars + [(bvs, ODDS["mixed"], "idm-mobil") for bvs in DRIVERS]


def lines_of(wanted: list[tuple[Bvs, Odd, str]], model: NddModel) -> list[str]:
    with ThreadPoolExecutor(2) as pool:
        found = pool.map(lambda run: digest_of(run[0].setting(model, run[1], run[2]), run[1], TESTS), wanted)
        return [f"{bvs.name} | {odd.name} | {av} | {text}" for (bvs, odd, av), text in zip(wanted, found, strict=True)]


@pytest.mark.full
def test_a_hundred_thousand_tests_end_as_they_did(model: NddModel, golden: Callable[[str, str], None]) -> None:
    golden("digests.txt", "\n".join(lines_of(runs(), model)) + "\n")


def test_one_run_in_eleven_ends_as_it_did(model: NddModel) -> None:
    """All drivers are among them, and most AVs."""
    some = runs()[::11]
    assert {bvs.name for bvs, _, _ in some} == {bvs.name for bvs in DRIVERS}
    stored = (Path(__file__).parents[1] / "golden" / "digests.txt").read_text(encoding="utf-8").splitlines()
    assert lines_of(some, model) == stored[::11]
