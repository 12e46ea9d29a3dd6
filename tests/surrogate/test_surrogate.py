"""The trained map against its formulae, written out point by point."""

import dataclasses
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate.scaling import GROUPS
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.terms import Terms
from tests.surrogate.term_sums import (
    END,
    GROWTH,
    OPTIONAL,
    SECOND,
    SPAN,
    TOGETHER,
    groups_by_hand,
    limit_by_hand,
    predict_by_hand,
    random_inputs,
    random_terms,
    small_surrogate,
    taken,
    value_of,
)

SURROGATE = small_surrogate()
VALUES = (
    "curvature",
    "bend_angle",
    "peak_stretch",
    "sd",
    "bend_angle_sd",
    "peak_stretch_sd",
)
BY_DIFFERENCES = ("slope", "sd", "bend_angle_sd", "peak_stretch_sd")  # by hand


def compare_by_hand(inputs, surrogate=SURROGATE):
    """Return the share of the points that are allowed."""
    got = surrogate(inputs)
    for index in np.ndindex(got.curvature.shape):
        place = (got.curvature.shape, index)
        scale = float(np.broadcast_to(inputs.linear_scale, place[0])[index])
        want = predict_by_hand(surrogate, groups_by_hand(inputs, place), scale)
        assert (got.status[index] == 0) == want["allowed"]
        for name in (*VALUES, "slope"):
            value = getattr(got, name)[index]
            if want["allowed"]:
                rel = 1e-7 if name in BY_DIFFERENCES else 1e-11
                assert value == pytest.approx(want[name], rel=rel), name
            else:
                assert np.isnan(value), name
    return float(np.mean(got.status == 0))


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    given_fields=st.sets(st.sampled_from(sorted(OPTIONAL))),
    columns=st.integers(1, 4),
)
def test_it_follows_its_formulae(seed, given_fields, columns):
    inputs = random_inputs(
        np.random.default_rng(seed), (2, 3), given=sorted(given_fields), columns=columns
    )
    compare_by_hand(inputs)


def test_most_of_the_points_compared_are_allowed_and_some_are_not():
    inputs = random_inputs(np.random.default_rng(0), (40,), given=sorted(OPTIONAL), columns=3)
    inputs = dataclasses.replace(inputs, pressure=np.array([1.5, 2.0, 3.0]) * inputs.pressure)
    assert 0.5 < compare_by_hand(inputs) < 1.0


def test_materials_that_change_along_a_curve_are_points_of_their_own():
    generator = np.random.default_rng(1)
    inputs = random_inputs(generator, (4, 3), given=["skin", "paper_slack"], columns=5)
    skin = generator.uniform(0.1, 1.0, (3, 5))
    compare_by_hand(dataclasses.replace(inputs, skin=skin))


def test_scalars_and_lists_of_points_are_answered_too():
    inputs = random_inputs(np.random.default_rng(2), (4,), given=["erosion"])
    flat = taken(inputs, np.s_[:, 0])
    whole, lists = SURROGATE(inputs), SURROGATE(flat)
    np.testing.assert_allclose(lists.curvature, whole.curvature[:, 0], rtol=1e-13)
    one = taken(inputs, (2, 0))
    assert SURROGATE(one).curvature.shape == ()
    assert SURROGATE(one).curvature == pytest.approx(whole.curvature[2, 0], rel=1e-13)


def test_walkers_are_the_same_one_at_a_time():
    generator = np.random.default_rng(3)
    walkers = random_inputs(generator, (6, 1), given=["wall_factor"])
    pressure = generator.uniform(1.0, 60.0, (5, 4))
    together = SURROGATE(dataclasses.replace(walkers, pressure=pressure))
    assert together.curvature.shape == (6, 5, 4)
    for walker in range(6):
        alone = SURROGATE(dataclasses.replace(taken(walkers, walker), pressure=pressure))
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[walker])


def base_inputs(load=0.2, **fields):
    """A material in the middle of the range, at moulded size, with C1 = 0.4 MPa."""
    base = {
        "c1": 0.4,
        "c2": 0.0,
        "c3": 0.4 * float(np.exp(np.mean([GROUPS[1].low, GROUPS[1].high]))),
        "linear_scale": 0.85,
        "paper_stiffness": 3e4,
    }
    arrays = {name: np.atleast_1d(np.asarray(v, float)) for name, v in (base | fields).items()}
    return Inputs(pressure=400.0 * np.atleast_1d(np.asarray(load, float)), **arrays)


