"""Lines that a person set: tables of points and regions of ImageJ, as hints and as corrections."""

import io
import zipfile

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from roifile import ROI_TYPE, ImagejRoi
from typer.testing import CliRunner

from bayesdeg.cli import app
from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing import lines
from bayesdeg_camera.tracing.lines import ANY, line_of, parse_lines
from bayesdeg_camera.tracing.trace import PictureScale, angle_and_length, trace_line

LINE = np.array([[10.5, 20.25], [30.0, 22.0], [50.0, 30.0], [70.0, 45.5]])


def region(points=LINE, kind=ROI_TYPE.POLYLINE, name=""):
    made = ImagejRoi.frompoints(points, name=name)
    made.roitype = kind
    return made.tobytes()


def archive(entries):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as written:
        for name, content in entries.items():
            written.writestr(name, content)
    return made.getvalue()


# ---- what is read


@pytest.mark.parametrize("kind", [ROI_TYPE.POLYLINE, ROI_TYPE.FREELINE, ROI_TYPE.POINT])
def test_a_region_of_imagej_is_its_points(kind):
    found = parse_lines("a.roi", region(kind=kind))
    assert found[ANY] == pytest.approx(LINE, abs=1e-5)


def test_a_set_of_regions_is_told_by_their_names():
    content = archive(
        {
            "0001.roi": region(name="one.jpg"),
            "0002.roi": region(LINE + 5.0, name="two"),
            "notes.txt": b"no region",
        }
    )
    found = parse_lines("RoiSet.zip", content)
    assert list(found) == ["one.jpg", "two"]
    assert line_of(found, "two.png") == pytest.approx(LINE + 5.0, abs=1e-5)
    assert line_of(found, "three.png") is None


def test_a_set_of_one_region_is_of_any_photograph():
    assert list(parse_lines("RoiSet.zip", archive({"0001.roi": region()}))) == [ANY]


def test_points_that_were_set_twice_count_once():
    twice = np.repeat(LINE, 2, axis=0)
    table = pd.DataFrame(twice, columns=["x_px", "y_px"]).to_csv(index=False)
    assert parse_lines("a.csv", table.encode())[ANY] == pytest.approx(LINE)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"Iout",
        b"Iout\x00\xe4\x05",
        region()[:50],
        b"PK\x03\x04",
        archive({})[:-3],
        archive({"a.txt": b"x"}),
        archive({"a.roi": b"Iout"}),
        archive({"a.roi": b"x" * 3_000_000}),
        region(kind=ROI_TYPE.POLYGON),
        region(kind=ROI_TYPE.OVAL),
        region(LINE[:1]),
        b"\xff\xfe\x00\x01",
        b"x_px\n3\n",
        b"x_px,y_px\n1,2\n",
        b"x_px,y_px\n1,2\nx,4\n",
        b"x_px,y_px\n1,2\n1,2\n",
        b"file,x_px,y_px\na.jpg,1,2\n",
    ],
)
def test_what_holds_no_line_is_refused_in_one_line(content):
    with pytest.raises(BayesdegError) as refused:
        parse_lines("lines.x", content)
    assert str(refused.value).startswith("lines.x: ")
    assert "; " in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_set_of_very_many_regions_is_not_read(monkeypatch):
    monkeypatch.setattr(lines, "MOST_REGIONS", 3)
    many = archive({f"{i}.roi": region() for i in range(4)})
    with pytest.raises(BayesdegError, match="claims too many"):
        parse_lines("RoiSet.zip", many)


# ---- what becomes of it


@pytest.fixture(scope="module")
def bent(scenes):
    return scenes.scene(5, megapixels=3, target="grid", method="paper", kind="white")


@pytest.fixture
def photograph(bent, tmp_path):
    (tmp_path / "photos").mkdir()
    path = tmp_path / "photos" / "a.png"
    Image.fromarray(np.ascontiguousarray(bent.image[:, :, ::-1])).save(path)
    return path


def by_hand(one, count=14):
    return one.line_px[np.linspace(0, len(one.line_px) - 1, count).astype(int)]


def test_a_line_is_taken_as_it_is_with_the_error_of_a_hand(bent):
    rng = np.random.default_rng(1)
    found = trace_line(bent.image, PictureScale(grid=5.0), by_hand(bent), rng=rng)
    angle, length = angle_and_length(bent.line)
    assert found.length == pytest.approx(length, rel=0.01)
    assert found.angle == pytest.approx(-np.degrees(angle), abs=3.0 * found.angle_error)
    assert found.angle_error > 1.0
    # from the clamp, bending towards the paper
    assert found.pixels[0] == pytest.approx(bent.line_px[0], abs=1e-6)
    assert found.points[0].tolist() == [0.0, 0.0]
    assert found.points[-1, 1] < -5.0
    assert found.doubts == ()


def test_a_point_that_is_set_twice_counts_once(bent):
    line, scale = by_hand(bent), PictureScale(grid=5.0)
    once, twice = (
        trace_line(bent.image, scale, points, rng=np.random.default_rng(1))
        for points in (line, np.repeat(line, 2, axis=0))
    )
    assert twice.angle == once.angle
    np.testing.assert_array_equal(twice.points, once.points)


def test_a_line_from_the_other_side_of_the_actuator_bends_towards_its_paper_too(bent):
    image = np.ascontiguousarray(bent.image[:, ::-1])
    line = [bent.image.shape[1] - 1, 0] + by_hand(bent) * [-1, 1]
    scale, rng = PictureScale(length=bent.length), np.random.default_rng(1)
    found = trace_line(image, scale, line, rng=rng)
    assert found.angle > 0.0
    assert found.points[-1, 1] < -5.0
    assert found.pixels[0] == pytest.approx(line[0])


@pytest.mark.parametrize("line", [LINE[:3], LINE + 1e5])
def test_a_line_of_few_points_or_elsewhere_is_refused(bent, line):
    with pytest.raises(BayesdegError):
        trace_line(bent.image, PictureScale(grid=5.0), line, rng=np.random.default_rng(1))


def run(*words):
    return CliRunner().invoke(app, ["trace", *map(str, words)])


@pytest.mark.parametrize("option", ["--line", "--hint"])
def test_the_command_takes_a_region_of_imagej(option, bent, photograph, tmp_path):
    (tmp_path / "RoiSet.zip").write_bytes(archive({"1.roi": region(by_hand(bent), name="a.png")}))
    done = run(photograph, "--grid", 5, option, tmp_path / "RoiSet.zip", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    row = pd.read_csv(tmp_path / "out" / "traces.csv").iloc[0]
    assert row["corrected"] == (option == "--line")
    assert row["length_mm"] == pytest.approx(bent.length, rel=0.01)
    assert sorted(p.name for p in photograph.parent.iterdir()) == ["a.png"]


def test_edited_points_are_given_back_as_a_correction(photograph, tmp_path):
    first = run(photograph, "--grid", 5, "--out", tmp_path / "one")
    assert first.exit_code == 0
    points = pd.read_csv(tmp_path / "one" / "points.csv")
    points["y_px"] += 2.0
    points.to_csv(tmp_path / "edited.csv", index=False)
    asked = ("--grid", 5, "--line", tmp_path / "edited.csv", "--out", tmp_path / "two")
    assert run(photograph, *asked).exit_code == 0
    again = pd.read_csv(tmp_path / "two" / "points.csv")
    assert again["y_px"].iloc[0] == pytest.approx(points["y_px"].iloc[0], abs=0.01)
    # not over what was corrected
    assert isinstance(run(photograph, *asked).exception, BayesdegError)
