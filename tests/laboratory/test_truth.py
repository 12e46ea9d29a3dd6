"""The truth: agreement with what was published, and truths drawn about it."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.data.moisture import saturating
from bayesdeg.laboratory.truth import TRUTH_NODES, Truth, drawn_truth
from bayesdeg.observations.curvature import BEND_ANGLE, actuator_parameters
from bayesdeg.observations.specimens import elongation_parameters, material_parameters
from bayesdeg.observations.tensile import TENSILE


def test_the_reference_agrees_with_the_published_statistics():
    truth = Truth()
    modulus = 6.0 * truth.constants([0.0, 25.0])[:, 0]
    assert modulus[0] == pytest.approx(1.73, abs=0.01)
    assert modulus[1] / modulus[0] == pytest.approx(5.5, abs=0.05)
    elongation = 100.0 * (truth.limit_stretch([0.0, 12.5, 25.0]) - 1.0)
    np.testing.assert_allclose(elongation, [209.8, 105.0, 52.0])
    assert truth.volume_ratio == 0.62
    assert saturating(np.array([24.0]), truth.degradation_limit, truth.time_constant)[0] == (
        pytest.approx(25.0, abs=0.1)
    )
    assert truth.is_stable()


def test_constants_at_the_nodes_are_those_given():
    truth = Truth()
    constants = truth.constants(TRUTH_NODES)
    np.testing.assert_allclose(constants[:, 0], truth.c1)
    np.testing.assert_allclose(constants[:, 2], truth.c3)
    ratio = constants[:, 1] / np.sqrt(3.0 * constants[:, 0] * constants[:, 2])
    np.testing.assert_allclose(ratio, truth.c2_ratio)


def test_values_carry_the_names_of_the_parameters_that_are_calibrated():
    """But for control values between the ends: what is true there is the value itself."""
    named = Truth().named()
    material = {p.name for p in material_parameters(TRUTH_NODES)}
    controls = {name for name in material if "_control_" in name}
    assert controls == {f"{name}_control_12_5" for name in ("c1", "c2_ratio", "c3")}
    others = (
        *elongation_parameters(TRUTH_NODES),
        *actuator_parameters(240.0),
        *BEND_ANGLE,
        *TENSILE,
    )
    assert (material - controls) | {p.name for p in others} <= set(named)
    assert {name.replace("control", "at") for name in controls} <= set(named)
    assert named["c2_ratio_at_25"] == -0.20
    assert all(isinstance(value, float) for value in named.values())


def test_drawn_truths_scatter_about_the_reference_as_stated():
    generator = np.random.default_rng(11)
    drawn = [drawn_truth(generator) for _ in range(1500)]
    centre = Truth()
    wanted = {"c1": 0.15, "c3": (0.25, 0.21, 0.21), "paper_stiffness": 0.4}
    shift = {"c3": (0.0, 0.12, -0.11)}  # of what is drawn anew: its trend would leave the range
    for name, sd in wanted.items():
        z = np.log([getattr(t, name) for t in drawn]) - np.log(getattr(centre, name))
        np.testing.assert_allclose(z.std(axis=0), sd, rtol=0.1)
        moved = z.mean(axis=0) - shift.get(name, 0.0)
        np.testing.assert_allclose(moved, 0.0, atol=4.0 * np.max(sd) / np.sqrt(1500))
    for name, sd in {"c2_ratio": 0.05, "volume_ratio": 0.04}.items():
        z = np.array([getattr(t, name) for t in drawn]) - np.array(getattr(centre, name))
        np.testing.assert_allclose(z.std(axis=0), sd, rtol=0.1)
    assert all(t.is_stable() and t.is_within_trends() for t in drawn)
    assert len({t.c1 for t in drawn}) == 1500


def test_a_trend_within_the_range_has_positive_bernstein_coefficients_through_the_nodes():
    assert Truth().is_within_trends()
    sagging = replace(Truth(), c2_ratio=(0.0, 0.0, 0.0), c3=(0.003, 0.027, 0.1175))
    assert sagging.is_stable()
    assert not sagging.is_within_trends()
    assert 2.0 * sagging.c3[1] < 0.5 * (sagging.c3[0] + sagging.c3[2])


def test_unstable_truths_are_drawn_anew():
    class Wild:
        """Deviations so large that the material is unstable, then none."""

        calls = 0

        def standard_normal(self, size):
            self.calls += 1
            z = np.zeros(size)
            if self.calls == 1:
                z[3:6] = -30.0
            return z

    generator = Wild()
    assert drawn_truth(generator) == Truth()
    assert generator.calls == 2
