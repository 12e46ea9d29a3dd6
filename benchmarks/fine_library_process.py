"""A Gaussian process of values and their derivatives: kriging with gradients.

The kernel is σ² Π_d (c_d + exp(−r_d²/2))/(c_d + 1), r_d the distance along a coordinate over its
length: with large c_d coordinates act nearly each by itself, with small ones all together.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Kinds = tuple[int, ...]


@dataclass(frozen=True)
class Kernel:
    """A kernel with its noise.

    Parameters
    ----------
    log : array, shape (2 n + 3,)
        ln of the lengths, of the constants c, of σ, and of the standard errors of values and of
        derivatives by coordinates over their lengths.
    """

    log: Floats

    @property
    def size(self) -> int:
        return (len(self.log) - 3) // 2

    @property
    def lengths(self) -> Floats:
        return np.exp(self.log[: self.size])

    @property
    def constants(self) -> Floats:
        return np.exp(self.log[self.size : -3])

    def factor(self, d: int, first: Floats, second: Floats) -> tuple[Floats, Floats, Floats]:
        """Return a coordinate's factor at scaled (n,) and (m,), and over it the derivatives.

        The one by the first place, and the mixed one by both, (n, m).
        """
        c = self.constants[d]
        r = first[:, None] - second
        e = np.exp(-0.5 * r * r)
        share = e / (c + e)
        return (c + e) / (c + 1.0), -share * r, share * (1.0 - r * r)

    def factors(self, first: Floats, second: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the kernel (n, m) at scaled places, and ``factor``'s derivatives, (d, n, m)."""
        k = np.full((len(first), len(second)), np.exp(2.0 * self.log[-3]))
        slope = np.empty((self.size, *k.shape))
        both = np.empty_like(slope)
        for d in range(self.size):
            factor, slope[d], both[d] = self.factor(d, first[:, d], second[:, d])
            k *= factor
        return k, slope, both

    def matrix(self, first: Floats, second: Floats, *, rows: Kinds, columns: Kinds) -> Floats:
        """Return covariances, blocks by kind: 0 the value, i + 1 the slope by coordinate i."""
        k, slope, both = self.factors(first / self.lengths, second / self.lengths)
        out = np.empty((len(rows), len(first), len(columns), len(second)))
        for place, i in enumerate(rows):
            left = k if i == 0 else k * slope[i - 1]
            for other, j in enumerate(columns):
                block = out[place, :, other]
                if i == j > 0:
                    np.multiply(k, both[i - 1], out=block)
                elif j == 0:
                    block[:] = left
                else:
                    np.multiply(left, -slope[j - 1], out=block)
        return out.reshape(len(rows) * len(first), len(columns) * len(second))

    def noise(self, n: int, kinds: Kinds) -> Floats:
        """Return variances of errors of n values and of slopes."""
        value, slope = np.exp(2.0 * self.log[-2:])
        return np.concatenate([np.full(n, slope if kind else value) for kind in kinds])


@dataclass(frozen=True)
class Data:
    """What a process is conditioned on.

    Parameters
    ----------
    places : array, shape (n, d)
        Coordinates.
    values : array, shape (n, n_outputs)
        To be fitted.
    slopes : array, shape (n, n_outputs, d)
        Their derivatives; nan where not known.
    """

    places: Floats
    values: Floats
    slopes: Floats

    @property
    def kinds(self) -> Kinds:
        """What is known anywhere, as in ``Kernel.matrix``."""
        some = np.isfinite(self.slopes).any(axis=(0, 1))
        return (0, *(int(d) + 1 for d in np.flatnonzero(some)))

    def stacked(self, kernel: Kernel) -> tuple[Floats, Flags]:
        """Return all by kind, (n_kinds n, n_outputs), and what of it is known."""
        by = [d - 1 for d in self.kinds[1:]]
        slopes = np.moveaxis(self.slopes[:, :, by] * kernel.lengths[by], 2, 0)
        whole = np.concatenate([self.values[None], slopes]).reshape(-1, self.values.shape[1])
        return whole, np.isfinite(whole).all(axis=1)


