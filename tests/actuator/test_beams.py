"""Beams: tip load and weight against Euler and Bernoulli, a bimetal strip against Timoshenko."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bayesdeg.actuator.body import boundary_faces, box
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.status import PathEffort

pytestmark = pytest.mark.fem

YOUNG = 6.0  # of an incompressible solid of shear modulus 2 C1 [C1]
SOLID = MaterialGroups(0.0, 0.0, paper_group=0.0, bulk_ratio=1e5)
EXACT = PathEffort(tolerance=1e-10, iterations=12)
HEIGHT, WIDTH = 1.0, 1.0
SLENDERNESS = (4, 8, 16, 32)


def cantilever(slenderness):
    """Held at x = 0 so that the section stays plane but may contract, as the formula assumes."""
    body = box((slenderness * HEIGHT, WIDTH, HEIGHT), divisions=(2 * slenderness, 1, 2))
    held = np.zeros_like(body.fixed)
    held[:, :2] = np.isclose(body.nodes[:, :2], 0.0)
    # one node: more of them would keep the section from bending across
    held[:, 2] = np.all(np.isclose(body.nodes, [0.0, 0.0, 0.5 * HEIGHT]), axis=1)
    return replace(body, fixed=held)


def tip(body, displacement):
    end = np.isclose(body.nodes[:, 0], body.nodes[:, 0].max())
    return float(displacement[end, 2].mean())


def errors_against(formula, load, at_rest):
    found = []
    for slenderness in SLENDERNESS:
        body, length = cantilever(slenderness), slenderness * HEIGHT
        problem = load(System(body), length)
        deflection = tip(body, at_rest(problem, EXACT).displacement)
        assert abs(deflection) < 2e-3 * length  # small enough for a linear formula
        found.append(deflection / formula(length) - 1.0)
    return found


def test_cantilever_under_a_tip_load_approaches_euler_and_bernoulli(at_rest):
    inertia = WIDTH * HEIGHT**3 / 12.0

    def force(length):
        return 1e-3 * 3.0 * YOUNG * inertia / length**2  # deflects by a thousandth of the length

    def load(system, length):
        on_end = np.isclose(system.body.nodes[:, 0], length)
        pull = np.zeros_like(system.body.nodes)
        # shared as ∫ N dA over the end, which the volumes of its nodes are in proportion to
        share = np.where(on_end, system.volumes, 0.0)
        pull[:, 2] = force(length) * share / share.sum()
        return Problem(system, SOLID, nodal_force=pull)

    errors = errors_against(
        lambda length: force(length) * length**3 / (3.0 * YOUNG * inertia), load, at_rest
    )
    print(
        "tip load: error at slenderness", dict(zip(SLENDERNESS, np.round(errors, 5), strict=True))
    )
    assert all(abs(b) < abs(a) for a, b in pairwise(errors))
    assert abs(errors[-1]) < 0.01


def test_cantilever_under_its_weight_approaches_euler_and_bernoulli(at_rest):
    inertia, area = WIDTH * HEIGHT**3 / 12.0, WIDTH * HEIGHT

    def weight(length):
        return 1e-3 * 8.0 * YOUNG * inertia / (area * length**3)

    def load(system, length):
        return Problem(system, replace(SOLID, gravity_up=-weight(length)))

    errors = errors_against(
        lambda length: -weight(length) * area * length**4 / (8.0 * YOUNG * inertia), load, at_rest
    )
    print("weight: error at slenderness", dict(zip(SLENDERNESS, np.round(errors, 5), strict=True)))
    assert all(abs(b) < abs(a) for a, b in pairwise(errors))
    assert abs(errors[-1]) < 0.01


def test_hanging_column_stretches_under_its_weight(at_rest):
    """u = ρ g L²/(2 E) far from the clamp, where the lateral strain is free."""
    errors = []
    for slenderness in (4, 8, 16):
        body, length = cantilever(slenderness), slenderness * HEIGHT
        weight = 1e-4 / length
        problem = Problem(System(body), replace(SOLID, gravity_along=weight))
        end = np.isclose(body.nodes[:, 0], length)
        stretch = at_rest(problem, EXACT).displacement[end, 0].mean()
        errors.append(stretch / (weight * length**2 / (2.0 * YOUNG)) - 1.0)
    print("hanging: error", np.round(errors, 5))
    assert all(abs(b) < abs(a) for a, b in pairwise(errors))
    assert abs(errors[-1]) < 0.03


MISMATCH = 1e-4


def strip(width):
    """Half a strip on paper, cut at y = 0 and x = 0: it bends freely.

    Across, solid and paper are at odds within a depth like the width: bricks are as flat there.
    """
    body = box((10.0, 0.5 * width, HEIGHT), divisions=(20, 1, 6))
    graded = body.nodes.copy()
    planes = np.linspace(0.0, HEIGHT, 7)
    graded[:, 2] = np.interp(body.nodes[:, 2], planes, HEIGHT * (planes / HEIGHT) ** 2.5)
    body = body.placed_at(graded)
    faces = boundary_faces(body)
    faces = faces[np.all(np.isclose(body.nodes[faces, 2], 0.0), axis=1)]
    order = [np.lexsort((body.nodes[f, 1], body.nodes[f, 0])) for f in faces]
    held = np.zeros_like(body.fixed)
    held[:, :2] = np.isclose(body.nodes[:, :2], 0.0)
    held[:, 2] = np.isclose(body.nodes[:, 0], 0.0) & np.isclose(body.nodes[:, 2], 0.0)
    return replace(body, fixed=held, paper=np.take_along_axis(faces, np.array(order), axis=1))


def curvature(body, displacement):
    """Of the bottom's middle line between x = 4 and x = 6, far from both ends."""
    at = [
        np.flatnonzero(np.all(np.isclose(body.nodes, [x, 0.0, 0.0]), axis=1))[0]
        for x in (4.0, 5.0, 6.0)
    ]
    return float(np.diff(displacement[at, 2], 2)[0])


