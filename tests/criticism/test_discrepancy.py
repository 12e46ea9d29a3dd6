"""The measuring stick of misfit: held against normal densities of scipy, and calibrated."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import kstest, multivariate_normal

from bayesdeg.criticism.checks.discrepancy import (
    ALIKE,
    AMPLITUDES,
    DRIFT,
    EACH,
    EVERYWHERE,
    FEWEST,
    LONG,
    SHORT,
    Misfit,
    discrepancies,
    explained,
    explained_on_one_scale,
    largest_ratio,
    measure,
    resolved,
)
from bayesdeg.criticism.fit.linear import linearise
from bayesdeg.criticism.outcome import LEFT_LEVEL, MISFIT_LEVEL
from bayesdeg.observations.curvature import ANGLE, CURVATURE, Curvature
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import drawn, known_linear, with_readings
from tests.criticism.straight_subject import reading
from tests.inference.small_study import altered, small_model, values_of

PATHS = [(SHORT, EVERYWHERE), (SHORT, DRIFT), (LONG, EVERYWHERE), (LONG, DRIFT), (LONG, EACH)]


@pytest.fixture(scope="module", params=[False, True], ids=["curvature", "with bend angle"])
def linear(request):
    return known_linear(with_angle=request.param)


def statistic_of(linear, readings):
    return float(largest_ratio(linear.whiten(readings)[None], discrepancies(linear))[0][0])


def measured(linear, readings, generator, *, replicates):
    return measure(with_readings(linear, readings), drawn(linear, generator, replicates))


def bump(linear, size, *, angle=1.0):
    """A smooth excess at middle pressures, growing with degradation."""
    places = linear.subject.places
    shape = np.exp(-(((places.along - 90.0) / 40.0) ** 2)) * (1.0 + places.level / 24.0)
    return size * linear.mean * shape * np.where(places.kind == ANGLE, angle, 1.0)


def covariances(linear, alike=ALIKE):
    """Every discrepancy that is tried, written out from the kernel's definition."""
    places = linear.subject.places
    p = places.along / (160.0 - 20.0)
    d = places.level
    same = (places.specimen[:, None] == places.specimen).astype(float)
    shapes = [
        np.exp(-0.5 * (((p[:, None] - p) / along) ** 2 + ((d[:, None] - d) / across) ** 2))
        for along, across in PATHS
    ]
    shapes.append(np.exp(-0.5 * ((p[:, None] - p) / LONG) ** 2) * same)
    envelope = np.abs(linear.mean)
    for kind in (CURVATURE, ANGLE):
        rows = places.kind == kind
        envelope[rows] += 0.1 * np.max(envelope[rows], initial=0.0)
    for kernel, of_angle in product(shapes, alike):
        own = envelope * np.where(places.kind == ANGLE, of_angle, 1.0)
        for amplitude in AMPLITUDES:
            yield amplitude**2 * kernel * np.outer(own, own)


def largest_by_hand(linear, readings, **which):
    """The misfit statistic from densities of scipy."""
    residual = readings - linear.mean
    covariance = linear.factor @ linear.factor.T
    none = multivariate_normal(np.zeros(len(residual)), covariance).logpdf(residual)
    return max(
        multivariate_normal(np.zeros(len(residual)), covariance + extra).logpdf(residual) - none
        for extra in covariances(linear, **which)
    )


def test_statistic_is_the_largest_ratio_of_normal_densities(linear):
    with_bump = linear.mean + bump(linear, 0.1)
    expected = largest_by_hand(linear, with_bump)
    assert statistic_of(linear, with_bump) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("angle", "better"), [(1.0, 1.0), (0.0, 0.0)])
def test_a_discrepancy_is_in_both_readings_or_in_the_curvature_alone(angle, better):
    known = known_linear(with_angle=True)
    readings = known.mean + bump(known, 0.1, angle=angle)
    by_kind = {of: largest_by_hand(known, readings, alike=(of,)) for of in ALIKE}
    assert max(by_kind, key=by_kind.get) == better
    assert statistic_of(known, readings) == pytest.approx(by_kind[better], rel=1e-6)
    assert by_kind[better] > by_kind[1.0 - better] + np.log(20.0)


