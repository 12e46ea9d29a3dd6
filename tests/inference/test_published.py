"""Published R² and counts of ruptures as data, against scipy, plain loops and simulation."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.data.study import read_study
from bayesdeg.errors import StudyError
from bayesdeg.material.degradation import yeoh_constants
from bayesdeg.material.strength import Strength
from bayesdeg.observations.counts import log_count, rupture_chances
from bayesdeg.observations.kinds import State
from bayesdeg.observations.published import (
    PRESSURES,
    Differences,
    PublishedTests,
    expected_total,
    misfit_moments,
    of_tests,
    published_counts,
    published_tests,
    r_squared_log_density,
)
from bayesdeg.observations.specimens import FilmsAndActuators, Material
from bayesdeg.surrogate.trained import default_surrogate
from tests.surrogate.closed_form import ClosedFormMap

GELATIN = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"
LEVELS = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 25.0])
PUBLISHED = (0.984, 0.997, 0.982, 0.931, 0.920, 0.861)


def some_differences(generator, *, specimens):
    """Two draws, two levels, four pressures, correlated noise."""
    root = generator.standard_normal((2, 2, 4, 4))
    return Differences(
        slope=generator.normal(-3.0, 1.0, (2, 2, 4)),
        spread=generator.uniform(0.01, 0.1, (2, 2)),
        common_spread=generator.uniform(0.001, 0.03, (2, 1)),
        noise=0.02 * root @ np.swapaxes(root, -1, -2),
        specimens=specimens,
    )


def dense(differences, draw, level, specimens):
    """Covariance of every reading's deviation, common and own, block by block."""
    slope, spread, common, noise, _ = differences
    j = slope[draw, level]
    total = np.zeros((4 * specimens, 4 * specimens))
    for s in range(specimens):
        for t in range(specimens):
            block = common[draw, 0] * np.outer(j, j)
            if s == t:
                block = block + noise[draw, level] + spread[draw, level] * np.outer(j, j)
            total[4 * s : 4 * s + 4, 4 * t : 4 * t + 4] = block
    return total


def test_moments_are_those_of_the_whole_covariance():
    some = some_differences(np.random.default_rng(1), specimens=np.array([3.0, 2.0]))
    mean, variance = misfit_moments(some)
    for draw in range(2):
        for level, specimens in enumerate((3, 2)):
            covariance = dense(some, draw, level, specimens)
            assert mean[draw, level] == pytest.approx(np.trace(covariance), rel=1e-12)
            square = 2.0 * np.trace(covariance @ covariance)
            assert variance[draw, level] == pytest.approx(square, rel=1e-12)


def test_the_total_sum_of_squares_counts_the_readings_at_no_pressure():
    generator = np.random.default_rng(2)
    some = some_differences(generator, specimens=np.array([3.0, 1.0]))
    curvature = generator.uniform(1.0, 9.0, (2, 2, 4))
    total = expected_total(curvature, some)
    for draw in range(2):
        for level, specimens in enumerate((3, 1)):
            exact = some._replace(common_spread=np.zeros((2, 1)))
            # a reading of zero without error before those of each specimen
            place = np.arange(5 * specimens) % 5 > 0
            covariance = np.zeros((5 * specimens, 5 * specimens))
            covariance[np.ix_(place, place)] = dense(exact, draw, level, specimens)
            mean = np.tile(np.concatenate([[0.0], curvature[draw, level]]), specimens)
            centre = np.eye(mean.size) - 1.0 / mean.size
            expected = mean @ centre @ mean + np.trace(centre @ covariance)
            assert total[draw, level] == pytest.approx(expected, rel=1e-12)


def test_the_density_of_r_squared_is_a_scaled_chi_square():
    generator = np.random.default_rng(3)
    specimens = np.array([3.0, 2.0])
    some = some_differences(generator, specimens=specimens)
    curvature = generator.uniform(1.0, 9.0, (2, 2, 4))
    unexplained = np.array([0.02, 0.139])
    density = r_squared_log_density(unexplained, curvature, some)
    mean, variance = misfit_moments(some)
    total = expected_total(curvature, some)
    for draw in range(2):
        for level in range(2):
            unit = variance[draw, level] / (2.0 * mean[draw, level]) / total[draw, level]
            law = stats.chi2(2.0 * mean[draw, level] ** 2 / variance[draw, level], scale=unit)
            expected = law.logpdf(unexplained[level])
            assert density[draw, level] == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_a_perfect_r_squared_is_taken_as_rounded():
    some = some_differences(np.random.default_rng(4), specimens=3.0)
    curvature = np.full((2, 2, 4), 5.0)
    density = r_squared_log_density(np.array([0.0, 1.7]), curvature, some)
    assert np.all(np.isfinite(density))  # R² of 1, and one far below 0


