"""Statistics with a physical reading: calibrated, and each finds the effect it is named after."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import kstest

from bayesdeg.criticism.checks import statistics as actuators
from bayesdeg.criticism.checks.discrepancy import measure
from bayesdeg.criticism.checks.residuals import misfit_frame
from bayesdeg.criticism.checks.statistics import (
    UNREMARKABLE,
    adjusted_p_values,
    frame,
    statistics_of,
    statistics_table,
)
from bayesdeg.criticism.fit.linear import linearise
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.readings import Formula, FormulaReadings, places_of
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile, median_stresses
from bayesdeg.priors import Normal, Parameter
from tests.inference.small_study import altered, small_model, values_of

OFFSET, TIME = "offset at low pressure", "trend of the residual with time"
COLUMNS = ["statistic", "value", "unit", "simulated_q05", "simulated_q95"]
COLUMNS += ["p_value", "p_adjusted", "reading", "replicates"]


def rich_actuators(data, *, mounts=("horizontal", "hanging")):
    """Eight actuators, two a mount and level: two cycles of both branches, unequal holds."""
    up = np.linspace(20.0, 140.0, 7)
    path = np.concatenate([up, up[-2::-1]])
    pressure = np.tile(np.concatenate([path, path]), (8, 1))
    shape = pressure.shape
    once = np.where(np.arange(len(path)) < 7, "loading", "unloading")
    hold = np.random.default_rng(3).uniform(10.0, 60.0, shape)
    return replace(
        data,
        specimens=tuple("abcdefgh"),
        degradation=np.repeat([0.0, 24.0], 4)[:, None],
        degradation_sd=np.full((8, 1), 0.3),
        pressure=pressure,
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        angle_sd=np.zeros(shape),
        mask=np.ones(shape, bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.ones(shape, bool),
        recorded=np.ones(shape, bool),
        ruptured=np.zeros(shape, bool),
        cycle=np.tile(np.repeat([1, 2], len(path)), (8, 1)),
        branch=np.tile(np.concatenate([once, once]), (8, 1)),
        time=np.cumsum(hold, axis=1),
        humidity=np.full(shape, np.nan),
        mount=np.broadcast_to(np.tile(mounts, 4)[:, None], shape).copy(),
    )


def fitted_exactly(model):
    """The model whose actuators read what it predicts, linearised at its parameters."""
    mode = model.table.vectors(values_of())[0]
    if model.of_kind(Curvature):
        model = model.with_observations(
            *data_of_actuators(
                model.data_of(Curvature).tests.with_readings(
                    model.data_of(Curvature)
                    .predicted(model.tests(model.table.named(mode[None])))
                    .mean[0]
                ),
                model.base,
            )
        )
    if model.of_kind(Tensile):
        stresses = median_stresses(
            model.tests(model.table.named(mode[None])), model.data_of(Tensile).tests
        ).at_rest[0]
        model = altered(model, tensile=replace(model.data_of(Tensile).tests, stress=stresses))
    return linearise(model, mode)


@cache
def rich():
    model = small_model()
    return fitted_exactly(altered(model, actuator=rich_actuators(model.data_of(Curvature).tests)))


@cache
def films():
    return fitted_exactly(altered(small_model(), actuator=None))


def drawn(linear, count, seed):
    """Data sets of the linear model itself."""
    normal = np.random.default_rng(seed).standard_normal((count, len(linear.mean)))
    return linear.mean + normal @ linear.factor.T


class Read:
    """The places of a subject, with other readings."""

    def __init__(self, subject, observed):
        self.subject = getattr(subject, "subject", subject)
        self.places, self.observed = subject.places, observed
        self.world = self.subject.world


def reading(linear, readings):
    """The same linear model with other data."""
    return replace(linear, subject=Read(linear.subject, readings))


def value_of(linear, readings, name):
    (one,) = (s for s in statistics_of(linear) if s.name == name)
    return float(one.of(linear.whiten(readings)))


def judged(linear, readings, name, count=399):
    table = statistics_table(reading(linear, readings), drawn(linear, count, 8))
    (one,) = (s for s in table if s.name == name)
    return one


NAMES = {
    "offset at low pressure": "kPa",
    "ratio of slopes at high and low pressure, over the simulated": "–",
    "hysteresis area between branches": "kPa/m",
    "trend of the residual with time": "%/min",
    "trend of the residual with degradation": "% per 10 points",
    "variance between specimens, over the model's": "–",
    "curvature beyond what the bend angle says": "%",
    "later cycles against the first": "%",
    "mount horizontal against hanging": "%",
    "equibiaxial against uniaxial tension": "MPa",
    "planar against uniaxial tension": "MPa",
    "trend of the films' residual with stretch": "% per unit of stretch",
}


# ---- calibration


def test_every_statistic_of_a_study_has_its_unit():
    table = statistics_table(rich(), drawn(rich(), 99, 0))
    there = {s.name: s.unit for s in table if not s.unavailable}
    assert there == NAMES
    assert all(
        np.isfinite([s.value, s.low, s.high, s.p_value]).all() for s in table if s.name in NAMES
    )


def test_no_statistic_speaks_of_degradation_where_nothing_degrades():
    linear = rich()
    model = linear.subject
    fresh = replace(linear, subject=model.with_world(degrades=False))
    found = {one.name: one for one in statistics_of(fresh)}
    kept = set(NAMES) - {"trend of the residual with degradation"}
    assert set(found) & set(NAMES) == kept
    said = " ".join(f"{s.name} {s.more} {s.less} {s.why}" for s in found.values())
    assert not re.search("degrad|misread rate", said)
    assert "degrad" in " ".join(s.more for s in statistics_of(linear))


@pytest.fixture(scope="module")
def many():
    """Whitened data sets of the linear model: 300 studies, each with 59 simulated ones."""
    return rich().whiten(drawn(rich(), 300 * 60, 1)).reshape(300, 60, -1)


@pytest.mark.parametrize("name", NAMES)
def test_p_values_are_uniform_where_the_model_is_true(name, many):
    (statistic,) = (s for s in statistics_of(rich()) if s.name == name)
    values = statistic.of(many)
    values = np.cbrt(values) if statistic.squares else values
    far = np.abs(values - np.median(values, axis=1, keepdims=True))
    ranks = 1.0 + np.sum(far[:, 1:] >= far[:, :1], axis=1)
    smooth = (ranks - np.random.default_rng(2).uniform(size=300)) / 60.0
    assert kstest(smooth, "uniform").pvalue > 0.01 / len(NAMES)


@pytest.mark.long
def test_the_tables_p_values_are_uniform_and_the_adjusted_ones_keep_their_level():
    linear = rich()
    tables = [
        statistics_table(reading(linear, y), drawn(linear, 99, 100 + number))
        for number, y in enumerate(drawn(linear, 300, 4))
    ]
    smallest = np.array([min(s.p_adjusted for s in t if not s.unavailable) for t in tables])
    single = np.array([[s.p_value for s in t if not s.unavailable] for t in tables])
    assert np.mean(smallest <= 0.05) < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 300)
    assert np.mean(single <= 0.05, axis=0).max() < 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / 300)
    assert np.mean(single <= 0.05) > 0.03
    assert np.all(
        single <= np.array([[s.p_adjusted for s in t if not s.unavailable] for t in tables])
    )


def test_data_simulated_from_the_posterior_do_not_make_p_values_smaller():
    """Simulated data follow the readings in what the parameters take up: at most cautious."""
    linear = rich()
    n = len(linear.mean)
    spread = linear.factor @ linear.factor.T - linear.scatter
    gain = np.linalg.solve(linear.scatter + spread, spread).T
    left = spread - gain @ spread
    generator = np.random.default_rng(5)
    values, vectors = np.linalg.eigh(left + linear.scatter)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    small = []
    for y in drawn(linear, 150, 6):
        centre = linear.mean + gain @ (y - linear.mean)
        simulated = centre + generator.standard_normal((199, n)) @ root.T
        table = statistics_table(reading(linear, y), simulated)
        small.append([s.p_value for s in table if not s.unavailable])
    rate = np.mean(np.array(small) <= 0.1, axis=0)
    assert rate.max() < 0.1 + 4.0 * np.sqrt(0.09 / 150)


# ---- each finds its own effect


@cache
def changes():
    """What is planted, in the units of the statistic: name, size, change of the readings."""
    linear = rich()
    bench = actuators.Bench.of(linear)
    places, size = linear.subject.places, bench.size
    low = places.along / 140.0
    film = places.family == "film"
    stress = np.where(film, linear.prediction, 0.0)
    uniaxial = film & (places.history == "uniaxial")
    biaxial = film & (places.history == "equibiaxial")
    planar = film & (places.history == "planar")
    unloading = np.char.startswith(places.history, "unloading") & (places.kind == "curvature")
    return {
        "hysteresis area between branches": (129.8, unloading * 1.5 * 4.0 * low * (1.0 - low)),
        "trend of the residual with time": (2.0, size * 0.02 * np.nan_to_num(places.time) / 60.0),
        "trend of the residual with degradation": (-12.0, -0.12 * size * places.level / 10.0),
        "curvature beyond what the bend angle says": (
            -6.0,
            -0.06 * size * (places.kind == "curvature"),
        ),
        "later cycles against the first": (
            4.0,
            0.04 * size * (np.char.find(places.history, " 2 ") > 0),
        ),
        "mount horizontal against hanging": (
            -9.0,
            -0.09 * size * np.char.endswith(places.history, "horizontal"),
        ),
        "equibiaxial against uniaxial tension": (
            0.3 * np.mean(stress[biaxial]),
            0.3 * stress * biaxial,
        ),
        "planar against uniaxial tension": (
            -0.3 * np.mean(stress[planar]),
            -0.3 * stress * planar,
        ),
        "trend of the films' residual with stretch": (
            20.0,
            0.2 * stress * (places.along - 1.0) * (uniaxial | biaxial | planar),
        ),
    }


@pytest.mark.parametrize(
    "name",
    [name for name in NAMES if not name.startswith(("offset", "ratio of slopes", "variance"))],
)
def test_a_statistic_finds_the_effect_it_is_named_after_at_its_size(name):
    linear = rich()
    size, change = changes()[name]
    rest = value_of(linear, linear.mean, name)
    assert value_of(linear, linear.mean + change, name) - rest == pytest.approx(size, rel=0.1)


def at_other_pressures(change):
    """Readings of the full model where the true pressures are those read and this more [kPa]."""
    linear = rich()
    model = linear.subject
    moved = replace(
        model.data_of(Curvature).tests, pressure=model.data_of(Curvature).tests.pressure + change
    )
    subject = altered(model, actuator=moved)
    return linear.mean + subject.expected(linear.mode[None])[0] - linear.prediction


@pytest.mark.parametrize("offset", [8.0, -8.0])
def test_an_offset_of_pressure_through_the_whole_model_is_found_in_kilopascals(offset):
    name = "offset at low pressure"
    found = judged(rich(), at_other_pressures(-offset), name)
    assert found.value == pytest.approx(offset, rel=0.15)
    assert found.p_adjusted == pytest.approx(1.0 / 400.0)
    assert found.reading.startswith("curves start late" if offset > 0.0 else "curves start early")


def test_a_part_that_steepens_with_pressure_is_told_by_the_ratio_of_slopes():
    linear = rich()
    places = linear.subject.places
    actuator = places.family == "actuator"
    readings = linear.prediction * (1.0 + 0.05 * actuator * places.along / 140.0)
    first = (places.specimen == "a") & (places.kind == "curvature")
    first &= places.history == "loading 1 horizontal"

    def ratio(values):
        thirds = np.array([0.0, 140.0 / 3.0, 280.0 / 3.0, 140.0])
        pressure, curve = np.append(0.0, places.along[first]), np.append(0.0, values[first])
        low, _, high = np.diff(np.interp(thirds, pressure, curve))
        return high / low

    expected = ratio(readings) / ratio(linear.prediction)
    name = "ratio of slopes at high and low pressure, over the simulated"
    neutral = value_of(linear, linear.mean, name)
    found = value_of(linear, linear.mean + readings - linear.prediction, name)
    assert neutral == pytest.approx(1.0)
    assert found - 1.0 == pytest.approx(expected - 1.0, rel=0.25)


def test_an_offset_is_not_taken_for_a_ratio_nor_a_ratio_for_an_offset():
    linear = rich()
    actuator = linear.subject.places.family == "actuator"
    ratio = linear.mean + 0.1 * actuator * linear.prediction
    assert abs(value_of(linear, ratio, OFFSET)) < 1e-6
    late = at_other_pressures(-8.0)
    slopes = value_of(linear, late, "ratio of slopes at high and low pressure, over the simulated")
    assert abs(slopes - 1.0) < 0.02


def test_the_area_of_a_loop_is_that_of_its_readings():
    linear = rich()
    size, change = changes()["hysteresis area between branches"]
    places = linear.subject.places
    one = (places.specimen == "c") & (places.kind == "curvature")
    up = one & (places.history == "loading 1 horizontal")
    down = one & (places.history == "unloading 1 horizontal")
    peak = np.append(change[up][-1], change[down])
    pressures = np.append(places.along[up][-1], places.along[down])
    area = -np.trapezoid(peak, pressures) - np.trapezoid(change[up], places.along[up])
    assert area == pytest.approx(size, rel=0.01)


@pytest.mark.parametrize("share", [0.15, 0.25])
def test_more_scatter_between_specimens_is_found_at_its_variance(share):
    linear = rich()
    places = linear.subject.places
    name = "variance between specimens, over the model's"
    (statistic,) = (s for s in statistics_of(linear) if s.name == name)
    own = (places.specimen[:, None] == np.unique(places.specimen)) & (places.family == "actuator")[
        :, None
    ]
    columns = own * linear.prediction[:, None]
    generator = np.random.default_rng(9)
    extra = share * generator.standard_normal((4000, own.shape[1])) @ columns.T
    values = statistic.of(linear.whiten(drawn(linear, 4000, 10) + extra))
    one_specimen = columns[:, 0]
    variance = 1.0 / (one_specimen @ np.linalg.solve(linear.scatter, one_specimen))
    assert np.mean(values) == pytest.approx(1.0 + share**2 / variance, rel=0.15)
    found = judged(linear, (drawn(linear, 4000, 10) + extra)[int(np.argmax(values))], name)
    assert found.value > found.high
    assert found.reading == statistic.more
    assert found.p_value == pytest.approx(1.0 / 400.0)


def test_specimens_all_alike_differ_less_than_the_model_allows():
    name = "variance between specimens, over the model's"
    found = judged(rich(), rich().mean, name)
    (statistic,) = (s for s in statistics_of(rich()) if s.name == name)
    assert found.value < found.low
    assert found.reading == statistic.less


# ---- what the study lacks, and tables


def test_what_the_study_lacks_is_said():
    table = statistics_table(
        fitted_exactly(small_model()), drawn(fitted_exactly(small_model()), 99, 0)
    )
    missing = {s.name: s.unavailable for s in table if s.unavailable}
    needed = {
        "hysteresis": "column branch of actuator.csv",
        TIME: "column time_s of actuator.csv",
        "later cycles": "column cycle of actuator.csv",
        "difference between mounts": "column mount of actuator.csv",
        "variance between films": "several films",
    }
    assert len(missing) == len(needed)
    for (name, why), (start, what) in zip(missing.items(), needed.items(), strict=True):
        assert name.startswith(start)
        assert what in why
    by_name = frame(table).set_index("statistic")
    for name, why in missing.items():
        assert by_name.loc[name, "reading"] == f"not available: {why}"
        assert np.isnan(by_name.loc[name, "value"])


def test_films_alone_have_no_statistics_of_actuators():
    names = [s.name for s in statistics_of(films())]
    assert len(names) == 4
    assert all("film" in name or "tension" in name for name in names)


def test_the_reading_says_where_time_and_pressure_cannot_be_told_apart():
    model = small_model()
    data = model.data_of(Curvature).tests
    steady = replace(data, time=3.0 * data.pressure)
    rising = statistics_of(fitted_exactly(altered(model, actuator=steady)))
    (together,) = (s for s in rising if s.name == TIME)
    (apart,) = (s for s in statistics_of(rich()) if s.name == TIME)
    assert together.more.removeprefix(apart.more) == together.less.removeprefix(apart.less)
    assert "pressure" in together.more.removeprefix(apart.more)


def test_the_table_is_sorted_and_reads_only_what_is_significant():
    late = statistics_table(reading(rich(), at_other_pressures(-8.0)), drawn(rich(), 399, 8))
    table = frame(late)
    assert list(table.columns) == COLUMNS
    assert table["p_adjusted"].dropna().is_monotonic_increasing
    assert table["statistic"].iloc[0] == OFFSET
    significant = table["p_adjusted"] <= 0.05
    assert significant.sum() >= 1
    rest = table[~significant & table["value"].notna()]
    assert set(rest["reading"]) == {UNREMARKABLE}
    assert np.all(table["simulated_q05"].dropna() < table["simulated_q95"].dropna())


def test_adjusted_p_values_are_between_the_single_ones_and_holms():
    generator = np.random.default_rng(12)
    null = np.abs(generator.standard_normal((6, 9999)))
    observed = np.array([3.2, 2.6, 2.2, 1.0, 0.5, 0.1])
    single = (1.0 + np.sum(null >= observed[:, None], axis=1)) / 10000.0
    holm = np.maximum.accumulate(np.minimum(single * np.arange(6, 0, -1), 1.0))
    adjusted = adjusted_p_values(observed, null)
    assert np.all(adjusted >= single)
    assert np.all(adjusted <= holm + 0.01)
    np.testing.assert_allclose(adjusted[:3], holm[:3], rtol=0.2)  # independent: nearly Holm's
    order = np.array([4, 0, 5, 2, 1, 3])
    np.testing.assert_array_equal(adjusted_p_values(observed[order], null[order]), adjusted[order])


def test_data_sets_without_an_answer_are_left_out_and_too_few_calibrate_nothing():
    simulated = drawn(rich(), 99, 0)
    broken = np.vstack([simulated, np.full((3, simulated.shape[1]), np.nan)])
    assert statistics_table(rich(), broken)[0] == statistics_table(rich(), simulated)[0]
    few = statistics_table(rich(), simulated[:18], 200)
    assert [one.name for one in few] == [one.name for one in statistics_table(rich(), simulated)]
    assert any("18 of 200" in one.finding for one in few)
    assert all(one.finding.startswith("not available: ") for one in few)
    assert all(np.isnan([one.value, one.p_value, one.p_adjusted]).all() for one in few)
    assert len(frame(few)) == len(few)
    none = statistics_table(rich(), broken[-3:])
    assert any("0 of 3" in one.unavailable for one in none)


# ---- other models


def ball(height):
    times = np.sqrt(2.0 * height / 9.81) * 1.02
    gravity = Parameter("gravity", Normal(9.81, 0.01), "m/s²", "of the earth", None)
    read = FormulaReadings(
        times, places_of(height, kind="time"), error=lambda values, readings: 0.02
    )
    fall = Formula(lambda values, height: np.sqrt(2.0 * height / values["gravity"]))
    return JointModel((gravity,), (read,), fall)


def test_a_model_of_another_kind_has_trends_of_its_own():
    height = np.linspace(1.0, 20.0, 12)
    subject = ball(height)
    linear = linearise(subject, subject.table.vectors({"gravity": np.array([9.81])})[0])
    name = "trend of the residual with the path (readings)"
    both = [s.name for s in statistics_of(linear) if s.projections is not None]
    assert len(both) == 2
    assert name in both
    assert all(one.endswith("(readings)") for one in both)
    (trend,) = (s for s in statistics_of(linear) if s.name == name)
    share = (height - 1.0) / 19.0
    late = linear.mean + 0.05 * linear.prediction * share
    assert float(trend.of(linear.whiten(late))) == pytest.approx(5.0)
    assert statistics_table(reading(linear, late), drawn(linear, 99, 0))


# ---- how much there is to explain


def test_the_table_of_the_misfit_is_the_discrepancy_with_the_errors_about_it():
    linear = reading(rich(), at_other_pressures(-8.0))
    misfit = measure(linear, drawn(linear, 50, 0))
    table = misfit_frame(linear, misfit, "base")
    assert list(table.columns) == [
        *("model", "kind", "history", "specimen_id", "degradation_pct", "along"),
        *("discrepancy", "residual"),
    ]
    np.testing.assert_allclose(table["discrepancy"], misfit.discrepancy)
    # nothing but the offset was planted: next to nothing is left beside the discrepancy
    curvature = (table["kind"] == "curvature").to_numpy()
    left = (table["residual"] - table["discrepancy"])[curvature]
    assert np.std(left) < 0.2 * np.std(table["discrepancy"][curvature])


def test_without_a_discrepancy_the_table_of_the_misfit_holds_what_the_refit_leaves():
    linear = reading(rich(), drawn(rich(), 1, 2)[0])
    misfit = measure(linear, drawn(linear, 50, 0))
    none = replace(misfit, discrepancy=np.zeros(len(linear.mean)))
    table = misfit_frame(linear, none, "base")
    np.testing.assert_allclose(table["residual"], linear.unexplained(linear.observed), atol=1e-12)
