"""Materials with a memory: closed forms of creep, softening, diffusion and swelling."""

from dataclasses import replace

import numpy as np
import pytest
from physics.fields import (
    EFFORT,
    Diffusion,
    Drying,
    Elastic,
    Field,
    FieldActuator,
    FieldBody,
    FieldEquations,
    FieldMap,
    Schedule,
    Softened,
    Viscous,
    Water,
    energy_of,
    isochoric_stress,
    reacted,
)
from scipy.special import erf

from bayesdeg.actuator.body import box
from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.problem import MechanicalState, Problem
from bayesdeg.data.settings import Dimensions

SMALL = Geometry(Dimensions(length=14.0, chambers=1))
BARE = MaterialGroups(c2_ratio=0.0, c3_ratio=0.0, paper_group=0.0)
YEOH = MaterialGroups(c2_ratio=-0.03, c3_ratio=0.01, paper_group=100.0, paper_thickness=0.12)


@pytest.fixture(scope="module")
def mesh():
    return build_mesh(SMALL, COARSE)


def stretched(stretch):
    """F of incompressible uniaxial tension, (1, 1, 3, 3)."""
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])[None, None]


CONSTANTS = np.array([[[1.0, -0.03, 0.01, 0.0]]])


def test_the_stress_is_the_derivative_of_the_energy():
    rng = np.random.default_rng(3)
    gradient = np.eye(3) + 0.3 * rng.standard_normal((1, 1, 3, 3))
    stress = (gradient @ isochoric_stress(CONSTANTS, gradient))[0, 0]
    for i in range(3):
        for j in range(3):
            change = np.zeros((3, 3))
            change[i, j] = 1e-6
            up, down = (energy_of(CONSTANTS, gradient + s * change) for s in (1, -1))
            assert stress[i, j] == pytest.approx(float((up - down)[0, 0]) / 2e-6, abs=1e-7)


def total(memory, span, gradient):
    """The stress at the end of a step: of the field's constants, and the overstress."""
    field = memory.field(span, gradient)
    return isochoric_stress(field.constants, gradient) + field.overstress


def test_stress_relaxes_after_a_step_of_strain_as_its_prony_series():
    memory, gradient = Viscous(CONSTANTS, (0.2, 0.1), (30.0, 5.0)), stretched(1.5)
    elastic = isochoric_stress(CONSTANTS, gradient)
    assert total(memory, 0.0, gradient) == pytest.approx(elastic, rel=1e-12)
    memory, time = memory.after(0.0, gradient), 0.0
    for span in (1.0, 7.0, 20.0):
        time += span
        left = 1.0 - 0.2 * (1 - np.exp(-time / 30.0)) - 0.1 * (1 - np.exp(-time / 5.0))
        assert total(memory, span, gradient) == pytest.approx(left * elastic, rel=1e-12)
        memory = memory.after(span, gradient)


def test_a_straight_ramp_of_stress_is_exact_in_one_step():
    share, constant, span = 0.3, 10.0, 25.0
    memory, gradient = Viscous(CONSTANTS, (share,), (constant,)), stretched(1.4)
    # ∫ (1 − g (1 − e^(−(t − s)/τ))) ds/t of a stress that grows evenly
    share_left = 1.0 - share * (1.0 - constant / span * (1.0 - np.exp(-span / constant)))
    expected = share_left * isochoric_stress(CONSTANTS, gradient)
    assert total(memory, span, gradient) == pytest.approx(expected, rel=1e-12)


@pytest.mark.fem
def test_a_small_load_creeps_as_the_correspondence_of_linear_viscoelasticity(mesh):
    share, constant, held = 0.2, 30.0, 40.0
    actuator = FieldActuator(mesh, BARE, replace(EFFORT, tolerance=1e-9))
    viscous = Viscous(actuator.body.constants, (share,), (constant,))
    load, volume = np.array([1e-3]), OUTPUTS.index("cavity_volume")
    empty = Problem(actuator.body.system, BARE).cavity_volume(actuator.body.rest.state)
    at_once, late = (
        actuator.tested(viscous, Schedule(load, np.array([time])))[0, volume] - empty
        for time in (0.0, held)
    )
    amount, slower = share / (1.0 - share), constant / (1.0 - share)
    expected = 1.0 + amount * (1.0 - np.exp(-held / slower))
    assert late / at_once == pytest.approx(expected, rel=2e-3)


