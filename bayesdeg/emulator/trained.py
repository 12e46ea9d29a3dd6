"""Trained emulators on disk: the one that ships with the package, and those of other geometries."""

import hashlib
import io
import json
import os
import zlib
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from bayesdeg.actuator.curve import MODEL_VERSION
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.emulator.recipe import Recipe
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.errors import BayesdegError

SHIPPED = "default.npz"
# under the working directory, beside the solutions of the campaign
CACHE = Path(".cache/emulators")


@dataclass(frozen=True)
class Found:
    """What a search for a trained emulator came to.

    Parameters
    ----------
    surrogate : Surrogate, optional
        None if it has to be trained.
    path : Path
        Where the emulator of this geometry is kept, or goes once it is trained.
    reason : str
        Why there is none; empty if there is one.
    """

    surrogate: Surrogate | None
    path: Path
    reason: str = ""


def to_bytes(surrogate: Surrogate) -> bytes:
    """Return a surrogate as the content of a npz file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **surrogate.to_arrays())
    return buffer.getvalue()


def from_bytes(content: bytes) -> Surrogate:
    """Return the surrogate of a npz file's content."""
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return Surrogate.from_arrays({name: stored[name] for name in stored.files})


def default_surrogate() -> Surrogate:
    """Return the emulator of the default geometry that ships with the package.

    Examples
    --------
    >>> default_surrogate().length
    50.0
    """
    return from_bytes((files("bayesdeg.emulator") / SHIPPED).read_bytes())


def surrogate_for(geometry: Geometry, surrogate: Surrogate | None = None) -> Surrogate:
    """Return an emulator if it is of this geometry.

    Parameters
    ----------
    geometry : Geometry
        The actuator of the study.
    surrogate : Surrogate, optional
        By default the one that ships with the package.

    Raises
    ------
    BayesdegError
        If it is not, naming the dimensions that differ.
    """
    surrogate = surrogate or default_surrogate()
    changed = other_dimensions(geometry, surrogate)
    if changed:
        raise BayesdegError(
            f"the emulator is of another geometry: {', '.join(changed)}; train one with "
            "'bayesdeg emulate STUDY --out FILE' and give it to 'bayesdeg run' with --emulator FILE"
        )
    return surrogate


def other_dimensions(geometry: Geometry, surrogate: Surrogate) -> list[str]:
    """Return in words the dimensions of a geometry that an emulator was not trained for."""
    trained = json.loads(surrogate.record).get("dimensions_mm", {})
    return [
        f"{name} = {value:g} (trained: {trained.get(name, float('nan')):g})"
        for name, value in asdict(geometry.dimensions).items()
        if trained.get(name) != value
    ]


def outdated(surrogate: Surrogate) -> str:
    """Say that an emulator is of another version of the finite element model; empty if it is not.

    Examples
    --------
    >>> from dataclasses import replace
    >>> outdated(replace(default_surrogate(), record='{"model_version": "0"}'))[:46]
    'was trained on version 0 of the finite element'
    """
    version = json.loads(surrogate.record).get("model_version", "unknown")
    if version == MODEL_VERSION:
        return ""
    return f"was trained on version {version} of the finite element model, this is {MODEL_VERSION}"


def cached_path(geometry: Geometry, recipe: Recipe, cache: Path = CACHE) -> Path:
    """Return where the emulator of a geometry is kept: named by dimensions and recipe.

    Examples
    --------
    >>> from bayesdeg.measure.settings import Dimensions
    >>> one, other = (Geometry(Dimensions(length=mm)) for mm in (50.0, 60.0))
    >>> cached_path(one, Recipe()) == cached_path(other, Recipe())
    False
    """
    content = json.dumps([asdict(geometry), asdict(recipe)])
    content = json.dumps(json.loads(content, parse_int=float), sort_keys=True)  # 60 and 60.0
    return cache / f"{hashlib.sha256(content.encode()).hexdigest()[:16]}.npz"


def read_trained(path: Path) -> Surrogate:
    """Return the emulator in a file.

    Raises
    ------
    BayesdegError
        If it cannot be read, is damaged, or is of another version of the finite element model.
    """
    try:
        content = path.read_bytes()
    except OSError as fault:
        raise BayesdegError(
            f"{path} cannot be read ({fault.strerror}); name a file made by 'bayesdeg emulate'"
        ) from fault
    try:
        surrogate = from_bytes(content)
        old = outdated(surrogate)
    except (OSError, ValueError, LookupError, EOFError, BadZipFile, zlib.error) as fault:
        raise BayesdegError(
            f"{path} is damaged, or no emulator made by 'bayesdeg emulate' ({fault}); "
            "train it again"
        ) from fault
    if old:
        raise BayesdegError(f"{path} {old}; train it again with 'bayesdeg emulate'")
    return surrogate


def write_trained(path: Path, surrogate: Surrogate) -> None:
    """Keep an emulator in a file: whole or not at all.

    Raises
    ------
    BayesdegError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            with part.open("wb") as file:
                file.write(to_bytes(surrogate))
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as fault:
        raise BayesdegError(
            f"the emulator cannot be written to {path} ({fault.strerror}); make room or name "
            "another place; nothing that was solved is lost"
        ) from fault


def find(geometry: Geometry, *, recipe: Recipe | None = None, cache: Path = CACHE) -> Found:
    """Look for a trained emulator of a geometry: first in the package, then in a cache.

    Parameters
    ----------
    geometry : Geometry
        The actuator of the study.
    recipe : Recipe, optional
        What it shall be trained on; the package's is of the default recipe.
    cache : Path
        Folder of emulators of other geometries.
    """
    recipe = recipe or Recipe()
    path = cached_path(geometry, recipe, cache)
    reasons = []
    if recipe == Recipe():
        shipped = default_surrogate()
        changed, old = other_dimensions(geometry, shipped), outdated(shipped)
        if not changed and not old:
            return Found(shipped, path)
        reasons.append(
            f"the package's emulator is of another geometry: {', '.join(changed)}"
            if changed
            else f"the package's emulator {old}"
        )
    if path.exists():
        try:
            return Found(surrogate_for(geometry, read_trained(path)), path)
        except BayesdegError as fault:
            reasons.append(str(fault))
    return Found(
        None, path, "; ".join(reasons) or "no emulator of this geometry has been trained yet"
    )
