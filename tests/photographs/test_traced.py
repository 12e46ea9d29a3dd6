"""From rendered photographs to points: against the truth, and what is refused."""

import io
import zlib

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from typer.testing import CliRunner

from bayesdeg.cli import app
from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.outline import Silhouette, _with_slots
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.plane import _board, grid_plane, ruler_plane
from bayesdeg_camera.tracing.record import corrected
from bayesdeg_camera.tracing.trace import (
    STIFF,
    PictureScale,
    _refuse_target,
    angle_and_length,
    trace,
)


@pytest.fixture(scope="module")
def bent(scenes):
    return scenes.scene(5, megapixels=3, target="grid", method="paper", kind="white")


def traced(one, scale, **asked):
    return trace(one.image, scale, rng=np.random.default_rng(1), **asked)


def saved(image, kind="PNG", **asked):
    content = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image[:, :, ::-1])).save(content, kind, **asked)
    return content.getvalue()


# ---- angle and length


def test_a_circle_between_straight_ends_has_its_angle_and_length():
    turn = np.linspace(0.0, 4.0, 400)  # more than half a turn
    arc = 10.0 * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
    end = np.array([np.cos(4.0), np.sin(4.0)])
    line = np.vstack([[[-4.0, 0.0]], [[-2.0, 0.0]], arc, arc[-1] + 2.0 * end, arc[-1] + 4.0 * end])
    angle, length = angle_and_length(line)
    assert angle == pytest.approx(4.0, abs=1e-9)
    assert length == pytest.approx(48.0, rel=1e-4)
    mirrored, _ = angle_and_length(line * [1.0, -1.0])
    assert mirrored == pytest.approx(-4.0, abs=1e-9)


# ---- planes


def test_a_checkerboard_gives_lengths_in_a_tilted_view(scenes, bent):
    plane = grid_plane(bent.image, 5.0, np.random.default_rng(0))
    _, length = angle_and_length(plane.placed(bent.line_px))
    assert length == pytest.approx(bent.length, rel=0.003)


def test_a_ruler_gives_the_scale(scenes):
    one = scenes.scene(9, megapixels=3, target="ruler", method="paper", kind="grey")
    plane = ruler_plane(one.image, 1.0, np.random.default_rng(0))
    _, length = angle_and_length(plane.placed(one.line_px))
    assert length == pytest.approx(one.length, rel=0.01)


# ---- lines


def test_angle_and_curvature_are_those_of_the_true_line(bent):
    found = traced(bent, PictureScale(grid=5.0), base="left")
    angle, length = angle_and_length(bent.line)
    assert abs(found.angle + np.degrees(angle)) < min(1.5, 3.0 * found.angle_error)
    assert found.curvature == pytest.approx(-1e3 * angle / length, rel=0.03)
    # in its own frame: from the clamp, along x, towards the paper
    assert found.points[0].tolist() == [0.0, 0.0]
    assert abs(found.points[3, 1]) < 0.05 < found.points[3, 0]
    assert found.points[-1, 1] < -5.0
    assert found.pixels[0, 0] < found.pixels[-1, 0]


def test_a_mirrored_or_upside_down_photograph_has_the_same_reading(bent):
    scale = PictureScale(grid=5.0)
    first = traced(bent, scale)
    for image in (bent.image[::-1, ::-1], bent.image[:, ::-1]):
        other = trace(np.ascontiguousarray(image), scale, rng=np.random.default_rng(1))
        assert other.angle == pytest.approx(first.angle, abs=4.0 * first.angle_error)
        assert np.allclose(other.points[-1], first.points[-1], atol=0.6)


