"""`effort` names how much work is done. Its old name was `budget`, which elsewhere means a likelihood budget."""

from __future__ import annotations

import warnings
from collections.abc import Iterable

from cornerforge._checks import check_in
from cornerforge.errors import InputError

__all__ = ["effort_and_budget"]


def effort_and_budget(
    effort: str | None, budget: float | str | None, efforts: Iterable[str], default: str = "quick"
) -> tuple[str, float | None]:
    """Return the name of an effort, and a likelihood budget [nats] or None.

    Args:
        effort: Name of an effort; None: not given.
        budget: Likelihood budget, as a number or its text; or the name of an effort, where `effort` is not given.
        efforts: All names.
        default: The effort where none is named.

    Raises:
        UnknownNameError: There is no effort of that name.
        InputError: Both name an effort.
    """
    names = tuple(efforts)
    nats: float | None
    try:
        nats = None if budget is None else float(budget)
    except ValueError:
        old = check_in("effort", str(budget), names)
        if effort is not None:
            raise InputError(
                f"effort = {effort} and budget = {old}, the old name of effort, exclude each other; leave the budget "
                "out."
            ) from None
        effort, nats = old, None
        warnings.warn(
            f"budget {effort} is called effort {effort} now (--effort {effort}); a budget is a likelihood, in nats.",
            FutureWarning,
            stacklevel=3,
        )
    return check_in("effort", default if effort is None else effort, names), nats
