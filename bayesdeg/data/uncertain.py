"""Dimensions of an actuator given by a distribution: their possible range."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import override

import numpy as np
from numpy.typing import ArrayLike

from bayesdeg.priors import Distribution, FloatArray, Normal, Parameter, TruncatedNormal, Uniform

PREFIX = "actuator."
"""Prefix of parameters that are dimensions."""
UNIT = "mm"
MOST = 3
"""Maximum number of uncertain dimensions: curves are solved for each, and for each pair."""
BEYOND = 0.00135
"""Probability cut off at either end of a law: that beyond three standard deviations of a normal
law. No curve is solved there."""
MOST_LOST = 0.01
"""Probability of a law that may lie where no actuator can be made, and is then cut off; with more,
the law is refused as a mistake."""
KEPT_OFF = 0.05
"""Share of the way from the median to a vanishing wall that is kept off, as meshes fail there."""
NEAR = 0.02  # of a law's width: bounds this close to its ends count as its ends
_HALVINGS = 60
_SD = 0.1586552539314571  # probability below μ − σ of a normal law

Problems = Callable[[Mapping[str, float]], tuple[str, ...]]
"""Says why no actuator can be made with changed dimensions [mm]."""


@dataclass(frozen=True)
class BoundedLaw(Distribution):
    """A law truncated to two bounds; logit transform.

    Parameters
    ----------
    law : Distribution
        The law before truncation.
    low, high : float
        Bounds, between which its probability is positive.

    Examples
    --------
    >>> from bayesdeg.priors import LogNormal
    >>> bounded = BoundedLaw(LogNormal(2.0, 0.1), 1.9, 2.1)
    >>> bounded.quantile([0.0, 0.5, 1.0]).round(3).tolist()
    [1.9, 1.998, 2.1]
    """

    law: Distribution
    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse bounds without probability between them."""
        if not self.low < self.high:
            raise ValueError(f"low must be below high, not {self.low!r} and {self.high!r}")
        first, last = self._ends
        if not last > first:
            raise ValueError(f"no probability between {self.low!r} and {self.high!r}")

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return mass_below(self.law, self.low), mass_below(self.law, self.high)

    @property
    @override
    def support(self) -> tuple[float, float]:
        return self.low, self.high

    @override
    def log_density(self, x: ArrayLike) -> FloatArray:
        x = np.asarray(x, dtype=np.float64)
        first, last = self._ends
        inside = (x >= self.low) & (x <= self.high)
        return np.where(inside, self.law.log_density(x) - np.log(last - first), -np.inf)

    @override
    def quantile(self, u: ArrayLike) -> FloatArray:
        first, last = self._ends
        share = first + (last - first) * np.asarray(u, dtype=np.float64)
        return np.clip(self.law.quantile(share), self.low, self.high)


def mass_below(law: Distribution, x: float) -> float:
    """Return the probability of a law below a value, from its quantiles.

    Examples
    --------
    >>> round(mass_below(Normal(1.0, 0.5), 1.5), 4)
    0.8413
    """
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(law.quantile(middle)) < x else (low, middle)
    return 0.5 * (low + high)


def bounded(law: Distribution, low: float, high: float) -> Distribution:
    """Truncate a law to two bounds, keeping its class if that has bounds.

    Examples
    --------
    >>> bounded(Uniform(0.0, 4.0), 1.0, 9.0)
    Uniform(low=1.0, high=4.0)
    """
    if isinstance(law, Uniform):
        return Uniform(max(law.low, low), min(law.high, high))
    if isinstance(law, Normal):
        return TruncatedNormal(law.mean, law.sd, low, high)
    if isinstance(law, TruncatedNormal):
        return TruncatedNormal(law.mean, law.sd, max(law.low, low), min(law.high, high))
    return BoundedLaw(law, low, high)