def test_a_hint_in_any_direction_gives_the_line(bent):
    hint = bent.line_px[:: len(bent.line_px) // 6] + np.array([3.0, -4.0])
    first = traced(bent, PictureScale(length=bent.length), hint=hint)
    second = traced(bent, PictureScale(length=bent.length), hint=hint[::-1])
    assert first.length == pytest.approx(bent.length, rel=1e-9)
    assert second.angle == pytest.approx(first.angle, abs=2.0 * first.angle_error)


# ---- what is refused


def test_a_scale_wrong_by_ten_is_refused(bent):
    with pytest.raises(BayesdegError, match="factor of 10"):
        traced(bent, PictureScale(grid=50.0, length=bent.length))


def test_a_clamp_at_the_other_end_is_refused(bent):
    with pytest.raises(BayesdegError, match="mirrored"):
        traced(bent, PictureScale(grid=5.0), base="right")


def test_a_ruler_that_is_taken_for_the_actuator_is_refused():
    ticks = np.column_stack([np.linspace(10.0, 90.0, 30), np.full(30, 45.0)])
    line = np.column_stack([np.linspace(0.0, 100.0, 40), np.full(40, 60.0)])
    around = np.array([[0.0, 60.0], [100.0, 60.0], [100.0, 30.0], [0.0, 30.0]])
    ruler = Silhouette(line, 30.0, 0.99, around)
    _refuse_target(ruler, ticks + np.array([0.0, 25.0]))  # beside it
    _refuse_target(ruler, np.empty((0, 2)))
    with pytest.raises(BayesdegError):
        _refuse_target(ruler, ticks)


def test_a_board_of_which_a_corner_is_not_in_its_place_is_not_taken(bent):
    grey = cv2.cvtColor(bent.image, cv2.COLOR_BGR2GRAY)
    at, lattice = _board(grey, 1000, 0)
    assert len(at) == 24
    assert sorted(set(np.diff(np.unique(lattice[:, 0])))) == [1.0]
    # bent by more than any lens does, it is none
    assert _board(cv2.remap(grey, *swirled(grey.shape), cv2.INTER_LINEAR), 1000, 0) is None


def swirled(shape):
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    return x + 40.0 * np.sin(y / 60.0).astype(np.float32), y + 40.0 * np.sin(x / 60.0).astype(
        np.float32
    )


def test_a_card_is_told_from_a_comb():
    comb, card = Silhouette(np.zeros((2, 2)), 1.0, 0.87), Silhouette(np.zeros((2, 2)), 1.0, 0.99)
    with_clamp = Silhouette(np.zeros((2, 2)), 1.0, 0.68)
    assert _with_slots([card, with_clamp, comb]) == [comb]
    assert _with_slots([card, with_clamp]) == [with_clamp]
    assert _with_slots([card]) == []


def test_nothing_and_two_actuators_are_refused(bent):
    empty = np.full_like(bent.image, 180)
    with pytest.raises(BayesdegError, match="no actuator"):
        trace(empty, PictureScale(length=40.0), rng=np.random.default_rng(0))
    with pytest.raises(BayesdegError, match="two actuators"):
        trace(
            np.vstack([bent.image, bent.image]),
            PictureScale(length=40.0),
            rng=np.random.default_rng(0),
        )


def test_a_missing_target_is_refused(scenes):
    one = scenes.scene(4, megapixels=3, target="length", method="paper", kind="white")
    with pytest.raises(BayesdegError, match="no checkerboard"):
        traced(one, PictureScale(grid=5.0))
    with pytest.raises(BayesdegError, match="no ruler"):
        traced(one, PictureScale(ruler=1.0))


def bomb():
    """A PNG of a few bytes that claims 30,000 × 30,000 pixels."""

    def chunk(kind, data):
        body = kind + data
        return len(data).to_bytes(4) + body + zlib.crc32(body).to_bytes(4)

    size = (30_000).to_bytes(4)
    header = chunk(b"IHDR", size + size + bytes([8, 2, 0, 0, 0]))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def encoded(mode, kind, value=128, **asked):
    content = io.BytesIO()
    Image.new(mode, (300, 300), value).save(content, kind, **asked)
    return content.getvalue()


def animated():
    frames = [Image.new("RGB", (300, 300), (i, 0, 0)) for i in (10, 200)]
    content = io.BytesIO()
    frames[0].save(content, "GIF", save_all=True, append_images=frames[1:])
    return content.getvalue()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: b"specimen_id,pressure_kPa\n", "not a picture"),
        (lambda: b"", "not a picture"),
        (lambda: encoded("I;16", "PNG"), "8 bits"),
        (lambda: encoded("CMYK", "JPEG", (0, 0, 0, 0)), "CMYK"),
        (animated, "several frames"),
        (bomb, "megapixels"),
        (
            lambda: saved(np.random.default_rng(0).integers(0, 255, (300, 300, 3), dtype=np.uint8))[
                :5000
            ],
            "truncated",
        ),
        (lambda: saved(np.zeros((50, 300, 3), dtype=np.uint8)), "too few"),
    ],
)
def test_a_bad_file_is_one_line(make, words):
    with pytest.raises(BayesdegError, match=words) as caught:
        read_picture("a.jpg", make())
    assert str(caught.value).startswith("a.jpg: ")
    assert "\n" not in str(caught.value)


def test_the_camera_held_upright_is_turned():
    image = np.zeros((300, 400, 3), dtype=np.uint8)
    image[:, :50] = 255
    exif = Image.Exif()
    exif[0x0112] = 6  # turn clockwise
    upright = read_picture("a.jpg", saved(image, "JPEG", exif=exif))
    assert upright.shape == (400, 300, 3)
    assert upright[:40].min() > 200


# ---- the command


def run(*arguments):
    return CliRunner().invoke(app, ["trace", *map(str, arguments)])


