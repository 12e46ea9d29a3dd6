"""What holds for actuators of every geometry: volumes, symmetry, energy, derivatives, scale."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap, with_layer
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.inputs import Inputs, material_groups
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import build_mesh, reshaped
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.section import air_volume
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import FINE, Status
from bayesdeg.data.families import CylindricalDimensions, RibbedDimensions
from bayesdeg.errors import GeometryError
from tests.actuator.geometries import (
    CHANNELS,
    EXACT,
    GEOMETRIES,
    ONE_ELEMENT_A_WALL,
    PARTS,
    RIBBED,
    SOFT,
    cavity,
    geometry_named,
)
from tests.marks import long_unless

ONE = np.ones((1, 1))
# every input of the model at a typical size
EVERY = MaterialGroups(
    -0.02,
    0.02,
    8.0,
    second_invariant_ratio=0.1,
    skin=0.3,
    paper_thickness=0.1,
    paper_slack=0.002,
    paper_mismatch=0.002,
    gravity_along=2e-3,
    gravity_up=-1e-3,
    wall_factor=1.02,
    erosion=0.03,
)


@pytest.fixture(scope="module", params=[*GEOMETRIES, *PARTS])
def actuator(request, tmp_path_factory):
    geometry = geometry_named(request.param, tmp_path_factory.mktemp("part"))
    with_mesh = Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))
    yield with_mesh
    with_mesh.close()


def material_for(geometry, material):
    """A material without what a part of a file cannot have."""
    if hasattr(geometry, "part"):
        return replace(material, wall_factor=1.0, erosion=0.0)
    return material


# ---- volumes


@st.composite
def ribbed(draw):
    size = st.floats(0.5, 4.0)
    length, rib, cover, side, deep, under, end = (draw(size) for _ in range(7))
    count, wide = draw(st.integers(1, 4)), draw(st.floats(2.0, 20.0))
    passive = draw(st.sampled_from(["open", "pressurised", "solid", "none"]))
    layers = 1 if passive == "none" else 2
    return RibbedDimensions(
        length=count * length + (count - 1) * rib + 2.0 * end,
        width=wide + 2.0 * side,
        height=layers * (cover + deep + under),
        channels=count,
        channel_length=length,
        channel_width=wide,
        channel_height=deep,
        pitch=length + rib,
        cover=cover,
        passage_width=draw(st.floats(0.1, 0.9)) * wide,
        passage_height=draw(st.floats(0.1, 0.9)) * deep,
        passive=passive,
    )


@st.composite
def channelled(draw):
    size = st.floats(0.5, 4.0)
    wide, wall, side, deep, under, cover, end = (draw(size) for _ in range(7))
    count, long = draw(st.integers(1, 4)), draw(st.floats(2.0, 40.0))
    passive = draw(st.sampled_from(["open", "pressurised", "solid", "none"]))
    halves = 1 if passive == "none" else 2
    return CylindricalDimensions(
        length=long + 2.0 * end,
        width=count * wide + (count - 1) * wall + 2.0 * side,
        height=halves * (under + deep + cover),
        channels=count,
        channel_length=long,
        channel_width=wide,
        channel_height=deep,
        pitch=wide + wall,
        offset=under + 0.5 * deep,
        passive=passive,
    )


def air(d):
    """Air of one half of a whole segment: its channels, and passages through ribs [mm³]."""
    channels = d.channels * d.channel_length * d.channel_width * d.channel_height
    if isinstance(d, CylindricalDimensions):
        return channels
    ribs = (d.channels - 1) * (d.pitch - d.channel_length)
    return channels + ribs * d.passage_width * d.passage_height


@pytest.mark.parametrize("possible", [ribbed(), channelled()], ids=["ribbed", "channels"])
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_the_mesh_holds_exactly_material_and_air_of_the_boxes(possible, data):
    d = data.draw(possible)
    geometry = SegmentGeometry(d)
    body = build_mesh(geometry, ONE_ELEMENT_A_WALL).body
    halves = {"open": 2, "pressurised": 2, "solid": 1, "none": 1}[d.passive]
    block = d.length * d.width * d.height
    assert 2.0 * body.volume == pytest.approx(block - halves * air(d), rel=1e-10)
    assert geometry.volume == pytest.approx(2.0 * body.volume, rel=1e-12)
    pressed = 2 if d.passive == "pressurised" else 1
    assert 2.0 * cavity(body)[0] == pytest.approx(pressed * air(d), rel=1e-10)
    assert air_volume(geometry) == pytest.approx(pressed * air(d), rel=1e-10)
    again = geometry_of_record(geometry.record())
    assert again.planes()[1].tolist() == pytest.approx(geometry.planes()[1].tolist())


def test_volumes_and_the_record_are_those_of_the_geometry(actuator):
    geometry, body = actuator.mesh.geometry, actuator.mesh.body
    # an ellipse is met by one element as closely as quadratic bricks do
    near = 1e-2 if getattr(geometry, "rounded", False) else 1e-10
    assert 2.0 * body.volume == pytest.approx(geometry.volume, rel=near)
    assert 2.0 * cavity(body)[0] == pytest.approx(air_volume(geometry), rel=1e-10)
    assert geometry_of_record(geometry.record()).record() == geometry.record()


def test_fine_meshes_of_defaults_have_a_usual_size():
    for dimensions, least in ((RibbedDimensions(), 60_000), (CylindricalDimensions(), 40_000)):
        geometry = geometry_of(dimensions)
        mesh = build_mesh(geometry, geometry.mesh_like(FINE))
        assert least < 3 * len(mesh.body.nodes) < 90_000


# ---- walls


@pytest.mark.parametrize("wall_factor", [0.8, 1.2])
def test_moved_walls_hold_what_a_new_mesh_holds(actuator, wall_factor):
    geometry = actuator.mesh.geometry
    if hasattr(geometry, "part"):
        with pytest.raises(GeometryError):
            geometry.changed(wall_factor=wall_factor, erosion=0.0)
        return
    moved = reshaped(actuator.mesh, wall_factor=wall_factor, erosion=0.15)
    rebuilt = build_mesh(moved.geometry, ONE_ELEMENT_A_WALL)
    np.testing.assert_array_equal(moved.body.layer, rebuilt.body.layer)
    again = reshaped(moved, wall_factor=1.0, erosion=0.0)
    np.testing.assert_allclose(again.body.nodes, actuator.mesh.body.nodes, atol=1e-12)
    if geometry.rounded:  # whose bricks share the room in another way, see test_round.py
        return
    np.testing.assert_allclose(moved.body.nodes, rebuilt.body.nodes, atol=1e-12)
    np.testing.assert_allclose(moved.body.depth, rebuilt.body.depth, atol=1e-12)


@pytest.mark.parametrize(
    ("dimensions", "changes"),
    [
        (RIBBED, {"wall_factor": 2.0}),
        (RIBBED, {"wall_factor": 3.0}),
        (RIBBED, {"erosion": 1.1}),
        (RIBBED, {"erosion": -0.1}),
        (CHANNELS, {"wall_factor": 4.0}),
        (CHANNELS, {"wall_factor": -1.0}),
        (CHANNELS, {"erosion": 1.6}),
        (CHANNELS, {"erosion": -0.1}),
    ],
)
def test_walls_that_are_lost_are_refused(dimensions, changes):
    with pytest.raises(GeometryError):
        SegmentGeometry(dimensions, **changes)
    of = Actuator(build_mesh(geometry_of(dimensions), ONE_ELEMENT_A_WALL))
    solution = of.solve(Curve((0.1,), replace(SOFT, **changes)))
    assert solution.status is Status.INVALID_INPUT


# ---- solved


@pytest.mark.fem
@pytest.mark.parametrize(
    ("name", "bent"),
    [
        ("ribbed", 5e-3),
        ("ribbed without layer", 5e-3),
        ("channels", 2e-3),
        ("round", 1e-4),
    ],
)
def test_a_segment_pressed_in_both_halves_does_not_bend(name, bent):
    geometry, curve = GEOMETRIES[name], Curve((0.2, 0.4), SOFT)
    pressed = replace(geometry, dimensions=replace(geometry.dimensions, passive="pressurised"))
    one, both = (
        Actuator(build_mesh(each, ONE_ELEMENT_A_WALL)).solve(curve, effort=EXACT)
        for each in (geometry, pressed)
    )
    assert one.status is both.status is Status.CONVERGED
    np.testing.assert_allclose(both.bend_angle, 0.0, atol=1e-9)
    assert both.arc_length[-1] > geometry.dimensions.length
    assert np.all(one.bend_angle > bent)


ASSEMBLED_TWICE = ("ribbed", "ribbed without layer", "ribbed with a slab", "channels", "round")


@pytest.mark.fem
@pytest.mark.parametrize("name", [long_unless(n == "ribbed", n) for n in ASSEMBLED_TWICE])
def test_both_assemblies_solve_the_same_curve(name):
    """See also test_weak_form.py; the weak form knows no tetrahedra."""
    ours = Actuator(build_mesh(GEOMETRIES[name], ONE_ELEMENT_A_WALL))
    theirs = Actuator(ours.mesh, backend="scikit-fem")
    material = replace(
        SOFT, paper_group=8.0, skin=0.2, second_invariant_ratio=0.1, paper_slack=0.002
    )
    curve = with_layer(GEOMETRIES[name], Curve((0.1, 0.3), material))
    one, other = (a.solve(curve, effort=EXACT) for a in (ours, theirs))
    assert one.status is Status.CONVERGED
    np.testing.assert_allclose(other.readings, one.readings, rtol=1e-9, atol=1e-12)


def inputs(pressure, scale=1.0):
    constants = (value * ONE for value in (0.01, -1e-4, 2e-5))
    paper = {"paper_stiffness": 2e3 * scale * ONE, "paper_thickness": 0.1 * scale * ONE}
    return Inputs(np.array([pressure]), *constants, scale * ONE, **paper)


OF_ONE_ELASTOMER = [name for name, one in GEOMETRIES.items() if not one.constraint.is_slab]
OF_BRICKS = [name for name in PARTS if "tetrahedra" not in name]


@pytest.mark.fem
@pytest.mark.parametrize("actuator", [*OF_ONE_ELASTOMER, *OF_BRICKS], indirect=True)
def test_the_pressure_does_the_work_that_is_stored(actuator, path_of, stored_energy):
    """∫ p dV = p V − ∫ V dp by Simpson's rule [kPa ml = mJ] against the energy, in C1 mm³."""
    pressure = np.linspace(0.0, 4.0, 17)
    asked = inputs(pressure)
    groups = {name: float(np.ravel(value)[0]) for name, value in material_groups(asked).items()}
    curve = Curve(tuple(1e-3 * pressure[1:] / 0.01), MaterialGroups(**groups))
    solved = actuator.solve(curve, effort=EXACT)
    volume = 2e-3 * np.array([0.0, *(solved.readings[:, 2] - solved.rest[2])])
    work = pressure[-1] * volume[-1] - simpson(volume, x=pressure)
    _, problem = actuator.problem(curve)
    path = path_of(problem, curve.loads[-1:], EXACT)
    ends = [stored_energy(problem, p.state.displacement) for p in (path.rest, path.points[-1])]
    stored = 2.0 * 0.01 * (ends[1] - ends[0])
    print(f"work over energy - 1 is {work / stored - 1.0:.1e}")
    assert stored > 0.0
    assert work == pytest.approx(stored, rel=1e-5)


