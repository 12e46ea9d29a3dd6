"""Actuators: errors and scatter as stated, effects act, specimens burst where they must."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.data.settings import Dimensions
from bayesdeg.laboratory.experiment import Breaking, inflate_actuators
from bayesdeg.laboratory.truth import Truth, parse_effects
from tests.laboratory.linear_actuator import LENGTH_M, LinearActuator, curvature_by_hand

TRUTH = Truth()
QUIET = replace(
    TRUTH,
    curvature_noise=0.0,
    curvature_noise_floor=0.0,
    bend_angle_noise=0.0,
    bend_angle_noise_floor=0.0,
)


def many(level, count, pressures=(60.0, 120.0, 180.0), sd=np.nan):
    specimens = pd.DataFrame(
        {
            "specimen_id": [f"a{i}" for i in range(count)],
            "degradation_pct": float(level),
            "degradation_sd_pct": sd,
        }
    )
    return specimens.merge(pd.DataFrame({"pressure_kPa": pressures}), how="cross")


def inflate(table, truth=TRUTH, effects=(), forward=None, seed=5):
    return inflate_actuators(
        table,
        truth,
        effects=parse_effects(effects),
        forward=forward or LinearActuator(),
        generator=np.random.default_rng(seed),
    )


def c1_of(specimens, names):
    real = specimens.loc[names]
    return TRUTH.constants(real["degradation_pct"])[:, 0] * np.exp(real["ln_stiffness"].to_numpy())


def expected(readings, specimens, pressure=None):
    pressure = readings["pressure_kPa"] if pressure is None else pressure
    c1 = c1_of(specimens, readings["specimen_id"])
    return curvature_by_hand(pressure.to_numpy(), c1, 0.62)


@pytest.mark.parametrize("level", [0.0, 15.0])
def test_readings_are_those_of_the_specimen_with_the_errors_stated(level):
    readings, specimens = inflate(many(level, 1000))
    curvature = expected(readings, specimens)
    z = (readings["curvature_per_m"] - curvature) / np.sqrt(0.1**2 + (0.02 * curvature) ** 2)
    angle = np.degrees(curvature * LENGTH_M)
    y = (readings["bend_angle_deg"] - angle) / np.sqrt(0.25**2 + (0.02 * angle) ** 2)
    for error in (z, y):
        assert stats.kstest(error, "norm").pvalue > 1e-3
        assert error.std() == pytest.approx(1.0, rel=0.05)
    assert abs(np.corrcoef(z, y)[0, 1]) < 0.08
    assert (readings["ruptured"] == 0).all()


@pytest.mark.parametrize("level", [0.0, 15.0])
def test_specimens_scatter_as_stated(level):
    _, specimens = inflate(many(level, 3000, pressures=[60.0]))
    assert specimens["ln_stiffness"].std() == pytest.approx(0.04, rel=0.06)
    error = specimens["degradation_pct"] - level
    assert error.std() == pytest.approx(0.0 if level == 0.0 else 0.5, rel=0.06)
    elongation = specimens["limit_stretch"] - 1.0
    median = TRUTH.limit_stretch(specimens["degradation_pct"].to_numpy()) - 1.0
    assert np.log(elongation / median).std() == pytest.approx(0.05, rel=0.06)
    if level > 0.0:
        deviations = [error, specimens["ln_stiffness"], np.log(elongation / median)]
        np.testing.assert_allclose(np.corrcoef(deviations), np.eye(3), atol=0.08)


def test_an_error_of_the_rate_that_the_design_states_is_kept():
    readings, specimens = inflate(many(10.0, 2000, pressures=[60.0], sd=1.5))
    assert (specimens["degradation_pct"] - 10.0).std() == pytest.approx(1.5, rel=0.06)
    assert set(readings["degradation_sd_pct"]) == {1.5}


def test_an_error_of_reading_that_the_design_states_adds_up():
    table = many(0.0, 2000, pressures=[60.0]).assign(curvature_sd_per_m=0.4)
    readings, specimens = inflate(table, replace(QUIET, curvature_noise_floor=0.3))
    error = readings["curvature_per_m"] - expected(readings, specimens)
    assert error.std() == pytest.approx(0.5, rel=0.06)
    assert set(readings["curvature_sd_per_m"]) == {0.4}


def test_a_pressure_offset_shifts_the_curve():
    for offset in (14.0, -14.0):
        readings, specimens = inflate(many(5.0, 4), QUIET, [f"pressure_offset={offset}"])
        real, rest = readings["pressure_kPa"] - offset, max(-offset, 0.0)
        shifted = expected(readings, specimens, real)
        zero = expected(readings, specimens, 0.0 * real + rest)
        np.testing.assert_allclose(readings["curvature_per_m"], shifted - zero, atol=6e-5)


def test_a_misreading_moves_and_scatters_degraded_specimens_only():
    effects = ["degradation_misread.shift=3", "degradation_misread.scatter=1.2"]
    _, specimens = inflate(many(15.0, 3000, pressures=[60.0]), effects=effects)
    error = specimens["degradation_pct"] - 15.0
    assert error.mean() == pytest.approx(3.0, abs=0.1)
    assert error.std() == pytest.approx(1.3, rel=0.06)
    readings, fresh = inflate(many(0.0, 50, pressures=[60.0]), effects=effects)
    assert (fresh["degradation_pct"] == 0.0).all()
    assert set(readings["degradation_sd_pct"]) == {0.0}


def test_what_is_recorded_of_the_rate_does_not_betray_a_misreading():
    readings, _ = inflate(many(15.0, 3), effects=["degradation_misread=3"])
    assert set(readings["degradation_pct"]) == {15.0}
    assert set(readings["degradation_sd_pct"]) == {0.5}


def test_reading_another_fibre_changes_the_curvature_and_not_the_bend_angle():
    table = many(0.0, 4)
    plain, _ = inflate(table, QUIET)
    read, _ = inflate(table, QUIET, ["curvature_reading=8"])
    spread = 1.0 + 8e-3 * plain["curvature_per_m"]
    np.testing.assert_allclose(
        read["curvature_per_m"], plain["curvature_per_m"] / spread, atol=2e-4
    )
    pd.testing.assert_series_equal(read["bend_angle_deg"], plain["bend_angle_deg"])


def test_effects_act_together():
    table = many(10.0, 4)
    effects = ["curvature_reading.magnification=0.02", "gauge_gain=-0.1", "pressure_offset=14"]
    readings, specimens = inflate(table, QUIET, effects)
    real = 0.9 * readings["pressure_kPa"] - 14.0
    np.testing.assert_allclose(
        readings["curvature_per_m"], 1.02 * expected(readings, specimens, real), atol=6e-5
    )


def test_a_specimen_bursts_at_its_own_limit_and_nothing_is_read_from_there_on():
    pressures = np.arange(20.0, 241.0, 20.0)
    table = many(0.0, 40, pressures)
    readings, specimens = inflate(table, forward=LinearActuator(stretching=2.7))
    load = pressures / 1e3 / c1_of(specimens, specimens.index)[:, None]
    over = 1.0 + 2.7 * load > specimens["limit_stretch"].to_numpy()[:, None]
    assert 0 < over.any(axis=1).sum() < 40
    for i, (_, test) in enumerate(readings.groupby("specimen_id", sort=False)):
        whole = pressures[: over[i].argmax()] if over[i].any() else pressures
        kept = test[test["ruptured"] == 0]
        assert kept["pressure_kPa"].tolist() == whole.tolist()
        assert kept[["curvature_per_m", "bend_angle_deg"]].notna().all(axis=None)
        burst = test[test["ruptured"] == 1]
        assert len(burst) == over[i].any()
        assert burst[["curvature_per_m", "bend_angle_deg"]].isna().all(axis=None)
        assert burst.index.tolist() == test.index[len(whole) : len(whole) + 1].tolist()
    assert set(specimens["status"]) == {"converged"}


def test_where_there_is_no_equilibrium_a_specimen_bursts():
    readings, specimens = inflate(
        many(0.0, 30, [60.0, 130.0, 220.0]), forward=LinearActuator(limit=0.45)
    )
    load = 0.13 / c1_of(specimens, specimens.index)
    for beyond, (_, test) in zip(
        load > 0.45, readings.groupby("specimen_id", sort=False), strict=True
    ):
        assert test["ruptured"].tolist() == ([0, 1] if beyond else [0, 0, 1])
        assert test["curvature_per_m"].isna().tolist() == (
            [False, True] if beyond else [False, False, True]
        )
    assert set(specimens["status"]) == {"limit_point"}
    assert 0 < np.sum(load > 0.45) < 30


def test_tests_of_different_length_and_order_keep_their_rows():
    table = pd.DataFrame(
        {
            "specimen_id": ["b", "b", "b", "a", "a"],
            "degradation_pct": [5.0, 5.0, 5.0, 0.0, 0.0],
            "degradation_sd_pct": 0.0,
            "pressure_kPa": [0.0, 90.0, 30.0, 200.0, 210.0],
            "cycle": [1.0, 1.0, 1.0, 1.0, 2.0],
            "branch": ["loading", "loading", "unloading", "loading", "loading"],
            "humidity_pct": [60.0, 61.0, 62.0, 63.0, 64.0],
        }
    )
    readings, specimens = inflate(table, QUIET)
    pd.testing.assert_frame_equal(readings[list(table)], table)
    np.testing.assert_allclose(
        readings["curvature_per_m"], expected(readings, specimens), atol=6e-5
    )
    noisy, _ = inflate(table)
    assert noisy["curvature_per_m"][0] == 0.0 == noisy["bend_angle_deg"][0]
    assert (noisy["curvature_per_m"][1:] != readings["curvature_per_m"][1:]).all()


def test_specimens_and_errors_do_not_depend_on_what_is_hidden():
    table = many(0.0, 6)
    plain, specimens = inflate(table)
    hidden, same = inflate(table, effects=["curvature_reading=8"])
    pd.testing.assert_frame_equal(specimens, same)
    pd.testing.assert_series_equal(plain["bend_angle_deg"], hidden["bend_angle_deg"])


def test_hidden_dry_air_weakens_by_the_humidity_of_each_test():
    """ln of the limits: less by b (D/25 %)(67 % − RH)/7 %, the specimens and their own limits kept.

    The rate is what each has, not what is recorded.
    """
    table = many(20.0, 4).assign(humidity_pct=np.repeat([67.0, 60.0, 46.0, np.nan], 3))
    _, plain = inflate(table)
    _, hidden = inflate(table, effects=["dry_embrittlement=1.2"])
    cut = np.log((plain["limit_stretch"] - 1.0) / (hidden["limit_stretch"] - 1.0))
    lost = np.array([0.0, 1.0, 3.0, 1.0])
    np.testing.assert_allclose(cut, 1.2 * lost * plain["degradation_pct"] / 25.0, rtol=1e-12)


def test_hidden_unevenness_weakens_along_the_trend_of_the_films():
    table = many(20.0, 3)
    _, plain = inflate(table)
    _, hidden = inflate(table, effects=["uneven_degradation=0.3"])
    cut = np.log((plain["limit_stretch"] - 1.0) / (hidden["limit_stretch"] - 1.0))
    rate, h = plain["degradation_pct"].to_numpy(), 1e-4
    near = [np.log(TRUTH.limit_stretch(rate + step) - 1.0) for step in (-h, h)]
    slope = (near[1] - near[0]) / (2.0 * h)
    np.testing.assert_allclose(cut, -0.3 * rate * slope, rtol=1e-6)


@pytest.mark.fem
def test_the_finite_element_model_as_the_truth():
    """Two specimens on a tiny actuator, against solutions asked for one by one."""
    forward = ExactMap(Geometry(Dimensions(length=20.0, chambers=2)), Resolution(9.0, 9.0, 9.0))
    table = pd.concat(
        [many(0.0, 1, [30.0, 90.0]), many(20.0, 1, [60.0, 120.0, 200.0]).assign(specimen_id="b")]
    )
    readings, specimens = inflate(table, QUIET, ["pressure_offset=14"], forward)
    assert readings["specimen_id"].tolist() == ["a0", "a0", "b", "b", "b"]
    for name, test in readings.groupby("specimen_id"):
        real = specimens.loc[name]
        c1, c2, c3 = TRUTH.constants([real["degradation_pct"]])[0] * np.exp(real["ln_stiffness"])
        alone = forward(
            Inputs(
                test["pressure_kPa"].to_numpy() - 14.0,
                *(np.array([c]) for c in (c1, c2, c3)),
                np.array([0.62 ** (1.0 / 3.0)]),
                np.array([3e4]),
            )
        )
        np.testing.assert_allclose(test["curvature_per_m"], alone.curvature, atol=6e-5)
        np.testing.assert_allclose(test["bend_angle_deg"], alone.bend_angle, atol=6e-4)
    assert (readings["curvature_per_m"] > 0.0).all()
    assert (readings["ruptured"] == 0).all()


def test_by_the_weakest_link_the_larger_actuator_bursts_sooner():
    """Under uniform strain its volume survives as so many films would, one beside the other."""
    scatter, size_ratio, pressures = 0.1, 60.0, np.arange(60.0, 2001.0, 20.0)
    weak = replace(QUIET, elongation_scatter=scatter, stiffness_scatter=0.0)
    readings, _ = inflate_actuators(
        many(0.0, 1500, pressures),
        weak,
        effects=(),
        forward=LinearActuator(),
        generator=np.random.default_rng(3),
        breaking=Breaking("weakest_link", size_ratio),
    )
    modulus = np.pi / (np.sqrt(6.0) * scatter)
    strain = pressures / (1e3 * weak.constants([0.0])[0, 0])
    median = weak.limit_stretch([0.0])[0] - 1.0
    films = size_ratio * weak.volume_ratio
    expected_share = 1.0 - 0.5 ** (films * (strain / median) ** modulus)
    burst = readings.loc[readings["ruptured"] == 1].groupby("pressure_kPa").size()
    share = burst.reindex(pressures, fill_value=0).cumsum().to_numpy() / 1500.0
    assert expected_share.max() > 0.2
    np.testing.assert_allclose(share, expected_share, atol=4.0 * np.sqrt(0.25 / 1500.0))
