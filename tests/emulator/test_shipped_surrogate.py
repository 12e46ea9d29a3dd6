"""The emulator that ships with the package."""

import json
from dataclasses import fields, replace
from importlib.resources import files

import numpy as np
import pytest

from bayesdeg.actuator.curve import MODEL_VERSION
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.trained import SHIPPED, default_surrogate, surrogate_for
from bayesdeg.errors import BayesdegError
from bayesdeg.measure.settings import Dimensions


@pytest.fixture(scope="module")
def shipped():
    return default_surrogate()


def material(c1, c2_ratio, c3, pressure, *, volume_ratio=0.62, paper=3e4):
    c1, c2_ratio, c3 = (np.reshape(np.asarray(v, float), (-1, 1)) for v in (c1, c2_ratio, c3))
    return Inputs(
        pressure=np.asarray(pressure, float),
        c1=c1,
        c2=c2_ratio * np.sqrt(3.0 * c1 * c3),
        c3=c3,
        linear_scale=np.cbrt(np.array(volume_ratio)),
        paper_stiffness=np.array(paper),
    )


PRESSURES = np.linspace(0.0, 240.0, 25)
FRESH_AND_DEGRADED = ((0.3, 0.7, 1.5), (-0.15, -0.1, -0.15), (1e-2, 2e-2, 0.1))


def test_it_is_of_the_default_geometry_and_the_present_model(shipped):
    record = json.loads(shipped.record)
    assert record["dimensions_mm"] == vars(Dimensions())
    assert record["model_version"] == MODEL_VERSION
    assert shipped.length == Dimensions().length
    assert surrogate_for(Geometry(Dimensions())).record == shipped.record


@pytest.mark.parametrize("field", [f.name for f in fields(Dimensions)])
def test_another_geometry_is_refused_and_the_dimension_named(field):
    value = getattr(Dimensions(), field)
    changed = replace(Dimensions(), **{field: value - 1 if field == "chambers" else value * 1.01})
    with pytest.raises(BayesdegError, match=rf"{field} = .*bayesdeg emulate"):
        surrogate_for(Geometry(changed))


def test_its_record_promises_an_error_below_a_percent(shipped):
    record = json.loads(shipped.record)
    assert record["left_out_rms_pct"] < 1.0
    assert np.all(shipped.error < 0.02)
    assert np.all(shipped.error > 0.0)


def test_curvature_rises_with_pressure_and_falls_with_stiffness(shipped):
    answer = shipped(material(*FRESH_AND_DEGRADED, PRESSURES[:13]))
    np.testing.assert_array_equal(answer.status, 0)
    assert np.all(answer.curvature[:, 0] == 0.0)
    assert np.all(np.diff(answer.curvature, axis=1) > 0.0)
    assert np.all(np.diff(answer.curvature[:, 1:], axis=0) < 0.0)
    assert np.all(answer.peak_stretch[:, 1:] > 1.0)
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


def test_bend_angle_is_curvature_times_arc_length(shipped):
    """A deformed arc length between moulded length times scale and a quarter more."""
    inputs = material(*FRESH_AND_DEGRADED, PRESSURES[1:13])
    answer = shipped(inputs)
    arc = np.radians(answer.bend_angle) / answer.curvature * 1e3
    ratio = arc / (shipped.length * inputs.linear_scale)
    assert np.all((ratio > 0.98) & (ratio < 1.25))


def test_stiffer_paper_keeps_the_bottom_line_nearer_to_its_length(shipped):
    changes = []
    for paper in (1e4, 1e5):
        inputs = material(0.7, -0.1, 2e-2, PRESSURES[1:8], paper=paper)
        answer = shipped(inputs)
        arc = np.radians(answer.bend_angle) / answer.curvature * 1e3
        changes.append(np.abs(arc / (shipped.length * inputs.linear_scale) - 1.0))
    assert np.all(changes[0] > changes[1])


def test_its_file_is_plain_arrays():
    with (files("bayesdeg.emulator") / SHIPPED).open("rb") as file:
        assert all(
            not array.dtype.hasobject for array in np.load(file, allow_pickle=False).values()
        )
