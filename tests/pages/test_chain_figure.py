"""The figure of the chains: ranks are uniform where the chains agree, and not where they differ."""

import numpy as np
import pytest
import xarray as xr

from bayesdeg.pages.drawing import Shown
from bayesdeg.pages.figures.checks import BINS, MOST, rank_counts, rank_figure
from bayesdeg.pages.page import FIGURES
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.tables import Tables


def posterior(parameters=3, shift=0.0):
    draws = np.random.default_rng(1).standard_normal((parameters, 4, 500))
    draws[0, 0] += shift
    return xr.Dataset({f"p{k}": (("chain", "draw"), values) for k, values in enumerate(draws)})


def test_every_draw_is_counted_once_and_chains_share_alike():
    counts = rank_counts(posterior()["p0"].to_numpy())
    assert counts.mean(axis=1) == pytest.approx(1.0)
    assert counts.mean(axis=0) == pytest.approx(1.0)


def test_a_chain_that_is_shifted_departs_from_one_and_its_lines_slope():
    agreed, shifted = (rank_counts(posterior(shift=s)["p0"].to_numpy()) for s in (0.0, 2.0))
    chance = 4.5 * np.sqrt(BINS / 500)
    assert np.abs(agreed - 1.0).max() < chance < np.abs(shifted - 1.0).max()
    assert shifted[0, -1] > 2.0 > 0.5 > shifted[0, 0]


def test_the_parameters_that_depart_most_are_drawn():
    figure = rank_figure(posterior(MOST + 3, shift=2.0))
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.lines]
    assert len(titles) == MOST
    assert titles[0] == "p0"


@pytest.mark.parametrize("draws", [None, posterior().isel(chain=[0])])
def test_without_several_chains_there_is_no_figure(draws):
    run = VerdictRecord(outcome="adequate"), RunRecord(title="a run"), Tables({})
    assert FIGURES["ranks"].drawing(Shown(*run, posterior=lambda _: draws)) is None


def test_the_caption_tells_how_many_chains_there_are():
    run = VerdictRecord(outcome="adequate"), RunRecord(title="a run"), Tables({})
    drawing = FIGURES["ranks"].drawing(Shown(*run, posterior=lambda _: posterior()))
    assert "each of 4 chains" in drawing.caption
    assert drawing.section == "posterior"
