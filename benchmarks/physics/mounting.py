r"""Mounting and bonding of an actuator: detached paper and compliant clamps.

Independent physics that use nothing of `bayesdeg.causes`:

* `Bond`: the paper has detached from part of the bottom. The body bends and stretches there without
  it; the loose part of the paper carries no load.
* `Clamp`: the clamped end face rests on springs instead of being fixed, so its reactions displace
  and rotate it.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import Body, boundary_faces
from bayesdeg.actuator.families import PartGeometry
from bayesdeg.actuator.mesh import ActuatorMesh, build_mesh
from bayesdeg.actuator.moulded import Moulded, Planes
from bayesdeg.actuator.problem import System
from bayesdeg.actuator.status import Resolution

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

NEAREST = 0.05
"""Ends of bonding closer than this to a face of the geometry are moved to it [mm].

Half the paper thickness: finer resolution is meaningless, and bricks would degenerate.
"""


@dataclass(frozen=True)
class Bond:
    r"""Detachment of the paper from the bottom; the bonded part is a rectangle.

    Parameters
    ----------
    off_end : float
        Detached share of the length, from the free end inwards [–].
    off_clamp : float
        The same, from the clamp outwards [–].
    off_edges : float
        Detached share of the width, half of it from each edge [–].

    Notes ----- Detached paper carries no load. At the free end and the edges it is a loose flap, so
    this is exact without friction. At the clamp it holds if the paper ends there; paper gripped by
    the clamp would span the detached part as a tendon.

    Raises
    ------
    ValueError
        If a share is not between 0 and 1.

    Examples
    --------
    >>> Bond(off_end=0.2, off_edges=0.5).bonded(50.0, 5.0)
    (0.0, 40.0, 2.5)
    >>> Bond().is_whole
    True
    """

    off_end: float = 0.0
    off_clamp: float = 0.0
    off_edges: float = 0.0

    def __post_init__(self) -> None:
        """Refuse values that are not shares."""
        for name, value in vars(self).items():
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} must be between 0 and 1, not {value:g}")

    @property
    def is_whole(self) -> bool:
        """Whether the paper is fully bonded."""
        return not any(vars(self).values())

    @property
    def share_off(self) -> float:
        """Detached share of the bottom's area [–]."""
        along = max(1.0 - self.off_end - self.off_clamp, 0.0)
        return 1.0 - along * (1.0 - self.off_edges)

    def bonded(self, length: float, half_width: float) -> tuple[float, float, float]:
        """Return where bonding begins and ends along x, and its half width [mm]."""
        begin, end = self.off_clamp * length, (1.0 - self.off_end) * length
        return begin, max(begin, end), (1.0 - self.off_edges) * half_width

    def grown(self, degradation: float, reference: float) -> Self:
        """Return the bond at a degradation rate, given shares at a reference rate [%].

        Shares are proportional to the rate, and at most 1.
        """
        ratio = degradation / reference
        return replace(self, **{name: min(ratio * v, 1.0) for name, v in vars(self).items()})


def bonded_mesh(geometry: Moulded, resolution: Resolution, bond: Bond) -> ActuatorMesh:
    """Return the half model with partly bonded paper; mesh faces end where bonding does.

    An element bonded over part of its length would hardly stretch, however small that part. So a
    mesh plane is placed where bonding ends, unless a face of the geometry is within `NEAREST`; a
    complete bond gives the mesh of `build_mesh`.

    Raises
    ------
    ValueError
        If the actuator has no membrane.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.actuator.mesh import COARSE
    >>> from bayesdeg.data.settings import Dimensions
    >>> small = Geometry(Dimensions(length=14.0, chambers=1))
    >>> mesh = bonded_mesh(small, COARSE, Bond(off_end=0.25))
    >>> float(mesh.body.nodes[mesh.body.paper][..., 0].max())
    10.5
    """
    if not geometry.constraint.is_membrane:
        raise ValueError("without a membrane nothing can detach")
    return detached(build_mesh(geometry, resolution, cuts=cuts_of(geometry, bond)), bond)


def cuts_of(geometry: Moulded, bond: Bond) -> Planes:
    """Return the planes along x, y and z that a mesh needs where bonding ends [mm].

    Raises
    ------
    ValueError
        If a user's mesh is only partly bonded: no plane can be inserted into it.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> x, y, _ = cuts_of(Geometry(Dimensions()), Bond(off_end=0.5, off_edges=0.6))
    >>> x.tolist(), y.tolist()  # the middle of the length is that of a chamber
    ([25.0], [2.0])
    """
    if isinstance(geometry, PartGeometry) and not bond.is_whole:
        raise ValueError("a user's mesh has no plane where bonding ends")
    x, y, _ = geometry.planes()
    (_, length), (_, half_width), _ = geometry.outer
    begin, end, edge = bond.bonded(length, half_width)
    return _apart(x, (begin, end)), _apart(y, (edge,)), np.empty(0)


def _apart(planes: Floats, wanted: tuple[float, ...]) -> Floats:
    kept: list[float] = []
    for at in np.unique(wanted).tolist():
        if np.min(np.abs(np.append(planes, kept) - at)) > NEAREST:
            kept.append(at)
    return np.array(kept)


