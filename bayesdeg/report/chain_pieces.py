"""Pieces of a chain as HDF5 files, one each, so that a killed run goes on where it was.

An HDF5 file does not survive its writer being killed; a file that appears whole under its name,
or not at all, does.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from bayesdeg.files import refuse_special, write_bytes
from bayesdeg.inference.sampling import Piece, digest

ENDING = ".h5"


@dataclass(frozen=True)
class ChainPieces:
    """Pieces of one chain in a folder.

    Each file holds ``chain``, ``log_prob``, ``acceptance``, ``refusals`` and the state of the
    random numbers after it; its attributes say what it follows from, and a hash of all arrays.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    fingerprint : str
        Hash of everything else that the chain depends on, such as the density.
    damaged : list of Path
        Files that were found damaged; their pieces are computed again.
    """

    folder: Path
    fingerprint: str
    damaged: list[Path] = field(default_factory=list)

    def load(self, ensemble: int, number: int, key: str) -> Piece | None:
        """Return a piece if it is there, whole, and of the task with this key."""
        path = self._path(ensemble, number)
        if not path.exists():
            return None
        try:
            refuse_special(path)
            with h5py.File(path, "r") as file:
                owner = (str(file.attrs["fingerprint"]), str(file.attrs["key"]))
                arrays = {name: np.asarray(file[name]) for name in file}
                whole = str(file.attrs["digest"]) == digest(arrays)
            if whole:
                return Piece.from_arrays(arrays) if owner == (self.fingerprint, key) else None
        except (OSError, KeyError, ValueError, RuntimeError, TypeError):
            pass  # whatever h5py says of a file that is none
        self.damaged.append(path)
        return None

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Keep a piece: whole or not at all."""
        arrays = piece.arrays()
        made = io.BytesIO()
        with h5py.File(made, "w") as file:
            for name, array in arrays.items():
                file.create_dataset(name, data=array)
            file.attrs["fingerprint"] = self.fingerprint
            file.attrs["key"] = key
            file.attrs["digest"] = digest(arrays)
        write_bytes(self._path(ensemble, number), made.getbuffer())

    def _path(self, ensemble: int, number: int) -> Path:
        return self.folder / f"ensemble-{ensemble}-{number:03d}{ENDING}"


def save_arrays(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Keep arrays as ``npz``: whole or not at all."""
    made = io.BytesIO()
    np.savez(made, allow_pickle=False, **arrays)
    write_bytes(path, made.getbuffer())
