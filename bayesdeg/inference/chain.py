"""Draws of independent ensembles, what they may cost, and what they are worth."""

import math
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from bayesdeg.inference.refusals import Refusals

Floats = NDArray[np.float64]

LONGEST_LOOK = 8  # steps between looks, at most, in those of the first period


@dataclass(frozen=True)
class Effort:
    """What sampling may cost, and when it is enough.

    Parameters
    ----------
    effective : float
        Effective sample size wanted in every parameter.
    r_hat : float
        Largest rank-normalised split R̂ across ensembles that is accepted.
    chunk, longest : int
        Steps of the first period and to the first look at the chain, and steps at most, which are
        two or more.
    ensembles, kept : int
        Independent ensembles, and draws kept of each.
    times : float
        Autocorrelation times that every walker must have gone, at least. Without it as many
        walkers as effective draws are wanted would be enough where they stand.
    starts : int
        Dispersed starts from which separate modes are looked for before sampling.
    """

    effective: float
    r_hat: float
    chunk: int
    longest: int
    ensembles: int = 4
    kept: int = 500
    times: float = 5.0
    starts: int = 0

    def periods(self, *, settled: bool = False) -> tuple[tuple[int, ...], ...]:
        """Return the steps to each look at the chain, period by period.

        Moves are fitted anew before each period, to the draws of the one before, and draws of the
        last period alone are kept; so each is twice as long as the one before. The first is for
        fitting alone. The last goes on to the limit.

        Parameters
        ----------
        settled : bool
            Whether the moves of the first period served well: the second is then the last.

        Examples
        --------
        >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
        >>> effort.periods()
        ((50,), (50, 50), (100, 100), (200, 200, 200, 50))
        >>> effort.periods(settled=True)[1][:6]
        (25, 25, 25, 25, 25, 31)
        >>> Effort(effective=400.0, r_hat=1.01, chunk=10, longest=20).periods()
        ((10,), (10,))
        """
        first = min(self.chunk, max(1, self.longest // 2))
        if settled:
            return (first,), _growing(
                self.longest - first, max(1, first // 2), LONGEST_LOOK * first
            )
        lengths, left = [first], self.longest - first
        while left >= 2 * lengths[-1]:
            lengths.append(2 * lengths[-1])
            left -= lengths[-1]
        if len(lengths) == 1:
            lengths.append(0)
        lengths[-1] += left
        looks = [first] + [min(first * 2**k, LONGEST_LOOK * first) for k in range(len(lengths) - 1)]
        return tuple(_split(length, look) for length, look in zip(lengths, looks, strict=True))


def _split(length: int, part: int) -> tuple[int, ...]:
    rest = length % part
    return (part,) * (length // part) + ((rest,) if rest else ())


def _growing(length: int, least: int, most: int) -> tuple[int, ...]:
    """Split a length: a look whenever the chain is a quarter longer than at the last."""
    parts: list[int] = []
    while (done := sum(parts)) < length:
        parts.append(min(max(least, done // 4), most, length - done))
    return tuple(parts)


EFFORTS = {
    "quick": Effort(effective=150.0, r_hat=1.05, chunk=25, longest=1200),
    "standard": Effort(effective=400.0, r_hat=1.01, chunk=25, longest=6000, starts=4),
    "thorough": Effort(effective=2000.0, r_hat=1.005, chunk=50, longest=40000, kept=2000, starts=8),
}


@dataclass(frozen=True)
class Standing:
    """How far sampling is.

    Parameters
    ----------
    steps, kept : int
        Steps done, and those of the draws that would be kept now; none while moves are fitted.
    effective, r_hat : float
        Smallest bulk effective sample size and largest R̂ of the kept draws; nan of none.
    times : float
        Autocorrelation times that the walkers have gone; nan of none.
    resumed : int
        Steps that an earlier run had done.
    settled : bool
        Whether moves are fitted no more.
    """

    steps: int = 0
    kept: int = 0
    effective: float = math.nan
    r_hat: float = math.nan
    times: float = math.nan
    resumed: int = 0
    settled: bool = False

    def steps_wanted(self, effort: Effort) -> float:
        """Return how many kept steps would meet an effort's criteria; nan while none are kept.

        Effective draws grow with the steps, and R̂ − 1 falls with them.

        Examples
        --------
        >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
        >>> Standing(100, kept=50, effective=250.0, r_hat=1.02, times=5.0).steps_wanted(effort)
        100.0
        """
        lacking = (
            effort.effective / self.effective,
            (self.r_hat - 1.0) / (effort.r_hat - 1.0) if effort.r_hat > 1.0 else math.inf,
            effort.times / self.times,
        )
        # the rounding is that of R̂ − 1
        return round(self.kept * max(lacking), 6)

    def enough(self, effort: Effort) -> bool:
        """Return whether an effort's criteria are met."""
        return (
            self.effective >= effort.effective
            and self.r_hat <= effort.r_hat
            and self.times >= effort.times
        )


@dataclass(frozen=True)
class Chain:
    """Draws of several independent ensembles.

    Parameters
    ----------
    vectors : array, shape (n_ensembles, n_steps, n_walkers, n_parameters)
        On the unconstrained scale, after burn-in.
    log_prob : array, shape (n_ensembles, n_steps, n_walkers)
        Log posterior density, not normalised.
    acceptance : array, shape (n_ensembles,)
        Accepted share of proposals.
    refusals : Refusals
        How many proposals the emulator refused, burn-in included.
    """

    vectors: Floats
    log_prob: Floats
    acceptance: Floats
    refusals: Refusals = field(default_factory=Refusals)

    def r_hat(self) -> Floats:
        """Rank-normalised split R̂ of each parameter, ensembles as chains.

        The walkers of one ensemble move by one another, so they are no independent chains.
        """
        ensembles, steps, walkers, size = self.vectors.shape
        draws = self.vectors.reshape(ensembles, steps * walkers, size)
        return np.array([array_stats.rhat(draws[:, :, i]) for i in range(size)])

    def effective(self, method: str = "bulk") -> Floats:
        """Effective sample size of each parameter, autocorrelation taken along each walker."""
        ensembles, steps, walkers, size = self.vectors.shape
        lines = np.swapaxes(self.vectors, 1, 2).reshape(ensembles * walkers, steps, size)
        prob = 0.9 if method == "tail" else None
        return np.array(
            [array_stats.ess(lines[:, :, i], method=method, prob=prob) for i in range(size)]
        )

    def autocorrelation_time(self) -> Floats:
        """Return τ of each parameter [steps]: draws over effective draws of the bulk.

        It cannot be seen to be longer than the chain itself.
        """
        ensembles, steps, walkers, _ = self.vectors.shape
        time: Floats = ensembles * steps * walkers / self.effective()
        return time

    def judged(self, standing: Standing) -> Standing:
        """Return a standing with what the chain's draws are worth."""
        effective = float(np.min(self.effective()))
        ensembles, steps, walkers, _ = self.vectors.shape
        return replace(
            standing,
            kept=steps,
            effective=effective,
            r_hat=float(np.max(self.r_hat())),
            times=effective / (ensembles * walkers),
        )

    def thinned(self, kept: int) -> Self:
        """Return about ``kept`` evenly spaced draws of each ensemble, one walker column."""
        ensembles, steps, walkers, size = self.vectors.shape
        total = steps * walkers
        take = np.unique(np.linspace(0, total - 1, min(kept, total)).round().astype(np.int64))
        return replace(
            self,
            vectors=self.vectors.reshape(ensembles, total, 1, size)[:, take],
            log_prob=self.log_prob.reshape(ensembles, total, 1)[:, take],
        )
