"""The weak form in scikit-fem against the kernels: two assemblies of the same equations."""

from dataclasses import fields, replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator import curve as curves
from bayesdeg.actuator.body import LINEAR_CONSTANT
from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.problem import MechanicalState
from bayesdeg.actuator.status import Backend, PathEffort, Resolution, Status
from bayesdeg.errors import BayesdegError

pytestmark = pytest.mark.fem

COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
ROUNDING = 1e-12
NEO_HOOKEAN = MaterialGroups(c2_ratio=0.0, c3_ratio=0.0, paper_group=0.0)
# one input of the mechanics each; those of the paper need one
PAPER = {"paper_group": 60.0}
ALONE = {
    "c2_ratio": {"c2_ratio": -0.02},
    "c3_ratio": {"c3_ratio": 0.05},
    "paper_group": PAPER,
    "paper_poisson": PAPER | {"paper_poisson": 0.1},
    "bulk_ratio": {"bulk_ratio": 1e3},
    "second_invariant_ratio": {"second_invariant_ratio": 0.3},
    "skin": {"skin": 0.4},
    "paper_thickness": PAPER | {"paper_thickness": 0.25},
    "paper_slack": PAPER | {"paper_slack": 0.01},
    "paper_mismatch": PAPER | {"paper_mismatch": 0.01},
    "gravity_along": {"gravity_along": 4e-3},
    "gravity_up": {"gravity_up": -6e-3},
    "wall_factor": {"wall_factor": 1.2},
    "erosion": {"erosion": 0.2},
}


@pytest.fixture(scope="module")
def twins(one_chamber):
    """The same equations of a material by the kernels and by scikit-fem."""
    slow = Actuator(one_chamber.mesh, backend="scikit-fem")

    def build(material):
        curve = Curve((0.1,), material)
        return one_chamber.problem(curve)[1], slow.equations(curve)[1]

    return build


@pytest.fixture(scope="module")
def pair(two_chambers):
    return two_chambers, Actuator(two_chambers.mesh, backend="scikit-fem")


def apart(ours, theirs):
    """Largest difference over the largest entry."""
    return np.max(np.abs(theirs - ours)) / np.max(np.abs(ours))


def check(kernels, form, state):
    ours, theirs = kernels.linearise(state), form.linearise(state)
    assert ours.smallest_jacobian > 0.0
    assert apart(ours.residual, theirs.residual) < ROUNDING
    assert apart(ours.tangent, theirs.tangent) < ROUNDING
    assert apart(ours.volume_residual, theirs.volume_residual) < ROUNDING
    assert apart(kernels.system.on_free(ours.force), form.system.on_free(theirs.force)) < ROUNDING
    assert theirs.smallest_jacobian == pytest.approx(ours.smallest_jacobian, rel=ROUNDING)
    assert theirs.cavity_volume == pytest.approx(ours.cavity_volume, rel=ROUNDING)


def test_every_input_of_the_mechanics_is_compared():
    assert set(ALONE) == {field.name for field in fields(MaterialGroups)}


@pytest.mark.parametrize("name", ALONE)
def test_residual_and_tangent_with_one_input_alone(twins, random_state, name):
    kernels, form = twins(replace(NEO_HOOKEAN, **ALONE[name]))
    plain, _ = twins(replace(NEO_HOOKEAN, **(PAPER if name.startswith("paper") else {})))
    state = random_state(kernels.system.body, seed=3, load=0.3)
    check(kernels, form, state)
    if name != "paper_group":  # that the input acts at all
        assert apart(plain.linearise(state).residual, form.linearise(state).residual) > 1e-6


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    load=st.floats(-0.5, 1.5),
    share=st.floats(0.0, 1.0),
    c2=st.floats(-0.1, 0.2),
    c3=st.floats(0.01, 0.2),
    r=st.floats(0.0, 1.0),
    skin=st.floats(-0.5, 0.5),
    paper=st.floats(1.0, 1e3),
    slack=st.just(0.0) | st.floats(1e-4, 0.02),
    mismatch=st.floats(0.0, 0.03),
    bulk=st.floats(1e2, 1e5),
)
def test_residual_and_tangent_at_any_state(
    twins, random_state, seed, load, share, c2, c3, r, skin, paper, slack, mismatch, bulk
):
    material = MaterialGroups(
        c2_ratio=c2,
        c3_ratio=c3,
        paper_group=paper,
        bulk_ratio=bulk,
        second_invariant_ratio=r,
        skin=skin,
        paper_thickness=0.2,
        paper_slack=slack,
        paper_mismatch=mismatch,
        gravity_along=1e-3,
        gravity_up=-2e-3,
    )
    kernels, form = (twin.with_share(share) for twin in twins(material))
    check(kernels, form, random_state(kernels.system.body, seed, load=load))


