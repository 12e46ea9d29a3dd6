"""The pressure for a wanted curvature, against forward maps whose inverse is known."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import kstest, norm

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.status import Status
from bayesdeg.inference.sampling import Chain
from bayesdeg.prediction.control import (
    largest_allowed,
    needed_by,
    needed_pressure,
    setting_for,
)
from bayesdeg.prediction.predictive import draw_specimens, finer, respond
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.laboratory.linear_actuator import LinearActuator

C1 = TRUTH["c1_at_0"]
SCALE = np.cbrt(TRUTH["volume_ratio"])
FIRST = 140.0
STILL = 1e-9  # of a scatter that has no effect


@dataclass(frozen=True)
class StraightLine:
    """Curvature 40 p/C1 over the scale, stretch 1 + p/C1, up to a largest p/C1."""

    limit: float = np.inf

    def __call__(self, inputs: Inputs) -> Prediction:
        load = inputs.pressure / (1e3 * inputs.c1)
        curvature = 40.0 * load / inputs.linear_scale
        nothing = np.zeros(curvature.shape)
        there = np.broadcast_to(load <= self.limit, curvature.shape)
        return Prediction(
            curvature=np.where(there, curvature, np.nan),
            bend_angle=np.where(there, curvature, np.nan),
            peak_stretch=np.where(there, 1.0 + load, np.nan),
            slope=np.where(there, curvature, np.nan),
            sd=nothing,
            bend_angle_sd=nothing,
            peak_stretch_sd=nothing,
            status=np.where(there, 0, int(Status.LIMIT_POINT)),
        )


def specimens_of(forward=None, *, draws=20, strata=6, **changes):
    """Specimens of a posterior without width."""
    model = altered(small_model(), forward=forward or StraightLine())
    if changes.pop("unknown_strength", False):
        base = tuple(p for p in model.base if not p.name.startswith("elongation"))
        model = altered(model, base=base)
    truth = {n: v for n, v in (TRUTH | changes).items() if n in model.table.names}
    vectors = model.table.vectors(values_of(truth, 10))[None, :, None]
    chain = Chain(vectors, np.zeros((1, 10, 1)), np.ones(1))
    return draw_specimens(model, chain, np.random.default_rng(4), draws=draws, strata=strata)


def setting(specimens, wanted=5.0, risk=0.05, degradation=0.0):
    return setting_for(specimens, degradation, wanted, risk=risk, first=FIRST)


def straight_pressure(wanted):
    """κ = 40 p/(C1 s), solved for p [kPa]."""
    return 1e3 * C1 * SCALE * wanted / 40.0


def test_a_curve_is_inverted_as_numpy_interpolates():
    pressure = np.linspace(0.0, 200.0, 21)
    curves = np.array([[0.1], [0.2]]) * pressure + np.array([[1e-4], [0.0]]) * pressure**2
    found = needed_pressure(pressure, curves, 7.3)
    assert found == pytest.approx([np.interp(7.3, curve, pressure) for curve in curves])


def test_the_lowest_pressure_counts_after_a_dead_band_and_before_the_end_of_a_curve():
    pressure = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    curves = np.array(
        [
            [0.0, 0.0, 0.0, 4.0, 8.0],  # nothing happens at first
            [0.0, 4.0, 3.0, 6.0, 9.0],  # falls in between
            [0.0, 2.0, 4.0, np.nan, np.nan],  # ends after
            [0.0, 1.0, np.nan, np.nan, np.nan],  # ends before
        ]
    )
    found = needed_pressure(pressure, curves, 3.0)
    assert found.tolist() == [27.5, 7.5, 15.0, np.inf]


@pytest.mark.parametrize("wanted", [0.5, 5.0, 17.0, 60.0])
def test_the_pressure_is_exact_where_curvature_is_proportional_to_it(wanted):
    """Also where more pressure is needed than was tried first."""
    found = setting(specimens_of(stiffness_scatter=STILL), wanted, risk=0.999)
    assert found.reached
    assert found.pressure == pytest.approx(straight_pressure(wanted), rel=1e-6)
    assert found.needed == pytest.approx(np.full(3, straight_pressure(wanted)), rel=1e-6)
    assert found.curvature == pytest.approx(np.full(5, wanted), rel=1e-6)


def test_the_pressure_of_a_curved_law_solves_its_equation():
    """20 q (1 + q)/s = κ."""
    wanted = 9.0
    q = 0.5 * (np.sqrt(1.0 + 4.0 * wanted * SCALE / 20.0) - 1.0)
    found = setting(specimens_of(LinearActuator(), stiffness_scatter=STILL), wanted, risk=0.999)
    assert found.pressure == pytest.approx(1e3 * C1 * q, rel=1e-5)


def test_specimens_scatter_about_the_pressure_as_their_stiffness_does():
    """p = p₀ e^{σ z}: a log-normal law of pressures, and of curvatures at the median."""
    sigma, wanted = 0.08, 5.0
    specimens = specimens_of(draws=400, strata=10, stiffness_scatter=sigma)
    found = setting(specimens, wanted, risk=0.999)
    spread = np.exp(sigma * norm.ppf([0.05, 0.5, 0.95]))
    assert found.needed == pytest.approx(straight_pressure(wanted) * spread, rel=3e-3)
    five = np.exp(sigma * norm.ppf([0.05, 0.25, 0.5, 0.75, 0.95]))
    assert found.curvature == pytest.approx(wanted * five, rel=3e-3)


def test_scores_of_specimens_follow_the_normal_law():
    specimens = specimens_of(draws=300, strata=8)
    assert kstest(specimens.score, "norm").pvalue > 0.2
    assert np.std(specimens.score) == pytest.approx(1.0, abs=0.01)
    more = finer(specimens, 50)
    assert len(more.score) == 300 * 50
    assert np.std(more.score) == pytest.approx(1.0, abs=0.02)
    assert all(len(v) == 300 * 50 for v in more.values.values())


def test_the_probability_of_rupture_is_that_of_both_scatters_together():
    """Λ − 1 = p/C1 e^{−σ z} against ε e^{s z'}: P = Φ(ln(p/(C1 ε))/√(σ² + s²))."""
    sigma, s, epsilon = 0.08, 0.12, 0.25
    specimens = specimens_of(
        draws=400,
        strata=10,
        stiffness_scatter=sigma,
        elongation_at_0=100.0 * epsilon,
        elongation_scatter=s,
    )
    pressure = np.array([60.0, 70.0, 75.0, 80.0, 90.0])
    expected = norm.cdf(np.log(pressure / (1e3 * C1 * epsilon)) / np.hypot(sigma, s))
    answer = respond(specimens, 0.0, pressure)
    assert answer.burst.mean(axis=0) == pytest.approx(expected, abs=2e-3)
    assert np.all(answer.answered == 1.0)


@pytest.mark.parametrize("risk", [0.001, 0.05, 0.3])
def test_the_pressure_allowed_is_where_the_probability_of_rupture_is_the_risk(risk):
    s, epsilon = 0.12, 0.25
    changes = {"elongation_at_0": 100.0 * epsilon, "elongation_scatter": s}
    specimens = specimens_of(stiffness_scatter=STILL, **changes)
    allowed = largest_allowed(specimens, 0.0, risk, first=FIRST)
    expected = 1e3 * C1 * epsilon * np.exp(s * norm.ppf(risk))
    assert allowed.pressure == pytest.approx(expected, rel=1e-4)
    assert allowed.by_rupture
    assert allowed.found
    after = allowed.pressure + FIRST / 2**14
    at, beyond = respond(specimens, 0.0, np.array([allowed.pressure, after])).burst.mean(axis=0)
    assert at <= risk < beyond


def test_more_risk_never_allows_less_pressure():
    specimens = specimens_of(stiffness_scatter=0.08, elongation_at_0=25.0, draws=100)
    risks = [0.001, 0.01, 0.05, 0.2, 0.5, 0.9]
    allowed = [largest_allowed(specimens, 0.0, risk, first=FIRST).pressure for risk in risks]
    assert np.all(np.diff(allowed) > 0.0)


def test_what_is_out_of_reach_at_a_risk_gives_the_largest_pressure_allowed():
    s, epsilon, risk = 0.12, 0.25, 0.05
    changes = {"elongation_at_0": 100.0 * epsilon, "elongation_scatter": s}
    specimens = specimens_of(stiffness_scatter=STILL, **changes)
    best = 1e3 * C1 * epsilon * np.exp(s * norm.ppf(risk))
    found = setting(specimens, 20.0, risk)
    assert not found.reached
    assert found.pressure == pytest.approx(best, rel=1e-4)
    assert found.needed[1] == pytest.approx(straight_pressure(20.0), rel=1e-6)
    assert found.curvature[2] == pytest.approx(40.0 * best / (1e3 * C1 * SCALE), rel=1e-4)
    assert found.probability[0] == pytest.approx(risk, rel=1e-2)
    assert found.probability[0] <= risk
    # with more risk the same curvature is reached
    assert setting(specimens, 20.0, 0.999999).reached


def test_specimens_that_balloon_count_as_burst():
    """Those softer than p/(C1 q_max): P = Φ(ln(p/(C1 q_max))/σ)."""
    sigma, limit, risk = 0.08, 0.3, 0.1
    specimens = specimens_of(StraightLine(limit), draws=2000, strata=10, stiffness_scatter=sigma)
    allowed = largest_allowed(specimens, 0.0, risk, first=FIRST)
    expected = 1e3 * C1 * limit * np.exp(sigma * norm.ppf(risk))
    assert allowed.pressure == pytest.approx(expected, rel=2e-3)
    assert not allowed.by_rupture
    found = setting(specimens, 500.0, risk)
    assert np.all(np.isinf(found.needed))
    assert found.pressure == allowed.pressure
    assert np.isfinite(found.curvature[2])
    # a tenth balloons: the largest of twenty has no curvature
    assert np.isinf(found.curvature[4])


def test_ballooning_bounds_the_risk_where_nothing_is_known_of_rupture():
    specimens = specimens_of(StraightLine(0.3), stiffness_scatter=STILL, unknown_strength=True)
    found = setting(specimens, 5.0)
    assert found.allowed.pressure == pytest.approx(1e3 * C1 * 0.3, rel=1e-4)
    assert found.reached
    assert np.all(np.isnan(found.probability))


def test_an_actuator_that_nothing_bounds_is_said_to_have_no_end():
    specimens = specimens_of(stiffness_scatter=STILL, unknown_strength=True)
    allowed = largest_allowed(specimens, 0.0, 0.05, first=FIRST)
    assert not allowed.found
    assert allowed.pressure == FIRST * 2**6


def test_no_pressure_is_set_where_the_map_has_no_answer_at_all():
    found = setting(specimens_of(StraightLine(-1.0)), 5.0)
    assert not found.reached
    assert np.isnan(found.pressure)
    assert np.all(np.isnan(found.curvature))


def test_a_stiffer_material_needs_more_pressure():
    specimens = specimens_of(stiffness_scatter=STILL)
    pressures = [setting(specimens, 5.0, 0.999, level).pressure for level in (0.0, 10.0, 25.0)]
    assert np.all(np.diff(pressures) > 0.0)
    assert pressures[2] == pytest.approx(straight_pressure(5.0) * TRUTH["c1_at_25"] / C1, rel=1e-6)


def test_the_same_specimens_need_the_same_pressures():
    specimens = specimens_of(stiffness_scatter=0.05)
    one, other = (needed_by(specimens, 10.0, 5.0, first=FIRST) for _ in range(2))
    assert np.array_equal(one, other)


@pytest.mark.parametrize(("wanted", "risk"), [(0.0, 0.05), (-3.0, 0.05), (5.0, 0.0), (5.0, 1.0)])
def test_what_makes_no_sense_is_refused(wanted, risk):
    with pytest.raises(ValueError, match="above 0"):
        setting(specimens_of(), wanted, risk)


@pytest.mark.parametrize("ceiling", [0.0, 30.0, 100.0, 5000.0])
@pytest.mark.parametrize("risk", [0.01, 0.5])
def test_a_ceiling_ends_what_the_risk_allows_and_nothing_else(ceiling, risk):
    specimens = specimens_of(elongation_at_0=40.0, elongation_scatter=0.2)
    free = largest_allowed(specimens, 0.0, risk, first=FIRST)
    found = largest_allowed(specimens, 0.0, risk, first=FIRST, ceiling=ceiling)
    assert found.pressure == pytest.approx(min(free.pressure, ceiling), rel=1e-3)
    assert found.by_test == (ceiling < free.pressure)
    assert found.by_rupture == (free.by_rupture and not found.by_test)
