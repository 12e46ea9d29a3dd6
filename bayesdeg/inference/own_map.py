"""Models of readings and a user's forward map.

Readings are y = f(θ, x) + s a + e: f the forward map, e ~ N(0, σ²) the reading error, and, where
specimens differ, one deviation a ~ N(0, 1) per specimen, which shifts all its readings by s a.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.observations import readings as flat
from bayesdeg.observations.kinds import Places, Scale, joined_places
from bayesdeg.observations.readings import Formula, FormulaReadings, places_of
from bayesdeg.priors import Distribution, HalfNormal, Named, Parameter

Floats = NDArray[np.float64]
Forward = Callable[[dict[str, Floats], Any], ArrayLike]

SHARE_OF_SPREAD = 0.5
"""Scale of the default prior of a reading error, relative to the standard deviation of all
readings: 95 % of it is then below the error of a model that explains nothing."""
#: Messages of Python and numpy for a scalar function called with arrays.
_ON_ARRAYS = re.compile(
    "can be converted to Python scalars|cannot convert the series to|truth value of an? "
)
FOR_ARRAYS = "write it for arrays: np.exp for math.exp, np.where for if"
PROBED = 3  # parameter vectors for trying a forward map


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of one kind, with their inputs.

    Parameters
    ----------
    x : array, shape (n,), DataFrame with n rows, or mapping of names to arrays
        What the experiment set; handed to the forward map as it is. Misfits are looked for along
        it, or along the first column.
    y : array, shape (n,)
        What was read.
    specimen : array, shape (n,), optional
        Whose reading it is: readings of one specimen are held out together. By default each
        reading is of a specimen of its own.
    name, unit : str
        What was read, and its unit.
    error : float, array, Distribution, Parameter or None
        Standard deviation of a reading: known, with a prior of its own, or, by default, a parameter
        ``<name>_error`` with the prior HalfNormal(sd(y)/2), 95 % of which lies below the standard
        deviation of all readings, which a model that explains nothing would leave as error.
    scatter : bool or Distribution
        Whether specimens differ: a parameter ``<name>_scatter``, the standard deviation by which
        all readings of a specimen are shifted together; its default prior is that of the error.
    level, time, history : array, optional
        What was set for the whole specimen; when a reading was taken; how it was loaded. Misfits
        are looked for along these as well.
    level_unit : str
        Unit of the level.

    Raises
    ------
    BayesdegError
        If shapes do not go together, or a reading is no finite number.

    Examples
    --------
    >>> Readings([1.0, 2.0, 3.0], [2.1, 3.9, 6.2], unit="mm").y.tolist()
    [2.1, 3.9, 6.2]
    """

    x: Any
    y: Any
    specimen: Any = None
    name: str = "reading"
    unit: str = "–"
    error: float | ArrayLike | Distribution | Parameter | None = None
    scatter: bool | Distribution = False
    level: Any = 0.0
    time: Any = np.nan
    history: Any = "once"
    level_unit: str = ""

    def __post_init__(self) -> None:
        """Convert readings to arrays, and refuse inconsistent shapes."""
        y = np.asarray(self.y, dtype=np.float64)
        x = as_inputs(self.x)
        if y.ndim != 1 or not len(y) or not np.all(np.isfinite(y)):
            raise BayesdegError(f"{self.name}: y must be finite numbers along one axis")
        counts = {np.shape(column)[:1] for _, column in columns_of(x)}
        if counts != {y.shape}:
            rows = ", ".join(f"{count[0]} rows" if count else "a single number" for count in counts)
            raise BayesdegError(f"{self.name}: x has {rows}, but y has {len(y)} readings")
        for other in ("specimen", "level", "time", "history"):
            value = getattr(self, other)
            if value is not None and np.shape(value) not in ((), y.shape):
                raise BayesdegError(
                    f"{self.name}: {other} has shape {np.shape(value)}, but y has {y.shape}"
                )
        if isinstance(self.error, (bool, str)):
            raise BayesdegError(f"{self.name}: error must be a number, an array or a prior law")
        is_known = not (self.error is None or isinstance(self.error, (Distribution, Parameter)))
        if is_known and not np.all(np.asarray(self.error, dtype=np.float64) > 0.0):
            raise BayesdegError(f"{self.name}: error must be above 0, not {self.error}")
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of unknown error and scatter."""
        found = []
        if isinstance(self.error, Parameter):
            found.append(self.error)
        elif self.error is None or isinstance(self.error, Distribution):
            meaning = f"reading error of {self.name}, standard deviation"
            law = self.error if isinstance(self.error, Distribution) else self._default()
            found.append(Parameter(f"{self.name}_error", law, self.unit, meaning))
        if self.scatter is not False:
            meaning = f"specimen-to-specimen shift of {self.name}, standard deviation"
            law = self.scatter if isinstance(self.scatter, Distribution) else self._default()
            found.append(Parameter(f"{self.name}_scatter", law, self.unit, meaning))
        return tuple(found)

    def parameter_of(self, what: str) -> str:
        """Return the name of the parameter of ``error`` or ``scatter``."""
        given = getattr(self, what)
        return given.name if isinstance(given, Parameter) else f"{self.name}_{what}"

    def _default(self) -> Distribution:
        spread = float(np.std(self.y))
        if spread == 0.0:
            raise BayesdegError(
                f"{self.name}: all readings are equal, so their error is unknown; give error="
            )
        return HalfNormal(SHARE_OF_SPREAD * spread)

    @property
    def places(self) -> Places:
        """Return the places of the readings."""
        column = next(column for _, column in columns_of(self.x))
        along = np.asarray(column, dtype=np.float64).reshape(len(self.y), -1)[:, 0]
        own = [f"{self.name} {number}" for number in range(1, len(self.y) + 1)]
        specimen = own if self.specimen is None else np.asarray(self.specimen).astype(np.str_)
        return places_of(
            along,
            kind=self.name,
            specimen=np.broadcast_to(specimen, self.y.shape),
            level=self.level,
            time=self.time,
            history=self.history,
        )

    @property
    def scale(self) -> Scale:
        """Unit of the readings, and what they are drawn against."""
        return Scale(self.unit, next(name for name, _ in columns_of(self.x)), self.level_unit)


def as_inputs(x: Any) -> Any:
    """Return inputs as arrays of numbers, in the form in which they were given."""
    if isinstance(x, Mapping):
        return {str(name): np.asarray(column, dtype=np.float64) for name, column in x.items()}
    return x if isinstance(x, pd.DataFrame) else np.asarray(x, dtype=np.float64)


def columns_of(x: Any) -> Iterator[tuple[str, Any]]:
    """Yield the inputs by their names; one without a name is x."""
    if isinstance(x, (Mapping, pd.DataFrame)):
        yield from ((str(name), x[name]) for name in x)
    else:
        yield "x", x


@dataclass(frozen=True)
class _Asked:
    """Inputs of the forward map: values by name (k,), and the inputs of each kind of readings."""

    values: dict[str, Floats]
    x: tuple[Any, ...]

    @property
    def count(self) -> int:
        """The number of vectors k."""
        return max(map(len, self.values.values()))


@dataclass(frozen=True, eq=False)
class UserMap:
    """Readings, and the functions that predict them.

    Parameters
    ----------
    readings : tuple of Readings
        Of one kind or several.
    forward : mapping of str to callable
        By the names of the readings: from values by name (k,) and x to predicted readings (k, n).
    source : str
        Where the function stands, for a report and for messages.
    """

    readings: tuple[Readings, ...]
    forward: Mapping[str, Forward]
    source: str = "forward"

    @classmethod
    def of(
        cls,
        readings: Readings | Iterable[Readings],
        forward: Forward | Mapping[str, Forward] | None,
    ) -> "UserMap":
        """Check that readings and forward map match.

        Raises
        ------
        BayesdegError
            If something is missing or has another type.
        """
        blocks = (readings,) if isinstance(readings, Readings) else tuple(readings)
        wrong = [type(block).__name__ for block in blocks if not isinstance(block, Readings)]
        if wrong or not blocks:
            raise BayesdegError(
                "a Model needs a study, or a list of Readings and a forward map, not "
                f"{', '.join(wrong) or 'an empty list'}"
            )
        names = [block.name for block in blocks]
        if len(set(names)) < len(names):
            raise BayesdegError(
                f"several kinds of readings need distinct names, Readings(..., name=), not {names}"
            )
        if isinstance(forward, Mapping):
            missing = [name for name in names if not callable(forward.get(name))]
            if missing:
                raise BayesdegError(f"forward has no function for {', '.join(missing)}")
            return cls(blocks, forward)
        if not callable(forward):
            raise BayesdegError("readings need a forward map: Model([...], forward=function)")
        if len(names) > 1:
            raise BayesdegError(
                f"there are several kinds of readings: give forward={{{names[0]!r}: function, ...}}"
            )
        return cls(blocks, {names[0]: forward})

    @property
    def title(self) -> str:
        """Name of the readings in words."""
        return ", ".join(block.name for block in self.readings)

    def model(self, parameters: Iterable[Parameter]) -> JointModel:
        """Return the density that is sampled and judged.

        Raises
        ------
        BayesdegError
            If names clash, or shapes do not go together.
        """
        extra = [parameter for block in self.readings for parameter in block.parameters]
        try:
            read = flat.FormulaReadings(
                np.concatenate([block.y for block in self.readings]),
                joined_places([block.places for block in self.readings]),
                error=partial(self._sizes, "error"),
                conditions=tuple(block.x for block in self.readings),
                common=partial(self._sizes, "scatter"),
                read_in={block.name: block.scale for block in self.readings},
            )
            formula = Formula(self._predicted, _asked, _side_by_side, _of_blocks, made_of=self)
            return JointModel((*parameters, *extra), (read,), formula)
        except ValueError as fault:
            raise BayesdegError(str(fault)) from fault

    def at(self, model: JointModel, block: Readings, x: Any) -> JointModel:
        """Return a model, of which this is the forward map, of one kind of readings at other x."""
        plain: dict[str, Any] = {"specimen": None, "level": 0.0, "time": np.nan, "history": "once"}
        count = max((len(column) for _, column in columns_of(x)), default=0)
        at = replace(block, x=x, y=np.zeros(count), error=1.0, scatter=False, **plain)
        return replace(self, readings=(at,)).model(model.base).extended(*model.causes)

    def _predicted(self, asked: _Asked, conditions: tuple[Any, ...]) -> tuple[Floats, ...]:
        found = []
        for block, x in zip(self.readings, asked.x, strict=True):
            answer = np.asarray(self.forward[block.name](asked.values, x), dtype=np.float64)
            shape = (asked.count, len(block.y))
            if answer.shape != shape:
                raise BayesdegError(
                    f"{self.source} must return {block.name} of shape {shape}, one row for each of "
                    f"the values and one column for each reading, not {answer.shape}; write "
                    "values[name][:, None] to broadcast values against x"
                )
            found.append(answer)
        return tuple(found)

    def _sizes(self, what: str, values: Named, readings: Floats) -> Floats:
        """Return standard deviations of error or scatter, (k, n)."""
        columns = []
        for block in self.readings:
            name, known = block.parameter_of(what), getattr(block, what)
            if name in values:
                size = values[name]
            else:
                size = np.asarray(0.0 if known is False else known, dtype=np.float64)
            columns.append(np.broadcast_to(size, (len(readings), len(block.y))))
        return np.concatenate(columns, axis=1)


def user_map(model: JointModel) -> UserMap | None:
    """Return the user's forward map of a model; None of films and actuators."""
    made_of = model.world.made_of if isinstance(model.world, Formula) else None
    return made_of if isinstance(made_of, UserMap) else None


