"""Scores of held-out specimens, per level and over all.

The transform of a reading is the share of its predictive draws below it, uniform for a correct
prediction (Gelfand, Dey & Chang 1992; Gabry et al. 2019, doi:10.1111/rssa.12378). Readings of one
specimen are correlated, so their transforms are not independent and tests for independent values
reject far too often. Here the band and the p-value come from the predictive draws themselves: each
in turn is taken as the data, with the correlation of the model.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.residuals import r_squared
from bayesdeg.criticism.holdout.held_out import HeldOut, group_levels, standard_error
from bayesdeg.data.levels import levels
from bayesdeg.inference.density import log_ratio
from bayesdeg.inference.model import JointModel

Floats = NDArray[np.float64]

UNITS = {"curvature": "_per_m", "stress": "_MPa"}
"""Units of scored kinds of readings, as suffixes of columns; other kinds state their own."""


def gain_table(subject: JointModel, results: dict[str, HeldOut]) -> pd.DataFrame:
    """Return the scores of each model per level and over all, on held-out specimens.

    Parameters
    ----------
    subject : JointModel
        With the data.
    results : mapping
        By name of the model; the first is the one that others are compared with.

    Returns
    -------
    DataFrame
        The columns of ``gain.csv``; of films alone errors are in ``rmse_MPa`` and ``crps_MPa``, of
        other readings in ``rmse`` and ``crps``, in their unit, and the columns of curvatures are
        empty. Standard errors are over specimens.
    """
    centres, member = levels(group_levels(subject))
    rows = []
    for name, held_out in results.items():
        base = next(iter(results.values()))
        for k, centre in enumerate(centres):
            rows.append(_scores(name, f"{centre:.4g}", subject, held_out, base, member == k))
        rows.append(_scores(name, "all", subject, held_out, base, member >= 0))
    return pd.DataFrame(rows)


def mode_table(subject: JointModel, results: dict[str, HeldOut]) -> pd.DataFrame:
    """Return the scores of each model by mode of tension, each predicted from the others.

    The columns of ``gain_modes.csv``. A mode is one group, so there is no standard error.
    """
    base = next(iter(results.values()))
    rows = [
        {
            "mode": mode,
            **_scores(name, "", subject, held_out, base, np.array(subject.groups) == mode),
        }
        for name, held_out in results.items()
        for mode in subject.groups
    ]
    no_use = ["degradation_pct", "elpd_se", "elpd_diff_se", "rmse_per_m", "crps_per_m"]
    return pd.DataFrame(rows).drop(columns=no_use)


def crps(draws: Floats, observed: Floats) -> Floats:
    """Return the continuous ranked probability score of draws (n, ...) for observations (...).

    E|X − y| − E|X − X'|/2, the second term from the sorted draws.

    Source: Gneiting and Raftery (2007), doi:10.1198/016214506000001437.

    Examples
    --------
    >>> float(crps(np.array([0.0, 2.0]), np.array(1.0)))
    0.5
    """
    count = len(draws)
    ordered = np.sort(draws, axis=0)
    weight = (2.0 * np.arange(1, count + 1) - count - 1.0) / count**2
    spread = np.tensordot(weight, ordered, axes=(0, 0))
    score: Floats = np.mean(np.abs(draws - observed), axis=0) - spread
    return score


def _scores(
    name: str,
    label: str,
    subject: JointModel,
    held_out: HeldOut,
    base: HeldOut,
    chosen: NDArray[np.bool_],
) -> dict[str, object]:
    gap = log_ratio(held_out.log_density, base.log_density)[chosen]
    names = [g for g, is_chosen in zip(subject.groups, chosen, strict=True) if is_chosen]
    rows = np.isin(subject.group, names)
    kind = subject.places.kind[rows][0]
    rows = rows & (subject.places.kind == kind)
    observed, draws, mean = subject.observed[rows], held_out.draws[:, rows], held_out.mean[rows]
    ending = UNITS.get(str(kind), "")

    def coverage(share: float) -> float:
        low, high = np.nanquantile(draws, [0.5 - share / 2, 0.5 + share / 2], axis=0)
        return float(np.mean((observed >= low) & (observed <= high)))

    # of the first kind of reading that is held out; the columns of curvature are always there
    return {
        "model": name,
        "degradation_pct": label,
        "elpd": float(np.sum(held_out.log_density[chosen])),
        "elpd_se": standard_error(held_out.log_density[chosen]),
        "elpd_diff": float(np.sum(gap)),
        "elpd_diff_se": standard_error(gap),
        "rmse_per_m": np.nan,
        "crps_per_m": np.nan,
        f"rmse{ending}": float(np.sqrt(np.mean((observed - mean) ** 2))),
        f"crps{ending}": float(np.mean(crps(np.nan_to_num(draws), observed))),
        "r_squared": r_squared(observed, mean),
        "coverage_50": coverage(0.5),
        "coverage_90": coverage(0.9),
    }


GRID = np.arange(1, 40) / 40.0
FEWEST = 100
"""Fewest draws for a 95 % band."""
SIGNIFICANT = 0.05


class Scatter(StrEnum):
    """Scatter of held-out readings about their predictions."""

    AS_PREDICTED = "as predicted"
    ABOVE = "above"
    BELOW = "below"
    TOO_NARROW = "narrow"
    TOO_WIDE = "wide"
    NOT_KNOWN = "not known"


@dataclass(frozen=True)
class LooPit:
    """Probability integral transforms of held-out readings.

    Parameters
    ----------
    pit : array, shape (n,)
        Share of the predictive draws below each reading.
    grid : array, shape (m,)
        Probabilities.
    difference : array, shape (m,)
        Share of the transforms up to each of them, less that probability.
    low, high : array, shape (m,)
        Band in which 95 % of data sets drawn from the predictions stay everywhere.
    p_value : float
        Share of them at least as far out as the data, (1 + #)/(1 + D); nan where fewer than
        `FEWEST` draws are finite, and all curves with it.
    scatter : Scatter
        What is most remarkable: where the readings lie in their predictions, or how wide these are.
    share : float
        Of the readings that lie above (or below) the middle of their prediction, or in its middle
        half, as `scatter` has it; nan where neither is remarkable.
    replicates : int
        Data sets behind the p-value; draws of which all readings are finite.
    drawn : int
        Predictive draws.
    """

    pit: Floats
    grid: Floats
    difference: Floats
    low: Floats
    high: Floats
    p_value: float
    scatter: Scatter
    share: float
    replicates: int
    drawn: int

    @property
    def is_available(self) -> bool:
        """Whether there were enough draws for a band."""
        return not np.isnan(self.p_value)


def loo_pit(draws: Floats, observed: Floats) -> LooPit:
    r"""Compare held-out readings with their predictions.

    With F the share of the transforms up to u, data sets are compared by
    :math:`\max_u |F(u) - \bar F(u)| / s(u)`, mean and standard deviation being those of data sets
    drawn from the predictions.

    Parameters
    ----------
    draws : array, shape (D, n)
        Predictive draws of readings; those of one specimen, in one row, are of one simulated test
        that took no part in the fit. Rows with a nan are left out.
    observed : array, shape (n,)
        The readings.

    Examples
    --------
    >>> generator = np.random.default_rng(0)
    >>> draws = generator.standard_normal((400, 60))
    >>> loo_pit(draws, 2.5 * generator.standard_normal(60)).scatter
    <Scatter.TOO_NARROW: 'narrow'>
    """
    known = draws[np.all(np.isfinite(draws), axis=1)]
    if len(known) < FEWEST or not len(observed):
        readings, nothing = np.full(draws.shape[1], np.nan), np.full(len(GRID), np.nan)
        nan, replicates = float("nan"), len(known) if len(readings) else 0
        curves = (readings, GRID, nothing, nothing, nothing)
        return LooPit(*curves, nan, Scatter.NOT_KNOWN, nan, replicates, drawn=len(draws))
    ordered = np.sort(known, axis=0)
    columns = zip(ordered.T, observed, strict=True)
    below = np.array([np.searchsorted(column, value) for column, value in columns])
    pit = np.asarray((below + 0.5) / (len(ordered) + 1.0))
    # the transform of every draw among the others
    ranks = np.argsort(np.argsort(known, axis=0, kind="stable"), axis=0, kind="stable")
    simulated = np.asarray((ranks + 0.5) / len(known))
    difference, null = _differences(pit[None])[0], _differences(simulated)
    mean, sd = null.mean(axis=0), np.maximum(null.std(axis=0), 1e-12)
    far = np.max(np.abs(null - mean) / sd, axis=1)
    own = float(np.max(np.abs(difference - mean) / sd))
    p_value = float(chance_of(own, far))
    width = float(np.quantile(far, 0.95)) * sd
    return LooPit(
        pit,
        GRID,
        difference,
        mean - width,
        mean + width,
        p_value,
        *_scatter(pit, simulated, p_value),
        replicates=len(far),
        drawn=len(draws),
    )


def frame(models: Mapping[str, LooPit]) -> pd.DataFrame:
    """Return the curves of several models as one table.

    Columns: ``model``, ``probability``, ``difference``, ``low``, ``high``, ``p_value`` and
    ``replicates``, the last two the same in all rows of a model.
    """
    parts = [
        pd.DataFrame(
            {
                "model": name,
                "probability": one.grid,
                "difference": one.difference,
                "low": one.low,
                "high": one.high,
                "p_value": one.p_value,
                "replicates": one.replicates,
            }
        )
        for name, one in models.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _differences(pit: Floats) -> Floats:
    """Return the empirical distribution of transforms (k, n) less the uniform one, (k, m)."""
    ordered = np.sort(pit, axis=1)
    counts = np.stack([np.searchsorted(row, GRID, side="right") for row in ordered])
    return np.asarray(counts / pit.shape[1] - GRID)


def _scatter(pit: Floats, simulated: Floats, p_value: float) -> tuple[Scatter, float]:
    """Return the most remarkable departure, and the share of the readings that shows it."""
    if p_value > SIGNIFICANT:
        return Scatter.AS_PREDICTED, float("nan")
    own, null = ndtri(pit), ndtri(simulated)  # on this scale a shift does not change the spread
    shift = _score(float(own.mean()), null.mean(axis=1))
    spread = _score(float(np.log(own.std())), np.log(null.std(axis=1)))
    if abs(shift) >= abs(spread):
        above = float(np.mean(pit > 0.5))
        return (Scatter.ABOVE, above) if shift > 0.0 else (Scatter.BELOW, 1.0 - above)
    inside = float(np.mean(np.abs(pit - 0.5) < 0.25))
    return (Scatter.TOO_NARROW if spread > 0.0 else Scatter.TOO_WIDE), inside


def _score(value: float, simulated: Floats) -> float:
    return float((value - simulated.mean()) / max(float(simulated.std()), 1e-12))
