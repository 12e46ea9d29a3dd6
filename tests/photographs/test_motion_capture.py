"""Recordings of motion capture: markers, frames and pressures of a C3D file become lines."""

import struct
import sys

import numpy as np
import pandas as pd
import pytest

from bayesdeg import limited
from bayesdeg.actuator.line import read_line
from bayesdeg.assembly.reading import read_study
from bayesdeg.commands.check import check
from bayesdeg.data.captures import captured_messages
from bayesdeg.errors import StudyError
from bayesdeg_camera import c3d
from bayesdeg_camera.c3d import read_c3d
from bayesdeg_camera.captures import error_of_mean, fitted_plane, shifted, stated_plane
from tests.photographs.recordings import LENGTH, TURNED, WHERE, arc, names, write_c3d

ANGLES = {40.0: 0.2, 80.0: 0.45, 120.0: 0.8}
MARKERS = f"markers = {names()}\n"
NOISE = 0.05  # mm


def frames(angle, count=40, *, seed=1, noise=0.0, below=0.0):
    """Frames of a hold in the laboratory."""
    rng = np.random.default_rng(seed)
    line = arc(angle, below=below) @ TURNED.T + WHERE
    return line + noise * rng.normal(size=(count, *line.shape))


def write_study(folder, settings=MARKERS, *, rows=None, **how):
    """Write a study with a recording a pressure; ``how`` goes to `frames` and `write_c3d`."""
    (folder / "captures").mkdir(parents=True)
    of_frames = {key: how.pop(key) for key in ("noise", "below") if key in how}
    factor = {"m": 1e-3, "cm": 0.1, "in": 1 / 25.4}.get(how.get("unit", "mm"), 1.0)
    table = []
    for pressure, angle in ANGLES.items():
        name = f"p{pressure:.0f}.c3d"
        points = factor * frames(angle, **of_frames)
        write_c3d(folder / "captures" / name, points, names(subject="S:"), **how)
        table.append((name, "a", 0.0, pressure))
    columns = ["file", "specimen_id", "degradation_pct", "pressure_kPa"]
    table = pd.DataFrame(table, columns=columns) if rows is None else pd.DataFrame(rows)
    table.to_csv(folder / "captures.csv", index=False)
    (folder / "study.toml").write_text(f"seed = 7\n[captures]\n{settings}", encoding="utf-8")
    return folder


def faults(folder):
    with pytest.raises(StudyError) as refused:
        read_study(folder)
    return refused.value.faults


def fault(folder):
    (one,) = faults(folder)
    return one


# ---- from recordings to readings


@pytest.mark.parametrize("unit", ["mm", "m", "cm", "in"])
def test_readings_are_those_of_the_true_lines_in_any_unit(tmp_path, unit):
    read = read_study(write_study(tmp_path / "study", unit=unit))
    assert read.actuator["pressure_kPa"].tolist() == list(ANGLES)
    for (_, row), angle in zip(read.actuator.iterrows(), ANGLES.values(), strict=True):
        true = read_line(arc(angle)[:, ::2])
        assert row["bend_angle_deg"] == pytest.approx(np.degrees(true.angle), rel=3e-4)
        assert row["curvature_per_m"] == pytest.approx(1e3 * angle / LENGTH, rel=2e-4)
    assert read.line_points == 12
    assert read.lines_file == "captures.csv"
    assert read.given("markers") is None
    assert read.given("actuator") is None
    assert set(read.hashes) >= {"captures.csv", "captures/p40.c3d"}


def test_a_unit_that_is_stated_counts_and_not_that_of_the_file(tmp_path):
    folder = write_study(tmp_path / "study", MARKERS + 'unit = "mm"\n', unit="")
    assert len(read_study(folder).actuator) == 3
    folder = write_study(tmp_path / "other", unit="furlong")
    found = faults(folder)
    assert {one.column for one in found} == {"POINT:UNITS"}
    assert {one.value for one in found} == {"furlong"}
    assert [one.file for one in found] == [f"captures/p{p:.0f}.c3d" for p in ANGLES]


def test_a_wrong_unit_is_seen_by_the_length(tmp_path):
    found = faults(write_study(tmp_path / "study", MARKERS + 'unit = "cm"\n'))
    assert len(found) == 3
    assert all(one.file == "captures.csv" and "430 mm" in one.problem for one in found)


