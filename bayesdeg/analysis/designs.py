"""Further experiments modelled on the tests of a study.

Measurement errors and scatter between parts are assumed: a calliper or a microscope on a soft part,
a second gauge of the same class as the first.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.batch_stiffness import CONTRASTS
from bayesdeg.causes.cause import Conditions, Degradation, Stage
from bayesdeg.causes.erosion import NOMINAL_WALL
from bayesdeg.causes.fold import acting, applied
from bayesdeg.causes.temperature_softening import USUAL
from bayesdeg.criticism.experiments.ranking import (
    ActuatorTests,
    Experiment,
    ExperimentPlan,
    FilmTests,
    VolumeTests,
)
from bayesdeg.data.levels import LEVEL_WIDTH, levels
from bayesdeg.inference.model import JointModel
from bayesdeg.material.degradation import young_modulus
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.curvature import ActuatorCurves, Curvature, mechanics_inputs
from bayesdeg.observations.pressures import PressureTests
from bayesdeg.observations.specimens import PAPER_STIFFNESS, layer_stiffness, linear_scale
from bayesdeg.observations.tensile import Tensile, TensileCurves
from bayesdeg.observations.volume import CavityVolume
from bayesdeg.priors import Named

Floats = NDArray[np.float64]

MOST_STEPS = 16
MOST_COPIES = 3
DWELL = 10.0  # s between readings where the study recorded no time
LONG = 300.0  # s at one pressure


@dataclass(frozen=True)
class ActuatorDesign:
    """Design of a study's actuator tests.

    Parameters
    ----------
    data : ActuatorCurves
        The tests.
    levels : tuple of float
        Nominal degradation levels [%], ascending.
    copies : int
        Specimens of a level, the median, at most 3.
    timed : bool
        Whether times were recorded.
    dwell : float
        Time between readings [s].
    """

    data: ActuatorCurves
    levels: tuple[float, ...]
    copies: int
    timed: bool
    dwell: float

    @classmethod
    def of(cls, data: ActuatorCurves) -> Self:
        """Return the design of a study's actuator tests."""
        centres = levels(data.degradation[:, 0])[0].round(1).tolist()
        counts = [len(_near(data, level)) for level in centres]
        steps = np.diff(data.time, axis=1)[data.mask[:, 1:]]
        steps = steps[steps > 0.0]
        return cls(
            data,
            tuple(centres),
            int(np.clip(np.median(counts), 1, MOST_COPIES)),
            bool(np.isfinite(data.time).any()),
            float(np.median(steps)) if len(steps) else DWELL,
        )

    @property
    def long_hold(self) -> bool:
        """Whether any pressure was held for long."""
        same = np.isclose(np.diff(self.data.pressure, axis=1), 0.0)
        return bool(np.any(same & (np.diff(self.data.time, axis=1) >= LONG)))

    def pressures(self, level: float) -> Floats:
        """Return the steps of a loading [kPa], up to the pressure that half of them reached."""
        rows = _near(self.data, level)
        read = self.data.mask[rows]
        highest = np.where(read, self.data.pressure[rows], 0.0).max(axis=1)
        steps: Floats = np.unique(self.data.pressure[self.data.mask].round(6))
        steps = steps[steps <= max(np.median(highest), steps[0]) + 1e-6]
        if len(steps) > MOST_STEPS:
            steps = steps[np.linspace(0, len(steps) - 1, MOST_STEPS).round().astype(int)]
        return steps

    def degradation_sd(self, level: float) -> float:
        """Return the standard error of degradation rates near one [%]."""
        return float(self.data.degradation_sd[_near(self.data, level)].mean())

    def another_level(self, last_of_films: float) -> float | None:
        """Return an untested degradation rate at which the films' law is known."""
        if last_of_films - self.levels[-1] > LEVEL_WIDTH:
            return last_of_films
        gaps = np.diff(self.levels)
        if not len(gaps) or gaps.max() < 2.0 * LEVEL_WIDTH:
            return None
        widest = int(np.argmax(gaps))
        return float(round(self.levels[widest] + 0.5 * gaps[widest], 1))

    def curves(
        self,
        levels: tuple[float, ...] | list[float],
        pressure: Floats,
        *,
        time: Floats | None = None,
        branch: NDArray[np.str_] | str = "loading",
        cycle: NDArray[np.int64] | int = 1,
        mount: str = "",
        temperature: float = np.nan,
        batches: tuple[int, ...] = (),
        angle: bool = False,
    ) -> ActuatorCurves:
        """Return tests without readings, all at the same pressures, otherwise unchanged."""
        shape = (len(levels), len(pressure))
        usual_times = np.arange(len(pressure)) * (self.dwell if self.timed else np.nan)
        usual = str(_most_common(self.data.mount[self.data.mask]))
        read = np.ones(shape, dtype=bool)
        return ActuatorCurves(
            specimens=tuple(f"new {k} at {level:g} %" for k, level in enumerate(levels)),
            degradation=np.array(levels, dtype=np.float64)[:, None],
            degradation_sd=np.array([[self.degradation_sd(level)] for level in levels]),
            pressure=np.broadcast_to(pressure, shape),
            curvature=np.zeros(shape),
            curvature_sd=np.full(shape, np.median(self.data.curvature_sd[self.data.mask])),
            angle_sd=np.full(shape, np.median(self.data.angle_sd[self.data.mask])),
            mask=read,
            bend_angle=np.zeros(shape),
            angle_mask=read & (angle or self.data.with_angle),
            recorded=read,
            ruptured=~read,
            cycle=np.broadcast_to(np.asarray(cycle, dtype=np.int64), shape),
            branch=np.broadcast_to(np.asarray(branch), shape),
            time=np.broadcast_to(usual_times if time is None else time, shape),
            humidity=np.full(shape, _usual(self.data.humidity)),
            mount=np.full(shape, mount or usual),
            temperature=np.full(
                shape, _usual(self.data.temperature) if np.isnan(temperature) else temperature
            ),
            batch=np.array(batches)[:, None] if batches else self._batches(levels),
        )

    def _batches(self, levels: tuple[float, ...] | list[float]) -> NDArray[np.int64]:
        """Return the batch of most specimens near each rate, (n_levels, 1)."""
        batch = self.data.conditions.batch[:, 0]
        return np.array([[_most_common(batch[_near(self.data, level)])] for level in levels])

    def batch_name(self, number: int) -> str:
        """Return the study's name of a batch; empty if none is recorded."""
        batch, names = np.broadcast_arrays(self.data.batch, self.data.batch_name)
        names = names[(batch == number) & (names != "")]
        return str(names[0]) if len(names) else ""

    def experiment(
        self,
        kind: str,
        curves: ActuatorCurves,
        *,
        mount: str = "",
        temperature: float = np.nan,
        batch: str = "",
        hold: float = 0.0,
    ) -> Experiment:
        """Return an experiment on as many specimens as the study has per level."""
        return Experiment(
            ExperimentPlan(
                kind,
                self.copies * len(curves.specimens),
                tuple(dict.fromkeys(curves.degradation[:, 0].tolist())),
                low=float(curves.pressure.min()),
                top=float(curves.pressure.max()),
                timed=self.timed,
                mount=mount,
                temperature_c=temperature,
                batch=batch,
                hold_s=hold,
                steps=curves.pressure.shape[1],
            ),
            ActuatorTests(curves, self.copies),
        )


