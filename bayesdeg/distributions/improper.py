"""Improper laws: a constant density over the line or a part of it, for posteriors of others."""

import math
from dataclasses import dataclass
from typing import override

import numpy as np
import numpy.typing as npt

from bayesdeg.distributions.law import FloatArray, Law


@dataclass(frozen=True)
class Flat(Law):
    """Density 1 between low and high, of which at least one is infinite: no probability law.

    It states a bound and leaves the rest to the likelihood, as an undeclared prior does in Stan.
    A posterior under it must be made proper by the data, and its evidence has no absolute meaning.
    It has no quantiles and cannot be drawn from; a study's priors are therefore never flat.

    Values above a bound are sampled as low + exp(z), values below one as high − exp(−z).

    Raises
    ------
    ValueError
        If both bounds are finite (`Uniform` is the law), or they are no interval.

    Examples
    --------
    >>> float(Flat(low=0.0).log_density(3.0)), float(Flat(low=0.0).log_density(-3.0))
    (0.0, -inf)
    """

    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low must be below high, not {self.low!r} and {self.high!r}")
        if math.isfinite(self.low) and math.isfinite(self.high):
            raise ValueError("between two finite bounds use Uniform, which is a proper law")

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        return np.where((x >= self.low) & (x <= self.high), 0.0, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        raise ValueError("a flat law over an infinite range has no quantiles")

    @override
    def to_unconstrained(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if math.isfinite(self.low):
                return np.log(x - self.low)
            return -np.log(self.high - x) if math.isfinite(self.high) else x

    @override
    def from_unconstrained(self, z: npt.ArrayLike) -> FloatArray:
        z = np.asarray(z, dtype=float)
        with np.errstate(over="ignore", under="ignore"):
            if math.isfinite(self.low):
                return self.low + np.exp(z)
            return self.high - np.exp(-z) if math.isfinite(self.high) else z

    @override
    def log_jacobian(self, z: npt.ArrayLike) -> FloatArray:
        z = np.asarray(z, dtype=float)
        if math.isfinite(self.low):
            return z
        return -z if math.isfinite(self.high) else np.zeros_like(z)
