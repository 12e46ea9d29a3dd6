"""No run is ever lost: every stage that a run can do without is broken in turn."""

import re
import shutil
import sys
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from bayesdeg import cli
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.analysis import films, judge, model_kind, refuting
from bayesdeg.commands import run as command
from bayesdeg.criticism.fit.search import SearchEffort
from bayesdeg.criticism.holdout import leave_one_out
from bayesdeg.criticism.posterior import prior_sensitivity
from bayesdeg.errors import Fault, ResumableError, StudyError
from bayesdeg.observations.means import Means
from bayesdeg.observations.tensile import Tensile
from bayesdeg.pages import drawing
from bayesdeg.pages import tables as columns
from bayesdeg.pages.folder import LEFT_OUT, POSTERIOR_AVERAGED, POSTERIORS, RunFolder
from bayesdeg.pages.left_out import (
    STRICT,
    Guard,
    OptionalStage,
    figure_stage,
    posterior_stage,
    table_stage,
)
from bayesdeg.pages.page import FIGURES as DRAWN
from bayesdeg.prediction import prior_predictive
from bayesdeg.run import record, writing
from bayesdeg.run import stages as run
from bayesdeg.run import writing as deciding
from tests.marks import long_unless
from tests.pages.html_reading import read_html
from tests.run.planted_offset import emulator, planted_study

EFFORT = SearchEffort(replicates=60, fitted=1, pairs=0, levels_out=True)
COARSEST = Resolution(along=9.0, across=9.0, up=9.0)

# of what is written
WRITTEN = {table_stage(name): name for name in columns.TABLES} | {
    posterior_stage(name): name for name in POSTERIORS
}
FIGURES = {figure_stage(name): name for name in DRAWN}
# what can only be said, not raised: see the tests of too few simulated data sets
SAID = {OptionalStage.CALIBRATION}
# of a study of films alone, and of readings of other kinds
ELSEWHERE = {
    *(table_stage(columns.GAIN_MODES), table_stage(columns.FITTED)),
    posterior_stage(POSTERIOR_AVERAGED),  # where causes cannot be told apart
    # where a study asks for suspects to be set aside
    *(OptionalStage.SUSPECTS, OptionalStage.WITH_SUSPECTS),
    *(table_stage(columns.SUSPECTS), table_stage(columns.SET_ASIDE), figure_stage("suspects")),
    # of a study with a misfit that no cause accounts for: see the test of that
    *(OptionalStage.MISSING_TERMS, figure_stage("missing-terms")),
    *(table_stage(columns.MISSING_TERMS), table_stage(columns.MISFIT_COLUMNS)),
    table_stage(columns.TERM_READINGS),
    # of a study of photographs
    *(table_stage(columns.TRACES), table_stage(columns.PHOTO_LINES), figure_stage("photographs")),
}
STAGES = sorted({*OptionalStage, *WRITTEN, *FIGURES} - SAID - ELSEWHERE)
# all stages share one mechanism: a plain run breaks a table, a figure, and stages that others need
PLAIN = {
    *("gain.csv", "figure bands", OptionalStage.VERDICT, OptionalStage.HELD_OUT),
    *(OptionalStage.COURSE, OptionalStage.ORDERS, OptionalStage.PAGE),
}


# what goes with a stage
WITHOUT = {
    OptionalStage.VERDICT: {
        *("gain.csv", "gain_levels.csv", "statistics.csv", "discrepancy.csv", "loo_pit.csv"),
        *("misfit_null.csv", "absorption.csv", "pushes.csv", "sets.csv"),
    },
    OptionalStage.SETS: {"sets.csv"},
    OptionalStage.ABSORPTION: {"absorption.csv", "pushes.csv"},
    OptionalStage.HELD_OUT: {"gain.csv", "gain_levels.csv", "loo_pit.csv"},
    OptionalStage.SHARED_SCATTER: {"gain_levels.csv"},
    OptionalStage.STRUCTURE: {"gain_levels.csv"},
    OptionalStage.LEVELS_OUT: {"gain_levels.csv"},
    OptionalStage.PRIOR_SENSITIVITY: {"prior_sensitivity.csv"},
    OptionalStage.PRIOR_PREDICTIVE: {"prior_predictive.csv"},
    OptionalStage.LEAVE_ONE_OUT: {"leave_one_out.csv"},
    OptionalStage.COURSE: {"course.csv", "posterior_course.nc", "lifetime.csv"},
    OptionalStage.ORDERS: {"orders.csv"},
    OptionalStage.LAWS: {"material_laws.csv"},
    OptionalStage.READINGS: {"observations.csv", "levels.csv"},
    OptionalStage.DEFORMED: {"deformed.npz", "actuator_0pct.vtu", "actuator_25pct.vtu"},
    OptionalStage.PAGE: {"index.html"},
}