def test_frames_of_a_hold_are_those_that_the_recording_numbers(tmp_path):
    """One recording of three holds that was cut, so that it begins at frame 351."""
    holds = np.concatenate([frames(angle, 20) for angle in ANGLES.values()])
    rows = [
        {"file": "all.c3d", "specimen_id": "a", "degradation_pct": 0.0, "pressure_kPa": pressure,
         "first_frame": 351 + 20 * i, "last_frame": 370 + 20 * i}
        for i, pressure in enumerate(ANGLES)
    ]  # fmt: skip
    folder = write_study(tmp_path / "study", rows=rows)
    write_c3d(folder / "captures" / "all.c3d", holds, names(), first=351)
    read = read_study(folder).actuator
    assert read["curvature_per_m"].to_numpy() == pytest.approx(
        [1e3 * angle / LENGTH for angle in ANGLES.values()], rel=2e-4
    )
    rows[2]["last_frame"] = 411
    pd.DataFrame(rows).to_csv(folder / "captures.csv", index=False)
    one = fault(folder)
    assert (one.specimen, one.value) == ("a", "all.c3d")
    assert "391 to 411" in one.problem
    assert "351 to 410" in one.problem
    rows[2] |= {"first_frame": 405, "last_frame": 400}
    pd.DataFrame(rows).to_csv(folder / "captures.csv", index=False)
    assert fault(folder).column == "first_frame"


def test_pressures_are_means_of_a_channel_over_the_frames_of_the_hold(tmp_path):
    """Of a sensor of 50 kPa for a volt that reads 0.5 V at no pressure."""
    holds = np.concatenate([frames(angle, 20) for angle in ANGLES.values()])
    volts = 0.5 + np.repeat(list(ANGLES), 20) / 50.0
    volts += np.tile([-0.1, 0.1], 30)
    rows = [
        {"file": "all.c3d", "specimen_id": "a", "degradation_pct": 0.0, "pressure_kPa": "",
         "first_frame": 1 + 20 * i, "last_frame": 20 + 20 * i}
        for i in range(3)
    ]  # fmt: skip
    channel = 'pressure = "p"\n'
    folder = write_study(tmp_path / "a", f"{MARKERS}{channel}kPa_per_unit = 50\nzero = 0.5\n",
                         rows=rows)  # fmt: skip
    for name in ("p40", "p80", "p120"):
        (folder / "captures" / f"{name}.c3d").unlink()
    write_c3d(folder / "captures" / "all.c3d", holds, names(), pressures=volts)
    assert read_study(folder).actuator["pressure_kPa"].tolist() == pytest.approx(list(ANGLES))
    (folder / "study.toml").write_text(f"[captures]\n{MARKERS}{channel}")
    one = fault(folder)
    assert (one.file, one.column, one.value) == ("captures/all.c3d", "p", "V")
    bars = np.repeat(list(ANGLES), 20) / 100.0
    write_c3d(folder / "captures" / "all.c3d", holds, names(), pressures=bars, channel_unit="bar")
    assert read_study(folder).actuator["pressure_kPa"].tolist() == pytest.approx(list(ANGLES))
    (folder / "study.toml").write_text(f'[captures]\n{MARKERS}pressure = "q"\n')
    assert fault(folder).value == "q"
    (folder / "study.toml").write_text(f"[captures]\n{MARKERS}")
    found = faults(folder)
    assert len(found) == 3
    assert all("pressure_kPa" in one.problem for one in found)


def test_frames_with_a_gap_are_left_out_and_said(tmp_path):
    """A marker that jumps where others are not seen would move their mean."""
    folder = write_study(tmp_path / "study")
    points = frames(ANGLES[80.0])
    points[5:15, 3] = np.nan
    points[5:15, 4] += 30.0
    write_c3d(folder / "captures" / "p80.c3d", points, names())
    study = read_study(folder)
    assert [one.left_out for one in study.captured] == [0, 10, 0]
    assert [one.frames for one in study.captured] == [40, 30, 40]
    (said,) = captured_messages(study.captured)
    assert "p80.c3d" in said
    assert "10 of 40" in said
    assert study.actuator["curvature_per_m"][1] == pytest.approx(1e3 * 0.45 / LENGTH, rel=2e-4)
    points[:, 3] = np.nan
    write_c3d(folder / "captures" / "p80.c3d", points, names())
    one = fault(folder)
    assert (one.file, one.value) == ("captures.csv", "p80.c3d")
    assert "B4" in one.problem