def detached(mesh: ActuatorMesh, bond: Bond) -> ActuatorMesh:
    """Return a mesh with paper only on its bonded faces.

    A face counts as bonded if its centre is.
    """
    body, (_, length) = mesh.body, mesh.geometry.outer[0]
    begin, end, edge = bond.bonded(length, mesh.geometry.outer[1][1])
    x, y, _ = np.moveaxis(body.nodes[body.paper].mean(axis=1), -1, 0)
    kept = (x > begin) & (x < end) & (y < edge)
    return replace(mesh, body=replace(body, paper=body.paper[kept]))


@dataclass(frozen=True)
class Clamp:
    r"""A compliant clamp: the end face rests on uniformly distributed springs.

    .. math:: P N = -k_n u_x e_x - k_t (u_y e_y + u_z e_z) \quad\text{on } x = 0

    A moment M rotates a face of width w and height h by :math:`M/k_\theta`,
    :math:`k_\theta = k_n w h^3/12`.

    Parameters
    ----------
    normal : float
        :math:`k_n`, at moulded size, over C1: a layer of Young's modulus E and thickness t has
        E/(t C1) or, if thin, more [1/mm].
    tangential : float
        :math:`k_t`, likewise [1/mm].

    Examples
    --------
    >>> Clamp(0.12, 0.04).turning(10.0, 10.0)  # C1 mm³
    100.0
    """

    normal: float
    tangential: float

    def turning(self, width: float, height: float) -> float:
        """Return the stiffness of a full face against rotation, k_n w h³/12 [C1 mm³]."""
        return self.normal * width * height**3 / 12.0


def end_face(body: Body) -> Indices:
    """Return the nodes of the faces in the plane x = 0, of bricks or of tetrahedra."""
    faces = boundary_faces(body)
    at_end: Indices = faces[np.all(np.isclose(body.nodes[faces][..., 0], 0.0), axis=1)]
    return at_end


def released(body: Body) -> Body:
    """Return a body whose plane x = 0 is released, except in its plane of symmetry.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> bool(released(box((3.0, 2.0, 1.0), divisions=(1, 1, 1))).fixed[:, 0].any())
    False
    """
    free = body.fixed.copy()
    at_end, middle = np.isclose(body.nodes[:, 0], 0.0), np.isclose(body.nodes[:, 1], 0.0)
    symmetric = body.fixed[middle & ~at_end, 1].all() and bool(np.any(middle & ~at_end))
    free[at_end] = False
    free[at_end & middle, 1] = symmetric
    return replace(body, fixed=free)


@dataclass(frozen=True, eq=False)
class ClampSprings:
    """The springs of a clamp in the discrete equations of a body.

    Parameters
    ----------
    matrix : scipy.sparse.csr_array
        ∫ k v · u dA over the end face, on all degrees of freedom [C1 mm].
    data : array
        Its entries in the order of the system's upper triangle.
    """

    matrix: sp.csr_array
    data: Floats

    @classmethod
    def on(cls, system: System, clamp: Clamp) -> Self:
        """Return the springs on a body whose end face is released."""
        faces = end_face(system.body)
        element = system.body.element
        rule = kernels.face_shapes(element.order, triangle=element.triangular)
        (shapes, *along), weights = rule[:3], rule[3]
        tangents = (np.einsum("qa,fai->fqi", one, system.body.nodes[faces]) for one in along)
        area = weights * np.linalg.norm(np.cross(*tangents), axis=2)
        mass = np.einsum("fq,qa,qb->fab", area, shapes, shapes)
        each = np.array([clamp.normal, clamp.tangential, clamp.tangential])
        blocks = np.einsum("fab,ij->faibj", mass, np.diag(each))
        size = 3 * faces.shape[1]
        values = blocks.reshape(len(faces), size, size)
        degrees = (3 * faces[:, :, None] + np.arange(3)).reshape(len(faces), size)
        rows, columns = (np.broadcast_to(d, values.shape) for d in _crossed(degrees))
        whole = 3 * len(system.body.nodes)
        entries = (values.ravel(), (rows.ravel(), columns.ravel()))
        places = system.places_of(faces)
        stored = places >= 0
        data = np.bincount(places[stored], values[stored], minlength=system.upper.nnz)
        return cls(sp.coo_array(entries, shape=(whole, whole)).tocsr(), data)

    def push(self, displacement: Floats) -> Floats:
        """Return the internal force of the springs, (n_nodes, 3) [C1 mm²]."""
        force: Floats = (self.matrix @ displacement.ravel()).reshape(-1, 3)
        return force


def _crossed(degrees: Indices) -> tuple[Indices, Indices]:
    return degrees[:, :, None], degrees[:, None, :]


@dataclass(frozen=True)
class Mounting:
    """Bonding and clamping of an actuator.

    Parameters
    ----------
    bond : Bond
        Bond of the paper.
    clamp : Clamp, optional
        A compliant clamp; by default the end face is fixed.
    """

    bond: Bond = Bond()
    clamp: Clamp | None = None
