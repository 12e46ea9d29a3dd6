"""A segment with straight channels beside its axis, in one half or both, and a layer between."""

from dataclasses import asdict, dataclass, field, replace
from typing import Self

from bayesdeg.actuator.moulded import (
    Box,
    Planes,
    block_left,
    change_problems,
    constraint_record,
    line_height,
    mirrored,
    order_is_kept,
    planes_of,
    slab_of,
    volume_without,
)
from bayesdeg.actuator.status import FINE, Resolution
from bayesdeg.data.families import Constraint, CylindricalDimensions
from bayesdeg.errors import GeometryError

ALONG, ACROSS, MOST_UP = 24, 10, 30  # elements of a fine mesh in the outer sizes, about


@dataclass(frozen=True)
class CylindricalGeometry:
    """The half segment as moulded, cut at its plane of symmetry y = 0.

    The channels of the upper half are under pressure, which bends the segment downwards: towards
    the constraint layer, and the passive half below it.

    Parameters
    ----------
    dimensions : CylindricalDimensions
        As moulded [mm].
    wall_factor : float
        Thickness of the cover and of the walls between channels over the nominal one; the outer
        faces and the floor of the channels stay where they are [–].
    erosion : float
        Thickness lost from every exposed face: all outer faces but the clamped end, and the
        bottom if the constraint covers it [mm].
    constraint : Constraint
        The layer that does not stretch.

    Raises
    ------
    GeometryError
        If no segment can be made of the dimensions; the message lists every reason.

    Examples
    --------
    >>> geometry = CylindricalGeometry(CylindricalDimensions())
    >>> len(geometry.cavities), geometry.line_height
    (1, 9.8)
    """

    dimensions: CylindricalDimensions
    wall_factor: float = 1.0
    erosion: float = 0.0
    constraint: Constraint = field(default_factory=Constraint)

    def __post_init__(self) -> None:
        """Refuse impossible dimensions."""
        problems = (
            self.dimensions.problems()
            or self.constraint.problems(self.dimensions)
            or self._changed_problems()
        )
        if problems:
            raise GeometryError("; ".join(problems))

    def _changed_problems(self) -> tuple[str, ...]:
        d, w, e = self.dimensions, self.wall_factor, self.erosion
        if w == 1.0 and e == 0.0:
            return ()
        if wrong_change := change_problems(w, e):
            return wrong_change
        if order_is_kept(self.changed(wall_factor=1.0, erosion=0.0)._faces, self._faces):
            return ()
        return (
            f"a wall factor of {w:g} and {e:g} mm of erosion leave nothing of a wall or a channel "
            f"(cover {d.cover:g} mm, channels {d.channel_width:g} mm wide and "
            f"{d.channel_height:g} mm high)",
        )

    @property
    def line_height(self) -> float:
        """Height of the constraint's plane, along whose middle the curvature is read [mm]."""
        return line_height(self.constraint, self.dimensions, self.erosion)

    @property
    def outer(self) -> Box:
        """What is left of the block after erosion [mm]."""
        return block_left(self.dimensions, self.constraint, self.erosion)

    @property
    def upper(self) -> tuple[Box, ...]:
        """Boxes of air in the upper half: channels, that in the middle cut in two [mm]."""
        d = self.dimensions
        wall = d.pitch - d.channel_width if d.channels > 1 else 0.0
        reach = 0.5 * (d.channel_width - (self.wall_factor - 1.0) * wall)
        along = (d.end_wall, d.end_wall + d.channel_length)
        upward = (d.floor, d.height - self.wall_factor * d.cover)
        return tuple(
            (along, (max(0.0, middle - reach), middle + reach), upward)
            for middle in d.channel_middles
            if middle > -0.5 * d.channel_width
        )

    @property
    def lower(self) -> tuple[Box, ...]:
        """Their mirror images in the lower half; none if it has no channels [mm]."""
        d = self.dimensions
        return mirrored(self.upper, d.height) if d.is_mirrored else ()

    @property
    def cavities(self) -> tuple[Box, ...]:
        """Boxes of air under pressure [mm]."""
        return self.upper + (self.lower if self.dimensions.passive == "pressurised" else ())

    @property
    def voids(self) -> tuple[Box, ...]:
        """Boxes of air that is not under pressure [mm]."""
        return self.lower if self.dimensions.passive == "open" else ()

    @property
    def exposed(self) -> tuple[Box, ...]:
        """None: the channels of the lower half open into a tube, not to the soil."""
        return ()

    @property
    def slab(self) -> tuple[Box, ...]:
        """The box of a constraint layer of elastomer, if it is one [mm]."""
        return slab_of(self.constraint, self.dimensions, self.outer)

    @property
    def _faces(self) -> tuple[Box, ...]:
        plane = (0.0, 0.0), (0.0, 0.0), (self.line_height, self.line_height)
        return (self.outer, plane, *self.slab, *self.upper, *self.lower)

    @property
    def volume(self) -> float:
        """Volume of the material of the whole segment [mm³].

        Examples
        --------
        >>> round(CylindricalGeometry(CylindricalDimensions()).volume)
        39556
        """
        return 2.0 * volume_without(self.planes(), (*self.upper, *self.lower))

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return the mesh that is to this segment what a mesh is to the default pneunet.

        For ``FINE`` there are two elements in the height of a channel, 24 along and about seven
        across.
        """
        d = self.dimensions
        up = max(0.52 * d.channel_height, d.height / MOST_UP)
        return Resolution(
            d.length / ALONG * usual.along / FINE.along,
            d.width / ACROSS * usual.across / FINE.across,
            up * usual.up / FINE.up,
        )

    def planes(self) -> Planes:
        """Return the coordinates of all planes along x, y and z between which bricks stand [mm]."""
        return planes_of(self.outer, (*self.slab, *self.upper, *self.lower), self.line_height)

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the segment with thicker or thinner walls and faces eroded [–, mm]."""
        return replace(self, wall_factor=wall_factor, erosion=erosion)

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as it is written and hashed."""
        layer = constraint_record(self.constraint, self.dimensions)
        return asdict(self) | {"kind": self.dimensions.kind, "constraint": layer}
