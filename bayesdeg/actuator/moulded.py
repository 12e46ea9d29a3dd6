"""The shape of an actuator as moulded, for meshing, and functions of its boxes."""

from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.round import RoundSection
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, Mould
from bayesdeg.errors import GeometryError

Floats = NDArray[np.float64]
Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
Planes = tuple[Floats, Floats, Floats]

CLOSEST = 1e-9  # mm: closer planes are one


class Moulded(Protocol):
    """The half actuator as moulded, cut at its plane of symmetry y = 0: a block minus boxes.

    x runs along the actuator from the clamped end, y across from the plane of symmetry, z up
    from the bottom. Positive bending is downwards. A family is a frozen dataclass that derives from
    this class; what it does not override is that of an eroded block.

    Parameters
    ----------
    dimensions : Mould
        Dimensions as moulded [mm].
    wall_factor : float
        Thickness of walls over the nominal one; the outer faces do not move [–].
    erosion : float
        Thickness lost from every face exposed to the soil: all outer faces except the clamped end,
        and the bottom if a membrane covers it [mm].
    constraint : Constraint
        The inextensible or stiffer layer; by default paper in its usual place.

    Raises
    ------
    GeometryError
        If no actuator can have these dimensions; the message lists every reason.
    """

    dimensions: Mould
    wall_factor: float
    erosion: float
    constraint: Constraint

    def __post_init__(self) -> None:
        """Refuse impossible dimensions."""
        w, e = self.wall_factor, self.erosion
        problems = self.dimensions.problems() or self.constraint.problems(self.dimensions)
        if not problems and not (w > 0.0 and e >= 0.0):
            problems = (f"wall factor {w:g} must be above 0, erosion {e:g} mm not negative",)
        if problems := problems or self.change_problems():
            raise GeometryError("; ".join(problems))

    def change_problems(self) -> tuple[str, ...]:
        """Say why walls cannot be changed by this factor and erosion; empty if they can."""
        return ()

    @property
    def bottom_is_exposed(self) -> bool:
        """Whether no membrane covers the bottom; an elastomer there is itself exposed."""
        layer = self.constraint
        return not (layer.is_membrane and layer.height_in(self.dimensions) == 0.0)

    @property
    def outer(self) -> Box:
        """Remaining block after erosion [mm]."""
        d, e = self.dimensions, self.erosion
        bottom = e if self.bottom_is_exposed else 0.0
        return (0.0, d.length - e), (0.0, d.width / 2 - e), (bottom, d.height - e)

    @property
    def cavities(self) -> tuple[Box, ...]:
        """Boxes of air under pressure; they may overlap [mm]."""

    @property
    def voids(self) -> tuple[Box, ...]:
        """Boxes of unpressurised air [mm]."""

    @property
    def exposed(self) -> tuple[Box, ...]:
        """The voids that are open to the outside [mm]."""
        return ()

    @property
    def slab(self) -> tuple[Box, ...]:
        """The box of a constraint layer of elastomer, if it is one [mm]."""
        if not self.constraint.is_slab:
            return ()
        low, high = self.constraint.slab_in(self.dimensions)
        along, across, (bottom, top) = self.outer
        return ((along, across, (max(low, bottom), min(high, top))),)

    @property
    def rounded(self) -> RoundSection | None:
        """The outline across the length, if round."""
        return None

    @property
    def line_height(self) -> float:
        """Height of the plane along whose middle the curvature is read [mm].

        That of the constraint layer. Without one it may lie on the bottom, and then moves with an
        eroded bottom.
        """
        height = self.constraint.height_in(self.dimensions)
        return height if self.constraint.is_there else max(height, self.erosion)

    @property
    def faces(self) -> tuple[Box, ...]:
        """The block, the line's plane and all boxes [mm]."""
        plane: Box = ((0.0, 0.0), (0.0, 0.0), (self.line_height, self.line_height))
        return (self.outer, plane, *self.slab, *self.cavities, *self.voids)

    @property
    def volume(self) -> float:
        """Volume of the material of the whole actuator [mm³]."""
        return 2.0 * volume_without(self.planes(), (*self.cavities, *self.voids))

    @property
    def is_boxes(self) -> bool:
        """Whether it is a block minus boxes; otherwise a mesh defines it."""
        return True

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return the resolution equivalent to one of the default pneunet."""

    def planes(self) -> Planes:
        """Return the coordinates of all planes along x, y and z between bricks [mm]."""
        boxes = (*self.slab, *self.cavities, *self.voids)
        return planes_of(self.outer, boxes, self.line_height)

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the actuator with thicker or thinner walls and faces eroded [–, mm]."""

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as written and hashed."""

    @property
    def constraint_record(self) -> dict[str, object]:
        """The constraint's data that a solution depends on: paper and film are equal."""
        layer = self.constraint
        plain = {"is_there": layer.is_there, "height": layer.height_in(self.dimensions)}
        own = ("kind", "thickness", "c1", "c2", "c3") if layer.is_slab else ()
        return plain | {name: getattr(layer, name) for name in own}


