"""Numbers as people read them."""

from __future__ import annotations

import math
import re

__all__ = [
    "capital",
    "count",
    "duration",
    "interval",
    "miles",
    "miles_range",
    "plain",
    "rate",
    "rounded_down",
    "sentence",
    "share",
    "share_in_words",
    "share_range",
    "signed",
    "times",
]

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def count(value: float) -> str:
    """A whole number with commas between thousands.

    >>> count(1234567)
    '1,234,567'
    """
    return f"{round(value):,}"


def rate(value: float, digits: int = 3) -> str:
    """A rate or ratio to `digits` significant digits: plain from 0.001 to 1e6, else with a power of ten.

    >>> rate(0.28612), rate(0.0000012345, 2), rate(0.0), rate(1.0)
    ('0.286', '1.2 × 10⁻⁶', '0', '1.00')
    """
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -3 <= exponent < digits:
        return f"{value:.{digits - 1 - exponent}f}"
    if digits <= exponent < 6:
        return count(round(value, digits - 1 - exponent))
    mantissa = f"{value / 10.0**exponent:.{digits - 1}f}"
    return f"{mantissa} × 10{str(exponent).translate(_SUPERSCRIPTS)}"


def miles(value: float, digits: int = 2) -> str:
    """A distance to `digits` significant digits, in words from a thousand on.

    >>> miles(776000.0), miles(1.234e9), miles(12.0)
    ('780 thousand miles', '1.2 billion miles', '12 miles')
    """
    for size, word in ((1e9, " billion"), (1e6, " million"), (1e3, " thousand")):
        shown = float(f"{value:.{digits - 1}e}") / size
        if shown >= 1.0:
            return f"{rate(shown, digits)}{word} miles"
    return f"{rate(value, digits)} miles"


def miles_range(low: float, high: float) -> str:
    """Both ends of an interval of miles.

    >>> miles_range(310000.0, 770000.0), miles_range(0.0, 1.2e6)
    ('310 to 770 thousand miles', '0 miles to 1.2 million miles')
    """
    (first, *unit), last = miles(low).split(" "), miles(high)
    return f"{first} to {last}" if last.split(" ")[1:] == unit else f"{miles(low)} to {last}"


def share_in_words(value: float) -> str:
    """A share as per cent to two digits; below one in a million it is said to be that.

    >>> share_in_words(0.1234), share_in_words(0.0), share_in_words(2e-12)
    ('12 %', '0 %', 'less than 1 in a million')
    """
    if 0.0 < value < 1e-6:
        return "less than 1 in a million"
    return f"{100.0 * float(f'{value:.1e}'):g} %"


def interval(low: float, high: float, digits: int = 3) -> str:
    """Both ends of an interval.

    >>> interval(0.2791, 0.2931)
    '0.279 to 0.293'
    """
    return f"{rate(low, digits)} to {rate(high, digits)}"


def share(value: float) -> str:
    """A share in per cent; more digits near 0 and 100 %, where they matter.

    >>> share(0.25), share(0.0042), share(0.9985), share(0.0), share(1.0)
    ('25.0 %', '0.42 %', '99.85 %', '0 %', '100 %')
    """
    if value in (0.0, 1.0):
        return f"{100 * value:.0f} %"
    return f"{100 * value:.{1 if 0.01 <= value <= 0.99 else 2}f} %"


def share_range(low: float, high: float) -> str:
    """Both ends of an interval of a share.

    >>> share_range(0.123, 0.456)
    '12.3 to 45.6 %'
    """
    return f"{share(low).removesuffix(' %')} to {share(high)}"


def signed(value: float, digits: int = 3) -> str:
    """A difference with its sign.

    >>> signed(-0.0223), signed(0.004), signed(0.0)
    ('−0.0223', '+0.00400', '0')
    """
    return rate(value) if value == 0.0 else ("−" if value < 0.0 else "+") + rate(abs(value), digits)


def sentence(text: str) -> str:
    """A sentence of the analysis with units and signs as in print.

    >>> sentence("brakes with -4.0 m/s2 at 3 m").replace(chr(0xA0), "_")
    'brakes with −4.0_m/s² at 3 m'
    """
    return re.sub(r"(?<= )-(?=\d)", "−", text).replace(" m/s2", "\u00a0m/s²")


_PLAIN = (
    (r"\bBVs\b", "other vehicles"),
    (r"\bthe BV\b", "the other vehicle"),
    (r"\bThe BV\b", "The other vehicle"),
    (r"\b(?:a|another) BV\b", "another vehicle"),
    (r"\bBV\b(?! \d)", "another vehicle"),
    (r"(?<!\bthe )(?<!\ban )(?<!\bThe )\bAV\b", "the AV"),
)


def plain(words: str) -> str:
    """Words of the analysis for readers who do not know that a BV is any vehicle but the AV.

    >>> plain("BV runs into the rear of an AV that brakes hard")
    'another vehicle runs into the rear of an AV that brakes hard'
    >>> plain("AV brakes in front of the BV"), plain("rear-end by BV"), plain("BV 3: left")
    ('the AV brakes in front of the other vehicle', 'rear-end by another vehicle', 'BV 3: left')
    """
    for pattern, word in _PLAIN:
        words = re.sub(pattern, word, words)
    return words


def capital(words: str) -> str:
    """The words as the begin of a sentence.

    >>> capital("the AV brakes")
    'The AV brakes'
    """
    return words[:1].upper() + words[1:]


def rounded_down(value: float, digits: int = 2) -> float:
    """A value above 0 rounded down, for what is said to be at least so much.

    >>> rounded_down(63520.0), rounded_down(0.0199), rounded_down(3000.0)
    (63000.0, 0.019, 3000.0)
    """
    near = float(f"{value:.{digits - 1}e}")
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return near if near <= value else float(f"{near - step:.{digits - 1}e}")


def times(value: float) -> str:
    """A factor to two digits.

    >>> times(3.04), times(286000.0), times(2.84e6)
    ('3.0', '290,000', '2.8 million')
    """
    return rate(value, 2) if value < 999_500.0 else miles(value).removesuffix(" miles")


def duration(seconds: float) -> str:
    """A length of time.

    >>> duration(4.25), duration(75.0), duration(7300.0)
    ('4.2 s', '1 min 15 s', '2 h 1 min')
    """
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    whole = int(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
