"""Virtual actuators that break at the weakest of their points, against Weibull's law."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from bayesdeg.laboratory.truth import Truth
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.material.strength import GUMBEL

LEVEL = 20.0


@pytest.fixture(scope="module")
def studies():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        yield importlib.import_module("rupture_studies")


def uniform(studies, points, *, volume=1818.0):
    """A half model whose strain is the same everywhere, and half the load."""
    load = np.linspace(0.0, 2.0, 41)
    strain = 0.5 * load[:, None] * np.ones(points)
    parts = np.full(points, volume / points)
    depth = np.linspace(0.0, 1.0, points)
    return studies.Field(load, strain, parts, depth, np.zeros(41), np.ones(41))


def study(studies, flaws=None, **changed):
    truth = replace(Truth(stiffness_scatter=0.0, elongation_scatter=GUMBEL / 9.0), **changed)
    return studies.RuptureStudy(0, truth, flaws)


@pytest.mark.parametrize("points", [1, 60])
def test_actuators_burst_by_weibull_s_law_however_finely_they_are_meshed(studies, points):
    given = study(studies)
    found = studies.inflated(
        given, LEVEL, uniform(studies, points), 1500, np.random.default_rng(points)
    )
    median = float(given.truth.limit_stretch([LEVEL])[0]) - 1.0
    volume = 2.0 * 1818.0 * given.truth.volume_ratio / studies.FILM_VOLUME
    scale = median * (volume * np.log(2.0)) ** (-1.0 / given.modulus)
    c1 = given.truth.constants([LEVEL])[0, 0]
    strain = 0.5 * found.burst / (1e3 * c1)
    assert np.all(np.isfinite(strain))
    assert stats.kstest(strain, stats.weibull_min(given.modulus, scale=scale).cdf).pvalue > 0.01
    np.testing.assert_array_equal(found.whole, found.burst)
    assert not found.flaws.any()


def test_a_crack_tears_where_its_energy_is_that_of_a_film_at_break(studies):
    truth = Truth()
    longer = np.array([1.0, 4.0, 30.0])
    torn = studies._EnergyLaw.of(truth, LEVEL).torn(0.6, longer)

    def energy(strain):
        at = np.linspace(0.0, strain, 2001)
        stress = yeoh_basis(1.0 + at, "uniaxial", "nominal") @ truth.constants([LEVEL])[0]
        return np.trapezoid(stress, at)

    np.testing.assert_allclose(
        [energy(strain) * ratio for strain, ratio in zip(torn, longer, strict=True)],
        energy(0.6),
        rtol=2e-3,
    )
    assert torn[0] == pytest.approx(0.6)


def test_flaws_begin_at_their_onset_and_let_actuators_burst_sooner(studies):
    flaws = studies.Flaws(number=12.0, onset=15.0, length=40.0, surface=False)
    assert [flaws.expected(level) for level in (0.0, 15.0, 20.0, 25.0)] == [0.0, 0.0, 6.0, 12.0]
    given, field = study(studies, flaws), uniform(studies, 300)
    smooth, rough = (
        studies.inflated(given, level, field, 200, np.random.default_rng(3))
        for level in (10.0, 25.0)
    )
    np.testing.assert_array_equal(smooth.burst, smooth.whole)
    assert np.mean(rough.flaws) == pytest.approx(12.0, abs=4.0 * np.sqrt(12.0 / 200.0))
    assert np.mean(rough.burst < 0.5 * rough.whole) > 0.95


def test_flaws_of_the_surface_sit_in_the_skin(studies):
    flaws = studies.Flaws(number=500.0, onset=0.0, length=1e4, surface=True)
    field = uniform(studies, 300)
    # only the core is strained: a flaw of the skin meets nothing
    core = replace(field, strain=field.strain * (field.depth >= studies.SKIN))
    given = study(studies, flaws)
    found = studies.inflated(given, 25.0, core, 20, np.random.default_rng(5))
    np.testing.assert_array_equal(found.burst, found.whole)


def test_a_study_is_made_whose_tests_end_where_actuators_burst(studies, monkeypatch):
    """From fields alone to all its tables; levels have pressures of their own."""
    field = replace(uniform(studies, 20), angle=np.linspace(0.0, 1.0, 41))
    monkeypatch.setattr(studies, "field_of", lambda world, level: field)
    given = study(studies, elongation=(60.0, 30.0, 12.0))
    experiment, drawn = studies.made(given, np.random.default_rng(6))
    readings = experiment.tables["actuator"]
    assert set(drawn) == set(studies.LARGEST)
    last = readings.groupby("specimen_id").last()
    burst = last["ruptured"] == 1
    assert 0 < burst.sum() < len(last)
    at = experiment.actuators["burst_kPa"].loc[last.index]
    step = last["pressure_kPa"].where(burst).dropna()
    assert np.all(step >= at[step.index])
    assert np.all(step - studies.STEP < at[step.index])
    largest = experiment.actuators["degradation_pct"].map(studies.LARGEST).loc[last.index]
    np.testing.assert_array_equal(last["pressure_kPa"][~burst], largest[~burst])
