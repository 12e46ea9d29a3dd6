"""Parameters that absorb an effect: against normal laws in closed form, and in planted studies."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import assemble
from bayesdeg.criticism.checks.absorption import (
    LEAST_LEARNED,
    Absorption,
    AllElse,
    PlacedEffect,
    Push,
    Split,
    absorption,
    holm,
    judged_kinds,
    measured,
    split,
)
from bayesdeg.criticism.fit.linear import linearise
from bayesdeg.criticism.fit.search import Search, SearchEffort, run_search
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.data.study import read_study
from bayesdeg.inference.laplace import Evidence
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.means import Statistic
from bayesdeg.observations.readings import Formula, FormulaReadings, places_of
from bayesdeg.priors import Flat, Normal, Parameter
from tests.criticism.straight_subject import (
    CAUSES,
    LEVEL,
    SHAPES,
    SPECIMEN,
    X,
    common,
    error,
    fitted,
    joint_of,
    linear_cause,
    readings,
    subject_of,
)
from tests.inference.small_study import altered, draws_near_truth, small_model

COUNT = 4096
STATED = np.array([[0.25, 0.06], [0.06, 0.09]])  # of all else: slope and bend go together


@cache
def standard(size=2):
    """Draws of a normal law with mean 0 and covariance 1 to all digits."""
    drawn = stats.norm.ppf(qmc.Sobol(size, scramble=True, rng=1).random(COUNT))
    drawn = drawn - drawn.mean(axis=0)
    return np.linalg.solve(np.linalg.cholesky(np.cov(drawn.T)), drawn.T).T


def drawn_from(mean, covariance):
    return mean + standard(len(mean)) @ np.linalg.cholesky(covariance).T


def normal_posterior(law, observed, covariance):
    """Mean and covariance of the parameters, from their precisions."""
    precision = np.linalg.inv(covariance)
    information = law.shapes.T @ np.linalg.solve(law.scatter, law.shapes)
    own = np.linalg.inv(precision + information)
    right = precision @ law.mean + law.shapes.T @ np.linalg.solve(law.scatter, observed)
    return own @ right, own


def exact_split(observed, covariance=STATED, subject=None):
    """The split of a model whose posterior and whose law of all else are exactly known."""
    subject, law = subject or subject_of(observed), joint_of()
    mean, own = normal_posterior(law, observed, covariance)
    draws = drawn_from(mean, own)
    weights = np.zeros(COUNT)
    posterior = Evidence(0.0, 0.0, draws, weights, float(COUNT))
    trial = _Resting(subject, mean, 0.0, posterior, covariance, law.mean)
    known = AllElse(drawn_from(law.mean, covariance), np.full(COUNT, 1.0 / COUNT), float(COUNT))
    return Split(trial, known, linearise(subject, mean, uncertain=covariance, centre=law.mean))


class _Resting(CandidateFit):
    """A trial that gives its draws as they are."""

    def draws(self, generator, count):
        return self.posterior.draws


def from_readings_alone(observed, place, covariance):
    """Mean and variance of one parameter from the readings, the other following as all else says.

    By generalised least squares with one column, the other parameter integrated out.
    """
    law, other = joint_of(), 1 - place
    slope = covariance[other, place] / covariance[place, place]
    left = covariance[other, other] - slope * covariance[place, other]
    column = law.shapes[:, place] + slope * law.shapes[:, other]
    scatter = law.scatter + left * np.outer(law.shapes[:, other], law.shapes[:, other])
    information = column @ np.linalg.solve(scatter, column)
    residual = observed - law.shapes @ law.mean
    return law.mean[place] + column @ np.linalg.solve(
        scatter, residual
    ) / information, 1.0 / information


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("planted", [0.0, 0.15])
def test_the_score_is_that_of_readings_alone_against_all_else(place, planted):
    observed = readings(seed=3, offset=planted)
    one = exact_split(observed).displacements[place]
    centre, variance = from_readings_alone(observed, place, STATED)
    m, u = joint_of().mean[place], STATED[place, place]
    assert one.score_sd == pytest.approx((centre - m) / np.sqrt(u + variance), rel=1e-6)
    assert one.learned == pytest.approx(u / (u + variance), rel=1e-6)
    mean, own = normal_posterior(joint_of(), observed, STATED)
    assert one.moved_sd == pytest.approx((mean[place] - m) / np.sqrt(u), rel=1e-6)
    assert 1.0 - one.learned == pytest.approx(own[place, place] / u, rel=1e-6)


def test_the_p_value_is_that_of_two_normal_laws_and_never_nothing():
    for planted in (0.0, 0.1, 2.0):
        one = exact_split(readings(seed=5, offset=planted)).displacements[1]
        exact = 2.0 * stats.norm.sf(abs(one.score_sd))
        assert one.p_alone == pytest.approx(exact, rel=0.03, abs=2.1 / COUNT)
        assert one.p_alone >= 2.0 / (1.0 + COUNT)


def test_without_an_effect_the_p_values_are_uniform():
    generator, found = np.random.default_rng(8), []
    for seed in range(1000):
        slope, bend = generator.multivariate_normal(joint_of().mean, STATED)
        drawn = exact_split(readings(seed=10_000 + seed, slope=slope, bend=bend))
        found.append([one.p_alone for one in drawn.displacements])
    for column in np.array(found).T:
        assert stats.kstest(column, "uniform").pvalue > 0.01
    # all parameters counted: no more than the level in studies without an effect
    false = np.mean([min(holm(np.array(pair))) <= 0.05 for pair in found])
    assert false <= stats.binom.ppf(0.999, 1000, 0.05) / 1000


@pytest.mark.parametrize("name", ["offset", "wave", "ageing"])
@pytest.mark.parametrize("size", [-0.3, 0.2])
def test_the_shift_by_a_cause_is_what_a_refit_with_it_takes_back(name, size):
    observed, cause = readings(seed=4), linear_cause(name)
    here = exact_split(observed)
    effect = PlacedEffect.at(here.model, here.trial.mode, cause, np.array([size]))
    before, _ = normal_posterior(joint_of(), observed, STATED)
    after, _ = normal_posterior(joint_of(), observed - size * SHAPES[name], STATED)
    expected = (before - after) / np.sqrt(np.diag(STATED))
    assert here.shift_by(effect) == pytest.approx(expected, rel=1e-5, abs=1e-7)


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3))
def test_the_unit_of_a_parameter_does_not_matter(unit):
    observed = readings(seed=6, offset=0.2)
    plain = exact_split(observed)
    parameters = (
        Parameter("slope", Normal(unit, 0.5 * unit), "–", "of a test"),
        Parameter("bend", Normal(0.0, 0.3), "–", "of a test"),
    )
    places = places_of(X, level=LEVEL, specimen=SPECIMEN)
    rescaled = JointModel(
        parameters,
        (FormulaReadings(observed, places, error=error, common=common),),
        Formula(lambda values, x: values["slope"] / unit * x + values["bend"] * x**2),
    )
    stretch = np.diag([unit, 1.0])
    known = replace(plain.known, draws=plain.known.draws @ stretch)
    posterior = replace(plain.trial.posterior, draws=plain.trial.posterior.draws @ stretch)
    trial = replace(
        plain.trial, subject=rescaled, mode=plain.trial.mode @ stretch, posterior=posterior
    )
    linear = linearise(rescaled, trial.mode, uncertain=known.covariance, centre=known.mean)
    for one, other in zip(
        plain.displacements, Split(trial, known, linear).displacements, strict=True
    ):
        for what in ("moved_sd", "learned", "score_sd", "p_alone"):
            assert getattr(other, what) == pytest.approx(getattr(one, what), rel=1e-4)


def test_what_is_merely_learned_is_not_in_question():
    """A parameter known to ±1 by its prior that readings put 2 off is told by them, no more."""
    observed = readings(seed=1, slope=3.0, bend=0.0)
    loose = np.diag([1.0, 0.3]) ** 2
    one = exact_split(observed, loose).displacements[0]
    assert one.learned > 0.9
    assert one.moved_sd > 1.645
    assert not one.in_question


def test_what_readings_do_not_show_and_flat_priors_are_not_judged():
    sure = np.diag([1e-3, 0.3]) ** 2
    one, other = exact_split(readings(seed=1), sure).displacements
    assert one.learned < LEAST_LEARNED
    assert not one.is_judged
    assert other.is_judged
    assert other.p_adjusted == other.p_alone  # counted alone
    flat = subject_of(readings(seed=1, offset=3.0))
    flat = replace(flat, base=(replace(flat.base[0], law=Flat()), flat.base[1]))
    assert not exact_split(flat.observed, subject=flat).displacements[0].is_judged


def test_heavy_tails_of_all_else_make_a_contradiction_more_probable():
    normal = AllElse(standard()[:, :1], np.full(COUNT, 1 / COUNT), 4096.0)
    heavy = stats.t(3.0).ppf((np.arange(COUNT) + 0.5) / COUNT)[:, None]
    student = replace(normal, draws=heavy / heavy.std())
    assert student.p_value(0, 4.0, 0.1) > 5.0 * normal.p_value(0, 4.0, 0.1)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holms_p_values_keep_their_order_and_are_between_one_and_all(given_values):
    p_values = np.array(given_values)
    adjusted = holm(p_values)
    assert np.all(adjusted >= p_values)
    assert np.all(adjusted <= np.minimum(1.0, len(p_values) * p_values) + 1e-12)
    assert np.all(np.diff(adjusted[np.argsort(p_values, kind="stable")]) >= 0.0)


def test_means_of_replicates_speak_of_one_parameter_or_of_none():
    model = altered(
        small_model(),
        statistics=(
            Statistic("volume_ratio", 0.0, 0.60, 0.03, "shrinkage.csv, 4 films", 3.0),
            Statistic("volume_ratio", 0.0, 0.70, 0.20, "a guess", 3.0),
            Statistic("young_modulus", 0.0, 1.8, 0.15, "the paper", 2.0),
            Statistic("young_modulus", 12.5, 4.0, 0.4, "the paper", 2.0),
        ),
    )
    found = measured(model, draws_near_truth(model, 1)[0])
    assert set(found) == {"volume_ratio", "c1_at_0"}
    assert found["volume_ratio"].value == pytest.approx(0.60, rel=1e-6)
    assert found["volume_ratio"].source == "shrinkage.csv, 4 films"
    one = found["c1_at_0"]  # Young's modulus is six times C1
    assert (one.value, one.se) == pytest.approx((0.3, 0.025), rel=1e-6)


def test_a_fitted_model_is_split_as_in_closed_form():
    observed = readings(seed=2, offset=0.2)
    found = split(fitted(subject_of(observed)))
    prior = np.diag(joint_of().sd ** 2)
    for one, exact in zip(
        found.displacements, exact_split(observed, prior).displacements, strict=True
    ):
        assert one.score_sd == pytest.approx(exact.score_sd, rel=0.1, abs=0.1)
        assert one.learned == pytest.approx(exact.learned, abs=0.02)
    assert judged_kinds(found.model) == (FormulaReadings.name,)


def searched(observed):
    effort = SearchEffort(replicates=50, fitted=3, pairs=1)
    search = Search(fitted(subject_of(observed)), CAUSES, effort, np.random.SeedSequence(1))
    return search, run_search(search)


def test_the_cause_that_pushed_is_said_and_the_parameter_returns():
    # so close to all else that only the hidden offset can take the slope away
    observed = readings(seed=2, slope=1.0, bend=0.0, offset=1.5)
    search, chosen = searched(observed)
    assert chosen == {"offset"}
    found = absorption(search, chosen)
    [worst, *_] = found.in_question
    assert ("offset",) in {push.causes for push in found.pushed_by(worst)}
    after = found.returned(worst)
    assert abs(after.moved_sd) < 0.5 * abs(worst.moved_sd)
    assert not after.in_question
    [push] = [one for one in found.pushes if one.causes == ("offset",)]
    assert push.share(worst) == pytest.approx(1.0 - after.moved_sd / worst.moved_sd, abs=0.02)


def test_without_an_effect_nothing_is_in_question():
    search, chosen = searched(readings(seed=7, slope=1.2, bend=0.1))
    assert chosen == frozenset()
    found = absorption(search, chosen)
    assert found.in_question == ()
    assert found.after == ()
    assert len(found.pushes) == len(CAUSES)


def pushes(**given_shares):
    one = exact_split(readings(seed=3, offset=0.4)).displacements[0]
    name = one.parameter
    return one, tuple(
        Push(tuple(causes.split("_")), factor, {name: share * one.moved_sd})
        for causes, (factor, share) in given_shares.items()
    )


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ({"a": (50.0, 0.9), "b": (10.0, 1.0)}, (("a",),)),
        ({"a": (48.0, 0.9), "b": (50.0, 0.8)}, (("b",), ("a",))),
        ({"a": (50.0, 0.2), "b": (48.0, -1.0)}, ()),
        ({"a": (50.0, 1.6)}, ()),
        ({"a": (2.0, 1.0)}, ()),
        ({"a": (50.0, 0.4), "b": (50.0, 0.4), "a_b": (50.0, 0.9)}, (("a", "b"),)),
        ({"a": (50.0, 0.8), "b": (50.0, 0.2), "a_b": (50.0, 1.0)}, (("a",),)),
        ({"a": (50.0, float("nan"))}, ()),
    ],
)
def test_what_pushed_has_evidence_and_explains_more_than_it_leaves(shares, expected):
    one, given_pushes = pushes(**shares)
    found = Absorption((one,), given_pushes).pushed_by(one)
    assert tuple(push.causes for push in found) == expected


STUDIES = "tests/hidden_effects/studies"


@cache
def judged(number):
    """What is absorbed in a study whose curvatures are of the fine finite element model."""
    with threadpool_limits(limits=1):
        assembly = assemble(read_study(f"{STUDIES}/{number:02d}"))
        base = base_without_chain(assembly.model, np.random.SeedSequence(1))
        effort = SearchEffort(replicates=50, fitted=3, pairs=1)
        search = Search(base, assembly.candidates, effort, np.random.SeedSequence(2))
        chosen = run_search(search)
        return absorption(search, chosen)


@pytest.mark.long
@pytest.mark.slow
def test_a_volume_ratio_that_took_up_a_wrong_scale_is_found_and_comes_back():
    """A scale read 18 % too small: the base model has a volume ratio that no film shows."""
    found = judged(9)
    [one] = found.in_question
    assert one.parameter == "volume_ratio"
    assert [push.causes for push in found.pushed_by(one)] == [("shrinkage_reading",)]
    assert one.base_q95 < one.all_else_q05 < one.measured
    after = found.returned(one)
    assert abs(after.moved_sd) < 1.0
    assert not after.in_question
    assert after.base_q50 == pytest.approx(one.measured, abs=2 * one.measured_se)


@pytest.mark.slow
def test_where_nothing_is_hidden_no_parameter_is_in_question():
    found = judged(17)
    assert found.in_question == ()
    judged_ones = [one for one in found.displacements if one.is_judged]
    assert len(judged_ones) >= 5
    assert min(one.p_adjusted for one in judged_ones) > MISFIT_LEVEL