@dataclass(frozen=True)
class UncertainDimension:
    """A dimension of an actuator given by a prior, and its range.

    Parameters
    ----------
    name : str
        Name of the dimension.
    law : Distribution
        As stated in the study [mm].
    low, high : float
        Range used [mm].
    lost : float
        Probability of the law where no actuator can be made [–].

    Examples
    --------
    >>> length = UncertainDimension("length", Normal(40.4, 2.6), 32.6, 48.2)
    >>> length.median, round(length.step, 6), length.parameter.name
    (40.4, 2.6, 'actuator.length')
    """

    name: str
    law: Distribution
    low: float
    high: float
    lost: float = 0.0

    @property
    def median(self) -> float:
        """The value at which the actuator is built [mm]."""
        return float(self.law.quantile(0.5))

    @cached_property
    def step(self) -> float:
        """Half the width of the central 68 % of the law, a standard deviation [mm]."""
        low, high = self.law.quantile([_SD, 1.0 - _SD])
        return float(0.5 * (high - low))

    @property
    def range(self) -> tuple[float, float]:
        """Its bounds minus the median, in units of ``step`` [–]."""
        return (self.low - self.median) / self.step, (self.high - self.median) / self.step

    @property
    def prior(self) -> Distribution:
        """The truncated law [mm]."""
        return bounded(self.law, self.low, self.high)

    @property
    def parameter(self) -> Parameter:
        """The sampled parameter."""
        return Parameter(f"{PREFIX}{self.name}", self.prior, UNIT, f"{self.name} as moulded")


def is_dimension(name: str) -> bool:
    """Return whether a parameter is a dimension of the actuator, by its name.

    Examples
    --------
    >>> is_dimension("actuator.length"), is_dimension("pressure_offset.offset")
    (True, False)
    """
    return name.startswith(PREFIX)


def dimensions_among(names: Iterable[str]) -> tuple[str, ...]:
    """Return the dimensions among parameters, by their own names.

    Examples
    --------
    >>> dimensions_among(["paper_stiffness", "actuator.length"])
    ('length',)
    """
    return tuple(name.removeprefix(PREFIX) for name in names if is_dimension(name))


def uncertain_dimension(name: str, law: Distribution, problems: Problems) -> UncertainDimension:
    """Return a dimension with its law truncated to possible actuators.

    Parameters
    ----------
    name : str
        A dimension whose median is possible.
    law : Distribution
        Distribution of its values [mm].
    problems : callable
        Says what is wrong with changed dimensions.

    Raises
    ------
    ValueError
        If more than ``MOST_LOST`` of the law lies where no actuator can be made; the message says
        beyond which value, and why.

    Examples
    --------
    >>> def thin(values):
    ...     return () if values["wall"] > 0.0 else ("no wall; give more",)
    >>> found = uncertain_dimension("wall", Normal(1.0, 0.4), thin)
    >>> round(found.low, 3), round(found.high, 3), round(found.lost, 4)
    (0.05, 2.2, 0.0062)
    """
    median = float(law.quantile(0.5))
    ends, lost = list[float](), 0.0
    for far in _far_ends(law):
        wrong = problems({name: far})
        if not wrong:
            ends.append(far)
            continue
        last = _last_possible(name, median, far, problems)
        below = mass_below(law, last)
        lost += below if far < median else 1.0 - below
        if lost > MOST_LOST:
            side = "below" if far < median else "above"
            raise ValueError(
                f"has {100.0 * lost:.2g} % of its probability {side} {last:.4g} mm, where "
                f"{wrong[0].partition('; ')[0]}"
            )
        ends.append(last + KEPT_OFF * (median - last))
    return UncertainDimension(name, law, ends[0], ends[1], lost)


def _far_ends(law: Distribution) -> tuple[float, float]:
    """Return the tail quantiles of a law, or its bounds where they are close."""
    low, first, last, high = (float(law.quantile(u)) for u in (0.0, BEYOND, 1.0 - BEYOND, 1.0))
    near = NEAR * (last - first)
    return low if first - low < near else first, high if high - last < near else last


def _last_possible(name: str, median: float, far: float, problems: Problems) -> float:
    """Return the farthest value from the median with which an actuator can be made [mm]."""
    inner, outer = median, far
    for _ in range(_HALVINGS):
        middle = 0.5 * (inner + outer)
        inner, outer = (inner, middle) if problems({name: middle}) else (middle, outer)
    return inner


def corners(dimensions: tuple[UncertainDimension, ...]) -> Iterator[dict[str, float]]:
    """Yield all combinations of dimensions one standard deviation off [mm].

    Examples
    --------
    >>> one = UncertainDimension("wall", Uniform(1.0, 3.0), 1.0, 3.0)
    >>> [round(found["wall"], 2) for found in corners((one,))]
    [1.32, 2.68]
    """
    if len(dimensions) == 0:
        return
    for signs in product((-1.0, 1.0), repeat=len(dimensions)):
        yield {
            one.name: min(max(one.median + sign * one.step, one.low), one.high)
            for one, sign in zip(dimensions, signs, strict=True)
        }
