"""``bayesdeg emulate``, and ``bayesdeg run`` on a geometry that has no emulator yet."""

import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bayesdeg as bd
from bayesdeg import training
from bayesdeg.actuator.status import Backend, Status
from bayesdeg.analysis.region import FIRST, AskedAfterwards
from bayesdeg.commands import run as run_command
from bayesdeg.data.study import read_study
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.run.run_record import emulator_facts
from bayesdeg.surrogate import campaign, workers
from bayesdeg.surrogate.kept import cached_path, duration, rough_seconds
from bayesdeg.surrogate.local import TARGET_OUTSIDE, LocalDesign
from bayesdeg.surrogate.refinement import TooFewCurvesError
from bayesdeg.surrogate.scaling import ONE, TrainingRange
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.trained import is_refined, read_trained, write_trained
from tests.run.study_files import SETTINGS, study_in
from tests.run.tiny_campaign import GEOMETRY, RECIPE, TABLE, build, emulator, solve_once

ROOT = Path(__file__).parents[2]
CACHED = cached_path(GEOMETRY, RECIPE)
pytestmark = pytest.mark.fem


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory where the recipe is tiny; with a study and a file of its geometry."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "RECIPE", RECIPE)
    monkeypatch.setattr(training, "LOCAL", lambda _dimensions: RECIPE)
    monkeypatch.setattr(training, "ROUNDS", 0)
    monkeypatch.setattr(training, "LAST_ROUNDS", 0)
    monkeypatch.setattr(campaign, "build", build)
    monkeypatch.setattr(campaign, "solve", solve_once)
    (tmp_path / "tiny.toml").write_text(TABLE, encoding="utf-8")
    (tmp_path / "study").mkdir()
    study_in(tmp_path / "study", {"study.toml": SETTINGS + TABLE})
    return tmp_path


@pytest.fixture
def pipeline(monkeypatch):
    """Let 'run' go no further than to the emulator; gives the emulators that it was given."""
    given = []

    def run_study(_study, _folder, _checkpoints, *, forward, **_):
        given.append(forward)
        return VerdictRecord(outcome="adequate", explanation="nothing was calibrated")

    monkeypatch.setattr(run_command, "run_study", run_study)
    monkeypatch.setattr(run_command, "add_page", lambda _folder, found, _guard: (found, None))
    return given


def kept():
    return list(CACHED.parent.glob("*.npz"))


def solved(folder=Path(".cache/campaign")):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.npz")}


# ---- emulate


def test_emulate_says_the_time_trains_and_ends_with_a_table(here, bayesdeg):
    code, out, err = bayesdeg("emulate", "tiny.toml", "--workers", 1)
    assert (code, out.strip()) == (0, f"wrote {CACHED}"), err
    lines = err.splitlines()
    expected = next(i for i, line in enumerate(lines) if line.startswith("training takes"))
    assert duration(0.0) in lines[expected]
    assert "2 of " in lines[expected]
    assert "in .cache/campaign" in lines[expected]
    table = [line for line in lines if line.startswith("│ all")]
    assert table
    assert lines.index(table[0]) > expected
    assert re.findall(r"\d+", table[0]) == ["6", "2"]
    row = next(line for line in lines if line.startswith("│ curvature"))
    assert [cell.strip() for cell in row.strip("│").split("│")][1:] == [
        "0.25",
        "0.50",
        "1.25",
        "91\N{NO-BREAK SPACE}%",
    ]
    assert read_trained(CACHED).length == 14.0
    assert len(solved()) == 8


def test_emulate_repeats_nothing(here, bayesdeg):
    bayesdeg("emulate", "tiny.toml", "--workers", 1, "--quiet")
    before = solved()
    code, _, err = bayesdeg("emulate", "study", "--workers", 1, "--out", "other.npz")
    assert code == 0
    assert "training takes" not in err
    assert solved() == before
    assert Path("other.npz").read_bytes() == CACHED.read_bytes()


