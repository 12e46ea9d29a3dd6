"""What a user would have decided before and after: pressure for a curvature, risk of rupture."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.residuals import levels
from bayesdeg.inference.curves import ActuatorCurves
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.prediction.control import INTERVAL, largest_allowed, needed_by
from bayesdeg.prediction.predictive import Specimens, draw_specimens, respond

Floats = NDArray[np.float64]

RISK = 0.05
SHARE = 0.5  # of the largest curvature measured at a level: what is wanted there
DRAWS = 300


def decisions(fits: Mapping[str, Fit], generator: np.random.Generator) -> pd.DataFrame:
    """Return the pressure for half of the largest curvature measured at each level, by model.

    Parameters
    ----------
    fits : mapping
        Calibrations by the models' names, with actuators.
    generator : Generator
        Draws the specimens.

    Returns
    -------
    DataFrame
        The columns of ``decisions.csv``: wanted curvature, the pressure that a new specimen needs
        with its 90 % interval, and the probability of rupture there.
    """
    data = next(iter(fits.values())).model.actuator
    assert data is not None
    rows = []
    for name, fit in fits.items():
        specimens = draw_specimens(fit.model, fit.chain, generator, draws=DRAWS)
        first = fit.model.largest_pressure
        for level, wanted in _wanted(data):
            allowed = largest_allowed(specimens, level, RISK, first=first)
            each = needed_by(specimens, level, wanted, first=first)
            needed = np.quantile(each, INTERVAL, method="inverted_cdf")
            rows.append(
                {
                    "model": name,
                    "degradation_pct": level,
                    "wanted_per_m": wanted,
                    "needed_q05_kPa": needed[0],
                    "needed_q50_kPa": needed[1],
                    "needed_q95_kPa": needed[2],
                    "allowed_kPa": allowed.pressure,
                    "probability": _probability(specimens, level, float(needed[1])),
                }
            )
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


def _probability(specimens: Specimens, degradation: float, pressure: float) -> float:
    """Return the probability of rupture; nan where there is no pressure, or no limit is known."""
    if not (np.isfinite(pressure) and specimens.model.has_elongation):
        return float("nan")
    return float(respond(specimens, degradation, np.array([pressure])).burst.mean())


def _wanted(data: ActuatorCurves) -> list[tuple[float, float]]:
    """Return each level of degradation [%] and half of its largest curvature [1/m].

    Levels at which nothing bent are left out.
    """
    centres, member = levels(data.degradation[:, 0])
    largest = np.where(data.mask, data.curvature, 0.0).max(axis=1)
    found = [
        (float(round(centre, 2)), float(f"{SHARE * largest[member == k].max():.3g}"))
        for k, centre in enumerate(centres)
    ]
    return [(level, wanted) for level, wanted in found if wanted > 0.0]
