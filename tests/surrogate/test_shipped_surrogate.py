"""The emulator that ships with the package."""

import json
import re
from dataclasses import fields, replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import MODEL_VERSION, ExactMap
from bayesdeg.actuator.demand import MEASURES
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.kept import SHIPPED, Recipe
from bayesdeg.surrogate.surrogate import map_of_rows
from bayesdeg.surrogate.trained import default_surrogate, surrogate_for

QUANTITIES = ("curvature", "bend_angle", "peak_stretch")
PRESSURES = np.linspace(0.0, 240.0, 25)
FRESH_AND_DEGRADED = ((0.3, 0.7, 1.5), (-0.15, -0.1, -0.15), (1e-2, 2e-2, 0.1))


@pytest.fixture(scope="module")
def shipped():
    return default_surrogate()


@pytest.fixture(scope="module")
def record(shipped):
    return json.loads(shipped.record)


def material(c1, softening, c3, pressure, *, volume_ratio=0.62, paper=3e4):
    c1, softening, c3 = (np.reshape(np.asarray(v, float), (-1, 1)) for v in (c1, softening, c3))
    return Inputs(
        pressure=np.asarray(pressure, float),
        c1=c1,
        c2=softening * np.sqrt(3.0 * c1 * c3),
        c3=c3,
        linear_scale=np.cbrt(np.array(volume_ratio)),
        paper_stiffness=np.array(paper),
    )


def arc_ratio(answer, inputs, length):
    """Deformed arc length over the moulded one times the scale."""
    arc = np.radians(answer.bend_angle) / answer.curvature * 1e3
    return arc / (length * inputs.linear_scale)


def test_it_is_of_the_default_geometry_recipe_and_model(shipped, record):
    assert record["model_version"] == MODEL_VERSION
    assert record["dimensions_mm"] == vars(Dimensions())
    assert record["coarse_mesh_mm"] == vars(Recipe().coarse_mesh)
    assert record["fine_mesh_mm"] == vars(Recipe().fine_mesh)
    assert record["seed"] == Recipe().seed
    assert "Sobol" in record["design"]
    counts = (Recipe().coarse_runs, Recipe().fine_runs)
    assert (record["coarse_curves"], record["fine_curves"]) == counts
    assert record["terms"] == len(shipped.terms.orders) + len(shipped.load.orders)
    assert shipped.length == Dimensions().length
    assert surrogate_for(Geometry(Dimensions())).record == shipped.record


def test_its_record_says_how_accurate_all_quantities_are(record):
    assert set(record["accuracy"]) == {*QUANTITIES, *MEASURES, "load"}
    for name, found in record["accuracy"].items():
        assert 0.0 < found["median_pct"] <= found["p95_pct"] <= found["max_pct"], name
        assert 0.0 < found["rms_pct"] <= found["max_pct"], name
    assert record["accuracy"]["curvature"]["median_pct"] < 0.5
    assert record["accuracy"]["load"]["median_pct"] < 0.25


def test_its_error_at_usual_materials_is_below_two_percent(shipped):
    answer = shipped(material(*FRESH_AND_DEGRADED, PRESSURES[1:13]))
    for sd, value in (
        (answer.sd, answer.curvature),
        (answer.bend_angle_sd, answer.bend_angle),
    ):
        assert np.all(sd > shipped.mesh_error * value)
        assert np.all(sd < 0.02 * value)


@pytest.mark.parametrize("field", [f.name for f in fields(Dimensions)])
def test_another_geometry_is_refused_and_the_dimension_named(field):
    value = getattr(Dimensions(), field)
    changed = replace(Dimensions(), **{field: value - 1 if field == "chambers" else value * 1.01})
    with pytest.raises(BayesdegError, match=rf"{field} = .*bayesdeg emulate"):
        surrogate_for(Geometry(changed))


@pytest.mark.fem
def test_it_agrees_with_a_curve_solved_on_the_coarse_mesh(shipped):
    """Within 3 % of the largest reading: so near nineteen in twenty coarse curves are to fine ones.

    The emulator stands for the fine mesh, on which a curve takes too long for a plain test.
    """
    inputs = material(0.7, -0.1, 2e-2, [40.0, 80.0, 120.0, 160.0])
    exact = ExactMap(Geometry(Dimensions()), Recipe().coarse_mesh)(inputs)
    answer = shipped(inputs)
    assert np.all(exact.status == 0)
    assert np.all(answer.status == 0)
    for name in ("curvature", "bend_angle"):
        got, want = getattr(answer, name), getattr(exact, name)
        np.testing.assert_allclose(got, want, rtol=0.0, atol=0.03 * want.max(), err_msg=name)


