"""Tip forces that an emulator is trained on, against curves solved for what it was not shown."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve, ExactMap, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import Resolution, Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import build, runs
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.local import InputDraws, local_design
from bayesdeg.surrogate.regression import observe_force
from bayesdeg.surrogate.scaling import GROUPS, LOAD, groups_of
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.trained import from_bytes, lacking, to_bytes

GEOMETRY = Geometry(Dimensions(length=14.0, chambers=1))
COARSE, FINE = Resolution(9.0, 9.0, 9.0), Resolution(9.0, 9.0, 8.0)
PRESSURE = np.array([[25.0, 50.0, 75.0]])


def materials(count, seed):
    """Inputs of films of a study, 20 % apart in stiffness."""
    z = np.random.default_rng(seed).standard_normal((4, count, 1))
    c1 = 0.3 * np.exp(0.1 * z[0])
    return Inputs(
        PRESSURE,
        c1,
        -0.01 * c1 * (1.0 + 0.3 * z[1]),
        0.012 * c1 * np.exp(0.1 * z[2]),
        np.full((count, 1), 0.853),
        3e4 * np.exp(0.1 * z[3]),
    )


def asked(count=60, seed=1):
    given = groups_of(materials(count, seed))
    load = given.pop(LOAD).max(axis=-1)
    groups = [
        np.broadcast_to(given[g.name], (count, 1))[:, 0]
        if g.name in given
        else np.full(count, g.neutral)
        for g in GROUPS
    ]
    return InputDraws(np.column_stack(groups), load)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    recipe = Recipe(COARSE, FINE, 20, 4)
    design = replace(local_design(asked(), recipe), with_forces=True)
    store = SolutionStore(tmp_path_factory.mktemp("store"))
    assert len(runs(GEOMETRY, recipe, design)) == 2 * (20 + 4)
    return build(GEOMETRY, store, recipe=recipe, design=design)


@pytest.mark.fem
@pytest.mark.parametrize("output", ["tip_force", "cavity_volume"])
def test_what_is_asked_beside_the_shape_is_that_of_new_solutions(trained, output):
    given = replace(materials(6, seed=9), asked=output)
    found, exact = trained(given), ExactMap(GEOMETRY, FINE)(given)
    assert np.all(found.status == 0)
    np.testing.assert_allclose(found.further.value, exact.further.value, rtol=5e-3)
    np.testing.assert_allclose(found.further.slope, exact.further.slope, rtol=2e-2)
    assert np.all(found.further.sd > 0.0)


@pytest.mark.fem
def test_the_file_holds_forces_and_runs_have_names_of_their_own(trained):
    again = from_bytes(to_bytes(trained))
    assert set(again.answers) == {"cavity_volume", "tip_force"}
    assert lacking(again, ["tip_force"]) == ""
    recipe = Recipe(COARSE, FINE, 2, 1)
    design = local_design(asked(), recipe)
    plain, forced = (
        runs(GEOMETRY, recipe, design),
        runs(GEOMETRY, recipe, replace(design, with_forces=True)),
    )
    assert [run.key() for run in plain] == [run.key() for run in forced[:3]]
    assert len({run.key() for run in forced}) == 6


def test_a_curve_of_one_step_says_what_it_has():
    """A stiff part is solved in one step: F = s q with d ln F/d q known, and s at rest."""
    curve = Curve((0.3,), MaterialGroups(-0.05, 0.01, 100.0))
    gradients = np.zeros((2, 1, len(INPUTS)))
    gradients[:, 0, INPUTS.index("load")] = (1.8, 2.3)
    found = PathSamples(
        np.array([0.0, 0.3]), np.array([[0.0], [0.6]]), gradients, Status.CONVERGED, np.inf, 4, "x"
    )
    learnt = observe_force(curve, found, length=20.0)
    assert learnt is not None
    np.testing.assert_allclose(learnt.values, np.log(0.6 / 0.3 / 20.0**2))
    np.testing.assert_allclose(learnt.first, np.log(1.8 / 20.0**2))
    nothing = replace(found, loads=found.loads[:1], readings=found.readings[:1])
    assert observe_force(curve, nothing, length=20.0) is None
