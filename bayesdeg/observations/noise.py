r"""Noise laws and the specimen hierarchy: log densities of whole paths of readings, compiled.

The dependence of a reading on earlier ones follows from the path and the length ℓ only, not from
the values: the filter is computed once for consecutive specimens on the same path, and the pass
over a specimen's readings is only products and sums.

The readings of one specimen are

.. math:: y = f(m) + \varepsilon, \qquad m_k \sim N(0, \tau_k^2), \qquad
    \varepsilon_j = \sqrt{v_j}\, z_j

with m the specimen's own deviations (of ln stiffness, of its degradation rate) and z partly an
Ornstein–Uhlenbeck process along the path, partly independent: cor(z_i, z_j) =
(1 − w) exp(−d_ij/ℓ), d the length of path between two readings and w = 0.2 (`INDEPENDENT`).  A
second output from the same picture (the bend angle with the curvature) has the same law and
the correlation c with the first at the same reading, its process being z₂ = c z₁ + √(1 − c²) u with
u independent of z₁.

f is nearly linear in m, so m is integrated out with f(m) ≈ f(m̂) + J (m − m̂), linearised about
its most probable value.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from bayesdeg.compiled import compiled

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

LOG_TWO_PI = math.log(2.0 * math.pi)
INDEPENDENT = 0.2
"""Share of an error's variance that is independent per reading: rounding, picking of markers."""
LANES = 32
"""Number of vectors processed together, so that the compiler can use SIMD."""


class Paths(NamedTuple):
    """Sequence of readings, n_readings = n_outputs × n_points per specimen.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_readings)
        Where there is a reading; the second output needs one of the first at the same point.
    gap : array, shape (n_specimens, n_readings)
        Length of path since the previous reading of the same output; infinite for the first.
    place : array, shape (n_specimens, n_readings)
        Length of path up to it.
    points : int
        Readings of the first output; those of the second follow them.
    """

    mask: Flags
    gap: Floats
    place: Floats
    points: int


def paths_of(mask: Flags, place: Floats) -> Paths:
    """Return the paths of readings at places along them.

    Parameters
    ----------
    mask : array of bool, shape (n_specimens, n_outputs, n_points)
        Where there is a reading.
    place : array, shape (n_specimens, n_points)
        Length of path up to each reading, non-decreasing.

    Examples
    --------
    >>> paths = paths_of(np.array([[[True, False, True]]]), np.array([[20.0, 40.0, 60.0]]))
    >>> paths.gap[0, [0, 2]]
    array([inf, 40.])
    """
    n_specimens, n_outputs, n_points = mask.shape
    read = mask & mask[:, :1]
    gap = np.full(mask.shape, np.inf)
    last = np.full((n_specimens, n_outputs), -np.inf)
    for j in range(n_points):
        here = place[:, None, j]
        gap[..., j] = here - last
        last = np.where(read[..., j], here, last)
    return Paths(
        read.reshape(n_specimens, -1),
        gap.reshape(n_specimens, -1),
        np.tile(place, n_outputs),
        n_points,
    )


@compiled
def same_path(mask: Flags, gap: Floats) -> Flags:
    """Return whether each specimen's path equals the previous specimen's."""
    alike = np.zeros(len(mask), np.bool_)
    for s in range(1, len(mask)):
        same = True
        for j in range(mask.shape[1]):
            if mask[s, j] != mask[s - 1, j] or (mask[s, j] and gap[s, j] != gap[s - 1, j]):
                same = False
                break
        alike[s] = same
    return alike


