"""Dimensionless groups and the box."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.scaling import TrainingBox, groups
from bayesdeg.emulator.training import unit_groups

POSITIVE = st.floats(0.01, 100.0)


@given(
    p=POSITIVE,
    c1=POSITIVE,
    r=st.floats(-0.9, 2.0),
    c3=POSITIVE,
    s=POSITIVE,
    et=POSITIVE,
    k=POSITIVE,
)
def test_groups_are_free_of_units(p, c1, r, c3, s, et, k):
    """Forces and lengths in other units: stresses by k, so Et by k; size by s, so Et by s."""
    c2 = r * np.sqrt(3.0 * c1 * c3)
    one = groups(Inputs(*(np.array([v]) for v in (p, c1, c2, c3, 1.0, et))))
    other = groups(Inputs(*(np.array([v]) for v in (k * p, k * c1, k * c2, k * c3, s, k * s * et))))
    np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        one,
        np.reshape([p / c1 * 1e-3, r, np.log(c3 / c1), np.log(et / c1 * 1e-3)], (4, 1)),
        rtol=1e-9,
        atol=1e-9,
    )


@given(u=st.tuples(*[st.floats(0.0, 1.0)] * 3))
def test_a_material_of_the_unit_cube_has_those_coordinates(u):
    box = TrainingBox()
    curve = Curve((0.1,), box.material(np.array(u)))
    np.testing.assert_allclose(unit_groups(curve, box), 2.0 * np.array(u) - 1.0, atol=1e-9)


def test_every_material_of_the_box_is_stable():
    box = TrainingBox()
    assert box.lower[0] > -1.0
    for corner in np.ndindex(2, 2, 2):
        m = box.material(np.array(corner, float))
        assert m.c2_ratio > -np.sqrt(3.0 * m.c3_ratio)


def test_unstable_materials_have_no_groups():
    values = np.array([[-0.1, 0.1], [0.3, -0.1]])
    inputs = Inputs(np.array(50.0), values[0], np.zeros(2), values[1], np.array(0.8), np.array(3e4))
    assert np.all(np.isnan(groups(inputs)[1]))
