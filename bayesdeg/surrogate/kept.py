"""Recipes of emulators, places of trained ones, and rough training times.

An emulator's record says what it was trained on; reading it needs no compiled code.
"""

import hashlib
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import ceil, prod
from pathlib import Path

import numpy as np

from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import CONVERGED, MODEL_VERSION, Backend, Resolution
from bayesdeg.data.families import Constraint, MeshDimensions, Mould
from bayesdeg.data.families import Kind as ActuatorKind
from bayesdeg.data.part import read_part
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.errors import BayesdegError
from bayesdeg.files import EMULATOR_MB, OF_DAMAGED_ARCHIVES, read_bytes, reason


@dataclass(frozen=True)
class Recipe:
    """Training set of an emulator: many curves on a coarse mesh and few on a fine one.

    Parameters
    ----------
    coarse_mesh, fine_mesh : Resolution
        The mesh of the many curves, and the one that the emulator represents.
    coarse_runs, fine_runs : int
        Numbers of curves.
    seed : int
        Seed of the design.
    backend : Backend
        Assembly of the equations.

    Examples
    --------
    >>> Recipe().coarse_runs, Recipe().fine_runs
    (300, 48)
    """

    coarse_mesh: Resolution = field(
        default_factory=lambda: Resolution(along=2.5, across=2.5, up=2.1)
    )
    fine_mesh: Resolution = CONVERGED
    coarse_runs: int = 300
    fine_runs: int = 48
    seed: int = 11
    backend: Backend = Backend.KERNELS


SHIPPED = files("bayesdeg.surrogate") / "default.npz"
# under the working directory, next to the solutions of the campaign
CACHE = Path(".cache/emulators")


@dataclass(frozen=True)
class EmulatorSearch:
    """Result of a search by records.

    Parameters
    ----------
    source : Traversable, optional
        File of the emulator; None if it must be trained.
    path : Path
        Place of the emulator of this geometry, existing or to be trained.
    reasons : tuple of str
        Why earlier places have none.
    """

    source: Traversable | None
    path: Path
    reasons: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """Why there is none."""
        return "; ".join(self.reasons) or "no emulator of this geometry has been trained yet"


def other_dimensions(geometry: Moulded, record: str) -> list[str]:
    """Return in words the dimensions for which an emulator was not trained."""
    facts = json.loads(record)
    trained, shape = facts.get("dimensions_mm", {}), facts.get("geometry")
    unlike = departure(geometry)
    if shape is not None and shape == json.loads(json.dumps(geometry.record())):
        return []
    if unlike or shape is not None:
        return [unlike or "it is of a different kind of actuator"]
    return [
        f"{name} = {value:g} (trained: {trained.get(name, float('nan')):g})"
        for name, value in vars(geometry.dimensions).items()
        if trained.get(name) != value
    ]


def has_ground(geometry: Moulded) -> bool:
    """Return whether an actuator's map has the form of the default one's."""
    return not departure(geometry)


def departure(geometry: Moulded) -> str:
    """Say why an actuator is not a pneunet with paper on its bottom; empty if it is one.

    The whole range of groups is for such pneunets. An emulator of a different actuator is trained
    for one study, over the part that it needs.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> departure(geometry_of(Dimensions()))
    ''
    >>> departure(geometry_of(RibbedDimensions()))
    'it is a ribbed actuator'
    """
    kind = geometry.dimensions.kind
    if kind != "pneunet":
        return f"it is a {kind} actuator"
    if not geometry.constraint.is_there:
        return "it has no constraint layer"
    height = geometry.line_height
    return f"its constraint layer is {height:g} mm above the bottom" if height > 0.0 else ""


# rms error of the fine mesh against convergence. Default pneunet: fresh and degraded, as
# printed by `python benchmarks/forward.py --json` (details of error_pct). Default ribbed segment:
# 1,118 elements are 4 % below 3,498 elements, and these 1.5 % below finer ones, see
# `segment.sizes_about_slits`. Straight channels: `python benchmarks/channel_meshes.py --json`
MESH_ERROR: Mapping[ActuatorKind, float] = {"pneunet": 0.0065, "ribbed": 0.05, "cylindrical": 0.04}
LAYER_MESH_ERROR = 0.01  # of a pneunet with an elastomer layer, by the same command


def mesh_error_of(geometry: Moulded) -> float:
    """Return the relative error of an actuator's fine mesh; for a user's mesh the stated one.

    Examples
    --------
    >>> mesh_error_of(geometry_of(Dimensions()))
    0.0065
    """
    dimensions = geometry.dimensions
    if isinstance(dimensions, MeshDimensions):
        return dimensions.mesh_error
    own = MESH_ERROR[dimensions.kind]
    return max(own, LAYER_MESH_ERROR) if geometry.constraint.is_slab else own


def refuse_whole_range(geometry: Moulded) -> None:
    """Raise BayesdegError for an actuator that is not a pneunet with paper."""
    if reason := departure(geometry):
        raise BayesdegError(
            f"no emulator of the whole range can be trained for this actuator: {reason}, but that "
            "range is for pneunets with paper or film on the bottom; 'bayesdeg run STUDY' trains "
            "one for the study, and ExactMap of bayesdeg.actuator.curve solves without an emulator"
        )


