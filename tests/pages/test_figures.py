import re
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from scipy import stats

from bayesdeg.criticism.findings import RuptureCountsEntry
from bayesdeg.pages.drawing import BASE_COLOUR, FINAL_COLOUR, VIRTUAL, inline_svg, panels
from bayesdeg.pages.figures.criticism import gain_figure
from bayesdeg.pages.figures.curvature import (
    bands_figure,
    elongation_figure,
    null_figure,
    residual_figure,
    rupture_figure,
    share_interval,
)
from bayesdeg.pages.figures.films import constants_figure, tensile_figure
from bayesdeg.pages.summaries import MOST_LEVELS, by_level, pooled
from tests.pages.synthetic_run import (
    LEVELS,
    bands,
    constants,
    elongation,
    gain,
    measured,
    observations,
    rupture,
    tensile,
)

GENERATOR = np.random.default_rng(5)
OBSERVED = observations(GENERATOR, final=True)
NULL = pd.DataFrame({"replicate": range(50), "statistic": GENERATOR.gamma(5.0, 1.0, 50)})

CYCLED = pd.concat(
    [
        OBSERVED.assign(
            branch=branch, cycle=cycle, residual_per_m=OBSERVED["residual_per_m"] + cycle
        )
        for branch in ("loading", "unloading")
        for cycle in (1, 2)
    ]
)

FIGURES = {
    "residuals-of-cycles": lambda: residual_figure(
        CYCLED, LEVELS, noise_per_m=0.6, specimens=("A5-1", "A25-2")
    ),
    "residuals": lambda: residual_figure(OBSERVED, LEVELS, noise_per_m=0.6),
    "bands": lambda: bands_figure(bands(), OBSERVED, LEVELS),
    "bands_alone": lambda: bands_figure(bands(), None, LEVELS),
    "gain": lambda: gain_figure(
        pooled(gain("named")), by_level(gain("named")), "base+degraded_skin"
    ),
    "rupture": lambda: rupture_figure(rupture()),
    "elongation": lambda: elongation_figure(elongation()),
    "null": lambda: null_figure(NULL, observed=31.7, name="misfit"),
    "constants": lambda: constants_figure(constants(final=True), measured()),
    "tensile": lambda: tensile_figure(tensile(GENERATOR)),
}


def drawn(figure: Figure, colour: str) -> list[tuple[list[float], list[float]]]:
    return [
        (list(line.get_xdata()), list(line.get_ydata()))
        for axes in (figure.axes if isinstance(figure, Figure) else [figure])
        for line in axes.lines
        if same_color(line.get_color(), colour)
    ]


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_states_its_unit(name):
    figure = FIGURES[name]()
    common = {"x": figure.get_supxlabel(), "y": figure.get_supylabel()}
    for axes in figure.axes:
        if axes.axison:
            x = common["x"] or axes.get_xlabel()
            y = common["y"] or axes.get_ylabel()
            assert re.search(r"\[.+\]$", x), x
            named_rows = name == "gain" and not y
            assert named_rows or re.search(r"\[.+\]$", y), y


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_stands_in_the_page_on_its_own(name):
    svg = inline_svg(FIGURES[name](), name, description='a < b & "c"', virtual=False)
    tree = ElementTree.fromstring(svg)
    assert tree.get("aria-label") == 'a < b & "c"'
    assert tree.get("role") == "img"
    assert tree.get("viewBox")
    assert tree.get("width") is None
    ids = re.findall(r'\bid="([^"]*)"', svg)
    assert len(ids) == len(set(ids))
    assert all(entry.startswith(f"{name}-") for entry in ids)
    referred = re.findall(r'(?:href="#|url\(#)([^")]*)', svg)
    assert set(referred) <= set(ids)
    assert "#0102" not in svg
    assert VIRTUAL not in svg
    assert not re.search(r'(?:href|src)="(?!#)', svg)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_a_virtual_experiment_says_so(name):
    svg = inline_svg(FIGURES[name](), name, description="what", virtual=True)
    tree = ElementTree.fromstring(svg)
    texts = ["".join(node.itertext()).strip() for node in tree.iter() if node.tag.endswith("text")]
    assert VIRTUAL in texts
    assert tree.get("aria-label").startswith(VIRTUAL)


