"""The tests of a study as a pattern for further ones."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.experiments import Experiment
from bayesdeg.criticism.experiments_measurement import ActuatorTests
from bayesdeg.inference.curves import ActuatorCurves, TensileCurves
from bayesdeg.material.hyperelastic import yeoh_basis

Floats = NDArray[np.float64]

MOST_STEPS = 16
MOST_COPIES = 3
DWELL = 10.0  # s between readings where the study recorded no time
SAME_LEVEL = 2.5  # points of degradation: nearer rates are no other level
LONG = 300.0  # s at one pressure


@dataclass(frozen=True)
class ActuatorDesign:
    """What the actuators' tests of a study set.

    Parameters
    ----------
    data : ActuatorCurves
        The tests.
    levels : tuple of float
        Degradation rates [%], rising; rates nearer than 2.5 points are one.
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
        """Return the design of a study's tests."""
        levels = _levels(data.degradation[:, 0])
        counts = [len(_near(data, level)) for level in levels]
        steps = np.diff(data.time, axis=1)[data.mask[:, 1:]]
        steps = steps[steps > 0.0]
        return cls(
            data,
            levels,
            int(np.clip(np.median(counts), 1, MOST_COPIES)),
            bool(np.isfinite(data.time).any()),
            float(np.median(steps)) if len(steps) else DWELL,
        )

    @property
    def long_hold(self) -> bool:
        """Whether one pressure was ever held for long."""
        same = np.isclose(np.diff(self.data.pressure, axis=1), 0.0)
        return bool(np.any(same & (np.diff(self.data.time, axis=1) >= LONG)))

    def pressures(self, level: float) -> Floats:
        """Return the steps of a loading [kPa], up to what half of the specimens there reached."""
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

    def words(self, level: float) -> str:
        """Word the specimens of a test."""
        plural = "s" if self.copies > 1 else ""
        degraded = f"degraded by {level:g} %" if level else "that are fresh"
        return f"{self.copies} new specimen{plural} {degraded}"

    def another_level(self, last_of_films: float) -> float | None:
        """Return a degradation rate that was not tested, at which the films' law is known."""
        if last_of_films - self.levels[-1] > SAME_LEVEL:
            return last_of_films
        gaps = np.diff(self.levels)
        if not len(gaps) or gaps.max() < 2.0 * SAME_LEVEL:
            return None
        widest = int(np.argmax(gaps))
        return float(round(self.levels[widest] + 0.5 * gaps[widest], 1))

    def curves(
        self,
        levels: tuple[float, ...] | list[float],
        pressure: Floats,
        *,
        time: Floats | None = None,
        branch: NDArray[np.str_] | None = None,
        cycle: NDArray[np.int64] | None = None,
        mount: str | None = None,
        angle: bool = False,
    ) -> ActuatorCurves:
        """Return tests without readings, all on the same pressures; the rest is as it was."""
        shape = (len(levels), len(pressure))
        usual_times = np.arange(len(pressure)) * (self.dwell if self.timed else np.nan)
        known = self.data.humidity[np.isfinite(self.data.humidity)]
        names, counts = np.unique(self.data.mount[self.data.mask], return_counts=True)
        usual = str(names[int(np.argmax(counts))])
        read = np.ones(shape, dtype=bool)
        return ActuatorCurves(
            specimens=tuple(f"new at {level:g} %" for level in levels),
            degradation=np.array(levels, dtype=np.float64)[:, None],
            degradation_sd=np.array([[self.degradation_sd(level)] for level in levels]),
            pressure=np.broadcast_to(pressure, shape),
            curvature=np.zeros(shape),
            curvature_sd=np.full(shape, np.median(self.data.curvature_sd[self.data.mask])),
            mask=read,
            bend_angle=np.zeros(shape),
            angle_mask=read & (angle or self.data.with_angle),
            recorded=read,
            ruptured=~read,
            cycle=np.broadcast_to(np.int64(1) if cycle is None else cycle, shape),
            branch=np.broadcast_to("loading" if branch is None else branch, shape),
            time=np.broadcast_to(usual_times if time is None else time, shape),
            humidity=np.full(shape, np.median(known) if len(known) else np.nan),
            mount=np.full(shape, usual if mount is None else mount),
        )

    def experiment(self, kind: str, words: str, curves: ActuatorCurves) -> Experiment:
        """Return an experiment on so many specimens as the study has of a level."""
        specimens = self.copies * len(curves.specimens)
        return Experiment(kind, words, specimens, ActuatorTests(curves, self.copies))


@dataclass(frozen=True)
class FilmDesign:
    """What the films' tests of a study set.

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
        """Return the design of a study's tests of films."""
        level = float(data.degradation.min())
        there = int(np.sum(np.abs(data.degradation - level) < SAME_LEVEL))
        return cls(data, level, min(there, MOST_COPIES))

    def curves(self, mode: str) -> TensileCurves:
        """Return a test of one film in another mode, up to half the elongation reached so far."""
        rows = np.flatnonzero(np.abs(self.data.degradation - self.level) < SAME_LEVEL)
        largest = float(np.median(self.data.stretch[rows].max(axis=1)))
        count = min(int(self.data.mask[rows].sum(axis=1).max()), MOST_STEPS)
        # other modes break earlier, and strain the material more
        stretch = np.linspace(1.0, 1.0 + 0.5 * (largest - 1.0), count + 1)[None, 1:]
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
        )


def _levels(rates: Floats) -> tuple[float, ...]:
    """Return the mean of each group of rates that follow each other closely, rounded to 0.1 %."""
    rising = np.sort(rates)
    groups = np.split(rising, np.flatnonzero(np.diff(rising) >= SAME_LEVEL) + 1)
    return tuple(float(round(group.mean(), 1)) for group in groups)


def _near(data: ActuatorCurves, level: float) -> NDArray[np.intp]:
    """Return the specimens at a level, or the nearest one."""
    distance = np.abs(data.degradation[:, 0] - level)
    return np.flatnonzero(distance <= max(SAME_LEVEL, float(distance.min())))
