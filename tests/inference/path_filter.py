"""The compiled pass along a path, for readings that are linearised already."""

import numpy as np

from bayesdeg.observations.noise import LANES, filter_of, specimen_density


def density_and_mode(curves):
    """Return the log density of each specimen's readings with m integrated out, and m̂."""
    mask, gap, _, points = curves.paths
    n, n_specimens, n_deviations = curves.spread.shape
    density, deviation = np.empty((n, n_specimens)), np.empty((n, n_specimens, 2))
    size = mask.shape[1]
    gains, order, constant = np.empty((size, 3 * LANES)), np.empty(size, np.int64), np.empty(LANES)
    white, found = np.empty((size, 3 * LANES)), np.empty((3, LANES))
    for b, s in np.ndindex(n, n_specimens):
        length, correlation = (np.full(LANES, v[b]) for v in (curves.length, curves.correlation))
        path = (mask[s].copy(), gap[s].copy(), points)
        count = filter_of(length, correlation, *path, gains, order, constant)
        widths = np.zeros(2)
        widths[:n_deviations] = np.sqrt(curves.spread[b, s])
        rows = np.zeros((size, 4))
        rows[:, 0], rows[:, 3] = curves.residual[b, s], curves.variance[b, s]
        rows[:, 1 : 1 + n_deviations] = curves.slope[b, s] * widths[:n_deviations]
        lanes = np.repeat(rows, LANES, axis=1)
        specimen_density(lanes, gains, order[:count], points, correlation, constant, white, found)
        density[b, s], *deviation[b, s] = found[:, LANES - 1] * [1.0, *widths]
    return density, deviation[..., :n_deviations]
