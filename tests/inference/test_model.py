"""The posterior density against plain loops, against quadrature, and by its symmetries."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.material.degradation import satisfies_baker_ericksen
from bayesdeg.observations import noise as likelihood
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.noise import sequential
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.specimens import has_elongation, stiffness_spread
from bayesdeg.observations.tensile import Tensile
from bayesdeg.prediction.predictive import at_conditions
from bayesdeg.priors import Choice
from tests.inference import slow_model
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model, values_of
from tests.surrogate.closed_form import trained


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def vectors(model):
    return draws_near_truth(model, 6, spread=0.15)


def scalars(model, vector):
    return {name: float(v) for name, v in model.table.named(vector).items()}


# ---- against plain loops


@pytest.mark.parametrize(
    ("kind", "slow"),
    [
        ("tensile", slow_model.log_tensile),
        ("actuator", slow_model.log_actuator),
        ("rupture", slow_model.log_rupture),
        ("breaks", slow_model.log_breaks),
        ("statistics", slow_model.log_statistics),
    ],
)
def test_each_kind_of_data_has_the_density_of_plain_loops(model, vectors, kind, slow):
    got = model.log_likelihood(model.table.named(vectors))[kind]
    want = [slow(model, scalars(model, vector)) for vector in vectors]
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-10)


def test_the_prior_is_that_of_scipy_with_its_jacobian(model, vectors):
    want = [slow_model.log_prior(model.table.parameters, scalars(model, v)) for v in vectors]
    np.testing.assert_allclose(model.table.log_prior(vectors), want, rtol=1e-10)


def test_log_prob_is_that_of_plain_loops(model, vectors):
    want = [slow_model.log_prob(model, vector) for vector in vectors]
    assert np.all(np.isfinite(want))
    np.testing.assert_allclose(model.log_prob(vectors), want, rtol=1e-10)


def test_ruptures_are_censored_elongation_limits(model, vectors):
    """Burst between two pressures, at the first, after unloading, or not at all."""
    data = model.data_of(Curvature).tests
    ruptured = np.zeros((5, 7), bool)
    ruptured[1, 4] = ruptured[2, 0] = ruptured[3, 6] = True
    wide = altered(model, actuator=replace(data, ruptured=ruptured, mask=data.mask & ~ruptured))
    values = wide.table.named(vectors) | {"elongation_scatter": np.full(len(vectors), 1.5)}
    got = wide.log_likelihood(values)["rupture"]
    want = [
        slow_model.log_rupture(wide, {k: float(v[i]) for k, v in values.items()})
        for i in range(len(vectors))
    ]
    np.testing.assert_allclose(got, want, rtol=1e-8)
    assert np.all(got[:, [1, 2, 3]] < -0.5)


# ---- the specimen's deviation, integrated out by quadrature


def quadrature(log_density, spread):
    """ln ∫ N(m; 0, τ²) exp(log_density(m)) dm."""
    sd = np.sqrt(spread)
    m = np.linspace(-8.0 * sd, 8.0 * sd, 4001)
    logs = stats.norm(0.0, sd).logpdf(m) + [log_density(x) for x in m]
    top = np.max(logs)
    return top + np.log(integrate.simpson(np.exp(logs - top), x=m))


def normal_log_density(residual, sd, correlation):
    """Log density of residuals (n, k) with sds (n, k) and one correlation matrix (k, k)."""
    z = np.linalg.solve(np.linalg.cholesky(correlation), (residual / sd).T).T
    half = np.sum(np.log(np.diag(np.linalg.cholesky(correlation))))
    total = -0.5 * np.sum(z**2, axis=1) - np.sum(np.log(sd), axis=1) - half
    return total - 0.5 * residual.shape[1] * np.log(2.0 * np.pi)


def exact_actuator(model, values, s):
    """Over stiffness and degradation rate, both: D_R acts through all three constants."""
    data = model.data_of(Curvature).tests
    points = 201
    levels, weights = np.polynomial.hermite_e.hermegauss(15)
    sd = data.degradation_sd[s, 0]
    m = np.linspace(-8.0, 8.0, points) * values["stiffness_scatter"]
    step = (m[1] - m[0]) / np.sqrt(2.0 * np.pi) / values["stiffness_scatter"]
    total = []
    for level, weight in zip(levels, weights / weights.sum(), strict=True):
        moved = altered(
            model,
            actuator=replace(
                data.subset(np.array([s])),
                degradation=data.degradation[[s]] + sd * level,
                degradation_sd=np.zeros((1, 1)),
            ),
        )
        many = {name: np.full(points, value) for name, value in values.items()}
        predicted = moved.data_of(Curvature).predicted(moved.tests(many), m[:, None, None])
        read = moved.data_of(Curvature).tests.paths.mask[0]
        noise = likelihood.noise_correlation(
            moved.data_of(Curvature).tests.paths, *(np.array([values[k]]) for k in NOISE)
        )[0, 0][np.ix_(read, read)]
        # the emulator's error is that of the recorded rate, whatever the true one
        logs = normal_log_density(
            moved.data_of(Curvature).tests.readings[0, read] - predicted.mean[:, 0, read],
            np.sqrt(predicted.variance[:, 0, read]),
            noise,
        )
        logs = np.where(np.isfinite(logs), logs, -np.inf)  # so soft that it balloons
        total.append(logs - 0.5 * (m / values["stiffness_scatter"]) ** 2 + np.log(weight * step))
    return np.logaddexp.reduce(np.concatenate(total))


NOISE = ("curvature_noise_length", "reading_correlation")


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1])
def test_actuators_have_the_density_of_quadrature_over_the_deviation(model, scatter):
    """To a twentieth of a unit of log density, where a unit is what can be told apart at all."""
    values = TRUTH | {"stiffness_scatter": scatter}
    exactly = altered(
        model, actuator=replace(model.data_of(Curvature).tests, degradation_sd=np.zeros((5, 1)))
    )
    got = exactly.log_likelihood(values_of(values))["actuator"][0]
    want = [exact_actuator(exactly, values, s) for s in range(5)]
    np.testing.assert_allclose(got, want, rtol=0.0, atol=0.05)


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1])
def test_uncertain_degradation_rates_are_those_of_quadrature_over_all_constants(model, scatter):
    """Of ± 0.5 to 1 points: what the model leaves out, the errors of C2 and C3, is a tenth."""
    values = TRUTH | {"stiffness_scatter": scatter}
    got = model.log_likelihood(values_of(values))["actuator"][0]
    want = [exact_actuator(model, values, s) for s in range(5)]
    np.testing.assert_allclose(got, want, rtol=0.0, atol=0.1)


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1])
def test_films_have_the_density_of_quadrature_over_both_deviations(model, scatter):
    """With reading errors in proportion to the specimen's own stress, correlated in stretch."""
    values = TRUTH | {"stiffness_scatter": scatter}
    got = model.log_likelihood(values_of(values))["tensile"][0]
    want = [
        exact_film(model, values, s) for s in range(len(model.data_of(Tensile).tests.specimens))
    ]
    np.testing.assert_allclose(got, want, rtol=0.0, atol=0.05)


