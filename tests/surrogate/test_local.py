"""Emulators of one study: where it lies, which curves, and what is learned beside another one."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import LOCAL, runs
from bayesdeg.surrogate.fit import NEAR, train
from bayesdeg.surrogate.kept import Recipe, local_recipe
from bayesdeg.surrogate.local import InputDraws, covers, curves_of, local_design, span_of
from bayesdeg.surrogate.regression import observe
from bayesdeg.surrogate.scaling import GROUPS, NAMES, Place, TrainingRange
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.terms import features
from bayesdeg.surrogate.trained import covering, write_trained
from tests.run.tiny_campaign import GEOMETRY, emulator
from tests.surrogate.closed_form import LENGTH, SPAN, sample, trained

NEUTRAL = np.array([group.neutral for group in GROUPS])
SKIN, WALL, SLACK = (NAMES.index(name) - 1 for name in ("skin", "wall_factor", "paper_slack"))


def asked_of(count, seed):
    """Draws in the middle of the material's range, every other one with a skin or thick walls."""
    generator = np.random.default_rng(seed)
    groups = np.tile(NEUTRAL, (count, 1))
    low, high = SPAN.lower[:3], SPAN.upper[:3]
    groups[:, :3] = low + (high - low) * generator.uniform(0.35, 0.65, (count, 3))
    groups[::4, SKIN] = generator.uniform(0.0, 0.6, len(groups[::4]))
    groups[2::4, WALL] = generator.uniform(0.9, 1.1, len(groups[2::4]))
    return InputDraws(groups, generator.uniform(0.2, 0.3, count))


ASKED = asked_of(200, 1)
WANTED = span_of(ASKED)


def other(curve, *, fine):
    """Another actuator: it bends 1.2 times as much, and ever more so, with exact derivatives."""
    found = sample(curve, fine=fine)
    factor = 1.2 * (1.0 + 0.3 * found.loads)
    readings, gradients = found.readings.copy(), found.gradients.copy()
    readings[:, 0] *= factor
    gradients[:, 0] *= factor[:, None]
    gradients[:, 0, 0] += found.readings[:, 0] * 1.2 * 0.3
    return replace(found, readings=readings, gradients=gradients)


def solved(curves, *, fine):
    return list(curves), [other(curve, fine=fine) for curve in curves]


def learned(design, ground):
    return train(
        solved(design.coarse, fine=False),
        solved(design.fine, fine=True),
        span=design.span,
        length=LENGTH,
        mesh_error=0.0,
        record={"design": LOCAL, "dimensions_mm": vars(GEOMETRY.dimensions)},
        terms=NEAR,
        usual=design.coarse,
        ground=ground,
    )


@pytest.fixture(scope="module")
def design():
    return local_design(ASKED, replace(Recipe(), coarse_runs=16, fine_runs=4))


@pytest.fixture(scope="module")
def beside(design):
    return learned(design, trained())


def worst_error(surrogate):
    """Largest weighted error of ln curvature over fresh curves of the same study."""
    worst = []
    for curve in curves_of(asked_of(40, 2), WANTED, 20, seed=3):
        run = observe(
            curve, other(curve, fine=True), length=LENGTH, compliance=surrogate.compliance
        )
        y = (
            features(surrogate.terms.orders, run.coordinates.points)
            @ surrogate.terms.coefficients.T
        )
        error = y[:, 0] - run.values[:, 0]
        worst.append(np.max(run.weights * np.abs(error)))
    return max(worst)


# ---- where


def test_what_no_draw_moves_has_no_range():
    for k, group in enumerate(WANTED.groups):
        moved = ASKED.groups[:, k] != group.neutral
        assert (group.high > group.low) == bool(moved.any())
        assert group.low <= group.neutral <= group.high or not group.is_cause
    assert WANTED.groups[SLACK].high == 0.0


def test_nothing_lies_beyond_what_the_shipped_emulator_was_trained_on():
    wild = replace(ASKED, groups=ASKED.groups * 5.0, load=ASKED.load * 50.0)
    span = span_of(wild)
    assert np.all(span.lower >= SPAN.lower)
    assert np.all(span.upper <= SPAN.upper)
    assert span.share == 1.0


def test_the_range_has_room_about_the_draws_and_covers_them():
    assert covers(WANTED, span_of(ASKED, wider=0.0))
    assert not covers(span_of(ASKED, wider=0.0), WANTED)
    assert covers(TrainingRange(), WANTED)


