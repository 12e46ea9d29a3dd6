"""Which causes the study at hand could confuse: it is simulated under each, and judged.

Readings z = d_a + e, e ~ N(0, I), of the linearised model with the effect d_a of cause a; cause b
is as good where its linear Bayes factor is within odds of 20 of that of a.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.linear import Linear, effects, log_bayes_factor, sensitivities
from bayesdeg.criticism.subject import typical_size

Floats = NDArray[np.float64]

CLEAR = float(np.log(20.0))
OFTEN = 0.1  # of simulated studies in which the wrong cause is as good: then they are confusable
VISIBLE = 3.0  # size of an effect, in standard deviations, below which it is not seen at all
DRAWS = 300


@dataclass(frozen=True)
class Confusability:
    """What would be named if each cause acted.

    Parameters
    ----------
    names : tuple of str
        The causes.
    visible : array, shape (k,)
        Size of each one's effect on the whitened readings [standard deviations].
    confused : array, shape (k, k)
        Share of studies simulated under the row's cause in which the column's is as good, to
        within a Bayes factor of 20.
    """

    names: tuple[str, ...]
    visible: Floats
    confused: Floats

    def pairs(self) -> list[tuple[str, str]]:
        """Return pairs of which either would often be taken for the other."""
        return [
            (self.names[i], self.names[j])
            for i in range(len(self.names))
            for j in range(i + 1, len(self.names))
            if self._is_confused(i, j)
        ]

    def rivals(self, name: str) -> list[str]:
        """Return what would often be as good as a cause if it acted."""
        i = self.names.index(name)
        return [n for j, n in enumerate(self.names) if j != i and self.confused[i, j] > OFTEN]

    def _is_confused(self, i: int, j: int) -> bool:
        seen = self.visible[[i, j]] > VISIBLE
        return bool(
            (seen[0] and seen[1]) and (self.confused[i, j] > OFTEN or self.confused[j, i] > OFTEN)
        )


NOT_KNOWN = Confusability((), np.zeros(0), np.zeros((0, 0)))


def confusability(
    linear: Linear, causes: tuple[Cause, ...], generator: np.random.Generator
) -> Confusability:
    """Simulate the readings under each cause at its usual size and judge them.

    Parameters
    ----------
    linear : Linear
        The base model, linearised.
    causes : tuple of Cause
        What may act; each at the size that its catalogue entry gives as typical.
    generator : Generator
        For the noise.
    """
    if not causes:
        return NOT_KNOWN
    columns = [sensitivities(linear, cause) for cause in causes]
    changes = np.stack([_typical_effect(linear, cause) for cause in causes])
    noise = generator.standard_normal((DRAWS, changes.shape[1]))
    confused = np.zeros((len(causes), len(causes)))
    for i, change in enumerate(changes):
        z = change + noise
        factors = np.stack(
            [log_bayes_factor(z, _wide(c, d)) for c, d in zip(columns, changes, strict=True)]
        )
        confused[i] = np.mean(factors > factors[i] - CLEAR, axis=1)
    return Confusability(
        tuple(cause.name for cause in causes), np.linalg.norm(changes, axis=1), confused
    )


def _typical_effect(linear: Linear, cause: Cause) -> Floats:
    effect: Floats = np.nan_to_num(effects(linear, cause, typical_size(cause)[None])[0])
    return effect


def _wide(columns: Floats, change: Floats) -> Floats:
    """Return directions of a cause: of small sizes, and of its usual one."""
    return np.column_stack([columns, change])
