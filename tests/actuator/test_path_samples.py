"""What an emulator learns from: readings and derivatives where a path stopped by itself."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator import curve
from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Backend, PathEffort, Status
from bayesdeg.data.settings import Dimensions

pytestmark = pytest.mark.fem

LOADS = (0.1, 0.3, 0.5)
SMOOTH = [name for name in OUTPUTS if not name.startswith("peak")]  # all but quantiles


@pytest.fixture(scope="module")
def material(every_effect):
    return replace(every_effect, paper_slack=0.0, wall_factor=1.04, erosion=0.06)


@pytest.fixture(scope="module")
def sampled(two_chambers, material):
    return two_chambers.sample(Curve(LOADS, material))


def test_samples_begin_at_rest_and_end_at_the_last_load(sampled):
    assert sampled.status is Status.CONVERGED
    assert sampled.loads[0] == 0.0
    assert sampled.loads[-1] == LOADS[-1]
    assert np.all(np.diff(sampled.loads) > 0.0)
    assert sampled.readings.shape == (len(sampled.loads), len(OUTPUTS))
    assert sampled.gradients.shape == (len(sampled.loads), len(OUTPUTS), len(INPUTS))


def test_samples_are_equilibria_and_their_derivatives(two_chambers, material, sampled):
    """Against the same loads solved to a tolerance of 1e-6, adjoints to 1e-8."""
    curve = Curve(tuple(sampled.loads[1:].tolist()), material)
    solution, gradients = two_chambers.solve_with_gradients(curve)
    error = np.abs(sampled.readings[1:] / solution.readings - 1.0).max()
    size = np.abs(gradients).max(axis=0)
    wrong = np.abs(sampled.gradients[1:] - gradients) / size
    smooth = wrong[:, [OUTPUTS.index(name) for name in SMOOTH]].max()
    print(f"readings within {error:.1e}, derivatives within {smooth:.1e} of their largest")
    assert error < 1e-4
    assert smooth < 1e-3


def test_a_path_without_time_is_given_up_with_a_status(two_chambers, fresh):
    curve = Curve(LOADS, fresh)
    assert two_chambers.solve(curve, effort=PathEffort(seconds=0.0)).status is Status.TIMED_OUT
    timed_out = two_chambers.sample(curve, effort=PathEffort(seconds=0.0))
    assert timed_out.status is Status.TIMED_OUT
    assert "time" in timed_out.status.advice


@pytest.mark.parametrize("mismatch", [0.02, -0.02])
def test_a_mismatch_is_raised_in_few_steps(two_chambers, fresh, mismatch):
    """Each step from the polynomial through the last states; steps of a fixed size took 145."""
    solution = two_chambers.solve(Curve(LOADS, replace(fresh, paper_mismatch=mismatch)))
    print(f"{solution.iterations} factorizations at a mismatch of {mismatch}")
    assert solution.status is Status.CONVERGED
    assert solution.iterations <= 40


def test_where_a_shape_cannot_vary_its_derivatives_are_not_known(fresh):
    """With the channel as high as the chambers' top, another wall is another topology."""
    flat = Dimensions(length=20.0, chambers=2, channel_height=6.0, channel_roof=1.0, gap=0.0)
    found = curve.sample_task((Geometry(flat), Resolution(6.0, 5.0, 5.0), Curve((0.05,), fresh)))
    assert found.status is Status.CONVERGED
    walls = found.gradients[:, :, INPUTS.index("wall_factor")]
    assert np.all(np.isnan(walls))
    assert np.all(np.isfinite(found.gradients[:, :, : INPUTS.index("wall_factor")]))


def test_a_process_holds_few_meshes_and_closes_the_others(fresh, monkeypatch):
    closed = []
    monkeypatch.setattr(curve, "_HELD", {})
    monkeypatch.setattr(curve.Actuator, "close", lambda self: closed.append(self))
    sizes = [Resolution(6.0 + k, 5.0, 5.0) for k in range(curve.MESHES + 2)]
    geometry = Geometry(Dimensions(length=20.0, chambers=2))
    rest = (Backend.KERNELS, False, None)
    actuators = [curve._actuator(geometry, size, *rest) for size in sizes]
    assert closed == actuators[:2]
    assert curve._actuator(geometry, sizes[-1], *rest) is actuators[-1]
