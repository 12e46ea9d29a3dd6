r"""Linearised models: a covariance of specimen blocks plus a low-rank part, and its whitening.

.. math:: \Sigma = B (I + Q D^2 Q^T) B^T, \qquad B B^T = V,\quad Q D = B^{-1} X \Lambda^{-1/2}

with V the scatter, in which readings of different specimens are independent, and X Λ⁻¹ Xᵀ of as low
a rank as there are parameters. So cost grows with the number of readings, and not with its cube.

Near the mode the readings are y = f + X δ + d(φ) + e: δ the deviation of the parameters from the
mode, known from all other data and the priors to N(δ₀, Λ⁻¹); d the change that a cause of size φ
makes; e ~ N(0, V) with reading error and specimen scatter. After δ is integrated out and the result
is whitened, the base model says z ~ N(0, I), and an effect with a normal prior makes the covariance
larger.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import logsumexp

from bayesdeg.causes.cause import Cause
from bayesdeg.inference.density import Density
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, approximate, slopes
from bayesdeg.inference.model import JointModel
from bayesdeg.priors import Parameter

Floats = NDArray[np.float64]

FAINT = 1e-12  # relative to the largest: a direction in which nothing is shared


@dataclass(frozen=True)
class Whitening:
    """A covariance Σ as maps to the whitened scale and back.

    Parameters
    ----------
    lower, inverse : sparse array, shape (n, n)
        B, lower triangular in the order of each block's readings, and its inverse.
    basis : array, shape (n, r)
        Q, orthonormal.
    size : array, shape (r,)
        Diagonal of D.

    Examples
    --------
    >>> shared = np.array([[1.0], [1.0]])
    >>> law = Whitening.of(np.diag([1.0, 4.0]), shared)
    >>> (law.factor @ law.factor.T).round(6)
    array([[2., 1.],
           [1., 5.]])
    """

    lower: csr_array
    inverse: csr_array
    basis: Floats
    size: Floats

    @classmethod
    def of(cls, scatter: Floats, shared: Floats) -> "Whitening":
        """Return the whitening of scatter + shared sharedᵀ.

        V (n, n) is zero between readings of different specimens; the other is a root of what is
        shared, (n, r), as X Λ^(−1/2).

        Raises
        ------
        LinAlgError
            If V is not positive definite. Numbers that are not finite are kept.
        """
        count, member = connected_components(csr_array(scatter != 0.0), directed=False)
        lower, inverse = [], []
        order = np.argsort(member, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(member[order])) + 1) if count else ():
            block = scatter[np.ix_(rows, rows)]
            if np.all(np.isfinite(block)):
                factor = np.linalg.cholesky(block)
                back = solve_triangular(factor, np.eye(len(rows)), lower=True)
            else:
                factor = back = np.tril(np.full(block.shape, np.nan))
            lower.append((rows, factor))
            inverse.append((rows, back))
        size, nothing = len(scatter), np.zeros((len(scatter), 0))
        roots = _sparse(lower, size), _sparse(inverse, size)
        return cls(*roots, nothing, np.zeros(0)).sharing(shared)

    def sharing(self, shared: Floats) -> "Whitening":
        """Return the whitening for the same scatter and a different shared part, (n, r)."""
        columns = self.inverse @ shared
        vectors, size, _ = np.linalg.svd(
            np.where(np.isfinite(columns), columns, 0.0), full_matrices=False
        )
        kept = size > FAINT * size.max(initial=1.0)
        if not np.all(np.isfinite(shared)):
            vectors = np.full_like(vectors, np.nan)
        return replace(self, basis=vectors[:, kept], size=size[kept])

    @cached_property
    def is_finite(self) -> bool:
        """Whether all values are finite."""
        return bool(np.all(np.isfinite(self.lower.data)) and np.all(np.isfinite(self.basis)))

    @property
    def factor(self) -> Floats:
        """A root F of Σ = F Fᵀ with F z what `coloured` returns, (n, n)."""
        return self.coloured(np.eye(self.lower.shape[0]))

    def whitened(self, columns: Floats) -> Floats:
        """Return F⁻¹ y of y (n,) or of columns (n, k)."""
        return self._turned(self.inverse @ columns, 1.0 / np.sqrt(1.0 + self.size**2))

    def coloured(self, columns: Floats) -> Floats:
        """Return F z of z (n,) or of columns (n, k)."""
        coloured: Floats = self.lower @ self._turned(columns, np.sqrt(1.0 + self.size**2))
        return coloured

    def adjoint(self, columns: Floats) -> Floats:
        """Return F⁻ᵀ z of z (n,) or of columns (n, k): Σ⁻¹ y is that of whitened y."""
        turned = self._turned(columns, 1.0 / np.sqrt(1.0 + self.size**2))
        found: Floats = self.inverse.T @ turned
        return found

    def log_density(self, residual: Floats) -> float:
        """Return ln N(y; 0, Σ) of y (n,), less a constant."""
        root = float(np.sum(np.log(self.lower.diagonal())))
        spread = root + 0.5 * float(np.sum(np.log1p(self.size**2)))
        return -0.5 * float(np.sum(self.whitened(residual) ** 2)) - spread

    def _turned(self, columns: Floats, stretch: Floats) -> Floats:
        along = (stretch - 1.0) * (self.basis.T @ columns).T
        turned: Floats = columns + self.basis @ along.T
        return turned


def _sparse(blocks: list[tuple[NDArray[np.intp], Floats]], size: int) -> csr_array:
    row = np.concatenate([np.repeat(rows, len(rows)) for rows, _ in blocks])
    column = np.concatenate([np.tile(rows, len(rows)) for rows, _ in blocks])
    values = np.concatenate([block.ravel() for _, block in blocks])
    kept = values != 0.0
    return csr_array(coo_array((values[kept], (row[kept], column[kept])), shape=(size, size)))


ROUNDING = 1e-6  # standard deviations of the readings
SHORT = 1e-3  # standard deviations, of differences
SMALL = 0.25  # step in prior sizes: large enough to show an effect, small enough to be near neutral


@dataclass(frozen=True)
class Linear:
    """A linearised model of readings.

    Parameters
    ----------
    subject : JointModel
        What was linearised.
    mode : array, shape (n_parameters,)
        Where.
    prediction : array, shape (n,)
        Readings predicted at the mode.
    mean : array, shape (n,)
        Readings expected from all other data: the prediction with the shift X δ₀.
    shift : array, shape (n_parameters,)
        δ₀, on the sampler's scale.
    jacobian : array, shape (n, n_parameters)
        X, on the sampler's scale.
    scatter : array, shape (n, n)
        V, of specimens and errors.
    whitening : Whitening
        Of V + X Λ⁻¹ Xᵀ.
    """

    subject: JointModel
    mode: Floats
    prediction: Floats
    mean: Floats
    shift: Floats
    jacobian: Floats
    scatter: Floats
    whitening: Whitening

    @property
    def is_known(self) -> bool:
        """Whether the model can be evaluated at and around the mode."""
        return bool(np.all(np.isfinite(self.mean))) and self.whitening.is_finite

    @cached_property
    def factor(self) -> Floats:
        """A root F of the covariance V + X Λ⁻¹ Xᵀ; readings less their mean are F z, (n, n)."""
        return self.whitening.factor

    def whiten(self, readings: Floats) -> Floats:
        """Return z for readings (..., n), of the same shape."""
        residual = readings - self.mean
        flat = residual.reshape(-1, residual.shape[-1]).T
        return self.whitening.whitened(flat).T.reshape(residual.shape)

    def whiten_columns(self, columns: Floats) -> Floats:
        """Return directions (n, k) on the whitened scale."""
        return self.whitening.whitened(columns)

    @cached_property
    def covariance(self) -> Floats:
        """V + X Λ⁻¹ Xᵀ, (n, n)."""
        total: Floats = self.factor @ self.factor.T
        return total

    def with_scatter(self, scatter: Floats) -> "Linear":
        """Return the model with a different scatter V, (n, n), and the same shared part."""
        shared = self.whitening.lower @ (self.whitening.basis * self.whitening.size)
        return replace(self, scatter=scatter, whitening=Whitening.of(scatter, shared))

    @cached_property
    def observed(self) -> Floats:
        """The data on the whitened scale, shape (n,)."""
        return self.whiten(self.subject.observed)

    def straightened(self, vectors: Floats, simulated: Floats) -> Floats:
        """Return data sets simulated at posterior draws with the model linear in δ, (k, n).

        f + X (θ − mode) with the simulated errors and specimen deviations, since the observed data,
        unlike these, are those about which the model was linearised.

        Data sets (k, n) are those at the draws θ (k, n_parameters); nan where the model had no
        answer.
        """
        errors = simulated - self.subject.expected(vectors)
        straight: Floats = self.prediction + (vectors - self.mode) @ self.jacobian.T + errors
        return straight

    def unexplained(self, whitened: Floats) -> Floats:
        """Return the part of whitened data that is error and scatter after the refit, (..., n).

        The posterior mean of e: V (V + X Λ⁻¹ Xᵀ)⁻¹ (y − mean), in the readings' units.
        """
        flat = whitened.reshape(-1, whitened.shape[-1]).T
        errors = (self.scatter @ self.whitening.adjoint(flat)).T
        return np.asarray(errors.reshape(whitened.shape))


def linearise(
    subject: JointModel,
    mode: Floats,
    *,
    uncertain: Floats | None = None,
    centre: Floats | None = None,
) -> Linear:
    """Linearise a model of readings at its mode, or at any point.

    `uncertain` is Λ⁻¹ if it is known already, see `rest_law`. `centre` is the mean of the
    parameters given all but the readings, by default that of the normal law whose slope at the mode
    is the one there: δ₀ = Λ⁻¹ ∇ ln p. Laws of few replicates have heavy tails; where the readings
    have moved a parameter into one, it pulls back less than a normal law of their width.
    """
    prediction = subject.expected(mode[None])[0]
    jacobian = jacobian_of(subject, mode)
    if uncertain is None:
        uncertain = rest_law(subject, mode)[1]
    scatter = subject.scatter(mode)
    # non-finite values where the model cannot be evaluated, see `is_known`
    whitening = Whitening.of(scatter, jacobian @ rooted(uncertain))
    moves = is_seen(whitening.whitened(jacobian))
    if centre is None:
        found: Floats = slopes(subject.rest(), mode[None], SHORT * np.sqrt(np.diag(uncertain)))[0]
        shift = uncertain @ np.where(moves, found, 0.0)
    else:
        shift = centre - mode
    mean = prediction + jacobian @ shift
    return Linear(subject, mode, prediction, mean, shift, jacobian, scatter, whitening)


def rooted(covariance: Floats) -> Floats:
    """Return R with R Rᵀ a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def rest_law(subject: JointModel, start: Floats) -> tuple[Floats, Floats]:
    """Return mean and covariance of the parameters given priors and all but the readings.

    They come from draws, not from mode and inverse curvature: laws of few replicates have heavy
    tails, where the curvature is meaningless.
    """
    rest, generator = subject.rest(), np.random.default_rng(0)
    laplace = approximate(rest, generator, start=start)
    found = about_mode(rest, laplace, generator)
    if found.effective < FEWEST_EFFECTIVE:
        return laplace.mode, laplace.covariance
    weights = np.exp(found.log_weights - logsumexp(found.log_weights))
    known = np.isfinite(found.log_weights)
    mean = np.average(found.draws[known], axis=0, weights=weights[known])
    return mean, np.atleast_2d(np.cov(found.draws[known].T, aweights=weights[known]))


