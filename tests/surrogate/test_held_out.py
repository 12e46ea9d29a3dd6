"""Curves as studies ask for them, which no training sees."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import MaterialGroups, is_elliptic
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import runs
from bayesdeg.surrogate.design import Effects, is_answered, study_like
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.scaling import TrainingRange

COUNT, SEED = 40, 5
CURVES = study_like(400, seed=SEED)
BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "emulator_held_out.py"


def column(name):
    return np.array([getattr(curve.material, name) for curve in CURVES])


def test_the_same_seed_draws_the_same_curves_and_another_draws_others():
    assert study_like(COUNT, seed=SEED) == CURVES[:COUNT]
    others = {curve.material for curve in study_like(COUNT, seed=SEED + 1)}
    assert not others & {curve.material for curve in CURVES}


def test_pressures_are_twelve_even_steps_from_20_to_240_kpa_over_c1():
    loads = np.array([curve.loads for curve in CURVES])
    np.testing.assert_allclose(loads / loads[:, :1], np.tile(np.arange(1.0, 13.0), (400, 1)))
    c1 = 0.02 / loads[:, 0]
    # from fresh to degraded by 25 %, three standard deviations of 10 % beyond either
    assert 0.288 * np.exp(-0.35) < c1.min() < 0.35
    assert 1.2 < c1.max() < 1.588 * np.exp(0.35)
    assert np.median(c1) == pytest.approx(0.78, rel=0.1)


def test_materials_are_stable_and_paper_has_its_nominal_thickness_over_a_scale_near_moulded():
    assert all(is_elliptic(curve.material) for curve in CURVES)
    scale = 0.1 / column("paper_thickness")
    usual = (scale > np.cbrt(0.47)) & (scale < np.cbrt(0.77))
    assert 0.85 < usual.mean() < 1.0  # in the others the thickness is the cause


def test_none_one_or_two_causes_are_at_work_within_what_is_trained():
    names = [f.name for f in fields(Effects) if f.name not in ("gravity", "paper_thickness")]
    names += ["gravity_along", "gravity_up"]
    base = MaterialGroups(0.0, 0.01, 100.0)
    at_work = np.column_stack([column(name) != getattr(base, name) for name in names])
    assert at_work.any(axis=0).all()
    assert at_work.sum(axis=1).max() == 2
    # 0.4 without a cause, and an eighth of 0.4 with the paper's thickness alone
    share = np.mean(~at_work.any(axis=1))
    assert abs(share - 0.45) < 4.0 * np.sqrt(0.45 * 0.55 / len(CURVES))
    for name in (n for n in names if not n.startswith("gravity")):
        low, high = getattr(Effects(), name)
        moved = column(name)[column(name) != getattr(base, name)]
        assert np.all((moved >= low) & (moved <= high)), name


def test_nearly_all_are_answered_by_the_emulator():
    answered = [is_answered(curve, TrainingRange()) for curve in CURVES]
    assert np.mean(answered) > 0.95


def test_none_is_in_the_design_that_the_emulator_is_trained_on():
    assert f"CURVES, SEED = {COUNT}, {SEED}\n" in BENCHMARK.read_text(encoding="utf-8")
    trained = {run.curve.material for run in runs(Geometry(Dimensions()))}
    assert len(trained) == Recipe().coarse_runs
    assert not trained & {curve.material for curve in CURVES}
