"""Numbers and names as text for the report."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from bayesdeg.quantities import p_value_text

SPACE = "\N{NO-BREAK SPACE}"

NOTHING = "–"
"""Shown for a value that is not available."""

MINUS = "\N{MINUS SIGN}"

LARGE = 100.0  # from which a number needs no decimals
LARGE_ERROR = 10.0  # from which a standard error needs no decimals

_PROPER = {
    "c1": "C1",
    "cauchy_stress": "Cauchy stress",
    "c2": "C2",
    "c3": "C3",
    "young_modulus": "Young's modulus",
    "modulus_100": "100 % modulus",
    "neo_hookean": "neo-Hookean",
    "mooney_rivlin": "Mooney–Rivlin",
    "yeoh": "Yeoh",
    "gent": "Gent",
    "ogden": "Ogden",
    "r_squared": "R²",
    "mullins": "Mullins",
}
_NUMBER_WITH_UNIT = re.compile(r"(\d) (%|kPa|MPa|1/m|mm\b|s\b|h\b)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def number(value: float | str | None, digits: int = 3) -> str:
    """Format a number with this many significant digits, avoiding exponents where possible.

    Parameters
    ----------
    value : float, str or None
        A text that is not a number is returned unchanged.
    digits : int
        Significant digits; whole numbers keep all of theirs.

    Returns
    -------
    str

    Examples
    --------
    >>> number(0.23749), number(-1234.56), number(2.0e-7), number(None), number("5.5 times")
    ('0.237', '−1235', '2.00e−7', '–', '5.5 times')
    >>> number("0.5"), number("2")
    ('0.500', '2')
    """
    if isinstance(value, str):
        if value.isdecimal():  # a count
            return count(float(value))
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


def fixed(value: float | None, decimals: int = 2, *, sign: bool = False) -> str:
    """Format a number with this many decimals, or none from 100 on.

    It gets more decimals only if it would otherwise round to zero.

    Parameters
    ----------
    value : float or None
        The number.
    decimals : int
        Digits after the point.
    sign : bool
        Whether a positive number gets a plus.

    Examples
    --------
    >>> fixed(0.7099), fixed(41.23, 1, sign=True), fixed(-2.0, 1), fixed(609.5, 1), fixed(0.0012)
    ('0.71', '+41.2', '−2.0', '610', '0.001')
    """
    large = value is not None and abs(value) >= LARGE
    return _to_decimals(value, 0 if large else decimals, sign=sign)


def _to_decimals(value: float | None, decimals: int, *, sign: bool = False) -> str:
    if value is None or not math.isfinite(value):
        return NOTHING
    small = 0.0 < abs(value) < 10.0**-decimals
    text = number(value, 1) if small else f"{value:.{decimals}f}".replace("-", MINUS)
    return f"+{text}" if sign and value > 0 else text


def count(value: float | None) -> str:
    """Format a count with narrow spaces between thousands.

    Examples
    --------
    >>> count(1204311.0).split()
    ['1', '204', '311']
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def percent(fraction: float | None) -> str:
    """Format a probability or fraction in percent, never as certain when it is not.

    Examples
    --------
    >>> [percent(value).replace(SPACE, " ") for value in (0.97, 0.99997, 0.0002, 0.0, 0.063)]
    ['97 %', '> 99.9 %', '< 0.1 %', '0 %', '6.3 %']
    """
    if fraction is None or not math.isfinite(fraction):
        return NOTHING
    if 0.0 < fraction < 0.001:
        return f"<{SPACE}0.1{SPACE}%"
    if 0.999 < fraction < 1.0:
        return f">{SPACE}99.9{SPACE}%"
    digits = 1 if fraction < 0.0995 or 0.99 < fraction < 1.0 else 0
    return f"{100 * fraction:.{digits}f}".removesuffix(".0").replace("-", MINUS) + f"{SPACE}%"


def chance(probability: float | None, checks: float | None = None, *, short: bool = False) -> str:
    """Format a probability that rests on this many checks; below one in that many it is a bound.

    Parameters
    ----------
    probability : float or None
        As computed.
    checks : float or None
        Specimens, draws or simulated data sets that it rests on; None if unknown.
    short : bool
        Shorter form, for narrow tables.

    Examples
    --------
    >>> [chance(value, 50).replace(SPACE, " ") for value in (2e-80, 0.02, 0.3, None)]
    ['less than 1 in 50', 'less than 1 in 50', '30 %', '–']
    >>> chance(0.01, 50, short=True).replace(SPACE, " ")
    '< 1 in 50'
    """
    if probability is None or not math.isfinite(probability):
        return NOTHING
    if checks and probability <= (1.0 + 1e-9) / checks:
        return f"{'<' if short else 'less than'} 1 in {checks:.0f}".replace(" ", SPACE)
    return percent(probability)


