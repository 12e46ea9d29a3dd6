"""The posterior density against plain loops, against quadrature, and by its symmetries."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.inference.data import ActuatorCurves, TensileCurves
from tests.emulator.closed_form import trained
from tests.inference import slow_model
from tests.inference.small_study import TRUTH, draws_near_truth, small_model, values_of


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
        ("breaks", slow_model.log_breaks),
        ("statistics", slow_model.log_statistics),
    ],
)
def test_each_kind_of_data_has_the_density_of_plain_loops(model, vectors, kind, slow):
    got = model.log_likelihood(model.table.named(vectors))[kind]
    want = [slow(model, scalars(model, vector)) for vector in vectors]
    np.testing.assert_allclose(got, want, rtol=1e-8, atol=1e-8)


def test_the_prior_is_that_of_scipy_with_its_jacobian(model, vectors):
    want = [slow_model.log_prior(model.table.parameters, scalars(model, v)) for v in vectors]
    np.testing.assert_allclose(model.table.log_prior(vectors), want, rtol=1e-10)


def test_log_prob_is_that_of_plain_loops(model, vectors):
    want = [slow_model.log_prob(model, vector) for vector in vectors]
    assert np.sum(np.isfinite(want)) >= 4
    assert np.any(np.isinf(want))  # one of them is unstable
    np.testing.assert_allclose(model.log_prob(vectors), want, rtol=1e-8)


# ---- the specimen's deviation, integrated out by quadrature


def quadrature(log_density, spread):
    """ln ∫ N(m; 0, τ²) exp(log_density(m)) dm."""
    sd = np.sqrt(spread)
    m = np.linspace(-8.0 * sd, 8.0 * sd, 4001)
    logs = stats.norm(0.0, sd).logpdf(m) + [log_density(x) for x in m]
    top = np.max(logs)
    return top + np.log(integrate.simpson(np.exp(logs - top), x=m))


def exact_actuator(model, values, s):
    data, mask = model.actuator, model.actuator.mask[s]
    spread = slow_model.deviation_variance(
        values, model.nodes, data.degradation[s, 0], data.degradation_sd[s, 0]
    )
    sd = np.sqrt(spread)
    m = np.linspace(-8.0 * sd, 8.0 * sd, 4001)
    shape = (len(m), len(data.specimens), 1)
    many = {name: np.full(len(m), value) for name, value in values.items()}
    kappa = model.curvature(many, np.broadcast_to(m[:, None, None], shape)).curvature[:, s, mask]
    floor, share = values["curvature_noise_floor"], values["curvature_noise"]
    sigma = np.sqrt(
        floor**2
        + (share * kappa) ** 2
        + (model.forward.relative_error * kappa) ** 2
        + data.curvature_sd[s, mask] ** 2
    )
    logs = np.sum(stats.norm(kappa, sigma).logpdf(data.curvature[s, mask]), axis=-1)
    logs = np.where(np.isfinite(logs), logs, -np.inf)  # a specimen so soft that it balloons
    logs = logs + stats.norm(0.0, sd).logpdf(m)
    top = np.max(logs)
    return top + np.log(integrate.simpson(np.exp(logs - top), x=m))


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1])
def test_actuators_have_the_density_of_quadrature_over_the_deviation(model, scatter):
    """To a twentieth of a unit of log density, where a unit is what can be told apart at all."""
    values = TRUTH | {"stiffness_scatter": scatter}
    got = model.log_likelihood(values_of(values))["actuator"][0]
    want = [exact_actuator(model, values, s) for s in range(len(model.actuator.specimens))]
    np.testing.assert_allclose(got, want, rtol=0.0, atol=0.05)


@pytest.mark.parametrize("scatter", [0.02, 0.05, 0.1])
def test_films_have_the_density_of_quadrature_over_the_deviation(model, scatter):
    """With reading errors in proportion to the specimen's own stress."""
    values = TRUTH | {"stiffness_scatter": scatter}
    got = model.log_likelihood(values_of(values))["tensile"][0]
    data = model.tensile
    for s, mode in enumerate(data.modes):
        level, points = data.degradation[s], np.flatnonzero(data.mask[s])
        constants = slow_model.constants_at(values, model.nodes, level)
        f = np.array(
            [
                slow_model.yeoh_stress(*constants, data.stretch[s, j], mode, data.cauchy[s, j])
                for j in points
            ]
        )
        floor, share = values["tensile_noise_floor"], values["tensile_noise"]
        spread = slow_model.deviation_variance(values, model.nodes, level, data.degradation_sd[s])

        def log_density(m, f=f, y=data.stress[s, points], floor=floor, share=share):
            own = f * np.exp(m)
            return np.sum(stats.norm(own, np.hypot(floor, share * own)).logpdf(y))

        want = quadrature(log_density, spread)
        assert got[s] == pytest.approx(want, abs=0.05)


