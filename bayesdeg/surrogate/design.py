"""Choose curves to solve: designs over the whole range, and curves typical of studies."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.surrogate.coordinates import inside, scaled_material
from bayesdeg.surrogate.scaling import MATERIAL, NOMINAL_THICKNESS, Place, TrainingRange

Floats = NDArray[np.float64]

PRESSURES = tuple(float(p) for p in range(20, 241, 20))  # kPa
ACTIVE_HELD_OUT = (0.4, 0.4, 0.2)  # probabilities of none, one or two active causes
# constants at 0, 12.5 and 25 % [MPa], softening [–]: assumed about the published moduli
LEVELS = (0.0, 12.5, 25.0)
LOG_C1 = np.log((0.288, 0.78, 1.588))
SOFTENING = (-0.10, -0.15, -0.20)
LOG_C3 = np.log((0.003, 0.035, 0.1175))


def study_like(count: int, *, seed: int) -> list[Curve]:
    """Return curves of pressures 20, 40, …, 240 kPa as typical in the sampler of a study.

    Degradation uniform from 0 to 25 %; C1 by 10 %, C3 by half, softening by 0.1 and the paper's
    stiffness by a factor of 1.6 about their usual values; α = 0.62 ± 0.05; none, one or two
    causes at practical sizes.

    Examples
    --------
    >>> len(study_like(2, seed=1)[0].loads)
    12
    """
    generator, curves = np.random.default_rng(seed), []
    for _ in range(count):
        base, c1, scale = _usual_material(generator)
        number = int(generator.choice(len(ACTIVE_HELD_OUT), p=ACTIVE_HELD_OUT))
        effects = _effects(generator, weight=_weight(c1, scale))
        for k in generator.permutation(len(effects))[:number]:
            base |= effects[int(k)]
        curves.append(_at_pressures(MaterialGroups(**base), c1))
    return curves


def _at_pressures(material: MaterialGroups, c1: float) -> Curve:
    return Curve(tuple(p * 1e-3 / c1 for p in PRESSURES), material)


def _weight(c1: float, scale: float) -> float:
    """Return the group of a specific weight of 12 kN/m³ [1/mm]."""
    return 1.2e-5 * scale / c1


def _usual_material(generator: np.random.Generator) -> tuple[dict[str, float], float, float]:
    """Return groups without a cause, C1 [MPa] and the linear scale [–]."""
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
    return base, c1, scale


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


# dense at the start of the curve, to determine the initial slope
LOAD_SHARES = tuple(float(x) for x in (np.arange(1, 15) / 14.0) ** 1.3)

# probabilities of none, one, two … active causes
ACTIVE = (0.2, 0.3, 0.3, 0.15, 0.05)
GRAVITY_ALONG = 0.4  # share of the curves with gravity in which it acts along the actuator
# below it stiff paper tightens immediately and curves are hard to follow: interpolated
SMALLEST_SLACK = 0.01


@dataclass(frozen=True)
class Effects:
    """Ranges of causes in a design, by fields of ``MaterialGroups``."""

    second_invariant_ratio: tuple[float, float] = (0.0, 1.0)
    skin: tuple[float, float] = (0.0, 1.2)
    paper_thickness: tuple[float, float] = (0.05, 0.25)
    paper_slack: tuple[float, float] = (SMALLEST_SLACK, 0.05)
    paper_mismatch: tuple[float, float] = (-0.02, 0.03)
    gravity: tuple[float, float] = (-6e-5, 6e-5)
    wall_factor: tuple[float, float] = (0.8, 1.2)
    erosion: tuple[float, float] = (0.0, 0.4)


def space_filling(span: TrainingRange, count: int, *, seed: int) -> list[Curve]:
    """Return curves over a scrambled Sobol' design, each with none to four active causes.

    The first curves of a longer design are those of a shorter one. The seed is that of scrambling
    and of the choice of causes.

    Examples
    --------
    >>> short, long = (space_filling(TrainingRange(), n, seed=1) for n in (3, 6))
    >>> short == long[:3]
    True
    """
    ranges = vars(Effects())
    names = list(ranges)
    generator = np.random.default_rng(seed)
    sampler = qmc.Sobol(len(MATERIAL) + len(names), rng=generator)
    size = 2 ** int(np.ceil(np.log2(max(count, 1))))
    curves = []
    for point in sampler.random(size)[:count]:
        number = generator.choice(len(ACTIVE), p=ACTIVE)
        active = {names[k] for k in generator.permutation(len(names))[:number]}
        gravity = "gravity_along" if generator.random() < GRAVITY_ALONG else "gravity_up"
        changes = {
            (gravity if name == "gravity" else name): float(low + (high - low) * share)
            for (name, (low, high)), share in zip(
                ranges.items(), point[len(MATERIAL) :], strict=True
            )
            if name in active
        }
        low, high = span.lower[: len(MATERIAL)], span.upper[: len(MATERIAL)]
        softening, stiffening, paper = low + (high - low) * point[: len(MATERIAL)]
        c3 = float(np.exp(stiffening))
        material = MaterialGroups(
            c2_ratio=float(softening * np.sqrt(3.0 * c3)),
            c3_ratio=c3,
            paper_group=float(np.exp(paper)),
            paper_thickness=NOMINAL_THICKNESS,
        )
        largest = float(span.largest_load(np.array(2.0 * point[1] - 1.0)))
        loads = tuple(largest * share for share in LOAD_SHARES)
        curves.append(Curve(loads, replace(material, **changes)))
    return curves


def training_curves(
    span: TrainingRange, coarse: int, fine: int, *, seed: int
) -> tuple[list[Curve], list[Curve]]:
    """Return the curves of an emulator of the whole range, for the coarse and for the fine mesh.

    Two thirds of the coarse ones fill the space, the others are typical of studies; of the fine
    ones, which are among them, three quarters are typical.

    Examples
    --------
    >>> many, few = training_curves(TrainingRange(), 12, 4, seed=1)
    >>> len(many), len(few), set(few) <= set(many)
    (12, 4, True)
    """
    filling = space_filling(span, coarse - coarse // 3, seed=seed)
    usual = typical(span, coarse // 3, seed=seed)
    return [*filling, *usual], [*filling[: fine - 3 * fine // 4], *usual[: 3 * fine // 4]]


# positions in the result of `_effects`, in turn: weight (5), skin (1) and mismatch (4), whose
# effects are small, occur more often
IN_TURN = (5, 1, 4, 0, 5, 6, 1, 4, 5, 3, 7, 2)
FURTHER = 1.5  # loads trained over those of studies, for softer materials and higher pressures


def typical(span: TrainingRange, count: int, *, seed: int) -> list[Curve]:
    """Return curves typical of studies, every other one with a single cause, all in turn.

    Examples
    --------
    >>> len(typical(TrainingRange(), 3, seed=1))
    3
    """
    generator, curves = np.random.default_rng(seed), list[Curve]()
    while len(curves) < count:
        turn, is_single = divmod(len(curves), 2)
        base, c1, scale = _usual_material(generator)
        effects = _effects(generator, weight=_weight(c1, scale))
        number = int(generator.choice(len(ACTIVE_HELD_OUT), p=ACTIVE_HELD_OUT))
        chosen = generator.permutation(len(effects))[:number].tolist()
        for k in [IN_TURN[turn % len(IN_TURN)]] if is_single else chosen:
            base |= effects[k]
        curve = _within(_at_pressures(MaterialGroups(**base), c1), span)
        if is_answered(curve, span):
            curves.append(curve)
    return curves


def is_answered(curve: Curve, span: TrainingRange) -> bool:
    """Return whether an emulator covers the material of a curve."""
    return bool(np.all(inside(np.array([Place.of(curve.material).values]), span)))


def _within(curve: Curve, span: TrainingRange) -> Curve:
    """Return the curve with the standard loads, up to those trained or the range's end."""
    place = Place.of(curve.material)
    stiffening = scaled_material(np.array(place.values[: len(MATERIAL)]))[1]
    end = float(span.largest_load(stiffening)) * place.modulus
    end = min(FURTHER * curve.loads[-1], end)
    return replace(curve, loads=tuple(end * share for share in LOAD_SHARES))
