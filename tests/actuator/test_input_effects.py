"""What every input of the model does: neutral values, signs, limits, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, gravity_direction
from bayesdeg.actuator.material import SKIN_DEPTH, MaterialGroups, skin_profile
from bayesdeg.actuator.mesh import Resolution, build_mesh, reshaped
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.status import PathEffort, Status
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError

pytestmark = pytest.mark.fem

COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
TWO = Geometry(Dimensions(length=20.0, chambers=2))
ONE = np.ones(1)
NEUTRAL = {
    "second_invariant": 0.0 * ONE,
    "skin": 0.0 * ONE,
    "paper_thickness": PAPER_THICKNESS * ONE,
    "paper_slack": 0.0 * ONE,
    "paper_mismatch": 0.0 * ONE,
    "weight_along": 0.0 * ONE,
    "weight_up": 0.0 * ONE,
    "wall_factor": ONE,
    "erosion": 0.0 * ONE,
}
# typical sizes that move the curvature, and in which direction
EFFECTS = {
    "second_invariant": (0.1, -1),
    "skin": (0.5, 0),
    "paper_thickness": (1.0, 0),
    "paper_slack": (0.02, 0),
    "paper_mismatch": (0.02, 0),
    "weight_along": (100.0, -1),
    "weight_up": (100.0, 0),
    "wall_factor": (1.2, -1),
    "erosion": (0.3, 1),
}


@pytest.fixture(scope="module")
def forward():
    return ExactMap(TWO, COARSEST)


@pytest.fixture(scope="module")
def inputs():
    pressure = np.array([20.0, 60.0, 120.0])
    return Inputs(pressure, 0.3 * ONE, -0.005 * ONE, 0.001 * ONE, 0.85 * ONE, 3e4 * ONE)


@pytest.mark.parametrize("name", [*NEUTRAL, "all"])
def test_neutral_values_change_no_bit(forward, inputs, name):
    given = NEUTRAL if name == "all" else {name: NEUTRAL[name]}
    plain, neutral = forward(inputs), forward(replace(inputs, **given))
    for field in ("curvature", "bend_angle", "peak_stretch", "slope", "sd", "status"):
        np.testing.assert_array_equal(getattr(neutral, field), getattr(plain, field))


@pytest.mark.parametrize("name", EFFECTS)
def test_every_input_moves_the_curvature_the_way_it_must(forward, inputs, name):
    value, sign = EFFECTS[name]
    plain, changed = forward(inputs), forward(replace(inputs, **{name: value * ONE}))
    np.testing.assert_array_equal(changed.status, 0)
    share = changed.curvature / plain.curvature - 1.0
    print(f"{name} = {value}: curvature changes by", np.round(100.0 * share, 2), "%")
    assert np.all(np.abs(share) > 1e-5)
    if sign:
        assert np.all(sign * share > 0.0)


def test_skin_keeps_the_volume_mean_of_the_logarithm_of_the_stiffness(two_chambers):
    body = two_chambers.mesh.body
    material = MaterialGroups(-0.01, 0.003, paper_group=100.0, skin=0.9, second_invariant_ratio=0.2)
    constants = Problem(two_chambers.system, material).constants
    uniform = np.array([1.0, -0.01, 0.003, 0.2])
    logarithm = np.log(constants / uniform)
    # all four constants alike, and none on average
    np.testing.assert_allclose(logarithm, logarithm[..., :1] * np.ones(4), atol=1e-14)
    mean = np.sum(logarithm[..., 0] * body.weights) / body.volume
    print(f"volume mean of ln C: {mean:.1e}; from {logarithm.min():.2f} to {logarithm.max():.2f}")
    assert abs(mean) < 1e-14
    assert logarithm.max() <= 0.9


def test_skin_is_that_of_the_depth_under_exposed_faces():
    """Depth by hand in a single chamber: outer faces but for the bottom and the clamped end."""
    body = build_mesh(Geometry(Dimensions(length=14.0, chambers=1)), Resolution(2.0, 2.0, 2.0)).body
    points = np.einsum("qa,eai->eqi", body.element.shapes, body.nodes[body.elements])
    x, y, z = np.moveaxis(points, -1, 0)
    depth = np.minimum(np.minimum(14.0 - x, 5.0 - y), 10.0 - z)
    np.testing.assert_allclose(body.depth, depth, atol=1e-12)
    decay = np.exp(-depth / SKIN_DEPTH)
    mean = np.sum(decay * body.weights) / body.volume
    np.testing.assert_allclose(skin_profile(body), (decay - mean) / (1.0 - mean), rtol=1e-12)
    nearest = np.unravel_index(np.argmin(depth), depth.shape)
    assert skin_profile(body)[nearest] == skin_profile(body).max() < 1.0


def test_slots_are_exposed(two_chambers):
    body, geometry = two_chambers.mesh.body, two_chambers.mesh.geometry
    ((low, high),) = geometry.slot_spans
    middles = body.nodes[body.elements].mean(axis=1)
    beside = (middles[:, 2] > geometry.slot_bottom) & (middles[:, 0] < low)
    nearest = body.depth[beside].min()
    assert nearest < 0.2 * geometry.dimensions.chamber_wall
    assert high > low


def material_volume(d, w, e):
    """Half of an actuator with walls w times as thick and e lost from exposed faces [mm3]."""
    outer = (d.length - e) * (d.width / 2.0 - e) * (d.height - e)
    pitch = (d.length - 2.0 * d.end_wall + 2.0 * d.chamber_wall + d.gap) / d.chambers
    nominal = pitch - 2.0 * d.chamber_wall - d.gap
    walls = [d.end_wall, *[d.chamber_wall] * (2 * (d.chambers - 1)), d.end_wall]
    lengths = [nominal - (w - 1.0) * (walls[2 * i] + walls[2 * i + 1]) for i in range(d.chambers)]
    section = (d.width / 2.0 - w * d.side_wall) * (d.height - w * d.roof - d.floor)
    dividers = (d.chambers - 1) * (2.0 * w * d.chamber_wall + d.gap)
    channel = dividers * d.channel_width / 2.0 * d.channel_height
    bottom = d.floor + d.channel_height + d.channel_roof - e
    slot = (d.gap + 2.0 * e) * (d.width / 2.0 - e) * (d.height - e - bottom)
    return outer - sum(lengths) * section - channel - (d.chambers - 1) * slot * (d.gap > 0.0)


@pytest.mark.parametrize("dimensions", [Dimensions(), Dimensions(gap=0.0), Dimensions(chambers=2)])
@pytest.mark.parametrize(("factor", "erosion"), [(0.7, 0.0), (1.25, 0.0), (1.0, 0.3), (1.2, 0.4)])
def test_walls_and_erosion_change_the_volume_as_arithmetic_says(dimensions, factor, erosion):
    mesh = build_mesh(Geometry(dimensions), COARSEST)
    assert mesh.body.volume == pytest.approx(material_volume(dimensions, 1.0, 0.0), rel=1e-12)
    changed = reshaped(mesh, wall_factor=factor, erosion=erosion)
    wanted = material_volume(dimensions, factor, erosion)
    assert changed.body.volume == pytest.approx(wanted, rel=1e-12)
    # and the same bricks as a mesh that was built so
    built = build_mesh(changed.geometry, Resolution(99.0, 99.0, 99.0))
    assert built.body.volume == pytest.approx(wanted, rel=1e-12)


def test_reshaped_mesh_answers_as_one_that_was_built_so(fresh):
    """The bricks moved against bricks made: the same division of every wall, so the same answer."""
    one_a_wall = Resolution(99.0, 99.0, 99.0)
    curve = Curve((0.2, 0.4), replace(fresh, wall_factor=1.15, erosion=0.2))
    moved = Actuator(build_mesh(TWO, one_a_wall)).solve(curve)
    geometry = replace(TWO, wall_factor=1.15, erosion=0.2)
    made = Actuator(build_mesh(geometry, one_a_wall)).solve(Curve((0.2, 0.4), fresh))
    np.testing.assert_allclose(moved.readings, made.readings, rtol=1e-8)


def test_slack_gives_a_dead_band_and_wears_off(two_chambers):
    """At rest the slack paper is not felt at all; far beyond its slack it is as stiff as ever."""
    bare = MaterialGroups(0.0, 0.01, paper_group=0.0)
    tight = MaterialGroups(0.0, 0.01, paper_group=100.0)
    loads = (0.005, 0.2, 0.6)
    # iterated to the end at every load: a paper that is just taken up is all but linear
    effort = PathEffort(tolerance=1e-5, iterations=15, rate_tolerance=1e-7, exact=True)
    none, full = (two_chambers.solve(Curve(loads, m), effort=effort) for m in (bare, tight))
    shares = []
    for slack in (0.001, 0.01, 0.1):
        curve = Curve(loads, replace(tight, paper_slack=slack))
        loose = two_chambers.solve(curve, effort=effort)
        assert loose.status is Status.CONVERGED
        # one minus tanh(x)/x vanishes at rest: the rates are those without paper
        np.testing.assert_allclose(loose.rest_rates[:3], none.rest_rates[:3], rtol=1e-9)
        grown, most, least = (s.readings[:, 2] for s in (loose, none, full))
        shares.append((most - grown) / (most - least))
    shares = np.array(shares)
    print("share of the paper's hold on the cavity at slack 0.001, 0.01, 0.1:\n", shares)
    assert np.all(np.diff(shares, axis=0) < 0.0)
    assert np.all((shares > 0.0) & (shares < 1.05))
    assert shares[2, 0] < 0.01
    assert shares[0, 2] > 0.8


def test_mismatch_bends_away_from_the_longer_paper(two_chambers, fresh):
    longer, shorter = (
        two_chambers.solve(Curve((0.2,), replace(fresh, paper_mismatch=m))) for m in (0.01, -0.01)
    )
    assert longer.rest[0] < 0.0 < shorter.rest[0]  # positive is towards the paper


def test_mounts_order_the_bend_at_rest_and_under_pressure(two_chambers, fresh):
    weight, found = 4e-4, {}
    for mount in ("horizontal", "hanging", "bending_up", "bending_down"):
        along, up = gravity_direction(mount)
        loaded = replace(fresh, gravity_along=weight * along, gravity_up=weight * up)
        found[mount] = two_chambers.solve(Curve((0.4,), loaded))
    rest = {mount: solution.rest[0] for mount, solution in found.items()}
    bent = {mount: solution.bend_angle[0] for mount, solution in found.items()}
    print("at rest", rest, "under pressure", bent)
    assert rest["horizontal"] == pytest.approx(0.0, abs=1e-14)
    assert rest["bending_up"] < 0.0 < rest["bending_down"]
    assert bent["bending_up"] < bent["horizontal"] < bent["bending_down"]
    # the weight pulls over the stiff paper and so bends towards it, then holds against bending
    assert rest["hanging"] > 0.0
    assert bent["hanging"] - rest["hanging"] < bent["horizontal"]
    # of first order for a cantilever: the same to either side
    assert rest["bending_up"] == pytest.approx(-rest["bending_down"], rel=0.05)


def test_weights_along_the_axes_of_every_mount_are_units():
    for mount in ("hanging", "bending_up", "bending_down"):
        assert np.linalg.norm(gravity_direction(mount)) == 1.0
    assert gravity_direction("horizontal") == (0.0, 0.0)
    with pytest.raises(KeyError):
        gravity_direction("upside_down")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"erosion": 2.5}, "roof of 2 mm"),
        ({"wall_factor": 0.1, "erosion": 0.2}, "chamber_wall of 1.5"),
        ({"wall_factor": 3.0}, "no room"),
        ({"wall_factor": 0.0}, "must be above 0"),
        ({"erosion": -0.1}, "must be above 0"),
    ],
)
def test_lost_walls_are_an_invalid_input_and_the_geometry_says_why(
    two_chambers, fresh, changes, reason
):
    solution = two_chambers.solve(Curve((0.2,), replace(fresh, **changes)))
    assert solution.status is Status.INVALID_INPUT
    assert len(solution.readings) == 0
    assert np.all(np.isnan(solution.rest))
    with pytest.raises(GeometryError, match=reason):
        replace(TWO, **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"paper_group": -1.0},
        {"paper_thickness": -0.1},
        {"paper_slack": -0.01},
        {"paper_group": float("inf")},
        {"skin": float("nan")},
        {"gravity_up": float("nan")},
        {"c2_ratio": float("nan")},
    ],
)
def test_impossible_inputs_are_a_status(two_chambers, fresh, changes):
    solution = two_chambers.solve(Curve((0.2,), replace(fresh, **changes)))
    assert solution.status is Status.INVALID_INPUT


@pytest.mark.parametrize("loads", [(0.2, 0.1), (0.0, 0.1), (-0.1,), (float("nan"),)])
def test_loads_that_do_not_rise_are_a_status(two_chambers, fresh, loads):
    assert two_chambers.solve(Curve(loads, fresh)).status is Status.INVALID_INPUT


def test_sharing_the_numbering_changes_nothing(two_chambers, fresh):
    moved = reshaped(two_chambers.mesh, wall_factor=0.9, erosion=0.1).body
    shared, own = two_chambers.system.with_body(moved), System(moved)
    state = shared.rest()
    state = state.moved(0.01 * moved.nodes * ~moved.fixed, state.pressure)
    one, other = (Problem(s, fresh).linearise(state) for s in (shared, own))
    np.testing.assert_array_equal(one.residual, other.residual)
    np.testing.assert_array_equal(one.tangent, other.tangent)


@pytest.mark.parametrize(
    "dimensions",
    [
        Dimensions(length=20.0, chambers=2, gap=0.0),
        Dimensions(length=14.0, chambers=1),
        Dimensions(length=20.0, chambers=2, channel_width=6.0),
        Dimensions(length=20.0, chambers=2, gap=0.0, channel_width=6.0, channel_height=6.0),
    ],
    ids=["no gap", "one chamber", "channel as wide as the chambers", "one duct"],
)
def test_unusual_geometries_are_solved(dimensions, fresh):
    solution = Actuator(build_mesh(Geometry(dimensions), COARSEST)).solve(Curve((0.2, 0.4), fresh))
    print(dimensions, solution.bend_angle)
    assert solution.status is Status.CONVERGED
    assert 0.0 < solution.bend_angle[0] < solution.bend_angle[1]


def test_a_duct_without_walls_between_is_the_single_chamber(fresh):
    """Without a gap, a channel as large as the chambers leaves one long chamber."""
    duct = Dimensions(
        length=20.0, chambers=2, gap=0.0, chamber_wall=2.0, channel_width=6.0, channel_height=6.0
    )
    single = Dimensions(length=20.0, chambers=1)
    # all planes stand on whole millimetres, so both are divided alike
    one, other = (build_mesh(Geometry(d), Resolution(1.0, 9.0, 9.0)) for d in (duct, single))
    assert one.body.volume == pytest.approx(other.body.volume, rel=1e-12)
    a, b = (Actuator(mesh).solve(Curve((0.3,), fresh)) for mesh in (one, other))
    np.testing.assert_allclose(a.readings, b.readings, rtol=1e-9)