def test_nothing_bends_at_zero_pressure():
    inputs = random_inputs(np.random.default_rng(4), (30,), given=["skin", "paper_slack"])
    rest = SURROGATE(dataclasses.replace(inputs, pressure=np.zeros(3)))
    np.testing.assert_array_equal(rest.status, 0)
    for name in ("curvature", "bend_angle", "slope", "sd", "bend_angle_sd", "peak_stretch_sd"):
        np.testing.assert_array_equal(getattr(rest, name), 0.0, err_msg=name)
    np.testing.assert_array_equal(rest.peak_stretch, 1.0)


def test_misfit_and_weight_stretch_at_zero_pressure():
    rest = SURROGATE(base_inputs(0.0, paper_mismatch=0.02))
    assert rest.peak_stretch[0] > 1.001
    assert rest.peak_stretch_sd[0] > 0.0
    assert rest.curvature[0] == 0.0


def test_slope_is_the_derivative_by_the_logarithm_of_pressure():
    inputs = random_inputs(np.random.default_rng(5), (60,), given=sorted(OPTIONAL), columns=2)
    here, h = SURROGATE(inputs), 1e-5
    up, down = (
        SURROGATE(dataclasses.replace(inputs, pressure=inputs.pressure * np.exp(d)))
        for d in (h, -h)
    )
    ok = (here.status == 0) & (up.status == 0)
    assert ok.mean() > 0.5
    np.testing.assert_allclose(
        here.slope[ok], ((up.curvature - down.curvature) / (2 * h))[ok], rtol=1e-7, atol=1e-9
    )


@pytest.mark.parametrize("slack", [0.0, 0.01])
def test_curvature_is_smooth_in_pressure(slack):
    load = np.linspace(0.0, 0.4, 4001)
    bent = SURROGATE(base_inputs(load, paper_slack=slack))
    assert np.all(bent.status == 0)
    curvature, step = bent.curvature, load[1] - load[0]
    second = np.diff(curvature, 2) / step**2
    # a kink would leave a second difference of order 1/step
    assert np.max(np.abs(np.diff(second))) < 0.02 * np.max(np.abs(second))
    trapezium = np.sum(0.5 * (bent.slope[1:-1] / load[1:-1] + bent.slope[2:] / load[2:])) * step
    assert trapezium == pytest.approx(curvature[-1] - curvature[1], rel=1e-5)


ABSENT = {"paper_thickness": 0.1, "wall_factor": 1.0}
ARRAYS = [one.name for one in dataclasses.fields(Prediction) if one.name != "further"]


def test_neutral_fields_are_the_same_as_none():
    inputs = random_inputs(np.random.default_rng(6), (20,), columns=3)
    neutral = {name: np.full(1, ABSENT.get(name, 0.0)) for name in OPTIONAL}
    plain, spelt = SURROGATE(inputs), SURROGATE(dataclasses.replace(inputs, **neutral))
    for name in ARRAYS:
        np.testing.assert_allclose(getattr(spelt, name), getattr(plain, name), rtol=1e-12)


def test_one_active_cause_in_a_batch_leaves_the_others_as_they_are():
    inputs = random_inputs(np.random.default_rng(7), (20,), columns=3)
    changes = {}
    for name in OPTIONAL:
        value = np.full((20, 1), ABSENT.get(name, 0.0))
        value[0] = OPTIONAL[name][1]
        changes[name] = value
    plain, full = SURROGATE(inputs), SURROGATE(dataclasses.replace(inputs, **changes))
    for name in ARRAYS:
        a, b = getattr(plain, name), getattr(full, name)
        np.testing.assert_allclose(b[1:], a[1:], rtol=1e-12, err_msg=name)


def differences(inputs, name, size):
    step = np.full(np.shape(getattr(inputs, name)), size)
    up, down = (
        SURROGATE(dataclasses.replace(inputs, **{name: getattr(inputs, name) + sign * step}))
        for sign in (1, -1)
    )
    ok = (up.status == 0) & (down.status == 0)
    return ok, (up.curvature - down.curvature) / (2 * size)


STEPS = {
    "pressure": 1e-3,
    "c1": 1e-6,
    "c2": 1e-6,
    "c3": 1e-8,
    "linear_scale": 1e-6,
    "paper_stiffness": 1e-1,
    "second_invariant": 1e-6,
    "skin": 1e-5,
    "paper_thickness": 1e-6,
    "paper_slack": 1e-7,
    "paper_mismatch": 1e-7,
    "weight_along": 1e-4,
    "weight_up": 1e-4,
    "wall_factor": 1e-5,
    "erosion": 1e-5,
    "reference_pressure": 1e-3,
}


