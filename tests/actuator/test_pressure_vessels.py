"""Thick cylinder and sphere of Yeoh's solid against quadrature of the incompressible solution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from bayesdeg.actuator.body import boundary_faces, box, isoparametric
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.status import PathEffort

pytestmark = pytest.mark.fem

INNER, OUTER, GROWN = 1.0, 2.0, 1.4  # radii at rest, and of the bore under pressure [mm]
C2, C3 = -0.03, 0.01
YEOH = MaterialGroups(C2, C3, paper_group=0.0, bulk_ratio=1e7)
EXACT = PathEffort(tolerance=1e-10, iterations=15, rate_tolerance=1e-3)


def slope(first):
    """∂W/∂I₁ of Yeoh's solid."""
    return 1.0 + 2.0 * C2 * (first - 3.0) + 3.0 * C3 * (first - 3.0) ** 2


def cylinder_pressure():
    """p = ∫ (σ_θ − σ_r) dr/r with r² = R² + a² − A², in plane strain."""

    def integrand(rest):
        placed = np.sqrt(rest**2 + GROWN**2 - INNER**2)
        hoop, radial = (placed / rest) ** 2, (rest / placed) ** 2
        return 2.0 * slope(hoop + radial + 1.0) * (hoop - radial) * rest / placed**2

    return quad(integrand, INNER, OUTER, epsabs=1e-13, epsrel=1e-13)[0]


def sphere_pressure():
    """p = ∫ 2 (σ_θ − σ_r) dr/r with r³ = R³ + a³ − A³."""

    def integrand(rest):
        placed = np.cbrt(rest**3 + GROWN**3 - INNER**3)
        hoop, radial = (placed / rest) ** 2, (rest / placed) ** 4
        stress = 2.0 * slope(2.0 * hoop + radial) * (hoop - radial)
        return 2.0 * stress * rest**2 / placed**3

    return quad(integrand, INNER, OUTER, epsabs=1e-13, epsrel=1e-13)[0]


def quarter(n):
    """Quarter of a ring between planes z = 0 and 0.5 that hold it, n bricks through the wall."""
    brick = box((1.0, 1.0, 0.5), divisions=(n, n, 1))
    radius = INNER + (OUTER - INNER) * brick.nodes[:, 0]
    angle = 0.5 * np.pi * brick.nodes[:, 1]
    nodes = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), brick.nodes[:, 2]])
    held = np.isclose(nodes, 0.0)
    held[:, 2] = True
    body = replace(brick.placed_at(nodes), fixed=held)
    faces = boundary_faces(body)
    return body, faces[np.all(np.isclose(brick.nodes[faces, 0], 0.0), axis=1)]


def bore_force(body, faces, rule):
    """Dead nodal forces of the pressure p on the grown bore: p a/A along R, on the bore at rest."""
    shapes, first, second, weights = rule
    x, a, b = (np.einsum("qa,fai->fqi", s, body.nodes[faces]) for s in (shapes, first, second))
    area = np.linalg.norm(np.cross(a, b), axis=-1)
    outward = x * [1.0, 1.0, 0.0]
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    traction = cylinder_pressure() * GROWN / INNER
    local = traction * np.einsum("q,fq,fqi,qa->fai", weights, area, outward, shapes)
    force = np.zeros_like(body.nodes)
    np.add.at(force, faces, local)
    return force


def octant(cube):
    """An eighth of a hollow sphere: three unit cubes of one mesh that meet in (1, 1, 1)."""
    radius = INNER + (OUTER - INNER) * cube.nodes[:, :1]
    towards = np.column_stack(
        [np.ones(len(cube.nodes)), *np.tan(0.25 * np.pi * cube.nodes[:, 1:]).T]
    )
    block = radius * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    every = np.concatenate([np.roll(block, turn, axis=1) for turn in range(3)])
    _, first, node = np.unique(np.round(every, 9), axis=0, return_index=True, return_inverse=True)
    nodes = every[first]
    elements = np.concatenate([cube.elements + turn * len(block) for turn in range(3)])
    elements = node.ravel()[elements]
    gradients, weights = isoparametric(cube.element, nodes[elements])
    body = replace(
        cube,
        nodes=nodes,
        elements=elements,
        gradients=gradients,
        weights=weights,
        fixed=np.isclose(nodes, 0.0),
        depth=np.full(weights.shape, np.inf),
    )
    faces = boundary_faces(body)
    radii = np.linalg.norm(nodes[faces], axis=2)
    return replace(body, cavity=faces[np.all(np.isclose(radii, INNER), axis=1)])