@pytest.mark.parametrize("angle", [0.0, 1.0])
def test_the_measured_discrepancy_is_that_of_the_readings_it_is_in(angle):
    known = known_linear(with_angle=True)
    planted = bump(known, 0.15, angle=angle)
    found = measured(known, known.mean + planted, np.random.default_rng(20), replicates=9)
    assert found.discrepancy.shape == planted.shape
    assert np.corrcoef(found.discrepancy, planted)[0, 1] > 0.9
    of_angle = known.subject.places.kind == ANGLE
    size = [np.sqrt(np.mean(d[of_angle] ** 2)) for d in (found.discrepancy, bump(known, 0.15))]
    assert size[0] > 0.5 * size[1] if angle else size[0] < 0.1 * size[1]


def test_statistic_is_zero_where_the_model_is_exact(linear):
    assert statistic_of(linear, linear.mean) == 0.0


def test_p_values_are_uniform_on_data_of_the_model(linear):
    generator = np.random.default_rng(11)
    kernels = discrepancies(linear)
    null, statistics = (
        largest_ratio(linear.whiten(drawn(linear, generator, count)), kernels)[0]
        for count in (400, 200)
    )
    p_values = (1.0 + np.sum(null >= statistics[:, None], axis=1)) / (1.0 + len(null))
    # many statistics are 0, where p is 1: below that p is uniform, above it larger
    level = 1.0 - np.mean(null == 0.0)
    assert level > 0.4
    assert kstest(p_values, "uniform", alternative="greater").pvalue > 0.01
    assert np.mean(p_values <= 0.4) == pytest.approx(0.4, abs=3.0 * np.sqrt(0.24 / 200))


def test_data_simulated_by_the_subject_calibrate_its_own_misfit():
    """Of the straight model, whose linear form is exact: p of whole analyses."""
    generator, p_values = np.random.default_rng(12), []
    for seed in range(200):
        linear = straight.exact_linear(straight.readings(seed, slope=1.1, bend=0.05))
        law = straight.joint_of()
        mean, covariance = law.posterior(linear.subject.observed)
        draws = generator.multivariate_normal(mean, covariance, 99)
        p_values.append(measure(linear, linear.subject.simulated(draws, generator)).p_value)
    assert kstest(p_values, "uniform", alternative="greater").pvalue > 0.01
    # posterior draws are closer to the data than the prior says: p is cautious at most
    assert np.mean(np.array(p_values) <= 0.1) <= 0.1 + 3.0 * np.sqrt(0.09 / 200)


def test_the_p_value_counts_simulated_data_that_misfit_as_much(linear):
    generator = np.random.default_rng(18)
    readings = drawn(linear, generator) + bump(linear, 0.03)
    misfit = measured(linear, readings, generator, replicates=99)
    larger = np.sum(misfit.null >= misfit.statistic)
    assert misfit.p_value == pytest.approx((1 + larger) / 100)
    assert measured(linear, linear.mean, generator, replicates=99).p_value == 1.0


@pytest.mark.parametrize(
    ("share", "level", "most", "count"),
    [
        (0.3, MISFIT_LEVEL, 5000, range(200, 201)),  # far from the level
        (0.005, MISFIT_LEVEL, 5000, range(400, 1601)),  # clear at about 800
        (MISFIT_LEVEL, MISFIT_LEVEL, 1000, range(1000, 1001)),  # never clear
        (MISFIT_LEVEL, MISFIT_LEVEL, 0, range(200, 201)),
        (LEFT_LEVEL, LEFT_LEVEL, 1000, range(1000, 1001)),
        (0.05, LEFT_LEVEL, 5000, range(200, 401)),
    ],
)
def test_data_are_simulated_until_the_side_of_a_level_is_clear(linear, share, level, most, count):
    generator = np.random.default_rng(8)

    def simulate(size):
        return drawn(linear, generator, size)

    def null(size):
        return largest_ratio(linear.whiten(simulate(size)), discrepancies(linear))[0]

    statistic, few = float(np.quantile(null(5000), 1.0 - share)), null(200)
    p_value = (1 + np.sum(few >= statistic)) / 201
    first = Misfit(statistic, few, p_value, "actuator", "the path", few, 0.0)
    found = resolved(first, linear, simulate, most=most, level=level)
    assert len(found.null) in count
    assert found.p_value == pytest.approx(share, abs=4.0 * np.sqrt(share / len(found.null)))
    np.testing.assert_array_equal(found.null[:200], few)


def test_simulated_data_without_an_answer_are_left_out_and_counted(linear):
    generator = np.random.default_rng(19)
    readings, simulated = drawn(linear, generator), drawn(linear, generator, 20)
    simulated[[3, 7, 8], 0] = np.nan
    misfit = measure(with_readings(linear, readings), simulated)
    assert misfit.lost == pytest.approx(3 / 20)
    assert len(misfit.null) == 17
    kept = np.delete(np.arange(20), [3, 7, 8])
    np.testing.assert_array_equal(
        misfit.null, measure(with_readings(linear, readings), simulated[kept]).null
    )