def test_the_same_figure_gives_the_same_bytes():
    first, second = (
        inline_svg(FIGURES["rupture"](), "r", description="", virtual=False) for _ in range(2)
    )
    assert first == second


def test_branches_and_cycles_have_marks_of_their_own_and_a_key():
    figure = FIGURES["residuals-of-cycles"]()
    lines = [line for axes in figure.axes for line in axes.lines if len(line.get_xdata()) > 2]
    for branch in ("loading", "unloading"):
        for cycle in (1, 2):
            dashed, mark = branch == "unloading", "s" if cycle == 2 else "ov"[branch != "loading"]
            own = [
                line
                for line in lines
                if line.get_marker() == mark and (line.get_linestyle() == "--") is dashed
            ]
            assert len(own) == 2 * 3 * len(LEVELS), (branch, cycle)
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert entries[-2:] == ["unloading", "later cycles"]
    plain = [text.get_text() for text in FIGURES["residuals"]().legends[0].get_texts()]
    assert not {"unloading", "later cycles"} & set(plain)


def test_specimens_in_which_the_misfit_sits_are_named_in_their_panels_and_thick():
    figure = FIGURES["residuals-of-cycles"]()
    named = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert named == [[], ["A5-1"], [], [], [], ["A25-2"]]
    for axes, names in zip(figure.axes, named, strict=True):
        thick = [line for line in axes.lines if line.get_linewidth() > 1.5]
        assert len(thick) == 8 * len(names)  # of two models, branches and cycles each
    assert not any(axes.texts for axes in FIGURES["residuals"]().axes)


@pytest.mark.parametrize(("model", "colour"), [("base", BASE_COLOUR), ("final", FINAL_COLOUR)])
def test_residuals_are_those_of_the_table(model, colour):
    lines = drawn(FIGURES["residuals"](), colour)
    table = OBSERVED[OBSERVED["model"] == model]
    assert sorted(y for _, ys in lines for y in ys) == sorted(table["residual_per_m"])
    assert len(lines) == table["specimen_id"].nunique()


def test_each_specimen_lies_in_the_panel_nearest_to_its_degradation():
    figure = FIGURES["residuals"]()
    for axes, level in zip(figure.axes, LEVELS, strict=True):
        assert axes.get_title(loc="left").startswith(f"{level:.0f}")
        others = [abs(level - other) for other in LEVELS if other != level]
        shown = {y for line in axes.lines for y in line.get_ydata()} - {0.0}
        here = OBSERVED[OBSERVED["residual_per_m"].isin(shown)]
        assert (abs(here["degradation_pct"] - level) <= min(others) / 2).all()


def test_bands_are_those_of_the_table():
    table = bands()
    lines = drawn(FIGURES["bands_alone"](), FINAL_COLOUR)
    for (x, y), level in zip(lines, LEVELS, strict=True):
        rows = table[table["degradation_pct"] == level]
        assert x == rows["pressure_kPa"].tolist()
        assert y == rows["q50"].tolist()


def test_the_models_are_drawn_beside_the_readings_of_the_same_specimens():
    figure = FIGURES["bands"]()
    for model, colour in (("base", BASE_COLOUR), ("final", FINAL_COLOUR)):
        dashed = [
            (x, y) for x, y in drawn(figure, colour) if y not in list(bands().groupby("q50").groups)
        ]
        means = OBSERVED[OBSERVED["model"] == model]["mean_per_m"]
        assert set(means) <= {value for _, y in dashed for value in y}


