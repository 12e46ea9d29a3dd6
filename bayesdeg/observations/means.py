"""Means of replicates: published ones, and α from the films' masses."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, NamedTuple, override

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.shrinkage import film_masses, mean_over_films
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.observations.kinds import Grouped, Observations, Parts, Rows, State
from bayesdeg.observations.noise import student, student_information
from bayesdeg.observations.specimens import FilmsAndActuators, modulus_100, young_modulus
from bayesdeg.priors import Named

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


MPA = 1e-3  # per kPa


@dataclass(frozen=True)
class Statistic:
    """A published or replicate mean used as one observation.

    The mean of n replicates minus the truth, over its standard error, follows Student's law with
    n − 1 degrees of freedom, since the scatter was estimated from the same replicates.

    Parameters
    ----------
    quantity : {"young_modulus", "modulus_100", "elongation_at_break", "volume_ratio"}
        The quantity.
    degradation : float
        D_R at which it holds [%].
    value, se : float
        Mean and its standard error, in the quantity's unit.
    source : str
        Its reference.
    dof : float
        Degrees of freedom, n − 1; inf if n is not known.
    """

    quantity: str
    degradation: float
    value: float
    se: float
    source: str
    dof: float = float("inf")


class Compared(NamedTuple):
    """A measured mean and its model value.

    Parameters
    ----------
    mean : Statistic
        The measurement.
    expected : array, shape (n,)
        The model value of each draw.
    """

    mean: Statistic
    expected: Floats


def statistics(study: Study) -> tuple[Statistic, ...]:
    """Return published means with their standard errors, and α from the films' masses.

    They include a vendor's 100 % modulus of the fresh material, with its stated error.

    The standard error is sd/√n; without n it is the sd itself. That of α includes the stated errors
    of recipe and densities, which all films share.
    """
    found = []
    if study.summary is not None:
        known = ("young_modulus", "elongation_at_break", "volume_ratio")
        rows = study.summary[study.summary["quantity"].isin(known)]
        for row in rows.to_dict("records"):
            count = float(row["n"]) if pd.notna(row["n"]) else 1.0
            dof = count - 1.0 if count > 1.0 else float("inf")
            if pd.notna(row["sd"]):
                level = float(row["degradation_pct"]) if pd.notna(row["degradation_pct"]) else 0.0
                value, se = float(row["value"]), float(row["sd"]) / np.sqrt(max(count, 1.0))
                name, source = str(row["quantity"]), str(row["source"])
                found.append(Statistic(name, level, value, se, source, dof))
    if study.shrinkage is not None and len(study.shrinkage) > 1:
        mean, dof = mean_over_films(film_masses(study.shrinkage), study.settings.shrinkage)
        source = f"shrinkage.csv, {mean.count} films"
        found.append(Statistic("volume_ratio", 0.0, mean.value, mean.standard_error, source, dof))
    vendor = study.settings.vendor
    if vendor.modulus_100 is not None:
        value, se = (MPA * number for number in (vendor.modulus_100.value, vendor.modulus_100.sd))
        found.append(Statistic("modulus_100", 0.0, value, se, f"study.toml, {vendor.source}"))
    faults = [
        Fault(
            s.source if s.source.startswith("shrinkage.csv") else "summary.csv",
            f"{s.quantity} at {s.degradation:g} % has a standard error of 0",
            "give the observed scatter, or leave sd empty to only show the value",
        )
        for s in found
        if not s.se > 0.0
    ]
    if faults:
        raise StudyError(faults)
    return tuple(found)


def expected_statistics(
    state: State[FilmsAndActuators], statistics: tuple[Statistic, ...]
) -> Floats:
    """Return the model values of statistics, in their units, (n, n_statistics)."""
    levels, ratio, modulus, at_100, elongation = _kinds_of(statistics)
    world = state.world
    given: Named = state.values  # noqa: PD011 - not a frame
    means = np.empty((len(state), len(statistics)))
    if np.any(ratio):
        means[:, ratio] = given["volume_ratio"][:, None]
    if np.any(modulus):
        at = world.constants(given, levels[modulus])
        means[:, modulus] = young_modulus(given, at, state.causes)
    if np.any(at_100):
        at = world.constants(given, levels[at_100])
        means[:, at_100] = modulus_100(given, at, state.causes)
    if np.any(elongation):
        means[:, elongation] = world.elongation(given, levels[elongation])
    return means


@lru_cache(maxsize=64)
def _kinds_of(statistics: tuple[Statistic, ...]) -> tuple[Floats, Flags, Flags, Flags, Flags]:
    """Return degradation rates [%], and masks of ratios, both kinds of moduli, and elongations."""
    levels = np.array([s.degradation for s in statistics])
    kinds = np.array([s.quantity for s in statistics])
    ratio, modulus = kinds == "volume_ratio", kinds == "young_modulus"
    at_100 = kinds == "modulus_100"
    return levels, ratio, modulus, at_100, ~(ratio | modulus | at_100)


@dataclass(frozen=True)
class Means(Grouped):
    """Means of replicates.

    Parameters
    ----------
    statistics : tuple of Statistic
        The means.
    """

    name: ClassVar[str] = "statistics"
    order: ClassVar[int] = 50
    beside: ClassVar[bool] = True

    statistics: tuple[Statistic, ...] = ()

    @override
    def among(self, others: tuple[Observations, ...]) -> "Means":
        """Leave out volume ratios without actuators, which alone they concern."""
        if any(one.uses_forward for one in others):
            return self
        kept = tuple(s for s in self.statistics if s.quantity != "volume_ratio")
        return Means(kept)

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return tuple(f"{s.quantity} at {s.degradation:g} %" for s in self.statistics)

    @property
    @override
    def specimens(self) -> tuple[str, ...]:
        return ()

    @property
    @override
    def row_groups(self) -> tuple[str, ...]:
        pairs = zip(self.labels, self.statistics, strict=True)
        return tuple(f"{label} ({statistic.source})" for label, statistic in pairs)

    @property
    @override
    def material_levels(self) -> Floats:
        return np.concatenate([self._levels("young_modulus"), self._levels("modulus_100")])

    @property
    @override
    def elongation_levels(self) -> Floats:
        return self._levels("elongation_at_break")

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        return np.stack(self._densities(self._expected(state)), axis=-1)

    @override
    def factors(self, state: State[FilmsAndActuators]) -> Parts:
        means = self._expected(state)
        scale = np.array([student_information(s.dof) / s.se for s in self.statistics])
        densities = np.stack(self._densities(means), axis=-1)
        return Parts(events=((densities, scale * means),))

    @override
    def subset(self, rows: Rows) -> "Means":
        return Means(tuple(self.statistics[row] for row in rows))

    @override
    def replicated(
        self,
        state: State[FilmsAndActuators],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        again = []
        for s, mean in zip(self.statistics, self._expected(state)[0], strict=True):
            is_normal = np.isinf(s.dof)
            score = generator.standard_normal() if is_normal else generator.standard_t(s.dof)
            again.append(replace(s, value=float(mean) + s.se * score))
        return (*drawn, Means(tuple(again)))

    def compared(self, state: State[FilmsAndActuators]) -> list[Compared]:
        """Return the means with their model values."""
        pairs = zip(self.statistics, self._expected(state).T, strict=True)
        return [Compared(statistic, expected) for statistic, expected in pairs]

    def _expected(self, state: State[FilmsAndActuators]) -> Floats:
        return expected_statistics(state, self.statistics)

    def _densities(self, expected: Floats) -> list[Floats]:
        pairs = zip(self.statistics, expected.T, strict=True)
        return [student(s.value, mean, s.se, s.dof) for s, mean in pairs]

    def _levels(self, quantity: str) -> Floats:
        return np.array([s.degradation for s in self.statistics if s.quantity == quantity])


def from_study(study: Study) -> tuple[Means, ...]:
    """Return the means given by a study, if any."""
    found = statistics(study)
    return (Means(found),) if found else ()
