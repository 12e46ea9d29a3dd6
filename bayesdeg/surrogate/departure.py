r"""Departure of a map with changed dimensions of the actuator.

With δ = (d − median)/step a dimension's distance from where the emulator was trained, every output
of `bayesdeg.surrogate.surrogate` is

.. math:: Y(x; \delta) = Y(x) + \sum_p \delta^p A_p(x)

over powers p of one dimension, and products of two. The A are smooth in the emulator's own
coordinates x.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.demand import MEASURES
from bayesdeg.surrogate.coordinates import SLACK, Batch, unit_rate, unit_swelling
from bayesdeg.surrogate.terms import Terms, evaluate, stacked

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

ROOM = 1e-6  # of a step: tolerance of the range
SHAPE = 3  # outputs of the shape
OF_LOAD = SHAPE + len(MEASURES)  # place of the load among the outputs


@dataclass(frozen=True, eq=False)
class Departure:
    """Trained departure with some dimensions.

    Parameters
    ----------
    names : tuple of str
        The dimensions.
    ranges : array, shape (n_dimensions, 4)
        Median, step, and training bounds of each [mm].
    powers : array of int, shape (n_parts, n_dimensions)
        Powers of δ in each part.
    parts : tuple of Terms
        A of each part, with one output per output of the map: ``OUTPUTS``, ``MEASURES``, the load
        and, if it was trained, the force of a held tip.
    error : array, shape (n_parts, n_outputs)
        Standard error of each output's Y for a δ^p of 1 [–].
    """

    names: tuple[str, ...]
    ranges: Floats
    powers: Indices
    parts: tuple[Terms, ...]
    error: Floats

    def away(self, given: Mapping[str, Floats], rows: tuple[int, ...]) -> Floats:
        """Return δ of given dimensions, 0 for others, (n_dimensions, n_rows)."""
        median, step, _, _ = self.ranges.T
        found = np.zeros((len(self.names), int(np.prod(rows))))
        for k, name in enumerate(self.names):
            if name in given:
                found[k] = (np.broadcast_to(given[name], rows).ravel() - median[k]) / step[k]
        return found

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Smallest and largest δ, each (n_dimensions, 1)."""
        median, step, low, high = self.ranges.T
        return ((low - median) / step)[:, None], ((high - median) / step)[:, None]

    def inside(self, away: Floats) -> Flags:
        """Return which rows lie in the range, (n_rows,)."""
        low, high = self.bounds
        within: Flags = np.all((away >= low - ROOM) & (away <= high + ROOM), axis=0)
        return within

    def covers(self, name: str, low: float, high: float) -> bool:
        """Return whether a dimension is trained over a range [mm]."""
        if name not in self.names:
            return False
        _, step, first, last = self.ranges[self.names.index(name)]
        return bool(first - ROOM * step <= low and high <= last + ROOM * step)

    def sizes(self, away: Floats) -> Floats:
        """Return δ^p of all parts, (n_parts, n_rows)."""
        sizes: Floats = np.prod(away[None] ** self.powers[:, :, None], axis=1)
        return sizes

    def change_of_load(self, batch: Batch, away: Floats, shape: tuple[int, int]) -> Floats:
        """Return what is added to the load's series in the swelling, (n_slots, n_rows).

        ``shape`` are the series' orders, and powers of φ.
        """
        change = np.zeros((shape[1], shape[0], away.shape[1]))
        for part, size in zip(self.parts, self.sizes(away), strict=True):
            own = part.output(OF_LOAD)
            for power, order in np.unique(own.orders[:, [SLACK, 0]], axis=0):
                if power < shape[1]:
                    these = np.all(own.orders[:, [SLACK, 0]] == (power, order), axis=1)
                    orders = own.orders[these]
                    orders[:, [SLACK, 0]] = 0
                    there = np.zeros((away.shape[1], 1))
                    found = evaluate(
                        Terms(orders, own.coefficients[:, these]), batch.scaled, there, there
                    )
                    change[power, order] += size * found[0, :, 0]
        return change.reshape(-1, away.shape[1])

    def change(
        self, places: tuple[int, ...], batch: Batch, away: Floats, along: Floats
    ) -> "Change":
        """Return the change of some outputs.

        Parameters
        ----------
        places : tuple of int
            Indices of the outputs.
        batch : Batch
            Batch of the inputs.
        away : array, shape (n_dimensions, n_rows)
            δ.
        along : array, shape (n_rows, n_columns)
            Swelling t, or p/M of a held tip.
        """
        sizes, phi = self.sizes(away), batch.phi(along)
        found = evaluate(_of_outputs(self, places), batch.scaled, unit_swelling(along), phi)
        found = found.reshape(len(self.parts), len(places) + 2, *along.shape)
        *values, by_place, by_phi = np.einsum("pr,porc->orc", sizes, found)
        growth = unit_rate(along) * by_place - phi * (1.0 - phi) * by_phi
        variance = np.square(self.error[:, list(places)]).T @ np.square(sizes)
        return Change(np.exp(np.stack(values)), growth, variance[..., None])

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as plain arrays, for a npz file."""
        arrays: dict[str, NDArray[np.generic]] = {
            "dimensions": np.array(self.names),
            "dimensions_ranges": self.ranges,
            "dimensions_powers": self.powers,
            "dimensions_error": self.error,
        }
        for k, part in enumerate(self.parts):
            arrays |= {f"dimensions_orders_{k}": part.orders}
            arrays |= {f"dimensions_coefficients_{k}": part.coefficients}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> Self | None:
        """Return a departure from ``to_arrays``; None if there is none."""
        if "dimensions" not in arrays:
            return None
        powers = np.asarray(arrays["dimensions_powers"], dtype=np.int64)
        return cls(
            names=tuple(str(name) for name in arrays["dimensions"]),
            ranges=np.asarray(arrays["dimensions_ranges"], dtype=np.float64),
            powers=powers,
            parts=tuple(
                Terms(
                    np.asarray(arrays[f"dimensions_orders_{k}"], dtype=np.int64),
                    np.asarray(arrays[f"dimensions_coefficients_{k}"], dtype=np.float64),
                )
                for k in range(len(powers))
            ),
            error=np.asarray(arrays["dimensions_error"], dtype=np.float64),
        )


@dataclass(frozen=True)
class Change:
    """How outputs change with dimensions, (n_outputs, n_rows, n_columns).

    Parameters
    ----------
    factor : array
        Factor of each output.
    growth : array, shape (n_rows, n_columns)
        Change of the first one's logarithm with that of the swelling.
    variance : array, shape (n_outputs, n_rows, 1)
        Variance of the logarithm of the factors.
    """

    factor: Floats
    growth: Floats
    variance: Floats

    def applied(self, values: Floats, rate: Floats) -> Floats:
        """Return curvature, bend angle, peak stretch, slope and three errors, all changed.

        It is a change of these and of the load, whose error adds to theirs.

        ``values``, shape (7, n_rows, n_columns), are those at the nominal dimensions, ``rate`` is
        d ln t/d ln q.
        """
        curvature, angle, stretch, slope, *sds = values
        sizes = (curvature, angle, stretch - 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            growth = self.growth * rate + np.where(curvature > 0.0, slope / curvature, 1.0)
        variances = self.variance[:SHAPE] + growth**2 * self.variance[SHAPE]
        curvature, angle, strain = (
            size * factor for size, factor in zip(sizes, self.factor[:SHAPE], strict=True)
        )
        return np.stack(
            [
                *(curvature, angle, 1.0 + strain, curvature * growth),
                *(
                    factor * np.sqrt(sd**2 + variance * size**2)
                    for sd, size, factor, variance in zip(
                        sds, sizes, self.factor[:SHAPE], variances, strict=True
                    )
                ),
            ]
        )


@lru_cache(maxsize=16)
def _of_outputs(departure: Departure, places: tuple[int, ...]) -> Terms:
    """Return some outputs of all parts, with derivatives of the first one along the curve."""
    parts = list[Terms]()
    for part in departure.parts:
        first = Terms(part.orders, part.coefficients[[places[0]]])
        chosen = Terms(part.orders, part.coefficients[list(places)])
        parts += [chosen, first.derivative(0), first.derivative(SLACK)]
    return stacked(parts)
