"""Test of ruptures against the model, calibrated by simulation."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.findings import RuptureMisfit
from bayesdeg.inference.model import JointModel, replicate
from bayesdeg.observations.rupture import Rupture

Floats = NDArray[np.float64]

FEWEST = 19
"""Fewest simulated data sets with which a p-value can reach 0.05, for judging ruptures."""


def rupture_misfit(
    model: JointModel, vectors: Floats, generator: np.random.Generator
) -> RuptureMisfit | None:
    """Compare ruptures with those of data simulated from posterior draws.

    The discrepancy is −2 Σ ln P of the specimens' survivals and ruptures, data and simulated data
    each at the parameters of the same draw.

    Draws are (k, n_parameters). None without actuators or a limit of elongation.

    References
    ----------
    Gelman, Meng, Stern (1996), Statistica Sinica 6:733, for discrepancies that depend on
    parameters.
    """
    happened = _events(model)
    if happened is None:
        return None
    observed = _deviances(model, vectors)
    simulated, bursts = [], []
    for vector in vectors:
        again = replicate(model, model.table.named(vector[None]), generator)
        simulated.append(_deviances(again, vector[None])[0])
        bursts.append(_events(again) or 0)
    known = np.isfinite(observed) & np.isfinite(simulated)
    count = int(np.sum(known))
    excess = np.array(simulated)[known] - observed[known]
    return RuptureMisfit(
        burst=happened,
        expected=float(np.mean(bursts)),
        deviance=float(np.mean(observed[known])) if count else float("nan"),
        p_value=float(chance_of(0.0, excess, fewest=FEWEST)),
        known=count,
        drawn=len(vectors),
    )


def _deviances(model: JointModel, vectors: Floats) -> Floats:
    """Return −2 ln of the ruptures' probability, (k,), ignoring nan readings."""
    with np.errstate(all="ignore"):
        state = model.state(model.table.named(vectors))
        densities = [o.log_likelihood(state) for o in model.of_kind(Rupture)]
        return np.asarray(-2.0 * np.sum(np.concatenate(densities, axis=1), axis=1))


def _events(model: JointModel) -> int | None:
    """Return the number of specimens with an event; None if none is recorded."""
    return next((one.events for one in model.of_kind(Rupture)), None)
