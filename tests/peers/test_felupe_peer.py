"""felupe on the same mesh with the same element: the same curvatures, digit by digit."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import LINEAR_CONSTANT, QUADRATIC, QUADRATIC_CONSTANT
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import LayerGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.data.families import Constraint
from bayesdeg.data.settings import Dimensions
from tests.actuator.geometries import CHANNELS, RIBBED, ROUND
from tests.peers.peer_path import FRESH, LOADS, curvatures, own_path

felupe_actuator = pytest.importorskip("tests.peers.felupe_actuator", reason="needs felupe")

pytestmark = [pytest.mark.peer, pytest.mark.fem]

ONE_CHAMBER = Geometry(Dimensions(length=14.0, chambers=1))
TWO_CHAMBERS = Geometry(Dimensions(length=20.0, chambers=2))
DEFAULT = Geometry(Dimensions())
COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
FIVE_DECIMALS = 5e-6  # 1/m


def both(geometry, element, material=FRESH, loads=LOADS, layer=None):
    mesh = build_mesh(geometry, COARSEST, element=element)
    ours = own_path(mesh.body, material, loads=loads, layer=layer)
    theirs = felupe_actuator.solve(mesh.body, material, loads=loads, layer=layer)
    return curvatures(mesh, ours.displacements), curvatures(mesh, theirs.displacements)


@pytest.mark.parametrize(
    ("geometry", "element"),
    [
        (TWO_CHAMBERS, LINEAR_CONSTANT),
        (DEFAULT, LINEAR_CONSTANT),
        (ONE_CHAMBER, QUADRATIC_CONSTANT),
        (ONE_CHAMBER, QUADRATIC),
        pytest.param(TWO_CHAMBERS, QUADRATIC_CONSTANT, marks=[pytest.mark.long, pytest.mark.slow]),
        pytest.param(TWO_CHAMBERS, QUADRATIC, marks=[pytest.mark.long, pytest.mark.slow]),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_all_curvatures_agree_to_five_decimals(geometry, element):
    ours, theirs = both(geometry, element)
    assert ours[-1] > 5.0  # a path of large rotations
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=FIVE_DECIMALS)


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
def test_a_ribbed_segment_with_a_film_inside(element):
    """The film lies between bricks, the slits of the other half are not pressed."""
    ours, theirs = both(SegmentGeometry(RIBBED), element, loads=LOADS[:6])
    assert ours[-1] > 1.0
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
def test_straight_channels_beside_the_axis(element):
    ours, theirs = both(SegmentGeometry(CHANNELS), element, loads=LOADS[:6])
    assert ours[-1] > 0.2
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
def test_a_round_section_with_channels(element):
    """Bricks of the ring are bent; the film lies in the plane of the axis."""
    ours, theirs = both(SegmentGeometry(ROUND), element, loads=LOADS[:6])
    assert ours[-1] > 0.1
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("element", [LINEAR_CONSTANT, QUADRATIC], ids=lambda e: e.name)
def test_a_layer_of_another_elastomer(element):
    slab = Constraint("elastomer", thickness=0.8, c1=1.0)
    geometry = SegmentGeometry(RIBBED, constraint=slab)
    stiff = replace(FRESH, bulk_ratio=1e5)
    ours, theirs = both(geometry, element, stiff, LOADS[:6], LayerGroups(8.0, -0.1, 0.02))
    assert ours[-1] > 0.2
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)


def test_a_film_inside_one_half_counts():
    one_half = replace(RIBBED, passive="none", height=4.0)
    found = []
    for constraint in (Constraint("film", 0.8), Constraint("none", 0.8)):
        geometry = SegmentGeometry(one_half, constraint=constraint)
        ours, theirs = both(geometry, LINEAR_CONSTANT, loads=LOADS[:6])
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
        found.append(ours)
    assert np.all(np.abs(found[0] / found[1] - 1.0) > 0.05)


def test_without_paper_too():
    ours, theirs = both(TWO_CHAMBERS, LINEAR_CONSTANT, replace(FRESH, paper_group=0.0))
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=FIVE_DECIMALS)


def test_the_paper_counts_in_the_comparison():
    _, papered = both(TWO_CHAMBERS, LINEAR_CONSTANT)
    _, bare = both(TWO_CHAMBERS, LINEAR_CONSTANT, replace(FRESH, paper_group=0.0))
    assert np.all(np.abs(papered / bare - 1.0) > 0.05)
