"""Results of finished stages, kept so that an interrupted run goes on where it stopped."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


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
            with np.load(path, allow_pickle=False) as stored:
                if str(stored["fingerprint"]) != self.fingerprint:
                    return None
                return {key: stored[key] for key in stored.files if key != "fingerprint"}
        except (OSError, ValueError, KeyError, EOFError):
            return None

    def save(self, name: str, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep the arrays of a stage: whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        part = self.folder / f".{name}.{os.getpid()}.part"
        with part.open("wb") as file:
            np.savez(file, allow_pickle=False, fingerprint=np.array(self.fingerprint), **arrays)
        part.replace(self.folder / f"{name}.npz")

    def clear(self) -> None:
        """Forget everything."""
        for path in self.folder.glob("*.npz"):
            path.unlink()
