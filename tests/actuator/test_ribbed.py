"""A ribbed segment and a layer inside the block: volumes, symmetry, energy, both assemblies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator import kernels
from bayesdeg.actuator.body import boundary_faces, box, faces_on_plane
from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, Resolution, build_mesh, reshaped
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.section import air_volume, section
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import FINE, PathEffort, Status
from bayesdeg.data.families import Constraint, RibbedDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError

ONE_ELEMENT_A_WALL = Resolution(along=100.0, across=100.0, up=100.0)
# two slits in each half, a third of a millimetre of film
SMALL = RibbedDimensions(
    length=9.0,
    width=8.0,
    height=8.0,
    channels=2,
    channel_length=1.0,
    channel_width=5.0,
    channel_height=1.5,
    pitch=3.0,
    cover=1.0,
    passage_width=1.0,
    passage_height=0.6,
)
SOFT = MaterialGroups(c2_ratio=-0.01, c3_ratio=0.002, paper_group=200.0, paper_thickness=0.1)
EXACT = PathEffort(tolerance=1e-8, iterations=20, rate_tolerance=1e-9, exact=True)


def actuator(dimensions=SMALL, constraint=None, **changes):
    geometry = SegmentGeometry(dimensions, constraint=constraint or Constraint(), **changes)
    return Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))


def cavity(body):
    return kernels.cavity_volume(
        body.nodes,
        body.cavity,
        kernels.volume_form(body.element.order),
        1.0,
        np.zeros_like(body.nodes),
        np.empty((0, 0, 0), dtype=np.int32),
        np.empty(0),
    )


def air(d):
    """Air of one half of a whole segment: slits and passages through the ribs [mm3]."""
    slits = d.channels * d.channel_length * d.channel_width * d.channel_height
    ribs = (d.channels - 1) * (d.pitch - d.channel_length)
    return slits + ribs * d.passage_width * d.passage_height


@st.composite
def possible(draw):
    size = st.floats(0.5, 4.0)
    length, rib, cover, side, deep, under, end = (draw(size) for _ in range(7))
    count, wide = draw(st.integers(1, 4)), draw(st.floats(2.0, 20.0))
    passive = draw(st.sampled_from(["open", "pressurised", "solid", "none"]))
    layers = 1 if passive == "none" else 2
    return RibbedDimensions(
        length=count * length + (count - 1) * rib + 2.0 * end,
        width=wide + 2.0 * side,
        height=layers * (cover + deep + under),
        channels=count,
        channel_length=length,
        channel_width=wide,
        channel_height=deep,
        pitch=length + rib,
        cover=cover,
        passage_width=draw(st.floats(0.1, 0.9)) * wide,
        passage_height=draw(st.floats(0.1, 0.9)) * deep,
        passive=passive,
    )


@settings(max_examples=25, deadline=None)
@given(possible())
def test_the_mesh_holds_exactly_material_and_air_of_the_boxes(d):
    geometry = SegmentGeometry(d)
    body = build_mesh(geometry, ONE_ELEMENT_A_WALL).body
    halves = {"open": 2, "pressurised": 2, "solid": 1, "none": 1}[d.passive]
    block = d.length * d.width * d.height
    assert 2.0 * body.volume == pytest.approx(block - halves * air(d), rel=1e-10)
    assert geometry.volume == pytest.approx(2.0 * body.volume, rel=1e-12)
    pressed = 2 if d.passive == "pressurised" else 1
    assert 2.0 * cavity(body) == pytest.approx(pressed * air(d), rel=1e-10)
    assert air_volume(geometry) == pytest.approx(pressed * air(d), rel=1e-10)


def test_the_default_cavity_is_the_sum_of_its_authors():
    """doi:10.1089/soro.2014.0022: 1.04 ml, thirteen slits and twelve passages."""
    stated = 13 * 25.4 * 3.1 * 1.0 + 12 * 0.65 * (3.15 - 1.81) * 1.76
    body = build_mesh(SegmentGeometry(RibbedDimensions()), ONE_ELEMENT_A_WALL).body
    assert 2.0 * cavity(body) == pytest.approx(stated, rel=1e-12)
    assert round(1e-3 * stated, 2) == 1.04


def test_node_sets_lie_where_they_should():
    mesh = actuator(constraint=Constraint("film", 4.5)).mesh
    body, d = mesh.body, SMALL
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


@pytest.mark.parametrize("wall_factor", [0.8, 1.2])
@pytest.mark.parametrize("passive", ["open", "none"])
def test_moved_walls_hold_what_a_new_mesh_holds(wall_factor, passive):
    mesh = build_mesh(SegmentGeometry(replace(SMALL, passive=passive)), ONE_ELEMENT_A_WALL)
    moved = reshaped(mesh, wall_factor=wall_factor, erosion=0.15)
    anew = build_mesh(moved.geometry, ONE_ELEMENT_A_WALL)
    np.testing.assert_allclose(moved.body.nodes, anew.body.nodes, atol=1e-12)
    np.testing.assert_allclose(moved.body.depth, anew.body.depth, atol=1e-12)
    top, bottom = moved.body.nodes[:, 2].max(), moved.body.nodes[:, 2].min()
    # paper covers the bottom of a segment without another half, the soil is at the other's
    assert (bottom, top) == pytest.approx((0.0 if passive == "none" else 0.15, 7.85))


@pytest.mark.parametrize(
    "changes", [{"wall_factor": 2.0}, {"wall_factor": 3.0}, {"erosion": 1.1}, {"erosion": -0.1}]
)
def test_walls_that_are_lost_are_refused(changes):
    with pytest.raises(GeometryError):
        SegmentGeometry(SMALL, **changes)
    material = replace(SOFT, **{"wall_factor": 1.0, "erosion": 0.0} | changes)
    assert actuator().solve(Curve((0.1,), material)).status is Status.INVALID_INPUT


def test_the_drawn_section_shows_the_passages_and_the_layer():
    drawn = section(SegmentGeometry(SMALL), 72).splitlines()
    assert sum(set(row) == {"="} for row in drawn) == 1
    upper, lower = drawn[: drawn.index("=" * 72)], drawn[drawn.index("=" * 72) + 1 :]
    assert upper == [row.replace("o", " ") for row in reversed(lower)]
    assert max(row.count(" ") for row in upper) == 32  # both slits and the passage, 4 of 9 mm
    assert "o" not in "".join(upper)


@pytest.mark.fem
@pytest.mark.parametrize("kind", ["film", "none"])
def test_a_segment_pressed_in_both_halves_does_not_bend(kind):
    both = actuator(replace(SMALL, passive="pressurised"), Constraint(kind))
    solution = both.solve(Curve((0.2, 0.4), SOFT), effort=EXACT)
    assert solution.status is Status.CONVERGED
    np.testing.assert_allclose(solution.bend_angle, 0.0, atol=1e-9)
    # while the same pressure in one half bends it
    one = actuator(constraint=Constraint(kind)).solve(Curve((0.2, 0.4), SOFT), effort=EXACT)
    assert np.all(one.bend_angle > 5e-3)


@pytest.mark.fem
def test_without_a_layer_the_middle_gets_longer_and_with_a_film_it_does_not():
    none, film = (
        actuator(constraint=Constraint(kind)).solve(Curve((0.4,), SOFT))
        for kind in ("none", "film")
    )
    stretch = [float(s.arc_length[0]) / SMALL.length - 1.0 for s in (none, film)]
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
    both, angles = replace(SMALL, passive="pressurised"), {}
    for height in (3.0, 4.0, 5.0):
        of = actuator(both, Constraint("film", height))
        material = replace(SOFT, paper_mismatch=0.01)
        state = at_rest(Problem(of.system, material), EXACT)
        angles[height] = read_state(of.mesh, state).bend_angle
    assert angles[3.0] == pytest.approx(-angles[5.0], rel=1e-8)
    assert abs(angles[3.0]) > 1e-3
    assert angles[4.0] == pytest.approx(0.0, abs=1e-10)


@pytest.mark.fem
@pytest.mark.parametrize("passive", ["open", "none"])
def test_work_of_the_pressure_is_the_energy_stored(path_of, stored_energy, passive):
    """∫ p dV = p V − ∫ V dp, the latter by a rule of fourth order from V and dV/dp."""
    of = actuator(replace(SMALL, passive=passive))
    problem, n, load = Problem(of.system, SOFT), 10, 0.3
    loads = np.linspace(0.0, load, n + 1)
    path = path_of(problem, tuple(loads[1:]), EXACT)
    points = (path.rest, *path.points)
    volume = np.array([problem.cavity_volume(p.state) for p in points])
    rate = [np.sum(problem.cavity_gradient(p.state) * p.rate.displacement) for p in points]
    step = load / n
    integral = np.trapezoid(volume, dx=step) + step**2 / 12.0 * (rate[0] - rate[-1])
    work = load * volume[-1] - integral
    stored = stored_energy(problem, points[-1].state.displacement)
    assert stored > 0.0
    print(f"{passive}: work over energy - 1 is {work / stored - 1.0:.1e}")
    assert work == pytest.approx(stored, rel=1e-5)


@pytest.mark.fem
@pytest.mark.parametrize("kind", ["film", "none"])
def test_both_assemblies_solve_the_same_curve(kind):
    ours = actuator(constraint=Constraint(kind))
    theirs = Actuator(ours.mesh, backend="scikit-fem")
    curve = Curve((0.1, 0.3), replace(SOFT, skin=0.2, paper_slack=0.002))
    one, other = (a.solve(curve, effort=EXACT) for a in (ours, theirs))
    np.testing.assert_allclose(other.readings, one.readings, rtol=1e-9, atol=1e-12)


@pytest.mark.fem
@pytest.mark.parametrize("name", ["c2_ratio", "paper_group", "wall_factor", "erosion"])
def test_derivatives_are_those_of_solutions_done_anew(name):
    of, curve = actuator(constraint=Constraint("film", 4.6)), Curve((0.3,), SOFT)
    _, gradients = of.solve_with_gradients(curve, effort=EXACT)
    value, step = getattr(SOFT, name), 1e-4 * max(1.0, abs(getattr(SOFT, name)))
    if name == "erosion":  # not below 0
        curve = Curve((0.3,), replace(SOFT, erosion=2.0 * step))
        value = 2.0 * step
    low, high = (
        of.solve(
            Curve((0.3,), replace(curve.material, **{name: value + side * step})), effort=EXACT
        ).bend_angle[0]
        for side in (-1.0, 1.0)
    )
    found = gradients[0, 0, INPUTS.index(name)]
    assert found == pytest.approx((high - low) / (2.0 * step), rel=2e-3)


@pytest.mark.fem
def test_the_forward_map_answers_and_smaller_parts_bend_more():
    one = np.ones((1, 1))
    pressure = np.array([[2.0, 4.0]])
    forward = ExactMap(SegmentGeometry(SMALL), ONE_ELEMENT_A_WALL)
    plain = Inputs(
        pressure, 0.01 * one, 0 * one, 0 * one, one, 3e3 * one, paper_thickness=0.1 * one
    )
    found = forward(plain)
    assert np.all(found.status == Status.CONVERGED)
    assert 0.0 < found.curvature[0, 0] < found.curvature[0, 1]
    # half the size with half the film: the same shape
    film = {"paper_stiffness": 1.5e3 * one, "paper_thickness": 0.05 * one}
    half = forward(replace(plain, linear_scale=0.5 * one, **film))
    np.testing.assert_allclose(half.curvature, 2.0 * found.curvature, rtol=1e-9)


def test_meshes_follow_the_slits():
    default, small = (SegmentGeometry(d) for d in (RibbedDimensions(), SMALL))
    mesh = build_mesh(default, default.mesh_like(FINE))
    assert 60_000 < 3 * len(mesh.body.nodes) < 90_000
    assert small.mesh_like(FINE).along == pytest.approx(1.0)
    assert Geometry(Dimensions()).mesh_like(FINE) == FINE
    assert System(mesh.body).bending.nnz > 0
