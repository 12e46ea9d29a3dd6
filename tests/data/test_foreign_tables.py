"""Tables of points as other programs write them."""

import numpy as np
import pytest

from bayesdeg.assembly.reading import read_study
from bayesdeg.data.foreign import ForeignTable, translated
from bayesdeg.errors import StudyError

HEADER = ("specimen", "D", "p", "nr", "x", "y")
MAPPING = (
    'columns = { specimen_id = "specimen", degradation_pct = "D", pressure_kPa = "p", '
    'point = "nr", x_mm = "x", y_mm = "y" }'
)


def cells(comma):
    at = np.linspace(0.0, 0.8, 12)
    for k in (1.0, 2.0):
        points = np.column_stack([np.sin(at) * 43.0 / 0.8, (np.cos(at) - 1.0) * 43.0 / 0.8])
        for i, (x, y) in enumerate(points):
            row = ["a", "0", f"{40 * k:g}", str(i + 1), f"{x:.4f}", f"{y:.4f}"]
            yield [cell.replace(".", ",") for cell in row] if comma else row


def write(folder, delimiter, *, comma=False, before="", settings=""):
    rows = [HEADER, *cells(comma)]
    text = before + "".join(delimiter.join(row) + "\n" for row in rows)
    (folder / "markers.csv").write_text(text, encoding="utf-8")
    (folder / "study.toml").write_text(f"seed = 7\n[markers]\n{settings}\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("written", "comma", "before", "form"),
    [
        (",", False, "", {}),
        (";", True, "", {"delimiter": ";", "decimal": ","}),
        ("\t", True, "mass_A\t\t\n", {"delimiter": "tab", "decimal": ",", "skip": 1}),
        (";", False, "", {"delimiter": ";"}),
        ("  ", False, "", {"delimiter": "space"}),
    ],
)
def test_a_foreign_table_is_read_as_the_same_lines(tmp_path, written, comma, before, form):
    settings = "\n".join([MAPPING, *(f"{key} = {value!r}" for key, value in form.items())])
    folder = write(tmp_path, written, comma=comma, before=before, settings=settings)
    read = read_study(folder).actuator
    assert read["pressure_kPa"].tolist() == [40.0, 80.0]
    assert read["curvature_per_m"].to_numpy() == pytest.approx(0.8e3 / 43.0, rel=2e-3)


def test_rows_of_faults_are_those_of_the_file(tmp_path):
    folder = write(tmp_path, ";", before="one\ntwo\n", settings=f'delimiter=";"\nskip=2\n{MAPPING}')
    text = (folder / "markers.csv").read_text().replace("a;0;40;3;", "a;zero;40;3;")
    (folder / "markers.csv").write_text(text)
    with pytest.raises(StudyError) as refused:
        read_study(folder)
    (fault,) = refused.value.faults
    assert (fault.row, fault.column, fault.value) == (6, "degradation_pct", "zero")


def test_points_of_kappa_are_read_with_their_scale(tmp_path):
    """Fiji's plugin writes micrometres, the curve's name, and averages that are passed over."""
    header = '"Curve Name","Average Curvature (um-1)","X-Coordinate (um)","Y-Coordinate (um)","kPa"'
    rows = [f'"{c[0]}","0.1","{1e3 * float(c[4])}","{-1e3 * float(c[5])}","{c[2]}"'
            for c in cells(False)]  # fmt: skip
    (tmp_path / "markers.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    (tmp_path / "study.toml").write_text(
        "[markers]\nconstants = { scale_mm_per_px = 0.001, degradation_pct = 0.0 }\n"
        '[markers.columns]\nspecimen_id = "Curve Name"\npressure_kPa = "kPa"\n'
        'x_px = "X-Coordinate (um)"\ny_px = "Y-Coordinate (um)"\n'
    )
    read = read_study(tmp_path).actuator
    assert read["pressure_kPa"].tolist() == [40.0, 80.0]
    assert read["curvature_per_m"].to_numpy() == pytest.approx(0.8e3 / 43.0, rel=2e-3)


@pytest.mark.parametrize(
    "settings",
    [
        'columns = { x_mm = "no_such" }',
        "constants = {}",
        "constants = { x_mm = [1] }",
        'columns = { x_mm = "x", y_mm = "x" }',
        "columns = {}",
        'columns = "x"',
        "columns = { x_mm = 3 }",
        'delimiter = "|"',
        'decimal = "x"',
        "skip = -1",
        'comma = ","',
    ],
)
def test_a_wrong_form_is_refused_at_its_place(tmp_path, settings):
    with pytest.raises(StudyError) as refused:
        read_study(write(tmp_path, ",", settings=settings))
    assert any(fault.file == "study.toml" for fault in refused.value.faults)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b'"', b'"a;b\n1;2', b"\x00", b";;\n;;;;\n"])
def test_whatever_is_there_is_translated_without_a_fault_of_ours(content):
    form = ForeignTable({"x_mm": "x"}, delimiter=";", decimal=",")
    assert isinstance(translated(content, form, "markers.csv", "study.toml")[0], bytes)


def test_a_table_of_the_contract_is_left_as_it_is():
    content = b"\xef\xbb\xbfx_mm,y_mm\r\n1,2\r\n"
    assert translated(content, ForeignTable(), "markers.csv", "study.toml") == (content, ())
