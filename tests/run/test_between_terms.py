"""Terms as causes: they change readings as the dictionary says, and experiments tell them apart."""

import numpy as np
import pytest

from bayesdeg.analysis.between_terms import IN_QUESTION, term_cause, term_trials
from bayesdeg.causes.cause import Conditions
from bayesdeg.criticism.checks.discrepancy import measure
from bayesdeg.criticism.checks.known_terms import RATE, Acts, known_terms
from bayesdeg.criticism.checks.missing_terms import missing_terms
from bayesdeg.criticism.experiments.ranking import rank
from bayesdeg.criticism.fit.linear import effects
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import known_linear


@pytest.fixture(scope="module")
def linear():
    return known_linear(with_angle=True)


def test_a_term_acts_on_the_forward_map_as_the_dictionary_says(linear):
    """Factors and shifts alike; along the path the slope is the map's and not a difference."""
    offered = known_terms(linear)
    chosen = range(0, len(offered), 17)
    for i in chosen:
        term, column = offered.terms[i], offered.whitened[:, i]
        size = 0.01 * term.per_unit
        changed = effects(linear, term_cause(linear, term, size), np.array([[size]]))[0]
        if term.acts is Acts.PATH:
            cosine = changed @ column / np.linalg.norm(changed) / np.linalg.norm(column)
            assert cosine > 0.97, term.formula
        else:
            np.testing.assert_allclose(changed, 0.01 * column, atol=1e-8, err_msg=term.formula)
    assert {offered.terms[i].acts for i in chosen} == set(Acts)


def test_a_group_of_the_study_is_known_of_new_specimens(linear):
    [term] = [
        one for one in known_terms(linear).terms if one.formula == "(κ, φ) × (1 + b [D_R = 10 %])"
    ]
    act = term_cause(linear, term, 0.1).on_reading
    near = Conditions(np.full((3, 2), 50.0), np.array([[10.4], [15.0], [24.0]]))
    groups = act._known(near, np.zeros_like(near.pressure)).labels[RATE.column]
    assert groups.ravel().tolist() == ["10 %", "", "24 %"]


def test_fewer_than_two_terms_of_actuators_are_nothing_to_tell_apart():
    base = straight.fitted(straight.subject_of(straight.readings(4, wave=0.4)))
    generator = np.random.default_rng(0)
    noise = generator.standard_normal((200, len(base.linear.mean)))
    simulated = base.linear.mean + noise @ base.linear.factor.T
    found = missing_terms(base.linear, simulated, measure(base.linear, simulated))
    assert found.terms
    trials = term_trials(base, found, generator)
    assert trials == ()
    assert rank(trials, (), generator) == ()
    assert IN_QUESTION >= 2
