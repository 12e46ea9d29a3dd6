"""The joint model: data, forward map and active causes as one batched log density."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import with_causes
from bayesdeg.inference.density import Density, Factors
from bayesdeg.observations import catalogue
from bayesdeg.observations.kinds import (
    NOWHERE,
    Deviations,
    Grouped,
    Labels,
    Observations,
    Places,
    Pointwise,
    Scale,
    State,
    joined_places,
)
from bayesdeg.priors import Named, Parameter, ParameterTable

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AT_ONCE = 256
"""Vectors of a batch evaluated at a time: few enough for intermediate results to fit the cache."""


@dataclass(frozen=True)
class JointModel:
    """A posterior density, up to a constant, that can be criticised and extended by causes.

    Parameters
    ----------
    base : tuple of Parameter
        Parameters, without those of the causes.
    observations : tuple of Observations
        The data, each kind once.
    world : FilmsAndActuators or Formula
        Conversion of parameters to what the kinds of data need.
    causes : tuple of Cause
        Active causes.
    held : str
        Name of the kind of data that is held out group by group; by default the available one of
        highest priority.

    Raises
    ------
    ValueError
        If there are no parameters, names clash, or a cause acts on nothing.

    Examples
    --------
    A spring of unknown stiffness, read with an error of 1 mm:

    >>> from bayesdeg.observations.readings import Formula, FormulaReadings, places_of
    >>> from bayesdeg.priors import LogNormal
    >>> force = np.array([1.0, 2.0, 3.0])
    >>> length = FormulaReadings(
    ...     np.array([14.0, 23.0, 35.0]),
    ...     places_of(force, kind="length"),
    ...     error=lambda values, lengths: 1.0,
    ... )
    >>> spring = JointModel(
    ...     (Parameter("stiffness", LogNormal(0.1, 1.0), "N/mm", "of the spring"),),
    ...     (length,),
    ...     Formula(lambda values, force: force / values["stiffness"]),
    ... )
    >>> spring.expected(np.array([[np.log(0.1)]]))
    array([[10., 20., 30.]])
    """

    base: tuple[Parameter, ...]
    observations: tuple[Observations, ...]
    world: Any
    causes: tuple[Cause, ...] = ()
    held: str = ""

    def __post_init__(self) -> None:
        """Link dependent kinds of data, and refuse inconsistent ones."""
        linked = (one.linked(self.observations) for one in self.observations)
        kept = tuple(one for one in linked if one is not None)
        object.__setattr__(self, "observations", kept)
        names = self.table.names
        if not self.base or len(set(names)) < len(names):
            raise ValueError(f"parameters need distinct names, at least one, not {list(names)}")
        self.world.check(self.causes)

    @cached_property
    def table(self) -> ParameterTable:
        """All parameters, those of the causes last."""
        return with_causes(self.base, self.causes)

    @property
    def continued(self) -> Self:
        """The model with a forward map continued outside its range; its density is the same."""
        return replace(self, world=self.world.continued)

    # ---- the density

    def state(self, values: Named) -> State[Any]:
        """Return named values (n,) with derived quantities, in the continued world."""
        return State(values, self.world.continued, self.causes)

    def tests(self, values: Named) -> State[Any]:
        """Return the same with nan outside the forward map's range."""
        return State(values, self.world, self.causes)

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, shape (n,); −inf where impossible."""
        table, parts = self.table, []
        for part in _batches(vectors):
            with np.errstate(all="ignore"):
                values = table.named(part)
                total = table.log_prior(part, truncate=truncate)
                for block in self.log_likelihood(values).values():
                    total = total + np.sum(block, axis=-1)
                total = np.where(self.allows(values), total, -np.inf)
            parts.append(np.where(np.isfinite(total), total, -np.inf))
        return np.concatenate(parts)

    def log_likelihood(self, values: Named) -> dict[str, Floats]:
        """Return log densities of whole specimens by kind of data, each (n, n_specimens)."""
        state = self.state(values)
        return {one.name: one.log_likelihood(state) for one in self.observations}

    def factors(self, vectors: Floats) -> Factors | None:
        """Return the factors of the density, without the bounds of priors.

        None if the law of a kind of data has a different form.
        """
        with np.errstate(all="ignore"):
            state = self.state(self.table.named(vectors))
            # parts without the forward map come first
            ordered = sorted(self.observations, key=lambda one: one.uses_forward)
            parts = [one.factors(state) for one in ordered] if self.world.is_factored else [None]
            known = [part for part in parts if part is not None]
            if len(known) < len(parts):
                return None
            prior = self.table.log_priors(vectors, truncate=False)
        normal = [pair for part in known for pair in part.normal]
        events = [pair for part in known for pair in part.events]
        return Factors(*_joined(normal, len(vectors)), *_joined(events, len(vectors)), prior)

    def allows(self, values: Named) -> Flags:
        """Return a mask of values allowed by the world for these specimens, (n,)."""
        allowed: Flags = self.world.allows(values, self._levels)
        return allowed

    @cached_property
    def _levels(self) -> Floats:
        return np.concatenate([np.empty(0), *(one.levels for one in self.observations)])

    # ---- different data and causes

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        return replace(self, causes=in_order((*self.causes, *causes)))

    def with_observations(self, *new: Observations) -> Self:
        """Return the model with different data of these kinds."""
        names = {one.name for one in new}
        kept = (one for one in self.observations if one.name not in names)
        return replace(self, observations=catalogue.in_order((*kept, *new)))

    def without_kinds(self, *names: str) -> Self:
        """Return the model without data of these kinds."""
        kept = tuple(one for one in self.observations if one.name not in names)
        return replace(self, observations=kept)

    def with_world(self, **changes: Any) -> Self:
        """Return the model with a modified world."""
        return replace(self, world=replace(self.world, **changes))

    def of_kind[K: Observations](self, kind: type[K]) -> tuple[K, ...]:
        """Return the data of a kind: one entry, or none."""
        return catalogue.of_kind(self.observations, kind)

    def data_of[K: Observations](self, kind: type[K]) -> K:
        """Return the data of a kind; empty if the model has none."""
        found = self.of_kind(kind)
        return found[0] if found else kind()

    # ---- readings and held-out groups

    @property
    def criticised(self) -> tuple[Observations, ...]:
        """Kinds of data that are compared with the model by reading or event."""
        return tuple(one for one in self.observations if one.is_criticised)

    @cached_property
    def places(self) -> Places:
        """Return the places of the readings."""
        parts = [one.places for one in self._read]
        return joined_places(parts) if parts else NOWHERE

    @property
    def _read(self) -> tuple[Pointwise, ...]:
        """Kinds of data with readings; an empty part would change the layout of others."""
        found = (one for one in self.observations if isinstance(one, Pointwise))
        return tuple(one for one in found if one.is_criticised and len(one.places))

    @property
    def scales(self) -> dict[str, Scale]:
        """Units and axes of kinds of readings without their own tables and figures."""
        return {name: scale for one in self._read for name, scale in one.scales.items()}

    @cached_property
    def observed(self) -> Floats:
        """The readings, (n,)."""
        return np.concatenate([np.empty(0), *(one.observed for one in self._read)])

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups held out in turn; `without` and `only` take indices into it."""
        return self._held[0].groups if self._held else ()

    @cached_property
    def group(self) -> Labels:
        """Group of each reading, (n,); empty for readings that are never held out."""
        held = [one.name for one in self._held]
        parts = [
            one.reading_groups if one.name in held else np.full(len(one.places), "")
            for one in self._read
        ]
        return np.concatenate([np.empty(0, dtype=np.str_), *parts])

    @property
    def _of_groups(self) -> tuple[Grouped, ...]:
        return tuple(one for one in self.observations if isinstance(one, Grouped))

    @property
    def _held(self) -> tuple[Grouped, ...]:
        """The held-out data, and further readings on the same specimens."""
        asked = [one for one in self._of_groups if one.name == self.held]
        usual = [one for one in self._of_groups if one.priority] if not self.held else []
        if not (asked or usual):
            return ()
        chief = max((*asked, *usual), key=lambda one: one.priority)
        return (chief, *(one for one in self._of_groups if one.follows == chief.name))

    @property
    def holds_out_modes(self) -> bool:
        """Whether whole modes of tension are held out."""
        return any(one.is_by_mode for one in self._held)

    @property
    def is_beside(self) -> bool:
        """Whether the held-out data are compared only by density, besides the readings."""
        return bool(self.held)

    @property
    def beside(self) -> tuple[Self, ...]:
        """The same model, holding out the additional data on which causes are compared."""
        chief = [one.name for one in self._held if one.uses_forward]
        others = [one for one in self._of_groups if one.beside and chief]
        return tuple(
            replace(self.with_observations(one.held_beside()), held=one.name) for one in others
        )

    def expected(self, vectors: Floats) -> Floats:
        """Return readings of average specimens, (k, n); nan if refused."""
        state = self.state(self.table.named(vectors))
        return np.concatenate([one.expected(state) for one in self._read], axis=1)

    def scatter(self, vector: Floats) -> Floats:
        """Return the covariance of readings from specimen deviations and errors, (n, n)."""
        state = self.state(self.table.named(vector[None]))
        blocks = (block for one in self._read for block in one.covariance(state))
        total = np.asarray(block_diag(*blocks))
        own = {one.name: one.deviations(state) for one in self._read}
        for one in self._read:
            if one.shares in own:
                first, second = own[one.shares], own[one.name]
                both = first.slope * first.spread @ second.slope.T
                rows, columns = self._rows_of(one.shares), self._rows_of(one.name)
                total[rows, columns], total[columns, rows] = both, both.T
        return total

    def _rows_of(self, name: str) -> slice:
        """Return the slice of the readings of a kind."""
        before = 0
        for one in self._read:
            if one.name == name:
                return slice(before, before + len(one.places))
            before += len(one.places)
        return slice(0, 0)

    def deviations(self, vector: Floats) -> Deviations:
        """Return the effect of specimen deviations on all readings."""
        state = self.state(self.table.named(vector[None]))
        found = [one.deviations(state) for one in self._read]
        if not found:
            return Deviations(np.empty((0, 0)), np.empty(0), np.empty(0))
        slope, spread, level = zip(*found, strict=True)
        joined = block_diag(*slope)
        starts = np.cumsum([0, *(len(own.spread) for own in found)])
        place = {one.name: k for k, one in enumerate(self._read)}
        own = np.ones(joined.shape[1], dtype=bool)
        for k, one in enumerate(self._read):
            if one.shares in place:
                columns, chief = (slice(starts[i], starts[i + 1]) for i in (k, place[one.shares]))
                joined[:, chief] += joined[:, columns]
                own[columns] = False
        return Deviations(joined[:, own], np.concatenate(spread)[own], np.concatenate(level)[own])

    def simulated(self, vectors: Floats, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan if refused."""
        state = self.state(self.table.named(vectors))
        return np.concatenate([one.simulate(state, generator) for one in self._read], axis=1)

    def rest(self) -> Self:
        """Return the model without its readings: priors and all other data."""
        kept = tuple(one for one in self.observations if not one.is_criticised)
        return replace(self, observations=kept)

    def without(self, groups: NDArray[np.intp]) -> Self:
        """Return the model without some groups."""
        return self.only(np.setdiff1d(np.arange(len(self.groups)), groups))

    def only(self, groups: NDArray[np.intp]) -> Self:
        """Return the model with only some groups; data that are never held out stay."""
        kept = {"", *(self.groups[g] for g in groups)}
        held = {one.name: one for one in self._held}
        found = (
            _subset(one, [g in kept for g in held[one.name].row_groups])
            if one.name in held
            else one
            for one in self.observations
        )
        return replace(self, observations=tuple(one for one in found if len(one.labels)))

    def group_density(self, vectors: Floats) -> Floats:
        """Return the log density of all readings of each group, (k, n_groups)."""
        state = self.state(self.table.named(vectors))
        total = np.zeros((len(vectors), len(self.groups)))
        with np.errstate(invalid="ignore"):
            for one in self._held:
                density, member = one.log_likelihood(state), np.array(one.row_groups)
                columns = [density[:, member == g].sum(axis=1) for g in self.groups]
                total = total + np.stack(columns, axis=1)
        return np.where(np.isfinite(total), total, -np.inf)

    def watched(self, report: Callable[[Flags], None]) -> Self:
        """Return a model that reports the vectors refused by its forward map, (n,)."""
        world = self.world
        for one in self.observations:
            world = one.watched(world, report)
        return replace(self, world=world)


def _batches(vectors: Floats) -> Iterator[Floats]:
    """Yield vectors `AT_ONCE` at a time; an empty batch if there are none."""
    for first in range(0, max(len(vectors), 1), AT_ONCE):
        yield vectors[first : first + AT_ONCE]


def _subset(one: Observations, kept: list[bool]) -> Observations:
    return one.subset(np.flatnonzero(kept))


def _joined(parts: list[tuple[Floats, Floats]], count: int) -> tuple[Floats, Floats]:
    """Join pairs of arrays (count, k) along their last axis."""
    nothing = np.empty((count, 0))
    first, second = zip((nothing, nothing), *parts, strict=True)
    return np.concatenate(first, axis=-1), np.concatenate(second, axis=-1)


@dataclass(frozen=True)
class Refusals:
    """Counts of proposals.

    Parameters
    ----------
    proposed : int
        Vectors whose density was evaluated.
    refused : int
        Those allowed by priors and stability but refused by the forward map as outside its training
        range.

    Examples
    --------
    >>> (Refusals(300, 2) + Refusals(100, 2)).share
    0.01
    """

    proposed: int = 0
    refused: int = 0

    def __add__(self, other: "Refusals") -> "Refusals":
        """Return the sums of both."""
        return Refusals(self.proposed + other.proposed, self.refused + other.refused)

    @property
    def share(self) -> float:
        """Refused share of the proposals [–]; 0 without proposals."""
        return self.refused / self.proposed if self.proposed else 0.0


def share_outside(model: JointModel, vectors: Floats) -> float:
    """Return the share of vectors with a reading outside the forward map's range [–].

    There the likelihood only pushes back inside: a posterior with a large share there is
    unreliable.

    Parameters
    ----------
    model : JointModel
        Without a forward map nothing is outside.
    vectors : array, shape (n, n_parameters)
        Posterior draws.
    """
    if not len(vectors):
        return 0.0
    tests = model.tests(model.table.named(vectors))
    refused = [one.refused(tests) for one in model.observations]
    return float(np.mean(np.any([np.zeros(len(vectors), dtype=bool), *refused], axis=0)))


class CountedDensity:
    """A log density that counts the vectors refused by a model's forward map.

    Parameters
    ----------
    density : Density
        The density; one that is not a ``JointModel`` refuses nothing.
    """

    def __init__(self, density: Density) -> None:
        self._proposed = 0
        self._refused: list[Floats] = []
        self._watched = density
        self._outside = np.zeros(0, dtype=bool)
        if isinstance(density, JointModel):
            self._model = density
            self._watched = density.watched(self._report)

    def __call__(self, vectors: Floats) -> Floats:
        """Return the log posterior density of each vector, shape (n,)."""
        densities = []
        # in the batches of the model, which evaluates its forward map for each
        for part in _batches(vectors):
            self._outside = np.zeros(len(part), dtype=bool)
            densities.append(self._watched.log_prob(part))
            self._proposed += len(part)
            if self._outside.any():
                self._refused.append(part[self._outside])
        return np.concatenate(densities)

    @property
    def refusals(self) -> Refusals:
        """Number of vectors so far, and of those refused only by the map."""
        if not self._refused:
            return Refusals(self._proposed)
        table, refused = self._model.table, np.concatenate(self._refused)
        with np.errstate(all="ignore"):
            possible = np.isfinite(table.log_prior(refused))
            stable = self._model.allows(table.named(refused))
        return Refusals(self._proposed, int(np.sum(possible & stable)))

    def _report(self, refused: Flags) -> None:
        self._outside = self._outside | refused


def blocks_of(
    model: JointModel, kinds: Iterable[str] | None = None
) -> dict[str, dict[str, NDArray[np.intp]]]:
    """Return the rows of every specimen in every kind of data.

    A film that was stretched and then torn is in two tables under one name, one stretched in two
    modes has two curves: each is one block.

    Parameters
    ----------
    model : JointModel
        With its data.
    kinds : iterable of str, optional
        Names of kinds; all by default.

    Returns
    -------
    dict
        Rows by specimen and kind, specimens in order of first appearance.
    """
    blocks: dict[str, dict[str, list[int]]] = {}
    chosen = {one.name for one in model.observations} if kinds is None else set(kinds)
    for one in model.observations:
        for row, specimen in enumerate(one.specimens if one.name in chosen else ()):
            blocks.setdefault(specimen, {}).setdefault(one.name, []).append(row)
    return {
        specimen: {kind: np.array(rows, dtype=np.intp) for kind, rows in found.items()}
        for specimen, found in blocks.items()
    }


def without(model: JointModel, specimens: Iterable[str]) -> JointModel:
    """Return the model without the data of some specimens, in any table.

    Priors, parameters and summary statistics stay.

    Raises
    ------
    ValueError
        If the model has no specimen of a name.
    """
    left_out = frozenset(specimens)
    known = {name for one in model.observations for name in one.specimens}
    if unknown := left_out - known:
        raise ValueError(f"there is no specimen {', '.join(sorted(unknown))}")
    found = (
        _subset(one, [name not in left_out for name in one.specimens]) if one.specimens else one
        for one in model.observations
    )
    return replace(model, observations=tuple(one for one in found if len(one.labels)))


def replicate(model: JointModel, values: Named, generator: np.random.Generator) -> JointModel:
    r"""Return the model with all data simulated for new specimens in the same tests.

    Every kind of data is drawn from its likelihood, except that nothing is linearised: the
    specimens' deviations m of ln stiffness and of the degradation rate of films go through the full
    equations,

    .. math:: y = f(m) + \sqrt{v(m)}\, z, \qquad m_k \sim N(0, \tau_k^2)

    with z correlated along the path and between the outputs. An actuator bursts at the first
    pressure with more stretch than its own limit, drawn from the law of elongation at break; later
    rows are removed.

    Parameters
    ----------
    model : JointModel
        Its tests: stretches, pressures, degradation rates, standard errors.
    values : mapping
        One set of named values, each of shape (1,).
    generator : Generator
        Source of all draws.

    Returns
    -------
    JointModel
        Readings are nan outside the forward map's range; if the model includes elongation at break,
        an actuator bursts there instead.

    Examples
    --------
    >>> from bayesdeg.observations.means import Means, Statistic
    >>> from bayesdeg.observations.specimens import FilmsAndActuators, material_parameters
    >>> modulus = Statistic("young_modulus", 0.0, 1.7, 0.1, "published", 2.0)
    >>> films = FilmsAndActuators((0.0,))
    >>> model = JointModel(material_parameters((0.0,)), (Means((modulus,)),), films)
    >>> values = model.table.named(model.table.sample(np.random.default_rng(0), 1))
    >>> (6.0 * values["c1_at_0"]).round(2)  # Young's modulus [MPa]
    array([2.07])
    >>> again = replicate(model, values, np.random.default_rng(1))
    >>> round(again.data_of(Means).statistics[0].value, 2)
    2.13
    """
    state: State[Any] = model.tests(values)
    drawn: tuple[Observations, ...] = ()
    for one in model.observations:
        drawn = one.replicated(state, generator, drawn)
    return replace(model, observations=drawn)


JITTER = 0.03  # spread of vectors about the fit, on the unconstrained scale
INSIDE = 0.02  # probability that a start stays away from the bounds of its prior


def least_squares(model: JointModel) -> Floats:
    """Return a vector near the mode, by least squares from films, else from prior medians.

    Stress is linear in the control values of the constants, and ln elongation in its values at the
    nodes, so both have a unique solution: starts drawn from a prior may lead to a different, lower
    mode.

    Returns
    -------
    array, shape (n_parameters,)
        On the unconstrained scale; its density may still be 0.
    """
    values = {p.name: float(p.law.quantile(0.5)) for p in model.table.parameters}
    values |= _suggested(model)
    within = {
        p.name: float(np.clip(values[p.name], *p.law.quantile([INSIDE, 1.0 - INSIDE])))
        for p in model.table.parameters
    }
    return np.asarray(model.table.vectors({name: np.array(v) for name, v in within.items()}))


def near_films(
    model: JointModel, generator: np.random.Generator, *, count: int = 400
) -> Floats | None:
    """Return the most probable of vectors near the films' least-squares fit, if any is possible.

    Also None if the world has no known limits. Parameters not determined by films are drawn from
    their priors: if their medians lead outside the forward map's range, other values may not.

    Parameters
    ----------
    model : JointModel
        Whose mode is sought.
    generator : Generator
        Draws the vectors.
    count : int
        Number of them.
    """
    if not model.world.is_limited:
        return None
    fit, known = least_squares(model), _suggested(model)
    draws = model.table.sample(generator, count)
    columns = [i for i, name in enumerate(model.table.names) if name in known]
    jitter = JITTER * generator.standard_normal((count, len(columns)))
    draws[:, columns] = fit[columns] + jitter
    trials = np.vstack([fit, draws])
    density = model.log_prob(trials)
    best = int(np.argmax(density))
    return trials[best] if np.isfinite(density[best]) else None


def _suggested(model: JointModel) -> dict[str, float]:
    """Return the start suggested by the kinds of data."""
    return {n: v for one in model.observations for n, v in one.start(model.world).items()}
