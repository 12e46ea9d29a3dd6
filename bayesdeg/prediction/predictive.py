"""New specimens drawn from a posterior: curvature bands and rupture probability."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.material.strength import Strength
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.rupture import data_of_actuators, strength_of
from bayesdeg.observations.specimens import has_elongation
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.priors import Named
from bayesdeg.quantities import LOADING, UNLOADING

Floats = NDArray[np.float64]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def at_conditions(
    model: JointModel, degradation: Floats, pressure: Floats, conditions: ServiceConditions = PROMPT
) -> JointModel:
    """Return the model of new specimens at degradation rates, under pressures.

    Parameters
    ----------
    model : JointModel
        A calibrated model.
    degradation : array, shape (n_levels,) or (n, n_levels)
        Known but for the standard error of the conditions, or that of each draw [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor [kPa].
    conditions : ServiceConditions
        Without a history each degradation rate has one specimen, over all pressures; with one
        there is a specimen for each rate and pressure, see `history`.
    """
    largest = model.world.largest_pressure
    return model.with_observations(
        *data_of_actuators(
            _tests_in(conditions, degradation, pressure, largest=largest), model.base
        )
    )


class LoadHistory(NamedTuple):
    """Loading of specimens up to their readings.

    Parameters
    ----------
    pressure : array, shape (n_specimens, n_points)
        [kPa]
    cycle, time, unloading : array, shape (n_points,)
        Loading cycle, time since the first point [s], whether the pressure is on its way down.
    """

    pressure: Floats
    cycle: NDArray[np.int64]
    time: Floats
    unloading: NDArray[np.bool_]


def history(conditions: ServiceConditions, pressure: Floats, largest: float) -> LoadHistory:
    """Return the loading of specimens that are each read at their own pressure.

    All steps but the last are prompt. Since prompt cycles are equal, one represents all earlier
    ones.

    Parameters
    ----------
    conditions : ServiceConditions
        Hold, cycle and branch.
    pressure : array, shape (n_specimens,)
        At which each is read, held for the time of the conditions [kPa].
    largest : float
        To which earlier cycles and the way up went, where that is above the pressure [kPa].

    Examples
    --------
    >>> up_and_down = ServiceConditions(hold_s=60.0, cycle=2, branch="unloading")
    >>> path = history(up_and_down, np.array([40.0]), 240.0)
    >>> path.pressure.tolist(), path.time.tolist()
    ([[240.0, 0.0, 240.0, 40.0]], [0.0, 0.0, 0.0, 60.0])
    """
    top, nothing = np.maximum(pressure, largest), np.zeros_like(pressure)
    steps = list(_steps(conditions, top, nothing))
    steps.append((pressure, conditions.cycle, conditions.branch == UNLOADING))
    reached, cycle, down = zip(*steps, strict=True)
    time = np.zeros(len(steps))
    time[-1] = conditions.hold_s
    return LoadHistory(np.stack(reached, axis=-1), np.array(cycle), time, np.array(down))


def _steps(
    conditions: ServiceConditions, top: Floats, nothing: Floats
) -> Iterator[tuple[Floats, int, bool]]:
    """Yield pressure, cycle and whether it is on its way down, before the last step."""
    if conditions.cycle > 1:
        yield top, conditions.cycle - 1, False
        yield nothing, conditions.cycle - 1, True
    elif conditions.branch == LOADING:
        yield nothing, 1, False
    if conditions.branch == UNLOADING:
        yield top, conditions.cycle, False


def _tests_in(
    conditions: ServiceConditions, degradation: Floats, pressure: Floats, *, largest: float
) -> ActuatorCurves:
    """Return tests of new specimens, without readings.

    Parameters
    ----------
    conditions : ServiceConditions
        Without a history there is one specimen for each degradation rate, over all pressures;
        with one there is a specimen for each rate and pressure, rates first.
    degradation : array, shape (n_levels,) or (n, n_levels)
        The same for all draws, or that of each draw [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor [kPa].
    largest : float
        See `history` [kPa].
    """
    if conditions.has_history:
        levels = degradation.shape[-1]
        path = history(conditions, np.tile(pressure, levels), largest)
        degradation = np.repeat(degradation, len(pressure), axis=-1)
    else:
        shape = (degradation.shape[-1], len(pressure))
        path = LoadHistory(
            np.broadcast_to(pressure, shape).copy(),
            np.array(1),
            np.array(np.nan),
            np.array(False),
        )
    return _tests(conditions, degradation, path)


def _tests(conditions: ServiceConditions, degradation: Floats, path: LoadHistory) -> ActuatorCurves:
    shape = path.pressure.shape
    rates = degradation if degradation.ndim == 1 else np.mean(degradation, axis=0)
    humidity, temperature = (
        np.nan if value is None else value
        for value in (conditions.humidity_pct, conditions.temperature_c)
    )
    return ActuatorCurves(
        specimens=tuple(f"{level:g} %" for level in rates),
        degradation=degradation[..., None],
        degradation_sd=np.full((shape[0], 1), conditions.degradation_sd),
        pressure=path.pressure,
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        angle_sd=np.zeros(shape),
        mask=np.ones(shape, dtype=bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.zeros(shape, dtype=bool),
        recorded=np.ones(shape, dtype=bool),
        ruptured=np.zeros(shape, dtype=bool),
        cycle=np.broadcast_to(path.cycle, shape).copy(),
        branch=np.where(np.broadcast_to(path.unloading, shape), UNLOADING, LOADING),
        time=np.broadcast_to(path.time, shape).copy(),
        humidity=np.full(shape, humidity),
        mount=np.full(shape, conditions.mount),
        temperature=np.full(shape, temperature),
    )


@dataclass(frozen=True)
class Grid:
    """New specimens at degradation rates, read at pressures in some conditions.

    Parameters
    ----------
    model : JointModel
        What `at_conditions` makes of the model that predicts.
    levels, pressures : int
        Number of each.
    has_histories : bool
        Whether each pressure is read on a specimen of its own, at the end of its history.
    """

    model: JointModel
    levels: int
    pressures: int
    has_histories: bool = False

    @classmethod
    def of(
        cls, model: JointModel, degradation: Floats, pressure: Floats, conditions: ServiceConditions
    ) -> "Grid":
        """Return the grid of these rates and pressures, as of `at_conditions`."""
        at = at_conditions(model, degradation, pressure, conditions)
        return cls(at, np.shape(degradation)[-1], len(pressure), conditions.has_history)

    @property
    def _alike(self) -> int:
        """Specimens at each rate, one after another, which differ in their pressure alone."""
        return self.pressures if self.has_histories else 1

    def deviation_sd(self, values: Named) -> Floats:
        """Return τ of specimens at each rate, (n, n_levels, 1)."""
        return self.model.data_of(Curvature).deviation_sd(self.model.tests(values))[
            :, :: self._alike
        ]

    def draw_deviation(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw the deviation of ln stiffness of a specimen at each rate, (n, n_levels, 1)."""
        sd = self.deviation_sd(values)
        return sd * generator.standard_normal(sd.shape)

    def strength(self, values: Named) -> Strength:
        """Return the elongation limit of specimens at each rate, (n, n_levels, 1)."""
        step = self._alike
        return strength_of(self.model.tests(values), self.model.data_of(Curvature).tests).mapped(
            lambda array: array[:, ::step, None]
        )

    def reached(self, values: Named, deviation: Floats) -> "Reached":
        """Return the response of specimens up to each reading, (n, n_levels, n_pressures).

        Parameters
        ----------
        values : mapping
            Named values, (n,).
        deviation : array, shape (n, n_levels, 1)
            Of each specimen's ln stiffness.
        """
        prediction = (
            self.model.data_of(Curvature)
            .predicted(self.model.tests(values), np.repeat(deviation, self._alike, axis=1))
            .prediction
        )
        answered = prediction.status == 0
        if not self.has_histories:
            stretch, sd = prediction.peak_stretch, prediction.peak_stretch_sd
            return Reached(prediction.curvature, stretch, sd, answered)
        shape = (-1, self.levels, self.pressures)
        whole = answered.all(axis=-1)
        curvature = np.where(whole, prediction.curvature[..., -1], np.nan)
        largest, error = _largest_stretch(prediction)
        bent, stretch, sd = (v.reshape(shape) for v in (curvature, largest, error))
        return Reached(bent, stretch, sd, whole.reshape(shape))


class Reached(NamedTuple):
    """Response of specimens up to their readings, each (n, n_levels, n_pressures).

    Parameters
    ----------
    curvature : array
        Without reading noise [1/m]; nan where the forward map has no answer.
    stretch, stretch_sd : array
        The largest stretch so far, and the forward map's error of it [–].
    answered : array of bool
        Whether the whole history is within the forward map's range.
    """

    curvature: Floats
    stretch: Floats
    stretch_sd: Floats
    answered: NDArray[np.bool_]


def _largest_stretch(prediction: Prediction) -> tuple[Floats, Floats]:
    """Return the largest stretch of each history and its error, (n, n_specimens)."""
    stretch = prediction.peak_stretch
    at = np.argmax(np.where(np.isfinite(stretch), stretch, 0.0), axis=-1)[..., None]
    sd = np.broadcast_to(prediction.peak_stretch_sd, stretch.shape)
    largest, error = (np.take_along_axis(v, at, axis=-1)[..., 0] for v in (stretch, sd))
    return largest, error


LOOKED_AT = 20  # draws for testing the effect of conditions
SHARES = np.array([0.25, 0.5, 0.75, 1.0])  # fractions of the largest tested pressure for that test
SAME = 1e-9  # relative difference up to which predictions are equal: rounding


def moving_nothing(
    model: JointModel, chain: Chain, degradation: Floats, conditions: ServiceConditions
) -> tuple[str, ...]:
    """Return the names of conditions without effect on curvature or elongation limit.

    Each is reset to that of a prompt first loading while the others stay; a condition that acts
    only together with one that was not given has no effect either. For rupture only the elongation
    limit counts, since whatever the causes, a specimen may have burst at a larger earlier pressure.

    Parameters
    ----------
    model, chain : JointModel, Chain
        With the active causes.
    degradation : array, shape (n_levels,)
        [%]
    conditions : ServiceConditions
        The requested conditions.
    """
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    values = model.table.named(flat[:: -(-len(flat) // LOOKED_AT)])
    pressure = SHARES * model.world.largest_pressure

    def seen(at: ServiceConditions) -> Floats:
        grid = Grid.of(model, degradation, pressure, at)
        sd = grid.deviation_sd(values)
        found = [sd, grid.reached(values, np.zeros_like(sd)).curvature]
        if has_elongation(model.base):
            strength = grid.strength(values)
            found += [strength.limit(np.zeros(1)), strength.scatter, strength.flaw_share]
        return np.concatenate(found, axis=-1)

    whole = seen(conditions)
    return tuple(
        name
        for name in conditions.changed
        if np.allclose(whole, seen(conditions.without(name)), rtol=SAME, atol=0.0, equal_nan=True)
    )


def draw_values(
    model: JointModel, chain: Chain, generator: np.random.Generator, draws: int
) -> dict[str, Floats]:
    """Return named values of random draws from a chain."""
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return model.table.named(flat[generator.integers(len(flat), size=draws)])


def curvature_bands(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 1000,
    conditions: ServiceConditions = PROMPT,
) -> pd.DataFrame:
    """Return quantiles of the curvature of a new specimen, without reading noise.

    Parameters
    ----------
    model, chain : JointModel, Chain
        JointModel and its posterior.
    generator : Generator
        Draws parameters and the specimen's own stiffness.
    degradation, pressure : array
        Levels [%], (n_levels,) or of each draw (draws, n_levels), and pressures as read [kPa].
    draws : int
        Number of specimens drawn.
    conditions : ServiceConditions
        Conditions of the reading.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, the median of the draws, ``pressure_kPa``, ``q05`` … ``q95``
        [1/m]; nan where more than half of the draws lie outside the range of the forward map.
    """
    grid = Grid.of(model, degradation, pressure, conditions)
    values = draw_values(model, chain, generator, draws)
    deviation = grid.draw_deviation(values, generator)
    curvature = grid.reached(values, deviation).curvature
    usable = np.mean(np.isfinite(curvature), axis=0) > 0.5
    safe = np.where(usable, curvature, 0.0)
    bands = np.where(usable, np.nanquantile(safe, QUANTILES, axis=0), np.nan)
    levels, pressures = np.meshgrid(_medians(degradation), pressure, indexing="ij")
    columns = {f"q{round(100 * q):02d}": bands[i].ravel() for i, q in enumerate(QUANTILES)}
    return pd.DataFrame(
        {"degradation_pct": levels.ravel(), "pressure_kPa": pressures.ravel()} | columns
    )


def _medians(degradation: Floats) -> Floats:
    """Return the rates of all draws, or the medians of those of each, (n_levels,)."""
    medians: Floats = degradation if degradation.ndim == 1 else np.median(degradation, axis=0)
    return medians


DRAWS, STRATA = 800, 6
_EDGE = 2.0**-40  # of which the normal law has finite quantiles


@dataclass(frozen=True)
class Specimens:
    """New specimens: several for each posterior draw.

    Parameters
    ----------
    model : JointModel
        Predicts them.
    values : mapping
        Named values, one a specimen, the specimens of a draw side by side, (n,).
    score : array, shape (n,)
        Deviation of each specimen's ln stiffness in standard deviations.
    strata : int
        Specimens of a draw.
    conditions : ServiceConditions
        In which they are used.
    """

    model: JointModel
    values: Named
    score: Floats
    strata: int
    conditions: ServiceConditions = PROMPT


@dataclass(frozen=True)
class Response:
    """Response of specimens to pressures.

    Parameters
    ----------
    curvature : array, shape (n, n_pressures)
        Without reading noise [1/m]; nan where the forward map has no answer.
    burst : array, shape (n_draws, n_pressures)
        Probability that a specimen of a draw has burst up to a pressure. One for which the forward
        map has no answer counts as burst, since it balloons or nothing is known about it.
    """

    curvature: Floats
    burst: Floats

    @property
    def answered(self) -> Floats:
        """Share of the specimens within the forward map's range, (n_pressures,)."""
        share: Floats = np.mean(np.isfinite(self.curvature), axis=0)
        return share


def draw_specimens(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    draws: int = DRAWS,
    strata: int = STRATA,
    conditions: ServiceConditions = PROMPT,
) -> Specimens:
    """Draw parameters, and specimens of each with stratified stiffness.

    The k-th of m specimens has the score Φ⁻¹((k + u)/m), with one u a draw, uniform in [0, 1): each
    is a random specimen, and a mean over them has less error than over as many independent ones.

    Parameters
    ----------
    model, chain : JointModel, Chain
        JointModel and its posterior.
    generator : Generator
        Draws parameters and u.
    draws, strata : int
        Draws, and specimens of each.
    conditions : ServiceConditions
        In which they are used.
    """
    values = draw_values(model, chain, generator, draws)
    place = (np.arange(strata) + generator.random((draws, 1))) / strata
    score = ndtri(np.clip(place, _EDGE, 1.0 - _EDGE)).ravel()
    repeated = {n: np.repeat(v, strata) for n, v in values.items()}
    return Specimens(model, repeated, score, strata, conditions)


def finer(specimens: Specimens, strata: int) -> Specimens:
    """Return more specimens of the same draws, at the midpoints of equal strata.

    Parameters
    ----------
    specimens : Specimens
        Of which the draws are taken.
    strata : int
        Specimens of a draw.
    """
    named = specimens.values  # noqa: PD011
    values = {n: np.repeat(v[:: specimens.strata], strata) for n, v in named.items()}
    draws = len(specimens.score) // specimens.strata
    score = np.tile(ndtri((np.arange(strata) + 0.5) / strata), draws)
    return replace(specimens, values=values, score=score, strata=strata)


def respond(specimens: Specimens, degradation: float | Floats, pressure: Floats) -> Response:
    """Return the response of specimens in their conditions.

    Parameters
    ----------
    specimens : Specimens
        Drawn once, so that answers at several pressures are those of the same specimens.
    degradation : float or array, shape (n_draws,) or (n,)
        Degradation rate of all, of the specimens of each draw, or of each specimen [%].
    pressure : array, shape (n_pressures,)
        As read by the sensor, rising [kPa].
    """
    curvature, burst = respond_each(specimens, degradation, pressure)
    return Response(curvature, burst.reshape(-1, specimens.strata, len(pressure)).mean(axis=1))


def respond_each(
    specimens: Specimens, degradation: float | Floats, pressure: Floats
) -> tuple[Floats, Floats]:
    """Return curvature [1/m] and probability of rupture of each specimen, (n, n_pressures).

    Parameters as in `respond`; specimens outside the range have no curvature and count as burst.
    """
    rates = np.atleast_1d(degradation)
    if np.ndim(degradation):
        rates = np.repeat(rates, len(specimens.score) // len(rates))[:, None]
    grid = Grid.of(specimens.model, rates, pressure, specimens.conditions)
    deviation = specimens.score[:, None, None] * grid.deviation_sd(specimens.values)
    reached = grid.reached(specimens.values, deviation)
    answered = reached.answered[:, 0]
    known = _burst(grid, specimens.values, reached) if has_elongation(grid.model.base) else 0.0
    curvature: Floats = np.where(answered, reached.curvature[:, 0], np.nan)
    return curvature, np.where(answered, known, 1.0)


def _burst(grid: Grid, values: Named, reached: Reached) -> Floats:
    """Return the probability that each specimen has burst, (n, n_pressures)."""
    strength = grid.strength(values).mapped(lambda array: array[:, 0])
    stretch = np.where(reached.answered[:, 0], np.maximum(reached.stretch[:, 0], 1.0), 1.0)
    return _probability(stretch, np.nan_to_num(reached.stretch_sd[:, 0]), strength)


def specimens_tested(model: JointModel) -> int:
    """Return the number of films broken and actuators loaded, the data on rupture.

    The distribution of the limit and the strains were checked on no more specimens. Films behind a
    published mean count too, as do actuators of which only the number burst is known.
    """
    films = len(model.data_of(Breaks).labels)
    means = (s for s in model.data_of(Means).statistics if s.quantity == "elongation_at_break")
    films += sum(round(s.dof) + 1 for s in means if np.isfinite(s.dof))
    own = len(model.data_of(Curvature).labels)
    others = sum(float(one.tests.tested.sum()) for one in model.of_kind(RuptureCounts))
    return films + own + int(others)


def fewest_checks(specimens: int, draws: int) -> int:
    """Return N, with 1/N the smallest probability that can be stated: specimens, or else draws."""
    return max(1, min(specimens or draws, draws))


def not_below(probability: Floats, checks: int) -> Floats:
    """Return probabilities of rupture with a floor of one in the number of checks.

    Smaller ones rest on a tail that no specimen has tested.

    Examples
    --------
    >>> not_below(np.array([2e-80, 0.5, np.nan]), 50)
    array([0.02, 0.5 ,  nan])
    """
    return np.maximum(probability, 1.0 / checks)


# Gauss–Hermite rule for the specimen's own stiffness
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)


def rupture_table(
    model: JointModel,
    chain: Chain,
    generator: np.random.Generator,
    *,
    degradation: Floats,
    pressure: Floats,
    draws: int = 500,
    specimens: int = 0,
    conditions: ServiceConditions = PROMPT,
) -> pd.DataFrame:
    """Return the probability that a specimen bursts up to a pressure.

    A specimen bursts if the stretch of the criterion exceeds its uniaxial elongation limit, which
    scatters about a median that depends on D_R. The probability averages over
    specimens; its 5 and 95 % quantiles are over the posterior. None of them is below one in the
    number of specimens that were tested, or of draws if that is not given, but for 0 of those that
    were never under pressure. Parameters are those of
    `curvature_bands`.

    Returns
    -------
    DataFrame
        Columns ``degradation_pct``, ``pressure_kPa``, ``probability``, ``probability_q05``,
        ``probability_q95`` [–]; a draw whose stretch lies outside the forward map's range counts
        as nan and is left out.
    """
    grid = Grid.of(model, degradation, pressure, conditions)
    values = draw_values(model, chain, generator, draws)
    strength, sd = grid.strength(values), grid.deviation_sd(values)
    total = np.zeros((draws, grid.levels, len(pressure)))
    for node, weight in zip(_NODES, _WEIGHTS / np.sum(_WEIGHTS), strict=True):
        reached = grid.reached(values, node * sd)
        stretch = np.where(reached.answered, np.maximum(reached.stretch, 1.0), np.nan)
        total += weight * _probability(stretch, reached.stretch_sd, strength)
    levels, pressures = np.meshgrid(_medians(degradation), pressure, indexing="ij")
    usable = np.mean(np.isfinite(total), axis=0) > 0.5
    safe = np.where(usable, total, 0.0)
    low, high = np.where(usable, np.nanquantile(safe, [0.05, 0.95], axis=0), np.nan)
    mean = np.where(usable, np.nanmean(safe, axis=0), np.nan)
    checks = fewest_checks(specimens, draws)
    # without pressure nothing bursts, unless it was under pressure before
    pressed = (pressures > 0.0) | conditions.has_history
    mean, low, high = (
        np.where(pressed, not_below(part, checks), 0.0 * part) for part in (mean, low, high)
    )
    return pd.DataFrame(
        {
            "degradation_pct": levels.ravel(),
            "pressure_kPa": pressures.ravel(),
            "probability": mean.ravel(),
            "probability_q05": low.ravel(),
            "probability_q95": high.ravel(),
        }
    )


def _probability(stretch: Floats, stretch_sd: Floats, strength: Strength) -> Floats:
    """Return the probability of having burst; the error of the forward map adds to the scatter."""
    known = np.isfinite(stretch)
    strain = np.where(known, stretch, 1.0) - 1.0
    share = stretch_sd / np.maximum(strain, 1e-12)
    with np.errstate(divide="ignore"):  # nothing bursts without strain
        probability = -np.expm1(strength.log_whole(np.log(strain), share))
    return np.where(known, probability, np.nan)
