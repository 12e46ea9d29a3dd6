"""Films: scatter and errors of reading are those stated; the readings lead back to the truth."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.data.moisture import degradation_of_films, moisture_content, saturating
from bayesdeg.data.settings import Mixture
from bayesdeg.data.shrinkage import mean_of_replicates, volume_ratio
from bayesdeg.laboratory.experiment import Design, tear_films, weigh_moisture, weigh_shrinkage
from bayesdeg.laboratory.truth import Truth
from tests.inference.saturating_course import least_squares_course

TRUTH = Truth()


def many_films(level, count, sd=np.nan):
    films = pd.DataFrame(
        {
            "specimen_id": [f"f{i}" for i in range(count)],
            "degradation_pct": float(level),
            "degradation_sd_pct": sd,
        }
    )
    points = pd.DataFrame(
        {
            "mode": "uniaxial",
            "elongation_share": np.linspace(0.1, 0.97, 6),
            "stress_measure": "nominal",
        }
    )
    return replace(Design(), tensile=films.merge(points, how="cross"), breaks=films)


def generator(seed=3):
    return np.random.default_rng(seed)


def test_moisture_leads_back_to_the_course_of_degradation():
    times = np.repeat([0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0], 400)
    table = pd.DataFrame({"film_id": [f"m{i}" for i in range(times.size)], "time_h": times})
    weighed = weigh_moisture(table, TRUTH, generator())
    content = moisture_content(weighed["mass_equilibrated_g"], weighed["mass_dry_g"])
    spread = pd.Series(content).groupby(times).std()
    np.testing.assert_allclose(spread, TRUTH.moisture_scatter, rtol=0.15)
    assert content[times == 0.0].mean() == pytest.approx(20.0, abs=0.06)
    course = least_squares_course(degradation_of_films(times, content))
    late = saturating(24.0, course.limit_pct, course.time_constant_h)
    assert late == pytest.approx(25.0, abs=0.4)
    sd = np.sqrt(np.diag(course.covariance))
    assert abs(course.limit_pct - TRUTH.degradation_limit) < 4.0 * sd[0]
    assert abs(course.time_constant_h - TRUTH.time_constant) < 4.0 * sd[1]
    fresh, late = (weighed.loc[times == t, "mass_dry_g"].mean() for t in (0.0, 24.0))
    # 0.8574 × 29.4 % (25 % on the dry basis)
    assert 1.0 - late / fresh == pytest.approx(0.252, abs=0.02)


def test_shrinkage_leads_back_to_the_volume_ratio():
    table = pd.DataFrame({"film_id": [f"s{i}" for i in range(4000)]})
    weighed = weigh_shrinkage(table, TRUTH, generator())
    masses = [weighed[f"mass_{name}_g"] for name in ("poured", "cured", "conditioned")]
    mean = mean_of_replicates(volume_ratio(*masses))
    assert mean.value == pytest.approx(0.62, abs=4.0 * mean.standard_error)
    assert mean.sd == pytest.approx(0.05, rel=0.05)
    assert masses[0].mean() == pytest.approx(30.0, rel=1e-3)
    # 13.5–17.7 g cured and 9.1–11.7 g conditioned are what the published α allows
    assert 13.5 < masses[1].mean() < 17.7
    assert 9.1 < masses[2].mean() < 11.7


def test_films_of_another_recipe_lead_back_with_that_recipe():
    table = pd.DataFrame({"film_id": [f"s{i}" for i in range(2000)]})
    other = Mixture(gelatin=3.0, water=7.0, gelatin_density=1.3)
    weighed = weigh_shrinkage(table, TRUTH, generator(), other)
    masses = [weighed[f"mass_{name}_g"] for name in ("poured", "cured", "conditioned")]
    mean = mean_of_replicates(volume_ratio(*masses, other))
    assert mean.value == pytest.approx(0.62, abs=4.0 * mean.standard_error)


@pytest.mark.parametrize("ratio", [0.35, 0.62, 0.95])
def test_films_only_lose_mass_whatever_the_volume_ratio(ratio):
    table = pd.DataFrame({"film_id": [f"s{i}" for i in range(500)]})
    weighed = weigh_shrinkage(table, replace(TRUTH, volume_ratio=ratio), generator())
    assert (weighed["mass_poured_g"] >= weighed["mass_cured_g"]).all()
    assert (weighed["mass_cured_g"] >= weighed["mass_conditioned_g"]).all()


@pytest.mark.parametrize("level", [0.0, 12.5, 25.0])
def test_stresses_are_those_of_the_film_with_the_error_stated(level):
    tensile, _, films = tear_films(many_films(level, 300), TRUTH, generator())
    film = films.loc[tensile["specimen_id"]]
    constants = TRUTH.constants(film["degradation_pct"].to_numpy())
    c1, c2, c3 = constants.T * np.exp(film["ln_stiffness"].to_numpy())
    lam = tensile["stretch"].to_numpy()
    x = lam**2 + 2.0 / lam - 3.0
    stress = 2.0 * (lam - lam**-2) * (c1 + 2.0 * c2 * x + 3.0 * c3 * x**2)
    z = (tensile["stress_MPa"] - stress) / np.sqrt(0.005**2 + (0.02 * stress) ** 2)
    assert stats.kstest(z, "norm").pvalue > 1e-3
    assert z.std() == pytest.approx(1.0, rel=0.06)
    assert (tensile["stress_measure"] == "nominal").all()


def test_cauchy_stress_is_recorded_where_the_design_says_so():
    design = many_films(0.0, 5)
    quiet = replace(TRUTH, tensile_noise=0.0, tensile_noise_floor=0.0)
    nominal, _, _ = tear_films(design, quiet, generator())
    cauchy_design = replace(design, tensile=design.tensile.assign(stress_measure="cauchy"))
    cauchy, _, _ = tear_films(cauchy_design, quiet, generator())
    np.testing.assert_allclose(
        cauchy["stress_MPa"], nominal["stress_MPa"] * nominal["stretch"], rtol=1e-4
    )


@pytest.mark.parametrize("level", [0.0, 25.0])
def test_films_scatter_as_stated(level):
    _, breaks, films = tear_films(many_films(level, 3000), TRUTH, generator())
    assert films["ln_stiffness"].std() == pytest.approx(0.04, rel=0.06)
    assert films["ln_stiffness"].mean() == pytest.approx(0.0, abs=0.003)
    error = films["degradation_pct"] - level
    if level == 0.0:
        assert (error == 0.0).all()
    else:
        assert error.std() == pytest.approx(0.5, rel=0.06)
    assert set(breaks["degradation_sd_pct"]) == {0.0 if level == 0.0 else 0.5}
    median = 100.0 * (TRUTH.limit_stretch(films["degradation_pct"].to_numpy()) - 1.0)
    log = np.log(breaks["elongation_pct"].to_numpy() / median)
    assert log.std() == pytest.approx(0.05, rel=0.06)
    assert log.mean() == pytest.approx(0.0, abs=0.004)


def test_a_curve_ends_just_below_the_break_of_the_same_film():
    tensile, breaks, films = tear_films(Design(), TRUTH, generator())
    last = tensile.groupby("specimen_id")["stretch"].max()
    broken = 1.0 + breaks.set_index("specimen_id")["elongation_pct"] / 100.0
    np.testing.assert_allclose((last - 1.0) / (broken - 1.0), 0.97, atol=2e-4)
    np.testing.assert_allclose(films.loc[broken.index, "limit_stretch"], broken, atol=1e-4)
    assert (tensile.groupby("specimen_id").size() == 15).all()


def test_a_film_cannot_be_read_beyond_its_break():
    films = pd.DataFrame(
        {"specimen_id": ["u", "e"], "degradation_pct": 25.0, "degradation_sd_pct": 0.7}
    )
    points = pd.DataFrame({"stretch": [1.2, 1.4, 1.9], "stress_measure": "nominal"})
    table = films.merge(points, how="cross")
    table["mode"] = np.where(table["specimen_id"] == "u", "uniaxial", "equibiaxial")
    design = replace(Design(), tensile=table, breaks=films[:1])
    tensile, breaks, _ = tear_films(design, TRUTH, generator())
    by_film = tensile.groupby("specimen_id")["stretch"].agg(list)
    assert by_film["u"] == [1.2, 1.4]
    assert by_film["e"] == [1.2, 1.4, 1.9]
    assert breaks["degradation_sd_pct"].tolist() == [0.7]
