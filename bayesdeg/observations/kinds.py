"""Interface of a kind of data: readings, their law, and what a model needs of them.

A kind of data is one module of this package. Its class says what was read, where, and by which law,
so code that fits, holds out, simulates or criticises never depends on a particular kind. A subclass
of the protocols inherits their defaults.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Asked
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import Acting, acting
from bayesdeg.priors import Named, Parameter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Labels = NDArray[np.str_]
Rows = NDArray[np.intp]

ROUNDING = 12.0**-0.5
"""Standard deviation of a rounded value over its last digit: uniform within one digit."""


@dataclass(frozen=True)
class Places:
    """Place of each reading, all of shape (n,).

    Parameters
    ----------
    kind : array of str
        Kind of reading, such as ``curvature``.
    family : array of str
        Kinds that may share a discrepancy, such as ``actuator`` for curvature and bend angle.
    along : array
        Position on its path: pressure [kPa], stretch [–], height.
    level : array
        Degradation rate [%], or any other condition of the whole specimen.
    specimen : array of str
        Specimen of the reading; its readings are held out together.
    history : array of str
        Loading: branch, cycle, mount, mode of tension.
    time : array
        Time [s]; nan where it was not recorded.
    humidity : array, optional
        Relative humidity of the room [%]; nan where it was not recorded, the default.
    """

    kind: Labels
    family: Labels
    along: Floats
    level: Floats
    specimen: Labels
    history: Labels
    time: Floats
    humidity: Floats = field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self) -> None:
        """Broadcast a common humidity to all readings."""
        shape = np.shape(self.kind)
        object.__setattr__(self, "humidity", np.broadcast_to(self.humidity, shape))

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.kind)

    def subset(self, rows: Flags) -> "Places":
        """Return the places of selected readings."""
        return Places(*(getattr(self, field.name)[rows] for field in fields(self)))


def joined_places(parts: Sequence[Places]) -> Places:
    """Concatenate places."""
    names = [field.name for field in fields(Places)]
    return Places(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


_NO_WORDS, _NO_NUMBERS = np.empty(0, dtype=np.str_), np.empty(0)
NOWHERE = Places(_NO_WORDS, _NO_WORDS, _NO_NUMBERS, _NO_NUMBERS, _NO_WORDS, _NO_WORDS, _NO_NUMBERS)
"""Empty places."""


@dataclass(frozen=True)
class State[W]:
    """Values of all parameters, with cached results shared by several kinds of data.

    Parameters
    ----------
    values : mapping
        Named values, (n,).
    world
        Maps parameters to what kinds of data need.
    causes : tuple of Cause
        Active ones, in order.
    """

    values: Named
    world: W
    causes: tuple[Cause, ...] = ()
    _known: dict[tuple[object, ...], tuple[object, Any]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def __len__(self) -> int:
        """Return the number of values of each parameter."""
        return len(next(iter(self.values.values())))

    def once[T, *About](self, work: Callable[["State[W]", *About], T], *about: *About) -> T:
        """Return the result of ``work`` for this state and objects; cached."""
        key = (work, *map(id, about))
        if key not in self._known:
            self._known[key] = (about, work(self, *about))  # kept, so that their ids stay valid
        found: T = self._known[key][1]
        return found

    def recomputed[T, *About](self, work: Callable[["State[W]", *About], T], *about: *About) -> T:
        """Recompute ``work`` and cache it for `once`, as for draws that others reuse."""
        self._known.pop((work, *map(id, about)), None)
        return self.once(work, *about)

    def with_causes(self, causes: tuple[Cause, ...], values: Named) -> "State[W]":
        """Return the state with different causes, which must not affect cached results."""
        return replace(self, causes=causes, values=values)

    def acting(self, *, axes: int = 2) -> tuple[Acting, ...]:
        """Return the active causes with their sizes, see `bayesdeg.causes.fold.acting`."""
        return acting(self.causes, self.values, axes=axes)


Pair = tuple[Floats, Floats]


class Parts(NamedTuple):
    """Factors of a log likelihood, see `bayesdeg.inference.density.Factors`.

    Parameters
    ----------
    normal : tuple of pairs of arrays, (n, k)
        z and ln s of normal laws.
    events : tuple of pairs of arrays, (n, k)
        Log densities of other laws, and their signals.
    """

    normal: tuple[Pair, ...] = ()
    events: tuple[Pair, ...] = ()


class Deviations(NamedTuple):
    """Effect of specimens' own deviations on their readings.

    Parameters
    ----------
    slope : array, shape (n_readings, n_specimens)
        Derivative of each reading with respect to its specimen's deviation; 0 for others.
    spread : array, shape (n_specimens,)
        Variance of the deviations.
    level : array, shape (n_specimens,)
        Degradation rate of the specimens [%].
    """

    slope: Floats
    spread: Floats
    level: Floats


class Scale(NamedTuple):
    """Unit of a kind of reading, and the axis against which it is plotted.

    Parameters
    ----------
    unit : str
        Of the readings.
    axis : str
        Label of the path, with its unit, as on the axis of a figure.
    level : str
        Unit of the specimen's condition; % for the degradation rate.
    """

    unit: str
    axis: str
    level: str = ""


class Stored(NamedTuple):
    """Readings of one output as stored in a posterior file.

    Parameters
    ----------
    output, axis : str
        Name of the variables, and of their dimension.
    observed : array, shape (m,)
        Readings.
    log_likelihood, replicates : array, shape (n, m)
        Log density of each given those before it, and replicated readings.
    labels : dict of str to array, shape (m,)
        Coordinates.
    constants : dict of str to array, shape (m,)
        Test conditions.
    """

    output: str
    axis: str
    observed: Floats
    log_likelihood: Floats
    replicates: Floats
    labels: dict[str, NDArray[Any]]
    constants: dict[str, Floats]


class Observations(Protocol):
    """One kind of data.

    Rows are independent given the parameters: specimens, or published statistics. A kind needs a
    name, labels, a density and how to choose rows; everything else has a default. One that is
    compared reading by reading is also `Pointwise`, one that may be left out by groups `Grouped`.

    Parameters
    ----------
    name : str
        Name of the kind, as in the groups of a posterior file.
    order : int
        Kinds of smaller order are simulated and shown first.
    is_criticised : bool
        Whether its readings or events are used to criticise a model.
    uses_forward : bool
        Whether it needs the forward map.
    asks : str
        What it needs of the forward map besides the shape, as in `bayesdeg.actuator.inputs.Inputs`.
    floors : mapping of str to str
        Parameters of constant reading errors, and the column of each.
    """

    name: ClassVar[str]
    order: ClassVar[int] = 100
    is_criticised: ClassVar[bool] = False
    uses_forward: ClassVar[bool] = False
    asks: ClassVar[Asked] = ""
    floors: ClassVar[Mapping[str, str]] = {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters, with default priors."""
        return ()

    @property
    def error_parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the emulator error, where an emulator replaces the mechanics."""
        return ()

    def least(self, digits: Mapping[str, float]) -> dict[str, float]:
        """Return the rounding error for each parameter bounded below by it.

        Otherwise readings that a model meets exactly would make its density unbounded.

        Parameters
        ----------
        digits : mapping of str to float
            Resolution of columns, where known.
        """
        known = {name: column for name, column in self.floors.items() if column in digits}
        return {name: ROUNDING * digits[column] for name, column in known.items()}

    def among(self, others: tuple["Observations", ...]) -> "Observations":
        """Return the part that is informative about the model of all data of a study."""
        return self

    def linked(self, others: tuple["Observations", ...]) -> "Observations | None":
        """Return it conditioned on other data of a model; None if nothing is left."""
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the rows."""
        ...

    @property
    def specimens(self) -> tuple[str, ...]:
        """The specimen of each row; empty if not specimens of the study."""
        return self.labels

    @property
    def levels(self) -> Floats:
        """Degradation rates of specimens, at which the material must be stable [%]."""
        return np.empty(0)

    @property
    def material_levels(self) -> Floats:
        """Degradation rates at which it informs about the material [%]."""
        return self.levels

    @property
    def elongation_levels(self) -> Floats:
        """Degradation rates at which it informs about the elongation at break [%]."""
        return np.empty(0)

    def log_likelihood(self, state: State[Any]) -> Floats:
        """Return log densities of the rows, (n, n_rows)."""
        ...

    def factors(self, state: State[Any]) -> Parts | None:
        """Return the factors of the density; None if it has none."""
        return None

    def subset(self, rows: Rows) -> Self:
        """Return some of the rows."""
        ...

    def replicated(
        self,
        state: State[Any],
        generator: np.random.Generator,
        drawn: tuple["Observations", ...],
    ) -> tuple["Observations", ...]:
        """Return the draws so far and replicates of this kind, for one vector."""
        return (*drawn, self)

    def start(self, world: Any) -> dict[str, float]:
        """Return values of parameters that the readings alone suggest."""
        return {}

    def refused(self, state: State[Any]) -> Flags:
        """Return for which vectors the forward map has no solution for some reading, (n,)."""
        return np.zeros(len(state), dtype=bool)

    def watched(self, world: Any, report: Callable[[Flags], None]) -> Any:
        """Return a world that reports which vectors it refused these readings, (n,)."""
        return world

    def reveals(self, cause: Cause) -> bool:
        """Return whether it reveals a cause by itself, without curvatures or tensile curves."""
        return False


