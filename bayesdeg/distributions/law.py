"""What a probability law is, and its map to the whole real line."""

import math
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from scipy import special

type FloatArray = npt.NDArray[np.float64]
type Size = int | tuple[int, ...] | None

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


@runtime_checkable
class Law(Protocol):
    """A univariate probability law, vectorised over its arguments.

    The maps to and from the unconstrained scale follow from the support: x = z where it is the
    whole line, x = exp(z) where it is (0, ∞), x = low + (high − low) / (1 + exp(−z)) where it is
    bounded.  `TruncatedNormal` alone replaces them.
    """

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest possible value."""
        ...

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Return the log probability density; −inf outside the support."""
        ...

    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        """Return the value below which the probability is u, with u in [0, 1]."""
        ...

    def untruncated_log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Return the log density continued smoothly over the bounds of a truncated law.

        Differs from `log_density` for `TruncatedNormal` only, whose normalising constant it keeps:
        for derivatives at a value on the bound.
        """
        return self.log_density(x)

    def sample(self, generator: np.random.Generator, size: Size = None) -> FloatArray:
        """Draw by inversion, one uniform number a draw."""
        # the generator may return exactly 0, of which an unbounded law has no finite quantile
        return self.quantile(generator.uniform(2.0**-54, 1.0, size))

    def to_unconstrained(self, x: npt.ArrayLike) -> FloatArray:
        """Return z of x; ±inf on the bounds, nan outside the support."""
        low, high = self.support
        x = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if math.isinf(low):
                return x
            return np.log(x) if math.isinf(high) else np.log(x - low) - np.log(high - x)

    def from_unconstrained(self, z: npt.ArrayLike) -> FloatArray:
        """Return x of z."""
        low, high = self.support
        z = np.asarray(z, dtype=float)
        with np.errstate(over="ignore", under="ignore"):
            if math.isinf(low):
                return z
            if math.isinf(high):
                return np.exp(z)
            # each bound is approached from itself, lest rounding overstep it
            return np.where(
                z < 0.0,
                low + (high - low) * special.expit(z),
                high - (high - low) * special.expit(-z),
            )

    def log_jacobian(self, z: npt.ArrayLike) -> FloatArray:
        """Return log |dx/dz|."""
        low, high = self.support
        z = np.asarray(z, dtype=float)
        if math.isinf(low):
            return np.zeros_like(z)
        if math.isinf(high):
            return z
        return math.log(high - low) + special.log_expit(z) + special.log_expit(-z)


def require_positive(value: float, name: str) -> None:
    """Raise ValueError unless the argument is a positive, finite number."""
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} must be positive and finite, not {value!r}")


def require_finite(value: float, name: str) -> None:
    """Raise ValueError unless the argument is a finite number."""
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, not {value!r}")


def normal_log_density(x: npt.ArrayLike, mean: float, sd: float) -> FloatArray:
    """Return the log density of the normal law."""
    with np.errstate(over="ignore", under="ignore"):
        density: FloatArray = -0.5 * np.square((np.asarray(x, dtype=float) - mean) / sd)
    return density - (math.log(sd) + _LOG_ROOT_TWO_PI)
