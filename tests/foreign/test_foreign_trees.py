"""Trees of an AV from outside: the same as of that AV inside, with memory and without, in any batch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign.opened_av import opened
from hand_built import WIDE, setting_of

from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.av_file import av_of
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.recorder import ForeignRecorder
from cornerforge.ndd.model import NddModel
from cornerforge.rates.branching.danger import N_SEEN, WIDTH, Network
from cornerforge.rates.branching.drive import DrivenTrees, drive_trees
from cornerforge.rates.branching.foreign import ForeignTrees
from cornerforge.rates.branching.population import TREE, Plan, Tilt
from cornerforge.sim import Script, ScriptDriver, Setting, controllers, n_slots, simulate
from cornerforge.sim.world import VEHICLE

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("in_memory")]

ODD = WIDE
SLOTS = n_slots(ODD)
SIGMAS = 5.0


def plan(seed: int, level: float, *, windows: int = 1) -> Plan:
    """A plan by a network that was taught nothing."""
    rng = np.random.default_rng(seed)
    shapes = (N_SEEN, WIDTH), (WIDTH,), (WIDTH, WIDTH), (WIDTH,), (WIDTH + 1,)
    weights = [rng.normal(0.0, 0.5, shape).astype(np.float32) for shape in shapes]
    weights[-1][-1] = -6.0
    return Plan(level, 0.3 * level, 0.1, 0.02, windows, 30.0, 2.0, Network(*weights))


def trees(run: Setting, av: ForeignAv | None, tests: int, how: Plan, threads: int = 1) -> DrivenTrees:
    extra = {} if av is None else {"driver": ForeignTrees(av)}
    return drive_trees(run, SLOTS, how, seed=4, first=3, tests=tests, threads=threads, **extra)  # type: ignore[arg-type]


def same(a: DrivenTrees, b: DrivenTrees) -> bool:
    """All trees, and all crashes but for their order."""
    first, second = (
        driven.crashes[np.lexsort([driven.crashes[n] for n in ("time", "weight", "test")])] for driven in (a, b)
    )
    names = ("test", "weight", "time", "partner", "acts", "begun")
    return all((a.trees[name] == b.trees[name]).all() for name in TREE.names or ()) and all(
        np.array_equal(first[name], second[name]) for name in names
    )


@pytest.mark.usefixtures("twins")
def test_they_are_the_trees_of_the_same_av_inside(reckless: NddModel) -> None:
    """`rl` decides every half second, so a copy that has not been shown what it saw would be out of step."""
    inside = setting_of(reckless, ODD, av=av_of("rl"))
    run, how = inside.with_drivers(av=controllers.OUTSIDE), plan(0, 1e-2)
    expected = trees(inside, None, 10, how)
    assert expected.trees["crashes"].sum() > 5
    for batch in (256, 5):
        found = trees(run, opened("twins:Twin", ODD, batch=batch), 10, how)
        assert same(found, expected)
        assert found.strayed == 0
        assert found.asked > 6 * expected.trees["seconds"].sum()


@pytest.mark.usefixtures("twins")
def test_tests_drawn_from_proposals_are_those_of_the_same_av_inside(reckless: NddModel) -> None:
    """Without copies the AV is shown nothing again while its batch has a row for each test."""
    inside = setting_of(reckless, ODD, av=av_of("rl"))
    run = inside.with_drivers(av=controllers.OUTSIDE)
    how = plan(0, 1e-2)._replace(tilt=Tilt(np.array([0.3, 0.7]), np.array([0.0, 1.0]), 2))
    expected = trees(inside, None, 300, how)
    assert expected.trees["crashes"].sum() > 5
    assert expected.trees["ended"].std() > 0.1
    for batch, again in ((256, False), (5, True)):
        found = trees(run, opened("twins:Twin", ODD, batch=batch), 300, how)
        assert same(found, expected)
        assert found.strayed == 0
        assert (found.asked > expected.trees["seconds"].sum() * 10) == again


STEERS = """
import numpy as np

class Weaves:
    answers = "trajectory"
    def reset(self, seed):
        self.phase, self.seen = seed % 628 / 100, 0.0
    def plan(self, scene):
        own, t = scene.own, np.arange(0, 2, 0.2)
        self.seen += sum(o.vx for o in scene.others) * 1e-3
        y = own.y + 0.3 * t * (6 + np.sin(self.phase + self.seen) - own.y)
        return np.stack([t, own.x + own.vx * t, y], axis=1)
"""


def script_of(test: int, actions: np.ndarray) -> Script:
    """A branch of a test of seed 4: a foreign AV's recorder draws the start itself."""
    n = actions.shape[1]
    return Script(np.arange(n, dtype=np.int16), np.zeros(n, VEHICLE), actions, 4, test)


