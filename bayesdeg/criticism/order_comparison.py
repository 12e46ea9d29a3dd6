"""Orders of the polynomials of the degradation rate side by side: a table and a sentence."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CLEARLY = 2.0
"""Standard errors by which a held-out difference must pass zero to count."""
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
        Where that was too heavy and the model was calibrated anew without the film.
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
    """Orders side by side.

    Parameters
    ----------
    fits : tuple of OrderFit
        By rising order.
    used : int
        The order of the study's model.
    """

    fits: tuple[OrderFit, ...]
    used: int

    def difference(self, fit: OrderFit) -> tuple[float, float]:
        """Return the gain in elpd over the order used, and its standard error over films."""
        gap = fit.elpd - self._reference.elpd
        count = len(gap)
        error = np.sqrt(count) * np.std(gap, ddof=1) if count > 1 else np.nan
        return float(np.sum(gap)), float(error)

    def log_bayes_factor(self, fit: OrderFit) -> tuple[float, float]:
        """Return the log Bayes factor against the order used, and its Monte Carlo error."""
        reference = self._reference
        if fit is reference:
            return 0.0, 0.0
        gap = fit.log_evidence - reference.log_evidence
        return gap, float(np.hypot(fit.error, reference.error))

    def table(self) -> pd.DataFrame:
        """Return one row an order: the columns of ``orders.csv``."""
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
    def sentence(self) -> str:
        """Which order the films support, and whether the one used is adequate."""
        others = [fit for fit in self.fits if fit is not self._reference]
        figures = "; ".join(self._figures(fit) for fit in others)
        return (
            f"The films compare polynomials of the degradation rate of order {self.used}, which "
            f"is used, with others: {figures}. {self._conclusion(others)}"
        )

    def _conclusion(self, others: list[OrderFit]) -> str:
        if not np.isfinite(self._reference.log_evidence):
            return f"Order {self.used} itself could not be judged."
        better = [fit for fit in others if self._is_better(fit)]
        if better:
            best = max(better, key=lambda fit: self.difference(fit)[0])
            return (
                f"Order {self.used} is not adequate: order {best.order} predicts held-out films "
                f"better and is more probable; set order = {best.order} under [material]."
            )
        simpler = [fit for fit in others if fit.order < self.used and self._does_as_well(fit)]
        if simpler:
            return f"Order {self.used} is adequate; order {simpler[0].order} would do as well."
        return f"Order {self.used} is adequate."

    def _is_better(self, fit: OrderFit) -> bool:
        gain, error = self.difference(fit)
        return gain > CLEARLY * error and self.log_bayes_factor(fit)[0] > STRONG

    def _does_as_well(self, fit: OrderFit) -> bool:
        gain, error = self.difference(fit)
        return gain > -CLEARLY * error and self.log_bayes_factor(fit)[0] > 0.0

    def _figures(self, fit: OrderFit) -> str:
        (gain, gain_error), (factor, error) = self.difference(fit), self.log_bayes_factor(fit)
        evidence_words = (
            f"{factor:+.1f} ± {error:.2f} in log evidence"
            if np.isfinite(factor)
            else "its evidence could not be had"
        )
        return (
            f"order {fit.order} has {gain:+.1f} ± {gain_error:.1f} in the log predictive density "
            f"of held-out films, {evidence_words}"
        )

    @property
    def _reference(self) -> OrderFit:
        return next(fit for fit in self.fits if fit.order == self.used)
