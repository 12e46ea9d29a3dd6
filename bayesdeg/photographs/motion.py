r"""Markers in space, as motion capture sees them, become a line of points in the plane of bending.

Frames of a hold are averaged. With s the standard deviation of a coordinate over n frames and τ its
integrated autocorrelation time in frames, the mean has the standard error

.. math:: \sigma = s \sqrt{\tau / n}, \qquad \tau = 1 + 2 \sum_{k=1}^{M} \rho_k,

with M the first lag of at least 5 τ (Sokal 1997, doi:10.1007/978-1-4899-0319-8_6): frames are not
independent, since programs smooth what cameras see, and gel creeps while it is held.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Floats = NDArray[np.float64]

#: Frames below which their autocorrelation cannot be told: then the mean is no better than one.
FEW_FRAMES = 10
WINDOW = 5.0  # autocorrelation times, after Sokal
#: Bending leaves the straight line by so many times what leaves the plane, or there is none.
BENT = 3.0


@dataclass(frozen=True)
class BendingPlane:
    """The plane in which an actuator bends.

    Parameters
    ----------
    middle : array, shape (3,)
        A point of it [mm].
    axes : array, shape (2, 3)
        Its two directions: along the actuator, and away from the paper.
    off : float
        Root mean square distance of markers from it [mm].
    """

    middle: Floats
    axes: Floats
    off: float

    def placed(self, points: Floats) -> Floats:
        """Return points in its two directions, (..., 2) [mm]."""
        found: Floats = (points - self.middle) @ self.axes.T
        return found


def stated_plane(along: str, away: str, points: Floats) -> BendingPlane:
    """Return the plane of two axes of the laboratory.

    Parameters
    ----------
    along, away : str
        ``x``, ``-x`` and so on: along the clamped end towards the tip, and away from the paper.
    points : array, shape (n, 3)
        Of markers [mm].

    Examples
    --------
    >>> stated_plane("-z", "x", np.zeros((1, 3))).placed(np.array([3.0, 5.0, -40.0])).tolist()
    [40.0, 3.0]
    """
    axes = np.array([_axis(along), _axis(away)])
    normal = np.cross(*axes)
    distance = (points - points.mean(axis=0)) @ normal
    return BendingPlane(np.zeros(3), axes, float(np.sqrt(np.mean(distance**2))))


def _axis(name: str) -> Floats:
    found = np.zeros(3)
    found["xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return found


def fitted_plane(lines: list[Floats]) -> BendingPlane | None:
    """Return the plane in which lines bend; None if they are too straight to have one.

    Parameters
    ----------
    lines : list of array, shape (n_points, 3)
        Of one actuator from the clamp to the tip, the one that is bent most last [mm]. It bends
        towards the paper.

    Examples
    --------
    >>> at = np.linspace(0.0, 1.0, 8)
    >>> bent = [40.0 / k * np.column_stack([np.sin(k * at), 0.0 * at, np.cos(k * at)])
    ...         for k in (0.2, 0.7)]
    >>> plane = fitted_plane(bent)
    >>> round(plane.off, 9), bool(plane.placed(bent[1][-1] - bent[1][0])[1] < 0.0)
    (0.0, True)
    >>> fitted_plane([np.outer(at, [40.0, 1.0, 0.0])]) is None
    True
    """
    points = np.concatenate([line - line[0] for line in lines])
    middle = lines[-1][0]
    _, spread, axes = np.linalg.svd(points, full_matrices=False)
    rounding = 1e-9 * spread[0]
    if spread[1] <= BENT * max(spread[2], rounding):
        return None
    along, away = axes[:2]
    last = lines[-1]
    if along @ (last[-1] - last[0]) < 0.0:
        along = -along
    plane = BendingPlane(middle, np.array([along, away]), float(spread[2] / np.sqrt(len(points))))
    if _turned(plane.placed(last)) > 0.0:
        plane = BendingPlane(middle, np.array([along, -away]), plane.off)
    return plane


def _turned(line: Floats) -> float:
    """Return by how much a line turns from its first to its last step, to the left [rad]."""
    steps = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(heading[-1] - heading[0])


def error_of_mean(values: Floats) -> Floats:
    """Return the standard error of the mean of frames, (n_series,); 0 of one frame.

    Parameters
    ----------
    values : array, shape (n_frames, n_series)

    Examples
    --------
    Of 400 frames, and of as many that are each there four times:

    >>> noise = np.random.default_rng(1).normal(size=(400, 100))
    >>> [float(error_of_mean(one).mean().round(3)) for one in (noise, np.repeat(noise, 4, axis=0))]
    [0.052, 0.051]
    """
    count = len(values)
    if count < 2:
        return np.zeros(values.shape[1])
    spread = np.std(values, axis=0, ddof=1)
    if count < FEW_FRAMES:
        return np.asarray(spread)
    share = np.array([_correlation_time(series) for series in values.T]) / count
    return np.asarray(spread * np.sqrt(np.minimum(share, 1.0)))


def _correlation_time(series: Floats) -> float:
    """Return the integrated autocorrelation time in frames, at least 1."""
    centred = series - series.mean()
    if not np.any(np.abs(centred) > 1e-12 * np.abs(series).max()):
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * len(series))
    rho = np.fft.irfft(np.abs(spectrum) ** 2)[: len(series)]
    times = 2.0 * np.cumsum(rho / rho[0]) - 1.0
    enough = np.arange(len(times)) >= WINDOW * times
    return max(1.0, float(times[np.argmax(enough) if enough.any() else -1]))


def shifted(line: Floats, distance: float) -> Floats:
    """Return a line moved away from the paper, at right angles to itself, (n, 2) [mm].

    Centres of markers that sit on the paper are a distance below the bottom line.

    Examples
    --------
    >>> shifted(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), 0.5)[:, 1].tolist()
    [0.5, 0.5, 0.5, 0.5]
    """
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    ahead = CubicSpline(arc, line)(arc, 1)
    ahead /= np.hypot(*ahead.T)[:, None]
    found: Floats = line + distance * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return found