# ---- how good the approximation is, on curves of the actuator


def gelatin_curves():
    constants = yeoh_constants(
        [0.29, 0.7, 1.58], [-0.15] * 3, [1.5e-3, 2.5e-2, 0.1], LEVELS, (0.0, 12.5, 25.0)
    )
    c1, c2, c3 = (c[:, None] for c in constants)
    one = np.ones((1, 1))
    prediction = default_surrogate()(Inputs(PRESSURES, c1, c2, c3, 0.853 * one, 3e4 * one))
    assert np.all(prediction.status == 0)
    return prediction.curvature, prediction.slope


# scatter of stiffness, error of ln stiffness by that of D_R, noise: proportional and constant
CASES = [
    (0.04, 0.0, 0.02, 0.1),
    (0.04, 0.05, 0.02, 0.1),
    (0.04, 0.05, 0.05, 0.3),
    (0.1, 0.14, 0.02, 0.1),
    (0.02, 0.0, 0.005, 0.02),
]


def case(level, scatter, by_degradation, noise, floor):
    curvature, slope = (values[level] for values in gelatin_curves())
    spread = scatter**2 + (by_degradation**2 if level > 0 else 0.0)
    sd = np.hypot(floor, noise * curvature)
    correlation = np.exp(-np.abs(PRESSURES[:, None] - PRESSURES) / 40.0)
    covariance = sd[:, None] * correlation * sd
    one = np.ones((1, 1))
    some = Differences(
        slope[None, None], spread * one, scatter**2 / 3.0 * one, covariance[None, None], 3.0
    )
    return curvature, some


def simulated(curvature, some, generator, replicates):
    """R² of whole published studies, the response to stiffness not linearised."""
    slope, spread, common, noise, _ = some
    growth = slope[0, 0] / curvature
    shape = (replicates, 3, 1)
    own = np.sqrt(spread[0, 0]) * generator.standard_normal(shape)
    shared = np.sqrt(common[0, 0]) * generator.standard_normal((replicates, 1, 1))
    root = np.linalg.cholesky(noise[0, 0])
    read = generator.standard_normal((replicates, 3, curvature.size)) @ root.T
    experiment = curvature * np.exp(-growth * own) + read
    simulation = curvature * np.exp(-growth * shared)
    squares = np.square(experiment).sum(axis=(1, 2))
    total = squares - experiment.sum(axis=(1, 2)) ** 2 / (3.0 * (curvature.size + 1))
    return np.square(experiment - simulation).sum(axis=(1, 2)) / total


@pytest.mark.parametrize("numbers", CASES)
@pytest.mark.parametrize("level", [0, 3, 5])
def test_probabilities_of_r_squared_are_those_of_simulated_studies(level, numbers):
    curvature, some = case(level, *numbers)
    sample = np.sort(simulated(curvature, some, np.random.default_rng(5), 20_000))
    # the density integrated from the smallest simulated value up
    grid = np.geomspace(1e-5, 2.0 * sample[-1], 20_000)
    density = np.exp(
        [r_squared_log_density(grid, np.broadcast_to(curvature, (1, 1, 12)), some)]
    ).ravel()
    steps = np.diff(grid) * 0.5 * (density[1:] + density[:-1])
    below = np.concatenate([[0.0], np.cumsum(steps)])
    here = np.interp(sample, grid, below)
    assert np.max(np.abs(here - np.arange(1, sample.size + 1) / sample.size)) < 0.075


@pytest.mark.parametrize("numbers", CASES)
@pytest.mark.parametrize("level", [0, 3, 5])
def test_the_scaled_chi_square_has_the_density_of_the_weighted_sum(level, numbers):
    _, some = case(level, *numbers)
    slope, spread, common, noise, _ = (np.asarray(v) for v in some)
    outer = np.outer(slope, slope)
    single = noise[0, 0] + spread[0, 0] * outer
    covariance = np.kron(np.eye(3), single) + np.kron(np.ones((3, 3)), common[0, 0] * outer)
    weights = np.linalg.eigvalsh(covariance)
    mean, variance = (float(moment[0, 0]) for moment in misfit_moments(some))
    assert mean == pytest.approx(weights.sum(), rel=1e-10)
    law = stats.chi2(2.0 * mean**2 / variance, scale=variance / (2.0 * mean))
    draws = np.random.default_rng(6).chisquare(1.0, (50_000, weights.size)) @ weights
    places = np.quantile(draws, [0.05, 0.25, 0.5, 0.75, 0.95])
    exact = inverted(weights / weights.sum(), places / weights.sum()) / weights.sum()
    assert np.max(np.abs(law.logpdf(places) - np.log(exact))) < 0.35


