"""Split one CSV file into lines, header and numbers, and find the faults in them."""

import csv
import io
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import pandas as pd

from bayesdeg.errors import Fault, nearest
from bayesdeg.quantities import DIMENSIONLESS, QUANTITIES, stem

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_DIGITS = re.compile(r"(?=.*\d)[+-]?\d*(\.(?P<decimals>\d*))?([eE](?P<exponent>[+-]?\d+))?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
#: 1,000.8 and 1 000.8 and 1.000,8.
THOUSANDS = re.compile(
    r"(?P<whole>[+-]?[1-9]\d{0,2}(?P<mark>[,.'’\s])\d{3}(?:(?P=mark)\d{3})*)(?:[.,](?P<rest>\d*))?"
)
#: One comma before three digits, which may be a decimal comma.
ONE_COMMA = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
#: Dashes that word processors and spreadsheets put in place of a minus.
DASH = re.compile("^[\u2010-\u2015\u2212]\\s*(?=[.\\d])")
#: Invisible characters: zero-width spaces, joiners and marks.
INVISIBLE = re.compile("[\u00ad\u200b-\u200f\u2060\ufeff]")
LINE_END = re.compile("\\s*[\r\n\v\f\x85\u2028\u2029]\\s*")
#: Not normalised: file names are compared with those on disk, sources are quoted.
AS_WRITTEN = ("file", "source")
#: First line in which a spreadsheet declares its separator.
SEPARATOR_LINE = re.compile(r'"?sep=.?"?\s*')
#: Holds in every unit of the contract; 1e9 s are thirty years.
LARGEST = 1e9
NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity|na|n/a|null|none|-+|#n/a)", re.IGNORECASE)


def read_number(text: str) -> float | tuple[str, str]:
    """Read the number in a cell, not empty, without blanks around it; else problem and remedy.

    Examples
    --------
    >>> read_number("2.5e1")
    25.0
    >>> read_number("0,25")
    ('is written with a decimal comma', 'write decimals with a point, 0.25')
    >>> read_number("25 %")
    ('is not a number', 'give the number alone; the unit belongs in the header')
    >>> read_number("1,000.8")
    ('is written with a thousands separator', 'write 1000.8')
    """
    if NUMBER.fullmatch(text):
        value = float(text)
        if abs(value) <= LARGEST:
            return value
        return "is too large for a measured value", f"give a number up to {LARGEST:g}"
    if DASH.match(text):
        return "begins with a dash, not a minus sign", f"use -: {DASH.sub('-', text)}"
    if ONE_COMMA.fullmatch(text):
        point, whole = text.replace(",", "."), text.replace(",", "")
        return "is written with a comma", f"write {point}, or {whole} if it separates thousands"
    if thousands := THOUSANDS.fullmatch(text):
        whole, rest = re.sub(r"[^\d+-]", "", thousands["whole"]), thousands["rest"]
        plain = f"{whole}.{rest}" if rest else whole
        return "is written with a thousands separator", f"write {plain}"
    if DECIMAL_COMMA.fullmatch(text):
        point = text.replace(",", ".")
        return "is written with a decimal comma", f"write decimals with a point, {point}"
    if NOT_FINITE.fullmatch(text):
        return "is not a finite number", "leave the cell empty if nothing was recorded"
    if NUMBER.match(text):
        return "is not a number", "give the number alone; the unit belongs in the header"
    return "is not a number", "give a number with a decimal point"


def least_digit(texts: Iterable[str]) -> float:
    """Return the resolution of the most finely written number: one unit in its last digit.

    Examples
    --------
    >>> least_digit(["0.5", "0.250", "", "1e1"]), least_digit(["1e2", ""])
    (0.001, 100.0)
    """
    exponents = [
        int(number["exponent"] or 0) - len(number["decimals"] or "")
        for number in map(_DIGITS.fullmatch, texts)
        if number is not None
    ]
    return float(f"1e{min(exponents, default=0)}")


IN_QUOTES = 'if a name begins with #, put it in quotation marks: "#1"'


@dataclass(frozen=True)
class Cells:
    """A CSV file as text.

    Parameters
    ----------
    file : str
        Name of the file.
    header_row : int
        Line of the header, counted from 1.
    texts : pandas.DataFrame
        Stripped cells in the form of `normalised`; the index is the line of the file.
    rows_in_comments : tuple of int
        Lines that begin with ``#``, so they are comments, but look like data rows: a specimen's
        name may begin so.
    """

    file: str
    header_row: int
    texts: pd.DataFrame
    rows_in_comments: tuple[int, ...] = ()


def normalised(text: str) -> str:
    r"""Return one form for all texts that look alike.

    Composed letters (NFC), no invisible characters, a blank for each line end, none at either end.

    Examples
    --------
    >>> normalised("A\u200b00a\n"), normalised("gro\u0308sse") == "grösse"
    ('A00a', True)
    """
    return LINE_END.sub(" ", unicodedata.normalize("NFC", INVISIBLE.sub("", text)).strip())


def read_cells(
    content: bytes, file: str, columns: Sequence[str] = ()
) -> tuple[Cells | None, tuple[Fault, ...]]:
    r"""Split a CSV file into cells.

    Lines that begin with ``#``, blank lines, rows of empty cells and a first line ``sep=,`` are
    skipped, but counted.

    Parameters
    ----------
    content : bytes
        The file as stored, with or without byte order mark.
    file : str
        Its name, for the faults.
    columns : sequence of str
        The header must have at least one of these names; a row of numbers is not a header.

    Returns
    -------
    cells : Cells or None
        ``None`` if the file cannot be split.
    faults : tuple of Fault
        Faults of the file as a whole, or wrong numbers of cells in a row. Such a row is omitted.

    Examples
    --------
    >>> cells, _ = read_cells(b"# film 1\nspecimen_id,stretch\na,1.5\n", "tensile.csv")
    >>> cells.header_row, cells.texts.index.tolist(), cells.texts.loc[3, "stretch"]
    (2, [3], '1.5')
    """
    text = _decode(content, file)
    if isinstance(text, Fault):
        return None, (text,)
    rows = _split(text, file)
    if isinstance(rows, Fault):
        return None, (rows,)
    if not rows:
        return None, (Fault(file, "is empty", "give a header and at least one row of data"),)
    header_row, header = rows[0]
    wrong = _wrong_header(header, header_row, file, columns)
    if wrong:
        return None, wrong
    in_comments = _rows_in_comments(text, header, header_row)
    if len(rows) == 1:
        problem, remedy = "has a header but no data", "add rows, or remove the file"
        if in_comments:
            problem += f": {len(in_comments)} lines begin with # and count as comments"
            remedy = IN_QUOTES
        return None, (Fault(file, problem, remedy, header_row),)
    good, faults = list[tuple[int, list[str]]](), list[Fault]()
    for row, cells in rows[1:]:
        if len(cells) == len(header):
            good.append((row, cells))
            continue
        if len(cells) > len(header):
            problem = f"has too many cells: {len(cells)}, but the header has {len(header)}"
            remedy = (
                "write numbers with a decimal point and no thousands separator, and put texts "
                "that contain a comma in quotation marks"
            )
        else:
            problem = f"has too few cells: {len(cells)}, but the header has {len(header)}"
            remedy = "where nothing was recorded, leave the cell empty but keep its comma"
        faults.append(Fault(file, problem, remedy, row, value=",".join(cells)))
    texts = pd.DataFrame(
        [cells for _, cells in good],
        columns=pd.Index(header, dtype=object),
        index=pd.Index([row for row, _ in good], name="row", dtype="int64"),
        dtype=object,
    )
    return Cells(file, header_row, texts, in_comments), tuple(faults)


def _rows_in_comments(text: str, header: list[str], header_row: int) -> tuple[int, ...]:
    """Return comments below the header that have as many cells as it, one of them a number."""
    found = []
    for row, line in enumerate(io.StringIO(text, newline=""), start=1):
        if row <= header_row or not line.startswith("#") or line.count(",") < len(header) - 1:
            continue
        cells = [cell.strip() for cell in line[1:].split(",")]
        if len(cells) == len(header) and any(NUMBER.fullmatch(cell) for cell in cells[1:]):
            found.append(row)
    return tuple(found)


def _decode(content: bytes, file: str) -> str | Fault:
    remedy = "save it as CSV in UTF-8"
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        value = repr(content[error.start : error.start + 1])[2:-1]
        return Fault(file, "is not UTF-8 text", remedy, row, value=value)
    if "\0" in text:
        row = text.count("\n", 0, text.index("\0")) + 1
        return Fault(file, "contains a zero byte, so it is not UTF-8 text", remedy, row)
    return text


def _is_read(column: Sequence[str]) -> bool:
    """Whether the cells of a named column are read; others are kept unchanged."""
    return any(name in QUANTITIES and name not in AS_WRITTEN for name in column)


def _split(text: str, file: str) -> list[tuple[int, list[str]]] | Fault:
    line, start = 0, 1
    rows: list[tuple[int, list[str]]] = []

    def lines() -> Iterator[str]:
        nonlocal line
        for raw in io.StringIO(text, newline=""):
            line += 1
            # the reader must see every line, or line numbers are wrong
            skipped = raw.startswith("#") or (line == 1 and SEPARATOR_LINE.fullmatch(raw))
            yield "\n" if skipped else raw

    try:
        for row in csv.reader(lines(), strict=True):
            header = rows[0][1] if rows else ()
            cells = [
                normalised(cell) if not rows or _is_read(header[i : i + 1]) else cell.strip()
                for i, cell in enumerate(row)
            ]
            if any(cells):
                rows.append((start, cells))
            start = line + 1
    except csv.Error as error:
        remedy = "close every quotation mark and put it around the whole cell"
        return Fault(file, f"cannot be split into cells ({error})", remedy, start)
    return rows


def _wrong_header(
    header: list[str], row: int, file: str, columns: Sequence[str]
) -> tuple[Fault, ...]:
    for separator, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if len(header) == 1 and separator in header[0]:
            problem = f"separates columns by {name}"
            remedy = "separate columns by commas and write decimals with a point"
            return (Fault(file, problem, remedy, row, value=header[0]),)
    if columns and not {*header} & {*columns} and any(NUMBER.fullmatch(name) for name in header):
        remedy = f"begin with a line that names the columns: {', '.join(columns)}"
        return (Fault(file, "has no header", remedy, row, value=",".join(header)),)
    unnamed = [i for i, name in enumerate(header, start=1) if not name]
    faults = [
        Fault(file, f"has no name above column {i}", "name it or remove it", row) for i in unnamed
    ]
    twice = sorted({name for name in header if name and header.count(name) > 1})
    problem, remedy = "is a duplicate column name", "keep one of them"
    return (*faults, *(Fault(file, problem, remedy, row, name) for name in twice))


#: Endings that mark the same quantity in a different unit.
UNITS = frozenset(
    {"pa", "hpa", "kpa", "mpa", "gpa", "bar", "mbar", "psi", "atm", "mmhg", "n_per_mm2"}
    | {"ug", "mg", "g", "kg", "um", "mm", "cm", "m", "per_mm", "per_cm", "per_m", "deg", "rad"}
    | {"ms", "s", "sec", "seconds", "min", "minutes", "h", "hr", "hours", "d", "days"}
    | {"pct", "percent", "frac", "fraction", "ratio"}
)


def check_header(
    names: Sequence[str], place: Fault, *, required: Iterable[str], optional: Iterable[str]
) -> dict[str, Fault]:
    """Find columns that are missing, misspelt or in a different unit.

    A column that is neither listed nor similar to an absent listed one is not a fault: it is kept.

    Parameters
    ----------
    names : sequence of str
        The header as written.
    place : Fault
        Carries file and row of the header.
    required, optional : iterable of str
        Expected columns, each with at most one fault.

    Examples
    --------
    >>> place = Fault("tensile.csv", "", "", 1)
    >>> names = ["stretch", "stress_kPa"]
    >>> faults = check_header(names, place, required=["stretch", "stress_MPa"], optional=[])
    >>> faults["stress_MPa"].column, faults["stress_MPa"].remedy
    ('stress_kPa', 'give it in MPa and name the column stress_MPa')
    """
    required, optional = tuple(required), tuple(optional)
    listed = {*required, *optional}
    there = tuple(listed & set(names))
    twice = {
        column: _in_capitals(name, column, place, is_there=True)
        for column in there
        for name in names
        if name != column and name.casefold() == column.casefold()
    }
    # `stress_MPa_raw` next to `stress_MPa` is the user's own
    unlisted = [name for name in names if name not in listed and not name.startswith(there)]
    faults = twice
    for column in (*required, *optional):
        if column in names:
            continue
        blamed = _blame(column, unlisted, place, is_required=column in required)
        if blamed is not None:
            faults[column] = blamed
            unlisted = [name for name in unlisted if name != blamed.column]
    return faults


def _blame(
    column: str, unlisted: Sequence[str], place: Fault, *, is_required: bool
) -> Fault | None:
    unit = QUANTITIES[column].unit
    wanted = "" if unit == DIMENSIONLESS else f" in {unit}"
    if not is_required:
        unlisted = [name for name in unlisted if not _is_other_quantity(name, column)]
    for name in unlisted:
        if name.casefold() == column.casefold():
            return _in_capitals(name, column, place, is_there=False)
        if _is_other_unit(name, column):
            problem = "has the wrong unit in its name"
            remedy = f"give it{wanted} and name the column {column}"
            return Fault(place.file, problem, remedy, place.row, name)
    best = nearest(column, unlisted, cutoff=0.7 if is_required else 0.8)
    # an unlisted column is the user's own unless it is almost certainly a misspelling
    if best is not None and (is_required or best[0].casefold() == column[0].casefold()):
        problem, remedy = "is not a known column", f"did you mean {column!r}? Rename it"
        return Fault(place.file, problem, remedy, place.row, best)
    if is_required:
        remedy = f"add it: {QUANTITIES[column].meaning}{wanted}"
        return Fault(place.file, "is missing", remedy, place.row, column)
    return None


def _in_capitals(name: str, column: str, place: Fault, *, is_there: bool) -> Fault:
    """Refuse a column name that differs from a known one only in capitals."""
    if is_there:
        problem, remedy = f"duplicates {column} in different capitals", "remove one of them"
    else:
        unit = "" if column == column.lower() else " but for the unit"
        problem, remedy = "is wrongly capitalised", f"write it in lower case{unit}: {column}"
    return Fault(place.file, problem, remedy, place.row, name)


def _is_other_quantity(name: str, column: str) -> bool:
    """Whether a name is a column of a different table; minutes for seconds are a slip."""
    return name in QUANTITIES and stem(name) != name and (name, column) != ("time_min", "time_s")


def _is_other_unit(name: str, column: str) -> bool:
    if QUANTITIES[column].unit == DIMENSIONLESS:
        return False
    start, folded = stem(column).casefold(), name.casefold()
    if folded == start:
        return True
    return folded.startswith(f"{start}_") and folded.removeprefix(f"{start}_") in UNITS
