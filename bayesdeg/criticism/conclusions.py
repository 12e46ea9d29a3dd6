"""What a reader takes from a posterior: quantities that the report states."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named

Floats = NDArray[np.float64]


def conclusions(model: Model, values: Named) -> dict[str, Floats]:
    """Return the quantities that the report states, by what they are called there.

    C1 and the elongation limit without degradation and at the last node, the volume ratio, the
    stiffness of the paper, and the size of each active cause.

    Parameters
    ----------
    model : Model
        Those that it has no parameters for are left out.
    values : mapping
        Named values, (n,).

    Returns
    -------
    dict
        Each (n,), in the users' units.
    """
    found = _against_degradation(
        "C1", model.constants(values, _ends(model.nodes))[..., 0], model.nodes
    )
    named = {"volume_ratio": "volume ratio", "paper_stiffness": "paper stiffness"}
    found |= {words: values[name] for name, words in named.items() if name in values}
    if "elongation_scatter" in values:
        nodes = model.elongation_nodes
        found |= _against_degradation(
            "elongation limit", model.elongation(values, _ends(nodes)), nodes
        )
    for cause in model.causes:
        for parameter in cause.parameters:
            words = f"{cause.name.replace('_', ' ')}: {parameter.name.replace('_', ' ')}"
            found[words] = values[cause.qualified(parameter.name)]
    return found


def _ends(nodes: tuple[float, ...]) -> Floats:
    return np.unique([0.0, max(nodes)])


def _against_degradation(name: str, draws: Floats, nodes: tuple[float, ...]) -> dict[str, Floats]:
    return {f"{name} at {end:.3g} %": draws[:, i] for i, end in enumerate(_ends(nodes))}