@dataclass(frozen=True)
class FilmDesign:
    """Design of a study's film tests.

    Parameters
    ----------
    data : TensileCurves
        The tests.
    level : float
        The lowest degradation rate [%].
    copies : int
        Films of it, at most 3.
    """

    data: TensileCurves
    level: float
    copies: int

    @classmethod
    def of(cls, data: TensileCurves) -> Self:
        """Return the design of a study's film tests."""
        level = float(data.degradation.min())
        there = int(np.sum(np.abs(data.degradation - level) <= LEVEL_WIDTH))
        return cls(data, level, min(there, MOST_COPIES))

    def curves(self, mode: str) -> TensileCurves:
        """Return a test of one film in a new mode, up to half the elongation reached so far."""
        rows = np.flatnonzero(np.abs(self.data.degradation - self.level) <= LEVEL_WIDTH)
        largest = float(np.median(self.data.stretch[rows].max(axis=1)))
        count = min(int(self.data.mask[rows].sum(axis=1).max()), MOST_STEPS)
        # other modes break earlier, and strain the material more
        stretch = np.linspace(1.0, 1.0 + 0.5 * (largest - 1.0), count + 1)[None, 1:]
        batch = np.broadcast_to(self.data.batch, len(self.data.specimens))
        return TensileCurves(
            specimens=(f"new in {mode}",),
            modes=(mode,),
            degradation=np.array([self.level]),
            degradation_sd=np.array([float(self.data.degradation_sd[rows].mean())]),
            basis=yeoh_basis(stretch, np.array([[mode]]), np.array([["nominal"]])),
            stretch=stretch,
            stress=np.zeros_like(stretch),
            cauchy=np.zeros(stretch.shape, dtype=bool),
            mask=np.ones(stretch.shape, dtype=bool),
            temperature=np.array([_usual(self.data.temperature)]),
            batch=np.array([_most_common(batch[rows])]),
        )


