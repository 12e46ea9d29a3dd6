from dataclasses import replace

import numpy as np
import pytest
from arviz_base import from_dict
from arviz_stats import psense
from scipy.stats import norm

from bayesdeg.assembly.assemble import assemble
from bayesdeg.criticism.posterior import prior_sensitivity as module
from bayesdeg.criticism.posterior.prior_sensitivity import (
    NOTICEABLE,
    Diagnosis,
    PriorSensitivity,
    Scaling,
    Sensitivity,
    conclusions,
    log_priors,
    power_scaling,
    prior_sensitivity,
)
from bayesdeg.data.study import read_study
from bayesdeg.inference.sampling import Chain
from bayesdeg.priors import Normal, Parameter, ParameterTable
from tests.criticism.linear_case import scaling_cause
from tests.inference.small_study import draws_near_truth, small_model

DRAWS = 40000


def posterior(prior_sd, readings_sd, reading=1.0):
    """Mean and precision of θ ~ N(0, prior_sd²) with one reading of this error."""
    precision = 1.0 / prior_sd**2 + 1.0 / readings_sd**2
    return reading / readings_sd**2 / precision, precision


def draws_of(mean, precision, seed=0):
    generator = np.random.default_rng(seed)
    return mean + precision**-0.5 * generator.standard_normal((4, DRAWS // 4))


def distance(first, second, low, high):
    """Cumulative Jensen–Shannon distance of two normal laws between bounds, by quadrature."""
    x = np.linspace(low, high, 20001)

    def seen_from(sign):
        p, q = (norm.cdf(sign * (x - mean) / sd) for mean, sd in (first, second))
        middle = 0.5 * (p + q)
        total = np.trapezoid(p * np.log2(p / middle) + q * np.log2(q / middle), x)
        return np.sqrt(total / np.trapezoid(p + q, x))

    return max(seen_from(1.0), seen_from(-1.0))


@pytest.mark.parametrize(
    ("prior_sd", "readings_sd", "by_prior", "by_data"),
    [(0.5, 5.0, True, False), (5.0, 0.5, False, True), (1.0, 1.0, True, True)],
    ids=["prior", "data", "both"],
)
def test_a_conjugate_normal_is_shaped_by_what_is_narrow(prior_sd, readings_sd, by_prior, by_data):
    mean, precision = posterior(prior_sd, readings_sd)
    draws = draws_of(mean, precision)
    found, exact = [], []
    for which, log_density in enumerate(
        (norm.logpdf(draws, 0.0, prior_sd), norm.logpdf(1.0, draws, readings_sd))
    ):
        found.append(power_scaling(draws, Scaling.of(log_density)))
        slopes = []
        for alpha in (0.99, 1.01):
            sds = [prior_sd, readings_sd]
            sds[which] /= np.sqrt(alpha)
            centre, total = posterior(*sds)
            gap = distance((mean, precision**-0.5), (centre, total**-0.5), draws.min(), draws.max())
            slopes.append(gap / abs(np.log2(alpha)))
        exact.append(np.mean(slopes))
    np.testing.assert_allclose(found, exact, rtol=0.05, atol=0.003)
    assert (found[0] >= NOTICEABLE) == by_prior
    assert (found[1] >= NOTICEABLE) == by_data


def test_the_shift_is_that_of_the_closed_form(monkeypatch):
    """d mean/d log2 α = −ln 2 · mean · (prior precision over total), over the posterior's sd."""
    model, chain = theta_model(prior_sd=1.0, readings_sd=1.0)
    monkeypatch.setattr(module, "conclusions", lambda model, values: {})
    row = prior_sensitivity(model, chain).rows[0]
    mean, precision = posterior(1.0, 1.0)
    exact = -np.log(2.0) * mean / precision * precision**0.5
    assert row.shift == pytest.approx(exact, abs=0.05)
    assert row.diagnosis is Diagnosis.BOTH


def test_sensitivities_are_those_of_arviz():
    model = small_model()
    chain = possible_chain(model)
    found = prior_sensitivity(model, chain)
    flat = model.table.named(chain.vectors[:, :, 0])
    values = {name: v.reshape(-1) for name, v in flat.items()}
    prior = {name: v.reshape(4, -1) for name, v in log_priors(model.table, values).items()}
    blocks = {
        kind: v.sum(axis=-1).reshape(4, -1) for kind, v in model.log_likelihood(values).items()
    }
    tree = from_dict({"posterior": flat, "log_prior": prior, "log_likelihood": blocks})
    peer = [
        psense(tree, group=group, group_var_names=list(parts))
        for group, parts in (("prior", prior), ("likelihood", blocks))
    ]
    rows = {row.quantity: row for row in found.rows}
    for name in model.table.names:
        assert rows[name].prior == pytest.approx(float(peer[0][name]), rel=1e-6)
        assert rows[name].likelihood == pytest.approx(float(peer[1][name]), rel=1e-6)


def test_priors_add_up_to_the_log_prior_without_the_map_to_the_whole_line():
    model = small_model()
    vectors = draws_near_truth(model, 5)
    values = model.table.named(vectors)
    jacobian = sum(p.law.log_jacobian(vectors[:, i]) for i, p in enumerate(model.table.parameters))
    total = sum(log_priors(model.table, values).values()) + jacobian
    np.testing.assert_allclose(total, model.table.log_prior(vectors), rtol=1e-12)


def test_a_flat_prior_moves_nothing():
    draws = draws_of(0.0, 1.0)
    assert power_scaling(draws, Scaling.of(np.zeros_like(draws))) == pytest.approx(0.0, abs=1e-6)
    assert power_scaling(np.ones_like(draws), Scaling.of(norm.logpdf(draws))) == 0.0


def test_a_part_that_most_draws_agree_on_is_scaled_too():
    """As the density of not having burst, 1 in nearly all draws."""
    draws = draws_of(0.0, 1.0)
    rare = np.where(draws > 3.0, -1.0, 0.0)
    assert 0.0 <= power_scaling(draws, Scaling.of(rare)) < NOTICEABLE


def test_unrelated_draws_show_the_noise():
    """Two parameters of which each one's prior is nothing to the other."""
    draws, other = draws_of(0.0, 1.0, seed=1)[:, :500], draws_of(0.0, 1.0, seed=2)[:, :500]
    unrelated = power_scaling(draws, Scaling.of(norm.logpdf(other)))
    assert 0.0 < unrelated < 0.5 * NOTICEABLE


# ---- what is concluded


def test_conclusions_are_what_the_report_states():
    model = small_model()
    values = model.table.named(draws_near_truth(model, 3))
    found = conclusions(model, values)
    assert list(found) == [
        "C1 at 0 %",
        "C1 at 25 %",
        "volume ratio",
        "paper stiffness",
        "elongation limit at 0 %",
        "elongation limit at 25 %",
    ]
    np.testing.assert_allclose(found["C1 at 25 %"], values["c1_at_25"], rtol=1e-12)
    np.testing.assert_allclose(found["elongation limit at 0 %"], values["elongation_at_0"])
    extended = model.extended(scaling_cause())
    values = extended.table.named(np.zeros((3, len(extended.table))))
    assert list(conclusions(extended, values))[-1] == "scale: size"


def row(quantity, prior, likelihood, *, noise=0.01, shift=0.4, hangs_on="volume_ratio"):
    return Sensitivity(quantity, True, prior, likelihood, noise, noise, shift, hangs_on, "actuator")


def test_the_diagnosis_takes_both_sides_and_the_noise():
    assert row("a", 0.3, 0.01).diagnosis is Diagnosis.PRIOR
    assert row("a", 0.3, 0.2).diagnosis is Diagnosis.BOTH
    assert row("a", 0.01, 0.2).diagnosis is Diagnosis.DATA
    assert row("a", 0.01, 0.01).diagnosis is Diagnosis.NEITHER
    assert row("a", 0.06, 0.2, noise=0.04).diagnosis is Diagnosis.DATA


def test_what_hangs_on_which_prior_comes_first():
    rows = (
        row("C1 at 0 %", 0.01, 0.2),
        row("volume ratio", 0.07, 0.2, hangs_on="paper_stiffness", shift=0.16),
        row("paper stiffness", 0.3, 0.01, hangs_on="paper_stiffness", shift=-0.7),
        row("creep: size", 0.3, 0.1, hangs_on="creep.size"),
    )
    found = PriorSensitivity((*rows, replace(rows[2], quantity="c", conclusion=False)))
    names = ("paper stiffness", "creep: size", "volume ratio")
    assert tuple(one.quantity for one in found.on_priors) == names
    assert found.on_data == ("C1 at 0 %",)


def test_nothing_may_hang_on_a_prior():
    found = PriorSensitivity((row("C1 at 0 %", 0.01, 0.2), row("volume ratio", 0.02, 0.2)))
    assert found.on_priors == ()
    assert found.on_data == ("C1 at 0 %", "volume ratio")


# ---- a chain for the tests


class _Theta:
    """Stands in for a model with one parameter and one reading."""

    def __init__(self, prior_sd, readings_sd):
        self.table = ParameterTable((Parameter("theta", Normal(0.0, prior_sd), "–", "mean"),))
        self.readings_sd = readings_sd

    def log_likelihood(self, values):
        return {"reading": norm.logpdf(1.0, values["theta"], self.readings_sd)[:, None]}


def theta_model(*, prior_sd, readings_sd):
    vectors = draws_of(*posterior(prior_sd, readings_sd))[:, :2000, None, None]
    return _Theta(prior_sd, readings_sd), Chain(vectors, np.zeros((4, 2000, 1)), np.full(4, 0.4))


def possible_chain(model):
    draws = draws_near_truth(model, 8000)
    draws = draws[np.isfinite(model.log_prob(draws))][:2000]
    vectors = draws.reshape(4, 500, 1, -1)
    return Chain(vectors, np.zeros((4, 500, 1)), np.full(4, 0.4))


@pytest.mark.parametrize("file", ["moisture.csv", "shrinkage.csv"])
def test_a_study_of_film_masses_alone_hangs_on_priors_and_nothing_else(tmp_path, file):
    """Its model has no likelihood: once the transposed weights of nothing ended the stage."""
    tables = {
        "moisture.csv": "film_id,time_h,mass_equilibrated_g,mass_dry_g\na,0,2.0,1.7\nb,9,2.1,1.8\n",
        "shrinkage.csv": "film_id,mass_poured_g,mass_cured_g,mass_conditioned_g\na,10,6.5,6.2\n",
    }
    (tmp_path / "study.toml").write_text("")
    (tmp_path / file).write_text(tables[file])
    model = assemble(read_study(tmp_path)).model
    vectors = model.table.sample(np.random.default_rng(1), 800).reshape(4, 20, 10, -1)
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(4, 0.4))
    rows = prior_sensitivity(model, chain).rows
    assert rows
    assert max(max(row.likelihood, row.likelihood_noise) for row in rows) < 1e-6
    assert {row.rests_on for row in rows} == {""}
    assert {row.diagnosis for row in rows} <= {Diagnosis.PRIOR, Diagnosis.NEITHER}
