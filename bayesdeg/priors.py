"""Prior laws: densities, maps to the real line, and the parameters that carry them."""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import Protocol, override, runtime_checkable

import numpy as np
import numpy.typing as npt
import scipy

from bayesdeg.errors import Fault, StudyError

type FloatArray = npt.NDArray[np.float64]
type Size = int | tuple[int, ...] | None

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)
_WHOLE_LINE, _POSITIVE = (-math.inf, math.inf), (0.0, math.inf)  # supports


@runtime_checkable
class Distribution(Protocol):
    """A univariate probability distribution, vectorised over its arguments.

    The maps to and from the unconstrained scale follow from the support: x = z where it is the
    whole line, x = low + exp(z) or high − exp(−z) where one end is infinite, x = low +
    (high − low) / (1 + exp(−z)) where it is bounded. A `TruncatedNormal` has x = z.
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

    def allows(self, x: float) -> bool:
        """Return whether a value is possible."""
        return math.isfinite(float(self.log_density(x)))

    def untruncated_log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Return the log density continued smoothly over the bounds of a truncated law.

        Differs from `log_density` only for `TruncatedNormal`, whose normalising constant it keeps:
        for derivatives at a value on the bound.
        """
        return self.log_density(x)

    def sample(self, generator: np.random.Generator, size: Size = None) -> FloatArray:
        """Draw by inversion, one uniform number per draw."""
        # the generator may return exactly 0, where an unbounded law has no finite quantile
        return self.quantile(generator.uniform(2.0**-54, 1.0, size))

    def to_unconstrained(self, x: npt.ArrayLike) -> FloatArray:
        """Return z of x; ±inf on the bounds, nan outside the support."""
        low, high = _transformed(self)
        x = np.asarray(x, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            if math.isinf(high):
                return x if math.isinf(low) else np.log(x - low)
            return -np.log(high - x) if math.isinf(low) else np.log(x - low) - np.log(high - x)

    def from_unconstrained(self, z: npt.ArrayLike) -> FloatArray:
        """Return x of z."""
        low, high = _transformed(self)
        z = np.asarray(z, dtype=float)
        with np.errstate(over="ignore", under="ignore"):
            if math.isinf(high):
                return z if math.isinf(low) else low + np.exp(z)
            if math.isinf(low):
                return high - np.exp(-z)
            # compute from the nearer bound, so that rounding does not overstep it
            return np.where(
                z < 0.0,
                low + (high - low) * scipy.special.expit(z),
                high - (high - low) * scipy.special.expit(-z),
            )

    def log_jacobian(self, z: npt.ArrayLike) -> FloatArray:
        """Return log |dx/dz|."""
        low, high = _transformed(self)
        z = np.asarray(z, dtype=float)
        if math.isinf(high):
            return np.zeros_like(z) if math.isinf(low) else z
        if math.isinf(low):
            return -z
        return math.log(high - low) + scipy.special.log_expit(z) + scipy.special.log_expit(-z)


def _transformed(law: Distribution) -> tuple[float, float]:
    """Return the bounds that the unconstrained scale never reaches: those of most supports."""
    is_linear = isinstance(law, TruncatedNormal | Choice)
    return _WHOLE_LINE if is_linear else law.support


def require_positive(value: float, name: str) -> None:
    """Raise ValueError unless the argument is a positive, finite number."""
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} must be positive and finite, not {value!r}")


def require_finite(value: float, name: str) -> None:
    """Raise ValueError unless the argument is a finite number."""
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, not {value!r}")


