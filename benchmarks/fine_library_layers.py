"""Outputs of the fine mesh: process of a coarse mesh, correction, and effect of slack paper.

With a tight paper outputs are T = coarse + correction. A slack paper lacks the share φ of its
force and adds φ D, with D a process of its own on either mesh, too: all four are smooth.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from fine_library_data import Points, missing_force
from fine_library_likelihood import most_likely
from fine_library_process import Conditioned, Data, Kernel, Process, condition
from numpy.typing import NDArray

from bayesdeg.surrogate.coordinates import SLACK

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PARTS = ("tight", "tight_correction", "loose", "loose_correction")
# first guess of the lengths, in units of the coordinates, and of σ, c and the errors
LENGTHS = np.array([0.8, 7.0, 4.0, 3.0, 20.0, 6.0, 15.0, 2.0, 15.0, 15.0, 15.0, 6.0, 5.0])
SCALES, CONSTANT = (0.5, 0.05, 0.2, 0.05), 1.0
CURVES, ITERATIONS, SEED = 32, 30, 3


@dataclass(frozen=True)
class Layer:
    """Some outputs as a sum of processes.

    Parameters
    ----------
    parts : tuple of Process
        In the order of ``PARTS``.
    """

    parts: tuple[Process, ...]

    def along(self, rows: Floats, bending: Floats) -> tuple[Floats, Floats]:
        """Return outputs where rows (m, 13) meet bendings (j,), and slopes, (m, j, n_outputs)."""
        taut = rows.copy()
        taut[:, SLACK] = 0.0
        value, slope = _sum(self.parts[:2], taut, bending)
        loose = rows[:, SLACK] > 0.0
        if np.any(loose):
            more, steeper = _sum(self.parts[2:], rows[loose], bending)
            every = np.repeat(rows[loose], len(bending), axis=0)
            every[:, 0] = np.tile(bending, int(loose.sum()))
            phi, by = missing_force(every)
            shape = (*more.shape[:2], 1)
            phi, rate = phi.reshape(shape), by[:, 0].reshape(shape)
            value[loose] += phi * more
            slope[loose] += phi * steeper + rate * more
        return value, slope

    def distance(self, rows: Floats, bending: Floats) -> Floats:
        """Return the distance from what was solved on the coarse mesh, (m, j)."""
        taut = rows.copy()
        taut[:, SLACK] = 0.0
        out = self.parts[0].distance(taut, bending)
        loose = rows[:, SLACK] > 0.0
        out[loose] = np.maximum(out[loose], self.parts[2].distance(rows[loose], bending))
        return out


def _sum(parts: tuple[Process, ...], rows: Floats, bending: Floats) -> tuple[Floats, Floats]:
    first, second = (part.along(rows, bending) for part in parts)
    return first[0] + second[0], first[1] + second[1]


@dataclass(frozen=True)
class Fit:
    """A layer with all that it was made of.

    Parameters
    ----------
    outputs : tuple of int
        Which values of ``Points``.
    found : tuple of Conditioned
        In the order of ``PARTS``.
    curves : tuple of array
        The curve of each of their places.
    """

    outputs: tuple[int, ...]
    found: tuple[Conditioned, ...]
    curves: tuple[NDArray[np.int64], ...]

    @property
    def layer(self) -> Layer:
        """What predicts."""
        return Layer(tuple(part.process for part in self.found))

    def without(self, curve: int, *, loose: bool) -> Layer:
        """Return the layer that knows a curve on neither mesh."""
        chosen = (2, 3) if loose else (0, 1)
        return Layer(
            tuple(
                part.without(of == curve) if k in chosen and np.any(of == curve) else part.process
                for k, (part, of) in enumerate(zip(self.found, self.curves, strict=True))
            )
        )


def fit(coarse: Points, fine: Points, *, outputs: tuple[int, ...], errors: Floats) -> Fit:
    """Return the layer of some outputs.

    Parameters
    ----------
    coarse, fine : Points
        Curves have the same numbers on both meshes.
    outputs : tuple of int
        Which values.
    errors : array, shape (2,)
        First guess of the errors of values and derivatives of the coarse tight process.
    """
    found: list[Conditioned] = []
    taut = [_taken(p.only(~p.loose), outputs) for p in (coarse, fine)]
    loose = [p.only(p.loose) for p in (coarse, fine)]
    found.append(_fitted(taut[0], coarse.curve[~coarse.loose], 0, errors))
    base = found[0].process
    found.append(_fitted(_less(taut[1], base), fine.curve[~fine.loose], 1, errors))
    # of slack paper the correction is that of the whole tight surface
    less = [_less(_taken(p, outputs), base) for p in loose]
    less[1] = _less(less[1], found[1].process)
    shares = [_over_share(data, p) for data, p in zip(less, loose, strict=True)]
    found.append(_fitted(shares[0], loose[0].curve, 2, 10.0 * errors))
    rest = _less(shares[1], found[2].process, taut=False)
    found.append(_fitted(rest, loose[1].curve, 3, 10.0 * errors))
    points = (coarse, fine)
    curves = [*(p.curve[~p.loose] for p in points), *(p.curve[p.loose] for p in points)]
    return Fit(outputs, tuple(found), tuple(curves))


def _taken(points: Points, outputs: tuple[int, ...]) -> Data:
    chosen = list(outputs)
    return Data(points.places, points.values[:, chosen], points.slopes[:, chosen])


def _less(data: Data, process: Process, *, taut: bool = True) -> Data:
    """Return data less what a process says of them."""
    places = data.places.copy()
    if taut:
        places[:, SLACK] = 0.0
    value, slope = process.with_slopes(places)
    if taut:
        slope[..., SLACK] = 0.0
    return Data(data.places, data.values - value, data.slopes - slope)


def _over_share(data: Data, points: Points) -> Data:
    """Return data over φ."""
    phi, by = missing_force(points.places)
    values = data.values / phi[:, None]
    slopes = (data.slopes - values[..., None] * by[:, None]) / phi[:, None, None]
    return Data(data.places, values, slopes)


def _fitted(data: Data, curve: NDArray[np.int64], part: int, errors: Floats) -> Conditioned:
    """Return the process of the most likely kernel: that of some curves, for the first output."""
    guess = np.concatenate(
        [
            np.log(LENGTHS),
            np.full(len(LENGTHS), np.log(CONSTANT)),
            [np.log(SCALES[part])],
            np.log(errors),
        ]
    )
    chosen = np.random.default_rng(SEED).permutation(np.unique(curve))[:CURVES]
    some = np.isin(curve, chosen)
    subset = Data(data.places[some], data.values[some][:, :1], data.slopes[some][:, :1])
    return condition(most_likely(Kernel(guess), subset, iterations=ITERATIONS), data)


def arrays(layer: Layer, name: str) -> dict[str, Any]:
    """Return a layer as arrays to be stored."""
    return {
        f"{name}_{part}_{field}": value
        for part, process in zip(PARTS, layer.parts, strict=True)
        for field, value in {
            "kernel": process.kernel.log,
            "places": process.places,
            "mean": process.mean,
            "weights": process.weights,
        }.items()
    }


def restored(stored: Mapping[str, Any], name: str) -> Layer:
    """Return a layer from its arrays."""
    return Layer(
        tuple(
            Process(
                Kernel(stored[f"{name}_{part}_kernel"]),
                *(stored[f"{name}_{part}_{field}"] for field in ("places", "mean", "weights")),
            )
            for part in PARTS
        )
    )