def inverted(weights, places):
    """Density of Σ w χ²₁ from its characteristic function."""
    step = 0.02
    t = step * (np.arange(100_000) + 0.5)
    log_phi = -0.5 * sum(np.log(1.0 - 2.0j * t * w) for w in weights)
    return np.array([np.sum(np.exp(log_phi - 1j * t * x).real) * step / np.pi for x in places])


def test_the_inversion_gives_a_chi_square_its_own_density():
    places = np.array([0.5, 1.0, 2.0])
    np.testing.assert_allclose(
        inverted(np.full(4, 0.25), places), stats.chi2(4, scale=0.25).pdf(places), rtol=1e-5
    )


# ---- ruptures


def rupture_log_density(ruptured, tested, stretch, *, limit, scatter):
    walls = Strength(limit - 1.0, np.broadcast_to(scatter, np.shape(limit)))
    return log_count(ruptured, tested, rupture_chances(stretch, walls))


def test_counts_are_binomial_over_specimens_of_varying_stiffness():
    generator = np.random.default_rng(7)
    stretch = 1.0 + generator.uniform(0.2, 1.5, (4, 3, 7))
    limit = 1.0 + generator.uniform(0.3, 1.5, (4, 3))
    scatter = generator.uniform(0.1, 0.6, (4, 1))
    ruptured, tested = np.array([0.0, 2.0, 5.0]), np.array([3.0, 3.0, 5.0])
    density = rupture_log_density(ruptured, tested, stretch, limit=limit, scatter=scatter)
    weights = np.polynomial.hermite_e.hermegauss(7)[1]
    for n in range(4):
        for level in range(3):
            ratio = (stretch[n, level] - 1.0) / (limit[n, level] - 1.0)
            chances = stats.norm.cdf(np.log(ratio) / scatter[n, 0])
            chance = np.sum(weights * chances) / np.sum(weights)
            expected = stats.binom(tested[level], chance).logpmf(ruptured[level])
            assert density[n, level] == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_ruptures_that_contradict_the_model_are_improbable_and_not_impossible():
    stretch = np.full((1, 2, 7), 1.1)
    stretch[0, 1] = 1.0 - 1e-9  # not stretched at all, by rounding
    density = rupture_log_density(
        np.array([2.0, 2.0]),
        np.array([3.0, 3.0]),
        stretch,
        limit=np.array([[1.52, 1.52]]),
        scatter=np.array([[1e-3]]),
    )
    assert np.all(np.isfinite(density))
    z = np.log(0.1 / 0.52) / 1e-3
    assert density[0, 0] == pytest.approx(np.log(3.0) + 2.0 * special.log_ndtr(z), rel=1e-9)


def test_soft_specimens_beyond_the_map_are_left_out_unless_the_mean_one_is():
    stretch = np.full((1, 1, 7), 1.5)
    stretch[..., 0] = np.nan
    numbers = {"limit": np.array([[1.5]]), "scatter": np.array([[0.1]])}
    one, three = np.array([1.0]), np.array([3.0])
    known = rupture_log_density(one, three, stretch, **numbers)
    assert np.exp(known[0, 0]) == pytest.approx(3.0 / 8.0)
    stretch[..., 3] = np.nan
    assert np.isnan(rupture_log_density(one, three, stretch, **numbers)[0, 0])
    stretch[:] = np.nan
    assert np.isnan(rupture_log_density(one, three, stretch, **numbers)[0, 0])


# ---- from a study


def summary_alone(folder, *, change=None, with_readings=False):
    names = ["study.toml", "summary.csv", *(["actuator.csv"] if with_readings else [])]
    for name in names:
        shutil.copy(GELATIN / name, folder / name)
    if change is not None:
        text = (folder / "summary.csv").read_text(encoding="utf-8")
        assert change[0] in text
        (folder / "summary.csv").write_text(text.replace(*change), encoding="utf-8")
    return read_study(folder)


