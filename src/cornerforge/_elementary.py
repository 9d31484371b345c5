"""Elementary functions for kernels: exponential, logarithm, sine, cosine and arctangent with the same bits everywhere.

Functions of the C library differ in their last bits between libraries and processors, and a different last bit makes a
different test (docs/adr/0021-elementary-functions.md). The functions here use only operations that IEEE 754 rounds
exactly (+, -, *, /, floor, and the bits of a number), in a fixed order, without fused multiply-adds, calls or memory.
So they give the same bits compiled for any processor and as plain Python (`exp.py_func` and so on).

Each one brings its argument near to 0 and sums a Taylor series there. The rounding errors of that step are kept beside
the argument ("lost") and added last. The ideas are in Muller, Elementary Functions (3rd edition, 2016), the constants
in several parts in Cody and Waite, Software Manual for the Elementary Functions (1980). The errors stated below are in
units in the last place (ulp) of the true value; `tests/test_elementary.py` compares with mpmath.
"""

from __future__ import annotations

import math

import numpy as np

from cornerforge._jit import inlined_kernel, kernel

__all__ = ["SIN_COS_LIMIT", "atan", "exp", "log", "sin_cos"]

SIN_COS_LIMIT = 524288.0
"""`sin_cos` gives NaN for angles beyond this [rad]."""

_PER_LN2 = float.fromhex("0x1.71547652b82fep+0")
_LN2 = tuple(map(float.fromhex, ("0x1.62e42fee00000p-1", "0x1.a39ef35793c76p-33")))
"""ln 2 in two parts: 32 bits, so that its product with an exponent of 2 is exact, and the rest."""

_PER_QUARTER = float.fromhex("0x1.45f306dc9c883p-1")
_QUARTER = tuple(
    map(
        float.fromhex,
        ("0x1.921fb54400000p+0", "0x1.0b4611a600000p-34", "0x1.3198a2e000000p-69", "0x1.b839a252049c1p-104"),
    )
)
"""A quarter turn, pi / 2, in four parts: thrice 33 bits, so that their products with a count below 2^20 are exact."""

_EIGHTH = 0.7853981633974483

_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD

_F = tuple(1.0 / math.factorial(n) for n in range(18))
"""1 / n!, the coefficients of exp, sin and cos."""
_ODD = tuple(1.0 / (2 * n + 1) for n in range(12))
"""1 / (2 n + 1), the coefficients of artanh and, with alternating signs, of arctan."""

_ATAN = tuple(
    map(
        float.fromhex,
        ("0x0p+0", "0x1.f5b75f92c80ddp-3", "0x1.dac670561bb4fp-2", "0x1.4978fa3269ee1p-1", "0x1.921fb54442d18p-1"),
    )
)
"""arctan(j / 4) for j = 0 .. 4; `_ATAN_LACKS` holds their rounding errors (true value minus this)."""
_ATAN_LACKS = tuple(
    map(
        float.fromhex,
        ("0x0p+0", "0x1.8ab6e3cf7afbdp-57", "0x1.a2b7f222f65e2p-56", "0x1.2419a87f2a458p-56", "0x1.1a62633145c07p-55"),
    )
)
_ACOT = tuple(
    map(
        float.fromhex,
        (
            "0x1.921fb54442d18p+0", "0x1.5368c951e9cfdp+0", "0x1.1b6e192ebbe44p+0", "0x1.dac670561bb4fp-1",
            "0x1.921fb54442d18p-1",
        ),
    )
)  # fmt: skip
"""pi / 2 - arctan(j / 4), in the same way."""
_ACOT_LACKS = tuple(
    map(
        float.fromhex,
        (
            "0x1.1a62633145c07p-54", "-0x1.96f47948a99f1p-54", "0x1.b1b466a88828ep-54", "0x1.a2b7f222f65e2p-55",
            "0x1.1a62633145c07p-55",
        ),
    )
)  # fmt: skip


@kernel
def _power_of_two(k: int) -> float:
    """2^k for k = -1022 .. 1023."""
    return float(np.int64((k + 1023) << 52).view(np.float64))


@kernel
def exp(x: float) -> float:
    """e^x. Error below 0.9 ulp, also where the result is subnormal.

    +inf where e^x rounds to more than the largest number (x > 709.78), 0 where it rounds to 0 (x < -745.13),
    exp(0) = 1, NaN for NaN.
    """
    if not x >= -745.14:
        return x if x != x else 0.0
    if x > 709.79:
        return math.inf
    # e^x = 2^k e^(r + lost), |r| < 0.347
    k = math.floor(x * _PER_LN2 + 0.5)
    high = x - k * _LN2[0]
    low = k * _LN2[1]
    r = high - low
    lost = (high - r) - low
    # 1 + r + r^2 / 2! + ... in pairs, which the processor takes side by side
    z = r * r
    w = z * z
    first = (_F[2] + r * _F[3]) + z * (_F[4] + r * _F[5])
    second = (_F[6] + r * _F[7]) + z * (_F[8] + r * _F[9])
    third = (_F[10] + r * _F[11]) + z * ((_F[12] + r * _F[13]) + z * _F[14])
    near = 1.0 + r
    lost += (1.0 - near) + r
    p = near + (lost + z * (first + w * (second + w * third)))
    half = k >> 1  # in two steps: 2^k itself may lie outside the numbers though the result does not
    return p * _power_of_two(half) * _power_of_two(k - half)


