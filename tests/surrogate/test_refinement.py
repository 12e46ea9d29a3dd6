"""An emulator corrected by fine curves where a posterior lies."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate.local import InputDraws, counted_in, curves_along, curves_of
from bayesdeg.surrogate.refinement import FEWEST, refine
from bayesdeg.surrogate.regression import observe
from bayesdeg.surrogate.scaling import GROUPS, Units
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.terms import features
from tests.surrogate.closed_form import LENGTH, SPAN, largest_of, sample, trained

NEUTRAL = np.array([group.neutral for group in GROUPS])
ORDERS, WRONG = trained().terms.orders, 0.01


def asked_of(count, seed, *, low=0.4, high=0.6, loads=(0.2, 0.3)):
    generator = np.random.default_rng(seed)
    groups = np.tile(NEUTRAL, (count, 1))
    width = SPAN.upper[:3] - SPAN.lower[:3]
    groups[:, :3] = SPAN.lower[:3] + width * generator.uniform(low, high, (count, 3))
    return InputDraws(groups, generator.uniform(*loads, count))


POSTERIOR, WHOLE = asked_of(200, 1), asked_of(400, 2, low=0.0, high=1.0)


def off():
    """The emulator of the closed form, wrong by 1 % and by as much along load and stiffening."""
    plain = trained()
    coefficients = plain.terms.coefficients.copy()
    for order, size in ((0, WRONG), (1, WRONG), (2, 0.5 * WRONG)):
        for axis in (0, 2):
            wanted = np.zeros(13, dtype=np.int64)
            wanted[axis] = order
            coefficients[:2, np.all(wanted == ORDERS, axis=1)] += size
    error = plain.error.coefficients.copy()
    error[:2] = 0.0
    error[:2, np.all(plain.error.orders == 0, axis=1)] = 2.0 * np.log(2.0 * WRONG)
    return replace(
        plain,
        terms=replace(plain.terms, coefficients=coefficients),
        error=replace(plain.error, coefficients=error),
    )


def refined(count, *, ground=None, seed=3):
    curves = curves_along(POSTERIOR, SPAN, count, seed=seed)
    return refine(ground or off(), curves, [sample(curve) for curve in curves], WHOLE)


def strained(plain, wrong):
    """The emulator with all its strains larger by a factor, and as uncertain."""

    def larger(table, first, size):
        coefficients = table.coefficients.copy()
        coefficients[first:, np.all(table.orders == 0, axis=1)] += size
        return replace(table, coefficients=coefficients)

    def uncertain(table, first):
        coefficients = table.coefficients.copy()
        coefficients[first:] = 0.0
        flat = replace(table, coefficients=coefficients)
        return larger(flat, first, 2.0 * np.log(2.0 * wrong))

    return replace(
        plain,
        terms=larger(plain.terms, 2, wrong),
        strains=larger(plain.strains, 0, wrong),
        error=uncertain(plain.error, 2),
        strain_error=uncertain(plain.strain_error, 0),
    )


def errors_of(surrogate, curves):
    """Errors of ln curvature over the emulator's own standard error, and the errors, of curves."""
    found, sds = [], []
    for curve in curves:
        run = observe(curve, sample(curve), length=LENGTH, compliance=trained().compliance)
        points = run.coordinates.points
        y = features(surrogate.terms.orders, points) @ surrogate.terms.coefficients[0]
        log_square = features(surrogate.error.orders, points) @ surrogate.error.coefficients[0]
        found.append(y - run.values[:, 0])
        sds.append(np.exp(0.5 * log_square))
    return np.concatenate(found), np.concatenate(sds)


@pytest.fixture(scope="module")
def better():
    return refined(8)


def test_it_is_right_at_new_curves_where_the_posterior_lies(better):
    curves = curves_of(asked_of(60, 9), SPAN, 12, seed=4)
    before, _ = errors_of(off(), curves)
    after, sds = errors_of(better.surrogate, curves)
    assert np.sqrt(np.mean(before**2)) > 5e-3
    assert np.sqrt(np.mean(after**2)) < 5e-4
    # and says so, without saying too much
    assert np.mean(np.abs(after) <= 1.645 * sds) > 0.7
    assert np.median(sds) < 0.2 * WRONG


