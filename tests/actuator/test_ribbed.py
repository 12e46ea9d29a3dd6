"""A ribbed segment and a layer inside the block: where they lie, and what the layer does."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import boundary_faces, box, faces_on_plane
from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import COARSE, build_mesh, reshaped
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.section import section
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.actuator.status import FINE
from bayesdeg.data.families import Constraint, RibbedDimensions
from bayesdeg.data.settings import Dimensions
from tests.actuator.geometries import EXACT, ONE_ELEMENT_A_WALL, RIBBED, SOFT, cavity


def actuator(dimensions=RIBBED, constraint=None, **changes):
    geometry = SegmentGeometry(dimensions, constraint=constraint or Constraint(), **changes)
    return Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))


def test_the_default_cavity_is_the_sum_of_its_authors():
    """doi:10.1089/soro.2014.0022: 1.04 ml, thirteen slits and twelve passages."""
    stated = 13 * 25.4 * 3.1 * 1.0 + 12 * 0.65 * (3.15 - 1.81) * 1.76
    body = build_mesh(SegmentGeometry(RibbedDimensions()), ONE_ELEMENT_A_WALL).body
    assert 2.0 * cavity(body)[0] == pytest.approx(stated, rel=1e-12)
    assert round(1e-3 * stated, 2) == 1.04


def test_node_sets_lie_where_they_should():
    mesh = actuator(constraint=Constraint("film", 4.5)).mesh
    body, d = mesh.body, RIBBED
    np.testing.assert_allclose(body.nodes[body.paper][..., 2], 4.5)
    sides = np.ptp(body.nodes[body.paper], axis=1)
    assert np.sum(sides[:, 0] * sides[:, 1]) == pytest.approx(d.length * d.width / 2.0)
    # first axis along x, second along y, as the membrane takes them
    grid = body.nodes[body.paper].reshape(-1, 3, 3, 3)
    assert np.all(grid[:, 2, 0, 0] > grid[:, 0, 0, 0])
    assert np.all(grid[:, 0, 2, 1] > grid[:, 0, 0, 1])
    line = body.nodes[mesh.bottom_line]
    np.testing.assert_allclose(line[:, 1:], np.tile([0.0, 4.5], (len(line), 1)))
    assert (line[0, 0], line[-1, 0]) == (0.0, d.length)
    assert np.all(np.diff(line[:, 0]) > 0.0)


@pytest.mark.parametrize("constraint", [Constraint("film"), Constraint("paper", 0.0)])
def test_a_layer_at_height_0_is_the_paper_of_a_pneunet_bit_by_bit(constraint):
    usual = build_mesh(Geometry(Dimensions()), COARSE)
    mesh = build_mesh(geometry_of(Dimensions(), constraint), COARSE)
    for name, value in vars(usual.body).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(mesh.body, name))
    np.testing.assert_array_equal(usual.bottom_line, mesh.bottom_line)
    # and that is what it always was: the faces of the boundary at z = 0, in their order
    faces = boundary_faces(usual.body)
    bottom = faces[np.isclose(usual.body.nodes[faces].mean(axis=1)[:, 2], 0.0)]
    np.testing.assert_array_equal(np.sort(usual.body.paper), np.sort(bottom))
    assert mesh.geometry.record() == usual.geometry.record()


def test_a_plane_between_bricks_has_each_face_once():
    body = box((3.0, 2.0, 1.0), divisions=(3, 2, 4))
    for height in (0.0, 0.25, 0.5, 1.0):
        faces = faces_on_plane(body, height)
        assert len(faces) == 6
        np.testing.assert_allclose(body.nodes[faces][..., 2], height)
    assert len(faces_on_plane(body, 0.3)) == 0


@pytest.mark.parametrize("passive", ["open", "none"])
def test_exposed_faces_erode(passive):
    mesh = build_mesh(SegmentGeometry(replace(RIBBED, passive=passive)), ONE_ELEMENT_A_WALL)
    heights = reshaped(mesh, wall_factor=1.2, erosion=0.15).body.nodes[:, 2]
    # paper covers the bottom of a segment without another half, the soil is at the other's
    low = 0.0 if passive == "none" else 0.15
    assert (heights.min(), heights.max()) == pytest.approx((low, 7.85))


def test_the_drawn_section_shows_the_passages_and_the_layer():
    drawn = section(SegmentGeometry(RIBBED), 72).splitlines()
    assert sum(set(row) == {"="} for row in drawn) == 1
    upper, lower = drawn[: drawn.index("=" * 72)], drawn[drawn.index("=" * 72) + 1 :]
    assert upper == [row.replace("o", " ") for row in reversed(lower)]
    assert max(row.count(" ") for row in upper) == 32  # both slits and the passage, 4 of 9 mm
    assert "o" not in "".join(upper)


@pytest.mark.fem
def test_without_a_layer_the_middle_gets_longer_and_with_a_film_it_does_not():
    none, film = (
        actuator(constraint=Constraint(kind)).solve(Curve((0.4,), SOFT))
        for kind in ("none", "film")
    )
    stretch = [float(s.arc_length[0]) / RIBBED.length - 1.0 for s in (none, film)]
    assert stretch[0] > 3e-3
    assert abs(stretch[1]) < 0.6 * stretch[0]
    # without a layer its stiffness and thickness are of no account
    other = actuator(constraint=Constraint("none")).solve(
        Curve((0.4,), replace(SOFT, paper_group=1e4, paper_thickness=0.4))
    )
    np.testing.assert_array_equal(none.readings, other.readings)


@pytest.mark.fem
def test_a_shrunken_body_bends_about_the_height_of_the_layer(at_rest):
    """Mirror images bend by opposite angles, a layer in the middle not at all."""
    both, angles = replace(RIBBED, passive="pressurised"), {}
    for height in (3.0, 4.0, 5.0):
        of = actuator(both, Constraint("film", height))
        material = replace(SOFT, paper_mismatch=0.01)
        state = at_rest(Problem(of.system, material), EXACT)
        angles[height] = read_state(of.mesh, state).bend_angle
    assert angles[3.0] == pytest.approx(-angles[5.0], rel=1e-8)
    assert abs(angles[3.0]) > 1e-3
    assert angles[4.0] == pytest.approx(0.0, abs=1e-10)


def test_meshes_follow_the_slits():
    default, small = (SegmentGeometry(d) for d in (RibbedDimensions(), RIBBED))
    mesh = build_mesh(default, default.mesh_like(FINE))
    assert small.mesh_like(FINE).along == pytest.approx(1.0)
    assert Geometry(Dimensions()).mesh_like(FINE) == FINE
    assert System(mesh.body).bending.nnz > 0