@pytest.mark.fem
@pytest.mark.parametrize("actuator", [*OF_ONE_ELASTOMER, *PARTS], indirect=True)
def test_smaller_parts_bend_more_and_take_up_less(actuator):
    """Half the size with half the film is the same shape; a slab keeps its thickness."""
    forward = ExactMap(actuator.mesh.geometry, ONE_ELEMENT_A_WALL)
    whole, half = (
        forward(replace(inputs([2.0, 4.0], scale), asked="cavity_volume")) for scale in (1.0, 0.5)
    )
    assert np.all(whole.status == Status.CONVERGED)
    assert 0.0 < whole.curvature[0, 0] < whole.curvature[0, 1]
    np.testing.assert_allclose(half.curvature, 2.0 * whole.curvature, rtol=1e-9)
    np.testing.assert_allclose(half.further.value, whole.further.value / 8.0, rtol=1e-9)


DIFFERENTIATED = {
    "ribbed with a film above the middle": ("c2_ratio", "paper_group", "wall_factor", "erosion"),
    "ribbed with a slab": INPUTS,
    "channels": ("paper_group", "wall_factor"),
    "round": ("load", "paper_group", "skin", "wall_factor", "erosion"),
    "part of tetrahedra": ("load", "c2_ratio", "c3_ratio", "paper_group", "paper_mismatch"),
}


