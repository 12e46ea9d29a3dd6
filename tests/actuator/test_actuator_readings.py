"""Bend angle and arc length of shapes that are known."""

import numpy as np
import pytest

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.outputs import read_state
from bayesdeg.actuator.problem import MechanicalState
from bayesdeg.data.settings import Dimensions


def placed(actuator, positions):
    return MechanicalState(
        positions - actuator.mesh.body.nodes, actuator.system.rest().pressure, 0.0
    )


def turned(nodes, angle):
    """Rotated towards the paper, that is from z towards x, about a point far away."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return (nodes - [3.0, 0.0, -11.0]) @ turn.T + [100.0, 0.0, 5.0]


@pytest.mark.parametrize("angle", [-3.0, -0.4, 0.0, 1e-6, 0.7, 1.6, 3.1])
def test_rigid_rotation_is_returned_exactly(two_chambers, angle):
    reading = read_state(
        two_chambers.mesh, placed(two_chambers, turned(two_chambers.mesh.body.nodes, angle))
    )
    assert reading.bend_angle == pytest.approx(angle, abs=1e-13)
    assert reading.arc_length == pytest.approx(20.0, rel=1e-13)
    assert reading.peak_stretch == pytest.approx(1.0, abs=1e-12)


def test_angle_beyond_half_a_turn_follows_the_angle_before(two_chambers):
    previous = 0.0
    for angle in np.linspace(0.0, 14.0, 9):
        state = placed(two_chambers, turned(two_chambers.mesh.body.nodes, angle))
        previous = read_state(two_chambers.mesh, state, previous_angle=previous).bend_angle
        assert previous == pytest.approx(angle, abs=1e-12)


def test_end_rotation_ignores_stretch_of_the_end_and_its_shift(two_chambers):
    nodes = two_chambers.mesh.body.nodes * [1.0, 1.4, 0.7]
    reading = read_state(two_chambers.mesh, placed(two_chambers, turned(nodes, 0.9)))
    assert reading.bend_angle == pytest.approx(0.9, abs=1e-13)


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.5])
def test_arc_length_of_a_straight_line_is_exact(two_chambers, stretch):
    state = placed(two_chambers, two_chambers.mesh.body.nodes * [stretch, 1.0, 1.0])
    reading = read_state(two_chambers.mesh, state)
    assert reading.arc_length == pytest.approx(20.0 * stretch, rel=1e-13)


def test_curvature_of_a_circular_arc_is_one_over_its_radius():
    mesh = build_mesh(
        Geometry(Dimensions(length=20.0, chambers=2)), Resolution(along=1.0, across=9.0, up=9.0)
    )
    x, y, z = mesh.body.nodes.T
    for radius in (15.0, 25.0, 100.0):
        # the bottom bends on a circle about (0, -radius), the sections stay plane
        bent = np.stack(
            [
                (radius + z) * np.sin(x / radius),
                y,
                (radius + z) * np.cos(x / radius) - radius,
            ],
            axis=1,
        )
        state = MechanicalState(bent - mesh.body.nodes, np.zeros((len(mesh.body.elements), 4)), 0.0)
        reading = read_state(mesh, state)
        assert reading.bend_angle == pytest.approx(20.0 / radius, rel=1e-12)
        assert reading.curvature == pytest.approx(1.0 / radius, rel=1e-6)


def test_arc_length_of_a_circle_converges_at_fourth_order():
    errors = []
    for along in (4.0, 2.0, 1.0):
        mesh = build_mesh(
            Geometry(Dimensions(length=20.0, chambers=1, end_wall=4.0)),
            Resolution(along=along, across=9.0, up=9.0),
        )
        x, y, z = mesh.body.nodes.T
        turn, radius = x / 10.0, 10.0 + z
        bent = np.stack([radius * np.sin(turn), y, radius * np.cos(turn) - 10.0], axis=1)
        state = MechanicalState(bent - mesh.body.nodes, np.zeros((len(mesh.body.elements), 4)), 0.0)
        errors.append(abs(read_state(mesh, state).arc_length - 20.0))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(orders, 4.0, atol=0.3)
