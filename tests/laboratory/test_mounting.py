"""Paper that comes off and a clamp that gives: limits, closed forms, convergence."""

from dataclasses import replace

import numpy as np
import pytest
from physics.fields import (
    Elastic,
    Field,
    FieldActuator,
    FieldBody,
    FieldEquations,
    FieldMap,
    Schedule,
)
from physics.mounting import (
    NEAREST,
    Bond,
    Clamp,
    ClampSprings,
    Mounting,
    bonded_mesh,
    cuts_of,
    detached,
    end_face,
    released,
)

from bayesdeg.actuator.body import boundary_faces, box, tetrahedra_of
from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import face_rotation
from bayesdeg.actuator.problem import MechanicalState, Problem, System
from bayesdeg.actuator.status import PathEffort, Resolution
from bayesdeg.data.families import Constraint
from bayesdeg.data.settings import Dimensions
from tests.actuator.geometries import geometry_of_file
from tests.actuator.parts import half, tetrahedral, write
from tests.actuator.test_tetrahedra import cube

TWO = Geometry(Dimensions(length=23.0, chambers=2))
YEOH = MaterialGroups(c2_ratio=-0.03, c3_ratio=0.01, paper_group=100.0, paper_thickness=0.12)
BARE = replace(YEOH, paper_group=0.0)
STIFF = MaterialGroups(0.0, 0.0, paper_group=0.0, bulk_ratio=1e3)
LOADS = np.array([0.1, 0.3])


def bent(mesh, material=YEOH, loads=LOADS, **options):
    """Bend angle and arc length at the loads."""
    actuator = FieldActuator(mesh, material, **options)
    memory = Elastic(Field(actuator.body.constants))
    return actuator.tested(memory, Schedule(loads, np.zeros(len(loads))))[:, :2]


def curvature(mesh, **options):
    angle, length = bent(mesh, **options).T
    return angle / length


@pytest.fixture(scope="module")
def whole():
    return build_mesh(TWO, COARSE)


def test_a_whole_bond_is_the_mesh_without(whole):
    mesh = bonded_mesh(TWO, COARSE, Bond())
    assert np.array_equal(mesh.body.nodes, whole.body.nodes)
    assert np.array_equal(mesh.body.paper, whole.body.paper)
    assert Bond().is_whole
    assert Bond().share_off == 0.0


@pytest.mark.parametrize(
    ("bond", "share"),
    [
        (Bond(off_end=0.3), 0.3),
        (Bond(off_clamp=0.3), 0.3),
        (Bond(off_edges=0.37), 0.37),
        (Bond(off_end=0.15, off_clamp=0.2, off_edges=0.5), 1.0 - 0.65 * 0.5),
        (Bond(off_end=1.0), 1.0),
        (Bond(off_end=0.7, off_clamp=0.6), 1.0),
    ],
)
def test_the_papered_area_is_that_which_is_bonded(bond, share):
    body = bonded_mesh(TWO, COARSE, bond).body
    covered = np.prod(np.ptp(body.nodes[body.paper], axis=1)[:, :2], axis=1).sum()
    bottom = TWO.dimensions.length * TWO.dimensions.width / 2.0
    assert bond.share_off == pytest.approx(share, abs=1e-12)
    assert covered == pytest.approx((1.0 - share) * bottom, abs=1e-9)


def test_bonding_ends_on_a_plane_that_is_near_enough():
    x = TWO.planes()[0][2]
    for off, cuts in ((0.5 * NEAREST, 0), (2.0 * NEAREST, 1)):
        bond = Bond(off_end=1.0 - (x + off) / TWO.dimensions.length)
        assert len(cuts_of(TWO, bond)[0]) == cuts
    narrow = Bond(off_clamp=0.5, off_end=0.5 - 0.5 * NEAREST / TWO.dimensions.length)
    assert len(cuts_of(TWO, narrow)[0]) == 1


def test_shares_grow_with_degradation_up_to_all():
    bond = Bond(off_end=0.4, off_edges=0.8)
    assert bond.grown(12.5, 25.0) == Bond(off_end=0.2, off_edges=0.4)
    assert bond.grown(50.0, 25.0) == Bond(off_end=0.8, off_edges=1.0)
    assert bond.grown(0.0, 25.0).is_whole


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"off_end .* not 1\.2"):
        Bond(off_end=1.2)
    bare = replace(TWO, constraint=Constraint("none"))
    with pytest.raises(ValueError, match="membrane"):
        bonded_mesh(bare, COARSE, Bond(off_end=0.2))


