"""Where most of a misfit sits, on made-up readings of twelve actuators of known covariance."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from bayesdeg.criticism.checks.discrepancy import discrepancies, largest_ratio
from bayesdeg.criticism.checks.residuals import (
    MORE,
    MOST,
    RARE,
    concentration,
)
from bayesdeg.criticism.fit.linear import Linear, Whitening
from bayesdeg.observations.kinds import Places

LEVELS = np.repeat([0.0, 8.0, 16.0, 24.0], 3)
UP = np.array([40.0, 80.0, 120.0, 160.0, 160.0])  # held at the top
SCALE, NOISE = 0.03, 0.01


@cache
def readings_of_actuators():
    """Two cycles of loading with a hold, and unloading, of each specimen."""
    rows = []
    for i, level in enumerate(LEVELS):
        for cycle in (1, 2):
            rows += [(f"s{i}", level, p, f"loading {cycle} horizontal") for p in UP]
            rows += [(f"s{i}", level, p, f"unloading {cycle} horizontal") for p in UP[3::-1]]
    specimen, level, pressure, history = (np.array(column) for column in zip(*rows, strict=True))
    count = len(rows)
    return Places(
        np.full(count, "curvature"),
        np.full(count, "actuator"),
        pressure,
        level,
        specimen,
        history,
        np.full(count, np.nan),
    )


@cache
def model():
    """Curvature in proportion to pressure; its level is not known, nor is that of a specimen."""
    places = readings_of_actuators()
    mean = 0.1 * places.along
    same = places.specimen[:, None] == places.specimen
    scatter = np.outer(mean, mean) * (SCALE**2 * same + NOISE**2 * np.eye(len(mean)))
    jacobian = mean[:, None]
    whitening = Whitening.of(scatter, 0.2 * jacobian)
    subject = SimpleNamespace(places=places, observed=mean)
    zero = np.zeros(1)
    return Linear(subject, zero, mean, mean, zero, jacobian, scatter, whitening)


def drawn(seed, count):
    noise = np.random.default_rng(seed).standard_normal((count, len(model().mean)))
    return model().mean + noise @ model().factor.T


def found_in(off, seed=1):
    """What is found where readings are these shares larger than in a model that is right."""
    readings = drawn(seed, 1)[0] + off * model().mean
    linear = replace(
        model(), subject=SimpleNamespace(places=readings_of_actuators(), observed=readings)
    )
    statistic, _ = largest_ratio(linear.observed[None], discrepancies(linear))
    return concentration(linear, drawn(99, 200), float(statistic[0]))


def rows(part):
    return np.char.find(readings_of_actuators().history, part) >= 0


def of(*specimens):
    return np.isin(readings_of_actuators().specimen, specimens)


@pytest.mark.parametrize(
    ("part", "excess", "kind", "name"),
    [
        ("unloading", 0.06, "branch", "unloading"),
        ("unloading", -0.06, "branch", "unloading"),
        (" 2 ", 0.05, "cycle", "cycle 2"),
    ],
)
def test_a_branch_or_later_cycle_that_departs_is_named_with_its_size(part, excess, kind, name):
    found = found_in(excess * rows(part))
    assert (found.kind, found.members) == (kind, (name,))
    assert found.excess_pct[0] == pytest.approx(100 * excess, abs=1.0)
    assert found.share_of_misfit > max(MOST, MORE * found.share_of_readings)
    assert found.share_of_readings == pytest.approx(np.mean(rows(part)))
    assert found.p_value == pytest.approx(1 / 201)


def test_readings_after_a_hold_are_named():
    """Not the first of unloading, which is at the pressure of the one before too."""
    held = np.arange(len(model().mean)) % 9 == 4
    found = found_in(0.08 * held)
    assert found.kind == "hold"
    assert len(found.members) == 1
    assert found.share_of_readings == pytest.approx(1 / 9)


def test_a_specimen_that_departs_is_named():
    found = found_in(-0.25 * of("s4"))
    assert (found.kind, found.members) == ("specimen", ("s4",))
    assert found.excess_pct[0] == pytest.approx(-25.0, abs=8.0)
    assert found.share_of_readings == pytest.approx(1 / 12)


def test_a_few_specimens_are_named_the_worst_first():
    found = found_in(0.4 * of("s4") - 0.25 * of("s9"))
    assert (found.kind, found.members) == ("specimen", ("s4", "s9"))
    assert found.excess_pct[0] > 0.0 > found.excess_pct[1]


@pytest.mark.parametrize(
    "off",
    [
        0.3 * (readings_of_actuators().level == 24.0),
        0.3 * (1.0 - readings_of_actuators().along / 160.0),
        0.25 * of("s0", "s3", "s6", "s9") - 0.25 * of("s1", "s4", "s7"),
    ],
    ids=["a degradation rate", "low pressures", "many specimens"],
)
def test_what_sits_elsewhere_is_not_said_of_a_branch_or_specimen(off):
    assert found_in(off) is None


def test_where_nothing_departs_nothing_is_named():
    named = [found_in(np.zeros(len(model().mean)), seed) is not None for seed in range(60)]
    assert np.mean(named) <= RARE + 2.0 * np.sqrt(RARE / 60)


def test_without_simulated_data_nothing_is_said():
    assert concentration(model(), drawn(1, 0), 50.0) is None
