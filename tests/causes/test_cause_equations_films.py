"""Causes that act on tensile tests, against stresses derived by computer algebra."""

from dataclasses import replace

import numpy as np
import pytest
import sympy

from bayesdeg.causes.catalogue import find
from bayesdeg.causes.cause import FilmConditions
from bayesdeg.causes.second_invariant import add_to_stress
from bayesdeg.causes.stress_measure import confuse_measure
from bayesdeg.material.hyperelastic import NeoHookean, cauchy_stress, nominal_stress, yeoh_basis
from tests.causes.default_actuator import effect

MODES = ("uniaxial", "equibiaxial", "planar")
STRETCH = np.linspace(0.8, 3.1, 9)
ON_FILMS = ("stress_measure", "second_invariant")


def films(*, cauchy, modes=MODES, stretch=STRETCH):
    shape = (len(modes), len(stretch))
    return FilmConditions(
        stretch=np.broadcast_to(stretch, shape),
        mode=np.array(modes),
        cauchy=np.full(shape, cauchy),
        degradation=np.zeros(len(modes)),
    )


def principal(mode, stretch):
    """The three principal stretches of an incompressible film."""
    return {
        "uniaxial": (stretch, 1 / sympy.sqrt(stretch), 1 / sympy.sqrt(stretch)),
        "equibiaxial": (stretch, stretch, stretch**-2),
        "planar": (stretch, sympy.Integer(1), 1 / stretch),
    }[mode]


def derived_stress(mode):
    """Cauchy stress σ₁ = λ₁ ∂W/∂λ₁ − λ₃ ∂W/∂λ₃ of W = √I₂, face 3 free, as a function of λ."""
    a, b, c, stretch = sympy.symbols("a b c x", positive=True)
    energy = sympy.sqrt(a**2 * b**2 + b**2 * c**2 + c**2 * a**2)
    stress = a * sympy.diff(energy, a) - c * sympy.diff(energy, c)
    at = dict(zip((a, b, c), principal(mode, stretch), strict=True))
    return sympy.simplify(stress.subs(at)), stretch


def test_stress_of_the_second_invariant_is_that_of_its_energy():
    constants = np.array([[[0.3, -0.01, 0.002], [0.6, 0.0, 0.0], [1.2, 0.0, 0.1]]])
    values = effect(ratio=[0.5, 1.0])
    nothing = np.zeros((1, 3, len(STRETCH)))
    true = add_to_stress(nothing, films(cauchy=True), values, constants)
    nominal = add_to_stress(nothing, films(cauchy=False), values, constants)
    assert true.shape == (2, 3, len(STRETCH))
    for row, mode in enumerate(MODES):
        stress, stretch = derived_stress(mode)
        want = sympy.lambdify(stretch, stress)(STRETCH)
        for walker, ratio in enumerate((0.5, 1.0)):
            r = ratio * constants[0, row, 0]
            np.testing.assert_allclose(true[walker, row], r * want, rtol=1e-11, atol=1e-14)
            np.testing.assert_allclose(
                nominal[walker, row], r * want / STRETCH, rtol=1e-11, atol=1e-14
            )


@pytest.mark.parametrize(
    ("mode", "second", "bracket"),
    [
        ("uniaxial", "2*x + x**-2", "1 - x**-3"),
        ("equibiaxial", "x**4 + 2*x**-2", "x**3 - x**-3"),
        ("planar", "x**2 + 1 + x**-2", "x - x**-3"),
    ],
)
def test_the_formulas_in_the_text_are_the_derived_ones(mode, second, bracket):
    stress, stretch = derived_stress(mode)
    written = sympy.sympify(f"({bracket})/sqrt({second})", locals={"x": stretch})
    for value in (sympy.Rational(6, 5), sympy.Rational(5, 2), sympy.Rational(7, 10)):
        difference = (stress / stretch - written).subs(stretch, value)
        assert abs(sympy.N(difference, 30)) < 1e-25


def test_the_second_invariant_adds_to_the_stress_that_is_there():
    constants = np.array([[[0.3, -0.01, 0.002]]])
    film = films(cauchy=False, modes=("uniaxial",), stretch=np.array([2.0]))
    # r/√I₂ (1 − λ⁻³) = 0.15/√4.25 · 7/8
    added = add_to_stress(np.full((1, 1, 1), 0.7), film, effect(ratio=0.5), constants)
    assert added.item() == pytest.approx(0.7 + 0.15 / np.sqrt(4.25) * 0.875, rel=1e-14)