def with_prior_moments(
    mean: Floats, covariance: Floats, density: Density, extended: Density
) -> tuple[Floats, Floats]:
    """Return mean and Λ⁻¹ of an extended model, with priors for the added parameters.

    On the sampler's scale.
    """
    known = {name: i for i, name in enumerate(density.table.names)}
    rows = [known.get(name, -1) for name in extended.table.names]
    centre, wider = np.zeros(len(rows)), np.zeros((len(rows), len(rows)))
    old = np.array([i for i, row in enumerate(rows) if row >= 0])
    kept = [row for row in rows if row >= 0]
    centre[old], wider[np.ix_(old, old)] = mean[kept], covariance[np.ix_(kept, kept)]
    for i, parameter in enumerate(extended.table.parameters):
        if rows[i] < 0:
            values = parameter.law.quantile((np.arange(1000) + 0.5) / 1000.0)
            draws = parameter.law.to_unconstrained(values)
            centre[i], wider[i, i] = float(np.mean(draws)), float(np.var(draws))
    return centre, wider


def with_neutral(vector: Floats, density: Density, extended: Density) -> Floats:
    """Return a vector of an extended model with the added parameters at their neutral values."""
    known = dict(zip(density.table.names, vector, strict=True))
    return np.array(
        [
            known[p.name] if p.name in known else float(p.law.to_unconstrained(p.neutral or 0.0))
            for p in extended.table.parameters
        ]
    )


