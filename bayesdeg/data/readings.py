"""Columns of ``readings.csv``, whatever a study with its own forward map calls them."""

import pandera.pandas as pa

from bayesdeg.data.cells import Cells, read_cells, read_number
from bayesdeg.data.settings import UserForward
from bayesdeg.data.tables import Table, number, text
from bayesdeg.errors import Fault, use_one_of

NAME, FILE = "readings", "readings.csv"
SPECIMEN, HISTORY, LEVEL, TIME = "specimen_id", "history", "degradation_pct", "time_s"
_WORDS = (SPECIMEN, HISTORY)


def readings_table(
    content: bytes, forward: UserForward
) -> tuple[Table, tuple[str, ...], tuple[Fault, ...]]:
    r"""Return the columns of a study's readings, and which of them are inputs.

    Parameters
    ----------
    content : bytes
        The file as stored.
    forward : UserForward
        As stated by the study.

    Returns
    -------
    table : Table
        With the columns that exist and are used; others are kept as text.
    inputs : tuple of str
        Columns given to the forward map: those that the study names, or all numeric ones except the
        reading.
    faults : tuple of Fault
        Columns that are missing.

    Examples
    --------
    >>> content = b"specimen_id,height_m,observer,time_s\na,1.0,Ada,0.45\n"
    >>> readings_table(content, UserForward("model.py:fall", reading="time_s"))[1]
    ('height_m',)
    """
    cells, _ = read_cells(content, FILE)
    if cells is None:  # the fault is reported when the cells are read
        return Table(NAME, pa.DataFrameSchema(name=FILE)), (), ()
    there = list(cells.texts.columns)
    inputs = _inputs(cells, forward)
    missing = [name for name in (forward.reading, *inputs) if name not in there]
    faults = [
        Fault(FILE, "is missing", f"{use_one_of(name, there)} {_where(name, forward)}",
              cells.header_row, name)
        for name in missing
    ]  # fmt: skip
    if not inputs:
        remedy = "add a column with the input set for each reading"
        faults.append(Fault(FILE, "has no input besides the reading", remedy, cells.header_row))
    numbers = dict.fromkeys((forward.reading, *inputs))
    columns = {name: text() for name in _WORDS if name in there}
    columns |= {name: number() for name in numbers if name in there and name not in _WORDS}
    return Table(NAME, pa.DataFrameSchema(columns, name=FILE)), inputs, tuple(faults)


def _inputs(cells: Cells, forward: UserForward) -> tuple[str, ...]:
    if forward.inputs is not None:
        return forward.inputs
    return tuple(
        str(name)
        for name in cells.texts
        if name not in (forward.reading, *_WORDS) and _is_of_numbers(cells, str(name))
    )


def _is_of_numbers(cells: Cells, name: str) -> bool:
    """Return whether most cells are numbers, so that any other cell is a fault."""
    texts = cells.texts[name]
    return 2 * sum(isinstance(read_number(text), float) for text in texts if text) > len(texts)


def _where(name: str, forward: UserForward) -> str:
    key = "name under [reading]" if name == forward.reading else "inputs under [forward]"
    return f"or change {key} in study.toml"