class Kept:
    """A function whose results are kept: what it costs is paid once for all runs."""

    def __init__(self, real, key=lambda *_args, **_options: None):
        self.real, self.key, self.known = real, key, {}

    def __call__(self, *args, **options):
        key = self.key(*args, **options)
        if key not in self.known:
            self.known[key] = self.real(*args, **options)
        return self.known[key]


class KeptFiles:
    """A function whose files are kept and copied: of calls with the same texts the first counts."""

    def __init__(self, real):
        self.real, self.known = real, {}

    def __call__(self, folder, *args, **options):
        path = folder.path
        path.mkdir(parents=True, exist_ok=True)
        key = tuple(one for one in args if isinstance(one, str))
        if key not in self.known:
            before = set(path.glob("*"))
            self.real(folder, *args, **options)
            new = set(path.glob("*")) - before
            self.known[key] = {file.name: file.read_bytes() for file in new}
        for name, content in self.known[key].items():
            (path / name).write_bytes(content)


def has_table(figure, shown):
    return tuple(shown.tables[name] is not None for name in figure.tables)


KEPT = [
    (run, "calibrate", lambda _model, name, **_options: name),
    (model_kind, "base_of", None),
    (judge, "Search", None),
    (refuting, "held_out_and_all", None),
    (judge, "absorption", None),
    (judge, "levels_out", lambda _search, names, **_options: names),
    (judge, "rank", lambda trials, *_args, **_options: tuple(t.names for t in trials)),
    (judge, "rupture_misfit", None),
    (prior_sensitivity, "prior_sensitivity", lambda model, _chain: len(model.table.names)),
    (prior_predictive, "prior_predictive", lambda model, _rng: len(model.table.names)),
    (leave_one_out, "leave_one_out", lambda model, *_args, **_o: len(model.table.names)),
    (films, "_course", None),
    (films, "compare_orders", None),
    (films, "compare_laws", None),
    (writing, "to_datatree", lambda model, *_args: len(model.table.names)),
    (writing, "decisions", None),
    (writing, "life", lambda found: found.results.course is None),
    (drawing, "inline_svg", lambda _figure, name, **_options: name),
]


