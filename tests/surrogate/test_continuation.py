"""Outside its range the emulator leads the likelihood back inside, and predicts nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs, continuation
from bayesdeg.actuator.status import Status
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.laplace import find_mode
from bayesdeg.inference.model import least_squares
from bayesdeg.observations.curvature import Curvature
from bayesdeg.surrogate.surrogate import OUTSIDE_BY
from bayesdeg.surrogate.trained import default_surrogate

EMULATOR = default_surrogate()
STUDY = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"


def inputs(pressure, c1=0.288, **more):
    one = np.ones(1)
    material = (c1 * one, -0.004 * one, 0.0012 * one)
    return replace(Inputs(np.asarray(pressure, float), *material, 0.853 * one, 3e4 * one), **more)


def limit():
    """The largest pressure that is answered, found by bisection [kPa]."""
    low, high = 200.0, 400.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        inside = EMULATOR(inputs([middle])).status[0] == 0
        low, high = (middle, high) if inside else (low, middle)
    return low


def test_inside_it_is_the_emulator_itself():
    given = inputs(np.linspace(0.0, 240.0, 13))
    plain, beyond = EMULATOR(given), EMULATOR.continued(given)
    assert np.all(plain.status == 0)
    for name in ("curvature", "bend_angle", "peak_stretch", "slope", "sd", "status"):
        np.testing.assert_array_equal(getattr(beyond, name), getattr(plain, name))
    np.testing.assert_array_equal(beyond.excess, 0.0)


def test_curves_go_on_along_their_tangent_and_the_excess_grows_from_zero():
    edge = limit()
    ratio = np.array([1.0 - 1e-6, 1.0 + 1e-6, 1.02, 1.2])
    assert np.isnan(EMULATOR(inputs(edge * ratio)).curvature[1:]).all()
    found = EMULATOR.continued(inputs(edge * ratio))
    assert found.curvature[1] == pytest.approx(found.curvature[0], rel=1e-4)
    tangent = found.curvature[1] + found.slope[1] * np.log(ratio)
    np.testing.assert_allclose(found.curvature[2:], tangent[2:], rtol=1e-4)
    np.testing.assert_allclose(found.excess[2:], np.log(ratio[2:]) / OUTSIDE_BY, rtol=1e-3)
    assert found.excess[0] == 0.0
    assert np.all(found.status[1:] == int(Status.OUTSIDE_TRAINING))


def test_a_group_outside_is_put_on_the_end_of_its_range_and_adds_to_the_excess():
    inner, outer = (
        EMULATOR.continued(inputs([100.0], erosion=np.full(1, 0.853 * thickness)))
        for thickness in (0.4, 0.44)  # trained up to 0.4 mm
    )
    np.testing.assert_allclose(outer.curvature, inner.curvature, rtol=1e-9)
    assert inner.excess[0] == pytest.approx(0.0, abs=1e-6)
    assert outer.excess[0] == pytest.approx(0.04 / 0.4 / OUTSIDE_BY, rel=1e-6)


def test_readings_from_a_reference_pressure_go_on_too():
    reference = np.full(1, 10.0)
    found = EMULATOR.continued(inputs([100.0, 1.1 * limit()], reference_pressure=reference))
    plain = EMULATOR(inputs([100.0, 1.1 * limit()], reference_pressure=reference))
    assert found.curvature[0] == plain.curvature[0]
    assert np.isnan(plain.curvature[1])
    assert np.isfinite(found.curvature[1])
    assert found.excess[1] > 5.0


def test_what_is_no_material_has_no_continuation():
    assert np.isnan(EMULATOR.continued(inputs([100.0], c1=-1.0)).curvature).all()


def test_a_map_that_does_not_go_on_is_its_own_continuation():
    assert continuation(EMULATOR)(inputs([100.0])).excess is not None

    def forward(given):
        return EMULATOR(given)

    assert continuation(forward) is forward


@pytest.mark.slow
def test_the_search_of_a_mode_finds_its_way_back_inside():
    """Started where the softest actuators balloon below the highest pressures that were read."""
    model = assemble(read_study(STUDY)).model
    start = least_squares(model)
    inside, _ = find_mode(model, start)
    soft = start.copy()
    soft[model.table.names.index("c1_at_0")] -= 0.45
    at = model.table.named(soft[None])
    assert np.isnan(
        model.data_of(Curvature)
        .predicted(model.tests(at))
        .prediction.curvature[:, model.data_of(Curvature).tests.mask]
    ).any()
    assert np.isfinite(model.log_prob(soft[None])[0])
    # at the most probable deviations of the specimens, which bring them inside
    assert model.data_of(Curvature).range_excess(model.state(at)).max() == 0.0
    soft[model.table.names.index("c1_at_0")] -= 2.0
    assert (
        model.data_of(Curvature).range_excess(model.state(model.table.named(soft[None]))).max()
        > 1.0
    )
    found, _ = find_mode(model, soft)
    assert model.log_prob(found[None])[0] == pytest.approx(model.log_prob(inside[None])[0], abs=0.1)
    assert (
        model.data_of(Curvature).range_excess(model.state(model.table.named(found[None]))).max()
        == 0.0
    )
    assert np.all(
        np.isfinite(
            model.data_of(Curvature)
            .predicted(model.tests(model.table.named(found[None])))
            .mean[:, model.data_of(Curvature).tests.paths.mask]
        )
    )
