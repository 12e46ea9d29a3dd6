"""Published counts are held against a model, and become its data with a cause of rupture."""

from pathlib import Path

import pytest

from bayesdeg.data.study import read_study
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.experiment import ModelledExperiment

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_actuator"


@pytest.fixture(scope="module")
def experiment():
    study = read_study(STUDY)
    return ModelledExperiment(study, assemble(study))


def with_causes(experiment, *names):
    causes = tuple(experiment.cause(name) for name in names)
    return ModelledExperiment(experiment.study, experiment.assembly, causes).density


def test_the_base_model_is_not_fitted_to_them(experiment):
    assert experiment.assembly.counts.tests.ruptured.tolist() == [0, 0, 0, 0, 0, 2]
    assert experiment.density.of_kind(RuptureCounts) == ()
    assert with_causes(experiment, "pressure_offset").of_kind(RuptureCounts) == ()


@pytest.mark.parametrize("name", ["flaw_embrittlement", "dry_embrittlement"])
def test_a_model_with_a_cause_of_rupture_is(experiment, name):
    [counts] = with_causes(experiment, "pressure_offset", name).of_kind(RuptureCounts)
    assert counts is experiment.assembly.counts


def test_causes_that_counts_may_show_need_no_columns(experiment):
    names = [cause.name for cause in experiment.assembly.of_counts]
    assert names == ["dry_embrittlement", "flaw_embrittlement"]
    assert "dry_embrittlement" in experiment.assembly.unjudged
