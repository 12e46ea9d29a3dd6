"""Laws on held-out films: densities against dense matrices, and films of laws that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.analysis import material_laws
from bayesdeg.analysis.material_laws import (
    MOST,
    NOISE,
    Calibrated,
    FitStart,
    FittedLaw,
    LawComparison,
    LevelFilms,
    NoiseLevels,
    compare_laws,
    fit_law,
)
from bayesdeg.material.hyperelastic import (
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    nominal_stress,
    yeoh_basis,
)
from bayesdeg.material.laws import FORMS
from bayesdeg.observations.noise import noise_correlation
from bayesdeg.observations.specimens import STIFFNESS_SCATTER
from bayesdeg.observations.tensile import TENSILE, TensileCurves
from bayesdeg.pages.tables import MATERIAL_LAWS, TABLES

PRIORS = {p.name: p.law for p in (*TENSILE, STIFFNESS_SCATTER)}
TRUE = NoiseLevels(0.002, 0.01, 0.03, 0.05)
SOLIDS = {
    "yeoh": Yeoh(0.3, -0.02, 0.004),
    "neo_hookean": NeoHookean(0.3),
    "mooney_rivlin": MooneyRivlin(0.2, 0.1),
    "gent": Gent(0.5, 12.0),
    "ogden": Ogden([0.5, 0.002, -0.02], [1.3, 6.0, -2.0]),
}


def curves_of(solid, *, films=4, levels=(0.0,), top=2.8, points=16, seed=1, modes=("uniaxial",)):
    """Films of a law, from its own closed form, with scatter and errors of the noise model."""
    generator = np.random.default_rng(seed)
    count = films * len(levels)
    stretch = np.tile(np.linspace(1.05, top, points), (count, 1))
    named = tuple(modes[i % len(modes)] for i in range(count))
    data = TensileCurves(
        specimens=tuple(f"f{i}" for i in range(count)),
        modes=named,
        degradation=np.repeat(levels, films),
        degradation_sd=np.zeros(count),
        basis=yeoh_basis(stretch, np.array(named)[:, None]),
        stretch=stretch,
        stress=np.zeros(stretch.shape),
        cauchy=np.zeros(stretch.shape, bool),
        mask=np.ones(stretch.shape, bool),
    )
    stiffer = 1.0 + 0.05 * data.degradation
    pure = np.stack([nominal_stress(solid, s, mode=m) for s, m in zip(stretch, named, strict=True)])
    pure = pure * stiffer[:, None]
    correlation = noise_correlation(data.paths, np.array([TRUE.length]), np.zeros(1))[0]
    z = np.stack([np.linalg.cholesky(one) @ generator.standard_normal(points)
                  for one in correlation])  # fmt: skip
    scatter = 1.0 + TRUE.scatter * generator.standard_normal((count, 1))
    return replace(data, stress=pure * scatter + np.hypot(TRUE.floor, TRUE.share * pure) * z)


def some(name="gent", **options):
    films = LevelFilms(curves_of(SOLIDS["yeoh"], **options), PRIORS)
    u = 0.3 * np.random.default_rng(2).standard_normal((films.count, FORMS[name].size))
    return films, material_laws._at(FORMS[name], films, u)


def dense(films, point, film):
    """The covariance of a film's readings given the law, from whole matrices."""
    paths = films.curves.paths
    correlation = noise_correlation(paths, np.array([TRUE.length]), np.zeros(1))[0, film]
    floor = np.hypot(TRUE.floor, films.resolution)
    sd = np.hypot(floor, TRUE.share * point.stress[film])
    return correlation * np.outer(sd, sd) + TRUE.scatter**2 * np.outer(
        point.stress[film], point.stress[film]
    )


