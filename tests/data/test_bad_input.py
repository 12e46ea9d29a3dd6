from dataclasses import dataclass
from pathlib import Path

import pytest

from bayesdeg.data.study import read_study
from bayesdeg.errors import Fault, StudyError

GOOD = {
    "moisture.csv": """film_id,time_h,mass_equilibrated_g,mass_dry_g
f1,0,1.00,0.80
f2,0,1.02,0.81
f3,8,1.00,0.85
""",
    "mass_loss.csv": """specimen_id,time_min,mass_dry_before_g,mass_dry_after_g,"""
    """mass_equilibrated_before_g,mass_equilibrated_after_g
m1,10,0.50,0.45,0.62,0.55
m2,30,0.51,0.40,0.64,0.47
""",
    "shrinkage.csv": """film_id,mass_poured_g,mass_cured_g,mass_conditioned_g
s1,30,15,10
s2,30.1,15.2,10.1
""",
    "tensile.csv": """# one line of comment
specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure
t1,0,uniaxial,1.0,0.0,nominal
t1,0,uniaxial,1.5,0.4,nominal
t2,5.2,,1.5,0.6,cauchy
""",
    "break.csv": """specimen_id,degradation_pct,elongation_pct
b1,0,209.8
b2,-1.5,205
""",
    "actuator.csv": "specimen_id,degradation_pct,pressure_kPa,curvature_per_m,"
    """cycle,branch,mount,ruptured
a1,0,0,0,1,loading,horizontal,0
a1,0,20,1.5,1,loading,horizontal,0
a1,0,40,3.1,1,loading,horizontal,0
a1,0,20,1.8,1,unloading,horizontal,0
a1,0,0,0.2,1,unloading,horizontal,0
a1,0,20,1.6,2,loading,horizontal,0
a2,25,20,0.4,1,loading,horizontal,0
a2,25,40,,1,loading,horizontal,1
""",
    "summary.csv": """quantity,degradation_pct,value,sd,n,unit,source
young_modulus,0,1.73,0.15,3,MPa,text
r_squared,0,0.984,,,–,text
""",
    "study.toml": 'title = "t"\nseed = 7\n',
}


@dataclass(frozen=True)
class Slip:
    """A good study with one slip in it, and the one fault it should give."""

    file: str
    old: str
    new: str
    row: int | None
    column: str | None
    value: str | None
    says: str


def write(folder: Path, files: dict[str, str | bytes]) -> Path:
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
    return folder


def faults_of(folder: Path) -> tuple[Fault, ...]:
    with pytest.raises(StudyError) as caught:
        read_study(folder)
    return caught.value.faults


