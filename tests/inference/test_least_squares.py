"""Where the search for a mode begins."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.model import least_squares, near_films, share_outside
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.tensile import Tensile, median_stresses
from bayesdeg.priors import LogNormal
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.surrogate.closed_form import trained

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_actuator"


def test_exact_stresses_and_elongations_give_their_constants_back():
    model = small_model()
    stress = median_stresses(model.tests(values_of()), model.data_of(Tensile).tests).at_rest
    elongation = model.world.elongation(values_of(), model.data_of(Breaks).table.degradation)[0]
    exact = altered(
        model,
        tensile=replace(
            model.data_of(Tensile).tests,
            stress=np.where(model.data_of(Tensile).tests.mask, stress[0], 0.0),
        ),
        breaks=replace(model.data_of(Breaks).table, elongation=elongation),
    )
    found = exact.table.named(least_squares(exact))
    for name in ("c1_at_0", "c3_at_25", "c1_control_12_5", "elongation_at_0", "elongation_at_25"):
        assert float(found[name]) == pytest.approx(TRUTH[name], rel=1e-3), name


def test_it_is_far_above_draws_from_the_prior_on_the_gelatin_study():
    model = assemble(read_study(STUDY)).model
    draws = model.table.sample(np.random.default_rng(0), 200)
    assert model.log_prob(least_squares(model)[None])[0] > np.max(model.log_prob(draws)) + 50.0


def test_without_films_it_is_the_median_of_the_prior():
    model = altered(small_model(), tensile=None, breaks=None)
    named = model.table.named(least_squares(model))
    for parameter in model.table.parameters:
        median = float(parameter.law.quantile(0.5))
        assert float(named[parameter.name]) == pytest.approx(median, rel=1e-9)


def test_where_the_medians_are_refused_others_are_tried():
    """A prior of the paper whose median is stiffer than the forward map was trained on."""
    model = small_model()
    base = tuple(
        replace(p, law=LogNormal(3e6, 4.0)) if p.name == "paper_stiffness" else p
        for p in model.base
    )
    model = altered(model, base=base, forward=trained())
    medians = least_squares(model)
    found = near_films(model, np.random.default_rng(0))
    assert model.log_prob(found[None])[0] > model.log_prob(medians[None])[0] + 100.0
    assert share_outside(model, np.stack([medians, found])) == 0.5


def test_where_nothing_is_answered_there_is_still_a_way_back():
    """A prior wholly outside the emulator's range: said by the share of the posterior there."""
    model = small_model()
    base = tuple(
        replace(p, law=LogNormal(1e12, 0.1)) if p.name == "paper_stiffness" else p
        for p in model.base
    )
    model = altered(model, base=base, forward=trained())
    found = near_films(model, np.random.default_rng(0))
    assert np.isfinite(model.log_prob(found[None])[0])
    assert share_outside(model, found[None]) == 1.0
