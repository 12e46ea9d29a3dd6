"""Yeoh's stress as a linear model: the paper's Eq. 2, its misuse, and Treloar's rubber."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.material.hyperelastic import (
    EXPONENTS,
    NeoHookean,
    Yeoh,
    YeohRootSecondInvariant,
    cauchy_stress,
    loaded_axes,
    nominal_stress,
    power_sum,
    root_second_invariant_basis,
    yeoh_basis,
)

STRETCHES = np.linspace(0.7, 3.2, 26)
CONSTANTS = np.array([0.3, -0.02, 0.004])
LAW = Yeoh(*CONSTANTS)
MODES = tuple(EXPONENTS)


@pytest.mark.parametrize("mode", MODES)
def test_basis_times_constants_is_the_stress(mode):
    for measure, stress in (("nominal", nominal_stress), ("cauchy", cauchy_stress)):
        np.testing.assert_allclose(
            yeoh_basis(STRETCHES, mode, measure) @ CONSTANTS,
            stress(LAW, STRETCHES, mode=mode),
            rtol=1e-12,
            atol=1e-15,
        )


@pytest.mark.parametrize("mode", MODES)
def test_root_term_is_a_further_column(mode):
    law = YeohRootSecondInvariant(*CONSTANTS, 0.15)
    columns = yeoh_basis(STRETCHES, mode) @ CONSTANTS
    columns = columns + 0.15 * root_second_invariant_basis(STRETCHES, mode)
    np.testing.assert_allclose(
        columns, nominal_stress(law, STRETCHES, mode=mode), rtol=1e-12, atol=1e-15
    )


def test_rows_of_mixed_modes_and_measures():
    modes = np.array(["uniaxial", "planar", "equibiaxial"], dtype=object)
    measures = np.array(["nominal", "cauchy", "cauchy"], dtype=object)
    rows = yeoh_basis([1.2, 1.4, 1.6], modes, measures)
    for row, stretch, mode, measure in zip(rows, (1.2, 1.4, 1.6), modes, measures, strict=True):
        np.testing.assert_allclose(row, yeoh_basis(stretch, mode, measure), rtol=1e-14)


def test_unknown_measure_is_refused():
    with pytest.raises(ValueError, match="measure 'true'"):
        yeoh_basis(1.5, "uniaxial", "true")


def test_cauchy_basis_is_equation_two_of_the_paper():
    x = STRETCHES**2 + 2.0 / STRETCHES - 3.0
    powers = np.stack([np.ones_like(x), 2.0 * x, 3.0 * x**2], axis=-1)
    expected = 2.0 * (STRETCHES**2 - 1.0 / STRETCHES)[:, np.newaxis] * powers
    np.testing.assert_allclose(
        yeoh_basis(STRETCHES, "uniaxial", "cauchy"), expected, rtol=1e-10, atol=1e-14
    )


def test_equation_two_fitted_to_nominal_stress_makes_the_solid_too_soft():
    stretches = np.linspace(1.0, 3.1, 201)[1:]
    nominal = nominal_stress(NeoHookean(0.3), stretches, mode="uniaxial")
    basis = yeoh_basis(stretches, "uniaxial", "cauchy")
    c1, c2, c3 = np.linalg.lstsq(basis, nominal, rcond=None)[0]
    assert c1 / 0.3 - 1.0 == pytest.approx(-0.32, abs=0.005)
    assert c2 < 0.0 < c3


def treloar():
    table = pd.read_csv(Path(__file__).parent / "data" / "treloar_1944.csv", comment="#")
    return table.assign(
        mode=table["mode"].map({"UT": "uniaxial", "ET": "equibiaxial", "PS": "planar"})
    )


def columns(table, term):
    stretch, mode = table["stretch"].to_numpy(), table["mode"].to_numpy()
    basis = yeoh_basis(stretch, mode)
    if term == "root":
        return np.column_stack([basis, root_second_invariant_basis(stretch, mode)])
    if term == "linear":
        slope = power_sum(stretch, mode, -2.0).slope / loaded_axes(mode)
        return np.column_stack([basis, slope])
    return basis


def held_out_equibiaxial_rmse(train_modes, term):
    table = treloar()
    train, held_out = table[table["mode"].isin(train_modes)], table[table["mode"] == "equibiaxial"]
    stress = train["nominal_stress_MPa"].to_numpy()
    constants = np.linalg.lstsq(columns(train, term), stress, rcond=None)[0]
    error = held_out["nominal_stress_MPa"].to_numpy() - columns(held_out, term) @ constants
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(("term", "rmse"), [("none", 0.237), ("root", 0.044), ("linear", 1.14)])
def test_treloar_rubber_fitted_in_two_modes_predicts_the_third(term, rmse):
    assert held_out_equibiaxial_rmse(["uniaxial", "planar"], term) == pytest.approx(rmse, rel=0.01)


def test_treloar_uniaxial_data_alone_cannot_identify_the_second_invariant():
    plain = held_out_equibiaxial_rmse(["uniaxial"], "none")
    assert plain == pytest.approx(0.258, rel=0.01)
    assert held_out_equibiaxial_rmse(["uniaxial"], "root") > 3.0 * plain
    basis = columns(treloar().query("mode == 'uniaxial'"), "root")
    scaled = basis / np.linalg.norm(basis, axis=0)
    assert np.linalg.cond(scaled) > 50.0
