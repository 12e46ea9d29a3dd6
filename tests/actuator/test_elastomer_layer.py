"""A constraint layer of another elastomer: its volume, a composite beam, limits."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import box
from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import LayerGroups, MaterialGroups
from bayesdeg.actuator.mesh import build_mesh, reshaped
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.section import described, section
from bayesdeg.actuator.status import Status
from bayesdeg.data.families import Constraint, CylindricalDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError
from tests.actuator.geometries import EXACT, ONE_ELEMENT_A_WALL, RIBBED, SLAB, SOFT


def actuator(constraint=SLAB, dimensions=RIBBED):
    return Actuator(build_mesh(geometry_of(dimensions, constraint), ONE_ELEMENT_A_WALL))


@pytest.mark.parametrize("dimensions", [RIBBED, Dimensions(), CylindricalDimensions()])
def test_the_layer_takes_its_volume_out_of_the_block(dimensions):
    geometry = geometry_of(dimensions, SLAB)
    body = build_mesh(geometry, ONE_ELEMENT_A_WALL).body
    assert body.weights[body.layer].sum() == pytest.approx(
        0.8 * dimensions.length * dimensions.width / 2.0
    )
    assert geometry.volume == pytest.approx(geometry_of(dimensions, Constraint("none")).volume)
    assert len(body.paper) == 0
    low, high = SLAB.slab_in(dimensions)
    assert geometry.line_height == pytest.approx(0.5 * (low + high))
    assert low == pytest.approx(0.5 * dimensions.height - 0.4 if dimensions.usual_height else 0.0)
    again = geometry_of_record(geometry.record())
    assert again.constraint == replace(SLAB, height=geometry.line_height)
    assert {"=" * 40} <= set(section(geometry, 40).splitlines())
    assert "60" in described(geometry)


def test_one_that_is_in_the_way_or_has_no_stiffness_is_refused():
    for wrong in (
        replace(SLAB, thickness=4.0),
        replace(SLAB, thickness=0.0),
        replace(SLAB, c1=0.0),
        replace(SLAB, c3=-1.0),
        replace(SLAB, height=0.1),
    ):
        with pytest.raises(GeometryError):
            geometry_of(RIBBED, wrong)


def test_the_bottom_of_a_layer_erodes():
    mesh = build_mesh(geometry_of(Dimensions(), SLAB), ONE_ELEMENT_A_WALL)
    moved = reshaped(mesh, wall_factor=1.1, erosion=0.2)
    assert moved.body.nodes[:, 2].min() == pytest.approx(0.2)


@pytest.mark.fem
@pytest.mark.parametrize("ratio", [1.0, 5.0, 25.0])
def test_a_cantilever_of_two_elastomers_sags_like_a_composite_beam(ratio, at_rest):
    """w L⁴/(8 B), with B = ∫ E (z − z_n)² dA about the axis of the stiffness."""
    length, wide, high, load = 60.0, 1.0, 2.0, 1e-7
    body = box((length, wide, high), divisions=(30, 1, 4))
    lower = body.nodes[body.elements].mean(axis=1)[:, 2] < 0.5 * high
    plain = MaterialGroups(0.0, 0.0, paper_group=0.0, bulk_ratio=1e6, gravity_up=-load)
    problem = Problem(System(replace(body, layer=lower)), plain, layer=LayerGroups(ratio))
    state = at_rest(problem, EXACT)
    tip = np.isclose(body.nodes[:, 0], length)
    sag = -state.displacement[tip, 2].mean()
    half = 0.5 * high
    stiff, middles = 6.0 * np.array([ratio, 1.0]), np.array([0.5 * half, 1.5 * half])
    axis = stiff @ middles / stiff.sum()
    bending = wide * (stiff @ (half**3 / 12.0 + half * (middles - axis) ** 2))
    beam = load * wide * high * length**4 / (8.0 * bending)
    print(f"sag over that of a composite beam at {ratio:g}: {sag / beam:.4f}")
    assert sag == pytest.approx(beam, rel=0.02)


@pytest.mark.fem
def test_a_layer_like_the_body_is_as_good_as_none():
    curve = Curve((0.2, 0.4), SOFT)
    alike = replace(curve, layer=LayerGroups(1.0, SOFT.c2_ratio, SOFT.c3_ratio))
    of = actuator()
    one, other = (of.solve(each, effort=EXACT) for each in (curve, alike))
    np.testing.assert_allclose(other.readings, one.readings, rtol=1e-12)


@pytest.mark.fem
def test_the_forward_map_takes_the_layers_own_constants():
    """A body twice as stiff under twice the pressure bends more: the layer is not stiffer."""
    one = np.ones((1, 1))
    pressure = np.array([[1.0, 2.0]])
    soft = Inputs(pressure, 0.01 * one, 0 * one, 0 * one, one, 3e3 * one)
    forward = ExactMap(geometry_of(RIBBED, SLAB), ONE_ELEMENT_A_WALL)
    found = forward(soft)
    assert np.all(found.status == Status.CONVERGED)
    twice = forward(replace(soft, pressure=2.0 * pressure, c1=0.02 * one)).curvature
    assert np.all(np.abs(twice / found.curvature - 1.0) > 1e-3)
    stiffer = Constraint("elastomer", thickness=0.8, c1=120.0, c2=-1.0, c3=0.6)
    both = ExactMap(geometry_of(RIBBED, stiffer), ONE_ELEMENT_A_WALL)
    again = both(replace(soft, pressure=2.0 * pressure, c1=0.02 * one)).curvature
    np.testing.assert_allclose(again, found.curvature, rtol=1e-8)


@pytest.mark.fem
def test_the_stiffer_the_layer_the_less_the_middle_gets_longer():
    of = actuator(dimensions=replace(RIBBED, passive="pressurised"))
    lengths = [
        of.solve(Curve((0.4,), SOFT, LayerGroups(c1)), effort=EXACT).arc_length[0]
        for c1 in (0.1, 1.0, 10.0, 100.0)
    ]
    assert np.all(np.diff(lengths) < 0.0)
    assert lengths[-1] / RIBBED.length - 1.0 < 0.05 * (lengths[0] / RIBBED.length - 1.0)
