"""What of the walls' state is held against films, of solved actuators and in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.demand import (
    MEASURES,
    demanded_strain,
    modulus_weights,
    needed,
)
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.outputs import (
    OUTPUTS,
    PEAK_SHARE,
    StrainFields,
    Stretches,
    demands,
    equivalent_stretches,
    measured_strains,
    read_state,
    read_with_gradients,
    volume_quantile,
    weibull_strain,
    window_points,
)
from bayesdeg.data.settings import Dimensions
from bayesdeg.material.hyperelastic import Yeoh
from bayesdeg.material.strength import (
    energy_equivalent_stretch,
    equivalent_uniaxial_stretch,
    wall_state,
)

COARSEST = Resolution(9.0, 9.0, 9.0)
ONE_CHAMBER = Geometry(Dimensions(length=14.0, chambers=1))
TWO_CHAMBERS, FINE_ENOUGH = Geometry(Dimensions(length=20.0, chambers=2)), Resolution(2.5, 2.5, 2.5)
MATERIAL = MaterialGroups(c2_ratio=-0.05, c3_ratio=0.05, paper_group=30.0, paper_thickness=0.12)
LOADS = (0.1, 0.3, 0.6)
STEP = 1e-6


@pytest.fixture(scope="module")
def solved():
    """A small actuator at three loads: its mesh and its states."""
    actuator = Actuator(build_mesh(ONE_CHAMBER, COARSEST))
    mesh, problem = actuator.problem(Curve(LOADS, MATERIAL))
    factorization = open_factorization(problem.system.upper)
    try:
        path = follow(problem, factorization, loads=LOADS)
    finally:
        factorization.close()
    return mesh, [point.state for point in path.points]


def inputs(criterion, shape=(1, 1, 3), **given_):
    one = np.ones(shape)
    constants = (0.3 * one, -0.015 * one, 0.015 * one)
    return Inputs(100.0 * one, *constants, one, 3e4 * one, criterion=criterion, **given_)


@settings(deadline=None)  # the first call compiles
@given(st.floats(1.0, 4.0), st.floats(-0.5, 1.0))
def test_equivalent_stretches_of_a_homogeneous_state_are_those_in_closed_form(stretch, b):
    state = wall_state(stretch, b)
    f = np.diag(state)[None, None]
    value, slope = np.empty((1, 1)), f.copy()
    demands(slope, value, np.empty((1, 1)), np.empty((1, 1)))
    energy, difference = equivalent_stretches(f, Stretches(value, slope))
    assert float(energy.value[0, 0]) == pytest.approx(
        float(energy_equivalent_stretch(state)), abs=1e-7
    )
    other = float(difference.value[0, 0])
    # where the two thinner axes are equal their difference is the root of rounding
    rounding = np.sqrt(np.finfo(float).eps) * state.max() ** 2
    assert other**2 - 1.0 / other == pytest.approx(
        state.max() ** 2 - state.min() ** 2, abs=float(rounding)
    )


def test_derivatives_of_all_readings_are_differences(solved):
    mesh, states = solved
    generator = np.random.default_rng(2)
    direction = generator.normal(size=states[-1].displacement.shape)
    _, gradient = read_with_gradients(mesh, states[-1])
    more, less = (
        read_state(
            mesh,
            replace(states[-1], displacement=states[-1].displacement + sign * STEP * direction),
        ).values
        for sign in (1.0, -1.0)
    )
    slopes = (more - less) / (2.0 * STEP)
    found = np.einsum("onk,nk->o", gradient, direction)
    np.testing.assert_allclose(found, slopes, rtol=2e-5, atol=1e-7)


@pytest.mark.parametrize("modulus", [6.0, 7.0, 14.0, 28.0, 35.0])
def test_weibull_strains_between_the_moduli_are_interpolated(solved, modulus):
    mesh, states = solved
    for state in states:
        stretch, weights = StrainFields.of(mesh.body, state).largest.value, mesh.body.weights
        strains = measured_strains(read_state(mesh, state).values)
        asked = inputs("weakest_link", (1,), weibull_modulus=np.array([modulus]))
        seen = strains[list(needed("weakest_link")), None]
        exact, _ = weibull_strain(stretch, weights, modulus)
        assert float(demanded_strain(asked, seen)[0]) == pytest.approx(exact, rel=4e-3)


def test_the_stress_of_a_state_is_that_of_uniaxial_tension():
    """Where energy and difference are those of one state, the criterion is the pointwise one."""
    state = wall_state(np.array([1.1, 1.6, 2.2]), 0.3)
    energy = energy_equivalent_stretch(state)
    squares = state.max(axis=-1) ** 2 - state.min(axis=-1) ** 2
    difference = equivalent_uniaxial_stretch(state, "cauchy_stress", Yeoh(1.0, 0.0, 0.0))
    np.testing.assert_allclose(difference**2 - 1.0 / difference, squares)
    asked = inputs("cauchy_stress", (3,))
    found = demanded_strain(asked, np.stack([energy, difference]) - 1.0)
    law = Yeoh(asked.c1, asked.c2, asked.c3)
    np.testing.assert_allclose(
        found, equivalent_uniaxial_stretch(state, "cauchy_stress", law) - 1.0, rtol=1e-7
    )


@given(st.floats(5.0, 40.0))
def test_weights_of_the_moduli_are_those_of_a_polynomial(modulus):
    weights = modulus_weights(np.array(modulus))
    nodes = 1.0 / (np.array([5.0, 10.0, 20.0, 40.0]) + 10.0)
    for power in range(4):
        expected = (modulus + 10.0) ** -power
        assert float(weights @ nodes**power) == pytest.approx(expected, rel=1e-9)


def test_without_a_modulus_the_weakest_link_is_refused():
    with pytest.raises(ValueError, match="weibull_modulus"):
        demanded_strain(inputs("weakest_link"), np.ones((4, 1, 1, 3)))


@pytest.mark.parametrize("criterion", ["cauchy_stress", "strain_energy", "weakest_link"])
def test_the_exact_map_reads_what_the_criterion_asks_for(criterion):
    pressure = np.array([[[30.0, 60.0]]])
    given_ = {"weibull_modulus": np.full((1, 1, 1), 10.0)} if criterion == "weakest_link" else {}
    forward = ExactMap(ONE_CHAMBER, COARSEST)
    asked = replace(inputs(criterion, (1, 1, 1), **given_), pressure=pressure)
    found, plain = forward(asked), forward(replace(asked, criterion="principal_stretch"))
    np.testing.assert_array_equal(found.curvature, plain.curvature)
    assert np.all(np.diff(found.peak_stretch) > 0.0)
    assert np.all(found.peak_stretch > 1.0)
    assert not np.allclose(found.peak_stretch, plain.peak_stretch, rtol=1e-4)


def test_quantiles_of_equivalent_stretches_are_read(solved):
    mesh, states = solved
    f = np.eye(3) + np.einsum(
        "eai,eqaj->eqij", states[-1].displacement[mesh.body.elements], _gradients(mesh.body)
    )
    energy, _ = equivalent_stretches(f, StrainFields.of(mesh.body, states[-1]).largest)
    quantile = volume_quantile(energy.value, mesh.body.weights, PEAK_SHARE)
    strain = measured_strains(read_state(mesh, states[-1]).values)[
        MEASURES.index("peak_energy_stretch")
    ]
    assert 1.0 + strain == pytest.approx(quantile, rel=1e-9)


def _gradients(body):
    """Shape function gradients as (n_elements, n_points, n_nodes, 3)."""
    gradients = body.gradients
    return gradients if gradients.shape[-1] == 3 else np.swapaxes(gradients, -1, -2)


@given(
    st.lists(st.tuples(st.sampled_from((1.0, 1.1, 1.25, 2.0)), st.floats(0.01, 50.0)), min_size=2),
    st.floats(0.0, 1.0),
)
def test_a_quantile_of_the_most_stretched_is_that_of_all_in_order(points, share):
    """Few of them are ordered; ties, unequal volumes and any share come to the same."""
    stretch, weights = np.array(points).T
    order = np.argsort(stretch, kind="stable")
    middle = np.cumsum(weights[order]) - 0.5 * weights[order]
    expected = np.interp(share * weights.sum(), middle, stretch[order])
    assert volume_quantile(stretch, weights, share) == pytest.approx(expected, rel=1e-9)


def test_smooth_derivatives_of_quantiles_are_nearer_to_slopes_between_loads():
    """Along a path, over four steps of it; exact ones are those of two points alone."""
    actuator = Actuator(build_mesh(TWO_CHAMBERS, FINE_ENOUGH))
    loads = tuple(np.linspace(0.02, 0.6, 30))
    mesh, problem = actuator.problem(Curve(loads, MATERIAL))
    factorization = open_factorization(problem.system.upper)
    try:
        points = follow(problem, factorization, loads=loads).points
    finally:
        factorization.close()
    columns = [k for k, name in enumerate(OUTPUTS) if name.startswith("peak")]
    at = np.array([point.state.load for point in points])
    errors = []
    for is_smooth in (False, True):
        read = [read_with_gradients(mesh, p.state, is_smooth=is_smooth) for p in points]
        values = np.array([value[columns] for value, _ in read])
        rates = np.array(
            [
                np.einsum("kni,ni->k", gradient[columns], point.rate.displacement)
                for (_, gradient), point in zip(read, points, strict=True)
            ]
        )
        slopes = (values[4:] - values[:-4]) / (at[4:] - at[:-4])[:, None]
        errors.append(np.sqrt(np.mean((rates[2:-2] / slopes - 1.0) ** 2, axis=0)))
    print("exact and smooth:", np.round(errors, 4))
    assert np.all(errors[1] < 0.75 * errors[0])


def test_of_few_points_or_at_rest_no_derivative_is_smoothed():
    assert window_points(np.linspace(1.0, 2.0, 100), np.ones(100), 0.99) is None
    assert window_points(np.ones(10_000), np.ones(10_000), 0.99) is None
    assert window_points(np.full(10_000, np.nan), np.ones(10_000), 0.99) is None


@given(st.integers(0, 1000))
def test_what_goes_with_the_logarithm_of_the_volume_beyond_is_met_exactly(seed):
    """A parabola over it: the parts give its value at the quantile."""
    generator = np.random.default_rng(seed)
    volumes = generator.uniform(0.5, 1.5, 5000)
    stretch = np.sort(generator.uniform(1.0, 2.0, 5000))
    beyond = (np.cumsum(volumes[::-1])[::-1] - 0.5 * volumes) / volumes.sum()
    shape = np.polynomial.Polynomial(generator.normal(size=3))
    found = window_points(stretch, volumes, PEAK_SHARE)
    assert found is not None
    places, parts = found
    met = parts @ shape(np.log(beyond[places]))
    assert met == pytest.approx(shape(np.log(1.0 - PEAK_SHARE)), rel=1e-6, abs=1e-6)


def test_a_quantile_of_what_is_not_known_is_not_known():
    assert np.isnan(volume_quantile(np.full(5, np.nan), np.ones(5), 0.99))
    assert np.isnan(volume_quantile(np.array([1.0, 1.2, np.nan]), np.ones(3), 0.99))
    assert volume_quantile(np.array([1.0, 1.2, np.nan]), np.ones(3), 0.0) == 1.0