# ---- symmetries


def reordered_actuator(data, order):
    return data.subset(np.array(order))


def reordered_tensile(data, order):
    pick = np.array(order)
    return TensileCurves(
        tuple(data.specimens[i] for i in order),
        tuple(data.modes[i] for i in order),
        *(
            getattr(data, name)[pick]
            for name in (
                "degradation",
                "degradation_sd",
                "basis",
                "stretch",
                "stress",
                "cauchy",
                "mask",
            )
        ),
    )


def test_the_order_of_specimens_does_not_matter(model, vectors):
    mixed = replace(
        model,
        actuator=reordered_actuator(model.actuator, [3, 0, 4, 2, 1]),
        tensile=reordered_tensile(model.tensile, [2, 0, 3, 1]),
        statistics=model.statistics[::-1],
    )
    np.testing.assert_allclose(mixed.log_prob(vectors), model.log_prob(vectors), rtol=1e-12)
    before = model.log_likelihood(model.table.named(vectors))
    after = mixed.log_likelihood(model.table.named(vectors))
    np.testing.assert_allclose(after["actuator"], before["actuator"][:, [3, 0, 4, 2, 1]])
    np.testing.assert_allclose(after["tensile"], before["tensile"][:, [2, 0, 3, 1]])


def test_the_order_of_rows_does_not_matter(model, vectors):
    order = np.random.default_rng(0).permutation(7)
    data = model.actuator
    mixed_actuator = replace(
        data,
        **{
            name: getattr(data, name)[:, order]
            for name in ("pressure", "curvature", "curvature_sd", "mask", "cycle", "branch")
        },
    )
    rows = np.random.default_rng(1).permutation(6)
    films = model.tensile
    mixed_films = replace(
        films,
        **{
            name: getattr(films, name)[:, rows]
            for name in ("basis", "stretch", "stress", "cauchy", "mask")
        },
    )
    mixed = replace(model, actuator=mixed_actuator, tensile=mixed_films)
    np.testing.assert_allclose(mixed.log_prob(vectors), model.log_prob(vectors), rtol=1e-12)


def test_padding_does_not_matter(model, vectors):
    data = model.actuator

    def wider(values, fill):
        return np.concatenate([values, np.full((len(values), 2), fill)], axis=1)

    padded = ActuatorCurves(
        data.specimens,
        data.degradation,
        data.degradation_sd,
        wider(data.pressure, 55.0),
        wider(data.curvature, 1e3),
        wider(data.curvature_sd, 0.0),
        wider(data.mask, False),
        wider(data.cycle, 1),
        wider(data.branch, "loading"),
    )
    np.testing.assert_allclose(
        replace(model, actuator=padded).log_prob(vectors), model.log_prob(vectors), rtol=1e-12
    )


def test_a_batch_is_one_vector_at_a_time(model, vectors):
    single = [model.log_prob(vector[None])[0] for vector in vectors]
    np.testing.assert_allclose(model.log_prob(vectors), single, rtol=1e-12)


def test_a_batch_is_one_vector_at_a_time_with_the_surrogate_and_causes(vectors):
    model = replace(small_model(), forward=trained()).extended(*CATALOGUE.values())
    extra = len(model.table) - vectors.shape[1]
    generator = np.random.default_rng(7)
    typical = [c.typical[p.name] for c in CATALOGUE.values() for p in c.parameters]
    assert extra == len(typical)
    tail = np.array(typical) * generator.uniform(0.5, 1.0, (len(vectors), extra))
    full = np.hstack([vectors, tail])
    single = [model.log_prob(vector[None])[0] for vector in full]
    assert np.sum(np.isfinite(single)) >= 4
    np.testing.assert_allclose(model.log_prob(full), single, rtol=1e-11)


def test_kinds_of_data_that_are_missing_add_nothing(model, vectors):
    total = model.table.log_prior(vectors)
    for kind in ("tensile", "actuator", "breaks", "statistics"):
        gone = {k: None for k in ("tensile", "actuator", "breaks") if k != kind}
        if kind != "statistics":
            gone["statistics"] = ()
        alone = replace(model, **gone)
        total = total + alone.log_prob(vectors) - model.table.log_prior(vectors)
    np.testing.assert_allclose(total, model.log_prob(vectors), rtol=1e-12)


# ---- impossible vectors


