"""Hyperelastic laws: against a derivation in sympy, limits, laws that hold for every law."""

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.material.hyperelastic import (
    EXPONENTS,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    YeohRootSecondInvariant,
    cauchy_stress,
    energy,
    nominal_stress,
    power_sum,
    tangent,
)

MODES = tuple(EXPONENTS)
STRETCHES = np.array([0.6, 0.9, 0.999, 1.001, 1.1, 1.5, 2.0, 3.1])

L1, L2, L3, L = sympy.symbols("l1 l2 l3 l", positive=True)
I1 = L1**2 + L2**2 + L3**2
I2 = (L1 * L2) ** 2 + (L2 * L3) ** 2 + (L3 * L1) ** 2


def yeoh_symbolic(c1, c2, c3):
    return c1 * (I1 - 3) + c2 * (I1 - 3) ** 2 + c3 * (I1 - 3) ** 3


def ogden_symbolic(mu, alpha):
    pairs = zip(mu, alpha, strict=True)
    return sum(m / a * (L1**a + L2**a + L3**a - 3) for m, a in pairs)


EXACT = sympy.Rational
LAWS = [
    (NeoHookean(0.3), EXACT(3, 10) * (I1 - 3)),
    (
        Yeoh(0.3, -0.02, 0.004),
        yeoh_symbolic(EXACT(3, 10), -EXACT(2, 100), EXACT(4, 1000)),
    ),
    (
        YeohRootSecondInvariant(0.3, -0.02, 0.004, 0.15),
        yeoh_symbolic(EXACT(3, 10), -EXACT(2, 100), EXACT(4, 1000))
        + EXACT(15, 100) * (sympy.sqrt(I2) - sympy.sqrt(3)),
    ),
    (MooneyRivlin(0.25, 0.05), EXACT(1, 4) * (I1 - 3) + EXACT(1, 20) * (I2 - 3)),
    (Gent(0.6, 40.0), -EXACT(6, 10) * 20 * sympy.log(1 - (I1 - 3) / 40)),
    (
        Ogden([0.5, 0.02, -0.1], [1.5, 4.0, -2.0]),
        ogden_symbolic(
            [EXACT(1, 2), EXACT(2, 100), -EXACT(1, 10)], [EXACT(3, 2), EXACT(4), EXACT(-2)]
        ),
    ),
]
NAMES = [type(law).__name__ for law, _ in LAWS]
FREE_AXIS = {"uniaxial": 1, "equibiaxial": 2, "planar": 2}
STATE = {
    "uniaxial": (L, 1 / sympy.sqrt(L), 1 / sympy.sqrt(L)),
    "equibiaxial": (L, L, L**-2),
    "planar": (L, sympy.Integer(1), 1 / L),
}


def cauchy_by_eliminating_the_pressure(potential, mode):
    extra = [axis * sympy.diff(potential, axis) for axis in (L1, L2, L3)]
    difference = extra[0] - extra[FREE_AXIS[mode]]
    return difference.subs(dict(zip((L1, L2, L3), STATE[mode], strict=True)), simultaneous=True)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("law", "potential"), LAWS, ids=NAMES)
