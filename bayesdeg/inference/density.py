"""Densities for sampling: any log density over named parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from inspect import signature
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from bayesdeg.priors import Flat, Named, Parameter, ParameterTable

Floats = NDArray[np.float64]

GUESS = 2.0  # half width of guesses for an improper prior, on the unconstrained scale


class Density(Protocol):
    """Interface of a posterior density, up to a constant, for mode search, evidence and sampling.

    ``log_prob`` may take a keyword ``truncate``; with False it leaves out the bounds of truncated
    priors (`ParameterTable.log_prior` does so), so that derivatives exist on a bound. A density
    that is a product of normal laws of readings may provide its factors (`Factored`): then the mode
    search uses expected second derivatives at the cost of first ones.
    """

    @property
    def table(self) -> ParameterTable:
        """The parameters, in the order of the vectors."""
        ...

    def log_prob(self, vectors: Floats) -> Floats:
        """Return log densities on the unconstrained scale, (n,) of (n, n_parameters)."""
        ...


class Factors(NamedTuple):
    r"""A log density as the sum of its factors, without the bounds of priors.

    .. math:: \ln p = \sum_j \left(-\tfrac12 z_j^2 - \ln s_j - \tfrac12 \ln 2\pi\right)
        + \sum_k g_k + \sum_i \ln p(\theta_i)

    Parameters
    ----------
    score : array, shape (n, n_readings)
        z_j, each reading given those before it, less its mean, over its standard deviation.
    log_sd : array, shape (n, n_readings)
        ln s_j, the logarithm of that standard deviation.
    other : array, shape (n, n_other)
        g_k, log densities of what is not normal.
    signal : array, shape (n, n_other)
        Quantities u_k with E[(∂g_k)²] = (∂u_k)²: their slopes give the expected information.
    prior : array, shape (n, n_parameters)
        Log density of each parameter on the unconstrained scale.
    """

    score: Floats
    log_sd: Floats
    other: Floats
    signal: Floats
    prior: Floats


class Factored(Density, Protocol):
    """A density that provides its factors."""

    def factors(self, vectors: Floats) -> Factors | None:
        """Return the factors at vectors (n, n_parameters); None if some have a different form."""
        ...


class _Continued(Protocol):
    """A density continued beyond the bounds of truncated priors."""

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats: ...


@dataclass(frozen=True)
class CustomDensity:
    """Any posterior: prior laws by parameter and a log likelihood over a batch of values.

    log p(z | y) = Σ log p(x_i) + log |dx_i/dz_i| + log L(x), with x the values that users know and
    z the sampler's unconstrained scale (log above or below a bound, logit between two); the
    Jacobian is that of Stan's transforms.

    Parameters
    ----------
    parameters : tuple of Parameter
        With distinct names. An improper prior is ``bayesdeg.priors.Flat``; a bound
        with a density that has no law here is `Flat(low=…)` with its log added to the likelihood.
    log_likelihood : callable
        From values by name, each of shape (n,), to log likelihoods (n,). Nan counts as impossible.
        A function of a module, not a lambda, if ensembles are to run in other processes.

    Examples
    --------
    The mean and sd of five readings, with a flat prior on the mean and one on the sd's logarithm:

    >>> from bayesdeg.priors import Flat
    >>> readings = np.array([4.9, 5.0, 5.2, 5.4, 5.5])
    >>> def log_likelihood(values):
    ...     mean, sd = values["mean"][:, None], values["sd"][:, None]
    ...     density = -0.5 * ((readings - mean) / sd) ** 2 - np.log(sd)
    ...     return density.sum(axis=1) - np.log(values["sd"])  # the prior 1/sd
    >>> posterior = CustomDensity(
    ...     (
    ...         Parameter("mean", Flat(), "–", "mean of the readings"),
    ...         Parameter("sd", Flat(low=0.0), "–", "their standard deviation"),
    ...     ),
    ...     log_likelihood,
    ... )
    >>> posterior.log_prob(np.array([[5.2, np.log(0.3)]])).round(3)
    array([4.575])

    From here on it is sampled as every model is:

    >>> from bayesdeg.inference.laplace import approximate, evidence
    >>> generator = np.random.default_rng(0)
    >>> laplace = approximate(posterior, generator)
    >>> start = evidence(posterior, laplace, generator)  # for bayesdeg.inference.sampling.sample
    >>> round(float(laplace.mode[0]), 3), start.effective > 1000.0
    (5.2, True)
    """

    parameters: tuple[Parameter, ...]
    log_likelihood: Callable[[Named], Floats]

    @property
    def table(self) -> ParameterTable:
        """The parameters, in the order of the vectors."""
        return ParameterTable(self.parameters)

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, shape (n,); −inf where impossible.

        Raises
        ------
        ValueError
            If the log likelihood does not return one number per vector.
        """
        table = self.table
        with np.errstate(all="ignore"):
            prior = table.log_prior(vectors, truncate=truncate)
            data = np.asarray(self.log_likelihood(table.named(vectors)), dtype=np.float64)
            if data.shape != prior.shape:
                raise ValueError(
                    f"log_likelihood must return shape {prior.shape}, one number for each of the "
                    f"given values, not {data.shape}"
                )
            total = prior + data
        # +inf is also invalid: the sampler would never leave it
        return np.where(np.isfinite(total), total, -np.inf)


