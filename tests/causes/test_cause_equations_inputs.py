"""Causes that act on material and geometry: what they make of the inputs, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.inputs import gravity_direction
from bayesdeg.causes.batch_stiffness import scale_by_batch
from bayesdeg.causes.catalogue import find
from bayesdeg.causes.degraded_shrinkage import shrink_as_degraded
from bayesdeg.causes.degraded_skin import stiffen_skin
from bayesdeg.causes.delamination import loosen_paper
from bayesdeg.causes.erosion import thin_walls
from bayesdeg.causes.film_mismatch import stiffen_casting
from bayesdeg.causes.gauge_gain import scale_pressure
from bayesdeg.causes.gravity import weigh
from bayesdeg.causes.initial_curvature import shrink_on_paper
from bayesdeg.causes.paper_slack import slacken_paper
from bayesdeg.causes.paper_softening import soften_paper
from bayesdeg.causes.second_invariant import add_to_energy
from bayesdeg.causes.shrinkage_reading import resize
from bayesdeg.causes.temperature_softening import soften_in_warmth
from bayesdeg.causes.wall_thickness import thicken_walls
from bayesdeg.data.moisture import mass_loss_from_degradation
from tests.causes.default_actuator import (
    LEVELS,
    LOADING,
    conditions_of,
    effect,
    inputs_of,
)

INPUTS, CONDITIONS = inputs_of(), conditions_of()
MOUNTS = ("horizontal", "hanging", "bending_up", "bending_down")


def test_skin_stiffens_in_proportion_to_the_degradation_rate():
    skin = stiffen_skin(INPUTS, CONDITIONS, effect(skin_stiffening=[0.5, 1.0])).skin
    assert skin.shape == (2, 6, 1)
    np.testing.assert_allclose(skin[0, :, 0], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-15)
    np.testing.assert_allclose(skin[1], 2.0 * skin[0], rtol=1e-15)


def test_erosion_takes_a_share_of_two_millimetres_scaled_to_the_part():
    lost = thin_walls(INPUTS, CONDITIONS, effect(lost_share=0.1, growth=1.0)).erosion
    # 0.1 · 2 mm · 0.853 at 25 %
    np.testing.assert_allclose(lost[0, :, 0], 0.1706 * LEVELS[:, 0] / 25.0, rtol=1e-14)


def test_walls_may_be_eaten_later_than_the_gel_degrades():
    lost = thin_walls(INPUTS, CONDITIONS, effect(lost_share=0.1, growth=2.0)).erosion
    np.testing.assert_allclose(lost[0, :, 0], 0.1706 * (LEVELS[:, 0] / 25.0) ** 2, rtol=1e-14)


def test_a_degraded_part_keeps_a_share_of_its_volume_that_falls_linearly():
    scale = shrink_as_degraded(INPUTS, CONDITIONS, effect(lost_volume=[0.3, 0.6])).linear_scale
    kept = (scale[..., 0] / 0.853) ** 3
    np.testing.assert_allclose(kept[0], [1.0, 0.94, 0.88, 0.82, 0.76, 0.7], rtol=1e-13)
    np.testing.assert_allclose(1.0 - kept[1], 2.0 * (1.0 - kept[0]), atol=1e-14)


def test_scatter_of_rates_below_zero_makes_no_part_larger():
    scattered = conditions_of(degradation=np.array([[-3.0], [100.0]]))
    inputs = replace(INPUTS, linear_scale=np.ones((1, 1, 1)))
    scale = shrink_as_degraded(inputs, scattered, effect(lost_volume=0.5)).linear_scale[0, :, 0]
    np.testing.assert_allclose(scale, [1.0, np.cbrt(0.1)])  # a tenth of the volume stays


def test_the_typical_loss_of_volume_is_that_of_the_lost_mass_and_water():
    """Eq. 6 of the source for the dry mass, which then holds less water; 1.319 and 1 g/cm³."""
    water, dry = (m / (1.0 - m) for m in (0.15, 0.2))
    kept = 1.0 - mass_loss_from_degradation(25.0, moisture_initial_pct=20.0) / 100.0
    volume = kept * (1.0 / 1.3186 + water) / (1.0 / 1.3186 + dry)
    assert volume == pytest.approx(0.693, abs=1e-3)
    assert find("degraded_shrinkage").typical["lost_volume"] == pytest.approx(1 - volume, abs=0.01)


def test_a_gauge_is_off_either_way_and_so_is_its_zero():
    counted = replace(INPUTS, reference_pressure=np.full((1, 1, 1), 5.0))
    met = scale_pressure(counted, CONDITIONS, effect(gain=[0.03, -0.03]))
    np.testing.assert_allclose(met.pressure[:, 0], [1.03 * LOADING, 0.97 * LOADING])
    np.testing.assert_allclose(met.reference_pressure.ravel(), [5.15, 4.85])
    assert scale_pressure(INPUTS, CONDITIONS, effect(gain=0.03)).reference_pressure is None


def test_each_batch_has_its_own_stiffness():
    batch = np.array([[0], [1], [2], [3], [1], [4]])  # the last is beyond those that are compared
    tests = conditions_of(batch=batch)
    met = scale_by_batch(INPUTS, tests, effect(second=0.2, third=-0.1, fourth=0.3))
    want = [0.0, 0.2, -0.1, 0.3, 0.2, 0.0]
    for name in ("c1", "c2", "c3"):
        ratio = getattr(met, name) / getattr(INPUTS, name)
        np.testing.assert_allclose(np.log(ratio[0, :, 0]), want, atol=1e-14)
    np.testing.assert_array_equal(met.paper_stiffness, INPUTS.paper_stiffness)


def test_a_body_is_softer_in_a_warmer_room_and_its_paper_not():
    """By the median of its test; where nothing is recorded it is that of 24 °C."""
    room = np.full((6, 12), np.nan)
    room[1], room[2], room[3, 4:] = 29.0, 19.0, 34.0
    room[1, :3] = 40.0  # a door that was opened
    met = soften_in_warmth(INPUTS, conditions_of(temperature=room), effect(softening=0.02))
    for name in ("c1", "c2", "c3"):
        ratio = getattr(met, name) / getattr(INPUTS, name)
        np.testing.assert_allclose(np.log(ratio[0, :, 0]), [0.0, -0.1, 0.1, -0.2, 0, 0], atol=1e-14)
    np.testing.assert_array_equal(met.paper_stiffness, INPUTS.paper_stiffness)


def test_paper_keeps_a_share_that_halves_with_every_step():
    """exp(−a D/25 %) with a = 5 ln 2: half for each 5 % of degradation."""
    softened = soften_paper(INPUTS, CONDITIONS, effect(softening=5.0 * np.log(2.0), growth=1.0))
    want = [30000.0, 15000.0, 7500.0, 3750.0, 1875.0, 937.5]
    np.testing.assert_allclose(softened.paper_stiffness[0, :, 0], want, rtol=1e-13)


def test_paper_may_soften_later_than_the_gel_degrades():
    """exp(−a (D/25 %)²) with a = 25 ln 2: halved 1, 4, 9, 16 and 25 times."""
    softened = soften_paper(INPUTS, CONDITIONS, effect(softening=25.0 * np.log(2.0), growth=2.0))
    want = 3e4 * 0.5 ** np.array([0.0, 1.0, 4.0, 9.0, 16.0, 25.0])
    np.testing.assert_allclose(softened.paper_stiffness[0, :, 0], want, rtol=1e-12)


def test_paper_that_comes_off_is_in_series_with_a_compliance():
    """1/(E t)' = 1/(E t) + ρ (D/25 %)³/(C1 s h), with h = 5 mm."""
    loosened = loosen_paper(INPUTS, CONDITIONS, effect(looseness=0.8)).paper_stiffness
    share = 0.8 * (LEVELS[:, 0] / 25.0) ** 3
    held = 5.0 * 1e3 * (INPUTS.c1 * INPUTS.linear_scale)[0, :, 0]  # N/m
    np.testing.assert_allclose(1.0 / loosened[0, :, 0], 1.0 / 3e4 + share / held, rtol=1e-13)


