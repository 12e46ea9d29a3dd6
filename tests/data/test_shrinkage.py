import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.data.settings import Known, Mixture, MixtureRecipe
from bayesdeg.data.shrinkage import (
    component_masses,
    density_by_mass_average,
    film_volume,
    linear_scale,
    mean_as_printed,
    mean_of_replicates,
    mean_over_films,
    recipe_error,
    volume_ratio,
    volume_ratio_by_mass_average,
)

SHARES = st.floats(0.3, 1.0)


@given(poured=st.floats(0.1, 100.0), a=SHARES, b=SHARES)
def test_volume_ratio_is_one_plus_beta_of_eq_11(poured: float, a: float, b: float) -> None:
    cured, conditioned = poured * max(a, b), poured * min(a, b)
    beta = (conditioned - cured) / 1.00 / film_volume(poured, cured)
    np.testing.assert_allclose(volume_ratio(poured, cured, conditioned), 1 + beta, rtol=1e-12)


def test_mass_averaged_ratio_is_eq_16_to_the_letter() -> None:
    m0, m1, m2, big, gel, gly, r_gel, r_gly, r_w = sympy.symbols("m0 m1 m2 M Mg My rg ry rw")
    bracket = gel * r_gel + gly * r_gly + (big * m1 / m0 - gel - gly) * r_w
    alpha = 1 + (m2 - m1) / r_w * m0 / (big * m1**2) * bracket
    values = {m0: 30, m1: 14.2, m2: 9.7, big: 11, gel: 2, gly: 1, r_gel: 1.35, r_gly: 1.26, r_w: 1}
    np.testing.assert_allclose(
        volume_ratio_by_mass_average(30.0, 14.2, 9.7), float(alpha.subs(values)), rtol=1e-13
    )


def test_components_add_up_to_the_film() -> None:
    masses = np.array([30.0, 20.0, 10.0])
    parts = component_masses(30.0, masses)
    np.testing.assert_allclose(sum(parts), masses)
    np.testing.assert_allclose(parts[0] / parts[1], 2.0)
    np.testing.assert_allclose(parts[2][0] / parts[1][0], 8.0)


def test_equal_densities_make_volume_follow_mass() -> None:
    same = Mixture(gelatin_density=1.1, glycerol_density=1.1, water_density=1.1)
    np.testing.assert_allclose(film_volume(30.0, 12.0, same), 12.0 / 1.1)
    np.testing.assert_allclose(density_by_mass_average(30.0, 12.0, same), 1.1)
    np.testing.assert_allclose(volume_ratio(30.0, 15.0, 12.0, same), 0.8)
    np.testing.assert_allclose(volume_ratio_by_mass_average(30.0, 15.0, 12.0, same), 0.8)


def test_masses_named_in_the_literature_give_its_volume_ratio() -> None:
    # α = 0.62 needs m_1 of about 13.5 to 17.7 g and m_2 of 9.1 to 11.7 g at 10 to 30 % moisture
    np.testing.assert_allclose(volume_ratio(30.0, [13.5, 17.7], [9.1, 11.7]), 0.62, atol=0.01)
    to_mould = film_volume(30.0, [9.1, 11.7]) / film_volume(30.0, 30.0)
    assert np.all((to_mould > 0.24) & (to_mould < 0.36))


def test_mass_average_is_a_little_too_dense() -> None:
    exact, averaged = volume_ratio(30.0, 15.0, 10.0), volume_ratio_by_mass_average(30.0, 15.0, 10.0)
    assert 0.005 < (exact - averaged) / exact < 0.02
    assert density_by_mass_average(30.0, 15.0) > 15.0 / film_volume(30.0, 15.0)


def test_range_of_gelatin_density_matters_little() -> None:
    ratios = [
        float(volume_ratio(30.0, 15.0, 10.0, Mixture(gelatin_density=density)))
        for density in (1.27, 1.44)
    ]
    assert abs(ratios[0] - ratios[1]) < 0.02


def test_impossible_masses_are_refused() -> None:
    with pytest.raises(ValueError, match=r"glycerol alone are 0\.273"):
        volume_ratio(30.0, 15.0, 8.0)
    with pytest.raises(ValueError, match="glycerol alone"):
        volume_ratio_by_mass_average(30.0, 15.0, 8.0)
    with pytest.raises(ValueError, match="its poured mass"):
        volume_ratio(30.0, 31.0, 10.0)


