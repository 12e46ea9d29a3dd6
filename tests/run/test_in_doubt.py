"""What a run writes beside its verdict of readings and parameters that are in doubt."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from bayesdeg.criticism.checks.absorption import Absorption, Push
from bayesdeg.criticism.decide.verdict import NotConverged
from bayesdeg.criticism.findings import Displacement
from bayesdeg.data.study import read_study
from bayesdeg.inference.sampling import Chain
from bayesdeg.pages.headline import doubts_of
from bayesdeg.pages.record import InDoubt, VerdictRecord
from bayesdeg.priors import LogNormal, with_priors
from bayesdeg.run.record import in_doubt
from tests.inference.small_study import altered, draws_near_truth, small_model

STUDY = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"


def results(absorbed=None, study=None, **priors):
    """A calibration near the truth of the small study, under some other priors."""
    study = study or read_study(STUDY)
    model = small_model()
    values = model.table.named(draws_near_truth(model, 200))
    stated = altered(model, base=with_priors(model.base, priors))
    vectors = stated.table.vectors(values).reshape(4, 50, 1, -1)
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(4))
    return SimpleNamespace(
        final=SimpleNamespace(model=stated, chain=chain),
        fits={},
        assembly=SimpleNamespace(
            model=stated, aside=(), study=study, whole=study, beyond=(), answers=None
        ),
        with_suspects=None,
        judgement=SimpleNamespace(absorbed=absorbed, decision=SimpleNamespace(reasons=())),
    )


def test_a_sound_study_near_its_priors_is_in_no_doubt():
    found = in_doubt(results())
    assert found == InDoubt()


def test_a_final_model_whose_sampler_failed_is_said():
    judged = results()
    judged.judgement.decision.reasons = (NotConverged("model with the causes", 1.8, 12.0),)
    [said] = in_doubt(judged).not_converged
    assert "1.80" in said


def test_an_odd_film_and_a_value_off_its_prior_reach_the_reader():
    study = read_study(STUDY)
    films = study.tensile.copy()
    films.loc[films["specimen_id"] == "F10-2", "stress_MPa"] *= 10.0
    odd = replace(study, tensile=films)
    found = in_doubt(results(study=odd, paper_stiffness=LogNormal(3e5, 0.3)))
    [suspect], [question] = found.suspects, found.parameters_in_question
    assert (suspect.file, suspect.specimen) == ("tensile.csv", "F10-2")
    assert (suspect.column, suspect.value) == ("stress_MPa", "2.7686")
    assert question.parameter == "paper_stiffness"
    assert question.unit == "N/m"
    assert question.median < question.prior_low < 3e5 < question.prior_high
    assert 0.0 < question.p_value < 0.02
    said = doubts_of(VerdictRecord.read({"outcome": "adequate"} | found.document()))
    assert len(said) == 2
    assert said[0] == suspect.why
    assert np.all(["Paper stiffness" in said[1], "N/m" in said[1]])


def test_what_pushed_a_parameter_in_question_stands_with_it():
    prior = LogNormal(3e5, 0.3)
    stiff = Displacement(parameter="paper_stiffness", unit="N/m", moved_sd=-7.5, learned=0.9)
    pushes = (
        Push(("paper_slack",), 30.0, {"paper_stiffness": -7.0}),
        Push(("creep",), 2.0, {"paper_stiffness": -7.5}),
    )
    absorbed = Absorption((stiff,), pushes)
    [question] = in_doubt(results(absorbed, paper_stiffness=prior)).parameters_in_question
    assert question.displacement == -7.5
    assert question.pushed_by == (("paper_slack",),)
    [plain] = in_doubt(results(paper_stiffness=prior)).parameters_in_question
    assert {"displacement", "pushed_by"} & set(plain.model_dump()) == set()
    assert plain.median == question.median
