"""The figure of a life in the soil: numbers are where they belong."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color

from bayesdeg.pages.drawing import BASE_COLOUR, FINAL_COLOUR, INK, Shown
from bayesdeg.pages.figures.lifetime import FIGURES, lifetime_figure
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.tables import TABLES, Tables

HOURS = np.linspace(0.0, 24.0, 9)


def lifetime(fastest=1.0):
    """Failure rises, the curvature falls, and the pressure that keeps it rises."""
    failed = np.clip(fastest * HOURS / 24.0, 0.0, 1.0)
    columns = {
        "time_h": HOURS,
        "pressure_kPa": 120.0,
        "wanted_per_m": 5.0,
        "risk": 0.05,
        "burst_probability": 0.1 * failed,
        "lost_probability": failed,
        "failed_probability": failed,
        "allowed_kPa": 240.0,
        "reachable": 1.0 - failed,
    }
    for q, shift in (("05", -1.0), ("50", 0.0), ("95", 1.0)):
        columns[f"degradation_q{q}"] = HOURS + shift
        columns[f"q{q}_per_m"] = 12.0 - 0.4 * HOURS + shift
        columns[f"needed_q{q}_kPa"] = 60.0 + 8.0 * HOURS + 10.0 * shift
        columns[f"burst_q{q}"] = 0.1 * failed
        columns[f"failed_q{q}"] = np.clip(failed + 0.1 * shift, 0.0, 1.0)
    return pd.DataFrame(columns)[TABLES["lifetime"].headings]


def lines(axes, colour):
    found = [line for line in axes.lines if same_color(line.get_color(), colour)]
    return [np.asarray(line.get_ydata(), float) for line in found]


def test_each_panel_has_its_quantity_against_time():
    table = lifetime()
    failing, bending, keeping = lifetime_figure(table).axes
    for axes, colour, name in (
        (failing, FINAL_COLOUR, "failed_probability"),
        (failing, BASE_COLOUR, "burst_probability"),
        (bending, FINAL_COLOUR, "q50_per_m"),
        (bending, INK, "wanted_per_m"),
        (keeping, FINAL_COLOUR, "needed_q50_kPa"),
        (keeping, INK, "allowed_kPa"),
    ):
        assert any(np.allclose(line, table[name]) for line in lines(axes, colour)), name
    assert [len(axes.collections) for axes in (failing, bending, keeping)] == [1, 1, 1]


@pytest.mark.parametrize(("fastest", "half"), [(1.0, 12.0), (0.3, None)])
def test_the_caption_says_when_half_have_failed(fastest, half):
    [figure] = FIGURES
    tables = Tables({"lifetime": lifetime(fastest)})
    shown = Shown(VerdictRecord(outcome="named"), RunRecord(title="a"), tables)
    assert figure.draw(shown).facts["half"] == half
    drawing = figure.drawing(shown)
    assert drawing.files == ("lifetime.csv",)
    assert "120 kPa" in drawing.caption.replace("\N{NO-BREAK SPACE}", " ")


def test_without_a_life_there_is_no_figure():
    shown = Shown(VerdictRecord(outcome="named"), RunRecord(title="a"), Tables({}))
    assert FIGURES[0].drawing(shown) is None