def _usual(values: Floats) -> float:
    """Return the median of the recorded values; nan without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def _most_common[T: np.generic](values: NDArray[T]) -> T:
    """Return the most frequent value, the first in order if several are."""
    found, counts = np.unique(values, return_counts=True)
    common: T = found[np.argmax(counts)]
    return common


def _near(data: ActuatorCurves, level: float) -> NDArray[np.intp]:
    """Return the specimens at a level, or the nearest one."""
    distance = np.abs(data.degradation[:, 0] - level)
    return np.flatnonzero(distance <= max(LEVEL_WIDTH, float(distance.min())))


Flags = NDArray[np.bool_]

LENGTH_ERROR = 0.01  # relative error of the length: 0.5 mm in 50 mm, calliper and moulding
WALL_ERROR = 0.05 / NOMINAL_WALL  # 0.05 mm under a microscope
WALL_SCATTER = 0.02  # relative scatter of the thickness, between parts
STRIP_ERROR = 0.05  # relative error of the stiffness of a small strip, besides specimen scatter
PAPER_ERROR = 0.05  # relative error of the stiffness of a strip of paper, including its scatter
GAUGE_ERROR = 1.0  # kPa
WEIGHING_ERROR = 1.0  # error of the degradation rate of one weighed piece, in points


class Measurand(StrEnum):
    """Quantities measured on a part, by the name of the experiment."""

    LENGTH = "length"
    WALL = "roof"
    STRIP = "strip of the wall"
    PAPER = "strip of the paper"
    GAUGE = "second gauge"
    WEIGHED = "weighed piece"


@dataclass(frozen=True)
class PartMeasurements:
    """Direct measurements on parts.

    Parameters
    ----------
    quantity : Measurand
        What is measured.
    degradation, degradation_sd : array, shape (S, 1)
        Of each kind of specimen, as recorded, and its standard error [%].
    pressure : array, shape (S, R)
        As read by the sensor while it is measured [kPa].
    copies : int
        Specimens of each kind.
    """

    quantity: Measurand
    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    copies: int

    @property
    def read(self) -> Flags:
        """Where there is a reading."""
        return np.ones(self.pressure.shape, dtype=bool)

    errors = ()  # they are stated

    def expected(self, model: JointModel, values: Named) -> Floats:
        """Return readings expected."""
        return self._readings(model, values)[0]

    def covariance(self, model: JointModel, values: Named) -> Floats:
        """Return their covariance; errors are independent."""
        variance = self._readings(model, values)[1]
        return variance[..., None] * np.eye(variance.shape[-1])

    def simulated(self, model: JointModel, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings of new parts."""
        mean, variance = self._readings(model, values)
        drawn: Floats = mean + np.sqrt(variance) * generator.standard_normal(mean.shape)
        return drawn

    def _readings(self, model: JointModel, values: Named) -> tuple[Floats, Floats]:
        """Return readings expected and their variance with the scatter of parts, (n, S, R)."""
        conditions = Conditions(self.pressure, self.degradation)
        believed = Degradation(self.degradation, self.degradation_sd)
        causes = acting(model.causes, values)
        believed = applied("on_degradation", believed, conditions, causes)
        shape = (len(values["stiffness_scatter"]), len(self.degradation))
        level = np.broadcast_to(believed.value[..., 0], shape)
        c1, c2, c3 = np.moveaxis(model.world.constants(values, level)[..., None], 2, 0)
        plain = Inputs(
            pressure=self.pressure,
            c1=c1,
            c2=c2,
            c3=c3,
            linear_scale=linear_scale(values)[:, None, None],
            paper_stiffness=layer_stiffness(values)[:, None, None],
        )
        # responses of the material to the load are not properties of the part
        lasting = (one for one in causes if one.cause.stage <= Stage.LOAD)
        part = applied("on_inputs", plain, conditions, lasting)
        mean: Floats
        variance: Floats | float
        match self.quantity:
            case Measurand.LENGTH:
                mean, variance = part.linear_scale, (LENGTH_ERROR * part.linear_scale) ** 2
            case Measurand.WALL:  # over that in the mould; one of its faces is exposed
                lost = _or_neutral(part.erosion, 0.0) / NOMINAL_WALL
                mean = part.linear_scale * _or_neutral(part.wall_factor, 1.0) - lost
                variance = WALL_ERROR**2 + (WALL_SCATTER * mean) ** 2
            case Measurand.STRIP:  # ln of Young's modulus [MPa]
                mean = np.log(young_modulus(part.c1, _or_neutral(part.second_invariant, 0.0)))
                variance = values["stiffness_scatter"][:, None, None] ** 2 + STRIP_ERROR**2
            case Measurand.PAPER:
                mean, variance = np.log(part.paper_stiffness), PAPER_ERROR**2
            case Measurand.GAUGE:
                mean, variance = part.pressure, GAUGE_ERROR**2
            case Measurand.WEIGHED:
                mean, variance = believed.value, believed.sd**2 + WEIGHING_ERROR**2
        whole = (len(values["stiffness_scatter"]), *self.pressure.shape)
        return np.broadcast_to(mean, whole), np.broadcast_to(variance, whole)


