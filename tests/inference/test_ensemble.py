"""Sampling of known targets, seeds and executors, and the chain as a DataTree."""

from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import accumulate, pairwise
from itertools import chain as joined
from multiprocessing import get_context

import arviz
import numpy as np
import pytest
import xarray as xr
from scipy import stats

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.importance import Proposal
from bayesdeg.inference.laplace import Evidence, Laplace, approximate, evidence
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import (
    EFFORTS,
    Chain,
    Effort,
    Position,
    RandomState,
    SamplerStatus,
    Task,
    advance,
    lie_in_a_plane,
    sample,
    start_of,
)
from bayesdeg.inference.tree import to_datatree
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.noise import sequential
from bayesdeg.observations.specimens import (
    STIFFNESS_SCATTER,
    FilmsAndActuators,
    material_parameters,
)
from bayesdeg.priors import Normal, Parameter, ParameterTable
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model, values_of
from tests.surrogate.closed_form import trained

MEAN = np.array([1.0, -2.0, 0.5])
COVARIANCE = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, -0.2], [0.0, -0.2, 0.25]])


class GaussianModel:
    """A correlated normal target with what a Model offers."""

    def __init__(self):
        self.table = ParameterTable(
            tuple(Parameter(f"p{i}", Normal(0.0, 10.0), "–", "p") for i in range(3))
        )
        self._target = stats.multivariate_normal(MEAN, COVARIANCE)

    def log_prob(self, vectors, *, truncate=True):
        return np.atleast_1d(self._target.logpdf(vectors))


@cache
def gaussian_chain(seed=1):
    model = GaussianModel()
    # a proposal that is off, so that the chain has to find its way
    start = evidence(
        model, Laplace(MEAN + 0.5, 2.0 * COVARIANCE, 0.0), np.random.default_rng(0), draws=400
    )
    effort = Effort(effective=1500.0, r_hat=1.02, chunk=50, longest=1500)
    return sample(model, start, effort=effort, seed=np.random.SeedSequence(seed))


def test_a_correlated_target_is_recovered_within_monte_carlo_error():
    chain = gaussian_chain()
    flat = chain.vectors.reshape(-1, 3)
    effective = chain.effective()
    assert np.all(effective >= 1500.0)
    error = np.sqrt(np.diag(COVARIANCE) / effective)
    assert np.all(np.abs(flat.mean(axis=0) - MEAN) < 4.5 * error)
    white = np.linalg.inv(np.linalg.cholesky(COVARIANCE))
    got = white @ np.cov(flat.T) @ white.T
    np.testing.assert_allclose(got, np.eye(3), atol=4.5 * np.sqrt(2.0 / effective.min()))


def test_stored_log_density_is_that_of_the_stored_draws():
    chain = gaussian_chain()
    want = stats.multivariate_normal(MEAN, COVARIANCE).logpdf(chain.vectors)
    np.testing.assert_allclose(chain.log_prob, want, rtol=1e-12)


def test_draws_of_the_last_period_alone_are_kept_and_walkers_suffice():
    chain = gaussian_chain()
    ensembles, steps, walkers, size = chain.vectors.shape
    assert (ensembles, walkers, size) == (4, 40, 3)
    assert steps == 25  # after 50 for fitting: those to the first look, which were enough
    assert chain.log_prob.shape == (4, steps, 40)
    assert np.all((chain.acceptance > 0.1) & (chain.acceptance < 0.9))


@pytest.mark.parametrize("longest", [2, 7, 40, 1000, 6000])
def test_periods_add_up_to_the_limit_and_double(longest):
    effort = Effort(effective=1.0, r_hat=1.1, chunk=20, longest=longest)
    periods = [sum(looks) for looks in effort.periods()]
    assert sum(periods) == longest
    assert all(later == 2 * earlier for earlier, later in pairwise(periods[:-1]))
    assert periods[-1] >= periods[-2]
    assert all(0 < look <= 160 for looks in effort.periods() for look in looks)


@pytest.mark.parametrize("chunk", [1, 20, 50])
def test_settled_there_are_two_periods_and_looks_grow_up_to_a_limit(chunk):
    effort = Effort(effective=1.0, r_hat=1.1, chunk=chunk, longest=6000)
    first, rest = effort.periods(settled=True)
    assert first == (chunk,)
    assert sum(first) + sum(rest) == 6000
    assert all(0 < earlier <= later <= 8 * chunk for earlier, later in pairwise(rest[:-1]))


