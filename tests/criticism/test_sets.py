"""Evidence of sets of causes on one linear scale, against closed forms; what chance gives pairs."""

from itertools import combinations, permutations

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_normal, norm

from bayesdeg.criticism.fit.linear import log_bayes_factor, sensitivities
from bayesdeg.criticism.fit.screening import JointScreening, largest_by_chance, screen
from bayesdeg.criticism.fit.search import beside_the_rate, set_penalties
from bayesdeg.priors import Normal, TruncatedNormal
from tests.criticism import straight_subject as straight
from tests.criticism.straight_subject import ERROR, SHAPES, X, cause_of, linear_cause


def joint(observed, causes=straight.CAUSES):
    linear = straight.exact_linear(observed)
    return JointScreening.of(linear.observed, [screen(linear, cause) for cause in causes])


@pytest.mark.parametrize("size", [1, 2, 3])
def test_log_bayes_factors_of_sets_are_exact(size):
    observed = straight.readings(9, offset=0.15, wave=-0.2)
    found = joint(observed)
    sets = found.all_sets(size)
    names = [found.names_of(places) for places in sets]
    assert set(names) == {frozenset(n) for n in combinations((c.name for c in found.causes), size)}
    exact = [straight.log_factor(observed, *(linear_cause(n) for n in own)) for own in names]
    # no draws: normal laws are integrated in closed form
    np.testing.assert_allclose(found.factors(sets), exact, atol=0.01)
    if size == 2:
        assert names[int(np.argmax(exact))] == {"offset", "wave"}


def test_sizes_in_a_set_are_those_of_the_joint_posterior():
    observed = straight.readings(9, offset=0.15, wave=-0.2)
    found = joint(observed)
    both = [linear_cause(name) for name in ("offset", "wave")]
    mode = straight.joint_of(*both).posterior(observed)[0][-2:]
    sizes = found.sizes_of(found.places_of(frozenset({"offset", "wave"})))
    np.testing.assert_allclose([sizes["offset"][0], sizes["wave"][0]], mode, atol=1e-3)


def test_a_pair_with_a_twin_is_no_better_than_one_of_them():
    causes = [linear_cause(name) for name in ("offset", "twin")]
    found = joint(straight.readings(10, offset=0.15), causes)
    [pair] = found.factors(found.all_sets(2))
    assert pair < found.alone[0] + np.log(2.0)


def test_causes_that_change_no_reading_are_in_no_set():
    noise = cause_of("noise", {"extra": TruncatedNormal(0.0, 0.1, 0.0, np.inf)}, straight.untouched)
    found = joint(straight.readings(11, wave=0.1), [noise, *map(linear_cause, ("wave", "lag"))])
    assert [cause.name for cause in found.causes] == ["wave", "lag"]
    assert found.places_of(frozenset({"noise", "wave"})) is None


def test_causes_of_several_parameters_stand_beside_those_of_one():
    shapes = {"size": SHAPES["offset"], "more": SHAPES["wave"]}
    laws = {"size": Normal(0.0, 0.3), "more": Normal(0.0, 0.2)}
    two = cause_of("two", laws, straight.partial(straight.added, shapes=shapes))
    observed = straight.readings(4, offset=-0.3, wave=0.4, lag=0.2)
    found = joint(observed, [linear_cause("lag"), two])
    [pair] = found.factors(found.all_sets(2))
    exact = straight.log_factor(observed, linear_cause("lag"), two)
    assert pair == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("planted", [0.15, -0.15])
def test_a_prior_that_ends_at_a_bound_counts_only_one_side(planted):
    """Against quadrature over both sizes, of a positive effect beside one of either sign."""
    law, sd = TruncatedNormal(0.0, 0.3, 0.0, np.inf), 0.3
    causes = [linear_cause("wave", law=law), linear_cause("lag")]
    observed = straight.readings(5, wave=planted, lag=0.2)
    found = joint(observed, causes)
    [pair] = found.factors(found.all_sets(2))
    base = straight.joint_of()
    normal = multivariate_normal(base.shapes @ base.mean, base.covariance)
    shapes = np.array([SHAPES["wave"], SHAPES["lag"]])
    precision = shapes @ np.linalg.solve(base.covariance, shapes.T) + np.eye(2) / sd**2
    centre = np.linalg.solve(
        precision, shapes @ np.linalg.solve(base.covariance, observed - normal.mean)
    )
    at = np.array([max(centre[0], 0.0), centre[1]])

    def log_density(wave, lag):
        change = np.array([wave, lag]) @ shapes
        ratio = normal.logpdf(observed - change) - normal.logpdf(observed)
        return ratio + law.log_density(wave) + norm.logpdf(lag, scale=sd)

    top, (wide, tall) = float(log_density(*at)), 8.0 / np.sqrt(np.diag(precision))
    mass, _ = dblquad(
        lambda lag, wave: np.exp(float(log_density(wave, lag)) - top),
        max(0.0, at[0] - wide),
        at[0] + wide,
        at[1] - tall,
        at[1] + tall,
    )
    exact = top + np.log(mass)
    # bounds are taken one parameter at a time, and a size beyond its bound is a tail
    assert pair == pytest.approx(exact, abs=0.3)


def test_another_scatter_is_that_of_screening_on_it():
    observed = straight.readings(6, wave=0.2, lag=0.1)
    linear = straight.exact_linear(observed)
    scatter = linear.scatter + 3.0 * ERROR**2 * np.eye(len(X))
    other = linear.with_scatter(scatter)
    screened = [screen(linear, cause) for cause in straight.CAUSES]
    moved = JointScreening.at(linear, screened, scatter)
    again = JointScreening.of(other.observed, [screen(other, cause) for cause in straight.CAUSES])
    sets = moved.all_sets(2)
    np.testing.assert_allclose(moved.factors(sets), again.factors(sets), atol=0.01)


def test_the_order_of_causes_does_not_matter():
    observed = straight.readings(7, wave=0.2, lag=0.1)
    found = []
    for causes in list(permutations(straight.CAUSES))[::5]:
        one = joint(observed, causes)
        sets = one.all_sets(3)
        factors = one.factors(sets)
        found.append({one.names_of(s): f for s, f in zip(sets, factors, strict=True)})
    for other in found[1:]:
        assert other == pytest.approx(found[0], abs=1e-8)


def test_the_best_pair_by_chance_is_that_of_every_pair_by_itself():
    linear = straight.exact_linear(straight.readings(8))
    columns = [sensitivities(linear, cause) for cause in straight.CAUSES]
    z = np.random.default_rng(1).standard_normal((50, len(X)))
    pairs = [log_bayes_factor(z, np.hstack(two)) for two in combinations(columns, 2)]
    np.testing.assert_allclose(largest_by_chance(z, columns), np.max(pairs, axis=0), atol=1e-9)
    assert not largest_by_chance(z, columns[:1]).any()


@pytest.mark.parametrize("share", [0.0, 0.02, 0.05])
def test_pairs_and_single_causes_together_keep_the_rate(share):
    generator = np.random.default_rng(2)
    singles, pairs = generator.standard_normal((2, 2000))
    threshold = float(np.quantile(singles, 1.0 - share))
    limit = beside_the_rate(singles, pairs, threshold)
    rate = np.mean((singles > threshold) | (pairs > limit))
    assert rate == pytest.approx(0.05, abs=1e-3)
    assert np.mean(singles > threshold) == pytest.approx(share, abs=1e-3)


def test_sets_of_one_size_share_their_prior_probability():
    np.testing.assert_allclose(np.exp(set_penalties(25))[:4], [1.0, 25.0, 300.0, 2300.0])