def test_at_rest_a_slack_paper_carries_nothing(twins):
    kernels, form = twins(replace(NEO_HOOKEAN, paper_group=60.0, paper_slack=0.01))
    rest = kernels.system.rest()
    np.testing.assert_array_equal(form.linearise(rest).residual, 0.0)
    assert apart(kernels.linearise(rest).tangent, form.linearise(rest).tangent) < ROUNDING


def test_derivatives_along_directions(twins, random_state, every_effect):
    kernels, form = twins(every_effect)
    body = kernels.system.body
    state = random_state(body, seed=5, load=0.4)
    along = [random_state(body, seed=seed, load=seed - 6.5) for seed in (6, 7)]
    along = [replace(d, displacement=d.displacement * ~body.fixed) for d in along]
    pairs = zip(kernels.products(state, along), form.products(state, along), strict=True)
    for (force, volume), (other_force, other_volume) in pairs:
        assert apart(kernels.system.on_free(force), form.system.on_free(other_force)) < ROUNDING
        assert apart(volume, other_volume) < ROUNDING


def test_pressure_increments_and_the_volumes_gradient(twins, random_state, every_effect):
    kernels, form = twins(every_effect)
    body = kernels.system.body
    state = random_state(body, seed=8, load=0.4)
    step = random_state(body, seed=9)
    ours, theirs = kernels.linearise(state), form.linearise(state)
    for volume in (None, step.pressure):
        assert (
            apart(
                kernels.pressure_increment(ours, step.displacement, volume),
                form.pressure_increment(theirs, step.displacement, volume),
            )
            < ROUNDING
        )
    gradients = [p.system.on_free(p.cavity_gradient(state)) for p in (kernels, form)]
    assert apart(*gradients) < ROUNDING


def test_the_tangent_is_the_residuals_derivative(twins, random_state, every_effect):
    """Without the kernels: central differences of scikit-fem's own residual."""
    _, form = twins(every_effect)
    system = form.system
    state = random_state(system.body, seed=10, load=0.4)
    direction = random_state(system.body, seed=11).displacement * ~system.body.fixed
    here = form.linearise(state)
    upper = sp.csr_array(
        (here.tangent, system.upper.indices, system.upper.indptr), shape=system.upper.shape
    )
    along = form.system.on_free(direction)
    product = upper @ along + sp.triu(upper, k=1).T @ along
    # the condensed tangent: the pressure follows the displacement
    follows = form.pressure_increment(here, direction)
    step = 1e-6
    ends = []
    for sign in (step, -step):
        moved = state.moved(sign * direction, sign * follows)
        ends.append(form.system.on_free(form.linearise(moved, tangent=False).force))
    assert apart(product, (ends[0] - ends[1]) / (2.0 * step)) < 1e-7


def test_a_brick_inside_out_is_told_and_not_raised(twins, every_effect):
    kernels, form = twins(every_effect)
    body = kernels.system.body
    crushed = MechanicalState(-1.5 * body.nodes, kernels.system.rest().pressure, 0.1)
    assert not form.linearise(crushed).smallest_jacobian > 0.0
    assert not np.all(np.isfinite(form.linearise(crushed, tangent=False).force))