@runtime_checkable
class Pointwise(Observations, Protocol):
    """A kind of data that is compared with a model reading by reading.

    Parameters
    ----------
    shares : str
        The kind whose specimens' deviations also act on its readings; labels are equal.
    """

    shares: ClassVar[str] = ""

    @property
    def places(self) -> Places:
        """Places of the readings."""
        ...

    @property
    def scales(self) -> Mapping[str, Scale]:
        """Scales of readings by kind; those with their own tables are known."""
        return {}

    @property
    def reading_groups(self) -> Labels:
        """Hold-out group of each reading, (n,)."""
        return self.places.specimen

    @property
    def observed(self) -> Floats:
        """The readings, (n,)."""
        ...

    def expected(self, state: State[Any]) -> Floats:
        """Return readings of mean specimens, (k, n); nan if refused."""
        ...

    def covariance(self, state: State[Any]) -> list[Floats]:
        """Return covariances of readings about them, specimen by specimen, for one vector."""
        ...

    def simulate(self, state: State[Any], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan where refused."""
        ...

    def deviations(self, state: State[Any]) -> Deviations:
        """Return the effect of specimens' own deviations, for one vector."""
        return Deviations(np.empty((len(self.places), 0)), np.empty(0), np.empty(0))

    def stored(
        self, state: State[Any], tests: State[Any], generator: np.random.Generator
    ) -> list[Stored]:
        """Return the readings as stored in a posterior file.

        Parameters
        ----------
        state, tests : State
            With an extrapolating forward map, and with the original one.
        generator : Generator
            Draws replicates.
        """
        return []


@runtime_checkable
class Grouped(Observations, Protocol):
    """A kind of data that may be left out group by group.

    Parameters
    ----------
    priority : int
        A model holds out the kind of highest priority; kinds of priority 0 are held out only on
        request.
    follows : str
        The kind that was read on the same specimens: they are held out together.
    beside : bool
        Whether it is held out in addition to the kind of highest priority, to compare causes.
    """

    priority: ClassVar[int] = 0
    follows: ClassVar[str] = ""
    beside: ClassVar[bool] = False

    @property
    def row_groups(self) -> tuple[str, ...]:
        """Hold-out group of each row; empty if never held out."""
        return self.labels

    @property
    def is_by_mode(self) -> bool:
        """Whether all specimens of a test mode are held out together."""
        return False

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups that can be held out in turn."""
        return tuple(name for name in dict.fromkeys(self.row_groups) if name)

    def held_beside(self) -> Self:
        """Return it as held out in addition to another kind."""
        return self
