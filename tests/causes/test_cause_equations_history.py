"""Causes that remember: creep, drying, softening, friction against laws solved step by step."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import erf

from bayesdeg.causes.cause import Conditions
from bayesdeg.causes.creep import creep_under_load
from bayesdeg.causes.history import filled, known_time, lagging
from bayesdeg.causes.humidity_drift import dry_out, dryness
from bayesdeg.causes.hysteresis import lag_behind, played
from bayesdeg.causes.mullins import ratio_to_largest, soften_below_largest
from tests.causes.default_actuator import LOADING, THERE_AND_BACK, effect, inputs_of

FRESH = np.array([[0.0]])


def experiment(pressure, time=np.nan, humidity=np.nan):
    pressure = np.atleast_2d(np.asarray(pressure, float))
    return Conditions(
        pressure,
        np.zeros((len(pressure), 1)),
        time=np.asarray(time, float),
        humidity=np.asarray(humidity, float),
    )


def crept(pressure, time, amount, time_constant):
    conditions = experiment(pressure, time)
    inputs = inputs_of(conditions.pressure, FRESH)
    values = effect(amount=amount, time_constant=time_constant)
    return creep_under_load(inputs, conditions, values).pressure


def dried(pressure, time, humidity, stiffening, time_constant):
    conditions = experiment(pressure, time, humidity)
    inputs = inputs_of(conditions.pressure, FRESH)
    values = effect(stiffening=stiffening, time_constant=time_constant)
    return dry_out(inputs, conditions, values).pressure


def relaxing(target, time, time_constant):
    """x of τ dx/dt = target − x, each target held up to its own time; x = 0 at the first."""
    x, found = 0.0, [0.0]
    for j in range(1, len(time)):
        x = target[j] + (x - target[j]) * np.exp(-(time[j] - time[j - 1]) / time_constant)
        found.append(x)
    return np.array(found)


def test_creep_of_two_steps_by_hand():
    """Step of 100 kPa held 10 s, let out by 60 kPa for 20 s more; a = 0.2, τ = 10 s."""
    pressure = crept([0.0, 100.0, 40.0], [0.0, 10.0, 30.0], 0.2, 10.0)[0, 0]
    after_first = 100.0 + 0.2 * 100.0 * (1.0 - np.exp(-1.0))
    in_the_end = 40.0 + 0.2 * (100.0 * (1.0 - np.exp(-3.0)) - 60.0 * (1.0 - np.exp(-2.0)))
    np.testing.assert_allclose(pressure, [0.0, after_first, in_the_end], rtol=1e-14)


@given(
    pressure=st.lists(st.floats(0.0, 240.0), min_size=2, max_size=8),
    holds=st.lists(st.floats(0.0, 300.0), min_size=8, max_size=8),
    amount=st.floats(0.0, 1.0),
    time_constant=st.floats(0.1, 1e4),
)
@settings(max_examples=60)
def test_creep_is_a_relaxation_towards_the_held_pressure(pressure, holds, amount, time_constant):
    pressure = [0.0, *pressure]
    time = np.concatenate([[0.0], np.cumsum(holds)])[: len(pressure)]
    want = np.array(pressure) + amount * relaxing(pressure, time, time_constant)
    got = crept(pressure, time, amount, time_constant)[0, 0]
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-9)
    assert np.all(got >= 0.0)


def test_creep_under_short_and_long_holds():
    time = np.arange(12.0)
    np.testing.assert_allclose(crept(LOADING, 1e-9 * time, 0.2, 10.0)[0, 0], LOADING, rtol=1e-9)
    long = crept(LOADING, 1e4 * time, 0.2, 10.0)[0, 0]
    # of the first reading no hold is known
    np.testing.assert_allclose(long[1:], 1.2 * LOADING[1:], rtol=1e-12)
    assert long[0] == LOADING[0]


def test_creep_lags_on_unloading():
    pressure = crept(THERE_AND_BACK, 30.0 * np.arange(23.0), 0.15, 30.0)[0, 0]
    up, down = pressure[:11], pressure[:11:-1]
    assert np.all(down > up)
    assert np.all(pressure[1:] > THERE_AND_BACK[1:])


def test_creep_is_one_walker_and_one_specimen_at_a_time():
    conditions = experiment(
        [LOADING, 0.5 * LOADING], [30.0 * np.arange(12.0), 9.0 * np.arange(12.0)]
    )
    inputs = inputs_of(LOADING, np.zeros((2, 1)))
    values = effect(amount=[0.1, 0.3], time_constant=[5.0, 50.0])
    together = creep_under_load(inputs, conditions, values).pressure
    assert together.shape == (2, 2, 12)
    for walker, (amount, constant) in enumerate(((0.1, 5.0), (0.3, 50.0))):
        for row, hold in enumerate((30.0, 9.0)):
            alone = crept(LOADING, hold * np.arange(12.0), amount, constant)[0, 0]
            np.testing.assert_allclose(together[walker, row], alone, rtol=1e-14)


def test_what_was_not_recorded_is_taken_from_the_reading_before():
    nan = np.nan
    rows = np.array([[nan, nan, 3.0, nan], [0.0, nan, nan, 9.0], [nan] * 4])
    want = [[7.0, 7.0, 3.0, 3.0], [0.0, 0.0, 0.0, 9.0], [7.0] * 4]
    np.testing.assert_array_equal(filled(rows, 7.0), want)


def test_specimens_without_times_neither_creep_nor_dry():
    times = [np.full(12, np.nan), 30.0 * np.arange(12.0)]
    conditions = experiment([LOADING, LOADING], times)
    inputs = inputs_of(LOADING, np.zeros((2, 1)))
    crept_inputs = creep_under_load(inputs, conditions, effect(amount=0.3, time_constant=10.0))
    dry_inputs = dry_out(inputs, conditions, effect(stiffening=0.3, time_constant=10.0))
    for pressure in (crept_inputs.pressure[0], dry_inputs.pressure[0]):
        np.testing.assert_array_equal(pressure[0], LOADING)
        assert np.all(pressure[1, 1:] != LOADING[1:])
    np.testing.assert_array_equal(known_time(conditions)[0], 0.0)


def test_drying_without_a_hygrometer_is_an_exponential_in_time():
    time = 120.0 * np.arange(12.0)
    pressure = dried(LOADING, time, np.nan, 0.15, 900.0)[0, 0]
    want = LOADING * np.exp(-0.15 * (1.0 - np.exp(-time / 900.0)))
    np.testing.assert_allclose(pressure, want, rtol=1e-13)


def test_drying_follows_the_recorded_humidity():
    """The equation of the gel's dryness, integrated numerically."""
    time = np.array([0.0, 300.0, 500.0, 1500.0, 1800.0])
    humidity = np.array([64.0, 64.0, 53.0, 60.0, 70.0])
    held = (67.0 - humidity) / 7.0

    def rate(t, m):
        return (held[min(np.searchsorted(time, t), 4)] - m) / 900.0

    solution = solve_ivp(rate, (0.0, 1800.0), [0.0], t_eval=time, rtol=1e-9, max_step=5.0)
    pressure = dried(np.full(5, 100.0), time, humidity, 0.2, 900.0)[0, 0]
    np.testing.assert_allclose(np.log(pressure / 100.0), -0.2 * solution.y[0], atol=1e-4)
    np.testing.assert_allclose(
        np.log(pressure / 100.0), -0.2 * relaxing(held, time, 900.0), atol=1e-13
    )


