"""Interface of a geometry for meshing, and functions of its boxes."""

from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.round import RoundSection
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, Mould

Floats = NDArray[np.float64]
Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
Planes = tuple[Floats, Floats, Floats]

CLOSEST = 1e-9  # mm: closer planes are one


class Moulded(Protocol):
    """The half actuator as moulded, cut at its plane of symmetry y = 0: a block minus boxes.

    x runs along the actuator from the clamped end, y across from the plane of symmetry, z up
    from the bottom. Positive bending is downwards.
    """

    @property
    def dimensions(self) -> Mould:
        """Dimensions as moulded [mm]."""

    @property
    def constraint(self) -> Constraint:
        """The inextensible layer."""

    @property
    def outer(self) -> Box:
        """Remaining block after erosion [mm]."""

    @property
    def cavities(self) -> tuple[Box, ...]:
        """Boxes of air under pressure; they may overlap [mm]."""

    @property
    def voids(self) -> tuple[Box, ...]:
        """Boxes of unpressurised air [mm]."""

    @property
    def exposed(self) -> tuple[Box, ...]:
        """The voids that are open to the outside [mm]."""

    @property
    def slab(self) -> tuple[Box, ...]:
        """The box of a constraint layer of elastomer, if it is one [mm]."""

    @property
    def rounded(self) -> RoundSection | None:
        """The outline across the length, if round."""

    @property
    def line_height(self) -> float:
        """Height of the constraint's plane, along whose middle the curvature is read [mm]."""

    @property
    def volume(self) -> float:
        """Volume of the material of the whole actuator [mm³]."""

    def mesh_like(self, usual: Resolution) -> Resolution:
        """Return the resolution equivalent to one of the default pneunet."""

    def planes(self) -> Planes:
        """Return the coordinates of all planes along x, y and z between bricks [mm]."""

    @property
    def is_boxes(self) -> bool:
        """Whether it is a block minus boxes; otherwise a mesh defines it."""

    def changed(self, *, wall_factor: float, erosion: float) -> Self:
        """Return the actuator with thicker or thinner walls and faces eroded [–, mm]."""

    def record(self) -> dict[str, object]:
        """Return all that a solution depends on, as written and hashed."""


def bottom_is_exposed(constraint: Constraint, mould: Mould) -> bool:
    """Return whether no membrane covers the bottom; an elastomer there is itself exposed."""
    return not (constraint.is_membrane and constraint.height_in(mould) == 0.0)


def line_height(constraint: Constraint, mould: Mould, erosion: float) -> float:
    """Return the height of the plane along whose middle the curvature is read [mm].

    That of the constraint layer. Without one it may lie on the bottom, and then moves with an
    eroded bottom.
    """
    height = constraint.height_in(mould)
    return height if constraint.is_there else max(height, erosion)


def constraint_record(constraint: Constraint, mould: Mould) -> dict[str, object]:
    """Return the constraint's data that a solution depends on: paper and film are equal."""
    plain: dict[str, object] = {
        "is_there": constraint.is_there,
        "height": constraint.height_in(mould),
    }
    own = ("kind", "thickness", "c1", "c2", "c3")
    return plain | ({name: getattr(constraint, name) for name in own} if constraint.is_slab else {})


def slab_of(constraint: Constraint, mould: Mould, outer: Box) -> tuple[Box, ...]:
    """Return the box of an elastomer layer within the remaining block, if there is one.

    Examples
    --------
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> layer = Constraint("elastomer", thickness=1.0, c1=60.0)
    >>> slab_of(layer, RibbedDimensions(), ((0.0, 37.8), (0.0, 16.0), (0.0, 18.5)))
    (((0.0, 37.8), (0.0, 16.0), (8.75, 9.75)),)
    """
    if not constraint.is_slab:
        return ()
    low, high = constraint.slab_in(mould)
    return ((outer[0], outer[1], (max(low, outer[2][0]), min(high, outer[2][1]))),)


def block_left(mould: Mould, constraint: Constraint, erosion: float) -> Box:
    """Return the eroded half block: all outer faces except the clamped end move [mm].

    The bottom moves too if no layer covers it.
    """
    bottom = erosion if bottom_is_exposed(constraint, mould) else 0.0
    return (
        (0.0, mould.length - erosion),
        (0.0, mould.width / 2 - erosion),
        (bottom, mould.height - erosion),
    )


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


def change_problems(wall_factor: float, erosion: float) -> tuple[str, ...]:
    """Say why walls cannot be changed like this [–, mm]; empty if they can."""
    if wall_factor > 0.0 and erosion >= 0.0:
        return ()
    return (f"wall factor {wall_factor:g} must be above 0, erosion {erosion:g} mm not negative",)


def order_is_kept(before: tuple[Box, ...], after: tuple[Box, ...], least: float = 1e-9) -> bool:
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
    return bool(np.all(np.where(steps > least, moved > least, np.abs(moved) <= least)))


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
