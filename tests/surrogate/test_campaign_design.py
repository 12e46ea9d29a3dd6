"""Which curves are solved: prefixes, ranges, causes, and those typical of studies."""

from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest

from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.surrogate.design import (
    ACTIVE,
    FURTHER,
    IN_TURN,
    PRESSURES,
    Effects,
    is_answered,
    space_filling,
    study_like,
    training_curves,
    typical,
)
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.scaling import NOMINAL_THICKNESS, Place, TrainingRange

SPAN, RECIPE = TrainingRange(), Recipe()
BASE = MaterialGroups(0.0, 0.01, 100.0, paper_thickness=NOMINAL_THICKNESS)
CAUSES = [f.name for f in fields(Effects) if f.name != "gravity"] + ["gravity_along", "gravity_up"]
FIRST = space_filling(SPAN, 512, seed=RECIPE.seed)
USUAL = typical(SPAN, 240, seed=RECIPE.seed)


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


# ---- typical of studies


def test_typical_curves_are_answered_and_distinct_and_none_is_held_out():
    assert typical(SPAN, 24, seed=RECIPE.seed) == USUAL[:24]
    materials = [curve.material for curve in USUAL]
    assert len(set(materials)) == len(materials)
    # the seed of benchmarks/emulator_held_out.py
    held_out = {curve.material for curve in study_like(512, seed=5)}
    assert not held_out & set(materials)
    assert all(is_answered(curve, SPAN) for curve in USUAL)


def test_typical_loads_go_beyond_those_of_studies_and_never_beyond_the_range():
    ends = []
    for curve in USUAL:
        place = Place.of(curve.material)
        c3 = 2.0 * (place.values[1] - SPAN.lower[1]) / (SPAN.upper[1] - SPAN.lower[1]) - 1.0
        largest = float(SPAN.largest_load(np.array(c3))) * place.modulus
        assert np.all(np.diff(curve.loads) > 0.0)
        assert 0.0 < curve.loads[0] < curve.loads[-1] <= largest * (1.0 + 1e-12)
        ends.append(curve.loads[-1] / largest)
    assert 0.0 < np.mean(np.array(ends) > 1.0 - 1e-9) < 0.9
    # moduli of degraded films, whose loads are small, are those of studies
    c1 = FURTHER * PRESSURES[-1] * 1e-3 / np.array([curve.loads[-1] for curve in USUAL])
    assert c1.max() < 1.588 * np.exp(0.35)


def test_every_other_typical_curve_has_one_cause_and_all_occur_in_turn():
    """Thickness of paper, which shrinks with the body, differs in all of them."""
    causes = [name for name in CAUSES if name != "paper_thickness"]
    found = [[name for name in acting(curve) if name in causes] for curve in USUAL]
    single = found[1::2]
    assert all(len(names) <= 1 for names in single)
    count = Counter(name for names in single for name in names)
    with_weight = count["gravity_along"] + count["gravity_up"]
    assert set(count) == set(causes)
    turns = len(single) / len(IN_TURN)
    assert with_weight == pytest.approx(turns * IN_TURN.count(5), abs=3)
    assert count["skin"] == pytest.approx(turns * IN_TURN.count(1), abs=3)
    assert count["paper_mismatch"] == pytest.approx(turns * IN_TURN.count(4), abs=3)
    assert {len(names) for names in found[::2]} == {0, 1, 2}


# ---- both together


def test_of_the_whole_design_a_third_is_typical_and_fine_curves_are_among_the_coarse():
    coarse, fine = training_curves(SPAN, RECIPE.coarse_runs, RECIPE.fine_runs, seed=RECIPE.seed)
    third = RECIPE.coarse_runs // 3
    assert len(coarse) == len(set(coarse)) == RECIPE.coarse_runs
    assert len(fine) == len(set(fine)) == RECIPE.fine_runs
    assert coarse[-third:] == USUAL[:third]
    assert coarse[:-third] == FIRST[: RECIPE.coarse_runs - third]
    assert set(fine) <= set(coarse)
    assert len(set(fine) & set(USUAL)) == 3 * RECIPE.fine_runs // 4
