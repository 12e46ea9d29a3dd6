"""Which curves to solve: space-filling over the material, a few causes at work in each."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.material import Material
from bayesdeg.emulator.coordinates import inside
from bayesdeg.emulator.held_out import study_like
from bayesdeg.emulator.scaling import MATERIAL, NOMINAL_THICKNESS, Place, TrainingRange

Floats = NDArray[np.float64]

# dense where the curve starts, so that the first slope is known
LOAD_SHARES = tuple(float(x) for x in (np.arange(1, 15) / 14.0) ** 1.3)

SECOND_STAGE = Path(__file__).with_name("second_stage.json")
CANDIDATES, CANDIDATES_SEED = 512, 12

# how often none, one, two … causes are at work
ACTIVE = (0.2, 0.3, 0.3, 0.15, 0.05)
GRAVITY_ALONG = 0.4  # share of the curves with gravity in which it acts along the actuator
# below it stiff paper tightens at once, and curves are hard to follow: it is interpolated
SMALLEST_SLACK = 0.01


@dataclass(frozen=True)
class Effects:
    """How much of each cause a design holds: ranges of fields of ``Material``."""

    second_invariant_ratio: tuple[float, float] = (0.0, 1.0)
    skin: tuple[float, float] = (0.0, 1.2)
    paper_thickness: tuple[float, float] = (0.05, 0.25)
    paper_slack: tuple[float, float] = (SMALLEST_SLACK, 0.05)
    paper_mismatch: tuple[float, float] = (-0.02, 0.03)
    gravity: tuple[float, float] = (-6e-5, 6e-5)
    wall_factor: tuple[float, float] = (0.8, 1.2)
    erosion: tuple[float, float] = (0.0, 0.4)


def space_filling(span: TrainingRange, count: int, *, seed: int) -> list[Curve]:
    """Return curves over a scrambled Sobol' design, each with none to four causes at work.

    The first curves of a longer design are those of a shorter one.

    Parameters
    ----------
    span : TrainingRange
        What the emulator shall cover.
    count : int
        Number of curves.
    seed : int
        Of scrambling and choice of causes.

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
        material = replace(_base_material(span, point), **changes)
        curves.append(Curve(_loads(span, point[1]), material))
    return curves


def candidates(span: TrainingRange) -> list[Curve]:
    """Return the curves that a second stage is chosen from.

    One half fills the space, the other is as studies ask for, so that the choice is weighted by
    what is likely. None of them is held out.
    """
    filling = space_filling(span, CANDIDATES, seed=CANDIDATES_SEED)
    return [curve for curve in filling if is_answered(curve, span)] + likely(span)


def likely(span: TrainingRange) -> list[Curve]:
    """Return curves as studies ask for them, over which a second stage lowers the error."""
    drawn = (_within(curve, span) for curve in study_like(CANDIDATES, seed=CANDIDATES_SEED))
    return [curve for curve in drawn if is_answered(curve, span)]


def is_answered(curve: Curve, span: TrainingRange) -> bool:
    """Return whether an emulator answers at all for the material of a curve."""
    return bool(np.all(inside(np.array([Place.of(curve.material).values]), span)))


def _within(curve: Curve, span: TrainingRange) -> Curve:
    """Return the curve with as many loads as any, up to where its own end or the range does."""
    largest = min(curve.loads[-1], span.load)
    return replace(curve, loads=tuple(largest * share for share in LOAD_SHARES))


def second_stage(span: TrainingRange, first: list[Curve], fine: int) -> tuple[list[Curve], ...]:
    """Return further curves for the coarse and for the fine mesh, chosen by ``sequential``.

    Parameters
    ----------
    span : TrainingRange
        What the emulator shall cover.
    first : list of Curve
        The first stage on the coarse mesh, for which the choice was made.
    fine : int
        How many of these were solved on the fine mesh, the first ones.
    """
    chosen = json.loads(SECOND_STAGE.read_text(encoding="utf-8"))
    pool = candidates(span)
    coarse = [pool[index] for index in chosen["coarse"]]
    twins = [*first[fine:], *coarse]
    return coarse, [twins[index] for index in chosen["fine"]]


def _base_material(span: TrainingRange, unit: Floats) -> Material:
    low, high = span.lower[: len(MATERIAL)], span.upper[: len(MATERIAL)]
    softening, stiffening, paper = low + (high - low) * unit[: len(MATERIAL)]
    c3 = float(np.exp(stiffening))
    return Material(
        c2_ratio=float(softening * np.sqrt(3.0 * c3)),
        c3_ratio=c3,
        paper_group=float(np.exp(paper)),
        paper_thickness=NOMINAL_THICKNESS,
    )


def _loads(span: TrainingRange, unit_stiffening: float) -> tuple[float, ...]:
    largest = float(span.largest_load(np.array(2.0 * unit_stiffening - 1.0)))
    return tuple(largest * share for share in LOAD_SHARES)