@pytest.mark.fem
def test_the_tangent_is_the_derivative_of_the_residual(mesh):
    rng = np.random.default_rng(5)
    body = FieldBody(mesh.body, YEOH)
    shape = mesh.body.weights.shape
    overstress = 0.2 * rng.standard_normal((*shape, 3, 3))
    overstress = overstress + np.swapaxes(overstress, -1, -2)
    swelling = 1.0 + 0.05 * rng.standard_normal(shape)
    problem = Problem(body.system, YEOH, local=body.constants)
    equations = FieldEquations(problem, overstress, swelling)

    def moved(scale):
        return body.system.expand(scale * rng.standard_normal(len(body.system.free)))

    state = MechanicalState(
        moved(0.01), 0.1 * rng.standard_normal((len(mesh.body.elements), 4)), 0.1
    )
    along = MechanicalState(moved(1.0), rng.standard_normal(state.pressure.shape), 0.0)
    step = 1e-6
    ends = [
        equations.linearise(state.moved(s * along.displacement, s * along.pressure), tangent=False)
        for s in (step, -step)
    ]
    [(force, volume)] = equations.products(state, [along])
    assert force == pytest.approx((ends[0].force - ends[1].force) / (2 * step), abs=1e-4)
    difference = (ends[0].volume_residual - ends[1].volume_residual) / (2 * step)
    assert volume == pytest.approx(difference, abs=1e-5)
    # the stored upper triangle holds the same overstress as the products
    alone = FieldEquations(problem, overstress, None)
    extra = alone.linearise(state).tangent - problem.linearise(state).tangent
    upper = body.system.upper.copy()
    upper.data = extra
    full = upper + upper.T
    full.setdiag(upper.diagonal())
    still = replace(along, pressure=np.zeros_like(along.pressure))
    [(with_it, _)], [(without, _)] = (e.products(state, [still]) for e in (alone, problem))
    assert full @ problem.system.on_free(still.displacement) == pytest.approx(
        problem.system.on_free(with_it - without), abs=1e-9
    )


@pytest.mark.fem
def test_a_free_block_swells_evenly():
    block = box((3.0, 2.0, 1.0), divisions=(2, 1, 1))
    planes = np.isclose(block.nodes, 0.0)
    body = FieldBody(replace(block, fixed=planes), BARE)
    swelling = np.full(block.weights.shape, 1.2)
    memory = Elastic(Field(body.constants, swelling=swelling))
    last, _ = body.later(body.rest, 0.0, memory, 0.0)
    assert last.rate is not None
    grown = block.nodes * (1.2 ** (1.0 / 3.0) - 1.0)
    assert last.state.displacement == pytest.approx(grown, abs=1e-4)


def test_softening_is_that_of_ogden_and_roxburgh():
    r, m, beta = 4.0, 0.05, 0.2
    memory = Softened(CONSTANTS, r, m, beta).after(0.0, stretched(1.6))
    most, now = (energy_of(CONSTANTS, stretched(x))[0, 0] for x in (1.6, 1.3))
    eta = 1.0 - erf((most - now) / (m + beta * most)) / r
    assert memory.field(0.0, stretched(1.3)).constants[0, 0] == pytest.approx(eta * CONSTANTS[0, 0])
    assert memory.field(0.0, stretched(1.7)).constants == pytest.approx(CONSTANTS)


@pytest.mark.fem
def test_the_first_loading_is_elastic_and_unloading_bends_further(mesh):
    actuator = FieldActuator(mesh, YEOH)
    load = np.array([0.2, 0.5, 0.2, 0.5, 0.7])
    schedule = Schedule(load, np.zeros(5))
    elastic = actuator.tested(Elastic(Field(actuator.body.constants)), schedule)[:, 0]
    soft = actuator.tested(Softened(actuator.body.constants, 4.0, 0.01, 0.1), schedule)[:, 0]
    assert soft[[0, 1, 3, 4]] == pytest.approx(elastic[[0, 1, 3, 4]], rel=2e-4)
    assert soft[2] > 1.02 * elastic[2]


