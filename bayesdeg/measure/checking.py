"""One CSV file → its checked table, or every fault in it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pandera.pandas as pa

from bayesdeg.errors import Fault
from bayesdeg.files import as_named
from bayesdeg.measure.cells import Cells, read_cells
from bayesdeg.measure.header import check_header
from bayesdeg.measure.nearest import use_one_of
from bayesdeg.measure.number import read_number
from bayesdeg.measure.rules import Rule
from bayesdeg.measure.tables import Column, Table, cell_schema, row_schema

#: So many faults of one kind in one column are told one by one.
TOLD_ONE_BY_ONE = 5


@dataclass(frozen=True)
class CheckedTable:
    """What became of a file.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns of the contract in its order, then the extra ones as text. Absent or empty cells
        hold their default, or nan for "not recorded". Only to be used if there is no fault.
    faults : tuple of Fault
        Everything that is wrong with the file.
    recorded : frozenset of str
        Columns in which the file itself gives at least one cell.
    passed_over : int
        Comments that look like rows of data.
    """

    frame: pd.DataFrame
    faults: tuple[Fault, ...]
    recorded: frozenset[str]
    passed_over: int = 0


def check_table(content: bytes, table: Table, *, degradation_sd_pct: float) -> CheckedTable:
    r"""Read one file of a study against its table.

    Parameters
    ----------
    content : bytes
        The file as it is on the disk.
    table : Table
        One of `bayesdeg.measure.tables.TABLES`.
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].

    Returns
    -------
    CheckedTable

    Notes
    -----
    A cell that cannot be read is one fault and takes no part in further checks, so that a single
    slip is told once.

    Examples
    --------
    >>> from bayesdeg.measure.tables import BREAKS
    >>> content = b"specimen_id,degradation_pct,elongation_pct\na,0,210\nb,5,2oo\n"
    >>> print(check_table(content, BREAKS, degradation_sd_pct=1.0).faults[0])
    break.csv, row 3, column elongation_pct, value '2oo': is not a number; give the number alone; the unit stands in the header
    """  # noqa: E501
    cells, faults = read_cells(content, table.file)
    if cells is None:
        return CheckedTable(pd.DataFrame(), faults, frozenset())
    required = [column.name for column in table.columns if column.required]
    optional = [column.name for column in table.columns if not column.required]
    place = Fault(table.file, "", "", cells.header_row)
    names = list(cells.texts.columns)
    blamed = check_header(names, place, required=required, optional=optional)
    cells = replace(cells, texts=_until_rupture(cells.texts))
    frame, wrong_cells = _read_columns(cells, table)
    # what a misspelt column holds is unknown, so its default must not stand in for it
    fillable = tuple(column for column in table.columns if column.name not in blamed)
    frame = _fill(frame, fillable, degradation_sd_pct)
    wrong_rows = tuple(_broken_rules(frame, cells, table, wrong_cells))
    in_order = sorted((*wrong_cells, *wrong_rows), key=lambda fault: fault.row or 0)
    recorded = frozenset(str(name) for name in names if (cells.texts[name] != "").any())
    return CheckedTable(
        _finish(frame, table),
        _capped((*faults, *blamed.values(), *in_order)),
        recorded,
        len(cells.rows_in_comments),
    )


def _until_rupture(texts: pd.DataFrame) -> pd.DataFrame:
    if not {"specimen_id", "ruptured"} <= set(texts.columns):
        return texts
    burst = texts["ruptured"].map(lambda text: text != "" and read_number(text) == 1.0).astype(int)
    earlier = burst.groupby(texts["specimen_id"]).cumsum() - burst
    return texts[earlier == 0]


def _read_columns(cells: Cells, table: Table) -> tuple[pd.DataFrame, tuple[Fault, ...]]:
    faults: list[Fault] = []
    read: dict[str, pd.Series] = {}
    for column in table.columns:
        if column.name in cells.texts:
            read[column.name] = _read_column(cells, column, faults)
    extra = {name: cells.texts[name] for name in cells.texts if name not in read}
    frame = pd.DataFrame(read | extra, index=cells.texts.index)
    failed = list(_failures(frame, table, cells))
    faults += [_fault(cells, row, column.name, *words) for row, column, *words in failed]
    for column in table.columns:
        rows = [row for row, failing, *_ in failed if failing is column]
        if rows:
            frame.loc[rows, column.name] = None if column.kind == "text" else np.nan
    return frame, tuple(faults)


def _read_column(cells: Cells, column: Column, faults: list[Fault]) -> pd.Series:
    values: list[object] = []
    for row, text in cells.texts[column.name].items():
        value: object = None if column.kind == "text" else np.nan
        if text == "":
            if column.required and not column.may_be_empty:
                remedy = "give a value; only optional columns may have empty cells"
                faults.append(_fault(cells, int(str(row)), column.name, "is empty", remedy))
        elif column.kind == "text":
            value = as_named(text)
        else:
            number = read_number(text)
            if isinstance(number, float):
                value = number
            else:
                faults.append(_fault(cells, int(str(row)), column.name, *number))
        values.append(value)
    return pd.Series(values, index=cells.texts.index, dtype=column.dtype)


def _failure_cases(schema: pa.DataFrameSchema, frame: pd.DataFrame) -> pd.DataFrame:
    try:
        schema.validate(frame, lazy=True)
    except pa.errors.SchemaErrors as errors:
        cases: pd.DataFrame = errors.failure_cases
        return cases
    return pd.DataFrame(columns=["column", "check_number", "index"])


def _failures(
    frame: pd.DataFrame, table: Table, cells: Cells
) -> Iterator[tuple[int, Column, str, str]]:
    columns = {column.name: column for column in table.columns}
    cases = _failure_cases(cell_schema(table), frame).drop_duplicates(["column", "index"])
    for name, number, row in zip(
        cases["column"], cases["check_number"], cases["index"], strict=True
    ):
        column = columns[name]
        if number < len(column.demands):
            demand = column.demands[number]
            yield row, column, demand.problem, demand.remedy
        else:
            text = str(cells.texts.loc[row, name])
            yield row, column, "is not known", use_one_of(text, column.one_of)


def _fill(
    frame: pd.DataFrame, columns: tuple[Column, ...], degradation_sd_pct: float
) -> pd.DataFrame:
    filled = frame.copy()
    for column in columns:
        if column.name not in filled and not column.required:
            empty = None if column.kind == "text" else np.nan
            filled[column.name] = pd.Series(empty, index=frame.index, dtype=column.dtype)
        default = column.default
        if column.name == "degradation_sd_pct":
            filled[column.name] = filled[column.name].fillna(degradation_sd_pct)
        elif default is not None and column.name in filled:
            filled[column.name] = filled[column.name].fillna(default)
    return filled


def _broken_rules(
    frame: pd.DataFrame, cells: Cells, table: Table, wrong_cells: tuple[Fault, ...]
) -> Iterator[Fault]:
    spoilt = {(fault.row, fault.column) for fault in wrong_cells}
    repeated = Rule(
        None,
        "repeats an earlier row",
        "remove one of the two",
        tuple(frame.columns),
        lambda rows: ~rows.duplicated(),
    )
    for rule in (repeated, *table.rules):
        if not set(rule.needs) <= set(frame.columns):
            continue
        schema = row_schema(replace(table, rules=(rule,)))
        # a failed row comes once for each of its columns
        for row in sorted(set(_failure_cases(schema, frame)["index"])):
            if spoilt.isdisjoint((row, name) for name in rule.needs):
                yield _fault(cells, row, rule.column, rule.problem, rule.remedy)
            if rule is repeated:
                frame = frame.drop(index=row)


def _fault(cells: Cells, row: int, column: str | None, problem: str, remedy: str) -> Fault:
    if column is None:
        value: str | None = ",".join(str(text) for text in cells.texts.loc[[row]].to_numpy()[0])
    else:
        value = str(cells.texts.loc[row, column]) if column in cells.texts else None
    return Fault(cells.file, problem, remedy, row, column, value)


def _capped(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    kept: list[Fault] = []
    seen: dict[tuple[str | None, str], list[Fault]] = {}
    for fault in faults:
        alike = seen.setdefault((fault.column, fault.problem), [])
        alike.append(fault)
        if len(alike) <= TOLD_ONE_BY_ONE:
            kept.append(fault)
    for alike in seen.values():
        more = len(alike) - TOLD_ONE_BY_ONE
        if more > 0:
            problem = f"{alike[0].problem}: and {more} more such row{'s' if more > 1 else ''}"
            kept.append(replace(alike[0], problem=problem, row=None, value=None))
    return tuple(kept)


def _finish(frame: pd.DataFrame, table: Table) -> pd.DataFrame:
    listed = [column.name for column in table.columns if column.name in frame]
    extra = [name for name in frame.columns if name not in listed]
    finished = frame[[*listed, *extra]].reset_index(drop=True)
    for column in table.columns:
        if column.kind == "whole" and column.name in finished:
            finished[column.name] = finished[column.name].astype("int64")
        elif column.kind == "text" and column.name in finished:
            finished[column.name] = finished[column.name].astype("str")
    for name in extra:
        finished[name] = finished[name].where(finished[name] != "").astype("str")
    return finished
