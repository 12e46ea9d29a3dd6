r"""The smallest misfit that a study can detect.

For smooth relative discrepancies f common to all specimens, drawn from the kernels of
`checks.discrepancy`, the amplitude a is found at which the misfit test is significant in
`OFTEN` of data sets y = mean + a f + e simulated from the fitted model. What counts is not a f,
most of which the parameters may take up, but what is left of it once they are fitted again,

.. math:: r = a \, V C^{-1} f, \qquad C = V + X \Lambda^{-1} X^T,

and its largest value over the largest reading of its kind. The misfit stated is that below which
nine in ten of these lie. Scatter of specimens is part of V: where a single specimen can take any
shape as its own, r is large.

A cause of size x, in prior sizes, with whitened effect x S has on average a log Bayes factor of

.. math:: \tfrac12 \frac{x^2 |S|^4}{1 + |S|^2} - \tfrac12 \ln (1 + |S|^2),

and its square root varies with standard deviation :math:`1/\sqrt 2`; the size stated passes the
naming threshold as often.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.checks.discrepancy import (
    Discrepancy,
    Misfit,
    discrepancies,
    discrepancy_roots,
    largest_of,
)
from bayesdeg.criticism.findings import Detectable, DetectableCause
from bayesdeg.criticism.fit.linear import Linear, neutral_sizes, prior_size, sensitivities
from bayesdeg.criticism.outcome import MISFIT_LEVEL

Floats = NDArray[np.float64]

OFTEN = 0.9  # share of data sets in which a misfit is to be significant
COVERED = 0.9  # share of smooth discrepancies for which that is promised
DRAWS, NOISES = 20, 40  # discrepancies of each kernel, and data sets for each of them
AMPLITUDES = np.geomspace(1e-3, 3.0, 25)
ALLOWED = 1e-3  # tail of a prior beyond which a size is not plausible
CAUSES = 3  # nearest causes whose sizes are stated


def detectable_misfit(linear: Linear, misfit: Misfit, simulated: Floats) -> Detectable | None:
    """Return the smallest detectable smooth misfit; see `detectable_causes` for its causes.

    Parameters
    ----------
    linear : Linear
        The fitted model.
    misfit : Misfit
        Its misfit, with the statistic's distribution by chance.
    simulated : array, shape (k, n_readings)
        Complete data sets simulated from the model.

    Returns
    -------
    Detectable
        None where p-values are not known.
    """
    if not misfit.is_calibrated or not len(simulated):
        return None
    generator, kernels = np.random.default_rng(0), discrepancies(linear)
    noise = linear.whiten(simulated[:NOISES])
    noises = [noise @ kernel.vectors for kernel in kernels]
    bound = float(np.quantile(misfit.null, 1.0 - MISFIT_LEVEL))
    places = linear.subject.places
    family = str(places.family[-1])  # the last along the chain of models: what the study is about
    rows = places.family == family
    kind = str(places.kind[rows][0])
    first = rows & (places.kind == kind)
    largest = float(np.max(np.abs(linear.subject.observed[first])))
    sizes: list[float] = []
    for one, label, root in discrepancy_roots(places, linear.mean):
        if one != family or "for each" in label:
            continue
        shapes = root @ generator.standard_normal((root.shape[1], DRAWS))
        moved = linear.whiten_columns(shapes).T
        left = np.max(np.abs(linear.unexplained(moved)[:, first]), axis=1) / largest
        for shape, size in zip(moved, left, strict=True):
            shifts = [shape @ kernel.vectors for kernel in kernels]
            sizes.append(size * _amplitude(shifts, noises, kernels, bound))
    own = linear.subject.deviations(linear.mode).slope[first]
    specimens = int(np.sum(np.any(own != 0.0, axis=0)))
    size = 100.0 * float(np.quantile(sizes, COVERED))
    return Detectable(kind=kind, misfit_pct=size, specimens=specimens)


def _amplitude(
    shifts: Sequence[Floats],
    noises: Sequence[Floats],
    kernels: Sequence[Discrepancy],
    bound: float,
) -> float:
    """Return the amplitude of a shift at which the test is significant as often."""
    low, high = 0, len(AMPLITUDES) - 1
    while low < high:
        middle = (low + high) // 2
        size = AMPLITUDES[middle]
        moved = [noise + size * shift for noise, shift in zip(noises, shifts, strict=True)]
        seen = largest_of(moved, kernels)[0] > bound
        low, high = (low, middle) if np.mean(seen) >= OFTEN else (middle + 1, high)
    return float(AMPLITUDES[low])


def detectable_causes(
    linear: Linear, causes: Sequence[Cause], threshold: float
) -> tuple[DetectableCause, ...]:
    """Return the sizes of causes that would have passed the naming threshold [nats].

    At most `CAUSES`, in order. A cause that changes no reading's mean, or would take a size that
    its prior all but excludes, has none. Of several parameters the first one counts.
    """
    found = []
    for cause in causes:
        parameter, column = cause.parameters[0], sensitivities(linear, cause)[:, 0]
        square = float(column @ column)
        if square <= 0.0 or not np.isfinite(square):
            continue
        root = np.sqrt(threshold + 0.5 * np.log1p(square)) + ndtri(OFTEN) / np.sqrt(2.0)
        units = root * np.sqrt(2.0 * (1.0 + square)) / square
        law, neutral = parameter.law, float(neutral_sizes(cause)[0])
        ends = law.to_unconstrained(law.quantile(np.array([ALLOWED, 1.0 - ALLOWED]))) - neutral
        away = units * prior_size(parameter) * (1.0 if ends[1] > 0.0 else -1.0)
        if not ends[0] <= away <= ends[1]:
            continue
        size, name = float(law.from_unconstrained(neutral + away)), parameter.name
        found.append(
            DetectableCause(cause=cause.name, parameter=name, size=size, unit=parameter.unit)
        )
        if len(found) == CAUSES:
            break
    return tuple(found)