@pytest.mark.parametrize("reference", [False, True])
def test_gradient_is_that_of_central_differences(reference):
    inputs = random_inputs(np.random.default_rng(8), (25,), given=sorted(OPTIONAL), columns=2)
    if reference:
        inputs = dataclasses.replace(inputs, reference_pressure=0.3 * inputs.pressure[:, :1])
    gradient = SURROGATE.gradient(inputs)
    steps = {n: h for n, h in STEPS.items() if reference or n != "reference_pressure"}
    assert set(gradient) == set(steps)
    here = SURROGATE(inputs)
    for name, size in steps.items():
        ok, slope = differences(inputs, name, size)
        ok &= here.status == 0
        assert ok.mean() > 0.5, name
        scale = np.max(np.abs(slope[ok]))
        np.testing.assert_allclose(
            gradient[name][ok], slope[ok], rtol=1e-6, atol=1e-6 * scale, err_msg=name
        )
        assert np.all(np.isnan(gradient[name][here.status != 0])), name


def test_gradient_by_causes_at_neutral_values_and_of_fields_that_are_given():
    inputs = base_inputs(np.array([0.1, 0.3]), skin=0.0, wall_factor=1.0)
    gradient = SURROGATE.gradient(inputs)
    six = {"pressure", "c1", "c2", "c3", "linear_scale", "paper_stiffness"}
    assert set(gradient) == six | {"skin", "wall_factor"}
    _, slope = differences(inputs, "wall_factor", 1e-5)
    np.testing.assert_allclose(gradient["wall_factor"], slope, rtol=1e-6)
    more = SURROGATE(dataclasses.replace(inputs, skin=np.array([1e-6]))).curvature
    slope = (more - SURROGATE(inputs).curvature) / 1e-6
    np.testing.assert_allclose(gradient["skin"], slope, rtol=1e-4)


def test_gradient_by_pressure_at_rest_is_the_first_slope():
    gradient = SURROGATE.gradient(base_inputs(0.0))
    little = SURROGATE(base_inputs(1e-9))
    assert gradient["pressure"][0] == pytest.approx(little.curvature[0] / 400e-9, rel=1e-7)
    assert gradient["c1"][0] == 0.0


def out_of(name, side):
    """An input that puts one group beyond an end of its range by a thousandth of it."""
    group = next(group for group in GROUPS if group.name == name)
    value = group.high if side > 0 else group.low
    value += side * 1e-3 * (group.high - group.low)
    c1, scale = 0.4, 0.85
    c3 = base_inputs().c3[0]
    return {
        "softening": lambda: {"c2": value * np.sqrt(3 * c3 * c1)},
        "log_stiffening": lambda: {"c3": c1 * np.exp(value)},
        "log_paper": lambda: {"paper_stiffness": 1e3 * c1 * scale * np.exp(value)},
        "second_invariant": lambda: {
            "second_invariant": 2 * np.sqrt(3) * value * c1 / (1 - value),
            "c3": c3 / (1 - value),
            "paper_stiffness": 3e4 / (1 - value),
        },
        "paper_thickness": lambda: {"paper_thickness": value * scale},
        "erosion": lambda: {"erosion": value * scale},
        "gravity_along": lambda: {"weight_along": 1e6 * value * c1 / scale},
        "gravity_up": lambda: {"weight_up": 1e6 * value * c1 / scale},
    }.get(name, lambda: {name: value})()


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("name", [group.name for group in GROUPS])
def test_groups_out_of_range_are_refused_and_named(name, side):
    group = next(group for group in GROUPS if group.name == name)
    inside, outside = base_inputs(0.05), base_inputs(np.full(3, 0.05), **out_of(name, side))
    assert SURROGATE.refusals(inside) == {}
    refused = SURROGATE(outside)
    assert Status(int(refused.status[0])) is Status.OUTSIDE_TRAINING
    for value in (*VALUES, "slope"):
        assert np.all(np.isnan(getattr(refused, value))), value
    (text,) = SURROGATE.refusals(outside).values()
    assert list(SURROGATE.refusals(outside)) == [name]
    assert f"{group.low:.4g} to {group.high:.4g}" in text
    assert "3 of 3 values" in text
    assert group.unit == "–" or group.unit in text


