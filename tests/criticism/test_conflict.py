"""Measured means and priors against what a calibrated model has instead, with scipy's laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.criticism.checks.conflict import conflict, questioned, surprise
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.observations.means import Statistic
from bayesdeg.priors import (
    Flat,
    HalfNormal,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
    with_priors,
)
from tests.inference.small_study import altered, draws_near_truth, small_model


@pytest.fixture(scope="module")
def vectors():
    return draws_near_truth(small_model(), 200)


def ratio(value, *, dof=3.0):
    return Statistic("volume_ratio", 0.0, value, 0.03, "shrinkage.csv, 4 films", dof)


def compared(vectors, *statistics):
    return conflict(altered(small_model(), statistics=statistics), vectors)


@pytest.mark.parametrize(("dof", "law"), [(3.0, stats.t(3.0)), (np.inf, stats.norm())])
@pytest.mark.parametrize("value", [0.4, 0.62, 0.9])
def test_the_chance_is_that_of_students_law_widened_by_the_posterior(vectors, value, dof, law):
    found = compared(vectors, ratio(value, dof=dof))
    drawn = small_model().table.named(vectors)["volume_ratio"]
    far = abs(value - drawn.mean()) / np.sqrt(0.03**2 + drawn.var())
    assert found.p_value == pytest.approx(2.0 * law.sf(far))
    assert (found.calibrated, found.calibrated_sd) == pytest.approx((drawn.mean(), drawn.std()))


def test_the_worst_of_several_is_told_and_pays_for_having_been_chosen(vectors):
    wrong, fine = ratio(0.95), ratio(0.62)
    alone = compared(vectors, wrong)
    found = compared(vectors, fine, wrong)
    assert (found.measured, found.source) == (wrong.value, wrong.source)
    assert found.p_value == pytest.approx(2.0 * alone.p_value)
    drawn = small_model().table.named(vectors)["volume_ratio"]
    assert compared(vectors, ratio(drawn.mean()), ratio(drawn.mean())).p_value == 1.0


def test_where_nothing_was_measured_nothing_is_contradicted(vectors):
    assert compared(vectors) is None


# ---- priors

GELATIN = TruncatedNormal(0.62, 0.07, 0.1, 1.0)


def calibrated_to(vectors, value, law=GELATIN):
    """What is questioned where the volume ratio is calibrated to a value, under a prior."""
    model = small_model()
    values = model.table.named(vectors) | {"volume_ratio": np.full(len(vectors), value)}
    stated = altered(model, base=with_priors(model.base, {"volume_ratio": law}))
    return questioned(stated, stated.table.vectors(values))


@given(st.floats(-6.0, 6.0))
def test_the_surprise_of_a_normal_law_is_its_two_sided_tail(value):
    assert surprise(Normal(0.0, 1.0), value) == pytest.approx(
        2.0 * stats.norm.sf(abs(value)), abs=1e-4
    )


@given(st.floats(0.0, 1.0), st.floats(0.2, 5.0))
def test_the_surprise_does_not_depend_on_the_unit(share, unit):
    value = 0.01 + 3.0 * share
    plain, other = LogNormal(0.5, 0.6), LogNormal(0.5 * unit, 0.6)
    assert surprise(other, unit * value) == pytest.approx(surprise(plain, value), abs=2e-4)


def test_neither_a_uniform_prior_nor_readings_better_than_expected_are_surprising():
    assert surprise(Uniform(0.0, 1.0), 1e-9) == 1.0
    assert surprise(HalfNormal(0.3), 1e-6) > 0.999
    assert surprise(Flat(low=0.0), 3.0) == 1.0


def test_a_flat_prior_beside_others_is_never_in_question(vectors):
    model = small_model()
    flat = altered(model, base=with_priors(model.base, {"volume_ratio": Flat()}))
    assert "volume_ratio" not in {one.parameter for one in questioned(flat, vectors)}


def test_a_part_that_did_not_shrink_questions_the_prior_of_one_that_did(vectors):
    """A volume ratio of 0.98 under 0.62 ± 0.07 once stood in a report as adequate."""
    [found] = calibrated_to(vectors, 0.98)
    assert found.parameter == "volume_ratio"
    assert found.median == pytest.approx(0.98)
    assert found.p_value <= MISFIT_LEVEL
    assert (found.prior_low, found.prior_high) == pytest.approx(
        (0.62 - 3.29 * 0.07, 0.62 + 3.29 * 0.07), abs=2e-3
    )


@pytest.mark.parametrize(
    ("value", "law"), [(0.62, GELATIN), (0.80, GELATIN), (0.98, Uniform(0.2, 1.0))]
)
def test_what_a_prior_allows_is_not_in_question(vectors, value, law):
    assert calibrated_to(vectors, value, law) == ()
