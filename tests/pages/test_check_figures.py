import math

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color

from bayesdeg.pages.drawing import BASE_COLOUR, FINAL_COLOUR
from bayesdeg.pages.figures.checks import (
    leave_one_out_figure,
    prior_curvature_figure,
    prior_stress_figure,
    sensitivity_figure,
)
from bayesdeg.pages.summaries import MOST_LEVELS, parameter_rows
from tests.pages.html_reading import numbers_in, read_html, table_cells
from tests.pages.synthetic_run import (
    LEVELS,
    leave_one_out,
    observations,
    parameters,
    prior_predictive,
    prior_sensitivity,
    tensile,
    write_bare,
)

GENERATOR = np.random.default_rng(5)
PRIOR = prior_predictive()
CURVATURE = PRIOR[PRIOR["quantity"] == "curvature"]
STRESS = PRIOR[PRIOR["quantity"] == "nominal_stress"]
FIGURES = {
    "leave-one-out": lambda: leave_one_out_figure(leave_one_out()),
    "prior-sensitivity": lambda: sensitivity_figure(prior_sensitivity()),
    "prior-curvature": lambda: prior_curvature_figure(
        CURVATURE, observations(GENERATOR, final=True)
    ),
    "prior-curvature-alone": lambda: prior_curvature_figure(CURVATURE, None),
    "prior-stress": lambda: prior_stress_figure(STRESS, tensile(GENERATOR)),
    "prior-stress-alone": lambda: prior_stress_figure(STRESS, None),
}


def lines_of(axes, colour):
    return [line for line in axes.lines if same_color(line.get_color(), colour)]


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_of_numbers_states_its_unit(name):
    figure = FIGURES[name]()
    for axes in figure.axes:
        labels = [figure.get_supxlabel() or axes.get_xlabel()]
        labels += [figure.get_supylabel() or axes.get_ylabel()]
        named = [axes.get_xticklabels(), axes.get_yticklabels()]
        for label, ticks in zip(labels, named, strict=True):
            categories = any(tick.get_text()[:1].isalpha() for tick in ticks)
            assert categories or axes is figure.axes[0] or label.endswith("]"), label


def test_refitted_specimens_are_filled_and_stand_above_the_line():
    table = leave_one_out()
    shape, influence = FIGURES["leave-one-out"]().axes
    (filled,) = lines_of(shape, BASE_COLOUR)
    refitted = table[table["refitted"] == 1]
    np.testing.assert_allclose(filled.get_ydata(), refitted["pareto_k"])
    assert min(filled.get_ydata()) > 0.7
    np.testing.assert_allclose([bar.get_height() for bar in influence.patches], table["influence"])
    assert [t.get_text() for t in influence.get_xticklabels()] == list(table["specimen_id"])


def test_an_unbounded_shape_stays_inside_the_figure():
    table = leave_one_out().assign(pareto_k=math.inf, refitted=1)
    (filled,) = lines_of(leave_one_out_figure(table).axes[0], BASE_COLOUR)
    assert np.isfinite(filled.get_ydata()).all()


def test_conclusions_alone_are_drawn_first_on_top():
    axes = FIGURES["prior-sensitivity"]().axes[0]
    names = [tick.get_text() for tick in axes.get_yticklabels()]
    assert names == ["paper stiffness", "volume ratio", "C1 at 0 %"]
    (prior,), (data,) = lines_of(axes, BASE_COLOUR), lines_of(axes, FINAL_COLOUR)
    assert list(prior.get_xdata()) == [0.346, 0.064, 0.013]
    assert list(data.get_xdata()) == [0.041, 0.148, 0.133]


def test_the_priors_curves_get_a_panel_a_condition_and_the_readings_once():
    figure = FIGURES["prior-curvature"]()
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == len(LEVELS)
    circles = sum(
        len(line.get_xdata()) for axes in shown for line in axes.lines if line.get_marker() == "o"
    )
    assert circles == 3 * len(LEVELS) * 12  # not once for each model


@pytest.mark.parametrize("name", ["prior-curvature", "prior-stress"])
def test_the_priors_curves_have_one_scale(name):
    shown = [axes for axes in FIGURES[name]().axes if axes.axison]
    assert len({axes.get_ylim() for axes in shown}) == 1


def test_no_more_panels_of_stress_than_fit():
    many = pd.concat(
        STRESS[STRESS["degradation_pct"] == 0.0].assign(degradation_pct=rate)
        for rate in np.linspace(0.0, 25.0, 15)
    )
    axes = prior_stress_figure(many, None).axes
    assert sum(a.axison for a in axes) == MOST_LEVELS


# ---- the page


def test_the_page_shows_what_hangs_on_priors_and_specimens(built):
    folder, html = built("named")
    page = read_html(html)
    posterior = page.by_id("posterior")
    for sentence in folder.read_run().checks.values():
        assert sentence.split(":")[0] in posterior.text.replace("\N{NO-BREAK SPACE}", " ")
    table = folder.read_table("leave_one_out")
    cells = table_cells(page, "Log predictive density of all readings of a specimen")
    assert [row[0] for row in cells] == list(table["specimen_id"])
    assert [row[5] == "yes" for row in cells] == list(table["refitted"] == 1.0)
    for row, k in zip(cells, table["pareto_k"], strict=True):
        assert numbers_in(row[4])[0] == pytest.approx(k, abs=0.006)
    table = folder.read_table("prior_sensitivity")
    cells = table_cells(page, "Sensitivity to priors and data")
    assert [row[0] for row in cells] == list(table["quantity"])
    for row, (_, entry) in zip(cells, table.iterrows(), strict=True):
        assert numbers_in(row[1])[0] == pytest.approx(entry["prior"], abs=6e-4)
        assert row[4] == entry["diagnosis"]


def test_the_sentences_stand_open_and_the_tables_folded(built):
    page = read_html(built("named")[1])
    folded = [details.text for details in page.by_id("posterior").all("details")]
    said = built("named")[0].read_run().checks
    assert any("(36)" in text for text in folded)
    for sentence in (said["prior_sensitivity"], said["leave_one_out"]):
        assert sentence.split(". ")[0] in page.by_id("posterior").text
        assert not any(sentence.split(". ")[0] in text for text in folded)


def test_a_run_without_checks_says_so(built):
    section = read_html(built("bare")[1]).by_id("posterior")
    assert sum("absent" in e.attributes.get("class", "") for e in section.every()) >= 3


def test_a_run_from_before_the_checks_is_still_read(tmp_path):
    assert write_bare(tmp_path / "old").read_run().checks == {}


def test_wide_positive_priors_are_drawn_to_a_logarithmic_scale():
    row = parameters().iloc[0]
    wide = {"prior_q05": 0.001, "prior_q95": 10.0, "q05": 0.1, "q95": 1.0}
    (entry,) = parameter_rows(pd.DataFrame([{**row, **wide}]))
    assert entry.logarithmic
    assert (entry.prior.left, entry.prior.width) == pytest.approx((0.0, 100.0))
    assert (entry.posterior.left, entry.posterior.width) == pytest.approx((50.0, 25.0))
    narrow = {"prior_q05": 1.0, "prior_q95": 5.0, "q05": 2.0, "q95": 3.0}
    (entry,) = parameter_rows(pd.DataFrame([{**row, **narrow}]))
    assert not entry.logarithmic
    assert (entry.posterior.left, entry.posterior.width) == pytest.approx((25.0, 25.0))
