"""A round section, bent from a block of bricks: an unchanged core and a ring around it."""

from dataclasses import dataclass
from math import atan2, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.families import CylindricalDimensions

Floats = NDArray[np.float64]

# the core reaches half way to the outline, and at most three quarters unless channels reach
# further; around them it leaves room for changed walls
HALF_WAY, FARTHEST, ROOM_OVER, ROOM_BESIDE = 0.5, 0.75, 0.3, 0.1


class Core(NamedTuple):
    """Half width and half height of the core, a rectangle that holds all channels [mm]."""

    across: float
    up: float


def core_of(d: CylindricalDimensions) -> Core:
    """Return the core of a round section whose channels lie inside the ellipse.

    Examples
    --------
    >>> core = core_of(CylindricalDimensions(section="round"))
    >>> core.across > 1.4, core.up > 4.9 + 1.4
    (True, True)
    >>> hypot(core.across / 16.75, core.up / 9.8) < 1.0
    True
    """
    a, b = 0.5 * d.width, 0.5 * d.height
    first = (
        (d.channel_middles[-1] + 0.5 * d.channel_width) / a,
        (d.offset + 0.5 * d.channel_height) / b,
    )
    least = hypot(*first)
    most = max(FARTHEST, 0.5 * (1.0 + least))
    far = tuple(
        max(HALF_WAY, x + room * (1.0 - x))
        for x, room in zip(first, (ROOM_BESIDE, ROOM_OVER), strict=True)
    )
    step = far[0] - first[0], far[1] - first[1]
    # |first + t step| = most
    square = step[0] ** 2 + step[1] ** 2
    along = first[0] * step[0] + first[1] * step[1]
    t = min(1.0, (sqrt(along**2 + square * (most**2 - least**2)) - along) / square)
    return Core(a * (first[0] + t * step[0]), b * (first[1] + t * step[1]))


@dataclass(frozen=True)
class RoundSection:
    """An ellipse bent from a rectangle twice as large as its core.

    In the rectangle the ring lies between the core and its image at twice the distance from the
    axis. A ray through the axis crosses the core's edge at P and the outer edge at 2 P; the segment
    between them maps linearly to the line from P to a point of the ellipse.

    Parameters
    ----------
    half_width, half_height : float
        Of the ellipse [mm].
    core : Core
        The unchanged core.
    axis : float
        Height of the axis above the bottom of the mould [mm].
    levels : tuple of float
        Heights above the axis of planes that stay plane, increasing, within the core [mm].

    Examples
    --------
    >>> circle = RoundSection(2.0, 2.0, Core(1.0, 1.0), axis=2.0, levels=(0.0,))
    >>> circle.bent(np.array([[0.0, 2.0, 2.0], [0.0, 2.0, 4.0], [0.0, 0.5, 2.5]])).round(6).tolist()
    [[0.0, 2.0, 2.0], [0.0, 1.414214, 3.414214], [0.0, 0.5, 2.5]]
    """

    half_width: float
    half_height: float
    core: Core
    axis: float
    levels: tuple[float, ...] = ()

    @property
    def holds_core(self) -> bool:
        """Whether the core lies inside the ellipse."""
        a, b = self.half_width, self.half_height
        return min(a, b) > 0.0 and hypot(self.core.across / a, self.core.up / b) < 1.0

    @property
    def area(self) -> float:
        """Area of the whole ellipse [mm²]."""
        return pi * self.half_width * self.half_height

    def holds(self, y: Floats, z: Floats) -> NDArray[np.bool_]:
        """Return whether places across and heights lie inside the ellipse [mm]."""
        inside: NDArray[np.bool_] = (y / self.half_width) ** 2 + (
            (z - self.axis) / self.half_height
        ) ** 2 < 1.0
        return inside

    def bent(self, nodes: Floats) -> Floats:
        """Map nodes of the rectangle to the section, (n, 3) [mm]."""
        y, z = nodes[:, 1], nodes[:, 2] - self.axis
        size = np.maximum(y / self.core.across, np.abs(z) / self.core.up)
        ring = size > 1.0
        edge_y, edge_z = y[ring] / size[ring], z[ring] / size[ring]
        # the ellipse's parameter of points of the core's edge [rad]
        corner = atan2(self.core.up / self.half_height, self.core.across / self.half_width)
        at = np.array([-self.core.up, *self.levels, self.core.up])
        levels = (np.arcsin(level / self.half_height) for level in self.levels)
        beside = np.interp(edge_z, at, np.array([-corner, *levels, corner]))
        turned = 0.5 * pi - (0.5 * pi - corner) * edge_y / self.core.across
        is_over = np.abs(edge_z) / self.core.up > edge_y / self.core.across
        angle = np.where(is_over, np.sign(edge_z) * turned, beside)
        share = size[ring] - 1.0
        out = nodes.copy()
        outer_y = self.half_width * np.sin(0.5 * pi - np.abs(angle))
        outer_z = self.half_height * np.sin(angle)
        out[ring, 1] = (1.0 - share) * edge_y + share * np.where(edge_y > 0.0, outer_y, 0.0)
        out[ring, 2] = self.axis + (1.0 - share) * edge_z + share * outer_z
        return out

    def depth(self, points: Floats) -> Floats:
        """Return the distance of points (…, 3) from the outline, to first order [mm].

        d = (1 − q)/|∇q| with q = (y/a)² + (z/b)²; deep inside it is too large.
        """
        y, z = points[..., 1] / self.half_width, (points[..., 2] - self.axis) / self.half_height
        slope = 2.0 * np.hypot(y / self.half_width, z / self.half_height)
        with np.errstate(divide="ignore"):
            distance: Floats = (1.0 - y * y - z * z) / slope
        return distance
