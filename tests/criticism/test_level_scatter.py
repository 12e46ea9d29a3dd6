"""What whole levels share is no scatter from specimen to specimen."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.fit.level_scatter import CLEAR, within_levels
from bayesdeg.criticism.fit.linear import Whitening, columns_of, linearise, with_neutral
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from tests.criticism.linear_case import tight_model
from tests.inference.small_study import altered, small_model, values_of

COPIES, LEVELS, POINTS = 3, (0.0, 6.0, 12.0, 18.0, 24.0), 8
OWN, SHARED = 0.02, 0.2
NAME = "stiffness_scatter"


@cache
def model(copies=COPIES):
    """Actuators at five levels; the films are left out, which know the scatter as well."""
    base = altered(tight_model(), tensile=None)
    count = copies * len(LEVELS)
    shape = (count, POINTS)
    data = replace(
        base.data_of(Curvature).tests,
        specimens=tuple(f"a{k:02d}" for k in range(count)),
        degradation=np.repeat(LEVELS, copies)[:, None],
        degradation_sd=np.zeros((count, 1)),
        batch=(np.arange(count) % 3 == 1)[:, None].astype(np.int64),
        pressure=np.tile(np.linspace(20.0, 160.0, POINTS), (count, 1)),
        **{
            name: np.resize(getattr(base.data_of(Curvature).tests, name), shape)
            for name in ("curvature", "curvature_sd", "angle_sd", "mask", "bend_angle")
        },
        **{
            name: np.resize(getattr(base.data_of(Curvature).tests, name), shape)
            for name in ("angle_mask", "recorded", "ruptured", "cycle", "branch", "time")
        },
        **{
            name: np.resize(getattr(base.data_of(Curvature).tests, name), shape)
            for name in ("humidity", "mount")
        },
    )
    return altered(base, actuator=data)


def mode_of(subject, scatter):
    return subject.table.vectors(values_of() | {NAME: np.array([scatter])})[0]


def scatter_of(linear):
    return float(linear.subject.table.named(linear.mode[None])[NAME][0])


def log_density(subject, mode):
    [mean] = subject.expected(mode[None])
    return multivariate_normal(mean, subject.scatter(mode)).logpdf(subject.observed)


def fitted(seed, *, shared, own=OWN, copies=COPIES, causes=(), batch=0.0):
    """Linearised where a fit ends that can only let each specimen scatter, and Λ⁻¹."""
    base, generator = model(copies), np.random.default_rng(seed)
    mode = mode_of(base, own)
    level = np.repeat(np.arange(len(LEVELS)), copies)
    deviation = shared * generator.standard_normal(len(LEVELS))[level]
    deviation = deviation + own * generator.standard_normal(len(level))
    deviation = deviation + batch * (base.data_of(Curvature).tests.batch[:, 0] - 1.0 / 3.0)
    errors = np.linalg.cholesky(base.scatter(mode_of(base, 1e-6)))
    [mean] = base.expected(mode[None])
    # curves are linearised where they were read
    slope = (
        base.with_observations(
            *data_of_actuators(
                base.data_of(Curvature).tests.with_readings(mean.reshape(len(level), POINTS)),
                base.base,
            )
        )
        .deviations(mode)
        .slope
    )
    observed = mean + slope @ deviation + errors @ generator.standard_normal(len(mean))
    subject = base.with_observations(
        *data_of_actuators(
            base.data_of(Curvature).tests.with_readings(observed.reshape(len(level), POINTS)),
            base.base,
        )
    )
    tried = [mode_of(base, scatter) for scatter in np.geomspace(0.01, 0.5, 30)]
    mode = max(tried, key=partial(log_density, subject))
    if causes:
        extended = subject.extended(*causes)
        subject, mode = extended, with_neutral(mode, subject, extended)
    uncertain = 1e-8 * np.eye(len(mode))
    place = list(subject.table.names).index(NAME)
    uncertain[place, place] = 1.0
    return linearise(subject, mode, uncertain=uncertain, centre=mode), uncertain


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_scatter_that_levels_share_is_replaced_by_that_within_them(seed):
    linear, uncertain = fitted(seed, shared=SHARED)
    assert scatter_of(linear) > 3.0 * OWN
    found = within_levels(linear, uncertain, linear.mode)
    # ten degrees of freedom within levels: a standard error of a quarter
    assert 0.4 * OWN < scatter_of(found) < 2.5 * OWN
    others = [k for k, name in enumerate(linear.subject.table.names) if name != NAME]
    assert np.array_equal(found.mode[others], linear.mode[others])


def test_scatter_of_each_specimen_stays_what_it_was_fitted_to_be():
    for seed in range(12):
        linear, uncertain = fitted(seed, shared=0.0, own=0.1)
        assert within_levels(linear, uncertain, linear.mode) is linear


@pytest.mark.parametrize(("rates", "copies"), [(6, 3), (3, 2), (1, 5)])
def test_chance_passes_the_threshold_in_one_or_two_studies_of_a_thousand(rates, copies):
    """One-way layouts without errors of reading, each variance at its best."""
    deviations = np.random.default_rng(0).standard_normal((20_000, rates, copies))
    means = deviations.mean(axis=2)
    within = np.sum((deviations - means[..., None]) ** 2, axis=(1, 2))
    between, count = copies * np.sum(means**2, axis=1), rates * copies
    alone = -0.5 * count * np.log((within + between) / count)
    own, of_rates = within / (count - rates), between / rates
    together = -0.5 * ((count - rates) * np.log(own) + rates * np.log(of_rates))
    gain = np.where(of_rates > own, together - alone, 0.0)
    assert 0.0004 < np.mean(gain > CLEAR) < 0.0025


def test_single_specimens_cannot_deviate_together():
    """What a level of one specimen shares is that specimen's own."""
    linear, uncertain = fitted(0, shared=SHARED, copies=1)
    assert within_levels(linear, uncertain, linear.mode) is linear


