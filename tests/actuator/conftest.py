"""Small models that solve in a fraction of a second, and an energy written without the kernels."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import QUADRATIC, box
from bayesdeg.actuator.curve import Actuator
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups, skin_profile
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.problem import MechanicalState, Problem
from bayesdeg.data.settings import Dimensions

COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
ONE_CHAMBER = Geometry(Dimensions(length=14.0, chambers=1))
TWO_CHAMBERS = Geometry(Dimensions(length=20.0, chambers=2))
# walls so thin that the actuator balloons at moderate pressure
THIN_WALLED = Geometry(
    Dimensions(
        length=20.0,
        chambers=2,
        roof=0.8,
        side_wall=0.8,
        chamber_wall=0.8,
        end_wall=0.8,
        floor=1.0,
        channel_height=1.0,
    )
)


@pytest.fixture(scope="session")
def one_chamber():
    return Actuator(build_mesh(ONE_CHAMBER, COARSEST))


@pytest.fixture(scope="session")
def two_chambers():
    return Actuator(build_mesh(TWO_CHAMBERS, COARSEST))


@pytest.fixture(scope="session")
def thin_walled():
    return Actuator(build_mesh(THIN_WALLED, COARSEST))


@pytest.fixture(scope="session")
def fresh():
    return MaterialGroups(
        -0.004 / 0.288, 0.0012 / 0.288, 30.0 / (0.288 * 0.843), paper_thickness=0.1 / 0.843
    )


@pytest.fixture(scope="session")
def every_effect():
    """A material in which every input of the model acts, at a typical size."""
    return MaterialGroups(
        c2_ratio=-0.02,
        c3_ratio=0.008,
        paper_group=60.0,
        second_invariant_ratio=0.3,
        skin=0.4,
        paper_thickness=0.25,
        paper_slack=0.004,
        paper_mismatch=0.01,
        gravity_along=4e-5,
        gravity_up=-6e-5,
    )


@pytest.fixture(scope="session")
def path_of():
    """The path of a problem, with the solver opened and closed."""

    def run(problem, loads, effort=None, solver=None):
        factorization = open_factorization(problem.system.upper, solver)
        try:
            return follow(problem, factorization, loads=loads, effort=effort)
        finally:
            factorization.close()

    return run


@pytest.fixture(scope="session")
def at_rest(path_of):
    """The equilibrium of a body without cavity under dead loads alone."""

    def run(problem, effort=None):
        # without a cavity nothing moves with the pressure, and relative changes of that are 0/0
        with np.errstate(invalid="ignore"):
            path = path_of(problem, (), effort)
        assert path.rest is not None, path.status.advice
        return path.rest.state

    return run


@pytest.fixture(scope="session")
def equilibria(path_of):
    """The path of an actuator of some material."""

    def run(actuator, material, loads, effort=None, solver=None):
        return path_of(Problem(actuator.system, material), loads, effort, solver)

    return run


@pytest.fixture(scope="session")
def random_state():
    """A smooth large deformation with noise on every node, and a random pressure field."""

    def draw(body, seed, noise=0.02, load=0.0):
        rng = np.random.default_rng(seed)
        affine = 0.08 * rng.standard_normal((3, 3))
        affine[1, [0, 2]] = 0.0  # the plane of symmetry stays where it is
        displacement = body.nodes @ affine.T + noise * rng.standard_normal(body.nodes.shape)
        displacement[np.isclose(body.nodes[:, 1], 0.0), 1] = 0.0
        modes = body.element.modes.shape[1]
        return MechanicalState(displacement, rng.standard_normal((len(body.elements), modes)), load)

    return draw


@pytest.fixture(scope="session")
def block():
    """Bricks without cavity; with a distortion no brick inside is a parallelepiped."""

    def build(counts=(2, 2, 2), size=(3.0, 2.0, 2.5), distortion=0.0, element=QUADRATIC):
        body = box(size, divisions=counts, element=element)
        x = body.nodes / np.array(size)
        hat = np.prod(4.0 * x * (1.0 - x), axis=1, keepdims=True)
        moved = body.nodes + distortion * hat * (
            np.array([0.3, -0.2, 0.25]) + 0.2 * np.sin(7.0 * x[:, [1, 2, 0]])
        )
        # the clamp of a box is not wanted here
        return replace(body.placed_at(moved), fixed=np.zeros_like(body.fixed))

    return build


def _lagrange(order, points):
    """Shapes and slopes of a line from interpolation, not from the kernels' formulas."""
    nodes = np.linspace(0.0, 1.0, order + 1)
    polynomials = [
        np.polynomial.Polynomial.fromroots(np.delete(nodes, i)) for i in range(order + 1)
    ]
    polynomials = [q / q(nodes[i]) for i, q in enumerate(polynomials)]
    return (
        np.stack([q(points) for q in polynomials], axis=-1),
        np.stack([q.deriv()(points) for q in polynomials], axis=-1),
    )


