"""Which curves are solved: prefixes, ranges, causes, and the second stage."""

from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest

from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.surrogate.design import (
    ACTIVE,
    Effects,
    candidates,
    is_answered,
    second_stage,
    space_filling,
    study_like,
)
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.scaling import NOMINAL_THICKNESS, Place, TrainingRange

SPAN, RECIPE = TrainingRange(), Recipe()
BASE = MaterialGroups(0.0, 0.01, 100.0, paper_thickness=NOMINAL_THICKNESS)
CAUSES = [f.name for f in fields(Effects) if f.name != "gravity"] + ["gravity_along", "gravity_up"]
FIRST = space_filling(SPAN, RECIPE.coarse_runs, seed=RECIPE.seed)


@pytest.fixture(scope="module")
def pool():
    return candidates(SPAN)


def acting(curve):
    return [name for name in CAUSES if getattr(curve.material, name) != getattr(BASE, name)]


@pytest.mark.parametrize("count", [1, 7, 8, 9, 100])
def test_a_shorter_design_is_the_start_of_a_longer_one(count):
    assert space_filling(SPAN, count, seed=RECIPE.seed) == FIRST[:count]


def test_another_seed_is_another_design():
    other = space_filling(SPAN, 64, seed=RECIPE.seed + 1)
    assert not {curve.material for curve in other} & {curve.material for curve in FIRST}


def test_every_cause_occurs_alone_and_with_others():
    found = [acting(curve) for curve in FIRST]
    assert {names[0] for names in found if len(names) == 1} == set(CAUSES)
    assert {name for names in found if len(names) > 1 for name in names} == set(CAUSES)
    assert not any({"gravity_along", "gravity_up"} <= set(names) for names in found)


def test_none_to_four_causes_are_at_work_as_often_as_wanted():
    count = Counter(len(acting(curve)) for curve in FIRST)
    assert set(count) == set(range(len(ACTIVE)))
    for number, share in enumerate(ACTIVE):
        deviation = count[number] - share * len(FIRST)
        assert abs(deviation) < 4.0 * np.sqrt(share * (1.0 - share) * len(FIRST)), number


@pytest.mark.parametrize("name", CAUSES)
def test_a_cause_fills_its_range_of_effects_and_no_more(name):
    low, high = getattr(Effects(), "gravity" if name.startswith("gravity") else name)
    values = [getattr(curve.material, name) for curve in FIRST if name in acting(curve)]
    assert low <= min(values) < low + 0.15 * (high - low)
    assert high - 0.15 * (high - low) < max(values) <= high


def test_materials_fill_the_range_of_their_groups():
    plain = [replace(curve.material, second_invariant_ratio=0.0) for curve in FIRST]
    unit = np.array([Place.of(m).values[:3] for m in plain]) - SPAN.lower[:3]
    unit /= SPAN.upper[:3] - SPAN.lower[:3]
    assert np.all((unit >= 0.0) & (unit <= 1.0))
    # a Sobol' design of 2⁹ points has one in each of 2⁹ slices of every axis
    for column in unit.T:
        assert sorted(np.floor(len(FIRST) * column).astype(int)) == list(range(len(FIRST)))


def test_loads_rise_from_above_zero_to_the_largest_of_the_material():
    for curve in FIRST:
        c3 = np.log(curve.material.c3_ratio)
        place = 2.0 * (c3 - SPAN.lower[1]) / (SPAN.upper[1] - SPAN.lower[1]) - 1.0
        largest = float(SPAN.largest_load(np.array(place)))
        assert curve.loads[-1] == pytest.approx(largest, rel=1e-12)
        assert curve.loads[0] > 0.0
        steps = np.diff(curve.loads)
        assert np.all(steps > 0.0)
        assert curve.loads[0] < steps[0] < steps[-1]  # dense where the curve starts


def test_a_curve_is_answered_if_its_material_is_in_range():
    curve = FIRST[0]
    material = replace(BASE, paper_slack=0.02)
    assert is_answered(replace(curve, material=material), SPAN)
    for change in (
        {"skin": 1.21},
        {"paper_mismatch": 0.01},
        {"c3_ratio": 1e-4},
        {"second_invariant_ratio": 1.01},
    ):
        changed = replace(curve, material=replace(material, **change))
        assert not is_answered(changed, SPAN), change


def test_nearly_all_of_the_design_is_answered_and_the_rest_are_slack_and_mismatched_or_edge():
    left = [curve for curve in FIRST if not is_answered(curve, SPAN)]
    assert 0 < len(left) < 0.05 * len(FIRST)
    for curve in left:
        both = {"paper_slack", "paper_mismatch"} <= set(acting(curve))
        assert both or "second_invariant_ratio" in acting(curve)


def test_candidates_are_answered_and_distinct_and_none_is_held_out_or_in_the_first_stage(pool):
    materials = [curve.material for curve in pool]
    assert len(set(materials)) == len(materials)
    # the seed of benchmarks/emulator_held_out.py
    held_out = {curve.material for curve in study_like(512, seed=5)}
    assert not held_out & set(materials)
    assert not {curve.material for curve in FIRST} & set(materials)
    assert all(is_answered(curve, SPAN) for curve in pool[::5])
    for curve in pool:
        assert np.all(np.diff(curve.loads) > 0.0)
        assert 0.0 < curve.loads[0] < curve.loads[-1] <= SPAN.load


def test_picks_of_the_second_stage_are_new_and_distinct_and_fine_ones_are_among_the_coarse(pool):
    coarse, fine = second_stage(SPAN, FIRST, RECIPE.fine_runs)
    assert (len(coarse), len(fine)) == (64, 24)
    assert len(set(coarse)) == len(coarse)
    assert len(set(fine)) == len(fine)
    assert set(coarse) <= set(pool)
    assert set(fine) <= {*FIRST, *coarse}
    assert not set(fine) & set(FIRST[: RECIPE.fine_runs])
    assert set(fine) & set(coarse)
