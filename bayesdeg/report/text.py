"""Sentences from templates, in which numbers, names and models are worded alike."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from bayesdeg.report import wording

FILTERS: Mapping[str, Callable[..., Any]] = {
    "number": wording.number,
    "count": wording.count,
    "fixed": wording.fixed,
    "percent": wording.percent,
    "p_value": wording.p_value,
    "strength": wording.strength,
    "unbroken": wording.unbroken,
    "words": wording.words,
    "listed": wording.listed,
    "model": wording.model_words,
    "level": wording.level_words,
    "duration": wording.duration,
}


def environment(*, autoescape: bool = False) -> Environment:
    """Return what fills the templates in ``report/templates``; a name that is not given raises."""
    made = Environment(
        loader=PackageLoader("bayesdeg.report"),
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
    r"""Fill a template; sentences are a space apart, whatever stands between them.

    Parameters
    ----------
    source : str
        The template itself.
    **facts
        What it speaks of.

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
        Name of the file in ``report/templates``, without ``.j2``.
    part : str
        A macro of it without arguments.
    **facts
        What it speaks of: seen by all macros of the file.
    """
    module = _plain().get_template(f"{template}.j2").make_module(facts)
    return _joined(str(getattr(module, part)()))


def _joined(text: str) -> str:
    # the spaces that keep numbers and units together stay
    return " ".join(part for part in text.replace("\n", " ").split(" ") if part)
