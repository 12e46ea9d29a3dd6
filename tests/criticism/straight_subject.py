"""A model that is linear in its parameters, with normal laws: everything about it in closed form.

y = B β + Σ D φ + a_s c + e with β, φ, a_s and e normal: given any set of causes the readings are
jointly normal, so that evidences, posteriors and predictions are those of normal laws.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import multivariate_normal

from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.fit.linear import linearise
from bayesdeg.criticism.fit.trials import base_trial
from bayesdeg.criticism.holdout.held_out import in_folds, one_by_one, run_folds
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.readings import Formula, FormulaReadings, places_of
from bayesdeg.priors import Normal, Parameter

SPECIMENS, POINTS = 6, 8
X = np.tile(np.linspace(0.1, 1.0, POINTS), SPECIMENS)
LEVEL = np.repeat([0.0, 0.0, 10.0, 10.0, 20.0, 20.0], POINTS)
SPECIMEN = np.repeat(np.array(list("abcdef")), POINTS)
LOADED = np.tile(np.arange(POINTS) % 2 == 0, SPECIMENS)
ERROR, COMMON = 0.05, 0.03
BASE = {"slope": (1.0, 0.5, X), "bend": (0.0, 0.3, X**2)}
SHAPES = {
    "offset": np.ones(len(X)),
    "twin": np.ones(len(X)) + 0.02 * np.sin(40.0 * X),
    "wave": np.sin(2.0 * np.pi * X),
    "ageing": X * LEVEL / 20.0,
    "lag": np.where(LOADED, -0.5, 0.5),
}


def straight(values, conditions):
    return sum(values[name] * shape for name, (_, _, shape) in BASE.items())


def error(values, readings):
    """The reading error, widened by a cause whose only parameter is ``extra``."""
    return np.hypot(ERROR, values.get("noise.extra", 0.0))


def common(values, readings):
    return COMMON * X


def added(readings, conditions, effect, *, shapes):
    return readings + sum(effect[name] * shape for name, shape in shapes.items())


def untouched(readings, conditions, effect):
    return readings


def cause_of(name, laws, hook, **typical):
    """A cause made for a test; its parameters are neutral at 0."""
    return Cause(
        name=name,
        stage=Stage.READING,
        parameters=tuple(Parameter(p, law, "–", "of a test", 0.0) for p, law in laws.items()),
        mechanism="made for a test",
        typical=typical or dict.fromkeys(laws, 0.2),
        revealed_by="a test",
        on_reading=hook,
    )


def linear_cause(name, shape=None, *, law=None, **typical):
    """An effect of one size."""
    shapes = {"size": SHAPES[name] if shape is None else shape}
    return cause_of(
        name, {"size": law or Normal(0.0, 0.3)}, partial(added, shapes=shapes), **typical
    )


CAUSES = tuple(linear_cause(name) for name in ("offset", "wave", "ageing", "lag"))
NOISE = cause_of("noise", {"extra": Normal(0.0, 0.1)}, untouched)


def subject_of(observed):
    parameters = tuple(
        Parameter(name, Normal(mean, sd), "–", "of a test") for name, (mean, sd, _) in BASE.items()
    )
    places = places_of(X, level=LEVEL, specimen=SPECIMEN)
    readings = FormulaReadings(observed, places, error=error, common=common)
    return JointModel(parameters, (readings,), Formula(straight))


def reading(subject, **changes):
    """The model with something else of its readings."""
    [read] = subject.observations
    return subject.with_observations(replace(read, **changes))


def readings(seed=0, *, slope=1.1, bend=-0.1, **planted):
    """Readings of a straight model with effects of these sizes hidden in them."""
    generator = np.random.default_rng(seed)
    mean = slope * X + bend * X**2
    mean = mean + sum(size * SHAPES[name] for name, size in planted.items())
    deviation = np.repeat(generator.standard_normal(SPECIMENS), POINTS)
    return mean + COMMON * X * deviation + ERROR * generator.standard_normal(len(X))


@dataclass(frozen=True)
class Joint:
    """The normal law of a model's parameters and readings."""

    mean: np.ndarray
    sd: np.ndarray
    shapes: np.ndarray
    scatter: np.ndarray

    @property
    def covariance(self):
        return self.scatter + (self.shapes * self.sd**2) @ self.shapes.T

    def log_evidence(self, observed):
        return multivariate_normal(self.shapes @ self.mean, self.covariance).logpdf(observed)

    def posterior(self, observed):
        """Mean and covariance of the parameters."""
        precision = np.diag(self.sd**-2.0) + self.shapes.T @ np.linalg.solve(
            self.scatter, self.shapes
        )
        covariance = np.linalg.inv(precision)
        right = self.mean / self.sd**2 + self.shapes.T @ np.linalg.solve(self.scatter, observed)
        return covariance @ right, covariance


def joint_of(*causes, rows=slice(None), extra=0.0):
    """The law of some readings where causes that are linear in their normal sizes act."""
    columns = list(BASE.values())
    for cause in causes:
        shapes = cause.on_reading.keywords["shapes"]
        columns += [(p.law.mean, p.law.sd, shapes[p.name]) for p in cause.parameters]
    mean, sd, shapes = (np.array(part) for part in zip(*columns, strict=True))
    same = SPECIMEN[:, None] == SPECIMEN
    scatter = (ERROR**2 + extra**2) * np.eye(len(X)) + COMMON**2 * np.outer(X, X) * same
    return Joint(mean, sd, shapes.T[rows], scatter[rows][:, rows])


def log_factor(observed, *causes, beside=()):
    """The exact log Bayes factor of causes against the model without them."""
    without = joint_of(*beside).log_evidence(observed)
    return joint_of(*beside, *causes).log_evidence(observed) - without


def exact_linear(observed, *causes):
    """The model linearised at its exact mode, with the prior's exact covariance."""
    subject, law = subject_of(observed).extended(*causes), joint_of(*causes)
    mode = law.posterior(observed)[0]
    return linearise(subject, mode, uncertain=np.diag(law.sd**2))


def fitted(subject, seed=0):
    """The subject as the base of a search."""
    generator = np.random.default_rng(seed)
    laplace = approximate(subject, generator)
    return base_trial(subject, laplace.mode, about_mode(subject, laplace, generator))


def conditional(law, observed, own):
    """Log density of some readings given all others of the law's."""
    others = ~own
    mean, covariance = law.shapes @ law.mean, law.covariance
    gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[np.ix_(others, own)]).T
    centre = mean[own] + gain @ (observed - mean)[others]
    left = covariance[np.ix_(own, own)] - gain @ covariance[np.ix_(others, own)]
    return multivariate_normal(centre, left).logpdf(observed[own])


def predict_one_by_one(trial, *, seed, executor=None):
    """Each group predicted from all others."""
    [found] = run_folds([one_by_one(trial, seed)], executor)
    return found


def predict_folds(trial, fold, *, seed, executor=None):
    """Each fold of groups predicted from all others."""
    [found] = run_folds([in_folds(trial, fold, seed)], executor)
    return found


def unit(shape):
    """A shape as large as one standard deviation of the readings after a refit."""
    linear = exact_linear(readings(0))
    return shape / np.linalg.norm(linear.whiten_columns(shape))
