"""A study of photographs: traced once, read as lines of points, shown in the report."""

import io
import shutil

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from bayesdeg.actuator.line import read_line
from bayesdeg.actuator.reading import bottom_lines, evenly, line_of_reading
from bayesdeg.assembly.reading import read_study
from bayesdeg.commands.check import check
from bayesdeg.data.photographs import TracedPhotograph, messages, trace_rows
from bayesdeg.errors import StudyError
from bayesdeg.pages.drawing import Shown
from bayesdeg.pages.folder import PICTURES, RunFolder
from bayesdeg.pages.page import FIGURES
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.tables import Tables
from bayesdeg.progress import Silent
from bayesdeg.run.writing import write_pictures
from bayesdeg_camera import photographs as traced
from bayesdeg_camera import pictures
from bayesdeg_camera.tracing.plane import mapped

PRESSURES = (80.0, 160.0, 240.0)
GROUP = 100.0  # mm; the paper of the photographed shapes is softer than any of the lines
OPERATOR = ("angle_over_arc", 50)
SETTINGS = 'seed = 7\n[photographs]\ngrid = 5.0\nbase = "left"\n'


@pytest.fixture(scope="module")
def drawn(scenes):
    """Photographs of one actuator at rising pressures, and the last one's empty background."""
    curve = scenes.shapes()[0]
    found = {}
    for pressure in PRESSURES:
        shape = curve[int(pressure / 20.0)]
        found[pressure] = scenes.scene(
            12, megapixels=3, target="grid", method="paper", kind="white", shape=shape
        )
    return found