def test_what_is_labelled_wrongly_is_the_other_stress():
    solid = NeoHookean(0.3)
    for row, mode in enumerate(MODES):
        nominal, true = (f(solid, STRETCH, mode=mode) for f in (nominal_stress, cauchy_stress))
        constants = np.zeros((1, 3, 3))
        stress = np.zeros((1, 3, len(STRETCH)))
        stress[0, row] = nominal
        read = confuse_measure(stress, films(cauchy=False), effect(confusion=1.0), constants)
        np.testing.assert_allclose(read[0, row], true, rtol=1e-14)
        stress[0, row] = true
        read = confuse_measure(stress, films(cauchy=True), effect(confusion=1.0), constants)
        np.testing.assert_allclose(read[0, row], nominal, rtol=1e-13)


def test_half_a_confusion_is_the_geometric_mean_of_the_two_stresses():
    film = films(cauchy=False, modes=("uniaxial",), stretch=np.array([4.0]))
    read = confuse_measure(np.ones((1, 1, 1)), film, effect(confusion=[0.0, 0.5, 1.0]), np.ones(3))
    np.testing.assert_allclose(read[:, 0, 0], [1.0, 2.0, 4.0])


def test_nominal_stress_taken_for_cauchys_looks_like_the_published_constants():
    """C1 a third too low and C2 negative, of a neo-Hookean film stretched to 3.1."""
    stretch = np.linspace(1.0, 3.1, 200)
    film = films(cauchy=True, modes=("uniaxial",), stretch=stretch)
    true = cauchy_stress(NeoHookean(0.288), stretch, mode="uniaxial")[None, None]
    read = confuse_measure(true, film, effect(confusion=1.0), np.ones((1, 1, 3)))[0, 0]
    fitted = np.linalg.lstsq(yeoh_basis(stretch, "uniaxial", "cauchy"), read, rcond=None)[0]
    assert fitted[0] / 0.288 - 1.0 == pytest.approx(-0.32, abs=0.005)
    assert fitted[1] < 0.0 < fitted[2]


@pytest.mark.parametrize("name", ON_FILMS)
def test_what_films_read_is_linear_in_stress_and_constants_together(name):
    """So that derivatives by the degradation rate go through the same hook."""
    cause, generator = find(name), np.random.default_rng(4)
    first, second = (generator.standard_normal((2, 3, 9)) for _ in range(2))
    one, other = (generator.standard_normal((2, 3, 3)) for _ in range(2))
    film, values = films(cauchy=True), effect(**{cause.parameters[0].name: [0.3, 0.9]})

    def read(stress, constants):
        return cause.on_stress(stress, film, values, constants)

    np.testing.assert_allclose(
        read(2.0 * first - 3.0 * second, 2.0 * one - 3.0 * other),
        2.0 * read(first, one) - 3.0 * read(second, other),
        rtol=1e-12,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ON_FILMS)
@pytest.mark.parametrize("cauchy", [False, True])
def test_neutral_values_leave_stresses_bit_by_bit(name, cauchy):
    cause, generator = find(name), np.random.default_rng(5)
    stress = generator.standard_normal((2, 3, 9))
    values = effect(**{p.name: [p.neutral, p.neutral] for p in cause.parameters})
    read = cause.on_stress(stress, films(cauchy=cauchy), values, generator.random((2, 3, 3)))
    np.testing.assert_array_equal(read, stress)


@pytest.mark.parametrize("name", ON_FILMS)
def test_unstretched_films_read_no_stress(name):
    film = films(cauchy=False, stretch=np.ones(2))
    cause = find(name)
    read = cause.on_stress(np.zeros((1, 3, 2)), film, effect(**cause.typical), np.ones((1, 3, 3)))
    np.testing.assert_allclose(read, 0.0, atol=1e-15)


def test_films_of_another_batch_and_of_a_warm_day_are_stiffer_or_softer_by_a_factor():
    tests = replace(
        films(cauchy=False),
        temperature=np.array([24.0, 29.0, np.nan]),
        batch=np.array([0, 1, 3]),
    )
    stress, constants = np.ones((1, 3, len(STRETCH))), np.ones((1, 3, 3))
    batches = effect(second=[0.2, -0.2], third=[0.0, 0.0], fourth=[0.1, 0.1])
    mixed = find("batch_stiffness").on_stress(stress, tests, batches, constants)
    np.testing.assert_allclose(np.log(mixed[..., 0]), [[0.0, 0.2, 0.1], [0.0, -0.2, 0.1]])
    warm = find("temperature_softening").on_stress(stress, tests, effect(softening=0.02), constants)
    np.testing.assert_allclose(np.log(warm[0, :, -1]), [0.0, -0.1, 0.0], atol=1e-15)
