"""What small causes do alone in the emulator, against the derivatives of the closed form."""

import numpy as np
import pytest

from bayesdeg.surrogate.design import is_answered, typical
from bayesdeg.surrogate.regression import observe
from bayesdeg.surrogate.scaling import NAMES, Place
from bayesdeg.surrogate.terms import feature_gradients
from tests.surrogate.closed_form import LENGTH, SPAN, sample, trained

SMALL = ("skin", "paper_mismatch", "gravity_along", "gravity_up")
CURVES = typical(SPAN, 24, seed=8)


def slopes(axis):
    """Slopes of ln κ, at a load, by a cause's coordinate: emulated ones, and exact ones."""
    emulated, exact = [], []
    for curve in CURVES:
        run = observe(curve, sample(curve), length=LENGTH, compliance=trained().compliance)
        place, before = run.coordinates, run.before_limit
        found = []
        for terms in (trained().terms, trained().load):
            by_points = feature_gradients(terms.orders, place.points)
            found.append(by_points[:, axis] @ terms.coefficients[0])
        scale = place.jacobian[:, axis, axis]
        wanted = [run.gradients[:, k, axis] / scale for k in (0, -1)]
        for slope, into in ((found, emulated), (wanted, exact)):
            into.append((slope[0] - run.growth * slope[1])[before])
    return np.concatenate(emulated), np.concatenate(exact)


@pytest.mark.parametrize("name", SMALL)
def test_what_a_small_cause_does_is_known_to_a_few_hundredths_of_its_effect(name):
    emulated, exact = slopes(NAMES.index(name))
    size = np.sqrt(np.mean(exact**2))
    assert size > 3e-3
    assert np.sqrt(np.mean((emulated - exact) ** 2)) < 0.07 * size


def test_curves_typical_of_studies_are_answered():
    assert all(is_answered(curve, SPAN) for curve in CURVES)
    assert len({Place.of(curve.material) for curve in CURVES}) == len(CURVES)
