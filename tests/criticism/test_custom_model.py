import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import judge_model
from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.checks.discrepancy import (
    AMPLITUDES,
    discrepancies,
    interval_with_discrepancy,
    largest_ratio,
)
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.criticism.fit.trials import try_causes
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.readings import Formula, FormulaReadings, nothing_common, places_of
from bayesdeg.priors import Normal, Parameter
from tests.criticism.straight_subject import predict_one_by_one

ALONG = np.linspace(0.5, 4.0, 12)
SPECIMENS = np.repeat(["a", "b", "c", "d"], 3)
SD, COMMON, SLOPE_SD, SHIFT_SD = 0.3, 0.4, 2.0, 1.5
OBSERVED = 1.3 * ALONG + np.random.default_rng(7).normal(0.0, SD, len(ALONG)) + 0.5


def slope(values, along):
    return values["slope"]


def line(factor, along):
    return factor * along


def error(values, readings):
    return SD


def common(values, readings):
    return COMMON


def shifted(readings, along, effect):
    return readings + effect["size"]


def steeper(factor, along, effect):
    return factor * np.exp(effect["growth"])


def one(name, stage, parameter, **hooks):
    return Cause(name, stage, (parameter,), "acts", {parameter.name: 1.0}, "readings", **hooks)


PARAMETERS = (Parameter("slope", Normal(0.0, SLOPE_SD), "–", "of the line"),)
SHIFT = one(
    "shift",
    Stage.READING,
    Parameter("size", Normal(0.0, SHIFT_SD), "mm", "added", 0.0),
    on_reading=shifted,
)
STEEP = one(
    "steep",
    Stage.MATERIAL,
    Parameter("growth", Normal(0.0, 0.2), "–", "of the slope's logarithm", 0.0),
    on_inputs=steeper,
)


def model(*, observed=OBSERVED, causes=(), parameters=PARAMETERS, **changes):
    world = {"forward": line, "inputs": slope}
    world |= {name: changes.pop(name) for name in (*world, "readings") if name in changes}
    places = places_of(ALONG, specimen=SPECIMENS)
    read = FormulaReadings(observed, places, **{"error": error, **changes})
    return JointModel(parameters, (read,), Formula(**world), causes)


def exact_evidence(subject, *columns):
    """Readings with all linear parameters integrated out: columns are scaled by prior sds."""
    covariance = subject.scatter(np.zeros(len(subject.table)))
    for column in columns:
        covariance = covariance + np.outer(column, column)
    return multivariate_normal(np.zeros(len(ALONG)), covariance).logpdf(OBSERVED)


@pytest.fixture(
    scope="module", params=[nothing_common, common], ids=["errors alone", "specimens differ"]
)
def trial(request):
    return base_without_chain(model(common=request.param), np.random.SeedSequence(0))


def test_the_posterior_is_the_conjugate_one(trial):
    scatter = trial.subject.scatter(trial.mode)
    precision = ALONG @ np.linalg.solve(scatter, ALONG) + SLOPE_SD**-2
    centre = ALONG @ np.linalg.solve(scatter, OBSERVED) / precision
    draws = trial.draws(np.random.default_rng(1), 4000)[:, 0]
    sd = precision**-0.5
    assert trial.mode[0] == pytest.approx(centre, abs=1e-3 * sd)
    assert np.mean(draws) == pytest.approx(centre, abs=0.1 * sd)
    assert np.std(draws) == pytest.approx(sd, rel=0.07)


def test_evidence_and_bayes_factor_are_the_exact_ones(trial):
    base = exact_evidence(trial.subject, SLOPE_SD * ALONG)
    with_shift = exact_evidence(trial.subject, SLOPE_SD * ALONG, SHIFT_SD * np.ones(len(ALONG)))
    screened = screen(trial.linear, SHIFT)
    larger = try_causes(trial, SHIFT, screened.size, np.random.default_rng(2))
    assert trial.log_evidence == pytest.approx(base, abs=0.1)
    assert larger.log_evidence - trial.log_evidence == pytest.approx(with_shift - base, abs=0.15)
    assert screened.log_bayes_factor == pytest.approx(with_shift - base, abs=0.3)


def test_density_is_that_of_the_covariance():
    subject = model(common=common)
    vectors = np.array([[1.0], [1.4]])
    table = subject.table.log_prior(vectors)
    for row, vector in enumerate(vectors):
        law = multivariate_normal(vector[0] * ALONG, subject.scatter(vector))
        assert subject.log_prob(vectors)[row] - table[row] == pytest.approx(law.logpdf(OBSERVED))
        assert subject.group_density(vectors)[row].sum() == pytest.approx(law.logpdf(OBSERVED))


