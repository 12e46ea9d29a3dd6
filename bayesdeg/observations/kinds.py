"""What a kind of data is: readings and their law, and what a model needs to know of both.

A kind of data is one module of this package. Its class says what was read, where, and with which
law, so that whatever fits, leaves out, simulates or criticises asks it and knows no kind by name.
A kind that is a subclass of the protocol has its defaults: no readings to criticise, no factors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self

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
"""Standard deviation over the least digit of what is rounded to it: uniform within one digit."""


@dataclass(frozen=True)
class Places:
    """Where each reading stands, all of shape (n,).

    Parameters
    ----------
    kind : array of str
        What was read, such as ``curvature``.
    family : array of str
        Which kinds a discrepancy may have in common, such as ``actuator`` for curvature and bend
        angle.
    along : array
        Where on its path: pressure [kPa], stretch [–], height.
    level : array
        Degradation rate [%], or what else was set for the whole specimen.
    specimen : array of str
        Whose reading it is: what is held out together.
    history : array of str
        How the load was applied: branch, cycle, mount, mode of tension.
    time : array
        When [s]; nan where it was not recorded.
    humidity : array, optional
        Relative humidity of the room [%]; nan where it was not recorded, as by default.
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
        """Bring a humidity that is the same for all readings to their shape."""
        shape = np.shape(self.kind)
        object.__setattr__(self, "humidity", np.broadcast_to(self.humidity, shape))

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.kind)

    def subset(self, rows: Flags) -> "Places":
        """Return where some of the readings stand."""
        return Places(*(getattr(self, field.name)[rows] for field in fields(self)))