@pytest.mark.long
def test_emulate_trains_on_either_assembly_and_mixes_no_solutions(here, bayesdeg):
    bayesdeg("emulate", "tiny.toml", "--workers", 1, "--quiet")
    before = solved()
    code, _, err = bayesdeg(
        *("emulate", "tiny.toml", "--workers", 1, "--quiet", "--backend", "scikit-fem")
    )
    assert code == 0, err
    made = sorted(Path(".cache/campaign").glob("*.npz"))
    assert len(made) == 2 * len(before)
    assert len(kept()) == 2
    ours, theirs = (campaign.runs(GEOMETRY, replace(RECIPE, backend=b)) for b in Backend)
    store = SolutionStore(Path(".cache/campaign"))
    for one, other in zip(ours, theirs, strict=True):
        expected, found = store.get(one), store.get(other)
        assert found.status == expected.status
        np.testing.assert_allclose(found.readings, expected.readings, rtol=1e-3, atol=1e-6)
        np.testing.assert_allclose(found.gradients[-1], expected.gradients[-1], rtol=0.1, atol=0.1)


@pytest.mark.long
@pytest.mark.slow
def test_run_takes_no_emulator_of_another_assembly(here, bayesdeg, pipeline):
    code, _, err = bayesdeg("run", "study", "--workers", 1, "--yes")
    assert code == 0, err
    write_trained(Path("given.npz"), pipeline[0])
    before = len(solved())
    code, _, err = bayesdeg("run", "study", "--workers", 1, "--yes", "--backend", "scikit-fem")
    assert code == 0, err
    assert len(solved()) == 2 * before
    code, _, err = bayesdeg("run", "study", "--emulator", "given.npz", "--backend", "scikit-fem")
    assert code == 2
    assert "given.npz" in err
    assert "kernels" in err


def test_quiet_says_where_the_emulator_is_and_nothing_else(here, bayesdeg):
    said = (0, f"wrote {CACHED}\n", "")
    assert bayesdeg("emulate", "tiny.toml", "--workers", 1, "--quiet") == said
    assert CACHED.exists()


def test_runs_that_are_given_up_are_listed_with_their_parameters(here, bayesdeg):
    code, _, err = bayesdeg(
        *("emulate", "tiny.toml", "--workers", 1, "--out", "out.npz", "--timeout", 1e-6)
    )
    assert code == 0, err
    listed = Path("out.failures.csv")
    assert str(listed) in err
    assert f"failed: {Status.TIMED_OUT.advice.split(':')[0]}" in err
    with listed.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert {row["status"] for row in rows} == {"TIMED_OUT"}
    runs = campaign.runs(GEOMETRY, RECIPE)
    assert {row["run"] for row in rows} == {run.key() for run in runs}
    for row, run in zip(rows, runs, strict=True):
        assert float(row["c3_ratio"]) == run.curve.material.c3_ratio
        assert float(row["mesh_along"]) == run.resolution.along
        assert float(row["largest_load"]) == run.curve.loads[-1]
    # with more time they are solved, and nothing is listed any more
    code, _, err = bayesdeg("emulate", "tiny.toml", "--workers", 1, "--out", "out.npz")
    assert code == 0, err
    assert not listed.exists()
    assert "failed" not in err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ["no [actuator] table", "add [actuator]"]),
        ("[actuator]\nlenght = 60.0\n", ["tiny.toml, row 2", "actuator.lenght", "'length'"]),
        ("[actuator]\nside_wall = 5.0\n", ["tiny.toml", "in the width"]),
        ("[actuator\n", ["tiny.toml, row 1", "valid TOML"]),
    ],
)
def test_a_geometry_that_is_none_is_refused(here, bayesdeg, text, said):
    Path("tiny.toml").write_text(text, encoding="utf-8")
    code, out, err = bayesdeg("emulate", "tiny.toml")
    assert (code, out) == (2, "")
    assert all(words in err for words in said)
    assert "study.toml" not in err
    assert not Path(".cache").exists()


@pytest.mark.parametrize("name", ["emulate", "run"])
def test_the_cluster_is_asked_for_by_its_address(here, bayesdeg, pipeline, monkeypatch, name):
    asked = []

    @contextmanager
    def pool(workers, scheduler=None):
        asked.append((workers, scheduler))
        yield None

    monkeypatch.setattr(workers, "pool", pool)
    code, *_ = bayesdeg(name, "study", "--scheduler", "tcp://192.0.2.1:8786", "--workers", 3)
    assert code == 0
    assert asked == [(3, "tcp://192.0.2.1:8786")]


@pytest.mark.parametrize("name", ["emulate", "run"])
def test_help_names_every_option(bayesdeg, name):
    _, out, _ = bayesdeg(name, "--help")
    for option in ("--workers", "--scheduler", "--out", "--yes", "--quiet"):
        assert option in out
    assert ".cache/" in out