@pytest.mark.parametrize("cut", [half, lambda: tetrahedral(half())], ids=["bricks", "tetrahedra"])
def test_paper_comes_off_no_meshed_part(tmp_path, cut):
    part = geometry_of_file(write(tmp_path / "part.msh", cut()))
    assert len(bonded_mesh(part, COARSE, Bond()).body.paper) > 0
    with pytest.raises(ValueError, match="no plane"):
        bonded_mesh(part, COARSE, Bond(off_end=0.2))


@pytest.mark.fem
def test_paper_that_came_off_everywhere_is_no_paper(whole):
    off = bent(detached(whole, Bond(off_end=1.0)))
    # but for rounding: without paper the unknowns are eliminated in another order
    assert off == pytest.approx(bent(whole, BARE), rel=1e-8)
    assert abs(off / bent(whole) - 1.0).max() > 0.05


@pytest.mark.fem
def test_a_bond_that_is_whole_bends_as_without_the_option(whole):
    assert np.array_equal(bent(bonded_mesh(TWO, COARSE, Bond())), bent(whole))


def inflated(mesh):
    """Change of the cavity's volume at a small load."""
    actuator = FieldActuator(mesh, YEOH, PathEffort(tolerance=1e-9))
    memory = Elastic(Field(actuator.body.constants))
    [[volume]] = actuator.tested(memory, Schedule(np.array([1e-3]), np.zeros(1)))[:, [2]]
    return volume - Problem(actuator.body.system, YEOH).cavity_volume(actuator.body.rest.state)


@pytest.mark.fem
@pytest.mark.parametrize("where", ["off_end", "off_clamp", "off_edges"])
def test_the_more_comes_off_the_further_a_small_load_inflates(where):
    """Less stiffness is more compliance, fᵀ K⁻¹ f, wherever the paper comes off.

    On one mesh, with a plane at each place where bonding ends.
    """
    bonds = [Bond(**{where: share}) for share in (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)]
    cuts = [cuts_of(TWO, bond) for bond in bonds]
    planes = tuple(np.unique(np.concatenate(axis)) for axis in zip(*cuts, strict=True))
    mesh = build_mesh(TWO, COARSE, cuts=planes)
    found = [inflated(detached(mesh, bond)) for bond in bonds]
    assert np.all(np.diff(found) > 0.0)
    assert found[-1] > 1.05 * found[0]


@pytest.mark.fem
def test_paper_that_comes_off_under_a_slot_adds_bending_and_under_a_chamber_takes_it():
    """Bending of a slotted body is that of its slots, in which paper is stretched and bent."""
    slot, chamber = TWO.voids[0][0], TWO.cavities[1][0]
    length = TWO.dimensions.length

    def effect(start, end):
        """By what the front does on its way along x, from one end to the other."""
        fronts = [Bond(off_end=1.0 - x / length) for x in (end, start)]
        meshes = [build_mesh(TWO, COARSE, cuts=cuts_of(TWO, bond)) for bond in fronts]
        before, after = (
            curvature(detached(mesh, bond))[0] / curvature(mesh)[0]
            for mesh, bond in zip(meshes, fronts, strict=True)
        )
        return after - before

    assert effect(*slot) > 0.05
    assert effect(*chamber) < 0.0


@pytest.mark.fem
def test_where_bonding_ends_may_move_through_a_plane_without_a_jump():
    """The front on both sides of a face of the geometry: a small way, a small change."""
    x, length = TWO.planes()[0][3], TWO.dimensions.length
    ways = np.array([-0.4, -0.2, -0.06, 0.0, 0.06, 0.2, 0.4])
    found = np.array([curvature(_ended(x + way, length))[1] for way in ways])
    lost = curvature(_ended(TWO.planes()[0][2], length))[1]
    steps = np.abs(np.diff(found))
    # were an element's paper kept or lost as a whole, one of the short ways would have it all
    assert steps[2:4].max() < 0.2 * abs(lost - found[3])
    assert steps.max() < 0.5 * abs(lost - found[3])


