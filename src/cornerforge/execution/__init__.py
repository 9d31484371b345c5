"""The spreading of work: ranges of tests, cases or worlds go in, their results come out in order.

A pool of threads computes them, since kernels release the interpreter's lock. A function for more machines or another
processor would take the same arguments as `in_order`, so that its callers need not change.
"""

from cornerforge.execution.threads import Rooms, default_threads, in_order

__all__ = ["Rooms", "default_threads", "in_order"]