def own_map_of(model: JointModel) -> UserMap:
    """Return the user's forward map, which a model of films or actuators does not have."""
    found = user_map(model)
    assert found is not None
    return found


def probe(model: JointModel) -> None:
    """Evaluate a forward map once, to report a wrong shape before anything is computed.

    Raises
    ------
    BayesdegError
        Saying what is wrong.
    """
    counts = {len(one.observed) for one in model.of_kind(FormulaReadings)}
    vectors = model.table.sample(np.random.default_rng(0), PROBED + (PROBED in counts))
    try:
        model.expected(vectors)
    except (ValueError, TypeError) as fault:
        if is_for_numbers(fault):
            problem = f"the function fails on arrays ({fault}); {FOR_ARRAYS}"
            raise BayesdegError(problem) from fault
        if isinstance(fault, TypeError):
            raise
        raise BayesdegError(str(fault)) from fault


def is_for_numbers(fault: BaseException) -> bool:
    """Return whether a function fails because it is written for single numbers.

    Examples
    --------
    >>> is_for_numbers(TypeError("only 0-dimensional arrays can be converted to Python scalars"))
    True
    """
    return _ON_ARRAYS.search(str(fault)) is not None


def _asked(values: Named, conditions: tuple[Any, ...]) -> _Asked:
    return _Asked({name: value[:, 0] for name, value in values.items()}, conditions)


def _side_by_side(readings: tuple[Floats, ...]) -> Floats:
    return np.concatenate(readings, axis=1)


def _of_blocks(cause: Cause) -> Cause:
    """Return a cause whose hooks act on every kind of readings.

    A cause without hooks acts through its parameters, which the forward map gets by name.
    """
    hooks: dict[str, Any] = {"on_inputs": partial(_on_inputs, cause.on_inputs)}
    if cause.on_reading is not None:
        hooks["on_reading"] = partial(_on_readings, cause.on_reading)
    return replace(cause, **hooks)


def _on_inputs(
    hook: Callable[..., Any] | None, asked: _Asked, recorded: tuple[Any, ...], effect: Effect
) -> _Asked:
    if hook is None:
        return asked
    pairs = zip(asked.x, recorded, strict=True)
    return replace(asked, x=tuple(hook(x, before, effect) for x, before in pairs))


def _on_readings(
    hook: Callable[..., Any],
    readings: tuple[Floats, ...],
    recorded: tuple[Any, ...],
    effect: Effect,
) -> tuple[Floats, ...]:
    pairs = zip(readings, recorded, strict=True)
    return tuple(np.asarray(hook(one, at, effect), dtype=np.float64) for one, at in pairs)