def joined_places(parts: Sequence[Places]) -> Places:
    """Return places one after another."""
    names = [field.name for field in fields(Places)]
    return Places(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


_NO_WORDS, _NO_NUMBERS = np.empty(0, dtype=np.str_), np.empty(0)
NOWHERE = Places(_NO_WORDS, _NO_WORDS, _NO_NUMBERS, _NO_NUMBERS, _NO_WORDS, _NO_WORDS, _NO_NUMBERS)
"""Places of no reading."""


class World(Protocol):
    """How parameters become what kinds of data need."""

    @property
    def is_limited(self) -> bool:
        """Whether parameters that priors allow may have no answer, so that a start is sought."""
        ...

    @property
    def is_factored(self) -> bool:
        """Whether densities without data say what their factors are."""
        ...

    @property
    def continued(self) -> Self:
        """The same with a forward map that goes on outside its range, if it can.

        What it predicts outside serves to linearise a model and to simulate readings about its
        mode, and is no prediction.
        """
        ...

    def check(self, causes: tuple[Cause, ...]) -> None:
        """Refuse causes that act on nothing of it."""
        ...

    def allows(self, values: Named, levels: Floats) -> Flags:
        """Return which values are possible with specimens of these levels, (n,)."""
        ...


@dataclass(frozen=True)
class State[W]:
    """Values of all parameters, and what several kinds of data make of them, worked out once.

    Parameters
    ----------
    values : mapping
        Named values, (n,).
    world
        How parameters become what the kinds of data need.
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
        """Return what work makes of this state and of objects; it is done once for each of them."""
        key = (work, *map(id, about))
        if key not in self._known:
            self._known[key] = (about, work(self, *about))  # keeps them, and with it their ids
        found: T = self._known[key][1]
        return found

    def anew[T, *About](self, work: Callable[["State[W]", *About], T], *about: *About) -> T:
        """Return what work makes anew, which `once` then returns: draws that others go on with."""
        self._known.pop((work, *map(id, about)), None)
        return self.once(work, *about)

    def with_causes(self, causes: tuple[Cause, ...], values: Named) -> "State[W]":
        """Return the state with other causes, which may act on nothing that is worked out once."""
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
        Log densities of what is not normal, and their signals.
    """

    normal: tuple[Pair, ...] = ()
    events: tuple[Pair, ...] = ()


class Deviations(NamedTuple):
    """What specimens' own deviations do to their readings.

    Parameters
    ----------
    slope : array, shape (n_readings, n_specimens)
        Change of each reading by the deviation of its specimen; 0 in readings of others.
    spread : array, shape (n_specimens,)
        Variance of the deviations.
    level : array, shape (n_specimens,)
        Degradation rate of the specimens [%].
    """

    slope: Floats
    spread: Floats
    level: Floats


class Compared(NamedTuple):
    """A measured mean beside what a model has instead.

    Parameters
    ----------
    mean
        What was measured, with ``value``, ``se`` and ``dof``.
    expected : array, shape (n,)
        What the model has instead, draw by draw.
    """

    mean: Any
    expected: Floats


class Scale(NamedTuple):
    """In what a kind of reading is given, and against what it is drawn.

    Parameters
    ----------
    unit : str
        Of the readings.
    axis : str
        What stands along the path, with its unit, as at the axis of a figure.
    level : str
        Unit of what was set for a whole specimen; %, where that is the degradation rate.
    """

    unit: str
    axis: str
    level: str = ""


class Stored(NamedTuple):
    """Readings of one output as a posterior file keeps them.

    Parameters
    ----------
    output, axis : str
        Name of the variables, and of their dimension.
    observed : array, shape (m,)
        Readings.
    log_likelihood, replicates : array, shape (n, m)
        Log density of each given those before it, and readings drawn anew.
    labels : dict of str to array, shape (m,)
        Coordinates.
    constants : dict of str to array, shape (m,)
        What the test set.
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

    Rows are what is independent given the parameters: specimens, or published statistics.

    Parameters
    ----------
    name : str
        Of the kind, as in the groups of a posterior file.
    order : int
        Kinds of a smaller one are simulated and shown first.
    priority : int
        What a model holds out by itself is the kind of the highest; kinds of 0 are held out only
        where that is asked for.
    is_criticised : bool
        Whether it is among the readings that are held against a model, or what is known beside
        them.
    follows : str
        The kind on whose specimens it was read as well: they are held out together.
    uses_forward : bool
        Whether the forward map has to be asked.
    beside : bool
        Whether it is held out beside the kind of the highest priority, to compare causes.
    asks : str
        What it asks of the forward map beside the shape, as `bayesdeg.actuator.inputs.Inputs`.
    shares : str
        The kind whose specimens' own deviations act on its readings as well; labels are the same.
    floors : mapping of str to str
        The constant reading errors by their parameters, and the column that each is of.
    """

    name: ClassVar[str]
    order: ClassVar[int] = 100
    priority: ClassVar[int] = 0
    is_criticised: ClassVar[bool] = False
    follows: ClassVar[str] = ""
    uses_forward: ClassVar[bool] = False
    beside: ClassVar[bool] = False
    shares: ClassVar[str] = ""
    asks: ClassVar[Asked] = ""
    floors: ClassVar[Mapping[str, str]] = {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What it adds to the posterior, with default priors."""
        return ()

    @property
    def error_parameters(self) -> tuple[Parameter, ...]:
        """What an emulator adds to the posterior where it stands for the mechanics."""
        return ()

    def least(self, digits: Mapping[str, float]) -> dict[str, float]:
        """Return the error that rounding leaves, for each parameter that it bounds below.

        Readings that a model meets exactly would otherwise let its density grow without bound.

        Parameters
        ----------
        digits : mapping of str to float
            The least digit of columns, where it is known.
        """
        known = {name: column for name, column in self.floors.items() if column in digits}
        return {name: ROUNDING * digits[column] for name, column in known.items()}

    def among(self, others: tuple["Observations", ...]) -> "Observations":
        """Return what of it says something of the model that all data of a study need."""
        return self

    def linked(self, others: tuple["Observations", ...]) -> "Observations | None":
        """Return it as it goes on what others of a model say; None where nothing is left of it."""
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the rows."""
        ...

    @property
    def specimens(self) -> tuple[str, ...]:
        """The specimen of each row; none where they are of no specimen of the study."""
        return self.labels

    @property
    def row_groups(self) -> tuple[str, ...]:
        """What each row is held out with; empty where it never is."""
        return self.labels

    @property
    def is_by_mode(self) -> bool:
        """Whether what is held out together are all specimens of a mode of testing."""
        return False

    @property
    def groups(self) -> tuple[str, ...]:
        """What can be held out one after another."""
        return tuple(name for name in dict.fromkeys(self.row_groups) if name)

    @property
    def levels(self) -> Floats:
        """Degradation rates of specimens, at which the material must be stable [%]."""
        return np.empty(0)

    @property
    def material_levels(self) -> Floats:
        """Degradation rates at which it says something of the material [%]."""
        return self.levels

    @property
    def elongation_levels(self) -> Floats:
        """Degradation rates at which it says something of the elongation at break [%]."""
        return np.empty(0)

    def log_likelihood(self, state: State[Any]) -> Floats:
        """Return log densities of the rows, (n, n_rows)."""
        ...

    def factors(self, state: State[Any]) -> Parts | None:
        """Return the factors of the density; None where its laws are of another kind."""
        return None

    def subset(self, rows: Rows) -> Self:
        """Return some of the rows."""
        ...

    @property
    def places(self) -> Places:
        """Where the readings stand; nowhere of what is not criticised reading by reading."""
        return NOWHERE

    @property
    def scales(self) -> Mapping[str, Scale]:
        """Units of readings, by what was read; of what has tables of its own they are known."""
        return {}

    @property
    def reading_groups(self) -> Labels:
        """What each reading is held out with, (n,)."""
        return self.places.specimen

    @property
    def observed(self) -> Floats:
        """The readings, (n,)."""
        return np.empty(0)

    def expected(self, state: State[Any]) -> Floats:
        """Return readings of specimens that are as the mean, (k, n); nan if refused."""
        return np.empty((len(state), 0))

    def covariance(self, state: State[Any]) -> list[Floats]:
        """Return covariances of readings about them, specimen by specimen, for one vector."""
        return []

    def simulate(self, state: State[Any], generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan where refused."""
        return np.empty((len(state), 0))

    def replicated(
        self,
        state: State[Any],
        generator: np.random.Generator,
        drawn: tuple["Observations", ...],
    ) -> tuple["Observations", ...]:
        """Return what was drawn so far and this kind drawn anew, for one vector."""
        return (*drawn, self)

    def start(self, world: Any) -> dict[str, float]:
        """Return values of parameters that the readings alone suggest."""
        return {}

    def deviations(self, state: State[Any]) -> Deviations:
        """Return what specimens' own deviations do, for one vector."""
        return Deviations(np.empty((len(self.places), 0)), np.empty(0), np.empty(0))

    def refused(self, state: State[Any]) -> Flags:
        """Return at which vectors the forward map has no answer for some reading, (n,)."""
        return np.zeros(len(state), dtype=bool)

    def watched(self, world: Any, report: Callable[[Flags], None]) -> Any:
        """Return a world that reports which vectors it refused these readings, (n,)."""
        return world

    def reveals(self, cause: Cause) -> bool:
        """Return whether it shows a cause by itself, without curvatures or tensile curves."""
        return False

    def compared(self, state: State[Any]) -> list[Compared]:
        """Return measured means beside what the model has instead."""
        return []

    @property
    def events(self) -> int | None:
        """How many of the specimens met the event that this kind records; None if it is none."""
        return None

    def held_beside(self) -> Self:
        """Return it as it is held out beside another kind."""
        return self

    def stored(
        self, state: State[Any], tests: State[Any], generator: np.random.Generator
    ) -> list[Stored]:
        """Return what a posterior file keeps of the readings.

        Parameters
        ----------
        state, tests : State
            With a forward map that goes on outside its range, and as it is.
        generator : Generator
            Draws replicates.
        """
        return []