def _ended(x, length):
    return bonded_mesh(TWO, COARSE, Bond(off_end=1.0 - x / length))


@pytest.mark.long
@pytest.mark.fem
@pytest.mark.slow
def test_the_effect_converges_with_the_mesh():
    bond, effects = Bond(off_end=0.45), []
    for along, across, up in ((3.5, 2.5, 5.0), (1.8, 1.3, 2.5), (0.9, 0.9, 1.3)):
        mesh = build_mesh(TWO, Resolution(along, across, up), cuts=cuts_of(TWO, bond))
        effects.append(curvature(detached(mesh, bond))[1] / curvature(mesh)[1] - 1.0)
    first, second, last = effects
    assert abs(last - second) < abs(second - first)
    assert second == pytest.approx(last, rel=0.1)


def of_bricks(lengths):
    return box(lengths, divisions=(2, 1, 2))


def of_tetrahedra(lengths):
    body = tetrahedra_of(*cube((2, 1, 2), lengths))
    held = np.repeat(np.isclose(body.nodes[:, :1], 0.0), 3, axis=1)
    return replace(body, fixed=held)


CELLS = pytest.mark.parametrize("cells", [of_bricks, of_tetrahedra], ids=["bricks", "tetrahedra"])


def turned_block(cells, clamp, moment, lengths=(4.0, 2.0, 3.0)):
    """Angle of the end face of a block on springs, under a moment on its other end [rad]."""
    whole = cells(lengths)
    body = FieldBody(released(whole), STIFF, PathEffort(tolerance=1e-10), clamp)
    far = boundary_faces(whole)
    far = far[np.all(np.isclose(whole.nodes[far][..., 0], lengths[0]), axis=1)]
    nodes = np.unique(far)
    arm = whole.nodes[nodes, 2] - lengths[2] / 2.0
    force = np.zeros_like(whole.nodes)
    force[nodes, 0] = moment * arm / np.sum(arm**2)
    problem = Problem(body.system, STIFF, nodal_force=force)
    equations = FieldEquations(problem, support=body.support)
    state = body.system.rest()
    solution = body.solver
    found = equations.linearise(state)
    solution.factorize(found.tangent)
    step = body.system.expand(solution.solve(-found.residual[:, None])[:, 0])
    angle, _ = face_rotation(whole, end_face(whole), whole.nodes + step, 0.0)
    return angle


@CELLS
@pytest.mark.fem
def test_a_moment_turns_the_clamp_by_its_stiffness(cells):
    clamp, moment = Clamp(1e-3, 1e-3), 1e-6
    expected = moment / clamp.turning(2.0, 3.0)
    # the springs are a thousandth as stiff as the block, which bends the face itself a little
    assert turned_block(cells, clamp, moment) == pytest.approx(expected, rel=5e-3)


@pytest.mark.fem
def test_the_springs_are_in_the_tangent_as_in_the_products(whole):
    rng = np.random.default_rng(7)
    body = FieldBody(released(whole.body), YEOH, clamp=Clamp(0.7, 0.2))
    problem = Problem(body.system, YEOH)
    equations = FieldEquations(problem, support=body.support)
    along = body.system.expand(rng.standard_normal(len(body.system.free)))
    state = body.system.rest()
    along_state = MechanicalState(along, np.zeros_like(state.pressure), 0.0)
    upper = body.system.upper.copy()
    upper.data = equations.linearise(state).tangent - problem.linearise(state).tangent
    full = upper + upper.T
    full.setdiag(upper.diagonal())
    [(with_it, _)], [(without, _)] = (
        e.products(state, [along_state]) for e in (equations, problem)
    )
    expected = problem.system.on_free(with_it - without)
    assert np.abs(expected).max() > 0.01
    assert full @ problem.system.on_free(along) == pytest.approx(expected, abs=1e-12)
    moved = MechanicalState(along, state.pressure, 0.0)
    force = equations.linearise(moved, tangent=False).force
    assert force - problem.linearise(moved, tangent=False).force == pytest.approx(
        with_it - without, abs=1e-9
    )