@pytest.mark.parametrize("count", [0, FEWEST - 1, FEWEST])
def test_with_too_few_simulated_data_nothing_is_known_of_the_misfit(linear, count):
    """An empty null once gave p = 1, which reads as adequate."""
    generator = np.random.default_rng(21)
    readings = drawn(linear, generator) + bump(linear, 0.15)
    simulated = drawn(linear, generator, 60)
    simulated[count:, 0] = np.nan
    misfit = measure(with_readings(linear, readings), simulated)
    assert (len(misfit.null), misfit.drawn) == (count, 60)
    assert misfit.is_calibrated == (count == FEWEST)
    # the smallest that so many data sets can give
    np.testing.assert_equal(misfit.p_value, MISFIT_LEVEL if count == FEWEST else np.nan)
    again = resolved(misfit, linear, lambda size: drawn(linear, generator, size), most=500)
    assert again.is_calibrated == (count == FEWEST)


def test_without_simulated_data_the_share_that_is_explained_is_of_the_whole_statistic():
    assert misfit_of(8.0, null=()).by_chance == 0.0
    assert explained(misfit_of(8.0, null=()), misfit_of(2.0, null=())) == pytest.approx(0.75)


def test_a_planted_discrepancy_is_measured(linear):
    generator = np.random.default_rng(12)
    planted = bump(linear, 0.15)
    misfit = measured(linear, drawn(linear, generator) + planted, generator, replicates=99)
    assert misfit.p_value == pytest.approx(0.01)
    assert misfit.statistic > 5.0 * misfit.null.max()
    assert np.corrcoef(misfit.discrepancy, planted)[0, 1] > 0.9


def test_misfit_grows_with_what_is_planted(linear):
    readings = drawn(linear, np.random.default_rng(13))
    sizes = [statistic_of(linear, readings + bump(linear, s)) for s in (0.1, 0.2, 0.4)]
    assert sizes == sorted(sizes)
    assert sizes[0] > 0.0


def test_a_stiff_specimen_is_scatter_and_no_misfit(linear):
    """One specimen along its own slope, by one sd of specimens: the model expects that."""
    model = linear.subject
    values = model.table.named(linear.mode[None])
    slope = model.data_of(Curvature).predicted(model.tests(values)).slope[0]
    moved = np.zeros_like(slope)
    moved[2] = float(model.data_of(Curvature).deviation_sd(model.tests(values))[0, 2, 0]) * slope[2]
    assert statistic_of(linear, linear.mean + moved.ravel()) < 1.0


def labels_of(linear):
    return [(kernel.family, kernel.label) for kernel in discrepancies(linear)]


def test_what_a_discrepancy_may_be_a_function_of(linear):
    along = ["the path", "the path, drifting with degradation", "the path, slowly"]
    along += ["the path, slowly, drifting with degradation", "the path, for each degradation rate"]
    # one history of load only, so that none is for each of them
    expected = [*along, "the path, for each specimen"]
    times = 2 if np.any(linear.subject.places.kind == ANGLE) else 1
    assert labels_of(linear) == [("actuator", label) for label in times * expected]


def test_a_discrepancy_of_one_specimen_is_found_as_such():
    """Of opposite sign in specimens of the same level, as no function of pressure and rate is."""
    known = known_linear()
    places = known.subject.places
    sign = np.where(np.isin(places.specimen, ["a", "c", "e"]), 1.0, -1.0)
    bent = 0.2 * sign * known.mean * np.sin(places.along / 40.0)
    found = measured(known, known.mean + bent, np.random.default_rng(21), replicates=19)
    assert found.label.endswith("each specimen")
    assert np.corrcoef(found.discrepancy, bent)[0, 1] > 0.9


def with_histories(linear):
    """The same tests, every other reading unloaded."""
    data = linear.subject.data_of(Curvature).tests
    branch = np.where(np.arange(data.pressure.shape[1]) % 2 == 0, "loading", "unloading")
    recorded = replace(data, branch=np.broadcast_to(branch, data.pressure.shape))
    subject = altered(linear.subject, actuator=recorded)
    return replace(linear, subject=subject)


