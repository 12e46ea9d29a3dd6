"""How long the next step of a path is, and from how many points its guess is extrapolated."""

import numpy as np
import pytest

from bayesdeg.actuator.equilibrium import MEMORY, LoadStep, StepControl

CONTROL = StepControl(step=0.1, smallest=1e-3, end=1.0, longest=0.5, target=0.02, exact=False)
IMPOSSIBLE = LoadStep(None, None, None, factorizations=1)
STRAYED = LoadStep(None, None, None, factorizations=4)


def test_a_guess_that_is_no_shape_is_made_by_the_last_tangent_alone_first():
    found = CONTROL.failed(IMPOSSIBLE)
    assert (found.memory, found.step) == (1, CONTROL.step)


def test_one_by_the_last_tangent_is_halved_and_extrapolated_again():
    found = CONTROL.failed(IMPOSSIBLE).failed(IMPOSSIBLE)
    assert (found.memory, found.step) == (MEMORY, 0.5 * CONTROL.step)


def test_one_that_strays_is_halved_at_once():
    found = CONTROL.failed(STRAYED)
    assert (found.memory, found.step) == (MEMORY, 0.5 * CONTROL.step)


def test_each_step_that_succeeds_lets_one_point_more_count():
    found = CONTROL.failed(IMPOSSIBLE)
    for memory in (2, 3, MEMORY):
        found = found.succeeded(1e-6, points=9)
        assert found.memory == memory


@pytest.mark.parametrize(("memory", "order"), [(1, 1), (2, 3), (MEMORY, 5)])
def test_the_error_of_a_guess_is_of_the_order_of_its_polynomial(memory, order):
    control = StepControl(**vars(CONTROL) | {"memory": memory})
    found = control.succeeded(0.5 * CONTROL.target / 1.5**order, points=9)
    assert found.step == pytest.approx(1.5 * CONTROL.step)


def test_no_step_is_longer_than_the_longest():
    assert CONTROL.succeeded(0.0, points=9).step == pytest.approx(0.25)
    assert np.isclose(StepControl(**vars(CONTROL) | {"step": 0.4}).succeeded(0.0, 9).step, 0.5)