def test_simulated_readings_have_the_covariance_that_is_stated():
    subject = model(common=common)
    drawn = subject.simulated(np.full((20_000, 1), 1.2), np.random.default_rng(3))
    assert np.allclose(drawn.mean(axis=0), 1.2 * ALONG, atol=0.02)
    assert np.allclose(np.cov(drawn.T), subject.scatter(np.array([1.2])), atol=0.015)


def test_held_out_groups_have_the_exact_predictive_density():
    trial = base_without_chain(model(), np.random.SeedSequence(0))
    found = predict_one_by_one(trial, seed=np.random.SeedSequence(5)).log_density
    covariance = SD**2 * np.eye(len(ALONG)) + SLOPE_SD**2 * np.outer(ALONG, ALONG)
    whole = multivariate_normal(np.zeros(len(ALONG)), covariance).logpdf(OBSERVED)
    for number, name in enumerate(("a", "b", "c", "d")):
        rest = name != SPECIMENS
        law = multivariate_normal(np.zeros(rest.sum()), covariance[np.ix_(rest, rest)])
        assert found[number] == pytest.approx(whole - law.logpdf(OBSERVED[rest]), abs=0.25)


@settings(deadline=None)
@given(st.floats(-3.0, 3.0), st.permutations([SHIFT, STEEP]), st.integers(1, 2))
def test_neutral_causes_change_nothing(value, causes, count):
    base = model()
    extended = base.extended(*causes[:count])
    neutral = np.append(value, np.zeros(count))[None]
    assert np.array_equal(extended.expected(neutral), base.expected(np.array([[value]])))
    assert np.array_equal(extended.scatter(neutral[0]), base.scatter(np.array([value])))


@settings(deadline=None)
@given(st.floats(0.1, 3.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_causes_act_in_the_order_of_their_stages(value, size, growth):
    vector = {"slope": value, "shift.size": size, "steep.growth": growth}
    for causes in ((SHIFT, STEEP), (STEEP, SHIFT)):
        extended = model().extended(*causes)
        found = extended.expected(np.array([[vector[n] for n in extended.table.names]]))[0]
        assert np.allclose(found, value * np.exp(growth) * ALONG + size)


@settings(deadline=None)
@given(st.sets(st.integers(0, 3), min_size=1, max_size=3))
def test_groups_left_out_and_kept_make_up_the_whole(rows):
    subject, vectors = model(common=common), np.array([[0.7], [1.9]])
    groups = np.array(sorted(rows), dtype=np.intp)
    kept, left = subject.only(groups), subject.without(groups)
    prior = subject.table.log_prior(vectors)
    both = kept.log_prob(vectors) + left.log_prob(vectors) - prior
    assert np.allclose(both, subject.log_prob(vectors))
    assert np.allclose(kept.group_density(vectors), subject.group_density(vectors)[:, groups])
    assert kept.groups == tuple(subject.groups[g] for g in groups)
    assert set(left.places.specimen) == set(left.groups)
    assert np.allclose(
        left.expected(vectors), subject.expected(vectors)[:, left.observations[0].rows]
    )


def test_readings_of_no_group_are_never_left_out():
    group = np.where(SPECIMENS == "a", "", SPECIMENS)
    subject = model(group=group)
    assert subject.groups == ("b", "c", "d")
    assert set(subject.without(np.arange(3)).places.specimen) == {"a"}
    assert set(subject.only(np.array([0])).places.specimen) == {"a", "b"}


def test_a_refused_prediction_is_impossible_and_not_an_error():
    subject = model(forward=lambda factor, along: np.where(factor > 1.0, factor * along, np.nan))
    vectors = np.array([[0.5], [1.5]])
    assert subject.log_prob(vectors)[0] == -np.inf
    assert np.isfinite(subject.log_prob(vectors)[1])
    assert np.all(subject.group_density(vectors)[0] == -np.inf)
    assert np.all(np.isnan(subject.simulated(vectors, np.random.default_rng(0))[0]))


def test_a_prediction_may_be_any_object():
    subject = model(
        inputs=lambda values, along: {"slope": values["slope"]},
        forward=lambda inputs, along: (inputs["slope"] * along, "note"),
        readings=lambda prediction: prediction[0],
    )
    moved = replace(SHIFT, on_reading=lambda p, along, effect: (p[0] + effect["size"], p[1]))
    assert np.allclose(subject.extended(moved).expected(np.array([[1.0, 2.0]])), ALONG + 2.0)


def test_the_rest_is_the_priors_alone():
    extended = model().extended(SHIFT)
    vectors = np.array([[0.3, 1.0], [1.0, -2.0]])
    assert np.allclose(extended.rest().log_prob(vectors), extended.table.log_prior(vectors))


def test_a_model_of_named_functions_can_be_sent_to_another_process():
    extended = model(common=common).extended(SHIFT)
    again = pickle.loads(pickle.dumps(extended))
    vectors = np.array([[1.2, 0.4]])
    assert again.log_prob(vectors) == extended.log_prob(vectors)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"observed": OBSERVED[:5]}, "places.kind must"),
        ({"observed": OBSERVED[:, None]}, "observed must be"),
        ({"group": np.array(["a"])}, "group must"),
        ({"group": np.roll(SPECIMENS, 1)}, "specimen 'a' is"),
        ({"rows": np.arange(3)}, "rows must"),
        ({"parameters": ()}, "at least one"),
        ({"parameters": PARAMETERS * 2}, "distinct names"),
        ({"causes": (SHIFT, SHIFT)}, "distinct names"),
        ({"causes": (replace(SHIFT, on_reading=None),)}, "neither on inputs"),
    ],
)
def test_what_does_not_go_together_is_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        model(**changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"forward": lambda factor, along: factor[:, 0]}, r"forward must return .*\(3, 12\)"),
        ({"error": lambda values, readings: np.ones(5)}, "error must return"),
        ({"common": lambda values, readings: np.ones(5)}, "common must return"),
        ({"rows": np.arange(12) + 4}, "15, forward returned 12"),
    ],
)
def test_wrong_shapes_of_functions_are_named(changes, said):
    with pytest.raises(ValueError, match=said):
        model(**changes).log_prob(np.ones((3, 1)))


