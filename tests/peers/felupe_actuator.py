"""The same body in felupe: its elements, its assembly, its Newton's method.

Only the arrays of the body are taken over. Material and paper are written here by their tensors,
in terms of the deformation gradient; the follower pressure and the solids are felupe's own. The
pressure in the solid is felupe's three-field solid where it is constant in a brick, and a second
global field on a disconnected mesh where it is linear.
"""

import time
import warnings

import felupe
import numpy as np
from felupe.math import cdya_ik, cdya_il, ddot, det, dot, dya, identity, inv, transpose
from pypardiso import spsolve
from skfem import ElementHex1, ElementHex2

from bayesdeg.actuator.body import LINEAR_FULL, QUADRATIC
from tests.peers.peer_path import PeerPath, refuse_special


def solve(body, material, *, loads, tolerance=1e-8, layer=None):
    """Return the equilibria of a body at rising cavity pressures, in units of C1.

    A load is done when the largest displacement of a Newton step is below ``tolerance`` times
    the size of the body, which is the criterion of ``bayesdeg.actuator.equilibrium.follow``.
    Every load starts from the state before: felupe extrapolates nothing.
    """
    refuse_special(material)
    start = time.perf_counter()
    items, pressure, field = _items(body, material, layer)
    held = np.flatnonzero(body.fixed)
    free = np.setdiff1d(np.arange(int(np.sum(field.fieldsizes))), held)
    size = float(np.ptp(body.nodes, axis=0).max())
    settled = _settled(3 * len(body.nodes), tolerance * size)
    states, iterations, begun = [], 0, time.perf_counter()
    for load in loads:
        pressure.update(load)
        result = felupe.newtonraphson(
            items=items,
            x0=field,
            dof0=held,
            dof1=free,
            ext0=np.zeros(len(held)),
            solver=spsolve,
            check=settled,
            maxiter=30,
            verbose=0,
        )
        field = result.x
        iterations += result.iterations
        states.append(field[0].values.copy())
    end = time.perf_counter()
    return PeerPath(np.array(states), iterations, begun - start, end - begun)


def _settled(count, largest):
    def check(dx, x, f, xtol, ftol, dof1, dof0, items):
        step = float(np.max(np.abs(dx.ravel()[:count])))
        return step, float(np.linalg.norm(f[dof1])), step < largest

    return check


def _items(body, material, layer):
    """Solid, paper and pressure, with the container of all unknowns."""
    mesh = _mesh(body)
    quadratic = body.element.order == 2
    kind = felupe.RegionTriQuadraticHexahedron if quadratic else felupe.RegionHexahedron
    displacement = felupe.Field(kind(mesh), dim=3)
    field = felupe.FieldContainer([displacement])
    constants = (1.0, material.c2_ratio, material.c3_ratio)
    if layer is not None:  # a constant a brick, next to the axis of quadrature points
        own = (layer.c1, layer.c2, layer.c3)
        constants = [np.where(body.layer, b, a) for a, b in zip(constants, own, strict=True)]
    yeoh = Yeoh(*constants)
    bulk = material.bulk_ratio
    if body.element is QUADRATIC:
        field = felupe.FieldContainer([displacement, _linear_pressure(displacement)])
        solid = felupe.SolidBody(Mixed(yeoh, bulk), field)
    elif body.element is LINEAR_FULL:
        solid = felupe.SolidBody(yeoh & felupe.Volumetric(bulk), field)
    else:
        solid = felupe.SolidBodyNearlyIncompressible(yeoh, field, bulk=bulk)
    pressure = felupe.SolidBodyPressure(_on_faces(mesh, body.cavity))
    items = [solid, pressure]
    if len(body.paper) and material.paper_group > 0.0:
        sheet = Membrane(material.paper_group, material.paper_poisson)
        items.append(felupe.SolidBody(sheet, _on_faces(mesh, body.paper)))
    return items, pressure, field


def _mesh(body):
    """Mesh with the local nodes in felupe's order."""
    quadratic = body.element.order == 2
    element = felupe.TriQuadraticHexahedron() if quadratic else felupe.Hexahedron()
    places = 2.0 * np.asarray((ElementHex2() if quadratic else ElementHex1()).doflocs) - 1.0
    distance = np.abs(element.points[:, None] - places[None]).sum(axis=2)
    assert np.allclose(distance.min(axis=1), 0.0)
    cells = body.elements[:, np.argmin(distance, axis=1)]
    return felupe.Mesh(body.nodes.copy(), cells, element.cell_type)


def _on_faces(mesh, faces):
    """Displacements on exactly these faces, of the boundary or between two bricks.

    felupe chooses faces by a mask over the points, which also takes those that lie between
    wanted faces; so all faces are built, and the others dropped. Of a face between bricks either
    side will do where only its own plane counts.
    """
    quadratic = mesh.cell_type == "hexahedron27"
    kind = (
        felupe.RegionTriQuadraticHexahedronBoundary
        if quadratic
        else felupe.RegionHexahedronBoundary
    )
    with warnings.catch_warnings():  # of faces that are dropped, where bricks are bent
        warnings.filterwarnings("ignore", message="Negative volumes")
        region = kind(mesh, only_surface=False)
    there = {frozenset(face): row for row, face in enumerate(region.mesh.cells_faces.tolist())}
    chosen = np.array([there[frozenset(face)] for face in faces.tolist()])
    region.mesh.update(cells=region.mesh.cells[chosen])
    assert np.all(region.dV[..., chosen] > 0.0)
    for name in ("dXdr", "drdX", "dhdX", "dA", "dV", "normals"):
        setattr(region, name, np.ascontiguousarray(getattr(region, name)[..., chosen]))
    return felupe.FieldContainer([felupe.Field(region, dim=3)])


