"""What is known of a fitted set of causes: its misfit, and which others deserve a full fit."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.screening import Screened
from bayesdeg.criticism.trials import Trial

Floats = NDArray[np.float64]

CLOSE = 10.0  # screened log Bayes factor behind the best up to which a full fit is worth it
NEAR_SHARE = 0.75  # or share of the best: screening is rough where effects are strong


@dataclass(frozen=True)
class Step:
    """What is known with a set of causes active.

    Parameters
    ----------
    trial : Trial
        The fitted model.
    misfit : Misfit
        What it leaves unexplained.
    simulated : array, shape (k, n_readings)
        Data sets simulated from its posterior, those refused left out.
    screened : mapping
        Every other cause at its most probable size, by name.
    threshold : float
        Log Bayes factor that naming one more takes.
    unbent : mapping
        The causes screened where no parameter has given way to the misfit, see `Trial.unbent`;
        empty if none has.
    chance : array, shape (k,)
        Log Bayes factor of the best of all other causes in each of the simulated data sets, which
        hold no further effect: what `threshold` comes from [nats]. Empty if there are none.
    """

    trial: Trial
    misfit: Misfit
    simulated: Floats
    screened: dict[str, Screened]
    threshold: float
    unbent: dict[str, Screened] = field(default_factory=dict)
    chance: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def false_name_rate(self) -> float | None:
        """Share of data without a further effect in which the best cause passes the threshold.

        At least one in as many as were simulated; None if none were. It is below 5 % where odds of
        20 ask for more than chance gives.
        """
        if not len(self.chance):
            return None
        return max(float(np.mean(self.chance > self.threshold)), 1.0 / (1 + len(self.chance)))

    def chance_of(self, log_bayes_factor: float) -> float | None:
        """Return how often the best cause gains as much where nothing acts, (1 + #)/(1 + k).

        Parameters
        ----------
        log_bayes_factor : float
            Of a set with one more cause against this one [nats].

        Returns
        -------
        float or None
            None if no data were simulated.
        """
        if not len(self.chance):
            return None
        larger = int(np.sum(self.chance >= log_bayes_factor))
        return (1 + larger) / (1 + len(self.chance))

    def guess(self, name: str) -> tuple[Cause, Floats]:
        """Return a cause with the size at which a full fit begins."""
        plain, straight = self.screened[name], self.unbent.get(name)
        if straight is not None and straight.log_bayes_factor > plain.log_bayes_factor:
            return straight.cause, straight.size
        return plain.cause, plain.size


def near(screened: dict[str, Screened], least: float) -> list[str]:
    """Return the causes that screening finds near the best, the best first."""
    factors = {name: one.log_bayes_factor for name, one in screened.items()}
    best = max(factors.values(), default=-np.inf)
    least = max(min(best - CLOSE, NEAR_SHARE * best), least)
    return sorted((n for n in factors if factors[n] >= least), key=lambda n: -factors[n])
