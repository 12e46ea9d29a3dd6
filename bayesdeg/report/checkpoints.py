"""What a run keeps so that it goes on where it was stopped: finished stages, pieces of chains.

An HDF5 file does not survive its writer being killed; a file that appears whole under its name,
or not at all, does.
"""

import io
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol
from zipfile import BadZipFile

import h5py
import numpy as np
from numpy.typing import NDArray

from bayesdeg.files import refuse_special, write_bytes
from bayesdeg.inference.sampling import ChainStore, NoStore, Piece, digest

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


class Stages(Protocol):
    """Where the results of finished stages are kept, if anywhere."""

    def load(self, name: str) -> dict[str, NDArray[np.float64]] | None:
        """Return the arrays of a stage; None if they are not there."""

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep the arrays of a stage."""

    def chain(self, name: str) -> "Pieces":
        """Return where the pieces of a chain are kept."""


class Pieces(ChainStore, Protocol):
    """Where the pieces of a chain are kept."""

    @property
    def damaged(self) -> list[Path]:
        """Files that were found damaged."""


@dataclass(frozen=True)
class NoPieces(NoStore):
    """Keeps no piece of a chain."""

    damaged: list[Path] = field(default_factory=list)


@dataclass(frozen=True)
class NoCheckpoints:
    """Keeps nothing: for calibrations whose result stays in memory."""

    def load(self, name: str) -> None:
        """Return None."""

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Do nothing."""

    def chain(self, name: str) -> NoPieces:
        """Return what keeps nothing."""
        return NoPieces()


@dataclass(frozen=True)
class Checkpoints:
    """Arrays of finished stages in a folder, valid for one fingerprint of the inputs.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    fingerprint : str
        Hash of everything that the results depend on; results of another one are not read.
    """

    folder: Path
    fingerprint: str

    def load(self, name: str) -> dict[str, NDArray[np.float64]] | None:
        """Return the arrays of a stage; None if they are not there, of other inputs, or broken."""
        path = self.folder / f"{name}.npz"
        try:
            refuse_special(path)
            with np.load(path, allow_pickle=False) as stored:
                if str(stored["fingerprint"]) != self.fingerprint:
                    return None
                return {key: stored[key] for key in stored.files if key != "fingerprint"}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error):
            return None

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep the arrays of a stage: whole or not at all."""
        labelled = {"fingerprint": np.array(self.fingerprint), **arrays}
        save_arrays(self.folder / f"{name}.npz", labelled)

    def chain(self, name: str) -> ChainPieces:
        """Return where the pieces of a chain are kept."""
        return ChainPieces(self.folder / f"chain-{name}", self.fingerprint)

    def clear(self) -> None:
        """Forget everything."""
        for pattern in ("*.npz", f"chain-*/*{ENDING}", "**/.*.part"):
            for path in self.folder.glob(pattern):
                path.unlink()
