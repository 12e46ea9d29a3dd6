"""Cells of text → numbers, or what keeps them from being numbers."""

import re

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
#: In every unit of the contract; 1e9 s are thirty years.
LARGEST = 1e9
NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity|na|n/a|null|none|-+|#n/a)", re.IGNORECASE)


def read_number(text: str) -> float | tuple[str, str]:
    """Read the number that a cell holds.

    Parameters
    ----------
    text : str
        The cell, not empty, without blanks around it.

    Returns
    -------
    float or tuple of str
        The number, or the problem and the remedy.

    Examples
    --------
    >>> read_number("2.5e1")
    25.0
    >>> read_number("0,25")
    ('is written with a decimal comma', 'write decimals with a point, 0.25')
    >>> read_number("25 %")
    ('is not a number', 'give the number alone; the unit stands in the header')
    """
    if NUMBER.fullmatch(text):
        value = float(text)
        if abs(value) <= LARGEST:
            return value
        return "is too large for a measured value", f"give a number up to {LARGEST:g}"
    if DECIMAL_COMMA.fullmatch(text):
        point = text.replace(",", ".")
        return "is written with a decimal comma", f"write decimals with a point, {point}"
    if NOT_FINITE.fullmatch(text):
        return "is not a finite number", "leave the cell empty if nothing was recorded"
    if NUMBER.match(text):
        return "is not a number", "give the number alone; the unit stands in the header"
    return "is not a number", "give a number with a decimal point"