def exact_film(model, values, s):
    data = model.data_of(Tensile).tests
    points = np.flatnonzero(data.mask[s])
    levels, weights = np.polynomial.hermite_e.hermegauss(15)
    m = np.linspace(-8.0, 8.0, 401) * values["stiffness_scatter"]
    step = (m[1] - m[0]) / np.sqrt(2.0 * np.pi) / values["stiffness_scatter"]
    distance = np.abs(data.stretch[s, points, None] - data.stretch[s, points])
    noise = 0.8 * np.exp(-distance / values["tensile_noise_length"]) + 0.2 * np.eye(len(points))
    total = []
    for level, weight in zip(levels, weights / weights.sum(), strict=True):
        rate = data.degradation[s] + data.degradation_sd[s] * level
        c = slow_model.constants_at(values, model.world.nodes, rate)
        f = np.array(
            [
                slow_model.yeoh_stress(*c, data.stretch[s, j], data.modes[s], data.cauchy[s, j])
                for j in points
            ]
        )
        own = f * np.exp(m)[:, None]
        sd = np.hypot(values["tensile_noise_floor"], values["tensile_noise"] * own)
        logs = normal_log_density(data.stress[s, points] - own, sd, noise)
        total.append(logs - 0.5 * (m / values["stiffness_scatter"]) ** 2 + np.log(weight * step))
    return np.logaddexp.reduce(np.concatenate(total))


# ---- symmetries


