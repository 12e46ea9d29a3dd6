"""Scatter of single specimens against one that those of a level share."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.checks.shared_scatter import SHARES, SharedScatter, shared_scatter
from bayesdeg.criticism.fit.linear import columns_of, with_neutral
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.inference.laplace import weighted
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from tests.criticism.linear_case import tight_model
from tests.inference.small_study import altered, small_model, values_of

MISREAD, STIFFER = find("degradation_misread"), find("film_mismatch")
SCATTER = 4.0  # of degradation rates [%]


def trial_of(*causes, size=SCATTER):
    """Six actuators at three levels, read as the model's mean, with so much scatter added."""
    base = altered(tight_model(with_angle=True), tensile=None)
    start = base.table.vectors(values_of())[0]
    [readings] = base.data_of(Curvature).predicted(base.tests(base.table.named(start[None]))).mean
    base = base.with_observations(
        *data_of_actuators(base.data_of(Curvature).tests.with_readings(readings), base.base)
    )
    subject = base.extended(*causes)
    mode = with_neutral(start, base, subject)
    if MISREAD in causes:
        law = MISREAD.parameters[1].law
        mode[columns_of(subject, MISREAD)[1]] = float(law.to_unconstrained(np.asarray(size)))
    uncertain = 1e-6 * np.eye(len(mode))
    return CandidateFit(subject, mode, 0.0, weighted(mode[None], np.zeros(1)), uncertain, mode)


@pytest.fixture(scope="module")
def scattering():
    return trial_of(MISREAD)


def added(trial):
    """What the added scatter does to each actuator's readings, from the covariances alone."""
    neutral = trial.mode.copy()
    neutral[columns_of(trial.subject, MISREAD)[1]] = float(
        MISREAD.parameters[1].law.to_unconstrained(np.zeros(()))
    )
    more = trial.subject.scatter(trial.mode) - trial.subject.scatter(neutral)
    found = []
    for name in trial.subject.data_of(Curvature).tests.specimens:
        own = trial.subject.places.specimen == name
        values, vectors = np.linalg.eigh(more * np.outer(own, own))
        direction = np.sqrt(values[-1]) * vectors[:, -1]
        found.append(direction * np.sign(direction.sum()))
    return found


def covariance(trial, share):
    """That of the readings where specimens of a level have so much of their scatter in common."""
    linear, directions = trial.linear, added(trial)
    level = trial.subject.data_of(Curvature).tests.degradation[:, 0]
    total = linear.factor @ linear.factor.T
    for k, one in enumerate(directions):
        for other, its in enumerate(directions):
            if k != other and level[k] == level[other]:
                total = total + share * np.outer(one, its)
    return total


def drawn(trial, share, count, seed):
    generator = np.random.default_rng(seed)
    factor = np.linalg.cholesky(covariance(trial, share))
    normals = generator.standard_normal((count, len(factor)))
    return trial.linear.mean + normals @ factor.T


def having_read(trial, readings):
    """The same fit, of other data."""
    subject = replace(trial.subject)
    subject.__dict__["observed"] = readings
    found = replace(trial, subject=subject)
    found.__dict__["linear"] = replace(trial.linear, subject=subject)
    return found


@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
def test_the_statistic_is_a_ratio_of_normal_densities(scattering, share):
    [data] = drawn(scattering, share, 1, 1)
    [found] = shared_scatter(having_read(scattering, data), drawn(scattering, 0.0, 5, 2))
    mean, options = scattering.linear.mean, {"allow_singular": True}
    plain, *exact = (
        multivariate_normal(mean, covariance(scattering, s), **options).logpdf(data)
        for s in (0.0, *SHARES)
    )
    assert found.cause == "degradation_misread"
    assert found.statistic == pytest.approx(max(exact) - plain, rel=1e-5, abs=1e-5)
    assert found.share == SHARES[int(np.argmax(exact))]


def test_p_values_are_those_of_chance_where_every_specimen_deviates_on_its_own(scattering):
    chance = drawn(scattering, 0.0, 99, 3)
    found = [
        shared_scatter(having_read(scattering, data), chance)[0].p_value
        for data in drawn(scattering, 0.0, 60, 4)
    ]
    # uniform: 60 of them are within 3 standard errors
    assert np.mean(found) == pytest.approx(0.5, abs=3.0 * np.sqrt(1.0 / 12.0 / 60.0))
    assert np.mean(np.array(found) <= 0.1) < 0.25


def test_a_deviation_of_whole_levels_is_found(scattering):
    """Two specimens at each of two degraded levels are few: not every time."""
    chance = drawn(scattering, 0.0, 99, 5)
    found = [
        shared_scatter(having_read(scattering, data), chance)[0]
        for data in drawn(scattering, 0.95, 20, 6)
    ]
    assert np.mean([one.p_value <= 0.1 for one in found]) > 0.6
    assert np.mean([one.share >= 0.75 for one in found]) > 0.6


def test_causes_that_widen_no_scatter_are_not_tested():
    data = np.zeros((1, 1))
    assert shared_scatter(trial_of(STIFFER), data) == []
    assert shared_scatter(trial_of(), data) == []
    assert shared_scatter(trial_of(MISREAD, size=1e-12), data) == []


def test_films_alone_are_not_tested(scattering):
    films = altered(small_model(), actuator=None, forward=None)
    assert shared_scatter(replace(scattering, subject=films), np.zeros((1, 1))) == []


@pytest.mark.parametrize(("p_value", "more"), [(0.02, True), (0.021, False)])
def test_more_than_chance_is_what_a_misfit_is_judged_by(p_value, more):
    assert SharedScatter("degradation_misread", 3.0, 0.75, p_value).is_more_than_chance is more