def test_a_discrepancy_of_one_branch_is_found_as_such():
    known = with_histories(known_linear())
    unloaded = np.char.startswith(known.subject.places.history, "unloading")
    bent = 0.2 * known.mean * np.where(unloaded, 1.0, -1.0)
    found = measured(known, known.mean + bent, np.random.default_rng(22), replicates=19)
    assert "history" in found.label
    assert np.corrcoef(found.discrepancy, bent)[0, 1] > 0.9


@pytest.fixture(scope="module")
def with_films():
    model = small_model()
    return linearise(model, model.table.vectors(values_of())[0])


def test_films_and_actuators_have_discrepancies_of_their_own(with_films):
    places = with_films.subject.places
    families = {family for family, _ in labels_of(with_films)}
    assert families == {"film", "actuator"}
    for kernel in discrepancies(with_films):
        own = with_films.factor @ kernel.vectors
        size = np.max(np.abs(own), axis=1)
        inside = size[places.family == kernel.family].max()
        assert np.all(size[places.family != kernel.family] < 1e-6 * inside)


def test_a_misfit_of_the_films_alone_is_found_in_them(with_films):
    """Stresses of one mode of tension 40 % off."""
    places = with_films.subject.places
    off = np.where(places.history == "equibiaxial", 0.4 * with_films.mean, 0.0)
    z = with_films.whiten(with_films.mean + off)
    statistic, best = largest_ratio(z[None], kernels := discrepancies(with_films))
    kernel = kernels[int(best[0]) // len(AMPLITUDES)]
    assert kernel.family == "film"
    assert statistic[0] > 0.0


def test_kernels_are_positive_and_their_directions_orthonormal_in_kernel_space(linear):
    for kernel in discrepancies(linear):
        assert np.all(kernel.values > 0.0)
        assert kernel.vectors.shape == (len(linear.mean), len(kernel.values))
        np.testing.assert_allclose(
            kernel.vectors.T @ kernel.vectors, np.eye(len(kernel.values)), atol=1e-5
        )


def test_the_same_data_give_the_same_misfit(linear):
    readings = drawn(linear, np.random.default_rng(16))
    one, two = (
        measured(linear, readings, np.random.default_rng(17), replicates=60) for _ in range(2)
    )
    assert one.p_value == two.p_value
    np.testing.assert_array_equal(one.null, two.null)


def misfit_of(statistic, null=(1.0, 3.0)):
    return Misfit(statistic, np.array(null), 0.01, "actuator", "the path", np.zeros(1), 0.0)


def test_explained_counts_from_what_chance_gives():
    assert explained(misfit_of(22.0), misfit_of(12.0)) == pytest.approx(0.5)
    assert explained(misfit_of(22.0), misfit_of(2.0)) == 1.0
    assert explained(misfit_of(22.0), misfit_of(0.0)) == 1.0


def test_explained_is_no_share_where_there_is_nothing_to_explain():
    assert np.isnan(explained(misfit_of(2.0), misfit_of(1.0)))
    assert np.isnan(explained(misfit_of(1.0), misfit_of(1.0)))


def test_what_makes_the_misfit_worse_explains_nothing():
    before = misfit_of(22.0)
    assert explained(before, replace(before, statistic=40.0)) == 0.0


def widened(linear, times):
    """A model that takes its errors and scatter for larger than they are."""
    return linear.with_scatter(times**2 * linear.scatter)


def test_errors_that_a_model_widened_do_not_hide_its_misfit_on_one_scale():
    observed, wave = straight.readings(1, wave=0.15), straight.linear_cause("wave")
    lacking, after = straight.exact_linear(observed), straight.exact_linear(observed, wave)
    share = explained_on_one_scale(lacking, after)
    assert share > 0.9
    wide = widened(lacking, 3.0)
    own = [
        float(largest_ratio(one.observed[None], discrepancies(one))[0][0])
        for one in (lacking, wide)
    ]
    assert own[1] < 0.3 * own[0]
    assert explained_on_one_scale(wide, after) == pytest.approx(share, abs=1e-6)


def test_the_same_model_explains_nothing_on_one_scale():
    one = straight.exact_linear(straight.readings(2, wave=0.3))
    assert explained_on_one_scale(one, one) == pytest.approx(0.0, abs=0.05)


def test_no_share_is_told_on_one_scale_where_there_is_nothing_to_explain():
    linear = straight.exact_linear(straight.readings(3))
    exact = replace(linear, subject=reading(linear.subject, observed_values=linear.mean))
    assert np.isnan(explained_on_one_scale(exact, exact))
