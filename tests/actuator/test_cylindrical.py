"""Straight channels beside the axis: volumes, symmetry, energy, both assemblies, a thick tube."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import Resolution, build_mesh, reshaped
from bayesdeg.actuator.problem import Problem
from bayesdeg.actuator.section import air_volume, section
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import FINE, Status
from bayesdeg.data.families import Constraint, CylindricalDimensions
from bayesdeg.errors import GeometryError
from tests.actuator.test_ribbed import EXACT, ONE_ELEMENT_A_WALL, SOFT, cavity

# two channels in each half beside the plane of symmetry
SMALL = CylindricalDimensions(
    length=16.0,
    width=8.0,
    height=8.0,
    channels=2,
    channel_length=12.0,
    channel_width=2.0,
    channel_height=1.5,
    pitch=3.0,
    offset=2.2,
)


def actuator(dimensions=SMALL, constraint=None, **changes):
    geometry = SegmentGeometry(dimensions, constraint=constraint or Constraint(), **changes)
    return Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))


@st.composite
def possible(draw):
    size = st.floats(0.5, 4.0)
    wide, wall, side, deep, under, cover, end = (draw(size) for _ in range(7))
    count, long = draw(st.integers(1, 4)), draw(st.floats(2.0, 40.0))
    passive = draw(st.sampled_from(["open", "pressurised", "solid", "none"]))
    halves = 1 if passive == "none" else 2
    return CylindricalDimensions(
        length=long + 2.0 * end,
        width=count * wide + (count - 1) * wall + 2.0 * side,
        height=halves * (under + deep + cover),
        channels=count,
        channel_length=long,
        channel_width=wide,
        channel_height=deep,
        pitch=wide + wall,
        offset=under + 0.5 * deep,
        passive=passive,
    )


@settings(max_examples=25, deadline=None)
@given(possible())
def test_the_mesh_holds_exactly_material_and_air_of_the_boxes(d):
    geometry = SegmentGeometry(d)
    body = build_mesh(geometry, ONE_ELEMENT_A_WALL).body
    air = d.channels * d.channel_length * d.channel_width * d.channel_height
    halves = {"open": 2, "pressurised": 2, "solid": 1, "none": 1}[d.passive]
    block = d.length * d.width * d.height
    assert 2.0 * body.volume == pytest.approx(block - halves * air, rel=1e-10)
    assert geometry.volume == pytest.approx(2.0 * body.volume, rel=1e-12)
    pressed = 2 if d.passive == "pressurised" else 1
    assert 2.0 * cavity(body) == pytest.approx(pressed * air, rel=1e-10)
    assert air_volume(geometry) == pytest.approx(pressed * air, rel=1e-10)
    assert geometry_of_record(geometry.record()).planes()[1].tolist() == pytest.approx(
        geometry.planes()[1].tolist()
    )


def test_the_default_cavity_is_that_of_its_authors():
    """doi:10.1089/soro.2014.0022: 0.31 ml a side."""
    geometry = geometry_of(CylindricalDimensions())
    assert 1e-3 * air_volume(geometry) == pytest.approx(0.31, abs=0.005)
    mesh = build_mesh(geometry, geometry.mesh_like(FINE))
    assert 40_000 < 3 * len(mesh.body.nodes) < 90_000


def test_an_even_number_of_channels_leaves_the_middle_solid():
    for count, first in ((1, 0.0), (2, 0.5), (3, 0.0), (4, 0.5)):
        d = replace(SMALL, channels=count, width=20.0)
        boxes = SegmentGeometry(d).upper
        assert len(boxes) == (count + 1) // 2
        assert min(across[0] for _, across, _ in boxes) == pytest.approx(first)
    drawn = section(SegmentGeometry(SMALL), 64).splitlines()
    assert max(row.count(" ") for row in drawn) == 48  # 12 of 16 mm


@pytest.mark.parametrize("wall_factor", [0.8, 1.2])
@pytest.mark.parametrize("passive", ["open", "none"])
def test_moved_walls_hold_what_a_new_mesh_holds(wall_factor, passive):
    d = replace(SMALL, passive=passive, offset=2.2)
    mesh = build_mesh(SegmentGeometry(d), ONE_ELEMENT_A_WALL)
    moved = reshaped(mesh, wall_factor=wall_factor, erosion=0.15)
    anew = build_mesh(moved.geometry, ONE_ELEMENT_A_WALL)
    np.testing.assert_allclose(moved.body.nodes, anew.body.nodes, atol=1e-12)
    np.testing.assert_allclose(moved.body.depth, anew.body.depth, atol=1e-12)
    wall = 1.0 * (wall_factor - 1.0)
    assert np.ptp(moved.geometry.upper[0][1]) == pytest.approx(2.0 - wall)


@pytest.mark.parametrize(
    "changes", [{"wall_factor": 4.0}, {"erosion": 1.6}, {"erosion": -0.1}, {"wall_factor": -1.0}]
)
def test_walls_that_are_lost_are_refused(changes):
    with pytest.raises(GeometryError):
        SegmentGeometry(SMALL, **changes)
    material = replace(SOFT, **{"wall_factor": 1.0, "erosion": 0.0} | changes)
    assert actuator().solve(Curve((0.1,), material)).status is Status.INVALID_INPUT


@pytest.mark.fem
def test_a_segment_pressed_in_both_halves_does_not_bend():
    both = actuator(replace(SMALL, passive="pressurised"), Constraint("film"))
    solution = both.solve(Curve((0.2, 0.4), SOFT), effort=EXACT)
    assert solution.status is Status.CONVERGED
    np.testing.assert_allclose(solution.bend_angle, 0.0, atol=1e-9)
    one = actuator(constraint=Constraint("film")).solve(Curve((0.2, 0.4), SOFT), effort=EXACT)
    assert np.all(one.bend_angle > 2e-3)


@pytest.mark.fem
def test_a_straight_channel_does_not_bend_an_incompressible_block_to_first_order():
    """Closed form: the moment on its ends is undone by the contraction of the walls it widens.

    With tractions -p n on the walls of the channel and the displacements (yz, (z^2 - y^2)/2), whose
    strain is z times the identity, the stresses across a section have the moment
    int z (s_yy + s_zz) dA = 2 p A z_c. A section bends by int z (s_xx - (s_yy + s_zz)/2) dA, of
    which the ends give int z s_xx dA = p A z_c: nothing is left. A longer channel bends no more.
    """
    gentle = replace(SOFT, c2_ratio=0.0, c3_ratio=0.0, bulk_ratio=1e6)
    angles, beams = [], []
    for length in (24.0, 48.0):
        d = replace(SMALL, length=length + 8.0, channel_length=length, channels=1, passive="none")
        geometry = SegmentGeometry(replace(d, height=4.0), constraint=Constraint("none"))
        of = Actuator(build_mesh(geometry, Resolution(along=4.0, across=2.0, up=1.0)))
        angles.append(of.solve(Curve((1e-4,), gentle), effort=EXACT).bend_angle[0])
        beams.append(1e-4 * geometry.dimensions.beam_bending)
    longer = (angles[1] - angles[0]) / (beams[1] - beams[0])
    print(f"bending by a longer channel over that of a beam pressed at its ends: {longer:.1e}")
    assert abs(longer) < 1e-3


@pytest.mark.fem
@pytest.mark.parametrize("passive", ["open", "none"])
def test_work_of_the_pressure_is_the_energy_stored(passive, path_of, stored_energy):
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
def test_both_assemblies_solve_the_same_curve():
    ours = actuator(constraint=Constraint("film"))
    theirs = Actuator(ours.mesh, backend="scikit-fem")
    curve = Curve((0.1, 0.3), replace(SOFT, skin=0.2, paper_slack=0.002))
    one, other = (a.solve(curve, effort=EXACT) for a in (ours, theirs))
    np.testing.assert_allclose(other.readings, one.readings, rtol=1e-9, atol=1e-12)


@pytest.mark.fem
@pytest.mark.parametrize("name", ["paper_group", "wall_factor"])
def test_derivatives_are_those_of_solutions_done_anew(name):
    of = actuator(constraint=Constraint("film"))
    _, gradients = of.solve_with_gradients(Curve((0.3,), SOFT), effort=EXACT)
    value = getattr(SOFT, name)
    step = 1e-4 * max(1.0, abs(value))
    low, high = (
        of.solve(
            Curve((0.3,), replace(SOFT, **{name: value + side * step})), effort=EXACT
        ).bend_angle[0]
        for side in (-1.0, 1.0)
    )
    found = gradients[0, 0, INPUTS.index(name)]
    assert found == pytest.approx((high - low) / (2.0 * step), rel=2e-3)


@pytest.mark.fem
def test_the_forward_map_answers_and_smaller_parts_bend_more():
    one = np.ones((1, 1))
    forward = ExactMap(SegmentGeometry(SMALL), ONE_ELEMENT_A_WALL)
    plain = Inputs(
        np.array([[2.0, 4.0]]), 0.01 * one, 0 * one, 0 * one, one, 3e3 * one, paper_thickness=one
    )
    found = forward(plain)
    assert np.all(found.status == Status.CONVERGED)
    assert 0.0 < found.curvature[0, 0] < found.curvature[0, 1]
    film = {"paper_stiffness": 1.5e3 * one, "paper_thickness": 0.5 * one}
    half = forward(replace(plain, linear_scale=0.5 * one, **film))
    np.testing.assert_allclose(half.curvature, 2.0 * found.curvature, rtol=1e-9)