def test_the_published_statistics_are_read_as_data(tmp_path):
    tests = published_tests(summary_alone(tmp_path))
    np.testing.assert_array_equal(tests.degradation, LEVELS)
    np.testing.assert_array_equal(tests.r_squared, PUBLISHED)
    np.testing.assert_array_equal(tests.ruptured, [0, 0, 0, 0, 0, 2])
    np.testing.assert_array_equal(tests.tested, [3] * 6)
    np.testing.assert_array_equal(tests.degradation_sd, [0, *[0.5] * 5])
    assert tests.films == 3.0
    assert tests.names("r_squared")[1] == "R² at 5 %"


def test_levels_may_have_one_of_the_statistics_alone(tmp_path):
    change = ("r_squared,5,0.997", "r_squared,7,0.997")
    tests = published_tests(summary_alone(tmp_path, change=change))
    assert tests.degradation.tolist() == [0.0, 5.0, 7.0, 10.0, 15.0, 20.0, 25.0]
    assert tests.given("ruptures").tolist() == [True, True, False, True, True, True, True]
    assert tests.given("r_squared").tolist() == [True, False, True, True, True, True, True]
    assert len(tests.names("ruptures")) == 6


def test_a_study_with_readings_of_its_own_uses_the_counts_and_not_r_squared(tmp_path):
    study = summary_alone(tmp_path, with_readings=True)
    assert published_tests(study) is None
    counted = published_counts(study).tests
    np.testing.assert_array_equal(counted.ruptured, [0, 0, 0, 0, 0, 2])
    np.testing.assert_array_equal(counted.tested, [3] * 6)
    np.testing.assert_array_equal(counted.pressure, [240.0] * 6)
    assert counted.specimens[-1] == "ruptures at 25 %"


def test_counts_of_others_are_read_to_the_pressure_of_the_study(tmp_path):
    study = summary_alone(tmp_path, with_readings=True)
    lower = study.actuator[study.actuator["pressure_kPa"] <= 160.0]
    assert published_counts(replace(study, actuator=lower)).tests.pressure.tolist() == [160.0] * 6
    assert published_counts(replace(study, summary=None)) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("r_squared,5,0.997", "r_squared,0,0.997"), "r_squared at 0 %"),
        (("ruptured_count,25,2,", "ruptured_count,25,4,"), "4 of 3 actuators"),
        (("tested_count,20,3,", "tested_count,20,0,"), "0 of 0 actuators"),
    ],
)
def test_impossible_statistics_are_refused(tmp_path, change, words):
    study = summary_alone(tmp_path, change=change)
    with pytest.raises(StudyError, match=words):
        published_tests(study)


SMALL = PublishedTests(
    degradation=np.array([0.0, 10.0, 20.0]),
    degradation_sd=np.array([0.0, 0.5, 0.5]),
    pressure=np.array([20.0, 60.0, 100.0]),
    tested=np.array([3.0, 2.0, 3.0]),
    r_squared=np.array([0.98, np.nan, 0.9]),
    ruptured=np.array([np.nan, 0.0, 1.0]),
    films=4.0,
)
VALUES = {
    "volume_ratio": np.array([0.6, 0.65]),
    "paper_stiffness": np.array([3e4, 2e4]),
    "stiffness_scatter": np.array([0.05, 0.08]),
    "curvature_noise": np.array([0.02, 0.03]),
    "curvature_noise_floor": np.array([0.1, 0.2]),
    "curvature_noise_length": np.array([30.0, 5.0]),
    "elongation_at_0": np.array([210.0, 200.0]),
    "elongation_at_25": np.array([50.0, 70.0]),
    "elongation_scatter": np.array([0.2, 0.4]),
}
CONSTANTS = (
    np.array([[0.3, 0.6, 1.2], [0.35, 0.7, 1.4]]),
    np.array([[-0.004, -0.01, -0.03], [-0.003, -0.01, -0.05]]),
    np.array([[0.002, 0.01, 0.05], [0.002, 0.02, 0.06]]),
)
MATERIAL = Material(np.stack(CONSTANTS, axis=-1), np.full((2, 3, 3), 0.05))


class Known(FilmsAndActuators):
    """A world whose material is known at the levels."""

    def material(self, values, degradation):
        rates = np.atleast_2d(degradation)[0]
        rows = np.searchsorted(SMALL.degradation, rates)
        return Material(MATERIAL.constants[:, rows], MATERIAL.slope[:, rows])


def blocks_of(tests):
    state = State(VALUES, Known((0.0,), (0.0, 25.0), ClosedFormMap()))
    return {one.name: one.log_likelihood(state) for one in of_tests(tests)}


