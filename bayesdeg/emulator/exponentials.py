"""Exponentials of many numbers at a time, written so that the compiler takes them as vectors."""

import math

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled

Floats = NDArray[np.float64]


_LOG2E = 1.0 / math.log(2.0)
_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 in two parts, the first with 32 bits free
_LN2_LOW = 1.90821492927058770002e-10
_ROUNDING = 6755399441055744.0  # 1.5 · 2⁵²: adding it leaves the nearest whole number in low bits
_LARGEST = 700.0  # exponents that a number of 64 bits holds
_INVERSE_FACTORIALS = tuple(1.0 / math.factorial(n) for n in range(14))


@compiled
def exponentials(values: Floats) -> None:  # pragma: no cover - compiled
    """Replace values by their exponentials, as vectors: e^x = 2^n e^r with |r| ≤ ln 2/2.

    Values beyond ±700 count as these. The Taylor series to r¹³ leaves 4·10⁻¹⁸.
    """
    whole = np.empty(values.size)
    bits = whole.view(np.int64)
    for k in range(values.size):
        x = min(max(values[k], -_LARGEST), _LARGEST)
        shifted = x * _LOG2E + _ROUNDING
        n = shifted - _ROUNDING
        r = (x - n * _LN2_HIGH) - n * _LN2_LOW
        total = _INVERSE_FACTORIALS[13]
        for order in range(12, -1, -1):
            total = total * r + _INVERSE_FACTORIALS[order]
        values[k] = total
        whole[k] = shifted
    for k in range(values.size):
        bits[k] = (bits[k] + 1023) << 52
    for k in range(values.size):
        values[k] *= whole[k]