def columns_of(extended: Density, cause: Cause) -> list[int]:
    """Return the indices of a cause's parameters in the vectors of an extended model."""
    names = extended.table.names
    return [names.index(cause.qualified(p.name)) for p in cause.parameters]


def is_seen(columns: Floats) -> NDArray[np.bool_]:
    """Return which whitened columns (n, k) change the mean by more than rounding, (k,).

    Parameters that only widen a scatter do not.
    """
    seen: NDArray[np.bool_] = np.max(np.abs(columns), axis=0, initial=0.0) > ROUNDING
    return seen


def effects(linear: Linear, cause: Cause, sizes: Floats) -> Floats:
    """Return whitened changes of the readings for these sizes of a cause, (k, n).

    Sizes (k, n_parameters of the cause) are on the unconstrained scale. Where the model refuses one
    the change is nan.
    """
    extended = linear.subject.extended(cause)
    neutral = with_neutral(linear.mode, linear.subject, extended)
    points = np.tile(neutral, (len(sizes) + 1, 1))
    points[1:, columns_of(extended, cause)] = sizes
    readings = extended.expected(points)
    changes: Floats = readings[1:] - readings[0]
    known = np.all(np.isfinite(changes), axis=1)
    changes[known] = linear.whiten_columns(changes[known].T).T
    changes[~known] = np.nan
    return changes