def normal_log_density(
    x: npt.ArrayLike, mean: float | FloatArray, sd: float | FloatArray
) -> FloatArray:
    """Return the log density of the normal law."""
    with np.errstate(over="ignore", under="ignore"):
        density: FloatArray = -0.5 * np.square((np.asarray(x, dtype=float) - mean) / sd)
    return density - (np.log(sd) + _LOG_ROOT_TWO_PI)


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal law of given mean and standard deviation.

    Examples
    --------
    >>> round(float(Normal(0.62, 0.07).quantile(0.975)), 3)
    0.757
    """

    mean: float
    sd: float
    support = _WHOLE_LINE

    def __post_init__(self) -> None:
        require_finite(self.mean, "mean")
        require_positive(self.sd, "sd")

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        return normal_log_density(x, self.mean, self.sd)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return np.asarray(
            self.mean + self.sd * scipy.special.ndtri(np.asarray(u)), dtype=np.float64
        )


@dataclass(frozen=True)
class StudentT(Distribution):
    """Student's t law with dof > 2; `sd` is its standard deviation, not its scale."""

    mean: float
    sd: float
    dof: float
    support = _WHOLE_LINE

    def __post_init__(self) -> None:
        require_finite(self.mean, "mean")
        require_positive(self.sd, "sd")
        require_positive(self.dof, "dof")
        if self.dof <= 2.0:
            raise ValueError(f"dof must exceed 2 for sd to exist, not {self.dof!r}")

    @cached_property
    def _scale(self) -> float:
        return self.sd * math.sqrt((self.dof - 2.0) / self.dof)

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        beta = math.lgamma(0.5 * (self.dof + 1.0)) - math.lgamma(0.5 * self.dof)
        constant = beta - 0.5 * math.log(self.dof * math.pi) - math.log(self._scale)
        with np.errstate(over="ignore", under="ignore"):
            square = np.square((np.asarray(x, dtype=float) - self.mean) / self._scale)
        return constant - 0.5 * (self.dof + 1.0) * np.log1p(square / self.dof)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        u = np.asarray(u, dtype=np.float64)
        # scipy's quantile has the wrong sign at probability zero
        standard = np.where(u <= 0.0, -math.inf, scipy.special.stdtrit(self.dof, u))
        return self.mean + self._scale * standard