@pytest.mark.parametrize(("width", "settled"), [(1.0, True), (100.0, False)])
def test_moves_are_fitted_again_only_where_the_first_law_served_badly(width, settled):
    told, model = [], GaussianModel()
    draws = MEAN + width * np.random.default_rng(0).standard_normal((300, 3))
    start = Evidence(0.0, 0.1, draws, np.zeros(300), 300.0)
    effort = Effort(effective=1e9, r_hat=1.0, chunk=20, longest=300, ensembles=2)
    chain = sample(
        model, start, effort=effort, seed=np.random.SeedSequence(0), on_chunk=told.append
    )
    assert told[-1].settled is settled
    kept = sum(effort.periods(settled=settled)[-1])
    assert told[-1].kept == chain.vectors.shape[1] == kept
    assert told[-1].steps == 300


def test_moves_that_served_are_fitted_again_where_the_walkers_go_too_slowly():
    told, model = [], GaussianModel()
    draws = MEAN + np.random.default_rng(0).standard_normal((300, 3))
    start = Evidence(0.0, 0.1, draws, np.zeros(300), 300.0)
    effort = Effort(effective=1.0, r_hat=9.0, chunk=20, longest=300, ensembles=2, times=1e9)
    chain = sample(
        model, start, effort=effort, seed=np.random.SeedSequence(0), on_chunk=told.append
    )
    settled = [standing.kept for standing in told if standing.settled]
    assert settled == [10, 20, 30, 40]  # looks until the law is given up
    assert told[-1].steps == 300
    assert told[-1].kept == chain.vectors.shape[1] == 300 - 20 - 40 - 80


def test_the_same_seed_gives_the_same_chain_and_another_seed_another():
    again = gaussian_chain.__wrapped__(1)
    np.testing.assert_array_equal(again.vectors, gaussian_chain().vectors)
    other = gaussian_chain.__wrapped__(2)
    assert not np.any(other.vectors[:, -1] == gaussian_chain().vectors[:, -1])


def test_ensembles_are_independent():
    vectors = gaussian_chain().vectors
    for i in range(4):
        for j in range(i):
            assert not np.any(vectors[i] == vectors[j])


def test_sampling_stops_when_it_is_enough_and_tells_how_far_it_is():
    told = []
    model = GaussianModel()
    start = evidence(model, Laplace(MEAN, COVARIANCE, 0.0), np.random.default_rng(0), draws=300)
    effort = Effort(effective=4000.0, r_hat=1.02, chunk=20, longest=1000, ensembles=2)
    chain = sample(
        model, start, effort=effort, seed=np.random.SeedSequence(0), on_chunk=told.append
    )
    looks = list(accumulate(joined.from_iterable(effort.periods(settled=True))))
    assert all(state.settled for state in told[1:])
    assert [state.steps for state in told] == looks[: len(told)]
    assert 2 < len(told) < len(looks)
    assert told[0].kept == 0
    assert np.isnan(told[0].effective)
    assert not any(state.enough(effort) for state in told[:-1])
    last = told[-1]
    assert last.enough(effort)
    assert last.kept == chain.vectors.shape[1]
    assert last.effective == pytest.approx(np.min(chain.effective()))
    assert last.r_hat == pytest.approx(np.max(chain.r_hat()))
    walkers = chain.vectors[:, 0, :, 0].size
    assert last.times == pytest.approx(np.min(chain.effective()) / walkers)


def test_walkers_that_stand_still_are_not_enough_however_many():
    """200 walkers at independent draws pass for 200 effective draws, in no autocorrelation time."""
    points = np.random.default_rng(3).standard_normal((4, 1, 50, 2))
    still = np.repeat(points, 40, axis=1)
    still += 1e-6 * np.random.default_rng(4).standard_normal(still.shape)
    effort = Effort(effective=150.0, r_hat=1.2, chunk=10, longest=40)
    standing = artificial(still).judged(SamplerStatus(40))
    assert standing.effective > 150.0
    assert standing.times < 2.0
    assert not standing.enough(effort)


