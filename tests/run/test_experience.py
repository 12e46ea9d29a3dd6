"""What a setting may rest on: pressures that were tested, and where actuators burst."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.pages.record import BurstEntry, ModelEntry, RunRecord
from bayesdeg.prediction.experience import NEAR, Experience, experience_of
from bayesdeg.prediction.stored import model_document
from tests.inference.small_study import actuator_curves, altered, small_model
from tests.run.study_files import study_in


def test_recorded_ruptures_are_those_of_the_curves():
    curves = actuator_curves()
    ruptured = curves.ruptured.copy()
    ruptured[4, 4], ruptured[3, 0] = True, True
    model = altered(small_model(), actuator=replace(curves, ruptured=ruptured))
    found = model_document(model).bursts
    assert [(b.degradation_pct, b.pressure_kPa, b.survived_kPa) for b in found] == [
        (14.0, 20.0, None),
        (24.0, 100.0, 80.0),
    ]
    known = experience_of(model_document(model))
    assert (known.pressure, known.rate) == (140.0, 24.0)
    asked = (0.0, 14.0 - NEAR, 14.0 + NEAR, 17.0, 24.0 - NEAR, 30.0)
    assert [known.ceiling(rate) for rate in asked] == [140.0, 0.0, 0.0, 140.0, 80.0, 80.0]


def test_published_counts_are_known_and_lower_nothing(tmp_path):
    """At which pressures they burst is not published: only that it was before the largest."""
    study = study_in(tmp_path)
    rows = [
        {"quantity": name, "degradation_pct": level, "value": value, "source": "a paper"}
        for name, level, value in (
            *(("ruptured_count", 0.0, 0.0), ("ruptured_count", 25.0, 2.0)),
            ("tested_count", 25.0, 3.0),
        )
    ]
    study = replace(
        study,
        summary=study.summary.iloc[:0]
        .reindex(range(3))
        .assign(**{name: [row[name] for row in rows] for name in rows[0]}),
    )
    entry = model_document(assemble(study).model, study)
    [burst] = entry.bursts
    assert (burst.degradation_pct, burst.burst, burst.tested) == (25.0, 2.0, 3.0)
    assert (burst.pressure_kPa, burst.source) == (None, "a paper")
    known = experience_of(entry)
    assert known.near(24.0) == (burst,)
    assert known.near(10.0) == ()
    assert known.ceiling(25.0) == known.pressure == 120.0


def test_records_of_older_runs_bound_pressures_too():
    """They do not list ruptures; without actuators the published protocol says how far tests go."""
    read = RunRecord.read({"title": "old", "model": {"measured": {"pressure_kPa": [20, 240]}}})
    assert experience_of(read.model) == Experience(240.0, 100.0)
    assert experience_of(ModelEntry(largest_pressure_kPa=200.0)).ceiling(25.0) == 200.0


@pytest.mark.parametrize("rate", np.linspace(0.0, 100.0, 11))
def test_nothing_is_allowed_above_what_was_tested(rate):
    burst = BurstEntry(degradation_pct=10.0, burst=1, pressure_kPa=300.0, survived_kPa=280.0)
    assert Experience(240.0, 25.0, (burst,)).ceiling(rate) <= 240.0
