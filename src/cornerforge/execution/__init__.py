"""How work is spread: ranges of tests, cases or worlds in, their results out in order, whatever computes them.

Today that is a pool of threads, since kernels release the interpreter's lock. More machines, or another processor, are
another function of the same form, and nothing that calls `in_order` need know.
"""

from cornerforge.execution.threads import Rooms, default_threads, in_order

__all__ = ["Rooms", "default_threads", "in_order"]
