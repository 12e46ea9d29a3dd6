"""Predictions under conditions: held, cycled, on the way down, in dry air, in other mounts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.control import setting_for
from bayesdeg.prediction.predictive import (
    QUANTILES,
    Grid,
    at_conditions,
    curvature_bands,
    draw_specimens,
    draw_values,
    history,
    moving_nothing,
    respond,
    rupture_table,
)
from bayesdeg.quantities import MOUNTS
from bayesdeg.surrogate.trained import default_surrogate
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.prediction.test_control import StraightLine

LEVELS = np.array([0.0, 25.0])
PRESSURES = np.array([20.0, 60.0, 100.0])
LARGEST = 140.0
BANDS = [f"q{round(100 * q):02d}" for q in QUANTILES]
ALL = ServiceConditions(600.0, 2, "unloading", 40.0, "bending_up", temperature_c=30.0)
HOLD = 40.0


@pytest.fixture(scope="module")
def surrogate():
    return default_surrogate()


def model_with(forward, *names):
    causes = [find(name) for name in names]
    return altered(small_model(), forward=forward, largest_pressure=LARGEST).extended(*causes)


def sizes(*names, **changed):
    """Typical sizes of causes, by their qualified names."""
    found = {find(n).qualified(p): v for n in names for p, v in find(n).typical.items()}
    return found | changed


def chain_at(model, **changes):
    """A posterior without width."""
    known = values_of(TRUTH | changes)
    vector = model.table.vectors({name: known[name] for name in model.table.names})[0]
    return Chain(np.tile(vector, (1, 10, 2, 1)), np.zeros((1, 10, 2)), np.array([0.4]))


def curvature_of(model, conditions, pressure=PRESSURES, levels=LEVELS, **changes):
    """Curvature of the median specimen, (n_levels, n_pressures)."""
    known = values_of(TRUTH | changes)
    values = {name: known[name] for name in model.table.names}
    grid = Grid.of(model, levels, np.asarray(pressure), conditions)
    return grid.reached(values, np.zeros((1, len(levels), 1))).curvature[0]


def test_a_prompt_first_loading_gives_the_numbers_it_gave_before_there_were_conditions(surrogate):
    """Bit for bit: the tests written out, and what was made of them."""
    model = model_with(surrogate, "creep", "gravity", "mullins", "humidity_drift")
    chain = chain_at(model, **sizes("creep", "gravity", "mullins", "humidity_drift"))
    shape = (2, 3)
    curves = ActuatorCurves(
        specimens=("0 %", "25 %"),
        degradation=LEVELS[:, None],
        degradation_sd=np.zeros((2, 1)),
        pressure=np.broadcast_to(PRESSURES, shape).copy(),
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        angle_sd=np.zeros(shape),
        mask=np.ones(shape, bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.zeros(shape, bool),
        recorded=np.ones(shape, bool),
        ruptured=np.zeros(shape, bool),
        cycle=np.ones(shape, np.int64),
        branch=np.full(shape, "loading"),
        time=np.full(shape, np.nan),
        humidity=np.full(shape, np.nan),
        mount=np.full(shape, "horizontal"),
    )
    written = model.with_observations(*data_of_actuators(curves, model.base))
    generator = np.random.default_rng(3)
    values = draw_values(model, chain, generator, 50)
    deviation = written.data_of(Curvature).drawn_deviations(written.tests(values), generator)
    expected = np.quantile(
        written.data_of(Curvature).predicted(written.tests(values), deviation).prediction.curvature,
        QUANTILES,
        axis=0,
    )
    asked = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 50}
    found = curvature_bands(model, chain, np.random.default_rng(3), **asked, conditions=PROMPT)
    assert np.array_equal(found[BANDS].to_numpy().T, expected.reshape(5, 6))
    own = at_conditions(model, LEVELS, PRESSURES).data_of(Curvature).tests
    for name in ("pressure", "time", "cycle", "branch", "humidity", "mount", "degradation_sd"):
        np.testing.assert_array_equal(getattr(own, name), getattr(curves, name))


def test_a_history_in_which_nothing_acts_ends_as_a_prompt_loading(surrogate):
    model = model_with(surrogate)
    chain = chain_at(model)
    asked = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 40}
    for predicted in (curvature_bands, rupture_table):
        prompt, held = (
            predicted(model, chain, np.random.default_rng(3), **asked, conditions=conditions)
            for conditions in (PROMPT, ServiceConditions(hold_s=600.0, humidity_pct=30.0))
        )
        np.testing.assert_allclose(held.to_numpy(), prompt.to_numpy(), rtol=1e-12)


def test_steps_of_a_history():
    """The pressure that is read comes last, after all that came before it."""
    for conditions, pressure, cycle, down in (
        (ServiceConditions(hold_s=5.0), [0, 40], [1, 1], [0, 0]),
        (ServiceConditions(branch="unloading"), [140, 40], [1, 1], [0, 1]),
        (ServiceConditions(cycle=3), [140, 0, 40], [2, 2, 3], [0, 1, 0]),
        (
            ServiceConditions(cycle=2, branch="unloading"),
            [140, 0, 140, 40],
            [1, 1, 2, 2],
            [0, 1, 0, 1],
        ),
    ):
        path = history(conditions, np.array([40.0]), LARGEST)
        assert path.pressure.tolist() == [pressure]
        assert path.cycle.tolist() == cycle
        assert path.unloading.tolist() == down
        assert path.time.tolist() == [0.0] * (len(pressure) - 1) + [conditions.hold_s]
    beyond = history(ServiceConditions(branch="unloading"), np.array([200.0]), LARGEST)
    assert beyond.pressure.tolist() == [[200.0, 200.0]]


def test_creep_raises_the_load_by_its_share_of_the_hold(surrogate):
    """p_eff = p (1 + a (1 − exp(−t/τ)))."""
    effect = sizes("creep")
    share = 1.0 + effect["creep.amount"] * -np.expm1(-HOLD / effect["creep.time_constant"])
    still = {"emulator_error_pressure": 0.0}
    model = model_with(surrogate, "creep")
    found = curvature_of(model, ServiceConditions(hold_s=HOLD), **effect | still)
    expected = curvature_of(model_with(surrogate), PROMPT, PRESSURES * share, **still)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    assert np.all(found > curvature_of(model, PROMPT, **effect | still))


def test_dry_air_lowers_the_load_by_its_share_of_the_time(surrogate):
    """p_eff = p exp(−a (67 − RH)/7 (1 − exp(−t/τ)))."""
    still = {"emulator_error_pressure": 0.0}
    effect = sizes("humidity_drift", **still)
    grown = -np.expm1(-600.0 / effect["humidity_drift.time_constant"])
    for humidity, dryness in ((None, 1.0), (46.0, 3.0), (67.0, 0.0)):
        share = np.exp(-effect["humidity_drift.stiffening"] * dryness * grown)
        conditions = ServiceConditions(hold_s=600.0, humidity_pct=humidity)
        found = curvature_of(model_with(surrogate, "humidity_drift"), conditions, **effect)
        expected = curvature_of(model_with(surrogate), PROMPT, PRESSURES * share, **still)
        np.testing.assert_allclose(found, expected, rtol=1e-10)


@pytest.mark.parametrize(
    "conditions", [ServiceConditions(branch="unloading"), ServiceConditions(cycle=2)]
)
def test_what_was_stretched_before_is_softer(surrogate, conditions):
    """p = q (1 − b erf((q_m² − q²)/(w C1²))), and nothing at the largest pressure."""
    still = {"emulator_error_pressure": 0.0}
    effect = sizes("mullins", **still)
    model = model_with(surrogate, "mullins")
    found = curvature_of(model, conditions, **effect)
    for row, level in enumerate(LEVELS):
        share = effect["mullins.onset"] * (1e3 * TRUTH[f"c1_at_{level:g}"]) ** 2

        def missing(q, p, share=share):
            eta = 1.0 - effect["mullins.softening"] * erf((LARGEST**2 - q**2) / share)
            return q * eta - p

        load = np.array([brentq(missing, p, LARGEST, args=(p,)) for p in PRESSURES])
        expected = curvature_of(model_with(surrogate), PROMPT, load, **still)
        np.testing.assert_allclose(found[row], expected[row], rtol=1e-8)
    top = np.array([LARGEST])
    np.testing.assert_allclose(
        curvature_of(model, conditions, top, **effect),
        curvature_of(model, PROMPT, top, **effect),
        rtol=1e-12,
    )


def test_friction_lags_behind_the_branch(surrogate):
    """p − w on the way up in any cycle, p + w on the way down."""
    still = {"emulator_error_pressure": 0.0}
    effect = sizes("hysteresis", **still)
    friction = effect["hysteresis.friction"]
    for conditions, lag in (
        (PROMPT, -friction),
        (ServiceConditions(cycle=2), -friction),
        (ServiceConditions(branch="unloading"), friction),
    ):
        found = curvature_of(model_with(surrogate, "hysteresis"), conditions, **effect)
        expected = curvature_of(model_with(surrogate), PROMPT, PRESSURES + lag, **still)
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_weight_acts_against_the_bend_of_what_bends_up(surrogate):
    effect = sizes("gravity")
    model = model_with(surrogate, "gravity")
    found = {m: curvature_of(model, ServiceConditions(mount=m), **effect)[0] for m in MOUNTS}
    np.testing.assert_array_equal(found["horizontal"], curvature_of(model, PROMPT, **effect)[0])
    assert np.all(found["hanging"] < found["horizontal"])
    assert np.all(found["bending_up"] != found["bending_down"])


ANSWERS = {
    "creep": {"hold_s"},
    "humidity_drift": {"hold_s", "humidity_pct"},
    "mullins": {"cycle", "branch"},
    "hysteresis": {"branch"},
    "gravity": {"mount"},
    "dry_embrittlement": {"humidity_pct"},
    "pressure_offset": set(),
}


@pytest.mark.parametrize("name", list(ANSWERS))
def test_what_no_cause_answers_to_is_known(surrogate, name):
    model = model_with(surrogate, name)
    chain = chain_at(model, **sizes(name))
    # one after another: on the second loading the branch alone makes no difference to Mullins
    asked = [replace(PROMPT, **{f: getattr(ALL, f)}) for f in ALL.changed if f != "humidity_pct"]
    asked.append(ServiceConditions(hold_s=600.0, humidity_pct=40.0))
    moved = set()
    for conditions in asked:
        still = moving_nothing(model, chain, LEVELS, conditions)
        moved |= set(conditions.changed) - set(still)
    assert moved == ANSWERS[name]


def test_humidity_without_time_moves_nothing_and_an_uncertain_rate_always_does(surrogate):
    model = model_with(surrogate, "humidity_drift")
    chain = chain_at(model, **sizes("humidity_drift"))
    dry = ServiceConditions(humidity_pct=30.0, degradation_sd=1.0)
    assert moving_nothing(model, chain, LEVELS, dry) == ("humidity_pct",)
    assert moving_nothing(model, chain, LEVELS, PROMPT) == ()


def test_dry_air_moves_rupture_and_in_the_air_of_the_storage_limits_are_those_of_films(surrogate):
    """At once, without a time in the room; what is fresh is weakened in no air."""
    weak = {"elongation_at_0": 30.0, "elongation_at_25": 12.0}
    dry, plain = model_with(surrogate, "dry_embrittlement"), model_with(surrogate)
    asked = {"degradation": LEVELS, "pressure": np.array([60.0, LARGEST]), "draws": 20}

    def burst(model, humidity, **size):
        chain, generator = chain_at(model, **weak, **size), np.random.default_rng(3)
        conditions = ServiceConditions(humidity_pct=humidity)
        found = rupture_table(model, chain, generator, **asked, conditions=conditions)
        return found["probability"].to_numpy().reshape(2, 2)

    typical = sizes("dry_embrittlement")
    stored, usual, drier = (burst(dry, humidity, **typical) for humidity in (67.0, 60.0, 50.0))
    np.testing.assert_array_equal(stored, burst(plain, 67.0))
    np.testing.assert_array_equal(usual, burst(dry, None, **typical))
    np.testing.assert_array_equal(usual[0], stored[0])
    np.testing.assert_array_equal(drier[0], stored[0])
    assert np.all(np.diff([stored[1], usual[1], drier[1]], axis=0) > 0.05)


# predictions are of the batch with which others are compared
ACTING = [
    cause
    for cause in CATALOGUE.values()
    if cause.acts_on != {"tensile"} and "batch" not in cause.needs
]


def test_a_warmer_room_moves_curvature_as_softer_material_and_a_batch_moves_nothing(surrogate):
    model = model_with(surrogate, "temperature_softening", "batch_stiffness")
    typical = sizes("temperature_softening", "batch_stiffness")
    warm, usual = (
        curvature_of(model, ServiceConditions(temperature_c=celsius), **typical)
        for celsius in (30.0, 24.0)
    )
    other = sizes("temperature_softening", **{"batch_stiffness.second": 0.0})
    np.testing.assert_array_equal(usual, curvature_of(model, PROMPT, **(typical | other)))
    softer = float(np.exp(-6.0 * find("temperature_softening").typical["softening"]))
    constants = [n for n in TRUTH if n.startswith(("c1_at", "c3_at"))]
    scaled = {name: softer * TRUTH[name] for name in constants}
    plain = model_with(surrogate)
    np.testing.assert_allclose(warm, curvature_of(plain, PROMPT, **scaled), rtol=2e-2)
    assert np.all(warm > 1.05 * usual)
    with pytest.raises(BayesdegError, match="degrees Celsius"):
        ServiceConditions(temperature_c=300.0)


@pytest.mark.parametrize("cause", ACTING, ids=lambda cause: cause.name)
def test_every_cause_with_a_size_moves_a_prediction_in_some_conditions(surrogate, cause):
    """Curvature or rupture, of what is in use. What acts on films alone moves the constants."""
    model = model_with(surrogate, cause.name)
    neutral = {cause.qualified(p.name): p.neutral for p in cause.parameters}
    found = []
    for values in (neutral, sizes(cause.name)):
        chain = chain_at(model, elongation_at_25=5.0, **values)
        asked = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 20, "conditions": ALL}
        bands = curvature_bands(model, chain, np.random.default_rng(3), **asked)
        rupture = rupture_table(model, chain, np.random.default_rng(3), **asked)
        found.append(np.append(bands["q50"], rupture["probability"]))
    assert np.all(np.isfinite(found))
    assert np.max(np.abs(found[1] - found[0])) > 1e-3


@pytest.mark.parametrize(
    ("name", "conditions"),
    [
        ("creep", ServiceConditions(hold_s=60.0)),
        ("humidity_drift", ServiceConditions(hold_s=600.0)),
        ("mullins", ServiceConditions(cycle=2)),
        ("gravity", ServiceConditions(mount="hanging")),
    ],
)
def test_causes_of_time_cycle_humidity_and_mount_move_control_and_risk(surrogate, name, conditions):
    model = model_with(surrogate, name)
    chain = chain_at(model, elongation_at_0=60.0, **sizes(name))
    prompt, used = (
        setting_for(
            draw_specimens(model, chain, np.random.default_rng(1), draws=30, conditions=one),
            *(0.0, 6.0),
            risk=0.3,
            first=LARGEST,
        )
        for one in (PROMPT, conditions)
    )
    assert abs(used.pressure / prompt.pressure - 1.0) > 3e-3
    assert used.curvature[2] == pytest.approx(6.0, rel=2e-3)
    softer = used.pressure < prompt.pressure
    assert softer == (name in {"creep", "mullins"})


def test_the_pressure_set_under_creep_is_less_by_its_share_of_the_load():
    """With a curvature of 40 p/C1 the pressure is known in closed form."""
    model = model_with(StraightLine(), "creep")
    effect = sizes("creep") | {"stiffness_scatter": 1e-9}
    chain = chain_at(model, **effect)
    held = ServiceConditions(hold_s=HOLD)
    specimens = draw_specimens(model, chain, np.random.default_rng(1), draws=5, conditions=held)
    found = setting_for(specimens, 0.0, 5.0, risk=0.05, first=LARGEST)
    share = 1.0 + effect["creep.amount"] * -np.expm1(-HOLD / effect["creep.time_constant"])
    straight = 1e3 * TRUTH["c1_at_0"] * np.cbrt(TRUTH["volume_ratio"]) * 5.0 / 40.0
    assert found.pressure == pytest.approx(straight / share, rel=1e-6)


def test_what_came_down_from_a_larger_pressure_may_have_burst_there(surrogate):
    model = model_with(surrogate)
    chain = chain_at(model, elongation_at_0=30.0)
    down, up = (
        respond(
            draw_specimens(model, chain, np.random.default_rng(1), draws=20, conditions=one),
            *(0.0, np.append(PRESSURES, LARGEST)),
        ).burst.mean(axis=0)
        for one in (ServiceConditions(branch="unloading"), PROMPT)
    )
    assert 0.02 < up[-1] < 0.98
    np.testing.assert_allclose(down, up[-1], rtol=1e-10)


def test_without_pressure_only_what_was_under_pressure_before_may_have_burst(surrogate):
    model = model_with(surrogate)
    chain = chain_at(model, elongation_at_0=30.0)
    fresh, down = (
        rupture_table(
            *(model, chain, np.random.default_rng(1)),
            degradation=np.array([0.0]),
            pressure=np.array([0.0, LARGEST]),
            draws=20,
            conditions=one,
        )["probability"].to_numpy()
        for one in (PROMPT, ServiceConditions(branch="unloading"))
    )
    assert fresh[0] == 0.0
    assert 0.02 < fresh[1] < 0.98
    np.testing.assert_allclose(down, fresh[1], rtol=1e-10)


def test_an_uncertain_degradation_widens_bands_by_its_share_of_the_stiffness(surrogate):
    """sd(ln κ) = |d ln κ/d ln E| · hypot(σ, d ln C1/dD · sd), to first order."""
    model = model_with(surrogate)
    chain = chain_at(model)
    at = np.array([12.5])
    widths = []
    for sd in (0.0, 1.0):
        bands = curvature_bands(
            *(model, chain, np.random.default_rng(2)),
            degradation=at,
            pressure=np.array([60.0]),
            draws=4000,
            conditions=ServiceConditions(degradation_sd=sd),
        )
        widths.append(np.log(bands["q95"][0] / bands["q05"][0]))
    sensitivity = model.world.material(values_of(), at).sensitivity[0, 0]
    scatter = TRUTH["stiffness_scatter"]
    expected = np.hypot(scatter, sensitivity) / scatter
    assert widths[1] / widths[0] == pytest.approx(expected, rel=0.02)


def test_each_draw_may_have_a_degradation_rate_of_its_own(surrogate):
    """As drawn one by one at known rates, in each draw's own material, with causes of the rate."""
    names = ("erosion", "degradation_misread", "creep")
    model = model_with(surrogate, *names)
    chain = chain_at(model, **sizes(*names))
    rates = np.array([3.0, 11.0, 19.0])
    for conditions in (PROMPT, ServiceConditions(hold_s=60.0)):
        drawn = draw_specimens(
            *(model, chain, np.random.default_rng(1)), draws=3, strata=2, conditions=conditions
        )
        found = respond(drawn, rates, PRESSURES)
        for i, rate in enumerate(rates):
            one = respond(drawn, rate, PRESSURES)
            rows = slice(2 * i, 2 * i + 2)
            np.testing.assert_allclose(found.curvature[rows], one.curvature[rows], rtol=1e-12)
            np.testing.assert_allclose(found.burst[i], one.burst[i], rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"hold_s": -1.0}, "hold_s -1 s"),
        ({"hold_s": np.nan}, "hold_s nan"),
        ({"cycle": 0}, "cycle 0"),
        ({"cycle": 1.5}, "cycle 1.5"),
        ({"branch": "up"}, "loading, unloading"),
        ({"humidity_pct": 101.0}, "0 to 100 %"),
        ({"mount": "bending"}, "bending_up"),
        ({"degradation_sd": -0.5}, "degradation_sd -0.5"),
    ],
)
def test_what_no_test_could_have_is_refused(given, words):
    with pytest.raises(BayesdegError, match=words):
        ServiceConditions(**given)