def test_standard_errors_are_those_of_the_means_of_frames(tmp_path):
    """Of 40 independent frames the mean has an error of 1/√40; of readings so has the spread."""
    read = read_study(write_study(tmp_path / "study", noise=NOISE)).actuator
    exact = read_study(
        write_study(tmp_path / "exact", MARKERS + f"sd = {NOISE / np.sqrt(40)}\n")
    ).actuator
    assert read["bend_angle_sd_deg"].to_numpy() == pytest.approx(
        exact["bend_angle_sd_deg"].to_numpy(), rel=0.25
    )
    assert (read["bend_angle_sd_deg"] > 0.0).all()
    off = read["bend_angle_deg"] - exact["bend_angle_deg"]
    assert (off.abs() < 4.0 * read["bend_angle_sd_deg"]).all()


def test_markers_that_sit_below_the_paper_are_moved_to_the_bottom_line(tmp_path):
    """2 mm below it a line is shorter by 2 mm times the angle, and its curvature larger."""
    raw = read_study(write_study(tmp_path / "raw", below=2.0)).actuator
    angles = np.array(list(ANGLES.values()))
    assert raw["curvature_per_m"].to_numpy() == pytest.approx(
        1e3 * angles / (LENGTH - 2.0 * angles), rel=3e-4
    )
    moved = read_study(write_study(tmp_path / "moved", MARKERS + "offset = 2.0\n", below=2.0))
    assert moved.actuator["curvature_per_m"].to_numpy() == pytest.approx(
        1e3 * angles / LENGTH, rel=1e-3
    )


