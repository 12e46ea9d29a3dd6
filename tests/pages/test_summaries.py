import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.summaries import (
    MOST_LEVELS,
    extended_model,
    gain_parts,
    level_rows,
    nearest_level,
    panel_levels,
    parameter_rows,
    tensile_errors,
)
from tests.pages.synthetic_run import PUBLISHED, gain, levels, parameters, tensile

RATES = st.lists(st.floats(0, 60), min_size=1, max_size=40)


@given(RATES)
def test_no_more_panels_than_fit_and_each_from_the_range_of_the_data(rates):
    shown = panel_levels(pd.DataFrame({"degradation_pct": rates}))
    assert 1 <= len(shown) <= MOST_LEVELS
    assert shown == sorted(set(shown))
    assert min(shown) >= min(rates) - 2.5
    assert max(shown) <= max(rates) + 2.5
    if len(set(rates)) <= MOST_LEVELS:
        assert shown == sorted(set(rates))


@given(RATES, st.lists(st.floats(0, 60), min_size=1, max_size=9, unique=True))
def test_no_other_level_is_nearer(rates, grid):
    for rate, chosen in zip(rates, nearest_level(rates, grid), strict=True):
        assert chosen in grid
        assert abs(rate - chosen) == min(abs(rate - level) for level in grid)


def test_levels_stand_in_order_with_both_models_beside_the_published_fit():
    frame = levels(final=True)
    shuffled = frame.sample(frac=1.0, random_state=3)
    rows = level_rows(shuffled.assign(degradation_pct=shuffled["degradation_pct"].astype(str)))
    assert [row.level for row in rows] == ["0.0", "5.0", "10.0", "15.0", "20.0", "25.0", "all"]
    assert [row.published_r_squared for row in rows] == [*PUBLISHED, None]
    assert {(row.base_r_squared, row.final_r_squared) for row in rows} == {(0.947, 0.9931)}


def test_a_model_that_is_absent_leaves_its_cells_empty():
    rows = level_rows(levels(final=False).astype({"degradation_pct": str}))
    assert {(row.base_rms, row.final_rms) for row in rows} == {(2.13, None)}


@pytest.mark.parametrize(
    ("models", "outcome", "causes", "found"),
    [
        (["base", "base+a", "base+b+a"], "named", ["a", "b"], "base+b+a"),
        (["base", "base+a"], "named", ["b"], None),
        (["base", "final"], "named", ["b"], "final"),
        (["base", "base+a"], "ambiguous", ["a"], None),
    ],
)
def test_the_extended_model_is_the_one_with_just_the_named_causes(models, outcome, causes, found):
    verdict = VerdictRecord.read({"outcome": outcome, "causes": causes})
    assert extended_model(pd.DataFrame({"model": models}), verdict) == found


def test_tensile_errors_agree_with_a_plain_sum_and_held_out_modes_lead():
    frame = tensile(np.random.default_rng(1))
    errors = tensile_errors(frame)
    assert [error.fitted for error in errors] == [False, False, True, True]
    assert sum(error.n for error in errors) == len(frame)
    held = frame[(frame["mode"] == "equibiaxial") & (frame["model"] == "final")]
    squares = [(m - p) ** 2 for m, p in zip(held["stress_MPa"], held["mean_MPa"], strict=True)]
    found = next(e for e in errors if e.mode == "equibiaxial" and e.model == "final")
    assert found.rms == pytest.approx((sum(squares) / len(squares)) ** 0.5)
    assert found.largest == max(held["stress_MPa"])


def test_both_intervals_of_a_parameter_fill_one_bar_together():
    for entry in parameter_rows(parameters()):
        ends = [entry.prior.left, entry.posterior.left]
        assert min(ends) == pytest.approx(0.0)
        widest = max(span.left + span.width for span in (entry.prior, entry.posterior))
        assert widest == pytest.approx(100.0)
        ratio = entry.posterior.width / entry.prior.width
        wide = entry.row["prior_q95"] - entry.row["prior_q05"]
        assert ratio == pytest.approx((entry.row["q95"] - entry.row["q05"]) / wide)


def test_parameters_of_a_final_model_that_is_the_base_model_are_listed_once():
    base = parameters().assign(model="base")
    both = pd.concat([base, base.assign(model="final")], ignore_index=True)
    assert [entry.row for entry in parameter_rows(both)] == [e.row for e in parameter_rows(base)]
    both.loc[len(base), "q50"] += 1.0
    assert len(parameter_rows(both)) == len(base) + 1


def test_a_parameter_without_a_prior_interval_has_no_bar():
    entry = parameter_rows(parameters().assign(prior_q05=np.nan))[0]
    assert entry.prior is None


def test_the_parts_of_a_gain_add_up_to_the_one_by_which_a_cause_is_judged():
    candidate = {"cause": "degraded_skin", "elpd_diff": 46.0, "elpd_diff_se": 6.4}
    verdict = {"outcome": "named", "causes": ["degraded_skin"], "candidates": [candidate]}
    parts = gain_parts(gain("named"), VerdictRecord.read(verdict))
    assert (parts.total, parts.total_se, parts.here) == (46.0, 6.4, 39.5)
    assert parts.here + parts.beside == parts.total
    alone = verdict | {"candidates": [candidate | {"elpd_diff": 39.5}]}
    assert gain_parts(gain("named"), VerdictRecord.read(alone)) is None
    assert gain_parts(None, VerdictRecord.read(verdict)) is None
    assert gain_parts(gain("named"), VerdictRecord.read({"outcome": "unexplained"})) is None
