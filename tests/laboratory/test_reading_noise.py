"""Errors of reading that are alike along a path, against the closed form of their correlation."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bayesdeg.laboratory.experiment import Design, tear_films
from bayesdeg.laboratory.truth import Truth, correlate_along
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.noise import noise_correlation, paths_of
from tests.laboratory.linear_actuator import LENGTH_M, curvature_by_hand
from tests.laboratory.test_actuators import c1_of, inflate, many

COUNT = 4000
CYCLE = (20.0, 80.0, 140.0, 60.0, 10.0, 100.0)  # up, down and up again [kPa]
ALIKE = replace(Truth(), curvature_noise_length=40.0, reading_correlation=0.6)
WITHIN = 5.0 / np.sqrt(COUNT)  # of an empirical correlation: five of its standard errors


def alike_over(lengths):
    """Correlation over distances in units of the length; a fifth of an error is its own."""
    return 0.8 * np.exp(-lengths) + 0.2 * np.eye(len(lengths))


def by_specimen(values):
    return np.asarray(values).reshape(COUNT, -1)


def errors(truth, pressures=CYCLE):
    """Errors of curvature and bend angle in their standard deviations, (COUNT, 2 n)."""
    readings, specimens = inflate(many(0.0, COUNT, pressures), truth)
    c1 = c1_of(specimens, readings["specimen_id"])
    curvature = curvature_by_hand(readings["pressure_kPa"].to_numpy(), c1, 0.62)
    angle = np.degrees(curvature * LENGTH_M)
    z = (readings["curvature_per_m"] - curvature) / np.hypot(0.1, 0.02 * curvature)
    y = (readings["bend_angle_deg"] - angle) / np.hypot(0.25, 0.02 * angle)
    return np.hstack([by_specimen(z), by_specimen(y)])


def test_errors_are_alike_as_far_as_the_path_is_short():
    place = np.array([0.0, 0.5, 0.7, 2.0, 2.0, 6.0])
    z = np.random.default_rng(1).standard_normal(COUNT * len(place))
    specimen = np.repeat(np.arange(COUNT), len(place))
    alike = by_specimen(correlate_along(np.tile(place, COUNT), z, specimen=specimen, length=1.5))
    expected = alike_over(np.abs(place[:, None] - place) / 1.5)
    np.testing.assert_allclose(np.corrcoef(alike.T), expected, atol=WITHIN)
    np.testing.assert_allclose(alike.std(axis=0), 1.0, atol=WITHIN)


def test_the_order_of_the_rows_does_not_matter_to_the_law():
    """Two specimens row by row, the one from its end: as each by itself along its path."""
    generator = np.random.default_rng(2)
    place, specimen = np.array([3.0, 0.0, 1.0, 2.0]), ["a", "b", "a", "b"]
    z = generator.standard_normal(4)
    alike = correlate_along(place, z, specimen=specimen, length=2.0)
    rho = 0.8 * np.exp(-1.0)
    by_hand = {
        2: z[2],  # the first on the path of a
        0: rho * z[2] + np.sqrt(1.0 - rho**2) * z[0],
        1: z[1],
        3: rho * z[1] + np.sqrt(1.0 - rho**2) * z[3],
    }
    np.testing.assert_allclose(alike, [by_hand[i] for i in range(4)], rtol=1e-12)


def test_errors_without_a_length_are_those_that_were_drawn():
    z = np.random.default_rng(3).standard_normal(5)
    np.testing.assert_array_equal(
        correlate_along(np.arange(5.0), z, specimen=[0] * 5, length=0.0), z
    )


def test_readings_of_an_actuator_are_alike_along_its_path_of_pressure():
    """Path, not pressure: 60 kPa on the way down is far from 80 kPa on the way up."""
    found = np.corrcoef(errors(ALIKE).T)
    travelled = np.cumsum(np.abs(np.diff(CYCLE, prepend=CYCLE[0])))
    decay = alike_over(np.abs(travelled[:, None] - travelled) / 40.0)
    expected = np.block([[decay, 0.6 * decay], [0.6 * decay, decay]])
    np.testing.assert_allclose(found, expected, atol=WITHIN)


def test_the_law_of_the_readings_is_that_which_inference_assumes():
    place = np.cumsum(np.abs(np.diff(CYCLE, prepend=0.0)))[None]
    paths = paths_of(np.ones((1, 2, len(CYCLE)), bool), place)
    assumed = noise_correlation(paths, np.array([40.0]), np.array([0.6]))[0, 0]
    np.testing.assert_allclose(np.corrcoef(errors(ALIKE).T), assumed, atol=WITHIN)


def test_correlated_errors_are_as_large_as_independent_ones():
    for truth in (Truth(), ALIKE):
        np.testing.assert_allclose(errors(truth).std(axis=0), 1.0, atol=WITHIN)


def test_specimens_do_not_share_their_errors():
    """The first reading of a specimen comes in the table right after the last of another."""
    truth = replace(ALIKE, curvature_noise_length=1e4)
    z = errors(truth)[:, : len(CYCLE)]
    assert abs(np.corrcoef(z[1:, 0], z[:-1, -1])[0, 1]) < WITHIN


def test_a_zero_on_the_way_is_a_place_on_the_path():
    """Curvature is counted from there, so that it has no error; those about it have theirs."""
    z = np.corrcoef(errors(ALIKE, (30.0, 0.0, 30.0)).T[[0, 2]])
    assert z[0, 1] == pytest.approx(0.8 * np.exp(-60.0 / 40.0), abs=WITHIN)


def test_stresses_of_a_film_are_alike_along_its_stretch():
    stretch = np.array([1.05, 1.1, 1.3, 1.32])
    films = pd.DataFrame({"specimen_id": [f"f{i}" for i in range(COUNT)]}).assign(
        degradation_pct=0.0, degradation_sd_pct=0.0
    )
    points = pd.DataFrame({"mode": "uniaxial", "stretch": stretch, "stress_measure": "nominal"})
    design = replace(Design(), tensile=films.merge(points, how="cross"), breaks=films)
    truth = replace(Truth(), tensile_noise_length=0.1)
    tensile, _, real = tear_films(design, truth, np.random.default_rng(4))
    constants = truth.constants([0.0])[0] * np.exp(real["ln_stiffness"].to_numpy())[:, None]
    basis = yeoh_basis(stretch, np.full(4, "uniaxial"), np.full(4, "nominal"))
    stress = constants @ basis.T
    z = (by_specimen(tensile["stress_MPa"]) - stress) / np.hypot(0.005, 0.02 * stress)
    expected = alike_over(np.abs(stretch[:, None] - stretch) / 0.1)
    np.testing.assert_allclose(np.corrcoef(z.T), expected, atol=WITHIN)
    np.testing.assert_allclose(z.std(axis=0), 1.0, atol=WITHIN)


def test_by_default_errors_are_the_independent_normals_that_the_generator_gives():
    """In the order in which they always were drawn: specimens, curvatures, bend angles."""
    readings, specimens = inflate(many(15.0, 6, CYCLE), seed=11)
    generator = np.random.default_rng(11)
    deviations = generator.standard_normal((3, 6))
    z, y = generator.standard_normal((2, 6 * len(CYCLE)))
    np.testing.assert_array_equal(specimens["ln_stiffness"], 0.04 * deviations[1])
    c1 = c1_of(specimens, readings["specimen_id"])
    curvature = curvature_by_hand(readings["pressure_kPa"].to_numpy(), c1, 0.62)
    angle = np.degrees(curvature * LENGTH_M)
    np.testing.assert_allclose(
        readings["curvature_per_m"], curvature + np.hypot(0.1, 0.02 * curvature) * z, atol=5.1e-5
    )
    np.testing.assert_allclose(
        readings["bend_angle_deg"], angle + np.hypot(0.25, 0.02 * angle) * y, atol=5.1e-4
    )