def slab(depth, count=12):
    """A block that is open at its top alone: the other faces are clamped or under paper."""
    block = box((1.0, 1.0, depth), divisions=(1, 1, count))
    diffusion = Diffusion.on(block)
    top = np.flatnonzero(np.isclose(block.nodes[:, 2], depth))
    return block, replace(diffusion, surface=top)


def test_what_reacts_falls_off_as_a_hyperbolic_cosine():
    depth, reach = 2.0, 0.7
    block, diffusion = slab(depth)
    found = diffusion.stationary(reach)
    exact = np.cosh(block.nodes[:, 2] / reach) / np.cosh(depth / reach)
    assert found == pytest.approx(exact, abs=2e-4)
    rate = reacted(diffusion, reach, 20.0)
    assert np.sum(rate * block.weights) / block.volume == pytest.approx(20.0)
    assert rate.max() > 20.0 > rate.min() > 0.0


def test_a_block_dries_as_the_series_for_diffusion_out_of_a_brick():
    # open at its top, bottom, side and end, with hardly any resistance of the air: half thickness
    # of 0.5 mm along z, and 1 mm from the closed planes x = 0 and y = 0
    block = box((1.0, 1.0, 1.0), divisions=(6, 6, 8))
    water = Water(diffusivity=1e-4, transfer=1.0, fall=1.0, stiffening=0.1)
    constants = np.ones((*block.weights.shape, 4))
    memory, time = Drying(Diffusion.on(block), constants, water), 0.0
    for _ in range(60):
        memory, time = memory.after(10.0, None), time + 10.0
    content = memory.diffusion.at_points(memory.content)
    mean = np.sum(content * block.weights) / block.volume
    odd = 2.0 * np.arange(200) + 1.0

    def left(half):  # Crank (1975), equation 4.18
        decay = np.exp(-((odd * np.pi / (2.0 * half)) ** 2) * 1e-4 * time)
        return np.sum(8.0 / (odd * np.pi) ** 2 * decay)

    assert 1.0 + mean == pytest.approx(left(1.0) ** 2 * left(0.5), rel=0.03)
    stiffer = memory.field(0.0, None).constants[..., 0]
    assert stiffer == pytest.approx(np.exp(-0.1 * content))


def test_the_air_takes_no_more_than_its_resistance_lets_through():
    block = box((1.0, 1.0, 1.0), divisions=(2, 2, 2))
    diffusion = Diffusion.on(block)
    water = Water(diffusivity=100.0, transfer=1e-4, fall=0.5)
    content = diffusion.later(np.zeros(diffusion.count), water, 10.0)
    # four open faces of 1 mm²; the inside follows at once
    expected = -0.5 * (1.0 - np.exp(-4.0 * 1e-4 * 10.0))
    assert content == pytest.approx(expected, rel=3e-3)


@pytest.mark.fem
def test_without_memory_the_map_is_the_elastic_one():
    one = np.ones((1, 2, 1))
    inputs = Inputs(
        pressure=np.array([[[30.0, 90.0, 30.0], [0.0, 90.0, 120.0]]]),
        c1=0.3 * one,
        c2=-0.01 * one,
        c3=0.004 * one,
        linear_scale=0.85 * one,
        paper_stiffness=3e4 * one,
    )

    def elastic(actuator, specimen):
        return Elastic(Field(actuator.body.constants))

    exact = ExactMap(SMALL, COARSE)
    reference = exact(inputs)
    for finer in (None, exact):
        found = FieldMap(SMALL, COARSE, np.zeros((2, 3)), elastic, finer=finer)(inputs)
        assert found.curvature == pytest.approx(reference.curvature, rel=1e-3)
        assert found.bend_angle == pytest.approx(reference.bend_angle, rel=1e-3)
        assert found.peak_stretch == pytest.approx(reference.peak_stretch, rel=1e-3)