def test_a_law_that_is_far_off_slows_the_moves_but_leads_to_the_same_draws():
    """Moves of a law too narrow, too wide or beside the target: detailed balance holds."""
    generator = np.random.default_rng(5)
    target = generator.multivariate_normal(MEAN, COVARIANCE, 4000)
    for draws in (
        MEAN + 0.7 * (target - MEAN),
        MEAN + 2.0 * (target - MEAN),
        target + np.array([1.0, 0.0, 0.5]),
        np.exp(0.3 * target),
    ):
        chain = np.stack([_chain_with(Proposal.fit(draws), seed) for seed in range(4)])
        found = Chain(chain, np.zeros(chain.shape[:3]), np.ones(4))
        error = np.sqrt(np.diag(COVARIANCE) / found.effective())
        flat = chain.reshape(-1, 3)
        assert np.all(np.abs(flat.mean(axis=0) - MEAN) < 4.5 * error)
        np.testing.assert_allclose(flat.var(axis=0), np.diag(COVARIANCE), rtol=0.12)


def _chain_with(law, seed):
    model = GaussianModel()
    begin = np.random.default_rng(seed).multivariate_normal(MEAN, COVARIANCE, 40)
    twister = np.random.MT19937(seed).state["state"]
    random = RandomState(twister["key"], twister["pos"], 0, 0.0)
    return advance(model, Task(Position(begin, model.log_prob(begin), random), law, 300)).vectors


@pytest.mark.parametrize("kind", ["point", "line", "few", "one of weight"])
def test_degenerate_starts_are_widened(kind):
    generator, model = np.random.default_rng(6), GaussianModel()
    draws = generator.multivariate_normal(MEAN, COVARIANCE, 300)
    weights = np.zeros(300)
    if kind == "point":
        draws = np.tile(MEAN, (300, 1))
    if kind == "line":
        draws = MEAN + np.outer(generator.standard_normal(300), [1.0, 2.0, -1.0])
    if kind == "few":
        draws, weights = draws[:2], weights[:2]
    if kind == "one of weight":
        weights[7] = 1e3
    start = Evidence(0.0, 0.1, draws, weights, 1.0)
    begun = start_of(model, start, np.random.default_rng(0))
    walkers = begun.walkers(model, np.random.default_rng(1), 40)
    assert len(np.unique(walkers, axis=0)) == 40
    assert not lie_in_a_plane(walkers)
    assert np.all(np.isfinite(model.log_prob(walkers)))
    effort = Effort(effective=1000.0, r_hat=1.02, chunk=50, longest=1500)
    chain = sample(model, start, effort=effort, seed=np.random.SeedSequence(2))
    assert chain.judged(SamplerStatus(1)).enough(effort)
    error = np.sqrt(np.diag(COVARIANCE) / chain.effective())
    assert np.all(np.abs(chain.vectors.reshape(-1, 3).mean(axis=0) - MEAN) < 4.5 * error)


def test_a_start_without_a_possible_vector_is_the_users_to_mend():
    start = Evidence(-np.inf, np.inf, np.zeros((5, 3)), np.full(5, -np.inf), 0.0)
    with pytest.raises(BayesdegError, match="widen the priors"):
        sample(GaussianModel(), start, effort=SHORT, seed=np.random.SeedSequence(0))


def test_draws_of_any_density_become_a_tree_of_posterior_and_density():
    model = GaussianModel()
    plain = to_datatree(model, gaussian_chain(), np.random.default_rng(0))
    assert set(plain.children) == {"posterior", "sample_stats"}
    values = {n: v.values for n, v in plain["posterior"].to_dataset().data_vars.items()}
    want = model.log_prob(model.table.vectors(values).reshape(-1, 3))
    np.testing.assert_allclose(plain["sample_stats"]["lp"].values.ravel(), want, rtol=1e-12)


def artificial(vectors):
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.full(len(vectors), 0.3))


def test_r_hat_is_one_for_equal_and_large_for_separated_ensembles():
    normal = np.random.default_rng(0).standard_normal((4, 100, 10, 2))
    assert np.all(artificial(normal).r_hat() < 1.01)
    apart = normal + np.array([0.0, 0.0, 0.0, 1.0])[:, None, None, None] * [1.0, 0.0]
    r_hat = artificial(apart).r_hat()
    assert r_hat[0] > 1.05
    assert r_hat[1] < 1.01


