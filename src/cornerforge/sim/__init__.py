"""The simulator: one AV and many background vehicles (BVs) on a straight highway, in compiled kernels.

What a newcomer should know, in the order of reading:

- `world`: all that the future of one test depends on; `snapshot` copies, stores and branches it.
- `setting`: what is constant in a run: road, AV, naturalistic model; who drives the AV, the critical BV, the others.
- `traffic`: puts a world at the start of a test, by (seed, test) alone.
- `advance`: the one loop. It moves a world until the test is over, a milestone is reached, or somebody outside the
  kernels must answer. Within it: `decide` (what BVs draw), `chances` (with which probability), `adversaries` (the
  hostile BV), `av`, `av_kinds` (built-in AVs), `step`, `actions`, `reach` (motion and contact), `neighbours`.
- `keep`: what stays of a drive (outcome, frames, decisions, counts: `statistics`); `scratch`: memory to work in.
- Callers of the loop: `drive`, `runner` (ranges of tests), `harvest` (cases), `recorder` (one test in full),
  `scripted` (given starts and actions), `lockstep` (AVs in other processes), `agents` (environments), `drive_bv` and
  `drive_av` (training, with `rewards`, `judge`, `braking`).
- Views: `observe` (of the adversary), `av_view` and `av_features` (of an AV).
- After a crash: `avoid`, `avoid_cases`, `avoid_check`, `avoid_motion` search for the ways out.

It knows no file, no learner and no plot. The same seed, test and setting give the same bits on any machine, for any
number of threads, through any of the callers (docs/design.md, ADR 20 and 21).
"""

from __future__ import annotations

__all__: list[str] = []
