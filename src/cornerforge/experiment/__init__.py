"""The experiment: an AV, a road, a model and controllers, found by name, checked, and identified.

`setting.experiment` makes an `experiments.Experiment` of names and files; `counting` drives and counts its tests,
`forecast` says how long that takes. `av_file` and `policy_file` are the files of networks; `output` says what may be
written where, and writes files whole; `roads` and `sites` find roads and junctions by name or
file.
"""

from __future__ import annotations

__all__: list[str] = []

MODULES = ("av_file", "counting", "experiments", "forecast", "output", "policy_file", "roads", "setting", "sites")
"""Modules from which other rooms import too."""
