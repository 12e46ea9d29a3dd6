"""Stress–stretch curves of films, with the inner loop of their likelihood."""

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, override

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import FilmConditions
from bayesdeg.causes.fold import applied
from bayesdeg.compiled import compiled
from bayesdeg.data.batches import batch_numbers, batch_order
from bayesdeg.data.study import Study, undeformed
from bayesdeg.material.degradation import bernstein_weights
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.arrays import PaddedRows, PathReadings, chosen, places_of_tests
from bayesdeg.observations.kinds import (
    Labels,
    Places,
    Rows,
    State,
)
from bayesdeg.observations.noise import (
    LANES,
    Linearised,
    Paths,
    correlated_normals,
    filter_of,
    paths_of,
    same_path,
    specimen_density,
)
from bayesdeg.observations.specimens import FilmsAndActuators, control_name
from bayesdeg.priors import HalfNormal, Named, Parameter, Uniform

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STRESS, FILM = "stress", "film"


TENSILE = (
    Parameter("tensile_noise", HalfNormal(0.05), "–", "proportional reading error of stress"),
    Parameter("tensile_noise_floor", HalfNormal(0.02), "MPa", "constant reading error of stress"),
    Parameter(
        "tensile_noise_length",
        Uniform(0.002, 0.15),
        "–",
        "correlation length of reading errors of stress in stretch",
    ),
)


@dataclass(frozen=True)
class TensileCurves:
    """Stress–stretch curves.

    Parameters
    ----------
    specimens : tuple of str
        One per curve.
    modes : tuple of str
        Mode of loading of each curve.
    degradation, degradation_sd : array, shape (n_specimens,)
        D_R of the film and its standard error [%].
    basis : array, shape (n_specimens, n_points, 3)
        Yeoh's design matrix for the recorded stress measure.
    stretch, stress : array, shape (n_specimens, n_points)
        [–], [MPa].
    cauchy : array of bool, shape (n_specimens, n_points)
        Whether the recorded stress is Cauchy stress.
    mask : array of bool, shape (n_specimens, n_points)
        Where there is an observation.
    temperature : array, shape (n_specimens,), optional
        Of the room [°C]; nan where not recorded, the default.
    batch : array of int, shape (n_specimens,), optional
        Number of its batch, see `bayesdeg.data.batches.batch_numbers`; by default 0.
    """

    specimens: tuple[str, ...]
    modes: tuple[str, ...]
    degradation: Floats
    degradation_sd: Floats
    basis: Floats
    stretch: Floats
    stress: Floats
    cauchy: Flags
    mask: Flags
    temperature: Floats = field(default_factory=lambda: np.array(np.nan))
    batch: NDArray[np.int64] = field(default_factory=lambda: np.array(0))

    @cached_property
    def conditions(self) -> FilmConditions:
        """Test conditions."""
        return FilmConditions(
            self.stretch,
            np.array(self.modes),
            self.cauchy,
            self.degradation,
            self.temperature,
            self.batch,
        )

    @cached_property
    def paths(self) -> Paths:
        """The readings of each film as a path of stretch."""
        travelled = np.abs(np.diff(self.stretch, axis=1, prepend=1.0))
        return paths_of(self.mask[:, None, :], np.cumsum(travelled, axis=1))

    @property
    def readings(self) -> Floats:
        """The stresses [MPa], (n_specimens, n_points)."""
        return self.stress

    def with_readings(self, readings: Floats) -> "TensileCurves":
        """Return the same tests with different stresses."""
        return replace(self, stress=np.where(self.mask, readings, 0.0))

    def subset(self, rows: Rows) -> "TensileCurves":
        """Return the curves of some specimens."""
        return chosen(self, rows)


def no_films() -> TensileCurves:
    """Return tests of no film."""
    one, none, never = np.empty(0), np.empty((0, 1)), np.empty((0, 1), bool)
    return TensileCurves((), (), one, one, np.empty((0, 1, 3)), none, none, never, never)


