"""Dimensions that are priors: curves with them moved, and the map between and beside these."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.errors import BayesdegError
from bayesdeg.priors import Normal
from bayesdeg.surrogate.departure import OF_LOAD
from bayesdeg.surrogate.departure_training import (
    LEVELS,
    departed,
    fit_departure,
    moved_curves,
)
from bayesdeg.surrogate.kept import PAIRED, Recipe
from bayesdeg.surrogate.local import curves_of, local_design
from bayesdeg.surrogate.regression import observe
from bayesdeg.surrogate.scaling import NOMINAL_THICKNESS
from bayesdeg.surrogate.surrogate import Surrogate
from tests.surrogate.closed_form import FILLED, LENGTH, sample, trained
from tests.surrogate.test_local import WANTED, asked_of

ROOF = UncertainDimension("roof", Normal(2.0, 0.2), 1.4, 2.6)
WALL = UncertainDimension("side_wall", Normal(2.0, 0.1), 1.7, 2.2)
ASKED = asked_of(200, 1)
SOFT = Curve((0.6,), MaterialGroups(-0.01, 0.0055, 60.0, paper_thickness=NOMINAL_THICKNESS))


def log_change(roof, wall):
    """What the dimensions do to ln of the curvature at a swelling."""
    return -0.08 * roof + 0.03 * wall + 0.004 * roof**2 + 0.006 * roof * wall


def log_load(roof, wall):
    """What they do to ln of the load at a swelling."""
    return -0.05 * roof + 0.02 * wall + 0.002 * roof**2


def moved(curve, away, *, fine):
    """The closed form with dimensions moved, with exact derivatives."""
    found = sample(curve, fine=fine)
    roof, wall = (*away, 0.0)[:2]
    factor, of_load = np.exp(log_change(roof, wall)), np.exp(log_load(roof, wall))
    readings, gradients = found.readings.copy(), found.gradients.copy()
    readings[:, 0] *= factor
    gradients[:, 0] *= factor
    gradients[:, :, 0] /= of_load
    return replace(
        found,
        loads=of_load * found.loads,
        readings=readings,
        gradients=gradients,
        limit_load=of_load * found.limit_load,
    )


def seen(curve, solved):
    return observe(curve, solved, length=LENGTH, compliance=FILLED)


def differences(dimensions, design):
    plan = moved_curves(dimensions, design.coarse, design.fine)
    return [
        (one, departed(seen(one.curve, sample(one.curve, fine=one.is_fine)),
                       seen(one.curve, moved(one.curve, one.away, fine=one.is_fine))))
        for one in plan
    ]  # fmt: skip


@pytest.fixture(scope="module")
def design():
    return local_design(ASKED, replace(Recipe(), coarse_runs=12, fine_runs=2))


@pytest.fixture(scope="module", params=[(ROOF,), (ROOF, WALL)], ids=["one", "two"])
def found(request, design):
    dimensions = request.param
    free = differences(dimensions, design)
    return fit_departure(dimensions, free, [])


@pytest.fixture(scope="module")
def surrogate(found):
    return replace(trained(), departure=found.departure)


def inputs_at(curve, dimensions, shape=(1,)):
    """Inputs of a curve's material with C1 = 1 MPa, at its loads."""
    m, one = curve.material, np.ones(shape)
    return Inputs(
        1e3 * np.array(curve.loads),
        one,
        m.c2_ratio * one,
        m.c3_ratio * one,
        one,
        1e3 * m.paper_group * one,
        skin=m.skin * one,
        wall_factor=m.wall_factor * one,
        paper_thickness=m.paper_thickness * one,
        dimensions=dimensions,
    )


def held_out(surrogate, values):
    """Relative errors of the change of curvature at fresh curves, at a load that changes too."""
    errors = []
    names = dict(zip(("roof", "side_wall"), values, strict=False))
    steps = [(names.get(d.name, d.median) - d.median) / d.step for d in (ROOF, WALL)]
    for curve in curves_of(asked_of(40, 2), WANTED, 12, seed=3):
        dims = {name: np.full((1,), value) for name, value in names.items()}
        given = inputs_at(curve, None)
        more = replace(given, pressure=given.pressure * np.exp(log_load(*steps)), dimensions=dims)
        errors.append(
            np.log(surrogate(more).curvature / surrogate(given).curvature) - log_change(*steps)
        )
    return np.abs(np.concatenate(errors))


# ---- which curves


def test_every_dimension_is_moved_both_ways_by_several_steps_within_its_range(design):
    plan = moved_curves((ROOF, WALL), design.coarse, design.fine)
    alone = [one for one in plan if np.count_nonzero(one.away) == 1]
    assert len(alone) == 2 * 2 * (len(design.coarse) + len(design.fine))
    steps = {round(one.away[0], 9) for one in alone}
    assert steps - {0.0} == {*LEVELS, *(-level for level in LEVELS)}
    assert max(one.away[1] for one in alone) == pytest.approx(WALL.range[1])
    assert len(plan) - len(alone) == PAIRED
    assert len(set(plan)) == len(plan)


# ---- what is learned


def test_the_change_is_met_at_values_and_curves_that_were_not_solved(surrogate, found):
    one = len(found.departure.names) == 1
    for values in [(1.7,), (2.25,), (2.55,)] if one else [(1.75, 2.05), (2.3, 1.85)]:
        errors = held_out(surrogate, values)
        assert np.nanmax(errors) < 2e-3
        assert np.count_nonzero(np.isfinite(errors)) > 0.9 * len(errors)