def sensitivities(linear: Linear, cause: Cause) -> Floats:
    """Return whitened changes of the readings for one prior size of each parameter, (n, k).

    A parameter that widens a scatter has a column of zeros: the mean does not show it.
    """
    neutral = neutral_sizes(cause)
    sizes = np.array([prior_size(p) for p in cause.parameters])
    moved = effects(linear, cause, neutral + SMALL * np.diag(sizes))
    return np.nan_to_num(moved.T / SMALL)


def neutral_sizes(cause: Cause) -> Floats:
    """Return the neutral parameters of a cause on the unconstrained scale."""
    return np.array([float(p.law.to_unconstrained(p.neutral or 0.0)) for p in cause.parameters])


def prior_size(parameter: Parameter) -> float:
    """Return the rms distance of a prior from its neutral value.

    It is taken on the sampler's scale, on which positive parameters are logarithms.

    Examples
    --------
    >>> from bayesdeg.priors import Normal
    >>> round(prior_size(Parameter("offset", Normal(0.0, 10.0), "kPa", "of a sensor", 0.0)), 1)
    10.0
    """
    law = parameter.law
    values = law.to_unconstrained(law.quantile((np.arange(1000) + 0.5) / 1000.0))
    neutral = float(law.to_unconstrained(parameter.neutral or 0.0))
    return float(np.sqrt(np.mean((values - neutral) ** 2)))


def log_bayes_factor(whitened: Floats, columns: Floats) -> Floats:
    """Return ln N(z; 0, I + S Sᵀ) − ln N(z; 0, I) for data (..., n), S (n, k) in prior sd's.

    Examples
    --------
    >>> z, s = np.array([2.0, 0.0]), np.array([[1.0], [0.0]])
    >>> round(float(log_bayes_factor(z, s)), 4)  # N(2; 0, √2) against N(2; 0, 1)
    0.6534
    """
    count = columns.shape[1]
    inner = np.eye(count) + columns.T @ columns
    projected = whitened @ columns
    gain = np.einsum("...i,ij,...j->...", projected, np.linalg.inv(inner), projected)
    factor: Floats = 0.5 * gain - 0.5 * np.linalg.slogdet(inner)[1]
    return factor


def jacobian_of(subject: JointModel, mode: Floats, step: float = 1e-3) -> Floats:
    """Central differences; one-sided if the other side is outside the forward map's range."""
    size = len(mode)
    around = mode + step * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
    return differences(subject.expected(around), step)


def differences(curves: Floats, step: float) -> Floats:
    """Return central differences (n, k) of curves (1 + 2 k, n) at, above and below a point.

    One-sided where a curve is nan.
    """
    half = len(curves) // 2
    here, forth, back = curves[0], curves[1 : half + 1], curves[half + 1 :]
    width = step * (np.isfinite(forth).astype(float) + np.isfinite(back))
    change = np.where(np.isfinite(forth), forth, here) - np.where(np.isfinite(back), back, here)
    slopes: Floats = (change / np.maximum(width, step)).T
    return slopes