def test_curvature_rises_with_pressure_and_falls_with_stiffness(shipped):
    answer = shipped(material(*FRESH_AND_DEGRADED, PRESSURES[:13]))
    np.testing.assert_array_equal(answer.status, 0)
    assert np.all(answer.curvature[:, 0] == 0.0)
    assert np.all(np.diff(answer.curvature, axis=1) > 0.0)
    assert np.all(np.diff(answer.curvature[:, 1:], axis=0) < 0.0)
    assert np.all(np.diff(answer.peak_stretch, axis=1) > 0.0)


def test_degraded_material_reaches_the_largest_pressure(shipped):
    answer = shipped(material(*(v[2:] for v in FRESH_AND_DEGRADED), PRESSURES))
    np.testing.assert_array_equal(answer.status, 0)


def test_slope_is_its_derivative(shipped):
    inputs = material(*FRESH_AND_DEGRADED, PRESSURES[1:13])
    h = 1e-5
    up, down = (
        shipped(replace(inputs, pressure=inputs.pressure * np.exp(d))).curvature for d in (h, -h)
    )
    np.testing.assert_allclose(shipped(inputs).slope, (up - down) / (2.0 * h), rtol=1e-6)


def test_both_branches_of_a_cycle_are_mapped_once_and_equal_to_the_last_bit(shipped, monkeypatch):
    up = PRESSURES[1:13]
    cycle = np.concatenate([up, up[-2::-1]])
    loading = shipped.continued(material(*FRESH_AND_DEGRADED, up))
    asked = []

    def counted(loads, *others):
        asked.append(loads.shape[1])
        return map_of_rows(loads, *others)

    monkeypatch.setattr("bayesdeg.surrogate.surrogate.map_of_rows", counted)
    whole = shipped.continued(material(*FRESH_AND_DEGRADED, cycle))
    assert asked == [len(up)]
    for name in ("curvature", "bend_angle", "peak_stretch", "slope", "sd"):
        once, both = getattr(loading, name), getattr(whole, name)
        np.testing.assert_array_equal(both[:, : len(up)], once)
        np.testing.assert_array_equal(both[:, len(up) :], once[:, -2::-1])


def test_deformed_arc_length_is_that_of_the_scaled_part_to_a_quarter(shipped):
    inputs = material(*FRESH_AND_DEGRADED, PRESSURES[1:13])
    ratio = arc_ratio(shipped(inputs), inputs, shipped.length)
    assert np.all((ratio > 0.98) & (ratio < 1.25))


def test_stiffer_paper_keeps_the_bottom_line_nearer_to_its_length(shipped):
    """Of paper so soft that the line changes by 0.1 % and more."""
    soft, stiff = (material(0.3, -0.15, 1e-2, PRESSURES[4:11], paper=p) for p in (1e3, 1e5))
    changes = [np.abs(arc_ratio(shipped(i), i, shipped.length) - 1.0) for i in (soft, stiff)]
    assert np.all(changes[0] > changes[1])


def test_causes_at_their_neutral_values_change_nothing(shipped):
    inputs = material(*FRESH_AND_DEGRADED, PRESSURES[:13])
    zero = dict.fromkeys(
        ("second_invariant", "skin", "paper_slack", "paper_mismatch", "weight_along", "weight_up"),
        np.zeros(1),
    )
    spelt = replace(
        inputs, **zero, paper_thickness=np.full(1, 0.1), wall_factor=np.ones(1), erosion=np.zeros(1)
    )
    assert None not in {type(v) for n, v in vars(spelt).items() if n != "reference_pressure"}
    for field in fields(shipped(inputs)):
        plain, neutral = (getattr(shipped(i), field.name) for i in (inputs, spelt))
        if plain is None:  # it was not asked for
            assert neutral is None
            continue
        np.testing.assert_allclose(neutral, plain, rtol=1e-12, err_msg=field.name)


def test_a_skin_out_of_range_is_refused_and_named(shipped):
    inputs = material(0.7, -0.1, 2e-2, PRESSURES[1:8])
    assert shipped.refusals(replace(inputs, skin=np.full(1, 1.2))) == {}
    beyond = replace(inputs, skin=np.full(1, 1.3))
    answer = shipped(beyond)
    np.testing.assert_array_equal(answer.status, int(Status.OUTSIDE_TRAINING))
    assert np.all(np.isnan(answer.curvature))
    assert list(shipped.refusals(beyond)) == ["skin"]
    assert re.search(r"1\.3.* 0 to 1\.2", shipped.refusals(beyond)["skin"])


def test_its_file_is_plain_arrays_of_less_than_10_mb():
    path = SHIPPED
    assert len(path.read_bytes()) < 10e6
    with path.open("rb") as file:
        arrays = dict(np.load(file, allow_pickle=False))
    assert {"terms_orders", "error_orders", "load_orders", "load_error_orders", "record"} <= set(
        arrays
    )
    assert not any(array.dtype.hasobject for array in arrays.values())
