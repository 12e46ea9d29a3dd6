"""Trained emulators on disk: the shipped one, and those of other geometries.

They are read and written here; their places and records are handled by `bayesdeg.surrogate.kept`,
which needs no compiled code.
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
from bayesdeg.errors import BayesdegError, ResumableError
from bayesdeg.files import written
from bayesdeg.surrogate.kept import (
    CACHE,
    FIT_VERSION,
    SHIPPED,
    Recipe,
    read_content,
    refuse_other,
    refuse_outdated,
    search,
)
from bayesdeg.surrogate.local import covers
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.surrogate import Surrogate


@dataclass(frozen=True)
class Found:
    """Result of a search for a trained emulator.

    Parameters
    ----------
    surrogate : Surrogate, optional
        None if it must be trained.
    path : Path
        Place of the emulator of this geometry, existing or to be trained.
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
    """Return the emulator of the default geometry shipped with the package.

    Examples
    --------
    >>> default_surrogate().length
    50.0
    """
    return from_bytes(SHIPPED.read_bytes())


def surrogate_for(geometry: Moulded, surrogate: Surrogate | None = None) -> Surrogate:
    """Return an emulator, by default the shipped one, checked to be of this geometry.

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
    """Say which requested output, or range of a dimension, an emulator lacks; empty if none.

    Examples
    --------
    >>> lacking(default_surrogate(), ["tip_force"])
    'the emulator does not predict the tip force'
    """
    missing = [name.replace("_", " ") for name in asked if name not in surrogate.answers]
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
    """Raise BayesdegError if an emulator lacks an output or a range, see `lacking`."""
    if reason := lacking(surrogate, asked, uncertain):
        raise BayesdegError(f"{reason}; 'bayesdeg run STUDY' trains a suitable one")


def read_trained(path: Traversable) -> Surrogate:
    """Return the emulator in a file.

    Raises
    ------
    BayesdegError
        If it cannot be read, is damaged, or is of a different version of the finite element model.
    """
    surrogate = read_content(path, from_bytes)
    refuse_outdated(path, surrogate.record)
    return surrogate


def covering(
    geometry: Moulded, wanted: TrainingRange, cache: Path = CACHE
) -> Iterator[tuple[Path, Surrogate]]:
    """Yield cached emulators of a geometry that cover a range."""
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
    """Mark the record of a refined emulator as requested by a run."""
    facts = json.loads(record)
    facts["refinement"][ASKED_FOR] = True
    return json.dumps(facts, indent=1)


def is_refined(record: str) -> bool:
    """Return whether an emulator was refined where a posterior lies on request of a run.

    Examples
    --------
    >>> is_refined(default_surrogate().record)
    False
    """
    return ASKED_FOR in (json.loads(record).get("refinement") or {})


def not_refined(record: str) -> str:
    """Mark a record as not refinable."""
    return json.dumps(json.loads(record) | {"refinement": None}, indent=1)


def ended_with_refinement(record: str) -> bool:
    """Return whether training ended with a refinement, successful or not.

    Examples
    --------
    >>> ended_with_refinement("{}"), ended_with_refinement(not_refined("{}"))
    (False, True)
    """
    return "refinement" in json.loads(record)


def is_current_fit(record: str) -> bool:
    """Return whether an emulator was fitted by the current method.

    Examples
    --------
    >>> is_current_fit("{}"), is_current_fit(json.dumps({"fit_version": FIT_VERSION}))
    (False, True)
    """
    return bool(json.loads(record).get("fit_version") == FIT_VERSION)


def write_trained(path: Path, surrogate: Surrogate) -> None:
    """Write an emulator to a file, completely or not at all; ResumableError if that fails."""
    try:
        with written(path) as part:
            part.write_bytes(to_bytes(surrogate))
    except ResumableError as fault:
        raise ResumableError(f"{fault}; solutions are not lost") from fault


def find(geometry: Moulded, *, recipe: Recipe | None = None, cache: Path = CACHE) -> Found:
    """Return the trained emulator that `search` finds in the package or in a cache."""
    found = search(geometry, recipe=recipe, cache=cache)
    if found.source is None:
        return Found(None, found.path, found.reason)
    try:
        return Found(read_trained(found.source), found.path)
    except BayesdegError as fault:  # its record is intact, the rest is damaged
        return Found(None, found.path, replace(found, reasons=(*found.reasons, str(fault))).reason)
