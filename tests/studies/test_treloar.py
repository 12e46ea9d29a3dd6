"""Real rubber: what three modes of tension name, and what one of them cannot.

Data: Treloar (1944), doi:10.1039/TF9444000059.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.checks.residuals import where_films
from bayesdeg.criticism.decide.support import as_it_is, hold_out_each
from bayesdeg.criticism.holdout.gain import mode_table
from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.data.study import read_study
from bayesdeg.pages.wording import fixed, worded
from bayesdeg.priors import Normal, Parameter
from bayesdeg.quantities import p_value_text
from bayesdeg.run.record import verdict_document
from tests.hidden_effects.judging import judged

pytestmark = pytest.mark.slow

STUDIES = Path(__file__).resolve().parents[2] / "studies"
SEEDS = range(1, 7)
ALIKE = ("second_invariant", "stress_measure")
BASE, ROOT, MOONEY = frozenset(), frozenset({"second_invariant"}), frozenset({"mooney"})


def assembled(name):
    return assemble(read_study(STUDIES / name))


@pytest.fixture(scope="module")
def uniaxial():
    """Verdicts on one mode, by seed."""
    assembly = assembled("treloar_uniaxial")
    return {seed: judged(assembly, seed=seed) for seed in SEEDS}


@pytest.fixture(scope="module")
def full():
    """Verdicts on all modes, by seed."""
    assembly = assembled("treloar")
    return {seed: judged(assembly, seed=seed) for seed in SEEDS}


def document(judgement):
    where = worded(where_films(judgement.search.base.linear))
    return verdict_document(judgement, where).document()


@pytest.mark.parametrize("seed", SEEDS)
def test_one_mode_names_nothing_whatever_the_seed(uniaxial, seed):
    """The cubic law misses the curve, and what is wrong a single mode cannot say."""
    found = uniaxial[seed]
    assert found.decision.outcome is Outcome.AMBIGUOUS
    assert found.decision.causes == ALIKE
    assert found.supported == ()
    assert found.misfit.p_value <= MISFIT_LEVEL
    # enough data sets were simulated for the p-value not to hang on the seed
    assert len(found.misfit.null) > 1000


def test_one_mode_lists_what_it_cannot_show_with_the_reason(uniaxial):
    told = document(uniaxial[1])
    entries = {entry["cause"]: entry for entry in told["candidates"]}
    for name in ALIKE:
        assert entries[name]["probability"] is None
        assert "only (uniaxial)" in entries[name]["why"]
        assert name in told["explanation"]
    assert told["outcome"] == "ambiguous"


def test_the_experiment_proposed_to_one_mode_is_a_second_mode(uniaxial):
    designs = [entry.design for entry in uniaxial[1].experiments]
    assert designs
    assert all(design.startswith(("equibiaxial", "planar")) for design in designs)


@pytest.mark.parametrize("seed", SEEDS)
def test_all_modes_name_the_second_invariant_whatever_the_seed(full, seed):
    found = full[seed]
    assert found.decision.outcome is Outcome.NAMED
    assert found.decision.causes == ("second_invariant",)
    size = found.candidates[0].effect["ratio"]
    assert size.q05 < 0.64 < size.q95


def test_each_held_out_mode_is_told_by_itself(full):
    """Equibiaxial tension gains most, which the pooled error of all modes hides."""
    found = full[1]
    table = mode_table(found.search.base.subject, found.held_out)
    error = table.pivot(index="mode", columns="model", values="rmse_MPa")
    after, before = error["base+second_invariant"], error["base"]
    assert before["equibiaxial"] == pytest.approx(0.20, abs=0.02)
    assert after["equibiaxial"] == pytest.approx(0.05, abs=0.015)
    assert np.all(after < before)
    ends = (fixed(before["equibiaxial"], 3), fixed(after["equibiaxial"], 3))
    assert "from {} to {} MPa in equibiaxial".format(*ends) in document(found)["explanation"]


def test_what_is_left_after_naming_is_said_where_it_is_no_chance(full):
    found = full[1]
    assert found.left.p_value <= MISFIT_LEVEL
    fine = replace(found, left=replace(found.left, p_value=0.3))
    said, short = document(found)["explanation"], document(fine)["explanation"]
    assert said.startswith(short)
    assert p_value_text(found.left.p_value, len(found.left.null)) in said.removeprefix(short)


def add_second_invariant(stress, films, effect, constants):
    """Return nominal stresses with those of C01 (I₂ − 3): C01 ∂I₂/∂λ, by half if equibiaxial."""
    stretch, mode = films.stretch, films.mode[:, None]
    basis = np.select(
        [mode == "uniaxial", mode == "equibiaxial"],
        [2.0 - 2.0 * stretch**-3, 2.0 * stretch**3 - 2.0 * stretch**-3],
        2.0 * stretch - 2.0 * stretch**-3,
    )
    return stress + effect["ratio"] * constants[..., :1] * basis


LINEAR_TERM = Cause(
    name="mooney",
    stage=Stage.MATERIAL,
    parameters=(Parameter("ratio", Normal(0.0, 0.5), "–", "C01 over C1", 0.0),),
    mechanism="the energy has a term C01 (I₂ − 3), which is linear in the second invariant",
    typical={"ratio": 0.2},
    revealed_by="films in a second mode",
    on_stress=add_second_invariant,
)


@pytest.fixture(scope="module")
def with_rival():
    """All modes, with the term that least squares prefers to none as a rival."""
    assembly = assembled("treloar")
    return judged(replace(assembly, candidates=(*assembly.candidates, LINEAR_TERM)))


def test_a_term_linear_in_the_second_invariant_is_not_preferred(with_rival):
    assert with_rival.decision.causes == ("second_invariant",)
    assert with_rival.decision.one_of == ()
    factors = {c.cause: c.log_bayes_factor for c in with_rival.candidates}
    assert factors["mooney"] < 0.0 < factors["second_invariant"]


def test_a_term_linear_in_the_second_invariant_fails_on_held_out_equibiaxial_tension(with_rival):
    search = with_rival.search
    search.fit(BASE, ["mooney"])
    assert search.factor(MOONEY) < search.factor(BASE) < search.factor(ROOT)
    held_out = {}
    for names in (MOONEY, ROOT):
        [found] = hold_out_each(search, names, [as_it_is], seed=np.random.SeedSequence(2))
        held_out |= found
    subject = search.base.subject
    mode = subject.groups.index("equibiaxial")
    rows = subject.group == "equibiaxial"
    error = {
        names: np.sqrt(np.mean((subject.observed - one.mean)[rows] ** 2))
        for names, one in held_out.items()
    }
    density = {names: one.log_density[mode] for names, one in held_out.items()}
    assert error[ROOT] < 0.5 * error[BASE]
    assert error[MOONEY] > 3.0 * error[BASE]
    assert density[MOONEY] < density[BASE] < density[ROOT]
