"""Both direct solvers on a tangent of the model, and on matrices that are not definite."""

import numpy as np
import pytest
import scipy.sparse as sp

from bayesdeg.actuator.linear import (
    LostDefinitenessError,
    SuperLU,
    open_factorization,
)
from bayesdeg.actuator.problem import Problem


def upper_of(full):
    """Upper triangle with every diagonal entry stored, also where it is zero."""
    rows, columns = np.triu_indices(len(full))
    keep = (full[rows, columns] != 0.0) | (rows == columns)
    rows, columns = rows[keep], columns[keep]
    pointers = np.searchsorted(rows, np.arange(len(full) + 1)).astype(np.int32)
    return sp.csr_array((full[rows, columns], columns.astype(np.int32), pointers), shape=full.shape)


@pytest.fixture(params=["pypardiso", "splu"])
def solver_name(request):
    if request.param == "pypardiso":
        pytest.importorskip("pypardiso")
    return request.param


@pytest.fixture
def tangent(two_chambers, fresh, equilibria):
    """The assembled tangent of a loaded equilibrium."""
    state = equilibria(two_chambers, fresh, (0.2, 0.4)).states[-1]
    upper = two_chambers.system.upper.copy()
    upper.data = Problem(two_chambers.system, fresh).linearise(state).tangent
    return upper


@pytest.mark.fem
def test_solution_satisfies_the_equations(tangent, solver_name):
    full = tangent + sp.triu(tangent, k=1).T
    right = np.random.default_rng(1).standard_normal((tangent.shape[0], 3))
    solver = open_factorization(tangent.copy(), solver_name)
    solver.factorize(tangent.data)
    several, one = solver.solve(right), solver.solve(right[:, 0])
    solver.close()
    assert solver.name == solver_name
    assert np.linalg.norm(full @ several - right) < 1e-9 * np.linalg.norm(right)
    assert np.linalg.norm(one - several[:, 0]) < 1e-8 * np.linalg.norm(one)


@pytest.mark.fem
def test_fallback_agrees_with_cholesky(tangent):
    pytest.importorskip("pypardiso")
    right = np.random.default_rng(2).standard_normal(tangent.shape[0])
    solutions = []
    for name in ("pypardiso", "splu"):
        solver = open_factorization(tangent.copy(), name)
        solver.factorize(tangent.data)
        solutions.append(solver.solve(right))
        solver.close()
    difference = np.linalg.norm(solutions[0] - solutions[1])
    assert difference < 1e-8 * np.linalg.norm(solutions[0])


@pytest.mark.fem
def test_fallback_follows_the_same_path(two_chambers, fresh, equilibria):
    pytest.importorskip("pypardiso")
    loads = (0.2, 0.4, 0.6)
    one, other = (
        equilibria(two_chambers, fresh, loads, solver=name) for name in ("pypardiso", "splu")
    )
    assert one.iterations == other.iterations
    for a, b in zip(one.states, other.states, strict=True):
        np.testing.assert_allclose(a.displacement, b.displacement, atol=1e-8)


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 0.5], [0.5, -1.0]],
        # eigenvalues -1 and 1, though row exchanges would leave positive pivots
        [[0.0, 1.0], [1.0, 0.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        [[4.0, 1.0, 0.0], [1.0, 3.0, 2.0], [0.0, 2.0, 1.0]],
    ],
)
def test_indefinite_matrix_is_refused(matrix, solver_name):
    upper = upper_of(np.array(matrix))
    assert np.linalg.eigvalsh(matrix)[0] < 1e-12
    solver = open_factorization(upper, solver_name)
    with pytest.raises(LostDefinitenessError):
        solver.factorize(upper.data.copy())
    solver.close()


def test_solver_recovers_after_a_refusal(solver_name):
    good = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 1.0], [0.5, 1.0, 2.0]])
    bad = good - 3.0 * np.eye(3)
    right = np.array([1.0, -2.0, 0.5])
    solver = open_factorization(upper_of(good), solver_name)
    for first in (bad, good):  # the refusal may come before or after the analysis
        if first is bad:
            with pytest.raises(LostDefinitenessError):
                solver.factorize(upper_of(bad).data)
        solver.factorize(upper_of(good).data)
        np.testing.assert_allclose(solver.solve(right), np.linalg.solve(good, right), rtol=1e-12)
    with pytest.raises(LostDefinitenessError):
        solver.factorize(upper_of(bad).data)
    solver.close()


def test_fallback_where_the_first_choice_is_missing(monkeypatch):
    monkeypatch.setattr("bayesdeg.actuator.linear.pypardiso", None)
    assert isinstance(open_factorization(upper_of(np.eye(2))), SuperLU)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_indefinite_solver_counts_negative_eigenvalues(solver_name, seed):
    rng = np.random.default_rng(seed)
    full = rng.standard_normal((12, 12))
    full = full + full.T
    solver = open_factorization(upper_of(full), solver_name, is_definite=False)
    negative = solver.factorize(upper_of(full).data)
    right = rng.standard_normal(12)
    np.testing.assert_allclose(full @ solver.solve(right), right, rtol=1e-7, atol=1e-9)
    assert negative == np.sum(np.linalg.eigvalsh(full) < 0.0)
    solver.close()
