"""Judgements of crashes: did the AV strike, and could it have avoided the crash by braking? Tests are driven again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.adversary.worlds.rewards import av_strikes
from cornerforge.counterfactual import Braking, is_avoidable
from cornerforge.recordings import Trajectories
from cornerforge.sim import Recorder, Setting, World, outcome
from cornerforge.site.tables import at_site
from cornerforge.work import Rooms, in_order

__all__ = ["judge_crash", "judge_crashes"]

_CHUNK = 256


@kernel
def judge_crash(w: World, recording: NDArray[np.void], setting: Setting, braking: Braking) -> tuple[bool, bool]:
    """Judge a recorded test that ended in a crash of the AV: did it strike, could braking have avoided the crash?

    The second is False at a site, where it is not judged.
    """
    state = w.state[0]
    partner = state.slot_b
    if at_site(setting.road.site):
        return av_strikes(w.vehicles, 0, partner, False), False
    strikes = av_strikes(w.vehicles, 0, partner, True)
    test = Trajectories(recording, w.vehicles, state.n_vehicles)
    return strikes, is_avoidable(test, state.frame, partner, setting.road, braking)


def judge_crashes(
    recorder: Callable[[], Recorder], setting: Setting, *, seed: int, tests: Sequence[int], braking: Braking,
    threads: int = 1,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:  # fmt: skip
    """Drive crashed tests again and judge each crash.

    Args:
        recorder: Makes a recorder of the run's tests, for one thread.
        setting: The run.
        seed: Of the tests.
        tests: Numbers of tests that ended in a crash of the AV, n of them; one that did not gets False twice.
        braking: How the AV would have braked.
        threads: Pool size; does not change the result.

    Returns:
        Whether the AV's front took part in the first contact, and whether braking would have avoided the crash
        (`counterfactual.is_avoidable`), bool (n,) each.

    Raises:
        InputError: `threads` is out of range.
    """
    rooms = Rooms(recorder)

    def judge(first: int, count: int) -> list[tuple[bool, bool]]:
        judged = []
        with rooms.lend() as one:
            for test in tests[first : first + count]:
                world, keep = one.drive(seed, test)
                has_crash = int(world.state["outcome"][0]) == outcome.AV_CRASH
                judged.append(judge_crash(world, keep.recording, setting, braking) if has_crash else (False, False))
        return judged

    parts = in_order(judge, 0, len(tests), chunk=_CHUNK, threads=threads)
    judged = np.array([pair for part in parts for pair in part], dtype=np.bool_).reshape(-1, 2)
    return judged[:, 0], judged[:, 1]