def test_the_order_of_specimens_does_not_matter(model, vectors):
    actuators, films = np.array([3, 0, 4, 2, 1]), np.array([2, 0, 3, 1])
    mixed = altered(
        model,
        actuator=model.data_of(Curvature).tests.subset(actuators),
        tensile=model.data_of(Tensile).tests.subset(films),
        breaks=model.data_of(Breaks).table.subset(np.array([1, 2, 0])),
        statistics=model.data_of(Means).statistics[::-1],
    )
    np.testing.assert_allclose(mixed.log_prob(vectors), model.log_prob(vectors), rtol=1e-12)
    before = model.log_likelihood(model.table.named(vectors))
    after = mixed.log_likelihood(model.table.named(vectors))
    np.testing.assert_allclose(after["actuator"], before["actuator"][:, actuators])
    np.testing.assert_allclose(after["rupture"], before["rupture"][:, actuators])
    np.testing.assert_allclose(after["tensile"], before["tensile"][:, films])


def test_padding_does_not_matter(model, vectors):
    data = model.data_of(Curvature).tests

    def wider(values, fill):
        return np.concatenate([values, np.full((len(values), 2), fill)], axis=1)

    padded = ActuatorCurves(
        data.specimens,
        data.degradation,
        data.degradation_sd,
        wider(data.pressure, 55.0),
        wider(data.curvature, 1e3),
        wider(data.curvature_sd, 0.0),
        wider(data.angle_sd, 0.0),
        wider(data.mask, False),
        wider(data.bend_angle, 1e3),
        wider(data.angle_mask, False),
        wider(data.recorded, False),
        wider(data.ruptured, False),
        wider(data.cycle, 1),
        wider(data.branch, "loading"),
        wider(data.time, np.nan),
        wider(data.humidity, np.nan),
        wider(data.mount, "horizontal"),
    )
    np.testing.assert_allclose(
        altered(model, actuator=padded).log_prob(vectors), model.log_prob(vectors), rtol=1e-12
    )


def test_a_batch_is_one_vector_at_a_time(model, vectors):
    single = [model.log_prob(vector[None])[0] for vector in vectors]
    np.testing.assert_allclose(model.log_prob(vectors), single, rtol=1e-12)


@pytest.mark.parametrize("cause", CATALOGUE.values(), ids=list(CATALOGUE))
def test_a_batch_is_one_vector_at_a_time_with_the_surrogate_and_a_cause(vectors, cause):
    model = altered(small_model(), forward=trained()).extended(cause)
    near = np.array(
        [
            float(p.law.to_unconstrained(p.neutral + share * (cause.typical[p.name] - p.neutral)))
            for p in cause.parameters
            for share in [1.0 if isinstance(p.law, Choice) else 0.3]
        ]
    )
    full = np.hstack([vectors, np.tile(near, (len(vectors), 1))])
    single = [model.log_prob(vector[None])[0] for vector in full]
    assert np.sum(np.isfinite(single)) >= 4
    np.testing.assert_allclose(model.log_prob(full), single, rtol=1e-11)


def test_kinds_of_data_that_are_missing_add_nothing(model, vectors):
    total = model.table.log_prior(vectors)
    assert has_elongation(model.base)  # ruptures come with the actuators
    for kind in ("tensile", "actuator", "breaks", "statistics"):
        gone = {k: None for k in ("tensile", "actuator", "breaks") if k != kind}
        if kind != "statistics":
            gone["statistics"] = ()
        alone = altered(model, **gone)
        total = total + alone.log_prob(vectors) - model.table.log_prior(vectors)
    np.testing.assert_allclose(total, model.log_prob(vectors), rtol=1e-12)


# ---- impossible vectors


@pytest.mark.parametrize(
    "change",
    [
        {"c2_ratio_at_25": -1.2},  # dW/dI1 below 0: unstable, and outside the prior
        {"volume_ratio": 1.4},  # outside the prior's bounds
        {"volume_ratio": -0.3},
        {"reading_correlation": 0.99},
    ],
    ids=str,
)
def test_impossible_vectors_have_density_zero_and_not_nan(model, change):
    model = altered(model, forward=trained())
    good, bad = values_of(), values_of(TRUTH | change)
    vectors = model.table.vectors({k: np.concatenate([good[k], bad[k]]) for k in good})
    density = model.log_prob(vectors)
    assert np.isfinite(density[0])
    assert density[1] == -np.inf


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("c1_at_0", (0.1, 0.05, 0.01)),  # p/C1 beyond the training range
        ("c3_at_0", (1e-5, 1e-6, 1e-7)),
        ("c3_at_0", (1.0, 2.0, 5.0)),
        ("paper_stiffness", (1e7, 1e8, 1e9)),
        ("paper_stiffness", (400.0, 200.0, 100.0)),
    ],
)
def test_outside_the_range_of_the_emulator_the_density_falls_the_farther_out(model, name, values):
    model = altered(model, forward=trained())
    vectors = np.concatenate([model.table.vectors(values_of(TRUTH | {name: v})) for v in values])
    at = model.table.named(vectors)
    assert (
        np.isnan(
            model.data_of(Curvature)
            .predicted(model.tests(at))
            .mean[:, model.data_of(Curvature).tests.paths.mask]
        )
        .any(axis=1)
        .all()
    )
    density = model.log_prob(vectors)
    assert np.all(np.isfinite(density))
    assert np.all(np.diff(density) < 0.0)
    inside = model.log_prob(model.table.vectors(values_of()))[0]
    assert np.all(density < inside - 100.0)