def test_scatter_of_an_active_cause_is_not_touched():
    misread = find("degradation_misread")
    linear, uncertain = fitted(1, shared=SHARED, causes=(misread,))
    found = within_levels(linear, uncertain, linear.mode)
    own = columns_of(linear.subject, misread)
    assert np.array_equal(found.mode[own], linear.mode[own])
    assert scatter_of(found) < 0.5 * scatter_of(linear)


def test_batches_across_levels_deviate_together_too():
    linear, uncertain = fitted(3, shared=0.0, own=OWN, batch=0.3)
    assert scatter_of(linear) > 3.0 * OWN
    blind = linear.subject.with_observations(
        *data_of_actuators(
            replace(linear.subject.data_of(Curvature).tests, batch=np.array(0)), linear.subject.base
        )
    )
    same = linearise(blind, linear.mode, uncertain=uncertain, centre=linear.mode)
    assert within_levels(same, uncertain, same.mode) is same
    assert scatter_of(within_levels(linear, uncertain, linear.mode)) < 2.5 * OWN


def test_warmth_is_looked_at_where_it_was_recorded():
    linear, uncertain = fitted(4, shared=0.0, own=OWN, batch=0.3)
    warm = np.where(linear.subject.data_of(Curvature).tests.batch == 0, 20.0, 27.0)
    tests = replace(
        linear.subject.data_of(Curvature).tests,
        batch=np.array(0),
        temperature=warm * np.ones(POINTS),
    )
    subject = linear.subject.with_observations(*data_of_actuators(tests, linear.subject.base))
    same = linearise(subject, linear.mode, uncertain=uncertain, centre=linear.mode)
    assert scatter_of(within_levels(same, uncertain, same.mode)) < 2.5 * OWN


def test_films_alone_have_no_levels_that_deviate():
    films = altered(small_model(), actuator=None, forward=None)
    mode = films.table.vectors(values_of())[0]
    uncertain = np.eye(len(mode))
    linear = linearise(films, mode, uncertain=uncertain, centre=mode)
    assert within_levels(linear, uncertain, mode) is linear


def test_a_log_density_is_that_of_the_normal_law_but_for_a_constant():
    generator = np.random.default_rng(2)
    root, shared = generator.standard_normal((5, 5)), generator.standard_normal((5, 2))
    scatter = root @ root.T + np.eye(5)
    law, exact = Whitening.of(scatter, shared), scatter + shared @ shared.T
    data = generator.standard_normal((4, 5))
    gaps = [law.log_density(y) - multivariate_normal(cov=exact).logpdf(y) for y in data]
    assert gaps == pytest.approx(np.full(4, 0.5 * 5 * np.log(2.0 * np.pi)))
