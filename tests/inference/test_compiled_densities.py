"""The compiled passes against the same linearisations in plain numpy, one after another."""

import numpy as np
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.inference.model import AT_ONCE
from bayesdeg.observations import curvature as actuators
from bayesdeg.observations import tensile as films
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.noise import LANES, Linearised
from bayesdeg.observations.specimens import stiffness_spread
from bayesdeg.observations.tensile import Tensile, median_stresses
from tests.inference.path_filter import density_and_mode
from tests.inference.small_study import draws_near_truth, small_model

CAUSES = (
    (),
    ("pressure_loss",),
    ("curvature_reading", "stress_measure"),
    ("initial_curvature", "film_mismatch"),
)


@pytest.fixture(scope="module", params=CAUSES, ids="+".join)
def model(request):
    return small_model().extended(*(CATALOGUE[name] for name in request.param))


@pytest.fixture(scope="module")
def values(model):
    base = draws_near_truth(small_model(), 5, spread=0.15)
    generator = np.random.default_rng(1)
    extra = 0.2 * generator.standard_normal((5, len(model.table) - base.shape[1]))
    return model.table.named(np.hstack([base, extra]))


def linearised_film(model, values, median, deviation):
    data = model.data_of(Tensile).tests
    stress, slope = films.film_readings(median, deviation)
    spread = np.empty(deviation.shape)
    spread[..., 0] = values["stiffness_scatter"][:, None] ** 2
    spread[..., 1] = data.degradation_sd**2
    return Linearised(
        data.stress - stress + np.einsum("nspk,nsk->nsp", slope, deviation),
        slope,
        films.stress_variance(values, stress),
        spread,
        values["tensile_noise_length"],
        np.zeros(len(stress)),
        data.paths,
    )


def test_films_are_linearised_three_times(model, values):
    median = median_stresses(model.tests(values), model.data_of(Tensile).tests)
    deviation = np.zeros((*median.at_rest.shape[:2], 2))
    for _ in range(3):
        at = linearised_film(model, values, median, deviation)
        density, deviation = density_and_mode(at)
    got = films.log_density(model.data_of(Tensile).tests, values, median)
    np.testing.assert_allclose(got, density, rtol=1e-11, atol=1e-11)
    there = films.linearise_films(model.data_of(Tensile).tests, values, median)
    np.testing.assert_allclose(density_and_mode(there)[0], density, rtol=1e-11, atol=1e-11)


def test_actuators_are_linearised_twice(model, values):
    state, data = model.tests(values), model.data_of(Curvature).tests
    believed = actuators.estimated_degradation(state, data)
    spread = stiffness_spread(values, model.world.material(values, believed.value), believed.sd)
    mode = np.zeros((*spread.shape, 1))
    for _ in range(2):
        predicted = actuators.predict(state, data, mode)
        at = Linearised(
            data.readings - predicted.mean + predicted.slope * mode,
            predicted.slope[..., None],
            predicted.variance,
            spread[..., None],
            values["curvature_noise_length"],
            values["reading_correlation"],
            data.paths,
        )
        density, mode = density_and_mode(at)
    got, prediction = actuators.log_density(state, data)
    np.testing.assert_allclose(got, density, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(
        prediction.peak_stretch, predicted.prediction.peak_stretch, rtol=1e-11
    )
    there = density_and_mode(model.data_of(Curvature).linearised(model.state(values)))[0]
    np.testing.assert_allclose(there, density, rtol=1e-11, atol=1e-11)


def test_specimens_on_one_path_and_on_several_have_the_densities_of_each_alone(model, values):
    """The filter of a path is kept from one specimen to the next, and dropped where they differ."""
    at = model.data_of(Curvature).linearised(model.state(values))
    together = density_and_mode(at)[0]
    for s in range(together.shape[1]):
        one = slice(s, s + 1)
        paths = at.paths._replace(
            mask=at.paths.mask[one], gap=at.paths.gap[one], place=at.paths.place[one]
        )
        alone = Linearised(*(part[:, one] for part in at[:4]), at.length, at.correlation, paths)
        np.testing.assert_array_equal(density_and_mode(alone)[0][:, 0], together[:, s])


def test_a_batch_in_parts_is_its_vectors_one_by_one():
    model = small_model()
    vectors = draws_near_truth(model, AT_ONCE + 3, spread=0.15)
    found = model.log_prob(vectors)
    assert found.shape == (AT_ONCE + 3,)
    for k in (0, AT_ONCE - 1, AT_ONCE, AT_ONCE + 2):
        np.testing.assert_allclose(found[k], model.log_prob(vectors[k : k + 1])[0], rtol=1e-12)
    assert model.log_prob(vectors[:0]).shape == (0,)


@pytest.mark.parametrize("away", [1e10, -1e10, np.nan])
def test_vectors_without_a_density_leave_those_beside_them_as_they_are(away):
    model = small_model()
    vectors = draws_near_truth(model, 3 * LANES, spread=0.15)
    broken = vectors.copy()
    broken[:LANES] += away
    kept = slice(LANES, None)
    np.testing.assert_array_equal(model.log_prob(broken)[kept], model.log_prob(vectors)[kept])
    for found, known in zip(model.factors(broken), model.factors(vectors), strict=True):
        np.testing.assert_array_equal(found[kept], known[kept])
