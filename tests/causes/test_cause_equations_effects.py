"""What causes do to the curvature of the default actuator, by the shipped emulator."""

from dataclasses import fields, replace

import numpy as np
import pytest

from bayesdeg.actuator.inputs import material_groups
from bayesdeg.causes.catalogue import CATALOGUE, find
from tests.causes.default_actuator import (
    LEVELS,
    LOADING,
    THERE_AND_BACK,
    change,
    conditions_of,
    effect,
    inputs_of,
    surrogate,
    typical,
)

ON_INPUTS = tuple(cause for cause in CATALOGUE.values() if cause.on_inputs is not None)
RICH = {
    "mount": "hanging",
    "humidity": 58.0,
    "temperature": 25.0,
    "batch": np.array([[0], [1], [2], [3], [1], [2]]),
}
# of 400 draws from its prior, how many leave every reading of six levels by twelve pressures
# within the emulator's range; those that do not are refused at the last steps of fresh specimens,
# which balloon at 261 kPa, or at 25 % where the paper is too soft
SMALL = 0.2  # % of the curvature that an emulator may err by from pressure to pressure
SHARE_WITHIN = {"creep": 1.0}


def there_and_back(**recorded):
    return inputs_of(THERE_AND_BACK), conditions_of(THERE_AND_BACK, **recorded)


def changed(name, **values):
    """Percent, of fresh and 25 % degraded specimens at the default's pressures."""
    found = change(find(name), inputs_of(), conditions_of(), effect(**values) if values else None)
    return found[0], found[-1]


@pytest.mark.parametrize("cause", ON_INPUTS, ids=lambda cause: cause.name)
def test_neutral_values_change_no_bit_of_a_prediction(cause):
    inputs, conditions = there_and_back(**RICH)
    neutral = effect(**{p.name: [p.neutral] for p in cause.parameters})
    beyond = surrogate().continued  # with the distance outside its range
    before, after = (beyond(i) for i in (inputs, cause.on_inputs(inputs, conditions, neutral)))
    for field in fields(before):
        a, b = getattr(before, field.name), getattr(after, field.name)
        if a is None:  # it was not asked for
            assert b is None
            continue
        np.testing.assert_array_equal(np.broadcast_to(a, b.shape), b, err_msg=field.name)


@pytest.mark.parametrize("cause", ON_INPUTS, ids=lambda cause: cause.name)
def test_a_specimen_stays_one_material_along_its_curve(cause):
    """What a load path of the finite element model needs."""
    after = cause.on_inputs(*there_and_back(**RICH), typical(cause))
    for name, group in material_groups(after).items():
        assert np.shape(group)[-1] == 1, name


@pytest.mark.parametrize("cause", ON_INPUTS, ids=lambda cause: cause.name)
def test_a_walker_is_alone(cause):
    inputs, conditions = there_and_back(**RICH)
    generator = np.random.default_rng(8)
    draws = {p.name: p.law.sample(generator, 3) for p in cause.parameters}
    together = surrogate()(cause.on_inputs(inputs, conditions, effect(**draws)))
    for walker in range(3):
        alone = effect(**{name: value[walker] for name, value in draws.items()})
        one = surrogate()(cause.on_inputs(inputs, conditions, alone))
        np.testing.assert_allclose(together.curvature[walker], one.curvature[0], rtol=1e-12)


@pytest.mark.parametrize("cause", ON_INPUTS, ids=lambda cause: cause.name)
def test_prior_draws_stay_within_the_emulators_range(cause):
    inputs, conditions = inputs_of(), conditions_of(**RICH)
    generator = np.random.default_rng(0)
    draws = {p.name: p.law.sample(generator, 400) for p in cause.parameters}
    status = surrogate()(cause.on_inputs(inputs, conditions, effect(**draws))).status
    assert np.mean(status == 0) > 0.98
    whole = np.mean(np.all(status == 0, axis=(1, 2)))
    assert whole == pytest.approx(SHARE_WITHIN.get(cause.name, 1.0), abs=0.04)


@pytest.mark.parametrize("cause", ON_INPUTS, ids=lambda cause: cause.name)
def test_typical_sizes_stay_within_the_emulators_range(cause):
    """But for creep, under which fresh specimens balloon before 240 kPa."""
    inputs, conditions = inputs_of(), conditions_of(**RICH)
    status = surrogate()(cause.on_inputs(inputs, conditions, typical(cause))).status[0]
    assert np.all(status[1:] == 0)
    assert np.all(status[0, : 10 if cause.name == "creep" else 12] == 0)