@dataclass(frozen=True)
class Process:
    """A process conditioned on data: its mean is what it predicts.

    Parameters
    ----------
    kernel : Kernel
    places : array, shape (n, d)
        Over lengths.
    mean : array, shape (n_outputs,)
    weights : array, shape (1 + d, n, n_outputs)
        Of values and of derivatives.
    """

    kernel: Kernel
    places: Floats
    mean: Floats
    weights: Floats

    def __call__(self, places: Floats) -> Floats:
        """Return the mean at (m, d) places, (m, n_outputs)."""
        k, slope, _ = self.kernel.factors(places / self.kernel.lengths, self.places)
        out = k @ self.weights[0]
        for d in range(self.kernel.size):
            out -= (k * slope[d]) @ self.weights[d + 1]
        return np.asarray(self.mean + out, dtype=np.float64)

    def along(self, rows: Floats, first: Floats) -> tuple[Floats, Floats]:
        """Return the mean where each of (m, d) rows meets each value (j,) of the first coordinate.

        Parameters
        ----------
        rows : array, shape (m, d)
            Coordinates; the first is not read.
        first : array, shape (j,)
            Values of the first.

        Returns
        -------
        mean, slope : array, shape (m, j, n_outputs)
            And its derivative by the first coordinate.
        """
        lengths = self.kernel.lengths
        a = np.exp(2.0 * self.kernel.log[-3]) * np.ones((len(rows), len(self.places)))
        slope = np.empty((len(lengths), *a.shape))
        for d in range(1, len(lengths)):
            factor, slope[d], _ = self.kernel.factor(d, rows[:, d] / lengths[d], self.places[:, d])
            a *= factor
        f, s, both = self.kernel.factor(0, first / lengths[0], self.places[:, 0])
        mean, by_first = [], []
        for output in range(len(self.mean)):
            weights = self.weights[:, :, output]
            b = a * (weights[0] - np.einsum("dmn,dn->mn", slope[1:], weights[2:]))
            c = a * weights[1]
            mean.append(self.mean[output] + b @ f.T - c @ (f * s).T)
            by_first.append((b @ (f * s).T + c @ (f * both).T) / lengths[0])
        return np.stack(mean, axis=-1), np.stack(by_first, axis=-1)

    def distance(self, rows: Floats, first: Floats) -> Floats:
        """Return how far from any data rows and values of the first coordinate meet, (m, j).

        In lengths of the kernel; a coordinate with a large constant c hardly counts.
        """
        weight = np.sqrt(1.0 / (1.0 + self.kernel.constants)) / self.kernel.lengths
        data = self.places[np.any(self.weights != 0.0, axis=(0, 2))] * self.kernel.lengths * weight
        along = (first[:, None] * weight[0] - data[:, 0]) ** 2
        out = np.empty((len(rows), len(first)))
        for row, place in zip(out, rows * weight, strict=True):
            across = np.sum((data[:, 1:] - place[1:]) ** 2, axis=1)
            row[:] = np.sqrt(np.min(along + across, axis=1))
        return out

    def with_slopes(self, places: Floats) -> tuple[Floats, Floats]:
        """Return the mean and its derivatives by the coordinates, (m, n_outputs, d)."""
        lengths, count = self.kernel.lengths, len(self.mean)
        kinds = tuple(range(self.kernel.size + 1))
        cross = self.kernel.matrix(places, self.places * lengths, rows=kinds, columns=kinds)
        out = (cross @ self.weights.reshape(-1, count)).reshape(-1, len(places), count)
        return self.mean + out[0], np.moveaxis(out[1:], 0, 2) / lengths


@dataclass(frozen=True)
class Conditioned:
    """A process with the factors of its matrix, to leave data out."""

    process: Process
    data: Data
    factor: Any
    known: Flags
    solved: Floats

    def without(self, out: Flags) -> Process:
        """Return the process without some places: their rows of the inverse are eliminated."""
        kinds = self.data.kinds
        rows = np.flatnonzero(np.tile(out, len(kinds))[self.known])
        unit = np.zeros((len(self.solved), len(rows)))
        unit[rows, np.arange(len(rows))] = 1.0
        inverse = cho_solve(self.factor, unit, check_finite=False)
        change = np.linalg.solve(inverse[rows], self.solved[rows])
        weights = spread(self, self.solved - inverse @ change)
        weights[:, out] = 0.0
        return replace(self.process, weights=weights)


def spread(found: "Conditioned", solved: Floats) -> Floats:
    """Return weights of what is known as weights of all values and derivatives."""
    data, outputs = found.data, solved.shape[1]
    some = np.zeros((len(found.known), outputs))
    some[found.known] = solved
    weights = np.zeros((found.process.kernel.size + 1, len(data.places), outputs))
    weights[list(data.kinds)] = some.reshape(len(data.kinds), -1, outputs)
    return weights


def condition(kernel: Kernel, data: Data) -> Conditioned:
    """Return the process that the data leave of a kernel."""
    whole, known = data.stacked(kernel)
    n, kinds = len(data.places), data.kinds
    mean = data.values.mean(axis=0)
    whole[:n] -= mean
    matrix = kernel.matrix(data.places, data.places, rows=kinds, columns=kinds)
    matrix[np.diag_indices_from(matrix)] += kernel.noise(n, kinds)
    if not known.all():
        matrix = matrix[np.ix_(known, known)]
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    solved = cho_solve(factor, whole[known], check_finite=False)
    process = Process(kernel, data.places / kernel.lengths, mean, np.empty(0))
    found = Conditioned(process, data, factor, known, solved)
    return replace(found, process=replace(process, weights=spread(found, solved)))
