"""`effort` names how much work is done. Its old name was `budget`, which elsewhere means a likelihood budget."""

from __future__ import annotations

import warnings
from collections.abc import Iterable

from cornerforge._checks import check_in

__all__ = ["effort_and_budget"]


def effort_and_budget(effort: str, budget: float | str | None, efforts: Iterable[str]) -> tuple[str, float | None]:
    """Return the name of an effort, and a likelihood budget [nats] or None.

    Args:
        effort: Name of an effort.
        budget: Likelihood budget, as a number or its text; or the name of an effort, which then replaces `effort`.
        efforts: All names.

    Raises:
        UnknownNameError: There is no effort of that name.
    """
    names = tuple(efforts)
    nats: float | None
    try:
        nats = None if budget is None else float(budget)
    except ValueError:
        effort, nats = check_in("effort", str(budget), names), None
        warnings.warn(
            f"budget {effort} is called effort {effort} now (--effort {effort}); a budget is a likelihood, in nats.",
            FutureWarning,
            stacklevel=3,
        )
    return check_in("effort", effort, names), nats
