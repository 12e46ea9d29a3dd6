import json
import re
import tomllib

import pytest
from typer.testing import CliRunner

from bayesdeg.assembly.outline import outline
from bayesdeg.cli import app
from bayesdeg.commands.init import STARTER, write_starter
from bayesdeg.data.plausibility import doubts
from bayesdeg.data.settings import KEYS, Dimensions, Settings, parse_settings
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError

NO_DEFAULT = (
    *("stretch_range", "modulus_100", "elongation_at_break"),
    *("grid", "ruler", "length", "scale", "base", "hint", "line", "columns", "constants"),
    *("markers", "unit", "plane", "pressure", "kPa_per_unit"),
)
SETTINGS = (STARTER / "study.toml").read_text(encoding="utf-8")


def test_it_writes_a_study_without_faults(tmp_path):
    files = write_starter(tmp_path / "a" / "mine")
    assert {"study.toml", "actuator.csv"} < {file.name for file in files}
    study = read_study(tmp_path / "a" / "mine")
    assert study.settings.virtual
    assert doubts(study, outline(study).expected) == ()


def test_how_long_training_takes_is_left_to_check():
    assert {"hour", "hours", "minute", "minutes", "min"}.isdisjoint(re.findall(r"\w+", SETTINGS))


def test_it_says_what_to_do_next(tmp_path):
    shown = CliRunner().invoke(app, ["init", str(tmp_path / "mine")], env={"COLUMNS": "500"})
    assert shown.exit_code == 0
    assert f"bayesdeg check {tmp_path / 'mine'}" in shown.stderr
    assert f"bayesdeg run {tmp_path / 'mine'}" in shown.stderr


def test_a_folder_that_holds_files_stays_as_it_is(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for folder in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(BayesdegError, match="new folder"):
            write_starter(folder)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_an_empty_folder_will_do(tmp_path):
    assert write_starter(tmp_path)


def test_every_key_is_there_and_what_is_commented_out_is_the_default():
    """Uncommented, the file says what an empty one does, but for what makes it an example."""
    everything = re.sub(r"^# (\w+ = )", r"\1", SETTINGS, flags=re.MULTILINE)
    document = tomllib.loads(everything)
    for table, key in ((table, key) for table, keys in KEYS.items() for key in keys):
        if table in ("forward", "reading"):  # of a forward map of one's own
            continue
        if table == "actuator" and key not in (*vars(Dimensions()), "kind"):
            continue  # of another family
        if table == "constraint" and key != "kind":  # has no default of its own
            continue
        if table != "actuator" and key in NO_DEFAULT:
            assert re.search(rf"^#   {key} = ", SETTINGS, flags=re.MULTILINE)
            continue
        assert key in (document[table] if table else document)
    settings, faults = parse_settings(everything.encode())
    assert not faults
    assert settings.priors.keys() == {"volume_ratio"}
    plain, _ = parse_settings(SETTINGS.encode())
    assert plain == Settings(title=plain.title, note=plain.note, virtual=True)
    assert {**vars(settings), "priors": {}} == vars(plain)


def test_its_data_say_that_they_are_virtual():
    for file in STARTER.glob("*.csv"):
        assert file.read_text(encoding="utf-8").startswith("# virtual experiment")


@pytest.mark.long
@pytest.mark.slow
def test_a_run_of_it_names_what_is_hidden(tmp_path):
    write_starter(tmp_path / "mine")
    options = ["--effort", "quick", "--out", str(tmp_path / "run"), "--quiet", "--workers", "1"]
    assert CliRunner().invoke(app, ["run", str(tmp_path / "mine"), *options]).exit_code == 0
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text(encoding="utf-8"))
    assert (verdict["outcome"], verdict["causes"]) == ("named", ["pressure_offset"])
    size = verdict["candidates"][0]["effect"]["offset"]
    assert size["q05"] < 14.0 < size["q95"]
