"""The cause that acts on rupture, by hand."""

import numpy as np
import pytest

from bayesdeg.causes import dry_embrittlement
from bayesdeg.causes.cause import Strength
from bayesdeg.causes.flaw_embrittlement import CAUSE, embrittle

DEGRADATION = np.array([[0.0, 19.0, 20.0, 22.5, 25.0], [0.0, 21.0, 25.0, 30.0, 24.0]])


def effect(cut, widening, onset=20.0):
    sizes = {"cut": cut, "widening": widening, "onset": onset}
    return {name: np.reshape(size, (-1, 1)) for name, size in sizes.items()}


def strength():
    return Strength(
        np.broadcast_to([2.1, 0.7, 0.65, 0.6, 0.52], (2, 5)), np.broadcast_to([[0.3]], (2, 5))
    )


def test_flaws_cut_the_limit_beyond_their_onset():
    after = embrittle(strength(), DEGRADATION, effect([np.log(4.0), np.log(4.0)], [0.0, 0.0]))
    ratio = after.median / strength().median
    np.testing.assert_allclose(ratio[0], [1.0, 1.0, 1.0, 0.5, 0.25], rtol=1e-14)
    np.testing.assert_allclose(ratio[1], 4.0 ** -np.array([0.0, 0.2, 1.0, 2.0, 0.8]), rtol=1e-14)
    np.testing.assert_array_equal(after.scatter, strength().scatter)


def test_flaws_of_an_early_onset_are_of_the_same_size_at_25_percent():
    sizes = effect(2 * [np.log(4.0)], 2 * [0.4], [0.0, 15.0])
    after = embrittle(strength(), np.array(2 * [[0.0, 15.0, 20.0, 22.5, 25.0]]), sizes)
    ratio = after.median / strength().median
    np.testing.assert_allclose(ratio[0], 4.0 ** -np.array([0.0, 0.6, 0.8, 0.9, 1.0]), rtol=1e-14)
    np.testing.assert_allclose(ratio[1], 4.0 ** -np.array([0.0, 0.0, 0.5, 0.75, 1.0]), rtol=1e-14)
    np.testing.assert_allclose(after.scatter[:, -1], 0.5, rtol=1e-14)


def test_flaws_from_the_beginning_are_as_dry_air():
    sizes = effect(2 * [1.3], 2 * [0.4], 0.0)
    one, other = (of(strength(), DEGRADATION, sizes) for of in (embrittle, dry_embrittlement.dry))
    np.testing.assert_allclose(one.median, other.median, rtol=1e-14)
    np.testing.assert_allclose(one.scatter, other.scatter, rtol=1e-14)


def test_flaws_widen_the_scatter_by_squares():
    after = embrittle(strength(), DEGRADATION, effect([0.0, 0.0], [0.4, 0.8]))
    np.testing.assert_allclose(
        after.scatter[0], [0.3, 0.3, 0.3, np.hypot(0.3, 0.2), 0.5], rtol=1e-14
    )
    assert after.scatter[1, 3] == pytest.approx(np.hypot(0.3, 1.6))
    np.testing.assert_array_equal(after.median, strength().median)


def test_neutral_values_leave_strength_bit_by_bit():
    after = embrittle(strength(), DEGRADATION, effect([0.0, 0.0], [0.0, 0.0]))
    np.testing.assert_array_equal(after.median, strength().median)
    np.testing.assert_array_equal(after.scatter, strength().scatter)


def test_typical_flaws_explain_two_of_three_ruptures_at_25_percent():
    """Films bear a strain of 0.52 there, the actuator demands 0.11 at 240 kPa."""
    from_films = Strength(np.array([[0.52]]), np.array([[0.1]]))
    typical = effect(CAUSE.typical["cut"], CAUSE.typical["widening"])
    after = embrittle(from_films, np.array([[25.0]]), typical)
    standard = np.log(0.11 / np.array([0.52, after.median.item()]))
    standard /= np.array([0.1, after.scatter.item()])
    assert standard[0] < -10.0
    assert -0.5 < standard[1] < 0.8  # 2 of 3 at +0.43


def test_dry_air_cuts_the_limit_in_proportion_to_the_degradation():
    after = dry_embrittlement.dry(strength(), DEGRADATION, effect(np.log([4.0, 4.0]), [0.0, 0.4]))
    ratio = after.median / strength().median
    np.testing.assert_allclose(ratio[0], 4.0 ** -(DEGRADATION[0] / 25.0), rtol=1e-14)
    assert ratio[1, 3] == pytest.approx(4.0**-1.2)
    np.testing.assert_array_equal(after.scatter[0], strength().scatter[0])
    assert after.scatter[1, 2] == pytest.approx(0.5)


def test_dry_air_does_nothing_to_fresh_or_moister_films():
    """A rate below 0, by the scatter of moistures, does not make a film tougher."""
    rates = np.array([[0.0, -1.0, 0.0, 0.0, 0.0]])
    after = dry_embrittlement.dry(strength(), rates, effect([1.5], [0.4]))
    np.testing.assert_array_equal(after.median, strength().median)