# ---- run


def test_run_trains_on_first_use_and_finds_the_emulator_afterwards(here, bayesdeg, pipeline):
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert "one is trained" in err
    assert f"training takes {duration(0.0)}" in err
    # of what one study may ask, and not of the whole range
    assert len(kept()) == 1
    assert not CACHED.exists()
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0
    assert "train" not in err
    assert [surrogate.length for surrogate in pipeline] == [14.0, 14.0]
    assert pipeline[0].record == pipeline[1].record


@pytest.mark.parametrize(
    ("content", "said"),
    [("damaged", "is damaged"), ("outdated", "trained on version 0")],
)
def test_run_trains_again_what_cannot_be_used_and_says_why(here, bayesdeg, pipeline, content, said):
    if content == "damaged":
        CACHED.parent.mkdir(parents=True)
        CACHED.write_bytes(b"PK nothing")
    else:
        write_trained(CACHED, emulator(version="0"))
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0
    assert str(CACHED) in err
    assert said in err
    (new,) = (path for path in kept() if path != CACHED)
    assert read_trained(new).record == pipeline[0].record


def test_run_solves_further_curves_where_the_posterior_lies(here, bayesdeg, pipeline, monkeypatch):
    monkeypatch.setattr(training, "ROUNDS", 1)
    monkeypatch.setattr(training, "TARGET_PCT", 1e9)
    monkeypatch.setattr(training, "TARGET_OUTSIDE", 1.0)
    code, _, err = bayesdeg("run", "study", "--workers", 1, "--out", "one")
    assert code == 0, err
    assert len(solved()) == RECIPE.coarse_runs + RECIPE.fine_runs
    assert "more curves" not in err
    for path in kept():
        path.unlink()
    monkeypatch.setattr(training, "TARGET_PCT", 0.0)
    monkeypatch.setattr(training, "REFINABLE_PCT", 0.0)
    code, _, err = bayesdeg("run", "study", "--workers", 1, "--out", "two")
    assert code == 0, err
    assert "more curves" in err
    more = training.MORE_COARSE + training.MORE_FINE
    assert len(solved()) == RECIPE.coarse_runs + RECIPE.fine_runs + more


@pytest.mark.parametrize(
    ("error_pct", "outside", "before", "good"),
    [
        (1.0, TARGET_OUTSIDE, None, True),
        (1.1, TARGET_OUTSIDE, None, False),
        (1.0, 0.03, None, False),
        (1.0, 0.03, 0.05, False),
        (1.0, 0.03, 0.03, True),  # which a round has not mended
        (1.1, 0.03, 0.03, False),
    ],
)
def test_rounds_end_where_further_curves_mend_nothing(error_pct, outside, before, good):
    def asked(outside):
        return AskedAfterwards(None, outside, 0.97, error_pct, None)

    design = LocalDesign(TrainingRange(), (), (), (), ONE)
    earlier = None if before is None else asked(before)
    assert training._is_good(asked(outside), design, 1.0, earlier) is good


@pytest.mark.long
def test_training_ends_with_fine_curves_at_the_posterior(here, bayesdeg, pipeline, monkeypatch):
    monkeypatch.setattr(training, "LAST_ROUNDS", 1)
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert len(solved()) == RECIPE.coarse_runs + RECIPE.fine_runs + FIRST
    (own,) = kept()
    record = pipeline[0].record
    assert json.loads(record)["refinement"]["curves"] <= FIRST
    assert not is_refined(record)
    assert str(RECIPE.coarse_runs) in err
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert pipeline[1].record == record
    assert kept() == [own]
    assert "finite element" not in err


@pytest.mark.long
def test_an_emulator_stays_where_too_few_curves_refine_it(here, bayesdeg, pipeline, monkeypatch):
    def refine(*_):
        raise TooFewCurvesError("2 curves are too few")

    monkeypatch.setattr(training, "LAST_ROUNDS", 1)
    monkeypatch.setattr(training, "refined_by", refine)
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert "2 curves" in err
    assert json.loads(pipeline[0].record)["refinement"] is None
    assert not is_refined(pipeline[0].record)
    assert emulator_facts(pipeline[0].record).record
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert "2 curves" not in err  # it is not tried again