def test_a_room_like_the_storage_dries_nothing_and_a_drier_one_in_proportion():
    time = 120.0 * np.arange(12.0)
    np.testing.assert_array_equal(dried(LOADING, time, 67.0, 0.2, 900.0)[0, 0], LOADING)
    published, twice = (
        np.log(dried(LOADING, time, humidity, 0.2, 900.0)[0, 0] / LOADING) for humidity in (60, 53)
    )
    np.testing.assert_allclose(twice, 2.0 * published, rtol=1e-12)
    assert np.all(dried(LOADING, time, 74.0, 0.2, 900.0)[0, 0, 1:] > LOADING[1:])


def test_dryness_is_one_where_humidity_was_not_recorded():
    np.testing.assert_array_equal(dryness(experiment(LOADING)), 1.0)


def test_a_lagging_response_to_one_step_of_many_walkers():
    response = lagging(np.array([[0.0, 1.0]]), np.array([[0.0, 2.0]]), np.array([[[1.0]], [[2.0]]]))
    np.testing.assert_allclose(response[:, 0, 1], 1.0 - np.exp([-2.0, -1.0]), rtol=1e-15)


def softened(pressure, b, onset=0.1):
    conditions = experiment(pressure)
    inputs = inputs_of(conditions.pressure, FRESH)
    values = effect(softening=b, onset=onset)
    return soften_below_largest(inputs, conditions, values).pressure[0, 0]


@given(
    pressure=st.lists(st.floats(0.0, 240.0), min_size=1, max_size=10),
    b=st.floats(0.0, 0.9),
    onset=st.floats(1e-3, 10.0),
)
def test_softened_material_balances_the_pressure(pressure, b, onset):
    """p = η q with η of Ogden and Roxburgh, and no shape beyond that of the largest pressure."""
    load = softened(pressure, b, onset)
    largest = np.maximum.accumulate(pressure)
    c1 = float(np.ravel(inputs_of(np.array([[1.0]]), FRESH).c1)[0])
    eta = 1.0 - b * erf((largest**2 - load**2) * 1e-6 / (onset * c1**2))
    np.testing.assert_allclose(eta * load, pressure, rtol=1e-6, atol=1e-6)
    assert np.all(load <= largest * (1.0 + 1e-14))
    assert np.all(load >= np.array(pressure) * (1.0 - 1e-14))


def test_a_far_larger_load_takes_the_whole_share():
    """Where (q_m² − q²)/(w C1²) is large, p = (1 − b) q; at small loads it is as it ever was."""
    load = softened([100.0, 60.0], 0.2, onset=1e-4)
    np.testing.assert_allclose(load, [100.0, 75.0], rtol=1e-12)
    np.testing.assert_allclose(softened([100.0, 60.0], 0.2, onset=1e6), [100.0, 60.0], rtol=1e-6)


