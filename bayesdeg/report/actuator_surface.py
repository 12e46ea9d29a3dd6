"""The surface of solved actuators: what a picture of them needs, and no more."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.body import Body, boundary_faces
from bayesdeg.report.actuator_fields import NodalFields

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Shape:
    """One solved actuator, the half y ≥ 0, at true size.

    Parameters
    ----------
    degradation : float
        Degradation rate [%].
    pressure : float
        Gauge pressure as read [kPa].
    rest, placed : array, shape (n_nodes, 3)
        Nodes of the surface before loading and under pressure [mm].
    stretch : array, shape (n_nodes,)
        Largest principal stretch [–].
    """

    degradation: float
    pressure: float
    rest: Floats
    placed: Floats
    stretch: Floats


@dataclass(frozen=True)
class Surface:
    """The faces that all shapes share.

    Parameters
    ----------
    faces : array, shape (n_faces, 4 or 9)
        Nodes as 2 × 2 or 3 × 3 grids whose first axis times second axis points out of the solid.
    on_cut, in_cavity : array of bool, shape (n_faces,)
        Faces in the plane of symmetry y = 0, and walls of the cavity.
    shapes : tuple of Shape
        In the order of drawing.
    """

    faces: Indices
    on_cut: Flags
    in_cavity: Flags
    shapes: tuple[Shape, ...]


def faces_of(body: Body) -> tuple[Surface, Indices]:
    """Return the surface of a body, without shapes, and the nodes of the body that it has.

    Parameters
    ----------
    body : Body
        Half an actuator, y ≥ 0.

    Returns
    -------
    surface : Surface
        Its faces count the nodes that are on the surface.
    nodes : array, shape (n_nodes,)
        Number of each in the body.

    Examples
    --------
    >>> from bayesdeg.actuator.body import box
    >>> surface, nodes = faces_of(box((2.0, 1.0, 1.0), divisions=(2, 1, 1)))
    >>> surface.faces.shape, int(surface.on_cut.sum()), len(nodes)
    ((10, 9), 2, 42)
    """
    side = body.element.order + 1
    inward = boundary_faces(body).reshape(-1, side, side)
    outward = np.swapaxes(inward, 1, 2).reshape(len(inward), side * side)
    nodes, numbered = np.unique(outward, return_inverse=True)
    on_cut = np.all(np.isclose(body.nodes[outward, 1], 0.0), axis=1)
    pressed = {tuple(face) for face in np.sort(body.cavity, axis=1)}
    in_cavity = np.array([tuple(face) in pressed for face in np.sort(outward, axis=1)], dtype=bool)
    return Surface(numbered.reshape(outward.shape), on_cut, in_cavity, ()), nodes


def shape_of(
    body: Body,
    fields: NodalFields,
    nodes: Indices,
    *,
    linear_scale: float,
    degradation: float,
    pressure: float,
) -> Shape:
    """Return the shape of a solved body.

    Parameters
    ----------
    body : Body
        At moulded size, before loading.
    fields : NodalFields
        Of the equilibrium.
    nodes : array
        Those of the surface, from `faces_of`.
    linear_scale : float
        True size over moulded size [–].
    degradation, pressure : float
        [%], [kPa].
    """
    rest = linear_scale * body.nodes[nodes]
    placed = rest + linear_scale * fields.displacement[nodes]
    return Shape(degradation, pressure, rest, placed, fields.stretch[nodes])
