"""A calibrated actuator whose linearised model is known from closed forms, not from a fit."""

from dataclasses import replace
from functools import cache

import numpy as np

from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.linear import Linear
from bayesdeg.inference.ensemble import Chain
from bayesdeg.laws import Normal, Parameter
from tests.inference.small_study import small_model, values_of


def constant_chain(model, vector, count=40):
    """A posterior without any width."""
    vectors = np.broadcast_to(vector, (1, count, 2, len(vector))).copy()
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.array([0.4]))


@cache
def tight_model():
    """Two specimens at each of three levels, all on the same pressures."""
    model = small_model()
    shape = (6, 8)
    data = replace(
        model.actuator,
        specimens=tuple("abcdef"),
        degradation=np.repeat([0.0, 10.0, 24.0], 2)[:, None],
        degradation_sd=np.zeros((6, 1)),
        pressure=np.tile(np.linspace(20.0, 160.0, 8), (6, 1)),
        curvature=np.zeros(shape),
        curvature_sd=np.zeros(shape),
        mask=np.ones(shape, bool),
        cycle=np.ones(shape, np.int64),
        branch=np.full(shape, "loading"),
    )
    return replace(model, actuator=data)


@cache
def known_linear():
    """The linear model of known parameters: mean and covariance from one prediction."""
    model = tight_model()
    mode = model.table.vectors(values_of())[0]
    prediction = model.curvature(model.table.named(mode[None])).curvature[0]
    model = model.with_curvature(prediction)  # the deviations that explain it best are zero
    curves = model.actuator_linearised(model.table.named(mode[None]))
    points = prediction.size
    covariance = np.diag(curves.variance[0].ravel())
    for i in range(len(prediction)):
        own = np.zeros(prediction.shape)
        own[i] = np.sqrt(curves.spread[0, i]) * curves.slope[0, i]
        covariance += np.outer(own.ravel(), own.ravel())
    assert covariance.shape == (points, points)
    return Linear(
        model, mode, prediction.ravel(), prediction.ravel(), np.linalg.cholesky(covariance)
    )


def with_readings(linear, readings):
    """The same model with other data."""
    return replace(linear, model=linear.model.with_curvature(readings))


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