def test_far_away_it_claims_no_more_than_it_knows(better):
    corner = asked_of(40, 5, low=0.0, high=0.08)
    corner.groups[:, 1] = SPAN.upper[1] - 0.02 * (SPAN.upper[1] - SPAN.lower[1])
    errors, sds = errors_of(better.surrogate, curves_of(corner, SPAN, 8, seed=1))
    _, near = errors_of(better.surrogate, curves_of(POSTERIOR, SPAN, 8, seed=1))
    assert np.median(sds) > 2.0 * np.median(near)
    assert np.quantile(np.abs(errors) / sds, 0.9) < 3.0


def test_the_accuracy_is_that_at_curves_left_out_and_more_curves_miss_less(better):
    many = json.loads(refined(16).surrogate.record)["accuracy"]["curvature"]
    few = json.loads(refined(5).surrogate.record)["accuracy"]["curvature"]
    assert many["rms_pct"] < few["rms_pct"]
    assert len(better.without) == 8


def test_leaving_a_curve_out_is_fitting_without_it(better):
    curves = curves_along(POSTERIOR, SPAN, 8, seed=3)
    rest = curves[1:]
    alone = refine(off(), rest, [sample(curve) for curve in rest], WHOLE).surrogate
    expected, _ = errors_of(alone, curves[:1])
    found, _ = errors_of(better.without[0], curves[:1])
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_strains_are_corrected_where_the_posterior_lies():
    ground = strained(trained(), 0.03)
    found = refined(8, ground=ground).surrogate
    gaps = {True: [], False: []}
    for curve in curves_of(asked_of(60, 9), SPAN, 12, seed=4):
        run = observe(curve, sample(curve), length=LENGTH, compliance=trained().compliance)
        points = run.coordinates.points
        for is_refined, one in ((False, ground), (True, found)):
            parts = ((one.terms, [2], [2]), (one.strains, list(range(6)), list(range(3, 9))))
            for table, rows, outputs in parts:
                y = features(table.orders, points) @ table.coefficients[rows].T
                gap = y - run.values[:, outputs]
                gaps[is_refined].append(np.abs(gap).max(axis=0))
    before, after = (np.concatenate(gaps[key]) for key in (False, True))
    assert np.median(before) > 0.025
    assert np.quantile(after, 0.9) < 5e-3
    accuracy = json.loads(found.record)["accuracy"]
    assert accuracy["peak_stretch"]["p95_pct"] < 1.0
    assert accuracy["weibull_strain_10"]["p95_pct"] < 1.0


def neutral_inputs(curve):
    """A material with C1 = 1 MPa and no cause at work."""
    m, one = curve.material, np.ones(1)
    return Inputs(
        pressure=1e3 * np.array([curve.loads[-1]]),
        c1=one,
        c2=m.c2_ratio * one,
        c3=m.c3_ratio * one,
        linear_scale=one,
        paper_stiffness=1e3 * m.paper_group * one,
    )


def test_the_load_at_a_swelling_is_corrected_and_with_it_where_curves_balloon():
    near = asked_of(100, 7, low=0.0, high=0.3, loads=(0.9, 1.0))
    curves = curves_along(near, SPAN, 12, seed=3)
    plain = trained()
    late, uncertain = plain.load.coefficients.copy(), 0.0 * plain.load_error.coefficients
    late[0, np.all(plain.load.orders == 0, axis=1)] += 0.05
    uncertain[0, np.all(plain.load_error.orders == 0, axis=1)] = 2.0 * np.log(0.05)
    ground = replace(
        plain,
        load=replace(plain.load, coefficients=late),
        load_error=replace(plain.load_error, coefficients=uncertain),
    )
    found = refine(ground, curves, [sample(curve) for curve in curves], WHOLE).surrogate
    gaps = {"late": [], "found": []}
    stated = []
    for curve in curves_of(near, SPAN, 8, seed=5):
        _, limit = largest_of(vars(curve.material))
        if not np.isfinite(limit):
            continue
        for name, one in (("late", ground), ("found", found)):
            got = one.limit_pressure(neutral_inputs(curve))
            gaps[name].append(abs(got.pressure.item() / (1e3 * limit) - 1.0))
        stated.append(got.sd.item() / got.pressure.item())
    assert len(gaps["late"]) >= 4
    assert np.median(gaps["late"]) > 0.03
    assert np.max(gaps["found"]) < 2e-3
    assert np.max(np.array(gaps["found"]) / stated) < 4.0
    assert np.median(stated) < 0.01
    assert json.loads(found.record)["accuracy"]["load"]["p95_pct"] < 0.5


