"""What the mechanics is asked: the inputs that a model hands to its forward map."""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.pipeline.calibrate import Fit

DRAWS = 400


class Listener:
    """A forward map that keeps what it is asked.

    Parameters
    ----------
    forward : ForwardMap
        Gives the answers.
    """

    def __init__(self, forward: ForwardMap) -> None:
        self._forward = forward
        self.heard: list[Inputs] = []

    def __call__(self, inputs: Inputs) -> Prediction:
        """Answer as the forward map does."""
        self.heard.append(inputs)
        return self._forward(inputs)


def refused_inputs(fit: Fit) -> dict[str, str]:
    """Return which inputs of new specimens the emulator refuses, in words by name.

    For draws from the posterior, each with new deviations of the specimens in the same tests.

    Parameters
    ----------
    fit : Fit
        Of a model with actuator readings; another forward map than an emulator refuses nothing.
    """
    forward = fit.model.forward
    if not isinstance(forward, Surrogate):
        return {}
    vectors = fit.chain.vectors.reshape(-1, fit.chain.vectors.shape[-1])
    thinned = vectors[np.linspace(0, len(vectors) - 1, min(DRAWS, len(vectors))).astype(int)]
    listener = Listener(forward)
    model = replace(fit.model, forward=listener)
    values = model.table.named(thinned)
    model.curvature(values, model.draw_deviation(values, np.random.default_rng(0)))
    return forward.refusals(listener.heard[0])