def _or_neutral(value: Floats | None, neutral: float) -> Floats:
    """Return an input, neutral if no cause changed it."""
    return np.asarray(neutral if value is None else value)


LONG_HOLD = 120.0  # s, of each step
HELD = np.array([0.0, 10.0, 30.0, 60.0, 120.0, 300.0, 900.0, 1800.0])  # s, at one pressure
MOUNTS = ("hanging", "bending_up", "bending_down", "horizontal")
MODES = ("equibiaxial", "planar", "uniaxial")
FRESH = 0.5  # %
WARMER = 6.0
"""Degrees above the usual room temperature: a heated room, 30 instead of 24 °C. Gelatin gels with
only water melt there; a pneumatic actuator is of one that does not."""


def candidate_experiments(model: JointModel) -> tuple[Experiment, ...]:
    """Return the possible next experiments of a study.

    They keep to the pressures, degradation rates and number of specimens of the study. Tests that
    are possible at any degradation rate are proposed at the lowest and the highest;
    `bayesdeg.criticism.experiments.ranking.rank` keeps the better one.

    From the base model with its data; empty if it has neither actuators nor films.
    """
    found: list[Experiment] = []
    for tests in model.of_kind(Curvature):
        design = ActuatorDesign.of(tests.tests)
        for level in dict.fromkeys((design.levels[0], design.levels[-1])):
            found += _histories(design, level)
            found += _of_part(design, level, with_paper=PAPER_STIFFNESS in model.table.names)
        found += _at_levels(design, model)
        for level in dict.fromkeys((design.levels[0], design.levels[-1])):
            found += _rooms(design, level)
            found += _batches(design, level)
            found += _volumes(design, level, model)
    for films in model.of_kind(Tensile):
        tested = FilmDesign.of(films.tests)
        for mode in [m for m in MODES if m not in tested.data.modes]:
            plan = ExperimentPlan(mode, tested.copies, (tested.level,))
            found.append(Experiment(plan, FilmTests(tested.curves(mode), tested.copies)))
    return tuple(found)


