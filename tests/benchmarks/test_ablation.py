"""The ablation of preset `fast`: each variant takes out what its name says, and nothing else."""

from __future__ import annotations

from dataclasses import asdict

from ablation import VARIANTS, variant

from cornerforge.adversary.config import PRESETS

OPTIMISER = {"optimiser", "learning_rate", "final_learning_rate"}
BATCH = {"batch", "decisions_per_update"}
EXPLORING = {"guided", "guided_epsilon"}
CHANGES = {
    "fast": set(),
    "SGD": OPTIMISER,
    "SGD, steps 100 times as large": OPTIMISER,
    "batches of 16, as many updates": BATCH,
    "batches of 16, as many transitions": BATCH,
    "exploring by chance": EXPLORING,
    "batches drawn alike": {"paid_share"},
    "exploring by chance, batches drawn alike": EXPLORING | {"paid_share"},
    "none of the four": OPTIMISER | BATCH | EXPLORING | {"paid_share"},
}


def test_a_variant_changes_what_it_is_named_for() -> None:
    assert set(CHANGES) == set(VARIANTS)
    fast = asdict(PRESETS["fast"]) | {"decisions": 1024}
    for name, may_change in CHANGES.items():
        made = asdict(variant(name, 1024))
        changed = {key for key in made if made[key] != fast[key]}
        assert changed <= may_change, name
        assert bool(changed) == bool(may_change), name


def test_as_many_updates_or_as_many_transitions() -> None:
    fast, few, many = (
        variant(name, 1024) for name in ("fast", "batches of 16, as many updates", "batches of 16, as many transitions")
    )
    assert few.decisions_per_update == fast.decisions_per_update
    assert many.batch / many.decisions_per_update == fast.batch / fast.decisions_per_update
    paper = PRESETS["paper"]
    none = variant("none of the four", 1024)
    assert (none.optimiser, none.batch, none.guided, none.paid_share) == (paper.optimiser, paper.batch, 0.0, 0.0)