def of_bricks(n):
    return octant(box((1.0, 1.0, 1.0), divisions=(n, n, n)))


def errors_of_sphere(octants, path_of):
    """Errors of the bore's radius under the pressure of the closed form, mesh by mesh."""
    errors = []
    for body in octants:
        path = path_of(Problem(System(body), YEOH), (sphere_pressure(),), EXACT)
        found = mean_radius(body, path.states[0].displacement, np.unique(body.cavity))
        errors.append(abs(found / GROWN - 1.0))
    return errors


def mean_radius(body, displacement, at):
    placed = (body.nodes + displacement)[at]
    return float(np.mean(np.linalg.norm(placed, axis=1)))


def test_thick_cylinder_under_the_traction_of_its_pressure(at_rest, face_rule):
    """Forces given, so that only the solid is at stake; the error is the bore's radius."""
    errors = []
    for n in (1, 2, 4):
        body, faces = quarter(n)
        problem = Problem(System(body), YEOH, nodal_force=bore_force(body, faces, face_rule(2)))
        placed = body.nodes + at_rest(problem, EXACT).displacement
        bore = np.linalg.norm(placed[np.unique(faces)][:, :2], axis=1)
        errors.append(abs(bore.mean() / GROWN - 1.0))
    orders = -np.diff(np.log2(errors))
    print("cylinder: error of the bore", [f"{e:.1e}" for e in errors], "orders", orders.round(2))
    assert errors[-1] < 1e-3
    assert np.all(orders > 2.5)


def test_thick_sphere_under_follower_pressure(path_of):
    """The pressure of the closed form grows the bore to the radius of the closed form."""
    errors = errors_of_sphere(map(of_bricks, (1, 2, 4)), path_of)
    orders = -np.diff(np.log2(errors))
    print("sphere: error of the bore", [f"{e:.1e}" for e in errors], "orders", orders.round(2))
    assert errors[-1] < 1e-3
    assert np.all(orders > 2.5)


def test_compressibility_of_the_sphere_is_in_proportion_to_one_over_the_bulk_modulus(path_of):
    """What K/C1 = 1e5 leaves of the difference to the incompressible solution."""
    body, radii = of_bricks(2), []
    for bulk in (1e3, 1e4, 1e5, 1e8):
        problem = Problem(System(body), replace(YEOH, bulk_ratio=bulk))
        path = path_of(problem, (sphere_pressure(),), EXACT)
        radii.append(mean_radius(body, path.states[0].displacement, np.unique(body.cavity)))
    differences = np.array(radii[:-1]) / radii[-1] - 1.0
    print("sphere: growth of the bore by compressibility at K/C1 = 1e3, 1e4, 1e5:", differences)
    np.testing.assert_allclose(differences[:-1] / differences[1:], 10.0, rtol=0.02)
    assert 0.0 < differences[-1] < 1e-4


def test_cavity_of_the_sphere_at_rest_converges_to_the_eighth_of_a_ball():
    errors = []
    for n in (1, 2, 4):
        body = of_bricks(n)
        problem = Problem(System(body), YEOH)
        volume = problem.linearise(problem.system.rest(), tangent=False).cavity_volume
        errors.append(abs(volume / (np.pi / 6.0) - 1.0))
    orders = -np.diff(np.log2(errors))
    print("ball: error of the volume", [f"{e:.1e}" for e in errors], "orders", orders.round(2))
    np.testing.assert_allclose(orders, 4.0, atol=0.4)
