"""Orders of the polynomials: evidence and held-out films against closed forms and known truths."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.analysis.order import (
    OrderComparison,
    OrderFit,
    compare_orders,
    films_alone,
    leave_films_out,
)
from bayesdeg.criticism.holdout.held_out import largest_k
from bayesdeg.inference.importance import Proposal, improved, log_density
from bayesdeg.inference.laplace import Laplace, approximate, evidence
from bayesdeg.inference.model import JointModel, without
from bayesdeg.material.degradation import NODES
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.means import Means, Statistic
from bayesdeg.observations.specimens import (
    STIFFNESS_SCATTER,
    FilmsAndActuators,
    material_parameters,
)
from bayesdeg.observations.tensile import TENSILE, Tensile, TensileCurves
from bayesdeg.pages.tables import ORDERS, TABLES
from bayesdeg.priors import Normal, Parameter, ParameterTable
from tests.inference.small_study import altered

LEVELS = np.repeat([0.0, 5.0, 10.0, 15.0, 20.0, 25.0], 2)
STRETCH = np.linspace(1.05, 1.5, 6)


def films_model(law, *, seed, order=2, levels=LEVELS):
    """Uniaxial films whose ln C1 is a given function of D_R; scatter 3 %, noise 1 %."""
    generator = np.random.default_rng(seed)
    count = len(levels)
    stretch = np.tile(STRETCH, (count, 1))
    basis = yeoh_basis(stretch, np.array(["uniaxial"] * count)[:, None], "nominal")
    constants = np.array([[c := np.exp(law(level)), -0.01 * c, 0.01 * c] for level in levels])
    scatter = np.exp(0.03 * generator.standard_normal(count))
    stress = np.einsum("spi,si,s->sp", basis, constants, scatter)
    stress = stress * (1.0 + 0.01 * generator.standard_normal(stress.shape))
    tensile = TensileCurves(
        specimens=tuple(f"f{i}" for i in range(count)),
        modes=("uniaxial",) * count,
        degradation=levels,
        degradation_sd=np.full(count, 0.1),
        basis=basis,
        stretch=stretch,
        stress=stress,
        cauchy=np.zeros(stretch.shape, bool),
        mask=np.ones(stretch.shape, bool),
    )
    base = (*material_parameters(NODES[order]), STIFFNESS_SCATTER, *TENSILE)
    return JointModel(base, (Tensile(tensile),), FilmsAndActuators(NODES[order]))


def straight(level):
    return np.log(0.3 + 0.05 * level)


def bent(level):
    return np.log(0.3 + 1.3 * (level / 25.0) ** 2)


def wavy(level):
    return np.log(0.3 + 1.3 * (0.5 - 0.5 * np.cos(np.pi * level / 25.0)) + 0.02 * level)


def fit_of(comparison, order):
    return next(fit for fit in comparison.fits if fit.order == order)


@pytest.fixture(scope="module")
def of_bent():
    model = films_model(bent, seed=1)
    return compare_orders(model, seed=np.random.SeedSequence(2))


@pytest.mark.long
@pytest.mark.slow
def test_films_on_a_parabola_support_order_two(of_bent):
    assert [fit.order for fit in of_bent.fits] == [1, 2, 3]
    first = fit_of(of_bent, 1)
    gain, error = of_bent.difference(first)
    assert gain < -2.0 * error
    assert of_bent.log_bayes_factor(first)[0] < -3.0
    gain, error = of_bent.difference(fit_of(of_bent, 3))
    assert abs(gain) < 3.0 * error + 3.0
    assert (of_bent.better, of_bent.simpler) == (None, None)


@pytest.mark.slow
def test_films_on_a_line_do_as_well_with_order_one():
    model = films_model(straight, seed=3)
    comparison = compare_orders(model, seed=np.random.SeedSequence(4), orders=(1, 2))
    gain, error = comparison.difference(fit_of(comparison, 1))
    assert gain > -2.0 * error
    assert comparison.log_bayes_factor(fit_of(comparison, 1))[0] > 0.0
    assert (comparison.better, comparison.simpler) == (None, 1)


@pytest.mark.slow
def test_films_on_a_steep_wave_ask_for_order_three():
    model = films_model(wavy, seed=5, levels=np.repeat(np.arange(0.0, 26.0, 2.5), 2))
    comparison = compare_orders(model, seed=np.random.SeedSequence(6), orders=(2, 3))
    gain, error = comparison.difference(fit_of(comparison, 3))
    assert gain > 2.0 * error
    assert comparison.better == 3


@pytest.mark.slow
def test_held_out_films_are_those_of_posteriors_without_them(of_bent):
    """ln p(y_i | the others) = ln p(y) − ln p(y without i), each evidence by itself."""
    model = films_alone(films_model(bent, seed=1), NODES[2])
    second = fit_of(of_bent, 2)
    for row in (0, 5, 11):
        generator = np.random.default_rng(row)
        others = without(model, [f"f{row}"])
        rough = evidence(others, approximate(others, generator), generator)
        left = improved(others, rough, generator)
        expected = second.log_evidence - left.log_evidence
        assert second.elpd[row] == pytest.approx(expected, abs=0.25)


@pytest.mark.long
@pytest.mark.slow
def test_a_film_with_a_heavy_tail_of_weights_is_calibrated_anew():
    model = films_model(bent, seed=7, levels=np.repeat([0.0, 12.0, 25.0], 2))
    assert model.of_kind(Tensile)
    stress = model.data_of(Tensile).tests.stress.copy()
    stress[2] *= 1.6  # one film far from its neighbour
    films = films_alone(
        altered(model, tensile=replace(model.data_of(Tensile).tests, stress=stress)), NODES[2]
    )
    generator = np.random.default_rng(8)
    rough = evidence(films, approximate(films, generator), generator)
    posterior_draws = improved(films, rough, generator)
    elpd, pareto_k, refitted = leave_films_out(
        films, posterior_draws, seed=np.random.SeedSequence(9)
    )
    assert pareto_k[2] > largest_k(1000)
    assert refitted[2]
    others = without(films, ["f2"])
    left = improved(others, evidence(others, approximate(others, generator), generator), generator)
    assert elpd[2] == pytest.approx(posterior_draws.log_evidence - left.log_evidence, abs=0.5)


def test_films_alone_keep_priors_and_leave_everything_else():
    model = films_model(bent, seed=1)
    own = Normal(0.3, 0.1)
    base = tuple(replace(p, law=own) if p.name == "c1_at_0" else p for p in model.base)
    statistics = (
        Statistic("young_modulus", 0.0, 1.73, 0.09, "paper"),
        Statistic("elongation_at_break", 0.0, 209.8, 3.6, "paper"),
    )
    films = films_alone(altered(model, base=base, statistics=statistics), NODES[1])
    laws = {p.name: p.law for p in films.base}
    assert laws["c1_at_0"] == own
    assert not any("control" in name for name in laws)
    assert {"stiffness_scatter", "tensile_noise", "tensile_noise_length"} <= set(laws)
    assert [s.quantity for s in films.data_of(Means).statistics] == ["young_modulus"]


def test_there_is_nothing_to_compare_without_films_at_several_rates():
    seed = np.random.SeedSequence(1)
    model = films_model(bent, seed=1, order=0, levels=np.zeros(3))
    assert compare_orders(model, seed=seed) is None
    assert compare_orders(altered(model, tensile=None), seed=seed) is None


def fit(order, elpd, log_evidence):
    count = len(elpd)
    return OrderFit(
        order=order,
        size=4 + 3 * (order + 1),
        log_evidence=log_evidence,
        error=0.1,
        effective=900.0,
        elpd=np.array(elpd),
        pareto_k=np.full(count, 0.3),
        refitted=np.zeros(count, bool),
    )


def test_the_table_holds_differences_to_the_order_used():
    comparison = OrderComparison(
        (fit(1, [1.0, 2.0, 4.0], 10.0), fit(2, [2.0, 4.0, 5.0], 14.0)), used=2
    )
    table = comparison.table().set_index("order")
    assert set(comparison.table().columns) == set(TABLES[ORDERS].headings)
    assert table.loc[1, "elpd_diff"] == pytest.approx(-4.0)
    assert table.loc[1, "elpd_diff_se"] == pytest.approx(np.sqrt(3.0) * np.std([1, 2, 1], ddof=1))
    assert table.loc[1, "log_bayes_factor"] == pytest.approx(-4.0)
    assert table.loc[1, "log_bayes_factor_error"] == pytest.approx(0.1 * np.sqrt(2.0))
    assert table.loc[2, "used"] == 1
    assert table.loc[2, "elpd_diff"] == 0.0


@pytest.mark.parametrize(
    ("other", "better", "simpler"),
    [
        (fit(3, [9.0, 9.1, 9.2], 20.0), 3, None),
        (fit(3, [9.0, 9.1, 9.2], 8.0), None, None),  # held-out films alone
        (fit(3, [2.1, 4.0, 5.0], 30.0), None, None),  # evidence alone
        (fit(1, [2.0, 4.0, 5.1], 15.0), None, 1),
        (fit(1, [2.0, 4.0, 5.1], float("nan")), None, None),
    ],
)
def test_both_evidence_and_held_out_films_are_asked_for(other, better, simpler):
    comparison = OrderComparison((fit(2, [2.0, 4.0, 5.0], 14.0), other), used=2)
    assert comparison.is_judged
    assert comparison.others == (other,)
    assert (comparison.better, comparison.simpler) == (better, simpler)


def test_an_order_without_evidence_is_not_judged():
    unknown = fit(2, [2.0, 4.0, 5.0], float("nan"))
    assert not OrderComparison((unknown, fit(1, [2.0, 4.0, 5.1], 15.0)), used=2).is_judged


# ---- the importance sample that evidences rest on


MEAN = np.array([0.5, -0.2, 0.1])
ROOT = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.5, 0.3, 0.4]])


class Bell:
    """A normal density of known mean and covariance, and of total mass e² on top of its priors."""

    table = ParameterTable(tuple(Parameter(f"p{i}", Normal(0.0, 1.0), "–", "p") for i in range(3)))
    mass = 2.0

    def log_prob(self, vectors, *, truncate=True):
        return self.mass + stats.multivariate_normal(MEAN, ROOT @ ROOT.T).logpdf(vectors)


def test_an_improved_sample_has_the_evidence_of_the_closed_form():
    generator = np.random.default_rng(1)
    # a proposal that misses: displaced by three standard deviations, and too wide
    off = Laplace(MEAN + 3.0 * np.linalg.norm(ROOT, axis=1), 4.0 * ROOT @ ROOT.T, np.nan)
    poor = evidence(Bell(), off, generator, draws=500)
    assert poor.effective < 100.0
    better = improved(Bell(), poor, generator)
    assert better.effective > 1000.0
    assert better.log_evidence == pytest.approx(Bell.mass, abs=4.0 * better.error)
    draws = better.resample(generator, 20_000)
    np.testing.assert_allclose(draws.mean(axis=0), MEAN, atol=0.1)
    np.testing.assert_allclose(np.cov(draws.T), ROOT @ ROOT.T, atol=0.12)


def test_the_density_of_a_proposal_is_normalised():
    draws = np.random.default_rng(2).gamma(4.0, 1.0, (4000, 1))
    law = Proposal.fit(draws)
    grid = np.linspace(-400.0, 800.0, 400_001)
    density = np.exp(log_density(law, grid[:, None]))
    assert np.sum(density) * (grid[1] - grid[0]) == pytest.approx(1.0, abs=2e-3)
    middle = np.array([3.0, 4.0, 6.0])
    expected = stats.gamma(4.0).pdf(middle)
    np.testing.assert_allclose(np.exp(log_density(law, middle[:, None])), expected, rtol=0.15)


def test_a_posterior_that_is_nowhere_possible_has_no_evidence():
    class Impossible(Bell):
        def log_prob(self, vectors, *, truncate=True):
            return np.full(len(vectors), -np.inf)

    generator = np.random.default_rng(3)
    start = evidence(Bell(), Laplace(MEAN, ROOT @ ROOT.T, np.nan), generator)
    for begin in (start, replace(start, effective=0.0, log_evidence=-np.inf)):
        found = improved(Impossible(), begin, generator)
        assert found.log_evidence == -np.inf
        assert found.effective == 0.0
