"""An actuator whose curvature is a closed form of pressure over C1, to stand in for solutions."""

from dataclasses import dataclass

import numpy as np

from bayesdeg.actuator.curve import relative_to_reference
from bayesdeg.actuator.inputs import Further, Inputs, Prediction
from bayesdeg.actuator.status import Status

LENGTH_M = 0.05


@dataclass(frozen=True)
class LinearActuator:
    """Curvature 20 (p/C1) (1 + p/C1) over the scale; stretch 1 + ``stretching`` p/C1."""

    stretching: float = 1.0
    limit: float = np.inf

    def __call__(self, inputs: Inputs) -> Prediction:
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        load = inputs.pressure / (1e3 * inputs.c1)
        curvature = 20.0 * load * (1.0 + load) / inputs.linear_scale
        slope = 20.0 * load * (1.0 + 2.0 * load) / inputs.linear_scale
        there = np.broadcast_to(load <= self.limit, curvature.shape)
        stretch = np.broadcast_to(1.0 + self.stretching * load, curvature.shape)
        return Prediction(
            curvature=np.where(there, curvature, np.nan),
            bend_angle=np.where(there, np.degrees(curvature * LENGTH_M), np.nan),
            peak_stretch=np.where(there, stretch, np.nan),
            slope=np.where(there, slope, np.nan),
            sd=np.zeros(curvature.shape),
            bend_angle_sd=np.zeros(curvature.shape),
            peak_stretch_sd=np.zeros(curvature.shape),
            status=np.where(there, 0, int(Status.LIMIT_POINT)),
            further=(
                Further(*(0.02 * x for x in (curvature, slope, 0.0 * curvature)))
                if inputs.asked
                else None
            ),
        )


def curvature_by_hand(pressure, c1, volume_ratio):
    """Written out once more."""
    q = pressure / 1000.0 / c1
    return 20.0 * (q + q * q) / volume_ratio ** (1.0 / 3.0)