@pytest.mark.parametrize("name", ["bands", "residuals", "tensile"])
def test_panels_of_one_quantity_have_one_scale(name):
    shown = [axes for axes in FIGURES[name]().axes if axes.axison]
    assert len(shown) > 1
    assert len({axes.get_ylim() for axes in shown}) == 1
    assert len({axes.get_xlim() for axes in shown}) == 1


def test_constants_at_a_single_rate_are_points_with_intervals():
    single = constants(final=True).query("degradation_pct == 0")
    figure = constants_figure(single, measured().query("degradation_pct == 0"))
    for axes in figure.axes:
        points = [line for line in axes.lines if line.get_marker() == "o"]
        modulus = axes.get_title(loc="left") == "Young's modulus"
        assert len(points) == 2 + modulus  # base, final, and what was measured
        assert len({line.get_xdata()[0] for line in points}) == len(points)
        left, right = axes.get_xlim()
        assert all(left < line.get_xdata()[0] < right for line in points)
        drawn_intervals = [path.vertices for c in axes.collections for path in c.get_paths()]
        assert sum(np.ptp(vertices[:, 1]) > 0.0 for vertices in drawn_intervals) >= 4
    rows = single[(single["constant"] == "c1") & (single["model"] == "final")].iloc[0]
    (final,) = drawn(figure.axes[0], FINAL_COLOUR)
    assert final[1] == [rows["q50"]]


def test_the_limit_of_elongation_at_a_single_rate_is_a_point_with_its_interval():
    axes = elongation_figure(elongation().query("degradation_pct == 0")).axes[0]
    (path,) = axes.collections[0].get_paths()
    assert np.ptp(path.vertices[:, 1]) > 0.0


def test_rupture_curves_are_those_of_the_table():
    axes = FIGURES["rupture"]().axes[0]
    table = rupture()
    curves = [line for line in axes.lines if len(line.get_ydata())]
    for line, level in zip(curves, LEVELS, strict=True):
        rows = table[table["degradation_pct"] == level]
        assert list(line.get_ydata()) == rows["probability"].tolist()
    colours = [line.get_color() for line in curves]
    assert len(set(colours)) == len(LEVELS)


def test_curves_of_rupture_go_on_dashed_and_counts_are_points_with_intervals():
    level = {"degradation_pct": LEVELS[-1], "pressure_kPa": 100.0, "tested": 3, "ruptured": 2}
    counted = RuptureCountsEntry.read({"source": "summary.csv", "levels": [level]})
    table = rupture()
    tested = float(table["pressure_kPa"].median())
    axes = rupture_figure(table, (counted,), tested).axes[0]
    solid, dashed = (
        [line for line in axes.lines if line.get_linestyle() == style and len(line.get_xdata()) > 2]
        for style in ("-", "--")
    )
    assert len(solid) == len(dashed) == len(LEVELS)
    assert max(max(line.get_xdata()) for line in solid) <= tested
    assert min(min(line.get_xdata()) for line in dashed) <= tested
    [point] = [line for line in axes.lines if line.get_marker() == "o"]
    assert point.get_ydata()[0] == pytest.approx(2.0 / 3.0)
    [interval] = [line for line in axes.lines if line.get_linewidth() == 0.8]
    law = stats.beta(2.5, 1.5)
    assert list(interval.get_ydata()) == pytest.approx(law.ppf([0.05, 0.95]).tolist())
    assert share_interval(0.0, 3.0)[0] == 0.0
    assert share_interval(3.0, 3.0)[1] == 1.0


def test_the_observed_misfit_is_marked():
    lines = drawn(FIGURES["null"](), BASE_COLOUR)
    assert [31.7, 31.7] in [x for x, _ in lines]


def test_held_out_modes_are_marked():
    titles = [axes.get_title(loc="left") for axes in FIGURES["tensile"]().axes]
    assert [("held out" in title) for title in titles if title] == [True] + 6 * [False]
    assert titles[0].startswith("equibiaxial")