@pytest.mark.fem
@pytest.mark.parametrize("name", [long_unless("film" in n, n) for n in DIFFERENTIATED])
def test_derivatives_are_those_of_curves_solved_again(name, tmp_path):
    """Central differences over 0.2 % of an input; by its layer's stiffness too."""
    geometry = geometry_named(name, tmp_path)
    of = Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))
    every, loads = material_for(geometry, EVERY), np.array([0.2, 0.5])
    smooth = [OUTPUTS.index(output) for output in ("bend_angle", "arc_length", "cavity_volume")]
    found, gradients = of.solve_with_gradients(with_layer(geometry, Curve(tuple(loads), every)))
    assert found.status is Status.CONVERGED
    by_load = gradients[:, smooth, INPUTS.index("load")]
    np.testing.assert_allclose(found.rates[:, smooth], by_load, rtol=1e-4)
    for one in DIFFERENTIATED[name]:
        by = gradients[:, smooth, INPUTS.index(one)]
        if geometry.constraint.is_slab and one.startswith("paper_") and one != "paper_group":
            assert not by.any()  # a slab is no paper
            continue
        ends = []
        for share in (-1e-3, 1e-3):
            other, at = every, loads
            if one == "load":
                at = loads * (1.0 + share)
            else:
                other = replace(every, **{one: getattr(every, one) * (1.0 + share)})
            curve = with_layer(geometry, Curve(tuple(at), other))
            ends.append(of.solve(curve, effort=EXACT).readings[:, smooth])
        start = loads[:, None] if one == "load" else getattr(every, one)
        # how a slab's bulk modulus grows with its group is left out
        near = 5e-3 if geometry.constraint.is_slab and one == "paper_group" else 2e-4
        slope = (ends[1] - ends[0]) / (2e-3 * start)
        least = 1e-7 if of.mesh.body.element.triangular else 2e-9
        np.testing.assert_allclose(slope, by, rtol=near, atol=least, err_msg=one)
