"""The figure and the table of parameters that absorb an effect."""

from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color

from bayesdeg.pages.drawing import BASE_COLOUR, FINAL_COLOUR, inline_svg
from bayesdeg.pages.figures.absorption import NINETY, absorption_figure, in_widths
from bayesdeg.pages.page import build_page
from bayesdeg.pages.summaries import farthest_first
from bayesdeg.pages.tables import ABSORPTION, TABLES
from tests.pages.html_reading import read_html, table_cells
from tests.pages.synthetic_run import write_full

WIDTH = 0.05  # sd of all else, of the logarithm of positive parameters


def row(name, off, score, *, positive=True, after=np.nan, **more):
    """A parameter whose base posterior is so many standard deviations off all else."""
    places = {"prior": 0.0, "all_else": 0.0, "base": off, "after": after}
    spreads = {"prior": 8.0, "all_else": 1.0, "base": 0.5, "after": 0.5}
    found = {"parameter": name, "unit": "–", "meaning": f"{name} of a test"}
    for what, place in places.items():
        for end, side in (("q05", -NINETY), ("q50", 0.0), ("q95", NINETY)):
            z = WIDTH * (place + side * spreads[what])
            found[f"{what}_{end}"] = 0.6 * np.exp(z) if positive else z
    found |= {"measured": np.nan, "measured_se": np.nan, "measured_source": ""}
    found |= {"moved_sd": off, "score_sd": score, "learned": 0.9}
    found |= {"p_value": 0.001, "p_adjusted": 0.003 if abs(score) > 4 else 1.0}
    found |= {"in_question": int(abs(score) > 4), "after_moved_sd": after}
    return found | {"pushed_by": "", "pushed_share": np.nan} | more


TABLE = pd.DataFrame(
    [
        row("c1_at_0", 1.0, 1.2),
        row("volume_ratio", 9.0, 9.4, after=0.5, pushed_by="pressure_offset", pushed_share=0.94),
        row("emulator_error_pressure", -5.0, -6.0, positive=False, after=-0.5),
        row("tensile_noise", 0.0, np.nan) | {"p_value": np.nan, "p_adjusted": np.nan},
    ]
)
ORDER = ["volume_ratio", "emulator_error_pressure", "c1_at_0"]
SAID = "calibrated to 0.94"
JUDGED = TABLE[TABLE["p_value"].notna()]


@pytest.mark.parametrize("what", ["prior", "all_else", "base", "after"])
@pytest.mark.parametrize("place", [1, 2])
def test_intervals_are_in_standard_deviations_of_all_else(what, place):
    given = TABLE.iloc[place]
    middle = {"prior": 0.0, "all_else": 0.0, "base": given["moved_sd"], "after": -given["moved_sd"]}
    middle["after"] = given["after_moved_sd"]
    half = {"prior": 8.0, "all_else": 1.0}.get(what, 0.5) * NINETY
    ends = middle[what] + np.array([-half, 0.0, half])
    assert in_widths(given, what) == pytest.approx(ends)


def test_the_unit_of_a_positive_parameter_does_not_matter():
    given = TABLE.iloc[1].copy()
    ends = [name for name in given.index if name.endswith(("q05", "q50", "q95"))]
    other = given.copy()
    other[ends] = 1e3 * given[ends].astype(float)
    assert in_widths(other, "base") == pytest.approx(in_widths(given, "base"))


def test_every_judged_parameter_has_a_row_the_farthest_off_on_top():
    figure = absorption_figure(JUDGED)
    [axes] = figure.axes
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["c1 at 0", "emulator error pressure", "volume ratio"]
    base = [line for line in axes.lines if same_color(line.get_color(), BASE_COLOUR)]
    points = [line.get_xdata()[0] for line in base if len(line.get_xdata()) == 1]
    assert points == pytest.approx([1.0, -5.0, 9.0])
    after = [line for line in axes.lines if same_color(line.get_color(), FINAL_COLOUR)]
    assert [line.get_xdata()[0] for line in after if len(line.get_xdata()) == 1] == pytest.approx(
        [-0.5, 0.5]
    )
    assert "[its sd]" in axes.get_xlabel()
    svg = inline_svg(figure, "absorption", description="what", virtual=False)
    assert ElementTree.fromstring(svg).get("aria-label") == "what"


def test_rows_of_the_page_are_those_that_were_judged():
    names = [one["parameter"] for one in farthest_first(TABLE)]
    assert names == ORDER
    assert farthest_first(None) == []


def test_the_page_has_sentence_figure_and_table(tmp_path):
    folder = write_full(tmp_path / "run", "named")
    folder.write_table(ABSORPTION, TABLE[TABLES[ABSORPTION].headings])
    run = folder.read_json("run")
    run["checks"]["absorption"] = SAID
    folder.write_json("run", run)
    page = read_html(build_page(folder.path).read_text(encoding="utf-8"))
    section = page.by_id("misfit")
    assert SAID in section.text
    assert page.by_id("figure-absorption") is not None
    cells = table_cells(section, "For each parameter")
    assert [row[0].startswith(name) for row, name in zip(cells, ORDER, strict=True)] == [True] * 3
    pushed = [row[8] for row in cells]
    assert "pressure offset" in pushed[0]
    assert "94" in pushed[0]
    assert "none" in pushed[1]
    assert pushed[2] == "–"


def test_a_run_without_the_table_says_nothing_of_it(tmp_path):
    folder = write_full(tmp_path / "run", "named")
    page = build_page(folder.path).read_text(encoding="utf-8")
    assert "absorption.csv" not in page
