"""Data, forward map and active causes as one log density over a batch of vectors."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import PAPER_THICKNESS, ForwardMap, Inputs, Prediction
from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import Cause, Conditions, Degradation
from bayesdeg.inference import likelihood
from bayesdeg.inference.data import (
    ActuatorCurves,
    Breaks,
    Statistic,
    TensileCurves,
)
from bayesdeg.inference.likelihood import Linearised
from bayesdeg.inference.parameters import Named, ParameterTable, node_name, with_causes
from bayesdeg.laws import Parameter
from bayesdeg.material import degradation as law

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Model:
    """A posterior density up to a constant.

    Parameters
    ----------
    base : tuple of Parameter
        Parameters without those of the causes.
    nodes, elongation_nodes : tuple of float
        Degradation rates at which constants and elongation are held [%].
    forward : ForwardMap, optional
        Needed if there are actuator curves.
    tensile, actuator, breaks, statistics
        The data; any may be missing.
    causes : tuple of Cause
        Active causes.
    paper_thickness : float
        Of the actuators [mm].

    Notes
    -----
    The deviation of a specimen's ln stiffness has variance
    τ² = σ² + (d ln C1/dD_R · sd(D_R))²: scatter of the material, and the error of its degradation
    rate, which acts through C1 (the elasticities to C2 and C3 are below 0.02).
    """

    base: tuple[Parameter, ...]
    nodes: law.Nodes
    elongation_nodes: law.Nodes = (0.0,)
    forward: ForwardMap | None = None
    tensile: TensileCurves | None = None
    actuator: ActuatorCurves | None = None
    breaks: Breaks | None = None
    statistics: tuple[Statistic, ...] = ()
    causes: tuple[Cause, ...] = ()
    paper_thickness: float = PAPER_THICKNESS

    @property
    def table(self) -> ParameterTable:
        """All parameters, those of the causes last."""
        return with_causes(self.base, self.causes)

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        return replace(self, causes=in_order((*self.causes, *causes)))

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of each vector, shape (n,); −inf where impossible."""
        table = self.table
        with np.errstate(all="ignore"):
            total = table.log_prior(vectors, truncate=truncate)
            values = table.named(vectors)
            for block in self.log_likelihood(values).values():
                total = total + np.sum(block, axis=-1)
            total = np.where(self.is_stable(values), total, -np.inf)
        return np.where(np.isfinite(total), total, -np.inf)

    def log_likelihood(self, values: Named) -> dict[str, Floats]:
        """Return log densities of whole specimens by kind of data, each (n, n_specimens)."""
        blocks = {}
        if self.tensile is not None:
            blocks["tensile"] = likelihood.marginal_of(self.tensile_linearised(values))
        if self.actuator is not None:
            blocks["actuator"] = likelihood.marginal_of(self.actuator_linearised(values))
        if self.breaks is not None:
            blocks["breaks"] = likelihood.log_normal(
                self.breaks.elongation,
                self.elongation(values, self.breaks.degradation),
                values["elongation_scatter"][:, None],
            )
        if self.statistics:
            blocks["statistics"] = np.stack(
                [
                    likelihood.student(s.value, self._mean(values, s), s.se, s.dof)
                    for s in self.statistics
                ],
                axis=-1,
            )
        return blocks

    def is_stable(self, values: Named) -> NDArray[np.bool_]:
        """Return whether the material is stable from no degradation to the last node."""
        return law.is_stable(
            *self.node_values(values),
            largest_degradation=max(self.nodes),
            nodes=self.nodes,
            points=11,
        )

    def node_values(self, values: Named) -> tuple[Floats, Floats, Floats]:
        """Return C1, the ratio of C2 and C3 at the nodes, each (n, n_nodes)."""
        c1, ratio, c3 = (
            np.stack([values[node_name(name, node)] for node in self.nodes], axis=-1)
            for name in ("c1", "c2_ratio", "c3")
        )
        return c1, ratio, c3

    def constants(self, values: Named, degradation: Floats) -> tuple[Floats, Floats, Floats]:
        """Return C1, C2, C3 [MPa] at degradation rates (s,) or (n, s)."""
        return law.yeoh_constants(*self.node_values(values), degradation, self.nodes)

    def elongation(self, values: Named, degradation: Floats) -> Floats:
        """Return the median elongation at break [%] at degradation rates (s,), shape (n, s)."""
        nodes = np.stack(
            [values[node_name("elongation", node)] for node in self.elongation_nodes], axis=-1
        )
        elongation: Floats = np.exp(
            law.polynomial(np.log(nodes), degradation, self.elongation_nodes)
        )
        return elongation

    def spread(self, values: Named, degradation: Floats, sd: Floats) -> Floats:
        """Return τ² of specimens at degradation rates (s,) or (n, s), shape (n, s)."""
        c1, _, _ = self.node_values(values)
        sensitivity = law.derivative(c1, degradation, self.nodes) / law.polynomial(
            c1, degradation, self.nodes
        )
        spread: Floats = values["stiffness_scatter"][:, None] ** 2 + (sensitivity * sd) ** 2
        return spread

    def tensile_linearised(self, values: Named) -> Linearised:
        """Linearise the stress–stretch curves at their most probable deviations."""
        assert self.tensile is not None
        data = self.tensile
        constants = np.stack(self.constants(values, data.degradation), axis=-1)
        stress = np.matmul(data.basis, constants[..., None])[..., 0]
        noise, floor = (
            values[name][:, None, None] for name in ("tensile_noise", "tensile_noise_floor")
        )
        spread = self.spread(values, data.degradation, data.degradation_sd)[..., None]
        mode = np.zeros_like(spread)
        for _ in range(3):
            slope = stress * np.exp(mode)
            residual = data.stress - slope * (1.0 - mode)
            variance = floor**2 + (noise * slope) ** 2
            at_mode = Linearised(residual, slope, variance, spread, data.mask, mode)
            mode = likelihood.deviation(
                residual, slope, variance=variance, spread=spread, mask=data.mask
            )
        return at_mode

    def actuator_linearised(self, values: Named) -> Linearised:
        """Linearise the curvature curves at their most probable deviations."""
        assert self.actuator is not None
        data = self.actuator
        degradation, spread = self._degradation(values)
        mode = np.zeros_like(spread)
        for _ in range(2):
            prediction = self._predict(values, degradation.value, mode)
            slope = -prediction.slope
            residual = data.curvature - prediction.curvature + slope * mode
            variance = self._variance(values, prediction)
            at_mode = Linearised(residual, slope, variance, spread, data.mask, mode)
            mode = likelihood.deviation(
                residual, slope, variance=variance, spread=spread, mask=data.mask
            )
        return at_mode

    def curvature(self, values: Named, deviation: Floats | None = None) -> Prediction:
        """Return predictions for the actuators, (n, n_specimens, n_points).

        Parameters
        ----------
        values : mapping
            Named values, (n,).
        deviation : array, shape (n, n_specimens, 1), optional
            Deviation of each specimen's ln stiffness; by default 0.
        """
        degradation, spread = self._degradation(values)
        mode = np.zeros_like(spread) if deviation is None else deviation
        return self._predict(values, degradation.value, mode)

    def curvature_pointwise(self, values: Named) -> Floats:
        """Return log densities of each reading given those before it on its specimen.

        Shape (n, n_specimens, n_points); they sum to the specimens' ``log_likelihood``.
        """
        return likelihood.sequential_of(self.actuator_linearised(values))

    def simulate(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw curvatures that new specimens in the same tests would show, one set a draw.

        Returns
        -------
        array, shape (n, n_specimens, n_points)
            [1/m]; nan where the forward map has no answer.
        """
        prediction = self.curvature(values, self.draw_deviation(values, generator))
        sd = np.sqrt(self._variance(values, prediction))
        return prediction.curvature + sd * generator.standard_normal(sd.shape)

    def deviation_sd(self, values: Named) -> Floats:
        """Return τ of each actuator, shape (n, n_specimens, 1)."""
        return np.sqrt(self._degradation(values)[1])

    def draw_deviation(self, values: Named, generator: np.random.Generator) -> Floats:
        """Draw each actuator's deviation of ln stiffness, shape (n, n_specimens, 1)."""
        sd = self.deviation_sd(values)
        return sd * generator.standard_normal(sd.shape)

    def with_curvature(self, curvature: Floats) -> Self:
        """Return the model for other readings in the same tests, (n_specimens, n_points)."""
        assert self.actuator is not None
        known = np.where(self.actuator.mask, curvature, 0.0)
        return replace(self, actuator=replace(self.actuator, curvature=known))

    def _degradation(self, values: Named) -> tuple[Degradation, Floats]:
        assert self.actuator is not None
        data = self.actuator
        state = Degradation(data.degradation, data.degradation_sd)
        for cause in self.causes:
            if cause.on_degradation is not None:
                effect = cause.effect(values)
                state = cause.on_degradation(state, self._conditions(), effect)
        count = len(values["stiffness_scatter"])
        shape = (count, len(data.specimens))
        level, sd = (np.broadcast_to(v[..., 0], shape) for v in (state.value, state.sd))
        return Degradation(level, sd), self.spread(values, level, sd)[..., None]

    def _predict(self, values: Named, degradation: Floats, deviation: Floats) -> Prediction:
        assert self.actuator is not None
        assert self.forward is not None
        factor = np.exp(deviation)
        c1, c2, c3 = (c[..., None] * factor for c in self.constants(values, degradation))
        inputs = Inputs(
            pressure=self.actuator.pressure,
            c1=c1,
            c2=c2,
            c3=c3,
            linear_scale=np.cbrt(values["volume_ratio"])[:, None, None],
            paper_stiffness=values["paper_stiffness"][:, None, None],
            paper_thickness=np.full((1, 1, 1), self.paper_thickness),
        )
        for cause in self.causes:
            if cause.on_inputs is not None:
                inputs = cause.on_inputs(inputs, self._conditions(), cause.effect(values))
        prediction = self.forward(inputs)
        for cause in self.causes:
            if cause.on_reading is not None:
                effect = cause.effect(values)
                prediction = cause.on_reading(prediction, self._conditions(), effect)
        return prediction

    def _variance(self, values: Named, prediction: Prediction) -> Floats:
        assert self.actuator is not None
        noise = values["curvature_noise"][:, None, None] * prediction.curvature
        floor = values["curvature_noise_floor"][:, None, None]
        variance: Floats = floor**2 + noise**2 + prediction.sd**2 + self.actuator.curvature_sd**2
        return variance

    def _conditions(self) -> Conditions:
        assert self.actuator is not None
        return Conditions(self.actuator.pressure, self.actuator.degradation)

    def _mean(self, values: Named, statistic: Statistic) -> Floats:
        if statistic.quantity == "volume_ratio":
            return values["volume_ratio"]
        level = np.array([statistic.degradation])
        if statistic.quantity == "young_modulus":
            return law.young_modulus(self.constants(values, level)[0][..., 0])
        return self.elongation(values, level)[..., 0]