@pytest.mark.long
def test_what_an_earlier_version_trained_is_refined(here, bayesdeg, pipeline, monkeypatch):
    bayesdeg("run", "study", "--workers", 1)
    monkeypatch.setattr(training, "LAST_ROUNDS", 1)
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert json.loads(pipeline[1].record)["refinement"]["curves"] <= FIRST
    assert len(kept()) == 1


def test_a_fit_of_an_earlier_version_is_fitted_again(here, bayesdeg, pipeline):
    """From the curves that are solved."""
    bayesdeg("run", "study", "--workers", 1)
    (own,), curves = kept(), solved()
    record = json.loads(pipeline[0].record)
    former = replace(emulator(), record=json.dumps(record | {"fit_version": "0"}))
    write_trained(own, former)
    for fitted in (1, 2):
        code, _, err = bayesdeg("run", "study", "--workers", 1)
        assert code == 0, err
        assert pipeline[fitted].record == pipeline[0].record
        assert ("is trained now" in err) == (fitted == 1)
    assert (kept(), solved()) == ([own], curves)


@pytest.mark.long
def test_an_emulator_of_another_study_is_used_where_it_is_good(
    here, bayesdeg, pipeline, monkeypatch
):
    bayesdeg("run", "study", "--workers", 1)
    (own,) = kept()
    own.rename(own.with_name("others.npz"))
    monkeypatch.setattr(training, "TARGET_PCT", 1e9)
    monkeypatch.setattr(training, "TARGET_OUTSIDE", 1.0)
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert len(kept()) == 1
    monkeypatch.setattr(training, "TARGET_PCT", 0.0)
    bayesdeg("run", "study", "--workers", 1)
    assert len(kept()) == 2


def test_python_and_run_find_what_the_other_trained(here, bayesdeg, pipeline):
    bayesdeg("run", "study", "--workers", 1)
    curves, files = solved(), kept()
    study = read_study(here / "study")
    found = bd.emulator(study, workers=1, progress=False)
    assert found.record == pipeline[0].record
    assert (solved(), kept()) == (curves, files)
    own = bd.emulator(study, cache="others", workers=1, progress=False)
    assert own.record == found.record
    assert solved() == curves
    files[0].unlink()
    next(Path("others").glob("*.npz")).rename(files[0])
    code, _, err = bayesdeg("run", "study", "--workers", 1)
    assert code == 0, err
    assert "is trained now" not in err


def test_an_emulator_of_dimensions_alone_says_how_long_it_takes(here):
    with pytest.warns(UserWarning, match=re.escape("bayesdeg.emulator(study)")) as said:
        found = bd.emulator(read_study(here / "study").geometry, workers=1, progress=False)
    for seconds in (0.0, rough_seconds(GEOMETRY.dimensions)):
        assert duration(seconds) in str(said[0].message)
    assert CACHED.exists()
    assert found.length == 14.0


def test_an_emulator_file_is_used_as_it_is(here, bayesdeg, pipeline):
    write_trained(Path("mine.npz"), emulator())
    code, *_ = bayesdeg("run", "study", "--emulator", "mine.npz", "--workers", 1)
    assert code == 0
    assert pipeline[0].record == emulator().record
    assert not Path(".cache").exists()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("missing", "mine.npz cannot"),
        ("damaged", "mine.npz is damaged"),
        ("outdated", "trained on version 0"),
        ("other", "chambers = 1 (trained: 5)"),
    ],
)
def test_an_emulator_file_that_does_not_fit_is_refused(here, bayesdeg, pipeline, kind, said):
    path = Path("mine.npz")
    if kind == "damaged":
        path.write_bytes(b"PK nothing")
    elif kind == "outdated":
        write_trained(path, emulator(version="0"))
    elif kind == "other":
        five = replace(GEOMETRY, dimensions=replace(GEOMETRY.dimensions, length=50.0, chambers=5))
        write_trained(path, emulator(five))
    code, _, err = bayesdeg("run", "study", "--emulator", path, "--workers", 1)
    assert code == 2
    assert said in err
    assert "bayesdeg emulate" in err
    assert not pipeline


def test_a_study_without_actuators_needs_no_emulator(here, bayesdeg, pipeline):
    (here / "study" / "actuator.csv").unlink()
    code, *_ = bayesdeg("run", "study", "--workers", 1)
    assert code == 0
    assert pipeline == [None]
    assert not Path(".cache").exists()


