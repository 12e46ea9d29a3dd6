"""Data drawn anew from the law that the likelihood stands for: what calibration is tested with."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Prediction
from bayesdeg.inference import films, likelihood
from bayesdeg.inference.curves import ActuatorCurves, Breaks, TensileCurves
from bayesdeg.inference.data import Statistic
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.specimens import elongation_spread

Floats = NDArray[np.float64]


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
