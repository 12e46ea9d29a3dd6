"""Comparison of polynomial orders in the degradation rate, on films.

Yeoh's constants are polynomials of D_R, of order 2 unless a study says otherwise, as in
doi:10.3389/frobt.2021.760485. The films alone show whether that is enough or too much:
stress–stretch curves and published Young's moduli are calibrated under each order and compared by
their marginal likelihood, and by how well a film is predicted from all others.
"""

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayesdeg.criticism.holdout.held_out import (
    largest_k,
    recalibrated,
    smoothed,
    specimen_density,
    standard_error,
)
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import FEWEST_EFFECTIVE, Evidence, approximate
from bayesdeg.inference.model import JointModel, blocks_of, near_films, without
from bayesdeg.material.degradation import Nodes, nodes_for
from bayesdeg.observations.means import Means
from bayesdeg.observations.specimens import FilmsAndActuators, material_parameters
from bayesdeg.observations.tensile import Tensile
from bayesdeg.priors import with_priors

Floats = NDArray[np.float64]

CLEARLY = 2.0
"""Standard errors by which a held-out difference must exceed zero to count."""
STRONG = 3.0
"""Log Bayes factor, 20 to 1, that counts; Kass and Raftery (1995), doi:10.2307/2291091."""


@dataclass(frozen=True)
class OrderFit:
    """The films calibrated under one order.

    Parameters
    ----------
    order : int
        Of the polynomials.
    size : int
        Number of parameters.
    log_evidence, error : float
        Log marginal likelihood and its Monte Carlo standard error; nan if the importance sample
        has too few effective draws.
    effective : float
        Effective number of draws.
    elpd, pareto_k : array, shape (n_films,)
        Log predictive density of each film given the others, and the shape of the importance
        weights' tail.
    refitted : array of bool, shape (n_films,)
        Where that was too heavy and the model was recalibrated without the film.
    """

    order: int
    size: int
    log_evidence: float
    error: float
    effective: float
    elpd: Floats
    pareto_k: Floats
    refitted: NDArray[np.bool_]


@dataclass(frozen=True)
class OrderComparison:
    """Comparison of orders, by rising order; `used` is that of the study's model."""

    fits: tuple[OrderFit, ...]
    used: int

    def difference(self, fit: OrderFit) -> tuple[float, float]:
        """Return the gain in elpd over the order used, and its standard error over films."""
        gap = fit.elpd - self._reference.elpd
        return float(np.sum(gap)), standard_error(gap)

    def log_bayes_factor(self, fit: OrderFit) -> tuple[float, float]:
        """Return the log Bayes factor against the order used, and its Monte Carlo error."""
        reference = self._reference
        if fit is reference:
            return 0.0, 0.0
        gap = fit.log_evidence - reference.log_evidence
        return gap, float(np.hypot(fit.error, reference.error))

    def table(self) -> pd.DataFrame:
        """Return one row per order: the columns of ``orders.csv``."""
        rows = []
        for fit in self.fits:
            gain, gain_error = self.difference(fit)
            factor, factor_error = self.log_bayes_factor(fit)
            rows.append(
                {
                    "order": fit.order,
                    "used": int(fit.order == self.used),
                    "parameters": fit.size,
                    "log_evidence": fit.log_evidence,
                    "log_evidence_error": fit.error,
                    "log_bayes_factor": factor,
                    "log_bayes_factor_error": factor_error,
                    "elpd": float(np.sum(fit.elpd)),
                    "elpd_diff": gain,
                    "elpd_diff_se": gain_error,
                    "films": len(fit.elpd),
                    "pareto_k_max": float(np.max(fit.pareto_k)),
                    "refitted": int(np.sum(fit.refitted)),
                    "effective": fit.effective,
                }
            )
        return pd.DataFrame(rows)

    @property
    def others(self) -> tuple[OrderFit, ...]:
        """All orders but the one used."""
        return tuple(fit for fit in self.fits if fit is not self._reference)

    @property
    def is_judged(self) -> bool:
        """Whether the evidence of the order used is known."""
        return bool(np.isfinite(self._reference.log_evidence))

    @property
    def better(self) -> int | None:
        """The order that predicts held-out films better and is more probable; None if none is."""
        gains = {fit.order: self.difference(fit) for fit in self.others}
        factors = {fit.order: self.log_bayes_factor(fit)[0] for fit in self.others}
        clear = (k for k, (gain, error) in gains.items() if gain > CLEARLY * error)
        found = (k for k in clear if factors[k] > STRONG)
        return max(found, key=lambda order: gains[order][0], default=None)

    @property
    def simpler(self) -> int | None:
        """The lowest order below the one used that is as good; None if none is."""
        for fit in self.others:
            gain, error = self.difference(fit)
            as_good = gain > -CLEARLY * error and self.log_bayes_factor(fit)[0] > 0.0
            if fit.order < self.used and as_good:
                return fit.order
        return None

    @property
    def _reference(self) -> OrderFit:
        return next(fit for fit in self.fits if fit.order == self.used)


