import numpy as np
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.material.hyperelastic import YeohRootSecondInvariant, nominal_stress, tangent
from bayesdeg.observations.means import Means
from bayesdeg.observations.specimens import young_modulus
from tests.inference.slow_model import log_statistics
from tests.inference.small_study import TRUTH, small_model, values_of

SECOND_INVARIANT = CATALOGUE["second_invariant"]
RATIO = np.array([0.0, 0.5, 1.0])
CONSTANTS = np.broadcast_to([[0.3, -0.01, 0.002], [1.6, -0.2, 0.1]], (3, 2, 3))


def test_a_term_in_the_second_invariant_raises_it_by_the_closed_form():
    found = young_modulus({"second_invariant.ratio": RATIO}, CONSTANTS, (SECOND_INVARIANT,))
    expected = 6.0 * CONSTANTS[..., 0] * (1.0 + RATIO[:, None] / (2.0 * np.sqrt(3.0)))
    np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_it_is_the_slope_of_the_uniaxial_stress_at_stretch_one():
    c1, c2, c3 = np.moveaxis(CONSTANTS, -1, 0)
    law = YeohRootSecondInvariant(c1, c2, c3, RATIO[:, None] * c1)
    found = young_modulus({"second_invariant.ratio": RATIO}, CONSTANTS, (SECOND_INVARIANT,))
    h = 1e-5
    up, down = (nominal_stress(law, 1.0 + d, mode="uniaxial") for d in (h, -h))
    np.testing.assert_allclose(found, (up - down) / (2.0 * h), rtol=1e-8)
    np.testing.assert_allclose(found, tangent(law, 1.0, mode="uniaxial"), rtol=1e-11)


def test_it_is_six_times_c1_where_nothing_acts_on_stresses():
    causes = (CATALOGUE["film_mismatch"], CATALOGUE["creep"])
    assert np.array_equal(young_modulus({}, CONSTANTS, causes), 6.0 * CONSTANTS[..., 0])


def test_a_confusion_of_stress_measures_leaves_it_since_both_have_one_slope_at_stretch_one():
    values = {"stress_measure.confusion": RATIO}
    found = young_modulus(values, CONSTANTS, (CATALOGUE["stress_measure"],))
    np.testing.assert_allclose(found, 6.0 * CONSTANTS[..., 0], rtol=1e-11)


def test_a_published_modulus_is_held_against_that_of_the_active_causes():
    model = small_model().extended(SECOND_INVARIANT)
    values = values_of(TRUTH | {"second_invariant.ratio": 0.5})
    means = model.data_of(Means).compared(model.state(values))
    modulus = [float(one.expected[0]) for one in means[:2]]
    factor = 6.0 * (1.0 + 0.5 / (2.0 * np.sqrt(3.0)))
    assert modulus == pytest.approx(
        [factor * TRUTH["c1_at_0"], factor * TRUTH["c1_at_25"]], rel=1e-10
    )


def test_the_likelihood_of_published_moduli_is_that_computed_slowly():
    model = small_model().extended(SECOND_INVARIANT)
    values = values_of(TRUTH | {"second_invariant.ratio": 0.5})
    slow = log_statistics(model, {name: float(v[0]) for name, v in values.items()})
    np.testing.assert_allclose(model.log_likelihood(values)["statistics"][0], slow, rtol=1e-10)