# in standard deviations: largest distance of the nearer bound, and least distance of the bounds,
# for which the probability between them is accurate: at least 1e-200 and 1e-9 of a density
PLAINLY_NEAR, PLAINLY_WIDE = 30.0, 1e-9


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """Normal law of given mean and standard deviation before truncation to low ≤ x ≤ high.

    It stays on the linear scale deliberately: the neutral value of a cause often lies on its bound,
    where log density and derivatives must exist and where a log scale would put it at −∞.
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
        low, high = self._standard_bounds
        # mostly decided without special functions: they take a third of a second to import, and the
        # catalogue contains such laws
        surely_some = max(low, -high) < PLAINLY_NEAR and high - low > PLAINLY_WIDE
        if not surely_some and not math.isfinite(self._log_mass):
            raise ValueError(f"no probability between {self.low!r} and {self.high!r}")

    @property
    def _standard_bounds(self) -> tuple[float, float]:
        return (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd

    @cached_property
    def _log_mass(self) -> float:
        low, high = self._standard_bounds
        if low > 0.0:
            low, high = -high, -low
        upper, lower = float(scipy.special.log_ndtr(high)), float(scipy.special.log_ndtr(low))
        gap = -math.expm1(lower - upper) if upper > -math.inf else 0.0
        return upper + math.log(gap) if gap > 0.0 else -math.inf

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @override
    def allows(self, x: float) -> bool:
        return self.low <= x <= self.high and math.isfinite(x)

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
        low, high = self._standard_bounds
        # the normal law is accurate in its lower tail only, so mirror an upper tail
        sign = -1.0 if low > 0.0 else 1.0
        if sign < 0.0:
            low, high, u = -high, -low, 1.0 - u
        with np.errstate(divide="ignore"):
            log_cdf = np.logaddexp(
                np.log1p(-u) + scipy.special.log_ndtr(low), np.log(u) + scipy.special.log_ndtr(high)
            )
        standard = sign * scipy.special.ndtri_exp(log_cdf)
        return np.clip(self.mean + self.sd * standard, self.low, self.high)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """Distribution of x > 0 with log x normal about log(median), standard deviation sigma."""

    median: float
    sigma: float
    support = _POSITIVE

    def __post_init__(self) -> None:
        require_positive(self.median, "median")
        require_positive(self.sigma, "sigma")

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=float)
        positive = x > 0.0
        log_x = np.log(np.where(positive, x, 1.0))
        density = normal_log_density(log_x, np.log(self.median), self.sigma) - log_x
        return np.where(positive, density, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return self.median * np.exp(
            self.sigma * scipy.special.ndtri(np.asarray(u, dtype=np.float64))
        )


@dataclass(frozen=True)
class HalfNormal(Distribution):
    """Distribution of |y| with y normal, mean zero and standard deviation sd; log transform."""

    sd: float
    support = _POSITIVE

    def __post_init__(self) -> None:
        require_positive(self.sd, "sd")

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        density = normal_log_density(x, 0.0, self.sd) + math.log(2.0)
        return np.where(np.asarray(x) >= 0.0, density, -math.inf)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return np.asarray(
            self.sd * math.sqrt(2.0) * scipy.special.erfinv(np.asarray(u)), dtype=np.float64
        )


@dataclass(frozen=True)
class HalfCauchy(Distribution):
    """Distribution of |y| where y is Cauchy about zero; `scale` is its median; log transform."""

    scale: float
    support = _POSITIVE

    def __post_init__(self) -> None:
        require_positive(self.scale, "scale")

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
class Uniform(Distribution):
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


@dataclass(frozen=True)
class Choice(Distribution):
    """One of two states: the parameter has the state, or its neutral value without its cause.

    Its evidence compares a model with the state to one without. A sampler needs a density: the
    parameter moves within ±1e-5 of the state by a normal law, and `ParameterTable.named` returns
    the state. A study cannot set this prior: only the probability of the cause is uncertain.

    Examples
    --------
    >>> exchanged = Choice(state=1.0, neutral=0.0)
    >>> exchanged.allows(0.0), exchanged.allows(0.4), exchanged.allows(1.0)
    (True, False, True)
    >>> float(exchanged.settled(np.array(1.0 - 1e-6)))
    1.0
    """

    state: float
    neutral: float

    def __post_init__(self) -> None:
        require_finite(self.state, "state")
        require_finite(self.neutral, "neutral")

    def __str__(self) -> str:
        """Return the two states."""
        return f"either {self.neutral:g} or {self.state:g}"

    @cached_property
    def _about(self) -> TruncatedNormal:
        sd = 1e-6
        return TruncatedNormal(self.state, sd, self.state - 10.0 * sd, self.state + 10.0 * sd)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self._about.support

    @override
    def allows(self, x: float) -> bool:
        return x in (self.state, self.neutral)

    @override
    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        return self._about.log_density(x)

    @override
    def untruncated_log_density(self, x: npt.ArrayLike) -> FloatArray:
        return self._about.untruncated_log_density(x)

    @override
    def quantile(self, u: npt.ArrayLike) -> FloatArray:
        return self._about.quantile(u)

    def settled(self, x: FloatArray) -> FloatArray:
        """Return the state for values near it, and others unchanged."""
        low, high = self.support
        return np.where((x >= low) & (x <= high), self.state, x)


@dataclass(frozen=True)
class Flat(Distribution):
    """Density 1 between low and high, of which at least one is infinite: an improper prior.

    It sets a bound and leaves the rest to the likelihood, like an undeclared prior in Stan.
    A posterior under it must be made proper by the data, and its evidence has no absolute meaning.
    It has no quantiles and cannot be drawn from; a study's priors are therefore never flat.

    Values above a bound are sampled as low + exp(z), values below one as high − exp(−z).

    Raises
    ------
    ValueError
        If both bounds are finite (use `Uniform`), or are not an interval.

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


__all__ = [
    "LAWS",
    "Choice",
    "Distribution",
    "FloatArray",
    "HalfCauchy",
    "HalfNormal",
    "LogNormal",
    "Normal",
    "Parameter",
    "StudentT",
    "TruncatedNormal",
    "Uniform",
    "law_from_mapping",
]

type _LawClass = (
    type[Normal]
    | type[LogNormal]
    | type[HalfNormal]
    | type[Uniform]
    | type[StudentT]
    | type[TruncatedNormal]
    | type[HalfCauchy]
)

LAWS: Mapping[str, _LawClass] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "half_normal": HalfNormal,
    "uniform": Uniform,
    "student_t": StudentT,
    "truncated_normal": TruncatedNormal,
    "half_cauchy": HalfCauchy,
}

#: Largest argument of a law; no parameter is as large in its unit.
_LARGEST = 1e12