def test_r_hat_sees_a_drift_that_all_ensembles_share():
    normal = np.random.default_rng(0).standard_normal((4, 100, 10, 1))
    drift = normal + np.linspace(-2.0, 2.0, 100)[None, :, None, None]
    assert artificial(drift).r_hat()[0] > 1.1


def test_effective_size_of_independent_draws_is_their_number():
    normal = np.random.default_rng(1).standard_normal((4, 200, 10, 2))
    np.testing.assert_allclose(artificial(normal).effective(), 8000.0, rtol=0.15)
    np.testing.assert_allclose(artificial(normal).effective("tail"), 8000.0, rtol=0.25)


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_effective_size_of_a_known_autocorrelation(rho):
    """An AR(1) chain has n (1 − ρ)/(1 + ρ) independent draws' worth of its mean."""
    generator = np.random.default_rng(2)
    shocks = generator.standard_normal((4, 600, 10, 1)) * np.sqrt(1.0 - rho**2)
    chain = np.empty_like(shocks)
    chain[:, 0] = generator.standard_normal((4, 10, 1))
    for t in range(1, 600):
        chain[:, t] = rho * chain[:, t - 1] + shocks[:, t]
    want = 24000 * (1.0 - rho) / (1.0 + rho)
    np.testing.assert_allclose(artificial(chain).effective(), want, rtol=0.2)


def test_thinning_keeps_draws_with_their_densities():
    chain = gaussian_chain()
    walkers = chain.vectors.shape[2]
    thin = chain.thinned(5 * walkers)
    assert thin.vectors.shape == (4, 5, walkers, 3)
    want = stats.multivariate_normal(MEAN, COVARIANCE).logpdf(thin.vectors)
    np.testing.assert_allclose(thin.log_prob, want, rtol=1e-12)
    assert chain.thinned(10**9).vectors.shape == chain.vectors.shape


def test_draws_kept_of_slow_walkers_are_worth_what_the_chain_is():
    """AR(1) walkers of which every second one hardly moves: 64 walkers, 500 of 6,400 draws."""
    generator, rho = np.random.default_rng(5), np.where(np.arange(64) % 2, 0.98, 0.9)[:, None]
    vectors = np.empty((4, 100, 64, 1))
    vectors[:, 0] = generator.standard_normal((4, 64, 1))
    for step in range(1, 100):
        shocks = generator.standard_normal((4, 64, 1))
        vectors[:, step] = rho * vectors[:, step - 1] + np.sqrt(1.0 - rho**2) * shocks
    chain = artificial(vectors)
    density = CustomDensity((Parameter("mean", Normal(0.0, 1.0), "–", "mean"),), np.zeros_like)
    kept = to_datatree(density, chain.thinned(500), generator)
    summary = arviz.summary(kept, round_to="none").loc["mean"]
    assert 1900 < kept["posterior"]["mean"].size < 2100
    # every draw is another one, of all walkers alike
    assert len(np.unique(kept["posterior"]["mean"])) == kept["posterior"]["mean"].size
    assert summary["ess_bulk"] == pytest.approx(chain.effective()[0], rel=0.35)
    assert summary["r_hat"] == pytest.approx(chain.r_hat()[0], abs=0.01)
    assert chain.spread(2000).shape == (kept["posterior"]["mean"].size, 1)


def test_more_effort_asks_for_more():
    quick, standard, thorough = (EFFORTS[name] for name in ("quick", "standard", "thorough"))
    for less, more in ((quick, standard), (standard, thorough)):
        assert more.effective > less.effective
        assert more.r_hat < less.r_hat
        assert more.longest > less.longest


# ---- a real model


@cache
def real_model():
    return altered(small_model(), forward=trained())


@cache
def real_start():
    model, generator = real_model(), np.random.default_rng(0)
    laplace = approximate(model, generator, start=model.table.vectors(values_of())[0])
    return evidence(model, laplace, generator, draws=500)


SHORT = Effort(effective=1e9, r_hat=1.0, chunk=10, longest=20, ensembles=2)


@cache
def real_chain():
    return sample(real_model(), real_start(), effort=SHORT, seed=np.random.SeedSequence(5))


@pytest.mark.slow
def test_two_processes_give_what_one_gives():
    # spawned, since a forked copy of a process with threads is not safe
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        side_by_side = sample(
            real_model(),
            real_start(),
            effort=SHORT,
            seed=np.random.SeedSequence(5),
            executor=executor,
        )
    np.testing.assert_array_equal(side_by_side.vectors, real_chain().vectors)
    np.testing.assert_array_equal(side_by_side.log_prob, real_chain().log_prob)
    np.testing.assert_array_equal(side_by_side.acceptance, real_chain().acceptance)


