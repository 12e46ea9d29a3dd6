"""The second surrogate's parts, on functions that are known in closed form."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Status
from bayesdeg.surrogate import coordinates as at
from bayesdeg.surrogate.coordinates import Coordinates
from bayesdeg.surrogate.design import study_like, training_curves
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.regression import Observed
from bayesdeg.surrogate.scaling import GROUPS, NAMES, NOMINAL_THICKNESS, Place, TrainingRange

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    process, likelihood, data, layers, fine_map, design = (
        import_module(f"fine_library_{name}")
        for name in ("process", "likelihood", "data", "layers", "map", "design")
    )

NEUTRAL = np.array([group.neutral for group in GROUPS])
BASE = np.array([-0.1, np.log(0.03), np.log(60.0), *NEUTRAL[3:]])


def kernel_of(size, *, lengths=1.5, constant=0.3, error=1e-5):
    log = [*np.full(size, np.log(lengths)), *np.full(size, np.log(constant))]
    return process.Kernel(np.array([*log, 0.0, np.log(error), np.log(10.0 * error)]))


def wave(places):
    """A smooth function of three coordinates, and its derivatives."""
    a, b, c = places.T
    value = np.sin(a) * np.cos(0.5 * b) + 0.2 * c * a
    slopes = np.column_stack(
        [
            np.cos(a) * np.cos(0.5 * b) + 0.2 * c,
            -0.5 * np.sin(a) * np.sin(0.5 * b),
            0.2 * a,
        ]
    )
    return value[:, None], slopes[:, None]


def waves(count, seed):
    places = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))
    return process.Data(places, *wave(places))


def test_process_predicts_a_smooth_function_and_its_slopes_far_better_with_derivatives():
    known, asked = waves(40, 1), waves(50, 2).places
    found = process.condition(kernel_of(3), known).process
    value, slopes = found.with_slopes(asked)
    true, true_slopes = wave(asked)
    np.testing.assert_allclose(value, true, atol=1e-3)
    np.testing.assert_allclose(slopes, true_slopes, atol=1e-2)
    np.testing.assert_allclose(found(asked), value, atol=1e-10)
    blind = process.Data(known.places, known.values, np.full_like(known.slopes, np.nan))
    without = process.condition(kernel_of(3), blind).process(asked)
    assert np.std(without - true) > 10.0 * np.std(value - true)


def test_values_along_the_first_coordinate_are_those_at_single_places():
    found = process.condition(kernel_of(3), waves(20, 3)).process
    rows, first = waves(4, 4).places, np.array([-0.5, 0.1, 0.8])
    value, slope = found.along(rows, first)
    for k, at_first in enumerate(first):
        places = np.column_stack([np.full(4, at_first), rows[:, 1:]])
        expected, slopes = found.with_slopes(places)
        np.testing.assert_allclose(value[:, k], expected, atol=1e-11)
        np.testing.assert_allclose(slope[:, k], slopes[..., 0], atol=1e-11)


def test_leaving_places_out_is_the_same_as_never_having_known_them():
    whole, out = waves(16, 5), np.arange(16) < 3
    values = whole.values.copy()
    for part in (out, ~out):  # the mean that is taken off first is then the same
        values[part] -= values[part].mean()
    known = process.Data(whole.places, values, whole.slopes)
    rest = process.Data(whole.places[~out], values[~out], whole.slopes[~out])
    kernel, asked = kernel_of(3, error=1e-2), waves(10, 6).places
    less = process.condition(kernel, known).without(out)
    never = process.condition(kernel, rest).process
    np.testing.assert_allclose(less(asked), never(asked), atol=1e-9)
    np.testing.assert_allclose(
        less.distance(asked, asked[:2, 0]), never.distance(asked, asked[:2, 0])
    )
    assert np.max(np.abs(less(asked) - process.condition(kernel, known).process(asked))) > 1e-4


def test_slopes_of_the_log_density_are_those_of_small_steps():
    some = waves(8, 7)
    slopes = some.slopes.copy()
    slopes[0] = np.nan
    slopes[2, :, 1] = np.nan
    known = process.Data(some.places, some.values, slopes)
    kernel = kernel_of(3, error=0.03)
    _, found = likelihood.log_density(kernel, known)
    for k in range(len(kernel.log)):
        step = np.zeros(len(kernel.log))
        step[k] = 1e-5
        more, less = (
            likelihood.log_density(process.Kernel(kernel.log + sign * step), known)[0]
            for sign in (1.0, -1.0)
        )
        assert found[k] == pytest.approx((more - less) / 2e-5, rel=1e-4, abs=1e-4)


def test_missing_force_is_all_at_rest_falls_as_slack_over_strain_and_has_exact_slopes():
    groups = np.tile(BASE, (4, 1))
    groups[:, at.SLACK - 1] = 0.01
    bending = np.array([1e-4, 0.1, 0.5, 50.0])
    places = data.coordinates(bending, groups)
    phi, slopes = data.missing_force(places)
    assert phi[0] == pytest.approx(1.0, abs=1e-4)
    assert phi[3] == pytest.approx(0.01 / (data.STRAIN * 50.0), rel=1e-6)
    for axis in range(13):
        step = np.zeros(13)
        step[axis] = 1e-5
        change = data.missing_force(places + step)[0] - data.missing_force(places - step)[0]
        np.testing.assert_allclose(slopes[1:, axis], change[1:] / 2e-5, atol=1e-7)
    groups[:, at.SLACK - 1] = 0.0
    assert not np.any(data.missing_force(data.coordinates(bending, groups))[0])


def closed_form(load, groups):
    """y = ln(k/q) of curvature and bend angle and ln(strain/q), by load and groups."""
    by = np.zeros((len(load), 3, 13))
    values = np.empty((len(load), 3))
    steps = (groups - BASE) / np.array([group.high - group.low for group in GROUPS])
    widths = np.array([group.high - group.low for group in GROUPS])
    for output, (start, first, weight) in enumerate(
        ((0.3, 0.5, 0.1), (0.35, 0.5, 0.12), (-1, 0.2, 0.2))
    ):
        values[:, output] = start + first * load + weight * (1.0 + load) * steps.sum(axis=1)
        by[:, output, 0] = first + weight * steps.sum(axis=1)
        by[:, output, 1:] = weight * (1.0 + load)[:, None] / widths
    return values, by


def bending_form(k, groups):
    """The same over k: h, ln(angle/k) and ln(strain + a constant), by bisection."""
    low, high = np.zeros(len(k)), np.full(len(k), 3.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        over = middle * np.exp(closed_form(middle, groups)[0][:, 0]) > k
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    y = closed_form(low, groups)[0]
    strain = low * np.exp(y[:, 2])
    return np.column_stack([-y[:, 0], y[:, 1] - y[:, 0], np.log(data.SMALL_STRAIN + strain)])


def test_derivatives_at_a_given_load_become_those_at_a_given_bending():
    load = np.array([0.1, 0.4, 0.8])
    groups = np.tile(BASE, (3, 1))
    values, by = closed_form(load, groups)
    none = np.empty(0)
    seen = Observed(Coordinates(none, none), load, load, values, by, none, none, tight=True)
    curve = data.Curve((0.8,), Place(tuple(BASE)).material())
    places, found, slopes, _ = data._points(0, curve, seen, 5)
    k = places[:, 0] * data.UNITS[0]
    np.testing.assert_allclose(found, bending_form(k, groups), atol=1e-12)
    for axis in (a for a in range(13) if a not in (at.SLACK, at.ALONG, at.UP, at.MISMATCH)):
        by_step = []
        for sign in (1.0, -1.0):
            moved = places.copy()
            moved[:, axis] += sign * 1e-4
            raw = moved * data.UNITS
            raw[:, at.THICKNESS] = np.sqrt(raw[:, at.THICKNESS])
            by_step.append(bending_form(raw[:, 0], raw[:, 1:]))
        change = (by_step[0] - by_step[1]) / 2e-4
        np.testing.assert_allclose(slopes[:, :, axis], change, atol=2e-6, err_msg=NAMES[axis])


def plain(places):
    """h = −0.3 + 0.2 k + 0.1 softening, angle = 1.05 k and strain as far as it bends."""
    k, softening = places[:, 0] * data.UNITS[0], places[:, 1] * data.UNITS[1]
    strain = 0.5 * k
    values = np.column_stack(
        [-0.3 + 0.2 * k + 0.1 * softening, np.full(len(k), np.log(1.05)), np.log(0.05 + strain)]
    )
    slopes = np.zeros((len(k), 3, 13))
    slopes[:, 0, 0], slopes[:, 0, 1] = 0.2 * data.UNITS[0], 0.1 * data.UNITS[1]
    slopes[:, 2, 0] = 0.5 / (0.05 + strain) * data.UNITS[0]
    return values, slopes


def points_of(count, seed, shift):
    generator = np.random.default_rng(seed)
    groups = np.tile(BASE, (count, 1))
    groups[:, 0] += generator.uniform(-0.3, 0.3, count)
    groups[::2, at.SLACK - 1] = 0.02
    places = data.coordinates(generator.uniform(0.02, 2.0, count), groups)
    values, slopes = plain(places)
    phi, rate = data.missing_force(places)
    # a slack paper lowers the load by a tenth of what it lacks
    values[:, 0] += shift - 0.1 * phi
    slopes[:, 0] -= 0.1 * rate
    return data.Points(places, values, slopes, np.arange(count))


@pytest.fixture(scope="module")
def fine_library():
    coarse, fine = points_of(40, 1, 0.0), points_of(20, 2, 0.01)
    bending, stretch = (
        layers.fit(coarse, fine, outputs=outputs, errors=np.array([1e-4, 1e-3])).layer
        for outputs in ((0, 1), (2,))
    )
    lower, upper = coarse.places.min(axis=0), coarse.places.max(axis=0)
    return fine_map.FineLibrary(fine_map.Library(bending, stretch, lower, upper, np.full(3, 1e-3)))


def inputs(*, slack=0.0, mismatch=0.0, scale=1.0, softening=-0.1, pressures=(100.0, 300.0)):
    c3 = 0.03
    return Inputs(
        pressure=np.array(pressures),
        c1=np.array([[1.0], [1.0]]),
        c2=np.full((2, 1), softening * np.sqrt(3.0 * c3)),
        c3=np.full((2, 1), c3),
        linear_scale=np.full((2, 1), scale),
        paper_stiffness=np.full((2, 1), 60e3 * scale),
        paper_thickness=np.full((2, 1), NOMINAL_THICKNESS * scale),
        paper_slack=np.array([[0.0], [slack]]),
        paper_mismatch=np.full((2, 1), mismatch),
    )


def test_forward_map_inverts_the_load_over_the_bending_for_tight_and_slack_paper(fine_library):
    found = fine_library(inputs(slack=0.02))
    assert found.curvature.shape == (2, 2)
    assert not np.any(found.status)
    k = found.curvature * 1e-3 * data.LENGTH
    groups = np.tile(BASE, (2, 1))
    groups[:, at.SLACK - 1] = 0.02
    phi = data.missing_force(data.coordinates(k[1], groups))[0]
    h = -0.3 + 0.2 * k - 0.01 + 0.01 - 0.1 * np.stack([np.zeros(2), phi])
    np.testing.assert_allclose(k * np.exp(h), [[0.1, 0.3]] * 2, rtol=2e-3)
    np.testing.assert_allclose(np.radians(found.bend_angle), 1.05 * k, rtol=2e-3)
    np.testing.assert_allclose(found.peak_stretch - 1.0, 0.5 * k, atol=5e-3)
    np.testing.assert_allclose(found.slope, found.curvature / (1.0 + 0.2 * k), rtol=5e-2)


def test_a_part_of_another_size_bends_by_the_same_angle(fine_library):
    one, small = fine_library(inputs()), fine_library(inputs(scale=0.8))
    np.testing.assert_allclose(small.curvature * 0.8, one.curvature)
    np.testing.assert_allclose(small.bend_angle, one.bend_angle)


@pytest.mark.parametrize(
    "asked",
    [
        inputs(softening=-0.9),
        inputs(softening=np.nan),
        inputs(pressures=(5000.0, 6000.0)),
    ],
    ids=["another material", "not a number", "beyond the end"],
)
def test_what_was_not_solved_is_refused(fine_library, asked):
    found = fine_library(asked)
    assert np.all(found.status == int(Status.OUTSIDE_TRAINING))
    assert np.all(np.isnan(found.curvature) & np.isnan(found.bend_angle))


def test_slack_paper_with_a_mismatch_is_refused_and_the_other_specimen_is_answered(fine_library):
    within = inputs(slack=0.02, mismatch=0.01)
    lower = fine_library.library.lower.copy()
    upper = fine_library.library.upper.copy()
    lower[at.MISMATCH], upper[at.MISMATCH] = -3.0, 3.0
    wide = fine_map.FineLibrary(
        fine_map.Library(
            fine_library.library.bending,
            fine_library.library.stretch,
            lower,
            upper,
            fine_library.library.errors,
        )
    )
    status = wide(within).status
    assert not np.any(status[0])
    assert np.all(status[1] == int(Status.OUTSIDE_TRAINING))


def test_design_is_its_own_and_the_first_curves_of_a_longer_one_are_those_of_a_shorter():
    curves, slack = design.design(60), design.loose(20)
    assert design.design(20) == curves[:20]
    assert design.loose(8) == slack[:8]
    materials = {curve.material for curve in curves}
    assert len(materials) == 60
    # neither those held out nor those of the emulator's own training
    own, _ = training_curves(TrainingRange(), 480, 96, seed=Recipe().seed)
    assert not materials & {curve.material for curve in [*study_like(60, seed=5), *own]}
    assert all(0.0 < curve.material.paper_slack <= 0.05 for curve in slack)
    wide = [curve.material for curve in curves[1::2]]
    assert not any(m.paper_slack > 0.0 and m.paper_mismatch != 0.0 for m in wide)
    for name in ("skin", "erosion", "paper_slack", "paper_mismatch", "second_invariant_ratio"):
        assert sum(getattr(material, name) != 0.0 for material in wide) >= 2