@dataclass(frozen=True)
class Parameter:
    """A named unknown with its prior.

    Parameters
    ----------
    name : str
        Name used by sampler, report and study file.
    law : Distribution
        Prior law.
    unit : str
        Unit of its values; an en dash, the default, if it has none.
    meaning : str
        Description in words; empty by default.
    neutral : float, optional
        The value at which it has no effect; its prior density there must not vanish.
    least : float
        Smaller values act like this one, see `at_least`; 0 for no bound.

    Raises
    ------
    ValueError
        If the name is empty, or the neutral value is not finite or impossible under the prior.

    Examples
    --------
    >>> Parameter("volume_ratio", Normal(0.62, 0.07), "–", "volume after over before drying").name
    'volume_ratio'
    """

    name: str
    law: Distribution
    unit: str = "–"
    meaning: str = ""
    neutral: float | None = None
    least: float = 0.0

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise ValueError("a parameter needs a name")
        if self.neutral is None:
            return
        if not math.isfinite(self.neutral):
            raise ValueError(f"{self.name}: neutral must be finite, not {self.neutral!r}")
        if not self.law.allows(self.neutral):
            raise ValueError(
                f"{self.name}: neutral {self.neutral!r} is impossible under {self.law}"
            )


def law_from_mapping(mapping: Mapping[str, object]) -> Distribution:
    """Return the law described by a table of a study file.

    Parameters
    ----------
    mapping : Mapping
        ``law`` names one of `LAWS`; the other keys are its arguments.

    Returns
    -------
    Distribution

    Raises
    ------
    ValueError
        If the law is unknown, a key is missing or unknown, or a value is impossible.

    Examples
    --------
    >>> law_from_mapping({"law": "normal", "mean": 0.62, "sd": 0.07})
    Normal(mean=0.62, sd=0.07)
    >>> law_from_mapping({"law": "norml", "mean": 0.62, "sd": 0.07})
    Traceback (most recent call last):
    ...
    ValueError: unknown law 'norml'; did you mean 'normal'?
    """
    if "law" not in mapping:
        raise ValueError(f"key 'law' is missing; use one of {', '.join(LAWS)}")
    name = mapping["law"]
    if not isinstance(name, str) or name not in LAWS:
        raise ValueError(f"unknown law {name!r}; {_suggestion(str(name), list(LAWS))}")
    law_class = LAWS[name]
    known = [field.name for field in fields(law_class)]
    required = [field.name for field in fields(law_class) if field.default is MISSING]
    arguments = {key: value for key, value in mapping.items() if key != "law"}
    for key in arguments:
        if key not in known:
            raise ValueError(f"law {name!r} has no key {key!r}; {_suggestion(key, known)}")
    for key in required:
        if key not in arguments:
            raise ValueError(f"law {name!r} needs key {key!r}")
    values = {}
    for key, value in arguments.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"law {name!r}: {key} must be a number, not {value!r}")
        if _LARGEST < abs(value) < math.inf:  # bounds may be infinite
            limits = f"between −{_LARGEST:g} and {_LARGEST:g}"
            raise ValueError(f"law {name!r}: {key} must be a number {limits}")
        values[key] = float(value)
    try:
        return law_class(**values)
    except ValueError as fault:
        raise ValueError(f"law {name!r}: {fault}") from None


def _suggestion(word: str, known: list[str]) -> str:
    nearest = difflib.get_close_matches(word.lower(), known, n=1)
    return f"did you mean {nearest[0]!r}?" if nearest else f"use one of {', '.join(known)}"


_STACKED = (Normal, TruncatedNormal, LogNormal, HalfNormal)
"""Laws that accept array arguments, as their scale depends only on their class."""


def _stack(laws: Sequence[Distribution]) -> Distribution:
    """Return a law with array arguments for laws of one class; a single law unchanged."""
    first = laws[0]
    if len(laws) == 1 or not isinstance(first, _STACKED):
        return first
    stack = object.__new__(type(first))
    for field in fields(first):
        stack.__dict__[field.name] = np.array([getattr(law, field.name) for law in laws])
    if isinstance(first, TruncatedNormal):
        masses = [law._log_mass for law in laws if isinstance(law, TruncatedNormal)]
        stack.__dict__["_log_mass"] = np.array(masses)
    return stack


Named = Mapping[str, FloatArray]
"""Values of parameters by name, each of shape (n,)."""


