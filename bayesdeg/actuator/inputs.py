"""Inputs and predictions of a forward map, and the dimensionless groups of inputs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.settings import RuptureCriterion

Floats = NDArray[np.float64]

PAPER_THICKNESS = 0.1  # mm

Asked = Literal["", "cavity_volume", "tip_force"]
"""Optional output of a forward map besides the shape: none, or one of these."""


@dataclass(frozen=True)
class Inputs:
    """Inputs of the mechanics; arrays broadcast over walkers × specimens × pressures.

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
        Gives the paper's bending stiffness; 0.1 by default [mm].
    paper_slack : array, optional
        Strain below which the paper carries hardly any load; neutral 0 [–].
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
        Measure of the walls' state returned as peak stretch, see `bayesdeg.actuator.demand`.
    weibull_modulus : array, optional
        m of the weakest link, constant over pressures of a specimen; unused otherwise [–].
    asked : str
        Optional output besides the shape, see ``Prediction.further``.
    dimensions : mapping of str to array, optional
        Moulded dimensions that differ from the map's actuator, constant over pressures of a
        specimen [mm].
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
    """An output besides the shape, relative to the reference pressure or to zero pressure.

    Parameters
    ----------
    value : array
        Volume of the whole cavity [ml], or force that holds the tip in the bending direction [N].
    slope : array
        p times its derivative with respect to pressure, in the same unit.
    sd : array
        Standard error of the map itself.
    """

    value: Floats
    slope: Floats
    sd: Floats


@dataclass(frozen=True)
class Prediction:
    """Prediction of a forward map; all arrays have the broadcast shape of the inputs.

    Parameters
    ----------
    curvature : array
        Bend angle over deformed arc length of the bottom line, relative to the reference pressure,
        or to zero pressure if there is none [1/m]; nan where ``status`` is not 0.
    bend_angle : array
        Rotation of the free end face, relative to the reference pressure [deg].
    peak_stretch : array
        99 % quantile over the volume of the largest principal stretch, or the equally demanding
        uniaxial stretch by the requested criterion [–].
    slope : array
        p ∂κ/∂p, the change of curvature for a relative change of pressure [1/m]. It is nearly
        that for a relative loss of stiffness, which also changes the paper's group.
    sd : array
        Standard error of the map's curvature [1/m].
    bend_angle_sd : array
        Standard error of the map's bend angle [deg].
    peak_stretch_sd : array
        Standard error of the map's peak stretch [–].
    status : array of int
        ``Status`` of each value.
    excess : array, optional
        Distance outside the range of an extrapolating map, see `continuation` [–].
    further : Further, optional
        The requested output besides the shape; None if not requested, or not available.
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
    """Return a map that extrapolates smoothly outside its range, if possible; else itself.

    For mode search and linearisation, which must find their way back inside: ``excess`` measures
    the distance outside, and the likelihood falls with its square. Extrapolated values are not
    predictions.
    """
    beyond: ForwardMap = getattr(forward, "continued", forward)
    return beyond


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


def paper_group_of(inputs: Inputs) -> Floats:
    """Return Et/(C1 s) [mm]; nan where C1 is not above 0, as a ratio hides its sign."""
    c1 = np.where(inputs.c1 > 0.0, inputs.c1, np.nan)
    group: Floats = inputs.paper_stiffness * 1e-3 / (c1 * inputs.linear_scale)
    return group


def material_groups(inputs: Inputs) -> dict[str, Floats]:
    """Return the fields of ``MaterialGroups`` given by the inputs: dimensionless, at moulded size.

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
        "paper_group": paper_group_of(inputs),
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


def gravity_direction(mount: str) -> tuple[float, float]:
    """Return the components along and up of a unit weight for a mount of the contract.

    With a horizontal bending plane the weight acts across, where the half model cannot bend; its
    effect on curvature is of second order.

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
    """Return the prediction relative to the reference pressure.

    Errors of a map are assumed to grow along a curve by independent steps, so that the covariance
    of two readings is the smaller variance: their difference has the variance |σ² − σ₀²|. That is 0
    at the reference pressure, and at least |σ − σ₀|, the part of an error common to the whole
    curve.
    """
    assert inputs.reference_pressure is not None
    plain = forward(replace(inputs, reference_pressure=None))
    zero = forward(replace(inputs, pressure=inputs.reference_pressure, reference_pressure=None))
    excess: Floats | None = None
    if plain.excess is not None and zero.excess is not None:
        excess = np.hypot(plain.excess, zero.excess)
    further: Further | None = None
    if plain.further is not None and zero.further is not None:
        further = Further(
            plain.further.value - zero.further.value,
            plain.further.slope - zero.further.slope,
            _difference_sd(plain.further.sd, zero.further.sd),
        )
    return replace(
        plain,
        curvature=plain.curvature - zero.curvature,
        bend_angle=plain.bend_angle - zero.bend_angle,
        slope=plain.slope - zero.slope,
        sd=_difference_sd(plain.sd, zero.sd),
        bend_angle_sd=_difference_sd(plain.bend_angle_sd, zero.bend_angle_sd),
        status=np.maximum(plain.status, zero.status),
        excess=excess,
        further=further,
    )


def _difference_sd(sd: Floats, reference_sd: Floats) -> Floats:
    difference: Floats = np.sqrt(np.abs(sd**2 - reference_sd**2))
    return difference
