"""Describe an actuator in words and characters, for a terminal, before solving anything."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.families import PartGeometry
from bayesdeg.actuator.moulded import Box, Moulded, volume_without
from bayesdeg.data.part import cavity_of

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

MATERIAL, PRESSED, OPEN, LAYER, OUTSIDE = "#", " ", "o", "=", "-"
COLUMNS, ACROSS = 76, 40
CELL = 2.0  # height over width of a character
ON_FACE = 1e-9  # share of a tetrahedron's size: points on its faces count as inside


def air_volume(geometry: Moulded) -> float:
    """Return the volume of the cavities under pressure of the whole actuator [mm³].

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(air_volume(geometry_of(Dimensions())), 6)
    924.0
    """
    if isinstance(geometry, PartGeometry):
        part = geometry.part
        return cavity_of(part)[0] * (2.0 if part.is_half else 1.0)
    planes = geometry.planes()
    return 2.0 * (volume_without(planes, ()) - volume_without(planes, geometry.cavities))


def described(geometry: Moulded) -> str:
    """Describe an actuator: family, dimensions, layer and volumes.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> described(geometry_of(RibbedDimensions())).partition(", width")[0]
    'ribbed actuator as moulded [mm]: length 37.8'
    """
    mould, layer = geometry.dimensions, geometry.constraint
    shown = vars(mould).items()
    hidden = ("path", "content", "bending")
    sizes = ", ".join(f"{name} {value}" for name, value in shown if name not in hidden)
    at = f"{layer.kind} at a height of {geometry.line_height:g}" if layer.is_there else "none"
    if layer.is_slab:
        c1, c2, c3 = layer.c1, layer.c2, layer.c3
        at += f", {layer.thickness:g} thick, C1 {c1:g}, C2 {c2:g}, C3 {c3:g} kPa"
    return (
        f"{mould.kind} actuator as moulded [mm]: {sizes}; constraint layer: {at}; "
        f"material {1e-3 * geometry.volume:.4g} ml, cavity {1e-3 * air_volume(geometry):.3g} ml"
    )


def section(geometry: Moulded, columns: int = COLUMNS) -> str:
    """Draw the section along the middle of an actuator, the clamped end on the left.

    Material is ``#``, air under pressure blank, other air ``o``, the constraint layer ``=``; for a
    meshed part all air is blank. There are ``columns`` characters for the length.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.settings import Dimensions
    >>> print(section(geometry_of(Dimensions(length=20.0, chambers=2)), 40))
    ##################oooo##################
    ##################oooo##################
    ######         ###oooo###         ######
    ######         ###oooo###         ######
    ######         ###oooo###         ######
    ######         ##########         ######
    ######         ##########         ######
    ######                            ######
    ########################################
    ########################################
    ========================================
    """
    if isinstance(geometry, PartGeometry):
        return _of_cells(geometry, columns)
    (_, length), _, (bottom, top) = geometry.outer
    x, z = _grid(length, bottom, top, columns)
    drawn = np.full((len(z), columns), MATERIAL)
    for boxes, mark in _marked(geometry):
        for along, _, upward in boxes:
            drawn[np.ix_(_within(upward, z), _within(along, x))] = mark
    has_line = geometry.constraint.is_there and LAYER not in drawn
    return _joined(drawn, z, geometry.line_height if has_line else None)


def _of_cells(geometry: PartGeometry, columns: int) -> str:
    """Draw the cells of a part cut by its middle plane, or touching it.

    A character is material if it lies in the bounding rectangle of a brick's section, or in a
    tetrahedron.
    """
    part = geometry.part
    corners = part.points[part.cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 1e-3 * float(part.size[1])  # slightly off the plane, as faces may lie in it
    cut = (low[:, 1] <= middle) & (high[:, 1] >= middle)
    x, z = _grid(float(part.size[0]), 0.0, float(part.size[2]), columns)
    drawn = np.full((len(z), columns), PRESSED)
    for own, a, b in zip(corners[cut], low[cut], high[cut], strict=True):
        there = np.ix_((a[2] <= z) & (z <= b[2]), (a[0] <= x) & (x <= b[0]))
        within = _in_tetrahedron(own, x[there[1]], middle, z[there[0]]) if len(own) == 4 else True
        drawn[there] = np.where(within, MATERIAL, drawn[there])
    return _joined(drawn, z, geometry.line_height if geometry.constraint.is_there else None)


def _in_tetrahedron(corners: Floats, x: Floats, y: float, z: Floats) -> Bools:
    """Return which points lie in a tetrahedron: no barycentric coordinate is negative."""
    at = np.stack(np.broadcast_arrays(x, y, z), axis=-1) - corners[0]
    shares = at @ np.linalg.inv(corners[1:] - corners[0])
    inside: Bools = np.all(shares > -ON_FACE, axis=-1) & (shares.sum(axis=-1) < 1.0 + ON_FACE)
    return inside


def across(geometry: Moulded, columns: int = ACROSS) -> str:
    """Draw the section across the middle of an actuator's length, seen along it.

    Like `section`; the outside of a round outline is ``-``. There are ``columns`` characters for
    the width.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import CylindricalDimensions
    >>> print(across(geometry_of(CylindricalDimensions(section="round")), 24))
    ------############------
    --#########  #########--
    -######################-
    ========================
    ########################
    -######################-
    --#########oo#########--
    ------############------
    """
    (_, length), (_, half), (bottom, top) = geometry.outer
    _, z = _grid(2.0 * half, bottom, top, columns)
    y = half * (2.0 * (np.arange(columns) + 0.5) / columns - 1.0)
    drawn = np.full((len(z), columns), MATERIAL)
    for boxes, mark in _marked(geometry):
        for (first, last), beside, upward in boxes:
            if first < 0.5 * length < last:
                drawn[np.ix_(_within(upward, z), _within(beside, np.abs(y)))] = mark
    if geometry.rounded is not None:
        inside = geometry.rounded.holds(y[None, :], z[:, None])
        drawn = np.where(inside, drawn, OUTSIDE)
    return _joined(drawn, z, geometry.line_height if geometry.constraint.is_membrane else None)


def _grid(length: float, bottom: float, top: float, columns: int) -> tuple[Floats, Floats]:
    """Return places along a length and heights, from the top down, of the characters."""
    rows = max(2, round((top - bottom) / length * columns / CELL))
    x = length * (np.arange(columns) + 0.5) / columns
    return x, top - (top - bottom) * (np.arange(rows) + 0.5) / rows


def _marked(geometry: Moulded) -> tuple[tuple[tuple[Box, ...], str], ...]:
    return (geometry.voids, OPEN), (geometry.cavities, PRESSED), (geometry.slab, LAYER)


def _within(ends: tuple[float, float], places: Floats) -> Bools:
    inside: Bools = (ends[0] < places) & (places < ends[1])
    return inside


def _joined(drawn: NDArray[np.str_], z: Floats, line: float | None) -> str:
    """Join the rows, with a line for a layer at a height."""
    lines = ["".join(row) for row in drawn]
    if line is not None:
        lines.insert(int(np.sum(z > line)), LAYER * drawn.shape[1])
    return "\n".join(lines)
