"""Solved actuators as files: VTU for ParaView, and the surface that the report draws."""

import io
from dataclasses import fields as fields_of
from pathlib import Path
from zipfile import BadZipFile

import meshio  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray
from skfem import ElementHex1, ElementHex2

from bayesdeg.actuator.body import Body, Element
from bayesdeg.errors import BayesdegError
from bayesdeg.files import refuse_special, write_bytes, written
from bayesdeg.report.actuator_fields import NodalFields
from bayesdeg.report.actuator_surface import Shape, Surface

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SURFACE = "deformed.npz"
_CELLS = {1: "hexahedron", 2: "hexahedron27"}
# VTK's nodes of the unit cube: corners, then the middles of edges, of faces, and of the cube
_VTK_NODES = 0.5 * np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)


def vtk_order(element: Element) -> Indices:
    """Return the local node of the brick that stands at each of VTK's places.

    VTK_TRIQUADRATIC_HEXAHEDRON for triquadratic bricks, VTK_HEXAHEDRON for trilinear ones.

    Examples
    --------
    >>> from bayesdeg.actuator.body import LINEAR_CONSTANT
    >>> vtk_order(LINEAR_CONSTANT)
    array([7, 4, 1, 5, 6, 2, 0, 3])
    """
    places = np.asarray((ElementHex1() if element.order == 1 else ElementHex2()).doflocs)
    apart = np.abs(places[None] - _VTK_NODES[: len(places), None]).sum(axis=2)
    order: Indices = np.argmin(apart, axis=1).astype(np.int64)
    return order


def write_vtu(
    path: Path, body: Body, fields: NodalFields, *, linear_scale: float = 1.0, c1: float = 1.0
) -> None:
    """Write a solved body for ParaView and its like: the half y ≥ 0 that was computed.

    Points stand where they were before loading; *Warp By Vector* with ``displacement_mm``
    deforms them, *Reflect* at y = 0 adds the other half.

    Parameters
    ----------
    path : Path
        The file; it appears whole or not at all.
    body : Body
        At moulded size, before loading.
    fields : NodalFields
        Of an equilibrium: ``displacement_mm``, ``largest_principal_stretch``,
        ``mean_stress_MPa`` and ``cauchy_stress_MPa`` (xx, yy, zz, xy, yz, xz), all at nodes.
    linear_scale : float
        True size over moulded size; lengths in the file are true [–].
    c1 : float
        The unit of stress [MPa].

    Examples
    --------
    >>> import tempfile
    >>> from bayesdeg.actuator.body import box
    >>> brick = box((2.0, 1.0, 1.0), divisions=(1, 1, 1))
    >>> still = NodalFields(0 * brick.nodes, np.zeros((27, 3, 3)), np.zeros(27),
    ...     np.tile([1.0, 0.0, 0.0, 0.0], (27, 1)))
    >>> path = Path(tempfile.mkdtemp()) / "brick.vtu"
    >>> write_vtu(path, brick, still, linear_scale=0.5)
    >>> meshio.read(path).points.max(axis=0)
    array([1. , 0.5, 0.5])
    """
    stress = c1 * fields.stress
    order = vtk_order(body.element)
    mesh = meshio.Mesh(
        linear_scale * body.nodes,
        [(_CELLS[body.element.order], body.elements[:, order])],
        point_data={
            "displacement_mm": linear_scale * fields.displacement,
            "largest_principal_stretch": fields.stretch,
            "mean_stress_MPa": c1 * fields.mean_stress,
            "cauchy_stress_MPa": stress[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]],
        },
    )
    with written(path) as part:
        meshio.write(part, mesh, file_format="vtu")


def vtu_name(degradation: float) -> str:
    """Return the name of the VTU file of an actuator at a degradation rate [%].

    Examples
    --------
    >>> vtu_name(12.5)
    'actuator_12.5pct.vtu'
    """
    return f"actuator_{degradation:g}pct.vtu"


def clear_solved(folder: Path) -> None:
    """Remove solved actuators of an earlier run from a run folder."""
    for path in (*folder.glob(vtu_name(0.0).replace("0", "*")), folder / SURFACE):
        path.unlink(missing_ok=True)


def write_surface(folder: Path, surface: Surface) -> None:
    """Write the surface of solved actuators into a run folder."""
    arrays = {
        "faces": surface.faces.astype(np.int32),
        "on_cut": surface.on_cut,
        "in_cavity": surface.in_cavity,
    }
    for field in fields_of(Shape):
        values = np.array([getattr(shape, field.name) for shape in surface.shapes])
        arrays[field.name] = values.astype(np.float32)

    made = io.BytesIO()
    np.savez_compressed(made, allow_pickle=False, **arrays)
    write_bytes(folder / SURFACE, made.getbuffer())


def read_surface(folder: Path) -> Surface | None:
    """Read what `write_surface` wrote; None if there is nothing.

    Raises
    ------
    BayesdegError
        If the file is there but damaged.
    """
    path = folder / SURFACE
    if not path.exists():
        return None
    try:
        refuse_special(path)
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            columns = [stored[field.name].astype(np.float64) for field in fields_of(Shape)]
            surface = Surface(
                stored["faces"].astype(np.int64),
                stored["on_cut"].astype(bool),
                stored["in_cavity"].astype(bool),
                tuple(Shape(*row) for row in zip(*columns, strict=True)),
            )
        _check(surface)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as fault:
        raise BayesdegError(
            f"{path}: {fault}; the file is damaged or from another version: run the study again "
            "with --fresh, or delete the file to leave its figure out of the report"
        ) from fault
    return surface


def _check(surface: Surface) -> None:
    count = {len(a) for a in (surface.faces, surface.on_cut, surface.in_cavity)}
    known = min((len(shape.stretch) for shape in surface.shapes), default=0)
    if len(count) != 1 or surface.faces.shape[1] not in (4, 9):
        raise ValueError("faces and their flags do not go together")
    if not surface.shapes or surface.faces.min() < 0 or surface.faces.max() >= known:
        raise ValueError("a face names a node that is not there")
