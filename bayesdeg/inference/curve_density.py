"""The inner loop of the actuators' likelihood: from predictions to densities in one pass."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.compiled import compiled
from bayesdeg.inference.path_density import filter_of, same_path, specimen_density

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Curves(NamedTuple):
    """What a forward map with its causes predicts of actuators, (n, n_specimens, n_points).

    Parameters
    ----------
    curvature, slope, curvature_sd : array
        With causes [1/m]; the slope is p ∂κ/∂p.
    angle, angle_sd : array
        With causes [°]; not read where no angle was read.
    unread_curvature, unread_slope : array
        Before causes that act on the reading [1/m]; not read where no angle was read.
    """

    curvature: Floats
    slope: Floats
    curvature_sd: Floats
    angle: Floats
    angle_sd: Floats
    unread_curvature: Floats
    unread_slope: Floats


@compiled
def curve_density(
    readings: Floats,
    reading_sd: Floats,
    curves: Curves,
    noise: Floats,
    mode: Floats,
    spread: Floats,
    length: Floats,
    correlation: Floats,
    mask: Flags,
    gap: Floats,
    density: Floats,
    deviation: Floats,
) -> None:
    """Write the log density of each specimen's readings and its most probable deviation.

    Parameters
    ----------
    readings : array, shape (n_specimens, n_readings)
        Curvatures [1/m], then angles [°] if they were read.
    reading_sd : array, shape (n_specimens, n_points)
        Standard error of each curvature by itself [1/m].
    curves : Curves
        At the deviations ``mode``.
    noise : array, shape (n, 4)
        Constant and proportional reading error of curvature [1/m], [–] and of angle [°], [–].
    mode, spread : array, shape (n, n_specimens)
        Deviation of ln stiffness at which the curves are, and its variance τ².
    length, correlation : array, shape (n,)
        As `bayesdeg.inference.likelihood.Linearised`.
    mask, gap : array, shape (n_specimens, n_readings)
        As `bayesdeg.inference.likelihood.Paths`.
    density, deviation : array, shape (n, n_specimens)
        Written.
    """
    n, n_specimens, points = curves.curvature.shape
    n_readings = mask.shape[1]
    alike = same_path(mask, gap)
    gains, order = np.empty((3, n_readings)), np.empty(n_readings, np.int64)
    scales, first = np.empty(n_readings), np.empty((points, 3))
    residual, slope = np.empty(n_readings), np.empty((n_readings, 1))
    variance = np.empty(n_readings)
    for b in range(n):
        count, constant = 0, 0.0
        for s in range(n_specimens):
            if not alike[s]:
                count, constant = filter_of(
                    length[b], correlation[b], mask[s], gap[s], points, gains, order
                )
            _curvatures(
                readings[s], reading_sd[s], curves.curvature[b, s], curves.slope[b, s],
                curves.curvature_sd[b, s], noise[b], mode[b, s], residual, slope, variance,
            )  # fmt: skip
            if n_readings > points:
                _angles(
                    readings[s], curves.angle[b, s], curves.angle_sd[b, s],
                    curves.unread_curvature[b, s], curves.unread_slope[b, s], noise[b],
                    mode[b, s], residual, slope, variance,
                )  # fmt: skip
            density[b, s], deviation[b, s], _ = specimen_density(
                residual, slope, variance, (math.sqrt(spread[b, s]), 0.0), correlation[b],
                constant, gains, order[:count], scales, first,
            )  # fmt: skip


@compiled
def _curvatures(
    readings: Floats,
    reading_sd: Floats,
    curvature: Floats,
    growth: Floats,
    sd: Floats,
    noise: Floats,
    mode: float,
    residual: Floats,
    slope: Floats,
    variance: Floats,
) -> None:
    """Linearise the curvatures of one specimen about its deviation."""
    for j in range(len(curvature)):
        error = noise[1] * curvature[j]
        slope[j, 0] = -growth[j]
        residual[j] = readings[j] - curvature[j] - growth[j] * mode
        variance[j] = noise[0] * noise[0] + error * error + sd[j] * sd[j]
        variance[j] += reading_sd[j] * reading_sd[j]


@compiled
def _angles(
    readings: Floats,
    angle: Floats,
    sd: Floats,
    curvature: Floats,
    growth: Floats,
    noise: Floats,
    mode: float,
    residual: Floats,
    slope: Floats,
    variance: Floats,
) -> None:
    """Linearise the bend angles of one specimen, which grow as the curvature does."""
    points = len(angle)
    for j in range(points):
        relative = growth[j] / (math.inf if curvature[j] == 0.0 else curvature[j])
        error = noise[3] * angle[j]
        slope[points + j, 0] = -angle[j] * relative
        residual[points + j] = readings[points + j] - angle[j] + slope[points + j, 0] * mode
        variance[points + j] = noise[2] * noise[2] + error * error + sd[j] * sd[j]