def test_the_worst_of_several_values_is_named():
    inputs = base_inputs(0.05, skin=np.array([[0.1], [1.3], [1.9], [0.2]]))
    text = SURROGATE.refusals(inputs)["skin"]
    assert "reaches 1.9," in text
    assert "2 of 4 values" in text
    assert SURROGATE(inputs).status[:, 0].astype(bool).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("load", "words"),
    [(-1e-6, "reaches -1e-06"), (np.nan, "not a number"), (np.inf, "reaches inf"), (2.0, "1.25")],
)
def test_loads_that_were_not_trained_are_refused_and_named(load, words):
    inputs = base_inputs([0.05, load])
    assert SURROGATE(inputs).status.astype(bool).tolist() == [False, True]
    found = SURROGATE.refusals(inputs)
    assert list(found) == ["load"]
    assert words in found["load"]
    assert "1 of 2 values" in found["load"]


def test_a_curve_that_still_rises_ends_at_the_largest_swelling():
    """q = t/64: the largest load then lies beyond the swelling of 14."""
    straight = Terms(np.zeros((1, 13), dtype=np.int64), np.array([[-np.log(64.0)]]))
    free = dataclasses.replace(SURROGATE, load=straight)
    last = 14.0 / 64.0
    assert free(base_inputs(last * (1 - 1e-9))).status[0] == 0
    beyond = base_inputs(last * (1 + 1e-9))
    assert free(beyond).status[0] == Status.OUTSIDE_TRAINING
    assert np.isposinf(free.limit_pressure(beyond).pressure[0])


@pytest.mark.parametrize(
    ("c1", "c2", "c3"), [(-0.3, 0.0, 0.01), (0.0, 0.0, 0.01), (0.3, 0.0, -0.01), (0.3, 0.0, 0.0)]
)
def test_impossible_materials_are_refused_and_named(c1, c2, c3):
    inputs = base_inputs(0.05, c1=c1, c2=c2, c3=c3)
    assert Status(int(SURROGATE(inputs).status[0])) is Status.OUTSIDE_TRAINING
    assert "log_stiffening" in SURROGATE.refusals(inputs)
    assert all(np.isnan(v[0]) for v in SURROGATE.gradient(inputs).values())


def test_a_limit_is_the_largest_load_of_the_formulae_if_that_is_trained():
    inputs = random_inputs(np.random.default_rng(9), (30,), given=sorted(OPTIONAL))
    limit = SURROGATE.limit_pressure(inputs)
    assert limit.pressure.shape == limit.sd.shape == (30, 1)
    for row in range(30):
        place = ((30, 1), (row, 0))
        at = groups_by_hand(inputs, place)
        modulus = value_of(inputs, "c1", place, None) + SECOND * value_of(
            inputs, "second_invariant", place, 0.0
        )
        load, error = limit_by_hand(SURROGATE, at)
        assert limit.pressure[row, 0] == pytest.approx(1e3 * modulus * load, rel=1e-7)
        assert limit.sd[row, 0] == pytest.approx(error * limit.pressure[row, 0], rel=1e-6)
    known = np.isfinite(limit.pressure)
    assert 5 < known.sum() < 30
    error = limit.sd[known] / limit.pressure[known]
    assert np.ptp(error) > 0.1 * np.mean(error)  # it is a table of its own


def test_loads_are_refused_from_shortly_below_the_limit():
    inputs = random_inputs(np.random.default_rng(9), (30,), given=sorted(OPTIONAL))
    limit = SURROGATE.limit_pressure(inputs)
    known = np.isfinite(limit.pressure[:, 0])
    inputs = taken(inputs, known)
    end = END * limit.pressure[known]
    below, above = (dataclasses.replace(inputs, pressure=end * (1 + d)) for d in (-1e-9, 1e-9))
    assert known.sum() > 5
    assert np.all(SURROGATE(below).status == 0)
    assert np.all(SURROGATE(above).status == Status.OUTSIDE_TRAINING)
    found = SURROGATE.refusals(above)
    assert list(found) == ["limit"]
    assert f"{known.sum()} of" in found["limit"]
    highest = np.argmax(
        above.pressure / above.c1 / (1.0 + SECOND * above.second_invariant / above.c1)
    )
    modulus = (above.c1 + SECOND * above.second_invariant)[highest, 0]
    assert f"{limit.pressure[known][highest, 0] / modulus / 1e3:.4g}" in found["limit"]


@pytest.mark.parametrize("mismatch", [-0.01, 0.01])
def test_a_paper_both_slack_and_mismatched_is_refused_and_says_so(mismatch):
    little, much = 0.99 * TOGETHER, 1.01 * TOGETHER
    pairs = [(0.02, little), (little, mismatch), (0.02, 0.0), (0.0, mismatch), (much, mismatch)]
    slack, misfit = np.array(pairs).T[:, :, None]
    inputs = base_inputs(0.05, paper_slack=slack, paper_mismatch=misfit)
    assert (SURROGATE(inputs).status[:, 0] == 0).tolist() == [True] * 4 + [False]
    found = SURROGATE.refusals(inputs)
    assert list(found) == ["paper_slack"]
    assert "mismatch" in found["paper_slack"]
    assert "1 of 5 values" in found["paper_slack"]


