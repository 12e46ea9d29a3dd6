import csv
import io
import unicodedata
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bayesdeg.data.study import read_study
from bayesdeg.data.tables import BASE_TABLES, words_of
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.quantities import QUANTITIES, axis_label

FINITE = st.floats(-1e6, 1e6, allow_nan=False)
POSITIVE = st.floats(1e-6, 1e6)
STRETCH = st.floats(1e-6, 50.0)
STRESS = FINITE.filter(lambda value: abs(value) > 1e-6)
# what looks alike is one name, see `normalised`
LABEL = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cs", "Z")), min_size=1, max_size=8
).map(lambda text: unicodedata.normalize("NFC", text))


def read_tables(**texts: str) -> dict[str, pd.DataFrame | None]:
    with TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "study.toml").write_text("[noise]\ndegradation_sd_pct = 0.7\n")
        for name, text in texts.items():
            (folder / BASE_TABLES[name].file).write_bytes(text.encode())
        study = read_study(folder)
    return {name: getattr(study, name) for name in BASE_TABLES}


def to_csv(frame: pd.DataFrame) -> str:
    """Write with the standard library, so that reading is not tested against itself."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(frame.columns)
    for row in frame.itertuples(index=False):
        cells = ["" if pd.isna(cell) else cell for cell in row]
        writer.writerow([repr(float(c)) if isinstance(c, float) else c for c in cells])
    return out.getvalue()


@st.composite
def actuators(draw: st.DrawFn) -> pd.DataFrame:
    blocks = []
    for specimen in draw(st.lists(LABEL, min_size=1, max_size=3, unique=True)):
        rate = draw(st.floats(-5, 100))
        for branch in ("loading", "unloading"):
            pressures = sorted(draw(st.sets(st.floats(0, 300), min_size=1, max_size=5)))
            n = len(pressures)
            blocks.append(
                pd.DataFrame(
                    {
                        "specimen_id": "x" + specimen,
                        "degradation_pct": rate,
                        "degradation_sd_pct": draw(st.floats(0, 5)),
                        "pressure_kPa": pressures if branch == "loading" else pressures[::-1],
                        "curvature_per_m": draw(st.lists(FINITE, min_size=n, max_size=n)),
                        "bend_angle_deg": draw(
                            st.lists(st.one_of(FINITE, st.just(np.nan)), min_size=n, max_size=n)
                        ),
                        "curvature_sd_per_m": draw(st.floats(0, 5)),
                        "bend_angle_sd_deg": draw(st.floats(0, 5)),
                        "cavity_volume_ml": draw(FINITE),
                        "time_s": np.arange(n, dtype=float),
                        "cycle": draw(st.integers(1, 9)),
                        "branch": branch,
                        "humidity_pct": draw(st.floats(0, 100)),
                        "mount": draw(
                            st.sampled_from(["horizontal", "hanging", "bending_up", "bending_down"])
                        ),
                        "temperature_C": draw(st.floats(-20, 90)),
                        "batch": "mixture " + draw(LABEL),
                        "ruptured": 0,
                    }
                )
            )
    frame = pd.concat(blocks, ignore_index=True)
    assume(frame["pressure_kPa"].abs().max() > 1e-3)
    return frame


@settings(max_examples=25, deadline=None)
@given(frame=actuators())
def test_actuator_table_reads_back_equal(frame: pd.DataFrame) -> None:
    got = read_tables(actuator=to_csv(frame))["actuator"]
    pd.testing.assert_frame_equal(got, frame, check_exact=True)


@settings(max_examples=25, deadline=None)
@given(
    rows=st.lists(
        st.tuples(LABEL, st.sampled_from(["uniaxial", "planar"]), STRETCH, STRESS, LABEL),
        min_size=1,
        max_size=6,
        unique_by=lambda row: row[2],
    )
)
def test_tensile_table_keeps_extra_columns_and_reads_back_equal(
    rows: list[tuple[str, str, float, float, str]],
) -> None:
    frame = pd.DataFrame(
        {
            "specimen_id": ["x" + row[0] for row in rows],
            "degradation_pct": 5.0,
            "degradation_sd_pct": 0.7,
            "mode": [row[1] for row in rows],
            "stretch": [row[2] for row in rows],
            "stress_MPa": [row[3] for row in rows],
            "stress_measure": "cauchy",
            "temperature_C": 24.5,
            "batch": ["mixture " + row[0] for row in rows],
            "operator's note": [row[4] for row in rows],
        }
    )
    text = to_csv(frame.drop(columns="degradation_sd_pct"))
    pd.testing.assert_frame_equal(read_tables(tensile=text)["tensile"], frame, check_exact=True)


@settings(max_examples=25, deadline=None)
@given(
    dry=st.lists(POSITIVE, min_size=1, max_size=5),
    gain=st.floats(0.001, 2.6),  # a film holds at least its gelatin and glycerol, 3/11
)
def test_moisture_and_shrinkage_read_back_equal(dry: list[float], gain: float) -> None:
    light = np.array(dry)
    ids = [f"f{i}" for i in range(len(dry))]
    moisture = pd.DataFrame(
        {
            "film_id": ids,
            "time_h": 4.0,
            "mass_equilibrated_g": light * (1 + gain),
            "mass_dry_g": light,
        }
    )
    shrinkage = pd.DataFrame(
        {
            "film_id": ids,
            "mass_poured_g": light * (1 + gain),
            "mass_cured_g": light,
            "mass_conditioned_g": light,
        }
    )
    got = read_tables(moisture=to_csv(moisture), shrinkage=to_csv(shrinkage))
    pd.testing.assert_frame_equal(got["moisture"], moisture, check_exact=True)
    pd.testing.assert_frame_equal(got["shrinkage"], shrinkage, check_exact=True)


def test_defaults_fill_absent_columns_and_empty_cells() -> None:
    got = read_tables(
        actuator="specimen_id,degradation_pct,pressure_kPa,curvature_per_m,mount\n"
        "a,0,0,0,\na,0,20,1.5,hanging\n",
        tensile="specimen_id,degradation_pct,degradation_sd_pct,stretch,stress_MPa\n"
        "t,0,,1.5,0.4\nu,5,0.2,1.5,0.4\n",
    )
    actuator, tensile = got["actuator"], got["tensile"]
    assert actuator is not None
    assert tensile is not None
    assert actuator["mount"].tolist() == ["horizontal", "hanging"]
    assert actuator["branch"].tolist() == ["loading", "loading"]
    assert actuator["cycle"].tolist() == [1, 1]
    assert actuator["ruptured"].tolist() == [0, 0]
    assert actuator["degradation_sd_pct"].tolist() == [0.7, 0.7]
    optional = ["time_s", "humidity_pct", "bend_angle_deg", "temperature_C", "batch"]
    assert actuator[optional].isna().all(axis=None)
    assert tensile["degradation_sd_pct"].tolist() == [0.7, 0.2]
    assert tensile["mode"].tolist() == ["uniaxial", "uniaxial"]
    assert tensile["stress_measure"].tolist() == ["nominal", "nominal"]


def test_rows_after_rupture_are_not_read() -> None:
    got = read_tables(
        actuator="specimen_id,degradation_pct,pressure_kPa,curvature_per_m,ruptured\n"
        "a,0,0,0,0\nb,0,0,0,0\na,0,20,,1\na,0,broken,?,7\nb,0,20,1.5,\n"
    )["actuator"]
    assert got is not None
    assert got["specimen_id"].tolist() == ["a", "b", "a", "b"]
    assert got["ruptured"].tolist() == [0, 0, 1, 0]
    assert got["curvature_per_m"].isna().tolist() == [False, False, True, False]


def test_held_pressure_is_accepted_while_time_goes_on() -> None:
    header = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m,time_s\n"
    got = read_tables(actuator=header + "a,0,20,1.5,0\na,0,20,1.6,5\na,0,40,3.0,6\n")["actuator"]
    assert got is not None
    assert len(got) == 3


def test_slightly_negative_degradation_is_scatter() -> None:
    got = read_tables(breaks="specimen_id,degradation_pct,elongation_pct\nb,-5,200\n")["breaks"]
    assert got is not None
    assert got["degradation_pct"].tolist() == [-5.0]


def test_byte_order_mark_comments_blank_lines_and_line_ends_are_accepted() -> None:
    text = (
        "\ufeff# a\r\nspecimen_id , degradation_pct,elongation_pct\r\n\r\n#b\r\nb1,0, 2.1e2\r\n,,"
    )
    got = read_tables(breaks=text)["breaks"]
    assert got is not None
    assert got.loc[0, ["specimen_id", "elongation_pct"]].tolist() == ["b1", 210.0]
    assert len(got) == 1


def test_texts_may_hold_commas_quotation_marks_and_line_ends() -> None:
    text = (
        "quantity,degradation_pct,value,sd,n,unit,source\n"
        'volume_ratio,,0.62,0.07,4,,"text, ""Scaling\nModel"""\n'
    )
    got = read_tables(summary=text)["summary"]
    assert got is not None
    assert got.loc[0, "source"] == 'text, "Scaling\nModel"'
    assert got.loc[0, "unit"] == "–"
    assert np.isnan(got.loc[0, "degradation_pct"])


