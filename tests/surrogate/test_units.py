"""Load and film counted in units of an emulator's own: the same map, in other scales."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.data.families import Constraint, RibbedDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.kept import local_recipe
from bayesdeg.surrogate.local import InputDraws, counted_in, local_design, span_of, units_for
from bayesdeg.surrogate.scaling import (
    GROUPS,
    LOAD,
    NO_LAYER,
    SECOND,
    TrainingRange,
    Units,
    groups_of,
)
from bayesdeg.surrogate.surrogate import Surrogate

UNITS = Units(load=4.0, paper=16.0)
RIBBED = geometry_of(RibbedDimensions(), Constraint("film"))


def inputs(pressure, stiffness, **more):
    one = np.ones((2, 1))
    c1, c2, c3 = (value * one for value in (0.3, 0.005, 0.01))
    return Inputs(pressure * one, c1, c2, c3, one, stiffness * one, **more)


@pytest.fixture
def pair(surrogate):
    """One that counts as the default one does, and the same numbers in other units."""
    return surrogate, replace(surrogate, units=UNITS)


def test_it_is_the_same_map_at_loads_and_films_so_many_times_as_large(pair):
    plain, scaled = pair
    pressure = np.array([20.0, 60.0])
    reference = 10.0 * np.ones((2, 1))
    given = inputs(pressure, 3e4, reference_pressure=reference)
    larger = inputs(4.0 * pressure, 16.0 * 3e4, reference_pressure=4.0 * reference)
    for a, b in (
        (given, larger),
        *[(replace(x, reference_pressure=None) for x in (given, larger))],
    ):
        for name in ("curvature", "bend_angle", "peak_stretch", "slope", "sd", "status"):
            np.testing.assert_array_equal(
                getattr(scaled(b), name), getattr(plain(a), name), err_msg=name
            )
        assert np.all(np.isfinite(scaled(b).curvature))
    beyond = inputs(4.0 * np.array([400.0, 900.0]), 16.0 * 3e4)
    at = inputs(np.array([400.0, 900.0]), 3e4)
    np.testing.assert_array_equal(scaled.continued(beyond).curvature, plain.continued(at).curvature)


def test_derivatives_are_those_of_central_differences(pair):
    _, scaled = pair
    given = inputs(np.array([100.0, 240.0]), 4e5)
    found = scaled.gradient(given)
    for name in ("pressure", "paper_stiffness", "c1"):
        value = getattr(given, name)
        step = 1e-5 * value
        up, down = (scaled(replace(given, **{name: value + s * step})) for s in (1.0, -1.0))
        slope = (up.curvature - down.curvature) / (2.0 * step)
        np.testing.assert_allclose(found[name], slope, rtol=1e-6)


def test_limits_and_refusals_are_in_the_users_units(pair):
    plain, scaled = pair
    given, larger = inputs(np.array([20.0]), 3e4), inputs(np.array([80.0]), 16.0 * 3e4)
    np.testing.assert_allclose(
        scaled.limit_pressure(larger).pressure, 4.0 * plain.limit_pressure(given).pressure
    )
    assert not scaled.refusals(larger)
    over = scaled.refusals(inputs(np.array([4e4]), 16.0 * 3e4))
    assert f"reaches {4e4 / 300.0:.4g}" in over[LOAD]
    stiff = scaled.refusals(inputs(np.array([80.0]), 1e9))
    assert f"reaches {np.log(1e6 / 0.3):.4g}" in stiff["log_paper"]


def test_a_file_keeps_them_and_files_of_before_have_units_of_one(pair):
    plain, scaled = pair
    assert Surrogate.from_arrays(scaled.to_arrays()).units == UNITS
    assert "units" not in plain.to_arrays()
    assert Surrogate.from_arrays(plain.to_arrays()).units == Units()


@pytest.mark.parametrize("layer", [0.02, 0.0])
def test_without_paper_its_stiffness_is_no_input_and_derivatives_know_that(surrogate, layer):
    """The group is then of the layer, which sizes and second invariants leave as it is, or none."""
    units = Units(load=4.0, paper=2.0**-8, layer=layer) if layer else Units(load=4.0, layer=0.0)
    scaled = replace(surrogate, units=units)
    second = 0.02 * np.ones((2, 1))
    given = replace(
        inputs(np.array([100.0, 240.0]), 4e5, second_invariant=second),
        linear_scale=np.array([[1.0], [0.9]]),
        paper_thickness=2.0 * np.ones((2, 1)),  # of a slab: no paper of the known range
    )
    found = scaled.gradient(given)
    assert np.all(np.isfinite(scaled(given).curvature))
    other = scaled(replace(given, paper_stiffness=0.0 * given.paper_stiffness))
    np.testing.assert_array_equal(other.curvature, scaled(given).curvature)
    assert not found["paper_stiffness"].any()
    assert not found["paper_thickness"].any()
    modulus = given.c1 + SECOND * second
    group = np.log(layer / modulus / units.paper) if layer else np.log(NO_LAYER) + 0.0 * modulus
    np.testing.assert_allclose(groups_of(units.inputs(given))["log_paper"], group, rtol=1e-12)
    for name in ("pressure", "linear_scale", "c1", "second_invariant"):
        value = getattr(given, name)
        step = 1e-5 * value
        up, down = (scaled(replace(given, **{name: value + s * step})) for s in (1.0, -1.0))
        slope = (up.curvature - down.curvature) / (2.0 * step)
        np.testing.assert_allclose(found[name], slope, rtol=1e-5)
    assert Surrogate.from_arrays(scaled.to_arrays()).units == units


def asked(load, paper):
    groups = np.tile([group.neutral for group in GROUPS], (200, 1))
    rng = np.random.default_rng(5)
    groups[:, 0] = rng.uniform(-0.1, 0.3, 200)
    groups[:, 1] = rng.uniform(-7.0, -6.0, 200)
    groups[:, 2] = np.log(paper) + rng.uniform(-0.5, 0.5, 200)
    return InputDraws(groups, load * rng.uniform(0.8, 1.0, 200))


@pytest.mark.parametrize(("load", "paper"), [(2.3, 4e4), (0.05, 300.0), (17.0, 0.3)])
def test_whatever_is_asked_of_a_ribbed_segment_lies_in_the_range(load, paper):
    draws = asked(load, paper)
    units = units_for(RIBBED, draws)
    assert np.log2([units.load, units.paper]).tolist() == [
        round(x) for x in np.log2([units.load, units.paper])
    ]
    counted, span = draws.in_units(units), span_of(draws.in_units(units))
    assert 0.4 < span.share <= 1.0
    assert (
        np.all((counted.groups >= span.lower) & (counted.groups <= span.upper), axis=1).mean()
        > 0.95
    )
    design = local_design(draws, local_recipe(RIBBED.dimensions), units)
    largest = np.array([curve.loads[-1] for curve in design.coarse])
    assert np.all((largest > 0.75 * load) & (largest < 1.3 * load))
    films = np.array([curve.material.paper_group for curve in design.coarse])
    assert np.all((films > 0.6 * paper) & (films < 1.7 * paper))


def test_pneunets_keep_units_of_one():
    assert units_for(geometry_of(Dimensions()), asked(2.3, 4e4)) == Units()
    curve = Curve((1.0, 2.0), MaterialGroups(0.0, 0.01, 800.0))
    assert counted_in(curve, Units()) is curve
    assert TrainingRange().share == 1.0
