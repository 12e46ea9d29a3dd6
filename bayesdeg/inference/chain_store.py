"""What an ensemble does between two looks: the task, the piece of chain, and where it is kept."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.proposals import Proposal
from bayesdeg.inference.refusals import Refusals

Floats = NDArray[np.float64]
Arrays = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True)
class RandomState:
    """State of a Mersenne twister, as emcee has it.

    Parameters
    ----------
    keys : array of uint32, shape (624,)
    position : int
        Within the keys.
    has_spare : int
        Whether the second of a pair of normal numbers waits.
    spare : float
        That number.
    """

    keys: NDArray[np.uint32]
    position: int
    has_spare: int
    spare: float

    def legacy(self) -> tuple[str, NDArray[np.uint32], int, int, float]:
        """Return the tuple that ``RandomState.set_state`` takes."""
        return ("MT19937", self.keys, self.position, self.has_spare, self.spare)


@dataclass(frozen=True)
class Position:
    """Where an ensemble is.

    Parameters
    ----------
    vectors : array, shape (n_walkers, n_parameters)
    log_prob : array, shape (n_walkers,)
    random : RandomState
    """

    vectors: Floats
    log_prob: Floats
    random: RandomState


@dataclass(frozen=True)
class Task:
    """All that decides what an ensemble does next, but for the density.

    Parameters
    ----------
    position : Position
        Where it begins.
    proposal : Proposal
        Law that moves are made of.
    steps : int
        How many.
    """

    position: Position
    proposal: Proposal
    steps: int

    def key(self) -> str:
        """Return a hash of the task's very bits."""
        position, warp = self.position, self.proposal.warp
        parts: tuple[NDArray[np.generic], ...] = (
            position.vectors,
            position.log_prob,
            position.random.keys,
            np.array([position.random.position, position.random.has_spare, self.steps]),
            np.array([position.random.spare]),
            *(warp.location, warp.scale, warp.skewness, warp.tail),
            *(self.proposal.mean, self.proposal.factor),
        )
        return digest({str(i): part for i, part in enumerate(parts)})


@dataclass(frozen=True)
class Piece:
    """What an ensemble did.

    Parameters
    ----------
    vectors : array, shape (n_steps, n_walkers, n_parameters)
    log_prob : array, shape (n_steps, n_walkers)
    acceptance : float
        Accepted share of proposals.
    refusals : Refusals
        Of the emulator.
    random : RandomState
        At the end.
    """

    vectors: Floats
    log_prob: Floats
    acceptance: float
    refusals: Refusals
    random: RandomState

    @property
    def end(self) -> Position:
        """Where the ensemble is at the end."""
        return Position(self.vectors[-1], self.log_prob[-1], self.random)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return everything as arrays by name."""
        random = self.random
        return {
            "chain": self.vectors,
            "log_prob": self.log_prob,
            "acceptance": np.array([self.acceptance]),
            "refusals": np.array([self.refusals.proposed, self.refusals.refused]),
            "random_keys": random.keys,
            "random_position": np.array([random.position, random.has_spare]),
            "random_spare": np.array([random.spare]),
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> "Piece":
        """Return the piece of what ``arrays`` gave."""
        position, has_spare = (int(v) for v in arrays["random_position"])
        keys = np.asarray(arrays["random_keys"], dtype=np.uint32)
        random = RandomState(keys, position, has_spare, float(arrays["random_spare"][0]))
        return cls(
            np.asarray(arrays["chain"], dtype=np.float64),
            np.asarray(arrays["log_prob"], dtype=np.float64),
            float(arrays["acceptance"][0]),
            Refusals(*(int(v) for v in arrays["refusals"])),
            random,
        )


class ChainStore(Protocol):
    """Keeps pieces of chains."""

    def load(self, ensemble: int, number: int, key: str) -> Piece | None:
        """Return a piece if it is there, whole, and of the task with this key."""

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Keep a piece."""


class NoStore:
    """Keeps nothing."""

    def load(self, ensemble: int, number: int, key: str) -> Piece | None:
        """Return None."""

    def save(self, ensemble: int, number: int, key: str, piece: Piece) -> None:
        """Do nothing."""


def digest(arrays: Arrays) -> str:
    """Return a hash of arrays: names, kinds, shapes and bits.

    Examples
    --------
    >>> digest({"a": np.zeros(2)}) == digest({"a": np.zeros((2, 1))})
    False
    """
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()