def test_no_vector_gives_nan(model):
    generator = np.random.default_rng(5)
    centre = model.table.vectors(values_of())
    wild = centre + 8.0 * generator.standard_normal((300, centre.shape[1]))
    wild[0], wild[1], wild[2] = 800.0, -800.0, np.nan
    density = altered(model, forward=trained()).log_prob(wild)
    assert not np.any(np.isnan(density))
    assert not np.any(density == np.inf)


# ---- simulation


def test_simulations_have_mean_and_covariance_of_the_linearised_law(model):
    count = 20000
    truth = TRUTH | {"stiffness_scatter": 0.02}
    model = altered(
        model, actuator=replace(model.data_of(Curvature).tests, degradation_sd=np.full((5, 1), 0.2))
    )
    many, one = values_of(truth, count), values_of(truth)
    draws = model.data_of(Curvature).drawn(model.tests(many), np.random.default_rng(3))
    for s in range(5):
        read = model.data_of(Curvature).tests.paths.mask[s]
        rows = slow_model.actuator_readings(model, truth, s, 0.0)
        mean, slope, sd, place, output, _ = (np.array(column) for column in zip(*rows, strict=True))
        spread = slow_model.deviation_variance(
            truth,
            model.world.nodes,
            model.data_of(Curvature).tests.degradation[s, 0],
            0.2,
        )
        noise = slow_model.noise_covariance(
            place, output, sd, truth["curvature_noise_length"], truth["reading_correlation"]
        )
        covariance = noise + spread * np.outer(slope, slope)
        sample = draws[:, s, read]
        standard_error = np.sqrt(np.diag(covariance) / count)
        # the law is linear in the deviation but for terms of its variance
        curved = 2.0 * spread * np.abs(mean)
        assert np.all(np.abs(sample.mean(axis=0) - mean) < 4.5 * standard_error + curved)
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        got = white @ np.cov(sample.T) @ white.T
        # 6 % of slope: the paper does not share the deviation, so J is not quite that of a load
        np.testing.assert_allclose(got, np.eye(len(mean)), atol=4.5 * np.sqrt(2.0 / count) + 0.1)
    assert model.data_of(Curvature).predicted(model.tests(one)).mean.shape == (1, 5, 14)


def test_simulations_of_one_seed_are_the_same_and_of_another_differ(model):
    first, again, other = (
        model.data_of(Curvature).drawn(model.tests(values_of(count=3)), np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)
    assert not np.any(first[0] == first[1])
    alone = model.data_of(Curvature).drawn(
        model.tests(values_of(count=3)), np.random.default_rng(1)
    )[..., : model.data_of(Curvature).tests.pressure.shape[1]]
    np.testing.assert_array_equal(alone, first[..., :7])


def test_other_readings_replace_those_that_were_observed_and_nothing_else(model, vectors):
    readings = np.random.default_rng(0).uniform(1.0, 5.0, (5, 14))
    other = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )
    read = model.data_of(Curvature).tests.paths.mask
    np.testing.assert_array_equal(other.data_of(Curvature).tests.readings[read], readings[read])
    np.testing.assert_array_equal(other.data_of(Curvature).tests.readings[~read], 0.0)
    before = model.log_likelihood(model.table.named(vectors))
    after = other.log_likelihood(model.table.named(vectors))
    for kind in ("tensile", "breaks", "statistics"):
        np.testing.assert_array_equal(after[kind], before[kind])
    assert not np.any(after["actuator"] == before["actuator"])
    back = other.with_observations(
        *data_of_actuators(
            other.data_of(Curvature).tests.with_readings(model.data_of(Curvature).tests.readings),
            other.base,
        )
    )
    np.testing.assert_array_equal(back.log_prob(vectors), model.log_prob(vectors))


