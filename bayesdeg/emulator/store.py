"""Trained emulators on disk: the one that ships with the package, and others."""

import io
import json
from importlib.resources import files

import numpy as np

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.errors import BayesdegError

SHIPPED = "default.npz"


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
    trained = json.loads(surrogate.record)["dimensions_mm"]
    wanted = vars(geometry.dimensions)
    changed = [
        f"{k} = {wanted[k]:g} (trained: {v:g})" for k, v in trained.items() if wanted[k] != v
    ]
    if changed:
        raise BayesdegError(
            f"the emulator is of another geometry: {', '.join(changed)}; train one with "
            "'bayesdeg emulate STUDY --out FILE' and give it to 'bayesdeg run' with --emulator FILE"
        )
    return surrogate
