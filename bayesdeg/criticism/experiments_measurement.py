"""What could still be read: tests of actuators, tests of films, measurements of the part."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.curves import ActuatorCurves, TensileCurves
from bayesdeg.inference.films import film_readings, stress_variance
from bayesdeg.inference.likelihood import Linearised, covariance
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import BEND_ANGLE, TENSILE, Named
from bayesdeg.inference.replicate import simulated_films

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Measurement(Protocol):
    """What would be read on new specimens of S kinds, so many of each kind."""

    @property
    def copies(self) -> int:
        """Number of specimens of each kind."""
        ...

    @property
    def read(self) -> Flags:
        """Where there is a reading, (S, R)."""
        ...

    def expected(self, model: Model, values: Named) -> Floats:
        """Return readings expected for named values (n,), shape (n, S, R); nan if refused."""
        ...

    def covariance(self, model: Model, values: Named) -> Floats:
        """Return the covariance of each kind's readings about them, (n, S, R, R)."""
        ...

    def simulated(self, model: Model, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of one specimen of each kind through the full equations, (n, S, R)."""
        ...


@dataclass(frozen=True)
class ActuatorTests:
    """Actuators under pressure.

    Parameters
    ----------
    curves : ActuatorCurves
        One row a kind of specimen; what it holds of readings is not used.
    copies : int
        Specimens of each kind.
    """

    curves: ActuatorCurves
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading: curvatures, then bend angles if there are any."""
        return self.curves.paths.mask

    def expected(self, model: Model, values: Named) -> Floats:
        """Return curvatures [1/m], then bend angles [°] expected."""
        return replace(model, actuator=self.curves).predict(values).mean

    def covariance(self, model: Model, values: Named) -> Floats:
        """Return their covariance, of specimens (linear in the stiffness) and errors."""
        tested = replace(model, actuator=self.curves)
        predicted = tested.predict(values)
        length = values["curvature_noise_length"]
        with_angle = self.curves.with_angle
        linearised = Linearised(
            np.zeros_like(predicted.mean),
            predicted.slope[..., None],
            predicted.variance,
            tested.deviation_sd(values) ** 2,
            length,
            values["reading_correlation"] if with_angle else np.zeros(len(length)),
            self.curves.paths,
        )
        return covariance(linearised)

    def simulated(self, model: Model, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens."""
        return replace(model, actuator=self.curves).simulate(values, generator)


@dataclass(frozen=True)
class FilmTests:
    """Films in tension.

    Parameters
    ----------
    curves : TensileCurves
        One row a kind of specimen; what it holds of stresses is not used.
    copies : int
        Specimens of each kind.
    """

    curves: TensileCurves
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading."""
        return self.curves.mask

    def expected(self, model: Model, values: Named) -> Floats:
        """Return stresses expected [MPa]."""
        return model.stresses(values, self.curves).at_rest

    def covariance(self, model: Model, values: Named) -> Floats:
        """Return their covariance, linear in stiffness and degradation rate, and of errors."""
        data = self.curves
        shape = (len(values["stiffness_scatter"]), len(data.specimens), 2)
        stress, slope = film_readings(model.stresses(values, data), np.zeros(shape))
        spread = np.empty(shape)
        spread[..., 0] = values["stiffness_scatter"][:, None] ** 2
        spread[..., 1] = data.degradation_sd**2
        linearised = Linearised(
            np.zeros_like(stress),
            slope,
            stress_variance(values, stress),
            spread,
            values["tensile_noise_length"],
            np.zeros(len(stress)),
            data.paths,
        )
        return covariance(linearised)

    def simulated(self, model: Model, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new films."""
        return simulated_films(model, self.curves, values, generator)


def with_noise(values: Named, generator: np.random.Generator) -> dict[str, Floats]:
    """Return named values with the noise of what was never read so far, as its prior has it."""
    count = len(values["stiffness_scatter"])
    unknown = [p for p in (*BEND_ANGLE, *TENSILE) if p.name not in values]
    return {**values, **{p.name: p.law.sample(generator, count) for p in unknown}}
