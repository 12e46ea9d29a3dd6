"""The figure of what an uncertainty is made of, from a made-up table."""

import numpy as np
import pandas as pd
import pytest

from bayesdeg.pages.drawing import Shown
from bayesdeg.pages.figures.shares import FIGURES, WORDS, largest_of, shares_figure
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.page import build_page
from bayesdeg.pages.tables import Tables
from bayesdeg.prediction.shares import SOURCES
from tests.pages.synthetic_run import write_full

PRESSURES, RATES = (60.0, 120.0, 240.0), (0.0, 25.0)
THREE = {"material": 0.2, "scatter": 0.5, "reading": 0.3}


def shares(parts=None):
    parts = parts or THREE
    return pd.DataFrame(
        [
            {
                "degradation_pct": rate,
                "pressure_kPa": pressure,
                "source": source,
                "first_order": 0.9 * share,
                "total": 1.1 * share,
                "share": share,
                "sd_per_m": 0.01 * pressure,
                "explained": 0.999,
            }
            for rate in RATES
            for pressure in PRESSURES
            for source, share in parts.items()
        ]
    )


def test_every_source_has_words():
    assert set(WORDS) == set(SOURCES)


def test_bars_are_the_shares_of_the_table_on_top_of_one_another():
    figure = shares_figure(shares())
    drawn = [axes for axes in figure.axes if axes.patches]
    assert [axes.get_title(loc="left") for axes in drawn] == ["60 kPa", "120 kPa", "240 kPa"]
    for axes in drawn:
        heights = np.array([bar.get_height() for bar in axes.patches]).reshape(3, len(RATES))
        assert heights == pytest.approx(np.array([[0.2, 0.2], [0.5, 0.5], [0.3, 0.3]]))
        tops = [bar.get_y() + bar.get_height() for bar in axes.patches[-2:]]
        assert tops == pytest.approx([1.0, 1.0])
    assert [text.get_text() for text in drawn[-1].get_xticklabels()] == ["0", "25"]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [WORDS[source] for source in ("material", "scatter", "reading")]


def test_a_source_that_is_missing_at_some_places_is_drawn_elsewhere():
    table = shares()
    table = table[~((table["source"] == "reading") & (table["pressure_kPa"] == 60.0))]
    figure = shares_figure(table)
    heights = [[bar.get_height() for bar in axes.patches[-2:]] for axes in figure.axes[:3]]
    assert np.array(heights) == pytest.approx(np.array([[0.0, 0.0], [0.3, 0.3], [0.3, 0.3]]))


def test_the_caption_names_the_largest_shares_at_the_highest_rate_and_pressure():
    facts = largest_of(shares({"paper": 0.05, "scale": 0.1} | {"scatter": 0.6, "reading": 0.25}))
    assert (facts["level"], facts["pressure"], facts["sd"]) == (25.0, 240.0, 2.4)
    assert [name for name, _ in facts["largest"]] == [
        *("scatter of specimens", "reading errors", "volume ratio"),
    ]


def test_without_a_table_there_is_no_figure():
    shown = Shown(verdict=None, run=None, tables=Tables({}))
    assert FIGURES[0].draw(shown) is None


def test_the_page_shows_it_with_its_sentence(tmp_path):
    folder = write_full(tmp_path, "named")
    RunFolder(folder.path).write_table("shares", shares())
    page = build_page(folder.path).read_text(encoding="utf-8")
    assert 'id="figure-shares"' in page
    assert FIGURES[0].title in page
    assert "scatter of specimens (50\N{NO-BREAK SPACE}%)" in page.replace("&nbsp;", "\xa0")
    assert 'href="shares.csv"' in page
