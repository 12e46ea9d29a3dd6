"""Laws of bounded quantities, sampled on a log or logit scale."""

import math
from dataclasses import dataclass
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
class LogNormal(Law):
    """Law of x > 0 whose logarithm is normal about log(median), with standard deviation sigma."""

    median: float
    sigma: float

    def __post_init__(self) -> None:
        require_positive(self.median, "median")
        require_positive(self.sigma, "sigma")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        positive = x > 0.0
        log_x = np.log(np.where(positive, x, 1.0))
        density = normal_log_density(log_x, math.log(self.median), self.sigma) - log_x
        return np.where(positive, density, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return self.median * np.exp(self.sigma * special.ndtri(np.asarray(u, dtype=np.float64)))


@dataclass(frozen=True)
class HalfNormal(Law):
    """Law of |y| where y is normal with mean zero and standard deviation sd; log transform."""

    sd: float

    def __post_init__(self) -> None:
        require_positive(self.sd, "sd")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        density = normal_log_density(x, 0.0, self.sd) + math.log(2.0)
        return np.where(np.asarray(x) >= 0.0, density, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return np.asarray(
            self.sd * math.sqrt(2.0) * special.erfinv(np.asarray(u)), dtype=np.float64
        )


@dataclass(frozen=True)
class HalfCauchy(Law):
    """Law of |y| where y is Cauchy about zero; `scale` is its median; log transform."""

    scale: float

    def __post_init__(self) -> None:
        require_positive(self.scale, "scale")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        with np.errstate(over="ignore", under="ignore"):
            density = math.log(2.0 / (math.pi * self.scale)) - np.log1p(np.square(x / self.scale))
        return np.where(x >= 0.0, density, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        u = np.asarray(u, dtype=float)
        return self.scale * np.where(u < 1.0, np.tan(0.5 * math.pi * u), math.inf)


@dataclass(frozen=True)
class Uniform(Law):
    """Uniform law between low and high; logit transform."""

    low: float
    high: float

    def __post_init__(self) -> None:
        require_finite(self.low, "low")
        require_finite(self.high, "high")
        if not self.low < self.high:
            raise ValueError(f"low must be below high, not {self.low!r} and {self.high!r}")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, -math.log(self.high - self.low), -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        u = np.asarray(u, dtype=float)
        return self.low * (1.0 - u) + self.high * u