def test_stated_axes_give_the_same_and_the_sign_of_the_bend(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.photographs.test_motion_capture.TURNED", np.eye(3))
    usual = read_study(write_study(tmp_path / "usual")).actuator
    for plane, sign in ((["x", "z"], 1.0), (["x", "-z"], -1.0)):
        folder = write_study(tmp_path / plane[1], MARKERS + f"plane = {plane}\n")
        read = read_study(folder).actuator
        assert read["curvature_per_m"].to_numpy() == pytest.approx(
            sign * usual["curvature_per_m"].to_numpy(), rel=1e-9
        )
    found = faults(write_study(tmp_path / "off", MARKERS + 'plane = ["y", "z"]\n'))
    assert found[0].specimen == "a"


def test_base_and_tip_need_axes_that_say_how_the_base_lies(tmp_path, monkeypatch):
    reading = '[reading]\noperator = "base_tip"\n'
    one = fault(write_study(tmp_path / "unknown", MARKERS + reading))
    assert one.column == "captures.plane"
    monkeypatch.setattr("tests.photographs.test_motion_capture.TURNED", np.eye(3))
    folder = write_study(tmp_path / "known", MARKERS + 'plane = ["x", "z"]\n' + reading)
    read = read_study(folder).actuator
    expected = [1e3 * angle / LENGTH for angle in ANGLES.values()]
    assert read["curvature_per_m"].to_numpy() == pytest.approx(expected, rel=1e-3)


def test_check_says_what_was_read(tmp_path, capsys):
    folder = write_study(tmp_path / "study")
    points = frames(ANGLES[40.0])
    points[0, 0] = np.nan
    write_c3d(folder / "captures" / "p40.c3d", points, names())
    check(folder)
    said = " ".join(capsys.readouterr().out.split())
    assert "1 of 40 frames" in said
    assert "captures.csv" in said


# ---- what is refused


@pytest.mark.parametrize(
    ("settings", "column"),
    [
        ("", "captures"),
        ("offset = 0.0\nsd = 0.1\n", "captures.markers"),
        ('markers = ["B1", "B2", "B3"]\n', "captures.markers"),
        ('markers = ["B1", "B2", "B3", "B3"]\n', "captures.markers"),
        (MARKERS.replace("'B4'", "'B44'"), "captures.markers"),
        (MARKERS + 'unit = "km"\n', "captures.unit"),
        (MARKERS + 'plane = ["x", "-x"]\n', "captures.plane"),
        (MARKERS + 'plane = ["x"]\n', "captures.plane"),
        (MARKERS + "sd = -1.0\n", "captures.sd"),
        (MARKERS + "kPa_per_unit = 0.0\n", "captures.kPa_per_unit"),
        (MARKERS + "kpa_per_unit = 1.0\n", "captures.kpa_per_unit"),
        (MARKERS + "frames = 3\n", "captures.frames"),
    ],
)
def test_settings_are_refused_at_their_place(tmp_path, settings, column):
    found = faults(write_study(tmp_path / "study", settings))
    assert {one.column for one in found} <= {column, "captures.markers"}
    assert found[0].column == (column if settings else "captures.markers")


def test_markers_that_are_not_named_are_listed(tmp_path):
    found = faults(write_study(tmp_path / "study", "sd = 0.1\n"))
    assert all("S:B1, S:B2" in one.remedy for one in found)


def test_options_without_recordings_and_recordings_beside_readings_are_refused(tmp_path):
    folder = write_study(tmp_path / "study")
    rows = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\na,0,40,5\na,0,80,9\n"
    (folder / "actuator.csv").write_text(rows)
    assert fault(folder).file == "captures.csv"
    (folder / "captures.csv").unlink()
    assert fault(folder).column == "captures"


def test_an_actuator_that_never_bends_has_no_plane(tmp_path):
    folder = write_study(tmp_path / "study")
    straight = np.zeros((40, 12, 3)) + WHERE
    straight[..., 0] += np.linspace(0.0, LENGTH, 12)
    straight += np.random.default_rng(2).normal(0.0, NOISE, straight.shape)
    for name in ("p40", "p80", "p120"):
        write_c3d(folder / "captures" / f"{name}.c3d", straight, names())
    one = fault(folder)
    assert one.specimen == "a"
    assert "plane" in one.remedy


def test_two_markers_at_one_place_are_refused(tmp_path):
    folder = write_study(tmp_path / "study")
    points = frames(ANGLES[80.0])
    points[:, 5] = points[:, 4]
    write_c3d(folder / "captures" / "p80.c3d", points, names())
    one = fault(folder)
    assert one.value == "p80.c3d"
    assert "B5 and B6" in one.problem


@pytest.mark.parametrize("name", ["../p40.c3d", "/etc/passwd", "none.c3d", "a\\b.c3d"])
def test_a_recording_outside_the_study_or_not_there_is_refused(tmp_path, name):
    rows = [{"file": name, "specimen_id": "a", "degradation_pct": 0, "pressure_kPa": 40}]
    one = fault(write_study(tmp_path / "study", rows=rows))
    assert (one.file, one.column, one.value) == ("captures.csv", "file", name)


def test_without_the_library_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    folder = write_study(tmp_path / "study")
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert "ezc3d" in fault(folder).problem


# ---- damaged files


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "sound.c3d"
    write_c3d(path, frames(0.5), names(), pressures=np.linspace(0.0, 1.0, 40), first=11)
    return path.read_bytes()


def refused(tmp_path, content):
    path = tmp_path / "one.c3d"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"^is \S") as found:
        read_c3d(str(path), content)
    return str(found.value)


def test_a_recording_is_read_as_it_was_written(tmp_path, sound):
    path = tmp_path / "one.c3d"
    path.write_bytes(sound)
    read = read_c3d(str(path), sound)
    assert np.abs(read.points - frames(0.5)).max() < 1e-4  # of single precision
    assert (read.first_frame, read.unit, read.labels) == (11, "mm", tuple(names()))
    assert np.abs(read.analogs[..., 0] - np.linspace(0.0, 1.0, 40)[:, None]).max() < 1e-6
    assert (read.channels, read.channel_units) == (("p",), ("V",))


@pytest.mark.parametrize("kept", [0, 1, 2, 100, 511, 600, 1500, 3000, -1])
def test_a_file_that_is_cut_off_is_refused(tmp_path, sound, kept):
    end = len(sound) if kept == -1 else kept
    data = 512 * (struct.unpack_from("<H", sound, 16)[0] - 1)
    whole = 40 * (4 * 12 + 4) * 4  # bytes of the frames
    content = sound[: min(end, data + whole - 4)]
    assert "is damaged" in refused(tmp_path, content) or len(content) < data + whole


@pytest.mark.parametrize("content", [b"", b"x", b"\x02\x51" + bytes(600), b"RIFF" + bytes(2000)])
def test_what_is_no_recording_is_refused(tmp_path, content):
    assert "not a C3D" in refused(tmp_path, content)


