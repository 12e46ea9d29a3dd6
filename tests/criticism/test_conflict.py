"""Measured means against what a calibrated model has instead, with scipy's laws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.criticism.conflict import conflict
from bayesdeg.inference.data import Statistic
from tests.inference.small_study import draws_near_truth, small_model


@pytest.fixture(scope="module")
def vectors():
    return draws_near_truth(small_model(), 200)


def ratio(value, *, dof=3.0):
    return Statistic("volume_ratio", 0.0, value, 0.03, "shrinkage.csv, 4 films", dof)


def compared(vectors, *statistics):
    return conflict(replace(small_model(), statistics=statistics), vectors)


@pytest.mark.parametrize(("dof", "law"), [(3.0, stats.t(3.0)), (np.inf, stats.norm())])
@pytest.mark.parametrize("value", [0.4, 0.62, 0.9])
def test_the_chance_is_that_of_students_law_widened_by_the_posterior(vectors, value, dof, law):
    found = compared(vectors, ratio(value, dof=dof))
    drawn = small_model().table.named(vectors)["volume_ratio"]
    far = abs(value - drawn.mean()) / np.sqrt(0.03**2 + drawn.var())
    assert found.p_value == pytest.approx(2.0 * law.sf(far))
    assert (found.wanted, found.wanted_sd) == pytest.approx((drawn.mean(), drawn.std()))


def test_the_worst_of_several_is_told_and_pays_for_having_been_chosen(vectors):
    wrong, fine = ratio(0.95), ratio(0.62)
    alone = compared(vectors, wrong)
    found = compared(vectors, fine, wrong)
    assert found.statistic == wrong
    assert found.p_value == pytest.approx(2.0 * alone.p_value)
    drawn = small_model().table.named(vectors)["volume_ratio"]
    assert compared(vectors, ratio(drawn.mean()), ratio(drawn.mean())).p_value == 1.0


def test_where_nothing_was_measured_nothing_is_contradicted(vectors):
    assert compared(vectors) is None