def tensile_curves(study: Study, *, fitted: bool) -> TensileCurves | None:
    """Return the tensile curves of the fitted modes, or of the held-out ones."""
    table = study.tensile
    if table is None:
        return None
    table = table[
        (table["mode"].isin(study.settings.tensile.fit_modes) == fitted) & ~undeformed(table)
    ]
    if table.empty:
        return None
    # sorted by stretch, so that row order does not matter
    table = table.sort_values("stretch", kind="stable")
    batches = batch_order(study.tensile, study.actuator)
    order = table.groupby(["specimen_id", "mode"], sort=False)
    groups = sorted((group for _, group in order), key=lambda group: int(group.index.min()))
    rows = PaddedRows(groups)
    modes = tuple(str(group["mode"].iloc[0]) for group in groups)
    stretch, measure = rows.numbers("stretch", 1.0), rows.words("stress_measure", "nominal")
    return TensileCurves(
        specimens=rows.specimens,
        modes=modes,
        degradation=rows.first("degradation_pct"),
        degradation_sd=rows.first("degradation_sd_pct"),
        basis=yeoh_basis(stretch, np.array(modes)[:, None], measure),
        stretch=stretch,
        stress=rows.numbers("stress_MPa", 0.0),
        cauchy=measure == "cauchy",
        mask=rows.recorded,
        temperature=np.array([group["temperature_C"].median() for group in groups]),
        batch=np.array([int(batch_numbers(group, batches)[0]) for group in groups]),
    )


@compiled
def film_density(
    stress: Floats,
    at_rest: Floats,
    by_rate: Floats,
    noise: Floats,
    spread: Floats,
    length: Floats,
    mask: Flags,
    gap: Floats,
    passes: int,
    density: Floats,
    deviation: Floats,
) -> None:
    """Compute the log density of each film's readings and its most probable deviations.

    Parameters
    ----------
    stress : array, shape (n_specimens, n_points)
        As read [MPa].
    at_rest, by_rate : array, shape (n, n_specimens, n_points)
        As in `Stresses`.
    noise : array, shape (n, 2)
        Constant [MPa] and proportional [–] reading error.
    spread, length : array, shape (n, n_specimens, 2), (n,)
        As in `bayesdeg.observations.noise.Linearised`.
    mask, gap : array, shape (n_specimens, n_points)
        As in `bayesdeg.observations.noise.Paths`.
    passes : int
        Number of linearisations, the first at zero deviation.
    density, deviation : array, shape (n, n_specimens), (n, n_specimens, 2)
        Output: of the last linearisation, and the resulting deviation.
    """
    n, n_specimens, n_points = at_rest.shape
    alike, count = same_path(mask, gap), 0
    rows, white = np.empty((n_points, 4 * LANES)), np.empty((n_points, 3 * LANES))
    gains, order = np.empty((n_points, 3 * LANES)), np.empty(n_points, np.int64)
    lengths, none, constant = np.empty(LANES), np.zeros(LANES), np.empty(LANES)
    median, law, found = np.empty((n_points, 2 * LANES)), np.empty(6 * LANES), np.empty((3, LANES))
    for first in range(0, n, LANES):
        here = min(LANES, n - first)
        for lane in range(LANES):
            lengths[lane] = length[first + min(lane, here - 1)]
        for s in range(n_specimens):
            if not alike[s]:
                count = filter_of(lengths, none, mask[s], gap[s], n_points, gains, order, constant)
            for lane in range(LANES):
                b = first + min(lane, here - 1)
                law[lane], law[LANES + lane] = noise[b, 0] * noise[b, 0], noise[b, 1]
                law[2 * LANES + lane] = math.sqrt(spread[b, s, 0])
                law[3 * LANES + lane] = math.sqrt(spread[b, s, 1])
                for j in range(n_points):
                    median[j, lane], median[j, LANES + lane] = at_rest[b, s, j], by_rate[b, s, j]
            law[4 * LANES :] = 0.0
            for _ in range(passes):
                _linearise(stress[s], median, law, rows)
                specimen_density(
                    rows, gains, order[:count], n_points, none, constant, white, found
                )  # fmt: skip
                law[4 * LANES : 5 * LANES] = found[1] * law[2 * LANES : 3 * LANES]
                law[5 * LANES :] = found[2] * law[3 * LANES : 4 * LANES]
            for lane in range(here):
                density[first + lane, s] = found[0, lane]
                deviation[first + lane, s, 0] = law[4 * LANES + lane]
                deviation[first + lane, s, 1] = law[5 * LANES + lane]


@compiled
def _linearise(stress: Floats, median: Floats, law: Floats, rows: Floats) -> None:
    """Linearise the stresses of one film about its deviations, as ``films.film_readings``.

    ``law`` holds the constant error's square, the proportional error, τ of both deviations, and
    the deviations, each for `LANES` vectors.
    """
    factor = np.empty(LANES)
    for lane in range(LANES):
        factor[lane] = math.exp(law[4 * LANES + lane])
    for j in range(len(stress)):
        at, row = median[j], rows[j]
        for lane in range(LANES):
            log_stiffness, rate = law[4 * LANES + lane], law[5 * LANES + lane]
            change = factor[lane] * at[LANES + lane]
            expected = factor[lane] * at[lane] + change * rate
            row[lane] = stress[j] - expected + expected * log_stiffness + change * rate
            row[LANES + lane] = expected * law[2 * LANES + lane]
            row[2 * LANES + lane] = change * law[3 * LANES + lane]
            error = law[LANES + lane] * expected
            row[3 * LANES + lane] = law[lane] + error * error