@pytest.fixture(scope="session")
def face_rule():
    """Shapes, slopes and weights on faces at the Gauss points."""

    def rule(order):
        points, weights = np.polynomial.legendre.leggauss(order + 1)
        n, dn = _lagrange(order, 0.5 * (points + 1.0))
        return np.kron(n, n), np.kron(dn, n), np.kron(n, dn), np.kron(weights, weights) / 4.0

    return rule


@pytest.fixture(scope="session")
def solid_energy():
    """Energy of the solid with the pressure field eliminated; analytic, so complex steps work."""

    def energy(body, displacement, material):
        local = displacement[body.elements]
        f = np.eye(3) + np.einsum("eai,eqja->eqij", local, body.gradients)
        j = np.linalg.det(f)
        c = np.einsum("eqki,eqkj->eqij", f, f)
        first = np.einsum("eqii->eq", c)
        second = 0.5 * (first**2 - np.einsum("eqij,eqji->eq", c, c))
        x = j ** (-2.0 / 3.0) * first - 3.0
        w = x + material.c2_ratio * x**2 + material.c3_ratio * x**3
        root = np.sqrt(j ** (-4.0 / 3.0) * second)
        w = w + material.second_invariant_ratio * (root - np.sqrt(3.0))
        w = w * np.exp(material.skin * skin_profile(body))
        modes = body.element.modes
        mass = np.einsum("eq,qm,qn->emn", body.weights, modes, modes)
        r = np.einsum("eq,qm,eq->em", body.weights, modes, j - 1.0)
        volumetric = np.einsum("em,emn,en->", r, np.linalg.inv(mass), r)
        return np.sum(body.weights * w) + 0.5 * material.bulk_ratio * volumetric

    return energy


@pytest.fixture(scope="session")
def paper_energy(face_rule):
    """Energy of the paper's membrane on the bottom, slack and longer than the body."""

    def energy(body, displacement, material):
        _, first, second, weights = face_rule(body.element.order)
        rest, placed = body.nodes[body.paper], (body.nodes + displacement)[body.paper]
        size = np.ptp(rest, axis=1)[:, :2] * (1.0 + material.paper_mismatch)
        a = np.einsum("qa,fai->fqi", first, placed) / size[:, None, :1]
        b = np.einsum("qa,fai->fqi", second, placed) / size[:, None, 1:]
        aa, bb, ab = (np.sum(u * v, axis=-1) for u, v in ((a, a), (b, b), (a, b)))
        e11, e22, e12 = (aa - 1.0) / 2.0, (bb - 1.0) / 2.0, ab / 2.0
        nu, slack = material.paper_poisson, material.paper_slack
        square = (1.0 - nu) * (e11**2 + e22**2 + 2.0 * e12**2) + nu * (e11 + e22) ** 2
        density = 0.5 * square
        if slack > 0.0:
            density = density - slack**2 * np.log(np.cosh(np.sqrt(square) / slack))
        density = material.paper_group / (1.0 - nu**2) * density
        return np.sum(density * weights * np.prod(size, axis=1)[:, None])

    return energy


@pytest.fixture(scope="session")
def enclosed_volume(face_rule):
    """Volume of the cavity as the flux of (0, 0, z) through its walls."""

    def volume(body, placed):
        shapes, first, second, weights = face_rule(body.element.order)
        local = placed[body.cavity]
        x, a, b = (np.einsum("qa,fai->fqi", s, local) for s in (shapes, first, second))
        return np.sum(x[..., 2] * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]) * weights)

    return volume


@pytest.fixture(scope="session")
def stored_energy(solid_energy, paper_energy):
    """All energy of a problem's body and paper, its bending included."""

    def energy(problem, displacement):
        body, material = problem.system.body, problem.material
        u = displacement.ravel()
        bent = 0.5 * problem.bending_stiffness * (u @ (problem.system.bending @ u))
        total = solid_energy(body, displacement, material) + bent
        return total + paper_energy(body, displacement, material)

    return energy
