"""Typed access to the fields of a JSON object, with errors that say which field is wrong."""

from collections.abc import Callable, Mapping
from typing import Final

type Json = Mapping[str, object]

#: No quantity in whatever unit is larger; the square of it is still a number.
LARGEST: Final = 1e100


class RunFaultError(ValueError):
    """A document of the run folder breaks its format; the message says where."""


def entries_of(content: Json, key: str) -> list[object]:
    """Return the list under a key; empty if there is none."""
    value = content.get(key)
    if value is None:
        return []
    if not isinstance(value, list):
        raise RunFaultError(f"{key!r} must be a list, not {value!r}")
    return value


def each_of[T](content: Json, key: str, parse: Callable[[Json], T]) -> tuple[T, ...]:
    """Parse every object of the list under a key."""
    entries = entries_of(content, key)
    for entry in entries:
        if not isinstance(entry, Mapping):
            raise RunFaultError(f"{key!r} must list objects, not {entry!r}")
    return tuple(parse(entry) for entry in entries if isinstance(entry, Mapping))


def strings_of(value: object, key: str) -> tuple[str, ...]:
    """Check a list of names."""
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise RunFaultError(f"{key!r} must hold lists of names, not {value!r}")
    return tuple(value)


def texts_of(content: Json, key: str) -> tuple[str, ...]:
    """Return the list of names under a key."""
    return strings_of(entries_of(content, key), key)


def text_of(content: Json, key: str) -> str:
    """Return the text or number under a key as text; empty if there is none."""
    value = content.get(key)
    if isinstance(value, Mapping | list):
        raise RunFaultError(f"{key!r} must be a text, not {value!r}")
    return "" if value is None else str(value)


def number_of(content: Json, key: str) -> float | None:
    """Return the number under a key; None for null or nothing."""
    value = content.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RunFaultError(f"{key!r} must be a number or null, not {value!r}")
    if not -LARGEST <= value <= LARGEST:
        raise RunFaultError(f"{key!r} must be a finite number of a quantity, not {str(value)[:12]}")
    return float(value)


def mapping_of(content: Json, key: str) -> Json:
    """Return the object under a key; empty if there is none."""
    value = content.get(key)
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise RunFaultError(f"{key!r} must be an object, not {value!r}")
    return value


def text_map_of(content: Json, key: str) -> dict[str, str]:
    """Return the object under a key, its values as texts."""
    entries = mapping_of(content, key)
    return {name: text_of(entries, name) for name in entries}


def number_map_of(content: Json, key: str) -> dict[str, float]:
    """Return the numbers of the object under a key, without the nulls."""
    entries = mapping_of(content, key)
    numbers = {name: number_of(entries, name) for name in entries}
    return {name: number for name, number in numbers.items() if number is not None}


def pairs_of(content: Json, key: str, names: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    """Return two texts of every object of the list under a key."""
    return each_of(content, key, lambda entry: (text_of(entry, names[0]), text_of(entry, names[1])))
