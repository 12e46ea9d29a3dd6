"""A study's model as what can be judged: places, order of readings, groups, laws."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.causes.catalogue import find
from bayesdeg.observations.curvature import ACTUATOR, ANGLE, CURVATURE, Curvature
from bayesdeg.observations.kinds import Places
from bayesdeg.observations.means import Means, Statistic
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import FILM, STRESS, Tensile
from tests.criticism.linear_case import noise_correlation_by_hand, tight_model
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model, values_of


@pytest.fixture(scope="module")
def subject():
    return small_model()


@pytest.fixture(scope="module")
def vectors(subject):
    return draws_near_truth(subject, 3)


def films_alone(modes=None):
    model = altered(small_model(), actuator=None, forward=None)
    if modes is not None:
        model = altered(model, tensile=replace(model.data_of(Tensile).tests, modes=modes))
    return model


def test_films_come_first_then_curvatures_then_bend_angles_of_the_actuators(subject):
    data, films, places = (
        subject.data_of(Curvature).tests,
        subject.data_of(Tensile).tests,
        subject.places,
    )
    count = len(places)
    assert count == films.mask.sum() + data.mask.sum() + data.angle_mask.sum()
    assert all(getattr(places, f.name).shape == (count,) for f in fields(Places))
    assert subject.observed.shape == (count,)
    of = {kind: places.kind == kind for kind in (STRESS, CURVATURE, ANGLE)}
    np.testing.assert_array_equal(subject.observed[of[STRESS]], films.stress[films.mask])
    np.testing.assert_array_equal(subject.observed[of[CURVATURE]], data.curvature[data.mask])
    np.testing.assert_array_equal(subject.observed[of[ANGLE]], data.bend_angle[data.angle_mask])
    assert set(places.family[of[STRESS]]) == {FILM}
    assert set(places.family[~of[STRESS]]) == {ACTUATOR}
    assert np.flatnonzero(of[STRESS]).max() < np.flatnonzero(~of[STRESS]).min()


def test_every_reading_knows_where_it_was_taken(subject):
    """Found again in the tables by specimen and path."""
    data, films = subject.data_of(Curvature).tests, subject.data_of(Tensile).tests
    of_kind = {CURVATURE: data.curvature, ANGLE: data.bend_angle, STRESS: films.stress}
    places = subject.places
    for i in range(len(places)):
        table = films if places.kind[i] == STRESS else data
        row = table.specimens.index(places.specimen[i])
        path = films.stretch[row] if table is films else data.pressure[row]
        [point] = np.flatnonzero(path == places.along[i])
        assert of_kind[str(places.kind[i])][row, point] == subject.observed[i]
        assert places.level[i] == np.ravel(table.degradation)[row]


def test_history_is_mode_of_tension_or_branch_cycle_and_mount(subject):
    places = subject.places
    films = places.kind == STRESS
    assert set(places.history[films]) == {"uniaxial", "equibiaxial", "planar"}
    assert set(places.history[~films]) == {"loading 1 horizontal"}
    assert np.all(np.isnan(places.time))
    data = subject.data_of(Curvature).tests
    branch, cycle = data.branch.astype("U9"), data.cycle.copy()
    branch[0, 3:], cycle[1] = "unloading", 2
    time = np.arange(35.0).reshape(5, 7)
    recorded = replace(data, branch=branch, cycle=cycle, time=time)
    other = altered(subject, actuator=recorded, tensile=None).places
    curvature = other.kind == CURVATURE
    first = other.specimen[curvature] == "a1"
    assert other.history[curvature][first].tolist() == 3 * ["loading 1 horizontal"] + 4 * [
        "unloading 1 horizontal"
    ]
    assert set(other.history[other.specimen == "a2"]) == {"loading 2 horizontal"}
    np.testing.assert_array_equal(other.time[curvature], time[data.mask])


def test_expected_readings_are_those_of_mean_specimens(subject, vectors):
    found = subject.expected(vectors)
    values = subject.table.named(vectors)
    data, films, kind = (
        subject.data_of(Curvature).tests,
        subject.data_of(Tensile).tests,
        subject.places.kind,
    )
    predicted = subject.data_of(Curvature).predicted(subject.tests(values)).prediction.curvature
    np.testing.assert_allclose(found[:, kind == CURVATURE], predicted[:, data.mask], rtol=1e-12)
    constants = subject.world.constants(values, films.degradation)
    stress = np.matmul(films.basis, constants[..., None])[..., 0]
    np.testing.assert_allclose(found[:, kind == STRESS], stress[:, films.mask], rtol=1e-9)


def test_scatter_is_that_of_errors_and_stiffness():
    """One actuator: noise along its path and its own stiffness, as in closed form."""
    model = altered(tight_model(), tensile=None)
    vector = model.table.vectors(values_of())[0]
    values = model.table.named(vector[None])
    # deviations are most probable at 0 where the readings are as predicted
    model = model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                model.data_of(Curvature).predicted(model.tests(values)).mean[0]
            ),
            model.base,
        )
    )
    covariance = model.scatter(vector)
    predicted = model.data_of(Curvature).predicted(model.tests(values))
    sd, slope = np.sqrt(predicted.variance[0]), predicted.slope[0]
    correlation = noise_correlation_by_hand(model, values)
    own = correlation * np.outer(sd[2], sd[2]) + model.data_of(Curvature).deviation_sd(
        model.tests(values)
    )[0, 2, 0] ** 2 * (np.outer(slope[2], slope[2]))
    np.testing.assert_allclose(covariance[16:24, 16:24], own, rtol=1e-9)
    assert not np.any(covariance[16:24, :16])


@pytest.mark.parametrize("family", [FILM, ACTUATOR])
def test_simulated_readings_have_the_scatter_that_is_stated(family):
    """Small deviations, for which the scatter, which is linear, is exact."""
    model = small_model()
    truth = TRUTH | {"stiffness_scatter": 0.01}
    subject = model
    vector = model.table.vectors(values_of(truth))[0]
    # noise alone depends on where deviations are linearised, that is on the readings
    exact = subject.expected(vector[None])[0]
    stress = np.zeros(model.data_of(Tensile).tests.stress.shape)
    stress[model.data_of(Tensile).tests.mask] = exact[subject.places.family == FILM]
    shaped = np.zeros(model.data_of(Curvature).tests.readings.shape)
    shaped[model.data_of(Curvature).tests.paths.mask] = exact[subject.places.family == ACTUATOR]
    model = altered(
        model, tensile=replace(model.data_of(Tensile).tests, stress=stress)
    ).with_observations(
        *data_of_actuators(
            altered(model, tensile=replace(model.data_of(Tensile).tests, stress=stress))
            .data_of(Curvature)
            .tests.with_readings(shaped),
            altered(model, tensile=replace(model.data_of(Tensile).tests, stress=stress)).base,
        )
    )
    subject = model
    drawn = subject.simulated(np.tile(vector, (4000, 1)), np.random.default_rng(1))
    assert drawn.shape == (4000, len(subject.places))
    rows = subject.places.family == family
    factor = np.linalg.cholesky(subject.scatter(vector)[np.ix_(rows, rows)])
    z = np.linalg.solve(factor, (drawn[:, rows] - exact[rows]).T)
    # degradation rates have errors of their own, whose effect is not linear
    assert np.max(np.abs(np.cov(z) - np.eye(len(z)))) < 0.25
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.05)
    assert np.max(np.abs(z.mean(axis=1))) < 0.2


def test_the_rest_is_all_but_the_readings(subject, vectors):
    """Densities of readings and of the rest are those of the whole."""
    values = subject.table.named(vectors)
    blocks = subject.log_likelihood(values)
    readings = blocks["tensile"].sum(axis=1) + blocks["actuator"].sum(axis=1)
    ruptures = blocks["rupture"].sum(axis=1)
    np.testing.assert_allclose(
        subject.rest().log_prob(vectors) + readings + ruptures, subject.log_prob(vectors)
    )


def test_actuators_are_held_out_one_by_one_and_films_never(subject, vectors):
    assert subject.groups == ("a1", "a2", "a3", "a4", "a5")
    of_films = subject.places.family == FILM
    assert set(subject.group[of_films]) == {""}
    np.testing.assert_array_equal(subject.group[~of_films], subject.places.specimen[~of_films])
    without, only = subject.without(np.array([1, 3])), subject.only(np.array([1, 3]))
    assert without.groups == ("a1", "a3", "a5")
    assert only.groups == ("a2", "a4")
    kept = np.isin(subject.group, ["", "a1", "a3", "a5"])
    np.testing.assert_array_equal(without.observed, subject.observed[kept])
    np.testing.assert_allclose(without.expected(vectors), subject.expected(vectors)[:, kept])
    whole = subject.group_density(vectors)
    assert whole.shape == (3, 5)
    np.testing.assert_allclose(only.group_density(vectors), whole[:, [1, 3]], rtol=1e-9)
    # films, breaks, statistics and priors are in both
    rest = without.log_prob(vectors) - without.group_density(vectors).sum(axis=1)
    np.testing.assert_allclose(rest, subject.log_prob(vectors) - whole.sum(axis=1), rtol=1e-9)


def test_films_beside_actuators_are_held_out_where_that_is_wanted(subject, vectors):
    """Then actuators stay, and the density of each film is what the model gives its row."""
    [films, _] = subject.beside
    assert films.groups == ("f1", "f2", "f3", "f4")
    of_films = films.places.family == FILM
    np.testing.assert_array_equal(films.group[of_films], films.places.specimen[of_films])
    assert set(films.group[~of_films]) == {""}
    each = films.log_likelihood(films.table.named(vectors))["tensile"]
    np.testing.assert_allclose(films.group_density(vectors), each)
    without = films.without(np.array([2]))
    assert without.groups == ("f1", "f2", "f4")
    assert without.data_of(Curvature).tests.specimens == subject.groups
    change = films.log_prob(vectors) - without.log_prob(vectors)
    np.testing.assert_allclose(change, each[:, 2], rtol=1e-6)
    assert altered(films, tensile=None).groups == ()


def test_means_of_replicates_are_held_out_where_that_is_wanted(subject, vectors):
    """A mean of four films follows Student's law about what the model expects."""
    shrinkage = Statistic("volume_ratio", 0.0, 0.62, 0.03, "shrinkage.csv, 4 films", 3.0)
    modulus = Statistic("young_modulus", 0.0, 1.73, 0.15, "summary.csv")
    model = altered(subject, statistics=(shrinkage, modulus))
    means = replace(model, held="statistics")
    assert len(means.groups) == 2
    assert "volume_ratio" in means.groups[0]
    assert set(means.group) == {""}
    ratio = means.table.named(vectors)["volume_ratio"]
    exact = stats.t(3.0, ratio, 0.03).logpdf(0.62)
    np.testing.assert_allclose(means.group_density(vectors)[:, 0], exact)
    without = means.without(np.array([0]))
    assert without.data_of(Means).statistics == (modulus,)
    np.testing.assert_allclose(
        means.log_prob(vectors) - without.log_prob(vectors), exact, rtol=1e-6
    )
    assert means.only(np.array([1])).groups == means.groups[1:]