@pytest.mark.parametrize("number", [1, 2, 3, 4, 7])
def test_as_many_panels_as_asked_for(number):
    figure, axes = panels(number)
    assert len(axes) == number
    assert sum(entry.axison for entry in figure.axes) == number


def test_gains_are_drawn_beside_errors_only_where_several_are_compared():
    figure = gain_figure(pooled(gain("named")), by_level(gain("named")), "base+degraded_skin")
    assert len(figure.axes) == 2
    figure = gain_figure(pooled(gain("ambiguous")), by_level(gain("ambiguous")), "base+erosion")
    assert len(figure.axes) == 1


def test_gain_with_one_table_only():
    figure = gain_figure(None, by_level(gain("named")), "base+degraded_skin")
    assert [axes.axison for axes in figure.axes] == [True]
    figure = gain_figure(pooled(gain("named")), None, "base+degraded_skin")
    assert [axes.axison for axes in figure.axes] == [True]


def test_errors_of_held_out_modes_are_drawn_where_there_is_one_degradation_rate():
    modes = pd.DataFrame(
        {
            "model": ["base", "base", "base+second_invariant", "base+second_invariant"],
            "mode": ["equibiaxial", "planar"] * 2,
            "rmse_MPa": [0.21, 0.06, 0.05, 0.02],
        }
    )
    figure = gain_figure(pooled(gain("named")), None, "base+second_invariant", modes)
    left = figure.axes[0]
    assert [label.get_text() for label in left.get_yticklabels()] == ["equibiaxial", "planar"]
    assert "[MPa]" in left.get_xlabel()
    assert ([0.05, 0.02], [0, 1]) in drawn(figure, FINAL_COLOUR)


MEAGRE = {
    "readings stop at rupture": lambda: residual_figure(
        OBSERVED.assign(
            residual_per_m=OBSERVED["residual_per_m"].where(OBSERVED["pressure_kPa"] < 150)
        ),
        LEVELS,
        noise_per_m=None,
    ),
    "one level": lambda: residual_figure(OBSERVED, [5.0], noise_per_m=0.6),
    "two levels": lambda: bands_figure(bands(), OBSERVED, [5.0, 10.0]),
    "one pressure": lambda: bands_figure(bands().query("pressure_kPa == 20"), None, LEVELS),
    "one rupture curve": lambda: rupture_figure(rupture().query("degradation_pct == 25")),
    "no elongation measured": lambda: elongation_figure(elongation().query("kind == 'band'")),
    "elongation measured only": lambda: elongation_figure(elongation().query("kind != 'band'")),
    "one replicate": lambda: null_figure(NULL.head(1), observed=None, name=""),
    "all replicates alike": lambda: null_figure(
        NULL.assign(statistic=2.0), observed=2.0, name="misfit"
    ),
    "modulus only, base only": lambda: constants_figure(
        constants(final=False).query("constant == 'young_modulus'"), None
    ),
    "values without sd": lambda: constants_figure(
        constants(final=False), measured().assign(sd=np.nan)
    ),
    "one tensile curve": lambda: tensile_figure(
        tensile(GENERATOR).query("mode == 'equibiaxial' and model == 'base'")
    ),
    "base model only": lambda: gain_figure(
        pooled(gain("adequate")), by_level(gain("adequate")), "none"
    ),
}


@pytest.mark.parametrize("name", MEAGRE)
def test_meagre_data_are_drawn_without_complaint(name):
    svg = inline_svg(MEAGRE[name](), "meagre", description="what", virtual=True)
    ElementTree.fromstring(svg)


def test_many_tensile_curves_are_thinned_to_what_fits():
    many = pd.concat(tensile(GENERATOR).assign(mode=mode) for mode in ("uniaxial", "planar", "x"))
    titles = [axes.get_title(loc="left") for axes in tensile_figure(many).axes]
    assert len([title for title in titles if title]) == MOST_LEVELS
