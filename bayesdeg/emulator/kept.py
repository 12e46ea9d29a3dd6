"""Where trained emulators are kept and which actuator each is of, without the emulators themselves.

An emulator's record says what it was trained on; to read it needs nothing compiled.
"""

import hashlib
import io
import json
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.version import MODEL_VERSION
from bayesdeg.emulator.recipe import Recipe
from bayesdeg.errors import BayesdegError
from bayesdeg.files import EMULATOR_MB, read_bytes, reason

SHIPPED = files("bayesdeg.emulator") / "default.npz"
# under the working directory, beside the solutions of the campaign
CACHE = Path(".cache/emulators")


@dataclass(frozen=True)
class Search:
    """What a search by records came to.

    Parameters
    ----------
    source : Traversable, optional
        File of the emulator; None if it has to be trained.
    path : Path
        Where the emulator of this geometry is kept, or goes once it is trained.
    reasons : tuple of str
        Why the places that were looked at before have none.
    """

    source: Traversable | None
    path: Path
    reasons: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """Why there is none."""
        return "; ".join(self.reasons) or "no emulator of this geometry has been trained yet"


def other_dimensions(geometry: Geometry, record: str) -> list[str]:
    """Return in words the dimensions of a geometry that an emulator was not trained for."""
    trained = json.loads(record).get("dimensions_mm", {})
    return [
        f"{name} = {value:g} (trained: {trained.get(name, float('nan')):g})"
        for name, value in asdict(geometry.dimensions).items()
        if trained.get(name) != value
    ]


def outdated(record: str) -> str:
    """Say that an emulator is of another version of the finite element model; empty if it is not.

    Examples
    --------
    >>> outdated('{"model_version": "0"}')[:46]
    'was trained on version 0 of the finite element'
    """
    version = json.loads(record).get("model_version", "unknown")
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


def read_content[T](path: Traversable, take: Callable[[bytes], T]) -> T:
    """Return what is taken from the content of an emulator's file.

    Raises
    ------
    BayesdegError
        If it cannot be read or is damaged.
    """
    try:
        content = read_bytes(path, most_mb=EMULATOR_MB)
    except OSError as fault:
        raise BayesdegError(
            f"{path} cannot be read ({reason(fault)}); name a file made by 'bayesdeg emulate'"
        ) from fault
    try:
        return take(content)
    except (OSError, ValueError, LookupError, EOFError, BadZipFile, zlib.error) as fault:
        raise BayesdegError(
            f"{path} is damaged, or no emulator made by 'bayesdeg emulate' ({fault}); "
            "train it again"
        ) from fault


def record_of(content: bytes) -> str:
    """Return what the emulator in a npz file was trained on."""
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return str(stored["record"])


def refuse_outdated(path: Traversable, record: str) -> None:
    """Refuse an emulator of another version of the finite element model.

    Raises
    ------
    BayesdegError
        If it is of another.
    """
    old = outdated(record)
    if old:
        raise BayesdegError(f"{path} {old}; train it again with 'bayesdeg emulate'")


def refuse_other(geometry: Geometry, record: str) -> None:
    """Refuse an emulator of another geometry.

    Raises
    ------
    BayesdegError
        Naming the dimensions that differ.
    """
    changed = other_dimensions(geometry, record)
    if changed:
        raise BayesdegError(
            f"the emulator is of another geometry: {', '.join(changed)}; train one with "
            "'bayesdeg emulate STUDY --out FILE' and give it to 'bayesdeg run' with --emulator FILE"
        )


def search(geometry: Geometry, *, recipe: Recipe | None = None, cache: Path = CACHE) -> Search:
    """Look for a trained emulator of a geometry by records: in the package, then in a cache.

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
        record = read_content(SHIPPED, record_of)
        changed, old = other_dimensions(geometry, record), outdated(record)
        if not changed and not old:
            return Search(SHIPPED, path)
        reasons.append(
            f"the package's emulator is of another geometry: {', '.join(changed)}"
            if changed
            else f"the package's emulator {old}"
        )
    if path.exists():
        try:
            record = read_content(path, record_of)
            refuse_outdated(path, record)
            refuse_other(geometry, record)
            return Search(path, path, tuple(reasons))
        except BayesdegError as fault:
            reasons.append(str(fault))
    return Search(None, path, tuple(reasons))
