"""Trained emulators on disk: the one that ships, and those of other geometries.

They are read and written here; where they are kept, and what their records say, is in
`bayesdeg.emulator.kept`, which needs nothing compiled.
"""

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from pathlib import Path

import numpy as np

from bayesdeg.actuator.inputs import Asked
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.emulator.kept import (
    CACHE,
    FIT_VERSION,
    SHIPPED,
    Recipe,
    read_content,
    refuse_other,
    refuse_outdated,
    search,
)
from bayesdeg.emulator.local import covers
from bayesdeg.emulator.scaling import TrainingRange
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.errors import BayesdegError, ResumableError
from bayesdeg.files import written


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
    return from_bytes(SHIPPED.read_bytes())


def surrogate_for(geometry: Moulded, surrogate: Surrogate | None = None) -> Surrogate:
    """Return an emulator if it is of this geometry.

    Parameters
    ----------
    geometry : Moulded
        The actuator of the study.
    surrogate : Surrogate, optional
        By default the one that ships with the package.

    Raises
    ------
    BayesdegError
        If it is not, naming the dimensions that differ.
    """
    surrogate = surrogate or default_surrogate()
    refuse_other(geometry, surrogate.record)
    return surrogate


def lacking(
    surrogate: Surrogate,
    asked: Sequence[Asked],
    uncertain: Sequence[UncertainDimension] = (),
) -> str:
    """Say what an emulator does not answer of what is asked beside the shape; empty if nothing.

    Parameters
    ----------
    surrogate : Surrogate
        Any.
    asked : sequence of str
        Beside the shape.
    uncertain : sequence of UncertainDimension
        Over whose ranges it must answer.

    Examples
    --------
    >>> lacking(default_surrogate(), ["cavity_volume"])
    'the emulator does not predict the cavity volume'
    """
    missing = [name.replace("_", " ") for name in asked if name not in surrogate.further]
    if missing:
        return f"the emulator does not predict the {' or the '.join(missing)}"
    known = surrogate.departure
    for one in uncertain:
        if known is None or not known.covers(one.name, one.low, one.high):
            return (
                f"the emulator was not trained for {one.name} from {one.low:.4g} to "
                f"{one.high:.4g} mm"
            )
    return ""


def refuse_lacking(
    surrogate: Surrogate,
    asked: Sequence[Asked],
    uncertain: Sequence[UncertainDimension] = (),
) -> None:
    """Refuse an emulator that does not answer what is asked beside the shape.

    Raises
    ------
    BayesdegError
        Saying what it lacks, and what to do.
    """
    reason = lacking(surrogate, asked, uncertain)
    if reason:
        raise BayesdegError(
            f"{reason}; 'bayesdeg run STUDY' trains one that does, where the study lies"
        )


def read_trained(path: Traversable) -> Surrogate:
    """Return the emulator in a file.

    Raises
    ------
    BayesdegError
        If it cannot be read, is damaged, or is of another version of the finite element model.
    """
    surrogate = read_content(path, from_bytes)
    refuse_outdated(path, surrogate.record)
    return surrogate


def covering(
    geometry: Moulded, wanted: TrainingRange, cache: Path = CACHE
) -> Iterator[tuple[Path, Surrogate]]:
    """Yield the emulators of a geometry in a cache that answer over all of a range."""
    for path in sorted(cache.glob("*.npz")):
        try:
            surrogate = read_trained(path)
            refuse_other(geometry, surrogate.record)
        except BayesdegError:
            continue
        if covers(surrogate.span, wanted):
            yield path, surrogate


ASKED_FOR = "asked_for"


def asked_for(record: str) -> str:
    """Return the record of a refined emulator that says that a run asked for it."""
    facts = json.loads(record)
    facts["refinement"][ASKED_FOR] = True
    return json.dumps(facts, indent=1)


def is_refined(record: str) -> bool:
    """Return whether an emulator was corrected where one posterior lies since a run asked for it.

    Examples
    --------
    >>> is_refined(default_surrogate().record)
    False
    """
    return ASKED_FOR in (json.loads(record).get("refinement") or {})


def not_refined(record: str) -> str:
    """Return a record that says that nothing was there to refine an emulator by."""
    return json.dumps(json.loads(record) | {"refinement": None}, indent=1)


def went_to_its_end(record: str) -> bool:
    """Return whether training ended with what refines an emulator, be it in vain.

    Examples
    --------
    >>> went_to_its_end("{}"), went_to_its_end(not_refined("{}"))
    (False, True)
    """
    return "refinement" in json.loads(record)


def is_fitted_as_now(record: str) -> bool:
    """Return whether an emulator is what its curves would give today.

    Examples
    --------
    >>> is_fitted_as_now("{}"), is_fitted_as_now(json.dumps({"fit_version": FIT_VERSION}))
    (False, True)
    """
    return bool(json.loads(record).get("fit_version") == FIT_VERSION)


def write_trained(path: Path, surrogate: Surrogate) -> None:
    """Keep an emulator in a file: whole or not at all.

    Raises
    ------
    ResumableError
        If the file cannot be written; nothing that was solved is lost.
    """
    try:
        with written(path) as part:
            part.write_bytes(to_bytes(surrogate))
    except ResumableError as fault:
        raise ResumableError(f"{fault}; nothing that was solved is lost") from fault


def find(geometry: Moulded, *, recipe: Recipe | None = None, cache: Path = CACHE) -> Found:
    """Look for a trained emulator of a geometry: first in the package, then in a cache.

    Parameters
    ----------
    geometry : Moulded
        The actuator of the study.
    recipe : Recipe, optional
        What it shall be trained on; the package's is of the default recipe.
    cache : Path
        Folder of emulators of other geometries.
    """
    found = search(geometry, recipe=recipe, cache=cache)
    if found.source is None:
        return Found(None, found.path, found.reason)
    try:
        return Found(read_trained(found.source), found.path)
    except BayesdegError as fault:  # its record was whole, the rest is not
        return Found(None, found.path, replace(found, reasons=(*found.reasons, str(fault))).reason)
