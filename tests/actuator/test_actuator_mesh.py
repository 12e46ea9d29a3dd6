"""Volumes, areas and node sets of the mesh against arithmetic on the boxes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.body import (
    LINEAR_CONSTANT,
    LINEAR_FULL,
    QUADRATIC,
    QUADRATIC_CONSTANT,
    boundary_faces,
    box,
)
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import COARSE, Resolution, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS, read_state
from bayesdeg.actuator.problem import System
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError
from tests.actuator.geometries import ONE_ELEMENT_A_WALL, cavity

ELEMENTS = (LINEAR_FULL, LINEAR_CONSTANT, QUADRATIC_CONSTANT, QUADRATIC)


def air(d):
    """Air in the half model: chambers, and the pieces of the channel between them [mm3]."""
    dividers = (d.chambers - 1) * (2.0 * d.chamber_wall + d.gap)
    chambers = d.length - 2.0 * d.end_wall - dividers
    inner = (d.width / 2.0 - d.side_wall) * (d.height - d.floor - d.roof)
    return chambers * inner + dividers * d.channel_width / 2.0 * d.channel_height


def slots(d):
    deep = d.height - d.floor - d.channel_height - d.channel_roof
    return (d.chambers - 1) * d.gap * d.width / 2.0 * deep


@st.composite
def possible_dimensions(draw):
    size = st.floats(0.5, 4.0)
    chambers, gap = draw(st.integers(1, 4)), draw(st.sampled_from([0.0, 1.0, 2.5]))
    floor, roof, side_wall, end_wall, wall = (draw(size) for _ in range(5))
    high, wide, long = (draw(st.floats(2.0, 8.0)) for _ in range(3))
    return Dimensions(
        length=2.0 * end_wall + (chambers - 1) * (2.0 * wall + gap) + chambers * long,
        width=2.0 * (side_wall + wide),
        height=floor + roof + high,
        chambers=chambers,
        floor=floor,
        roof=roof,
        side_wall=side_wall,
        end_wall=end_wall,
        chamber_wall=wall,
        gap=gap,
        channel_width=draw(st.floats(0.2, 0.9)) * wide,
        channel_height=draw(st.floats(0.2, 0.8)) * high,
        channel_roof=0.1 * high,
    )


@settings(max_examples=15, deadline=None)
@given(possible_dimensions())
def test_mesh_holds_exactly_the_material_and_the_air_of_the_boxes(d):
    body = build_mesh(Geometry(d), ONE_ELEMENT_A_WALL).body
    brick = d.length * d.width / 2.0 * d.height
    assert body.volume == pytest.approx(brick - air(d) - slots(d), rel=1e-10)
    volume, gradient = cavity(body, body.nodes)
    assert volume == pytest.approx(air(d), rel=1e-10)
    # a closed surface: no net force along and up; across, the dead surface is missing
    np.testing.assert_allclose(gradient.sum(axis=0)[[0, 2]], 0.0, atol=1e-9)
    assert gradient.sum(axis=0)[1] > 0.0


def test_default_volumes_by_hand():
    body = build_mesh(Geometry(Dimensions()), COARSE).body
    assert cavity(body, body.nodes)[0] == pytest.approx(5 * 4.8 * 3 * 6 + 4 * 5 * 1 * 1.5)
    assert body.volume == pytest.approx(50 * 5 * 10 - 462 - 4 * 2 * 5 * 5.5)


@pytest.mark.parametrize("factor", [0.5, 1.7])
def test_volume_of_a_scaled_cavity_grows_with_the_cube(two_chambers, random_state, factor):
    body = two_chambers.mesh.body
    placed = body.nodes + random_state(body, 1).displacement
    volume, gradient = cavity(body, placed)
    scaled, scaled_gradient = cavity(body, factor * placed)
    assert scaled == pytest.approx(factor**3 * volume, rel=1e-12)
    np.testing.assert_allclose(scaled_gradient, factor**2 * gradient, rtol=1e-10, atol=1e-12)


def test_deformed_cavity_is_still_closed(two_chambers, random_state):
    body = two_chambers.mesh.body
    placed = body.nodes + random_state(body, 2).displacement
    volume, gradient = cavity(body, placed)
    np.testing.assert_allclose(gradient.sum(axis=0)[[0, 2]], 0.0, atol=1e-11)
    moved, _ = cavity(body, placed + np.array([7.0, 0.0, -3.0]))
    assert moved == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize("gap", [0.0, 2.0])
def test_every_cavity_normal_points_into_material(gap):
    mesh = build_mesh(Geometry(Dimensions(length=20.0, chambers=2, gap=gap)), COARSE).body
    grid = mesh.nodes[mesh.cavity].reshape(-1, 3, 3, 3)
    normal = np.cross(grid[:, 2, 1] - grid[:, 0, 1], grid[:, 1, 2] - grid[:, 1, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centres = mesh.nodes[mesh.elements].mean(axis=1)
    reach = np.ptp(mesh.nodes[mesh.elements], axis=1) / 2.0
    behind = grid[:, 1, 1] + 1e-4 * normal
    inside = np.abs(behind[:, None] - centres) < reach
    np.testing.assert_array_equal(np.all(inside, axis=2).sum(axis=1), 1)
    before = grid[:, 1, 1] - 1e-4 * normal
    assert not np.any(np.all(np.abs(before[:, None] - centres) < reach, axis=2))


def test_solid_dividers_have_no_slot():
    with_slots, solid = (Geometry(Dimensions(gap=gap)) for gap in (2.0, 0.0))
    assert len(with_slots.voids) == 4
    assert solid.voids == ()
    gaps = [b[0] - a[1] for a, b in zip(solid.chamber_spans, solid.chamber_spans[1:], strict=False)]
    np.testing.assert_allclose(gaps, 2.0 * solid.dimensions.chamber_wall)


def test_a_single_chamber_needs_no_channel():
    # a channel that would not fit does not matter where there is none
    geometry = Geometry(Dimensions(chambers=1, channel_width=40.0))
    assert len(geometry.cavities) == 1
    assert geometry.chamber_length == pytest.approx(44.0)
    assert geometry.voids == ()


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"chambers": 12}, "in the length"),
        ({"side_wall": 5.0}, "in the width"),
        ({"floor": 8.5}, "in the height"),
        ({"channel_width": 6.5}, "channel .* is wider"),
        ({"channel_height": 6.5}, "channel .* is higher"),
        ({"channel_roof": 7.0}, "leave no slot"),
        ({"roof": -1.0}, "roof must"),
        ({"roof": float("nan")}, "roof must"),
        ({"gap": -0.1}, "gap must"),
        ({"chambers": 0}, "from 1 to 200"),
    ],
)
def test_impossible_dimensions_are_refused_with_the_reason(wrong, reason):
    with pytest.raises(GeometryError, match=reason):
        Geometry(replace(Dimensions(), **wrong))


def test_all_reasons_are_given_at_once():
    with pytest.raises(GeometryError, match=r"length .*; .* width"):
        Geometry(Dimensions(chambers=12, side_wall=6.0))


def test_node_sets_lie_where_they_should(two_chambers):
    mesh, body = two_chambers.mesh, two_chambers.mesh.body
    d = mesh.geometry.dimensions
    np.testing.assert_allclose(body.nodes[body.paper][..., 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(body.nodes[mesh.free_end][..., 0], d.length)
    clamped, cut = (np.isclose(body.nodes[:, axis], 0.0) for axis in (0, 1))
    np.testing.assert_array_equal(body.fixed[:, [0, 2]], np.stack([clamped, clamped], axis=1))
    np.testing.assert_array_equal(body.fixed[:, 1], clamped | cut)
    line = body.nodes[mesh.bottom_line]
    assert line[0, 0] == 0.0
    assert line[-1, 0] == d.length
    assert np.all(np.diff(line[:, 0]) > 0.0)
    for faces, axes, area in (
        (body.paper, (0, 1), d.length * d.width / 2.0),
        (mesh.free_end, (1, 2), d.width / 2.0 * d.height),
    ):
        sides = np.ptp(body.nodes[faces], axis=1)[:, axes]
        assert np.prod(sides, axis=1).sum() == pytest.approx(area)


def test_no_element_exceeds_the_resolution():
    resolution = Resolution(along=1.7, across=1.3, up=0.9)
    body = build_mesh(Geometry(Dimensions(length=14.0, chambers=1)), resolution).body
    sizes = np.ptp(body.nodes[body.elements], axis=1).max(axis=0)
    assert np.all(sizes <= [1.7 + 1e-9, 1.3 + 1e-9, 0.9 + 1e-9])


def test_every_node_belongs_to_an_element(two_chambers):
    body = two_chambers.mesh.body
    np.testing.assert_array_equal(np.unique(body.elements), np.arange(len(body.nodes)))


def test_cavity_volume_at_rest_is_read_as_the_closed_form():
    mesh = build_mesh(Geometry(Dimensions()), COARSE)
    rest = System(mesh.body).rest()
    reading = dict(zip(OUTPUTS, read_state(mesh, rest).values, strict=True))
    assert reading["cavity_volume"] == pytest.approx(air(Dimensions()), rel=1e-12)
    assert reading["bend_angle"] == pytest.approx(0.0, abs=1e-13)
    assert reading["arc_length"] == pytest.approx(50.0, rel=1e-14)
    assert reading["weibull_strain_10"] == 0.0


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
def test_moved_bricks_keep_the_volume_between_their_faces(element):
    """A sheared and stretched box: the determinant of the map, whatever the element."""
    body = box((3.0, 2.0, 1.0), divisions=(2, 3, 2), element=element)
    affine = np.array([[1.2, 0.3, 0.0], [-0.1, 0.9, 0.2], [0.0, 0.4, 1.1]])
    moved = body.placed_at(body.nodes @ affine.T)
    assert moved.volume == pytest.approx(6.0 * np.linalg.det(affine), rel=1e-12)
    # gradients of a linear field are exact
    field = moved.nodes @ [1.0, -2.0, 3.0]
    slopes = np.einsum("eqia,ea->eqi", moved.gradients, field[moved.elements])
    np.testing.assert_allclose(slopes - [1.0, -2.0, 3.0], 0.0, atol=1e-12)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
def test_boundary_faces_close_the_body_and_point_inwards(element):
    body = box((3.0, 2.0, 1.0), divisions=(2, 3, 2), element=element)
    faces = boundary_faces(body)
    assert len(faces) == 2 * (2 * 3 + 3 * 2 + 2 * 2)
    volume, gradient = cavity(replace(body, cavity=faces), body.nodes)
    assert volume == pytest.approx(-6.0, rel=1e-12)  # seen from inside
    np.testing.assert_allclose(gradient.sum(axis=0), 0.0, atol=1e-12)


def test_bricks_turned_inside_out_are_refused():
    body = box((3.0, 2.0, 1.0), divisions=(2, 1, 1))
    with pytest.raises(ValueError, match="inverted"):
        body.placed_at(body.nodes * [-1.0, 1.0, 1.0])


def test_quadrature_weights_are_volumes_at_any_order():
    """∫ x² y² z² over a box, of order 6 in all and 2 in each direction."""
    for element in ELEMENTS:
        body = box((3.0, 2.0, 1.0), divisions=(1, 1, 1), element=element)
        x = np.einsum("qa,eai->eqi", element.shapes, body.nodes[body.elements])
        wanted = 9.0 * 8.0 / 3.0 / 3.0
        assert np.sum(body.weights * np.prod(x**2, axis=-1)) == pytest.approx(wanted, rel=1e-12)
