"""The course of degradation from moisture: density, priors, what is derived from it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import nquad

from bayesdeg.data.moisture import degradation_of_films
from bayesdeg.inference.course import (
    COURSE,
    CourseModel,
    course_model,
    degradation_at,
    moisture_at,
    rate_errors,
    time_to_reach,
)
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.sampling import EFFORTS, sample
from bayesdeg.priors import Normal
from tests.inference.saturating_course import least_squares_course
from tests.run.study_files import SETTINGS, study_in

TRUTH = {
    "fresh_moisture": 20.0,
    "degradation_limit": 32.0,
    "degradation_time_constant": 14.0,
    "moisture_scatter": 0.5,
}
TIMES = np.repeat([0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0], 9)


def values_of(count=1):
    return {name: np.full(count, value) for name, value in TRUTH.items()}


def measured(seed, *, times=TIMES):
    generator = np.random.default_rng(seed)
    mean = moisture_at(values_of(), times)[0]
    moisture = mean + TRUTH["moisture_scatter"] * generator.standard_normal(times.size)
    return CourseModel(tuple(f"m{i}" for i in range(times.size)), times, moisture)


def slow_log_prob(model, vector):
    """The same density film by film, on scipy's laws, with the Jacobians written out."""
    fresh, constant, scatter = np.exp(vector[[0, 2, 3]])
    share = 1.0 / (1.0 + math.exp(-vector[1]))
    limit = 100.0 * share
    total = stats.lognorm(0.4, scale=20.0).logpdf(fresh) + vector[0]
    total += stats.uniform(0.0, 100.0).logpdf(limit) + math.log(100.0 * share * (1.0 - share))
    total += stats.lognorm(1.0, scale=12.0).logpdf(constant) + vector[2]
    total += stats.halfnorm(scale=2.0).logpdf(scatter) + vector[3]
    for time, moisture in zip(model.time_h, model.moisture_pct, strict=True):
        degradation = limit * (1.0 - math.exp(-time / constant))
        mean = fresh - fresh * degradation / 100.0
        total += stats.norm(mean, scatter).logpdf(moisture)
    return total


def test_the_density_is_that_of_plain_loops():
    model = measured(1)
    vectors = model.table.sample(np.random.default_rng(2), 200)
    slow = [slow_log_prob(model, vector) for vector in vectors]
    np.testing.assert_allclose(model.log_prob(vectors), slow, rtol=1e-10, atol=1e-10)


def test_films_sum_to_the_posterior_and_their_order_does_not_matter():
    model = measured(3)
    vectors = model.table.sample(np.random.default_rng(4), 20)
    blocks = model.log_likelihood(model.table.named(vectors))
    assert blocks["moisture"].shape == (20, 63)
    expected = model.table.log_prior(vectors) + blocks["moisture"].sum(axis=-1)
    np.testing.assert_allclose(model.log_prob(vectors), expected, rtol=1e-12)
    turned = np.random.default_rng(5).permutation(63)
    other = replace(model, time_h=model.time_h[turned], moisture_pct=model.moisture_pct[turned])
    np.testing.assert_allclose(other.log_prob(vectors), model.log_prob(vectors), rtol=1e-12)


def test_vectors_far_away_are_impossible_and_not_faults():
    far = np.array([[800.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -800.0], [3.0, np.nan, 2.0, 0.0]])
    assert np.all(measured(1).log_prob(far) == -np.inf)


def test_importance_sample_and_ensembles_agree_with_least_squares():
    model = measured(6)
    generator = np.random.default_rng(7)
    laplace = approximate(model, generator)
    posterior = evidence(model, laplace, generator, draws=50_000)
    assert posterior.effective > 20_000.0
    values = model.table.named(posterior.resample(generator, 40_000))
    seed = np.random.SeedSequence(8)
    chain = sample(model, posterior, effort=EFFORTS["quick"], seed=seed)
    sampled = model.table.named(chain.vectors.reshape(-1, 4))
    course = least_squares_course(degradation_of_films(model.time_h, model.moisture_pct))
    errors = np.sqrt(np.diag(course.covariance))
    for name, least, error in zip(
        ("degradation_limit", "degradation_time_constant"),
        (course.limit_pct, course.time_constant_h),
        errors,
        strict=True,
    ):
        assert abs(np.median(values[name]) - least) < error
        spread = sampled[name].std()
        assert sampled[name].mean() == pytest.approx(values[name].mean(), abs=0.2 * spread)
        assert spread == pytest.approx(values[name].std(), rel=0.1)


