"""Polynomials of the degradation rate in Bernstein form: values, slopes, and their guarantee."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from bayesdeg.material.degradation import (
    NODES,
    Controls,
    bernstein_slopes,
    bernstein_weights,
    constants,
    satisfies_baker_ericksen,
)

LEVELS = np.linspace(-2.0, 28.0, 31)
ORDERS = pytest.mark.parametrize("nodes", NODES[1:], ids=["first", "second", "third"])


@ORDERS
def test_weights_and_slopes_are_those_of_scipy(nodes):
    for k in range(len(nodes)):
        reference = BPoly(np.eye(len(nodes))[:, [k]], [nodes[0], nodes[-1]])
        np.testing.assert_allclose(
            bernstein_weights(LEVELS, nodes)[:, k], reference(LEVELS), rtol=1e-10, atol=1e-12
        )
        np.testing.assert_allclose(
            bernstein_slopes(LEVELS, nodes)[:, k],
            reference.derivative()(LEVELS),
            rtol=1e-10,
            atol=1e-12,
        )


def test_one_node_is_a_constant():
    assert bernstein_weights(LEVELS, (14.9,)).tolist() == [[1.0]] * len(LEVELS)
    assert not np.any(bernstein_slopes(LEVELS, (14.9,)))


@ORDERS
def test_evenly_spaced_controls_on_a_line_make_that_line(nodes):
    """Linear precision: control values at the nodes of a line reproduce it."""
    np.testing.assert_allclose(
        bernstein_weights(LEVELS, nodes) @ (0.3 + 0.05 * np.array(nodes)), 0.3 + 0.05 * LEVELS
    )


POSITIVE = st.floats(-14.0, 4.0).map(np.exp)
RATIO = st.floats(-0.999, 3.0)


@given(data=st.data(), order=st.integers(1, 3), place=st.floats(0.0, 1.0))
def test_positive_controls_and_ratios_above_minus_one_are_stable_everywhere(data, order, place):
    nodes = NODES[order]
    draw = [
        data.draw(st.lists(law, min_size=order + 1, max_size=order + 1))
        for law in (POSITIVE, RATIO, POSITIVE)
    ]
    controls = Controls(*(np.array([values]) for values in draw))
    c1, c2, c3 = constants(controls, bernstein_weights([25.0 * place], nodes))[0, 0]
    assert bool(satisfies_baker_ericksen(c1, c2, c3))
    assert c3 > 0.0


def test_the_ends_hold_the_control_values():
    controls = Controls(*(np.array([[a, b, c]]) for a, b, c in ((1, 2, 4), (0, 1, 0.5), (3, 1, 2))))
    ends = constants(controls, bernstein_weights([0.0, 25.0], NODES[2]))[0]
    np.testing.assert_allclose(ends[:, 0], [1.0, 4.0])
    np.testing.assert_allclose(ends[:, 1], [0.0, 0.5 * np.sqrt(3.0 * 4.0 * 2.0)])
    np.testing.assert_allclose(ends[:, 2], [3.0, 2.0])


def test_nodes_must_increase():
    with pytest.raises(ValueError, match="increase"):
        bernstein_weights(3.0, (25.0, 0.0))
