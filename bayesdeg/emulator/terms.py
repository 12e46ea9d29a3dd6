"""Sums of products of polynomials, one factor for each of the load and the groups."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.emulator.scaling import MATERIAL, NAMES

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

N_CHEBYSHEV = 1 + len(MATERIAL)  # the load and the material; causes enter by powers


@dataclass(frozen=True, eq=False)
class Terms:
    r"""Σₜ aₒₜ T_i(P₀) T_j(P₁) T_k(P₂) T_l(P₃) P₄^m₄ ⋯ P₁₂^m₁₂ for each output o.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
        Orders of the factors, in the order of ``NAMES``: of Chebyshev polynomials in the load and
        the material, powers of the causes.
    coefficients : array, shape (n_outputs, n_terms)
        aₒₜ [–].
    """

    orders: Indices
    coefficients: Floats

    def __post_init__(self) -> None:
        if self.orders.ndim != 2 or self.orders.shape[1] != len(NAMES):
            raise ValueError(f"orders need {len(NAMES)} columns, not shape {self.orders.shape}")
        if self.coefficients.ndim != 2 or self.coefficients.shape[1] != len(self.orders):
            raise ValueError(
                f"{len(self.orders)} terms need as many columns of coefficients, "
                f"not shape {self.coefficients.shape}"
            )

    def output(self, number: int) -> Self:
        """Return one output alone, without the terms that it does not have."""
        there = self.coefficients[number] != 0.0
        return type(self)(self.orders[there], self.coefficients[number : number + 1, there])

    def derivative(self, axis: int) -> Self:
        """Return the derivative by one of the 13 coordinates, as terms.

        dTₙ/dx = 2n (Tₙ₋₁ + Tₙ₋₃ + …), with T₀ counted half.

        Examples
        --------
        >>> cube = np.zeros((1, 13), dtype=np.int64)
        >>> cube[0, 0] = 3  # T₃ = 4x³ − 3x, and 12x² − 3 = 6 T₂ + 3
        >>> slope = Terms(cube, np.ones((1, 1))).derivative(0)
        >>> slope.orders[:, 0].tolist(), slope.coefficients.tolist()
        ([0, 2], [[3.0, 6.0]])
        """
        orders, coefficients = [], []
        for n in range(1, int(self.orders[:, axis].max(initial=0)) + 1):
            these = self.orders[:, axis] == n
            lower = range(n - 1, -1, -2) if axis < N_CHEBYSHEV else (n - 1,)
            for k in lower:
                part = self.orders[these]
                part[:, axis] = k
                factor = n if axis >= N_CHEBYSHEV or k == 0 else 2 * n
                orders.append(part)
                coefficients.append(factor * self.coefficients[:, these])
        if not orders:
            return type(self)(self.orders[:0], self.coefficients[:, :0])
        return type(self)(*_collected(np.vstack(orders), np.hstack(coefficients)))


def stacked(parts: Sequence[Terms]) -> Terms:
    """Return the outputs of several sums as those of one."""
    count = sum(len(part.coefficients) for part in parts)
    widths = [len(part.orders) for part in parts]
    coefficients = np.zeros((count, sum(widths)))
    row = column = 0
    for part, width in zip(parts, widths, strict=True):
        height = len(part.coefficients)
        coefficients[row : row + height, column : column + width] = part.coefficients
        row, column = row + height, column + width
    return Terms(*_collected(np.vstack([part.orders for part in parts]), coefficients))


def _collected(orders: Indices, coefficients: Floats) -> tuple[Indices, Floats]:
    """Return each product once, with the sum of its coefficients."""
    once, where = np.unique(orders, axis=0, return_inverse=True)
    total = np.zeros((len(once), len(coefficients)))
    np.add.at(total, where.ravel(), coefficients.T)
    return once, np.ascontiguousarray(total.T)
