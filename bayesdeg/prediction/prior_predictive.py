"""Prior predictive curves."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.levels import levels
from bayesdeg.inference.model import JointModel
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.tensile import Tensile, film_readings, median_stresses, stress_variance
from bayesdeg.prediction.predictive import QUANTILES, at_conditions
from bayesdeg.priors import Named

Floats = NDArray[np.float64]

DRAWS = 1000
PRESSURE_STEP = 20.0  # [kPa]
STRETCHES = 25
CURVATURE, STRESS = "curvature", "nominal_stress"
LEAST_INSIDE = 0.5  # share of the readings inside, below which the priors contradict them


@dataclass(frozen=True)
class PriorPredictive:
    """Prior predictive curves.

    Parameters
    ----------
    table : DataFrame
        The columns of ``prior_predictive.csv``: 5 to 95 % quantiles of the curves of a further
        specimen, without reading noise, at the study's degradation rates, over those draws that
        the forward map answers; their share is ``answered``.
    answered : float
        Share of the draws for which the forward map answers at every reading of an actuator; nan
        without actuators.
    inside_curvature, inside_stress : float
        Share of the readings inside the 90 % interval that the priors predict for them, reading
        noise included; nan where there are none.
    """

    table: pd.DataFrame
    answered: float
    inside_curvature: float
    inside_stress: float

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the readings inside, by kind."""
        both = {"curvature": self.inside_curvature, "stress": self.inside_stress}
        return {what: share for what, share in both.items() if np.isfinite(share)}

    @property
    def contradicted(self) -> bool:
        """Whether the priors exclude many of the readings."""
        return any(share < LEAST_INSIDE for share in self.shares.values())


def prior_predictive(model: JointModel, generator: np.random.Generator) -> PriorPredictive:
    """Draw from every prior and predict the study.

    Parameters
    ----------
    model : JointModel
        With the study's data, of which only the conditions enter the curves.
    generator : Generator
        Draws parameters, specimens and reading noise.
    """
    values = model.table.named(model.table.sample(generator, DRAWS))
    frames, answered, inside = [], float("nan"), [float("nan")] * 2
    if model.of_kind(Curvature):
        frames.append(curvature_curves(model, values, generator))
        answered, inside[0] = _held_against_curvature(model, values, generator)
    if model.of_kind(Tensile):
        frames.append(stress_curves(model, values, generator))
        inside[1] = _held_against_stress(model, values, generator)
    table = pd.concat(frames or [_nothing()], ignore_index=True)
    return PriorPredictive(table, answered, *inside)


def curvature_curves(
    model: JointModel, values: Named, generator: np.random.Generator
) -> pd.DataFrame:
    """Return quantiles of curvature against pressure at the actuators' degradation rates.

    A quantile is nan where the forward map answers fewer than half of the draws.
    """
    degradation, _ = levels(model.data_of(Curvature).tests.degradation[:, 0])
    pressure = np.arange(
        0.0, float(np.max(model.data_of(Curvature).tests.pressure)) + 1e-9, PRESSURE_STEP
    )
    kind, state = (
        at_conditions(model, degradation, pressure).data_of(Curvature),
        model.tests(values),
    )
    found = kind.predicted(state, kind.drawn_deviations(state, generator))
    curvature = found.prediction.curvature
    rates, pressures = np.meshgrid(degradation, pressure, indexing="ij")
    return _frame(
        curvature.reshape(len(curvature), -1),
        quantity=CURVATURE,
        unit="1/m",
        degradation_pct=rates.ravel(),
        pressure_kPa=pressures.ravel(),
    )


def stress_curves(model: JointModel, values: Named, generator: np.random.Generator) -> pd.DataFrame:
    """Return quantiles of nominal stress against stretch at the films' degradation rates."""
    data = model.data_of(Tensile).tests
    deviation = values["stiffness_scatter"] * generator.standard_normal(DRAWS)
    frames = []
    for mode in dict.fromkeys(data.modes):
        rows = np.flatnonzero(np.array(data.modes) == mode)
        centres, member = levels(data.degradation[rows])
        for k, centre in enumerate(centres):
            own = rows[member == k]
            longest = float(np.max(np.where(data.mask[own], data.stretch[own], 1.0)))
            stretch = np.linspace(1.0, longest, STRETCHES)
            constants = model.world.constants(values, np.array([centre]))[:, 0]
            stress = constants @ yeoh_basis(stretch, mode, "nominal").T
            frames.append(
                _frame(
                    stress * np.exp(deviation)[:, None],
                    quantity=STRESS,
                    unit="MPa",
                    mode=mode,
                    degradation_pct=centre,
                    stretch=stretch,
                )
            )
    return pd.concat(frames, ignore_index=True)


def _held_against_curvature(
    model: JointModel, values: Named, generator: np.random.Generator
) -> tuple[float, float]:
    """Return the shares of draws within range everywhere, and of readings inside 90 %."""
    kind = model.data_of(Curvature)
    mask = kind.tests.mask
    readings = kind.drawn(model.tests(values), generator)[..., : mask.shape[1]][:, mask]
    answered = np.isfinite(readings)
    return float(np.mean(answered.all(axis=1))), _inside(readings, kind.tests.curvature[mask])


def _held_against_stress(model: JointModel, values: Named, generator: np.random.Generator) -> float:
    data = model.data_of(Tensile).tests
    sd = np.broadcast_arrays(values["stiffness_scatter"][:, None], data.degradation_sd)
    deviation = np.stack(sd, axis=-1) * generator.standard_normal((*sd[0].shape, 2))
    stress, _ = film_readings(median_stresses(model.state(values), data), deviation)
    noise = np.sqrt(stress_variance(values, stress)) * generator.standard_normal(stress.shape)
    return _inside((stress + noise)[:, data.mask], data.stress[data.mask])


def _inside(draws: Floats, observed: Floats) -> float:
    """Return the share of values inside the 90 % interval of their draws, nan left out."""
    known = np.isfinite(draws).any(axis=0)
    if not known.any():
        return float("nan")
    low, high = np.nanquantile(draws[:, known], [0.05, 0.95], axis=0)
    return float(np.mean((observed[known] >= low) & (observed[known] <= high)))


def _nothing() -> pd.DataFrame:
    return _frame(np.zeros((1, 1)), quantity=CURVATURE, unit="1/m", degradation_pct=0.0).iloc[:0]


def _frame(
    draws: Floats,
    *,
    quantity: str,
    unit: str,
    degradation_pct: Floats | float,
    mode: str = "",
    pressure_kPa: Floats | float = np.nan,
    stretch: Floats | float = np.nan,
) -> pd.DataFrame:
    """Return quantiles over draws (n, n_places), one row per place."""
    answered = np.mean(np.isfinite(draws), axis=0)
    usable = answered >= 0.5
    bands = np.where(
        usable, np.nanquantile(np.where(usable, draws, 0.0), QUANTILES, axis=0), np.nan
    )
    return pd.DataFrame(
        {
            "quantity": quantity,
            "mode": mode,
            "degradation_pct": degradation_pct,
            "pressure_kPa": pressure_kPa,
            "stretch": stretch,
            "unit": unit,
            "answered": answered,
        }
        | {f"q{round(100 * q):02d}": bands[i] for i, q in enumerate(QUANTILES)}
    )
