"""``[reading] operator`` in the commands: a reminder, a refusal, readings as they are stated."""

from io import StringIO

import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.reading import ReadByOperator, mechanics_of, operator_ratio
from bayesdeg.actuator.status import Resolution
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.commands import simulate
from bayesdeg.pages.record import ModelEntry
from bayesdeg.prediction.stored import as_recorded, model_document
from bayesdeg.records import RecordError
from tests.run.planted_offset import emulator
from tests.run.study_files import SETTINGS, study_in

CIRCLE = '[reading]\noperator = "circle"\n'
ACTUATOR = (
    "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m,bend_angle_deg\n"
    "a0,0,0.5,0,0.0,0.0\na0,0,0.5,80,2.0,6.0\n"
)


@pytest.fixture
def call(monkeypatch, tmp_path, bayesdeg):
    """Run a command on a study with more in its settings; gives the code and what was said."""
    monkeypatch.setattr(simulate, "FINE", Resolution(9.0, 9.0, 9.0))

    def run(more, name, *options):
        study = tmp_path / "study"
        study.mkdir(exist_ok=True)
        study_in(study, {"actuator.csv": ACTUATOR})
        (study / "study.toml").write_text(SETTINGS + more, encoding="utf-8")
        code, *said = bayesdeg(name, study, *options)
        return code, "".join(said)

    return run


def test_check_reminds_of_the_operator_until_it_is_stated(call):
    code, said = call("", "check")
    assert code == 0
    assert "[reading] operator" in said
    code, said = call('[reading]\noperator = "angle_over_arc"\n', "check")
    assert code == 0
    assert "[reading] operator" not in said


@pytest.mark.parametrize("command", ["check", "run", "simulate"])
@pytest.mark.parametrize(
    "mould", ["[actuator]\nlength = 60.0\n", '[constraint]\nkind = "none"\n'], ids=["long", "bare"]
)
def test_another_operator_is_refused_where_its_ratio_is_not_known(call, command, mould, tmp_path):
    options = ("--out", tmp_path / "virtual") if command == "simulate" else ()
    code, said = call(mould + CIRCLE, command, *options)
    assert code == 2
    assert len(said.strip().splitlines()) == 1
    assert {"study.toml,", "reading.operator,", "'\"circle\"':"} <= set(said.split())
    assert not (tmp_path / "virtual").exists()


def test_the_model_predicts_what_is_stated(call, tmp_path):
    call(CIRCLE, "check")
    forward = assemble(read_study(tmp_path / "study"), emulator()).model.world.forward
    assert isinstance(forward, ReadByOperator)
    assert mechanics_of(forward) is not forward
    call("", "check")
    study = read_study(tmp_path / "study")
    assert not isinstance(assemble(study, emulator()).model.world.forward, ReadByOperator)


def test_a_run_folder_keeps_what_its_predictions_are_readings_of(call, tmp_path):
    for more, expected in ((CIRCLE + "points = 12\n", ("circle", 12)), ("", ("", None))):
        call(more, "check")
        study = read_study(tmp_path / "study")
        model = assemble(study, emulator()).model
        entry = model_document(model, study)
        assert (entry.reading_operator, entry.reading_points) == expected
        kept = as_recorded(entry, emulator())
        assert isinstance(kept, ReadByOperator) == (expected[0] == "circle")


@pytest.mark.fem
def test_virtual_readings_are_those_of_the_stated_operator(call, tmp_path):
    tables = []
    for name, more in (("plain", ""), ("circle", CIRCLE)):
        out = tmp_path / name
        code, _ = call(more, "simulate", "--out", out, "--workers", "1", "--quiet")
        assert code == 0
        assert read_study(out).settings.reading.operator == (None if name == "plain" else "circle")
        text = (out / "actuator.csv").read_text("utf-8")
        tables.append(pd.read_csv(StringIO(text), comment="#"))
    plain, circle = (table[table["pressure_kPa"] > 0.0] for table in tables)
    np.testing.assert_array_equal(plain["bend_angle_deg"], circle["bend_angle_deg"])
    ratio, _ = operator_ratio("circle", 50)(
        np.radians(plain["bend_angle_deg"].to_numpy()), np.array(50.0)
    )
    # noise of reading is the same in size, not in proportion
    factor = circle["curvature_per_m"] / plain["curvature_per_m"]
    np.testing.assert_allclose(factor, ratio, rtol=0.02)


@pytest.mark.parametrize(("operator", "points"), [("kappa", 500), ("kappa", 4), ("circle", 1e9)])
def test_numbers_of_points_that_no_operator_reads_are_refused(operator, points):
    entry = ModelEntry.read({"reading_operator": operator, "reading_points": points})
    with pytest.raises(RecordError, match="reading_operator"):
        as_recorded(entry, lambda inputs: pytest.fail("was asked"))