class LinearPressure(felupe.element.Element):
    """Four functions 1, r, s, t without nodes, for a field that jumps between bricks."""

    def __init__(self):
        self.points = np.zeros((4, 3))
        self.cells = np.arange(4).reshape(1, -1)
        self.cell_type = "hexahedron"

    def function(self, rst):
        return np.array([1.0, *rst])

    def gradient(self, rst):
        return np.vstack([np.zeros(3), np.eye(3)])


def _linear_pressure(displacement):
    region = displacement.region
    mesh = region.mesh.dual(points_per_cell=4)
    return felupe.Field(felupe.Region(mesh, LinearPressure(), region.quadrature, grad=False))


class Yeoh(felupe.ConstitutiveMaterial):
    """ψ = Σ cᵢ (Ī₁ − 3)ⁱ with Ī₁ = J^(−2/3) F : F, and nothing for the volume."""

    def __init__(self, *constants):
        self.constants = constants
        self.kwargs = {}  # asked for where materials are added
        self.x = [np.zeros((3, 3)), np.zeros(0)]

    def _parts(self, F):
        c1, c2, c3 = self.constants
        scale = det(F) ** (-2.0 / 3.0)
        first = ddot(F, F)
        x = scale * first - 3.0
        slope = c1 + 2.0 * c2 * x + 3.0 * c3 * x**2
        G = transpose(inv(F))
        return scale, first, slope, 2.0 * c2 + 6.0 * c3 * x, G

    def _gradient(self, x):
        F = x[0]
        scale, first, slope, _, G = self._parts(F)
        return [2.0 * slope * scale * (F - first / 3.0 * G), x[-1]]

    def _hessian(self, x):
        F = x[0]
        scale, first, slope, bend, G = self._parts(F)
        D = 2.0 * scale * (F - first / 3.0 * G)
        one = identity(F)
        mixed = dya(F, G)
        second = 2.0 * cdya_ik(one, one) - 4.0 / 3.0 * (mixed + dya(G, F))
        second += first * (4.0 / 9.0 * dya(G, G) + 2.0 / 3.0 * cdya_il(G, G))
        return [bend * dya(D, D) + slope * scale * second]


class Mixed(felupe.ConstitutiveMaterial):
    """ψ(F) + p (J − 1) − p² / (2 K) with the pressure p a second field."""

    def __init__(self, material, bulk):
        self.material, self.bulk = material, bulk
        self.x = [np.zeros((3, 3)), np.zeros(1), np.zeros(0)]

    def _gradient(self, x):
        F, p = x[0], x[1]
        J = det(F)
        stress = self.material.gradient([F, x[-1]])[0]
        return [stress + p * J * transpose(inv(F)), J - 1.0 - p / self.bulk, x[-1]]

    def _hessian(self, x):
        F, p = x[0], x[1]
        J, G = det(F), transpose(inv(F))
        elasticity = self.material.hessian([F, x[-1]])[0]
        elasticity += p * J * (dya(G, G) - cdya_il(G, G))
        return [elasticity, J * G, -np.ones_like(p) / self.bulk]


class Membrane(felupe.ConstitutiveMaterial):
    """St. Venant–Kirchhoff sheet on faces in the plane z = 0, per area of the sheet.

    W = Et / (2 (1 − ν²)) [(1 − ν) E : E + ν (tr E)²] with E = ½ P (Fᵀ F − 1) P, where P projects
    on the plane, so that the fibre across the sheet does not count.
    """

    def __init__(self, stiffness, poisson):
        self.shear = stiffness / (1.0 + poisson)
        self.dilation = stiffness * poisson / (1.0 - poisson**2)
        self.plane = np.diag([1.0, 1.0, 0.0]).reshape(3, 3, 1, 1)
        self.x = [np.zeros((3, 3)), np.zeros(0)]

    def _stress(self, F):
        inside = dot(F, self.plane)
        strain = 0.5 * (dot(transpose(inside), inside) - self.plane)
        trace = strain[0, 0] + strain[1, 1]
        return inside, self.shear * strain + self.dilation * trace * self.plane

    def _gradient(self, x):
        inside, stress = self._stress(x[0])
        return [dot(inside, stress), x[-1]]

    def _hessian(self, x):
        inside, stress = self._stress(x[0])
        metric = dot(inside, transpose(inside))
        plane = self.plane * np.ones_like(stress)
        along = cdya_ik(metric, plane) + cdya_il(inside, inside)
        return [
            cdya_ik(identity(x[0]) * np.ones_like(stress), stress)
            + self.dilation * dya(inside, inside)
            + 0.5 * self.shear * along
        ]