@pytest.mark.parametrize(
    "name", ["degraded_skin", "degraded_shrinkage", "delamination", "erosion", "paper_softening"]
)
def test_effects_of_degradation_grow_with_it_from_nothing(name):
    found = change(find(name), inputs_of(), conditions_of())
    np.testing.assert_allclose(found[0], 0.0, atol=1e-12)
    assert np.all(np.diff(np.abs(found[:, 5])) > 0.0)


def test_a_degraded_skin_takes_a_few_percent_of_the_curvature():
    _, degraded = changed("degraded_skin")
    assert np.all((degraded > -5.0) & (degraded < -3.0))


def test_eroded_walls_bend_more():
    _, small = changed("erosion", lost_share=0.05, growth=1.0)
    _, large = changed("erosion", lost_share=0.15, growth=1.0)
    np.testing.assert_allclose(small, 11.0, atol=0.5)
    np.testing.assert_allclose(large, 36.0, atol=1.5)


def test_softer_paper_bends_the_slotted_actuator_more():
    """Bend angle too: it is not that the bottom line gets shorter."""
    _, degraded = changed("paper_softening", softening=2.1, growth=1.0)
    assert np.all((degraded > 8.5) & (degraded < 12.0))
    assert np.all(np.diff(degraded) < 0.0)
    inputs, conditions = inputs_of(), conditions_of()
    softening = effect(softening=2.1, growth=1.0)
    softer = find("paper_softening").on_inputs(inputs, conditions, softening)
    before, after = (surrogate()(i).bend_angle[0, -1] for i in (inputs, softer))
    assert np.all(after > before)


def test_paper_that_comes_off_lets_the_slotted_actuator_bend_more():
    """With half of its length off, where ρ is 1.0, as the finite elements of `CONVERGED` do."""
    _, degraded = changed("delamination", looseness=1.0)
    # at 40 and 200 kPa, benchmarks/rules.py on that mesh
    assert degraded[[1, 9]] == pytest.approx([8.14, 7.37], abs=0.5)
    assert np.all(np.diff(degraded) < 0.0)


def test_slack_paper_is_felt_at_low_pressure():
    fresh, degraded = changed("paper_slack")
    for found in (fresh, degraded):
        assert np.all(np.diff(found) < SMALL)
        assert np.all(found > -SMALL)
    assert fresh[0] == pytest.approx(13.0, abs=1.0)
    assert fresh[-1] < 1.0
    assert np.all(degraded > fresh)  # stiff specimens pull it straight later


def test_thicker_walls_bend_less_in_nearly_constant_ratio():
    for excess, size in ((0.1, -18.6), (-0.1, 23.2)):
        fresh, degraded = changed("wall_thickness", excess=excess)
        both = np.concatenate([fresh[:6], degraded])
        np.testing.assert_allclose(both, size, atol=1.2)


def test_a_smaller_part_bends_in_constant_ratio_by_the_same_angle():
    inputs, conditions, cause = inputs_of(), conditions_of(), find("shrinkage_reading")
    smaller = cause.on_inputs(inputs, conditions, effect(scale_error=-0.2))
    before, after = surrogate()(inputs), surrogate()(smaller)
    ratio = after.curvature / before.curvature
    np.testing.assert_allclose(ratio, 1.25, rtol=8e-3)
    np.testing.assert_allclose(after.bend_angle / before.bend_angle, 1.0, atol=8e-3)
    assert np.ptp(ratio[0, 0]) < 2e-3


def test_a_stiffer_casting_is_a_gauge_that_is_off_by_a_factor():
    """But for the share of the paper, which does not stiffen with the gel."""
    inputs, conditions = inputs_of(), conditions_of()
    stiff = find("film_mismatch").on_inputs(inputs, conditions, effect(log_ratio=0.1))
    gauge = find("gauge_gain").on_inputs(inputs, conditions, effect(gain=np.exp(-0.1) - 1.0))
    scaled = replace(gauge, paper_stiffness=gauge.paper_stiffness * np.exp(-0.1))
    one, other, near = (surrogate()(i).curvature for i in (stiff, scaled, gauge))
    np.testing.assert_allclose(one, other, rtol=1e-11)
    np.testing.assert_allclose(one, near, rtol=6e-3)
    assert np.all(one < surrogate()(inputs).curvature)


