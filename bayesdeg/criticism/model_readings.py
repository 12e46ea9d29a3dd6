"""The readings of a study as what can be judged: stresses of films, curvatures, bend angles."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.subject import Places
from bayesdeg.inference.data import ActuatorCurves, Statistic, TensileCurves
from bayesdeg.inference.density import Factors
from bayesdeg.inference.likelihood import Linearised, covariance
from bayesdeg.inference.model import Model, simulated_films
from bayesdeg.inference.parameters import ParameterTable

Floats = NDArray[np.float64]

CURVATURE, ANGLE, STRESS = "curvature", "bend angle", "stress"
ACTUATOR, FILM = "actuator", "film"
Held = Literal["readings", "films", "statistics"]


@dataclass(frozen=True)
class ModelReadings:
    """A model of a study with its readings laid out flat: films first, then actuators.

    Parameters
    ----------
    model : Model
        With tensile curves or actuators or both.
    by_mode : bool, optional
        Whether films are held out mode by mode; by default where there are several modes.
    held : {"readings", "films", "statistics"}
        What is held out, one after another: see below; films alone; or means of replicates, such as
        that of the volume ratio.

    Notes
    -----
    Readings that are held out are those of actuators where there are any; else those of modes of
    tension where there are several, and of films where there is one.
    """

    model: Model
    by_mode: bool | None = None
    held: Held = "readings"

    @property
    def table(self) -> ParameterTable:
        """Parameters of the model."""
        return self.model.table

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Active causes."""
        return self.model.causes

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of the model, (k,)."""
        return self.model.log_prob(vectors, truncate=truncate)

    def factors(self, vectors: Floats) -> Factors | None:
        """Return the factors of the model's density, see `Model.factors`."""
        return self.model.factors(vectors)

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        return replace(self, model=self.model.extended(*causes))

    @cached_property
    def places(self) -> Places:
        """Where the readings stand."""
        parts = []
        if self.model.tensile is not None:
            parts.append(_places_of_films(self.model.tensile))
        if self.model.actuator is not None:
            parts.append(_places_of_actuators(self.model.actuator))
        joined = (np.concatenate([vars(p)[name] for p in parts]) for name in vars(parts[0]))
        return Places(*joined)

    @cached_property
    def observed(self) -> Floats:
        """The readings, (n,)."""
        parts = []
        if self.model.tensile is not None:
            parts.append(self.model.tensile.stress[self.model.tensile.mask])
        if self.model.actuator is not None:
            parts.append(self.model.actuator.readings[self.model.actuator.paths.mask])
        return np.concatenate(parts)

    @property
    def groups(self) -> tuple[str, ...]:
        """Specimens of actuators, modes of tension, films, or statistics."""
        if self.held == "statistics":
            return tuple(_name(statistic) for statistic in self.model.statistics)
        if self.held == "films" and self.model.tensile is None:
            return ()
        if self._held_actuators is not None:
            return self._held_actuators.specimens
        return tuple(dict.fromkeys(self._labels))

    @cached_property
    def group(self) -> NDArray[np.str_]:
        """Which of the groups each reading belongs to, (n,); empty for those that stay."""
        places = self.places
        if self.held == "statistics":
            return np.full(len(places), "")
        if self._held_actuators is not None:
            return np.where(places.family == ACTUATOR, places.specimen, "")
        labels = places.history if self._by_mode else places.specimen
        return np.where(places.family == FILM, labels, "")

    def expected(self, vectors: Floats) -> Floats:
        """Return readings of specimens of mean stiffness, (k, n)."""
        values = self.table.named(vectors)
        parts = []
        if self.model.tensile is not None:
            stresses = self.model.stresses(values, self.model.tensile).at_rest
            parts.append(stresses[:, self.model.tensile.mask])
        if self.model.actuator is not None:
            mean = self.model.continued.predict(values).mean
            parts.append(mean[:, self.model.actuator.paths.mask])
        return np.concatenate(parts, axis=1)

    def scatter(self, vector: Floats) -> Floats:
        """Return the covariance of readings, of specimens' deviations and of errors, (n, n)."""
        values = self.table.named(vector[None])
        blocks = []
        if self.model.tensile is not None:
            blocks += _blocks(self.model.tensile_linearised(values))
        if self.model.actuator is not None:
            blocks += _blocks(self.model.actuator_linearised(values))
        return np.asarray(block_diag(*blocks))

    def deviations(self, vector: Floats) -> tuple[Floats, Floats]:
        """Return what a deviation of an actuator's ln stiffness does, and the variances of those.

        Of shape (n, n_specimens), zero in readings of others, and (n_specimens,).
        """
        curves = self.model.actuator_linearised(self.table.named(vector[None]))
        mask = curves.paths.mask
        slope = np.zeros((len(self.places), len(mask)))
        read = np.zeros((*mask.shape, len(mask)))
        own = np.arange(len(mask))
        read[own, :, own] = curves.slope[0, :, :, 0]
        slope[len(slope) - int(mask.sum()) :] = read[mask]
        return slope, curves.spread[0, :, 0]

    def simulated(self, vectors: Floats, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan where refused."""
        values = self.table.named(vectors)
        parts = []
        if self.model.tensile is not None:
            stresses = simulated_films(self.model, self.model.tensile, values, generator)
            parts.append(stresses[:, self.model.tensile.mask])
        if self.model.actuator is not None:
            readings = self.model.continued.simulate(values, generator)
            parts.append(readings[:, self.model.actuator.paths.mask])
        return np.concatenate(parts, axis=1)

    def rest(self) -> Model:
        """Return the model without its readings: priors, elongations, shrinkage, statistics."""
        return replace(self.model, tensile=None, actuator=None)

    def without(self, groups: NDArray[np.intp]) -> Self:
        """Return the model without some groups."""
        return self.only(np.setdiff1d(np.arange(len(self.groups)), groups))

    def only(self, groups: NDArray[np.intp]) -> Self:
        """Return the model with some groups alone; what is not held out stays."""
        if self.held == "statistics":
            few = tuple(self.model.statistics[g] for g in groups)
            return replace(self, model=replace(self.model, statistics=few))
        if self._held_actuators is not None:
            subset = self._held_actuators.subset(groups)
            return replace(self, model=replace(self.model, actuator=subset))
        assert self.model.tensile is not None
        names = [self.groups[g] for g in groups]
        rows = np.array(
            [i for i, label in enumerate(self._labels) if label in names], dtype=np.intp
        )
        chosen = self.model.tensile.subset(rows)
        return replace(self, model=replace(self.model, tensile=chosen), by_mode=self._by_mode)

    def group_density(self, vectors: Floats) -> Floats:
        """Return the log density of all that was read on each group, (k, n_groups)."""
        values = self.table.named(vectors)
        if self.held == "statistics":
            return replace(self.model, tensile=None, actuator=None).log_likelihood(values)[
                "statistics"
            ]
        if self._held_actuators is not None:
            blocks = self.model.log_likelihood(values)
            total = blocks["actuator"] + blocks.get("rupture", 0.0)
            return np.where(np.isnan(total), -np.inf, total)
        film = self.model.log_likelihood(values)["tensile"]
        labels = np.array(self._labels)
        return np.stack([film[:, labels == g].sum(axis=1) for g in self.groups], axis=1)

    @property
    def is_beside(self) -> bool:
        """Whether what is held out is compared beside the readings, by its density alone."""
        return self.held != "readings"

    @property
    def holds_out_modes(self) -> bool:
        """Whether what is held out are whole modes of tension."""
        return self._held_actuators is None and self.held != "statistics" and self._by_mode

    @property
    def _held_actuators(self) -> ActuatorCurves | None:
        return self.model.actuator if self.held == "readings" else None

    @property
    def _by_mode(self) -> bool:
        if self.model.tensile is None or self.held == "films":
            return False
        return len(set(self.model.tensile.modes)) > 1 if self.by_mode is None else self.by_mode

    @property
    def _labels(self) -> tuple[str, ...]:
        """Return the group of each film."""
        assert self.model.tensile is not None
        return self.model.tensile.modes if self._by_mode else self.model.tensile.specimens


def _name(statistic: Statistic) -> str:
    return f"{statistic.quantity} at {statistic.degradation:g} % ({statistic.source})"


def _blocks(curves: Linearised) -> list[Floats]:
    total, mask = covariance(curves)[0], curves.paths.mask
    return [one[np.ix_(row, row)] for one, row in zip(total, mask, strict=True)]


def _places_of_films(films: TensileCurves) -> Places:
    read = films.mask
    count = int(read.sum())

    def each(values: NDArray[np.str_]) -> NDArray[np.str_]:
        return np.broadcast_to(values[:, None], read.shape)[read]

    return Places(
        np.full(count, STRESS),
        np.full(count, FILM),
        films.stretch[read],
        np.broadcast_to(films.degradation[:, None], read.shape)[read],
        each(np.array(films.specimens)),
        each(np.array(films.modes)),
        np.full(count, np.nan),
    )


def _places_of_actuators(data: ActuatorCurves) -> Places:
    read = data.paths.mask
    outputs = read.shape[1] // data.pressure.shape[1]

    def each(values: NDArray[np.generic]) -> NDArray[np.generic]:
        whole = np.broadcast_to(values, data.pressure.shape)
        return np.tile(whole, outputs)[read]

    history = np.char.add(np.char.add(data.branch, " "), data.cycle.astype(np.str_))
    kinds = np.repeat(np.array([CURVATURE, ANGLE][:outputs]), data.pressure.shape[1])
    return Places(
        np.broadcast_to(kinds, read.shape)[read],
        np.full(int(read.sum()), ACTUATOR),
        each(data.pressure).astype(np.float64),
        each(data.degradation).astype(np.float64),
        each(np.array(data.specimens)[:, None]).astype(np.str_),
        each(np.char.add(np.char.add(history, " "), data.mount)).astype(np.str_),
        each(data.time).astype(np.float64),
    )