def test_pointwise_densities_sum_to_those_of_the_specimens(model, vectors):
    values = model.table.named(vectors)
    pointwise = sequential(model.data_of(Curvature).linearised(model.state(values)))
    np.testing.assert_allclose(
        np.sum(pointwise, axis=-1), model.log_likelihood(values)["actuator"], rtol=1e-9
    )
    np.testing.assert_array_equal(pointwise[:, ~model.data_of(Curvature).tests.paths.mask], 0.0)


def test_every_draw_of_the_prior_is_stable(model):
    values = model.table.named(model.table.sample(np.random.default_rng(0), 500))
    levels = np.linspace(0.0, 25.0, 41)
    c1, c2, c3 = np.moveaxis(model.world.constants(values, levels), -1, 0)
    assert np.all(satisfies_baker_ericksen(c1, c2, c3))
    assert np.all(model.allows(values))


def test_films_beyond_the_last_node_must_be_stable_too(model):
    further = replace(model.data_of(Tensile).tests, degradation=np.array([0.0, 22.0, 0.3, 31.0]))
    model = altered(model, tensile=further)
    values = values_of(TRUTH | {"c1_control_12_5": 60.0})  # the parabola falls below 0
    assert not model.allows(values)[0]
    assert model.log_prob(model.table.vectors(values))[0] == -np.inf
    assert model.allows(values_of())[0]


def test_without_parameters_of_its_error_the_emulator_adds_to_every_readings_variance(model):
    values = {k: v for k, v in values_of().items() if not k.startswith("emulator_error")}
    alone = altered(model, base=tuple(p for p in model.base if p.name in values))
    predicted = alone.data_of(Curvature).predicted(alone.tests(values))
    kappa = predicted.prediction.curvature
    floor, share = TRUTH["curvature_noise_floor"], TRUTH["curvature_noise"]
    want = floor**2 + (share**2 + model.world.forward.relative_error**2) * kappa**2
    want = want + model.data_of(Curvature).tests.curvature_sd ** 2
    np.testing.assert_allclose(predicted.variance[..., :7], want)


def test_the_emulators_common_error_has_unit_variance_over_the_tests(model):
    """Over pressures and degradation rates spread evenly from nothing to the largest."""
    generator = np.random.default_rng(4)
    count = 20000
    values = values_of(count=count) | {
        f"emulator_error_{name}": generator.standard_normal(count)
        for name in ("level", "pressure", "degradation")
    }
    shape = (21, 21)
    pressure = np.broadcast_to(np.linspace(0.0, 140.0, 21), shape)
    level = np.linspace(0.0, 25.0, 21)[:, None]
    grid = at_conditions(model, level[:, 0], pressure[0])
    prediction = (
        grid.data_of(Curvature)
        .predicted(grid.tests({k: v[:2000] for k, v in values.items()}))
        .prediction
    )
    truth = replace(grid, base=tuple(p for p in grid.base if "emulator" not in p.name))
    at_truth = truth.tests({k: v[:1] for k, v in values.items() if "emulator" not in k})
    exact = truth.data_of(Curvature).predicted(at_truth).prediction
    g = (prediction.curvature - exact.curvature)[..., 1:] / exact.sd[..., 1:]
    assert np.mean(np.var(g, axis=0)) == pytest.approx(1.0, abs=0.1)


def test_bend_angles_without_a_curvature_are_not_used(model, vectors):
    data = model.data_of(Curvature).tests
    mask = data.mask.copy()
    mask[2, 3] = False
    with_angle = altered(model, actuator=replace(data, mask=mask))
    angle_mask = data.angle_mask.copy()
    angle_mask[2, 3] = False
    without = altered(model, actuator=replace(data, mask=mask, angle_mask=angle_mask))
    np.testing.assert_array_equal(with_angle.log_prob(vectors), without.log_prob(vectors))


def test_an_uncertain_degradation_rate_scatters_stiffness_by_its_slope(model):
    """τ² = σ² + (d ln C1/dD sd)², with d ln C1/dD of the parabola of controls 0.3, 0.5, 1.5."""
    levels, sd = np.array([0.0, 12.5, 25.0]), np.array([0.5, 1.0, 2.0])
    at_levels = [0.3, 0.25 * 0.3 + 0.5 * 0.5 + 0.25 * 1.5, 1.5]
    parabola = np.polynomial.Polynomial.fit(levels, at_levels, 2).convert()
    want = 0.05**2 + (parabola.deriv()(levels) / parabola(levels) * sd) ** 2
    material = model.world.material(values_of(), levels)
    np.testing.assert_allclose(stiffness_spread(values_of(), material, sd)[0], want, rtol=1e-12)