def test_films_alone_are_held_out_by_mode_where_there_are_several():
    subject = films_alone()
    assert subject.groups == ("uniaxial", "equibiaxial", "planar")
    np.testing.assert_array_equal(subject.group, subject.places.history)
    without = subject.without(np.array([0]))
    assert without.data_of(Tensile).tests.specimens == ("f3", "f4")
    only = subject.only(np.array([0]))
    assert only.data_of(Tensile).tests.specimens == ("f1", "f2")
    # groups stay what they are, though one mode is left
    assert only.groups == ("uniaxial",)
    assert set(only.group) == {"uniaxial"}
    vectors = draws_near_truth(subject, 2)
    each = subject.log_likelihood(subject.table.named(vectors))["tensile"]
    found = subject.group_density(vectors)
    np.testing.assert_allclose(found[:, 0], each[:, 0] + each[:, 1])
    np.testing.assert_allclose(found[:, 1:], each[:, 2:])
    np.testing.assert_allclose(only.group_density(vectors), found[:, :1])


def test_films_of_one_mode_are_held_out_one_by_one():
    subject = films_alone(4 * ("uniaxial",))
    assert subject.groups == ("f1", "f2", "f3", "f4")
    np.testing.assert_array_equal(subject.group, subject.places.specimen)
    assert subject.without(np.array([2])).data_of(Tensile).tests.specimens == ("f1", "f2", "f4")


def test_an_extended_model_has_the_same_readings_and_further_parameters(subject):
    cause = find("pressure_offset")
    extended = subject.extended(cause)
    assert extended.causes == (cause,)
    assert set(extended.table.names) - set(subject.table.names) == {"pressure_offset.offset"}
    np.testing.assert_array_equal(extended.observed, subject.observed)


def test_ruptures_count_in_the_density_of_their_specimen(subject, vectors):
    data = subject.data_of(Curvature).tests
    burst = np.zeros(data.ruptured.shape, bool)
    burst[2, 6] = True
    broken = altered(subject, actuator=replace(data, ruptured=burst))
    before, after = subject.group_density(vectors), broken.group_density(vectors)
    np.testing.assert_array_equal(after[:, [0, 1, 3, 4]], before[:, [0, 1, 3, 4]])
    assert np.all(after[:, 2] < before[:, 2] - 1.0)
