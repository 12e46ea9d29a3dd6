"""Families of actuators: from dimensions to geometry, and back from a record.

The geometry of a meshed part is here; its cells are created in `bayesdeg.actuator.mesh`, when it is
solved.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.moulded import Box, Moulded, Planes, order_is_kept
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, Kind, MeshDimensions, Mould
from bayesdeg.data.part import PartMesh, read_part, volume_of
from bayesdeg.data.settings import MOULDS, Settings
from bayesdeg.errors import GeometryError


@dataclass(frozen=True)
class PartGeometry(Moulded):
    """A meshed part as moulded: it has a single mesh at any requested resolution.

    Its walls are unknown, so wall factor and erosion must be neutral. Its layer, which cannot be an
    elastomer, is on the boundary named constraint. Its air is not boxes, and its outline is that of
    the mesh.

    Raises
    ------
    GeometryError
        If walls are changed, or the mesh file differs from what was read.
    """

    dimensions: MeshDimensions
    wall_factor: float = 1.0
    erosion: float = 0.0
    constraint: Constraint = field(default_factory=Constraint)
    cavities: ClassVar[tuple[Box, ...]] = ()
    voids: ClassVar[tuple[Box, ...]] = ()
    slab: ClassVar[tuple[Box, ...]] = ()
    is_boxes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse changes of walls."""
        if self.wall_factor != 1.0 or self.erosion != 0.0:
            raise GeometryError("walls of a meshed part are unknown, so they cannot be changed")

    @property
    def part(self) -> PartMesh:
        """Content of the file."""
        part = read_part(self.dimensions.path)
        if part.content != self.dimensions.content:
            raise GeometryError(f"{self.dimensions.file} has changed since it was read")
        return part

    @property
    def line_height(self) -> float:
        """Height of the constraint's plane, or of the bottom [mm]."""
        return self.dimensions.plane

    @property
    def outer(self) -> Box:
        """Bounding block of half the part [mm]."""
        d = self.dimensions
        return (0.0, d.length), (0.0, 0.5 * d.width), (0.0, d.height)

    @property
    def volume(self) -> float:
        """Volume of the material of the whole part [mm³]."""
        return volume_of(self.part) * (2.0 if self.part.is_half else 1.0)

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return the resolution unchanged; it has no effect."""
        return usual

    def planes(self) -> Planes:
        """Return the planes of its bounding block [mm]."""
        x, y, z = (np.array(ends) for ends in self.outer)
        return x, y, z

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the part itself if nothing changes."""
        return replace(self, wall_factor=wall_factor, erosion=erosion)

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on: the mesh by its content, not its path."""
        sizes = asdict(self.dimensions)
        del sizes["path"], sizes["file"], sizes["mesh_error"], sizes["cells"]
        return {"kind": "mesh", "dimensions": sizes, "constraint": self.constraint_record}


GEOMETRIES: Mapping[Kind, Callable[..., Moulded]] = {
    "pneunet": Geometry,
    "ribbed": SegmentGeometry,
    "cylindrical": SegmentGeometry,
    "mesh": PartGeometry,
}
"""Each is built from the family's dimensions, a wall factor, an erosion and a constraint."""


def geometry_of(dimensions: Mould, constraint: Constraint | None = None) -> Moulded:
    """Return the geometry of an actuator as moulded.

    Parameters
    ----------
    dimensions : Mould
        Dimensions of any family, such as ``Dimensions`` or ``CylindricalDimensions``.
    constraint : Constraint, optional
        By default paper in the usual place.

    Raises
    ------
    GeometryError
        If no actuator can have these dimensions.

    Examples
    --------
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> type(geometry_of(RibbedDimensions())).__name__
    'SegmentGeometry'
    """
    return GEOMETRIES[dimensions.kind](dimensions, constraint=constraint or Constraint())


def geometry_of_study(settings: Settings) -> Moulded:
    """Return the geometry of the actuators of a study, uncertain dimensions at their medians.

    Raises
    ------
    GeometryError
        If faces coincide within the range of an uncertain dimension, so that no mesh can be moved
        with it.

    Examples
    --------
    >>> geometry_of_study(Settings()).dimensions.kind
    'pneunet'
    """
    geometry = geometry_of(settings.dimensions, settings.layer)
    for one in settings.uncertain:
        for end in (one.low, one.high):
            if not is_movable(geometry, with_dimensions(geometry, {one.name: end})):
                raise GeometryError(
                    f"{one.name} cannot vary from {one.low:.4g} to {one.high:.4g} mm: faces of the "
                    "actuator merge or separate in between; change a dimension that equals "
                    "another, or give a narrower law"
                )
    return geometry


def with_dimensions(geometry: Moulded, values: Mapping[str, float]) -> Moulded:
    """Return an actuator as moulded with different dimensions [mm] and the same layer.

    A layer without a stated height stays in its default place.

    Raises
    ------
    GeometryError
        If no actuator can have them.

    Examples
    --------
    >>> with_dimensions(geometry_of(MOULDS["ribbed"]()), {"length": 43.0}).dimensions.length
    43.0
    """
    if not values:
        return geometry
    mould = geometry.dimensions
    return geometry_of(MOULDS[mould.kind](**(vars(mould) | dict(values))), geometry.constraint)


def is_movable(geometry: Moulded, other: Moulded) -> bool:
    """Return whether the faces of two actuators of a family are in the same order.

    Only then can the bricks of one be moved onto the other.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> usual, wide = (geometry_of(Dimensions(channel_width=mm)) for mm in (2.0, 6.0))
    >>> is_movable(usual, usual), is_movable(usual, wide)
    (True, False)
    """
    alike = [len(a) == len(b) for a, b in zip(geometry.planes(), other.planes(), strict=True)]
    return all(alike) and order_is_kept(geometry.faces, other.faces)


def geometry_of_record(record: Mapping[str, Any]) -> Moulded:
    """Return the geometry with a record, the inverse of ``Moulded.record``.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is from a different version of the package.

    Examples
    --------
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> geometry = geometry_of(RibbedDimensions(), Constraint("none"))
    >>> geometry_of_record(geometry.record()) == geometry_of(
    ...     RibbedDimensions(), Constraint("none", height=9.25)
    ... )
    True
    """
    kind: Kind = record.get("kind", "pneunet")
    layer = record.get("constraint")
    constraint = Constraint()
    if layer is not None:
        own = {
            name: layer[name] for name in ("kind", "thickness", "c1", "c2", "c3") if name in layer
        }
        kind_of_layer = {"kind": "paper" if layer["is_there"] else "none"}
        constraint = Constraint(**kind_of_layer | own | {"height": float(layer["height"])})
    whole = {one.name for one in fields(MOULDS[kind]) if one.type is int}
    sizes: dict[str, Any] = {
        name: int(value) if name in whole else value for name, value in record["dimensions"].items()
    }
    rest = {name: record[name] for name in ("wall_factor", "erosion") if name in record}
    return GEOMETRIES[kind](MOULDS[kind](**sizes), constraint=constraint, **rest)
