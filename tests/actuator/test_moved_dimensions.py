"""A mesh that moves with the dimensions of its actuator, and the exact map of moved actuators."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap, solve_task
from bayesdeg.actuator.families import geometry_of, is_movable, with_dimensions
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh, moved_onto
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, CylindricalDimensions, RibbedDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError

COARSEST = Resolution(9.0, 9.0, 9.0)
SHORT = Dimensions(length=20.0, chambers=2)
MOULDS = {
    "pneunet": (SHORT, {"roof": 2.6, "length": 21.0}),
    "ribbed": (RibbedDimensions(), {"length": 43.0, "cover": 4.6}),
    "cylindrical": (CylindricalDimensions(), {"offset": 4.0, "channel_width": 3.3}),
    "round": (
        CylindricalDimensions(width=20.0, section="round", passive="solid", height=20.0),
        {"height": 21.0, "channel_height": 3.2},
    ),
}


@pytest.fixture(params=MOULDS)
def both(request):
    mould, values = MOULDS[request.param]
    geometry = geometry_of(mould, Constraint("film"))
    return geometry, with_dimensions(geometry, values)


def test_moved_bricks_fill_the_moved_actuator(both):
    geometry, other = both
    assert is_movable(geometry, other)
    resolution = geometry.mesh_like(Resolution(3.0, 3.0, 3.0))
    mesh = build_mesh(geometry, resolution)
    moved = moved_onto(mesh, other)
    exact = 0.5 * other.volume
    # the outline of a round section is a polygon of either mesh
    assert moved.body.volume == pytest.approx(exact, rel=2e-2 if other.rounded else 1e-9)
    assert moved.body.volume != pytest.approx(mesh.body.volume, rel=1e-4)
    assert moved.geometry is other
    np.testing.assert_array_equal(moved.body.elements, mesh.body.elements)
    np.testing.assert_allclose(moved.body.nodes[moved.bottom_line, 2], other.line_height, atol=1e-9)


def test_there_and_back_is_where_it_was(both):
    geometry, other = both
    mesh = build_mesh(geometry, geometry.mesh_like(Resolution(3.0, 3.0, 3.0)))
    again = moved_onto(moved_onto(mesh, other), geometry)
    np.testing.assert_allclose(again.body.nodes, mesh.body.nodes, atol=1e-9)


def test_faces_that_fall_together_are_refused():
    geometry = geometry_of(SHORT)
    wide = with_dimensions(geometry, {"channel_width": 6.0})
    assert not is_movable(geometry, wide)
    with pytest.raises(GeometryError):
        moved_onto(build_mesh(geometry, COARSEST), wide)


CURVE = Curve((0.1, 0.2, 0.3), MaterialGroups(c2_ratio=-0.02, c3_ratio=0.005, paper_group=120.0))


@pytest.mark.fem
def test_a_mesh_that_moves_changes_curvature_smoothly():
    """On a mesh of its own each actuator has another error; moved it is the same one."""
    geometry = geometry_of(SHORT)
    angles = [
        solve_task(
            (with_dimensions(geometry, {"roof": roof}), COARSEST, CURVE), origin=geometry
        ).bend_angle[-1]
        for roof in (1.9, 2.0, 2.1, 2.2)
    ]
    logs = np.log(angles)
    assert np.all(np.diff(logs) < 0.0)
    assert abs(np.diff(logs, n=3)[0]) < 0.02 * abs(np.diff(logs)[0])


@pytest.mark.fem
def test_walls_and_faces_may_change_besides():
    geometry = geometry_of(SHORT)
    other = with_dimensions(geometry, {"roof": 2.4})
    actuator = Actuator(moved_onto(build_mesh(geometry, COARSEST), other))
    thicker = replace(CURVE, material=replace(CURVE.material, wall_factor=1.05, erosion=0.1))
    mesh, _ = actuator.problem(thicker)
    assert mesh.body.volume == pytest.approx(
        0.5 * other.changed(wall_factor=1.05, erosion=0.1).volume, rel=1e-9
    )
    actuator.close()


@pytest.mark.fem
def test_the_exact_map_answers_each_actuator_of_a_batch():
    geometry = geometry_of(SHORT)
    forward, one = ExactMap(geometry, COARSEST), np.ones((2, 1, 1))
    inputs = Inputs(
        np.array([40.0, 90.0]),
        0.3 * one,
        -0.006 * one,
        0.0015 * one,
        0.85 * one,
        3e4 * one,
        dimensions={"roof": np.array([2.0, 2.4])[:, None, None]},
    )
    found = forward(inputs).curvature
    plain = forward(replace(inputs, dimensions=None)).curvature
    np.testing.assert_array_equal(found[0], plain[0])
    assert np.all(found[1] < plain[1])
    alone = ExactMap(with_dimensions(geometry, {"roof": 2.4}), COARSEST)
    np.testing.assert_allclose(
        found[1], alone(replace(inputs, dimensions=None)).curvature[1], rtol=1e-9
    )