def test_mean_of_replicates_and_of_one() -> None:
    mean = mean_of_replicates([0.5, 0.6, 0.7, 0.8])
    assert mean.value == pytest.approx(0.65)
    assert mean.standard_error == pytest.approx(np.sqrt(5 / 300) / 2)
    assert mean.count == 4
    assert np.isnan(mean_of_replicates([0.6]).standard_error)
    with pytest.raises(ValueError, match="no film"):
        mean_of_replicates([])


@given(alpha=st.floats(0.05, 1.5))
def test_linear_scale_cubed_is_the_volume_ratio(alpha: float) -> None:
    np.testing.assert_allclose(linear_scale(alpha) ** 3, alpha)


FILMS = (np.array([30.0, 29.0, 31.0]), np.array([15.0, 16.0, 15.5]), np.array([10.0, 10.5, 10.2]))
RECIPE = MixtureRecipe(
    gelatin=Known(2.0, 0.1),
    water=Known(8.0, 0.3),
    gelatin_density=Known(1.35, 0.05),
    water_density=Known(1.0, 0.002),
)


def test_an_exact_recipe_leaves_the_mean_of_the_films_as_it_is() -> None:
    assert mean_over_films(FILMS, MixtureRecipe()) == (
        mean_of_replicates(volume_ratio(*FILMS)),
        2.0,
    )


def test_the_error_of_the_recipe_is_the_spread_of_the_mean_over_recipes() -> None:
    """All films share a recipe: it is drawn once for all of them."""
    generator = np.random.default_rng(0)
    means = [
        np.mean(volume_ratio(*FILMS, mixture))
        for mixture in (
            Mixture(
                gelatin=2.0 + 0.1 * z[0],
                water=8.0 + 0.3 * z[1],
                gelatin_density=1.35 + 0.05 * z[2],
                water_density=1.0 + 0.002 * z[3],
            )
            for z in generator.standard_normal((8000, 4))
        )
    ]
    assert recipe_error(FILMS, RECIPE) == pytest.approx(np.std(means), rel=0.04)


@pytest.mark.parametrize("times", [1, 100])
def test_more_films_average_their_own_scatter_and_not_the_recipes(times: int) -> None:
    poured, cured, conditioned = (np.tile(mass, times) for mass in FILMS)
    films = (poured, cured, conditioned)
    own, common = mean_of_replicates(volume_ratio(*films)), recipe_error(FILMS, RECIPE)
    mean, dof = mean_over_films(films, RECIPE)
    assert mean.standard_error == pytest.approx(np.hypot(own.standard_error, common))
    assert dof == pytest.approx((3 * times - 1) * (mean.standard_error / own.standard_error) ** 4)
    assert mean.value == own.value


def test_a_scale_common_to_all_parts_or_all_densities_changes_nothing() -> None:
    other = Mixture(20.0, 10.0, 80.0, 2.70, 2.52, 2.00)
    np.testing.assert_allclose(volume_ratio(*FILMS, other), volume_ratio(*FILMS), rtol=1e-12)


def test_a_film_as_light_as_its_solids_has_an_error_too() -> None:
    dry = (np.array([11.0]), np.array([6.0]), np.array([3.0]))
    assert 0.0 < recipe_error(dry, RECIPE) < 0.1


def test_eqs_15_to_17_as_printed_are_averaged_over_films() -> None:
    each = []
    for poured, cured, conditioned in zip(*FILMS, strict=True):
        gelatin, glycerol = 2.0 / 11.0 * poured, 1.0 / 11.0 * poured
        water = cured - gelatin - glycerol
        density = (gelatin * 1.35 + glycerol * 1.26 + water * 1.0) / cured
        each.append(1.0 + (conditioned - cured) / 1.0 * density / cured)
    found = mean_as_printed(FILMS, MixtureRecipe())
    assert found.value == pytest.approx(np.mean(each))
    assert found.standard_error == pytest.approx(np.std(each, ddof=1) / np.sqrt(len(each)))
    assert found.value < mean_over_films(FILMS, MixtureRecipe())[0].value
