"""Meshes of the benchmarks of the forward model, by name."""

from bayesdeg.actuator.body import LINEAR_CONSTANT, LINEAR_FULL, QUADRATIC, Element
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import COARSE, CONVERGED, FINE, ActuatorMesh, build_mesh
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions

RESOLUTIONS = {
    "coarsest": Resolution(along=9.0, across=9.0, up=9.0),
    "coarse": COARSE,
    "plain": Resolution(along=3.0, across=2.0, up=2.0),
    "middle": Resolution(along=1.6, across=1.3, up=2.0),
    "fine": FINE,
    "converged": CONVERGED,
}
LADDER = ("coarsest", "plain", "middle", "converged", "fine")
SHORT_LADDER = ("coarsest", "coarse", "plain", "middle")
ELEMENTS = {element.name: element for element in (LINEAR_FULL, LINEAR_CONSTANT, QUADRATIC)}


def named_mesh(name: str, element: Element = QUADRATIC) -> ActuatorMesh:
    """Return one of the meshes of the default geometry."""
    return build_mesh(Geometry(Dimensions()), RESOLUTIONS[name], element=element)
