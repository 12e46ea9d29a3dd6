"""Published counts are held against a model, and become its data with a cause of rupture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bayesdeg as bd
from bayesdeg.data.study import read_study
from bayesdeg.observations.counts import RuptureCounts, demand_of
from bayesdeg.observations.kinds import State

STUDY = Path(__file__).parents[2] / "studies" / "gelatin_actuator"


@pytest.fixture(scope="module")
def experiment():
    return bd.Model(read_study(STUDY))


def with_causes(experiment, *names):
    return experiment.with_causes(*names).density


def test_the_base_model_is_not_fitted_to_them(experiment):
    assert experiment.assembly.counts.tests.ruptured.tolist() == [0, 0, 0, 0, 0, 2]
    assert experiment.density.of_kind(RuptureCounts) == ()
    assert with_causes(experiment, "pressure_offset").of_kind(RuptureCounts) == ()


@pytest.mark.parametrize("name", ["flaw_embrittlement", "dry_embrittlement", "uneven_degradation"])
def test_a_model_with_a_cause_of_rupture_is(experiment, name):
    [counts] = with_causes(experiment, "pressure_offset", name).of_kind(RuptureCounts)
    assert counts is experiment.assembly.counts


def test_a_cause_of_rupture_that_readings_show_makes_them_data_too(experiment):
    """As when actuators of the study's own burst: its run fits what `Model.with_causes` is."""
    assembly, flaws = experiment.assembly, experiment.cause("flaw_embrittlement")
    of_readings = assembly.model.extended(flaws)
    assert of_readings.of_kind(RuptureCounts) == ()
    assert assembly.with_its_counts(of_readings) == assembly.extended(flaws)
    assert assembly.with_its_counts(assembly.model) is assembly.model
    without = replace(assembly, counts=None)
    assert without.extended(flaws).of_kind(RuptureCounts) == ()


def test_each_cause_of_a_study_is_known_once_with_the_priors_it_states(experiment):
    named = [cause.name for cause in experiment.assembly.causes]
    assert len(named) == len(set(named))
    assert "dry_embrittlement" in named
    for cause in experiment.assembly.of_counts:
        assert experiment.cause(cause.name) == cause


def test_a_list_of_candidates_holds_for_counts_too(experiment):
    narrowed = experiment.with_candidates(["pressure_offset", "flaw_embrittlement"])
    assert [cause.name for cause in narrowed.of_counts] == ["flaw_embrittlement"]


def test_causes_that_counts_may_show_need_no_columns(experiment):
    names = [cause.name for cause in experiment.assembly.of_counts]
    assert names == ["dry_embrittlement", "flaw_embrittlement", "uneven_degradation"]
    assert "dry_embrittlement" in experiment.assembly.unjudged


def test_where_actuators_balloon_before_the_counted_pressure_the_density_leads_back(experiment):
    """The sensor reads far too little: fresh actuators are beyond what the emulator answers."""
    density = with_causes(experiment, "pressure_offset", "flaw_embrittlement")
    values = {p.name: np.array(p.law.quantile(np.array([0.5]))) for p in density.table.parameters}
    steps = np.array([-20.0, -180.0, -200.0, -220.0])
    far = {name: np.repeat(v, len(steps)) for name, v in values.items()}
    far |= {"pressure_offset.offset": steps}
    state = density.state(far)
    [counts] = density.of_kind(RuptureCounts)
    excess = demand_of(state, counts.tests).excess.max(axis=1)
    assert excess[0] == 0.0
    assert np.all(np.diff(excess) > 0.0)
    assert np.all(np.isfinite(counts.log_likelihood(state)))
    # where there is an answer both worlds agree
    plain = State({n: v[:1] for n, v in far.items()}, density.world, density.causes)
    inside = counts.log_likelihood(state)[:1]
    np.testing.assert_allclose(counts.log_likelihood(plain), inside, rtol=1e-12)
