r"""Candidate missing terms: products of known functions of set or measured quantities.

A term changes the readings y of one family by

.. math:: \Delta = b\, a\, f\, g, \qquad
    a \in \{ y,\; y_{max},\; x_{max}\, \partial y / \partial x \},

b its size: proportional to the reading, a shift of the reading, or a shift of the path x. f is a
function of the load or of the reading itself, g one of the state of the specimen or of the history
of the test; either may be 1. Every f and g is dimensionless and is a power, a logarithm, a part
above, below or between values, a wave, or the membership of a group:

====================  =====================================================================
of the load           path x over its largest; pressure over the modulus of the specimen,
                      p/(6 C1(D)); the reading over the largest; how far the path is below its
                      largest value so far
of state and history  degradation rate, time, humidity, cycle, branch, mount, mode of tension,
                      batch, one degradation rate of several
====================  =====================================================================

An effect in a single specimen is not a term: no held-out data could confirm it.

A term is considered only if the parameters of the model cannot absorb it:

.. math:: |F^{-1} d|^2 \ge 0.1\, |B^{-1} d|^2,

d its direction, F F' the covariance of the readings with the parameters integrated out, B B' that
of errors and scatter alone.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.data.levels import levels
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import ACTUATOR, ANGLE, CURVATURE
from bayesdeg.observations.kinds import Places
from bayesdeg.observations.specimens import FilmsAndActuators, young_modulus
from bayesdeg.observations.tensile import FILM, STRESS

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Labels = NDArray[np.str_]

LEAST_LEFT = 0.1
"""Least share of a term's square that parameters cannot absorb: below it, a change of the
parameters within their priors reproduces nine tenths of the term."""
ALIKE = 1.0 - 1e-6
"""Cosine above which two terms are equivalent; the simpler is kept."""
PARTS = (0.25, 0.5, 0.75)
"""Fractions of the largest load or reading at which a term may begin or end."""
WAVES = (1, 2)
"""Waves along the whole path; shorter ones match the correlation length of reading errors."""
SHARED = 2  # fewest specimens of a group


class Acts(StrEnum):
    """The quantity that a term changes."""

    FACTOR = "factor"
    SHIFT = "shift"
    PATH = "path"


class Form(StrEnum):
    """Functions of one quantity."""

    POWER = "power"
    ABOVE = "above"
    BELOW = "below"
    BETWEEN = "between"
    SINE = "sine"
    COSINE = "cosine"
    LOGARITHM = "logarithm"
    MEMBER = "member"


class Quantified(NamedTuple):
    """Notation of a quantity: name, symbol and unit."""

    column: str
    symbol: str
    unit: str = ""


PATHS: Mapping[str, Quantified] = {
    ACTUATOR: Quantified("pressure", "p", "kPa"),
    FILM: Quantified("strain", "(λ − 1)"),
}
AT_REST: Mapping[str, float] = {FILM: 1.0}
"""Start of the path of a family, if not 0."""
READ: Mapping[str, tuple[str, str]] = {
    CURVATURE: ("κ", "1/m"),
    ANGLE: ("φ", "°"),
    STRESS: ("σ", "MPa"),
}
LOAD = Quantified("pressure over modulus", "p/(6 C1)")
LAG = Quantified("largest load so far", "x_max − x")
DEGRADATION = Quantified("degradation rate", "D_R", "%")
LEVEL = Quantified("level", "level")
TIME = Quantified("time", "t", "s")
HUMIDITY = Quantified("humidity", "RH", "%")
CYCLE = Quantified("cycle", "cycle − 1")
BRANCH = Quantified("branch", "branch")
MOUNT = Quantified("mount", "mount")
HISTORY = Quantified("history", "history")
BATCH = Quantified("batch", "batch")
RATE = Quantified("level", "D_R")
SIZE = "size"
ALL_ALIKE = np.zeros(1)  # in place of a quantity that was not recorded


class KnownColumns(NamedTuple):
    """Known quantities of each reading by column; all arrays of one shape.

    Numbers are in the quantities' units; labels are the groups to which readings belong.
    """

    numbers: Mapping[str, Floats]
    labels: Mapping[str, Labels]


@dataclass(frozen=True)
class KnownFunction:
    """A dimensionless function of one known quantity.

    Parameters
    ----------
    of : Quantified
        What it is a function of.
    form : Form
        Which.
    scale : float
        By which the quantity is divided, in its unit.
    origin : float
        What is taken off before; of a part its upper, of a wave no end.
    end : float
        Lower end of a part that is between two values; number of waves in one scale.
    group : str
        Of which it is the membership.
    """

    of: Quantified
    form: Form
    scale: float = 1.0
    origin: float = 0.0
    end: float = 0.0
    group: str = ""

    def at(self, known: KnownColumns) -> Floats:
        """Return its values, in the shape of the known quantities.

        Examples
        --------
        >>> known = KnownColumns({"time": np.array([0.0, 30.0])}, {})
        >>> KnownFunction(TIME, Form.LOGARITHM, 30.0).at(known).round(4)
        array([0.    , 0.6931])
        """
        if self.form is Form.MEMBER:
            return np.asarray(known.labels[self.of.column] == self.group, dtype=np.float64)
        value = known.numbers[self.of.column]
        match self.form:
            case Form.POWER:
                found = ((value - self.origin) / self.scale) ** self.end
            case Form.ABOVE:
                found = np.maximum(value - self.origin, 0.0) / self.scale
            case Form.BELOW:
                found = np.maximum(self.origin - value, 0.0) / self.scale
            case Form.BETWEEN:
                found = ((value > self.end) & (value <= self.origin)).astype(np.float64)
            case Form.LOGARITHM:
                found = np.log1p(np.maximum(value - self.origin, 0.0) / self.scale)
            case _:
                turns = 2.0 * np.pi * self.end * value / self.scale
                found = np.sin(turns) if self.form is Form.SINE else np.cos(turns)
        return np.asarray(found, dtype=np.float64)

    @property
    def formula(self) -> str:
        """Its notation.

        Examples
        --------
        >>> KnownFunction(PATHS["actuator"], Form.POWER, 200.0, end=2).formula
        '(p/200 kPa)²'
        """
        name, here = self.of.symbol, self._value(self.origin)
        less = f"{name} − {here}" if self.origin else name
        match self.form:
            case Form.MEMBER:
                return f"[{name} = {self.group}]"
            case Form.POWER:
                ratio = self._over(f"({less})" if {" ", "/"} & set(less) else less)
                return f"{ratio}²" if self.end == 2 else ratio
            case Form.ABOVE:
                return self._over(f"max({less}, 0)")
            case Form.BELOW:
                return self._over(f"max({here} − {name}, 0)")
            case Form.BETWEEN:
                return f"[{self._value(self.end)} < {name} ≤ {here}]"
            case Form.LOGARITHM:
                return f"ln(1 + {self._over(f'({less})' if self.origin else less)})"
            case _:
                wave = "sin" if self.form is Form.SINE else "cos"
                return f"{wave}(2π {name}/{self._value(self.scale / self.end)})"

    def _over(self, above: str) -> str:
        """Write a quotient; a dimensionless quantity divided by 1 is written alone."""
        below = self._value(self.scale)
        return above if below == "1" else f"({above}/{below})"

    def _value(self, value: float) -> str:
        return f"{value:.3g} {self.of.unit}".strip()


@dataclass(frozen=True)
class KnownTerm:
    """A candidate missing term.

    Parameters
    ----------
    family : str
        Of which readings.
    kinds : tuple of str
        Which of them it changes.
    acts : Acts
        On what.
    functions : tuple of KnownFunction
        f and g, as far as they are not 1.
    path : Quantified
        What the readings of the family are taken along.
    scales : mapping of str to (float, str, str)
        Largest reading of each kind, its symbol and unit.
    longest : float
        Largest value of the path, in its unit.
    """

    family: str
    kinds: tuple[str, ...]
    acts: Acts
    functions: tuple[KnownFunction, ...]
    path: Quantified
    scales: Mapping[str, tuple[float, str, str]]
    longest: float

    @property
    def columns(self) -> tuple[str, ...]:
        """Quantities that it depends on, besides the one it changes."""
        found = [one.of.column for one in self.functions]
        return tuple(
            dict.fromkeys([*found, *([self.path.column] if self.acts is Acts.PATH else [])])
        )

    @property
    def complexity(self) -> int:
        """Number of its functions, plus one if it acts only on some kinds of the family."""
        return len(self.functions) + (len(self.kinds) < len(self.scales))

    @property
    def simplicity(self) -> tuple[int, int, int]:
        """Sort key of terms that fit equally well: functions, nonlinear ones, quantity changed."""
        bent = sum(one.form is not Form.POWER or one.end > 1 for one in self.functions)
        return self.complexity, bent, list(Acts).index(self.acts)

    @property
    def unit(self) -> str:
        """Unit of its size: of the path, of the first kind it changes, or none."""
        if self.acts is Acts.PATH:
            return self.path.unit or "–"
        return "–" if self.acts is Acts.FACTOR else self.scales[self.kinds[0]][2]

    @property
    def per_unit(self) -> float:
        """Size, in its unit, for a direction with coefficient 1."""
        if self.acts is Acts.PATH:
            return self.longest
        return 1.0 if self.acts is Acts.FACTOR else self.scales[self.kinds[0]][0]

    @property
    def formula(self) -> str:
        """Formula of the readings with it, b its size.

        Examples
        --------
        >>> p = PATHS["actuator"]
        >>> scales = {"curvature": (30.0, "κ", "1/m")}
        >>> f = KnownFunction(p, Form.POWER, 200.0, end=1)
        >>> KnownTerm("actuator", ("curvature",), Acts.FACTOR, (f,), p, scales, 200.0).formula
        'κ × (1 + b (p/200 kPa))'
        >>> KnownTerm("actuator", ("curvature",), Acts.PATH, (), p, scales, 200.0).formula
        'κ(p + b)'
        """
        symbols = [self.scales[kind][1] for kind in self.kinds]
        name = symbols[0] if len(symbols) == 1 else f"({', '.join(symbols)})"
        size = " ".join(["b", *(one.formula for one in self.functions)])
        if self.acts is Acts.FACTOR:
            return f"{name} × (1 + {size})"
        return (
            f"{name} + {size}"
            if self.acts is Acts.SHIFT
            else f"{name}({self.path.symbol} + {size})"
        )

    def change(self, kind: str, known: KnownColumns, reading: Floats, slope: Floats) -> Floats:
        """Return its effect on readings of one kind, with coefficient 1.

        Readings and their slopes ∂y/∂x along the path are those without it.
        """
        if kind not in self.kinds:
            return np.zeros_like(reading)
        whole = {
            Acts.FACTOR: reading,
            Acts.SHIFT: np.full_like(reading, self.scales[kind][0]),
            Acts.PATH: self.longest * slope,
        }[self.acts]
        for one in self.functions:
            whole = whole * one.at(known)
        return whole


@dataclass(frozen=True)
class KnownTerms:
    """All candidate terms of a linearised model.

    Parameters
    ----------
    terms : tuple of KnownTerm
        The simplest first.
    directions : array, shape (n, m)
        Changes of the readings by each, taken once, in the readings' units.
    whitened : array, shape (n, m)
        The same on the whitened scale.
    penalty : array, shape (m,)
        ln of how many are as complex [nats]: each complexity is as probable as another.
    """

    terms: tuple[KnownTerm, ...]
    directions: Floats
    whitened: Floats
    penalty: Floats

    def __len__(self) -> int:
        """Return their number."""
        return len(self.terms)


def known_terms(
    linear: Linear,
    batches: Mapping[str, str] | None = None,
    families: Collection[str] | None = None,
) -> KnownTerms:
    """Return the candidate terms of a linearised model that its parameters cannot absorb.

    Batches are by specimen, as far as known; terms of all families of readings, or of some.
    """
    places, terms, columns = linear.subject.places, [], []
    slope = slopes_along(places, linear.prediction)
    for family in dict.fromkeys(places.family.tolist()):
        if families is not None and family not in families:
            continue
        rows = places.family == family
        known = known_of(linear, rows, batches or {})
        for term in _terms_of(linear, rows, known):
            terms.append(term)
            whole = np.zeros(len(places))
            kinds = places.kind[rows]
            for kind in term.kinds:
                changed = term.change(kind, known, linear.prediction[rows], slope[rows])
                whole[np.flatnonzero(rows)[kinds == kind]] = changed[kinds == kind]
            columns.append(whole)
    order = sorted(range(len(terms)), key=lambda i: terms[i].complexity)
    directions = np.array([columns[i] for i in order]).reshape(len(terms), len(places)).T
    whitened = linear.whiten_columns(directions)
    own = linear.whitening.inverse @ directions
    square, before = np.sum(whitened**2, axis=0), np.sum(own**2, axis=0)
    seen = np.flatnonzero(square > np.maximum(LEAST_LEFT * before, 1e-12))
    unit = whitened[:, seen] / np.sqrt(square[seen])
    same = np.abs(unit.T @ unit) > ALIKE
    first = np.array([not same[i, :i].any() for i in range(len(seen))], dtype=bool)
    kept = seen[first] if len(seen) else seen
    found = tuple(terms[order[i]] for i in kept.tolist())
    complexity = np.array([one.complexity for one in found], dtype=int)
    count = np.bincount(complexity, minlength=1)
    penalty = np.log(count[complexity]) if len(found) else np.zeros(0)
    return KnownTerms(found, directions[:, kept], whitened[:, kept], penalty)


def slopes_along(places: Places, readings: Floats) -> Floats:
    """Return ∂y/∂x of readings along the path on which they were taken, (n,).

    From differences between neighbours of the same specimen, kind and history; 0 for a reading
    without neighbours.

    Examples
    --------
    >>> from bayesdeg.observations.readings import places_of
    >>> curve = places_of([1.0, 2.0, 4.0], specimen=["a", "a", "a"])
    >>> slopes_along(curve, np.array([2.0, 4.0, 8.0])).tolist()
    [2.0, 2.0, 2.0]
    """
    found = np.zeros(len(places))
    keys = np.char.add(np.char.add(places.specimen, "\n"), places.kind)
    keys = np.char.add(np.char.add(keys, "\n"), places.history)
    for key in np.unique(keys):
        rows = np.flatnonzero(keys == key)
        along, place = np.unique(places.along[rows], return_inverse=True)
        if len(along) > 1:
            mean = np.bincount(place, readings[rows]) / np.bincount(place)
            found[rows] = np.gradient(mean, along)[place]
    return found


def known_of(linear: Linear, rows: Flags, batches: Mapping[str, str]) -> KnownColumns:
    """Return the known quantities of the readings of one family, each (k,)."""
    places = linear.subject.places.subset(rows)
    path = path_of(linear, places)
    tops = _tops(places, linear.prediction[rows])
    lag = np.zeros(len(places))  # of the path below its largest value so far, as it was read
    keys = np.char.add(np.char.add(places.specimen, "\n"), places.kind)
    for key in np.unique(keys):
        those = np.flatnonzero(keys == key)
        lag[those] = np.maximum.accumulate(places.along[those]) - places.along[those]
    numbers = {
        path.column: places.along - AT_REST.get(str(places.family[0]), 0.0),
        SIZE: np.abs(linear.prediction[rows]) / np.array([tops[kind] for kind in places.kind]),
        LAG.column: lag,
        DEGRADATION.column: places.level,
        TIME.column: places.time,
        HUMIDITY.column: places.humidity,
    }
    model = linear.subject
    if places.family[0] == ACTUATOR and isinstance(model.world, FilmsAndActuators):
        rates, place = np.unique(places.level, return_inverse=True)
        numbers[LOAD.column] = 1e-3 * places.along / moduli_at(model, linear.mode, rates)[place]
    unit = " %" if places.family[0] in PATHS else ""
    centres, member = levels(places.level)
    labels = {RATE.column: np.array([f"{centre:.3g}{unit}" for centre in centres])[member]}
    labels[BATCH.column] = np.array([batches.get(str(name), "") for name in places.specimen])
    words = [history.split() for history in places.history.tolist()]
    if all(len(one) == 3 and one[1].isdigit() for one in words):  # branch, cycle and mount
        split = np.array(words)
        labels[BRANCH.column], labels[MOUNT.column] = split[:, 0], split[:, 2]
        numbers[CYCLE.column] = split[:, 1].astype(np.float64) - 1.0
    else:
        labels[HISTORY.column] = places.history
    return KnownColumns({n: v for n, v in numbers.items() if np.all(np.isfinite(v))}, labels)


def path_of(linear: Linear, places: Places) -> Quantified:
    """Return the path of the readings of one family."""
    family = str(places.family[0])
    if family in PATHS:
        return PATHS[family]
    scale = linear.subject.scales.get(str(places.kind[0]))
    name = "x" if scale is None else scale.axis
    return Quantified(name, name)


def reading_unit(linear: Linear, kind: str) -> str:
    """Return the unit of one kind of reading; an en dash where it has none."""
    scale = linear.subject.scales.get(kind)
    return READ[kind][1] if kind in READ else ("" if scale is None else scale.unit) or "–"


def _tops(places: Places, readings: Floats) -> dict[str, float]:
    """Return the largest reading of each kind, in size."""
    return {
        str(kind): max(float(np.max(np.abs(readings[places.kind == kind]))), 1e-300)
        for kind in np.unique(places.kind)
    }


def moduli_at(model: JointModel, vector: Floats, rates: Floats) -> Floats:
    """Return Young's modulus of films at degradation rates [%] for one vector, (n,) [MPa]."""
    values = model.table.named(vector[None])
    moduli: Floats = young_modulus(values, model.world.constants(values, rates), model.causes)[0]
    return moduli


