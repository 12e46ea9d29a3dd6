r"""Columns with the misfit: its share, sign and size for each level of each column.

Each level of a column (a third of the path, a degradation rate, a branch, a mount, a specimen …)
gets its own scale and trend along the path, directions W on the whitened scale, for every kind of
reading in the family. The gain of a column in log-likelihood, less its mean gain in data simulated
from the model,

.. math:: \tfrac12 |Q^T z|^2 - \overline{\tfrac12 |Q^T z^{sim}|^2}, \qquad
    Q \text{ orthonormal, of the span of the } W \text{ of its levels},

divided by the largest gain of any column or of the smooth discrepancy that measures the misfit, is
the share of the column; that of a level uses its own directions. Correlated columns account for the
same misfit, so shares do not add up.

Sign and size are those of e = V C⁻¹ (y − mean), the errors and scatter left after the parameters
are fitted again (`criticism.fit.linear.Linear.unexplained`), on average over the readings of the
first kind, also over the mean size of what the model predicts there.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.checks.known_terms import (
    BATCH,
    BRANCH,
    CYCLE,
    HISTORY,
    HUMIDITY,
    MOUNT,
    RATE,
    TIME,
    known_of,
    path_of,
    reading_unit,
)
from bayesdeg.criticism.checks.residuals import gain_of
from bayesdeg.criticism.findings import ColumnMisfit, LevelMisfit
from bayesdeg.criticism.fit.linear import Linear

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PARTS = 3  # equal-count parts of a numeric column


def misfit_columns(
    linear: Linear,
    simulated: Floats,
    misfit: Misfit,
    *,
    batches: Mapping[str, str] | None = None,
) -> tuple[ColumnMisfit, ...]:
    """Return the misfit by column, the largest share first.

    The columns are those of the family of the misfit; `simulated` (k, n_readings) are data sets
    drawn from the posterior; batches are by specimen, as far as known.
    """
    ceiling = misfit.statistic - misfit.by_chance
    if ceiling <= 0.0 or not len(simulated):
        return ()
    data = np.vstack([linear.observed, linear.whiten(simulated)])
    rows = linear.subject.places.family == misfit.family
    columns = _columns(linear, rows, batches or {})
    parts = {name: _by_level(linear, rows, labels) for name, labels in columns.items()}
    gains = {n: _gain(linear, np.hstack([*own.values()]), data) for n, own in parts.items()}
    ceiling = max([ceiling, *gains.values()])
    kinds = linear.subject.places.kind[rows]
    kind, unit = str(kinds[0]), reading_unit(linear, str(kinds[0]))
    left, size = linear.unexplained(linear.observed)[rows], np.abs(linear.prediction[rows])
    found = []
    for name, labels in columns.items():
        each = []
        for level, own in parts[name].items():
            here = labels == level
            read = here & (kinds == kind) if np.any(here & (kinds == kind)) else here
            excess = float(np.mean(left[read]))
            each.append(
                LevelMisfit(
                    level=level,
                    readings=int(np.sum(here)),
                    share_of_misfit=_gain(linear, own, data) / ceiling,
                    excess=excess,
                    excess_pct=100.0 * excess / max(float(np.mean(size[read])), 1e-300),
                )
            )
        share = gains[name] / ceiling
        found.append(
            ColumnMisfit(
                column=name, share_of_misfit=share, kind=kind, unit=unit, levels=tuple(each)
            )
        )
    return tuple(sorted(found, key=lambda one: -one.share_of_misfit))


def _columns(
    linear: Linear, rows: Flags, batches: Mapping[str, str]
) -> dict[str, NDArray[np.str_]]:
    """Return columns with several levels, and the level of each reading of the family."""
    places, known = linear.subject.places.subset(rows), known_of(linear, rows, batches)
    found = {
        one.column: _thirds(known.numbers[one.column], one.unit)
        for one in (path_of(linear, places), TIME, HUMIDITY)
        if one.column in known.numbers
    }
    for quantity in (RATE, BRANCH, MOUNT, HISTORY, BATCH):
        if quantity.column in known.labels:
            found[quantity.column] = known.labels[quantity.column]
    if CYCLE.column in known.numbers:
        found["cycle"] = np.array([f"{1.0 + c:g}" for c in known.numbers[CYCLE.column]])
    found["specimen"] = places.specimen
    found["kind of reading"] = places.kind
    return {name: labels for name, labels in found.items() if len(np.unique(labels)) > 1}


def _thirds(values: Floats, unit: str) -> NDArray[np.str_]:
    """Return the third of the readings that each belongs to, labelled by its ends."""
    inner = np.quantile(values, np.arange(1, PARTS) / PARTS)
    part = np.searchsorted(inner, values)
    names = np.full(len(values), "", dtype="<U40")
    for k in np.unique(part):
        own = values[part == k]
        names[part == k] = f"{own.min():.3g} to {own.max():.3g} {unit}".strip()
    return names


def _by_level(linear: Linear, rows: Flags, labels: NDArray[np.str_]) -> dict[str, Floats]:
    """Return the directions of each level of a column, in the order along the path, (n, r) each.

    A scale and a trend along the path for each kind of reading.
    """
    places, found = linear.subject.places, {}
    for level in dict.fromkeys(labels[np.argsort(places.along[rows], kind="stable")].tolist()):
        own = np.zeros(len(rows), dtype=bool)
        own[rows] = labels == level
        middle, length = float(np.mean(places.along[own])), float(np.ptp(places.along[own]))
        columns = []
        for kind in np.unique(places.kind[own]):
            size = np.where(own & (places.kind == kind), linear.prediction, 0.0)
            columns += [size, size * (places.along - middle) / max(length, 1e-12)]
        found[level] = np.column_stack(columns)
    return found


def _gain(linear: Linear, directions: Floats, data: Floats) -> float:
    """Return the gain of directions in log-likelihood of the first data set, less chance [nats]."""
    gain = gain_of(linear, directions, data)
    return max(float(gain[0] - np.mean(gain[1:])), 0.0)
