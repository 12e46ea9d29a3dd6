from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.criticism.posterior.convergence import diagnose
from bayesdeg.inference.sampling import EFFORTS, Chain, Effort
from tests.inference.small_study import small_model

EFFORT = Effort(effective=200.0, r_hat=1.05, chunk=100, longest=1000)


def chain_of(vectors):
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.full(len(vectors), 0.4))


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def independent(model):
    return np.random.default_rng(1).standard_normal((4, 50, 10, len(model.table)))


def test_independent_draws_have_converged(model, independent):
    found = diagnose(model, chain_of(independent), EFFORT)
    assert found.names == model.table.names
    assert (found.ensembles, found.steps, found.walkers) == (4, 50, 10)
    assert found.usable
    assert max(found.r_hat) < 1.05
    assert min(found.ess_bulk) > 1000.0
    assert min(found.ess_tail) > 500.0


def test_ensembles_that_disagree_are_found_out_and_named(model, independent):
    apart = independent.copy()
    where = model.table.names.index("volume_ratio")
    apart[0, :, :, where] += 3.0
    found = diagnose(model, chain_of(apart), EFFORT)
    assert not found.usable
    assert found.names[found.worst] == "volume_ratio"
    assert found.more_helps
    assert max(found.r_hat) == found.r_hat[where] > 1.2


def test_walkers_that_hardly_move_are_few_effective_draws(model, independent):
    slow = np.cumsum(0.05 * independent, axis=1)
    found = diagnose(model, chain_of(slow), EFFORT)
    assert min(found.ess_bulk) < 200.0
    assert not found.usable


def test_the_effort_decides_what_is_enough(model, independent):
    strict = replace(EFFORT, effective=1e6)
    found = diagnose(model, chain_of(independent), strict)
    assert not found.usable
    assert found.effort == strict


def test_tails_and_autocorrelation_times_are_said(model, independent):
    found = diagnose(model, chain_of(independent), EFFORT)
    assert found.ess_tail[found.rarest] == min(found.ess_tail)
    assert found.tau[found.fewest] == max(found.tau)
    assert max(found.tau) == pytest.approx(2000 / min(found.ess_bulk))


def test_what_to_do_depends_on_whether_more_steps_would_be_enough(model, independent):
    few = replace(EFFORTS["thorough"], effective=5000.0)
    assert not diagnose(model, chain_of(independent), few).more_helps
    more = replace(EFFORT, effective=5000.0)
    assert diagnose(model, chain_of(independent), more).more_helps


@pytest.mark.parametrize(("shift", "judged"), [(0.0, True), (0.8, True), (3.0, False)])
def test_what_misses_its_effort_by_a_little_may_be_judged(model, independent, shift, judged):
    moved = independent.copy()
    moved[0, :, :, 0] += shift
    found = diagnose(model, chain_of(moved), EFFORT)
    assert found.is_converged == judged
    assert found.usable == (shift == 0.0)


def test_few_effective_draws_are_not_judged(model, independent):
    found = diagnose(model, chain_of(independent), EFFORT)
    assert replace(found, ess_bulk=(50.0, 60.0)).is_converged
    assert not replace(found, ess_bulk=(49.9, 60.0)).is_converged