def test_the_evidence_is_that_of_quadrature():
    # limit and time constant held: two dimensions are left, and quadrature is exact
    model = replace(measured(9), parameters=COURSE[:1] + COURSE[3:])
    fixed = {"degradation_limit": 32.0, "degradation_time_constant": 14.0}

    class Held:
        table = model.table

        def log_prob(self, vectors, *, truncate=True):
            values = self.table.named(vectors)
            values |= {name: np.full(len(vectors), v) for name, v in fixed.items()}
            with np.errstate(all="ignore"):
                block = model.log_likelihood(values)["moisture"].sum(axis=-1)
                return self.table.log_prior(vectors, truncate=truncate) + block

    held = Held()
    generator = np.random.default_rng(10)
    found = evidence(held, approximate(held, generator), generator, draws=20_000)
    top = found.log_evidence
    integral, _ = nquad(
        lambda a, b: float(np.exp(held.log_prob(np.array([[a, b]]))[0] - top)),
        [[2.9, 3.1], [-1.5, 0.2]],
        opts={"epsrel": 1e-6},
    )
    assert math.log(integral) == pytest.approx(0.0, abs=4.0 * found.error)


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say():
    inside, replicates = 0, 150
    for seed in range(replicates):
        model = measured(1000 + seed)
        generator = np.random.default_rng(seed)
        start = model.table.vectors(values_of())[0]
        posterior = evidence(model, approximate(model, generator, start=start), generator)
        values = model.table.named(posterior.resample(generator, 1000))
        low, high = np.quantile(time_to_reach(values, 20.0), [0.05, 0.95])
        inside += low < time_to_reach(values_of(), 20.0)[0] < high
    assert stats.binomtest(inside, replicates, 0.9).pvalue > 1e-3


def test_the_time_to_a_degradation_rate_inverts_the_course():
    values = values_of(3)
    values["degradation_limit"] = np.array([32.0, 20.0, 19.999])
    time = time_to_reach(values, 20.0)
    assert degradation_at(values, time[:1])[0, 0] == pytest.approx(20.0, rel=1e-12)
    assert time[1:].tolist() == [np.inf, np.inf]


def test_errors_of_rates_are_those_of_simulated_films():
    generator = np.random.default_rng(11)
    replicates, fresh_films, films = 40_000, 9, 3
    levels = np.array([5.0, 25.0])
    values = values_of()
    scatter, moisture = TRUTH["moisture_scatter"], TRUTH["fresh_moisture"]
    fresh = moisture + scatter / np.sqrt(fresh_films) * generator.standard_normal(replicates)
    rates = []
    for level in levels:
        mean = moisture * (1.0 - level / 100.0)
        own = mean + scatter / np.sqrt(films) * generator.standard_normal(replicates)
        rates.append(100.0 * (1.0 - own / fresh))
    errors = rate_errors(values, levels, fresh_films=fresh_films, films=films)
    np.testing.assert_allclose(np.std(rates, axis=1), errors.total[0], rtol=0.02)
    covariance = np.cov(rates)[0, 1]
    assert covariance == pytest.approx(errors.common[0].prod(), rel=0.05)


MOISTURE = "film_id,time_h,mass_equilibrated_g,mass_dry_g\n" + "".join(
    f"m{i},{time},2.5,{2.5 * (1.0 - content)}\n"
    for i, (time, content) in enumerate([(0, 0.2), (0, 0.21), (8, 0.17), (24, 0.15)])
)


def test_a_study_gives_films_on_the_wet_basis_and_its_own_priors(tmp_path):
    settings = SETTINGS + '[priors]\nfresh_moisture = { law = "normal", mean = 21, sd = 2 }\n'
    study = study_in(tmp_path, {"moisture.csv": MOISTURE, "study.toml": settings})
    model = course_model(study)
    assert model.films == ("m0", "m1", "m2", "m3")
    np.testing.assert_allclose(model.moisture_pct, [20.0, 21.0, 17.0, 15.0], rtol=1e-12)
    assert model.table.parameters[0].law == Normal(21.0, 2.0)


def test_films_of_a_single_time_have_no_course(tmp_path):
    assert course_model(study_in(tmp_path)) is None
    lines = MOISTURE.splitlines(keepends=True)
    study = study_in(tmp_path, {"moisture.csv": "".join(lines[:3])})
    assert course_model(study) is None