def test_equations_are_evaluated_alike_without_their_tangent(twins, random_state, every_effect):
    for equations in twins(every_effect):
        state = random_state(equations.system.body, seed=12, load=0.4)
        whole, alone = equations.linearise(state), equations.linearise(state, tangent=False)
        assert (len(alone.tangent), len(alone.residual)) == (0, 0)
        assert alone.force == pytest.approx(whole.force, rel=1e-12, abs=1e-14)
        assert alone.volume_residual == pytest.approx(whole.volume_residual, rel=1e-12, abs=1e-16)
        assert alone.smallest_jacobian == whole.smallest_jacobian


@pytest.mark.slow
@pytest.mark.parametrize("shape", [{}, {"wall_factor": 1.15, "erosion": 0.1}])
@pytest.mark.parametrize("name", ["fresh", pytest.param("every_effect", marks=pytest.mark.long)])
def test_a_whole_curve(pair, fresh, every_effect, name, shape):
    material = replace({"fresh": fresh, "every_effect": every_effect}[name], **shape)
    ours, theirs = (a.solve(Curve((0.1, 0.2, 0.4, 0.6), material)) for a in pair)
    assert ours.status == theirs.status == Status.CONVERGED
    assert ours.iterations == theirs.iterations
    np.testing.assert_allclose(theirs.readings, ours.readings, rtol=1e-9)
    # where nothing is strained, stretches of invariants are 1 to the root of rounding
    np.testing.assert_allclose(theirs.rest, ours.rest, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(theirs.rates, ours.rates, rtol=1e-7, atol=1e-9)


@pytest.mark.long
@pytest.mark.slow
def test_the_same_limit_point(thin_walled, fresh):
    """Volume control on the way, which ends with an indefinite tangent."""
    dimensions = replace(thin_walled.mesh.geometry.dimensions, length=14.0, chambers=1)
    mesh = build_mesh(Geometry(dimensions), COARSEST)
    curve = Curve((0.2, 0.4), replace(fresh, c2_ratio=-0.04, c3_ratio=0.001))
    ours, theirs = (
        Actuator(mesh, backend=backend).solve(curve, effort=PathEffort(halvings=0))
        for backend in Backend
    )
    assert ours.status == theirs.status == Status.LIMIT_POINT
    assert theirs.limit_load == pytest.approx(ours.limit_load, rel=1e-9)


def test_the_forward_map_takes_either(one_chamber):
    one = np.ones(2)
    inputs = Inputs(np.array([[0.0, 40.0]]), *((x * one)[None] for x in (0.3, 0.0, 0.0, 0.8, 3e4)))
    ours, theirs = (
        ExactMap(one_chamber.mesh.geometry, COARSEST, backend=backend)(inputs)
        for backend in ("kernels", "scikit-fem")
    )
    assert theirs.curvature[0, 1] > 0.1
    np.testing.assert_allclose(theirs.curvature, ours.curvature, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(theirs.peak_stretch, ours.peak_stretch, rtol=1e-9)


def test_what_the_weak_form_does_not_know_is_refused(one_chamber, fresh):
    with pytest.raises(ValueError, match="Q1P0"):
        Actuator(
            build_mesh(one_chamber.mesh.geometry, COARSEST, element=LINEAR_CONSTANT),
            backend="scikit-fem",
        )
    with pytest.raises(ValueError, match="fenics"):
        Actuator(one_chamber.mesh, backend="fenics")
    slow = Actuator(one_chamber.mesh, backend="scikit-fem")
    with pytest.raises(BayesdegError, match="derivatives"):
        slow.solve_with_gradients(Curve((0.1,), fresh))


def test_what_emulators_learn_is_the_same_of_either(one_chamber, fresh, monkeypatch):
    assembled = []
    made = curves.WeakForm
    monkeypatch.setattr(
        curves, "WeakForm", lambda *given, **named: assembled.append(1) or made(*given, **named)
    )
    ours, theirs = (
        Actuator(one_chamber.mesh, backend=backend).sample(Curve((0.05, 0.1), fresh))
        for backend in Backend
    )
    assert assembled == [1]
    assert ours.status == theirs.status == Status.CONVERGED
    for name in ("loads", "readings"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), 1e-6, 1e-9, name)
    # at rest, where nothing is strained, slack has a kink and a quantile no owner
    np.testing.assert_allclose(theirs.gradients[1:], ours.gradients[1:], rtol=1e-3, atol=1e-4)
