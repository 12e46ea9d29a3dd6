"""How much there is to explain: a Gaussian-process discrepancy, calibrated by simulation.

The discrepancy is a smooth function of pressure and degradation rate in proportion to a smooth
envelope of the readings, the same for curvature and bend angle, or of the curvature alone. It is a
measuring stick only: it never enters the physics.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.gaussian_process.kernels import RBF

from bayesdeg.criticism.linear import Linear
from bayesdeg.inference.ensemble import Chain

Floats = NDArray[np.float64]

# shared by all degradation rates, drifting with them, and one for each of them [kPa], [%]
LENGTHS = ((60.0, 1e3), (60.0, 12.0), (150.0, 1e3), (150.0, 12.0), (150.0, 2.0))
ALIKE = (1.0, 0.0)  # the bend angle's discrepancy over that of the curvature
AMPLITUDES = np.geomspace(0.005, 1.0, 25)


@dataclass(frozen=True)
class Misfit:
    """What the base model leaves unexplained.

    Parameters
    ----------
    statistic : float
        Largest log-likelihood ratio of a discrepancy against none [nats].
    null : array, shape (n,)
        The same for data simulated from the fitted model.
    p_value : float
        Share of simulated data with at least this statistic, (1 + #)/(1 + n).
    discrepancy : array, shape (n_observations,)
        Posterior mean of the best discrepancy of the curvatures [1/m].
    lost : float
        Share of simulated data sets that left the range of the forward map.
    rms, noise : float
        Root mean square of the curvatures' residuals [1/m], and of what a discrepancy and the
        specimens' own deviations leave of them [1/m].
    """

    statistic: float
    null: Floats
    p_value: float
    discrepancy: Floats
    lost: float
    rms: float
    noise: float


def measure(
    linear: Linear, chain: Chain, generator: np.random.Generator, *, replicates: int
) -> Misfit:
    """Measure the misfit of a model and calibrate it by simulating from its posterior.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    chain : Chain
        Its posterior, from which replicates are drawn.
    generator : Generator
        For the replicates.
    replicates : int
        Number of simulated data sets.
    """
    model = linear.model
    assert model.actuator is not None
    simulated = linear.whiten(replicate(linear, chain, generator, replicates))
    kernels = _spectra(linear)
    statistic, best = _statistic(linear.observed[None], kernels)
    null, _ = _statistic(simulated, kernels)
    curvatures = linear.output == 0
    discrepancy = _posterior_mean(linear, kernels, int(best[0]))[curvatures]
    readings = model.actuator.curvature[model.actuator.mask]
    return Misfit(
        statistic=float(statistic[0]),
        null=null,
        p_value=float((1 + np.sum(null >= statistic[0])) / (1 + len(null))),
        discrepancy=discrepancy,
        lost=1.0 - len(null) / replicates,
        rms=float(np.sqrt(np.mean((readings - linear.prediction[curvatures]) ** 2))),
        noise=_noise(linear, readings - linear.mean[curvatures] - discrepancy),
    )


def statistic_of(linear: Linear) -> float:
    """Return the misfit statistic of a linearised model on its own data [nats]."""
    kernels = _spectra(linear)
    return float(_statistic(linear.observed[None], kernels)[0][0])


def replicate(linear: Linear, chain: Chain, generator: np.random.Generator, count: int) -> Floats:
    """Draw data sets that the model's posterior predicts, (count, n_specimens, n_points)."""
    model = linear.model
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    draws = flat[generator.integers(len(flat), size=count)]
    simulated = model.simulate(model.table.named(draws), generator)
    finite = np.all(np.isfinite(simulated) | ~linear.read, axis=(1, 2))
    return simulated[finite]


def explained(before: Misfit, after: Misfit) -> float:
    """Return the share of the misfit statistic, less what chance gives, that a cause removes.

    nan where there is no more misfit than chance gives.

    Examples
    --------
    >>> null = np.zeros(3)
    >>> full = Misfit(50.0, null, 0.01, null, 0.0, 1.0, 0.1)
    >>> explained(full, Misfit(5.0, null, 0.5, null, 0.0, 0.1, 0.1))
    0.9
    """
    floor = float(np.mean(before.null))
    ceiling = before.statistic - floor
    if ceiling <= 0.0:
        return float("nan")
    left = max(after.statistic - float(np.mean(after.null)), 0.0)
    return float(np.clip(1.0 - left / ceiling, 0.0, 1.0))


def _spectra(linear: Linear) -> list[tuple[Floats, Floats]]:
    alike = ALIKE if np.any(linear.output == 1) else ALIKE[:1]
    return [_spectrum(linear, *lengths, both) for lengths in LENGTHS for both in alike]


def _spectrum(linear: Linear, along: float, across: float, alike: float) -> tuple[Floats, Floats]:
    """Eigenvalues and vectors of the discrepancy's covariance on the whitened scale."""
    model = linear.model
    assert model.actuator is not None
    data, read, output = model.actuator, linear.read, linear.output
    level = np.broadcast_to(data.degradation, read.shape)[read]
    pressure = np.tile(data.pressure, read.shape[1] // data.pressure.shape[1])[read]
    points = np.column_stack([pressure / along, level / across])
    # relative to the readings, but not nothing where they are small
    largest = np.array([np.max(np.abs(linear.mean[output == k]), initial=0.0) for k in (0, 1)])
    envelope = np.abs(linear.mean) + 0.1 * largest[output]
    envelope[output == 1] *= alike
    kernel = RBF(1.0)(points) * np.outer(envelope, envelope)
    half = linear.whiten_columns(kernel)
    whitened = linear.whiten_columns(half.T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    keep = values > 1e-8 * values[-1]
    return values[keep], vectors[:, keep]


def _statistic(
    whitened: Floats, kernels: list[tuple[Floats, Floats]]
) -> tuple[Floats, NDArray[np.int64]]:
    """Largest log-likelihood ratio over kernels and amplitudes, and which it was."""
    ratios = []
    for values, vectors in kernels:
        squares = (whitened @ vectors) ** 2
        for amplitude in AMPLITUDES:
            signal = amplitude**2 * values
            ratios.append(
                0.5 * squares @ (signal / (1.0 + signal)) - 0.5 * np.sum(np.log1p(signal))
            )
    table = np.stack(ratios)
    return np.maximum(table.max(axis=0), 0.0), table.argmax(axis=0)


def _posterior_mean(linear: Linear, kernels: list[tuple[Floats, Floats]], best: int) -> Floats:
    values, vectors = kernels[best // len(AMPLITUDES)]
    signal = AMPLITUDES[best % len(AMPLITUDES)] ** 2 * values
    shrunk = vectors @ ((signal / (1.0 + signal)) * (linear.observed @ vectors))
    return np.asarray(linear.factor @ shrunk)


def _noise(linear: Linear, residual: Floats) -> float:
    """RMS of residuals after each specimen's own deviation of stiffness is fitted."""
    model = linear.model
    assert model.actuator is not None
    mask = model.actuator.mask
    predicted = model.predict(model.table.named(linear.mode[None]))
    slope = predicted.slope[0, :, : mask.shape[1]]
    table = np.zeros(mask.shape)
    table[mask] = residual
    weighted = np.where(mask, slope, 0.0)
    size = np.sum(weighted * table, axis=1) / np.maximum(np.sum(weighted**2, axis=1), 1e-300)
    left = (table - size[:, None] * weighted)[mask]
    return float(np.sqrt(np.mean(left**2)))
