"""Laws sampled on their own scale: normal, Student's t, truncated normal."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import override

import numpy as np
import numpy.typing as npt
from scipy import special

from bayesdeg.distributions.law import (
    FloatArray,
    Law,
    normal_log_density,
    require_finite,
    require_positive,
)


@dataclass(frozen=True)
class Normal(Law):
    """Normal law of given mean and standard deviation.

    Examples
    --------
    >>> round(float(Normal(0.62, 0.07).quantile(0.975)), 3)
    0.757
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_finite(self.mean, "mean")
        require_positive(self.sd, "sd")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        return normal_log_density(x, self.mean, self.sd)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return np.asarray(self.mean + self.sd * special.ndtri(np.asarray(u)), dtype=np.float64)


@dataclass(frozen=True)
class StudentT(Law):
    """Student's t law with dof > 2; `sd` is its standard deviation, not its scale."""

    mean: float
    sd: float
    dof: float

    def __post_init__(self) -> None:
        require_finite(self.mean, "mean")
        require_positive(self.sd, "sd")
        require_positive(self.dof, "dof")
        if self.dof <= 2.0:
            raise ValueError(f"dof must exceed 2 for sd to exist, not {self.dof!r}")

    @cached_property
    def _scale(self) -> float:
        return self.sd * math.sqrt((self.dof - 2.0) / self.dof)

    @cached_property
    def _log_constant(self) -> float:
        beta = math.lgamma(0.5 * (self.dof + 1.0)) - math.lgamma(0.5 * self.dof)
        return beta - 0.5 * math.log(self.dof * math.pi) - math.log(self._scale)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return -math.inf, math.inf

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        with np.errstate(over="ignore", under="ignore"):
            square = np.square((np.asarray(x, dtype=float) - self.mean) / self._scale)
        return self._log_constant - 0.5 * (self.dof + 1.0) * np.log1p(square / self.dof)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        u = np.asarray(u, dtype=np.float64)
        # scipy's quantile has the wrong sign at probability zero
        standard = np.where(u <= 0.0, -math.inf, special.stdtrit(self.dof, u))
        return self.mean + self._scale * standard


@dataclass(frozen=True)
class TruncatedNormal(Law):
    """Normal law of given mean and standard deviation before truncation to low ≤ x ≤ high.

    It stays on the linear scale deliberately: the neutral value of a cause often lies on its
    bound, where log density and derivatives must exist and where a log scale would put it at −∞.
    """

    mean: float
    sd: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        require_finite(self.mean, "mean")
        require_positive(self.sd, "sd")
        if not self.low < self.high:
            raise ValueError(f"low must be below high, not {self.low!r} and {self.high!r}")
        if not math.isfinite(self._log_mass):
            raise ValueError(f"no probability between {self.low!r} and {self.high!r}")

    @cached_property
    def _log_mass(self) -> float:
        low, high = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        if low > 0.0:
            low, high = -high, -low
        upper, lower = float(special.log_ndtr(high)), float(special.log_ndtr(low))
        gap = -math.expm1(lower - upper) if upper > -math.inf else 0.0
        return upper + math.log(gap) if gap > 0.0 else -math.inf

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, self.untruncated_log_density(x), -math.inf)

    @override
    def untruncated_log_density(self, x: npt.ArrayLike) -> FloatArray:
        return normal_log_density(x, self.mean, self.sd) - self._log_mass

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        u = np.asarray(u, dtype=float)
        low, high = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        # the normal law is accurate in its lower tail only, so an upper tail is mirrored
        sign = -1.0 if low > 0.0 else 1.0
        if sign < 0.0:
            low, high, u = -high, -low, 1.0 - u
        with np.errstate(divide="ignore"):
            log_cdf = np.logaddexp(
                np.log1p(-u) + special.log_ndtr(low), np.log(u) + special.log_ndtr(high)
            )
        standard = sign * special.ndtri_exp(log_cdf)
        return np.clip(self.mean + self.sd * standard, self.low, self.high)

    @override
    def to_unconstrained(self, x: npt.ArrayLike) -> FloatArray:
        return np.asarray(x, dtype=float)

    @override
    def from_unconstrained(self, z: npt.ArrayLike) -> FloatArray:
        return np.asarray(z, dtype=float)

    @override
    def log_jacobian(self, z: npt.ArrayLike) -> FloatArray:
        return np.zeros_like(np.asarray(z, dtype=float))
