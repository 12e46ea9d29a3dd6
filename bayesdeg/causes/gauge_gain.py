"""Gauge gain: the gauge reads all pressures too high or too low by one factor.

Mechanism
    A gauge or transducer is off in proportion to its reading: its span was never adjusted, it has
    aged, or its calibration factor is rounded. A leak only lowers the pressure (``pressure_loss``);
    a gauge errs either way.

Equation
    p_true = (1 + g) p.

Typical size
    A few percent: accuracy classes of mechanical gauges are 1, 1.6, 2.5 and 4 % of full scale;
    transducers are better. g has a standard deviation of 2 %, so that this cause cannot replace
    what only a leak or a different material explains.

Revealed by
    A small ratio of curvatures, constant in p at every degradation rate. From
    curvature, bend angle and volume alone it cannot be told from a stiffer or softer casting
    (``film_mismatch``), nor from a small leak, since the shape depends on p/C1 alone.

Refuted by
    A second gauge of a better class that reads the same.

Source
    EN 837-1 (1996), Pressure gauges, for the classes; the experiment is that of
    doi:10.3389/frobt.2021.760485, which states none.
"""

from dataclasses import replace

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def scale_pressure(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs at (1 + g) p, and counted from (1 + g) times the reference pressure."""
    factor, reference = 1.0 + effect["gain"], inputs.reference_pressure
    return replace(
        inputs,
        pressure=factor * inputs.pressure,
        reference_pressure=None if reference is None else factor * reference,
    )


CAUSE = Cause(
    name="gauge_gain",
    stage=Stage.LOAD,
    parameters=(
        Parameter(
            "gain",
            TruncatedNormal(0.0, 0.02, -0.2, 0.2),
            "–",
            "true over recorded pressure, minus 1",
            0.0,
        ),
    ),
    mechanism="the gauge reads all pressures too high or too low by one factor",
    typical={"gain": 0.03},
    revealed_by="a small constant ratio at every pressure and degradation rate; refuted by a "
    "second gauge that reads the same",
    confusable_with=("film_mismatch", "pressure_loss", "initial_curvature", "wall_thickness"),
    twins=("film_mismatch",),
    on_inputs=scale_pressure,
)
