"""The second surrogate as a forward map: the load over the bending, inverted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from fine_library_data import AT_REST, LENGTH, SMALL_STRAIN, UNITS, coordinates
from fine_library_layers import Layer
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from bayesdeg.actuator.inputs import Inputs, Prediction, relative_to_reference
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.coordinates import SLACK
from bayesdeg.surrogate.scaling import GROUPS, LOAD, groups_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# bendings at which curves are tabulated: dense at the start, where slack paper tightens
LARGEST_BENDING = 2.6
TABLE = LARGEST_BENDING * np.linspace(0.0, 1.0, 64) ** 2
STEEPEST = 2.75  # d ln k/d ln q, beyond which the actuator is about to balloon
FARTHEST = 0.5  # distance from what was solved, in lengths; curves left out were up to 0.35
ROOM = 0.15  # beyond the range of what was solved, over that range
LARGEST_SLACK_AND_MISMATCH = (
    0.05  # units of slack, and of what strains its paper at rest, that may go together
)
NEUTRAL = {group.name: group.neutral for group in GROUPS}


@dataclass(frozen=True)
class Library:
    """What was solved and fitted, as far as it is needed to predict.

    Parameters
    ----------
    bending : Layer
        h and ln(bend angle/k).
    stretch : Layer
        ln(peak strain + ``SMALL_STRAIN``).
    lower, upper : array, shape (13,)
        Range of the coordinates of what was solved.
    errors : array, shape (3,)
        Relative standard errors of curvature and bend angle, and that of the peak stretch.
    """

    bending: Layer
    stretch: Layer
    lower: Floats
    upper: Floats
    errors: Floats


def predicted(library: Library, rows: Floats, loads: Sequence[Floats]) -> list[Floats]:
    """Return bending k, bend angle [rad], peak strain, growth and distance at loads p/M.

    The load is tabulated over the bending and inverted, as far as the curve is not too steep.

    Parameters
    ----------
    library : Library
    rows : array, shape (m, 13)
        Coordinates; the first is not read.
    loads : sequence of m arrays, shape (n,)
        p/M [–].

    Returns
    -------
    list of m arrays, shape (5, n)
        nan where the load is beyond the curve's end.
    """
    value, slope = library.bending.along(rows, TABLE / UNITS[0])
    strain, strain_slope = library.stretch.along(rows, TABLE / UNITS[0])
    distance = library.bending.distance(rows, TABLE / UNITS[0])
    with np.errstate(divide="ignore"):
        growth = 1.0 / (1.0 + TABLE * slope[..., 0] / UNITS[0])
    found = []
    for m, load in enumerate(loads):
        k = _inverted(load, value[m, :, 0], growth[m])
        ratio, strained = (
            CubicHermiteSpline(TABLE, y, by / UNITS[0])(k)
            for y, by in (
                (value[m, :, 1], slope[m, :, 1]),
                (strain[m, :, 0], strain_slope[m, :, 0]),
            )
        )
        outputs = [k, k * np.exp(ratio), np.exp(strained) - SMALL_STRAIN]
        others = [np.interp(k, TABLE, column[m]) for column in (growth, distance)]
        found.append(np.stack([*outputs, *others]))
    return found


def _inverted(load: Floats, h: Floats, growth: Floats) -> Floats:
    """Return k at loads from h and growth at the bendings of the table; nan beyond the end."""
    q = TABLE * np.exp(h)
    rising = (growth > 0.0) & (growth < 1.5 * STEEPEST) & (np.diff(q, prepend=-1.0) > 0.0)
    end = len(q) if rising.all() else int(np.argmin(rising))
    if end < 2:
        return np.full(len(load), np.nan)
    by_load = growth[:end] * np.exp(-h[:end])
    k: Floats = CubicHermiteSpline(q[:end], TABLE[:end], by_load, extrapolate=False)(load)
    return k


class FineLibrary:
    """The finer mesh's curvature, bend angle and peak stretch as a forward map."""

    def __init__(self, library: Library) -> None:
        self.library = library

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction; refused where it is too far from what was solved."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        at = groups_of(inputs)
        columns = [at[LOAD], *(at.get(name, np.full((), value)) for name, value in NEUTRAL.items())]
        shape = np.broadcast_shapes(*(column.shape for column in columns))
        flat = np.stack([np.broadcast_to(column, shape).ravel() for column in columns], axis=1)
        found = np.full((5, len(flat)), np.nan)
        known = np.isfinite(flat).all(axis=1)
        found[:, known] = self._at(flat[known, 0], flat[known, 1:])
        k, angle, strain, growth, distance = found.reshape(5, *shape)
        with np.errstate(invalid="ignore"):
            answered = (growth < STEEPEST) & (distance < FARTHEST) & np.isfinite(k)
        size = LENGTH * np.broadcast_to(inputs.linear_scale, shape)
        curvature = np.where(answered, k / size * 1e3, np.nan)
        bend_angle = np.where(answered, np.degrees(angle), np.nan)
        stretch = np.where(answered, 1.0 + strain, np.nan)
        errors = self.library.errors
        return Prediction(
            curvature=curvature,
            bend_angle=bend_angle,
            peak_stretch=stretch,
            slope=curvature * growth,
            sd=errors[0] * curvature,
            bend_angle_sd=errors[1] * bend_angle,
            peak_stretch_sd=errors[2] * stretch,
            status=np.where(answered, 0, int(Status.OUTSIDE_TRAINING)),
        )

    def _at(self, load: Floats, groups: Floats) -> Floats:
        """Return what ``predicted`` says at loads (n,) and groups (n, 12): each row once."""
        rows, where = np.unique(groups, axis=0, return_inverse=True)
        places = coordinates(np.zeros(len(rows)), rows)
        chosen = [np.flatnonzero(where == m) for m in range(len(rows))]
        out = np.full((5, len(load)), np.nan)
        found = predicted(self.library, places, [load[of] for of in chosen])
        for of, values in zip(chosen, found, strict=True):
            out[:, of] = values
        out[:, ~_within(self.library, places)[where]] = np.nan
        return out


def _within(library: Library, places: Floats) -> Flags:
    """Return whether materials and causes are in the range of what was solved."""
    room = ROOM * (library.upper - library.lower)
    inside = (places >= library.lower - room) & (places <= library.upper + room)
    at_rest = np.abs(places[:, AT_REST]) > LARGEST_SLACK_AND_MISMATCH
    corner = (places[:, SLACK] > LARGEST_SLACK_AND_MISMATCH) & at_rest.any(axis=1)
    return inside[:, 1:].all(axis=1) & ~corner & (places[:, SLACK] >= 0.0)