@compiled
def filter_of(
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    points: int,
    gains: Floats,
    order: Indices,
    constant: Floats,
) -> int:
    """Compute the filters of one path for `LANES` lengths; return its number of readings.

    ``order`` receives which readings there are; ``gains``, (n_readings, 3 `LANES`), for each of
    them, in that order, the decay since the last, the gain, and 1 over the standard deviation of
    the innovation; ``constant``, (`LANES`,), their part of ln det(2π R), which is that of the
    correlations R, without the variances.
    """
    count, step = 0, -1.0
    known, decay, product = np.empty(LANES), np.empty(LANES), np.ones(LANES)
    constant[:] = 0.0
    for j in range(len(mask)):
        if j % points == 0:  # no information before the first reading of an output
            known[:] = 1.0 - INDEPENDENT
        if not mask[j]:
            continue
        if gap[j] != step:  # most steps of a path are equal
            step = gap[j]
            for lane in range(LANES):
                decay[lane] = math.exp(-step / length[lane])
        gain = gains[count]
        for lane in range(LANES):
            square = decay[lane] * decay[lane]
            ahead = square * known[lane] + (1.0 - square) * (1.0 - INDEPENDENT)
            total = ahead + INDEPENDENT
            known[lane] = ahead * INDEPENDENT / total
            gain[lane], gain[LANES + lane] = decay[lane], ahead / total
            gain[2 * LANES + lane] = 1.0 / math.sqrt(total)
            share = 1.0 - correlation[lane] * correlation[lane] if j >= points else 1.0
            product[lane] *= total * share
        _take_logs(product, constant)
        order[count] = j
        count += 1
    for lane in range(LANES):
        constant[lane] += math.log(product[lane]) + count * LOG_TWO_PI
    return count


@compiled
def _take_logs(product: Floats, logs: Floats) -> None:
    """Move products near overflow or underflow to logarithms and reset them to 1."""
    for lane in range(LANES):
        if not 1e-200 < product[lane] < 1e200:  # also true for nan
            logs[lane] += math.log(product[lane])
            product[lane] = 1.0


@compiled
def whiten(
    rows: Floats, gains: Floats, order: Indices, points: int, correlation: Floats, white: Floats
) -> None:
    """Whiten readings and their slopes by the deviations: subtract what earlier readings predict.

    Parameters
    ----------
    rows : array, shape (n_readings, 4 LANES)
        Residual, its slopes by both deviations times τ, and variance; the first three are divided
        by the standard deviation.
    gains, order
        From `filter_of`; ``order`` is cut to its count.
    points : int
        Readings of the first output.
    correlation : array, shape (LANES,)
        c of the outputs.
    white : array, shape (n_readings, 3 LANES)
        Output in the order of the filter: independent, of unit variance.

    Notes
    -----
    The Kalman filter of an Ornstein–Uhlenbeck process observed with errors.
    """
    share, last = np.empty(LANES), np.zeros(3 * LANES)
    for lane in range(LANES):
        share[lane] = 1.0 / math.sqrt(1.0 - correlation[lane] * correlation[lane])
    for i in range(len(order)):
        row, gain, out = rows[order[i]], gains[i], white[i]
        for lane in range(LANES):
            scale = 1.0 / math.sqrt(row[3 * LANES + lane])
            row[lane] *= scale
            row[LANES + lane] *= scale
            row[2 * LANES + lane] *= scale
        for k in range(3 * LANES):
            out[k] = row[k]
        if order[i] >= points:
            before = rows[order[i] - points]
            for k in range(0, 3 * LANES, LANES):
                for lane in range(LANES):
                    out[k + lane] -= correlation[lane] * before[k + lane]
                    out[k + lane] *= share[lane]
        for k in range(0, 3 * LANES, LANES):
            for lane in range(LANES):
                decayed = gain[lane] * last[k + lane]  # an output's first gap is infinite
                new = out[k + lane] - decayed
                last[k + lane] = decayed + gain[LANES + lane] * new
                out[k + lane] = new * gain[2 * LANES + lane]


