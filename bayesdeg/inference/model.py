"""Data, forward map and active causes as one log density over a batch of vectors."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import PAPER_THICKNESS, ForwardMap, Prediction, continuation
from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import Cause, Degradation, Strength
from bayesdeg.inference import actuators, films, likelihood, published
from bayesdeg.inference.actuators import Rig
from bayesdeg.inference.curves import ActuatorCurves, Breaks, TensileCurves
from bayesdeg.inference.data import Statistic
from bayesdeg.inference.density import Factors
from bayesdeg.inference.likelihood import Linearised
from bayesdeg.inference.parameters import Named, ParameterTable, with_causes
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
from bayesdeg.material.degradation import satisfies_baker_ericksen
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