SLIPS = {
    "dry mass above the moist one": Slip(
        "mass_loss.csv",
        "0.40,0.64,0.47",
        "0.48,0.64,0.47",
        3,
        "mass_dry_after_g",
        "0.48",
        "is not below mass_equilibrated_after_g; a sample loses mass when it dries",
    ),
    "misspelt column": Slip(
        "tensile.csv", "stretch,", "strech,", 2, "strech", None, "did you mean 'stretch'?"
    ),
    "missing column": Slip(
        "break.csv",
        "specimen_id,degradation_pct,elongation_pct\nb1,0,209.8\nb2,-1.5,205",
        "specimen_id,degradation_pct\nb1,0\nb2,-1.5",
        1,
        "elongation_pct",
        None,
        "is missing",
    ),
    "misspelt optional column": Slip(
        "actuator.csv", ",branch,", ",brnach,", 1, "brnach", None, "did you mean 'branch'?"
    ),
    "stress in kPa": Slip(
        "tensile.csv", "stress_MPa", "stress_kPa", 2, "stress_kPa", None, "in MPa"
    ),
    "pressure in MPa": Slip(
        "actuator.csv", "pressure_kPa", "pressure_MPa", 1, "pressure_MPa", None, "in kPa"
    ),
    "unit in the wrong case": Slip(
        "actuator.csv", "pressure_kPa", "pressure_kpa", 1, "pressure_kpa", None, "pressure_kPa"
    ),
    "no unit": Slip("moisture.csv", "time_h", "time", 1, "time", None, "in h"),
    "column twice": Slip("actuator.csv", ",cycle,", ",branch,", 1, "branch", None, "duplicate"),
    "column without name": Slip("break.csv", "elongation_pct", "", 1, None, None, "no name"),
    "no header": Slip(
        "break.csv",
        "specimen_id,degradation_pct,elongation_pct\n",
        "",
        1,
        None,
        "b1,0,209.8",
        "has no header",
    ),
    "text in a number": Slip(
        "break.csv", "209.8", "209.8 %", 2, "elongation_pct", "209.8 %", "not a number"
    ),
    "letter in a number": Slip(
        "break.csv", "209.8", "2o9", 2, "elongation_pct", "2o9", "not a number"
    ),
    "number too large": Slip(
        "break.csv", "209.8", "1e999", 2, "elongation_pct", "1e999", "too large"
    ),
    "nan": Slip("tensile.csv", "1.5,0.4", "1.5,nan", 4, "stress_MPa", "nan", "not a finite"),
    "inf": Slip("tensile.csv", "1.5,0.4", "1.5,-inf", 4, "stress_MPa", "-inf", "not a finite"),
    "nan in an optional column": Slip(
        "actuator.csv", "3.1,1,", "3.1,NaN,", 4, "cycle", "NaN", "not a finite"
    ),
    "decimal comma in quotes": Slip(
        "break.csv", "209.8", '"209,8"', 2, "elongation_pct", "209,8", "209.8"
    ),
    "decimal comma without quotes": Slip(
        "break.csv", "209.8", "209,8", 2, None, "b1,0,209,8", "too many cells"
    ),
    "thousands separator": Slip(
        "break.csv", "209.8", '"1,209.8"', 2, "elongation_pct", "1,209.8", "write 1209.8"
    ),
    "thousands separator without quotes": Slip(
        "break.csv", "209.8", "1,209.8", 2, None, "b1,0,1,209.8", "no thousands separator"
    ),
    "comma that may be either": Slip(
        "break.csv", "209.8", '"1,209"', 2, "elongation_pct", "1,209", "write 1.209, or 1209"
    ),
    "minus sign of a word processor": Slip(
        "break.csv", "-1.5", "\N{MINUS SIGN}1.5", 3, "degradation_pct", "\N{MINUS SIGN}1.5", "use -"
    ),
    "no header, with cells alike": Slip(
        "tensile.csv",
        "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\nt1,0",
        "t1,0.0",
        2,
        None,
        "t1,0.0,uniaxial,1.0,0.0,nominal",
        "has no header; begin with a line that names the columns: specimen_id,",
    ),
    "header in capitals": Slip(
        "break.csv", "specimen_id", "SPECIMEN_ID", 1, "SPECIMEN_ID", None, "lower case: specimen_id"
    ),
    "capital in a unit's column": Slip(
        "actuator.csv",
        "pressure_kPa",
        "Pressure_kPa",
        1,
        "Pressure_kPa",
        None,
        "lower case but for the unit: pressure_kPa",
    ),
    "column twice but for capitals": Slip(
        "break.csv",
        "elongation_pct\nb1,0,209.8\nb2,-1.5,205",
        "elongation_pct,Elongation_pct\nb1,0,209.8,1\nb2,-1.5,205,1",
        1,
        "Elongation_pct",
        None,
        "remove one of them",
    ),
    "empty degradation rate": Slip(
        "break.csv", "-1.5", "", 3, "degradation_pct", "", "give the degradation rate"
    ),
    "too few cells": Slip("break.csv", "b2,-1.5,205", "b2,-1.5", 3, None, "b2,-1.5", "too few"),
    "negative mass": Slip(
        "moisture.csv", "1.02,0.81", "1.02,-0.81", 3, "mass_dry_g", "-0.81", "not above 0"
    ),
    "negative larger mass": Slip(
        "moisture.csv", "1.02,", "-1.02,", 3, "mass_equilibrated_g", "-1.02", "not above 0"
    ),
    "zero mass": Slip(
        "shrinkage.csv", "30,15,10", "0,15,10", 2, "mass_poured_g", "0", "not above 0"
    ),
    "dry as heavy as moist": Slip(
        "moisture.csv", "1.00,0.85", "0.85,0.85", 4, "mass_dry_g", "0.85", "mass_equilibrated_g"
    ),
    "conditioned above cured": Slip(
        "shrinkage.csv", "30,15,10", "30,15,16", 2, "mass_conditioned_g", "16", "mass_cured_g"
    ),
    "cured above poured": Slip(
        "shrinkage.csv", "30,15,10", "30,31,10", 2, "mass_cured_g", "31", "mass_poured_g"
    ),
    "negative time": Slip("moisture.csv", "f3,8", "f3,-8", 4, "time_h", "-8", "below 0"),
    "stretch of zero": Slip(
        "tensile.csv", "uniaxial,1.0,", "uniaxial,0.0,", 3, "stretch", "0.0", "not above 0"
    ),
    "degradation above 100": Slip(
        "actuator.csv", "a2,25,20", "a2,125,20", 8, "degradation_pct", "125", "above 100"
    ),
    "degradation far below 0": Slip(
        "break.csv", "-1.5", "-5.01", 3, "degradation_pct", "-5.01", "below -5 %"
    ),
    "published degradation below 0": Slip(
        "summary.csv", "young_modulus,0", "young_modulus,-1", 2, "degradation_pct", "-1", "below 0"
    ),
    "repeated row": Slip(
        "tensile.csv",
        "t2,5.2",
        "t1,0,uniaxial,1.5,0.4,nominal\nt2,5.2",
        5,
        None,
        "t1,0,uniaxial,1.5,0.4,nominal",
        "repeats",
    ),
    "repeated row, written otherwise": Slip(
        "actuator.csv",
        "a2,25,20,0.4,1,loading,horizontal,0\n",
        "a2,25,20,0.4,1,loading,horizontal,0\na2,25.0,20,.4,,,,\n",
        9,
        None,
        "a2,25.0,20,.4,,,,",
        "repeats",
    ),
    "film twice": Slip("moisture.csv", "f3,8", "f2,8", 4, "film_id", "f2", "more than one row"),
    "specimen breaks twice": Slip(
        "break.csv", "b2,-1.5", "b1,0", 3, "specimen_id", "b1", "more than one row"
    ),
    "pressure falls while loading": Slip(
        "actuator.csv", "a1,0,40", "a1,0,10", 4, "pressure_kPa", "10", "direction of its branch"
    ),
    "unloading without a branch": Slip(
        "actuator.csv",
        GOOD["actuator.csv"],
        "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
        "a1,0,20,1.5\na1,0,40,3.1\na1,0,60,5\na1,0,60,5.1\na1,0,40,3.3\na1,0,20,1.6\n"
        "a2,0,20,1.5\na2,0,40,3.1\na2,0,20,1.6\n",
        6,
        "pressure_kPa",
        "40",
        "add a column branch",
    ),
    "rate hardly known": Slip(
        "actuator.csv",
        GOOD["actuator.csv"],
        "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m\n"
        "a1,0,60,20,1.5\n",
        2,
        "degradation_sd_pct",
        "60",
        "unknown rate",
    ),
    "unloading film": Slip(
        "tensile.csv",
        "t2,5.2,",
        "t1,0,uniaxial,1.3,0.2,nominal\nt1,0,uniaxial,1.1,0.05,nominal\nt2,5.2,",
        None,
        "stretch",
        None,
        "2 of 5 rows were recorded after the first loading (t1: 2)",
    ),
    "film that is said to unload": Slip(
        "tensile.csv",
        "stress_measure\nt1,0,uniaxial,1.0,0.0,nominal\nt1,0,uniaxial,1.5,0.4,nominal\n"
        "t2,5.2,,1.5,0.6,cauchy",
        "branch\nt1,0,uniaxial,1.0,0.0,loading\nt1,0,uniaxial,1.5,0.4,\nt2,0,,1.5,0.6,Unloading",
        None,
        "branch",
        None,
        "1 of 3 rows was recorded after the first loading (t2: 1)",
    ),
    "pressure stands still": Slip(
        "actuator.csv", "a1,0,40", "a1,0,20", 4, "pressure_kPa", "20", "direction of its branch"
    ),
    "pressure rises while unloading": Slip(
        "actuator.csv", "a1,0,0,0.2", "a1,0,30,0.2", 6, "pressure_kPa", "30", "direction"
    ),
    "two degradation rates": Slip(
        "actuator.csv", "a1,0,20,1.8", "a1,1,20,1.8", 5, "degradation_pct", "1", "same specimen"
    ),
    "empty required cell": Slip(
        "tensile.csv", "t1,0,uniaxial,1.5,0.4", "t1,0,uniaxial,1.5,", 4, "stress_MPa", "", "empty"
    ),
    "empty label": Slip("break.csv", "b2,", ",", 3, "specimen_id", "", "is empty"),
    "empty curvature": Slip(
        "actuator.csv", "20,1.5,", "20,,", 3, "curvature_per_m", "", "has not burst"
    ),
    "text for curvature": Slip(
        "actuator.csv", "20,1.5,", "20,?,", 3, "curvature_per_m", "?", "not a number"
    ),
    "unknown mode": Slip(
        "tensile.csv", "t2,5.2,,", "t2,5.2,biaxial,", 5, "mode", "biaxial", "'equibiaxial'"
    ),
    "unknown stress measure": Slip(
        "tensile.csv", "0.6,cauchy", "0.6,Cauchi", 5, "stress_measure", "Cauchi", "'cauchy'"
    ),
    "unknown branch": Slip(
        "actuator.csv",
        "a1,0,40,3.1,1,loading",
        "a1,0,40,3.1,1,lodaing",
        4,
        "branch",
        "lodaing",
        "'loading'",
    ),
    "unknown mount": Slip(
        "actuator.csv",
        "1.5,1,loading,horizontal",
        "1.5,1,loading,hangin",
        3,
        "mount",
        "hangin",
        "'hanging'",
    ),
    "unknown quantity": Slip(
        "summary.csv",
        "young_modulus",
        "youngs_modulus",
        2,
        "quantity",
        "youngs_modulus",
        "'young_modulus'",
    ),
    "wrong unit of a statistic": Slip(
        "summary.csv", "MPa", "kPa", 2, "unit", "kPa", "not the unit"
    ),
    "r squared above 1": Slip("summary.csv", "0.984", "1.984", 3, "value", "1.984", "above 1"),
    "negative modulus": Slip("summary.csv", "1.73", "-1.73", 2, "value", "-1.73", "not above 0"),
    "broken count": Slip(
        "summary.csv", "r_squared,0,0.984", "ruptured_count,25,1.5", 3, "value", "1.5", "a count"
    ),
    "ruptured neither 0 nor 1": Slip(
        "actuator.csv",
        "1.6,2,loading,horizontal,0",
        "1.6,2,loading,horizontal,2",
        7,
        "ruptured",
        "2",
        "neither 0 nor 1",
    ),
    "broken cycle": Slip(
        "actuator.csv", "1.6,2,", "1.6,2.5,", 7, "cycle", "2.5", "not a whole number"
    ),
    "semicolons": Slip(
        "break.csv",
        GOOD["break.csv"],
        GOOD["break.csv"].replace(",", ";"),
        1,
        None,
        "specimen_id;degradation_pct;elongation_pct",
        "semicolons",
    ),
    "tabs": Slip(
        "break.csv",
        GOOD["break.csv"],
        GOOD["break.csv"].replace(",", "\t"),
        1,
        None,
        "specimen_id\tdegradation_pct\telongation_pct",
        "tabs",
    ),
    "empty file": Slip("break.csv", GOOD["break.csv"], "", None, None, None, "is empty"),
    "only comments": Slip("break.csv", GOOD["break.csv"], "# x\n\n", None, None, None, "is empty"),
    "header only": Slip("break.csv", "b1,0,209.8\nb2,-1.5,205\n", "", 1, None, None, "but no data"),
    "open quotation mark": Slip("break.csv", "b2,", '"b2,', 3, None, None, "cannot be split"),
    "zero byte": Slip("break.csv", "b2,", "b\0,", 3, None, None, "zero byte"),
}


