"""Figures of what is wrong with a model, from the tables that a run writes."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color

from bayesdeg.criticism.checks.statistics import SIGNIFICANT, Physical
from bayesdeg.criticism.checks.statistics import frame as statistics_frame
from bayesdeg.criticism.holdout.gain import loo_pit
from bayesdeg.pages.drawing import BASE_COLOUR, FINAL_COLOUR, INK, Shown
from bayesdeg.pages.figures.criticism import (
    FURTHEST,
    band_position,
    discrepancy_figure,
    loo_pit_figure,
    statistics_figure,
)
from bayesdeg.pages.page import FIGURES as DRAWN
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.tables import Tables
from bayesdeg.pages.wording import number
from bayesdeg.run.writing import loo_pit_table

LEVELS = (0.0, 10.0, 25.0)


def statistics():
    """Four that are there, one of them far out, and one that is not."""
    nan = float("nan")
    return statistics_frame(
        (
            Physical("trend with time", "%/min", 0.4, -1.0, 1.2, 0.6, 0.9, "it grows"),
            Physical("offset", "kPa", 14.0, -1.0, 1.0, 0.002, 0.004, "curves start late"),
            Physical("ratio of slopes", "–", 1.04, 0.9, 1.1, 0.4, 0.9, "they steepen"),
            Physical("trend with degradation", "%", -9.0, -4.0, 4.0, 0.01, 0.03, "they bend less"),
            Physical("area", "kPa/m", nan, nan, nan, nan, nan, "", "needs unloading"),
        )
    )


def transforms():
    generator = np.random.default_rng(0)
    draws = generator.standard_normal((300, 60))
    return loo_pit_table(
        {
            "base": loo_pit(draws, 2.5 * generator.standard_normal(60)),
            "final": loo_pit(draws, draws[0]),
        }
    )


def discrepancy(*, films=False):
    """A discrepancy of a tenth of the pressure that the named cause removes but for a hundredth."""
    rows = []
    for model, share in (("base", 0.1), ("final", 0.01)):
        for level in LEVELS:
            for specimen in range(3):
                for along in np.linspace(20.0, 240.0, 12):
                    smooth = share * along / (1.0 + level)
                    rows.append(
                        {
                            "model": model,
                            "kind": "stress" if films else "curvature",
                            "history": "equibiaxial" if films and specimen else "uniaxial",
                            "specimen_id": f"{level:g}-{specimen}",
                            "degradation_pct": level + 0.2 * specimen * (not films),
                            "along": 1.0 + along / 100.0 if films else along,
                            "discrepancy": smooth,
                            "residual": smooth + 0.05 * (-1.0) ** specimen,
                        }
                    )
    return pd.DataFrame(rows)


FIGURES = {
    "statistics": lambda: statistics_figure(statistics()),
    "loo-pit": lambda: loo_pit_figure(transforms()),
    "discrepancy": lambda: discrepancy_figure(discrepancy()),
    "discrepancy-films": lambda: discrepancy_figure(discrepancy(films=True)),
}


def lines_of(axes, colour):
    return [line for line in axes.lines if same_color(line.get_color(), colour)]


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_of_criticism_states_its_unit(name):
    figure = FIGURES[name]()
    for axes in figure.axes:
        assert (figure.get_supxlabel() or axes.get_xlabel()).endswith("]")
        labels = [figure.get_supylabel()] if figure.get_supylabel() else []
        labels += [] if labels else [tick.get_text() for tick in axes.get_yticklabels()]
        assert labels
        assert all(label.endswith("]") for label in labels)


def test_the_figures_are_the_same_from_the_files_of_a_run(tmp_path):
    for table, draw in (
        (statistics(), statistics_figure),
        (transforms(), loo_pit_figure),
        (discrepancy(), discrepancy_figure),
    ):
        table.to_csv(tmp_path / "table.csv", index=False)
        again = pd.read_csv(tmp_path / "table.csv")
        first, second = (
            [line.get_xydata() for axes in draw(t).axes for line in axes.lines]
            for t in (table, again)
        )
        for one, other in zip(first, second, strict=True):
            np.testing.assert_allclose(one, other)


def test_unloading_and_later_cycles_have_marks_of_their_own_in_the_discrepancy():
    one = discrepancy().query("model == 'base'")
    histories = ("loading 1 hanging", "unloading 1 hanging", "loading 2 hanging")
    figure = discrepancy_figure(pd.concat([one.assign(history=h) for h in histories]))
    for axes in figure.axes:
        assert [line.get_marker() for line in axes.lines if line.get_linestyle() == "None"] == [
            "o",
            "v",
            "s",
        ]
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert entries[-2:] == ["unloading", "later cycles"]


def test_the_most_remarkable_statistic_stands_on_top_with_its_unit_and_value():
    axes = FIGURES["statistics"]().axes[0]
    labels = [tick.get_text().replace("\N{NO-BREAK SPACE}", " ") for tick in axes.get_yticklabels()]
    assert labels[::-1] == [
        "offset [kPa]",
        "trend with degradation [%]",
        "ratio of slopes [–]",
        "trend with time [%/min]",
    ]
    (right,) = axes.child_axes
    texts = [tick.get_text().replace("\N{NO-BREAK SPACE}", " ") for tick in right.get_yticklabels()]
    assert texts[-1].split(", ") == ["14.0", "p = 0.002"]


def test_significant_statistics_are_filled_and_the_furthest_drawn_at_the_edge():
    axes = FIGURES["statistics"]().axes[0]
    filled, hollow = lines_of(axes, BASE_COLOUR), lines_of(axes, FINAL_COLOUR)
    arrow = next(line for line in filled if line.get_marker() == ">")
    assert list(arrow.get_xdata()) == [FURTHEST]
    assert list(arrow.get_ydata()) == [3.0]
    circle = next(line for line in filled if line.get_marker() == "o")
    assert list(circle.get_xdata()) == [-2.25]
    (unremarkable,) = hollow
    np.testing.assert_allclose(sorted(unremarkable.get_xdata()), [0.3 / 1.1, 0.4], atol=1e-9)


def test_a_value_at_the_end_of_its_band_is_at_one():
    row = pd.DataFrame({"value": [3.0], "simulated_q05": [1.0], "simulated_q95": [3.0]})
    assert band_position(row).tolist() == [1.0]


def test_the_transforms_get_a_panel_a_model_with_its_band_and_p_value():
    table = transforms()
    before, after = FIGURES["loo-pit"]().axes
    base = table[table["model"] == "base"]
    (curve,) = lines_of(before, BASE_COLOUR)
    np.testing.assert_allclose(curve.get_ydata(), base["difference"])
    edges = before.collections[0].get_paths()[0].vertices[:, 1]
    assert edges.max() == pytest.approx(base["high"].max())
    assert edges.min() == pytest.approx(base["low"].min())
    assert before.get_title(loc="left").startswith("base model, p")
    assert after.get_title(loc="left").startswith("final model, p")
    assert lines_of(after, FINAL_COLOUR)


def test_a_run_without_a_named_cause_has_one_panel_of_transforms():
    table = transforms()
    figure = loo_pit_figure(table[table["model"] == "base"])
    assert sum(axes.axison for axes in figure.axes) == 1


def test_what_there_is_to_explain_and_what_is_left_stand_in_one_panel_a_level():
    table = discrepancy()
    figure = FIGURES["discrepancy"]()
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == len(LEVELS)
    for axes in shown:
        before, after = lines_of(axes, BASE_COLOUR), lines_of(axes, FINAL_COLOUR)
        assert len(before) == len(after) == 3
        for one, other in zip(before, after, strict=True):
            np.testing.assert_allclose(one.get_ydata(), 10.0 * other.get_ydata())
    circles = [line for axes in shown for line in lines_of(axes, INK)]
    drawn = np.sort(np.concatenate([line.get_ydata() for line in circles]))
    np.testing.assert_allclose(drawn, np.sort(table[table["model"] == "base"]["residual"]))


@pytest.mark.parametrize("name", ["discrepancy", "discrepancy-films"])
def test_what_there_is_to_explain_has_one_scale(name):
    shown = [axes for axes in FIGURES[name]().axes if axes.axison]
    assert len({axes.get_ylim() for axes in shown}) == 1


def test_films_are_drawn_over_stretch_in_a_panel_a_mode():
    figure = FIGURES["discrepancy-films"]()
    assert [a.get_title(loc="left") for a in figure.axes if a.axison] == ["equibiaxial", "uniaxial"]
    assert figure.get_supxlabel().startswith("stretch")
    assert figure.get_supylabel().endswith("[MPa]")


def test_without_a_named_cause_nothing_is_said_to_be_left():
    table = discrepancy()
    figure = discrepancy_figure(table[table["model"] == "base"])
    (legend,) = figure.legends
    first, _ = (text.get_text() for text in legend.get_texts())
    assert first == "to explain"


def caption_of(name, table):
    tables = Tables({name.replace("-", "_"): table})
    shown = Shown(VerdictRecord(outcome="adequate"), RunRecord(title="a run"), tables)
    return DRAWN[name].drawing(shown).caption.replace("\N{NO-BREAK SPACE}", " ")


def test_captions_read_what_is_remarkable_and_nothing_else():
    caption = caption_of("statistics", statistics())
    remarkable = [row for row in statistics().itertuples() if row.p_adjusted <= SIGNIFICANT]
    assert len(remarkable) == 2
    for row in remarkable:
        assert (
            f"{row.statistic.capitalize()} {number(row.value)} {row.unit}: {row.reading}."
            in caption
        )
    assert "they steepen" not in caption
    table = transforms()
    caption = caption_of("loo-pit", table)
    for model in ("base", "final"):
        sentence = table[table["model"] == model]["sentence"].iloc[0]
        assert f"{model.capitalize()} model: {sentence}" in caption
    alone = discrepancy()[discrepancy()["model"] == "base"]
    both, one = (caption_of("discrepancy", table) for table in (discrepancy(), alone))
    assert both.startswith(one)
    assert both != one