@pytest.mark.slow
def test_trees_of_an_av_that_steers_do_not_depend_on_the_batch(
    reckless: NddModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its worlds are copied with its curvature, and a copy of it is shown again what it saw; crashes replay."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weaves.py").write_text(STEERS, encoding="utf-8")
    inside, how = setting_of(reckless, ODD, av=av_of("idm-mobil")), plan(0, 1e-2)
    av = opened("weaves:Weaves", ODD)
    run = av.steering(inside)
    assert run.who.av == controllers.STEERED
    many, few = trees(run, av, 8, how), trees(run, opened("weaves:Weaves", ODD, batch=3), 8, how)
    assert same(many, few)
    assert (many.strayed, few.strayed) == (0, 0)
    assert len(many.crashes) > 3
    recorder = ForeignRecorder(av, run, ODD)
    for end, answers, actions in zip(many.crashes, many.answers, many.actions, strict=True):
        given = answers[np.isfinite(answers[:, 0])]
        kept = recorder.record_branch(script_of(int(end["test"]), actions[: end["begun"]]), given)
        assert kept.crash is not None
        assert kept.crash.slot_a == 0


@pytest.mark.slow
@pytest.mark.usefixtures("avs")
def test_an_av_without_memory_is_shown_nothing_again(reckless: NddModel) -> None:
    run, how = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE), plan(0, 1e-2)
    with_memory, without = (trees(run, opened(f"avs:{name}", ODD), 20, how) for name in ("Good", "Forgetful"))
    assert same(with_memory, without)
    assert 6 * without.trees["seconds"].sum() < without.asked <= 10 * without.trees["seconds"].sum()
    assert with_memory.asked > 1.5 * without.asked
    assert (with_memory.strayed, without.strayed) == (0, 0)
    assert same(trees(run, opened("avs:Good", ODD), 20, how, threads=2), with_memory)


@pytest.mark.usefixtures("avs")
def test_an_av_that_counts_its_calls_in_idle_rows_too_is_not_out_of_step(reckless: NddModel) -> None:
    run, how = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE), plan(0, 1e-2)
    many, few = (trees(run, opened("avs:Counts", ODD, batch=batch), 6, how) for batch in (64, 6))
    assert same(many, few)
    assert (many.strayed, few.strayed) == (0, 0)


@pytest.mark.usefixtures("avs")
def test_their_mean_is_the_rate_that_counting_gives(reckless: NddModel) -> None:
    run = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE)
    av = opened("avs:Forgetful", ODD)
    weights = trees(run, av, 2_500, plan(0, 3e-2), threads=2).trees["weight"]
    counted = simulate(run, SLOTS, seed=9, tests=5_000, threads=2, drive=av)
    rate = counted.av_crashes / counted.tests
    off = np.hypot(weights.std(ddof=1) / np.sqrt(weights.size), np.sqrt(rate / counted.tests))
    assert abs(weights.mean() - rate) < SIGMAS * off
    assert off < 0.2 * rate, "so coarse that this test shows little"


@pytest.mark.usefixtures("avs")
def test_a_branch_is_recorded_with_the_answers_that_led_to_its_crash(reckless: NddModel) -> None:
    run = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE)
    av = opened("avs:Good", ODD)
    driven = trees(run, av, 20, plan(0, 1e-2))
    recorder, scripts = ForeignRecorder(av, run, ODD), ScriptDriver(run, ODD, av)
    assert len(driven.crashes) > 5
    for k in range(0, len(driven.crashes), max(1, len(driven.crashes) // 10)):
        end, answers = driven.crashes[k], driven.answers[k]
        actions = driven.actions[k, : end["begun"]]
        given = answers[np.isfinite(answers[:, 0])]
        kept = recorder.record_branch(script_of(int(end["test"]), actions), given)
        start = scripts.start_of_test(4, int(end["test"]))
        slots = np.arange(start.size, dtype=np.int16)
        asked, _ = scripts.record(Script(slots, start, actions[:, : start.size], 4, int(end["test"])))
        for scenario in (kept, asked):
            assert scenario.crash is not None
            assert scenario.crash.slot_a == 0
            assert (scenario.crash.time, scenario.crash.slot_b) == (round(float(end["time"]), 1), end["partner"])


@pytest.mark.usefixtures("twins")
def test_an_av_that_does_not_repeat_itself_is_noticed(reckless: NddModel) -> None:
    run = setting_of(reckless, ODD, av=av_of("rl")).with_drivers(av=controllers.OUTSIDE)
    assert trees(run, opened("twins:Dice", ODD), 4, plan(0, 1e-2)).strayed > 100


@pytest.mark.processes
@pytest.mark.usefixtures("avs")
@pytest.mark.parametrize(("name", "what"), [("Raises", "raised"), ("Nan", "answered with NaN")])
def test_a_failure_is_told_in_one_sentence(reckless: NddModel, name: str, what: str) -> None:
    run = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE)
    with pytest.raises(AvFaultError, match=f"failed while trees of tests were driven.*{what}.*--method mc"):
        trees(run, opened(f"avs:{name}", ODD), 200, plan(0, 1e-2))


def test_an_av_outside_needs_a_driver(reckless: NddModel) -> None:
    run = setting_of(reckless, ODD, av=av_of("idm-mobil")).with_drivers(av=controllers.OUTSIDE)
    with pytest.raises(InputError, match="driver of its own"):
        trees(run, None, 1, plan(0, 1e-2))