def _terms_of(linear: Linear, rows: Flags, known: KnownColumns) -> Iterator[KnownTerm]:
    """Yield all terms of one family of readings."""
    places = linear.subject.places.subset(rows)
    path, tops = path_of(linear, places), _tops(places, linear.prediction[rows])
    kinds = tuple(dict.fromkeys(places.kind.tolist()))
    scales = {k: (tops[k], READ.get(k, (k, ""))[0], reading_unit(linear, k)) for k in kinds}
    longest = float(np.max(np.abs(known.numbers[path.column])))
    plain = KnownTerm(str(places.family[0]), kinds, Acts.FACTOR, (), path, scales, longest)
    loads, states = list(_of_load(path, known)), list(_of_state(places, known))
    # groups are combined only with trends
    pairs = [
        (one, other)
        for one, other in product(loads, states)
        if other.form is not Form.MEMBER or (one.form is Form.POWER and one.end == 1)
    ]
    functions = [(), *((one,) for one in (*loads, *states)), *pairs]
    alone = [(kind,) for kind in kinds] if len(kinds) > 1 else []
    for acts, some, of in product(Acts, functions, [kinds, *alone]):
        yield replace(plain, acts=acts, functions=some, kinds=of)


def _of_load(path: Quantified, known: KnownColumns) -> Iterator[KnownFunction]:
    """Yield functions of the load, and of the reading itself."""
    yield from _shapes(path, known.numbers[path.column])
    top = float(np.max(np.abs(known.numbers[path.column])))
    if top > 0.0:
        for low, high in pairwise((0.0, top / 3.0, 2.0 * top / 3.0, top)):
            yield KnownFunction(path, Form.BETWEEN, top, high, low)
        for form, count in product((Form.SINE, Form.COSINE), WAVES):
            yield KnownFunction(path, form, top, end=count)
    if LOAD.column in known.numbers:
        yield from _shapes(LOAD, known.numbers[LOAD.column])
    yield from _shapes(Quantified(SIZE, "y/y_max"), known.numbers[SIZE])
    if np.max(known.numbers[LAG.column]) > 0.0:
        largest = float(np.max(known.numbers[LAG.column]))
        lag = Quantified(LAG.column, f"{path.symbol}_max − {path.symbol}", path.unit)
        yield KnownFunction(lag, Form.POWER, largest, end=1)