def continued(density: Density) -> Callable[[Floats], Floats]:
    """Return the log density without the bounds of truncated priors, if the density offers it.

    Otherwise it is ``log_prob`` itself.

    Examples
    --------
    >>> from bayesdeg.priors import TruncatedNormal
    >>> positive = Parameter("size", TruncatedNormal(0.0, 1.0, 0.0), "–", "of an effect")
    >>> flat = CustomDensity((positive,), lambda values: np.zeros(len(values["size"])))
    >>> below = np.array([[-1.0]])
    >>> flat.log_prob(below).round(3), continued(flat)(below).round(3)
    (array([-inf]), array([-0.726]))
    """
    if "truncate" in signature(density.log_prob).parameters:
        return partial(cast(_Continued, density).log_prob, truncate=False)
    return density.log_prob


def log_ratio(above: Floats, below: Floats) -> Floats:
    """Return ln(p/q) from ln p and ln q; nan without a warning where both densities are 0.

    Examples
    --------
    >>> log_ratio(np.array([-1.0, -np.inf, -np.inf]), np.array([-3.0, -3.0, -np.inf]))
    array([  2., -inf,  nan])
    """
    with np.errstate(invalid="ignore"):
        return np.subtract(above, below)


def factors_of(density: Density, vectors: Floats) -> Factors | None:
    """Return the factors of a density if it provides them, else None."""
    known = getattr(density, "factors", None)
    if known is None:
        return None
    found: Factors | None = known(vectors)
    return found


def bounds(table: ParameterTable) -> tuple[Floats, Floats]:
    """Return the smallest and largest possible vectors, each (n_parameters,), mostly infinite.

    Only truncated laws have bounds on the unconstrained scale.

    Examples
    --------
    >>> from bayesdeg.priors import Normal, TruncatedNormal
    >>> size = Parameter("size", TruncatedNormal(0.0, 1.0, 0.0), "–", "of an effect")
    >>> bounds(ParameterTable((size, Parameter("shift", Normal(0.0, 1.0), "–", "of it"))))
    (array([  0., -inf]), array([inf, inf]))
    """
    ends = np.array([p.law.to_unconstrained(np.array(p.law.support)) for p in table.parameters])
    return ends[:, 0], ends[:, 1]


def guesses(table: ParameterTable, generator: np.random.Generator, count: int) -> Floats:
    """Return starts of a mode search: the prior's median and draws, (1 + count, n_parameters).

    An improper prior has neither: its median is taken as 0, its draws as uniform on (−2, 2), both
    on the unconstrained scale, as Stan's initial values are.
    """
    columns = []
    for parameter in table.parameters:
        law = parameter.law
        if isinstance(law, Flat):
            column = np.append(0.0, generator.uniform(-GUESS, GUESS, count))
        else:
            values = np.append(law.quantile(0.5), law.sample(generator, count))
            column = law.to_unconstrained(values)
        columns.append(column)
    return np.stack(columns, axis=-1)