def timoshenko(paper_group, bending=0.0):
    """κ = ε a/(a² + (D1 + D2)(1/A1 + 1/A2)); doi:10.1364/JOSA.11.000233."""
    arm, axial = HEIGHT / 2.0, YOUNG * HEIGHT
    stiffness = YOUNG * HEIGHT**3 / 12.0 + bending
    return MISMATCH * arm / (arm**2 + stiffness * (1.0 / axial + 1.0 / paper_group))


@pytest.mark.parametrize("poisson", [0.0, 0.3])
@pytest.mark.parametrize("thickness", [0.0, 0.8])
@pytest.mark.parametrize("group", [3.0, 12.0])
def test_bimetal_strip_bends_as_timoshenko_says(at_rest, poisson, thickness, group):
    """In the limit of a narrow strip, where each layer is stressed along only.

    What the layers do to each other across is in proportion to the width, and is extrapolated
    away. The paper's bending is that of a plate, D = Et t²/(12 (1 − ν²)); the longer layer is
    outside.
    """
    bending = group * thickness**2 / (12.0 * (1.0 - poisson**2))
    errors = []
    for width in (0.2, 0.1, 0.05):
        body = strip(width)
        material = replace(
            SOLID,
            paper_group=group,
            paper_poisson=poisson,
            paper_thickness=thickness,
            paper_mismatch=MISMATCH,
        )
        found = curvature(body, at_rest(Problem(System(body), material), EXACT).displacement)
        errors.append(found / timoshenko(group, bending) - 1.0)
    share = timoshenko(group, bending) / timoshenko(group) - 1.0
    print(
        f"Et {group} ν {poisson} t {thickness}: errors {np.round(errors, 5)}, without width"
        f" {2.0 * errors[-1] - errors[-2]:.1e}; the paper's bending is {share:.3f} of the formula"
    )
    assert all(abs(b) < abs(a) for a, b in pairwise(errors))
    assert abs(2.0 * errors[-1] - errors[-2]) < 2e-3


def test_curvature_of_the_strip_is_in_proportion_to_a_small_mismatch(at_rest):
    body = strip(0.2)
    one, three = (
        curvature(
            body,
            at_rest(
                Problem(System(body), replace(SOLID, paper_group=12.0, paper_mismatch=m)), EXACT
            ).displacement,
        )
        for m in (MISMATCH, -3.0 * MISMATCH)
    )
    assert three == pytest.approx(-3.0 * one, rel=2e-3)
