"""Results of finished stages, kept so that an interrupted run goes on where it stopped."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from bayesdeg.files import refuse_special
from bayesdeg.inference.sampling import ChainStore, NoStore
from bayesdeg.report.chain_pieces import ENDING, ChainPieces, save_arrays


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