@pytest.mark.parametrize(
    ("apply", "parameter", "field"),
    [
        (loosen_paper, "looseness", "paper_stiffness"),
        (stiffen_skin, "skin_stiffening", "skin"),
        (thin_walls, "lost_share", "erosion"),
        (soften_paper, "softening", "paper_stiffness"),
    ],
)
def test_what_degradation_does_leaves_fresh_specimens(apply, parameter, field):
    size = effect(**{parameter: 0.2, "growth": 1.0})
    changed = getattr(apply(INPUTS, CONDITIONS, size), field)[0, :, 0]
    rest = 3e4 if field == "paper_stiffness" else 0.0
    assert changed[0] == rest
    assert np.all(np.diff(np.abs(changed - rest)) > 0.0)


@pytest.mark.parametrize(
    ("apply", "parameter", "field", "value", "want"),
    [
        (slacken_paper, "slack", "paper_slack", 0.01, 0.01),
        (shrink_on_paper, "mismatch", "paper_mismatch", -0.005, -0.005),
        (thicken_walls, "excess", "wall_factor", -0.08, 0.92),
        (resize, "scale_error", "linear_scale", -0.2, 0.6824),
        (stiffen_casting, "log_ratio", "c1", np.log(1.25), 0.36),
        (stiffen_casting, "log_ratio", "c2", np.log(1.25), -0.005),
        (stiffen_casting, "log_ratio", "c3", np.log(1.25), 0.0015),
        (add_to_energy, "ratio", "second_invariant", 0.5, 0.144),
    ],
)
def test_one_number_for_a_fresh_specimen(apply, parameter, field, value, want):
    changed = getattr(apply(INPUTS, CONDITIONS, effect(**{parameter: value})), field)
    assert np.broadcast_to(changed, (1, 6, 1))[0, 0, 0] == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize(
    ("cause", "field", "before", "together"),
    [
        ("degraded_skin", "skin", 0.2, 0.9),
        ("erosion", "erosion", 0.1, 0.1 + 0.1706),
        ("paper_slack", "paper_slack", 0.004, 0.014),
        ("initial_curvature", "paper_mismatch", -0.01, 0.01),
        ("wall_thickness", "wall_factor", 0.9, 0.972),
        ("second_invariant", "second_invariant", 0.1, 0.1 + 0.794),
        ("film_mismatch", "second_invariant", 0.1, 0.1 * np.exp(0.12)),
        ("degraded_shrinkage", "linear_scale", 0.8, 0.8 * np.cbrt(0.69)),
    ],
)
def test_what_others_did_before_is_kept(cause, field, before, together):
    """At 25 % and the typical size of each."""
    cause = find(cause)
    inputs = replace(INPUTS, **{field: np.full((1, 1, 1), before)})
    after = getattr(cause.on_inputs(inputs, CONDITIONS, effect(**cause.typical)), field)
    at_25 = np.broadcast_to(after, (1, 6, 1))[0, -1, 0]
    assert at_25 == pytest.approx(together, rel=1e-12)


