"""Readings of a user's own forward map: any function of parameters and conditions.

Readings are y = f + a_s c + e: f the forward map's, e ~ N(0, σ²) independent errors, and, if
specimens differ, a_s ~ N(0, 1) one deviation per specimen s, which shifts its readings by c. A
cause is a `bayesdeg.causes.cause.Cause` whose hooks ``on_inputs`` and ``on_reading`` take whatever
``inputs`` and ``forward`` return.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, override

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import Acting, applied
from bayesdeg.observations.kinds import (
    Grouped,
    Labels,
    Observations,
    Places,
    Pointwise,
    Rows,
    Scale,
    State,
    Stored,
)
from bayesdeg.priors import Named

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LOG_TWO_PI = float(np.log(2.0 * np.pi))


def places_of(
    along: ArrayLike,
    *,
    kind: ArrayLike = "reading",
    level: ArrayLike = 0.0,
    specimen: ArrayLike | None = None,
    history: ArrayLike = "once",
    time: ArrayLike = np.nan,
) -> Places:
    """Return places of readings, by default of one kind and each of a separate specimen.

    Parameters
    ----------
    along : array, shape (n,)
        The varied quantity, in its unit.
    kind, level, specimen, history, time : array, optional
        As in `bayesdeg.observations.kinds.Places`; each broadcasts to (n,).

    Raises
    ------
    ValueError
        If shapes do not match.

    Examples
    --------
    >>> places_of([0.5, 1.0], kind="time").specimen.tolist()
    ['1', '2']
    """
    path = np.asarray(along, dtype=np.float64)
    if path.ndim != 1:
        raise ValueError(f"along must have one axis, that of the readings, not shape {path.shape}")
    own = np.arange(1, len(path) + 1).astype(np.str_) if specimen is None else specimen

    def labels(values: ArrayLike) -> Labels:
        return np.broadcast_to(np.asarray(values, dtype=np.str_), path.shape)

    def numbers(values: ArrayLike) -> Floats:
        return np.broadcast_to(np.asarray(values, dtype=np.float64), path.shape)

    return Places(
        labels(kind), labels("readings"), path, numbers(level), labels(own), labels(history),
        numbers(time),
    )  # fmt: skip


def as_they_are(values: Named, conditions: object) -> Named:
    """Return the values of the parameters: the default input of a forward map."""
    return values


def as_given(cause: Cause) -> Cause:
    """Return a cause unchanged: its hooks take what the forward map takes and returns."""
    return cause


def nothing_common(values: Named, readings: Floats) -> ArrayLike:
    """Return 0: specimens do not differ beyond reading errors."""
    return 0.0


@dataclass(frozen=True)
class Formula:
    """The world of a user's own forward map.

    Functions get values by name of shape (k, 1), k vectors at once, which broadcast with readings
    (n,). Module-level functions, not lambdas, can be sent to other processes.

    Parameters
    ----------
    forward : callable
        From inputs and conditions to a prediction; an array of readings (k, n) or an object.
        FormulaReadings of nan mean that the map has no answer.
    inputs : callable
        From values and conditions to what the forward map takes; the values by default.
    readings : callable
        From a prediction to readings (k, n); unchanged by default.
    adapted : callable
        From a cause to one whose hooks take what the forward map takes and returns.
    report : callable, optional
        Called at every evaluation with the vectors for which some reading is missing, (k,).
    made_of : object, optional
        The forward map that it was made from, which can be asked at other inputs.
    """

    forward: Callable[[Any, Any], Any]
    inputs: Callable[[Named, Any], Any] = as_they_are
    readings: Callable[[Any], ArrayLike] = np.asarray
    adapted: Callable[[Cause], Cause] = as_given
    report: Callable[[Flags], None] | None = None
    made_of: object = None

    @property
    def is_limited(self) -> bool:
        """Whether allowed parameters may have no solution: unknown, so assumed."""
        return False

    @property
    def degrades(self) -> bool:
        """Whether anything in the study degrades: unknown, so assumed."""
        return True

    @property
    def is_factored(self) -> bool:
        """Whether densities without data provide their factors."""
        return False

    @property
    def continued(self) -> "Formula":
        """The same world: nothing is known of a range."""
        return self

    def check(self, causes: tuple[Cause, ...]) -> None:
        """Refuse a cause that has no effect on a user's own forward map.

        Raises
        ------
        ValueError
            If it has neither of the two hooks.
        """
        for cause in map(self.adapted, causes):
            if cause.on_inputs is None and cause.on_reading is None:
                raise ValueError(
                    f"cause {cause.name!r} acts neither on inputs nor on readings: give it "
                    "on_inputs or on_reading"
                )

    def allows(self, values: Named, levels: Floats) -> Flags:
        """Allow every vector, (n,)."""
        return np.ones(len(next(iter(values.values()))), dtype=bool)

    def predicted(self, state: State["Formula"], conditions: Any) -> Floats:
        """Return all readings of the forward map with causes, which broadcast to (k, n)."""
        causes = [Acting(self.adapted(one), size) for one, size in state.acting(axes=1)]
        values = {name: value[:, None] for name, value in state.values.items()}
        inputs = applied("on_inputs", self.inputs(values, conditions), conditions, causes)
        prediction = self.forward(inputs, conditions)
        met = applied("on_reading", prediction, conditions, causes)
        return np.asarray(self.readings(met), dtype=np.float64)


def spread(values: ArrayLike, shape: tuple[int, ...], source: str) -> Floats:
    """Broadcast values to the shape of vectors by readings.

    Raises
    ------
    ValueError
        If they do not broadcast; the message names the function that returned them.
    """
    found = np.asarray(values, dtype=np.float64)
    try:
        return np.broadcast_to(found, shape)
    except ValueError:
        raise ValueError(
            f"{source} must return values that broadcast to {shape}, vectors by readings, "
            f"not shape {found.shape}"
        ) from None


def check_shapes(observed: Floats, places: Places, group: Labels, rows: Rows | slice) -> None:
    """Refuse readings, places, groups and rows that do not match.

    Raises
    ------
    ValueError
        Naming the argument of wrong shape, or the specimen in several groups.
    """
    if np.ndim(observed) != 1 or not np.all(np.isfinite(observed)):
        raise ValueError(f"observed must be finite, with one axis, not shape {np.shape(observed)}")
    named = {f"places.{f.name}": getattr(places, f.name) for f in fields(Places)}
    taken = {} if isinstance(rows, slice) else {"rows": rows}
    for name, values in {**named, "group": group, **taken}.items():
        if np.shape(values) != np.shape(observed):
            raise ValueError(
                f"{name} must have the shape of the readings, {np.shape(observed)}, "
                f"not {np.shape(values)}"
            )
    for specimen in np.unique(places.specimen):
        owners = np.unique(group[places.specimen == specimen])
        if len(owners) > 1:
            raise ValueError(
                f"specimen {str(specimen)!r} is in several groups, {owners.tolist()}: "
                "all readings of a specimen must be held out together"
            )


@dataclass(frozen=True)
class FormulaReadings(Pointwise, Grouped):
    """Readings of a `Formula`, with normal errors.

    Parameters
    ----------
    observed_values : array, shape (n,)
        The readings.
    read_at : Places
        Their places, see `places_of`.
    error : callable
        From values by name (k, 1) and predicted readings (k, n) to the standard deviation of the
        errors, in the readings' units, which broadcasts to (k, n).
    group : array of str, shape (n,), optional
        Hold-out groups, by default specimens; empty for readings never held out.
    conditions
        Conditions of the experiment: any object, by default `read_at.along`.
    common : callable
        Like ``error``: c, the common deviation of readings between specimens.
    rows : array of int, shape (n,)
        Indices into the forward map's readings; by default all, in order.
    read_in : mapping of str to Scale
        Unit and axis of the readings by their kind.

    Raises
    ------
    ValueError
        If shapes do not match or a specimen is in several groups.
    """

    name: ClassVar[str] = "readings"
    order: ClassVar[int] = 80
    priority: ClassVar[int] = 3
    is_criticised: ClassVar[bool] = True
    uses_forward: ClassVar[bool] = True

    observed_values: Floats
    read_at: Places
    error: Callable[[Named, Floats], ArrayLike]
    group: Labels = field(default_factory=lambda: np.empty(0, dtype=np.str_))
    conditions: Any = None
    common: Callable[[Named, Floats], ArrayLike] = nothing_common
    rows: Rows | slice = slice(None)
    read_in: Mapping[str, Scale] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Fill in defaults, and refuse mismatched arguments."""
        if self.group.size == 0:
            object.__setattr__(self, "group", self.read_at.specimen)
        if self.conditions is None:
            object.__setattr__(self, "conditions", self.read_at.along)
        check_shapes(self.observed_values, self.read_at, self.group, self.rows)

    @cached_property
    def _first(self) -> tuple[Labels, Rows, Rows]:
        """Specimens, the first reading of each, and the specimen of each reading."""
        return np.unique(self.read_at.specimen, return_index=True, return_inverse=True)

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return tuple(self._first[0].tolist())

    @property
    @override
    def row_groups(self) -> tuple[str, ...]:
        return tuple(self.group[self._first[1]].tolist())

    @cached_property
    @override
    def groups(self) -> tuple[str, ...]:
        return tuple(str(g) for g in dict.fromkeys(self.group.tolist()) if g != "")

    @property
    @override
    def places(self) -> Places:
        return self.read_at

    @property
    @override
    def scales(self) -> Mapping[str, Scale]:
        return self.read_in

    @property
    @override
    def reading_groups(self) -> Labels:
        return self.group

    @property
    @override
    def observed(self) -> Floats:
        return self.observed_values

    @override
    def subset(self, rows: Rows) -> "FormulaReadings":
        keep = np.isin(self._first[2], rows)
        every = isinstance(self.rows, slice)
        taken = np.arange(len(self.observed_values)) if every else np.asarray(self.rows)
        return replace(
            self,
            observed_values=self.observed_values[keep],
            read_at=self.read_at.subset(keep),
            group=self.group[keep],
            rows=taken[keep],
        )

    @override
    def log_likelihood(self, state: State[Formula]) -> Floats:
        mean, sd, moved = self._laws(state)
        specimens, _, number = self._first
        member = (number[:, None] == np.arange(len(specimens))).astype(np.float64)
        z, c = (self.observed_values - mean) / sd, moved / sd
        gain = 1.0 + (c**2) @ member
        squares = (z**2) @ member - ((z * c) @ member) ** 2 / gain
        density: Floats = (
            -0.5 * (squares + np.log(gain)) - (np.log(sd) + 0.5 * _LOG_TWO_PI) @ member
        )
        return density

    @override
    def expected(self, state: State[Formula]) -> Floats:
        return self._predicted(state)[:, self.rows]

    @override
    def covariance(self, state: State[Formula]) -> list[Floats]:
        _, sd, moved = self._laws(state)
        same = self.read_at.specimen[:, None] == self.read_at.specimen
        covariance: Floats = np.diag(sd[0] ** 2) + same * np.outer(moved[0], moved[0])
        return [covariance]

    @override
    def simulate(self, state: State[Formula], generator: np.random.Generator) -> Floats:
        mean, sd, moved = self._laws(state)
        specimens, _, number = self._first
        deviation = generator.standard_normal((len(state), len(specimens)))[:, number]
        drawn: Floats = mean + moved * deviation + sd * generator.standard_normal(mean.shape)
        return drawn

    @override
    def replicated(
        self,
        state: State[Formula],
        generator: np.random.Generator,
        drawn: tuple[Observations, ...],
    ) -> tuple[Observations, ...]:
        return (*drawn, replace(self, observed_values=self.simulate(state, generator)[0]))

    @override
    def stored(
        self, state: State[Formula], tests: State[Formula], generator: np.random.Generator
    ) -> list[Stored]:
        places = self.read_at
        return [
            Stored(
                "reading",
                "observation",
                self.observed_values,
                self._sequential(state),
                self.simulate(tests, generator),
                {"specimen_id": places.specimen, "kind": places.kind},
                {"x": places.along},
            )
        ]

    def _sequential(self, state: State[Formula]) -> Floats:
        """Return log densities of each reading given earlier ones on its specimen, (k, n).

        After some readings the specimen's deviation a has precision 1 + Σ c²/σ² and mean Σ c r/σ²
        over it.
        """
        mean, sd, moved = self._laws(state)
        residual, density = self.observed_values - mean, np.empty(mean.shape)
        for specimen in range(len(self._first[0])):
            rows = self._first[2] == specimen
            r, s, c = residual[:, rows], sd[:, rows], moved[:, rows]
            precision = 1.0 + np.cumsum((c / s) ** 2, axis=1) - (c / s) ** 2
            known = np.cumsum(c * r / s**2, axis=1) - c * r / s**2
            width = np.sqrt(s**2 + c**2 / precision)
            z = (r - c * known / precision) / width
            density[:, rows] = -0.5 * (z**2 + _LOG_TWO_PI) - np.log(width)
        return density

    @override
    def refused(self, state: State[Formula]) -> Flags:
        return ~np.all(np.isfinite(self.expected(state)), axis=1)

    @override
    def watched(self, world: Formula, report: Callable[[Flags], None]) -> Formula:
        return replace(world, report=report)

    def _predicted(self, state: State[Formula]) -> Floats:
        """Return all readings of the forward map, (k, n)."""
        found = state.world.predicted(state, self.conditions)
        width = len(self.observed_values)
        if not isinstance(self.rows, slice):
            width, last = found.shape[-1] if found.ndim else 1, np.max(self.rows, initial=-1)
            if width <= last:
                raise ValueError(f"rows go up to {last}, forward returned {width} readings")
        predicted = spread(found, (len(state), width), "forward")
        if state.world.report is not None:
            state.world.report(~np.all(np.isfinite(predicted[:, self.rows]), axis=1))
        return predicted

    def _laws(self, state: State[Formula]) -> tuple[Floats, Floats, Floats]:
        """Return mean, standard deviation of errors and common deviation of readings, (k, n)."""
        values = {name: value[:, None] for name, value in state.values.items()}
        mean = self._predicted(state)
        sd = spread(self.error(values, mean), mean.shape, "error")
        moved = spread(self.common(values, mean), mean.shape, "common")
        return mean[:, self.rows], sd[:, self.rows], moved[:, self.rows]
