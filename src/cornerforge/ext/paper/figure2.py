"""Figure 2: how the yield grows while the adversary learns."""

from __future__ import annotations

from typing import Any

from cornerforge.experiment.policy_file import Policy, policy_hash
from cornerforge.ext.paper.bench import FREE, Adversary, Bench, pooled
from cornerforge.ext.paper.item import Finding, Item, Row
from cornerforge.intervals import binomial_interval

__all__ = ["FIGURE2", "PAPER_SECONDS", "PAPER_YIELD", "seconds_to_yield"]

PAPER_YIELD = 0.286
PAPER_SECONDS = 4 * 86_400.0
_HEURISTICS = ("lane-changer", "swerve")


def _curve(policy: Policy, name: str) -> dict[str, Any]:
    """The training curve that a policy carries; shares with their exact intervals."""
    points = policy.about.get("curve")
    known = [p for p in points if p["tests"]] if isinstance(points, list) else []
    crashes = [round(p["crashes_per_test"] * p["tests"]) for p in known]
    ends = [binomial_interval(c, p["tests"]) for c, p in zip(crashes, known, strict=True)]
    return {
        "name": name,
        "decisions": [p["decisions"] for p in known],
        "seconds": [p["seconds"] for p in known],
        "epsilon": [p["epsilon"] for p in known],
        "crashes_per_test": [p["crashes_per_test"] for p in known],
        "low": [low for low, _ in ends],
        "high": [high for _, high in ends],
    }


def seconds_to_yield(policy: Policy, wanted: float = PAPER_YIELD) -> float | None:
    """Training time [s] to the first point of the curve with at least this yield, exploration included; None if never.

    A point covers the tests that ended since the previous point. None also if the times were not recorded.
    """
    curve = _curve(policy, "")
    times = zip(curve["seconds"], curve["crashes_per_test"], strict=True)
    reached = [s for s, share in times if share >= wanted and s is not None]
    return reached[0] if reached else None


def compute(bench: Bench) -> Finding:
    """Curves of preset `fast` (each seed) and, where given, of a policy of preset `paper`; yields after training."""
    curves, judged = [], []
    for k in range(bench.size.seeds):
        curves.append(_curve(bench.timed_policy(FREE, k), f"preset fast, seed {bench.seed + k}"))
        judged.append(bench.judged(FREE, "idm-mobil", k))
    fast = pooled(judged)
    note = f"preset fast, {bench.size.decisions:,} decisions, greedy, on tests of its own"
    headline = Row(
        "crashes of the AV per test with the trained adversary", PAPER_YIELD, fast["crashes_per_test"],
        fast["interval95"], "crashes per test", note,
    )  # fmt: skip
    rows = [headline, _time(bench)]
    notes = [
        "A point of our curves is the share of crashes among the tests that ended since the point before, exploring "
        "actions included; the shade is its exact 95 % interval. After training the policy acts greedily on "
        f"{bench.size.tests:,} tests that nothing was trained on.{_guided(bench.config(FREE).guided)}",
        "Of the paper's curve the text states the end only; it is drawn as one mark, and no value is read off the "
        "picture. Whether its 0.286 is per test, and with exploration on or off, is not said.",
    ]
    if bench.size.seeds > 1:
        notes.append("The interval of our yield spans from the lowest to the highest end of all seeds' intervals.")
    if bench.paper_policy is not None:
        row, curve = _paper_preset(bench, bench.paper_policy)
        rows.append(row)
        curves.append(curve)
    plain = {name: bench.judged(Adversary(name, bounded=False), "idm-mobil") for name in _HEURISTICS}
    for name, rate in plain.items():
        note = "a plain rule, nothing learned"
        rows.append(Row(f"the same of {name}", None, rate["crashes_per_test"], _ends(rate), "crashes per test", note))
    notes.append(
        "A yield alone is no merit: plain rules of three lines reach the dotted levels on the same highway without "
        "any learning, so the yield depends on the traffic, the length of a test and the time that a lane change takes."
    )
    levels = {name: rate["crashes_per_test"] for name, rate in plain.items()}
    data = {"curves": curves, "levels": levels, "paper": {"seconds": PAPER_SECONDS, "crashes_per_test": PAPER_YIELD}}
    return Finding(headline, rows, data, notes)


def _guided(share: float) -> str:
    """Experience of others that the learner sees."""
    if share == 0.0:
        return ""
    return (
        " The curve counts worlds that explore at random, as the paper's did. Left out are "
        f"{100 * share:.0f} % of the worlds, in which exploring mostly is what plain rules would do (draw level and "
        "swerve, or ram the AV from behind); preset fast learns from both, preset paper explores at random only."
    )


def _time(bench: Bench) -> Row:
    """Training time to the paper's yield, the slowest seed's."""
    times = [seconds_to_yield(bench.timed_policy(FREE, k)) for k in range(bench.size.seeds)]
    known = [t for t in times if t is not None]
    note = "" if len(known) == len(times) else f"{len(times) - len(known)} of {len(times)} seeds never reached it"
    slowest = max(known) if len(known) == len(times) else None
    return Row(f"training time to a yield of {PAPER_YIELD}", PAPER_SECONDS, slowest, None, "s", note)


def _paper_preset(bench: Bench, policy: Policy) -> tuple[Row, dict[str, Any]]:
    rate = bench.judged_policy(policy, "idm-mobil", "paper-preset")
    decisions, updates = policy.about.get("decisions", 0), policy.about.get("updates", 0)
    note = f"after {decisions:,} decisions and {updates:,} updates"
    row = Row(
        "the same with preset paper (Table 1)", PAPER_YIELD, rate["crashes_per_test"], _ends(rate), "crashes per test",
        note,
    )  # fmt: skip
    return row, _curve(policy, "preset paper (Table 1)")


def _ends(rate: dict[str, Any]) -> tuple[float, float]:
    low, high = rate["interval95"]
    return low, high


def _inputs(bench: Bench) -> dict[str, Any]:
    return {"paper_policy": None if bench.paper_policy is None else policy_hash(bench.paper_policy)}


FIGURE2 = Item(
    id="figure2",
    title="Figure 2: training",
    place="Figure 2; section Corner Case Generation",
    says="The agent was trained for 4 days until it reached its performance limit, a crash frequency of about 0.286.",
    compute=compute,
    inputs=_inputs,
)