@pytest.mark.parametrize("slip", SLIPS.values(), ids=SLIPS.keys())
def test_one_slip_is_one_fault_at_its_place(slip: Slip, tmp_path: Path) -> None:
    good = GOOD[slip.file]
    bad = good.replace(slip.old, slip.new, 1)
    assert bad != good
    faults = faults_of(write(tmp_path, GOOD | {slip.file: bad}))
    assert len(faults) == 1, [str(fault) for fault in faults]
    (fault,) = faults
    assert (fault.file, fault.row, fault.column, fault.value) == (
        slip.file,
        slip.row,
        slip.column,
        slip.value,
    )
    assert slip.says in f"{fault.problem}; {fault.remedy}"
    assert fault.remedy


def test_the_study_without_a_slip_is_accepted(tmp_path: Path) -> None:
    study = read_study(write(tmp_path, dict(GOOD)))
    assert study.actuator is not None
    assert len(study.actuator) == 8


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_unreadable_encoding_is_named(tmp_path: Path, encoding: str) -> None:
    text = GOOD["break.csv"].replace("b2", "größe")
    faults = faults_of(write(tmp_path, GOOD | {"break.csv": text.encode(encoding)}))
    assert len(faults) == 1
    assert faults[0].file == "break.csv"
    assert faults[0].row == (3 if encoding == "latin-1" else 1)
    assert "UTF-8" in faults[0].remedy


