"""A calibrated model becomes a verdict: what is asked of it, and what joins the model."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.analysis import judge as judging
from bayesdeg.analysis import refuting
from bayesdeg.analysis.calibrate import Fit, base_of
from bayesdeg.analysis.designs import candidate_experiments
from bayesdeg.analysis.judge import (
    JUDGE_EFFORTS,
    extended_model,
    extension,
    judge,
    judge_briefly,
    label,
    readings_misfit,
    with_sampled_sizes,
)
from bayesdeg.assembly.assemble import Assembly
from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.decide.support import INSEPARABLE, Support
from bayesdeg.criticism.decide.verdict import Decision
from bayesdeg.criticism.fit.search import SearchEffort
from bayesdeg.criticism.fit.trials import DECIDING
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.criticism.posterior.convergence import diagnose
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.pages.left_out import Guard
from bayesdeg.priors import LogNormal, Normal, with_priors
from bayesdeg.progress import Silent
from tests.criticism.linear_case import tight_model, with_known_scatter
from tests.inference.small_study import TRUTH, altered, values_of
from tests.surrogate.closed_form import trained

EFFORT = SearchEffort(replicates=60, fitted=2, pairs=1, levels_out=True)
CAUSES = tuple(find(name) for name in ("pressure_offset", "erosion", "paper_softening"))
UNJUDGED = {"creep": "actuator.csv does not record time_s"}


def model_with(**effect):
    """Six actuators whose material is known, with an effect of the catalogue in their readings."""
    model = with_known_scatter(altered(tight_model(), tensile=None, breaks=None, statistics=()))
    known = {
        name: Normal(TRUTH[name], 0.02) if "ratio" in name else LogNormal(TRUTH[name], 0.03)
        for name in model.table.names
        if name.startswith(("c1_", "c2_", "c3_", "elongation_at", "volume", "paper"))
    }
    known["volume_ratio"] = Normal(TRUTH["volume_ratio"], 0.01)
    model = altered(model, base=with_priors(model.base, known), forward=trained())
    active = model.extended(*(find(name.split(".")[0]) for name in effect))
    values = values_of() | {name: np.array([size]) for name, size in effect.items()}
    return model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                active.data_of(Curvature).drawn(active.tests(values), np.random.default_rng(4))[0]
            ),
            model.base,
        )
    )


def fit_of(model, seed=0):
    """A fit whose chain holds independent draws."""
    generator = np.random.default_rng(seed)
    laplace = approximate(model, generator, start=model.table.vectors(values_of())[0])
    posterior = about_mode(model, laplace, generator)
    draws = posterior.resample(generator, 800).reshape(4, 10, 20, -1)
    log_prob = model.log_prob(draws.reshape(800, -1)).reshape(4, 10, 20)
    chain = Chain(draws, log_prob, np.full(4, 0.4))
    return Fit(model, laplace, posterior, chain, diagnose(model, chain, EFFORTS["quick"]))


class Watched(Silent):
    def __init__(self):
        self.stages, self.notes = [], []

    def stage(self, name, total=None):
        self.stages.append(name)

    def advance(self, steps=1.0, note=""):
        self.notes.append(note)


def judged(model, progress=None):
    assembly = Assembly(model, CAUSES, UNJUDGED, ())
    return judge(
        assembly,
        base_of(fit_of(model)),
        effort=EFFORT,
        seed=np.random.SeedSequence(5),
        progress=progress or Silent(),
    )


@pytest.fixture(scope="module")
def shifted():
    """A sensor that reads 12 kPa too much."""
    progress = Watched()
    return judged(model_with(**{"pressure_offset.offset": 12.0}), progress), progress


@pytest.fixture(scope="module")
def fine():
    return judged(model_with())


def test_a_planted_offset_is_named_with_its_size(shifted):
    judgement, _ = shifted
    assert judgement.decision.outcome is Outcome.NAMED
    assert judgement.decision.causes == ("pressure_offset",)
    assert judgement.misfit.p_value < 0.05 < judgement.left.p_value
    best = judgement.candidates[0]
    assert best.cause == "pressure_offset"
    size = best.effect["offset"]
    assert abs(size.mean) == pytest.approx(12.0, abs=4.0 * size.sd)
    assert best.log_bayes_factor > judgement.threshold
    assert best.elpd_diff > best.elpd_diff_se


@pytest.mark.parametrize(
    ("effect", "outcome", "causes"),
    [
        ({"pressure_offset.offset": 12.0}, Outcome.NAMED, ("pressure_offset",)),
        ({}, Outcome.ADEQUATE, ()),
    ],
)
def test_a_brief_verdict_holds_nothing_out(effect, outcome, causes, monkeypatch):
    def held_out(*_args, **_options):
        raise AssertionError

    monkeypatch.setattr(refuting, "held_out_and_all", held_out)
    base = base_of(fit_of(model_with(**effect)))
    assembly = Assembly(base.subject, CAUSES, UNJUDGED, ())
    found = judge_briefly(assembly, base, seed=np.random.SeedSequence(5))
    assert (found.outcome, found.causes) == (outcome, causes)


def test_candidates_that_could_not_be_judged_come_last_with_the_reason(shifted):
    judgement, _ = shifted
    names = [c.cause for c in judgement.candidates]
    assert set(names) == {"pressure_offset", "erosion", "paper_softening", "creep"}
    last = judgement.candidates[-1]
    assert (last.cause, last.why) == ("creep", UNJUDGED["creep"])
    assert last.log_bayes_factor is None


def test_specimens_and_levels_are_held_out_of_the_base_and_the_extended_model(shifted):
    judgement, _ = shifted
    assert list(judgement.held_out) == ["base", "base+pressure_offset"]
    assert list(judgement.levels_out) == ["base", "base+pressure_offset"]
    for found in (*judgement.held_out.values(), *judgement.levels_out.values()):
        assert found.log_density.shape == (6,)
        assert np.all(np.isfinite(found.log_density))
        assert np.all(np.isfinite(found.draws))


def test_the_named_cause_joins_the_model_with_a_start_near_its_mode(shifted):
    judgement, _ = shifted
    model, start = extended_model(judgement)
    assert [c.name for c in model.causes] == ["pressure_offset"]
    assert np.isfinite(model.log_prob(start[None])[0])
    size = model.table.named(start[None])["pressure_offset.offset"][0]
    assert abs(size) == pytest.approx(12.0, abs=4.0)


def test_sizes_of_named_causes_are_replaced_by_sampled_ones(shifted):
    judgement, _ = shifted
    model, start = extended_model(judgement)
    column = model.table.names.index("pressure_offset.offset")
    vectors = np.tile(start, (2, 50, 4, 1))
    vectors[..., column] = np.random.default_rng(6).normal(9.0, 0.5, (2, 50, 4))
    chain = Chain(vectors, np.zeros((2, 50, 4)), np.full(2, 0.4))
    final = replace(fit_of(judgement.search.base.subject), model=model, chain=chain)
    best, *others = with_sampled_sizes(judgement, final).candidates
    assert best.effect["offset"].mean == pytest.approx(9.0, abs=0.2)
    assert best.effect["offset"].unit == "kPa"
    assert others == list(judgement.candidates[1:])
    far = replace(final.diagnosis, r_hat=(1.3,) * len(model.table))
    unsettled = with_sampled_sizes(judgement, replace(final, diagnosis=far))
    assert unsettled.decision.outcome == "not_judged"
    assert unsettled.predicted_with == ()


def test_what_is_left_of_the_residuals_is_smaller_than_they_were(shifted):
    before, after = readings_misfit(shifted[0])
    assert 0.0 < after < 0.7 * before


def test_the_work_is_shown(shifted):
    judgement, progress = shifted
    assert any("misfit" in name for name in progress.stages)
    assert any("held-out" in name for name in progress.stages)
    fitted = {names for names in judgement.search.trials if names}
    assert {" and ".join(sorted(names)) for names in fitted} <= set(progress.notes)


def test_without_an_effect_the_model_is_adequate_and_nothing_joins_it(fine):
    assert fine.decision == Decision(Outcome.ADEQUATE, ())
    assert fine.supported == ()
    assert extended_model(fine) is None
    assert list(fine.held_out) == ["base"]
    assert fine.levels_out == {}
    assert fine.misfit.p_value > 0.02
    assert fine.experiments == ()


def test_ruptures_are_judged_where_there_is_a_limit(fine):
    assert fine.rupture is not None
    assert fine.rupture.burst == 0
    assert fine.rupture.p_value > 0.05


def test_a_final_model_holds_all_that_is_favoured_if_any_is_named():
    two = (Support("creep", 9.0, 4.0, 1.0, {}, 0.3), Support("erosion", 5.0, 2.0, 1.0, {}, 0.3))
    ambiguous = Decision(Outcome.AMBIGUOUS, ("creep", "erosion", "gravity"))
    assert extension(ambiguous, two) == {"creep", "erosion"}
    assert extension(Decision(Outcome.UNEXPLAINED, ()), two) == frozenset()


@pytest.mark.parametrize(("gain", "times"), [(1.5, 2), (9.0, 1)])
def test_specimens_are_held_out_again_where_draws_may_decide(shifted, monkeypatch, gain, times):
    judgement, _ = shifted
    search = replace(judgement.search, trials=dict(judgement.search.trials))
    chosen, held = frozenset({"pressure_offset"}), []
    monkeypatch.setattr(
        refuting,
        "held_out_and_all",
        lambda search, *_, **__: (held.append(search.trials[chosen]) or {}, {}),
    )
    one = Support("pressure_offset", 40.0, gain, 1.0, {}, 0.3)
    monkeypatch.setattr(refuting, "supports", lambda *_: [one])
    known = np.random.SeedSequence(1)
    assembly = Assembly(search.base.subject, CAUSES, UNJUDGED, ())
    tests = refuting.RefutingTests(search, assembly, known, Silent(), Guard(strict=True))
    tests.supported(chosen)
    assert [trial.settled_by for trial in held] == [0, DECIDING][:times]
    assert search.factor(frozenset()) == 0.0


def test_experiments_are_sought_to_tell_the_causes_of_an_ambiguous_outcome_apart(
    shifted, monkeypatch
):
    """Also where an implausible size widens the margin within which a rival is as good."""
    judgement, _ = shifted
    asked = []
    monkeypatch.setattr(judging, "rank", lambda trials, *_, **__: asked.append(trials) or ())
    search = replace(judgement.search, trials=dict(judgement.search.trials))
    known = search.trials[frozenset({"pressure_offset"})]
    search.trials[frozenset({"erosion"})] = known
    one = Support("pressure_offset", 40.0, 9.0, 1.0, {"erosion": 1.5 * INSEPARABLE}, 1e-4)
    assert one.inseparable == ("erosion",)
    ambiguous = Decision(Outcome.AMBIGUOUS, ("pressure_offset", "erosion"))
    assembly = Assembly(search.base.subject, CAUSES, UNJUDGED, ())
    judging._next(search, ambiguous, ([one], None), assembly, np.random.default_rng(1))
    assert asked == [[known, search.trials[frozenset({"erosion"})]]]


def test_causes_that_no_proposal_could_show_do_not_take_the_place_of_others(shifted):
    """No proposal is of a drier room; batches and warmth come after what leaves a misfit."""
    judgement, _ = shifted
    proposals = candidate_experiments(judgement.search.base.subject)
    recorded = ("batch_stiffness", "temperature_softening", "dry_embrittlement")
    shown = judging._shown_by(proposals, (*recorded, "creep", "no cause", "gravity"))
    assert [cause.name for cause in shown] == ["creep", "gravity", "batch_stiffness"]
    others = judging._shown_by(proposals, (*recorded, "creep", "mullins", "gravity"))
    assert [cause.name for cause in others] == ["creep", "mullins", "gravity"]


def test_models_are_labelled_by_their_causes_in_alphabetical_order():
    assert label(frozenset()) == "base"
    assert label(frozenset({"stress_measure", "creep"})) == "base+creep+stress_measure"


def test_more_effort_is_never_less():
    quick, standard, thorough = (JUDGE_EFFORTS[name] for name in ("quick", "standard", "thorough"))
    for low, high in ((quick, standard), (standard, thorough)):
        assert low.replicates < high.replicates
        assert low.fitted <= high.fitted
        assert low.pairs <= high.pairs