@dataclass(frozen=True)
class ParameterTable:
    """Parameters in the order of the sampler's vector.

    The sampler works on an unconstrained scale, log for positive and logit for bounded quantities;
    ``named`` returns the values that users know.

    Parameters
    ----------
    parameters : tuple of Parameter
        With distinct names.
    """

    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in order."""
        return tuple(p.name for p in self.parameters)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.parameters)

    @cached_property
    def _laws(self) -> list[tuple[Distribution, list[int]]]:
        """Laws with the columns that they are of, those of a class combined into one.

        The overhead of a call of numpy exceeds the computation of a law.
        """
        columns: dict[object, list[int]] = {}
        for i, parameter in enumerate(self.parameters):
            kind = type(parameter.law)
            columns.setdefault(kind if kind in _STACKED else i, []).append(i)
        return [(_stack([self.parameters[i].law for i in of]), of) for of in columns.values()]

    def named(self, vectors: FloatArray) -> dict[str, FloatArray]:
        """Return values by name from vectors (..., n_parameters)."""
        found: dict[str, FloatArray] = dict.fromkeys(self.names, vectors)
        for law, columns in self._laws:
            values = law.from_unconstrained(vectors[..., columns])
            if isinstance(law, Choice):
                values = law.settled(values)
            for k, i in enumerate(columns):
                parameter = self.parameters[i]
                found[parameter.name] = at_least(values[..., k], parameter.least)
        return found

    def vectors(self, values: Named) -> FloatArray:
        """Return vectors (..., n_parameters) from values by name."""
        return np.stack(
            [p.law.to_unconstrained(np.asarray(values[p.name])) for p in self.parameters], axis=-1
        )

    def log_prior(self, vectors: FloatArray, *, truncate: bool = True) -> FloatArray:
        """Return the log prior density on the unconstrained scale, shape (...).

        Parameters
        ----------
        vectors : array, shape (..., n_parameters)
            Unconstrained.
        truncate : bool
            False leaves out the bounds of truncated laws, for derivatives at a bound.
        """
        total: FloatArray = np.sum(self.log_priors(vectors, truncate=truncate), axis=-1)
        return total

    def log_priors(self, vectors: FloatArray, *, truncate: bool = True) -> FloatArray:
        """Return the log prior density of each parameter, shape (..., n_parameters).

        The arguments are those of `log_prior`.
        """
        found = np.empty(vectors.shape)
        for law, columns in self._laws:
            z = vectors[..., columns]
            x = law.from_unconstrained(z)
            density = law.log_density(x) if truncate else law.untruncated_log_density(x)
            found[..., columns] = density + law.log_jacobian(z)
        return found

    def sample(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Draw vectors from the prior, shape (count, n_parameters)."""
        draws = {p.name: p.law.sample(generator, count) for p in self.parameters}
        return self.vectors(draws)


SHARPNESS = 8
"""Exponent of `at_least`: twenty times the bound changes by a relative 5e-12."""


def at_least(values: FloatArray, least: float) -> FloatArray:
    """Return positive values bounded below by a positive one, smoothly: (x⁸ + least⁸)^(1/8).

    A mode at a kinked bound would have no curvature, which proposals and evidence need.

    Examples
    --------
    >>> at_least(np.array([0.0, 1.0, 20.0]), 1.0).round(3).tolist()
    [1.0, 1.091, 20.0]
    """
    if least == 0.0:
        return values
    larger = np.maximum(values, least)
    bounded: FloatArray = larger * (1.0 + (np.minimum(values, least) / larger) ** SHARPNESS) ** (
        1.0 / SHARPNESS
    )
    return bounded


def with_least(
    parameters: Iterable[Parameter], least: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """Return parameters with lower bounds given by name."""
    return tuple(replace(p, least=least.get(p.name, p.least)) for p in parameters)


def with_priors(
    parameters: Iterable[Parameter], priors: Mapping[str, Distribution]
) -> tuple[Parameter, ...]:
    """Return parameters with the priors given by a study."""
    return tuple(replace(p, law=priors.get(p.name, p.law)) for p in parameters)


def check_priors(priors: Mapping[str, Distribution], known: Iterable[str]) -> None:
    """Raise StudyError for priors of parameters that do not exist.

    Raises
    ------
    StudyError
        Naming the nearest known parameter.
    """
    names = list(known)
    faults = []
    for name in priors:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(names)}"
            faults.append(
                Fault("study.toml", "is no parameter of this study", remedy, None, f"priors.{name}")
            )
    if faults:
        raise StudyError(faults)