def test_a_refined_emulator_is_stored_with_its_range(better):
    assert better.surrogate.span == trained().span
    again = Surrogate.from_arrays(better.surrogate.to_arrays())
    for name in ("terms", "load"):
        kept, found = (getattr(one, name) for one in (better.surrogate, again))
        np.testing.assert_array_equal(kept.coefficients, found.coefficients)


def test_units_of_load_and_paper_change_nothing():
    units, size = Units(load=2.0, paper=4.0), np.ones(len(INPUTS))
    size[INPUTS.index("load")], size[INPUTS.index("paper_group")] = units.load, units.paper
    curves = curves_along(POSTERIOR, SPAN, 6, seed=3)
    samples = [
        replace(
            one,
            loads=one.loads * units.load,
            gradients=one.gradients / size,
            limit_load=one.limit_load * units.load,
        )
        for one in map(sample, curves)
    ]
    back = Units(1.0 / units.load, 1.0 / units.paper)
    counted = [counted_in(curve, back) for curve in curves]
    found = refine(replace(off(), units=units), counted, samples, WHOLE.in_units(back))
    expected = refined(6).surrogate
    assert found.surrogate.units == units
    np.testing.assert_allclose(
        found.surrogate.terms.coefficients, expected.terms.coefficients, atol=1e-6
    )


def test_too_few_curves_are_refused():
    with pytest.raises(BayesdegError, match="too few"):
        refined(FEWEST - 1)


# ---- which curves


def test_curves_along_are_spread_where_draws_differ_most():
    along = asked_of(300, 6)
    along.groups[:, 1] = np.linspace(-6.0, -2.0, 300)
    along.groups[:, 0] = 0.1 * along.groups[:, 1]
    along.groups[:, 2] = 4.0 - 0.2 * along.groups[:, 1]
    curves = curves_along(along, SPAN, 6, seed=1)
    at = np.sort([np.log(curve.material.c3_ratio) for curve in curves])
    shares = np.clip(np.floor((at + 6.0) / 4.0 * 6.0), 0, 5)
    assert shares.tolist() == [0, 1, 2, 3, 4, 5]
    assert curves_along(along, SPAN, 6, seed=1) == curves
    assert curves_along(along, SPAN, 6, seed=2) != curves


def test_more_curves_lie_where_actuators_bend_far():
    along = asked_of(400, 6)
    along.groups[:, 1] = np.linspace(-6.0, -2.0, 400)
    along.groups[:, 0] = 0.1 * along.groups[:, 1]
    along.groups[:, 2] = 4.0 - 0.2 * along.groups[:, 1]
    steep = InputDraws(along.groups, np.linspace(0.0, 0.3, 400))
    curves = curves_along(steep, SPAN, 16, seed=1)
    soft = np.sum([np.log(curve.material.c3_ratio) > -4.0 for curve in curves])
    assert soft == 12  # half of the draws, which bear three quarters of the load


def test_every_second_curve_ends_earlier_and_each_elsewhere():
    curves = curves_along(POSTERIOR, SPAN, 16, seed=1)
    ends = np.array([curve.loads[-1] for curve in curves])
    assert np.median(ends[1::2]) < 0.8 * np.median(ends[::2])
    shares = np.sort(ends[1::2])
    assert len(set(shares.round(6))) == 8
    assert shares[-1] / shares[0] > 2.0
