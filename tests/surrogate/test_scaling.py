"""Dimensionless groups and the range over which emulators are trained."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import is_elliptic
from bayesdeg.surrogate.scaling import (
    GROUPS,
    LOAD,
    MATERIAL,
    NAMES,
    Place,
    TrainingRange,
    groups_of,
    groups_of_material,
)

POSITIVE = st.floats(0.01, 100.0)
UNIT = st.floats(0.0, 1.0)
SPAN = TrainingRange()


def place_at(shares):
    return Place(tuple((SPAN.lower + (SPAN.upper - SPAN.lower) * np.array(shares)).tolist()))


def physical_inputs(load, material, *, c1, scale):
    """The inputs in kPa, MPa and mm that have these groups."""
    weight = 1e6 * c1 / scale
    values = {
        "pressure": 1e3 * c1 * load,
        "c1": c1,
        "c2": c1 * material.c2_ratio,
        "c3": c1 * material.c3_ratio,
        "linear_scale": scale,
        "paper_stiffness": 1e3 * c1 * scale * material.paper_group,
        "second_invariant": c1 * material.second_invariant_ratio,
        "skin": material.skin,
        "paper_thickness": scale * material.paper_thickness,
        "paper_slack": material.paper_slack,
        "paper_mismatch": material.paper_mismatch,
        "weight_along": weight * material.gravity_along,
        "weight_up": weight * material.gravity_up,
        "wall_factor": material.wall_factor,
        "erosion": scale * material.erosion,
    }
    return Inputs(**{name: np.array([value]) for name, value in values.items()})


@given(load=st.floats(0.0, 1.0), shares=st.tuples(*[UNIT] * 12), c1=POSITIVE, scale=POSITIVE)
def test_groups_of_inputs_are_those_of_the_finite_element_run(load, shares, c1, scale):
    """So they know neither the unit of stress nor the size."""
    material = place_at(shares).material()
    found = groups_of(physical_inputs(load, material, c1=c1, scale=scale))
    wanted = groups_of_material(np.array([load]), material)
    assert set(found) == set(wanted) == set(NAMES)
    for name in NAMES:
        np.testing.assert_allclose(found[name], wanted[name], rtol=1e-9, atol=1e-12, err_msg=name)


@given(shares=st.tuples(*[UNIT] * 12))
def test_a_place_and_its_material_are_the_same(shares):
    place = place_at(shares)
    np.testing.assert_allclose(
        Place.of(place.material()).values, place.values, rtol=1e-12, atol=1e-12
    )


def test_groups_follow_their_definitions():
    material = place_at(12 * (0.3,)).material()
    m = 1.0 + material.second_invariant_ratio / (2.0 * math.sqrt(3.0))
    found = groups_of_material(np.array(0.5), material)
    wanted = {
        LOAD: 0.5 / m,
        "softening": material.c2_ratio / math.sqrt(3.0 * material.c3_ratio * m),
        "log_stiffening": math.log(material.c3_ratio / m),
        "log_paper": math.log(material.paper_group / m),
        "second_invariant": 1.0 - 1.0 / m,
        "gravity_along": material.gravity_along / m,
        "erosion": material.erosion,
    }
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-12), name


def test_the_unit_of_stress_is_half_of_the_shear_modulus_at_rest():
    """W = C1 (I₁ − 3) + r (√I₂ − √3) in simple shear γ, where I₁ = I₂ = 3 + γ²: W'' = 2 M."""
    place = place_at((0.5, 0.5, 0.5, 0.8, *8 * (0.5,)))
    r = place.material().second_invariant_ratio
    gamma = 1e-3
    energy = gamma**2 + r * (math.sqrt(3.0 + gamma**2) - math.sqrt(3.0))
    assert 2.0 * energy / gamma**2 == pytest.approx(2.0 * place.modulus, rel=1e-6)


def test_every_material_of_the_range_is_stable():
    assert SPAN.lower[0] > -1.0
    for corner in np.ndindex(2, 2, 2):  # without a second invariant, which only adds
        assert is_elliptic(place_at((*corner, *9 * (0.0,))).material())


def test_unstable_materials_have_no_groups():
    values = np.array([[-0.1, 0.1, 0.1], [0.3, -0.1, 0.0]])
    inputs = Inputs(np.array(50.0), values[0], np.zeros(3), values[1], np.array(0.8), np.array(3e4))
    found = groups_of(inputs)
    assert np.all(np.isnan(found["log_stiffening"]))
    assert np.all(np.isnan(found["softening"]))


def test_groups_of_the_material_have_no_axis_of_pressures():
    inputs = physical_inputs(0.2, place_at(12 * (0.4,)).material(), c1=0.5, scale=0.8)
    found = groups_of(replace(inputs, pressure=np.linspace(0.0, 50.0, 7)))
    assert found[LOAD].shape == (7,)
    assert {np.shape(value) for name, value in found.items() if name != LOAD} == {(1,)}


def test_effects_that_inputs_do_not_speak_of_are_left_out():
    one = np.ones(1)
    found = groups_of(Inputs(50.0 * one, 0.3 * one, 0 * one, 0.03 * one, 0.8 * one, 3e4 * one))
    assert set(found) == {LOAD, *(group.name for group in MATERIAL), "paper_thickness"}


def test_neutral_values_lie_in_their_ranges():
    causes = [group for group in GROUPS if group.is_cause]
    assert len(causes) == 9
    assert all(group.low <= group.neutral <= group.high for group in causes)


def test_largest_load_falls_towards_degraded_material():
    largest = SPAN.largest_load(np.linspace(-1.0, 1.0, 41))
    assert largest[0] == SPAN.load
    assert largest[-1] == pytest.approx(0.45)
    assert np.all(np.diff(largest) <= 0.0)
