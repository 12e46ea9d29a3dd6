"""Bodies with known displacements, for the tests of pictures and exports."""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.body import Body, box
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.data.settings import Dimensions
from bayesdeg.pages.surface import NodalFields, Surface, faces_of, nodal_fields, shape_of

SCALE = 0.8
BENDING = 0.08  # 1/mm
TWO_CHAMBERS = Geometry(Dimensions(length=20.0, chambers=2))
YEOH = MaterialGroups(c2_ratio=-0.02, c3_ratio=0.004, paper_group=0.0)


def actuator() -> Body:
    """Return a small actuator in as few bricks as it takes."""
    return build_mesh(TWO_CHAMBERS, Resolution(along=9.0, across=9.0, up=9.0)).body


def brick(**options) -> Body:
    """Return a box of 2 × 3 × 1 bricks."""
    return box((3.0, 2.0, 1.5), divisions=(2, 3, 1), **options)


def solved(body: Body, displacement, pressure=None, *, material=YEOH) -> NodalFields:
    """Return the fields of a displacement, given as a function of the nodes."""
    modes = body.element.modes.shape[1]
    known = np.zeros((len(body.elements), modes)) if pressure is None else pressure
    state = MechanicalState(displacement(body.nodes), known, 0.0)
    return nodal_fields(Problem(System(body), material), state)


def bent(nodes):
    """Bend towards −z: sections stay plane, the bottom keeps its length."""
    angle = BENDING * nodes[:, 0]
    radius = 1.0 / BENDING + nodes[:, 2]
    along = radius * np.sin(angle) - nodes[:, 0]
    up = radius * np.cos(angle) - 1.0 / BENDING - nodes[:, 2]
    return np.stack([along, np.zeros(len(nodes)), up], axis=1)


def pictured(*cases, body: Body | None = None) -> Surface:
    """Return the surface of an actuator in several states, (displacement, D_R, kPa) each."""
    body = actuator() if body is None else body
    surface, nodes = faces_of(body)
    shapes = [
        shape_of(
            body,
            solved(body, displacement),
            nodes,
            linear_scale=SCALE,
            degradation=degradation,
            pressure=pressure,
        )
        for displacement, degradation, pressure in cases
    ]
    return replace(surface, shapes=tuple(shapes))
