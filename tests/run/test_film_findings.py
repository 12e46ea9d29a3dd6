"""What the films alone say, as tables, sentences and a figure of the report."""

from unittest.mock import MagicMock

import numpy as np
import pytest

from bayesdeg.analysis.films import (
    CourseFit,
    Films,
    begin_examination,
    common_error,
    course_summary,
)
from bayesdeg.assembly.assemble import assemble
from bayesdeg.criticism.posterior.convergence import diagnose
from bayesdeg.inference.course import CourseModel, degradation_at, rate_errors
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.inference.tree import to_datatree
from bayesdeg.pages.figures.films import course_figure
from bayesdeg.pages.folder import POSTERIOR_COURSE, RunFolder
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.page import build_page
from bayesdeg.pages.tables import COURSE, PARAMETERS, TABLES
from bayesdeg.progress import Silent
from bayesdeg.run import writing
from tests.pages.html_reading import read_html
from tests.pages.synthetic_run import write_full
from tests.run.planted_offset import MOISTURE
from tests.run.study_files import SETTINGS, study_in

TRUTH = {
    "fresh_moisture": 20.0,
    "degradation_limit": 32.0,
    "degradation_time_constant": 14.0,
    "moisture_scatter": 0.6,
}
TIMES = np.repeat([0.0, 8.0, 16.0, 24.0], 9)


def fit_of(*, width=1e-6, times=TIMES, **changes):
    """A course whose posterior is known: independent normal laws about the truth."""
    values = {name: np.array(v) for name, v in (TRUTH | changes).items()}
    generator = np.random.default_rng(1)
    model = CourseModel(tuple(f"m{i}" for i in range(times.size)), times, np.full(times.size, 17.0))
    centre = model.table.vectors(values)
    vectors = centre + width * generator.standard_normal((4, 50, 10, 4))
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(4, 0.4))
    return CourseFit(model, chain, diagnose(model, chain, EFFORTS["quick"]))


def test_the_table_holds_bands_and_films():
    fit = fit_of(width=0.02)
    table = Films(fit, None, np.empty((0, 2))).tables(np.random.default_rng(2))[COURSE]()
    assert set(TABLES[COURSE].headings) <= set(table.columns)
    films = table[table["kind"] == "film"]
    assert len(films) == 36
    fresh = fit.draws["fresh_moisture"].mean()
    assert films["degradation_pct"].iloc[0] == pytest.approx(100.0 * (1.0 - 17.0 / fresh))
    band = table[table["kind"] == "band"].set_index("time_h")
    assert band.index[-1] == 24.0
    at_end = degradation_at(fit.draws, np.array([24.0]))[:, 0]
    assert band.loc[24.0, "q05"] == pytest.approx(np.percentile(at_end, 5))
    assert band.loc[24.0, "q95"] == pytest.approx(np.percentile(at_end, 95))
    assert band.loc[0.0, "q50"] == 0.0


def test_the_band_of_moisture_is_that_of_a_film():
    table = Films(fit_of(), None, np.empty((0, 2))).tables(np.random.default_rng(3))[COURSE]()
    start = table[(table["kind"] == "band") & (table["time_h"] == 0.0)].iloc[0]
    reach = 1.645 * TRUTH["moisture_scatter"]
    assert start["moisture_q05"] == pytest.approx(20.0 - reach, abs=0.1)
    assert start["moisture_q95"] == pytest.approx(20.0 + reach, abs=0.1)


def test_a_rate_is_reached_after_the_time_of_the_closed_form():
    found = course_summary(fit_of())
    assert found.is_certain
    assert found.films == 36
    assert found.hours == pytest.approx([-14.0 * np.log(1.0 - 25.0 / 32.0)] * 3, rel=1e-4)
    assert found.limit == pytest.approx([32.0] * 3, rel=1e-4)
    assert found.hours[0] < found.last_h == 24.0


def test_a_rate_may_be_reached_beyond_the_readings():
    found = course_summary(fit_of(degradation_time_constant=30.0))
    assert found.hours[0] > found.last_h


def test_a_rate_may_never_be_reached():
    assert course_summary(fit_of(degradation_limit=20.0)).reached == 0.0
    perhaps = course_summary(fit_of(width=0.05, degradation_limit=25.0))
    assert perhaps.reached == pytest.approx(0.47, abs=0.07)
    assert not perhaps.is_certain


STATED = np.array([[5.0, 0.5], [25.0, 0.5], [25.0, 2.0]])


def test_the_error_of_fresh_moisture_is_that_of_the_mean_of_fresh_films():
    found = common_error(fit_of(), STATED)
    errors = rate_errors(fit_of().draws, np.array([25.0]), fresh_films=9, films=9)
    assert (found.fresh, found.films, found.level, found.stated) == (9, 9, 25.0, 0.5)
    assert found.common == pytest.approx(errors.common.mean())
    assert found.common == pytest.approx(0.75, rel=1e-4)  # 75 × 0.03/3
    assert found.own == pytest.approx(1.0, rel=1e-4)
    assert found.total == pytest.approx(np.hypot(0.75, 1.0), rel=1e-4)


