"""Small actuators of every geometry, which solve in a fraction of a second."""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator import kernels
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.actuator.status import PathEffort
from bayesdeg.data.families import (
    Constraint,
    CylindricalDimensions,
    MeshDimensions,
    RibbedDimensions,
)
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import with_part
from tests.actuator.parts import half, tetrahedral, write

ONE_ELEMENT_A_WALL = Resolution(along=100.0, across=100.0, up=100.0)
SOFT = MaterialGroups(c2_ratio=-0.01, c3_ratio=0.002, paper_group=200.0, paper_thickness=0.1)
EXACT = PathEffort(tolerance=1e-8, iterations=20, rate_tolerance=1e-9, exact=True)

PNEUNET = Dimensions(length=14.0, chambers=1)
# two slits in each half, a third of a millimetre of film
RIBBED = RibbedDimensions(
    length=9.0,
    width=8.0,
    height=8.0,
    channels=2,
    channel_length=1.0,
    channel_width=5.0,
    channel_height=1.5,
    pitch=3.0,
    cover=1.0,
    passage_width=1.0,
    passage_height=0.6,
)
# two channels in each half beside the plane of symmetry
CHANNELS = CylindricalDimensions(
    length=16.0,
    width=8.0,
    height=8.0,
    channels=2,
    channel_length=12.0,
    channel_width=2.0,
    channel_height=1.5,
    pitch=3.0,
    offset=2.2,
)
ROUND = CylindricalDimensions(
    length=12.0,
    width=9.0,
    height=8.0,
    channel_length=8.0,
    channel_width=2.0,
    channel_height=1.5,
    offset=1.8,
    section="round",
)
SLAB = Constraint("elastomer", thickness=0.8, c1=60.0, c2=-0.5, c3=0.3)

GEOMETRIES = {
    "pneunet": geometry_of(PNEUNET),
    "ribbed": geometry_of(RIBBED),
    "ribbed without layer": geometry_of(RIBBED, Constraint("none")),
    "ribbed with a film above the middle": geometry_of(RIBBED, Constraint("film", 4.6)),
    "ribbed on one side": geometry_of(replace(RIBBED, passive="none")),
    "ribbed with a slab": geometry_of(RIBBED, SLAB),
    "pneunet on a slab": geometry_of(PNEUNET, SLAB),
    "channels": geometry_of(CHANNELS),
    "channels on one side": geometry_of(replace(CHANNELS, passive="none")),
    "round": geometry_of(ROUND),
}
PARTS = {"part of bricks": lambda part: part, "part of tetrahedra": tetrahedral}


def geometry_of_file(path):
    settings, faults = with_part(path.parent, Settings(), MeshDimensions(file=path.name))
    assert faults == ()
    return geometry_of(settings.dimensions, settings.layer)


def geometry_named(name, folder):
    """A geometry; the file of a part is written into a folder."""
    if name in GEOMETRIES:
        return GEOMETRIES[name]
    return geometry_of_file(write(folder / "part.msh", PARTS[name](half())))


def cavity(body, placed=None):
    """Volume enclosed by the faces of a cavity, and its gradient, (n_nodes, 3)."""
    placed = body.nodes if placed is None else placed
    gradient = np.zeros_like(placed)
    form = kernels.volume_form(body.element.order, triangle=body.element.triangular)
    none = np.empty((0, 0, 0), dtype=np.int32)
    volume = kernels.cavity_volume(placed, body.cavity, form, 1.0, gradient, none, np.empty(0))
    return volume, gradient