def test_walkers_that_start_on_impossible_vectors_are_replaced():
    """Draws of weight zero are never started from, nor is a jitter kept that leads there."""
    model = real_model()
    draws = draws_near_truth(model, 60, spread=0.1)
    draws[::2, model.table.names.index("volume_ratio")] = 1.2  # beyond its prior
    possible = np.isfinite(model.log_prob(draws))
    assert 10 < possible.sum() < 50
    start = Evidence(0.0, 0.1, draws, np.where(possible, 0.0, -np.inf), float(possible.sum()))
    chain = sample(model, start, effort=SHORT, seed=np.random.SeedSequence(1))
    assert np.all(np.isfinite(chain.log_prob))


@cache
def tree():
    return to_datatree(real_model(), real_chain().thinned(30), np.random.default_rng(8))


def test_groups_are_those_of_the_contract():
    assert {
        "posterior",
        "sample_stats",
        "log_likelihood",
        "posterior_predictive",
        "observed_data",
        "constant_data",
    } <= set(tree().children)


def test_stored_draws_have_the_stored_log_density():
    """From names back to a vector, one draw at a time."""
    model, stored = real_model(), tree()
    posterior = stored["posterior"].to_dataset()
    assert set(posterior.data_vars) == set(TRUTH)
    assert dict(posterior.sizes) == {"chain": 2, "draw": real_chain().vectors.shape[2]}
    for chain, draw in [(0, 0), (0, 17), (1, 5), (1, 29)]:
        values = {n: v.values[chain, draw][None] for n, v in posterior.data_vars.items()}
        lp = float(stored["sample_stats"]["lp"][chain, draw])
        assert model.log_prob(model.table.vectors(values))[0] == pytest.approx(lp, rel=1e-9)


def test_stored_draws_have_the_stored_log_likelihoods():
    model, stored = real_model(), tree()
    posterior, densities = stored["posterior"].to_dataset(), stored["log_likelihood"]
    for chain, draw in [(0, 3), (1, 20)]:
        values = {n: v.values[chain, draw][None] for n, v in posterior.data_vars.items()}
        for kind, block in model.log_likelihood(values).items():
            got = densities[f"{kind}_specimens"].values[chain, draw]
            np.testing.assert_allclose(got, block[0], rtol=1e-9)
        pointwise = sequential(model.data_of(Curvature).linearised(model.state(values)))[0]
        data, points = (
            model.data_of(Curvature).tests,
            model.data_of(Curvature).tests.pressure.shape[1],
        )
        for name, mask, columns in (
            ("curvature", data.mask, slice(0, points)),
            ("bend_angle", data.angle_mask, slice(points, 2 * points)),
        ):
            np.testing.assert_allclose(
                densities[name].values[chain, draw],
                pointwise[:, columns][mask],
                rtol=1e-9,
                atol=1e-12,
            )


def test_likelihoods_and_prior_sum_to_the_log_density():
    model, stored = real_model(), tree()
    blocks = [
        stored["log_likelihood"][f"{kind}_specimens"].values.sum(axis=-1)
        for kind in ("tensile", "actuator", "rupture", "breaks", "statistics")
    ]
    values = {n: v.values for n, v in stored["posterior"].to_dataset().data_vars.items()}
    total = sum(blocks) + model.table.log_prior(model.table.vectors(values))
    np.testing.assert_allclose(total, stored["sample_stats"]["lp"].values, rtol=1e-9)
    densities, names = stored["log_likelihood"], list(model.data_of(Curvature).tests.specimens)
    both = densities["curvature"].groupby("specimen_id").sum("observation")
    both = both.sel(specimen_id=names).values.copy()
    angles = densities["bend_angle"]
    for s, name in enumerate(names):
        own = angles["bend_angle_specimen_id"].values == name
        both[..., s] += angles.values[..., own].sum(axis=-1)
    np.testing.assert_allclose(both, densities["actuator_specimens"].values, rtol=1e-9)