def outdated(record: str) -> str:
    """Say that an emulator is of a different version of the finite element model; empty if not.

    Examples
    --------
    >>> outdated('{"model_version": "0"}')[:46]
    'was trained on version 0 of the finite element'
    """
    version = json.loads(record).get("model_version", "unknown")
    if version == MODEL_VERSION:
        return ""
    return f"was trained on version {version} of the finite element model, this is {MODEL_VERSION}"


def cached_path(geometry: Moulded, recipe: Recipe, cache: Path = CACHE) -> Path:
    """Return the file of an emulator, named by dimensions and recipe.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> one, other = (Geometry(Dimensions(length=mm)) for mm in (50.0, 60.0))
    >>> cached_path(one, Recipe()) == cached_path(other, Recipe())
    False
    """
    trained_on = asdict(recipe)
    if recipe.backend is Backend.KERNELS:  # names from before there were other backends
        trained_on.pop("backend")
    content = json.dumps([geometry.record(), trained_on])
    content = json.dumps(json.loads(content, parse_int=float), sort_keys=True)  # 60 and 60.0
    return cache / f"{hashlib.sha256(content.encode()).hexdigest()[:16]}.npz"


def read_content[T](path: Traversable, take: Callable[[bytes], T]) -> T:
    """Apply a reader to the content of an emulator's file; BayesdegError if it is damaged."""
    try:
        content = read_bytes(path, most_mb=EMULATOR_MB)
    except OSError as fault:
        raise BayesdegError(
            f"{path} cannot be read ({reason(fault)}); name a file made by 'bayesdeg emulate'"
        ) from fault
    try:
        return take(content)
    except OF_DAMAGED_ARCHIVES as fault:
        raise BayesdegError(
            f"{path} is damaged, or not an emulator made by 'bayesdeg emulate' ({fault}); "
            "train it again"
        ) from fault


def record_of(content: bytes) -> str:
    """Return what the emulator in a npz file was trained on."""
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return str(stored["record"])


def backend_of(record: str) -> Backend:
    """Return the backend that assembled an emulator's equations.

    Examples
    --------
    >>> backend_of("{}")
    <Backend.KERNELS: 'kernels'>
    """
    return Backend(json.loads(record).get("backend", Backend.KERNELS))


def refuse_outdated(path: Traversable, record: str) -> None:
    """Raise BayesdegError for an emulator of a different version of the finite element model."""
    if old := outdated(record):
        raise BayesdegError(f"{path} {old}; train it again with 'bayesdeg emulate'")


def refuse_other(geometry: Moulded, record: str) -> None:
    """Raise BayesdegError for an emulator of a different geometry, naming what differs."""
    if changed := other_dimensions(geometry, record):
        raise BayesdegError(
            f"the emulator is of a different geometry: {', '.join(changed)}; train one with "
            "'bayesdeg emulate STUDY --out FILE' and pass it to 'bayesdeg run' with --emulator FILE"
        )


def search(
    geometry: Moulded, *, recipe: Recipe | None = None, cache: Path = CACHE
) -> EmulatorSearch:
    """Look for a trained emulator of a geometry by records: in the package, then in a cache.

    The package's has the default recipe, which is the default here.
    """
    recipe = recipe or Recipe()
    path = cached_path(geometry, recipe, cache)
    unlike = departure(geometry)
    if unlike:  # trained ones are for one study each
        return EmulatorSearch(None, path, (f"the package has no emulator of it: {unlike}",))
    reasons = []
    if recipe == Recipe():  # not with a different backend
        record = read_content(SHIPPED, record_of)
        changed, old = other_dimensions(geometry, record), outdated(record)
        if not changed and not old:
            return EmulatorSearch(SHIPPED, path)
        reasons.append(
            f"the package's emulator is of a different geometry: {', '.join(changed)}"
            if changed
            else f"the package's emulator {old}"
        )
    if path.exists():
        try:
            record = read_content(path, record_of)
            refuse_outdated(path, record)
            refuse_other(geometry, record)
            return EmulatorSearch(path, path, tuple(reasons))
        except BayesdegError as fault:
            reasons.append(str(fault))
    return EmulatorSearch(None, path, tuple(reasons))