@compiled
def specimen_density(
    rows: Floats,
    gains: Floats,
    order: Indices,
    points: int,
    correlation: Floats,
    constant: Floats,
    white: Floats,
    found: Floats,
) -> None:
    """Compute log densities of one specimen's readings and its most probable deviations over τ.

    Parameters
    ----------
    rows, gains, order, points, correlation, white
        As in `whiten`.
    constant : array, shape (LANES,)
        From `filter_of`.
    found : array, shape (3, LANES)
        Output.

    Notes
    -----
    The whitened readings are regressed on τ J with unit errors; the normal equations have as many
    unknowns as a specimen has deviations.
    """
    logs, product, sums = constant.copy(), np.ones(LANES), np.zeros(6 * LANES)
    for i in range(len(order)):
        variance = rows[order[i], 3 * LANES :]
        for lane in range(LANES):
            product[lane] *= variance[lane]
        _take_logs(product, logs)
    whiten(rows, gains, order, points, correlation, white)
    sums[:LANES], sums[2 * LANES : 3 * LANES] = 1.0, 1.0
    for i in range(len(order)):
        one = white[i]
        for lane in range(LANES):
            x, y, z = one[lane], one[LANES + lane], one[2 * LANES + lane]
            sums[lane] += y * y
            sums[LANES + lane] += y * z
            sums[2 * LANES + lane] += z * z
            sums[3 * LANES + lane] += x * y
            sums[4 * LANES + lane] += x * z
            sums[5 * LANES + lane] += x * x
    for lane in range(LANES):
        left, u, v = _regression(
            sums[lane], sums[LANES + lane], sums[2 * LANES + lane],
            sums[3 * LANES + lane], sums[4 * LANES + lane], sums[5 * LANES + lane],
        )  # fmt: skip
        left += logs[lane] + math.log(product[lane])
        found[0, lane], found[1, lane], found[2, lane] = -0.5 * left, u, v


@compiled
def _regression(
    g00: float, g10: float, g11: float, g20: float, g21: float, g22: float
) -> tuple[float, float, float]:
    """Return ln det plus the residual misfit, and the solution, by Cholesky factorisation.

    g₀₀, g₁₀ and g₁₁ are those of the normal matrix, g₂₀ and g₂₁ of the right-hand side, and g₂₂ is
    the sum of squares to be explained.
    """
    root = math.sqrt(g00)
    below = g10 / root
    rest = math.sqrt(g11 - below * below)
    u = g20 / root
    v = (g21 - u * below) / rest
    left = g22 - u * u - v * v
    if left < 0.0:  # rounding of an exact fit; nan stays nan
        left = 0.0
    v /= rest
    return left + 2.0 * math.log(root * rest), (u - below * v) / root, v


@compiled
def path_innovations(
    residual: Floats,
    slope: Floats,
    variance: Floats,
    spread: Floats,
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    points: int,
    score: Floats,
    log_sd: Floats,
    learnt: Floats,
) -> None:
    """Compute standardised innovations of each specimen's readings and the logs of their sds.

    Arguments as in `bayesdeg.observations.noise.Linearised`; ``score`` and ``log_sd``, both of
    shape (n, n_specimens, n_readings), are outputs; they are 0 where there is no reading. So are
    mean and variance of each specimen's first deviation given all its readings, in units of τ and
    τ²: ``learnt``, of shape (n, n_specimens, 2).

    Notes
    -----
    Whitened readings are processed sequentially: x = τ J m + e with m ~ N(0, 1) and unit
    errors.
    """
    n, n_specimens, n_readings = residual.shape
    alike, count = same_path(mask, gap), 0
    rows, white = np.empty((n_readings, 4 * LANES)), np.empty((n_readings, 3 * LANES))
    gains, order = np.empty((n_readings, 3 * LANES)), np.empty(n_readings, np.int64)
    lengths, both, constant = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    score[:], log_sd[:] = 0.0, 0.0
    for first in range(0, n, LANES):
        here = min(LANES, n - first)
        for lane in range(LANES):
            b = first + min(lane, here - 1)
            lengths[lane], both[lane] = length[b], correlation[b]
        for s in range(n_specimens):
            if not alike[s]:
                count = filter_of(lengths, both, mask[s], gap[s], points, gains, order, constant)
            rows[:, 2 * LANES : 3 * LANES] = 0.0
            for lane in range(here):
                b = first + lane
                for j in range(n_readings):
                    rows[j, lane], rows[j, 3 * LANES + lane] = residual[b, s, j], variance[b, s, j]
                    for k in range(slope.shape[3]):
                        change = slope[b, s, j, k] * math.sqrt(spread[b, s, k])
                        rows[j, (1 + k) * LANES + lane] = change
            whiten(rows, gains, order[:count], points, both, white)
            for lane in range(here):
                b, own = first + lane, white[:, lane::LANES]
                _learn(own, order[:count], score[b, s], log_sd[b, s], learnt[b, s])
                share = math.sqrt(1.0 - both[lane] * both[lane])
                for i in range(count):
                    j = order[i]
                    sd = math.sqrt(variance[b, s, j]) * (1.0 if j < points else share)
                    log_sd[b, s, j] += math.log(sd / gains[i, 2 * LANES + lane])


