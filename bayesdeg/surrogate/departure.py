r"""Departure of a map with changed dimensions of the actuator.

With δ = (d − median)/step a dimension's distance from where the emulator was trained, every output
of `bayesdeg.surrogate.surrogate` is

.. math:: Y(x; \delta) = Y(x) + \sum_p \delta^p A_p(x)

over powers p of one dimension, and products of two. The A are smooth in the emulator's own
coordinates x. The load at which curves end departs likewise, with constant coefficients.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Asked
from bayesdeg.surrogate.coordinates import SLACK, Batch
from bayesdeg.surrogate.terms import Terms, evaluate, stacked

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

ROOM = 1e-6  # of a step: tolerance of the range


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
        A of each part, with one output per output of the map.
    error : array, shape (n_parts, n_outputs)
        Standard error of each output's Y for a δ^p of 1 [–].
    limits, limit_error : array, shape (n_parts,)
        Change of ln of the load up to which curves are smooth, and its standard error [–].
    further : tuple of str
        Outputs besides the shape; they come last.
    """

    names: tuple[str, ...]
    ranges: Floats
    powers: Indices
    parts: tuple[Terms, ...]
    error: Floats
    limits: Floats
    limit_error: Floats
    further: tuple[Asked, ...] = ()

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

    def limit(self, away: Floats) -> tuple[Floats, Floats]:
        """Return the change of ln of the limit and its standard error, each (n_rows,)."""
        sizes = self.sizes(away)
        error = np.sqrt(np.square(self.limit_error) @ np.square(sizes))
        return self.limits @ sizes, error

    def change(
        self, places: tuple[int, ...], batch: Batch, away: Floats, warped: Floats, loads: Floats
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
        warped, loads : array, shape (n_rows, n_columns)
            Warped load on [−1, 1], and p/M.
        """
        sizes, phi = self.sizes(away), batch.phi(loads)
        found = evaluate(_of_outputs(self, places), batch.scaled, warped, phi)
        found = found.reshape(len(self.parts), len(places) + 2, *warped.shape)
        *values, by_load, by_phi = np.einsum("pr,porc->orc", sizes, found)
        growth = (warped + 1.0) * by_load - phi * (1.0 - phi) * by_phi
        variance = np.square(self.error[:, list(places)]).T @ np.square(sizes)
        return Change(np.exp(np.stack(values)), growth, variance[..., None])

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as plain arrays, for a npz file."""
        arrays: dict[str, NDArray[np.generic]] = {
            "dimensions": np.array(self.names),
            "dimensions_ranges": self.ranges,
            "dimensions_powers": self.powers,
            "dimensions_error": self.error,
            "dimensions_limits": np.stack([self.limits, self.limit_error]),
            "dimensions_further": np.array(self.further, dtype=np.str_),
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
        limits, limit_error = np.asarray(arrays["dimensions_limits"], dtype=np.float64)
        known: dict[str, Asked] = {"cavity_volume": "cavity_volume", "tip_force": "tip_force"}
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
            limits=limits,
            limit_error=limit_error,
            further=tuple(known[str(name)] for name in arrays["dimensions_further"]),
        )


@dataclass(frozen=True)
class Change:
    """How outputs change with dimensions, (n_outputs, n_rows, n_columns).

    Parameters
    ----------
    factor : array
        Factor of each output.
    growth : array, shape (n_rows, n_columns)
        Change of the first one's logarithm with the logarithm of the load.
    variance : array, shape (n_outputs, n_rows, 1)
        Variance of the logarithm of the factors.
    """

    factor: Floats
    growth: Floats
    variance: Floats

    def applied(self, values: Floats) -> Floats:
        """Return curvature, bend angle, peak stretch, slope and three errors, all changed.

        ``values``, shape (7, n_rows, n_columns), are those at the nominal dimensions.
        """
        curvature, angle, stretch, slope, *sds = values
        sizes = (curvature, angle, stretch - 1.0)
        changed = [size * factor for size, factor in zip(sizes, self.factor, strict=True)]
        return np.stack(
            [
                *changed[:2],
                1.0 + changed[2],
                self.factor[0] * (slope + curvature * self.growth),
                *(
                    self.factor[k] * np.sqrt(sd**2 + self.variance[k] * size**2)
                    for k, (sd, size) in enumerate(zip(sds, sizes, strict=True))
                ),
            ]
        )


@lru_cache(maxsize=16)
def _of_outputs(departure: Departure, places: tuple[int, ...]) -> Terms:
    """Return some outputs of all parts, each with the first one's derivatives by load and slack."""
    parts = list[Terms]()
    for part in departure.parts:
        first = Terms(part.orders, part.coefficients[[places[0]]])
        chosen = Terms(part.orders, part.coefficients[list(places)])
        parts += [chosen, first.derivative(0), first.derivative(SLACK)]
    return stacked(parts)