def test_the_command_writes_tables_and_a_picture_and_leaves_photographs_alone(tmp_path, bent):
    folder, out = tmp_path / "photos", tmp_path / "out"
    folder.mkdir()
    (folder / "a.png").write_bytes(saved(bent.image))
    (folder / "b.png").write_bytes(b"not a picture")
    about = tmp_path / "photos.csv"
    about.write_text(
        "file,specimen_id,pressure_kPa,degradation_pct\na.png,S1,120,5\nb.png,S2,120,5\n"
    )
    asked = ["--grid", "5 mm", "--length", f"{bent.length:.2f}", "--about", about]
    done = run(folder / "a.png", folder / "b.png", *asked, "--out", out)
    assert isinstance(done.exception, BayesdegError)
    assert str(done.exception).startswith("b.png: ")
    assert sorted(p.name for p in folder.iterdir()) == ["a.png", "b.png"]
    names = ["a_traced.png", "markers.csv", "points.csv", "trace.json", "traces.csv"]
    assert sorted(p.name for p in out.iterdir()) == names
    markers = pd.read_csv(out / "markers.csv")
    assert markers[["specimen_id", "pressure_kPa", "degradation_pct"]].iloc[0].tolist() == [
        "S1",
        120,
        5,
    ]
    assert (markers["sd_mm"] > 0.0).all()
    reading = pd.read_csv(out / "traces.csv").iloc[0]
    angle, length = angle_and_length(markers[["x_mm", "y_mm"]].to_numpy())
    assert -np.degrees(angle) == pytest.approx(reading["bend_angle_deg"], abs=0.02)
    assert length == pytest.approx(reading["length_mm"], abs=0.01)
    again = run(folder / "a.png", *asked, "--hint", out / "points.csv", "--out", tmp_path / "two")
    assert again.exception is None, again.output
    corrected = pd.read_csv(tmp_path / "two" / "traces.csv").iloc[0]
    error = reading["bend_angle_error_deg"]
    assert corrected["bend_angle_deg"] == pytest.approx(reading["bend_angle_deg"], abs=error)


def test_a_photograph_that_the_table_lacks_is_told_before_anything_is_written(tmp_path, bent):
    (tmp_path / "a.png").write_bytes(saved(bent.image))
    about, out = tmp_path / "about.csv", tmp_path / "out"
    about.write_text("file,specimen_id\nother.png,S1\n")
    done = run(tmp_path / "a.png", "--grid", "5", "--about", about, "--out", out)
    assert isinstance(done.exception, BayesdegError)
    assert "about.csv" in str(done.exception)
    assert not out.exists()


def test_nothing_is_written_beside_photographs(tmp_path, bent):
    (tmp_path / "a.png").write_bytes(saved(bent.image))
    done = run(tmp_path / "a.png", "--grid", "5", "--out", tmp_path)
    assert isinstance(done.exception, BayesdegError)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_a_size_that_is_none_is_refused(tmp_path):
    for asked in (["--grid", "five"], ["--length", "-3"], ["--scale", "0"], []):
        assert run(tmp_path / "a.png", *asked, "--out", tmp_path / "out").exit_code == 2


# ---- ends that bend


def rolled(scenes, curvature):
    """The shape at rest, bent into a circle up to its ends, by a curvature of its line [1/mm]."""
    rest = scenes.shapes()[0][0]

    def bent(points):
        turn, height = curvature * points[..., 0], points[..., 1]
        x = np.sin(turn) * (1.0 / curvature + height)
        y = np.cos(turn) * (1.0 / curvature + height) - 1.0 / curvature
        return np.stack([x, y], axis=-1)

    return scenes.Shape(bent(rest.faces), bent(rest.line))


@pytest.mark.parametrize("per_m", [4.363, 11.636, 21.817])
def test_a_strip_that_bends_up_to_its_ends_is_read_within_its_error(scenes, monkeypatch, per_m):
    """It was read 5 % low, its ends being taken for stiff, with a twelfth of that as the error.

    A strip that is hardly bent does not tell: it is still read low, by 1.2 of its errors.
    """
    monkeypatch.setattr(scenes, "drawn_shape", lambda _: rolled(scenes, 1e-3 * per_m))
    off = []
    for seed in range(1, 7):
        one = scenes.scene(seed, megapixels=3, target="grid", method="paper", kind="white")
        found = traced(one, PictureScale(grid=5.0))
        off.append((found.curvature - per_m) / found.curvature_error)
    assert np.max(np.abs(off)) < 3.0
    assert abs(np.mean(off)) < 2.0


def test_stiff_ends_are_seen_to_be_stiff(bent):
    found = traced(bent, PictureScale(grid=5.0))
    assert found.bent_ends < 0.01
    angle, _ = angle_and_length(bent.line)
    assert found.angle == pytest.approx(abs(np.degrees(angle)), abs=2.0 * found.angle_error)


def test_errors_of_moved_points_are_scaled_as_the_angle_is():
    """An angle read through bent ends is larger by 1/(1 - STIFF), and so is its error."""
    places = tuple((10.0 * k, 0.3 * k**2) for k in range(12))
    read = TracedPhotograph(
        pixels=places, errors=((0.01, 0.01),) * 12, to_mm=((0.1, 0, 0), (0, -0.1, 0), (0, 0, 1))
    )
    moved = np.array(places)
    moved[-1, 1] += 1.0
    stiff, bent = (corrected(read.model_copy(update={"bent_ends": p}), moved) for p in (0.1, 0.9))
    for name in ("bend_angle_deg", "bend_angle_error_deg", "curvature_error_per_m"):
        assert getattr(bent, name) == pytest.approx(getattr(stiff, name) / (1 - STIFF), rel=1e-3)
