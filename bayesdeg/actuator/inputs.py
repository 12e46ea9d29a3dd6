"""What a forward map takes and gives, and the dimensionless groups of its inputs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.settings import RuptureCriterion

Floats = NDArray[np.float64]

PAPER_THICKNESS = 0.1  # mm

Asked = Literal["", "cavity_volume", "tip_force"]
"""What may be asked of a forward map beside the shape: nothing, or one of these."""


@dataclass(frozen=True)
class Inputs:
    """What the mechanics needs; the arrays broadcast over walkers × specimens × pressures.

    Parameters
    ----------
    pressure : array
        True gauge pressure in the chambers [kPa], not negative.
    c1, c2, c3 : array
        Yeoh constants [MPa].
    linear_scale : array
        Size over moulded size [–].
    paper_stiffness : array
        Et of the paper [N/m].
    reference_pressure : array, optional
        True gauge pressure at which the reading was set to zero [kPa].
    second_invariant : array, optional
        r of a term r (√Ī₂ − √3) in the energy; neutral 0 [MPa].
    skin : array, optional
        ln of the stiffness of an exposed surface over that of the mean; neutral 0 [–].
    paper_thickness : array, optional
        From which the paper's bending stiffness follows; 0.1 if not given [mm].
    paper_slack : array, optional
        Strain within which the paper carries next to nothing; neutral 0 [–].
    paper_mismatch : array, optional
        Linear strain by which the body shrank after the paper was bonded; neutral 0 [–].
    weight_along, weight_up : array, optional
        Specific weight ρ g along the actuator from the clamp, and up from the paper [kN/m³];
        neutral 0, see ``gravity_direction``.
    wall_factor : array, optional
        Thickness of walls and roof over the nominal one; neutral 1 [–].
    erosion : array, optional
        Thickness lost from exposed faces; neutral 0 [mm].
    criterion : str
        What of the walls' state is asked for as peak stretch, see `bayesdeg.actuator.demand`.
    weibull_modulus : array, optional
        m of the weakest link, the same at all pressures of a specimen; of no other criterion [–].
    asked : str
        What is asked for beside the shape, see ``Prediction.further``.
    dimensions : mapping of str to array, optional
        Dimensions as moulded that are not those of the map's actuator, the same at all pressures
        of a specimen [mm].
    """

    pressure: Floats
    c1: Floats
    c2: Floats
    c3: Floats
    linear_scale: Floats
    paper_stiffness: Floats
    reference_pressure: Floats | None = None
    second_invariant: Floats | None = None
    skin: Floats | None = None
    paper_thickness: Floats | None = None
    paper_slack: Floats | None = None
    paper_mismatch: Floats | None = None
    weight_along: Floats | None = None
    weight_up: Floats | None = None
    wall_factor: Floats | None = None
    erosion: Floats | None = None
    criterion: RuptureCriterion = "principal_stretch"
    weibull_modulus: Floats | None = None
    asked: Asked = ""
    dimensions: Mapping[str, Floats] | None = None


@dataclass(frozen=True)
class Further:
    """An output beside the shape, less that at the reference pressure, or at zero pressure.

    Parameters
    ----------
    value : array
        Volume of the whole cavity [ml], or force that holds the tip in the bending direction [N].
    slope : array
        p times its derivative by the pressure, in the same unit.
    sd : array
        Standard error of the map's own value.
    """

    value: Floats
    slope: Floats
    sd: Floats


@dataclass(frozen=True)
class Prediction:
    """What a forward map answers; all arrays have the shape that the inputs broadcast to.

    Parameters
    ----------
    curvature : array
        Bend angle over deformed arc length of the bottom line, less that at the reference
        pressure, or at zero pressure if there is none [1/m]; nan where ``status`` is not 0.
    bend_angle : array
        Rotation of the free end face, less that at the reference pressure [deg].
    peak_stretch : array
        Largest principal stretch that 99 % of the volume stays below, or the uniaxial stretch that
        is as demanding by the criterion asked for [–].
    slope : array
        p ∂κ/∂p, the change of curvature for a relative change of pressure [1/m]. It is nearly
        that for a relative loss of stiffness, which also changes the paper's group.
    sd : array
        Standard error of the map's own curvature [1/m].
    bend_angle_sd : array
        Standard error of the map's own bend angle [deg].
    peak_stretch_sd : array
        Standard error of the map's own peak stretch [–].
    status : array of int
        ``Status`` of each value.
    excess : array, optional
        How far outside its range a map was asked that goes on beyond it, see `continuation` [–].
    further : Further, optional
        What the inputs asked for beside the shape; None where nothing was, or the map has none.
    """

    curvature: Floats
    bend_angle: Floats
    peak_stretch: Floats
    slope: Floats
    sd: Floats
    bend_angle_sd: Floats
    peak_stretch_sd: Floats
    status: NDArray[np.int64]
    excess: Floats | None = None
    further: Further | None = None


class ForwardMap(Protocol):
    """Exact or emulated: the same call."""

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction for the inputs."""


