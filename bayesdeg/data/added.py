"""Add rows to the actuator.csv of a study that was read before."""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import pandas as pd
import pandera.pandas as pa

from bayesdeg.data.cells import read_cells, read_number
from bayesdeg.data.study import CheckedTable, check_table
from bayesdeg.data.tables import ACTUATOR
from bayesdeg.errors import Fault, StudyError, use_one_of

FILE = "actuator.csv"
SPECIMEN, PRESSURE = "specimen_id", "pressure_kPa"
CYCLE, BRANCH, TIME = "cycle", "branch", "time_s"
_ORIGIN = "__origin__"


@dataclass(frozen=True)
class ExtendedTable:
    """A table of actuators with added rows.

    Parameters
    ----------
    table : CheckedTable
        All rows, checked together.
    added : bytes
        All rows added so far, as a CSV file.
    specimens : tuple of str
        Specimens with new rows.
    rows : int
        Number of new rows.
    filled : tuple of str
        Columns in which new rows have a value.
    """

    table: CheckedTable
    added: bytes
    specimens: tuple[str, ...]
    rows: int
    filled: tuple[str, ...] = ()


def extend(
    recorded: bytes,
    earlier: bytes | None,
    new: bytes,
    file: str,
    *,
    degradation_sd_pct: float,
) -> ExtendedTable:
    r"""Add rows to a table of actuators.

    A row of a known specimen is inserted by pressure in its cycle and branch; a row with a time, or
    of a different cycle, is appended to the specimen.

    Parameters
    ----------
    recorded : bytes
        The ``actuator.csv`` of the study.
    earlier : bytes, optional
        Rows added before.
    new : bytes
        The new rows, with the columns of ``actuator.csv``.
    file : str
        Name of the new file, for messages.
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].

    Raises
    ------
    StudyError
        Lists every fault of the new rows.

    Examples
    --------
    >>> head = b"specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
    >>> found = extend(head + b"a,0,20,1\na,0,60,3\n", None, head + b"a,0,40,2\n", "new.csv",
    ...                 degradation_sd_pct=1.0)
    >>> found.table.frame["pressure_kPa"].tolist(), found.specimens
    ([20.0, 40.0, 60.0], ('a',))
    """
    before = _texts(recorded, FILE)
    known = None if earlier is None else _texts(earlier, FILE)
    if known is not None:
        before = _merged(before, known)
    rows = _texts(new, file)
    faults = list(_alone(new, file, rows, before, degradation_sd_pct))
    if faults:
        raise StudyError(faults)
    whole = _merged(before, rows)
    table = check_table(
        _to_csv(whole.drop(columns=_ORIGIN)), ACTUATOR, degradation_sd_pct=degradation_sd_pct
    )
    faults = [_placed(fault, whole, file) for fault in table.faults]
    faults += [] if faults else _after_rupture(table.frame, whole, file)
    if faults:
        raise StudyError(faults)
    added = (rows if known is None else pd.concat([known, rows])).fillna("")
    specimens = tuple(dict.fromkeys(rows[SPECIMEN].tolist()))
    filled = tuple(str(n) for n in rows if n != _ORIGIN and (rows[n].str.strip() != "").any())
    return ExtendedTable(table, _to_csv(added.drop(columns=_ORIGIN)), specimens, len(rows), filled)


def _texts(content: bytes, file: str) -> pd.DataFrame:
    """Return cells as text, with file and line of each row."""
    cells, faults = read_cells(content, file)
    if cells is None or faults:
        raise StudyError(faults)
    texts = cells.texts.reset_index(drop=True)
    texts[_ORIGIN] = [(file, int(str(line))) for line in cells.texts.index]
    return texts


def _alone(
    content: bytes, file: str, rows: pd.DataFrame, before: pd.DataFrame, sd: float
) -> Iterator[Fault]:
    """Yield faults of the new rows on their own."""
    named = pa.DataFrameSchema(dict(ACTUATOR.columns), list(ACTUATOR.checks), name=file)
    found = check_table(content, named, degradation_sd_pct=sd).faults
    yield from found
    known = [*ACTUATOR.columns, *(n for n in before if n not in (*ACTUATOR.columns, _ORIGIN))]
    for name in rows:
        if name not in (*known, _ORIGIN, *(fault.column for fault in found)):
            problem = f"is not a column of {FILE}"
            yield Fault(file, problem, use_one_of(str(name), known), 1, str(name))


def _merged(before: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """Return all rows, grouped by specimen."""
    whole = before
    for specimen, new in rows.groupby(SPECIMEN, sort=False):
        for _, row in new.iterrows():
            one = row.to_frame().T
            place = _place(whole, str(specimen), row)
            whole = pd.concat([whole.iloc[:place], one, whole.iloc[place:]], ignore_index=True)
    return whole.fillna("")


def _place(whole: pd.DataFrame, specimen: str, row: pd.Series) -> int:
    """Return the position at which a specimen's new row is inserted."""
    own = [i for i, name in enumerate(whole[SPECIMEN]) if name == specimen]
    if not own:
        return len(whole)
    alike = [i for i in own if _path(whole.iloc[i]) == _path(row)]
    if not alike or row.get(TIME, ""):
        return own[-1] + 1
    down = _path(row)[1] == "unloading"
    here = _number(row[PRESSURE])
    passed = [
        i for i in alike
        if (value := _number(whole.loc[i, PRESSURE])) == here or (value > here) is down
    ]  # fmt: skip
    return passed[-1] + 1 if passed else alike[0]


def _path(row: pd.Series) -> tuple[float, str]:
    """Return cycle and branch of a row; empty cells mean the first loading."""
    return _number(row.get(CYCLE) or "1"), str(row.get(BRANCH) or "loading")


def _number(text: object) -> float:
    value = read_number(str(text))
    return value if isinstance(value, float) else float("nan")


def _to_csv(texts: pd.DataFrame) -> bytes:
    """Return cells as a file, quoting names that would read as comments."""
    hashed = any(str(cell).startswith("#") for cell in texts.iloc[:, 0])
    text = io.StringIO()
    texts.to_csv(text, index=False, quoting=csv.QUOTE_ALL if hashed else csv.QUOTE_MINIMAL)
    return text.getvalue().encode("utf-8")


def _placed(fault: Fault, whole: pd.DataFrame, file: str) -> Fault:
    """Return a fault of the merged rows at its place in the user's file."""
    if fault.row is None:
        return replace(fault, file=file)
    where, line = whole[_ORIGIN].iloc[fault.row - 2]
    return replace(fault, file=where, row=line)


def _after_rupture(frame: pd.DataFrame, whole: pd.DataFrame, file: str) -> Sequence[Fault]:
    """Return faults for new rows that follow their specimen's rupture."""
    kept = frame[SPECIMEN].value_counts()
    return [
        Fault(
            file,
            "has rows at pressures after it burst",
            "remove rows after the rupture; give a different actuator a different specimen_id",
            specimen=str(name),
        )
        for name, there in whole.groupby(SPECIMEN, sort=False)
        if len(there) > kept.get(name, 0) and any(where == file for where, _ in there[_ORIGIN])
    ]