@pytest.fixture(scope="module")
def whole(drawn, tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographed") / "study"
    (folder / "photos").mkdir(parents=True)
    rows = []
    for pressure, one in drawn.items():
        name = f"a_{pressure:.0f}.jpg"
        save(one.image, folder / "photos" / name)
        rows.append((name, "a", 0.0, pressure))
    save(np.full_like(one.image, 180), folder / "photos" / "nothing.jpg")
    rows.append(("nothing.jpg", "b", 0.0, 100.0))
    columns = ["file", "specimen_id", "degradation_pct", "pressure_kPa"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "photos.csv", index=False)
    (folder / "study.toml").write_text(SETTINGS, encoding="utf-8")
    return folder


@pytest.fixture
def folder(whole, tmp_path, monkeypatch):
    """A copy to be changed, and a place of its own to which the command is called."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return shutil.copytree(whole, tmp_path / "study")


@pytest.fixture(scope="module")
def study(whole, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("here"))
        return read_study(whole)


def save(image, path):
    Image.fromarray(np.ascontiguousarray(image[:, :, ::-1])).save(path, quality=92)


def faults(folder):
    with pytest.raises(StudyError) as refused:
        read_study(folder)
    return refused.value.faults


def listing(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


# ---- from photographs to readings


def test_readings_are_those_of_the_true_lines(study, drawn):
    read = study.actuator
    assert read["pressure_kPa"].tolist() == list(PRESSURES)
    for (_, row), one in zip(read.iterrows(), drawn.values(), strict=True):
        true = read_line(evenly(one.line, study.line_points))
        assert row["bend_angle_deg"] == pytest.approx(np.degrees(true.angle), rel=0.05, abs=1.0)
        assert row["curvature_per_m"] == pytest.approx(true.curvature, rel=0.05)
    assert (read["curvature_sd_per_m"] > 0.0).all()
    assert study.line_points is not None


def test_one_that_cannot_be_traced_is_left_out_and_said(study):
    assert [one.file for one in study.photographs if one.refused] == ["nothing.jpg"]
    (line,) = messages(study.photographs)
    assert "nothing.jpg" in line
    assert "[photographs] hint" in line
    table = trace_rows(study.photographs)
    assert table["curvature_per_m"].isna().tolist() == [False, False, False, True]
    assert study.given("markers") is None
    assert study.given("photos") is not None
    assert "photos/nothing.jpg" in study.hashes


def test_stored_points_become_mm_by_the_stored_homography(study):
    for one in study.photographs[:3]:
        placed = mapped(np.array(one.to_mm), np.array(one.pixels))
        assert np.allclose(placed, one.points, atol=1e-3)


def test_a_second_reading_traces_nothing_and_writes_nothing_into_the_study(folder, monkeypatch):
    before = listing(folder)
    first = read_study(folder)
    assert listing(folder) == before
    kept = listing(traced.CACHE)
    assert len(kept) == 4
    monkeypatch.setattr(traced, "trace", None)
    again = read_study(folder)
    assert again.actuator.equals(first.actuator)
    assert again.hashes == first.hashes
    assert listing(traced.CACHE) == kept


def test_other_options_and_other_photographs_are_traced_anew(folder):
    read_study(folder)
    (folder / "study.toml").write_text(SETTINGS.replace("5.0", "5.1"), encoding="utf-8")
    larger = read_study(folder).photographs[0]
    assert len(list(traced.CACHE.iterdir())) == 8
    assert larger.length_mm == pytest.approx(1.02 * read_at(folder, SETTINGS), rel=1e-3)


def read_at(folder, settings):
    (folder / "study.toml").write_text(settings, encoding="utf-8")
    return read_study(folder).photographs[0].length_mm


def test_a_damaged_record_is_traced_anew(folder):
    first = read_study(folder)
    for path in traced.CACHE.iterdir():
        path.write_text('{"pixels": 3}', encoding="utf-8")
    assert read_study(folder).actuator.equals(first.actuator)


def test_nothing_is_kept_where_that_is_in_the_study(folder, monkeypatch):
    monkeypatch.chdir(folder)
    before = listing(folder)
    read_study(folder)
    assert listing(folder) == before


def test_check_names_what_it_leaves_out(folder, capsys):
    check(folder)
    said = capsys.readouterr().out
    assert "nothing.jpg" in said
    assert "photos.csv" in said


# ---- what is refused


def rewritten(folder, name):
    table = pd.read_csv(folder / "photos.csv")
    table.loc[0, "file"] = name
    table.to_csv(folder / "photos.csv", index=False)


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../study.toml", "a/../../x.jpg", "C:\\x.jpg", "linked.jpg", "no.jpg"]
)
def test_photographs_outside_the_study_are_refused(folder, name):
    (folder.parent / "secret.jpg").write_bytes((folder / "photos" / "a_80.jpg").read_bytes())
    (folder / "photos" / "linked.jpg").symlink_to(folder.parent / "secret.jpg")
    rewritten(folder, name)
    (fault,) = faults(folder)
    assert (fault.file, fault.column, fault.value) == ("photos.csv", "file", name)
    assert not traced.CACHE.exists()


def test_a_folder_of_photographs_that_leads_out_is_refused(folder):
    (folder / "photos").rename(folder.parent / "elsewhere")
    (folder / "photos").symlink_to(folder.parent / "elsewhere")
    assert {fault.file for fault in faults(folder)} == {"photos.csv"}


def test_what_is_no_picture_is_refused_with_all_other_faults(folder):
    (folder / "photos" / "a_80.jpg").write_bytes(b"text")
    (folder / "photos" / "a_240.jpg").write_bytes(
        (folder / "photos" / "a_160.jpg").read_bytes()[:5000]
    )
    assert [fault.file for fault in faults(folder)] == ["photos/a_80.jpg", "photos/a_240.jpg"]


@pytest.mark.parametrize(
    ("change", "file"),
    [
        (lambda folder: (folder / "study.toml").write_text(""), "study.toml"),
        (lambda folder: shutil.copy(folder / "photos.csv", folder / "actuator.csv"), None),
        (lambda folder: shutil.rmtree(folder / "photos"), "photos.csv"),
        (
            lambda folder: (folder / "study.toml").write_text(f'{SETTINGS}hint = "../x.csv"\n'),
            "study.toml",
        ),
        (
            lambda folder: (folder / "study.toml").write_text(f'{SETTINGS}line = "\\u0000x"\n'),
            "study.toml",
        ),
        (
            lambda folder: (folder / "study.toml").write_text(f'{SETTINGS}hint = "no.csv"\n'),
            "study.toml",
        ),
        (lambda folder: (folder / "study.toml").write_text(f"{SETTINGS}length = 4.2\n"), None),
        (lambda folder: rewritten(folder, "a_160.jpg"), "photos.csv"),
    ],
)
def test_studies_that_contradict_themselves_are_refused(folder, change, file):
    change(folder)
    found = faults(folder)
    assert found
    assert file is None or {fault.file for fault in found} == {file}


def test_a_line_of_another_length_than_the_others_is_left_out():
    lines = [TracedPhotograph(file=f"{n}.jpg", length_mm=n) for n in (42.0, 43.0, 42.5, 35.0, 11.0)]
    kept = traced._of_one_length(lines, 50.0)
    assert [bool(one.refused) for one in kept] == [False, False, False, True, True]
    assert [one.refused for one in traced._of_one_length(lines[2:4], 50.0)] == ["", ""]


# ---- in the report


def test_lines_of_the_model_are_those_of_finite_elements():
    """Ends of lines that the fit has seen are met to a hundredth of the length."""
    known = bottom_lines()
    for i in np.flatnonzero(known.bend_angle > 0.1)[::7]:
        read = read_line(evenly(known.points[i], 50))
        line = line_of_reading(read.angle, known.arc_length[i], known.paper_group[i], *OPERATOR)
        assert np.abs(line[-1] - known.points[i][-1]).max() < 0.01 * known.arc_length[i]


@pytest.mark.parametrize("operator", ["angle_over_arc", "circle", "spline"])
@pytest.mark.parametrize("angle", [-0.4, 0.05, 1.2])
def test_a_predicted_line_is_read_as_predicted(operator, angle):
    line = line_of_reading(angle, 40.0, 30.0, operator, 50)
    found = read_line(evenly(line, 50), operator)
    assert found.angle == pytest.approx(angle, abs=1e-5)
    assert np.hypot(*np.diff(line, axis=0).T).sum() == pytest.approx(40.0)
    assert line[0].tolist() == [0.0, 0.0]


@pytest.fixture
def lines(study):
    """Lines on the pictures, of models of which one predicts what was read and one half of it."""
    photos, read = study.table("photos").iloc[:3], study.actuator
    readings = [
        photos.assign(model=model, curvature_per_m=read["curvature_per_m"], mean_per_m=mean)
        for model, mean in (
            ("base", 0.5 * read["curvature_per_m"]),
            ("final", read["curvature_per_m"]),
        )
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "paper_groups", lambda _, shown: np.full(len(shown), GROUP))
        fits = dict.fromkeys(("base", "final"))
        return pictures.lines_of(study, pd.concat(readings), fits)


def test_the_line_of_a_right_prediction_is_that_which_was_traced(study, lines):
    for _, rows in lines.groupby("picture"):
        ends = rows.groupby("line")[["x_px", "y_px"]].agg(["first", "last"])
        measured, base, final = (
            ends.loc[name].to_numpy() for name in ("measured", "base", "final")
        )
        size = np.ptp(rows["x_px"])
        assert np.abs(final - measured).max() < 0.1 * size
        assert np.abs(base - measured).max() > 2.0 * np.abs(final - measured).max()


def test_pictures_and_their_figure_are_small_and_say_what_they_show(study, lines, tmp_path):
    folder = RunFolder(tmp_path / "run")
    folder.path.mkdir()
    folder.write_picture(PICTURES[5], b"of an earlier run")
    write_pictures(folder, study)
    shown = folder.read_pictures()
    assert list(shown) == list(PICTURES[:3])
    for content in shown.values():
        assert max(Image.open(io.BytesIO(content)).size) <= pictures.SIDE
        assert len(content) < 80_000
    kept = {"photo_lines": lines, "traces": trace_rows(study.photographs)}
    verdict, run = VerdictRecord(outcome="named"), RunRecord(title="a", virtual=True)
    page = Shown(verdict, run, Tables(kept), pictures=shown)
    drawing = FIGURES["photographs"].drawing(page)
    assert drawing.svg.count("data:image/jpeg;base64,") == 3
    assert drawing.svg.count("<polyline") == 2 * (3 * 3 + 3)
    assert "nothing.jpg" in drawing.caption
    assert f"{lines['curvature_per_m'].iloc[0]:.3g}" in drawing.caption
    assert drawing.svg.split('aria-label="')[1].startswith("virtual")
    assert drawing.files == ("photo_lines.csv", "traces.csv")
    without = Shown(verdict, run, Tables(kept))
    assert FIGURES["photographs"].drawing(without) is None


def test_a_photograph_that_changed_since_is_not_shown(folder, tmp_path):
    found = read_study(folder)
    shutil.copy(folder / "photos" / "a_80.jpg", folder / "photos" / "a_240.jpg")
    with pytest.raises(Exception, match="changed"):
        write_pictures(RunFolder(tmp_path), found)


def test_progress_counts_photographs(folder):
    class Counted(Silent):
        steps = 0

        def stage(self, name, total=None):
            self.total = total

        def advance(self, steps=1.0, note=""):
            self.steps += steps

    counted = Counted()
    read_study(folder, counted)
    assert counted.steps == counted.total == 4