def _histories(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield tests at one degradation rate with another load history or mount, or more readings."""
    data, rising = design.data, design.pressures(level)
    steps = np.linspace(0.0, (2 * len(rising) - 1) * design.dwell, 2 * len(rising))
    if not np.any(data.branch == "unloading"):
        falling = rising[-2::-1]
        curves = design.curves(
            [level],
            np.append(rising, falling),
            time=steps[:-1],
            branch=np.repeat(["loading", "unloading"], [len(rising), len(falling)]),
        )
        yield design.experiment("unloading", curves)
    if np.all(data.cycle == 1):
        curves = design.curves(
            [level], np.tile(rising, 2), time=steps, cycle=np.repeat([1, 2], len(rising))
        )
        yield design.experiment("cycle", curves)
    if design.dwell < 0.5 * LONG_HOLD:
        time = np.linspace(0.0, (len(rising) - 1) * LONG_HOLD, len(rising))
        curves = design.curves([level], rising, time=time)
        yield design.experiment("held steps", curves, hold=LONG_HOLD)
    if not design.long_hold:
        middle = float(rising[len(rising) // 2])
        curves = design.curves([level], np.full(len(HELD), middle), time=HELD)
        yield design.experiment("hold", curves, hold=float(HELD[-1]))
    for mount in [m for m in MOUNTS if m not in data.mount]:
        curves = design.curves([level], rising, mount=mount)
        yield design.experiment("second mount", curves, mount=mount)
    if len(rising) > 1:
        between = 0.5 * (rising + np.append(0.0, rising[:-1]))
        finer = np.sort(np.append(rising, between))
        yield design.experiment("finer steps", design.curves([level], finer))
    if not data.with_angle:
        curves = design.curves([level], rising, angle=True)
        yield design.experiment("bend angle", curves)


def _at_levels(design: ActuatorDesign, model: JointModel) -> Iterator[Experiment]:
    """Yield tests at a further degradation rate, and one more specimen at each."""
    new = design.another_level(model.world.nodes[-1])
    if new is not None:
        yield design.experiment("another level", design.curves([new], design.pressures(new)))
    levels = design.levels
    curves = design.curves(levels, design.pressures(levels[-1]))
    yield Experiment(
        ExperimentPlan("more specimens", len(levels), levels), ActuatorTests(curves, 1)
    )


def _rooms(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield a test in a warmer room, if all rooms had about the same temperature."""
    rooms = design.data.conditions.room_temperature
    known = rooms[np.isfinite(rooms)]
    if len(known) and np.ptp(known) >= WARMER:
        return
    warm = WARMER + (float(np.median(known)) if len(known) else USUAL)
    curves = design.curves([level], design.pressures(level), temperature=warm)
    yield design.experiment("warmer room", curves, temperature=warm)


def _batches(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield tests of batches that were not tested at a degradation rate.

    If all actuators are of one batch, or none is recorded, two batches are compared.
    """
    data, rising = design.data, design.pressures(level)
    batch = data.conditions.batch[:, 0]
    known, there = np.unique(batch), batch[_near(data, level)]
    if len(known) == 1:
        curves = design.curves([level, level], rising, batches=(0, 1))
        # no more than in other tests, but at least one of each batch
        half = replace(design, copies=max(design.copies // 2, 1))
        yield half.experiment("two batches", curves)
    elif known[-1] <= len(CONTRASTS):
        for one in np.setdiff1d(known, there).tolist():
            curves = design.curves([level], rising, batches=(one,))
            yield design.experiment("another batch", curves, batch=design.batch_name(one))


def _volumes(design: ActuatorDesign, level: float, model: JointModel) -> Iterator[Experiment]:
    """Yield a test that reads the chamber volume, if the forward map predicts it."""
    if model.of_kind(CavityVolume):
        return
    curves = design.curves([level], design.pressures(level))
    tests = PressureTests(
        curves.specimens,
        curves.degradation,
        curves.degradation_sd,
        curves.conditions,
        np.zeros(curves.mask.shape),
        curves.mask,
    )
    at_medians = {p.name: np.atleast_1d(p.law.quantile(0.5)) for p in model.table.parameters}
    asked = mechanics_inputs(model.tests(at_medians), tests, np.zeros((1, 1, 1)))
    found = model.world.forward(replace(asked, asked=CavityVolume.asks)).further
    if found is None or not np.isfinite(found.value).any():
        return
    read = np.broadcast_to(np.nan_to_num(found.value)[0], curves.mask.shape)
    volumes = CavityVolume(replace(tests, read=read), curves)
    one = design.experiment("cavity volume", curves)
    measurement = VolumeTests(ActuatorTests(curves, design.copies), volumes)
    yield replace(one, measurement=measurement)


def _of_part(design: ActuatorDesign, level: float, *, with_paper: bool) -> Iterator[Experiment]:
    """Yield direct measurements of the part at one degradation rate."""
    rising = design.pressures(level)
    gauge = np.unique(rising[[0, len(rising) // 2, -1]])
    measured = {
        Measurand.LENGTH: rising[-1:],
        Measurand.WALL: rising[-1:],
        Measurand.STRIP: rising[-1:],
        **({Measurand.PAPER: rising[-1:]} if with_paper else {}),
        Measurand.GAUGE: gauge,
        **({Measurand.WEIGHED: rising[-1:]} if level > FRESH else {}),
    }
    for quantity, pressure in measured.items():
        test = PartMeasurements(
            quantity,
            np.array([[level]]),
            np.array([[design.degradation_sd(level)]]),
            pressure[None],
            design.copies,
        )
        yield Experiment(ExperimentPlan(quantity.value, design.copies, (level,)), test)
