"""Which causes a study could take for each other: equal effects, and only those."""

import numpy as np
import pytest

from bayesdeg.criticism.decide.candidates import CLEAR, VISIBLE, Confusability, confusability
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import known_linear, scaling_cause
from tests.criticism.straight_subject import SHAPES, linear_cause

LINEAR = straight.exact_linear(straight.readings(1))


def judged(*causes, seed=2):
    return confusability(LINEAR, causes, np.random.default_rng(seed))


def of_size(name, shape, visible):
    """A linear cause whose usual effect has so many standard deviations."""
    sd = np.linalg.norm(LINEAR.whiten_columns(shape))
    return linear_cause(name, shape, size=visible / sd)


def test_causes_of_the_same_effect_are_confusable():
    found = judged(
        of_size("wave", SHAPES["wave"], 10.0),
        of_size("same", 3.0 * SHAPES["wave"], 8.0),
        of_size("lag", SHAPES["lag"], 10.0),
    )
    assert found.pairs() == [("wave", "same")]
    assert found.rivals("wave") == ["same"]
    assert found.rivals("lag") == []
    np.testing.assert_allclose(found.visible, [10.0, 8.0, 10.0])
    assert found.confused[0, 1] > 0.95
    assert found.confused[0, 2] == 0.0


def test_each_cause_is_as_good_as_itself():
    found = judged(*(linear_cause(name) for name in ("wave", "lag")))
    np.testing.assert_array_equal(np.diag(found.confused), 1.0)


@pytest.mark.parametrize("visible", [0.5, VISIBLE - 0.1])
def test_effects_that_cannot_be_seen_are_not_listed(visible):
    """They would be taken for anything."""
    found = judged(
        of_size("wave", SHAPES["wave"], visible), of_size("same", SHAPES["wave"], visible)
    )
    assert found.confused[0, 1] > 0.9
    assert found.pairs() == []
    assert found.visible == pytest.approx([visible, visible])


def test_nearly_equal_effects_are_confused_unless_they_are_large():
    """Of the twin what is left is below one standard deviation of 10, not of 1000."""
    small = judged(of_size("offset", SHAPES["offset"], 10.0), of_size("twin", SHAPES["twin"], 10.0))
    large = judged(
        of_size("offset", SHAPES["offset"], 1000.0), of_size("twin", SHAPES["twin"], 1000.0)
    )
    assert small.pairs() == [("offset", "twin")]
    assert large.pairs() == []


def test_how_often_a_rival_is_as_good_is_as_for_two_normal_laws():
    """Orthogonal effects of s and t standard deviations: factors differ by a known amount.

    The factor of the first, of prior size s each way, is (s + u)² k/2 less a constant, that of the
    other v² k/2, u and v standard normal.
    """
    s = 3.5
    z = np.linalg.qr(LINEAR.whiten_columns(np.stack([SHAPES["wave"], SHAPES["lag"]], axis=1)))[0]
    shapes = (LINEAR.factor @ z).T
    causes = [
        linear_cause(name, shape, law=straight.Normal(0.0, s), size=s)
        for name, shape in zip(("first", "other"), shapes, strict=True)
    ]
    found = judged(*causes, seed=3)
    gain = 2.0 * s**2 / (1.0 + 2.0 * s**2)  # of the small size and of the usual one together
    generator = np.random.default_rng(4)
    u, v = generator.standard_normal((2, 200_000))
    expected = np.mean(0.5 * gain * v**2 > 0.5 * gain * (s + u) ** 2 - CLEAR)
    assert 0.1 < expected < 0.9
    error = 4.0 * np.sqrt(expected * (1.0 - expected) / 300)
    assert found.confused[0, 1] == pytest.approx(expected, abs=error)


def test_pairs_need_both_effects_to_be_visible_and_one_direction_of_confusion():
    names, visible = ("a", "b", "c"), np.array([5.0, 5.0, 1.0])
    confused = np.array([[1.0, 0.0, 0.9], [0.2, 1.0, 0.9], [0.9, 0.9, 1.0]])
    found = Confusability(names, visible, confused)
    assert found.pairs() == [("a", "b")]
    assert found.rivals("a") == ["c"]
    assert found.rivals("b") == ["a", "c"]


def test_effects_on_actuators_are_confused_as_their_shapes_are():
    known = known_linear()
    first, twin = scaling_cause("first"), scaling_cause("twin", sd=0.2)
    found = confusability(known, (first, twin), np.random.default_rng(5))
    assert found.pairs() == [("first", "twin")]
    one = np.linalg.norm(known.whiten_columns(0.1 * known.prediction))
    np.testing.assert_allclose(found.visible, [one, 2.0 * one], rtol=1e-9)


def test_without_a_cause_there_is_nothing_to_confuse():
    assert judged().pairs() == []