def interval(low: str, high: str) -> str:
    """Format an interval from the text of its ends.

    Examples
    --------
    >>> interval("2 %", "5 %"), interval("less than 1 in 50", "less than 1 in 50")
    ('2 % to 5 %', 'less than 1 in 50')
    """
    return low if low == high else f"{low} to {high}"


def ends(pair: Sequence[float], between: str = "–") -> str:
    """Format the ends of a range, which may coincide.

    Examples
    --------
    >>> ends((20.0, 80.0)), ends((11.2, 11.4), " to "), ends((11.0, 11.0)), ends((800.0, 1250.0))
    ('20–80', '11.2 to 11.4', '11', '800–1250')
    """
    low, high = (f"{end:.3g}" if abs(end) < 1000.0 else f"{end:.0f}" for end in pair)
    return low if low == high else f"{low}{between}{high}"


def plus_minus(value: float | None, error: float | None, *, sign: bool = False) -> str:
    """Format a number and its standard error, without meaningless decimals.

    Examples
    --------
    >>> plus_minus(227.57, 18.68), plus_minus(-4.51, 0.04), plus_minus(3.94, 4.0, sign=True)
    ('228 ± 19', '−4.5 ± 0.04', '+3.9 ± 4.0')
    """
    large = error is not None and math.isfinite(error) and abs(error) >= LARGE_ERROR
    decimals = 0 if large else 1
    return f"{_to_decimals(value, decimals, sign=sign)} ± {_to_decimals(error, decimals)}"


def p_value(value: float | None, replicates: float | None = None) -> str:
    """Format a p-value on one line; ``replicates`` are the simulated data sets behind it.

    Examples
    --------
    >>> p_value(0.0004).replace(SPACE, " "), p_value(1 / 501, 500).replace(SPACE, " ")
    ('p < 0.001', 'p < 0.002')
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    return p_value_text(value, replicates).replace(" ", SPACE)


def strength(log_bayes_factor: float) -> str:
    """Name the strength of a log Bayes factor [nats] on the scale of Kass and Raftery (1995).

    References
    ----------
    doi:10.1080/01621459.1995.10476572

    Examples
    --------
    >>> [strength(value) for value in (547.0, 4.0, 2.0, 0.3)]
    ['very strong', 'strong', 'positive', 'weak']
    """
    scale = ((5.0, "very strong"), (3.0, "strong"), (1.0, "positive"))
    return next((word for least, word in scale if log_bayes_factor >= least), "weak")


def unbroken(text: str) -> str:
    """Keep numbers and their units on one line.

    Examples
    --------
    >>> unbroken("above 160 kPa at 15 %") == f"above 160{SPACE}kPa at 15{SPACE}%"
    True
    """
    return _NUMBER_WITH_UNIT.sub(rf"\1{SPACE}\2", text)


def words(name: str) -> str:
    """Turn an identifier into words.

    Examples
    --------
    >>> words("degraded_skin"), words("c2")
    ('degraded skin', 'C2')
    """
    return _PROPER.get(name, name.replace("_", " "))


_PARAMETER = re.compile(r"(?:(\w+)\.)?(\w+?)(?:_(at|control)_(\d+(?:_\d+)?))?")


def parameter_words(name: str, degrades: bool = True) -> str:
    """Turn a parameter name into words, with its degradation rate if the study has several.

    Examples
    --------
    >>> parameter_words("paper_stiffness"), parameter_words("c2_ratio_at_12_5")
    ('paper stiffness', 'C2 ratio at 12.5 %')
    >>> parameter_words("c1_control_7"), parameter_words("dry_embrittlement.cut")
    ('C1, control value at 7 %', 'dry embrittlement: cut')
    >>> parameter_words("c1_at_0", degrades=False)
    'C1'
    """
    found = _PARAMETER.fullmatch(name)
    if found is None:
        return name
    cause, own, kind, rate = found.groups()
    first, *rest = own.split("_")
    said = " ".join([_PROPER.get(first, first), *rest])
    place = {"at": " at", "control": ", control value at"}.get(kind or "", "")
    rate = f"{place} {rate.replace('_', '.')} %" if rate and degrades else ""
    return f"{words(cause)}: {said}{rate}" if cause else f"{said}{rate}"


def begun(text: str) -> str:
    """Capitalize the first letter.

    Examples
    --------
    >>> begun("paper stiffness is low"), begun("C1 is high"), begun("")
    ('Paper stiffness is low', 'C1 is high', '')
    """
    return text[:1].upper() + text[1:]


def plain(text: str, names: Sequence[str]) -> str:
    """Replace the given identifiers in a text by words.

    Examples
    --------
    >>> plain("It may be pressure_offset.", ["pressure_offset", "creep"])
    'It may be pressure offset.'
    """
    known = sorted((name for name in names if "_" in name), key=len, reverse=True)
    pattern = "|".join(map(re.escape, known))
    return re.sub(rf"\b({pattern})\b", lambda found: words(found[0]), text) if known else text


def listed(names: Sequence[str]) -> str:
    """Join names with commas and "and".

    Examples
    --------
    >>> listed(["degraded_skin", "creep", "erosion"])
    'degraded skin, creep and erosion'
    """
    named = [words(name) for name in names]
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)


def model_words(model: str) -> str:
    """Turn a model name into words.

    Examples
    --------
    >>> model_words("base"), model_words("final"), model_words("base+degraded_skin+creep")
    ('base model', 'final model', 'base model + degraded skin + creep')
    """
    if model == "final":
        return "final model"
    return " + ".join("base model" if part == "base" else words(part) for part in model.split("+"))


def level_words(level: str | float) -> str:
    """Format a degradation rate, or "all".

    Examples
    --------
    >>> level_words("all"), level_words("15.0").replace(SPACE, " ")
    ('all', '15 %')
    """
    return "all" if level == "all" else f"{float(level):.3g}{SPACE}%"


def duration(seconds: float) -> str:
    """Format a duration.

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