@pytest.fixture(scope="module")
def cheap(tmp_path_factory):
    """A study, and a run command whose costly functions are computed once."""
    folder = tmp_path_factory.mktemp("planted")
    planted_study(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(STRICT, "0")
        patch.setattr(command, "emulator_for", lambda *_args, **_options: emulator())
        short = replace(run.EFFORTS["quick"], effective=1.0, r_hat=9.0, longest=60, chunk=30)
        patch.setattr(model_kind, "JUDGE_EFFORTS", {"quick": EFFORT})
        for module in (run, model_kind):
            patch.setattr(module, "EFFORTS", {"quick": short})
        patch.setattr(Tensile, "beside", False)
        patch.setattr(Means, "beside", False)
        patch.setattr(deciding, "DRAWS", 10)
        coarse = partial(writing.write_deformed, resolution=COARSEST)
        patch.setattr(writing, "write_deformed", KeptFiles(coarse))
        posterior = KeptFiles(RunFolder.write_posterior)
        patch.setattr(RunFolder, "write_posterior", lambda *args: posterior(*args))
        for name, figure in DRAWN.items():
            draw = Kept(figure.draw, partial(has_table, figure))
            patch.setitem(DRAWN, name, replace(figure, draw=draw))
        for module, name, key in KEPT:
            kept = Kept(getattr(module, name), *([key] if key else []))
            patch.setattr(module, name, kept)
        yield folder


def command_of(study, out, monkeypatch):
    """Run the command; return its exit code and what is in the folder."""
    words = ["bayesdeg", "run", str(study), "--out", str(out), "--workers", "1"]
    monkeypatch.setattr(sys, "argv", words)
    code = cli.exit_code()
    found = {p.name for p in out.iterdir() if p.is_file()} if out.exists() else set()
    return code, found


@pytest.fixture(scope="module")
def whole(cheap, tmp_path_factory):
    """A run in which nothing breaks."""
    out = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patch:
        code, found = command_of(cheap, out, patch)
    assert code == 0
    return out, found


def raising(fault):
    def broken(*_args, **_options):
        raise fault

    return broken


# begun together with the rest of what films say, which would go with it
BEGUN = {OptionalStage.ORDERS}


def broken_at(stage, fault, patch):
    """Let whatever is attempted as a stage raise, but for its beginning."""
    attempt, spared = Guard.attempt, [stage] if stage in BEGUN else []

    def broken(guard, of, compute, *args, **options):
        if of == stage and not spared:
            compute = raising(fault)
        elif of == stage:
            spared.pop()
        return attempt(guard, of, compute, *args, **options)

    patch.setattr(Guard, "attempt", broken)


def test_no_stage_is_excused_that_is_none():
    """The stages of the tables, posteriors and figures are made of their lists."""
    assert {*OptionalStage, *WRITTEN, *FIGURES} >= SAID | ELSEWHERE
    assert not set(WRITTEN) & set(FIGURES)


@pytest.mark.slow
def test_a_run_in_which_nothing_breaks_leaves_nothing_out(whole):
    out, found = whole
    verdict, document = (RunFolder(out).read_json(name) for name in ("verdict", "run"))
    assert verdict["outcome"] == "named"
    assert verdict["causes"] == verdict["predicted_with"] == ["pressure_offset"]
    assert verdict["left_out"] == document["left_out"] == []
    assert "left_out.txt" not in found
    assert not set(WRITTEN) - ELSEWHERE - found
    page = (out / "index.html").read_text(encoding="utf-8")
    assert 'id="left-out"' not in page
    # whatever can be drawn is drawn, so that the tests below lack nothing
    elsewhere = {"readings", "reading-residuals", "suspects", "photographs", "missing-terms"}
    assert set(DRAWN) - elsewhere == set(re.findall(r'id="figure-([a-z-]+)"', page))


@pytest.mark.slow
@pytest.mark.parametrize("stage", [long_unless(s in PLAIN, s, id=str(s)) for s in STAGES])
def test_a_stage_that_breaks_is_left_out_and_all_else_is_written(
    cheap, whole, stage, tmp_path, monkeypatch, capsys
):
    out = tmp_path / "run"
    broken_at(stage, RuntimeError("broken on purpose"), monkeypatch)
    code, found = command_of(cheap, out, monkeypatch)
    said = capsys.readouterr().err
    assert code == 0, said
    missing = WITHOUT.get(stage, {stage} if stage in WRITTEN else set())
    assert found == whole[1] - missing | {"left_out.txt"}
    verdict, document = (RunFolder(out).read_json(name) for name in ("verdict", "run"))
    assert [entry["stage"] for entry in verdict["left_out"]] == [stage]
    why = verdict["left_out"][0]["why"]
    assert "(RuntimeError: broken on purpose)" in why
    assert document["left_out"] == verdict["left_out"]
    assert "\nRuntimeError: broken on purpose" in (out / "left_out.txt").read_text()
    assert f"{stage}: {why}" in said
    assert "left_out.txt" in said.replace("\n", "")
    assert_judged_as_far_as_known(stage, verdict)
    if stage != OptionalStage.PAGE:
        page = read_html((out / "index.html").read_text(encoding="utf-8"))
        assert f"{stage}: {why}" in page.by_id("left-out").text


WORK = {
    OptionalStage.VERDICT: (judge, "run_search"),
    OptionalStage.WHERE: (record, "where"),
    OptionalStage.ORDERS: (model_kind, "begin_examination"),
    table_stage("bands"): (RunFolder, "write_table"),
    posterior_stage("posterior"): (RunFolder, "write_posterior"),
}


@pytest.mark.slow
@pytest.mark.parametrize("stage", WORK)
def test_the_work_of_a_stage_is_inside_its_guard(
    cheap, whole, stage, tmp_path, monkeypatch, capsys
):
    """Stages are broken above where they are begun; here in the middle of their work."""
    place, name = WORK[stage]
    function, written = getattr(place, name), WRITTEN.get(stage)

    def broken(*args, **options):
        if written is None or args[1] == written:
            raise RuntimeError("broken on purpose")
        return function(*args, **options)

    monkeypatch.setattr(place, name, broken)
    code, found = command_of(cheap, tmp_path / "run", monkeypatch)
    assert code == 0, capsys.readouterr().err
    left_out = RunFolder(tmp_path / "run").read_json("run")["left_out"]
    assert [entry["stage"] for entry in left_out] == [stage]
    assert stage not in found


def assert_judged_as_far_as_known(stage, verdict):
    """Nothing is named where a test that may refute it is missing, and nothing is adequate."""
    if stage in (OptionalStage.VERDICT, *judge.REFUTING):
        assert verdict["outcome"] == "not_judged"
        assert verdict["causes"] == verdict["predicted_with"] == []
        assert "broken on purpose" in verdict["explanation"]
    else:
        assert verdict["outcome"] == "named"
        with_cause = [] if stage == OptionalStage.EXTENDED else ["pressure_offset"]
        assert verdict["predicted_with"] == with_cause


@pytest.mark.slow
@pytest.mark.parametrize(
    "stage", [long_unless(s == OptionalStage.VERDICT, s, id=str(s)) for s in STAGES]
)
def test_ctrl_c_stops_a_run_in_any_stage(cheap, whole, stage, tmp_path, monkeypatch):
    broken_at(stage, KeyboardInterrupt(), monkeypatch)
    code, found = command_of(cheap, tmp_path / "run", monkeypatch)
    assert code == cli.STOPPED
    assert "left_out.txt" not in found


@pytest.mark.slow
def test_several_stages_may_break_at_once_and_files_of_the_run_before_are_removed(
    cheap, whole, tmp_path, monkeypatch
):
    out = tmp_path / "run"
    shutil.copytree(whole[0], out)
    broken = ("bands.csv", OptionalStage.COURSE, OptionalStage.EXPERIMENTS, figure_stage("tensile"))
    for stage in broken:
        broken_at(stage, ValueError("no"), monkeypatch)
    code, found = command_of(cheap, out, monkeypatch)
    assert code == 0
    gone = {"bands.csv", "course.csv", "posterior_course.nc", "lifetime.csv"}
    assert found == whole[1] - gone | {"left_out.txt"}
    verdict = RunFolder(out).read_json("verdict")
    assert {entry["stage"] for entry in verdict["left_out"]} == set(broken)


@dataclass(frozen=True)
class Judged:
    """As much of the results of a run as the verdict with suspects touches."""

    judgement: object
    with_suspects: object = None
    assembly: object = None


def test_the_search_for_suspects_and_the_verdict_with_them_may_break(monkeypatch):
    monkeypatch.setenv(STRICT, "0")
    fault, guard, found = raising(RuntimeError("broken on purpose")), Guard(), Judged("a verdict")
    monkeypatch.setattr(run, "screened", fault)
    monkeypatch.setattr(run, "_decision_of", fault)
    assert run._screened(found, None, guard) is found
    assert run.judged_with_suspects(found, None, None, None, guard) == found
    stages = [one.stage for one in guard.left_out]
    assert stages == [OptionalStage.SUSPECTS, OptionalStage.WITH_SUSPECTS]


@pytest.mark.slow
def test_without_the_description_of_a_misfit_a_run_has_all_else(
    cheap, whole, tmp_path, monkeypatch
):
    """No cause is found, so that the misfit of the planted offset is described, or is not."""
    monkeypatch.setattr(judge, "run_search", lambda _search: frozenset())
    files = {columns.TABLES[n].file for n in (columns.MISSING_TERMS, columns.MISFIT_COLUMNS)}
    files |= {columns.TABLES[columns.TERM_READINGS].file}
    code, described = command_of(cheap, tmp_path / "described", monkeypatch)
    assert code == 0
    verdict = RunFolder(tmp_path / "described").read_json("verdict")
    assert verdict["outcome"] == "unexplained"
    assert verdict["description"]["terms"][0]["columns"] == ["pressure"]
    assert files <= described
    page = read_html((tmp_path / "described" / "index.html").read_text(encoding="utf-8"))
    assert page.by_id("figure-missing-terms") is not None
    broken_at(OptionalStage.MISSING_TERMS, RuntimeError("broken on purpose"), monkeypatch)
    code, found = command_of(cheap, tmp_path / "broken", monkeypatch)
    assert code == 0
    assert found == described - files | {"left_out.txt"}
    verdict = RunFolder(tmp_path / "broken").read_json("verdict")
    assert (verdict["outcome"], "description" in verdict) == ("unexplained", False)
    [entry] = verdict["left_out"]
    assert entry["stage"] == OptionalStage.MISSING_TERMS


@pytest.mark.slow
def test_in_strict_mode_a_fault_of_ours_ends_the_run(cheap, whole, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(STRICT, "1")
    broken_at("bands.csv", RuntimeError("broken on purpose"), monkeypatch)
    assert command_of(cheap, tmp_path / "run", monkeypatch)[0] == cli.OUR_FAULT
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.slow
def test_where_most_simulated_data_sets_have_no_answer_nothing_is_judged(
    cheap, whole, tmp_path, monkeypatch, capsys
):
    """Once a run ended with a traceback: 19 simulated data sets are needed at least, not 18."""
    steps = judge.Search().steps
    step = steps[frozenset()]
    few = replace(
        step.misfit, null=step.misfit.null[:18], p_value=np.nan, drawn=200, lost=1.0 - 18 / 200
    )
    left = replace(step, misfit=few, simulated=step.simulated[:18], chance=step.chance[:18])
    monkeypatch.setitem(steps, frozenset(), left)
    monkeypatch.setattr(judge, "run_search", lambda _search: frozenset())
    # the base model takes errors for wide, which alone makes it unexplained
    monkeypatch.setattr(judge, "questioned", lambda *_: ())
    out = tmp_path / "run"
    code, found = command_of(cheap, out, monkeypatch)
    assert code == 0
    verdict = RunFolder(out).read_json("verdict")
    assert verdict["outcome"] == "not_judged"
    assert verdict["misfit"]["p_value"] is None
    said = "only 18 of 200 simulated data sets stayed within the emulator's range"
    assert said in verdict["explanation"]
    stages = {entry["stage"]: entry["why"] for entry in verdict["left_out"]}
    assert set(stages) == {OptionalStage.CALIBRATION, "statistics.csv"}
    assert all(said in why for why in stages.values())
    assert said in " ".join(capsys.readouterr().err.split())
    assert {"bands.csv", "statistics.csv", "misfit_null.csv", "index.html"} <= found
    table = RunFolder(out).read_table("statistics")
    assert table["reading"].str.startswith("not available").all()
    page = read_html((out / "index.html").read_text(encoding="utf-8"))
    assert page.by_id("verdict").all("span")[0].text == "Not judged"
    assert said in page.by_id("left-out").text


# ---- the guard


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize(
    "fault",
    [
        KeyboardInterrupt(),
        SystemExit(1),
        ResumableError("the scheduler is gone"),
        StudyError([Fault("a.csv", "is wrong", "mend it")]),
    ],
)
def test_what_is_no_fault_of_ours_is_passed_on(fault, strict):
    guard = Guard(strict=strict)
    with pytest.raises(type(fault)):
        guard.attempt(OptionalStage.COURSE, raising(fault))
    assert guard.left_out == []


def test_what_is_left_out_is_kept_with_its_reason_and_traceback():
    guard = Guard(strict=False)
    assert guard.attempt(OptionalStage.COURSE, int, "7") == 7
    assert guard.attempt(OptionalStage.HELD_OUT, raising(ValueError("two\n  lines."))) is None
    assert guard.attempt("bands.csv", raising(ValueError())) is None
    guard.note(OptionalStage.HELD_OUT, "the first reason counts")
    assert guard.stages == ("held-out specimens", "bands.csv")
    assert guard.why(OptionalStage.HELD_OUT).endswith("(ValueError: two lines).")
    assert guard.why("bands.csv").endswith("(ValueError).")
    assert guard.why(OptionalStage.COURSE) == ""
    entry = guard.entries()[0]
    assert (entry.stage, entry.why) == ("held-out specimens", guard.left_out[0].why)
    assert guard.traces().count("Traceback (most recent") == 2


def test_a_folder_keeps_no_tracebacks_of_an_earlier_run(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_left_out("of the first")
    assert (tmp_path / LEFT_OUT).read_text() == "of the first"
    folder.write_left_out("")
    folder.write_left_out("")
    assert not (tmp_path / LEFT_OUT).exists()
