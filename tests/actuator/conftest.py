"""Small models that solve in a fraction of a second, and an energy written without the kernels."""

import numpy as np
import pytest
from skfem import Basis, ElementHex2, MeshHex

from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.mesh import ActuatorMesh, Resolution, build_mesh
from bayesdeg.actuator.system import Material, State, System
from bayesdeg.measure.settings import Dimensions

COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
NONE = np.zeros(0, dtype=np.int64)


@pytest.fixture(scope="session")
def one_chamber():
    return System(build_mesh(Geometry(Dimensions(length=14.0, chambers=1)), COARSEST))


@pytest.fixture(scope="session")
def two_chambers():
    return System(build_mesh(Geometry(Dimensions(length=20.0, chambers=2)), COARSEST))


@pytest.fixture(scope="session")
def thin_walled():
    """Walls so thin that the actuator balloons at moderate pressure."""
    dimensions = Dimensions(
        length=20.0,
        chambers=2,
        roof=0.8,
        side_wall=0.8,
        chamber_wall=0.8,
        end_wall=0.8,
        floor=1.0,
        channel_height=1.0,
    )
    return System(build_mesh(Geometry(dimensions), COARSEST))


@pytest.fixture(scope="session")
def fresh():
    return Material(-0.004 / 0.288, 0.0012 / 0.288, 30.0 / (0.288 * 0.843))


@pytest.fixture(scope="session")
def equilibria():
    """Equilibria along a pressure curve, with the solver opened and closed."""

    def run(system, material, loads, effort=None, solver=None):
        factorization = open_factorization(system.upper, solver)
        try:
            return follow(system, factorization, material=material, loads=loads, effort=effort)
        finally:
            factorization.close()

    return run


@pytest.fixture(scope="session")
def random_state():
    """A smooth large deformation with noise on every node, and a random pressure field."""

    def draw(mesh, seed, noise=0.02, load=0.0):
        rng = np.random.default_rng(seed)
        affine = 0.08 * rng.standard_normal((3, 3))
        affine[1, [0, 2]] = 0.0  # the plane of symmetry stays where it is
        displacement = mesh.nodes @ affine.T + noise * rng.standard_normal(mesh.nodes.shape)
        displacement[mesh.symmetry, 1] = 0.0
        return State(displacement, rng.standard_normal((len(mesh.elements), 4)), load)

    return draw


@pytest.fixture(scope="session")
def block():
    """Bricks without cavity, the nodes inside moved, so that no element is a box."""

    def build(counts=(2, 2, 2), size=(3.0, 2.0, 2.5), distortion=0.0):
        mesh = MeshHex.init_tensor(
            *(np.linspace(0.0, s, n + 1) for n, s in zip(counts, size, strict=True))
        )
        p = mesh.p.copy()
        inside = np.all((p > 1e-9) & (p < np.array(size)[:, None] - 1e-9), axis=0)
        p[:, inside] += distortion * np.array([[0.3], [-0.2], [0.25]])
        basis = Basis(MeshHex(p, mesh.t), ElementHex2(), intorder=5)
        gradients = np.stack([field[0].grad for field in basis.basis], axis=-1)
        empty = np.zeros((0, 9), dtype=np.int64)
        return ActuatorMesh(
            geometry=Geometry(Dimensions()),
            nodes=np.ascontiguousarray(basis.doflocs.T),
            elements=np.ascontiguousarray(basis.element_dofs.T.astype(np.int64)),
            gradients=np.ascontiguousarray(np.transpose(gradients, (1, 2, 3, 0))),
            weights=np.ascontiguousarray(basis.dx),
            points=np.ascontiguousarray(basis.X.T),
            cavity=empty,
            bottom=empty,
            free_end=empty,
            bottom_line=NONE,
            clamped=NONE,
            symmetry=NONE,
        )

    return build


def _lagrange(points):
    """Quadratic shapes and slopes from interpolation, not from the kernels' formulas."""
    nodes = np.array([0.0, 0.5, 1.0])
    polynomials = [np.polynomial.Polynomial.fromroots(np.delete(nodes, i)) for i in range(3)]
    polynomials = [q / q(nodes[i]) for i, q in enumerate(polynomials)]
    return (
        np.stack([q(points) for q in polynomials], axis=-1),
        np.stack([q.deriv()(points) for q in polynomials], axis=-1),
    )


@pytest.fixture(scope="session")
def face_rule():
    """Shapes, slopes and weights on faces at the 3 x 3 Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(3)
    n, dn = _lagrange(0.5 * (points + 1.0))
    return np.kron(n, n), np.kron(dn, n), np.kron(n, dn), np.kron(weights, weights) / 4.0


@pytest.fixture(scope="session")
def solid_energy():
    """Energy of the solid with the pressure field eliminated; analytic, so complex steps work."""

    def energy(system, displacement, material):
        mesh = system.mesh
        local = displacement[mesh.elements]
        f = np.eye(3) + np.einsum("eai,eqaj->eqij", local, mesh.gradients)
        j = np.linalg.det(f)
        x = j ** (-2.0 / 3.0) * np.einsum("eqij,eqij->eq", f, f) - 3.0
        w = x + material.c2_ratio * x**2 + material.c3_ratio * x**3
        r = np.einsum("eq,qm,eq->em", mesh.weights, system.modes, j - 1.0)
        volumetric = np.einsum("em,emn,en->", r, np.linalg.inv(system.mass), r)
        return np.sum(mesh.weights * w) + 0.5 * material.bulk_ratio * volumetric

    return energy


@pytest.fixture(scope="session")
def paper_energy(face_rule):
    """Energy of the St. Venant-Kirchhoff membrane on the bottom."""

    def energy(mesh, displacement, material):
        _, first, second, weights = face_rule
        rest, placed = mesh.nodes[mesh.bottom], (mesh.nodes + displacement)[mesh.bottom]
        size = np.ptp(rest, axis=1)[:, :2]
        a = np.einsum("qa,fai->fqi", first, placed) / size[:, None, :1]
        b = np.einsum("qa,fai->fqi", second, placed) / size[:, None, 1:]
        aa, bb, ab = (np.sum(u * v, axis=-1) for u, v in ((a, a), (b, b), (a, b)))
        e11, e22, e12 = (aa - 1.0) / 2.0, (bb - 1.0) / 2.0, ab / 2.0
        nu = material.paper_poisson
        density = (1.0 - nu) * (e11**2 + e22**2 + 2.0 * e12**2) + nu * (e11 + e22) ** 2
        density = material.paper_group / (2.0 * (1.0 - nu**2)) * density
        return np.sum(density * weights * np.prod(size, axis=1)[:, None])

    return energy


@pytest.fixture(scope="session")
def enclosed_volume(face_rule):
    """Volume of the cavity as the flux of (0, 0, z) through its walls."""

    def volume(mesh, placed):
        shapes, first, second, weights = face_rule
        local = placed[mesh.cavity]
        x, a, b = (np.einsum("qa,fai->fqi", s, local) for s in (shapes, first, second))
        return np.sum(x[..., 2] * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]) * weights)

    return volume