def continuation(forward: ForwardMap) -> ForwardMap:
    """Return a map that goes on smoothly outside the range of this one, if it can; else itself.

    For the search of a mode and the linearisation about it, which must find the way back inside:
    ``excess`` says by how much it was asked outside, and the likelihood falls with its square. What
    it answers there is no prediction.
    """
    beyond: ForwardMap = getattr(forward, "continued", forward)
    return beyond


def dimensionless(inputs: Inputs) -> tuple[Floats, Floats, Floats, Floats]:
    """Return p/C1, C2/C1, C3/C1 and Et/(C1 s) [mm]: all that the curvature times s depends on.

    All are nan where C1 is not above 0, since ratios hide its sign.

    Examples
    --------
    >>> one = np.ones(1)
    >>> inputs = Inputs(240 * one, 0.3 * one, 0 * one, 0 * one, 0.8 * one, 3e4 * one)
    >>> [float(group[0]) for group in dimensionless(inputs)]
    [0.8, 0.0, 0.0, 125.0]
    """
    c1 = np.where(inputs.c1 > 0.0, inputs.c1, np.nan)
    paper = inputs.paper_stiffness * 1e-3 / (c1 * inputs.linear_scale)
    return load_of(inputs), inputs.c2 / c1, inputs.c3 / c1, paper


def load_of(inputs: Inputs) -> Floats:
    """Return p/C1 [–]; nan where C1 is not above 0.

    Examples
    --------
    >>> one = np.ones(1)
    >>> load_of(Inputs(240 * one, 0.3 * one, 0 * one, 0 * one, 0.8 * one, 3e4 * one))
    array([0.8])
    """
    load: Floats = inputs.pressure * 1e-3 / np.where(inputs.c1 > 0.0, inputs.c1, np.nan)
    return load


def material_groups(inputs: Inputs) -> dict[str, Floats]:
    """Return the fields of ``Material`` that the inputs give: dimensionless and at moulded size.

    Examples
    --------
    >>> one = np.ones(1)
    >>> inputs = Inputs(240 * one, 0.3 * one, 0 * one, 0 * one, 0.5 * one, 3e4 * one)
    >>> {name: float(value[0]) for name, value in material_groups(inputs).items()}
    {'c2_ratio': 0.0, 'c3_ratio': 0.0, 'paper_group': 200.0, 'paper_thickness': 0.2}
    """
    c1 = np.where(inputs.c1 > 0.0, inputs.c1, np.nan)
    scale = np.asarray(inputs.linear_scale, dtype=np.float64)
    thickness = PAPER_THICKNESS if inputs.paper_thickness is None else inputs.paper_thickness
    groups = {
        "c2_ratio": inputs.c2 / c1,
        "c3_ratio": inputs.c3 / c1,
        "paper_group": inputs.paper_stiffness * 1e-3 / (c1 * inputs.linear_scale),
        "paper_thickness": thickness / scale,
    }
    weight = 1e-6 * scale / c1  # kN/m³ to MPa/mm
    changes = {
        "second_invariant_ratio": (inputs.second_invariant, 1.0 / c1),
        "skin": (inputs.skin, 1.0),
        "paper_slack": (inputs.paper_slack, 1.0),
        "paper_mismatch": (inputs.paper_mismatch, 1.0),
        "gravity_along": (inputs.weight_along, weight),
        "gravity_up": (inputs.weight_up, weight),
        "wall_factor": (inputs.wall_factor, 1.0),
        "erosion": (inputs.erosion, 1.0 / scale),
    }
    given = {n: v * np.asarray(factor) for n, (v, factor) in changes.items() if v is not None}
    return groups | given


