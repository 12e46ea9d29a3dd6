"""A model linearised at its mode: calibrated tests and closed-form comparisons in milliseconds.

Near the mode the readings are y = f + X δ + S φ + e: δ the deviation of the parameters from the
mode, known from all other data and the priors to N(δ₀, Λ⁻¹); φ the size of a cause with sensitivity
S; e ~ N(0, V) with reading error and specimen scatter. After δ is integrated out and the result is
whitened, the base model says z ~ N(0, I), and every alternative is a larger covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular

from bayesdeg.causes.cause import Cause
from bayesdeg.inference.likelihood import covariance
from bayesdeg.inference.mode import derivatives, positive_inverse
from bayesdeg.inference.model import Model
from bayesdeg.laws import Parameter

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Linear:
    """The linearised base model of the actuator's readings.

    Parameters
    ----------
    model : Model
        What was linearised.
    mode : array, shape (n_parameters,)
        Where.
    prediction : array, shape (n,)
        Readings predicted at the mode, curvatures [1/m] and bend angles [°].
    mean : array, shape (n,)
        Readings expected from all other data: the prediction with the shift X δ₀.
    factor : array, shape (n, n)
        Cholesky factor of V + X Λ⁻¹ Xᵀ.
    """

    model: Model
    mode: Floats
    prediction: Floats
    mean: Floats
    factor: Floats

    @property
    def read(self) -> NDArray[np.bool_]:
        """Where there is a reading, (n_specimens, n_readings)."""
        assert self.model.actuator is not None
        return self.model.actuator.paths.mask

    @property
    def output(self) -> NDArray[np.int64]:
        """Whether each reading is a curvature, 0, or a bend angle, 1, shape (n,)."""
        assert self.model.actuator is not None
        columns = np.arange(self.read.shape[1]) // self.model.actuator.pressure.shape[1]
        return np.broadcast_to(columns, self.read.shape)[self.read]

    def whiten(self, readings: Floats) -> Floats:
        """Return z for readings (..., n_specimens, n_readings), shape (..., n)."""
        residual = readings[..., self.read] - self.mean
        flat = residual.reshape(-1, residual.shape[-1]).T
        whitened: Floats = solve_triangular(self.factor, flat, lower=True).T
        return whitened.reshape(residual.shape)

    def whiten_columns(self, columns: Floats) -> Floats:
        """Return directions (n, k) on the whitened scale."""
        return np.asarray(solve_triangular(self.factor, columns, lower=True))

    @property
    def observed(self) -> Floats:
        """The data on the whitened scale, shape (n,)."""
        assert self.model.actuator is not None
        return self.whiten(self.model.actuator.readings)


def linearise(model: Model, mode: Floats) -> Linear:
    """Linearise a model with actuator data at its mode."""
    assert model.actuator is not None
    mask = model.actuator.paths.mask
    values = model.table.named(mode[None])
    curves = model.actuator_linearised(values)
    prediction = model.predict(values).mean[0]
    jacobian = _jacobian(model, mode)
    gradient, hessian = derivatives(replace(model, actuator=None), mode)
    uncertain = positive_inverse(-hessian)
    shift = uncertain @ gradient
    scatter = block_diag(
        *(one[np.ix_(row, row)] for one, row in zip(covariance(curves)[0], mask, strict=True))
    )
    total = scatter + jacobian @ uncertain @ jacobian.T
    mean = prediction[mask] + jacobian @ shift
    return Linear(model, mode, prediction[mask], mean, np.linalg.cholesky(total))


def sensitivities(linear: Linear, cause: Cause) -> Floats:
    """Return whitened changes of the readings for one prior sd of each parameter, (n, k).

    A parameter that widens a scatter has a column of zeros: the mean does not show it.
    """
    model = linear.model
    assert model.actuator is not None
    extended = model.extended(cause)
    neutral = with_neutral(linear.mode, model, cause)
    base = extended.predict(extended.table.named(neutral[None])).mean[0]
    columns = []
    for parameter in cause.parameters:
        size = prior_size(parameter)
        moved = neutral.copy()
        # a quarter of the prior: large enough to see an effect, small enough to be near neutral
        moved[extended.table.names.index(cause.qualified(parameter.name))] += 0.25 * size
        change = extended.predict(extended.table.named(moved[None])).mean[0] - base
        columns.append(4.0 * change[linear.read])
    return linear.whiten_columns(np.nan_to_num(np.stack(columns, axis=1)))


def prior_size(parameter: Parameter) -> float:
    """Return the root mean square distance of a parameter's prior from its neutral value.

    Examples
    --------
    >>> from bayesdeg.laws import Normal
    >>> round(prior_size(Parameter("offset", Normal(0.0, 10.0), "kPa", "of a sensor", 0.0)), 1)
    10.0
    """
    values = parameter.law.quantile((np.arange(1000) + 0.5) / 1000.0)
    return float(np.sqrt(np.mean((values - (parameter.neutral or 0.0)) ** 2)))


def with_neutral(vector: Floats, model: Model, cause: Cause) -> Floats:
    """Return a vector of the model extended by a cause, at that cause's neutral values."""
    table = model.extended(cause).table
    known = dict(zip(model.table.names, vector, strict=True))
    return np.array(
        [
            known[p.name] if p.name in known else float(p.law.to_unconstrained(p.neutral or 0.0))
            for p in table.parameters
        ]
    )


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


def most_probable_size(whitened: Floats, columns: Floats, cause: Cause) -> Floats:
    """Return the posterior mean of a cause's parameters less their neutral values, (k,)."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    scaled = np.linalg.solve(inner, columns.T @ whitened)
    size: Floats = scaled * np.array([prior_size(p) for p in cause.parameters])
    return size


def overlap(first: Floats, second: Floats) -> float:
    """Return the largest squared correlation between two whitened effects, 0 to 1.

    At 1 the data cannot tell them apart; 1 − overlap is what is left of one when the other is
    refitted.
    """
    if first.shape[1] == 0 or second.shape[1] == 0:
        return 0.0
    a, b = (np.linalg.qr(columns)[0] for columns in (first, second))
    return float(np.linalg.svd(a.T @ b, compute_uv=False)[0] ** 2)


def _jacobian(model: Model, mode: Floats, step: float = 1e-3) -> Floats:
    """Central differences; one-sided where the other side is outside the forward map's range."""
    assert model.actuator is not None
    size = len(mode)
    around = mode + step * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
    curves = model.predict(model.table.named(around)).mean[:, model.actuator.paths.mask]
    here, forth, back = curves[0], curves[1 : size + 1], curves[size + 1 :]
    width = step * (np.isfinite(forth).astype(float) + np.isfinite(back))
    change = np.where(np.isfinite(forth), forth, here) - np.where(np.isfinite(back), back, here)
    jacobian: Floats = (change / np.maximum(width, step)).T
    return jacobian
