"""Where the readings of a custom forward map stand, and whether all shapes go together.

Readings are y = f + a_s c + e: f the forward map's, e ~ N(0, σ²) independent errors, and,
where specimens differ, a_s ~ N(0, 1) one deviation for each specimen s, which moves its readings by
c. A cause is a `bayesdeg.causes.cause.Cause` whose hooks ``on_inputs`` and ``on_reading`` take what
``inputs`` and ``forward`` return, whatever that is.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.criticism.subject import Labels, Places
from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.parameters import Named, ParameterTable, with_causes
from bayesdeg.priors import Parameter

Floats = NDArray[np.float64]


def places_of(
    along: ArrayLike,
    *,
    kind: ArrayLike = "reading",
    level: ArrayLike = 0.0,
    specimen: ArrayLike | None = None,
    history: ArrayLike = "once",
    time: ArrayLike = np.nan,
) -> Places:
    """Return places of readings, by default of one kind and each of a specimen of its own.

    Parameters
    ----------
    along : array, shape (n,)
        What was varied, in its unit.
    kind, level, specimen, history, time : array, optional
        As in `bayesdeg.criticism.subject.Places`; each broadcasts to (n,).

    Raises
    ------
    ValueError
        If shapes do not go together.

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


def spread(values: ArrayLike, shape: tuple[int, ...], source: str) -> Floats:
    """Return values brought to the shape of vectors by readings.

    Raises
    ------
    ValueError
        If they do not broadcast; the message names the function that gave them.
    """
    found = np.asarray(values, dtype=np.float64)
    try:
        return np.broadcast_to(found, shape)
    except ValueError:
        raise ValueError(
            f"{source} must return what broadcasts to {shape}, vectors by readings, "
            f"not shape {found.shape}"
        ) from None


def check_shapes(
    observed: Floats, places: Places, group: Labels, rows: NDArray[np.intp] | None
) -> None:
    """Refuse readings, places, groups and rows that do not go together.

    Raises
    ------
    ValueError
        Naming what has the wrong shape, or the specimen that is in several groups.
    """
    if np.ndim(observed) != 1 or not np.all(np.isfinite(observed)):
        raise ValueError(f"observed must be finite, with one axis, not shape {np.shape(observed)}")
    named = {f"places.{f.name}": getattr(places, f.name) for f in fields(Places)}
    for name, values in {**named, "group": group, "rows": rows}.items():
        if values is not None and np.shape(values) != np.shape(observed):
            raise ValueError(
                f"{name} must have the shape of the readings, {np.shape(observed)}, "
                f"not {np.shape(values)}"
            )
    for specimen in np.unique(places.specimen):
        owners = np.unique(group[places.specimen == specimen])
        if len(owners) > 1:
            raise ValueError(
                f"specimen {str(specimen)!r} is in several groups, {owners.tolist()}: "
                "readings of one specimen are held out together"
            )


_LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class CustomModel[Inputs, Conditions, Prediction]:
    """A forward map, its readings and its parameters, to be criticised and extended by causes.

    Functions are given values by name of shape (k, 1), k vectors at once, so that they broadcast
    with readings (n,). Functions of a module, not lambdas, can be sent to other processes.

    Parameters
    ----------
    parameters : tuple of Parameter
        Base parameters with their priors, those of the errors among them; at least one.
    conditions : Conditions
        What the experiment set: any object.
    inputs : callable
        From values and conditions to what the forward map takes.
    forward : callable
        From inputs and conditions to a prediction; an array of readings (k, n) or an object.
        Readings of nan mean that the map has no answer.
    error : callable
        From values and predicted readings (k, n) to the standard deviation of the errors, in the
        readings' units, which broadcasts to (k, n).
    observed : array, shape (n,)
        The readings.
    places : Places
        Where they stand, see `bayesdeg.criticism.custom.places_of`.
    group : array of str, shape (n,)
        What is held out together; empty where a reading never is.
    readings : callable
        From a prediction to readings (k, n); as it is by default.
    common : callable, optional
        Like ``error``: c, by how much readings differ together from specimen to specimen.
    rows : array of int, shape (n,), optional
        Which of the forward map's readings were taken; all, in order, by default.
    causes : tuple of Cause
        Active ones.

    Raises
    ------
    ValueError
        If shapes do not go together, names clash, a specimen is in several groups, or a cause has
        neither of the two hooks.

    Examples
    --------
    A spring of unknown stiffness, read with an error of 1 mm, and a scale that may be shifted:

    >>> from bayesdeg.causes.cause import Stage
    >>> from bayesdeg.criticism.custom import places_of
    >>> from bayesdeg.priors import LogNormal, Normal
    >>> force = np.array([1.0, 2.0, 3.0])
    >>> spring = CustomModel(
    ...     parameters=(Parameter("stiffness", LogNormal(0.1, 1.0), "N/mm", "of the spring"),),
    ...     conditions=force,
    ...     inputs=lambda values, force: values["stiffness"],
    ...     forward=lambda stiffness, force: force / stiffness,
    ...     error=lambda values, readings: 1.0,
    ...     observed=np.array([14.0, 23.0, 35.0]),
    ...     places=places_of(force, kind="length"),
    ...     group=np.array(["1", "2", "3"]),
    ... )
    >>> shift = Cause(
    ...     name="shift",
    ...     stage=Stage.READING,
    ...     parameters=(Parameter("length", Normal(0.0, 5.0), "mm", "added to all", 0.0),),
    ...     mechanism="the scale does not begin at zero",
    ...     typical={"length": 4.0},
    ...     revealed_by="a length without a force",
    ...     on_reading=lambda length, force, effect: length + effect["length"],
    ... )
    >>> spring.expected(np.array([[np.log(0.1)]]))
    array([[10., 20., 30.]])
    >>> spring.extended(shift).expected(np.array([[np.log(0.1), 4.0]]))
    array([[14., 24., 34.]])
    """

    parameters: tuple[Parameter, ...]
    conditions: Conditions
    inputs: Callable[[Named, Conditions], Inputs]
    forward: Callable[[Inputs, Conditions], Prediction]
    error: Callable[[Named, Floats], ArrayLike]
    observed: Floats
    places: Places
    group: Labels
    readings: Callable[[Prediction], Floats] = np.asarray
    common: Callable[[Named, Floats], ArrayLike] | None = None
    rows: NDArray[np.intp] | None = None
    causes: tuple[Cause, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what does not go together."""
        check_shapes(self.observed, self.places, self.group, self.rows)
        for cause in self.causes:
            if cause.on_inputs is None and cause.on_reading is None:
                raise ValueError(
                    f"cause {cause.name!r} acts neither on inputs nor on readings: give it "
                    "on_inputs or on_reading"
                )
        names = self.table.names
        if not self.parameters or len(set(names)) < len(names):
            raise ValueError(f"parameters need distinct names, at least one, not {list(names)}")

    @cached_property
    def table(self) -> ParameterTable:
        """Parameters of the model and of its causes."""
        return with_causes(self.parameters, self.causes)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """What is held out one after another, in the order of the readings."""
        return tuple(str(g) for g in dict.fromkeys(self.group.tolist()) if g != "")

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        return replace(self, causes=in_order((*self.causes, *causes)))

    def expected(self, vectors: Floats) -> Floats:
        """Return readings of specimens that are as the model's mean, (k, n); nan if refused."""
        return self._rows_of(self._predicted(self._values(vectors), len(vectors)))

    def scatter(self, vector: Floats) -> Floats:
        """Return the covariance of readings about them, of specimens and errors, (n, n)."""
        _, sd, moved = self._laws(vector[None])
        same = self.places.specimen[:, None] == self.places.specimen
        covariance: Floats = np.diag(sd[0] ** 2) + same * np.outer(moved[0], moved[0])
        return covariance

    def simulated(self, vectors: Floats, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan where refused."""
        mean, sd, moved = self._laws(vectors)
        specimens, number = np.unique(self.places.specimen, return_inverse=True)
        deviation = generator.standard_normal((len(vectors), len(specimens)))[:, number]
        drawn: Floats = mean + moved * deviation + sd * generator.standard_normal(mean.shape)
        return drawn

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, (k,); −inf where impossible."""
        with np.errstate(all="ignore"):
            prior = self.table.log_prior(vectors, truncate=truncate)
            total = prior + self._specimen_density(vectors).sum(axis=1)
        return np.where(np.isfinite(total), total, -np.inf)

    def group_density(self, vectors: Floats) -> Floats:
        """Return the log density of all that was read on each group, (k, n_groups)."""
        density = self._specimen_density(vectors)
        first = np.unique(self.places.specimen, return_index=True)[1]
        member = self.group[first][:, None] == np.array(self.groups, dtype=np.str_)
        with np.errstate(invalid="ignore"):
            total = np.where(member, density[:, :, None], 0.0).sum(axis=1)
        return np.where(np.isfinite(total), total, -np.inf)

    def rest(self) -> CustomDensity:
        """Return the priors: there is nothing beside the readings."""
        return CustomDensity(self.table.parameters, _nothing)

    def without(self, groups: NDArray[np.intp]) -> Self:
        """Return the model without the readings of some groups."""
        return self._kept(~np.isin(self.group, [self.groups[g] for g in groups]))

    def only(self, groups: NDArray[np.intp]) -> Self:
        """Return the model with some groups alone, and what is never held out."""
        return self._kept(np.isin(self.group, ["", *(self.groups[g] for g in groups)]))

    def _kept(self, keep: NDArray[np.bool_]) -> Self:
        rows = np.arange(len(self.observed)) if self.rows is None else self.rows
        places = Places(*(getattr(self.places, f.name)[keep] for f in fields(Places)))
        return replace(
            self,
            observed=self.observed[keep],
            places=places,
            group=self.group[keep],
            rows=rows[keep],
        )

    def _values(self, vectors: Floats) -> Named:
        return {name: value[:, None] for name, value in self.table.named(vectors).items()}

    def _effect(self, cause: Cause, values: Named) -> Effect:
        return {p.name: values[cause.qualified(p.name)] for p in cause.parameters}

    def _predicted(self, values: Named, count: int) -> Floats:
        """Return all readings of the forward map, (k, n)."""
        inputs, conditions = (
            cast(Any, self.inputs(values, self.conditions)),
            cast(Any, self.conditions),
        )
        for cause in self.causes:
            if cause.on_inputs is not None:
                inputs = cause.on_inputs(inputs, conditions, self._effect(cause, values))
        prediction = cast(Any, self.forward(cast(Inputs, inputs), self.conditions))
        for cause in self.causes:
            if cause.on_reading is not None:
                prediction = cause.on_reading(prediction, conditions, self._effect(cause, values))
        found = np.asarray(self.readings(cast(Prediction, prediction)), dtype=np.float64)
        width = len(self.observed)
        if self.rows is not None:
            width = found.shape[-1] if found.ndim else 1
            if width <= np.max(self.rows, initial=-1):
                raise ValueError(f"rows go up to {np.max(self.rows)}, forward returned {width}")
        return spread(found, (count, width), "forward")

    def _rows_of(self, readings: Floats) -> Floats:
        return readings if self.rows is None else readings[:, self.rows]

    def _laws(self, vectors: Floats) -> tuple[Floats, Floats, Floats]:
        """Return mean, standard deviation of errors and common deviation of readings, (k, n)."""
        values = self._values(vectors)
        mean = self._predicted(values, len(vectors))
        sd = spread(self.error(values, mean), mean.shape, "error")
        moved = 0.0 if self.common is None else self.common(values, mean)
        return (
            self._rows_of(mean),
            self._rows_of(sd),
            self._rows_of(spread(moved, mean.shape, "common")),
        )

    def _specimen_density(self, vectors: Floats) -> Floats:
        """Return the log density of the readings of each specimen, (k, n_specimens)."""
        mean, sd, moved = self._laws(vectors)
        specimens, number = np.unique(self.places.specimen, return_inverse=True)
        member = (number[:, None] == np.arange(len(specimens))).astype(np.float64)
        z, c = (self.observed - mean) / sd, moved / sd
        gain = 1.0 + (c**2) @ member
        squares = (z**2) @ member - ((z * c) @ member) ** 2 / gain
        density: Floats = (
            -0.5 * (squares + np.log(gain)) - (np.log(sd) + 0.5 * _LOG_TWO_PI) @ member
        )
        return density


def _nothing(values: Named) -> Floats:
    """Return the log likelihood of no data."""
    return np.zeros(len(next(iter(values.values()))))