NEUTRAL = {
    "second_invariant": 0.0,
    "skin": 0.0,
    "paper_slack": 0.0,
    "paper_mismatch": 0.0,
    "weight_along": 0.0,
    "weight_up": 0.0,
    "wall_factor": 1.0,
    "erosion": 0.0,
}


def departs(inputs: Inputs) -> NDArray[np.bool_]:
    """Return where an input that is neutral by default is not: maps that lack it must refuse.

    Examples
    --------
    >>> one = np.ones(2)
    >>> inputs = Inputs(one, one, one, one, one, one, skin=np.array([0.0, 0.3]))
    >>> departs(inputs).tolist()
    [False, True]
    """
    away = np.zeros((), dtype=bool)
    for name, neutral in NEUTRAL.items():
        value = getattr(inputs, name)
        if value is not None:
            away = away | (np.asarray(value) != neutral)
    return away


def gravity_direction(mount: str) -> tuple[float, float]:
    """Return the components along and up of a unit weight for a mount of the contract.

    A horizontal bending plane has its weight across, where the half model cannot bend; its
    effect on the curvature is of second order.

    Examples
    --------
    >>> gravity_direction("bending_down")  # towards the paper, which is down
    (0.0, -1.0)
    """
    directions = {
        "horizontal": (0.0, 0.0),
        "hanging": (1.0, 0.0),
        "bending_up": (0.0, 1.0),
        "bending_down": (0.0, -1.0),
    }
    return directions[mount]


def relative_to_reference(forward: ForwardMap, inputs: Inputs) -> Prediction:
    """Return the prediction with the curvature at the reference pressure taken off.

    Errors of a map are taken to grow along a curve by independent steps, so that the covariance
    of two readings is the smaller variance: their difference has the variance |σ² − σ₀²|. That is
    0 where the pressure is the reference, and not below what an error common to the whole curve
    leaves, |σ − σ₀|.
    """
    assert inputs.reference_pressure is not None
    plain = forward(replace(inputs, reference_pressure=None))
    zero = forward(replace(inputs, pressure=inputs.reference_pressure, reference_pressure=None))
    return replace(
        plain,
        curvature=plain.curvature - zero.curvature,
        bend_angle=plain.bend_angle - zero.bend_angle,
        slope=plain.slope - zero.slope,
        sd=_difference_sd(plain.sd, zero.sd),
        bend_angle_sd=_difference_sd(plain.bend_angle_sd, zero.bend_angle_sd),
        status=np.maximum(plain.status, zero.status),
        excess=_either(plain.excess, zero.excess),
        further=_further_difference(plain.further, zero.further),
    )


def _further_difference(plain: Further | None, zero: Further | None) -> Further | None:
    if plain is None or zero is None:
        return None
    return Further(
        plain.value - zero.value, plain.slope - zero.slope, _difference_sd(plain.sd, zero.sd)
    )


def _either(excess: Floats | None, reference: Floats | None) -> Floats | None:
    if excess is None or reference is None:
        return None
    both: Floats = np.hypot(excess, reference)
    return both


def _difference_sd(sd: Floats, reference_sd: Floats) -> Floats:
    difference: Floats = np.sqrt(np.abs(sd**2 - reference_sd**2))
    return difference