@pytest.mark.parametrize("name", FORMS)
def test_the_density_of_films_is_that_of_one_normal_law(name):
    """Readings of a level are f − J u + J x + e with x ~ N(0, I), linear about u."""
    films, point = some(name, films=3, levels=(0.0, 10.0))
    weights = np.array([1.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    expected = 0.0
    for level in range(2):
        rows = np.flatnonzero((films.member == level) & (weights > 0.0))
        slope = np.concatenate([point.slope[row] for row in rows])
        mean = np.concatenate([point.stress[row] for row in rows]) - slope @ point.u[level]
        size, points = len(mean), films.curves.stretch.shape[1]
        total = slope @ slope.T
        for k, row in enumerate(rows):
            part = slice(k * points, (k + 1) * points)
            total[part, part] += dense(films, point, row)
        read = np.concatenate([films.curves.stress[row] for row in rows])
        assert size == points * len(rows)
        expected += stats.multivariate_normal(mean, total).logpdf(read)
    found = material_laws._log_evidence(films, point, TRUE, weights)
    assert found == pytest.approx(expected, rel=1e-7)


def test_a_film_given_the_others_is_the_density_of_all_less_that_of_the_others():
    films, point = some("ogden", films=4)
    weights = np.array([1.0, 1.0, 0.0, 1.0])
    # at the mean of the coordinates without the film, where the prediction is linear too
    for _ in range(60):
        products = material_laws._products(films, point, TRUE)
        precision, vector = material_laws._normal_equations(films, point, products, weights)
        u = np.linalg.solve(precision, vector[..., None])[..., 0]
        point = material_laws._at(FORMS["ogden"], films, point.u + 0.5 * (u - point.u))
    fit = Calibrated(point, precision, TRUE, FitStart(point.u, np.zeros(4), np.eye(4)))
    both = [material_laws._log_evidence(films, point, TRUE, w) for w in (np.ones(4), weights)]
    assert material_laws._predict(films, fit, 2) == pytest.approx(both[0] - both[1], abs=1e-6)


def test_cells_without_a_reading_count_for_nothing():
    films, _ = some("yeoh", films=2)
    mask = films.curves.mask.copy()
    mask[:, 11:] = False
    stress = np.where(mask, films.curves.stress, 77.0)
    gappy = LevelFilms(replace(films.curves, mask=mask, stress=stress), PRIORS)
    short = replace(
        films.curves,
        **{name: getattr(films.curves, name)[:, :11] for name in ("stretch", "stress", "cauchy")},
        basis=films.curves.basis[:, :11],
        mask=np.ones((2, 11), bool),
    )
    a, b = (compare_laws(one.curves, PRIORS) for one in (gappy, LevelFilms(short, PRIORS)))
    for one, two in zip(a.fits, b.fits, strict=True):
        np.testing.assert_allclose(one.elpd, two.elpd, atol=1e-5)


@pytest.mark.parametrize("name", ["yeoh", "mooney_rivlin", "gent", "ogden"])
def test_the_law_of_which_films_are_is_not_beaten_and_others_are_told_from_it(name):
    modes = ("uniaxial", "equibiaxial") if name == "mooney_rivlin" else ("uniaxial",)
    found = compare_laws(curves_of(SOLIDS[name], films=8, modes=modes), PRIORS)
    true = found.by_name[name]
    for fit in found.fits:
        gain, error = found.difference(fit, true)
        assert gain < 2.0 * error + 1.0, fit.name
    gain, error = found.difference(true, found.by_name["neo_hookean"])
    assert gain > 5.0 * error > 0.0


def test_of_neo_hookean_films_no_law_with_more_constants_is_clearly_better():
    found = compare_laws(curves_of(SOLIDS["neo_hookean"], films=8), PRIORS, used="neo_hookean")
    assert not (found.best.name != "neo_hookean" and found.is_clear)
    assert float(found.by_name["neo_hookean"].constants[0]["c1_MPa"]) == pytest.approx(
        0.3, rel=0.05
    )


def test_constants_and_noise_are_those_that_films_were_made_with():
    films = LevelFilms(curves_of(SOLIDS["yeoh"], films=12, levels=(0.0, 10.0), points=40), PRIORS)
    fit = fit_law(FORMS["yeoh"], films)
    for k, stiffer in enumerate((1.0, 1.5)):
        stress = nominal_stress(FORMS["yeoh"].solid(fit.constants[k]), 2.5, mode="uniaxial")
        true = stiffer * nominal_stress(SOLIDS["yeoh"], 2.5, mode="uniaxial")
        assert float(stress) == pytest.approx(float(true), rel=0.03)
    assert fit.noise.scatter == pytest.approx(TRUE.scatter, rel=0.5)
    assert fit.noise.share == pytest.approx(TRUE.share, rel=0.5)


def test_predictions_are_calibrated():
    """Scores of held-out films, in units of what they should scatter by, are as they should be."""
    total, expected = [], []
    for seed in range(6):
        data = curves_of(SOLIDS["yeoh"], films=6, points=10, seed=seed)
        fit = compare_laws(data, PRIORS, names=("yeoh",)).fits[0]
        total.append(fit.elpd.mean())
        films = LevelFilms(data, PRIORS)
        point = material_laws.LawPoint(
            np.zeros((1, 3)),
            np.stack([nominal_stress(SOLIDS["yeoh"], s, mode="uniaxial") for s in data.stretch]),
            np.zeros((*data.stretch.shape, 3)),
        )
        expected.append(np.mean([
            stats.multivariate_normal(mean, dense(films, point, i)).logpdf(read)
            for i, (mean, read) in enumerate(zip(point.stress, data.stress, strict=True))
        ]))  # fmt: skip
    # what is not known of seven parameters costs a film about one nat each over six films
    assert 0.0 < np.mean(expected) - np.mean(total) < 4.0


def test_a_single_film_at_a_level_is_fitted_but_not_held_out():
    found = compare_laws(curves_of(SOLIDS["yeoh"], films=1, levels=(0.0, 10.0)), PRIORS)
    assert not found.is_judged
    assert found.held_out == 0
    table = found.table()
    assert table["elpd"].isna().all()
    assert (table["rmse_MPa"] > 0.0).all()


def test_levels_with_several_films_are_judged_beside_those_with_one():
    data = curves_of(SOLIDS["yeoh"], films=3, levels=(0.0, 10.0))
    found = compare_laws(data.subset(np.array([0, 1, 2, 3])), PRIORS)
    assert found.held_out == 3
    for fit in found.fits:
        assert np.isfinite(fit.elpd[:3]).all()
        assert np.isnan(fit.elpd[3])


def test_of_very_many_films_some_are_held_out():
    films = LevelFilms(curves_of(SOLIDS["neo_hookean"], films=MOST + 20, points=6), PRIORS)
    assert len(films.held_out) == len(set(films.held_out.tolist())) == MOST


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_films_without_any_error_or_stress_are_compared_too(size):
    data = curves_of(SOLIDS["neo_hookean"], films=3)
    exact = replace(data, stress=size * 0.3 * data.basis[..., 0])
    for fit in compare_laws(exact, PRIORS).fits:
        assert np.isfinite(fit.elpd).all()
        assert (fit.error < 1e-3).all()


def test_the_scale_of_stress_does_not_matter():
    """With the constant error in the same unit, densities differ by the factor of the units."""
    data = curves_of(SOLIDS["gent"], films=4)
    small = replace(data, stress=1e-2 * data.stress)
    priors = PRIORS | {"tensile_noise_floor": type(PRIORS["tensile_noise_floor"])(2e-4)}
    a, b = compare_laws(data, PRIORS), compare_laws(small, priors)
    shift = data.stretch.shape[1] * np.log(100.0)
    for one, two in zip(a.fits, b.fits, strict=True):
        np.testing.assert_allclose(one.elpd + shift, two.elpd, atol=0.05)


def test_the_table_has_a_row_for_each_law_and_level_and_for_all():
    found = compare_laws(curves_of(SOLIDS["yeoh"], films=2, levels=(0.0, 10.0)), PRIORS)
    table = found.table()
    assert list(table.columns) == TABLES[MATERIAL_LAWS].headings
    assert table.groupby("law").size().to_dict() == dict.fromkeys(FORMS, 3)
    assert table.loc[table["used"] == 1, "law"].unique().tolist() == ["yeoh"]
    pooled = table[table["degradation_pct"] == "all"].set_index("law")
    for name, fit in found.by_name.items():
        assert pooled.loc[name, "elpd"] == pytest.approx(fit.elpd.sum())
        assert pooled.loc[name, list(NOISE)].tolist() == pytest.approx(list(fit.noise))


def fitted(name, elpd):
    elpd = np.array(elpd)
    error = np.full(len(elpd), 0.1)
    return FittedLaw(name, 3, ({},), np.ones(1), TRUE, error, error, elpd)


def comparison(*fits):
    count = len(fits[0].elpd)
    return LawComparison(fits, "yeoh", np.zeros(count), np.full(count, 5), ("uniaxial",))


def test_the_best_law_is_held_against_the_one_used_and_that_against_the_second():
    yeoh, gent, ogden = (
        fitted("yeoh", [1.0, 2.0, 3.0]),
        fitted("gent", [5.0, 6.5, 7.0]),
        fitted("ogden", [0.0, 1.5, 3.0]),
    )
    better = comparison(yeoh, gent, ogden)
    assert (better.best.name, better.rival.name, better.is_clear) == ("gent", "yeoh", True)
    assert better.gain == pytest.approx((12.5, np.sqrt(3.0) * np.std([4.0, 4.5, 4.0], ddof=1)))
    used = comparison(yeoh, ogden)
    assert (used.best.name, used.rival.name, used.is_clear) == ("yeoh", "ogden", False)
