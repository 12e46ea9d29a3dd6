"""Laws in their coordinates: against the laws themselves, and slopes against differences."""

import numpy as np
import pytest

from bayesdeg.data.settings import MATERIAL_LAWS
from bayesdeg.material.hyperelastic import EXPONENTS, cauchy_stress, nominal_stress
from bayesdeg.material.laws import (
    CONSTANTS,
    FORMS,
    SMALLEST_POWER,
    film_tests,
    largest_excess,
)

MODES = tuple(EXPONENTS)
STRETCH = np.tile([0.7, 1.02, 1.5, 2.0, 3.0], (len(MODES), 1))
CAUCHY = np.zeros(STRETCH.shape, bool)
CAUCHY[:, ::2] = True
LARGEST = largest_excess(STRETCH, MODES, np.ones(STRETCH.shape, bool))
TESTS = film_tests(STRETCH, MODES, LARGEST, cauchy=CAUCHY)
SCALE = 0.37  # MPa
LAWS = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)


def coordinates(form, seed=0, count=6):
    return np.random.default_rng(seed).standard_normal((count, form.size))


def test_every_law_that_a_study_may_name_has_a_form():
    assert set(FORMS) == set(MATERIAL_LAWS)
    assert [form.name for form in FORMS.values()] == list(FORMS)


@LAWS
def test_a_form_has_the_stress_of_its_law_in_every_mode_and_measure(form):
    for u in coordinates(form):
        stress = SCALE * form.response(np.tile(u, (len(MODES), 1)), TESTS)[0]
        for row, mode in enumerate(MODES):
            constants = form.constants(u, SCALE, LARGEST[row])
            assert set(constants) <= set(CONSTANTS)
            law = form.solid(constants)
            nominal = nominal_stress(law, STRETCH[row], mode=mode)
            true = cauchy_stress(law, STRETCH[row], mode=mode)
            expected = np.where(CAUCHY[row], true, nominal)
            np.testing.assert_allclose(stress[row], expected, rtol=1e-11)


@LAWS
def test_the_constants_have_the_modulus_that_the_stress_has_at_small_strain(form):
    step = np.array([[1.0 - 1e-5, 1.0 + 1e-5]])
    tests = film_tests(step, ["uniaxial"], np.array([2.0]))
    for u in coordinates(form):
        low, high = SCALE * form.response(u[None], tests)[0][0]
        modulus = float(form.solid(form.constants(u, SCALE, 2.0)).shear_modulus)
        assert (high - low) / 2e-5 / 3.0 == pytest.approx(modulus, rel=1e-6)


@LAWS
def test_slopes_are_those_of_differences(form):
    step = 1e-6
    for u in coordinates(form):
        at = np.tile(u, (len(MODES), 1))
        slopes = form.response(at, TESTS)[1]
        assert slopes.shape == (*STRETCH.shape, form.size)
        for k in range(form.size):
            ends = [form.response(at + sign * step * np.eye(form.size)[k], TESTS)[0]
                    for sign in (1, -1)]  # fmt: skip
            difference = (ends[0] - ends[1]) / (2.0 * step)
            scale = np.abs(difference).max() + 1e-6
            np.testing.assert_allclose(slopes[..., k], difference, atol=1e-7 * scale, rtol=1e-6)


def test_without_its_other_terms_every_law_is_neo_hookean():
    known = FORMS["neo_hookean"].response(np.zeros((len(MODES), 1)), TESTS)[0]
    limits = {
        "yeoh": np.zeros(3),
        "mooney_rivlin": np.zeros(2),
        "gent": np.array([0.0, 20.0]),
        # α1 = 2, and two terms without a modulus
        "ogden": np.array([0.0, -40.0, -40.0, 2.0 / 3.0, 0.0, 0.0]),
    }
    for name, u in limits.items():
        stress = FORMS[name].response(np.tile(u, (len(MODES), 1)), TESTS)[0]
        np.testing.assert_allclose(stress, known, rtol=1e-10)


def test_a_power_of_zero_is_its_limit():
    """Σ e² ln λ is what is left of 2/α Σ e (λ^(α e) − 1) λ⁻¹ / 2."""
    zero = np.array([0.0, -40.0, -40.0, -2.0, 0.0, 0.0])
    at = np.tile(zero, (len(MODES), 1))
    stress = FORMS["ogden"].response(at, TESTS)[0]
    squares = np.array([sum(e * e for e in EXPONENTS[mode]) for mode in MODES])
    limit = 2.0 * TESTS.share * squares[:, None] * TESTS.log_stretch
    np.testing.assert_allclose(stress, limit, rtol=2.0 * SMALLEST_POWER)


def test_no_stretch_that_was_reached_is_beyond_the_limit_of_gents_law():
    for u in (-8.0, 0.0, 8.0):
        constants = FORMS["gent"].constants(np.array([0.0, u]), SCALE, 7.5)
        assert constants["j_m"] > 7.5
    assert np.isfinite(FORMS["gent"].response(np.full((3, 2), -3.0), TESTS)[0]).all()