def test_the_log_likelihood_is_that_of_plain_loops():
    blocks = blocks_of(SMALL)
    assert {kind: block.shape for kind, block in blocks.items()} == {
        "r_squared": (2, 2),
        "ruptures": (2, 2),
    }
    nodes, weights = np.polynomial.hermite_e.hermegauss(7)
    for n in range(2):
        v = {name: float(values[n]) for name, values in VALUES.items()}
        by_rate = 0.05 / CONSTANTS[0][n]
        spread = v["stiffness_scatter"] ** 2 + (by_rate * SMALL.degradation_sd) ** 2

        def answer(pressure, level, factor=1.0, *, n=n, v=v):
            c1, c2, c3 = (np.array(c[n, level] * factor) for c in CONSTANTS)
            scale = np.array(v["volume_ratio"] ** (1.0 / 3.0))
            paper, thick = np.array(v["paper_stiffness"]), np.array(0.1)
            given = (np.array(pressure), c1, c2, c3, scale, paper)
            return ClosedFormMap()(Inputs(*given, paper_thickness=thick))

        for place, level in enumerate((0, 2)):
            curve = [answer(p, level) for p in SMALL.pressure]
            kappa = np.array([float(c.curvature) for c in curve])
            slope = np.array([float(c.slope) for c in curve])
            sd = np.sqrt(v["curvature_noise_floor"] ** 2 + (v["curvature_noise"] * kappa) ** 2)
            covariance = np.array(
                [
                    [
                        a * b * np.exp(-abs(p - q) / v["curvature_noise_length"])
                        for b, q in zip(sd, SMALL.pressure, strict=True)
                    ]
                    for a, p in zip(sd, SMALL.pressure, strict=True)
                ]
            )
            common = v["stiffness_scatter"] ** 2 / 4.0
            single = covariance + spread[level] * np.outer(slope, slope)
            shared = common * np.outer(slope, slope)
            whole = np.kron(np.eye(3), single) + np.kron(np.ones((3, 3)), shared)
            mean, variance = np.trace(whole), 2.0 * np.trace(whole @ whole)
            readings = np.concatenate([[0.0], kappa])
            own = np.zeros((4, 4))
            own[1:, 1:] = single
            total = 3.0 * np.sum((readings - readings.mean()) ** 2)
            total += 3.0 * np.trace(own) - own.sum() / 4.0
            law = stats.chi2(2.0 * mean**2 / variance, scale=variance / (2.0 * mean * total))
            expected = law.logpdf(1.0 - SMALL.r_squared[level])
            assert blocks["r_squared"][n, place] == pytest.approx(expected, rel=1e-10, abs=1e-10)
        for place, level in enumerate((1, 2)):
            # ln of the elongation is a straight line of D_R, whose error adds to the scatter
            fall = np.log(v["elongation_at_25"] / v["elongation_at_0"]) / 25.0
            median = v["elongation_at_0"] / 100.0 * np.exp(fall * SMALL.degradation[level])
            sd = np.hypot(v["elongation_scatter"], fall * SMALL.degradation_sd[level])
            limit = stats.lognorm(sd, scale=median)
            chance = 0.0
            for node, weight in zip(nodes, weights / weights.sum(), strict=True):
                factor = np.exp(node * np.sqrt(spread[level]))
                reached = answer(100.0, level, factor)
                assert reached.status == 0
                stretch = float(reached.peak_stretch)
                chance += weight * limit.cdf(stretch - 1.0)
            law = stats.binom(SMALL.tested[level], chance)
            expected = law.logpmf(SMALL.ruptured[level])
            assert blocks["ruptures"][n, place] == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_what_is_not_given_has_no_block():
    none = np.full(3, np.nan)
    assert set(blocks_of(replace(SMALL, ruptured=none))) == {"r_squared"}
    assert set(blocks_of(replace(SMALL, r_squared=none))) == {"ruptures"}


def test_r_squared_finds_the_scatter_that_made_it():
    generator = np.random.default_rng(8)
    scatters = np.array([0.02, 0.04, 0.08, 0.16])
    sums = np.zeros((scatters.size, scatters.size))  # true, assumed
    for i, true in enumerate(scatters):
        for level in range(6):
            curvature, some = case(level, true, 0.0, 0.02, 0.1)
            misfit = simulated(curvature, some, generator, 200)
            for j, assumed in enumerate(scatters):
                _, other = case(level, assumed, 0.0, 0.02, 0.1)
                curve = np.broadcast_to(curvature, (1, 1, 12))
                sums[i, j] += r_squared_log_density(misfit, curve, other).sum()
    assert np.argmax(sums, axis=1).tolist() == [0, 1, 2, 3]
