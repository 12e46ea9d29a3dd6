"""A part that a user has meshed: the default actuator's own mesh, written and read back."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import LINEAR_CONSTANT, QUADRATIC
from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of_record
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.mesh import COARSE, build_mesh
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.section import air_volume, described, section
from bayesdeg.data.part import PartError, read_part
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import GeometryError
from bayesdeg.pages.surface import faces_of
from tests.actuator.geometries import PARTS, geometry_of_file
from tests.actuator.parts import COARSEST, SMALL, half, tetrahedral, whole, write
from tests.peers.peer_path import FRESH, LOADS, curvatures, own_path

VOLUME = OUTPUTS.index("cavity_volume")
PRESSURES = np.array([[20.0, 60.0, 120.0, 180.0]])


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


@pytest.mark.parametrize("cut", PARTS.values(), ids=PARTS)
@pytest.mark.parametrize(("suffix", "by"), [("inp", "nodes"), ("vtu", "arrays")])
def test_other_formats_and_ways_of_naming_say_the_same(tmp_path, suffix, by, cut):
    part = cut(half())
    one = write(tmp_path / "part.msh", part)
    other = write(tmp_path / f"other.{suffix}", part, by=by)
    a, b = (build_mesh(geometry_of_file(path), COARSEST).body for path in (one, other))
    for faces in ("cavity", "paper"):
        ours, theirs = getattr(a, faces), getattr(b, faces)
        assert len(ours) == len(theirs) > 0
        middles = [
            np.sort(body.nodes[f].mean(axis=1).round(9), axis=0)
            for body, f in ((a, ours), (b, theirs))
        ]
        np.testing.assert_allclose(*middles)
    np.testing.assert_array_equal(a.fixed, b.fixed)


@pytest.mark.parametrize("cut", PARTS.values(), ids=PARTS)
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


@pytest.mark.parametrize("cut", PARTS.values(), ids=PARTS)
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


MIRRORED = {8: [3, 2, 1, 0, 7, 6, 5, 4], 4: [0, 2, 1, 3]}
"""Nodes of a cell in the order of its mirror image."""


@pytest.mark.parametrize("cut", PARTS.values(), ids=PARTS)
def test_a_whole_part_and_one_elsewhere_read_as_the_half_does(tmp_path, cut):
    points, cells, sides = part = cut(half())
    away = points * [1.0, -1.0, 1.0] + [7.0, 3.0, -2.0]
    moved = (away, cells[:, MIRRORED[cells.shape[1]]], sides)
    ours, *others = (
        ExactMap(geometry_of_file(write(tmp_path / f"{k}.msh", one)), COARSEST)
        for k, one in enumerate((part, moved, cut(whole())))
    )
    asked = replace(inputs(), asked="cavity_volume")
    known, force = ours(asked), ours.tip_force(inputs()).value
    for other, is_whole in zip(others, (False, True), strict=True):
        # the halves of a whole are cut into tetrahedra along other diagonals
        near, of_force = (0.02, 0.02) if is_whole and cut is tetrahedral else (1e-7, 1e-5)
        found = other(asked)
        np.testing.assert_allclose(found.curvature, known.curvature, rtol=near)
        np.testing.assert_allclose(found.further.value, known.further.value, rtol=near)
        np.testing.assert_allclose(other.tip_force(inputs()).value, force, rtol=of_force)


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
