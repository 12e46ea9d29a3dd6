"""Data, forward map and active causes as one log density over a batch of vectors."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from bayesdeg.actuator.inputs import PAPER_THICKNESS, ForwardMap, Inputs, Prediction, continuation
from bayesdeg.actuator.status import Status
from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import Cause, Degradation, Strength
from bayesdeg.inference import actuators, films, likelihood, published
from bayesdeg.inference.actuators import Rig
from bayesdeg.inference.data import ActuatorCurves, Breaks, Statistic, TensileCurves
from bayesdeg.inference.density import Density, Factors
from bayesdeg.inference.likelihood import Linearised
from bayesdeg.inference.parameters import (
    Named,
    ParameterTable,
    control_name,
    node_name,
    with_causes,
)
from bayesdeg.inference.published import PublishedTests
from bayesdeg.inference.specimens import (
    Material,
    constants_at,
    controls_of,
    elongation_at,
    elongation_spread,
    expected_statistics,
    material_at,
    shared,
)
from bayesdeg.material import degradation as law
from bayesdeg.material.degradation import (
    Nodes,
    bernstein_weights,
    lagrange_weights,
    satisfies_baker_ericksen,
)
from bayesdeg.priors import Parameter

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AT_ONCE = 256
"""Vectors of a batch that are worked on at a time: so few that what lies between fits the cache."""


@dataclass(frozen=True)
class Model:
    """A posterior density up to a constant.

    Parameters
    ----------
    base : tuple of Parameter
        Parameters without those of the causes.
    nodes, elongation_nodes : tuple of float
        Degradation rates at which constants are controlled and elongation is held [%].
    forward : ForwardMap, optional
        Needed if there are actuator curves.
    tensile, actuator, breaks, statistics, published
        The data; any may be missing.
    causes : tuple of Cause
        Active causes.
    paper_thickness : float
        Of the actuators [mm].
    largest_pressure : float
        By which the emulator's common error is scaled [kPa].

    Notes
    -----
    The deviation of an actuator's ln stiffness has variance
    τ² = σ² + (d ln C1/dD_R · sd(D_R))²: scatter of the material, and the error of its degradation
    rate, which acts through C1 (the elasticities to C2 and C3 are below 0.02). In films the error
    of the degradation rate acts through all three constants.
    """

    base: tuple[Parameter, ...]
    nodes: law.Nodes
    elongation_nodes: law.Nodes = (0.0,)
    forward: ForwardMap | None = None
    tensile: TensileCurves | None = None
    actuator: ActuatorCurves | None = None
    breaks: Breaks | None = None
    statistics: tuple[Statistic, ...] = ()
    published: PublishedTests | None = None
    causes: tuple[Cause, ...] = ()
    paper_thickness: float = PAPER_THICKNESS
    largest_pressure: float = 240.0

    @property
    def table(self) -> ParameterTable:
        """All parameters, those of the causes last."""
        return with_causes(self.base, self.causes)

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        return replace(self, causes=in_order((*self.causes, *causes)))

    @property
    def continued(self) -> Self:
        """The model with a forward map that goes on outside its range, if it can.

        Its density is the same; what it predicts outside serves to linearise it and to simulate
        readings about its mode, and is no prediction.
        """
        if self.forward is None:
            return self
        return replace(self, forward=continuation(self.forward))

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, shape (n,); −inf where impossible."""
        parts = [
            self._log_prob(vectors[k : k + AT_ONCE], truncate=truncate)
            for k in range(0, max(len(vectors), 1), AT_ONCE)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _log_prob(self, vectors: Floats, *, truncate: bool) -> Floats:
        table = self.table
        with np.errstate(all="ignore"):
            values = table.named(vectors)
            total = table.log_prior(vectors, truncate=truncate, values=values)
            for block in self.log_likelihood(values).values():
                total = total + np.sum(block, axis=-1)
            total = np.where(self.is_stable(values), total, -np.inf)
        return np.where(np.isfinite(total), total, -np.inf)

    def factors(self, vectors: Floats) -> Factors | None:
        """Return the factors of the density, without the bounds of priors.

        None where published results of others are data, whose laws are of another kind.
        """
        if self.published is not None:
            return None
        with np.errstate(all="ignore"):
            values = self.table.named(vectors)
            normal, events = self._film_factors(values), self._mean_factors(values)
            if self.actuator is not None:
                curves, predicted = self._actuators(values)
                normal.append(likelihood.innovations(curves))
                excess = actuators.range_excess(self.actuator, predicted.prediction)
                events.append((-0.5 * excess**2, excess))
                if self.has_elongation:
                    log_rupture = self._log_rupture(values, predicted.prediction)
                    events.append((log_rupture, likelihood.event_signal(log_rupture)))
            prior = self.table.log_priors(vectors, truncate=False)
        count = len(vectors)
        return Factors(*_joined(normal, count), *_joined(events, count), prior)

    def _film_factors(self, values: Named) -> list[tuple[Floats, Floats]]:
        """Return z and ln s of stresses and of elongations at break, each (n, n_readings)."""
        found = []
        if self.tensile is not None:
            found.append(likelihood.innovations(self.tensile_linearised(values)))
        if self.breaks is not None:
            median, spread = self._break_law(values, self.breaks)
            score = np.log(self.breaks.elongation / median) / spread
            found.append((score, np.log(spread * self.breaks.elongation)))
        return found

    def _mean_factors(self, values: Named) -> list[tuple[Floats, Floats]]:
        """Return log densities of measured means and their signals, each (n, n_statistics)."""
        if not self.statistics:
            return []
        known = [(s.value, s.se, s.dof) for s in self.statistics]
        means = self._expected(values, self.statistics)
        densities = [
            likelihood.student(value, mean, se, dof)
            for (value, se, dof), mean in zip(known, means.T, strict=True)
        ]
        scale = np.array([likelihood.student_information(dof) / se for _, se, dof in known])
        return [(np.stack(densities, axis=-1), scale * means)]

    def log_likelihood(self, values: Named) -> dict[str, Floats]:
        """Return log densities of whole specimens by kind of data, each (n, n_specimens)."""
        blocks = {}
        if self.tensile is not None:
            stresses = self.stresses(values, self.tensile)
            blocks["tensile"] = films.log_density(self.tensile, values, stresses)
        if self.actuator is not None:
            rig, actuators_of = self.continued.rig, self._material_of_actuators(values)
            density, prediction = actuators.log_density(rig, values, *actuators_of)
            excess = actuators.range_excess(self.actuator, prediction)
            blocks["actuator"] = density - 0.5 * excess**2
            if self.has_elongation:
                blocks["rupture"] = self._log_rupture(values, prediction)
        if self.breaks is not None:
            blocks["breaks"] = self._log_breaks(values, self.breaks)
        if self.statistics:
            expected = zip(self.statistics, self._expected(values, self.statistics).T, strict=True)
            densities = [likelihood.student(s.value, mean, s.se, s.dof) for s, mean in expected]
            blocks["statistics"] = np.stack(densities, axis=-1)
        if self.published is not None:
            blocks |= self._log_published(values, self.published)
        return blocks

    @property
    def has_elongation(self) -> bool:
        """Whether the elongation at break is a part of the model."""
        return any(p.name == "elongation_scatter" for p in self.base)

    def is_stable(self, values: Named) -> Flags:
        """Return whether the material is stable at every degradation rate of the specimens.

        Up to the last node it is so by construction.
        """
        count = len(values["stiffness_scatter"])
        beyond = self._beyond_nodes()
        if not beyond.size:
            return np.ones(count, dtype=bool)
        c1, c2, c3 = np.moveaxis(self.constants(values, beyond), -1, 0)
        return np.asarray(np.all((c3 > 0.0) & satisfies_baker_ericksen(c1, c2, c3), axis=-1))

    def constants(self, values: Named, degradation: Floats) -> Floats:
        """Return C1, C2, C3 [MPa] at degradation rates (S,) or (n, S), shape (n, S, 3)."""
        return constants_at(controls_of(values, self.nodes), degradation, self.nodes)

    def material(self, values: Named, degradation: Floats) -> Material:
        """Return the median material at degradation rates (S,) or (n, S)."""
        return material_at(controls_of(values, self.nodes), degradation, self.nodes)

    def elongation(self, values: Named, degradation: Floats) -> Floats:
        """Return the median elongation at break [%] at degradation rates (S,), shape (n, S)."""
        return elongation_at(values, degradation, self.elongation_nodes)

    def spread(self, values: Named, material: Material, sd: Floats) -> Floats:
        """Return τ² of specimens whose degradation rates have standard errors sd, (n, S)."""
        scatter = values["stiffness_scatter"][:, None]
        spread: Floats = scatter**2 + (material.sensitivity * sd) ** 2
        return spread

    def tensile_linearised(self, values: Named) -> Linearised:
        """Linearise the stress–stretch curves at their most probable deviations."""
        assert self.tensile is not None
        return films.linearise_films(self.tensile, values, self.stresses(values, self.tensile))

    def stresses(self, values: Named, data: TensileCurves) -> films.Stresses:
        """Return what films of the median material read in these tests."""
        material = self.material(values, data.degradation)
        return films.median_stresses(data, values, material, self.causes)

    def rupture_density(self, values: Named) -> Floats:
        """Return log probabilities of what each actuator survived or burst at, (n, S)."""
        return self._log_rupture(values, self._actuators(values)[1].prediction)

    def range_excess(self, values: Named) -> Floats:
        """Return how far outside the forward map's range each actuator is asked, (n, S).

        At the most probable deviations of the specimens, as in the density: the log likelihood
        falls with half its square; 0 inside.
        """
        assert self.actuator is not None
        return actuators.range_excess(self.actuator, self._actuators(values)[1].prediction)

    def strength(self, values: Named) -> Strength:
        """Return the elongation limit of the actuators, (n, n_specimens)."""
        believed = self._degradation(values)
        return actuators.strength_of(self.rig, values, believed, nodes=self.elongation_nodes)

    def actuator_linearised(self, values: Named) -> Linearised:
        """Linearise the actuators' readings at their most probable deviations."""
        return self._actuators(values)[0]

    def predict(self, values: Named, deviation: Floats | None = None) -> actuators.Predicted:
        """Return readings expected of the actuators, with their errors' variances.

        Parameters
        ----------
        values : mapping
            Named values, (n,).
        deviation : array, shape (n, n_specimens, 1), optional
            Deviation of each specimen's ln stiffness; by default 0.
        """
        material, spread = self._material_of_actuators(values)
        mode = np.zeros((*spread.shape, 1)) if deviation is None else deviation
        return actuators.predict(self.rig, values, material, mode)

    def curvature(self, values: Named, deviation: Floats | None = None) -> Prediction:
        """Return predictions for the actuators, (n, n_specimens, n_points)."""
        return self.predict(values, deviation).prediction

    def readings_pointwise(self, values: Named) -> Floats:
        """Return log densities of each reading given those before it on its specimen.

        Shape (n, n_specimens, n_readings); they sum to the specimens' ``log_likelihood``.
        """
        return likelihood.sequential(self.actuator_linearised(values))

    def simulate(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw readings that new specimens in the same tests would show, one set a draw.

        Returns
        -------
        array, shape (n, n_specimens, n_readings)
            Curvatures [1/m], then bend angles [°]; nan where the forward map has no answer.
        """
        assert self.actuator is not None
        predicted = self.predict(values, self.draw_deviation(values, generator))
        length = values["curvature_noise_length"]
        with_angle = self.actuator.with_angle
        correlation = values["reading_correlation"] if with_angle else np.zeros(len(length))
        z = likelihood.correlated_normals(self.actuator.paths, length, correlation, generator)
        return predicted.mean + np.sqrt(predicted.variance) * z

    def simulate_curvature(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw curvatures of new specimens [1/m], (n, n_specimens, n_points); see `simulate`."""
        assert self.actuator is not None
        return self.simulate(values, generator)[..., : self.actuator.pressure.shape[1]]

    def deviation_sd(self, values: Named) -> Floats:
        """Return τ of each actuator, shape (n, n_specimens, 1)."""
        return np.sqrt(self._material_of_actuators(values)[1])[..., None]

    def draw_deviation(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw each actuator's deviation of ln stiffness, shape (n, n_specimens, 1)."""
        sd = self.deviation_sd(values)
        return sd * generator.standard_normal(sd.shape)

    def with_readings(self, readings: Floats) -> Self:
        """Return the model for other readings in the same tests, (n_specimens, n_readings)."""
        assert self.actuator is not None
        return replace(self, actuator=self.actuator.with_readings(readings))

    @property
    def rig(self) -> Rig:
        """The actuators' tests and how they are predicted."""
        assert self.actuator is not None
        assert self.forward is not None
        return Rig(
            self.actuator,
            self.forward,
            self.causes,
            self.paper_thickness,
            self.largest_pressure,
            max(self.nodes[-1], 1.0),
        )

    def _actuators(self, values: Named) -> tuple[Linearised, actuators.Predicted]:
        return actuators.linearise_actuators(
            self.continued.rig, values, *self._material_of_actuators(values)
        )

    def _material_of_actuators(self, values: Named) -> tuple[Material, Floats]:
        believed = self._degradation(values)
        material = self.material(values, shared(believed.value))
        return material, self.spread(values, material, believed.sd)

    def _degradation(self, values: Named) -> Degradation:
        return actuators.believed_degradation(self.rig, values)

    def _log_rupture(self, values: Named, prediction: Prediction) -> Floats:
        assert self.actuator is not None
        return actuators.log_rupture(self.actuator, prediction, self.strength(values))

    def _log_published(self, values: Named, tests: PublishedTests) -> dict[str, Floats]:
        assert self.forward is not None
        return published.log_likelihood(
            tests,
            self.forward,
            values,
            self.material(values, tests.degradation),
            elongation_nodes=self.elongation_nodes,
            paper_thickness=self.paper_thickness,
        )

    def _log_breaks(self, values: Named, data: Breaks) -> Floats:
        return likelihood.log_normal(data.elongation, *self._break_law(values, data))

    def _break_law(self, values: Named, data: Breaks) -> tuple[Floats, Floats]:
        """Return median and sd of the logarithm of elongations at break, each (n, n_films)."""
        nodes = self.elongation_nodes
        spread = elongation_spread(values, data.degradation, data.degradation_sd, nodes=nodes)
        return self.elongation(values, data.degradation), np.sqrt(spread)

    def _beyond_nodes(self) -> Floats:
        data = [d for d in (self.tensile, self.actuator) if d is not None]
        levels = np.unique(np.concatenate([[0.0], *(d.degradation.ravel() for d in data)]))
        return levels[levels > self.nodes[-1]]

    def expected(self, values: Named, statistic: Statistic) -> Floats:
        """Return what a statistic is of, in its unit, (n,)."""
        return self._expected(values, (statistic,))[:, 0]

    def _expected(self, values: Named, statistics: tuple[Statistic, ...]) -> Floats:
        nodes, at = self.nodes, self.elongation_nodes
        return expected_statistics(values, statistics, nodes=nodes, elongation_nodes=at)


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
        Vectors whose density was asked for.
    refused : int
        Those that priors and stability allow, but at whose readings the forward map refuses to
        answer, being outside its training.

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
        """Refused share of the proposals [–]; 0 of none."""
        return self.refused / self.proposed if self.proposed else 0.0


def share_outside(model: Model, vectors: Floats) -> float:
    """Return the share of vectors at which the forward map has no answer for some reading [–].

    There the likelihood only leads back inside: a posterior of which much lies there is not to be
    trusted.

    Parameters
    ----------
    model : Model
        One without actuators has nothing outside.
    vectors : array, shape (n, n_parameters)
        Posterior draws.
    """
    if model.actuator is None or not len(vectors):
        return 0.0
    status = model.predict(model.table.named(vectors)).prediction.status
    outside = np.any((status != Status.CONVERGED) & model.actuator.mask, axis=(-2, -1))
    return float(np.mean(outside))


class CountedDensity:
    """A log density that counts on the way how many vectors a model's forward map refused.

    Parameters
    ----------
    density : Density
        Left as it is; what is no ``Model`` refuses nothing.
    """

    def __init__(self, density: Density) -> None:
        self.refusals = Refusals()
        self._watched = density
        self._outside: Flags | None = None
        if (
            isinstance(density, Model)
            and density.forward is not None
            and density.actuator is not None
        ):
            self._model = density
            self._watched = replace(density, forward=self._forward)

    def __call__(self, vectors: Floats) -> Floats:
        """Return the log posterior density of each vector, shape (n,)."""
        # as many at once as the model takes, which asks its forward map for each part
        parts = [vectors[k : k + AT_ONCE] for k in range(0, max(len(vectors), 1), AT_ONCE)]
        return np.concatenate([self._counted(part) for part in parts])

    def _counted(self, vectors: Floats) -> Floats:
        self._outside = None
        density = self._watched.log_prob(vectors)
        outside = np.zeros(len(vectors), dtype=bool) if self._outside is None else self._outside
        refused = self._allowed(vectors[outside]) if outside.any() else 0
        self.refusals += Refusals(len(vectors), refused)
        return density

    def _forward(self, inputs: Inputs) -> Prediction:
        """Answer as the model's forward map, and remember whose readings it refused."""
        assert self._model.forward is not None
        assert self._model.actuator is not None
        prediction = continuation(self._model.forward)(inputs)
        refused = (prediction.status == Status.OUTSIDE_TRAINING) & self._model.actuator.mask
        outside = np.any(refused, axis=(-2, -1))
        self._outside = outside if self._outside is None else self._outside | outside
        return prediction

    def _allowed(self, vectors: Floats) -> int:
        """Count the vectors that nothing but the forward map refuses."""
        table = self._model.table
        with np.errstate(all="ignore"):
            possible = np.isfinite(table.log_prior(vectors))
            stable = self._model.is_stable(table.named(vectors))
        return int(np.sum(possible & stable))


def specimens_of(model: Model, kind: str) -> tuple[str, ...]:
    """Return the specimens of one kind of log likelihood, row by row.

    Parameters
    ----------
    model : Model
        With its data.
    kind : str
        A key of ``Model.log_likelihood``.

    Returns
    -------
    tuple of str
        Empty for summary statistics, which are of no specimen of the study.
    """
    data = {"tensile": model.tensile, "breaks": model.breaks, "statistics": None}
    rows = data.get(kind, model.actuator)  # an actuator's readings, and whether it burst
    return () if rows is None else rows.specimens


def blocks_of(model: Model, kinds: Iterable[str]) -> dict[str, dict[str, NDArray[np.intp]]]:
    """Return the rows of every specimen in every kind of data that it has.

    A film that was stretched and then torn stands in two tables under one name, one that was
    stretched in two modes has two curves: it is one block.

    Parameters
    ----------
    model : Model
        With its data.
    kinds : iterable of str
        Keys of ``Model.log_likelihood``.

    Returns
    -------
    dict
        Rows by specimen and kind, specimens in the order in which they first stand.
    """
    blocks: dict[str, dict[str, list[int]]] = {}
    for kind in kinds:
        for row, specimen in enumerate(specimens_of(model, kind)):
            blocks.setdefault(specimen, {}).setdefault(kind, []).append(row)
    return {
        specimen: {kind: np.array(rows, dtype=np.intp) for kind, rows in found.items()}
        for specimen, found in blocks.items()
    }


def without(model: Model, specimens: Iterable[str]) -> Model:
    """Return the model for the data without some specimens, in whatever tables they stand.

    Priors, parameters and summary statistics stay.

    Raises
    ------
    ValueError
        If the model has no specimen of a name.
    """
    left_out = frozenset(specimens)
    tables = (model.tensile, model.actuator, model.breaks)
    known = {name for data in tables if data is not None for name in data.specimens}
    if unknown := left_out - known:
        raise ValueError(f"there is no specimen {', '.join(sorted(unknown))}")
    return replace(
        model,
        tensile=_without(model.tensile, left_out),
        actuator=_without(model.actuator, left_out),
        breaks=_without(model.breaks, left_out),
    )


def _without[T: (TensileCurves, ActuatorCurves, Breaks)](
    data: T | None, left_out: frozenset[str]
) -> T | None:
    if data is None:
        return None
    kept = [row for row, name in enumerate(data.specimens) if name not in left_out]
    return data.subset(np.array(kept, dtype=np.intp)) if kept else None


def replicate(model: Model, values: Named, generator: np.random.Generator) -> Model:
    r"""Return the model with all its data drawn anew, in the same tests of new specimens.

    Every kind of data has the law of its likelihood, but for what the likelihood linearises: the
    specimens' deviations m of ln stiffness and of the degradation rate of films are drawn and go
    through the full equations,

    .. math:: y = f(m) + \sqrt{v(m)}\, z, \qquad m_k \sim N(0, \tau_k^2)

    with z correlated along the path and between the outputs. An actuator bursts at the first
    pressure that demands more stretch than its own limit, drawn from the law of elongation at
    break; rows after that are gone.

    Parameters
    ----------
    model : Model
        Its tests: stretches, pressures, degradation rates, standard errors.
    values : mapping
        One set of named values, each of shape (1,).
    generator : Generator
        Draws everything.

    Returns
    -------
    Model
        Readings are nan where the forward map has no answer; where the model knows of elongation
        at break, an actuator bursts there instead.

    Examples
    --------
    >>> from bayesdeg.inference.data import Statistic
    >>> from bayesdeg.inference.parameters import material_parameters
    >>> modulus = Statistic("young_modulus", 0.0, 1.7, 0.1, "published", 2.0)
    >>> model = Model(material_parameters((0.0,)), nodes=(0.0,), statistics=(modulus,))
    >>> values = model.table.named(model.table.sample(np.random.default_rng(0), 1))
    >>> (6.0 * values["c1_at_0"]).round(2)  # Young's modulus [MPa]
    array([2.07])
    >>> again = replicate(model, values, np.random.default_rng(1))
    >>> round(again.statistics[0].value, 2)
    2.13
    """
    new = model
    if model.tensile is not None:
        new = replace(new, tensile=_films(model, model.tensile, values, generator))
    if model.actuator is not None:
        new = replace(new, actuator=_actuators(model, model.actuator, values, generator))
    if model.breaks is not None:
        new = replace(new, breaks=_breaks(model, model.breaks, values, generator))
    drawn = tuple(_statistic(model, s, values, generator) for s in model.statistics)
    return replace(new, statistics=drawn)


def _films(
    model: Model, data: TensileCurves, values: Named, generator: np.random.Generator
) -> TensileCurves:
    read = simulated_films(model, data, values, generator)
    return replace(data, stress=np.where(data.mask, read[0], 0.0))


def simulated_films(
    model: Model, data: TensileCurves, values: Named, generator: np.random.Generator
) -> Floats:
    """Draw stresses that new films in the same tests would read, (n, n_specimens, n_points)."""
    shape = (len(values["stiffness_scatter"]), len(data.specimens))
    scatter = np.broadcast_to(values["stiffness_scatter"][:, None], shape)
    sd = np.stack([scatter, np.broadcast_to(data.degradation_sd, shape)], axis=-1)
    deviation = sd * generator.standard_normal(sd.shape)
    stress, _ = films.film_readings(model.stresses(values, data), deviation)
    length = values["tensile_noise_length"]
    z = likelihood.correlated_normals(data.paths, length, np.zeros(len(length)), generator)
    read: Floats = stress + np.sqrt(films.stress_variance(values, stress)) * z
    return read


def _actuators(
    model: Model, data: ActuatorCurves, values: Named, generator: np.random.Generator
) -> ActuatorCurves:
    deviation = model.draw_deviation(values, generator)
    predicted = model.predict(values, deviation)
    length = values["curvature_noise_length"]
    correlation = values["reading_correlation"] if data.with_angle else np.zeros(len(length))
    z = likelihood.correlated_normals(data.paths, length, correlation, generator)
    readings = (predicted.mean + np.sqrt(predicted.variance) * z)[0]
    if not model.has_elongation:
        return data.with_readings(readings)
    burst = _bursts(model, data, values, predicted.prediction, generator)
    return _cut(data, burst).with_readings(readings)


def _bursts(
    model: Model,
    data: ActuatorCurves,
    values: Named,
    prediction: Prediction,
    generator: np.random.Generator,
) -> NDArray[np.bool_]:
    """Return the recorded rows at which actuators burst, (n_specimens, n_points).

    The emulator's error of ln strain is one of the specimen, so that the stretch it demands grows
    with pressure; for each pressure it has the law of the likelihood.
    """
    strength = model.strength(values)
    z = generator.standard_normal(strength.median.shape)
    limit = np.log(strength.median) + strength.scatter * z
    strain = prediction.peak_stretch - 1.0
    share = prediction.peak_stretch_sd / np.maximum(strain, 1e-12)
    error = share * generator.standard_normal((*z.shape, 1))
    known = np.isfinite(strain) & (strain > 0.0)
    demanded = np.where(known, np.log(np.where(known, strain, 1.0)) + error, np.inf)
    over = data.recorded & (data.pressure > 0.0) & (demanded > limit[..., None])[0]
    first: NDArray[np.bool_] = over & (np.cumsum(over, axis=1) == 1)
    return first


def _cut(data: ActuatorCurves, burst: NDArray[np.bool_]) -> ActuatorCurves:
    """Return tests that end where the specimens burst, without a reading there."""
    before = np.cumsum(burst, axis=1) == 0
    return replace(
        data,
        mask=data.mask & before,
        angle_mask=data.angle_mask & before,
        recorded=data.recorded & (before | burst),
        ruptured=burst,
    )


def _breaks(model: Model, data: Breaks, values: Named, generator: np.random.Generator) -> Breaks:
    nodes = model.elongation_nodes
    spread = elongation_spread(values, data.degradation, data.degradation_sd, nodes=nodes)
    median = model.elongation(values, data.degradation)
    drawn = median * np.exp(np.sqrt(spread) * generator.standard_normal(spread.shape))
    return replace(data, elongation=drawn[0])


def _statistic(
    model: Model, statistic: Statistic, values: Named, generator: np.random.Generator
) -> Statistic:
    z = (
        generator.standard_normal()
        if np.isinf(statistic.dof)
        else generator.standard_t(statistic.dof)
    )
    mean = float(model.expected(values, statistic)[0])
    return replace(statistic, value=mean + statistic.se * z)


SMALLEST = (1e-3, -np.inf, 1e-6)  # of the control values of C1, C2, C3 [MPa]
NOISE = 0.03  # of stress, relative, by which readings are weighted
JITTER = 0.03  # of vectors about the fit, on the unconstrained scale
INSIDE = 0.02  # probability that a start stays away from the bounds of its prior


def least_squares(model: Model) -> Floats:
    """Return a vector near the mode, from films by least squares, else from prior medians.

    Stress is linear in the control values of the constants, and ln elongation in its values at the
    nodes, so both have one solution: starts drawn from a prior may lead to another, lower mode.

    Returns
    -------
    array, shape (n_parameters,)
        On the unconstrained scale; its density may still be 0.
    """
    values = {p.name: float(p.law.quantile(0.5)) for p in model.table.parameters}
    values |= _fitted(model)
    within = {
        p.name: float(np.clip(values[p.name], *p.law.quantile([INSIDE, 1.0 - INSIDE])))
        for p in model.table.parameters
    }
    return np.asarray(model.table.vectors({name: np.array(v) for name, v in within.items()}))


def near_films(model: Model, generator: np.random.Generator, *, count: int = 400) -> Floats | None:
    """Return the most probable of vectors about the films' least-squares fit; None if none is.

    What the films say nothing of is drawn from its prior: where the medians of all that demand more
    of the actuators than the forward map answers, others may not.

    Parameters
    ----------
    model : Model
        Whose mode is sought.
    generator : Generator
        Draws the vectors.
    count : int
        Number of them.
    """
    fit, known = least_squares(model), _fitted(model)
    draws = model.table.sample(generator, count)
    columns = [i for i, name in enumerate(model.table.names) if name in known]
    jitter = JITTER * generator.standard_normal((count, len(columns)))
    draws[:, columns] = fit[columns] + jitter
    trials = np.vstack([fit, draws])
    density = model.log_prob(trials)
    best = int(np.argmax(density))
    return trials[best] if np.isfinite(density[best]) else None


def _fitted(model: Model) -> dict[str, float]:
    """Return what films alone say."""
    found: dict[str, float] = {}
    if model.tensile is not None:
        found |= _constants(model.tensile, model.nodes)
    if model.breaks is not None:
        found |= _elongation(model.breaks, model.elongation_nodes)
    return found


def _constants(data: TensileCurves, nodes: Nodes) -> dict[str, float]:
    weights = bernstein_weights(data.degradation, nodes)
    columns = (data.basis[..., None] * weights[:, None, None, :])[data.mask]
    stress = data.stress[data.mask]
    scale = 1.0 / (NOISE * (np.abs(stress) + 0.05 * float(np.abs(stress).max())))
    design = columns.reshape(len(stress), -1) * scale[:, None]
    lower = np.repeat(SMALLEST, len(nodes))
    c1, c2, c3 = lsq_linear(design, stress * scale, (lower, np.inf)).x.reshape(3, -1)
    found = {"c1": c1, "c2_ratio": c2 / np.sqrt(3.0 * c1 * c3), "c3": c3}
    return {
        control_name(name, nodes, k): float(controls[k])
        for name, controls in found.items()
        for k in range(len(nodes))
    }


def _elongation(data: Breaks, nodes: Nodes) -> dict[str, float]:
    weights = lagrange_weights(data.degradation, nodes)
    at_nodes = np.linalg.lstsq(weights, np.log(data.elongation), rcond=None)[0]
    return {
        node_name("elongation", node): float(np.exp(value))
        for node, value in zip(nodes, at_nodes, strict=True)
    }