def test_places_need_one_axis():
    with pytest.raises(ValueError, match="one axis"):
        places_of(np.ones((2, 2)))


def test_the_shift_is_named_and_the_slope_is_then_right():
    clean = 1.3 * ALONG + 0.9 + np.random.default_rng(1).normal(0.0, SD, len(ALONG))
    found = judge_model(model(observed=clean), (SHIFT, STEEP), seed=4)
    assert found.decision.outcome == "named"
    assert found.decision.causes == ("shift",)
    low, high = np.quantile(found.draws("slope", np.random.default_rng(0)), [0.01, 0.99])
    assert low < 1.3 < high


def test_a_single_group_cannot_confirm_a_cause():
    clean = 1.3 * ALONG + 2.0 + np.random.default_rng(1).normal(0.0, SD, len(ALONG))
    subject = model(observed=clean, group=np.full(len(ALONG), "all"))
    found = judge_model(subject, (SHIFT, STEEP), seed=4)
    assert found.chosen == {"shift"}
    assert found.held_out == {}
    assert found.decision.causes == ()


def test_nothing_is_named_where_there_is_nothing():
    clean = 1.3 * ALONG + np.random.default_rng(1).normal(0.0, SD, len(ALONG))
    found = judge_model(model(observed=clean), (SHIFT, STEEP), seed=4)
    assert found.decision.outcome == "adequate"
    assert found.possible == (frozenset(),)


def test_the_interval_with_a_discrepancy_is_that_of_the_full_covariance():
    bent = 1.3 * ALONG + 0.4 * ALONG**2
    # a prior away from zero: discrepancies are in proportion to what it expects
    prior = (Parameter("slope", Normal(1.0, SLOPE_SD), "–", "of the line"),)
    trial = base_without_chain(model(observed=bent, parameters=prior), np.random.SeedSequence(0))
    linear = trial.linear
    kernels = discrepancies(linear)
    best = int(largest_ratio(linear.observed[None], kernels)[1][0])
    kernel, amplitude = kernels[best // len(AMPLITUDES)], AMPLITUDES[best % len(AMPLITUDES)]
    half = linear.factor @ kernel.vectors * (amplitude * np.sqrt(kernel.values))
    total = trial.subject.scatter(trial.mode) + half @ half.T
    precision = ALONG @ np.linalg.solve(total, ALONG) + SLOPE_SD**-2
    centre = (ALONG @ np.linalg.solve(total, bent) + SLOPE_SD**-2) / precision
    low, high = interval_with_discrepancy(trial, "slope")
    without = SD / np.linalg.norm(ALONG)
    assert 0.5 * (low + high) == pytest.approx(centre, abs=0.02)
    assert high - low == pytest.approx(2.0 * 1.645 * precision**-0.5, rel=0.05)
    assert precision**-0.5 > 1.2 * without