def mirrored(boxes: tuple[Box, ...], height: float) -> tuple[Box, ...]:
    """Return the mirror images of boxes in the middle of a height [mm].

    Examples
    --------
    >>> mirrored((((0.0, 1.0), (0.0, 1.0), (7.0, 9.0)),), 10.0)
    (((0.0, 1.0), (0.0, 1.0), (1.0, 3.0)),)
    """
    return tuple((x, y, (height - high, height - low)) for x, y, (low, high) in boxes)


def planes_of(outer: Box, boxes: tuple[Box, ...], line_height: float) -> Planes:
    """Return the coordinates of all faces along x, y and z, and of the line's plane [mm].

    Examples
    --------
    >>> box = ((1.0, 2.0), (0.0, 0.5), (1.0, 2.0))
    >>> [axis.tolist() for axis in planes_of(((0, 3), (0, 1), (0, 3)), (box,), 0.0)]
    [[0.0, 1.0, 2.0, 3.0], [0.0, 0.5, 1.0], [0.0, 1.0, 2.0, 3.0]]
    """
    found = []
    for axis, also in enumerate(((), (), (line_height,))):
        edges = [*outer[axis], *also, *(edge for box in boxes for edge in box[axis])]
        ordered = np.sort(np.asarray(edges, dtype=np.float64))
        found.append(ordered[np.concatenate([[True], np.diff(ordered) > CLOSEST])])
    x, y, z = found
    return x, y, z


def order_is_kept(before: tuple[Box, ...], after: tuple[Box, ...]) -> bool:
    """Return whether separate faces of boxes stay separate and ordered along each axis.

    Only then can the bricks between them be moved along.

    Examples
    --------
    >>> wide, thin, turned = (((0.0, x), (0.0, 1.0), (0.0, 1.0)) for x in (2.0, 1.0, -1.0))
    >>> order_is_kept((wide,), (thin,)), order_is_kept((wide,), (turned,))
    (True, False)
    """
    old, new = (np.moveaxis(np.array(boxes), 1, 0).reshape(3, -1) for boxes in (before, after))
    order = np.argsort(old, axis=1, kind="stable")
    steps, moved = (np.diff(np.take_along_axis(x, order, axis=1)) for x in (old, new))
    return bool(np.all(np.where(steps > CLOSEST, moved > CLOSEST, np.abs(moved) <= CLOSEST)))


def volume_without(planes: Planes, boxes: tuple[Box, ...]) -> float:
    """Return the volume between planes outside boxes whose faces are among them [mm³].

    Examples
    --------
    >>> box = ((1.0, 2.0), (0.0, 0.5), (1.0, 2.0))
    >>> volume_without(planes_of(((0, 3), (0, 1), (0, 3)), (box,), 0.0), (box,))
    8.5
    """
    middles = np.meshgrid(*(0.5 * (p[1:] + p[:-1]) for p in planes), indexing="ij")
    sizes = np.einsum("i,j,k->ijk", *(np.diff(p) for p in planes))
    solid = np.ones(sizes.shape, dtype=bool)
    for box in boxes:
        inside = [(a < m) & (m < b) for m, (a, b) in zip(middles, box, strict=True)]
        solid &= ~np.logical_and.reduce(inside)
    return float(sizes[solid].sum())
