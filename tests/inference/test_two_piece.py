"""The proposal about a mode: a density that integrates to one, draws that follow it, and bounds."""

import numpy as np
import pytest
from scipy import stats

from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.laplace import DEGREES_OF_FREEDOM, LOOKS, TwoPiece, about
from bayesdeg.priors import Normal, Parameter, TruncatedNormal


def proposal(below=(0.5, 2.0), above=(1.5, 1.0), *, low=(), high=()):
    factor = np.array([[1.0, 0.0], [0.6, 0.8]])
    order = np.array([1, 0])
    return TwoPiece(
        np.array([0.3, -0.2]), factor, order, np.array(below), np.array(above),
        np.array(low, dtype=float), np.array(high, dtype=float),
    )  # fmt: skip


@pytest.mark.parametrize("bound", [((), ()), ((-0.5,), (np.inf,)), ((-0.1,), (0.9,))])
def test_the_density_integrates_to_one(bound):
    """The mean of p/q over its draws is the mass of any p within the bounds."""
    law = proposal(low=bound[0], high=bound[1])
    points, log_q = law.draw(np.random.default_rng(0), 200_000)
    wide = stats.multivariate_normal([0.3, -0.2], 0.5 * np.eye(2))
    inside = wide.pdf(points)
    mass = np.mean(inside / np.exp(log_q))
    more = wide.rvs(200_000, random_state=1)
    kept = np.ones(len(more), bool)
    if bound[0]:
        kept = (more[:, 1] >= bound[0][0]) & (more[:, 1] <= bound[1][0])
        assert np.all((points[:, 1] >= bound[0][0]) & (points[:, 1] <= bound[1][0]))
    assert mass == pytest.approx(kept.mean(), abs=0.02)


def test_each_side_of_an_axis_is_a_student_law():
    law = proposal()
    points, _ = law.draw(np.random.default_rng(1), 20_000)
    first = points[:, 1] + 0.2  # along the first axis, whose parameter is the second
    student = stats.t(DEGREES_OF_FREEDOM)
    above, below = first[first > 0.0] / 1.5, -first[first < 0.0] / 0.5
    assert len(above) / len(first) == pytest.approx(1.5 / 2.0, abs=0.015)
    for side in (above, below):
        assert stats.kstest(side, lambda x: 2.0 * student.cdf(x) - 1.0).pvalue > 1e-3


def test_widths_are_those_of_the_density_on_either_side():
    def log_likelihood(values):
        x = values["x"]
        return -0.5 * np.where(x < 0.0, x / 0.5, x / 2.0) ** 2 + 0.5 * (x / 10.0) ** 2

    density = CustomDensity((Parameter("x", Normal(0.0, 10.0), "–", "x"),), log_likelihood)
    found = about(density, np.zeros(1), np.ones((1, 1)))
    # Student's law has dropped no more than the density at any look, and as much at one
    student = stats.t(DEGREES_OF_FREEDOM)
    for sign, width, own in ((-1.0, found.below[0], 0.5), (1.0, found.above[0], 2.0)):
        drop = student.logpdf(0.0) - student.logpdf(LOOKS / width)
        slack = 0.5 * (LOOKS / own) ** 2 - drop
        assert np.min(slack) == pytest.approx(0.0, abs=1e-3), sign
    assert found.above[0] > 3.0 * found.below[0]


def test_truncated_parameters_come_first_and_are_cut():
    laws = (Normal(0.0, 1.0), TruncatedNormal(0.0, 1.0, 0.0))
    parameters = tuple(
        Parameter(name, law, "–", name) for name, law in zip("ab", laws, strict=True)
    )
    density = CustomDensity(parameters, lambda values: np.zeros(len(values["a"])))
    found = about(density, np.zeros(2), np.array([[1.0, 0.9], [0.9, 1.0]]))
    np.testing.assert_array_equal(found.order, [1, 0])
    points, _ = found.draw(np.random.default_rng(0), 1000)
    assert np.all(points[:, 1] >= 0.0)
    assert np.all(np.isfinite(density.log_prob(points)))