FIT_VERSION = "5"  # raised when the same curves give a different emulator: it is then refitted
COARSE_RUNS, FINE_RUNS = 24, 4
"""Number of curves of an emulator for one study, on either mesh."""
DEPARTING, DEPARTING_FINE = 12, 1
"""Number of them solved with each uncertain dimension moved either way, on either mesh. For a
roof of 2 ± 0.2 mm eight coarse curves instead of twelve triple the held-out error, and a second
fine one changes nothing."""
PAIRED = 6
"""Number of them solved with two dimensions moved by a step together, per pair."""
# time of a curve of the default geometry on one core (studies/scaling.md) [s]
COARSE_SECONDS, FINE_SECONDS = 5.5, 50.0
FITTING_SECONDS = 10.0
# of the default pneunet, as for `Moulded.mesh_like`: a default ribbed segment then has 684 and
# 1,118 elements, and its slits one along and in the depth
SLIT_COARSE = Resolution(along=2.0, across=1.25, up=5.0)
SLIT_FINE = Resolution(along=2.0, across=0.92, up=1.79)
# of straight channels: two elements in a channel's smaller side, and three
CHANNEL_COARSE = Resolution(along=1.0, across=1.4, up=1.8, grading=0.75)
CHANNEL_FINE = Resolution(along=1.0, across=0.94, up=1.21, grading=0.75)
MESHES: Mapping[ActuatorKind, tuple[Resolution, Resolution]] = {
    "pneunet": (Recipe().coarse_mesh, Recipe().fine_mesh),
    "ribbed": (SLIT_COARSE, SLIT_FINE),
    "cylindrical": (CHANNEL_COARSE, CHANNEL_FINE),
}


AT_THE_POSTERIOR = 16
"""Fine curves at the end of the training of a pneunet's emulator for one study; more follow if they
are too few."""


def local_recipe(dimensions: Mould) -> Recipe:
    """Return meshes and numbers of curves of an emulator for one study.

    Element sizes scale with the size of the actuator: the error of a mesh depends only on its
    shape. For a family whose slits need many elements, both meshes are the coarsest that divide
    cover and slits.

    Examples
    --------
    >>> larger = local_recipe(Dimensions(length=100.0, width=20.0, height=20.0))
    >>> round(larger.fine_mesh.along / Recipe().fine_mesh.along, 12)
    2.0
    """
    if isinstance(dimensions, MeshDimensions):  # a single mesh, solved twice for a few curves
        return Recipe(coarse_runs=COARSE_RUNS, fine_runs=FINE_RUNS)
    shape = geometry_of(dimensions)
    coarse, fine = (shape.mesh_like(mesh) for mesh in MESHES[dimensions.kind])
    return Recipe(coarse, fine, COARSE_RUNS, FINE_RUNS)


def rough_seconds(
    dimensions: Mould,
    constraint: Constraint | None = None,
    *,
    workers: int = 1,
    moved: Sequence[UncertainDimension] = (),
    alone: bool = False,
) -> float:
    """Return the approximate time to train an emulator for a study [s].

    The time of a curve is assumed proportional to the number of elements; it is longer for wider or
    higher meshes. The campaign itself measures it. Additional curves are solved for ``moved``
    dimensions; if ``alone``, an emulator of the nominal actuator exists already.

    Examples
    --------
    >>> round(rough_seconds(Dimensions()) / 60.0)
    19
    >>> rough_seconds(Dimensions(length=100.0), workers=2) > rough_seconds(Dimensions(), workers=2)
    True
    """
    recipe, usual = local_recipe(dimensions), Recipe()
    shape, plain = geometry_of(dimensions, constraint), geometry_of(Dimensions())
    coarse = _elements(shape, recipe.coarse_mesh) / _elements(plain, usual.coarse_mesh)
    fine = _elements(shape, recipe.fine_mesh) / _elements(plain, usual.fine_mesh)
    many, few = (DEPARTING, DEPARTING_FINE) if alone else (COARSE_RUNS, FINE_RUNS)
    pairs = len(moved) * (len(moved) - 1) // 2
    many += 2 * len(moved) * DEPARTING + pairs * PAIRED
    few += 2 * len(moved) * DEPARTING_FINE
    if has_ground(shape) and not alone:
        few += AT_THE_POSTERIOR
    curves = many * COARSE_SECONDS * coarse + few * FINE_SECONDS * fine
    return curves / max(1, workers) + FITTING_SECONDS


def _elements(shape: Moulded, mesh: Resolution) -> int:
    mould = shape.dimensions
    if isinstance(mould, MeshDimensions):
        return len(read_part(Path(mould.path)).cells)
    if mould.kind != "pneunet":  # channel planes divide it more than element size does
        sizes = (mesh.along, mesh.across, mesh.up)
        planes = zip(shape.planes(), sizes, strict=True)
        return prod(int(np.ceil(np.diff(axis) / size).sum()) for axis, size in planes)
    # there is air between the planes of slots, so outer sizes are a better measure
    along, across = ceil(mould.length / mesh.along), ceil(mould.width / 2.0 / mesh.across)
    layer = ceil(shape.constraint.thickness / mesh.up) if shape.constraint.is_slab else 0
    return along * across * (ceil(mould.height / mesh.up) + layer)


def duration(seconds: float) -> str:
    """Word an expected time in minutes.

    Examples
    --------
    >>> duration(20.0), duration(500.0), duration(9000.0)
    ('less than a minute', 'about 8 min', 'about 2 h 30 min')
    """
    if seconds < 60.0:
        return "less than a minute"
    minutes = round(seconds / 60.0)
    return f"about {minutes} min" if minutes < 60 else f"about {minutes // 60} h {minutes % 60} min"
