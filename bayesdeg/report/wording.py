"""Numbers and names as the reader of the report sees them."""

import math
import re
from collections.abc import Sequence

from bayesdeg.report.record import Outcome

NOTHING = "–"
"""What stands in place of a value that is not available."""

MINUS = "\N{MINUS SIGN}"

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")

BADGES = {
    Outcome.ADEQUATE: "Adequate",
    Outcome.NAMED: "Cause named",
    Outcome.AMBIGUOUS: "Ambiguous",
    Outcome.UNEXPLAINED: "Unexplained",
}


def number(value: float | str | None, digits: int = 3) -> str:
    """Word a number to so many significant digits, without exponents where they can be avoided.

    Parameters
    ----------
    value : float, str or None
        A text is taken as a number if it is one, else given back.
    digits : int
        Significant digits; whole numbers keep all of theirs.

    Returns
    -------
    str

    Examples
    --------
    >>> number(0.23749), number(-1234.56), number(2.0e-7), number(None), number("5.5 times")
    ('0.237', '−1235', '2.00e−7', '–', '5.5 times')
    """
    if isinstance(value, str):
        return number(float(value), digits) if _NUMBER.fullmatch(value) else value or NOTHING
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if exponent < -4 or exponent > 6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}".replace("-", MINUS)
    return f"{value:.{max(digits - 1 - exponent, 0)}f}".replace("-", MINUS)


def count(value: float | None) -> str:
    """Word a count, thousands a narrow space apart.

    Examples
    --------
    >>> count(1204311.0).split()
    ['1', '204', '311']
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def signed(value: float | None, digits: int = 3) -> str:
    """Word a difference with its sign.

    Examples
    --------
    >>> signed(39.5), signed(-2.0)
    ('+39.5', '−2.00')
    """
    text = number(value, digits)
    return f"+{text}" if value is not None and value > 0 else text


def percent(fraction: float | None) -> str:
    """Word a probability or a fraction in percent; never as certain when it is not.

    Examples
    --------
    >>> percent(0.97), percent(0.99997), percent(0.0002), percent(0.0), percent(0.123)
    ('97 %', '> 99.9 %', '< 0.1 %', '0 %', '12 %')
    """
    if fraction is None or not math.isfinite(fraction):
        return NOTHING
    if 0.0 < fraction < 0.001:
        return "< 0.1 %"
    if 0.999 < fraction < 1.0:
        return "> 99.9 %"
    digits = 1 if fraction < 0.0995 or 0.99 < fraction < 1.0 else 0
    return f"{100 * fraction:.{digits}f}".removesuffix(".0").replace("-", MINUS) + " %"


def p_value(value: float | None) -> str:
    """Word a p-value.

    Examples
    --------
    >>> p_value(0.0004), p_value(0.31)
    ('p < 0.001', 'p = 0.31')
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    return "p < 0.001" if value < 0.001 else f"p = {number(value, 2)}"


def words(name: str) -> str:
    """Word a name of the code.

    Examples
    --------
    >>> words("degraded_skin"), words("c2")
    ('degraded skin', 'C2')
    """
    return name.upper() if name in ("c1", "c2", "c3") else name.replace("_", " ")


def listed(names: Sequence[str]) -> str:
    """Join names as a sentence does.

    Examples
    --------
    >>> listed(["degraded_skin", "creep", "erosion"])
    'degraded skin, creep and erosion'
    """
    named = [words(name) for name in names]
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)


def model_words(model: str) -> str:
    """Word the name of a model.

    Examples
    --------
    >>> model_words("base"), model_words("final"), model_words("base+degraded_skin+creep")
    ('base model', 'final model', 'base model + degraded skin + creep')
    """
    if model == "final":
        return "final model"
    return " + ".join("base model" if part == "base" else words(part) for part in model.split("+"))


def level_words(level: str | float) -> str:
    """Word a degradation rate, or all of them.

    Examples
    --------
    >>> level_words("all"), level_words("15.0"), level_words(2.5)
    ('all', '15 %', '2.5 %')
    """
    return "all" if level == "all" else f"{float(level):.3g} %"


def duration(seconds: float) -> str:
    """Word a time span.

    Examples
    --------
    >>> duration(3.21), duration(75), duration(4000)
    ('3.2 s', '1 min 15 s', '1 h 7 min')
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    if seconds < 3600:
        return f"{seconds // 60:.0f} min {seconds % 60:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min"
