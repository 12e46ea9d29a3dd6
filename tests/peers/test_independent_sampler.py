"""numpyro's No-U-Turn sampler on a model with all kinds of data: the same marginals."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arviz_stats.base import array_stats

from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.model import replicate
from bayesdeg.inference.sampling import EFFORTS, sample
from bayesdeg.observations.curvature import BEND_ANGLE, actuator_parameters
from bayesdeg.observations.specimens import (
    STIFFNESS_SCATTER,
    elongation_parameters,
    material_parameters,
)
from bayesdeg.observations.tensile import TENSILE
from tests.inference.small_study import ELONGATION_NODES, TRUTH, small_model, values_of
from tests.peers import numpyro_process

pytestmark = [pytest.mark.peer, pytest.mark.slow, pytest.mark.long]

NODES = (0.0, 25.0)


@cache
def model():
    """Films, actuators with bend angles, ruptures, breaks, statistics: 21 parameters."""
    base = (
        *material_parameters(NODES),
        STIFFNESS_SCATTER,
        *TENSILE,
        *actuator_parameters(140.0),
        *BEND_ANGLE,
        *elongation_parameters(ELONGATION_NODES),
    )
    empty = replace(small_model(), base=base).with_world(nodes=NODES)
    truth = {name: TRUTH[name] for name in empty.table.names}
    return replicate(empty, values_of(truth), np.random.default_rng(4))


@cache
def ours():
    generator = np.random.default_rng(0)
    start = evidence(model(), approximate(model(), generator), generator)
    return sample(model(), start, effort=EFFORTS["standard"], seed=np.random.SeedSequence(1))


@cache
def theirs():
    """Our draws lend a point and a mass matrix, which change the pace and not the law."""
    draws = ours().vectors.reshape(-1, len(model().table))
    return numpyro_process.nuts(
        model(), draws[-1], np.cov(draws, rowvar=False), warmup=200, draws=1000, seed=1
    )


def compared(function):
    """Distance of the means of a function of the vectors, in combined Monte Carlo errors."""
    chains = np.swapaxes(ours().vectors, 1, 2)  # walker by walker
    chains = function(chains.reshape(-1, *chains.shape[2:]))
    other = function(theirs()["vectors"])[None]
    scores = []
    for i in range(chains.shape[-1]):
        variances = [
            np.var(draws[..., i]) / array_stats.ess(draws[..., i], method="mean")
            for draws in (chains, other)
        ]
        scores.append((chains[..., i].mean() - other[..., i].mean()) / np.sqrt(sum(variances)))
    return dict(zip(model().table.names, scores, strict=True))


def test_the_other_sampler_went_well():
    assert theirs()["divergent"] < 0.05 * len(theirs()["vectors"])
    effective = [array_stats.ess(x[None], method="bulk") for x in theirs()["vectors"].T]
    assert min(effective) > 100.0


def test_means_agree_within_monte_carlo_error():
    for name, score in compared(lambda x: x).items():
        assert abs(score) < 4.0, name


def test_variances_agree_within_monte_carlo_error():
    centre = ours().vectors.reshape(-1, len(model().table)).mean(axis=0)
    for name, score in compared(lambda x: (x - centre) ** 2).items():
        assert abs(score) < 4.0, name


@pytest.mark.parametrize("probability", [0.05, 0.95])
def test_bounds_of_intervals_agree_within_monte_carlo_error(probability):
    bound = np.quantile(ours().vectors.reshape(-1, len(model().table)), probability, axis=0)
    for name, score in compared(lambda x: (x < bound).astype(float)).items():
        assert abs(score) < 4.0, name
