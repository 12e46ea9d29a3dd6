"""A calibrated actuator whose linearised model is known from closed forms, not from a fit."""

from dataclasses import replace
from functools import cache

import numpy as np

from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.fit.linear import Linear, Whitening
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.priors import LogNormal, Normal, Parameter, with_priors
from tests.inference.small_study import TRUTH, altered, small_model, values_of


def constant_chain(model, vector, count=40):
    """A posterior without any width."""
    vectors = np.broadcast_to(vector, (1, count, 2, len(vector))).copy()
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.array([0.4]))


SCATTERS = (
    *("tensile_noise", "tensile_noise_floor", "tensile_noise_length"),
    *("curvature_noise", "curvature_noise_floor", "curvature_noise_length"),
    *("bend_angle_noise", "bend_angle_noise_floor", "stiffness_scatter", "elongation_scatter"),
)


def with_known_scatter(model):
    """The model with noise and scatter known.

    Few readings leave them laws so far from normal ones that importance sampling has few draws.
    """
    pinned = {name: LogNormal(TRUTH[name], 0.01) for name in SCATTERS}
    pinned["reading_correlation"] = Normal(TRUTH["reading_correlation"], 0.004)
    return altered(model, base=with_priors(model.base, pinned))


@cache
def tight_model(*, with_angle=False):
    """Two specimens at each of three levels, all on the same pressures."""
    model = small_model()
    shape = (6, 8)
    data = replace(
        model.data_of(Curvature).tests,
        specimens=tuple("abcdef"),
        degradation=np.repeat([0.0, 10.0, 24.0], 2)[:, None],
        degradation_sd=np.zeros((6, 1)),
        pressure=np.tile(np.linspace(20.0, 160.0, 8), (6, 1)),
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        angle_sd=np.zeros(shape),
        mask=np.ones(shape, bool),
        bend_angle=np.zeros(shape),
        angle_mask=np.full(shape, with_angle),
        recorded=np.ones(shape, bool),
        ruptured=np.zeros(shape, bool),
        cycle=np.ones(shape, np.int64),
        branch=np.full(shape, "loading"),
        time=np.full(shape, np.nan),
        humidity=np.full(shape, np.nan),
        mount=np.full(shape, "horizontal"),
    )
    return altered(model, actuator=data)


def noise_correlation_by_hand(model, values):
    """Correlation of the reading errors of one specimen.

    From the law of Ornstein and Uhlenbeck, but for a fifth of the variance that is each picture's.
    """
    pressure = model.data_of(Curvature).tests.pressure[0]
    decay = np.exp(-np.abs(pressure[:, None] - pressure) / values["curvature_noise_length"][0])
    decay = 0.8 * decay + 0.2 * np.eye(len(pressure))
    if not model.data_of(Curvature).tests.with_angle:
        return decay
    c = values["reading_correlation"][0]
    return np.block([[decay, c * decay], [c * decay, decay]])


@cache
def known_linear(*, with_angle=False):
    """The linear model of known parameters: mean and covariance from one prediction."""
    model = altered(tight_model(with_angle=with_angle), tensile=None)
    mode = model.table.vectors(values_of())[0]
    values = model.table.named(mode[None])
    prediction = model.data_of(Curvature).predicted(model.tests(values)).mean[0]
    model = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(prediction), model.base)
    )  # the deviations that explain it best are zero
    predicted = model.data_of(Curvature).predicted(model.tests(values))
    spread = model.data_of(Curvature).deviation_sd(model.tests(values))[0, :, 0] ** 2
    correlation = noise_correlation_by_hand(model, values)
    size = prediction.shape[1]
    covariance = np.zeros((prediction.size, prediction.size))
    for i in range(len(prediction)):
        own = slice(i * size, (i + 1) * size)
        sd, slope = np.sqrt(predicted.variance[0, i]), predicted.slope[0, i]
        covariance[own, own] = correlation * np.outer(sd, sd) + spread[i] * np.outer(slope, slope)
    flat = prediction.ravel()
    jacobian = np.zeros((len(flat), len(mode)))  # nothing is uncertain
    whitening = Whitening.of(covariance, jacobian)
    return Linear(model, mode, flat, flat, 0.0 * mode, jacobian, covariance, whitening)


def with_readings(linear, readings):
    """The same model with other data, (n,)."""
    model = linear.subject
    shaped = np.reshape(readings, model.data_of(Curvature).tests.readings.shape)
    return replace(
        linear,
        subject=model.with_observations(
            *data_of_actuators(model.data_of(Curvature).tests.with_readings(shaped), model.base)
        ),
    )


def scaling_cause(name="scale", sd=0.1, on_reading=None):
    """A cause made for a test: every curvature by the same factor."""

    def scale(prediction, conditions, effect):
        factor = 1.0 + effect["size"]
        return replace(
            prediction,
            curvature=factor * prediction.curvature,
            slope=factor * prediction.slope,
            sd=factor * prediction.sd,
        )

    return Cause(
        name=name,
        stage=Stage.READING,
        parameters=(Parameter("size", Normal(0.0, sd), "–", "relative excess", 0.0),),
        mechanism="made for a test",
        typical={"size": sd},
        revealed_by="a test",
        on_reading=on_reading or scale,
    )


def drawn(linear, generator, count=None):
    """Readings that the linear model itself makes."""
    size = len(linear.mean) if count is None else (count, len(linear.mean))
    return linear.mean + generator.standard_normal(size) @ linear.factor.T
