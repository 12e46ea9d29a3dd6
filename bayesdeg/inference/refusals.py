"""How often the emulator refused what the sampler proposed."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs, Prediction, continuation
from bayesdeg.actuator.status import Status
from bayesdeg.inference.density import Density
from bayesdeg.inference.model import AT_ONCE, Model

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Refusals:
    """Counts of proposals.

    Parameters
    ----------
    proposed : int
        Vectors whose density was asked for.
    refused : int
        Those that priors and stability allow, but at whose readings the forward map refuses to
        answer, being outside its training.

    Examples
    --------
    >>> (Refusals(300, 2) + Refusals(100, 2)).share
    0.01
    """

    proposed: int = 0
    refused: int = 0

    def __add__(self, other: "Refusals") -> "Refusals":
        """Return the sums of both."""
        return Refusals(self.proposed + other.proposed, self.refused + other.refused)

    @property
    def share(self) -> float:
        """Refused share of the proposals [–]; 0 of none."""
        return self.refused / self.proposed if self.proposed else 0.0


def share_outside(model: Model, vectors: Floats) -> float:
    """Return the share of vectors at which the forward map has no answer for some reading [–].

    There the likelihood only leads back inside: a posterior of which much lies there is not to be
    trusted.

    Parameters
    ----------
    model : Model
        One without actuators has nothing outside.
    vectors : array, shape (n, n_parameters)
        Posterior draws.
    """
    if model.actuator is None or not len(vectors):
        return 0.0
    status = model.predict(model.table.named(vectors)).prediction.status
    outside = np.any((status != Status.CONVERGED) & model.actuator.mask, axis=(-2, -1))
    return float(np.mean(outside))


class CountedDensity:
    """A log density that counts on the way how many vectors a model's forward map refused.

    Parameters
    ----------
    density : Density
        Left as it is; what is no ``Model`` refuses nothing.
    """

    def __init__(self, density: Density) -> None:
        self.refusals = Refusals()
        self._watched = density
        self._outside: Flags | None = None
        if (
            isinstance(density, Model)
            and density.forward is not None
            and density.actuator is not None
        ):
            self._model = density
            self._watched = replace(density, forward=self._forward)

    def __call__(self, vectors: Floats) -> Floats:
        """Return the log posterior density of each vector, shape (n,)."""
        # as many at once as the model takes, which asks its forward map for each part
        parts = [vectors[k : k + AT_ONCE] for k in range(0, max(len(vectors), 1), AT_ONCE)]
        return np.concatenate([self._counted(part) for part in parts])

    def _counted(self, vectors: Floats) -> Floats:
        self._outside = None
        density = self._watched.log_prob(vectors)
        outside = np.zeros(len(vectors), dtype=bool) if self._outside is None else self._outside
        refused = self._allowed(vectors[outside]) if outside.any() else 0
        self.refusals += Refusals(len(vectors), refused)
        return density

    def _forward(self, inputs: Inputs) -> Prediction:
        """Answer as the model's forward map, and remember whose readings it refused."""
        assert self._model.forward is not None
        assert self._model.actuator is not None
        prediction = continuation(self._model.forward)(inputs)
        refused = (prediction.status == Status.OUTSIDE_TRAINING) & self._model.actuator.mask
        outside = np.any(refused, axis=(-2, -1))
        self._outside = outside if self._outside is None else self._outside | outside
        return prediction

    def _allowed(self, vectors: Floats) -> int:
        """Count the vectors that nothing but the forward map refuses."""
        table = self._model.table
        with np.errstate(all="ignore"):
            possible = np.isfinite(table.log_prior(vectors))
            stable = self._model.is_stable(table.named(vectors))
        return int(np.sum(possible & stable))