def test_faults_of_all_files_come_together(tmp_path: Path) -> None:
    files = dict(GOOD)
    names = ("negative mass", "conditioned above cured", "misspelt column", "empty label")
    names += ("unknown mount", "unknown quantity", "dry mass above the moist one")
    for name in names:
        slip = SLIPS[name]
        files[slip.file] = files[slip.file].replace(slip.old, slip.new, 1)
    files["study.toml"] = "sede = 7\n"
    faults = faults_of(write(tmp_path, files))
    assert sorted(fault.file for fault in faults) == sorted(files)


def test_a_file_tells_all_its_faults(tmp_path: Path) -> None:
    text = GOOD["actuator.csv"].replace("20,1.5,", "20,?,").replace("a2,25,20", "a2,125,20")
    faults = faults_of(write(tmp_path, GOOD | {"actuator.csv": text}))
    assert [(fault.row, fault.column) for fault in faults] == [
        (3, "curvature_per_m"),
        (8, "degradation_pct"),
    ]


def test_many_faults_of_one_kind_are_counted_after_the_fifth(tmp_path: Path) -> None:
    rows = "".join(f"b{i},0,x{i}\n" for i in range(12))
    text = f"specimen_id,degradation_pct,elongation_pct\n{rows}"
    faults = faults_of(write(tmp_path, GOOD | {"break.csv": text}))
    assert [fault.row for fault in faults] == [2, 3, 4, 5, 6, None]
    assert "and 7 more" in faults[-1].problem
    assert faults[-1].column == "elongation_pct"


