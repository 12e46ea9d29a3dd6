"""Dependence of the answers on the assumed reading error.

The paper states no error of its curvature readings. Evidence for each explanation relative to an
error of D_R alone is computed for several priors of that error, up to the default of the package.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from nagai_2021.agreement import MODELS, Fit, fit
from nagai_2021.aimed import evidence
from nagai_2021.causes import able, cannot_bend
from nagai_2021.explored import Setting, explore
from nagai_2021.imagined import Model
from nagai_2021.published import Curves

Json = dict[str, Any]

ASSUMED = (Model().noise, Model().floor)
OF_THE_PACKAGE = (0.05, 0.3)
"""Scales of the package's own half-normal priors of the reading error [–], [1/m]."""
NOISES = ((0.01, 0.05), ASSUMED, (0.03, 0.2), OF_THE_PACKAGE)
"""Scales of the half-normal priors of the reading error: share of a reading, and floor [1/m]."""
STATED = ("degraded_skin", "humidity_drift")
"""The causes of the catalogue that the paper names besides an error of D_R."""
ALONE = "D_R error"


def dependence(
    setting: Setting,
    curves: Curves,
    generator: np.random.Generator,
    *,
    compare: Callable[[dict[str, Fit]], dict[str, dict[str, float]]],
    inner: int,
    assumed: Json,
) -> list[Json]:
    """Return what is concluded for each prior of the reading error, the smallest first.

    Parameters
    ----------
    setting : Setting
        On which causes are compared.
    curves : Curves
        On which errors of D_R and of stiffness are.
    compare : callable
        Returns Bayes factors over an error of D_R alone, and probabilities, by model.
    inner : int
        Imagined experiments for each draw.
    assumed : dict
        ``models`` and ``causes`` for `ASSUMED`, which (a) and (c) have computed.
    """
    found: list[Json] = []
    for noise, floor in NOISES:
        scales: Json = {"noise": noise, "floor_per_m": floor}
        if (noise, floor) == ASSUMED:
            found.append(scales | assumed)
            continue
        models = {name: with_noise(model, noise, floor) for name, model in MODELS.items()}
        fits = {name: fit(curves, m, generator, inner=inner) for name, m in models.items()}
        causes = of_causes(setting, models[ALONE], generator)
        found.append(scales | {"models": compare(fits), "causes": causes})
    return found


def with_noise(model: Model, noise: float, floor: float) -> Model:
    """Return a model with another prior of the reading error."""
    return replace(model, noise=noise, floor=floor)


def of_causes(setting: Setting, beside: Model, generator: np.random.Generator) -> Json:
    """Return the Bayes factor of each cause beside an error of D_R over that error alone."""
    acting, _ = able(cannot_bend)
    reference = evidence(explore(setting, beside, generator).joint())
    factors = {
        name: evidence(explore(setting, beside, generator, cause).joint()).over(reference)
        for name, cause in acting.items()
    }
    return {n: {"bayes_factor": f, "bayes_factor_error": e} for n, (f, e) in factors.items()}


def factors_of(judged: Json) -> Json:
    """Return the Bayes factors alone of what was judged, by cause."""
    names = ("bayes_factor", "bayes_factor_error")
    return {cause: {name: one[name] for name in names} for cause, one in judged.items()}


def of_model(found: Json, name: str) -> Json:
    """Return the Bayes factor of a model over an error of D_R alone, with its Monte Carlo error."""
    one, alone = found["models"][name], found["models"][ALONE]
    error = np.hypot(one["log_evidence_error"], alone["log_evidence_error"])
    return {
        "bayes_factor": one["bayes_factor"],
        "bayes_factor_error": float(one["bayes_factor"] * error),
    }


def largest(found: Json) -> str:
    """Return the cause with the largest Bayes factor."""
    causes = found["causes"]
    return str(max(causes, key=lambda name: float(causes[name]["bayes_factor"])))


def at(found: Iterable[Json], scales: tuple[float, float]) -> Json:
    """Return what was concluded for one prior of the reading error."""
    return next(one for one in found if (one["noise"], one["floor_per_m"]) == scales)