@pytest.mark.parametrize(
    ("place", "value"),
    [(2, 0xFFFF), (4, 0xFFFF), (8, 0xFFFF), (16, 0xFFFF)],
    ids=["markers", "samples", "last frame", "start"],
)
def test_huge_counts_are_refused_before_anything_is_read(
    tmp_path, sound, monkeypatch, place, value
):
    """The header promises gigabytes: no process is started for them."""
    content = bytearray(sound)
    struct.pack_into("<H", content, place, value)
    monkeypatch.setattr(limited.subprocess, "run", lambda *_, **__: pytest.fail("was read"))
    assert "cut off" in refused(tmp_path, bytes(content))


def test_a_reader_that_dies_or_hangs_is_a_refusal(tmp_path, sound, monkeypatch):
    path = tmp_path / "one.c3d"
    path.write_bytes(sound)
    for code in ("import os; os.abort()", "while True: pass"):
        (tmp_path / "reader.py").write_text(code)
        monkeypatch.setattr(c3d, "__file__", str(tmp_path / "reader.py"))
        monkeypatch.setattr(limited, "PATIENCE_S", 2.0)
        with pytest.raises(ValueError, match="is damaged"):
            read_c3d(str(path), sound)


def test_a_damaged_recording_of_a_study_is_one_fault_and_nothing_is_written(tmp_path, sound):
    folder = write_study(tmp_path / "study")
    (folder / "captures" / "p80.c3d").write_bytes(sound[:700])
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert fault(folder).file == "captures/p80.c3d"
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


# ---- the arithmetic


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_the_error_of_a_mean_follows_the_correlation_of_frames(correlation):
    """Of an autoregression the variance of the mean is (1 + ρ)/(1 − ρ) times that of noise."""
    rng = np.random.default_rng(3)
    count, series = 2000, 40
    noise = rng.normal(size=(count, series))
    walk = noise.copy()
    for k in range(1, count):
        walk[k] = correlation * walk[k - 1] + np.sqrt(1.0 - correlation**2) * noise[k]
    expected = np.sqrt((1.0 + correlation) / (1.0 - correlation) / count)
    assert error_of_mean(walk).mean() == pytest.approx(expected, rel=0.1)


def test_of_few_frames_the_mean_is_no_better_than_one():
    values = np.random.default_rng(5).normal(size=(9, 2000))
    assert error_of_mean(values).mean() == pytest.approx(1.0, rel=0.05)
    assert error_of_mean(values[:1]).tolist() == [0.0] * 2000
    assert error_of_mean(np.ones((50, 1))).tolist() == [0.0]


def test_a_plane_is_found_wherever_the_actuator_is():
    lines = [arc(angle) @ TURNED.T + WHERE for angle in ANGLES.values()]
    plane = fitted_plane(lines)
    for line, angle in zip(lines, ANGLES.values(), strict=True):
        placed = plane.placed(line)
        assert read_line(placed).angle == pytest.approx(read_line(arc(angle)[:, ::2]).angle)
    assert plane.off == pytest.approx(0.0, abs=1e-9)


def test_what_leaves_the_plane_is_measured():
    lines = [arc(angle) for angle in ANGLES.values()]
    for line in lines:
        line[1::2, 1] += 0.3
    found = [fitted_plane(lines).off, stated_plane("x", "z", np.concatenate(lines)).off]
    assert found == pytest.approx([0.15, 0.15], rel=0.5)


def test_a_shifted_arc_is_an_arc_about_the_same_centre():
    line = arc(0.8, 40)[:, ::2]
    radius = LENGTH / 0.8
    moved = shifted(line, 2.0)
    assert np.hypot(moved[:, 0], moved[:, 1] + radius) == pytest.approx(radius + 2.0, abs=1e-4)


def test_an_operator_that_reads_curves_is_a_fault_of_the_settings(tmp_path):
    folder = write_study(tmp_path / "study")
    settings = (folder / "study.toml").read_text(encoding="utf-8")
    stated = f'{settings}\n[reading]\noperator = "kappa"\npoints = 6\n'
    (folder / "study.toml").write_text(stated, encoding="utf-8")
    assert (fault(folder).file, fault(folder).column) == ("study.toml", "reading.operator")
