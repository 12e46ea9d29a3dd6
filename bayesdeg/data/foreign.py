"""Convert a table written by a different program: column names, delimiter, decimals."""

import csv
import io
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Literal

from annotated_types import Interval, Len
from pydantic import AfterValidator, ConfigDict, Strict
from pydantic.dataclasses import dataclass

from bayesdeg.errors import Fault, use_one_of

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "\t": "\t", "space": " "}
_POINT, _OF_A_LINE = "point", ("specimen_id", "pressure_kPa")


def _of_other_names(columns: dict[str, str]) -> dict[str, str]:
    if not columns or len(set(columns.values())) < len(columns) or not all(columns.values()):
        raise ValueError("duplicate or empty column name")
    return columns


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class ForeignTable:
    """Format of a table exported by a different program.

    Parameters
    ----------
    columns : mapping of str to str
        Maps columns of the contract to those of the file; other columns keep their names.
    delimiter : {",", ";", "tab", "space"}
        Separator of cells.
    decimal : {".", ","}
        Decimal separator.
    skip : int
        Lines before the header.
    constants : mapping of str to str or float
        Columns of the contract that the file lacks, with their value in every row.
    """

    columns: Annotated[Mapping[str, str], AfterValidator(_of_other_names)] = field(
        default_factory=dict,
        metadata={"accepts": 'a table of names, { x_mm = "X", y_mm = "Y" }'},
    )
    constants: Annotated[Mapping[str, Annotated[float, Strict()] | str], Len(1)] = field(
        default_factory=dict,
        metadata={"accepts": "a table of values, { scale_mm_per_px = 0.001 }"},
    )
    delimiter: Literal[",", ";", "tab", "\t", "space"] = field(
        default=",", metadata={"accepts": 'one of ",", ";", "tab", "space"'}
    )
    decimal: Literal[".", ","] = field(default=".", metadata={"accepts": 'one of "." or ","'})
    skip: Annotated[int, Strict(), Interval(ge=0, le=100)] = field(
        default=0, metadata={"accepts": "a whole number from 0 to 100"}
    )


def translated(
    content: bytes, form: ForeignTable, file: str, settings: str
) -> tuple[bytes, tuple[Fault, ...]]:
    r"""Return a table in the contract's format, line by line, and faults of the mapping.

    Unnumbered points are counted, from 1 for each specimen and pressure.

    Parameters
    ----------
    content : bytes
        The file as stored.
    form : ForeignTable
        Its format.
    file, settings : str
        Names of the file, and of the file that states its format.

    Examples
    --------
    >>> form = ForeignTable({"x_mm": "x"}, delimiter=";", decimal=",", skip=1)
    >>> translated(b"mass A\nx;y_mm\n0,5;1\n", form, "markers.csv", "study.toml")[0]
    b'# mass A\nx_mm,y_mm,point\n0.5,1,1\n'
    """
    if form == ForeignTable():
        return content, ()
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:  # the fault is reported when the cells are read
        return content, ()
    rows = [f"# {line}" if number < form.skip else line for number, line in enumerate(lines)]
    there = {column: name for name, column in form.columns.items()}
    header: list[str] | None = None
    line_of_points, point, written = list[str | None](), 0, io.StringIO()
    write = csv.writer(written, lineterminator="\n")
    for line in rows:
        if line.startswith("#") or not line.strip():
            written.write(line + "\n")
            continue
        cells = _cells(line, form)
        if header is None:
            header = cells
            names = [there.get(cell, cell) for cell in cells]
            added = [name for name in form.constants if name not in names]
            numbered = _POINT in names or _POINT in added
            write.writerow([*names, *added, *([] if numbered else [_POINT])])
        else:
            whole = [*cells, *(str(form.constants[name]) for name in added)]
            of_row = dict(zip([*names, *added], whole, strict=False))
            here = [of_row.get(name) for name in _OF_A_LINE]
            point = point + 1 if here == line_of_points else 1
            line_of_points = here
            write.writerow(whole if numbered else [*whole, str(point)])
    missing = [column for column in there if column not in (header or [])]
    place = "markers.columns"
    return written.getvalue().encode(), tuple(
        Fault(
            settings, f"is no column of {file}", use_one_of(name, header or []), None, place, name
        )
        for name in missing
    )


def _cells(line: str, form: ForeignTable) -> list[str]:
    delimiter = DELIMITERS[form.delimiter]
    reader = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    try:
        cells = [cell.strip() for cell in next(reader)]
    except csv.Error:  # kept unchanged; its cells are refused later
        return [line]
    if form.delimiter == "space":
        cells = [cell for cell in cells if cell]
    if form.decimal == ",":
        cells = [cell.replace(",", ".", 1) if _is_number(cell) else cell for cell in cells]
    return cells


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", ".", 1))
    except ValueError:
        return False
    return cell.count(",") == 1 and "." not in cell
