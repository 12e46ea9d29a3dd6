"""Every output by every input: the adjoint against equilibria found anew."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.equilibrium import find_equilibrium
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.outputs import OUTPUTS, read_state
from bayesdeg.actuator.problem import MechanicalState
from bayesdeg.actuator.sensitivity import INPUTS, SHAPE_INPUTS, combined
from bayesdeg.actuator.status import PathEffort, Status

pytestmark = pytest.mark.fem

LOADS = (0.2, 0.5)
CLOSE = PathEffort(tolerance=1e-9, iterations=15, rate_tolerance=1e-10)
STEPS = (4e-3, 1e-3, 2.5e-4)  # of the input's own size


@pytest.fixture(scope="module")
def every_effect(every_effect):
    """Walls and faces moved too."""
    return replace(every_effect, wall_factor=1.04, erosion=0.06)


@pytest.fixture(scope="module")
def solved(two_chambers, every_effect):
    solution, gradients = two_chambers.solve_with_gradients(Curve(LOADS, every_effect))
    assert solution.status is Status.CONVERGED
    return solution, gradients


@pytest.fixture(scope="module")
def resolve(two_chambers, every_effect, path_of):
    """Outputs at the last load with one input changed, from the equilibrium next to it."""
    _, problem = two_chambers.problem(Curve(LOADS, every_effect))
    base = path_of(problem, LOADS, PathEffort(exact=True)).states[-1]
    solver = open_factorization(two_chambers.system.upper)

    def at(name, value):
        guess = replace(base, load=value) if name == "load" else base
        material = every_effect if name == "load" else replace(every_effect, **{name: value})
        mesh, changed = two_chambers.problem(Curve(LOADS, material))
        found = find_equilibrium(changed, solver, guess=guess, effort=CLOSE)
        assert found.rate is not None
        return read_state(mesh, found.state).values

    yield at
    solver.close()


@pytest.mark.parametrize("name", INPUTS)
def test_adjoint_gradients_agree_with_solutions_found_anew(solved, resolve, every_effect, name):
    """Central differences, extrapolated over two steps; the best of a study of the step counts."""
    _, gradients = solved
    adjoint = gradients[-1][:, INPUTS.index(name)]
    start = LOADS[-1] if name == "load" else getattr(every_effect, name)
    differences = []
    for share in STEPS:
        step = share * abs(start)
        differences.append((resolve(name, start + step) - resolve(name, start - step)) / (2 * step))
    coarse, middle, fine = np.array(differences)
    candidates = [middle, fine, (16 * middle - coarse) / 15, (16 * fine - middle) / 15]
    errors = np.abs(np.array(candidates) / adjoint - 1.0)
    best = errors.min(axis=0)
    print(f"{name:>24}", *(f"{o} {e:.0e}" for o, e in zip(OUTPUTS, best, strict=True)))
    assert np.all(np.isfinite(adjoint))
    if name == "wall_factor":
        # volumes change, and with them the place of the quantile between two points: a broken line
        best = np.delete(best, OUTPUTS.index("peak_stretch"))
    # shape inputs are themselves differences over 1e-7
    assert np.all(best < (1e-5 if name in SHAPE_INPUTS else 1e-6))


def test_rates_along_the_path_are_the_gradients_by_the_load(solved):
    solution, gradients = solved
    by_load = gradients[:, :, INPUTS.index("load")]
    error = np.abs(solution.rates / by_load - 1.0).max()
    print(f"rates against adjoint: {error:.1e}")
    assert error < 1e-6


def test_gradients_stand_beside_the_readings_of_every_load(solved):
    solution, gradients = solved
    assert gradients.shape == (len(LOADS), len(OUTPUTS), len(INPUTS))
    assert solution.readings.shape == (len(LOADS), len(OUTPUTS))


def test_rates_of_a_default_solution_agree_with_exact_ones(two_chambers, fresh):
    exact, _ = two_chambers.solve_with_gradients(Curve(LOADS, fresh))
    default = two_chambers.solve(Curve(LOADS, fresh), effort=PathEffort(exact=True))
    error = np.abs(default.rates / exact.rates - 1.0).max()
    print(f"rates at default effort: {error:.1e}")
    assert error < 1e-3


def test_rest_rates_are_the_slopes_of_the_first_small_load(two_chambers, every_effect):
    loads = (1e-5,)
    solution, _ = two_chambers.solve_with_gradients(Curve(loads, every_effect))
    slope = (solution.readings[0] - solution.rest) / loads[0]
    smooth = [OUTPUTS.index(n) for n in ("bend_angle", "arc_length", "cavity_volume")]
    np.testing.assert_allclose(slope[smooth], solution.rest_rates[smooth], rtol=1e-3)


def test_adjoints_are_combined_to_the_best_of_their_span() -> None:
    generator = np.random.default_rng(5)
    root = generator.normal(size=(38, 38))
    tangent = root @ root.T  # of 10 nodes in space and 4 pressures in each of 2 elements
    right = generator.normal(size=(3, 30))
    right[2] = 0.0  # an output that does not change
    exact = np.linalg.solve(tangent, np.hstack([right, np.zeros((3, 8))]).T).T
    rough = np.array([[1.0, 0.3, 0.0], [-0.2, 2.0, 0.0], [0.0, 0.0, 1.0]]) @ exact
    parts = [(row[:30].reshape(10, 3), row[30:].reshape(2, 4)) for row in rough]
    pushed = [(row[:30].reshape(10, 3), row[30:].reshape(2, 4)) for row in rough @ tangent]
    states = [MechanicalState(field, pressure, 0.0) for field, pressure in parts]
    found, products = combined(states, pushed, right.reshape(3, 10, 3))
    fields = np.stack([one.displacement.ravel() for one in found])
    pressures = np.stack([one.pressure.ravel() for one in found])
    np.testing.assert_allclose(np.hstack([fields, pressures]), exact, rtol=1e-8, atol=1e-12)
    forces = np.stack([force.ravel() for force, _ in products])
    np.testing.assert_allclose(forces, right, rtol=1e-8, atol=1e-9)
