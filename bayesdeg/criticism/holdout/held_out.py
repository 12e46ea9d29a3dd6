"""Held-out specimens: what a model predicts of those that took no part in its calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.model import JointModel, blocks_of
from bayesdeg.material.degradation import levels
from bayesdeg.priors import Named

Floats = NDArray[np.float64]
Folds = NDArray[np.int64]

DRAWS = 400  # predictive


@dataclass(frozen=True)
class HeldOut:
    """Predictions of groups of readings by a model that was calibrated without them.

    Parameters
    ----------
    log_density : array, shape (n_groups,)
        Log predictive density of all that was read on each group.
    draws : array, shape (n_draws, n_readings)
        Predictive draws; nan of readings that are never held out.
    kind : array of int, shape (n_groups,), optional
        Which groups are alike, as actuators are, and films; None if all are.
    """

    log_density: Floats
    draws: Floats
    kind: NDArray[np.int64] | None = None

    @property
    def kinds(self) -> NDArray[np.int64]:
        """Which groups are alike, (n_groups,)."""
        return np.zeros(len(self.log_density), dtype=np.int64) if self.kind is None else self.kind

    @property
    def mean(self) -> Floats:
        """Predictive mean of the readings, (n_readings,)."""
        known = np.isfinite(self.draws)
        total: Floats = np.where(known, self.draws, 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)


def joined(first: HeldOut, second: HeldOut) -> HeldOut:
    """Return both as one, the groups of either being of other kinds; draws are those of the first.

    Examples
    --------
    >>> films = HeldOut(np.zeros(3), np.zeros((1, 0)))
    >>> joined(films, films).kinds.tolist()
    [0, 0, 0, 1, 1, 1]
    """
    kind = np.concatenate([first.kinds, 1 + first.kinds.max() + second.kinds])
    return HeldOut(np.concatenate([first.log_density, second.log_density]), first.draws, kind)


def group_levels(subject: JointModel) -> Floats:
    """Return the degradation rate of each group [%], the mean over its readings."""
    return np.array(
        [float(np.mean(subject.places.level[subject.group == g])) for g in subject.groups]
    )


def by_level(subject: JointModel) -> Folds:
    """Return folds that leave out all specimens of one level of degradation."""
    member: Folds = levels(group_levels(subject))[1]
    return member


def difference(held_out: HeldOut, base: HeldOut) -> tuple[float, float]:
    """Return the gain in log predictive density over all groups and its standard error.

    The variance of a sum over several kinds of groups is that of the sums over each. A single group
    of its kind, such as a measured mean, has no spread: that of a log ratio g of two normal
    densities that differ in their means is taken, √(2|g|).
    """
    gap = held_out.log_density - base.log_density
    parts = [gap[held_out.kinds == kind] for kind in np.unique(held_out.kinds)]
    if len(parts) == 1:
        return float(np.sum(gap)), standard_error(gap)
    errors = [standard_error(part) if len(part) > 1 else _single_error(part[0]) for part in parts]
    return float(np.sum(gap)), float(np.sqrt(np.sum(np.square(errors))))


def standard_error(values: Floats) -> float:
    """Return the standard error of a sum over groups; nan for a single one."""
    return float(np.sqrt(len(values)) * np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _single_error(gain: float) -> float:
    """Return the standard error of a gain g that stands alone, √(2|g|).

    Of ln N(y | a, 1) - ln N(y | b, 1), which is (a - b)²/2 on average if a is right, and scatters
    by |a - b|.
    """
    return float(np.sqrt(2.0 * abs(gain)))


def specimen_density(
    model: JointModel, values: Named
) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Return log densities of all readings of each specimen.

    Given the parameters, the readings of one specimen in different tables are independent, so that
    their log densities add up.

    Parameters
    ----------
    model : JointModel
        With its data.
    values : mapping
        Named values, (n,).

    Returns
    -------
    specimens, kinds : tuple of str
        Names, and what was read on each.
    density : array, shape (n, n_specimens)
        −inf where the model has no answer.
    """
    by_kind = model.log_likelihood(values)
    blocks = blocks_of(model)
    columns = [
        sum(by_kind[kind][:, rows].sum(axis=-1) for kind, rows in found.items())
        for found in blocks.values()
    ]
    count = len(next(iter(values.values())))
    density = np.stack(columns, axis=-1) if columns else np.empty((count, 0))
    known = np.where(np.isnan(density), -np.inf, density)
    return tuple(blocks), tuple(", ".join(found) for found in blocks.values()), known
