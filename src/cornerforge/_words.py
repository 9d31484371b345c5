"""Values and times as messages write them."""

from __future__ import annotations

import math
import reprlib

__all__ = ["few_digits", "shown", "spoken"]

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 120


def shown(value: object) -> str:
    """Write a value that is not right as messages show it: as Python writes it, long ones without their middle.

    >>> shown("x"), shown([1.0, 2.0])
    ("'x'", '[1.0, 2.0]')
    """
    try:
        return " ".join(_SHORT.repr(value).split())
    except Exception:  # what cannot even be written: a whole number of 5,000 digits, an object of a class with a fault
        return f"<{type(value).__name__}>"


def spoken(seconds: float) -> str:
    """Write a time as people say it.

    >>> spoken(0.0021), spoken(0.2), spoken(47.0), spoken(400.0), spoken(9000.0), spoken(9e5)
    ('2.1 ms', '0.2 s', '47 s', '7 min', '2.5 h', '10 days')
    """
    if seconds < 0.1:
        return f"{1000.0 * seconds:.2g} ms"
    if seconds < 10.0:
        return f"{seconds:.2g} s"
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.0f} min"
    if seconds < 2.0 * 86400.0:
        return f"{seconds / 3600.0:.2g} h" if seconds < 36000.0 else f"{seconds / 3600.0:.0f} h"
    days = seconds / 86400.0
    return f"{days:,.0f} days" if math.isfinite(days) else "for ever"


def few_digits(number: float) -> str:
    """A number with as many digits as say something.

    >>> few_digits(12345.6), few_digits(3.14159), few_digits(0.01234)
    ('12,346', '3.1', '0.012')
    """
    return f"{number:,.0f}" if number >= 10.0 else f"{number:.2g}"
