"""Curves that no training sees: materials and effects as studies meet them."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.material import Material
from bayesdeg.emulator.scaling import NOMINAL_THICKNESS

Floats = NDArray[np.float64]

PRESSURES = tuple(float(p) for p in range(20, 241, 20))  # kPa
ACTIVE = (0.4, 0.4, 0.2)  # how often none, one or two causes are at work
# constants at 0, 12.5 and 25 % [MPa], softening [–]: assumed about the published moduli
LEVELS = (0.0, 12.5, 25.0)
LOG_C1 = np.log((0.288, 0.78, 1.588))
SOFTENING = (-0.10, -0.15, -0.20)
LOG_C3 = np.log((0.003, 0.035, 0.1175))


def study_like(count: int, *, seed: int) -> list[Curve]:
    """Return curves of pressures 20, 40, …, 240 kPa as the sampler of a study asks for them.

    Degradation uniform from 0 to 25 %; C1 by 10 %, C3 by half, softening by 0.1 and the paper's
    stiffness by a factor of 1.6 about their usual values; α = 0.62 ± 0.05; none, one or two
    causes at a size that is met in practice.

    Parameters
    ----------
    count : int
        Number of curves.
    seed : int
        Of all draws.

    Examples
    --------
    >>> len(study_like(2, seed=1)[0].loads)
    12
    """
    generator = np.random.default_rng(seed)
    return [_draw(generator) for _ in range(count)]


def _draw(generator: np.random.Generator) -> Curve:
    level = generator.uniform(0.0, 25.0)
    z = generator.standard_normal(6)
    c1 = float(np.exp(np.interp(level, LEVELS, LOG_C1) + 0.10 * z[0]))
    c3 = float(np.exp(np.interp(level, LEVELS, LOG_C3) + 0.5 * z[1])) / c1
    softening = float(np.clip(np.interp(level, LEVELS, SOFTENING) + 0.1 * z[2], -0.6, 0.5))
    scale = float(np.cbrt(0.62 + 0.05 * np.clip(z[3], -3.0, 3.0)))
    paper = float(30.0 * np.exp(0.5 * z[4])) / (c1 * scale)
    base = {
        "c2_ratio": float(softening * np.sqrt(3.0 * c3)),
        "c3_ratio": c3,
        "paper_group": min(paper, 1400.0),
        "paper_thickness": NOMINAL_THICKNESS * 0.853 / scale,
    }
    number = int(generator.choice(len(ACTIVE), p=ACTIVE))
    effects = _effects(generator, weight=1.2e-5 * scale / c1)
    for k in generator.permutation(len(effects))[:number]:
        base |= effects[int(k)]
    return Curve(tuple(p * 1e-3 / c1 for p in PRESSURES), Material(**base))


def _effects(generator: np.random.Generator, *, weight: float) -> list[dict[str, float]]:
    """Return a size of every effect; ``weight`` is ρ g s/C1 [1/mm]."""
    half = np.abs(generator.standard_normal(5))
    mount = [{"gravity_along": weight}, {"gravity_up": weight}, {"gravity_up": -weight}]
    return [
        {"second_invariant_ratio": float(min(0.4 * half[0], 1.0))},
        {"skin": float(min(0.5 * half[1], 1.2))},
        {"paper_thickness": float(generator.uniform(0.07, 0.2))},
        {"paper_slack": float(min(0.01 + 0.015 * half[2], 0.05))},
        {"paper_mismatch": float(min(0.012 * half[3], 0.03))},
        mount[int(generator.integers(3))],
        {"wall_factor": float(np.clip(1.0 + 0.07 * generator.standard_normal(), 0.82, 1.18))},
        {"erosion": float(min(0.15 * half[4], 0.4))},
    ]