def test_hashes_recorded_columns_and_names(tmp_path: Path) -> None:
    content = b"specimen_id,degradation_pct,elongation_pct,degradation_sd_pct\nb,0,200,\n"
    folder = tmp_path / "films"
    folder.mkdir()
    (folder / "study.toml").write_bytes(b'title = "T"')
    (folder / "break.csv").write_bytes(content)
    (folder / "other.csv").write_bytes(b"\xff\xfe;;")
    study = read_study(folder)
    assert (study.name, study.settings.title) == ("films", "T")
    assert study.hashes == {
        "break.csv": sha256(content).hexdigest(),
        "study.toml": sha256(b'title = "T"').hexdigest(),
    }
    expected = {"specimen_id", "degradation_pct", "elongation_pct"}
    assert study.recorded == {"breaks": frozenset(expected)}
    assert study.actuator is None


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
def test_every_column_is_in_the_one_table_of_names(table) -> None:
    for column in table.columns:
        assert QUANTITIES[column].meaning
        assert axis_label(column)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
def test_every_check_has_its_words_and_what_a_missing_file_costs(table) -> None:
    # nothing in the model rests on the control with an enzyme, and no study lacks further kinds
    assert table.cost or table.name == "mass_loss" or table.name not in BASE_TABLES
    assert all(check.error and check.description for check in table.schema.checks)
    for column in table.columns.values():
        assert all(c.error and (c.description or words_of(column)) for c in column.checks)
