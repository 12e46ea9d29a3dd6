"""Columns of ``readings.csv``, whatever a study with its own forward map calls them."""

import pandas as pd
import pandera.pandas as pa

from bayesdeg.data.cells import read_cells, read_number
from bayesdeg.data.settings import UserForward
from bayesdeg.data.tables import Table, number, text
from bayesdeg.errors import Fault, use_one_of

NAME, FILE = "readings", "readings.csv"
SPECIMEN, HISTORY, LEVEL, TIME = "specimen_id", "history", "degradation_pct", "time_s"
_WORDS = (SPECIMEN, HISTORY)


def readings_table(
    content: bytes, forward: UserForward, reading: str
) -> tuple[Table, tuple[str, ...], tuple[Fault, ...]]:
    r"""Return the columns of a study's readings, and which of them are inputs.

    Parameters
    ----------
    content : bytes
        The file as stored.
    forward : UserForward
        The study's own forward map.
    reading : str
        The column of readings.

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
    >>> readings_table(content, UserForward("model.py:fall"), "time_s")[1]
    ('height_m',)
    """
    cells, _ = read_cells(content, FILE)
    if cells is None:  # the fault is reported when the cells are read
        return Table(NAME, pa.DataFrameSchema(name=FILE)), (), ()
    there = list(cells.texts.columns)
    inputs = forward.inputs or tuple(
        str(name)
        for name in there
        if name not in (reading, *_WORDS) and _is_of_numbers(cells.texts[name])
    )
    faults = [
        Fault(
            FILE,
            "is missing",
            f"{use_one_of(name, there)} or change "
            f"{'name under [reading]' if name == reading else 'inputs under [forward]'} "
            "in study.toml",
            cells.header_row,
            name,
        )
        for name in (reading, *inputs)
        if name not in there
    ]
    if not inputs:
        remedy = "add a column with the input set for each reading"
        faults.append(Fault(FILE, "has no input besides the reading", remedy, cells.header_row))
    numbers = dict.fromkeys((reading, *inputs))
    columns = {name: text() for name in _WORDS if name in there}
    columns |= {name: number() for name in numbers if name in there and name not in _WORDS}
    return Table(NAME, pa.DataFrameSchema(columns, name=FILE)), inputs, tuple(faults)


def _is_of_numbers(cells: pd.Series) -> bool:
    """Return whether most cells are numbers, so that any other cell is a fault."""
    return 2 * sum(isinstance(read_number(text), float) for text in cells if text) > len(cells)
