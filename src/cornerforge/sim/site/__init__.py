"""Traffic at a site: vehicles on routes that cross, lights, people (docs/adr/0084-traffic-at-sites.md).

In the order of reading: `traffic` (a test's start, and agents that come), `moves` (ways to stop, times, gaps),
`claims` (who goes first), `look` (how a driver sees the world),
`people` (how a person does), `choice` (the natural probability of each action, and actions as they begin), `second`
(decisions and motion, which `loop.advance` and `step` call at a site), `av` (built-in AVs).
"""

from __future__ import annotations

__all__: list[str] = []
