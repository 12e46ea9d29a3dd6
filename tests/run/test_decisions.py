"""Decisions before and after: held against an actuator whose inverse is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.tables import DECISIONS, TABLES
from bayesdeg.run.writing import RISK, decisions
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.laboratory.linear_actuator import LinearActuator, curvature_by_hand

LEVELS = [0.0, 5.2, 14.0, 24.0]
LARGEST = np.array([8.0, 6.0, 3.0, 1.0])  # curvature measured at each level [1/m]
STILL = 1e-9  # of a scatter that has no effect
SCALE = np.cbrt(TRUTH["volume_ratio"])


def model_of(forward=None, largest=LARGEST):
    """Five actuators, two of them without degradation, with readings of these largest ones."""
    model = small_model()
    top = np.asarray(largest)[[0, 0, 1, 2, 3]]
    top[0] *= 0.5  # its fellow of the same level bends more
    curvature = top[:, None] * np.linspace(0.1, 1.0, 7) ** 2
    curvature[4, 4] = top[4]  # of the readings that there are
    data = replace(model.data_of(Curvature).tests, curvature=curvature)
    assert not data.mask[4, 5:].any()
    data.curvature[4, 5:] = 99.0  # after the rupture: not readings
    return altered(model, forward=forward or LinearActuator(), actuator=data)


def fit_of(model, **changes):
    """A posterior without width."""
    truth = TRUTH | {"stiffness_scatter": STILL} | changes
    vectors = model.table.vectors(values_of({n: truth[n] for n in model.table.names}, 10))
    return SimpleNamespace(
        model=model, chain=Chain(vectors[None, :, None], np.zeros((1, 10, 1)), np.ones(1))
    )


def decided(**fits):
    return decisions(fits, np.random.default_rng(3))


def constant(model, level, **changes):
    """C1 at a level [MPa]."""
    return model.world.constants(values_of(TRUTH | changes), np.array([level]))[0, 0, 0]


def load(wanted):
    """q = p/C1 of 20 q (1 + q)/s = κ."""
    return 0.5 * (np.sqrt(1.0 + 4.0 * wanted * SCALE / 20.0) - 1.0)


def test_half_of_the_largest_curvature_read_at_each_level_is_wanted():
    table = decided(base=fit_of(model_of()))
    assert table["degradation_pct"].tolist() == LEVELS
    assert table["wanted_per_m"].tolist() == (0.5 * LARGEST).tolist()
    assert set(table.columns) == set(TABLES[DECISIONS].headings)


def test_a_wanted_curvature_is_told_in_three_digits():
    table = decided(base=fit_of(model_of(largest=[7.77777, 6.0, 3.0, 1.0])))
    assert table["wanted_per_m"][0] == 3.89


def test_pressures_solve_the_equation_of_each_model():
    model = model_of()
    table = decided(base=fit_of(model), **{"base+erosion": fit_of(model, c1_at_0=0.36)})
    assert table["model"].tolist() == ["base"] * 4 + ["base+erosion"] * 4
    for (_, row), c1_at_0 in zip(table.iterrows(), np.repeat([0.3, 0.36], 4), strict=True):
        c1 = constant(model, row["degradation_pct"], c1_at_0=c1_at_0)
        needed = row["needed_q50_kPa"]
        assert needed == pytest.approx(1e3 * c1 * load(row["wanted_per_m"]), rel=1e-5)
        bent = curvature_by_hand(needed, c1, TRUTH["volume_ratio"])
        assert bent == pytest.approx(row["wanted_per_m"], rel=1e-5)
        assert row["needed_q05_kPa"] == pytest.approx(needed, rel=1e-6)


def test_new_specimens_scatter_as_their_stiffness_does():
    sigma = 0.08
    row = decided(base=fit_of(model_of(), stiffness_scatter=sigma)).iloc[0]
    spread = np.exp(sigma * norm.ppf([0.05, 0.95]))
    found = row[["needed_q05_kPa", "needed_q95_kPa"]].to_numpy(float)
    # 1800 specimens
    assert found / row["needed_q50_kPa"] == pytest.approx(spread, rel=0.01)


def test_the_probability_is_that_of_the_pressure_needed_even_where_it_is_not_allowed():
    """Λ − 1 = q against ε e^{s z}: P = Φ(ln(q/ε)/s), and q = ε e^{s Φ⁻¹(risk)} is allowed."""
    s, q = 0.12, load(0.5 * LARGEST[0])
    epsilon = q * 1.02
    fit = fit_of(model_of(), elongation_at_0=100.0 * epsilon, elongation_scatter=s)
    row = decided(base=fit).iloc[0]
    c1 = 1e3 * TRUTH["c1_at_0"]
    assert row["allowed_kPa"] == pytest.approx(c1 * epsilon * np.exp(s * norm.ppf(RISK)), rel=1e-4)
    assert row["allowed_kPa"] < 0.9 * row["needed_q50_kPa"]
    assert row["probability"] == pytest.approx(norm.cdf(np.log(q / epsilon) / s), abs=1e-4)
    assert row["probability"] > 5.0 * RISK


def test_a_curvature_that_is_never_reached_has_no_pressure_and_no_probability():
    row = decided(base=fit_of(model_of(LinearActuator(limit=0.5 * load(4.0))))).iloc[0]
    assert row[["needed_q05_kPa", "needed_q50_kPa", "needed_q95_kPa"]].isna().all()
    assert np.isnan(row["probability"])
    assert row["allowed_kPa"] > 0.0


def test_a_level_at_which_nothing_bent_has_no_row():
    table = decided(base=fit_of(model_of(largest=[8.0, 0.0, 3.0, 1.0])))
    assert table["degradation_pct"].tolist() == [0.0, 14.0, 24.0]