def test_rows_of_a_misspelt_column_are_not_blamed(tmp_path: Path) -> None:
    rows = "".join(f"b{i},0,{100 + i}\n" for i in range(50))
    text = f"specimen_id,degradation_pct,elongation\n{rows}"
    (fault,) = faults_of(write(tmp_path, GOOD | {"break.csv": text}))
    assert (fault.column, fault.row) == ("elongation", 1)


def test_a_file_of_which_every_row_has_too_few_cells_tells_each(tmp_path: Path) -> None:
    text = GOOD["tensile.csv"].replace(",nominal", "").replace(",cauchy", "")
    faults = faults_of(write(tmp_path, GOOD | {"tensile.csv": text}))
    assert [(fault.file, fault.row) for fault in faults] == [
        *(("tensile.csv", 3), ("tensile.csv", 4), ("tensile.csv", 5)),
    ]


def test_misspelt_file_is_named(tmp_path: Path) -> None:
    files = dict(GOOD)
    files["acutator.csv"] = files.pop("actuator.csv")
    (fault,) = faults_of(write(tmp_path, files))
    assert fault.file == "acutator.csv"
    assert "'actuator.csv'" in fault.remedy


def test_only_data_file_misspelt_is_one_fault(tmp_path: Path) -> None:
    files = {"study.toml": "", "Break.csv": GOOD["break.csv"]}
    (fault,) = faults_of(write(tmp_path, files))
    assert (fault.file, "'break.csv'" in fault.remedy) == ("Break.csv", True)


def test_missing_settings_file(tmp_path: Path) -> None:
    (fault,) = faults_of(write(tmp_path, {"break.csv": GOOD["break.csv"]}))
    assert (fault.file, fault.problem) == ("study.toml", "is missing")


def test_no_data_file(tmp_path: Path) -> None:
    (fault,) = faults_of(write(tmp_path, {"study.toml": "", "notes.csv": "a,b\n"}))
    assert "no data file" in fault.problem
    assert "actuator.csv" in fault.remedy


def test_empty_folder_tells_both(tmp_path: Path) -> None:
    problems = sorted(fault.problem for fault in faults_of(tmp_path))
    assert len(problems) == 2
    assert "no data file" in problems[0]
    assert "missing" in problems[1]


def test_absent_folder(tmp_path: Path) -> None:
    (fault,) = faults_of(tmp_path / "nowhere")
    assert fault.problem == "does not exist"
    assert "nowhere" in fault.file


def test_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (fault,) = faults_of(tmp_path / "file")
    assert fault.problem.endswith("not a folder")


def test_data_file_that_is_a_folder(tmp_path: Path) -> None:
    folder = write(tmp_path, {"study.toml": "", "break.csv": GOOD["break.csv"]})
    (folder / "tensile.csv").mkdir()
    (fault,) = faults_of(folder)
    assert (fault.file, "cannot be read" in fault.problem) == ("tensile.csv", True)
