"""Where to begin the search for a mode: the least-squares fit of the films."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from bayesdeg.inference.curves import Breaks, TensileCurves
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import control_name, node_name
from bayesdeg.material.degradation import Nodes, bernstein_weights, lagrange_weights

Floats = NDArray[np.float64]

SMALLEST = (1e-3, -np.inf, 1e-6)  # of the control values of C1, C2, C3 [MPa]
NOISE = 0.03  # of stress, relative, by which readings are weighted
JITTER = 0.03  # of vectors about the fit, on the unconstrained scale
INSIDE = 0.02  # probability that a start stays away from the bounds of its prior


def least_squares(model: Model) -> Floats:
    """Return a vector near the mode, from films by least squares, else from prior medians.

    Stress is linear in the control values of the constants, and ln elongation in its values at the
    nodes, so both have one solution: starts drawn from a prior may lead to another, lower mode.

    Returns
    -------
    array, shape (n_parameters,)
        On the unconstrained scale; its density may still be 0.
    """
    values = {p.name: float(p.law.quantile(0.5)) for p in model.table.parameters}
    values |= _fitted(model)
    within = {
        p.name: float(np.clip(values[p.name], *p.law.quantile([INSIDE, 1.0 - INSIDE])))
        for p in model.table.parameters
    }
    return np.asarray(model.table.vectors({name: np.array(v) for name, v in within.items()}))


def near_films(model: Model, generator: np.random.Generator, *, count: int = 400) -> Floats | None:
    """Return the most probable of vectors about the films' least-squares fit; None if none is.

    What the films say nothing of is drawn from its prior: where the medians of all that demand more
    of the actuators than the forward map answers, others may not.

    Parameters
    ----------
    model : Model
        Whose mode is sought.
    generator : Generator
        Draws the vectors.
    count : int
        Number of them.
    """
    fit, known = least_squares(model), _fitted(model)
    draws = model.table.sample(generator, count)
    columns = [i for i, name in enumerate(model.table.names) if name in known]
    jitter = JITTER * generator.standard_normal((count, len(columns)))
    draws[:, columns] = fit[columns] + jitter
    trials = np.vstack([fit, draws])
    density = model.log_prob(trials)
    best = int(np.argmax(density))
    return trials[best] if np.isfinite(density[best]) else None


def _fitted(model: Model) -> dict[str, float]:
    """Return what films alone say."""
    found: dict[str, float] = {}
    if model.tensile is not None:
        found |= _constants(model.tensile, model.nodes)
    if model.breaks is not None:
        found |= _elongation(model.breaks, model.elongation_nodes)
    return found


def _constants(data: TensileCurves, nodes: Nodes) -> dict[str, float]:
    weights = bernstein_weights(data.degradation, nodes)
    columns = (data.basis[..., None] * weights[:, None, None, :])[data.mask]
    stress = data.stress[data.mask]
    scale = 1.0 / (NOISE * (np.abs(stress) + 0.05 * float(np.abs(stress).max())))
    design = columns.reshape(len(stress), -1) * scale[:, None]
    lower = np.repeat(SMALLEST, len(nodes))
    c1, c2, c3 = lsq_linear(design, stress * scale, (lower, np.inf)).x.reshape(3, -1)
    found = {"c1": c1, "c2_ratio": c2 / np.sqrt(3.0 * c1 * c3), "c3": c3}
    return {
        control_name(name, nodes, k): float(controls[k])
        for name, controls in found.items()
        for k in range(len(nodes))
    }


def _elongation(data: Breaks, nodes: Nodes) -> dict[str, float]:
    weights = lagrange_weights(data.degradation, nodes)
    at_nodes = np.linalg.lstsq(weights, np.log(data.elongation), rcond=None)[0]
    return {
        node_name("elongation", node): float(np.exp(value))
        for node, value in zip(nodes, at_nodes, strict=True)
    }
