"""CalculiX on the same mesh of full eight-node bricks, which lock alike in both programs."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.body import LINEAR_CONSTANT, LINEAR_FULL
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.data.settings import Dimensions
from tests.peers import calculix_actuator
from tests.peers.peer_path import FRESH, LOADS, curvatures, own_path

pytestmark = [
    pytest.mark.peer,
    pytest.mark.fem,
    pytest.mark.skipif(calculix_actuator.program() is None, reason="needs CalculiX's ccx"),
]

BARE = replace(FRESH, paper_group=0.0, bulk_ratio=1e3)
MEDIUM, COARSEST = Resolution(3.0, 3.0, 3.0), Resolution(9.0, 9.0, 9.0)


@pytest.mark.parametrize(
    ("dimensions", "resolution"),
    [
        (Dimensions(length=20.0, chambers=2), MEDIUM),
        pytest.param(Dimensions(), COARSEST, marks=[pytest.mark.long, pytest.mark.slow]),
    ],
    ids=["two chambers", "default actuator"],
)
def test_curvatures_agree_within_a_fifth_of_a_percent(dimensions, resolution, tmp_path):
    mesh = build_mesh(Geometry(dimensions), resolution, element=LINEAR_FULL)
    ours = own_path(mesh.body, BARE, loads=LOADS)
    theirs = calculix_actuator.solve(mesh.body, BARE, loads=LOADS, folder=tmp_path)
    ours, theirs = (curvatures(mesh, path.displacements) for path in (ours, theirs))
    assert np.all(np.diff(ours) > 0.0)
    np.testing.assert_allclose(ours, theirs, rtol=2e-3)


def test_an_element_that_calculix_lacks_is_refused(tmp_path):
    mesh = build_mesh(Geometry(Dimensions()), COARSEST, element=LINEAR_CONSTANT)
    with pytest.raises(ValueError, match="Q1P0"):
        calculix_actuator.solve(mesh.body, BARE, loads=LOADS, folder=tmp_path)