def test_check_takes_another_geometry_and_says_that_it_will_be_trained(here, bayesdeg):
    code, out, _ = bayesdeg("check", "study")
    assert code == 0
    assert "no faults" in out
    assert "'bayesdeg run' trains" in " ".join(out.split())
    assert not Path(".cache").exists()


# ---- a terminal, and being stopped

DRIVER = """
import sys
from dataclasses import replace
from bayesdeg import cli
from bayesdeg import training
from bayesdeg.surrogate import campaign
from tests.run.tiny_campaign import RECIPE, build
if __name__ == "__main__":
    training.RECIPE = replace(RECIPE, coarse_runs=int(sys.argv.pop(1)))
    campaign.build = build
    cli.main()
"""


def start(folder, coarse_runs, *arguments, **settings):
    script = folder / "driver.py"
    script.write_text(DRIVER, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    line = [sys.executable, str(script), str(coarse_runs), *map(str, arguments)]
    return subprocess.Popen(line, cwd=folder, env=environment, **settings)


def on_terminal(folder, answer, *arguments):
    """Run a command on a terminal, answer its question; gives exit code and what was shown."""
    master, slave = pty.openpty()
    process = start(folder, 6, *arguments, stdin=slave, stdout=slave, stderr=slave)
    os.close(slave)
    shown = b""
    while True:
        try:
            part = os.read(master, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
        if answer and b"[Y/n]" in shown:
            os.write(master, answer)
            answer = b""
    os.close(master)
    return process.wait(timeout=60), shown.decode()


@pytest.mark.slow
def test_on_a_terminal_it_is_asked_and_a_no_starts_nothing(here):
    code, shown = on_terminal(here, b"n\n", "emulate", "tiny.toml", "--workers", 1)
    assert code == 3
    assert f"Train the emulator, {duration(0.0)}? [Y/n]" in shown
    assert "the same command" in shown
    assert not solved()
    assert not CACHED.exists()


@pytest.mark.long
@pytest.mark.slow
def test_yes_goes_on_without_a_question(here):
    code, shown = on_terminal(here, b"", "emulate", "tiny.toml", "--workers", 1, "--yes")
    assert code == 0
    assert "[Y/n]" not in shown
    assert re.search(rf"\d of 8, {duration(0.0)} left", shown)
    assert CACHED.exists()


@pytest.fixture
def interruptible():
    """A shell's background jobs ignore SIGINT, and so would what they start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stopped_in_mid_campaign_it_ends_with_3_says_what_stays_and_goes_on(here, number):
    runs = 40
    arguments = ("emulate", "tiny.toml", "--workers", 2)
    with start(here, runs, *arguments, stderr=subprocess.PIPE, text=True) as process:
        try:
            while len(solved()) < 8:
                assert process.poll() is None
                time.sleep(0.05)
            # both workers have a curve in hand, and the next in their queues
            begun = len(solved()) + 4
            process.send_signal(number)
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 3
    assert "Traceback" not in err
    stays = len(solved())
    assert stays <= begun
    assert f"stopped; {stays} of {runs + 2}" in err
    assert "in .cache/campaign" in err
    assert "the same command" in err
    before = solved()
    with start(here, runs, *arguments, stderr=subprocess.PIPE, text=True) as again:
        try:
            _, err = again.communicate(timeout=300)
        finally:
            again.kill()
    assert again.returncode == 0, err
    after = solved()
    assert len(after) == runs + 2
    assert {name: after[name] for name in before} == before
    assert cached_path(GEOMETRY, replace(RECIPE, coarse_runs=runs)).exists()


@pytest.mark.long
@pytest.mark.slow
def test_the_whole_way_from_a_geometry_to_an_emulator(tmp_path, bayesdeg, monkeypatch):
    """Nothing is replaced but meshes and numbers of curves."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training, "RECIPE", replace(RECIPE, coarse_runs=64, fine_runs=16))
    Path("tiny.toml").write_text(TABLE, encoding="utf-8")
    code, _, err = bayesdeg("emulate", "tiny.toml", "--workers", 2, "--out", "tiny.npz")
    assert code == 0, err
    surrogate = read_trained(Path("tiny.npz"))
    assert surrogate.length == 14.0
    assert re.search(r"│ curvature +│ +[\d.]+ +│", err)
    assert not SolutionStore(Path(".cache/campaign")).failures()
