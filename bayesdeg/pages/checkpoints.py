"""Checkpoints of an interrupted run: finished stages and pieces of chains.

Each file appears whole under its name or not at all, so a killed process leaves no partial file.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.files import OF_DAMAGED_ARCHIVES, refuse_special, write_bytes
from bayesdeg.inference.sampling import ChainStore, NoStore, Piece, digest

ENDING = ".npz"
LABELS = ("fingerprint", "key", "digest")


@dataclass(frozen=True)
class ChainPieces:
    """Pieces of one chain in a folder.

    Each file holds ``chain``, ``log_prob``, ``acceptance``, ``refusals``, the state of the
    random numbers after it, the key of what it follows from, and a hash of all arrays.

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
        """Return a piece if it exists, is whole and belongs to the task with this key."""
        path = self._path(ensemble, number)
        if not path.exists():
            return None
        try:
            arrays = load_arrays(path)
            fingerprint, follows, whole = (str(arrays.pop(name)) for name in LABELS)
            if whole == digest(arrays):
                is_current = (fingerprint, follows) == (self.fingerprint, key)
                return Piece.from_arrays(arrays) if is_current else None
        except OF_DAMAGED_ARCHIVES:
            pass
        self.damaged.append(path)
        return None

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Keep a piece: whole or not at all."""
        arrays = piece.arrays()
        labels = dict(zip(LABELS, (self.fingerprint, key, digest(arrays)), strict=True))
        labelled = {name: np.array(text) for name, text in labels.items()}
        save_arrays(self._path(ensemble, number), arrays | labelled)

    def _path(self, ensemble: int, number: int) -> Path:
        return self.folder / f"ensemble-{ensemble}-{number:03d}{ENDING}"


def save_arrays(path: Path, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Keep arrays as ``npz``: whole or not at all."""
    made = io.BytesIO()
    np.savez(made, allow_pickle=False, **arrays)
    write_bytes(path, made.getbuffer())


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read arrays of `save_arrays`; a damaged file raises one of `OF_DAMAGED_ARCHIVES`."""
    refuse_special(path)
    with path.open("rb") as content, np.load(content, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


class Stages(Protocol):
    """Where the results of finished stages are kept, if anywhere."""

    def load(self, name: str) -> dict[str, NDArray[np.float64]] | None:
        """Return the arrays of a stage; None if there are none."""

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
    """A store that keeps no pieces of a chain."""

    damaged: list[Path] = field(default_factory=list)


@dataclass(frozen=True)
class NoCheckpoints:
    """A store that keeps nothing, for calibrations whose result stays in memory."""

    def load(self, name: str) -> None:
        """Return None."""

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Do nothing."""

    def chain(self, name: str) -> NoPieces:
        """Return a store that keeps nothing."""
        return NoPieces()


@dataclass(frozen=True)
class Checkpoints:
    """Arrays of finished stages in a folder, valid for one fingerprint of the inputs.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    fingerprint : str
        Hash of everything that the results depend on; results with a different one are not read.
    """

    folder: Path
    fingerprint: str

    def load(self, name: str) -> dict[str, NDArray[np.float64]] | None:
        """Return the arrays of a stage; None if absent, of different inputs or damaged."""
        path = self.folder / f"{name}{ENDING}"
        try:
            arrays = load_arrays(path)
            return arrays if str(arrays.pop("fingerprint")) == self.fingerprint else None
        except OF_DAMAGED_ARCHIVES:
            return None

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep the arrays of a stage: whole or not at all."""
        labelled = {"fingerprint": np.array(self.fingerprint), **arrays}
        save_arrays(self.folder / f"{name}{ENDING}", labelled)

    def chain(self, name: str) -> ChainPieces:
        """Return where the pieces of a chain are kept."""
        return ChainPieces(self.folder / f"chain-{name}", self.fingerprint)

    def clear(self) -> None:
        """Forget everything."""
        for pattern in (f"*{ENDING}", f"chain-*/*{ENDING}", "**/.*.part"):
            for path in self.folder.glob(pattern):
                path.unlink()