# ---- which curves


def test_curves_lie_in_the_range_and_the_first_of_many_are_those_of_few():
    many = curves_of(ASKED, WANTED, 20, seed=1)
    assert curves_of(ASKED, WANTED, 7, seed=1) == many[:7]
    places = np.array([Place.of(curve.material).values for curve in many])
    assert np.all(places >= WANTED.lower - 1e-9)
    assert np.all(places <= WANTED.upper + 1e-9)
    assert len(set(many)) == 20


def test_draws_that_all_lie_outside_give_curves_at_the_end_of_the_range():
    groups = ASKED.groups.copy()
    groups[:, 1] = SPAN.upper[1] + 1.0
    beyond = replace(ASKED, groups=groups)
    span = span_of(beyond)
    places = np.array([Place.of(c.material).values for c in curves_of(beyond, span, 5, seed=1)])
    np.testing.assert_allclose(places[:, 1], SPAN.upper[1])


def test_further_curves_lie_where_a_study_asks_now_and_the_range_holds_both(design):
    moved = asked_of(80, 5)
    moved.groups[:, WALL] = 1.15
    more = design.further(moved, replace(Recipe(), coarse_runs=6, fine_runs=2))
    assert more.coarse[:16] == design.coarse
    assert more.fine == (*design.fine, *more.usual[:2])
    assert more.coarse[16:] == more.usual
    walls = [Place.of(curve.material).values[WALL] for curve in more.usual]
    np.testing.assert_allclose(walls, 1.15, atol=1e-3)  # draws stand on a grid of the range
    assert covers(more.span, design.span)
    assert covers(more.span, span_of(moved, wider=0.0))


def test_draws_that_differ_by_rounding_give_the_same_curves():
    noise = np.random.default_rng(8).normal(0.0, 1e-12, ASKED.groups.shape)
    near = InputDraws(np.where(ASKED.groups == NEUTRAL, NEUTRAL, ASKED.groups + noise), ASKED.load)
    assert curves_of(near, WANTED, 20, seed=1) == curves_of(ASKED, WANTED, 20, seed=1)


def test_runs_of_a_design_are_its_curves_on_either_mesh(design):
    recipe = local_recipe(GEOMETRY.dimensions)
    found = runs(GEOMETRY, recipe, design)
    assert [run.curve for run in found] == [*design.coarse, *design.fine]
    assert {run.resolution for run in found} == {recipe.coarse_mesh, recipe.fine_mesh}


def test_the_default_geometry_has_the_usual_meshes():
    recipe = local_recipe(Dimensions())
    assert recipe.coarse_mesh == Recipe().coarse_mesh
    assert recipe.fine_mesh == Recipe().fine_mesh


# ---- what is learned


def test_an_actuator_is_learned_as_a_departure_from_another(beside):
    assert worst_error(beside) < 2e-3
    # the other emulator alone is of another actuator
    assert worst_error(trained()) > 0.15
    accuracy = json.loads(beside.record)["accuracy"]
    assert accuracy["curvature"]["p95_pct"] < 1.0


def test_few_curves_say_more_beside_another_emulator_than_alone(design):
    few = replace(design, coarse=design.coarse[:3], fine=design.fine[:1])
    with_it, alone = (worst_error(learned(few, ground)) for ground in (trained(), None))
    assert with_it < 0.5 * alone


def test_it_answers_in_its_range_only(beside):
    middle = 0.5 * (WANTED.lower + WANTED.upper)
    middle[3:] = NEUTRAL[3:]
    for k, inside in ((SKIN, True), (SLACK, False)):
        moved = middle.copy()
        moved[k] = 0.02
        assert bool(beside.span.lower[k] <= moved[k] <= beside.span.upper[k]) is inside


def test_its_file_holds_its_range(beside, tmp_path):
    again = Surrogate.from_arrays(beside.to_arrays())
    assert again.span == beside.span
    write_trained(tmp_path / "one.npz", beside)
    write_trained(tmp_path / "whole.npz", replace(emulator(Geometry(Dimensions())), span=SPAN))
    ((path, found),) = covering(GEOMETRY, span_of(ASKED, wider=0.0), tmp_path)
    assert path == tmp_path / "one.npz"
    assert found.span == WANTED
    # of a wider study it knows nothing
    assert not list(covering(GEOMETRY, TrainingRange(), tmp_path))
    assert not list(covering(Geometry(Dimensions(length=70.0)), WANTED, tmp_path))