PASSES = 3
"""Number of linearisations, the first at zero deviation."""


class Stresses(NamedTuple):
    """Stresses of the median material with the effects of causes, (n, n_specimens, n_points).

    Parameters
    ----------
    at_rest : array
        Of films without deviations [MPa].
    by_rate : array
        Derivative with respect to the degradation rate [MPa/%].
    """

    at_rest: Floats
    by_rate: Floats


def median_stresses(state: State[FilmsAndActuators], data: TensileCurves) -> Stresses:
    """Return stresses of films of the median material."""
    material = state.world.material(state.values, data.degradation)
    causes, parts = state.acting(), []
    for constants in material:
        stress = (
            data.basis[..., 0] * constants[..., None, 0]
            + data.basis[..., 1] * constants[..., None, 1]
            + data.basis[..., 2] * constants[..., None, 2]
        )
        parts.append(applied("on_stress", stress, data.conditions, causes, constants))
    return Stresses(*parts)


def linearise_films(data: TensileCurves, values: Named, median: Stresses) -> Linearised:
    r"""Linearise stresses at the films' most probable deviations.

    .. math:: \sigma = e^m \sum_i \phi_i(\lambda) (C_i + d\, C_i')

    with m the deviation of ln stiffness and d that of the degradation rate [%], φ Yeoh's basis.
    """
    deviation = _density_and_mode(data, values, median, passes=PASSES - 1)[1]
    stress, slope = film_readings(median, deviation)
    residual = data.stress - stress
    residual += slope[..., 0] * deviation[..., None, 0]
    residual += slope[..., 1] * deviation[..., None, 1]
    return Linearised(
        residual,
        slope,
        stress_variance(values, stress),
        _spread(data, values),
        values["tensile_noise_length"],
        np.zeros(len(residual)),
        data.paths,
    )


def log_density(data: TensileCurves, values: Named, median: Stresses) -> Floats:
    """Return log densities of whole films, (n, n_specimens).

    The readings are linearised by `linearise_films`.
    """
    return _density_and_mode(data, values, median, passes=PASSES)[0]


def film_readings(median: Stresses, deviation: Floats) -> tuple[Floats, Floats]:
    """Return stresses of films, (n, n_specimens, n_points) [MPa], and their derivatives.

    Deviations (n, n_specimens, 2) are of ln stiffness [–] and of the degradation rate [%];
    derivatives with respect to them are (n, n_specimens, n_points, 2) [MPa], [MPa/%].
    """
    factor = np.exp(deviation[..., None, 0])
    by_rate = factor * median.by_rate
    stress = factor * median.at_rest + by_rate * deviation[..., None, 1]
    return stress, np.stack([stress, by_rate], axis=-1)


def stress_variance(values: Named, stress: Floats) -> Floats:
    """Return the variance of the reading error of stresses (n, n_specimens, n_points) [MPa²]."""
    floor, share = (
        values[name][:, None, None] for name in ("tensile_noise_floor", "tensile_noise")
    )
    variance: Floats = floor**2 + (share * stress) ** 2
    return variance


def _density_and_mode(
    data: TensileCurves, values: Named, median: Stresses, *, passes: int
) -> tuple[Floats, Floats]:
    """Return the density of the last linearisation, and its deviations."""
    spread = _spread(data, values)
    density, deviation = np.empty(spread.shape[:2]), np.empty(spread.shape)
    film_density(
        np.ascontiguousarray(data.stress),
        np.ascontiguousarray(median.at_rest),
        np.ascontiguousarray(median.by_rate),
        np.stack([values["tensile_noise_floor"], values["tensile_noise"]], axis=-1),
        spread,
        np.ascontiguousarray(values["tensile_noise_length"]),
        np.ascontiguousarray(data.paths.mask),
        np.ascontiguousarray(data.paths.gap),
        passes,
        density,
        deviation,
    )
    return density, deviation


def _spread(data: TensileCurves, values: Named) -> Floats:
    """Return τ² of ln stiffness [–] and of the degradation rate [%²], (n, n_specimens, 2)."""
    scatter = values["stiffness_scatter"]
    spread = np.empty((len(scatter), len(data.stress), 2))
    spread[..., 0] = scatter[:, None] ** 2
    spread[..., 1] = data.degradation_sd**2
    return spread


SMALLEST = (1e-3, -np.inf, 1e-6)  # of the control values of C1, C2, C3 [MPa]
NOISE = 0.03  # relative error of stress by which readings are weighted