@CELLS
def test_springs_push_against_a_shift_of_the_whole_face(cells):
    block = released(cells((1.0, 2.0, 3.0)))
    support = ClampSprings.on(System(block), Clamp(0.5, 0.25))
    shift = np.tile([0.1, 0.2, -0.4], (len(block.nodes), 1))
    total = support.push(shift).sum(axis=0)
    assert total == pytest.approx(6.0 * np.array([0.5, 0.25, 0.25]) * [0.1, 0.2, -0.4])
    # turned about its middle, as by `Clamp.turning`; and x · M x of a quadratic, by hand
    up = block.nodes[:, 2] - 1.5
    turned = support.push(np.column_stack([up, 0.0 * up, 0.0 * up]))
    assert turned[:, 0] @ up == pytest.approx(Clamp(0.5, 0.25).turning(2.0, 3.0))
    square = np.column_stack([block.nodes[:, 2] ** 2, 0.0 * up, 0.0 * up])
    assert support.push(square)[:, 0] @ square[:, 0] == pytest.approx(0.5 * 2.0 * 3.0**5 / 5.0)


@pytest.mark.fem
def test_a_stiff_clamp_is_one_that_holds(whole):
    held = bent(whole)
    errors = [np.abs(bent(whole, clamp=Clamp(k, k)) / held - 1.0).max() for k in (1e2, 1e4, 1e6)]
    assert errors[0] > 10.0 * errors[1] > 10.0 * errors[2]
    # what is left is the paper's slope, which a clamp of springs does not hold
    assert errors[2] < 5e-5


@pytest.mark.fem
def test_inflation_does_not_turn_a_clamp_and_weight_does(whole):
    """A closed cavity pushes on nothing outside: without weight the clamp carries no moment."""
    clamp = Clamp(0.1, 0.03)
    faces, space = (bent(whole, clamp=clamp), _in_space(whole, YEOH, clamp))
    assert space[:, 0] == pytest.approx(faces[:, 0], abs=2e-4)
    heavy = replace(YEOH, gravity_up=-1e-4)
    loads = np.array([0.0])
    actuator = FieldActuator(whole, heavy, clamp=clamp)
    memory = Elastic(Field(actuator.body.constants))
    [[turned, *_]] = actuator.tested(memory, Schedule(loads, np.zeros(1)), to_horizontal=True)
    [[between, _]] = bent(whole, heavy, loads, clamp=clamp)
    d = TWO.dimensions
    volume = TWO.volume
    middle = np.average(_middles(whole), weights=whole.body.weights.ravel())
    expected = 1e-4 * volume * middle / clamp.turning(d.width, d.height)
    assert turned - between == pytest.approx(expected, rel=0.03)


def _in_space(mesh, material, clamp):
    actuator = FieldActuator(mesh, material, clamp=clamp)
    memory = Elastic(Field(actuator.body.constants))
    schedule = Schedule(LOADS, np.zeros(len(LOADS)))
    return actuator.tested(memory, schedule, to_horizontal=True)[:, :2]


def _middles(mesh):
    body = mesh.body
    return np.einsum("qa,ea->eq", body.element.shapes, body.nodes[body.elements, 0]).ravel()


@pytest.mark.fem
def test_the_map_mounts_each_specimen_as_it_is_told():
    one = np.ones((1, 2, 1))
    inputs = Inputs(
        pressure=np.array([[[30.0, 90.0]]]) * one,
        c1=0.3 * one,
        c2=-0.01 * one,
        c3=0.004 * one,
        linear_scale=0.85 * one,
        paper_stiffness=3e4 * one,
    )
    mountings = (Mounting(), Mounting(Bond(off_end=1.0)))
    exact = ExactMap(TWO, COARSE)

    def elastic(actuator, specimen):
        return Elastic(Field(actuator.body.constants))

    mapped = FieldMap(
        TWO, COARSE, np.zeros((2, 2)), elastic, mounting=mountings.__getitem__, finer=exact
    )
    found = mapped(inputs).curvature[0]
    assert found[0] == pytest.approx(exact(inputs).curvature[0, 0], rel=1e-3)
    # on the same mesh, so that the ratio is that of paper to none
    bare = exact(replace(inputs, paper_stiffness=0.0 * one)).curvature[0, 1]
    assert found[1] == pytest.approx(bare, rel=1e-3)
