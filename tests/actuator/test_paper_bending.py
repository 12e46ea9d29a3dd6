"""Bending of the paper alone: what it stores in shapes whose second derivatives are known."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import LINEAR_CONSTANT, QUADRATIC, boundary_faces, box
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.paper import bending_matrix
from bayesdeg.data.settings import Dimensions

LENGTH, WIDTH = 6.0, 2.0


def sheet(counts=(8, 4), element=QUADRATIC, stretched=0.0):
    """A box with paper on its bottom, nothing held; planes unevenly spaced if stretched."""
    body = box((LENGTH, WIDTH, 1.0), divisions=(*counts, 1), element=element)
    x = body.nodes[:, 0] / LENGTH
    nodes = body.nodes.copy()
    nodes[:, 0] = LENGTH * (x + stretched * x * (1.0 - x))
    body = body.placed_at(nodes)
    faces = boundary_faces(body)
    faces = faces[np.all(np.isclose(body.nodes[faces, 2], 0.0), axis=1)]
    order = [np.lexsort((body.nodes[f, 1], body.nodes[f, 0])) for f in faces]
    paper = np.take_along_axis(faces, np.array(order), axis=1)
    return replace(body, paper=paper, fixed=np.zeros_like(body.fixed))


def energy(body, placed):
    u = (placed - body.nodes).ravel()
    return float(0.5 * u @ (bending_matrix(body).tocsr() @ u))


def rounding(body, placed):
    """The sum of all terms of the energy without their signs: what cancels."""
    u = np.abs((placed - body.nodes).ravel())
    return float(0.5 * u @ (abs(bending_matrix(body).tocsr()) @ u))


def rolled(nodes, radius, axis=0):
    """The plane rolled on a cylinder without stretching it."""
    s = nodes[:, axis] / radius
    placed = nodes.copy()
    placed[:, axis] = (radius + nodes[:, 2]) * np.sin(s)
    placed[:, 2] = (radius + nodes[:, 2]) * np.cos(s) - radius
    return placed


def turn(angles):
    a, b, c = angles
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
@pytest.mark.parametrize("stretched", [0.0, 0.4])
def test_rigid_motions_and_plane_stretches_cost_nothing(element, stretched):
    body = sheet(element=element, stretched=stretched)
    for placed in (
        body.nodes + np.array([1.0, -2.0, 3.0]),
        body.nodes @ turn((0.7, -1.9, 2.5)).T,
        body.nodes @ (turn((0.3, 0.2, -0.4)) @ np.diag([1.3, 0.8, 1.0])).T,
    ):
        assert abs(energy(body, placed)) < 1e-15 * rounding(body, placed)


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
@pytest.mark.parametrize("stretched", [0.0, 0.4])
def test_rotation_of_a_bent_shape_changes_no_energy(element, stretched):
    body = sheet(element=element, stretched=stretched)
    bent = rolled(body.nodes, 3.0)
    bent[:, 2] += 0.1 * bent[:, 0] * bent[:, 1]
    turned = bent @ turn((0.4, 2.0, -1.0)).T + [0.5, 1.0, -7.0]
    assert energy(body, turned) == pytest.approx(energy(body, bent), rel=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_cylinder_stores_half_its_area_over_the_radius_squared(axis):
    """½ ∫ κ² dX but for half a cell at each free edge, where no second derivative is known."""
    radius, size, errors, inner = 4.0, (LENGTH, WIDTH)[axis], [], []
    for n in (4, 8, 16):
        body = sheet((n, n))
        found = energy(body, rolled(body.nodes, radius, axis))
        step = size / (2 * n)
        whole = 0.5 * LENGTH * WIDTH / radius**2
        errors.append(abs(found / whole - 1.0))
        inner.append(abs(found / (whole * (1.0 - step / size)) - 1.0))
    orders = [-np.diff(np.log2(e)) for e in (errors, inner)]
    print(
        f"cylinder along axis {axis}: errors {errors}, orders {orders[0]};"
        f" without the edges {inner}, orders {orders[1]}"
    )
    np.testing.assert_allclose(orders[0], 1.0, atol=0.1)
    np.testing.assert_allclose(orders[1], 2.0, atol=0.05)


def test_clamped_cylinder_counts_its_clamped_edge():
    """The slope is zero at the clamp, so its half cell is known and half the error is left."""
    body, radius = sheet((8, 4)), 4.0
    clamped = replace(body, fixed=np.repeat(np.isclose(body.nodes[:, :1], 0.0), 3, axis=1))
    placed = rolled(body.nodes, radius)
    free, held = (energy(b, placed) for b in (body, clamped))
    half_cell = 0.5 * LENGTH / 16 * WIDTH * 0.5 / radius**2
    assert held - free == pytest.approx(half_cell, rel=0.01)


def test_cut_at_the_plane_of_symmetry_stores_half_of_the_whole():
    """A sheet rolled about x is even in y: half of it, mirrored, has half of its energy."""
    whole = sheet((4, 8))
    shift = np.array([0.0, 0.5 * WIDTH, 0.0])
    middle = replace(whole, nodes=whole.nodes - shift)
    half = box((LENGTH, 0.5 * WIDTH, 1.0), divisions=(4, 4, 1))
    faces = boundary_faces(half)
    faces = faces[np.all(np.isclose(half.nodes[faces, 2], 0.0), axis=1)]
    order = [np.lexsort((half.nodes[f, 1], half.nodes[f, 0])) for f in faces]
    held = np.zeros_like(half.fixed)
    held[:, 1] = np.isclose(half.nodes[:, 1], 0.0)
    half = replace(half, paper=np.take_along_axis(faces, np.array(order), axis=1), fixed=held)
    found = energy(half, rolled(half.nodes, 2.0, axis=1))
    assert found == pytest.approx(
        0.5 * energy(middle, rolled(middle.nodes, 2.0, axis=1)), rel=1e-10
    )


@pytest.mark.parametrize("stretched", [0.0, 0.4])
def test_twist_is_exact(stretched):
    """z = c x y has second derivatives 0, 0 and twice c: ½ ∫ 2 c² dX."""
    body = sheet(stretched=stretched)
    placed = body.nodes.copy()
    placed[:, 2] += 0.3 * body.nodes[:, 0] * body.nodes[:, 1]
    assert energy(body, placed) == pytest.approx(
        0.3**2 * LENGTH * WIDTH, abs=1e-15 * rounding(body, placed)
    )


def test_curved_and_twisted_shape_converges():
    """z = a sin(x) cos(y) on a clamped, mirrored sheet, against the integral."""
    errors = []
    for n in (6, 12, 24):
        body = sheet((n, n))
        placed, (x, y, _) = body.nodes.copy(), body.nodes.T
        # flat at all four edges to second order, so that free edges hide nothing
        placed[:, 2] += 0.1 * np.sin(np.pi * x / LENGTH) ** 4 * np.sin(np.pi * y / WIDTH) ** 4
        errors.append(abs(energy(body, placed) / _integral() - 1.0))
    orders = -np.diff(np.log2(errors))
    print(f"sin⁴ sin⁴: errors {errors}, orders {orders}")
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


def _integral():
    x, w = np.polynomial.legendre.leggauss(40)
    t, w = 0.5 * np.pi * (x + 1.0), 0.5 * w
    s, c = np.sin(t), np.cos(t)
    f, df, ddf = s**4, 4.0 * s**3 * c, 12.0 * s**2 * c**2 - 4.0 * s**4
    a, b = np.pi / LENGTH, np.pi / WIDTH
    xx = np.sum(w * ddf**2) * np.sum(w * f**2) * a**4
    yy = np.sum(w * f**2) * np.sum(w * ddf**2) * b**4
    xy = np.sum(w * df**2) ** 2 * a**2 * b**2
    return 0.5 * 0.1**2 * (xx + yy + 2.0 * xy) * LENGTH * WIDTH


def test_paper_that_fills_no_rectangle_is_refused():
    body = sheet()
    with pytest.raises(ValueError, match="rectangle"):
        bending_matrix(replace(body, paper=body.paper[1:]))


def test_planes_may_be_off_by_rounding_wherever_they_stand():
    body = sheet()
    noise = 1e-14 * np.random.default_rng(3).standard_normal(body.nodes.shape)
    for place in (0.0, 5e-10, 5e-8):  # where coordinates rounded to so many digits would fall apart
        moved = body.placed_at(body.nodes + np.array([place, place, 0.0]) + noise)
        difference = bending_matrix(moved).tocsr() - bending_matrix(body).tocsr()
        assert abs(difference).max() < 1e-9 * abs(bending_matrix(body).tocsr()).max()


def test_actuator_without_paper_thickness_has_no_bending(two_chambers, fresh):
    assert two_chambers.system.bending.nnz > 0
    mesh = build_mesh(Geometry(Dimensions(length=20.0, chambers=2)), Resolution(9.0, 9.0, 9.0))
    assert bending_matrix(replace(mesh.body, paper=mesh.body.paper[:0])).nnz == 0
