"""Models extended by causes, fitted as a whole: held against exact evidences of normal laws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdeg.criticism.fit import trials
from bayesdeg.criticism.fit.linear import columns_of, effects, with_neutral, with_prior_moments
from bayesdeg.criticism.fit.trials import BENT, STRONG, WANTED, CandidateFit, from_prior, try_causes
from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.laplace import Evidence, Laplace, approximate
from bayesdeg.priors import LogNormal, Normal, Parameter, TruncatedNormal
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import linear_cause

WAVE = linear_cause("wave")


def trial_of(observed, *causes, seed=1):
    """The base model with causes added one after another, each from no guess at all."""
    generator = np.random.default_rng(seed)
    found = straight.fitted(straight.subject_of(observed))
    for cause in causes:
        found = try_causes(found, cause, np.zeros(len(cause.parameters)), generator)
    return found


@pytest.mark.parametrize("names", [(), ("wave",), ("offset",), ("wave", "offset", "lag")])
def test_log_evidence_is_exact(names):
    observed = straight.readings(1, wave=0.2, offset=-0.1)
    causes = [linear_cause(name) for name in names]
    found = trial_of(observed, *causes)
    exact = straight.joint_of(*causes).log_evidence(observed)
    # a tenth is two standard errors of 300 effective draws
    assert found.log_evidence == pytest.approx(exact, abs=0.1)
    assert found.names == frozenset(names)


def test_mode_and_draws_are_those_of_the_exact_posterior():
    observed = straight.readings(2, wave=0.2)
    found = trial_of(observed, WAVE)
    mean, covariance = straight.joint_of(WAVE).posterior(observed)
    sd = np.sqrt(np.diag(covariance))
    # the most probable of mode and draws
    assert np.all(np.abs(found.mode - mean) < 0.1 * sd)
    draws = found.draws(np.random.default_rng(3), 4000)
    assert draws.shape == (4000, 3)
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 0.2 * sd)
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=0.15)


def test_an_effect_of_many_prior_sds_has_the_exact_evidence():
    cause = linear_cause("wave", law=Normal(0.0, 0.02))
    observed = straight.readings(4, wave=0.5)
    found = trial_of(observed, cause)
    exact = straight.joint_of(cause).log_evidence(observed)
    assert exact - straight.joint_of().log_evidence(observed) > 50.0
    assert found.log_evidence == pytest.approx(exact, abs=0.1)


def one_sided(observed, law, sizes=20_001):
    """Exact log evidence where the size has a truncated law: quadrature over its prior."""
    size = np.asarray(law.quantile((np.arange(sizes) + 0.5) / sizes))
    joint = straight.joint_of()
    root = np.linalg.cholesky(joint.covariance)
    residual = observed - joint.shapes @ joint.mean - size[:, None] * straight.SHAPES["wave"]
    squares = np.sum(np.linalg.solve(root, residual.T) ** 2, axis=0)
    constant = np.sum(np.log(np.diag(root))) + 0.5 * len(observed) * np.log(2.0 * np.pi)
    return logsumexp(-0.5 * squares) - np.log(sizes) - constant


@pytest.mark.parametrize("seed", [1, 5])  # with which a sample about the mode alone is off by 2
@pytest.mark.parametrize("size", [-0.3, -0.05])
def test_the_evidence_of_an_effect_of_the_wrong_sign_is_that_of_quadrature(size, seed):
    """Without the bound the mode would be outside."""
    law = TruncatedNormal(0.0, 0.1, 0.0, np.inf)
    observed = straight.readings(5, wave=size)
    found = trial_of(observed, linear_cause("wave", law=law), seed=seed)
    assert found.log_evidence == pytest.approx(one_sided(observed, law), abs=0.1)
    # the mode is on the bound, with all else as it is there
    assert found.mode[-1] == 0.0
    np.testing.assert_allclose(found.mode, making_room(observed, 0.0), atol=1e-3)
    assert found.posterior.effective >= WANTED


def test_the_average_over_the_prior_is_the_exact_log_bayes_factor():
    """Where the effect is not much better known from the data than before."""
    cause = linear_cause("wave", law=Normal(0.0, 0.03))
    observed = straight.readings(7, wave=0.03)
    parent = straight.fitted(straight.subject_of(observed))
    found = from_prior(parent, cause, np.random.default_rng(8), draws=20_000)
    exact = straight.log_factor(observed, cause)
    assert found.log_evidence == pytest.approx(exact, abs=0.1)
    assert found.draws.shape == (20_000, 3)


def test_a_cause_that_is_refused_everywhere_has_no_evidence():
    def refused(readings, conditions, effect):
        return readings + np.where(effect["size"] == 0.0, 0.0, np.nan)

    cause = straight.cause_of("refused", {"size": Normal(0.0, 1.0)}, refused)
    parent = straight.fitted(straight.subject_of(straight.readings(9)))
    found = from_prior(parent, cause, np.random.default_rng(1), draws=50)
    assert found.log_evidence == -np.inf
    assert found.effective == 0.0


def exact_parent(observed):
    """The base model at its exact mode."""
    subject, law = straight.subject_of(observed), straight.joint_of()
    mode = law.posterior(observed)[0]
    one = Evidence(0.0, 0.0, mode[None], np.zeros(1), 1.0)
    return CandidateFit(subject, mode, 0.0, one, np.diag(law.sd**2), law.mean)


def starts_at(observed, size, cause=WAVE):
    """Where the climb with a cause of a guessed size starts, and how strong that effect is."""
    parent, guess = exact_parent(observed), np.array([size])
    strength = np.linalg.norm(np.nan_to_num(effects(parent.linear, cause, guess[None])))
    return trials._starts(parent, parent.subject.extended(cause), cause, guess), strength


def making_room(observed, size):
    """The most probable point at which the wave has this size."""
    without = observed - size * straight.SHAPES["wave"]
    return np.append(straight.joint_of().posterior(without)[0], size)


def test_a_climb_starts_from_a_good_guess_with_all_else_moved_to_make_room():
    observed = straight.readings(13, wave=0.3)
    [start], strength = starts_at(observed, 0.3)
    assert strength > STRONG
    np.testing.assert_allclose(start, making_room(observed, 0.3), atol=1e-6)


def test_a_strong_effect_that_looks_worse_than_none_is_climbed_to_from_two_sides():
    observed = straight.readings(13, wave=0.02)
    (none, room), strength = starts_at(observed, 0.5)
    assert strength > STRONG
    np.testing.assert_allclose(none, [*exact_parent(observed).mode, 0.0], atol=1e-12)
    np.testing.assert_allclose(room, making_room(observed, 0.5), atol=1e-6)


def test_a_weak_effect_that_looks_worse_than_none_is_climbed_to_from_two_sides_too():
    observed = straight.readings(13, wave=0.02)
    (none, room), strength = starts_at(observed, -0.04)
    assert 0.0 < strength < STRONG
    np.testing.assert_allclose(none, [*exact_parent(observed).mode, 0.0], atol=1e-12)
    np.testing.assert_allclose(room, making_room(observed, -0.04), atol=1e-6)


def test_where_a_draw_is_higher_than_the_mode_the_climb_goes_on_from_it(monkeypatch):
    """As where the first climb ended on a lower mode."""
    observed = straight.readings(13, wave=0.3)
    climbs = []

    def lost_at_first(density, generator, *, start):
        climbs.append(start)
        found = approximate(density, generator, start=start)
        if len(climbs) > 1:
            return found
        away = found.mode + 3.0 * np.sqrt(np.diag(found.covariance))
        return Laplace(away, found.covariance, float(density.log_prob(away[None])[0]))

    monkeypatch.setattr(trials, "approximate", lost_at_first)
    found = trial_of(observed, WAVE)
    assert len(climbs) == 2
    np.testing.assert_allclose(
        found.mode, straight.joint_of(WAVE).posterior(observed)[0], atol=1e-2
    )
    exact = straight.joint_of(WAVE).log_evidence(observed)
    assert found.log_evidence == pytest.approx(exact, abs=0.2)


def test_a_guess_that_the_model_refuses_is_no_start():
    def refused(readings, conditions, effect):
        return readings + np.where(effect["size"] == 0.0, 0.0, np.nan)

    observed = straight.readings(13)
    cause = straight.cause_of("refused", {"size": Normal(0.0, 1.0)}, refused)
    [start], _ = starts_at(observed, 0.5, cause)
    np.testing.assert_allclose(start, [*exact_parent(observed).mode, 0.0], atol=1e-12)


def bent(by):
    """A fitted model whose slope is this many standard deviations from what all else says."""
    parent = exact_parent(straight.readings(13))
    sd = np.sqrt(np.diag(parent.uncertain))
    return replace(parent, centre=parent.mode - np.array([by * sd[0], 0.5 * sd[1]]))


def test_a_parameter_that_gave_way_is_put_where_all_else_has_it_and_no_other():
    trial = bent(BENT + 0.1)
    found = trial.unbent()
    np.testing.assert_allclose(found.mode, [trial.centre[0], trial.mode[1]], atol=1e-12)
    shapes = straight.joint_of().shapes
    np.testing.assert_allclose(found.prediction, shapes @ found.mode, atol=1e-9)
    # the readings are expected where all else has every parameter
    np.testing.assert_allclose(found.mean, shapes @ trial.centre, atol=1e-6)
    np.testing.assert_allclose(found.factor, trial.linear.factor, atol=1e-7)


def test_where_no_parameter_gave_way_there_is_nothing_to_put_back():
    assert bent(BENT - 0.1).unbent() is None
    assert bent(-(BENT - 0.1)).unbent() is None
    assert bent(BENT + 0.1).unbent() is not None


def test_the_size_of_a_cause_is_no_parameter_that_gave_way():
    """It is far from its prior because the readings say so."""
    trial = bent(BENT - 0.1)
    cause = linear_cause("wave")
    extended = trial.subject.extended(cause)
    point = with_neutral(trial.mode, trial.subject, extended)
    centre, uncertain = with_prior_moments(trial.centre, trial.uncertain, trial.subject, extended)
    at = columns_of(extended, cause)
    point[at] += 20.0 * np.sqrt(np.diag(uncertain))[at]
    far = replace(trial, subject=extended, mode=point, uncertain=uncertain, centre=centre)
    assert far.unbent() is None


def test_a_model_that_does_not_answer_where_all_else_has_it_is_not_put_back():
    trial = bent(BENT + 0.1)

    class Refusing:
        """Answers for slopes near the mode only."""

        def __getattr__(self, name):
            return getattr(trial.subject, name)

        def expected(self, vectors):
            near = np.abs(vectors[:, :1] - trial.mode[0]) < 1e-2
            return np.where(near, trial.subject.expected(vectors), np.nan)

    assert not np.isclose(trial.centre[0], trial.mode[0], atol=1e-2)
    assert replace(trial, subject=Refusing()).unbent() is None


def test_what_is_known_of_added_parameters_is_their_prior():
    """Of a positive one its logarithm, which is what the vectors hold."""
    cause = straight.cause_of(
        "two",
        {"size": Normal(0.5, 0.4), "more": TruncatedNormal(0.0, 2.0, 0.0, np.inf)},
        straight.untouched,
    )
    subject = straight.subject_of(straight.readings(10))
    extended = subject.extended(linear_cause("wave"), cause)
    known = np.array([[0.2, 0.05], [0.05, 0.1]])
    mean, found = with_prior_moments(np.array([0.7, -0.2]), known, subject, extended)
    names = list(extended.table.names)
    base = [names.index(name) for name in ("slope", "bend")]
    np.testing.assert_array_equal(found[np.ix_(base, base)], known)
    np.testing.assert_array_equal(mean[base], [0.7, -0.2])
    own = [names.index(name) for name in ("wave.size", "two.size", "two.more")]
    # a half normal law of scale 2 has the variance 4 (1 − 2/π)
    expected = np.diag([0.3**2, 0.4**2, 4.0 * (1.0 - 2.0 / np.pi)])
    np.testing.assert_allclose(found[np.ix_(own, own)], expected, rtol=0.02)
    centre = [0.0, 0.5, 2.0 * np.sqrt(2.0 / np.pi)]
    np.testing.assert_allclose(mean[own], centre, rtol=0.02, atol=1e-9)
    assert not np.any(found[np.ix_(base, own)])


def test_prior_variance_is_on_the_scale_of_the_vectors():
    ratio = Parameter("ratio", LogNormal(2.0, 0.7), "–", "of a test")
    shift = Parameter("shift", Normal(0.0, 1.0), "–", "of a test")
    small, large = CustomDensity((shift,), len), CustomDensity((ratio, shift), len)
    mean, wider = with_prior_moments(np.array([0.1]), np.array([[0.3]]), small, large)
    np.testing.assert_allclose(mean, [np.log(2.0), 0.1], rtol=1e-6)
    np.testing.assert_allclose(wider, [[0.49, 0.0], [0.0, 0.3]], rtol=0.02)


def test_neutral_vectors_leave_the_prediction():
    subject = straight.subject_of(straight.readings(11))
    extended = subject.extended(*straight.CAUSES)
    vector = np.array([1.2, -0.3])
    longer = with_neutral(vector, subject, extended)
    np.testing.assert_array_equal(extended.expected(longer[None]), subject.expected(vector[None]))
    assert [extended.table.names[i] for i in columns_of(extended, WAVE)] == ["wave.size"]


def test_the_same_generator_gives_the_same_trial():
    observed = straight.readings(12)
    one, two = (trial_of(observed, WAVE, seed=4) for _ in range(2))
    assert one.log_evidence == two.log_evidence
    np.testing.assert_array_equal(one.posterior.draws, two.posterior.draws)
    np.testing.assert_array_equal(one.mode, two.mode)