@kernel
def log(x: float) -> float:
    """Natural logarithm. Error below 0.9 ulp.

    -inf for 0, NaN below it and for NaN, +inf for +inf, log(1) = 0; subnormal arguments are taken at their full worth.
    """
    if not x > 0.0:
        return -math.inf if x == 0.0 else math.nan
    if x == math.inf:
        return x
    k = 0
    if x < 2.2250738585072014e-308:
        x *= 18014398509481984.0
        k = -54
    # x = 2^k (1 + f) with 1 + f from sqrt(1/2) to sqrt(2): the exponent is counted from sqrt(1/2), not from 1
    bits = int(np.float64(x).view(np.int64))
    shift = (bits - _SQRT_HALF_BITS) >> 52
    k += shift
    f = float(np.int64(bits - (shift << 52)).view(np.float64)) - 1.0
    # ln(1 + f) = 2 artanh(s) = 2 s + s rest with s = f / (2 + f). Here 2 s = f - (h - s h) with h = f^2 / 2, so that
    # f, which is exact, leads.
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = _ODD[1] + w * (_ODD[3] + w * (_ODD[5] + w * (_ODD[7] + w * _ODD[9])))
    odd = _ODD[2] + w * (_ODD[4] + w * (_ODD[6] + w * (_ODD[8] + w * _ODD[10])))
    rest = 2.0 * z * (even + z * odd)
    h = 0.5 * f * f
    return k * _LN2[0] + (f - (h - (s * (h + rest) + k * _LN2[1])))


@kernel
def _less_quarters(x: float, n: int) -> tuple[float, float]:
    """Subtract n < 2^20 quarter turns from an angle: the result [rad], at most pi / 4, and its rounding error."""
    a = x - n * _QUARTER[0]  # exact, and so are the next two products
    b = n * _QUARTER[1]
    c = n * _QUARTER[2]
    ab = a - b
    back = ab - a
    lost = (a - (ab - back)) - (b + back)
    abc = ab - c
    back = abc - ab
    lost += (ab - (abc - back)) - (c + back)
    lost -= n * _QUARTER[3]
    r = abc + lost
    return r, (abc - r) + lost


@kernel
def sin_cos(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad]. Errors below 0.9 ulp for |x| <= `SIN_COS_LIMIT`.

    NaN beyond, for infinities and NaN. sin_cos(0) = (0, 1), with the zero's sign.
    """
    size = abs(x)
    if not size <= SIN_COS_LIMIT:
        return math.nan, math.nan
    if size < 7.450580596923828e-9:
        return x, 1.0
    n = 0
    r = x
    lost = 0.0
    if size > _EIGHTH:
        n = math.floor(x * _PER_QUARTER + 0.5)
        r, lost = _less_quarters(x, n)
    z = r * r
    w = z * z
    # sin(r + lost) = r - r^3 / 3! + ... + lost cos r, cos(r + lost) = 1 - r^2 / 2 + ... - lost sin r
    even = -_F[3] + w * (-_F[7] + w * (-_F[11] + w * -_F[15]))
    odd = _F[5] + w * (_F[9] + w * (_F[13] + w * _F[17]))
    sine = r + (r * (z * (even + z * odd)) + lost * (1.0 - 0.5 * z))
    even = _F[4] + w * (_F[8] + w * (_F[12] + w * _F[16]))
    odd = -_F[6] + w * (-_F[10] + w * -_F[14])
    half = 0.5 * z
    near = 1.0 - half
    cosine = near + (((1.0 - near) - half) + (w * (even + z * odd) - r * lost))
    if n & 1:
        sine, cosine = cosine, -sine
    if n & 2:
        sine, cosine = -sine, -cosine
    return sine, cosine


@inlined_kernel
def atan(x: float) -> float:
    """Arctangent [rad]. Error below 0.9 ulp.

    atan(0) is 0 with its sign, atan(+-inf) = +-pi / 2, NaN for NaN.
    """
    size = abs(x)
    if size < 7.450580596923828e-9:
        return x
    start = 0.0
    lacks = 0.0
    t = size
    if size >= 0.1875:
        if size <= 1.0:
            # arctan(size) = arctan(c) + arctan(t), c the nearest quarter, so |t| <= 1/8
            j = math.floor(4.0 * size + 0.5)
            c = 0.25 * j
            start = _ATAN[j]
            below = 1.0 + size * c
            t = (size - c) / below
            lacks = _ATAN_LACKS[j] - t * ((1.0 - below) + size * c)  # what rounding took from `below`
        elif size < 18014398509481984.0:
            # the same with 1 / size, without rounding it: arctan(size) = pi / 2 - arctan(c) + arctan(t)
            j = math.floor(4.0 / size + 0.5)
            c = 0.25 * j
            start = _ACOT[j]
            lacks = _ACOT_LACKS[j]
            most = min(c, 0.5)  # 3/4 in two steps with exact products
            t = ((most * size - 1.0) + (c - most) * size) / (size + c)
        else:
            return x if x != x else math.copysign(_ACOT[0], x)
    z = t * t
    w = z * z
    even = _ODD[1] + w * (_ODD[3] + w * (_ODD[5] + w * (_ODD[7] + w * (_ODD[9] + w * _ODD[11]))))
    odd = _ODD[2] + w * (_ODD[4] + w * (_ODD[6] + w * (_ODD[8] + w * _ODD[10])))
    return math.copysign(start + (t - (t * (z * (even - z * odd)) - lacks)), x)