def test_the_joint_likelihood_is_of_all_that_was_read_on_each_specimen():
    densities = tree()["log_likelihood"].to_dataset()
    assert list(densities.data_vars) == ["joint"]
    parts = [densities[f"{k}_specimens"] for k in ("tensile", "actuator", "rupture", "breaks")]
    total = sum(part.sum(part.dims[-1]) for part in [*parts, densities["statistics_specimens"]])
    np.testing.assert_allclose(densities["joint"].sum("specimen"), total, rtol=1e-9)
    name = real_model().data_of(Curvature).tests.specimens[0]
    both = sum(densities[f"{kind}_specimens"].values[..., 0] for kind in ("actuator", "rupture"))
    np.testing.assert_allclose(densities["joint"].sel(specimen=name), both, rtol=1e-9)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto:UserWarning")
def test_arviz_leaves_out_whole_specimens_of_the_stored_tree_and_parts_by_name(tmp_path):
    tree().to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    stored = arviz.from_netcdf(tmp_path / "posterior.nc")
    found = arviz.loo(stored, pointwise=True)
    specimens = stored["log_likelihood"]["joint"].sizes["specimen"]
    assert found.n_data_points == specimens == len(found.elpd_i)
    assert float(found.elpd_i.sum()) == pytest.approx(found.elpd)
    data = real_model().data_of(Curvature).tests
    parts = arviz.loo(stored, var_name="curvature")
    assert parts.n_data_points == data.mask.sum()
    assert arviz.loo(stored, var_name="actuator_specimens").n_data_points == len(data.specimens)


@pytest.mark.parametrize(
    "group", ["log_likelihood", "posterior_predictive", "observed_data", "constant_data"]
)
def test_observations_carry_specimen_pressure_and_degradation(group):
    data, mask = real_model().data_of(Curvature).tests, real_model().data_of(Curvature).tests.mask
    coords = tree()[group].to_dataset().coords
    s, j = np.nonzero(mask)
    for name, want in (
        ("specimen_id", np.array(data.specimens)[s]),
        ("pressure_kPa", data.pressure[s, j]),
        ("degradation_pct", data.degradation[s, 0]),
    ):
        assert coords[name].dims == ("observation",)
        np.testing.assert_array_equal(coords[name].values, want)


def test_observed_and_constant_data_are_the_studys():
    data = real_model().data_of(Curvature).tests
    np.testing.assert_array_equal(tree()["observed_data"]["curvature"], data.curvature[data.mask])
    np.testing.assert_array_equal(tree()["constant_data"]["pressure"], data.pressure[data.mask])


def test_the_posterior_predictive_is_about_what_was_observed():
    replicates = tree()["posterior_predictive"]["curvature"].values
    replicates = replicates.reshape(-1, replicates.shape[-1])
    observed = tree()["observed_data"]["curvature"].values
    z = (observed - replicates.mean(axis=0)) / replicates.std(axis=0)
    assert np.all(np.abs(z) < 5.0)
    assert 0.3 < np.sqrt(np.mean(z**2)) < 2.0
    assert np.all(replicates.std(axis=0) > 0.0)


def test_a_model_without_actuators_has_a_tree_without_observations():
    model = altered(real_model(), actuator=None, forward=None)
    small = to_datatree(model, real_chain().thinned(4), np.random.default_rng(0))
    assert "observed_data" not in small.children
    assert "tensile_specimens" in small["log_likelihood"].to_dataset()


def test_the_tree_survives_netcdf(tmp_path):
    path = tmp_path / "posterior.nc"
    tree().to_netcdf(path, engine="h5netcdf")
    with xr.open_datatree(path, engine="h5netcdf") as stored:
        back = stored.load()
    assert set(back.children) == set(tree().children)
    for group in tree().children:
        xr.testing.assert_equal(back[group].to_dataset(), tree()[group].to_dataset())


def test_a_study_without_any_likelihood_has_a_joint_density_of_nothing(tmp_path):
    base = (*material_parameters((0.0,)), STIFFNESS_SCATTER)
    model = JointModel(base, (), FilmsAndActuators(nodes=(0.0,)))
    size = len(model.table)
    vectors = 0.01 * np.random.default_rng(0).standard_normal((2, 5, 4, size))
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))
    found = to_datatree(model, chain, np.random.default_rng(1))
    assert found["log_likelihood"]["joint"].shape == (2, 20, 0)
    found.to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    with xr.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as again:
        assert again["posterior"]["stiffness_scatter"].shape == (2, 20)