@compiled
def _learn(white: Floats, order: Indices, score: Floats, log_sd: Floats, learnt: Floats) -> None:
    """Compute scores and ln sd of one specimen's whitened readings (n, 3) given earlier ones.

    Mean and variance of its first deviation go to ``learnt``, in units of τ and τ².
    """
    mean, other = 0.0, 0.0
    var, cov, var_other = 1.0, 0.0, 1.0
    for i in range(len(order)):
        x, y, z = white[i, 0], white[i, 1], white[i, 2]
        p, q = var * y + cov * z, cov * y + var_other * z
        total = 1.0 + y * p + z * q
        gap = x - y * mean - z * other
        score[order[i]] = gap / math.sqrt(total)
        log_sd[order[i]] = 0.5 * math.log(total)
        mean, other = mean + p * gap / total, other + q * gap / total
        var, cov, var_other = var - p * p / total, cov - p * q / total, var_other - q * q / total
    learnt[0], learnt[1] = mean, var


@compiled
def path_grams(
    columns: Floats,
    variance: Floats,
    mask: Flags,
    gap: Floats,
    length: float,
    gram: Floats,
    log_det: Floats,
) -> None:
    """Compute products C' R⁻¹ C of columns of readings, R the covariance of one output's errors.

    Parameters
    ----------
    columns : array, shape (n_specimens, n_readings, n_columns)
        Such as residuals and their slopes.
    variance : array, shape (n_specimens, n_readings)
        v of the reading errors.
    mask, gap : array, shape (n_specimens, n_readings)
        As in `Paths`.
    length : float
        ℓ, in the unit of the gaps.
    gram : array, shape (n_specimens, n_columns, n_columns)
        Output.
    log_det : array, shape (n_specimens,)
        Output: ln det(2π R).

    Notes
    -----
    The filter is that of `filter_of` and `whiten`, for one length and any number of columns.
    """
    n_specimens, n_readings, n_columns = columns.shape
    last, white = np.empty(n_columns), np.empty(n_columns)
    step, decay = -1.0, 0.0
    gram[:] = 0.0
    for s in range(n_specimens):
        known, logs = 1.0 - INDEPENDENT, 0.0
        last[:] = 0.0
        for j in range(n_readings):
            if not mask[s, j]:
                continue
            if gap[s, j] != step:  # most steps of a path are equal
                step = gap[s, j]
                decay = math.exp(-step / length)
            square = decay * decay
            ahead = square * known + (1.0 - square) * (1.0 - INDEPENDENT)
            total = ahead + INDEPENDENT
            known, gain = ahead * INDEPENDENT / total, ahead / total
            scale, inverse = 1.0 / math.sqrt(variance[s, j]), 1.0 / math.sqrt(total)
            logs += math.log(variance[s, j] * total) + LOG_TWO_PI
            for k in range(n_columns):
                decayed = decay * last[k]
                new = columns[s, j, k] * scale - decayed
                last[k] = decayed + gain * new
                white[k] = new * inverse
                for m in range(k + 1):
                    gram[s, k, m] += white[k] * white[m]
        for k in range(n_columns):
            for m in range(k):
                gram[s, m, k] = gram[s, k, m]
        log_det[s] = logs


HELD = 300_000  # entries of covariance matrices held at a time, to fit the CPU cache


