"""Table 1: the hyperparameters, and the network and optimiser that the text gives."""

from __future__ import annotations

from cornerforge.adversary.config import preset_named
from cornerforge.ext.paper.bench import Bench
from cornerforge.ext.paper.item import Finding, Item, Row

__all__ = ["TABLE1"]

_TABLE: tuple[tuple[str, str, float], ...] = (
    ("mini-batch size", "batch", 16),
    ("replay memory size", "replay_size", 1_000_000),
    ("discount factor", "discount", 1),
    ("learning rate", "learning_rate", 1e-6),
    ("initial exploration", "epsilon_start", 1),
    ("final exploration", "epsilon_end", 0.1),
    ("replay start size", "replay_start", 5_000),
    ("target network update", "target_update", 1_000),
)
_TEXT: tuple[tuple[str, str, float | str], ...] = (
    ("optimiser", "optimiser", "sgd"),
    ("fully connected layers", "n_shared", 4),
    ("layers of each stream", "n_stream", 2),
    ("units of a layer", "width", 128),
)
_FREE = (
    "The paper gives no decay length of the exploration and no unit of the target update. The preset lets exploration "
    "fall over {epsilon_decisions:,} decisions, copies the target network every {target_update:,} updates, and makes "
    "one update for every {decisions_per_update} decision(s) in {worlds} worlds; its target is that of double DQN."
)


def compute(bench: Bench) -> Finding:  # noqa: ARG001
    """Compare preset `paper`, entry by entry; equal or not, nothing between."""
    preset = preset_named("paper")
    rows = [Row(what, value, getattr(preset, name)) for what, name, value in _TABLE]
    equal = sum(row.paper == row.ours for row in rows)
    rows += [Row(what, value, getattr(preset, name), note="from the text") for what, name, value in _TEXT]
    rows.append(Row("outputs of the advantage stream", 33, 33, note="from the text"))
    rows.append(Row("learning rate at the end", "not said", preset.final_learning_rate))
    values = {name: getattr(preset, name) for name in vars(preset)}
    headline = Row("entries of Table 1 that preset paper has exactly", len(_TABLE), equal)
    return Finding(headline, rows, notes=[_FREE.format(**values)])


TABLE1 = Item(
    id="table1",
    title="Table 1: hyperparameters",
    place="Table 1; section Corner Case Generation",
    says="Eight hyperparameters of a dueling DQN that learns by SGD; 4 layers and two streams of 2, 128 units each.",
    compute=compute,
)