def _shapes(of: Quantified, values: Floats) -> Iterator[KnownFunction]:
    """Yield powers of a quantity, and where it is above or below parts of its largest value."""
    top = float(np.max(np.abs(values)))
    if top <= 0.0:
        return
    for power in (1, 2):
        yield KnownFunction(of, Form.POWER, top, end=power)
    for part in PARTS:
        yield KnownFunction(of, Form.ABOVE, top, part * top)
    for part in PARTS[:2]:
        yield KnownFunction(of, Form.BELOW, top, part * top)


def _of_state(places: Places, known: KnownColumns) -> Iterator[KnownFunction]:
    """Yield functions of the specimen's state, and of the history of its test."""
    rates = known.numbers.get(DEGRADATION.column, ALL_ALIKE)
    if np.ptp(rates) > 0.0:
        of = DEGRADATION if places.family[0] in PATHS else LEVEL
        for power in (1, 2):
            yield KnownFunction(of._replace(column=DEGRADATION.column), Form.POWER,
                                float(np.max(np.abs(rates))), end=power)  # fmt: skip
    time = known.numbers.get(TIME.column, ALL_ALIKE)
    if np.ptp(time) > 0.0:
        yield KnownFunction(TIME, Form.POWER, float(np.max(time)), end=1)
        first = 0.1 * float(np.median(time[time > 0.0]))
        yield KnownFunction(TIME, Form.LOGARITHM, first)
    humidity = known.numbers.get(HUMIDITY.column, ALL_ALIKE)
    if np.ptp(humidity) > 0.0:
        middle = float(np.median(humidity))
        yield KnownFunction(HUMIDITY, Form.POWER, float(np.ptp(humidity)), middle, 1)
    cycle = known.numbers.get(CYCLE.column, ALL_ALIKE)
    if np.max(cycle) > 0.0:
        yield KnownFunction(CYCLE, Form.ABOVE, float(np.max(cycle)), 0.0)
        yield KnownFunction(CYCLE, Form.LOGARITHM, 1.0)
    rate = RATE if places.family[0] in PATHS else LEVEL
    names = {column.column: column for column in (BRANCH, MOUNT, HISTORY, BATCH, rate)}
    for column, labels in known.labels.items():
        groups = [str(name) for name in np.unique(labels) if name]
        if len(groups) == 2 and column in (BRANCH.column, MOUNT.column):
            groups = groups[1:]  # one group is the complement of the other
        for group in groups if len(np.unique(labels)) > 1 else ():
            if len(np.unique(places.specimen[labels == group])) >= SHARED:
                yield KnownFunction(names[column], Form.MEMBER, group=group)
