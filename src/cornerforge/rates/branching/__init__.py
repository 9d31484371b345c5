"""Weighted tests: particles that split where it is dangerous, or tests that are drawn from proposals.

A *particle* is a world with a weight. Copies share the weight of what was copied, and what is drawn from a proposal is
weighted by its density, so the weights of all crashes sum up to a number whose mean is the crash rate, whatever the
danger is taken to be (docs/adr/0030-natural-rates.md). In the order of reading: `danger` (how dangerous a BV is to the
AV), `acts` (what BVs may do in a second), `branches` (of which exactly one happens), `population` (plan, pool of
particles, terminal states), `splitting` (copies) and `tilt` (proposals), `training_data` (what the danger is trained
with), `schedule` and `foreign` (AVs outside the kernels), `drive` (ranges of tests, in threads).
"""

from __future__ import annotations

__all__: list[str] = []