def test_stiff_specimens_soften_less():
    pressure = experiment([200.0, 60.0])
    inputs = inputs_of(pressure.pressure, FRESH)
    values = effect(softening=0.2, onset=0.1)
    soft, stiff = (
        soften_below_largest(replace(inputs, c1=c1 * inputs.c1), pressure, values).pressure[0, 0, 1]
        for c1 in (1.0, 5.0)
    )
    assert soft > 1.2 * 60.0 > 1.03 * stiff > 1.03 * 60.0


def test_first_loading_is_left_bit_by_bit_and_met_again_beyond_the_largest():
    cycle = np.concatenate([THERE_AND_BACK[:18], LOADING + 10.0])
    load = softened(cycle, 0.3)
    np.testing.assert_array_equal(load[:12], LOADING)
    assert np.all(load[12:29] > cycle[12:29])
    assert load[-1] == 250.0


def test_ratio_to_the_largest_pressure_counts_from_each_specimens_own_readings():
    ratio = ratio_to_largest(np.array([[10.0, 20.0, 5.0], [0.0, 0.0, 5.0]]))
    np.testing.assert_array_equal(ratio, [[1.0, 1.0, 0.25], [1.0, 1.0, 1.0]])


@pytest.mark.parametrize("hold", [0.1, 1000.0])
def test_mullins_does_not_wait(hold):
    there = experiment(THERE_AND_BACK, hold * np.arange(23.0))
    inputs = inputs_of(THERE_AND_BACK, FRESH)
    load = soften_below_largest(inputs, there, effect(softening=0.2, onset=0.1)).pressure[0, 0]
    np.testing.assert_array_equal(load, softened(THERE_AND_BACK, 0.2))


def played_by_steps(pressure, friction, begins):
    """The play operator as it is defined, one reading after another."""
    chambers, found = 0.0, []
    for p, new in zip(pressure, begins, strict=True):
        for target in (0.0, p) if new else (p,):
            chambers = max(target - friction, min(target + friction, chambers))
        found.append(chambers)
    return found


@given(
    readings=st.lists(st.tuples(st.floats(0.0, 240.0), st.booleans()), min_size=1, max_size=40),
    friction=st.floats(0.0, 50.0),
)
def test_friction_plays_along_any_path(readings, friction):
    pressure, begins = (np.array(column) for column in zip(*readings, strict=True))
    got = played(pressure[None, None], np.full((1, 1, 1), friction), begins[None])[0, 0]
    np.testing.assert_allclose(got, played_by_steps(pressure, friction, begins), atol=1e-12)
    assert np.all((got >= 0.0) & (got <= pressure.max()))


def rubbed(pressure, friction, cycle=1):
    conditions = replace(experiment(pressure), cycle=np.broadcast_to(cycle, (1, len(pressure))))
    inputs = inputs_of(conditions.pressure, FRESH)
    return lag_behind(inputs, conditions, effect(friction=friction)).pressure


def test_friction_lags_on_both_branches():
    """Steps of 20 kPa pass the dead band of 18 kPa at once, and one of 20 kPa not that of 24."""
    pressure = rubbed(THERE_AND_BACK, 9.0)[0, 0]
    np.testing.assert_allclose(pressure[:12], LOADING - 9.0)
    np.testing.assert_allclose(pressure[12:], THERE_AND_BACK[12:] + 9.0)
    np.testing.assert_allclose(rubbed(THERE_AND_BACK, 12.0)[0, 0, 11:14], [228.0, 228.0, 212.0])


def test_friction_keeps_its_pressure_at_a_reversal_and_what_it_holds_at_the_end():
    np.testing.assert_allclose(rubbed([4.0, 100.0, 100.0, 95.0, 0.0], 6.0), [[[0, 94, 94, 94, 6]]])


def test_a_new_cycle_begins_at_zero():
    """Read at the lowest pressure twice, on the way down and on the next way up."""
    path = [20.0, 60.0, 20.0, 20.0, 60.0]
    one, two = rubbed(path, 9.0), rubbed(path, 9.0, [1, 1, 1, 2, 2])
    np.testing.assert_allclose(one, [[[11, 51, 29, 29, 51]]])
    np.testing.assert_allclose(two, [[[11, 51, 29, 11, 51]]])


def test_friction_is_one_walker_and_one_specimen_at_a_time():
    conditions = experiment([THERE_AND_BACK, 0.5 * THERE_AND_BACK])
    inputs = replace(
        inputs_of(THERE_AND_BACK, np.zeros((2, 1))), pressure=conditions.pressure[None]
    )
    together = lag_behind(inputs, conditions, effect(friction=[3.0, 14.0])).pressure
    for walker, friction in enumerate((3.0, 14.0)):
        for row, path in enumerate(conditions.pressure):
            np.testing.assert_array_equal(together[walker, row], rubbed(path, friction)[0, 0])