FILTERS: Mapping[str, Callable[..., Any]] = {
    "number": number,
    "count": count,
    "fixed": fixed,
    "plus_minus": plus_minus,
    "is_finite": math.isfinite,
    "percent": percent,
    "chance": chance,
    "p_value": p_value,
    "strength": strength,
    "unbroken": unbroken,
    "words": words,
    "parameter": parameter_words,
    "begun": begun,
    "ends": ends,
    "listed": listed,
    "model": model_words,
    "level": level_words,
    "duration": duration,
}


def environment(*, autoescape: bool = False) -> Environment:
    """Return the environment for ``pages/templates``; undefined names raise."""
    made = Environment(
        loader=PackageLoader("bayesdeg.pages"),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= FILTERS
    return made


@cache
def _plain() -> Environment:
    return environment()


def filled(source: str, **facts: object) -> str:
    r"""Fill a template, with one space between sentences.

    Parameters
    ----------
    source : str
        The template itself.
    **facts
        Variables of the template.

    Examples
    --------
    >>> filled("{{ n }} readings.\n{% if p < 0.05 %}  That is rare.{% endif %}", n=3, p=0.01)
    '3 readings. That is rare.'
    """
    return _joined(_plain().from_string(source).render(facts))


def sentences(template: str, part: str, **facts: object) -> str:
    """Fill one part of a template file.

    Parameters
    ----------
    template : str
        Name of the file in ``pages/templates``, without ``.j2``.
    part : str
        A macro of it without arguments.
    **facts
        Variables for all macros of the file; ``degrades`` (whether the study has degradation) is
        true by default.
    """
    module = _plain().get_template(f"{template}.j2").make_module({"degrades": True} | facts)
    return _joined(str(getattr(module, part)()))


def worded(record: object, **facts: object) -> str:
    """Put a record into words with the macro of ``findings.j2`` named after its class.

    Parameters
    ----------
    record : object
        ``one`` in the template.
    **facts
        Further variables.

    Examples
    --------
    >>> from bayesdeg.criticism.decide.verdict import TooLittleExplained
    >>> worded(TooLittleExplained(share=0.4))
    'it removes only 40 % of the misfit'
    """
    part = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(record).__name__).lower()
    said = sentences("findings", part, one=record, **{"most": None} | facts)
    return said.replace(SPACE, " ")


def _joined(text: str) -> str:
    # non-breaking spaces are kept
    return " ".join(part for part in text.replace("\n", " ").split(" ") if part)
