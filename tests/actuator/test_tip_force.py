"""Blocked tip force by finite elements, against beams and against the free actuator."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import boundary_faces, box, faces_on_plane
from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, ActuatorMesh, build_mesh, grid_order, tip_edge
from bayesdeg.actuator.outputs import face_rotation
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import PathEffort, Resolution, Status
from bayesdeg.data.settings import Dimensions

SMALL = Geometry(Dimensions(length=20.0, chambers=2))
COARSEST = Resolution(9.0, 9.0, 9.0)
YEOH = MaterialGroups(c2_ratio=-0.01, c3_ratio=0.01, paper_group=120.0)
C1 = 0.3


def inputs(pressure, **changed):
    one = np.ones((1, 1))
    plain = {"c1": C1, "c2": -0.003, "c3": 0.003, "linear_scale": 1.0, "paper_stiffness": 3e4}
    values = {name: value * one for name, value in (plain | changed).items()}
    return Inputs(pressure=np.atleast_2d(np.asarray(pressure, float)), **values)


def bar(length, width, height, divisions):
    """A solid bar, clamped at x = 0, with paper on its bottom."""
    body = box((length, width, height), divisions=divisions)
    faces = boundary_faces(body)
    end = np.isclose(body.nodes[faces][..., 0], length).all(axis=1)
    line = np.flatnonzero(np.isclose(body.nodes[:, 1], 0) & np.isclose(body.nodes[:, 2], 0))
    body = replace(body, paper=grid_order(body.nodes, faces_on_plane(body, 0.0)))
    return ActuatorMesh(SMALL, body, grid_order(body.nodes, faces[end]), line)


@pytest.mark.parametrize("paper", [0.0, 40.0])
def test_a_uniform_moment_is_held_by_three_halves_of_it_over_the_length(paper):
    """A couple at the free end bends the bar alike all along: F = 3 M/(2 L), whatever B is.

    Shear lets a bar of height h give way to the force, which is so 0.9 (h/L)² = 0.2 % smaller.
    """
    length, width, height, moment = 60.0, 2.0, 3.0, 1e-4
    mesh = bar(length, width, height, (24, 2, 3))
    material = MaterialGroups(0.0, 0.0, paper, bulk_ratio=YEOH.bulk_ratio)
    held = Actuator(mesh, held=True)
    # the couple is what does the work M θ on the end face's rotation θ
    _, rotation = face_rotation(mesh.body, mesh.free_end, mesh.body.nodes, 0.0)
    problem = Problem(held.system, material, nodal_force=moment * rotation)
    rest = _path(problem, ()).rest
    force = problem.linearise(rest.state, tangent=False).force[tip_edge(mesh), 2].sum()
    expected = 1.5 * moment / length / (1.0 + 0.9 * (height / length) ** 2)
    assert force == pytest.approx(expected, rel=0.006)


def test_the_force_is_what_brings_the_free_tip_back():
    """At a small load all is linear: F is the tip's way over its way under a force of 1.

    Both of the free actuator: the pressure lifts the tip by as much as a force on its edge does.
    """
    mesh = build_mesh(SMALL, COARSE)
    load = 1e-5
    edge, system = tip_edge(mesh), System(mesh.body)
    held = Actuator(mesh, held=True)
    whole = held.tip_forces(Curve((load,), YEOH))
    _, problem = held.equations(Curve((load,), YEOH))
    state = _path(problem, (load,)).points[0].state
    reaction = problem.linearise(state, tangent=False).force[edge, 2]
    assert whole.readings[0, 0] == pytest.approx(reaction.sum(), rel=1e-12)
    push = np.zeros_like(mesh.body.nodes)
    push[edge, 2] = reaction
    free = Problem(system, YEOH, nodal_force=push)
    both, alone = _path(free, (load,)), _path(Problem(system, YEOH), (load,))
    lifted = both.points[0].state.displacement[edge, 2]
    sunk = alone.points[0].state.displacement[edge, 2]
    assert np.all(sunk < 0.0)
    assert np.max(np.abs(lifted)) < 1e-5 * np.max(np.abs(sunk))


def _path(problem, loads):
    solver = open_factorization(problem.system.upper)
    try:
        return follow(problem, solver, loads=loads)
    finally:
        solver.close()


def test_forces_scale_with_stress_and_area():
    forward = ExactMap(SMALL, COARSEST)
    plain = forward.tip_force(inputs([40.0, 80.0])).value
    stiffer = {"c1": 2.0 * C1, "c2": -0.006, "c3": 0.006, "paper_stiffness": 6e4}
    stiff = forward.tip_force(inputs([80.0, 160.0], **stiffer)).value
    np.testing.assert_allclose(stiff, 2.0 * plain, rtol=1e-6)
    half = forward.tip_force(
        inputs([40.0, 80.0], linear_scale=0.5, paper_stiffness=1.5e4, paper_thickness=0.05)
    )
    np.testing.assert_allclose(half.value, 0.25 * plain, rtol=1e-6)


def test_the_slope_is_that_of_the_curve_and_the_map_hands_it_on():
    forward = ExactMap(SMALL, COARSEST)
    found = forward.tip_force(inputs([99.0, 100.0, 101.0]))
    slope = (found.value[0, 2] - found.value[0, 0]) / 0.02
    assert found.slope[0, 1] == pytest.approx(slope, rel=2e-3)
    asked = forward(replace(inputs([99.0, 100.0, 101.0]), asked="tip_force")).further
    np.testing.assert_array_equal(asked.value, found.value)
    over = replace(inputs([100.0], reference_pressure=50.0), asked="tip_force")
    counted = forward(over).further.value
    zero = forward.tip_force(inputs([50.0, 100.0])).value
    # between the steps of its own path each curve is interpolated
    assert counted[0, 0] == pytest.approx(zero[0, 1] - zero[0, 0], rel=2e-3)


def test_both_backends_hold_the_tip_alike():
    ours, theirs = (
        ExactMap(SMALL, COARSEST, backend=backend).tip_force(inputs([60.0])).value
        for backend in ("kernels", "scikit-fem")
    )
    np.testing.assert_allclose(theirs, ours, rtol=1e-7)


def test_a_tip_that_is_free_has_no_force():
    with pytest.raises(ValueError, match="not held"):
        Actuator(build_mesh(SMALL, COARSEST)).tip_forces(Curve((0.1,), YEOH))


def test_impossible_inputs_are_a_status():
    held = Actuator(build_mesh(SMALL, COARSEST), held=True)
    found = held.tip_forces(Curve((0.1,), replace(YEOH, paper_group=-1.0)))
    assert found.status is Status.INVALID_INPUT
    assert found.readings.shape == (0, 1)


def test_derivatives_of_the_force_are_those_of_solutions_done_anew():
    """By every input, each moved a little either way; slack and weight included."""
    material = replace(
        YEOH,
        paper_thickness=0.1,
        second_invariant_ratio=0.1,
        skin=0.2,
        paper_slack=0.004,
        gravity_along=1e-5,
        gravity_up=2e-5,
        erosion=0.05,
        wall_factor=1.05,
    )
    held = Actuator(build_mesh(SMALL, COARSEST), held=True)
    effort = PathEffort(tolerance=1e-6, rate_tolerance=1e-7)
    found = held.sample(Curve((0.15,), material), effort=effort)
    assert found.readings.shape == (len(found.loads), 1)
    last = held.tip_forces(Curve((0.15,), material), effort=replace(effort, exact=True))
    assert found.readings[-1, 0] == pytest.approx(last.readings[0, 0], rel=1e-6)
    for column, name in enumerate(INPUTS):
        value = 0.15 if name == "load" else getattr(material, name)
        step = 1e-3 * abs(value) if value else 1e-5
        ends = []
        for sign in (-1.0, 1.0):
            load = 0.15 + sign * step if name == "load" else 0.15
            moved = material if name == "load" else replace(material, **{name: value + sign * step})
            curve = Curve((load,), moved)
            ends.append(held.tip_forces(curve, effort=replace(effort, exact=True)).readings[0, 0])
        slope = (ends[1] - ends[0]) / (2.0 * step)
        scale = abs(last.readings[0, 0]) / max(abs(value), 1e-2)
        assert found.gradients[-1, 0, column] == pytest.approx(slope, rel=2e-3, abs=1e-4 * scale), (
            name
        )
