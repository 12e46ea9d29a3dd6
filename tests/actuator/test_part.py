"""A part that a user has meshed: the default actuator's own mesh, written and read back."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import LINEAR_CONSTANT, QUADRATIC
from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.equilibrium import follow
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.linear import open_factorization
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.section import air_volume, described, section
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.part import PartError, read_part
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import with_part
from bayesdeg.errors import GeometryError
from bayesdeg.pages.surface import faces_of
from tests.actuator.parts import COARSEST, SMALL, half, tetrahedral, whole, write
from tests.peers.peer_path import FRESH, LOADS, curvatures, own_path

VOLUME = OUTPUTS.index("cavity_volume")
PRESSURES = np.array([[20.0, 60.0, 120.0, 180.0]])


def geometry_of_file(path):
    settings, faults = with_part(path.parent, Settings(), MeshDimensions(file=path.name))
    assert faults == ()
    return geometry_of(settings.dimensions, settings.layer)


def inputs(**changed):
    one = np.ones((1, 1))
    plain = {"c1": 0.3, "c2": -0.003, "c3": 0.003, "linear_scale": 0.853, "paper_stiffness": 3e4}
    values = {name: value * one for name, value in (plain | changed).items()}
    return Inputs(pressure=PRESSURES, **values)


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    path = tmp_path_factory.mktemp("part") / "part.msh"
    return geometry_of_file(write(path, half(Geometry(Dimensions()), COARSE)))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("part") / "part.msh"
    return geometry_of_file(write(path, half()))


def test_the_default_actuators_own_mesh_gives_its_curve(default):
    """To rounding: its nodes have another order, so that sums do."""
    asked = replace(inputs(), asked="cavity_volume")
    ours = ExactMap(Geometry(Dimensions()), COARSE)(asked)
    theirs = ExactMap(default, COARSE)(asked)
    for name in ("curvature", "bend_angle", "peak_stretch"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-9)
    np.testing.assert_allclose(theirs.further.value, ours.further.value, rtol=1e-9)


@pytest.mark.parametrize(("suffix", "by"), [("inp", "nodes"), ("vtu", "arrays")])
def test_other_formats_and_ways_of_naming_say_the_same(tmp_path, small, suffix, by):
    other = geometry_of_file(write(tmp_path / f"part.{suffix}", half(), by=by))
    a, b = (build_mesh(one, COARSEST) for one in (small, other))
    for faces in ("cavity", "paper"):
        ours, theirs = getattr(a.body, faces), getattr(b.body, faces)
        assert len(ours) == len(theirs) > 0
        middles = [
            np.sort(m.body.nodes[f].mean(axis=1).round(9), axis=0)
            for m, f in ((a, ours), (b, theirs))
        ]
        np.testing.assert_allclose(*middles)
    np.testing.assert_array_equal(a.body.fixed, b.body.fixed)


@pytest.mark.parametrize("cut", [lambda part: part, tetrahedral], ids=["bricks", "tetrahedra"])
@pytest.mark.parametrize(("suffix", "by"), [("msh", "faces"), ("inp", "nodes"), ("vtu", "arrays")])
def test_paper_on_the_floor_of_a_cavity_takes_no_face_off_it(tmp_path, suffix, by, cut):
    points, bricks, sides = half()
    height = points[sides["cavity"]][..., 2]
    [floor, *_] = sides["cavity"][np.isclose(height, height.min()).all(axis=1)]
    part = cut((points, bricks, sides | {"constraint": floor[None]}))
    found = read_part(write(tmp_path / f"part.{suffix}", part, by=by)).sides
    assert {n: len(found[n]) for n in found} == {n: len(part[2][n]) for n in found}
    both = np.isin(found["cavity"], found["constraint"]).all(axis=1)
    assert both.sum() == len(found["constraint"]) > 0


@pytest.mark.parametrize(("suffix", "by", "more"), [("msh", "faces", 1), ("inp", "nodes", 0)])
def test_a_face_of_two_boundaries_is_of_the_cavity_where_faces_name_it(tmp_path, suffix, by, more):
    """A triangle in the plane of symmetry, where it opens no hole, on three nodes of the cavity."""
    points, cells, sides = tetrahedral(half())
    [face] = sides["symmetry"][np.isin(sides["symmetry"], sides["cavity"]).all(axis=1)]
    both = sides | {"cavity": np.vstack([sides["cavity"], face])}
    part = read_part(write(tmp_path / f"part.{suffix}", (points, cells, both), by=by))
    assert len(part.sides["cavity"]) == len(sides["cavity"]) + more


@pytest.mark.parametrize("cut", [lambda part: part, tetrahedral], ids=["bricks", "tetrahedra"])
def test_planes_of_a_file_of_few_digits_are_planes(tmp_path, cut):
    """Coordinates off by a thousandth of a micrometre: no face of the paper or the cut is lost."""
    points, cells, sides = cut(half())
    off = 1e-6 * np.random.default_rng(5).uniform(-1.0, 1.0, points.shape)
    exact, rounded = (
        build_mesh(geometry_of_file(write(tmp_path / f"{k}.msh", (at, cells, sides))), COARSEST)
        for k, at in enumerate((points, points + off))
    )
    assert len(rounded.body.paper) == len(exact.body.paper) > 0
    on_cut = [int(faces_of(mesh.body)[0].on_cut.sum()) for mesh in (exact, rounded)]
    assert on_cut[0] == on_cut[1] > 0
    np.testing.assert_array_equal(rounded.body.fixed, exact.body.fixed)
    np.testing.assert_allclose(rounded.body.nodes, exact.body.nodes, atol=1e-5)


def test_a_whole_part_reads_as_its_half_does(tmp_path, small):
    both = geometry_of_file(write(tmp_path / "whole.msh", whole()))
    asked = replace(inputs(), asked="cavity_volume")
    ours, theirs = (ExactMap(one, COARSEST)(asked) for one in (small, both))
    np.testing.assert_allclose(theirs.curvature, ours.curvature, rtol=1e-7)
    np.testing.assert_allclose(theirs.further.value, ours.further.value, rtol=1e-7)
    forces = [ExactMap(one, COARSEST).tip_force(inputs()).value for one in (small, both)]
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-5)


def test_wherever_the_part_stands_and_whichever_half_it_is(tmp_path, small):
    points, bricks, sides = half()
    moved = points * [1.0, -1.0, 1.0] + [7.0, 3.0, -2.0]
    part = (moved, bricks[:, [3, 2, 1, 0, 7, 6, 5, 4]], sides)
    other = geometry_of_file(write(tmp_path / "moved.msh", part))
    ours, theirs = (ExactMap(one, COARSEST)(inputs()) for one in (small, other))
    np.testing.assert_allclose(theirs.curvature, ours.curvature, rtol=1e-7)


def test_sizes_volumes_and_the_rough_bending_are_those_of_the_boxes(default):
    boxes = Geometry(Dimensions())
    d = default.dimensions
    assert (d.length, d.width, d.height) == pytest.approx((50.0, 10.0, 10.0))
    assert default.volume == pytest.approx(boxes.volume, rel=1e-12)
    assert air_volume(default) == pytest.approx(air_volume(boxes), rel=1e-12)
    assert 0.4 < d.beam_bending / Dimensions().beam_bending < 2.5


def test_it_is_drawn_and_described(small):
    drawn, ours = section(small, 40).splitlines(), section(SMALL, 40).splitlines()
    assert drawn[-1] == "=" * 40
    marks = [("".join(lines)).count("#") for lines in (drawn, ours)]
    assert marks[0] == pytest.approx(marks[1], rel=0.1)
    assert "20" in described(small)
    assert "/" not in described(small)  # of no path


def test_the_work_of_the_pressure_is_the_energy_that_is_stored(small):
    """∫ p dV along the path against the sum of energies by the kernels' own residual.

    The energy's derivative along the path is the internal force times the velocity, which is
    p dV/dp in equilibrium: both are integrated by the trapezium over 200 steps.
    """
    actuator = Actuator(build_mesh(small, COARSEST))
    loads = tuple(np.linspace(0.002, 0.4, 200))
    _, problem = actuator.problem(Curve(loads, FRESH))
    solver = open_factorization(problem.system.upper)
    path = follow(problem, solver, loads=loads)
    solver.close()
    volume = np.array([problem.cavity_volume(p.state) for p in path.points])
    internal = []
    for point in path.points:
        residual = problem.linearise(point.state, tangent=False).force
        pushed = point.state.load * problem.cavity_gradient(point.state)
        internal.append(np.sum((residual + pushed) * point.rate.displacement))
    p = np.array(loads)
    work = np.sum(0.5 * (p[1:] + p[:-1]) * np.diff(volume))
    energy = np.sum(0.5 * (np.array(internal)[1:] + np.array(internal)[:-1]) * np.diff(p))
    assert work == pytest.approx(energy, rel=2e-4)


@pytest.mark.peer
@pytest.mark.fem
@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda one: one.name)
def test_felupe_says_the_same_of_the_same_mesh(small, element):
    peer = pytest.importorskip("tests.peers.felupe_actuator", reason="needs felupe")
    mesh = build_mesh(small, COARSEST, element=element)
    loads = LOADS if element is LINEAR_CONSTANT else LOADS[:4]
    ours = own_path(mesh.body, FRESH, loads=loads)
    theirs = peer.solve(mesh.body, FRESH, loads=loads)
    found = [curvatures(mesh, one.displacements) for one in (ours, theirs)]
    assert found[0][-1] > 1.0
    np.testing.assert_allclose(*found, rtol=1e-6)


def test_walls_of_a_part_cannot_be_changed(small):
    with pytest.raises(GeometryError):
        small.changed(wall_factor=1.1, erosion=0.0)
    thicker = ExactMap(small, COARSEST)(inputs(wall_factor=1.1))
    assert np.all(np.isnan(thicker.curvature))


def test_a_solution_depends_on_what_the_file_holds_and_not_on_its_place(tmp_path, small):
    again = geometry_of_file(write(tmp_path / "other.msh", half()))
    assert again.record() == small.record()
    assert again != small
    longer = geometry_of_file(
        write(tmp_path / "long.msh", half(Geometry(Dimensions(length=22.0, chambers=2))))
    )
    assert longer.record() != small.record()
    assert geometry_of_record(small.record()).record() == small.record()


def test_a_file_that_was_changed_since_is_refused(tmp_path):
    path = write(tmp_path / "part.msh", half())
    geometry = geometry_of_file(path)
    write(path, half(Geometry(Dimensions(length=22.0, chambers=2))))
    with pytest.raises(GeometryError, match="changed"):
        build_mesh(geometry, COARSEST)


@pytest.mark.parametrize("suffix", ["msh", "inp", "vtu"])
def test_what_the_reader_prints_of_a_damaged_file_is_not_heard(tmp_path, capfd, suffix):
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(b"$MeshFormat\n<VTKFile>\n*NODE\n1, what\n")
    with pytest.raises(PartError, match="export"):
        read_part(path)
    assert capfd.readouterr() == ("", "")