def test_without_fresh_films_the_error_is_not_known():
    found = common_error(fit_of(times=TIMES + 8.0), STATED)
    assert found.fresh == 0
    assert np.isnan(found.total)


def test_a_study_without_degraded_specimens_states_no_error():
    found = common_error(fit_of(), np.empty((0, 2)))
    assert (found.stated, found.level) == (None, 25.0)


def test_parameters_of_the_course_stand_in_the_table_with_units():
    table = writing.parameters(fit_of(width=0.02), "course").set_index("parameter")
    assert {*table.columns, "parameter"} >= set(TABLES[PARAMETERS].headings)
    units = table["unit"].to_dict()
    assert units["degradation_time_constant"] == "h"
    assert units["fresh_moisture"] == "%"
    assert table.loc["degradation_limit", "q50"] == pytest.approx(32.0, rel=0.01)


# four readings of stress would leave their noise to the prior, down to nothing
NOISE = """[priors]
tensile_noise = { law = "lognormal", median = 0.02, sigma = 0.3 }
tensile_noise_floor = { law = "lognormal", median = 0.01, sigma = 0.3 }
"""


def examine(study, model):
    seed = np.random.SeedSequence(5)
    begun = begin_examination(study, model, effort=EFFORTS["quick"], seed=seed)
    return begun(Silent(), Guard(strict=True))


@pytest.fixture(scope="module")
def examined(tmp_path_factory):
    files = {"moisture.csv": MOISTURE, "study.toml": SETTINGS + NOISE}
    study = study_in(tmp_path_factory.mktemp("study"), files)
    model = assemble(study).model
    return examine(study, model)


def test_a_study_s_films_are_calibrated_until_they_may_be_used(examined):
    assert examined.course.diagnosis.usable
    draws = examined.course.draws
    assert np.mean(draws["fresh_moisture"]) == pytest.approx(20.0, abs=0.5)
    assert np.mean(draws["moisture_scatter"]) == pytest.approx(0.4, abs=0.15)
    assert examined.stated.tolist() == [[25.0, 1.0], [10.0, 0.5], [25.0, 0.5]]
    assert set(examined.sentences()) == {"course", "common_error", "orders", "material_laws"}
    assert set(examined.tables(np.random.default_rng(1))) == {"course", "orders", "material_laws"}


def test_a_study_without_moisture_has_no_course(tmp_path):
    study = study_in(tmp_path, without=("tensile.csv",))
    films = examine(study, assemble(study).model)
    assert films.course is None
    assert films.orders is None
    assert films.sentences() == {}


def test_the_figure_shows_films_and_bands(examined):
    table = examined.tables(np.random.default_rng(1))["course"]()
    left, right = course_figure(table).axes
    assert left.get_xlabel() == "time [h]"
    assert left.get_ylabel() == "moisture content [%]"
    assert right.get_ylabel() == "degradation [%]"
    for axes in (left, right):
        films = next(line for line in axes.lines if len(line.get_xdata()) == 16)
        assert films.get_marker() == "o"
    assert len(right.collections) == 2


def test_the_page_shows_course_and_orders(tmp_path, examined):
    folder = write_full(tmp_path / "run", "named")
    for name, compute in examined.tables(np.random.default_rng(1)).items():
        folder.write_table(name, compute())
    content = folder.read_json("run")
    folder.write_json("run", content | {"checks": examined.sentences()})
    plain = read_html(build_page(tmp_path / "run").read_text(encoding="utf-8")).text
    assert 'id="figure-course"' in (tmp_path / "run" / "index.html").read_text("utf-8")
    for sentence in examined.sentences().values():
        assert sentence.split(". ")[0] in plain.replace("\N{NO-BREAK SPACE}", " ")


def test_a_page_without_them_does_not_speak_of_them(tmp_path):
    write_full(tmp_path / "run", "named")
    text = build_page(tmp_path / "run").read_text(encoding="utf-8")
    assert 'id="figure-course"' not in text


def test_the_posterior_of_the_course_is_kept(tmp_path, examined):
    folder, course = RunFolder(tmp_path / "run"), examined.course
    tree = to_datatree(course.model, course.chain.thinned(50), np.random.default_rng(1))
    folder.write_posterior(POSTERIOR_COURSE, tree)
    read = folder.read_posterior(POSTERIOR_COURSE)["posterior"]
    vectors = course.model.table.vectors({name: read[name].to_numpy() for name in read.data_vars})
    again = course.model.log_prob(vectors.reshape(-1, 4))
    kept = folder.read_posterior(POSTERIOR_COURSE)["sample_stats"]["lp"].to_numpy().ravel()
    np.testing.assert_allclose(again, kept, rtol=1e-9, atol=1e-9)


def test_there_is_no_default_life_where_no_draw_is_answered(monkeypatch):
    found = MagicMock(has_actuators=True)
    found.results.final.model.world.largest_pressure = 240.0
    for name in ("kind_of", "Posterior", "draw_specimens", "respond"):
        monkeypatch.setattr(writing, name, MagicMock())
    writing.respond.return_value.curvature = np.full((3, 1), np.nan)
    assert writing.life(found) is None
