"""The earlier name of `cornerforge.work`; gives the same names."""

from cornerforge.work import (
    ENGINES,
    Rooms,
    code_hash,
    cpu_seconds,
    default_threads,
    engine,
    in_order,
    is_given_up,
    is_spread,
)

__all__ = [
    "ENGINES", "Rooms", "code_hash", "cpu_seconds", "default_threads", "engine", "in_order", "is_given_up", "is_spread",
]  # fmt: skip
