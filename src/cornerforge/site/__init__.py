"""Junctions: routes that cross, zones in which they do, stop lines, signals, crosswalks (docs/adr/0083-sites.md).

`network` says what a site is, `zones` where its routes meet, `faults` what is wrong with one. Nothing drives here yet.
"""

MODULES = ("faults", "network", "zones")
"""Modules that are doors of their own."""
__all__: list[str] = []