@dataclass(frozen=True)
class Tensile(PathReadings[TensileCurves]):
    """Stress–stretch curves of films.

    Parameters
    ----------
    tests : TensileCurves
        The readings.
    by_mode : bool, optional
        Whether films are held out mode by mode; by default if there are several modes.

    Notes
    -----
    The error of the degradation rate acts through all three constants.
    """

    name: ClassVar[str] = "tensile"
    order: ClassVar[int] = 10
    priority: ClassVar[int] = 1
    is_criticised: ClassVar[bool] = True
    beside: ClassVar[bool] = True
    floors: ClassVar[Mapping[str, str]] = {"tensile_noise_floor": "stress_MPa"}

    tests: TensileCurves = field(default_factory=no_films)
    by_mode: bool | None = None

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        return TENSILE

    @property
    @override
    def is_by_mode(self) -> bool:
        return len(set(self.tests.modes)) > 1 if self.by_mode is None else self.by_mode

    @property
    @override
    def row_groups(self) -> tuple[str, ...]:
        return self.tests.modes if self.is_by_mode else self.tests.specimens

    @override
    def held_beside(self) -> "Tensile":
        return replace(self, by_mode=False)

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        return log_density(self.tests, state.values, self.stresses(state))

    @override
    def subset(self, rows: Rows) -> "Tensile":
        # keep the groups, even if only one mode is left
        return Tensile(self.tests.subset(rows), self.is_by_mode)

    def stresses(self, state: State[FilmsAndActuators]) -> Stresses:
        """Return stresses of films of the median material."""
        return state.once(median_stresses, self.tests)

    @override
    def linearised(self, state: State[FilmsAndActuators]) -> Linearised:
        """Linearise the curves at the films' most probable deviations."""
        return linearise_films(self.tests, state.values, self.stresses(state))

    @cached_property
    @override
    def places(self) -> Places:
        modes = np.array(self.tests.modes, dtype=np.str_)
        return places_of_tests(self.tests, (STRESS,), FILM, self.tests.stretch, modes[:, None])

    @property
    @override
    def reading_groups(self) -> Labels:
        return self.places.history if self.is_by_mode else self.places.specimen

    @override
    def expected(self, state: State[FilmsAndActuators]) -> Floats:
        return self.stresses(state).at_rest[:, self.tests.mask]

    @override
    def drawn(self, state: State[FilmsAndActuators], generator: np.random.Generator) -> Floats:
        """Draw stresses of new films in the same tests, (n, n_specimens, n_points)."""
        data, values = self.tests, state.values
        shape = (len(values["stiffness_scatter"]), len(data.specimens))
        scatter = np.broadcast_to(values["stiffness_scatter"][:, None], shape)
        sd = np.stack([scatter, np.broadcast_to(data.degradation_sd, shape)], axis=-1)
        deviation = sd * generator.standard_normal(sd.shape)
        stress, _ = film_readings(self.stresses(state), deviation)
        length = values["tensile_noise_length"]
        z = correlated_normals(data.paths, length, np.zeros(len(length)), generator)
        read: Floats = stress + np.sqrt(stress_variance(values, stress)) * z
        return read

    @override
    def start(self, world: FilmsAndActuators) -> dict[str, float]:
        """Return control values of the constants by least squares, as stress is linear in them."""
        # takes a second to import, and reading data does not need it
        optimize = importlib.import_module("scipy.optimize")
        data, nodes = self.tests, world.nodes
        names = ("c1",) if world.law == "neo_hookean" else ("c1", "c2_ratio", "c3")
        weights = bernstein_weights(data.degradation, nodes)
        columns = (data.basis[..., : len(names), None] * weights[:, None, None, :])[data.mask]
        stress = data.stress[data.mask]
        scale = 1.0 / (NOISE * (np.abs(stress) + 0.05 * float(np.abs(stress).max())))
        design = columns.reshape(len(stress), -1) * scale[:, None]
        lower = np.repeat(SMALLEST[: len(names)], len(nodes))
        solved = optimize.lsq_linear(design, stress * scale, (lower, np.inf)).x
        found = dict(zip(names, solved.reshape(len(names), -1), strict=True))
        if "c3" in found:
            found["c2_ratio"] = found["c2_ratio"] / np.sqrt(3.0 * found["c1"] * found["c3"])
        return {
            control_name(name, nodes, k): float(controls[k])
            for name, controls in found.items()
            for k in range(len(nodes))
        }


def from_study(study: Study) -> tuple[Tensile, ...]:
    """Return the curves of the fitted modes, if any."""
    curves = tensile_curves(study, fitted=True)
    return () if curves is None else (Tensile(curves),)
