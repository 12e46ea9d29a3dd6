"""Suspects: deletion residuals against a plain computation, and mishaps planted in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_ind

from bayesdeg.criticism.checks import suspects
from bayesdeg.criticism.checks.suspects import (
    BEYOND_DOUBT,
    FACTORS,
    LEAST_CHANGE,
    LEVEL,
    SHARES,
    Anomaly,
    Irregularity,
    ReadingParts,
    Suspect,
    film_density,
    find_suspects,
    hypotheses,
    largest_t,
    parts_of,
    pool_of,
    scored,
    t_between,
)
from bayesdeg.inference.laplace import find_mode
from bayesdeg.observations.curvature import CURVATURE, Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile
from tests.criticism.linear_case import tight_model
from tests.inference.small_study import TRUTH, altered, small_model, values_of

SPECIMENS, POINTS = 18, 8
RATES = np.repeat(np.arange(0.0, 26.0, 5.0), 3)[:, None]


def whole_study(generator):
    """Eighteen actuators at six rates, drawn from the model at known values."""
    base = altered(tight_model(with_angle=True), tensile=None)
    curves = base.data_of(Curvature).tests
    rows = np.zeros(SPECIMENS, dtype=np.int64)
    many = curves.subset(rows)
    many = replace(
        many,
        specimens=tuple(f"A{rate:02.0f}-{k % 3}" for k, rate in enumerate(RATES[:, 0])),
        degradation=RATES,
        degradation_sd=np.full_like(RATES, 0.3),
    )
    model = base.with_observations(*data_of_actuators(many, base.base))
    values = model.table.named(model.table.vectors(values_of()))
    return model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                model.data_of(Curvature).drawn(model.tests(values), generator)[0]
            ),
            model.base,
        )
    ), values


@pytest.fixture(scope="module")
def study():
    model, _ = whole_study(np.random.default_rng(5))
    return model, find_mode(model, model.table.vectors(values_of())[0])[0]


def planted(study, specimen, change):
    """The study with the readings of a specimen changed, and its mode with and without it."""
    model, mode = study
    data = model.data_of(Curvature).tests
    row = data.specimens.index(specimen)
    readings = data.readings.copy()
    readings[row] = change(readings[row])
    wrong = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )

    def refit(found):
        out = {name for one in found for name in one.hypothesis.specimens}
        keep = [k for k, name in enumerate(data.specimens) if name not in out]
        rest = wrong.with_observations(
            *data_of_actuators(wrong.data_of(Curvature).tests.subset(np.array(keep)), wrong.base)
        )
        return find_mode(rest, mode)[0]

    return wrong, find_mode(wrong, mode)[0], refit


def test_a_score_is_the_deletion_residual_of_the_linear_model():
    generator = np.random.default_rng(0)
    n, shared = 12, generator.standard_normal((12, 3))
    blocks = generator.standard_normal((12, 12))
    scatter = np.kron(np.eye(3), (blocks @ blocks.T)[:4, :4] + 4.0 * np.eye(4))
    residual = generator.standard_normal(n)
    parts = ReadingParts(residual, shared, np.zeros((n, n)), scatter, np.full(n, "one"))
    one = Irregularity(Anomaly.READING, ("a",), "x", np.eye(n)[0] > 0.0, np.eye(n)[0])
    found = scored(parts, [one])
    # what all other readings say of the first, with its variance
    total = scatter + shared @ shared.T
    gain = np.linalg.solve(total[1:, 1:], total[1:, 0])
    expected, variance = gain @ residual[1:], total[0, 0] - gain @ total[1:, 0]
    score = found.scores(found.norms)[0]
    assert score == pytest.approx((residual[0] - expected) / np.sqrt(variance))
    assert score / found.norms[0] == pytest.approx(residual[0] - expected)


def test_a_density_is_that_of_the_whole_normal_law():
    generator = np.random.default_rng(1)
    scatter, shared = np.diag(generator.uniform(1.0, 2.0, 5)), generator.standard_normal((5, 2))
    residual = generator.standard_normal(5)
    parts = ReadingParts(residual, shared, scatter, 0.5 * scatter, np.full(5, "one"))
    total = 0.49 * scatter + 1.44 * 0.5 * scatter + shared @ shared.T
    exact = -0.5 * residual @ np.linalg.solve(total, residual) - 0.5 * np.linalg.slogdet(total)[1]
    assert parts.log_density(0.7, np.full(5, 1.2)) == pytest.approx(exact)


def test_what_tables_state_is_not_scaled():
    generator = np.random.default_rng(1)
    scatter, stated = np.diag(generator.uniform(1.0, 2.0, 5)), np.diag(generator.uniform(1, 2, 5))
    residual, nothing = generator.standard_normal(5), np.zeros((5, 1))
    family = np.full(5, "one")
    parts = ReadingParts(residual, nothing, scatter, 0.5 * scatter, family, stated)
    total = 0.49 * scatter + 1.44 * 0.5 * scatter + stated
    exact = -0.5 * residual @ np.linalg.solve(total, residual) - 0.5 * np.linalg.slogdet(total)[1]
    assert parts.log_density(0.7, np.full(5, 1.2)) == pytest.approx(exact)


def test_errors_of_degradation_rates_are_stated_and_scatter_of_stiffness_is_not(study):
    model, mode = study
    parts = parts_of(model, mode)
    values = {name: value[0] for name, value in model.table.named(mode[None]).items()}
    wider = values | {"stiffness_scatter": 2.0 * values["stiffness_scatter"]}
    vector = model.table.vectors({name: np.array(value) for name, value in wider.items()})
    other = parts_of(model, np.asarray(vector))
    assert np.any(parts.stated)
    np.testing.assert_allclose(
        other.stated, parts.stated, rtol=0.02
    )  # slopes are at the mean response
    np.testing.assert_allclose(other.specimens, 4.0 * parts.specimens, rtol=0.02)
    whole = parts.specimens + parts.stated + parts.errors
    np.testing.assert_allclose(whole, model.scatter(mode), rtol=1e-9, atol=1e-12)


def test_errors_of_reading_are_found_again_that_a_misfit_has_widened(study):
    model, mode = study
    values = {name: value[0] for name, value in model.table.named(mode[None]).items()}
    widened = values | {
        "curvature_noise": 3.0 * values["curvature_noise"],
        "bend_angle_noise": 3.0 * values["bend_angle_noise"],
        "reading_correlation": 0.9,
    }
    vector = model.table.vectors({name: np.array(value) for name, value in widened.items()})
    rows = model.places.specimen == "A10-1"
    one = Irregularity(Anomaly.RESPONSE, ("A10-1",), "", rows, rows.astype(float))
    out = [suspects.Suspect(one, 0.1, 3.0, 0.1)]
    own = suspects._with_own_errors(model, np.asarray(vector), out)
    found = {name: value[0] for name, value in model.table.named(own[None]).items()}
    for name in ("curvature_noise", "bend_angle_noise"):
        assert found[name] == pytest.approx(TRUTH[name], rel=0.25)
    assert found["reading_correlation"] < 0.7
    assert found["stiffness_scatter"] == pytest.approx(values["stiffness_scatter"])


def test_widths_are_found_again():
    generator = np.random.default_rng(2)
    n = 600
    specimens = np.kron(np.eye(n // 4), np.ones((4, 4)))
    deviation = np.repeat(generator.standard_normal(n // 4), 4)
    residual = 0.5 * deviation + 0.6 * generator.standard_normal(n)
    parts = ReadingParts(residual, np.ones((n, 1)), specimens, np.eye(n), np.full(n, "one"))
    found = parts.widths()
    assert found.errors["one"] == pytest.approx(0.6, rel=0.1)
    assert found.scatter == pytest.approx(0.5, rel=0.15)


def test_degrees_of_freedom_are_those_of_the_specimens():
    generator = np.random.default_rng(6)
    specimens = np.kron(np.eye(60), np.ones((4, 4)))
    residual = 0.6 * np.repeat(generator.standard_normal(60), 4)
    residual += 0.01 * generator.standard_normal(240)
    parts = ReadingParts(
        residual, np.ones((240, 1)), specimens, 1e-4 * np.eye(240), np.full(240, "one")
    )
    alone = parts.widths()
    assert alone.dof == pytest.approx(59, rel=0.1)
    # as many again, of the same width
    beside = -60 * np.log(FACTORS) - 30 * (0.6 / FACTORS) ** 2
    both = parts.widths(beside)
    assert both.dof == pytest.approx(119, rel=0.1)


def test_films_say_how_wide_the_scatter_of_specimens_is(study):
    assert np.all(film_density(*study, ()) == 0.0)  # it has none
    model = small_model()
    vector = model.table.vectors(values_of())[0]
    [films] = model.of_kind(Tensile)
    left_out = film_density(model, vector, ()) - film_density(model, vector, films.labels[:1])
    for k in (0, 3):
        values = values_of(TRUTH | {"stiffness_scatter": TRUTH["stiffness_scatter"] * FACTORS[k]})
        first = films.log_likelihood(model.state(values))[0, 0]
        assert left_out[k] == pytest.approx(first)


def test_the_split_is_the_largest_t_of_all():
    generator = np.random.default_rng(3)
    sizes = generator.standard_normal(9)
    ordered = np.sort(sizes)
    each = [ttest_ind(ordered[k:], ordered[:k]).statistic for k in range(3, 7)]
    t, part = largest_t(sizes[None], np.ones(9))
    assert t[0] == pytest.approx(max(each))
    assert part[0] == 3 + int(np.argmax(each))


def test_t_of_a_day_pools_scatter_with_the_errors_of_reading(monkeypatch):
    generator = np.random.default_rng(4)
    sizes, own = generator.standard_normal(12), np.arange(12) < 5
    wide = t_between(3.0 * sizes, np.ones(12), own)
    monkeypatch.setattr(suspects, "STATED_DOF", 0)
    alone = t_between(3.0 * sizes, np.ones(12), own)
    assert alone == pytest.approx(ttest_ind(sizes[own], sizes[~own]).statistic)
    monkeypatch.setattr(suspects, "STATED_DOF", 10**9)
    stated = t_between(3.0 * sizes, np.ones(12), own)
    means = 3.0 * (sizes[own].mean() - sizes[~own].mean())
    assert stated == pytest.approx(means / np.sqrt(1 / 5 + 1 / 7), rel=1e-6)
    assert abs(alone) < abs(wide) < abs(stated)


def test_the_level_is_shared_out():
    assert SHARES.sum() == pytest.approx(1.0)


def test_a_sound_study_has_no_suspects(study):
    model, mode = study
    assert find_suspects(model, mode, lambda found: mode) == ()


def test_every_reading_is_of_a_picture_of_its_specimen(study):
    model, mode = study
    known = hypotheses(model, mode)
    pictures = [one for one in known if one.oddity is Anomaly.READING]
    places = model.places
    assert sum(one.kind != "" for one in pictures) == len(places)
    for one in pictures:
        assert set(places.specimen[one.rows]) == set(one.specimens)
        assert len(set(places.along[one.rows])) == 1
    names = {one.specimens for one in known if one.oddity is Anomaly.BATCH}
    # the lowest and the highest rate are extrapolated to, where a cause may act alone
    assert names == {tuple(f"A{rate:02d}-{k}" for k in range(3)) for rate in (5, 10, 15, 20)}
    assert any(
        one.specimens == ("A00-0", "A00-1", "A00-2")
        for one in hypotheses(model, mode, [("A00-0", "A00-1", "A00-2")])
    )


@pytest.mark.parametrize(
    ("p_value", "size", "expected"),
    [
        (0.9 * BEYOND_DOUBT, 0.5, True),
        (1.1 * BEYOND_DOUBT, 0.5, False),  # one sound study in a thousand would lose data
        (1e-9, 0.9 * LEAST_CHANGE, False),  # sure, but within what a model may err by
        (1e-9, 1.1 * LEAST_CHANGE, True),
    ],
)
def test_what_is_beyond_doubt_is_neither_chance_nor_small(study, p_value, size, expected):
    model, _ = study
    rows = (model.places.specimen == "A10-1") & (model.places.kind == CURVATURE)
    # a jump by a share of the largest reading
    change = np.where(rows, model.observed[rows].max(), 0.0)
    way = Irregularity(Anomaly.JUMP, ("A10-1",), "", rows, change)
    assert Suspect(way, size, 6.0, p_value).is_beyond_doubt(model, study[1]) is expected


@pytest.mark.parametrize(("factor", "expected"), [(1.0, False), (1.2, False), (1.9, True)])
def test_a_specimen_is_set_aside_only_if_it_differs_from_its_replicates(study, factor, expected):
    """A05-0 and A05-1 differ by a third, as where a cause makes a rate scatter."""
    model, mode = study
    data = model.data_of(Curvature).tests
    readings = data.readings.copy()
    readings[data.specimens.index("A05-1")] *= 1.35
    readings[data.specimens.index("A05-2")] *= 1.35 * factor
    wrong = model.with_observations(*data_of_actuators(data.with_readings(readings), model.base))
    rows = wrong.places.specimen == "A05-2"
    way = Irregularity(Anomaly.RESPONSE, ("A05-2",), "", rows, np.where(rows, wrong.observed, 0.0))
    assert Suspect(way, 0.5, 9.0, 1e-9).is_beyond_doubt(wrong, mode) is expected


@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_specimen_that_responds_otherwise_is_found_by_name(study, factor):
    wrong, mode, refit = planted(study, "A10-1", lambda read: factor * read)
    [found] = find_suspects(wrong, mode, refit)
    assert found.hypothesis.specimens == ("A10-1",)
    assert found.hypothesis.oddity is Anomaly.RESPONSE
    assert np.sign(found.size) == np.sign(1.0 - factor)
    assert found.p_value < LEVEL


def test_a_mistraced_picture_is_found_and_nothing_else(study):
    points = study[0].data_of(Curvature).tests.pressure.shape[1]

    def mistraced(read):
        changed = read.copy()
        changed[[points - 2, 2 * points - 2]] *= 1.4
        return changed

    wrong, mode, refit = planted(study, "A15-2", mistraced)
    [found] = find_suspects(wrong, mode, refit)
    place = wrong.data_of(Curvature).tests.pressure[0, points - 2]
    assert found.hypothesis.oddity is Anomaly.READING
    assert found.hypothesis.specimens == ("A15-2",)
    assert found.hypothesis.at == pytest.approx(place)
    assert found.size == pytest.approx(0.4, abs=0.1)


def test_a_level_that_deviates_together_is_a_batch(study):
    model, mode = study
    data = model.data_of(Curvature).tests
    readings = data.readings.copy()
    readings[data.degradation[:, 0] == 10.0] *= 0.55
    wrong = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )
    start = find_mode(wrong, mode)[0]
    keep = np.flatnonzero(data.degradation[:, 0] != 10.0)
    rest = find_mode(
        wrong.with_observations(
            *data_of_actuators(wrong.data_of(Curvature).tests.subset(keep), wrong.base)
        ),
        mode,
    )[0]
    found = find_suspects(wrong, start, lambda suspects: rest)
    named = {name for one in found for name in one.hypothesis.specimens}
    assert named == {"A10-0", "A10-1", "A10-2"}


def short_on_a_day(study, day, factor=0.93):
    """A study with lengths short on a day, its mode, and one without the specimens of that day."""
    model, mode = study
    data = model.data_of(Curvature).tests
    readings = data.readings.copy()
    of_day = np.isin(data.specimens, day)
    readings[of_day, : data.pressure.shape[1]] /= factor
    wrong = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )
    rest = find_mode(
        wrong.with_observations(
            *data_of_actuators(
                wrong.data_of(Curvature).tests.subset(np.flatnonzero(~of_day)), wrong.base
            )
        ),
        mode,
    )[0]
    return wrong, find_mode(wrong, mode)[0], rest


@pytest.mark.parametrize("is_recorded", [True, False])
def test_a_day_on_which_lengths_were_short_is_found(study, is_recorded):
    """By a column, or as the second specimens of all rates."""
    day = tuple(name for name in study[0].data_of(Curvature).tests.specimens if name.endswith("-1"))
    wrong, start, rest = short_on_a_day(study, day)
    [found] = find_suspects(wrong, start, lambda suspects: rest, [day] if is_recorded else [])
    assert set(found.hypothesis.specimens) == set(day)
    assert found.hypothesis.oddity is Anomaly.DAY
    assert found.size == pytest.approx(1.0 / 0.93 - 1.0, abs=0.02)


def test_a_day_that_no_table_tells_is_found_by_its_sizes(study):
    day = ("A00-0", "A05-1", "A10-1", "A15-2", "A20-0", "A25-2")
    wrong, start, rest = short_on_a_day(study, day, factor=0.85)
    [found] = find_suspects(wrong, start, lambda suspects: rest)
    assert set(found.hypothesis.specimens) == set(day)
    assert found.hypothesis.oddity is Anomaly.DAY


def test_rounds_whose_lengths_scatter_are_no_days(study):
    """Lengths of specimens that differ by several errors of reading, in no order, accuse nobody."""
    model, mode = study
    data = model.data_of(Curvature).tests
    factor = np.exp(0.06 * np.random.default_rng(8).standard_normal(SPECIMENS))
    readings = data.readings.copy()
    readings[:, : data.pressure.shape[1]] *= factor[:, None]
    wrong = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )
    known = hypotheses(wrong, mode)
    free = scored(parts_of(wrong, mode), known)
    free = suspects.Scored(free.observed, suspects._with_free_response(known, free))
    days = [k for k, one in enumerate(known) if one.oddity is Anomaly.DAY]
    assert len(days) == 3
    assert np.all(suspects._unclear_days(known, free, 0.01)[days])


def way(oddity, names, rows=()):
    read = np.isin(np.arange(10), rows)
    return Irregularity(oddity, names, "", read, read.astype(float))


def test_a_specimen_that_is_odd_alone_does_not_draw_its_batch_along():
    alone = suspects.Suspect(way(Anomaly.RESPONSE, ("A25-3",)), -0.6, -5.4, 1e-4)
    batch = suspects.Suspect(way(Anomaly.BATCH, ("A25-1", "A25-2", "A25-3")), -0.8, -7.0, 1e-6)
    other = suspects.Suspect(way(Anomaly.BATCH, ("A10-1", "A10-2", "A10-3")), 0.4, 6.0, 1e-6)
    assert suspects._not_drawn_along((batch, alone, other)) == (alone, other)
    assert suspects._not_drawn_along((batch, other)) == (batch, other)


def test_what_comes_again_with_nearly_the_same_readings_is_no_other():
    """The edge of the picture moves by a reading with the calibration."""
    edge = way(Anomaly.EDGE, ("A00-1",), [3, 4, 5])
    assert suspects._is_among(edge, [way(Anomaly.EDGE, ("A00-1",), [4, 5])])
    assert not suspects._is_among(edge, [way(Anomaly.EDGE, ("A00-1",), [5, 6, 7])])
    assert not suspects._is_among(edge, [way(Anomaly.CUT_OFF, ("A00-1",), [3, 4, 5])])


def test_false_suspects_are_as_rare_as_stated(study):
    """Under the linear model with known scatter, whichever of all hypotheses is the oddest."""
    model, mode = study
    known = hypotheses(model, mode)
    parts = parts_of(model, mode)
    now, pool = scored(parts, known), pool_of(model, known)
    generator = np.random.default_rng(4)
    whole, false = now.norms, 0
    for _ in range(300):
        drawn = suspects.Scored(generator.standard_normal(len(now.observed)), now.columns)
        false += pool.p_values(drawn.scores(whole)).min() < LEVEL
    assert false <= 5  # of 300 at 0.01, of which at most three are expected


def test_few_specimens_accuse_nobody(study):
    model, mode = study
    few = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.subset(np.array([0, 3, 6])), model.base)
    )
    known = hypotheses(few, mode)
    pool = pool_of(few, known)
    assert np.all(pool.p_values(np.full(len(known), 50.0)) == 1.0)