def test_the_error_that_is_stated_is_of_the_size_of_the_one_that_is_made(surrogate, found):
    values = (2.5, 2.1)[: len(found.departure.names)]
    away = [(v - d.median) / d.step for v, d in zip(values, (ROOF, WALL), strict=False)]
    stated = np.sqrt(
        np.square(found.departure.error[:, [0, OF_LOAD]]).sum(axis=1)
        @ np.square(found.departure.sizes(np.array(away)[:, None])[:, 0])
    )
    errors = held_out(surrogate, values)
    assert np.nanquantile(errors, 0.9) < 2.0 * stated
    assert stated < 1e-3


def test_the_record_says_how_far_curves_left_out_are_missed(found):
    facts = found.facts["roof"]
    assert facts["median_mm"] == 2.0
    assert 0.0 < facts["accuracy"]["curvature"]["p95_pct"] < 1.0
    assert facts["curves"] >= 28
    json.dumps(found.facts)


def test_the_ballooning_pressure_moves_with_the_load():
    """Learned from curves that balloon, and others that nearly do."""
    asked = replace(ASKED, load=4.5 * ASKED.load)
    recipe = replace(Recipe(), coarse_runs=12, fine_runs=2)
    design = local_design(asked, recipe)
    assert sum(np.isfinite(sample(curve).limit_load) for curve in design.coarse) >= 2
    found = fit_departure((ROOF,), differences((ROOF,), design), [])
    surrogate = replace(trained(), departure=found.departure)
    at, still = (
        surrogate.limit_pressure(inputs_at(SOFT, dims))
        for dims in ({"roof": np.full((1,), 2.4)}, None)
    )
    wanted = np.exp(log_load(2.0, 0.0))
    assert np.isfinite(still.pressure.item())
    assert (at.pressure / still.pressure).item() == pytest.approx(wanted, rel=2e-3)


def test_a_change_of_load_alone_is_one_of_the_load_at_a_swelling(design):
    for curve in design.coarse[:4]:
        found = sample(curve, fine=True)
        gradients = found.gradients.copy()
        gradients[:, :, 0] /= 1.03
        stronger = replace(found, loads=found.loads * 1.03, gradients=gradients)
        away = departed(seen(curve, found), seen(curve, stronger))
        np.testing.assert_allclose(away.values[:, :-1], 0.0, atol=1e-12)
        np.testing.assert_allclose(away.values[:, -1], np.log(1.03), atol=1e-12)


def test_at_the_median_nothing_changes(surrogate):
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    at = {d.name: np.full((1,), d.median) for d in (ROOF, WALL)[: len(surrogate.departure.names)]}
    same, plain = surrogate(inputs_at(curve, at)), surrogate(inputs_at(curve, None))
    for name in ("curvature", "bend_angle", "peak_stretch", "slope", "sd"):
        np.testing.assert_allclose(getattr(same, name), getattr(plain, name), rtol=1e-9)


def test_the_slope_is_the_derivative_by_ln_pressure(surrogate):
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    dims = {"roof": np.full((1,), 2.3)}
    base = inputs_at(curve, dims)
    more, less = (surrogate(replace(base, pressure=base.pressure * f)) for f in (1.001, 0.999))
    numeric = (more.curvature - less.curvature) / 0.002
    inner = np.isfinite(numeric)
    np.testing.assert_allclose(surrogate(base).slope[inner], numeric[inner], rtol=1e-4)


def test_walkers_may_have_dimensions_of_their_own(surrogate):
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    roofs = np.array([1.8, 2.0, 2.4])
    together = surrogate(inputs_at(curve, {"roof": roofs[:, None, None]}, (3, 1, 1))).curvature
    for row, roof in zip(together, roofs, strict=True):
        alone = surrogate(inputs_at(curve, {"roof": np.full((1,), roof)})).curvature
        np.testing.assert_allclose(row[0], alone, rtol=1e-12)


# ---- where it answers


def test_outside_its_range_it_refuses_and_goes_on_with_an_excess(surrogate):
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    beyond = inputs_at(curve, {"roof": np.full((1,), 2.7)})
    end = inputs_at(curve, {"roof": np.full((1,), 2.6)})
    assert np.all(np.isnan(surrogate(beyond).curvature))
    on = surrogate.continued(beyond)
    assert np.all(on.excess > 1.0)
    np.testing.assert_allclose(on.curvature, surrogate.continued(end).curvature, rtol=1e-9)


def test_a_dimension_that_was_not_trained_is_refused_by_its_name(surrogate):
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    with pytest.raises(BayesdegError, match="width"):
        surrogate(inputs_at(curve, {"width": np.full((1,), 10.0)}))
    with pytest.raises(BayesdegError, match="roof"):
        trained()(inputs_at(curve, {"roof": np.full((1,), 2.0)}))


def test_its_file_holds_the_departure(surrogate):
    again = Surrogate.from_arrays(surrogate.to_arrays())
    curve = curves_of(asked_of(40, 2), WANTED, 1, seed=3)[0]
    at = inputs_at(curve, {"roof": np.full((1,), 2.3)})
    np.testing.assert_array_equal(again(at).curvature, surrogate(at).curvature)
    assert again.departure.covers("roof", 1.4, 2.6)
    assert not again.departure.covers("roof", 1.3, 2.6)
