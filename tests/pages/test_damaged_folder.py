"""A run folder whose files were changed by hand, or by another run: one line, no traceback."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayesdeg.errors import BayesdegError
from bayesdeg.pages.folder import POSTERIOR, RUN_FILES, RunFolder
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.page import build_page
from bayesdeg.pages.tables import TABLES, CellKind
from bayesdeg.records import LARGEST
from tests.pages.synthetic_run import write_full


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "whole"
    write_full(path, "named")
    return path


@pytest.fixture
def run(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    return RunFolder(tmp_path / "run")


NUMBERS = {
    name: next(c.name for c in table.columns if c.kind is CellKind.NUMBER and c.finite)
    for name, table in TABLES.items()
}


def change_cell(folder, name, column, cell):
    path = folder.path / f"{name}.csv"
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    table.loc[len(table) - 1, column] = cell
    table.to_csv(path, index=False)


@pytest.mark.parametrize("cell", ["1e308", "-1e308", "inf", "-inf", "1e999"])
@pytest.mark.parametrize("name", ["observations", "misfit_null", "tensile", "bands", "gain"])
def test_a_number_that_no_run_can_have_found_is_refused(run, name, cell):
    change_cell(run, name, NUMBERS[name], cell)
    with pytest.raises(BayesdegError, match=f"{name}.csv: column .* too large"):
        build_page(run.path)


def test_log_densities_may_be_infinite_but_not_huge(run):
    change_cell(run, "gain", "elpd", "-inf")
    assert np.isneginf(run.read_table("gain")["elpd"].iloc[-1])
    build_page(run.path, Guard(strict=False))
    change_cell(run, "gain", "elpd", "-1e308")
    with pytest.raises(BayesdegError, match="too large"):
        run.read_table("gain")


@pytest.mark.parametrize("name", TABLES)
def test_what_is_not_finite_is_written_as_not_available(name, tmp_path):
    columns = TABLES[name].columns
    cells = {c.name: ["x" if c.kind is CellKind.TEXT else 10.0 * LARGEST] for c in columns}
    cells |= {c.name: [np.inf] for c in columns if c.kind is CellKind.NUMBER and not c.finite}
    cells |= {c.name: [0.0] for c in columns if c.kind is CellKind.LEVEL}
    folder = RunFolder(tmp_path)
    folder.write_table(name, pd.DataFrame(cells))
    back = folder.read_table(name).iloc[0]
    for column in columns:
        if column.kind is CellKind.NUMBER:
            assert np.isnan(back[column.name]) if column.finite else np.isinf(back[column.name])


FORMULAS = ["=1+1", "@a", "+b", "-c", "'=d", "=SUM(A1)", "'quoted'", "-5", "plain", "=a,b"]


def test_no_spreadsheet_takes_a_name_for_a_formula_and_it_comes_back(tmp_path):
    folder = RunFolder(tmp_path)
    frame = pd.DataFrame(
        dict.fromkeys(TABLES["leave_one_out"].headings, 1.0), index=range(len(FORMULAS))
    )
    frame = frame.assign(specimen_id=FORMULAS, kind="curvature", extra=FORMULAS)
    folder.write_table("leave_one_out", frame)
    raw = pd.read_csv(tmp_path / "leave_one_out.csv", dtype=str)
    for name in ("specimen_id", "extra"):
        assert not [c for c in raw[name] if c[0] in "=@+-" and c != "-5"]
        assert folder.read_table("leave_one_out")[name].tolist() == FORMULAS


@pytest.mark.parametrize(
    "number", ["1e308", "1e999", "Infinity", "NaN", "-Infinity", 400 * "9", 5000 * "9"]
)
@pytest.mark.parametrize("document", ["verdict", "run"])
def test_a_number_in_a_document_that_no_run_can_have_found_is_refused(run, document, number):
    content = run.read_json(document)
    key = {"verdict": "misfit", "run": "seconds"}[document]
    content[key] = {"rms_per_m": "HERE", "read": "HERE"}
    (run.path / f"{document}.json").write_text(json.dumps(content).replace('"HERE"', number))
    with pytest.raises(BayesdegError) as caught:
        build_page(run.path)
    assert len(str(caught.value)) < 600


def write_posterior(folder, value=1.0):
    tree = xr.DataTree.from_dict(
        {"posterior": xr.Dataset({"c1_at_0": (("chain", "draw"), np.full((2, 5), value))})}
    )
    folder.write_posterior(POSTERIOR, tree)


def test_a_posterior_of_another_run_is_refused(run):
    write_posterior(run)
    assert list(run.posterior_hashes())[:1] == ["posterior.nc"]
    run.write_json("run", run.read_json("run") | {"posteriors": run.posterior_hashes()})
    run.read_posterior(POSTERIOR)
    write_posterior(run, 2.0)
    with pytest.raises(BayesdegError, match="not the posterior"):
        run.read_posterior(POSTERIOR)


@pytest.mark.parametrize("content", [b"", b"CDF\x01", b"\x89HDF\r\n\x1a\n" + bytes(200)])
def test_a_posterior_that_is_none_is_refused(run, content):
    (run.path / "posterior.nc").write_bytes(content)
    with pytest.raises(BayesdegError, match=r"posterior\.nc: .*again"):
        run.read_posterior(POSTERIOR)


def test_all_files_of_a_run_are_known(run):
    known = {*RUN_FILES}
    assert {p.name for p in run.path.glob("*.csv")} <= known
    assert {"verdict.json", "run.json", "index.html", "posterior.nc"} <= known
