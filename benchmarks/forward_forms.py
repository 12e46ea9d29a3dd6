"""A state for assembly, and the difference of two assemblies of the same equations there."""

import numpy as np

from bayesdeg.actuator.body import Body
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.problem import DiscreteEquations, MechanicalState, Problem, System
from bayesdeg.actuator.weak_form import Spaces, WeakForm


def agreement(
    kernels: DiscreteEquations, forms: DiscreteEquations, state: MechanicalState
) -> dict[str, float]:
    """Return the largest differences of tangent and residual over their largest entries."""
    ours, theirs = kernels.linearise(state), forms.linearise(state)
    pairs = {
        "tangent": (ours.tangent, theirs.tangent),
        "residual": (ours.residual, theirs.residual),
    }
    return {name: float(np.abs(b - a).max() / np.abs(a).max()) for name, (a, b) in pairs.items()}


def sample(body: Body) -> tuple[Problem, WeakForm, MechanicalState]:
    """Return solid, paper and pressed cavity by kernels and scikit-fem, and a state far from rest.

    Parameters
    ----------
    body : Body
        Of Q2/P1disc.
    """
    material = MaterialGroups(c2_ratio=-0.014, c3_ratio=0.004, paper_group=120.0)
    generator = np.random.default_rng(1)
    x, _, z = body.nodes.T
    bent = np.column_stack([0.004 * x * z, 0.1 * np.sin(0.2 * x), -0.002 * x * x])
    moved = (bent + 0.01 * generator.standard_normal(body.nodes.shape)) * ~body.fixed
    pressure = generator.standard_normal((len(body.elements), body.element.modes.shape[1]))
    system = System(body)
    forms = WeakForm(system, material, Spaces.on(body))
    return Problem(system, material), forms, MechanicalState(moved, pressure, load=0.5)