def test_stress_is_that_derived_from_the_energy(law, potential, mode):
    expected = sympy.lambdify(L, cauchy_by_eliminating_the_pressure(potential, mode))(STRETCHES)
    np.testing.assert_allclose(
        cauchy_stress(law, STRETCHES, mode=mode), expected, rtol=1e-10, atol=1e-13
    )


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("law", "potential"), LAWS, ids=NAMES)
def test_energy_is_the_potential_at_the_state(law, potential, mode):
    state = dict(zip((L1, L2, L3), STATE[mode], strict=True))
    expected = sympy.lambdify(L, potential.subs(state, simultaneous=True))(STRETCHES)
    np.testing.assert_allclose(energy(law, STRETCHES, mode=mode), expected, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("law", [law for law, _ in LAWS], ids=NAMES)
def test_tangent_is_the_slope_of_nominal_stress(law, mode):
    step = 1e-5
    above = nominal_stress(law, STRETCHES + step, mode=mode)
    below = nominal_stress(law, STRETCHES - step, mode=mode)
    np.testing.assert_allclose(
        tangent(law, STRETCHES, mode=mode), (above - below) / (2.0 * step), rtol=2e-8
    )


@pytest.mark.parametrize(("mode", "moduli"), [("uniaxial", 3), ("equibiaxial", 6), ("planar", 4)])
@pytest.mark.parametrize("law", [law for law, _ in LAWS], ids=NAMES)
def test_small_strain_limit_is_linear_elasticity(law, mode, moduli):
    assert float(tangent(law, 1.0, mode=mode)) == pytest.approx(moduli * float(law.shear_modulus))


def test_young_modulus_of_yeoh_is_six_times_its_first_constant():
    slope = float(nominal_stress(Yeoh(0.288, -0.01, 0.002), 1.0 + 1e-7, mode="uniaxial")) / 1e-7
    assert slope == pytest.approx(6.0 * 0.288, rel=1e-6)


constant = st.floats(0.0, 3.0)


@given(
    c1=st.floats(0.01, 3.0),
    c2=constant,
    c3=constant,
    c_s=constant,
    stretch=st.floats(0.3, 4.0),
    mode=st.sampled_from(MODES),
)
def test_energy_is_never_negative_and_stress_follows_the_stretch(c1, c2, c3, c_s, stretch, mode):
    law = YeohRootSecondInvariant(c1, c2, c3, c_s)
    assert energy(law, stretch, mode=mode) >= -1e-15
    stress = float(nominal_stress(law, stretch, mode=mode))
    assert stress * (stretch - 1.0) >= -1e-15
    assert float(cauchy_stress(law, stretch, mode=mode)) == pytest.approx(stretch * stress)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("law", [law for law, _ in LAWS], ids=NAMES)
def test_undeformed_solid_is_free_of_energy_and_stress(law, mode):
    assert float(energy(law, 1.0, mode=mode)) == 0.0
    assert float(nominal_stress(law, 1.0, mode=mode)) == pytest.approx(0.0, abs=1e-15)


@given(stretch=st.floats(1e-9, 1e-4), mode=st.sampled_from(MODES))
def test_small_strains_keep_their_digits(stretch, mode):
    share = {"uniaxial": 3.0, "equibiaxial": 12.0, "planar": 4.0}[mode]
    assert float(power_sum(1.0 + stretch, mode, 2.0).value) == pytest.approx(
        share * ((1.0 + stretch) - 1.0) ** 2, rel=3e-4, abs=1e-21
    )


def test_constants_broadcast_over_walkers_and_stretches():
    walkers = np.array([[0.2], [0.3], [0.4]])
    law = Yeoh(walkers, -0.02, walkers / 100.0)
    stress = nominal_stress(law, STRETCHES, mode="planar")
    assert stress.shape == (3, STRETCHES.size)
    single = nominal_stress(Yeoh(0.4, -0.02, 0.004), STRETCHES, mode="planar")
    np.testing.assert_allclose(stress[2], single, rtol=1e-14)


def test_ogden_constants_broadcast_over_walkers():
    mu = np.array([[[0.5, 0.1]], [[0.4, 0.2]]])
    stress = nominal_stress(Ogden(mu, [2.0, -2.0]), STRETCHES, mode="uniaxial")
    single = nominal_stress(Ogden([0.4, 0.2], [2.0, -2.0]), STRETCHES, mode="uniaxial")
    assert stress.shape == (2, STRETCHES.size)
    np.testing.assert_allclose(stress[1], single, rtol=1e-14)


def test_a_mode_for_each_stretch():
    stretches = np.array([1.5, 1.5, 1.5])
    mixed = nominal_stress(Yeoh(0.3, -0.02, 0.004), stretches, mode=list(MODES))
    each = [nominal_stress(Yeoh(0.3, -0.02, 0.004), 1.5, mode=mode) for mode in MODES]
    np.testing.assert_allclose(mixed, each, rtol=1e-14)


def test_ogden_of_power_two_is_neo_hookean_and_yeoh_reduces_to_it():
    expected = nominal_stress(NeoHookean(0.3), STRETCHES, mode="planar")
    for law in (Ogden([0.6], [2.0]), Yeoh(0.3, 0.0, 0.0), Gent(0.6, 1e12)):
        np.testing.assert_allclose(
            nominal_stress(law, STRETCHES, mode="planar"), expected, rtol=1e-9
        )


def test_gent_is_infinitely_stiff_beyond_its_limit():
    law = Gent(0.6, 4.0)
    assert float(energy(law, 3.0, mode="uniaxial")) == np.inf
    assert float(nominal_stress(law, 3.0, mode="uniaxial")) == np.inf
    assert float(nominal_stress(law, 0.1, mode="uniaxial")) == -np.inf
    near = nominal_stress(law, np.array([2.4, 2.45, 2.46]), mode="uniaxial")
    assert np.all(np.diff(near) > 0.0)


@pytest.mark.parametrize("mode", MODES)
def test_volume_is_kept(mode):
    assert sum(EXPONENTS[mode]) == 0.0  # the product of the stretches is 1


def test_faults_are_named():
    with pytest.raises(ValueError, match="unknown mode 'biaxial'"):
        nominal_stress(NeoHookean(0.3), 1.5, mode="biaxial")
    with pytest.raises(ValueError, match="above 0"):
        energy(NeoHookean(0.3), [1.0, 0.0], mode="uniaxial")
