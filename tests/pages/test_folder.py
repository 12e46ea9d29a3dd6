import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bayesdeg.errors import BayesdegError
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.tables import TABLES, CellKind
from bayesdeg.records import LARGEST
from tests.pages.synthetic_run import bands, gain, levels, write_full

FLOATS = st.floats(-LARGEST, LARGEST)
NAMES = st.text("abcNA-_ 0123456789,\"'µ%", min_size=1).filter(lambda name: name.strip() == name)


@given(
    rows=st.lists(
        st.tuples(NAMES, FLOATS, st.one_of(st.none(), FLOATS), NAMES), min_size=1, max_size=5
    )
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_table_comes_back_as_it_was_written(rows, tmp_path):
    columns = [column.name for column in TABLES["measured"].columns]
    frame = pd.DataFrame(
        [(name, rate, value, None, unit, 3, "NA") for name, rate, value, unit in rows],
        columns=columns,
    )
    folder = RunFolder(tmp_path)
    folder.write_table("measured", frame)
    back = folder.read_table("measured")
    assert back["quantity"].tolist() == frame["quantity"].tolist()
    assert back["unit"].tolist() == frame["unit"].tolist()
    assert back["degradation_pct"].tolist() == frame["degradation_pct"].tolist()
    expected = [math.nan if value is None else value for _, _, value, _ in rows]
    np.testing.assert_array_equal(back["value"], expected)
    assert back["sd"].isna().all()
    assert back["rests_on"].tolist() == ["NA"] * len(rows)


@pytest.mark.parametrize("name", TABLES)
def test_columns_are_written_in_the_documented_order_with_others_after(name, tmp_path):
    columns = TABLES[name].columns
    cells = {column.name: ["x" if column.kind is CellKind.TEXT else 1.5] for column in columns}
    shuffled = pd.DataFrame({"extra": ["kept"], **dict(reversed(cells.items()))})
    folder = RunFolder(tmp_path)
    folder.write_table(name, shuffled)
    header = (tmp_path / f"{name}.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.split(",") == [*(column.name for column in columns), "extra"]
    assert folder.read_table(name)["extra"].tolist() == ["kept"]


def test_the_contract_columns_come_first():
    names = {name: table.headings for name, table in TABLES.items()}
    assert names["bands"] == ["degradation_pct", "pressure_kPa", "q05", "q25", "q50", "q75", "q95"]
    assert names["rupture"] == [
        "degradation_pct",
        "pressure_kPa",
        "probability",
        "probability_q05",
        "probability_q95",
    ]
    assert names["gain"][2:] == [
        "elpd",
        "elpd_se",
        "elpd_diff",
        "elpd_diff_se",
        "rmse_per_m",
        "crps_per_m",
        "r_squared",
        "coverage_50",
        "coverage_90",
    ]


def test_levels_keep_the_word_all_beside_numbers(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_table("levels", levels(final=True))
    back = folder.read_table("levels")
    assert back["degradation_pct"].iloc[0] == "all"
    assert float(back["degradation_pct"].iloc[2]) == 5.0
    assert back["published_r_squared"].iloc[1] == 0.984


def test_writing_without_a_column_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ValueError, match="column q95 is missing"):
        RunFolder(tmp_path).write_table("bands", bands().drop(columns="q95"))
    assert list(tmp_path.iterdir()) == []


def test_writing_a_word_where_a_number_belongs_is_refused(tmp_path):
    frame = gain("named").assign(degradation_pct="most")
    with pytest.raises(ValueError, match="degradation_pct, row 1: 'most'"):
        RunFolder(tmp_path).write_table("gain", frame)


@pytest.mark.parametrize(
    ("damage", "what"),
    [
        (lambda text: text.replace("q95", "q96", 1), "column q95 is missing"),
        (lambda text: text.replace("20.0", "twenty", 1), "'twenty'"),
        (lambda text: "", "No columns"),
        (lambda text: text + "1,2,3,4,5,6,7,8,9\n", "Expected 7 fields"),
    ],
)
def test_a_damaged_table_says_which_file_and_how_to_mend_it(damage, what, tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_table("bands", bands())
    path = tmp_path / "bands.csv"
    path.write_text(damage(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(BayesdegError) as caught:
        folder.read_table("bands")
    assert "bands.csv" in str(caught.value)
    assert what in str(caught.value)
    assert "--fresh" in str(caught.value)


@pytest.mark.parametrize("name", ["verdict", "run"])
@pytest.mark.parametrize("content", ["{", "[1, 2]", None])
def test_a_damaged_or_missing_document_says_which_file(name, content, tmp_path):
    folder = write_full(tmp_path, "adequate")
    path = tmp_path / f"{name}.json"
    if content is None:
        path.unlink()
    else:
        path.write_text(content, encoding="utf-8")
    with pytest.raises(BayesdegError, match=rf"{name}\.json.*--fresh"):
        folder.read_json(name)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"outcome": "certain"}, "'outcome' must be"),
        ({"candidates": "none"}, "'candidates' must"),
        ({"candidates": ["creep"]}, "'candidates[0]' must"),
        (
            {"misfit": {"p_value": "small"}},
            "'misfit.p_value' must",
        ),
        ({"causes": [1]}, "'causes' must"),
    ],
)
def test_a_verdict_that_breaks_its_format_is_refused(change, what, tmp_path):
    folder = write_full(tmp_path, "named")
    folder.write_json("verdict", folder.read_json("verdict") | change)
    with pytest.raises(BayesdegError) as caught:
        folder.read_verdict()
    assert what in str(caught.value)
    assert "verdict.json" in str(caught.value)


@pytest.mark.parametrize("change", [{"title": None}, {"virtual": "no"}, {"seconds": {"a": "b"}}])
def test_a_run_record_that_breaks_its_format_is_refused(change, tmp_path):
    folder = write_full(tmp_path, "named")
    folder.write_json("run", folder.read_json("run") | change)
    with pytest.raises(BayesdegError, match=r"run\.json"):
        folder.read_run()


def test_numbers_of_numpy_and_infinities_become_plain_json(tmp_path):
    folder = RunFolder(tmp_path)
    folder.write_json(
        "run",
        {"a": np.float64(1.5), "b": np.int64(3), "c": math.inf, "d": np.array([1.0, np.nan])},
    )
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == {
        "a": 1.5,
        "b": 3,
        "c": None,
        "d": [1.0, None],
    }


def test_an_interrupted_write_leaves_the_old_file_and_no_rubbish(tmp_path, monkeypatch):
    folder = RunFolder(tmp_path)
    folder.write_table("bands", bands())
    before = (tmp_path / "bands.csv").read_bytes()

    def stop(self: Path, target: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", stop)
    with pytest.raises(KeyboardInterrupt):
        folder.write_table("bands", bands().iloc[:3])
    assert (tmp_path / "bands.csv").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["bands.csv"]


def test_a_posterior_comes_back_with_its_groups_and_coordinates(tmp_path):
    draws = xr.Dataset(
        {"c1": (("chain", "draw"), np.arange(6.0).reshape(2, 3))}, coords={"chain": [0, 1]}
    )
    observed = xr.Dataset(
        {"curvature": ("observation", [1.0, 2.0])},
        coords={"specimen_id": ("observation", ["A1", "A2"])},
    )
    tree = xr.DataTree.from_dict({"posterior": draws, "observed_data": observed})
    folder = RunFolder(tmp_path)
    folder.write_posterior("posterior", tree)
    back = folder.read_posterior("posterior")
    assert set(back.children) == {"posterior", "observed_data"}
    xr.testing.assert_equal(back["posterior"].to_dataset(), draws)
    assert back["observed_data"]["specimen_id"].to_numpy().tolist() == ["A1", "A2"]
    with pytest.raises(BayesdegError, match=r"posterior_base\.nc is missing"):
        folder.read_posterior("posterior_base")
    (tmp_path / "posterior.nc").write_bytes(b"no netCDF at all")
    with pytest.raises(BayesdegError, match=r"posterior\.nc.*--fresh"):
        folder.read_posterior("posterior")


def test_an_unknown_name_is_refused(tmp_path):
    with pytest.raises(ValueError, match="has no 'band'"):
        RunFolder(tmp_path).read_table("band")


def test_the_verdict_comes_back_as_it_was_written(tmp_path):
    verdict = write_full(tmp_path, "ambiguous").read_verdict()
    assert verdict.causes == ("erosion", "degradation_misread")
    assert verdict.candidates[0].probability == 0.52
    assert next(iter(verdict.candidates[0].effect.values())).q95 == 0.97
    assert verdict.candidates[-1].probability is None
    assert verdict.candidates[-1].why == "needs humidity_pct"
    assert verdict.confusable[0] == ("wall_thickness", "film_mismatch")
    assert verdict.next_experiments[1].expected_log_bayes_factor == 5.3
