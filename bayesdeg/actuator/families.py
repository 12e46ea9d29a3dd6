"""The families of actuators: which geometry belongs to which dimensions, and back from a record."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.part import PartGeometry
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.data.families import Constraint, Kind, Mould
from bayesdeg.data.settings import MOULDS, Settings

GEOMETRIES: Mapping[Kind, Callable[..., Moulded]] = {
    "pneunet": Geometry,
    "ribbed": SegmentGeometry,
    "cylindrical": SegmentGeometry,
    "mesh": PartGeometry,
}
"""Each is made of the family's dimensions, a wall factor, an erosion and a constraint."""


def geometry_of(dimensions: Mould, constraint: Constraint | None = None) -> Moulded:
    """Return the geometry of an actuator as moulded.

    Parameters
    ----------
    dimensions : Mould
        Of any family, such as ``Dimensions`` or ``CylindricalDimensions``.
    constraint : Constraint, optional
        By default paper, where the family has it.

    Raises
    ------
    GeometryError
        If no actuator can be made of the dimensions.

    Examples
    --------
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> type(geometry_of(RibbedDimensions())).__name__
    'SegmentGeometry'
    """
    return GEOMETRIES[dimensions.kind](dimensions, constraint=constraint or Constraint())


def geometry_of_study(settings: Settings) -> Moulded:
    """Return the geometry of the actuators of a study.

    Examples
    --------
    >>> geometry_of_study(Settings()).dimensions.kind
    'pneunet'
    """
    return geometry_of(settings.dimensions, settings.constraint)


def geometry_of_record(record: Mapping[str, Any]) -> Moulded:
    """Return the geometry with a record, the inverse of ``Moulded.record``.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is of another version of the package.

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
