"""The compiled pass along a path, for readings that are linearised already."""

import numpy as np

from bayesdeg.observations.noise import filter_of, specimen_density


def density_and_mode(curves):
    """Return the log density of each specimen's readings with m integrated out, and m̂."""
    mask, gap, _, points = curves.paths
    n, n_specimens, n_deviations = curves.spread.shape
    density, deviation = np.empty((n, n_specimens)), np.empty((n, n_specimens, 2))
    gains, order = np.empty((3, mask.shape[1])), np.empty(mask.shape[1], np.int64)
    scales, first = np.empty(mask.shape[1]), np.empty((points, 3))
    for b, s in np.ndindex(n, n_specimens):
        path = (float(curves.length[b]), float(curves.correlation[b]), mask[s].copy())
        count, constant = filter_of(*path, gap[s].copy(), points, gains, order)
        widths = np.zeros(2)
        widths[:n_deviations] = np.sqrt(curves.spread[b, s])
        arrays = (part[b, s].copy() for part in (curves.residual, curves.slope, curves.variance))
        density[b, s], *deviation[b, s] = specimen_density(
            *arrays, (widths[0], widths[1]), path[1], constant, gains, order[:count], scales, first
        )
    return density, deviation[..., :n_deviations]
