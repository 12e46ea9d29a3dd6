"""Whether actuators burst where the model expects: calibrated by simulating them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.model import Model
from bayesdeg.inference.replicate import replicate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RuptureMisfit:
    """How surprising the ruptures are.

    Parameters
    ----------
    burst, expected : float
        Actuators that burst, and how many do in simulated data on average.
    deviance : float
        −2 Σ ln of the probability of what each did, averaged over the posterior.
    p_value : float
        Share of simulated data sets that are at least as improbable.
    """

    burst: int
    expected: float
    deviance: float
    p_value: float


def rupture_misfit(
    model: Model, vectors: Floats, generator: np.random.Generator
) -> RuptureMisfit | None:
    """Compare ruptures with those of data simulated from posterior draws.

    The discrepancy is −2 Σ ln P of the specimens' survivals and ruptures, data and simulated data
    each at the parameters of the same draw.

    Parameters
    ----------
    model : Model
        With actuators and a limit of elongation; else there is nothing to compare: None.
    vectors : array, shape (k, n_parameters)
        Posterior draws.
    generator : Generator
        For the simulated data.

    References
    ----------
    Gelman, Meng, Stern (1996), Statistica Sinica 6:733, for discrepancies that depend on
    parameters.
    """
    if model.actuator is None or not model.has_elongation:
        return None
    observed, simulated, bursts = [], [], []
    for vector in vectors:
        values = model.table.named(vector[None])
        again = replicate(model, values, generator)
        assert again.actuator is not None
        observed.append(_deviance(model, vector))
        simulated.append(_deviance(again, vector))
        bursts.append(int(again.actuator.ruptured.any(axis=1).sum()))
    worse = int(np.sum(np.array(simulated) >= np.array(observed)))
    return RuptureMisfit(
        int(model.actuator.ruptured.any(axis=1).sum()),
        float(np.mean(bursts)),
        float(np.mean(observed)),
        (1 + worse) / (1 + len(vectors)),
    )


def _deviance(model: Model, vector: Floats) -> float:
    """Return −2 ln of the ruptures' probability; readings that are nan play no part."""
    values = model.table.named(vector[None])
    with np.errstate(all="ignore"):
        return float(-2.0 * np.sum(model.log_likelihood(values)["rupture"][0]))