@pytest.mark.parametrize(
    "change",
    [
        {"c2_ratio_at_25": -1.2},  # dW/dI1 below 0: unstable
        {
            "c2_ratio_at_0": -0.64,
            "c2_ratio_at_12_5": 0.59,
            "c2_ratio_at_25": -0.64,
            "c1_at_12_5": 9.0,
        },
        {"c1_at_0": 0.01},  # p/C1 beyond the training range
        {"c3_at_0": 1e-7},
        {"c3_at_0": 5.0},
        {"paper_stiffness": 1e9},
        {"paper_stiffness": 1e2},
        {"volume_ratio": 1.4},  # outside the prior's bounds
        {"volume_ratio": -0.3},
    ],
    ids=str,
)
def test_impossible_vectors_have_density_zero_and_not_nan(model, change):
    model = replace(model, forward=trained())
    good, bad = values_of(), values_of(TRUTH | change)
    vectors = model.table.vectors({k: np.concatenate([good[k], bad[k]]) for k in good})
    density = model.log_prob(vectors)
    assert np.isfinite(density[0])
    assert density[1] == -np.inf


def test_no_vector_gives_nan(model):
    generator = np.random.default_rng(5)
    centre = model.table.vectors(values_of())
    wild = centre + 8.0 * generator.standard_normal((300, centre.shape[1]))
    wild[0], wild[1], wild[2] = 800.0, -800.0, np.nan
    density = replace(model, forward=trained()).log_prob(wild)
    assert not np.any(np.isnan(density))
    assert not np.any(density == np.inf)


# ---- simulation


def test_simulations_have_mean_and_covariance_of_the_linearised_law(model):
    count = 20000
    truth = TRUTH | {"stiffness_scatter": 0.02}
    model = replace(model, actuator=replace(model.actuator, degradation_sd=np.full((5, 1), 0.2)))
    many, one = values_of(truth, count), values_of(truth)
    draws = model.simulate(many, np.random.default_rng(3))
    prediction = model.curvature(one)
    floor = truth["curvature_noise_floor"]
    share = np.hypot(truth["curvature_noise"], model.forward.relative_error)
    for s in range(5):
        mask = model.actuator.mask[s]
        J = -prediction.slope[0, s, mask]
        kappa = prediction.curvature[0, s, mask]
        spread = slow_model.deviation_variance(
            truth, model.nodes, model.actuator.degradation[s, 0], 0.2
        )
        variance = floor**2 + (share * kappa) ** 2 + model.actuator.curvature_sd[s, mask] ** 2
        covariance = np.diag(variance) + spread * np.outer(J, J)
        sample = draws[:, s, mask]
        standard_error = np.sqrt(np.diag(covariance) / count)
        # the law is linear in the deviation but for terms of its variance
        curved = 2.0 * spread * np.abs(kappa)
        assert np.all(np.abs(sample.mean(axis=0) - kappa) < 4.5 * standard_error + curved)
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        got = white @ np.cov(sample.T) @ white.T
        # 6 % of slope: the paper does not share the deviation, so J is not quite that of a load
        np.testing.assert_allclose(got, np.eye(len(J)), atol=4.5 * np.sqrt(2.0 / count) + 0.1)


def test_simulations_of_one_seed_are_the_same_and_of_another_differ(model):
    first, again, other = (
        model.simulate(values_of(count=3), np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)
    assert not np.any(first[0] == first[1])


def test_other_readings_replace_those_that_were_observed_and_nothing_else(model, vectors):
    readings = np.random.default_rng(0).uniform(1.0, 5.0, (5, 7))
    other = model.with_curvature(readings)
    np.testing.assert_array_equal(
        other.actuator.curvature[model.actuator.mask], readings[model.actuator.mask]
    )
    np.testing.assert_array_equal(other.actuator.curvature[~model.actuator.mask], 0.0)
    before = model.log_likelihood(model.table.named(vectors))
    after = other.log_likelihood(model.table.named(vectors))
    for kind in ("tensile", "breaks", "statistics"):
        np.testing.assert_array_equal(after[kind], before[kind])
    assert not np.any(after["actuator"] == before["actuator"])
    back = other.with_curvature(model.actuator.curvature)
    np.testing.assert_array_equal(back.log_prob(vectors), model.log_prob(vectors))


def test_pointwise_densities_sum_to_those_of_the_specimens(model, vectors):
    values = model.table.named(vectors)
    pointwise = model.curvature_pointwise(values)
    np.testing.assert_allclose(
        np.sum(pointwise, axis=-1), model.log_likelihood(values)["actuator"], rtol=1e-10
    )
    np.testing.assert_array_equal(pointwise[:, ~model.actuator.mask], 0.0)


def test_an_uncertain_degradation_rate_scatters_stiffness_by_its_slope(model):
    """τ² = σ² + (d ln C1/dD sd)², with d ln C1/dD of the parabola through 0.3, 0.7, 1.5."""
    levels, sd = np.array([0.0, 12.5, 25.0]), np.array([0.5, 1.0, 2.0])
    parabola = np.polynomial.Polynomial.fit(levels, [0.3, 0.7, 1.5], 2).convert()
    want = 0.05**2 + (parabola.deriv()(levels) / parabola(levels) * sd) ** 2
    np.testing.assert_allclose(model.spread(values_of(), levels, sd)[0], want, rtol=1e-12)
