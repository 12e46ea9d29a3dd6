"""Gravity: the actuator's own weight bends it.

Mechanism
    A cantilever sags, and sags less as it curls up, so part of the reading is weight lifted or
    lowered. With a horizontal bending plane the weight acts across it, where it has no first-order
    effect.

Equation
    Specific weight ρ g: along the actuator where it hangs from its clamp, up from the paper
    (against the bend) where it bends up, the opposite where it bends down. The shape at rest,
    under its weight, counts as zero.

Typical size
    ρ = 1100–1250 kg/m³ by the recipe. Readings of a fresh default actuator change by −1.5 to
    −1.8 % where it hangs; where it bends up or down by less than 0.3 % up to 120 kPa, and by
    +0.5 % and −0.6 % at 240 kPa; of a 25 % degraded one by −0.4 % where it hangs. Within the
    emulator's range for ρ s/C1 below 5.3 t/m³ over MPa: up to 1800 kg/m³ in fresh material.

Revealed by
    A difference between mounts, in soft specimens and at low pressure.

Refuted by
    Readings that do not depend on the mount.

Source
    Nielsen, Marr, Hvidt (2001), Carbohydr. Polym. 45:395, for gels that sag by their weight;
    doi:10.3389/frobt.2021.760485 for the recipe that gives the density.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs, gravity_direction
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal

STANDARD_GRAVITY = 9.80665  # m/s²


def weigh(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with the weight ρ g as each reading's mount directs it [kN/m³]."""
    mount = conditions.mount
    if np.all(mount == mount[:, :1]):
        mount = mount[:, :1]
    names, place = np.unique(mount, return_inverse=True)
    parts = np.array([gravity_direction(str(name)) for name in names])[place.reshape(mount.shape)]
    along, up = parts[..., 0], parts[..., 1]
    weight = effect["density"] * (STANDARD_GRAVITY * 1e-3)
    return replace(
        inputs,
        weight_along=weight * along + (0.0 if inputs.weight_along is None else inputs.weight_along),
        weight_up=weight * up + (0.0 if inputs.weight_up is None else inputs.weight_up),
    )


def always_horizontal(conditions: Conditions) -> str | None:
    """Say so where every mount was horizontal, with the weight across the bending plane."""
    if np.any(conditions.mount != "horizontal"):
        return None
    return "every actuator was mounted horizontally, so its weight acts across the bending plane"


CAUSE = Cause(
    name="gravity",
    stage=Stage.LOAD,
    parameters=(
        Parameter(
            "density",
            TruncatedNormal(1150.0, 400.0, 0.0, 2000.0),
            "kg/m³",
            "density of the material",
            0.0,
        ),
    ),
    mechanism="the actuator sags under its own weight, which the simulation ignores",
    typical={"density": 1150.0},
    revealed_by="a difference between mounts, in soft specimens; refuted by readings that do not "
    "depend on the mount",
    confusable_with=("paper_slack",),
    needs=("mount",),
    on_inputs=weigh,
    blind=always_horizontal,
)