ORDERS = (1, 2, 3)
DRAWS = 1000
"""Required effective draws of the posterior of all films, which are reweighted to leave one out."""


def compare_orders(
    model: JointModel,
    *,
    seed: np.random.SeedSequence,
    orders: tuple[int, ...] = ORDERS,
    executor: Executor | None = None,
) -> OrderComparison | None:
    """Calibrate the films of a model under several orders.

    Orders are compared with that of the model, whose actuators are left aside. None without films,
    or where the films have too few degradation rates to tell two orders apart.
    """
    if not model.of_kind(Tensile):
        return None
    used = films_alone(model, model.world.nodes)
    levels = [float(level) for one in used.observations for level in one.material_levels]
    by_order = {len(nodes) - 1: nodes for nodes in (nodes_for(levels, k) for k in orders)}
    by_order[len(model.world.nodes) - 1] = model.world.nodes
    if len(by_order) < 2:
        return None
    films = [films_alone(model, by_order[order]) for order in sorted(by_order)]
    apply = map if executor is None else executor.map
    fits = apply(fit_order, films, seed.spawn(len(films)))
    return OrderComparison(tuple(fits), len(model.world.nodes) - 1)


def films_alone(model: JointModel, nodes: Nodes) -> JointModel:
    """Return the model of only films and Young's moduli, with constants at these nodes.

    Parameters that both have keep the priors of the study.
    """
    laws = {p.name: p.law for p in model.base}
    own = (p for p in model.base if p.name.startswith(("stiffness_scatter", "tensile_")))
    moduli = tuple(s for s in model.data_of(Means).statistics if s.quantity == "young_modulus")
    data = (*model.of_kind(Tensile), *((Means(moduli),) if moduli else ()))
    law = model.world.law
    parameters = with_priors(material_parameters(nodes, law=law), laws)
    return JointModel((*parameters, *own), data, FilmsAndActuators(nodes, law=law))


def fit_order(films: JointModel, seed: np.random.SeedSequence) -> OrderFit:
    """Calibrate the films and predict each from all others."""
    first, refits = seed.spawn(2)
    generator = np.random.default_rng(first)
    laplace = approximate(films, generator, start=near_films(films, generator))
    posterior = about_mode(films, laplace, generator, enough=DRAWS)
    usable = posterior.effective >= FEWEST_EFFECTIVE
    if usable:
        elpd, pareto_k, refitted = leave_films_out(films, posterior, seed=refits)
    else:
        count = len(blocks_of(films))
        elpd, pareto_k = np.full((2, count), np.nan)
        refitted = np.zeros(count, dtype=bool)
    return OrderFit(
        order=len(films.world.nodes) - 1,
        size=len(films.table),
        log_evidence=posterior.log_evidence if usable else float("nan"),
        error=posterior.error if usable else float("nan"),
        effective=posterior.effective,
        elpd=elpd,
        pareto_k=pareto_k,
        refitted=refitted,
    )


def leave_films_out(
    films: JointModel, posterior: Evidence, *, seed: np.random.SeedSequence
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    r"""Predict each film from all others, by smoothed importance sampling.

    If the shape of the weights' tail is too large, the films are calibrated again without film i,
    and :math:`\ln p(y_i \mid y_{-i}) = \ln p(y) - \ln p(y_{-i})`: averaged over the posterior
    without it, p(y_i | θ) of a film far from the others would rest on few draws.

    Returns elpd, pareto_k and refitted of `OrderFit`; the seed has a child for each film.

    References
    ----------
    Vehtari, Gelman and Gabry (2017), doi:10.1007/s11222-016-9696-4.
    """
    first, *children = seed.spawn(1 + len(blocks_of(films)))
    draws = posterior.resample(np.random.default_rng(first), DRAWS)
    density = specimen_density(films, films.table.named(draws))[2]
    smooth = smoothed(density[None], min(posterior.effective / DRAWS, 1.0))
    elpd, refitted = smooth.elpd.copy(), ~(smooth.pareto_k <= largest_k(DRAWS))
    for row in np.flatnonzero(refitted):
        training = without(films, [tuple(blocks_of(films))[row]])
        generator = np.random.default_rng(children[row])
        # a separate start: draws of the posterior with the film may miss that without it
        start = near_films(training, generator)
        rest = recalibrated(training, generator, children[row], start=start, enough=DRAWS)
        if np.isfinite(rest.log_evidence):
            elpd[row] = posterior.log_evidence - rest.log_evidence
        else:
            density = specimen_density(films, films.table.named(rest.draws))[2][:, row]
            elpd[row] = float(logsumexp(density)) - float(np.log(len(density)))
    return elpd, smooth.pareto_k, refitted