def test_a_stiffer_casting_has_no_second_invariant_of_its_own():
    assert stiffen_casting(INPUTS, CONDITIONS, effect(log_ratio=0.1)).second_invariant is None


def test_second_invariant_follows_the_stiffness_of_each_specimen():
    found = add_to_energy(INPUTS, CONDITIONS, effect(ratio=[0.0, 0.4])).second_invariant
    np.testing.assert_array_equal(found[0], 0.0)
    np.testing.assert_allclose(found[1] / INPUTS.c1[0], 0.4, rtol=1e-15)


def test_weight_points_where_the_mount_says():
    mount = np.repeat(np.array(MOUNTS)[:, None], 12, axis=1)
    inputs = weigh(INPUTS, conditions_of(degradation=LEVELS[:4], mount=mount), effect(density=1e3))
    along, up = inputs.weight_along[0, :, 0], inputs.weight_up[0, :, 0]
    np.testing.assert_allclose(along, [0.0, 9.80665, 0.0, 0.0], rtol=1e-15)  # kN/m³
    np.testing.assert_allclose(up, [0.0, 0.0, 9.80665, -9.80665], rtol=1e-15)
    assert inputs.weight_along.shape == (1, 4, 1)  # one material a curve


def test_a_specimen_that_is_mounted_anew_gets_a_weight_for_each_reading():
    mount = np.array([["horizontal"] * 6 + ["bending_up"] * 6])
    inputs = weigh(INPUTS, conditions_of(degradation=LEVELS[:1], mount=mount), effect(density=1e3))
    np.testing.assert_array_equal(inputs.weight_up[0, 0, :6], 0.0)
    np.testing.assert_allclose(inputs.weight_up[0, 0, 6:], 9.80665)


@pytest.mark.parametrize("mount", MOUNTS)
def test_weight_adds_to_what_was_there(mount):
    rest = replace(INPUTS, weight_along=np.ones((1, 1, 1)), weight_up=np.ones((1, 1, 1)))
    inputs = weigh(rest, conditions_of(mount=mount), effect(density=1e3))
    along, up = gravity_direction(mount)
    np.testing.assert_allclose(inputs.weight_along, 1.0 + 9.80665 * along)
    np.testing.assert_allclose(inputs.weight_up, 1.0 + 9.80665 * up)


def test_pressures_are_left_by_causes_of_material_and_geometry():
    for name in ("degraded_skin", "erosion", "paper_softening", "wall_thickness", "gravity"):
        cause = find(name)
        after = cause.on_inputs(INPUTS, CONDITIONS, effect(**cause.typical))
        np.testing.assert_array_equal(after.pressure[0, 0], LOADING)