def test_a_limit_is_unknown_outside_the_groups():
    limit = SURROGATE.limit_pressure(base_inputs(0.1, skin=2.0))
    assert np.isnan(limit.pressure[0])
    assert np.isnan(limit.sd[0])


def test_the_mesh_error_can_be_left_out():
    limit = SURROGATE.limit_pressure(base_inputs(skin=0.4)).pressure[0] / 400.0
    inputs = base_inputs(limit * np.array([0.1, 0.5, 0.9, 0.99]), skin=0.4)
    whole, part = SURROGATE(inputs), SURROGATE.without_mesh_error()(inputs)
    np.testing.assert_array_equal(part.curvature, whole.curvature)
    steep = np.maximum(whole.slope / whole.curvature / GROWTH, 1.0)
    np.testing.assert_allclose(
        whole.sd, np.hypot(part.sd, SURROGATE.mesh_error * steep * whole.curvature), rtol=1e-12
    )
    assert steep[0] == 1.0 < steep[-1]
    assert np.all(part.sd < whole.sd)


def test_a_reference_pressure_takes_off_what_it_bends():
    load = np.array([0.0, 0.05, 0.1, 0.2, 0.3])
    inputs = base_inputs(load)
    reference = dataclasses.replace(inputs, reference_pressure=np.array([40.0]))
    plain, relative = SURROGATE(inputs), SURROGATE(reference)
    np.testing.assert_allclose(relative.curvature, plain.curvature - plain.curvature[2])
    np.testing.assert_allclose(relative.bend_angle, plain.bend_angle - plain.bend_angle[2])
    assert relative.sd[0] == plain.sd[2]  # all of the error is that of the reference
    assert relative.sd[2] == 0.0
    assert relative.bend_angle_sd[2] == 0.0
    common = np.abs(plain.sd - plain.sd[2])
    assert np.all(relative.sd >= common)
    assert np.all(relative.sd <= np.hypot(plain.sd, plain.sd[2]))
    beyond = dataclasses.replace(inputs, reference_pressure=np.array([4000.0]))
    assert np.all(SURROGATE(beyond).status == Status.OUTSIDE_TRAINING)
    assert SURROGATE.refusals(beyond)["load"].startswith("at the reference")


def assert_equal(left, right):
    for field in dataclasses.fields(Surrogate):
        a, b = getattr(left, field.name), getattr(right, field.name)
        if isinstance(a, Terms):
            for part in ("orders", "coefficients"):
                assert getattr(a, part).dtype == getattr(b, part).dtype
                np.testing.assert_array_equal(getattr(a, part), getattr(b, part))
        else:
            assert a == b, field.name


def test_a_file_without_pickle_brings_it_back():
    file = io.BytesIO()
    np.savez_compressed(file, **SURROGATE.to_arrays())
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        again = Surrogate.from_arrays(dict(stored))
    assert_equal(again, SURROGATE)
    inputs = random_inputs(np.random.default_rng(10), (10,), given=["skin"])
    np.testing.assert_array_equal(again(inputs).sd, SURROGATE(inputs).sd)


@pytest.mark.parametrize("name", ["groups", "ranges", "constants"])
def test_tables_of_other_groups_or_coordinates_are_refused(name):
    arrays = SURROGATE.to_arrays()
    changed = np.array(arrays[name])
    changed.flat[0] = "other" if name == "groups" else 7.0
    with pytest.raises(ValueError, match="than now"):
        Surrogate.from_arrays(arrays | {name: changed})


def test_order_of_specimens_does_not_matter():
    generator = np.random.default_rng(11)
    inputs = random_inputs(generator, (70,), given=["skin", "paper_slack"], columns=3)
    order = generator.permutation(70)
    moved = taken(inputs, order)
    a, b = SURROGATE(inputs), SURROGATE(moved)
    for name in (*VALUES, "slope", "status"):
        np.testing.assert_array_equal(getattr(b, name), getattr(a, name)[order])


def test_its_error_may_depend_on_everything():
    error = random_terms(np.random.default_rng(12), 30, 3, size=0.5)
    inputs = random_inputs(np.random.default_rng(13), (10,), given=["skin", "erosion"])
    compare_by_hand(inputs, dataclasses.replace(SURROGATE, error=error, mesh_error=0.0))


assert SURROGATE.span == SPAN