class Linearised(NamedTuple):
    """Readings linearised at the most probable deviations: all that their likelihood needs.

    Parameters
    ----------
    residual : array, shape (n, n_specimens, n_readings)
        y − f(m̂) + J m̂, the observation minus the linear model's value at m = 0.
    slope : array, shape (n, n_specimens, n_readings, n_deviations)
        J.
    variance : array, shape (n, n_specimens, n_readings)
        v.
    spread : array, shape (n, n_specimens, n_deviations)
        τ².
    length, correlation : array, shape (n,)
        ℓ, in the unit of the paths' gaps, and c.
    paths : Paths
        Paths of the readings.
    """

    residual: Floats
    slope: Floats
    variance: Floats
    spread: Floats
    length: Floats
    correlation: Floats
    paths: Paths

    def subset(self, rows: slice) -> "Linearised":
        """Return selected draws."""
        return self._replace(
            residual=self.residual[rows],
            slope=self.slope[rows],
            variance=self.variance[rows],
            spread=self.spread[rows],
            length=self.length[rows],
            correlation=self.correlation[rows],
        )


def innovations(curves: Linearised) -> tuple[Floats, Floats]:
    """Return z and ln s of each reading given earlier ones on its specimen.

    The log density of a specimen is the sum of −z²/2 − ln s − ln(2π)/2 over its readings; those of
    the second output come after all of the first.

    Returns
    -------
    score, log_sd : array, shape (n, n_recorded)
        For existing readings, specimen by specimen.
    """
    score, log_sd, _ = _innovations(curves)
    return score[:, curves.paths.mask], log_sd[:, curves.paths.mask]


def learnt_deviations(curves: Linearised) -> tuple[Floats, Floats]:
    """Return mean and variance of specimens' first deviations given readings, (n, n_specimens).

    For a specimen without readings they are 0 and τ².
    """
    learnt, spread = _innovations(curves)[2], curves.spread[..., 0]
    return np.sqrt(spread) * learnt[..., 0], spread * learnt[..., 1]


def _innovations(curves: Linearised) -> tuple[Floats, Floats, Floats]:
    """Return the outputs of `path_innovations`."""
    score, log_sd = np.empty_like(curves.residual), np.empty_like(curves.residual)
    learnt = np.empty((*curves.residual.shape[:2], 2))
    path_innovations(
        np.ascontiguousarray(curves.residual),
        np.ascontiguousarray(curves.slope),
        np.ascontiguousarray(curves.variance),
        np.ascontiguousarray(curves.spread),
        np.ascontiguousarray(curves.length),
        np.ascontiguousarray(curves.correlation),
        np.ascontiguousarray(curves.paths.mask),
        np.ascontiguousarray(curves.paths.gap),
        curves.paths.points,
        score,
        log_sd,
        learnt,
    )
    return score, log_sd, learnt


def covariance(curves: Linearised) -> Floats:
    """Return the covariance of the readings, shape (n, n_specimens, n_readings, n_readings).

    Rows and columns without a reading are those of the unit matrix.
    """
    correlation = noise_correlation(curves.paths, curves.length, curves.correlation)
    sd = np.sqrt(np.where(curves.paths.mask, curves.variance, 1.0))
    slope = np.where(curves.paths.mask[..., None], curves.slope, 0.0)
    scatter = np.einsum("nsik,nsk,nsjk->nsij", slope, curves.spread, slope)
    total: Floats = correlation * sd[..., :, None] * sd[..., None, :] + scatter
    return total


def blocks_of_covariance(curves: Linearised) -> list[Floats]:
    """Return the covariances of existing readings for one draw, specimen by specimen."""
    total, mask = covariance(curves)[0], curves.paths.mask
    return [one[np.ix_(row, row)] for one, row in zip(total, mask, strict=True)]


def noise_correlation(paths: Paths, length: Floats, correlation: Floats) -> Floats:
    """Return R, the correlation of the reading errors, (n, n_specimens, n_readings, n_readings)."""
    size = paths.mask.shape[-1]
    distance = np.abs(paths.place[:, :, None] - paths.place[:, None, :])
    output = np.arange(size) // paths.points
    same = output[:, None] == output[None, :]
    decay = np.exp(-distance / length[:, None, None, None])
    step = np.arange(size) % paths.points
    own = np.where(step[:, None] == step[None, :], 1.0, 1.0 - INDEPENDENT)
    read = paths.mask[:, :, None] & paths.mask[:, None, :]
    full: Floats = np.where(
        read, own * decay * np.where(same, 1.0, correlation[:, None, None, None]), np.eye(size)
    )
    return full


