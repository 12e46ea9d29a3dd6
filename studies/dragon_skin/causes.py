"""Possible errors of the beam model: nuisances with priors, without effect at zero."""

from dataclasses import dataclass

import numpy as np

from bayesdeg.priors import (
    Distribution,
    HalfNormal,
    LogNormal,
    Normal,
    Parameter,
    TruncatedNormal,
    Uniform,
)

DEGREE = np.pi / 180.0
MOTION = (1.0, 1.0, 1.0, DEGREE, DEGREE, DEGREE)  # a rigid motion of 1 mm and 1°
SWAY = (1.0, 1.0, 1.0, *(2.0 * DEGREE,) * 3)


@dataclass(frozen=True)
class Block:
    """Nuisances with normal priors that the likelihood integrates out.

    Parameters
    ----------
    shape : tuple of int
        Of the array; the last axis holds coordinates [mm], or shifts and turns [mm and rad].
    spread : tuple of float
        Prior standard deviations along the last axis, at a size of 1.
    size : Parameter, optional
        Factor on the spread, itself sampled; 1 if there is none.
    """

    shape: tuple[int, ...]
    spread: tuple[float, ...]
    size: Parameter | None = None

    @property
    def count(self) -> int:
        """Number of nuisances."""
        return int(np.prod(self.shape))


@dataclass(frozen=True)
class Cause:
    """One candidate: what it is in words, and either sampled or integrated out.

    Parameters
    ----------
    words : str
        For the page.
    parameter : Parameter, optional
        Acts through the finite element solution; sampled.
    block : Block, optional
        Moves markers; integrated out.
    """

    words: str
    parameter: Parameter | None = None
    block: Block | None = None

    @property
    def sampled(self) -> Parameter | None:
        """The parameter that the sampler sees."""
        return self.parameter if self.block is None else self.block.size


def _sized(name: str, median: float, unit: str, meaning: str) -> Parameter:
    return Parameter(f"{name}_size", LogNormal(median, 0.8), unit, f"sd of {meaning}")


def _block(name: str, shape: tuple[int, ...], spread: tuple[float, ...], median: float) -> Block:
    return Block(shape, spread, _sized(name, median, "mm", name.replace("_", " ")))


def _mechanical(name: str, law: Distribution, unit: str, words: str, meaning: str) -> Cause:
    return Cause(words, Parameter(name, law, unit, meaning))


#: How far the finite element solutions reach.
LOWEST, HIGHEST = 25.0, 75.0  # C1 [kPa]
STEEPEST = 10.0  # [°]

C1 = Parameter("c1", Uniform(LOWEST, HIGHEST), "kPa", "neo-Hookean constant; E = 6 C1")
NOISE = Parameter("noise", LogNormal(0.2, 0.7), "mm", "sd of a coordinate of a marker")

#: Always there: where the rig stands before the camera, and how that changes between load cases.
RIG = {
    "pose": Block((1, 6), (50.0, 50.0, 50.0, 0.3, 0.3, 0.3)),
    "setup_shift": Block((3, 3), (3.0, 3.0, 3.0)),
    "setup_turn": Block(
        (3, 3),
        (DEGREE, DEGREE, DEGREE),
        _sized("setup_turn", 0.5, "°", "the rig's turn from load case to load case"),
    ),
}

GEOMETRICAL = {
    "held_shape": Cause(
        "the hand holds the tip off its undeformed place, differently in each take",
        block=_block("held_shape", (6, 6), (0.3, 1.0, 1.0, *(0.8 * DEGREE,) * 3), 2.0),
    ),
    "tip_marker_offset": Cause(
        "tip markers are off their nominal places, the same throughout",
        block=_block("tip_marker_offset", (3, 3), (1.0, 1.0, 1.0), 1.0),
    ),
    "clamp_marker_offset": Cause(
        "clamp markers are off their nominal places, the same throughout",
        block=_block("clamp_marker_offset", (3, 3), (1.0, 1.0, 1.0), 1.0),
    ),
    "frame_by_case": Cause(
        "clamp markers sit, or are seen, differently in each load case",
        block=_block("frame_by_case", (3, 3, 3), (1.0, 1.0, 1.0), 0.3),
    ),
    "rig_shift": Cause(
        "the rig moves between held and rest, differently in each take (1 mm goes with 1°)",
        block=_block("rig_shift", (6, 6), MOTION, 0.1),
    ),
    "repeat": Cause(
        "the tip does not come to the same rest in both repeats (each take; 1 mm goes with 2°)",
        block=_block("repeat", (6, 6), SWAY, 0.3),
    ),
    "rest_misfit": Cause(
        "the tip rests elsewhere than modelled, alike in both repeats (each load case; 1 mm goes "
        "with 2°): whatever the other causes do not explain",
        block=_block("rest_misfit", (3, 6), SWAY, 0.3),
    ),
}

MECHANICAL = {
    "clamp_compliance": _mechanical(
        "clamp_compliance",
        HalfNormal(10.0),
        "°/(N m)",
        "the clamp turns with the moment; 10 °/(N m) adds a tenth to the sag under a tip load",
        "turn of the clamp per moment",
    ),
    "clamp_position": _mechanical(
        "clamp_position",
        Normal(0.0, 2.0),
        "mm",
        "the free length is not 100 mm",
        "free length beyond 100 mm",
    ),
    "load_point": _mechanical(
        "load_point",
        HalfNormal(3.0),
        "mm",
        "the weight hangs inwards of the tip",
        "from the tip to the weight",
    ),
    "load_depth": _mechanical(
        "load_depth",
        HalfNormal(5.0),
        "mm",
        "the weight pulls lower on the end face than on its upper 4 mm",
        "depth of the weight's resultant below that",
    ),
    "edge_line": _mechanical(
        "edge_line",
        Uniform(0.0, 1.0),
        "–",
        "the weight presses as a line on the very edge and dents it",
        "share of the weight on the edge",
    ),
    "marker_mass": _mechanical(
        "marker_mass",
        HalfNormal(3.0),
        "g",
        "the tip markers weigh something",
        "mass of the three together",
    ),
    "gravity_tilt": _mechanical(
        "gravity_tilt",
        TruncatedNormal(0.0, 5.0, -STEEPEST, STEEPEST),
        "°",
        "the beam points below the horizontal",
        "pitch of the undeformed beam below the horizontal",
    ),
    "hardening": _mechanical(
        "hardening",
        HalfNormal(0.1),
        "–",
        "the material stiffens with strain: Yeoh's law with this C2/C1, C3 = 0",
        "C2/C1",
    ),
}

CAUSES: dict[str, Cause] = {**GEOMETRICAL, **MECHANICAL}