def test_prestress_by_shrinking_is_hardly_seen():
    fresh, degraded = changed("initial_curvature", mismatch=0.01)
    for found in (fresh, degraded):
        assert np.all((found > 0.3) & (found < 1.0))


def test_the_second_invariant_takes_most_at_high_pressure_in_fresh_material():
    fresh, degraded = changed("second_invariant")
    assert np.all(np.diff(fresh) < SMALL)
    assert fresh[-1] == pytest.approx(-22.6, abs=1.0)
    assert np.ptp(degraded) < 1.0
    assert np.all(degraded < 0.0)


@pytest.mark.parametrize(
    ("mount", "low", "high"),
    [
        ("horizontal", 0.0, 0.0),
        ("hanging", -1.8, -1.4),
        ("bending_up", -0.1, 0.6),
        ("bending_down", -0.7, 0.0),
    ],
)
def test_weight_acts_by_the_mount(mount, low, high):
    """Within 0.7 % of the curvature: the emulator knows so small an effect no better."""
    found = change(find("gravity"), inputs_of(), conditions_of(mount=mount))
    room = 0.0 if mount == "horizontal" else 0.7
    assert np.all((low - room <= found[0]) & (found[0] <= high + room))
    assert np.all(np.abs(found[-1]) < 0.5)


def test_drying_takes_curvature_with_time_in_fresh_specimens_too():
    found = change(find("humidity_drift"), inputs_of(), conditions_of(hold=60.0))
    np.testing.assert_array_equal(found[:, 0], 0.0)
    assert np.all(np.diff(found, axis=1) < 0.0)


def test_creep_adds_curvature_and_lags_on_unloading():
    inputs, conditions = there_and_back()
    found = change(find("creep"), inputs, conditions)[1:]
    assert np.all(found[:, 1:] > 0.0)
    assert np.all(found[:, :11:-1] > found[:, :11])


def test_mullins_softens_the_way_back_only():
    inputs, conditions = there_and_back()
    found = change(find("mullins"), inputs, conditions)
    np.testing.assert_array_equal(found[:, :12], 0.0)
    assert np.all(found[:, 12:] > 0.0)
    assert np.all(np.diff(found[:, 12:].max(axis=1)) < 0.0)  # stiffer ones were stretched less


def test_creep_and_drying_have_opposite_signs():
    inputs, conditions = inputs_of(LOADING), conditions_of(LOADING)
    creep, drying = (
        change(find(name), inputs, conditions)[1:, 1:] for name in ("creep", "humidity_drift")
    )
    assert np.all(creep * drying < 0.0)


def test_every_level_of_the_default_actuator_is_within_the_range_itself():
    assert not np.any(surrogate()(inputs_of(degradation=LEVELS)).status)


def test_a_part_that_shrinks_as_it_degrades_bends_as_far_over_a_shorter_length():
    """Curvature grows by a seventh at 25 % and all pressures, the angle changes by the paper."""
    fresh, degraded = changed("degraded_shrinkage")
    np.testing.assert_allclose(fresh, 0.0, atol=1e-12)
    np.testing.assert_allclose(degraded, 12.7, atol=0.2)
    cause = find("degraded_shrinkage")
    inputs, conditions = inputs_of(), conditions_of()
    before = surrogate()(inputs).bend_angle
    after = surrogate()(cause.on_inputs(inputs, conditions, typical(cause))).bend_angle
    np.testing.assert_allclose(after[0, -1] / before[0, -1] - 1.0, -0.004, atol=0.001)


def test_a_gauge_reads_like_another_material():
    """(1 + g) p on C and E t is p on C/(1 + g) and E t/(1 + g)."""
    gain = changed("gauge_gain", gain=0.04)
    softer = inputs_of()
    softer = replace(
        softer,
        c1=softer.c1 / 1.04,
        c2=softer.c2 / 1.04,
        c3=softer.c3 / 1.04,
        paper_stiffness=softer.paper_stiffness / 1.04,
    )
    before = surrogate()(inputs_of()).curvature
    want = 100.0 * (surrogate()(softer).curvature / before - 1.0)[0]
    np.testing.assert_allclose(gain, [want[0], want[-1]], rtol=1e-9)
