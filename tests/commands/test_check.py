"""What ``bayesdeg check`` says of columns that cannot be what their names say."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

TIMES = ("before", "after")
STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture
def check(bayesdeg, tmp_path, monkeypatch):
    """Check a shipped study, columns of whose files were changed; gives exit code and output."""
    monkeypatch.chdir(tmp_path)

    def run(name, *, command="check", **changes):
        made = Path(shutil.copytree(STUDIES / name, "study"))
        for table, change in changes.items():
            frame = pd.read_csv(made / f"{table}.csv", comment="#")
            change(frame).to_csv(made / f"{table}.csv", index=False)
        code, *said = bayesdeg(command, made)
        return code, "".join(said)

    return run


@pytest.mark.parametrize("name", ["gelatin_actuator", "treloar", "treloar_uniaxial"])
def test_a_shipped_study_is_in_no_doubt(name, check):
    code, said = check(name)
    assert code == 0
    assert "doubt" not in said


@pytest.mark.parametrize("command", ["check", "run"])
def test_an_angle_57_times_too_large_is_refused_at_once(command, check, tmp_path):
    """It once gave no verdict in eight minutes."""
    code, said = check(
        "gelatin_actuator",
        command=command,
        actuator=lambda rows: rows.assign(bend_angle_deg=57.296 * rows["bend_angle_deg"]),
    )
    assert code == 2
    assert len(said.strip().splitlines()) == 1
    assert "column bend_angle_deg, value '4645.79'" in said
    assert "57.4 times" in said
    assert "180/π" in said
    assert not (tmp_path / "reports").exists()


def test_all_that_is_impossible_is_refused_together(check):
    code, said = check(
        "gelatin_actuator",
        tensile=lambda rows: rows.assign(stress_MPa=-rows["stress_MPa"]),
        actuator=lambda rows: rows.assign(bend_angle_deg=rows["bend_angle_deg"] / 57.296),
    )
    assert code == 2
    first, second = said.strip().splitlines()
    for part in ("tensile.csv", "specimen 'F00-1'", "column stress_MPa", "value '-0.2123'"):
        assert part in first
    assert "likely in radians" in second


def test_one_actuator_with_ten_times_the_pressure_is_named_and_not_refused(check):
    def slip(rows):
        factor = rows["specimen_id"].eq("A10-2").map({True: 10.0, False: 1.0})
        return rows.assign(pressure_kPa=factor * rows["pressure_kPa"])

    code, said = check("gelatin_actuator", actuator=slip)
    assert code == 0
    assert "1 in doubt" in said
    [line] = [line for line in said.splitlines() if line.startswith("in doubt:")]
    assert "specimen 'A10-2', column pressure_kPa, value '2400'" in line


def test_specimens_are_counted_by_file_and_what_looks_alike_is_in_doubt(check):
    def renamed(rows):
        half = (rows["specimen_id"] == "A00-1") & (rows["pressure_kPa"] > 120.0)
        return rows.assign(specimen_id=rows["specimen_id"].mask(half, "a00-1"))

    code, said = check("gelatin_actuator", actuator=renamed)
    assert code == 0
    rows = {line.split()[1]: line.split() for line in said.splitlines() if ".csv" in line}
    assert rows["actuator.csv"][-3:-1] == ["19", "specimens"]
    assert rows["moisture.csv"][-3:-1] == ["63", "films"]
    assert "nearly the same" in said
    assert "'a00-1'" in said


def test_both_ways_to_the_volume_ratio_and_the_control_of_eq_6_are_said(bayesdeg, tmp_path):
    states = [f"mass_{state}_{time}_g" for state in ("dry", "equilibrated") for time in TIMES]
    rows = ("a,30,0.60,0.45,0.75,0.54", "b,30,0.60,0.46,0.75,0.552")  # 25 and 20 % of moisture
    made = shutil.copytree(STUDIES / "gelatin_actuator", tmp_path / "made")
    header = ",".join(["specimen_id", "time_min", *states])
    (made / "mass_loss.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    code, *printed = bayesdeg("check", made)
    assert code == 0
    said = "".join(printed)
    used, as_printed, *_ = map(float, re.findall(r"(0\.\d+) ± ", said))
    assert used == pytest.approx(0.586, abs=0.002)
    assert 0.001 < used - as_printed < 0.02
    assert "Eqs 15" in said
    # 25 and 23.3 % of the mass over a rate of 20 %
    assert "1.21 ± 0.042" in said
    assert "0.8574" in said
