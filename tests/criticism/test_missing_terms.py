"""Missing terms: planted ones are found with their size, chance gives none, units do not matter."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.criticism.checks.discrepancy import measure
from bayesdeg.criticism.checks.known_terms import (
    BATCH,
    LEAST_LEFT,
    LOAD,
    RATE,
    Acts,
    Form,
    known_terms,
    slopes_along,
)
from bayesdeg.criticism.checks.misfit_columns import misfit_columns
from bayesdeg.criticism.checks.missing_terms import (
    AS_GOOD,
    FALSE_TERMS,
    MOST_TERMS,
    missing_terms,
    search_terms,
)
from bayesdeg.observations.curvature import ANGLE, CURVATURE
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import drawn, known_linear, with_readings


@pytest.fixture(scope="module")
def linear():
    return known_linear(with_angle=True)


def found(linear, readings, generator, *, replicates=300, **options):
    """What is found of readings, set against data that the linear model makes."""
    simulated = drawn(linear, generator, replicates)
    read = with_readings(linear, readings)
    return missing_terms(read, simulated, measure(read, simulated), **options)


def straight_found(readings, *, replicates=300, seed=1):
    """The same of readings of the straight model."""
    linear = straight.exact_linear(readings)
    simulated = drawn(linear, np.random.default_rng(seed), replicates)
    return missing_terms(linear, simulated, measure(linear, simulated))


@pytest.mark.parametrize(
    ("name", "size", "formula"),
    [
        ("wave", 0.4, "reading + b sin(2π x/1)"),
        ("wave", -0.4, "reading + b sin(2π x/1)"),
        ("ageing", 0.4, "reading + b x (level/20)"),
        ("offset", -0.3, "reading + b"),
    ],
)
def test_a_planted_term_is_found_with_its_formula_and_size(name, size, formula):
    [term] = straight_found(straight.readings(4, **{name: size})).terms
    if formula == term.term.formula:
        assert term.low < size < term.high
    else:
        [as_good] = [one for one in term.alike if one.term.formula == formula]
        assert as_good.size == pytest.approx(size, rel=0.25)
    assert term.share == pytest.approx(1.0, abs=0.1)
    assert term.p_value == pytest.approx(1.0 / 301.0)
    assert term.held_out > term.held_out_se > 0.0


def test_intervals_hold_the_planted_size_as_often_as_they_say():
    inside = []
    for seed in range(100):
        first = straight_found(straight.readings(seed, wave=0.6), replicates=60).terms[0]
        if first.term.formula == "reading + b sin(2π x/1)":
            inside.append(first.low < 0.6 < first.high)
    assert len(inside) >= 90
    assert 0.81 <= np.mean(inside) <= 0.99  # 0.9, with three standard errors of 100


def test_the_size_is_that_of_generalised_least_squares():
    linear = straight.exact_linear(straight.readings(4, wave=0.4))
    [term] = straight_found(straight.readings(4, wave=0.4)).terms
    covariance = straight.joint_of().covariance
    direction = straight.SHAPES["wave"]
    right = np.linalg.solve(covariance, direction)
    residual = linear.subject.observed - straight.joint_of().shapes @ straight.joint_of().mean
    assert term.size == pytest.approx(right @ residual / (right @ direction), rel=1e-4)
    half = 1.645 / np.sqrt(right @ direction)
    assert term.high - term.low == pytest.approx(2.0 * half, rel=1e-4)


def test_two_planted_terms_are_found_together():
    first, second = straight_found(straight.readings(5, wave=0.4, offset=0.5)).terms
    formulas = {first.term.formula, second.term.formula}
    assert formulas == {"reading + b sin(2π x/1)", "reading + b"}
    sizes = {one.term.formula: (one.low, one.high) for one in (first, second)}
    assert sizes["reading + b"][0] < 0.5 < sizes["reading + b"][1]
    assert sizes["reading + b sin(2π x/1)"][0] < 0.4 < sizes["reading + b sin(2π x/1)"][1]
    assert 1.0 >= second.share > first.share
    assert second.share == pytest.approx(1.0, abs=0.1)


def test_a_term_is_rarely_given_where_nothing_is_hidden():
    """Of 400 data sets without a misfit, no more than 5 % may have a term."""
    generator = np.random.default_rng(4)
    base = straight.exact_linear(straight.readings(0))
    offered = known_terms(base)
    null = generator.standard_normal((400, len(base.mean)))
    data = generator.standard_normal((400, len(base.mean)))
    p_values = np.array([search_terms(offered, one, null)[0].p_value for one in data])
    assert np.mean(p_values <= FALSE_TERMS) <= FALSE_TERMS + 3.0 * np.sqrt(0.05 * 0.95 / 400)
    assert np.mean(p_values <= FALSE_TERMS) >= 0.01  # a test that never rejects controls nothing
    assert np.mean(p_values <= 0.5) == pytest.approx(0.5, abs=0.1)


@pytest.mark.long
@pytest.mark.slow
def test_what_is_given_without_a_misfit_is_less_than_the_level(linear):
    generator = np.random.default_rng(6)
    simulated = drawn(linear, generator, 300)
    misfit = measure(linear, simulated)
    given = 0
    for _ in range(200):
        read = with_readings(linear, drawn(linear, generator))
        given += bool(missing_terms(read, simulated, misfit).terms)
    assert given <= FALSE_TERMS * 200


def test_what_parameters_could_take_up_is_not_offered():
    linear = straight.exact_linear(straight.readings(0))
    offered = known_terms(linear)
    formulas = {one.formula for one in offered.terms}
    assert "reading + b (x)" not in formulas  # the slope is a parameter, and the bend is one
    assert not {"reading × (1 + b)", "reading + b x", "reading + b x²"} & formulas
    assert {"reading + b", "reading × (1 + b (level/20))"} <= formulas
    plain = linear.whitening.inverse @ offered.directions
    left = np.sum(offered.whitened**2, axis=0) / np.sum(plain**2, axis=0)
    assert np.all(left >= LEAST_LEFT)


@pytest.mark.parametrize("level", [np.nan, 0.0])
def test_a_path_or_a_level_without_extent_gives_no_function(level):
    """Readings of a formula may be at one place, or have no level."""
    linear = straight.exact_linear(straight.readings(0))
    places = linear.subject.places
    flat = np.zeros(len(places))
    [read] = linear.subject.observations
    still = replace(read, read_at=replace(places, along=flat, level=flat + level))
    subject = linear.subject.with_observations(still)
    offered = known_terms(replace(linear, subject=subject))
    assert np.all(np.isfinite(offered.directions))
    assert not {"x", "degradation rate"} & {c for one in offered.terms for c in one.columns}


def test_no_two_terms_are_the_same_readings(linear):
    offered = known_terms(linear)
    unit = offered.whitened / np.linalg.norm(offered.whitened, axis=0)
    assert np.max(np.abs(unit.T @ unit) - np.eye(len(offered))) < 1.0 - 1e-7


def test_each_complexity_has_the_same_prior(linear):
    offered = known_terms(linear)
    complexity = np.array([one.complexity for one in offered.terms])
    for each in np.unique(complexity):
        own = offered.penalty[complexity == each]
        assert np.exp(-own).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_group_of_a_degradation_rate_is_found_in_both_readings(linear, sign):
    generator = np.random.default_rng(7)
    places = linear.subject.places
    readings = drawn(linear, generator) + 0.25 * sign * linear.mean * (places.level == 10.0)
    [term, *_] = found(linear, readings, generator).terms
    assert term.term.kinds == (CURVATURE, ANGLE)
    assert term.term.acts is Acts.FACTOR
    [function] = term.term.functions
    assert (function.of.column, function.form, function.group) == (RATE.column, Form.MEMBER, "10 %")
    assert term.low < 0.25 * sign < term.high
    assert np.sign(term.change @ linear.mean) == sign


def test_a_batch_is_a_group_where_it_is_known(linear):
    generator = np.random.default_rng(8)
    batches = dict.fromkeys("ace", "A") | dict.fromkeys("bdf", "B")
    mixed = np.isin(linear.subject.places.specimen, list("ace"))
    readings = drawn(linear, generator) + 0.3 * linear.mean * mixed
    [term, *_] = found(linear, readings, generator, batches=batches).terms
    formulas = [term.term.formula, *(one.term.formula for one in term.alike)]
    assert BATCH.column in term.term.columns, formulas
    assert BATCH.column not in {
        column for one in known_terms(linear).terms for column in one.columns
    }


def test_an_error_of_one_reading_is_told_from_one_of_both(linear):
    generator = np.random.default_rng(9)
    places = linear.subject.places
    bent = np.maximum(places.along - 80.0, 0.0) / 160.0
    readings = drawn(linear, generator) - 0.5 * linear.mean * bent * (places.kind == CURVATURE)
    [term, *_] = found(linear, readings, generator).terms
    assert term.term.kinds == (CURVATURE,)
    assert np.all(term.change[places.kind == ANGLE] == 0.0)


def in_other_units(linear, path, unit):
    """The same data, path and readings in other units."""
    [read] = linear.subject.observations
    subject = linear.subject.with_observations(
        replace(
            read,
            observed_values=unit * read.observed,
            read_at=replace(read.places, along=path * read.places.along),
        )
    )
    scaled = linear.whitening
    return replace(
        linear,
        subject=subject,
        prediction=unit * linear.prediction,
        mean=unit * linear.mean,
        scatter=unit**2 * linear.scatter,
        whitening=replace(scaled, lower=unit * scaled.lower, inverse=scaled.inverse / unit),
    )


def test_units_do_not_matter():
    linear = straight.exact_linear(straight.readings(5, wave=0.4, offset=0.5))
    other = in_other_units(linear, 7.0, 1e3)
    noise = np.random.default_rng(2).standard_normal((200, len(linear.mean)))
    results = []
    for one in (linear, other):
        simulated = one.mean + noise @ one.factor.T
        results.append(missing_terms(one, simulated, measure(one, simulated)))
    plain, scaled = results
    assert len(plain.terms) == MOST_TERMS
    assert plain.tried == scaled.tried
    for a, b in zip(plain.terms, scaled.terms, strict=True):
        ratio = 1e3 if a.term.acts is Acts.SHIFT else 1.0
        assert (b.term.acts, b.term.columns) == (a.term.acts, a.term.columns)
        assert b.size == pytest.approx(ratio * a.size)
        assert (b.p_value, b.share) == pytest.approx((a.p_value, a.share))
        assert b.held_out == pytest.approx(a.held_out)


def test_terms_that_fit_as_well_are_within_odds_of_twenty(linear):
    generator = np.random.default_rng(10)
    places = linear.subject.places
    bent = (places.along / 160.0) ** 2 * places.level / 24.0
    [term, *_] = found(linear, drawn(linear, generator) + 0.2 * linear.mean * bent, generator).terms
    assert term.count_alike >= len(term.alike) > 1
    assert all(one.behind < AS_GOOD for one in term.alike)
    assert sorted(one.behind for one in term.alike) == [one.behind for one in term.alike]


def test_without_simulated_data_no_term_is_given(linear):
    none = np.zeros((0, len(linear.mean)))
    readings = linear.mean * 1.3
    read = with_readings(linear, readings)
    got = missing_terms(read, none, measure(read, none))
    assert got.terms == ()
    assert np.isnan(got.p_value)


def test_the_load_over_the_modulus_is_known_of_actuators(linear):
    columns = {column for one in known_terms(linear).terms for column in one.columns}
    assert LOAD.column in columns
    assert LOAD.column not in {
        column
        for one in known_terms(straight.exact_linear(straight.readings(0))).terms
        for column in one.columns
    }


def test_the_slope_along_the_path_is_that_of_the_curve(linear):
    places = linear.subject.places
    slope = slopes_along(places, 3.0 * places.along + places.level)
    assert slope == pytest.approx(np.full(len(places), 3.0))
    single = places.subset(np.arange(len(places)) < 1)
    assert slopes_along(single, np.ones(1)).tolist() == [0.0]


def test_the_column_in_which_a_misfit_sits_has_the_largest_share(linear):
    generator = np.random.default_rng(11)
    places = linear.subject.places
    simulated = drawn(linear, generator, 200)
    readings = drawn(linear, generator) + 0.3 * linear.mean * (places.level == 10.0)
    read = with_readings(linear, readings)
    columns = misfit_columns(read, simulated, measure(read, simulated))
    by_name = {one.column: one for one in columns}
    assert set(by_name) == {"pressure", "level", "specimen", "kind of reading"}
    level = by_name["level"]
    assert level.worst.level == "10 %"
    assert level.share_of_misfit > 0.8
    assert level.share_of_misfit > by_name["pressure"].share_of_misfit
    assert level.worst.excess_pct == pytest.approx(30.0, abs=12.0)
    assert level.unit == "1/m"
    rows = (places.level == 10.0) & (places.kind == CURVATURE)
    excess = np.mean(read.unexplained(read.observed)[rows])
    assert level.worst.excess == pytest.approx(excess)
    assert sum(one.readings for one in level.levels) == len(places)


def test_columns_of_no_misfit_have_no_share(linear):
    simulated = drawn(linear, np.random.default_rng(12), 200)
    read = with_readings(linear, linear.mean)
    assert misfit_columns(read, simulated, measure(read, simulated)) == ()
