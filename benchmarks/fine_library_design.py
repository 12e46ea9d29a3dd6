"""Design of the second surrogate, with draws that differ from the emulator's design."""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.surrogate.design import study_like
from bayesdeg.surrogate.scaling import NOMINAL_SCALE, NOMINAL_THICKNESS, SECOND

SEED = 7701
# constants over the degradation rate [%], beyond which studies do not go
LEVELS = (0.0, 12.5, 25.0, 30.0)
LOG_C1 = np.log((0.288, 0.78, 1.588, 1.9))  # MPa
LOG_C3 = np.log((0.003, 0.035, 0.1175, 0.16))  # MPa
SOFTENING = (-0.10, -0.15, -0.20, -0.22)
ACTIVE = (0.15, 0.35, 0.35, 0.15)  # how often none to three causes are at work
PRESSURE = 0.26  # MPa, beyond what is read: some causes raise it
LARGEST_LOAD = 0.96  # p/M
SOFT = 8.0  # degradation rate up to which curves bend far [%]


def design(count: int, *, seed: int = SEED) -> list[Curve]:
    """Return curves, every other one as studies ask for it, the rest spread more widely.

    The first curves of a longer design are those of a shorter one.

    Parameters
    ----------
    count : int
        Number of curves, even.
    seed : int
        Of all draws.
    """
    generator = np.random.default_rng(seed)
    usual = study_like(count // 2, seed=seed)
    wide = [_wide(generator) for _ in usual]
    return [_as_far_as_read(curve) for pair in zip(usual, wide, strict=True) for curve in pair]


def loose(count: int, *, seed: int = SEED + 1) -> list[Curve]:
    """Return curves as studies ask for them, all with slack paper: its effect bends most."""
    generator = np.random.default_rng(seed)
    slack = generator.uniform(0.004, 0.05, count)
    return [
        _as_far_as_read(
            replace(
                curve,
                material=replace(curve.material, paper_slack=float(s), paper_mismatch=0.0),
            )
        )
        for curve, s in zip(study_like(count, seed=seed), slack, strict=True)
    ]


def _as_far_as_read(curve: Curve) -> Curve:
    largest = LARGEST_LOAD * (1.0 + SECOND * curve.material.second_invariant_ratio)
    end = min(curve.loads[-1] * PRESSURE / 0.24, largest)
    return replace(curve, loads=(0.5 * end, end))


def soft(count: int, *, seed: int = SEED + 2) -> list[Curve]:
    """Return widely spread curves of hardly degraded material: they bend farthest."""
    generator = np.random.default_rng(seed)
    return [_as_far_as_read(_wide(generator, largest=SOFT)) for _ in range(count)]


def _wide(generator: np.random.Generator, *, largest: float = LEVELS[-1]) -> Curve:
    level = generator.uniform(0.0, largest)
    z = generator.standard_normal(5)
    c1 = float(np.exp(np.interp(level, LEVELS, LOG_C1) + 0.17 * z[0]))
    c3 = float(np.exp(np.interp(level, LEVELS, LOG_C3) + 0.6 * z[1])) / c1
    softening = float(np.clip(np.interp(level, LEVELS, SOFTENING) + 0.13 * z[2], -0.6, 0.5))
    scale = NOMINAL_SCALE * float(np.exp(0.06 * z[3]))
    paper = float(30.0 * np.exp(0.6 * z[4])) / (c1 * scale)
    base = {
        "c2_ratio": float(softening * np.sqrt(3.0 * c3)),
        "c3_ratio": c3,
        "paper_group": min(paper, 1400.0),
        "paper_thickness": NOMINAL_THICKNESS * NOMINAL_SCALE / scale,
    }
    effects = _effects(generator, paper=base["paper_group"], weight=1e-5 * scale / c1)
    number = int(generator.choice(len(ACTIVE), p=ACTIVE))
    chosen = [effects[int(k)] for k in generator.permutation(len(effects))]
    acting: dict[str, float] = {}
    for effect in chosen:
        tight = {"paper_slack", "paper_mismatch"}
        if number > 0 and not (tight & set(acting) and tight & set(effect)):
            acting |= effect
            number -= 1
    return Curve((0.24 / c1,), MaterialGroups(**(base | acting)))


def _effects(
    generator: np.random.Generator, *, paper: float, weight: float
) -> list[dict[str, float]]:
    """Return a size of every effect; ``weight`` is ρ g s/C1 at 1 t/m³ [1/mm]."""
    pull = float(weight * generator.uniform(0.4, 1.8))
    mount = [{"gravity_along": pull}, {"gravity_up": pull}, {"gravity_up": -pull}]
    return [
        {"second_invariant_ratio": float(generator.uniform(0.0, 1.0))},
        {"skin": float(generator.uniform(0.0, 1.2))},
        {"paper_thickness": float(generator.uniform(0.06, 0.22))},
        {"paper_slack": float(generator.uniform(0.005, 0.05))},
        {"paper_mismatch": float(generator.uniform(-0.02, 0.03))},
        mount[int(generator.integers(3))],
        {"wall_factor": float(generator.uniform(0.82, 1.18))},
        {"erosion": float(generator.uniform(0.0, 0.4))},
        {"paper_group": max(2.6, paper * float(np.exp(-generator.uniform(0.0, 3.0))))},
    ]