def sequential(curves: Linearised) -> Floats:
    """Return log densities of each reading given earlier ones, (n, n_specimens, n_readings).

    Readings of the second output come after all of the first. Their sum over a specimen is its
    density: the chain rule, by the Cholesky factor of the covariance.
    """
    mask = curves.paths.mask
    out = np.zeros(curves.residual.shape)
    size = max(1, HELD // (mask.size * mask.shape[1]))
    for start in range(0, len(out), size):
        rows = slice(start, start + size)
        part = curves.subset(rows)
        factor = np.linalg.cholesky(covariance(part))
        residual = np.where(mask, part.residual, 0.0)
        z = np.linalg.solve(factor, residual[..., None])[..., 0]
        scale = np.diagonal(factor, axis1=-2, axis2=-1)
        out[rows] = np.where(mask, -0.5 * (z**2 + LOG_TWO_PI) - np.log(scale), 0.0)
    return out


def correlated_normals(
    paths: Paths, length: Floats, correlation: Floats, generator: np.random.Generator
) -> Floats:
    """Draw z, shape (n, n_specimens, n_readings); independent where there is no reading."""
    shape = (len(length), *paths.mask.shape)
    common, own = generator.standard_normal((2, *shape))
    points = paths.points
    for start in range(0, shape[-1], points):
        last = np.zeros(shape[:-1])
        for j in range(start, start + points):
            decay = np.exp(-paths.gap[:, j] / length[:, None])
            common[..., j] = decay * last + np.sqrt(1.0 - decay**2) * common[..., j]
            last = np.where(paths.mask[:, j], common[..., j], last)
    z: Floats = np.sqrt(1.0 - INDEPENDENT) * common + np.sqrt(INDEPENDENT) * own
    if shape[-1] > points:
        share = correlation[:, None, None]
        first, second = z[..., :points], z[..., points:]
        z = np.concatenate([first, share * first + np.sqrt(1.0 - share**2) * second], axis=-1)
    return np.where(paths.mask, z, own)


def normal(value: Floats | float, mean: Floats, sd: Floats | float) -> Floats:
    """Return the normal log density."""
    z = (value - mean) / sd
    density: Floats = -0.5 * (z**2 + LOG_TWO_PI) - np.log(sd)
    return density


def student(value: float, mean: Floats, scale: float, dof: float) -> Floats:
    """Return the log density of Student's law; normal for infinite degrees of freedom.

    Examples
    --------
    >>> round(float(student(0.0, np.array(0.0), 1.0, 3.0)), 4)
    -1.0009
    """
    if np.isinf(dof):
        return normal(value, mean, scale)
    z = (value - mean) / scale
    gammaln = scipy.special.gammaln
    constant = gammaln(0.5 * (dof + 1.0)) - gammaln(0.5 * dof) - 0.5 * np.log(dof * np.pi)
    density: Floats = constant - np.log(scale) - 0.5 * (dof + 1.0) * np.log1p(z**2 / dof)
    return density


def event_signal(log_probability: Floats) -> Floats:
    """Return 2 arcsin √P, whose squared slope is the information from an event.

    For an event of probability P this is P'²/(P (1 − P)).

    Examples
    --------
    >>> event_signal(np.log([0.5])).round(4)  # π/2
    array([1.5708])
    """
    signal: Floats = 2.0 * np.arcsin(np.exp(np.minimum(0.5 * log_probability, 0.0)))
    return signal


def student_information(dof: float) -> float:
    """Return the square root of the expected information of a shift by one scale.

    The information is (ν + 1)/(ν + 3) for Student's law, 1 for the normal law.

    Examples
    --------
    >>> student_information(float("inf")), round(student_information(3.0), 4)
    (1.0, 0.8165)
    """
    return 1.0 if np.isinf(dof) else float(np.sqrt((dof + 1.0) / (dof + 3.0)))
