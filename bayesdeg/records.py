"""JSON files as frozen records: one definition for writing, reading and the published schema.

A record is strict when bayesdeg creates it and tolerant when bayesdeg reads it: unknown keys of a
file of a different version are ignored, and missing ones take their defaults. Values of the wrong
type are refused, with the place, what was found, and what is expected.
"""

import itertools
import json
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, Final, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.config import JsonDict
from pydantic_core import ErrorDetails

#: No quantity is larger in any unit; its square is still finite.
LARGEST: Final = 1e100
#: Version of the formats; incremented when a key is renamed, removed or changes meaning.
VERSION: Final = 1
_FROM_FILE: Final = "from a file"
_SHOWN = 60  # shown characters of a value in a message


class RecordError(ValueError):
    """A JSON file breaks its format; the message says where."""


def _number(value: object, info: ValidationInfo) -> float | None:
    """Check a number; computed values that are not finite mean "not available"."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"must be a number or null, not {_shown(value)}")
    if info.context != _FROM_FILE and not math.isfinite(value):
        return None
    if not -LARGEST <= value <= LARGEST:
        raise ValueError(f"must be a finite number, not {str(value)[:12]}")
    return value


def _real(value: object, info: ValidationInfo) -> float:
    """Check a number that a computation works with; null is nan."""
    if isinstance(value, float) and info.context != _FROM_FILE:
        return math.nan if math.isnan(value) else float(value)
    found = _number(value, info)
    return math.nan if found is None else found


def _text(value: object) -> str:
    if isinstance(value, Mapping | list | tuple):
        raise ValueError(f"must be text, not {_shown(value)}")
    return "" if value is None else str(value)


def _needed_text(value: object) -> str:
    if not (text := _text(value)):
        raise ValueError("is missing")
    return text


def _names(value: object) -> tuple[str, ...]:
    whole = isinstance(value, list | tuple) and all(isinstance(name, str) for name in value)
    if not whole:
        raise ValueError(f"must be a list of names, not {_shown(value)}")
    return tuple(value)  # type: ignore[arg-type]


def _scalar(value: object) -> object:
    if isinstance(value, Mapping | list | tuple):
        raise ValueError(f"must be a number or text, not {_shown(value)}")
    return value.item() if isinstance(value, np.generic) else value


def _seed(value: object) -> int | None:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or (isinstance(value, int) and not isinstance(value, bool) and value >= 0):
        return value
    raise ValueError(f"must be a whole number of at least 0, not {_shown(value)}")


def _above_zero(value: float | None) -> float | None:
    if value is not None and value <= 0.0:
        raise ValueError(f"must be above 0, not {value:g}")
    return value


def _from_zero(value: float | None) -> float | None:
    if value is not None and value < 0.0:
        raise ValueError(f"must not be below 0, but is {value:g}")
    return value


def _rising(values: tuple[float | None, ...]) -> tuple[float | None, ...]:
    known = [value for value in values if value is not None]
    if len(known) < len(values) or any(a >= b for a, b in itertools.pairwise(known)):
        raise ValueError(f"must be increasing numbers, not {_shown(list(values))}")
    return values


def _known_version(version: int) -> int:
    if version > VERSION:
        raise ValueError(
            f"is {version}, of a newer bayesdeg; this one reads versions up to {VERSION}: update it"
        )
    return version


def _without_nulls(value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    return {key: one for key, one in value.items() if one is not None}


def is_absent(value: object) -> bool:
    """Return whether an optional key is omitted from the file: null, or an empty text.

    Examples
    --------
    >>> is_absent(None), is_absent(""), is_absent(0.0)
    (True, True, False)
    """
    return value is None or value == ""


#: A finite number or null; whole numbers stay whole.
Number = Annotated[float | None, PlainValidator(_number, json_schema_input_type=float | None)]
#: The same with nan in place of null, as computations need it.
Real = Annotated[float, PlainValidator(_real, json_schema_input_type=float | None)]
PositiveNumber = Annotated[Number, AfterValidator(_above_zero)]
#: A count or null.
Count = Annotated[Number, AfterValidator(_from_zero)]
RisingNumbers = Annotated[tuple[Number, ...], AfterValidator(_rising)]
#: A seed of random numbers or null.
SeedNumber = Annotated[int | None, PlainValidator(_seed, json_schema_input_type=int | None)]
#: A text; a number is read as its digits, null as an empty text.
Text = Annotated[str, PlainValidator(_text, json_schema_input_type=str)]
#: A number or a text, as written.
Scalar = Annotated[
    int | float | str | None,
    PlainValidator(_scalar, json_schema_input_type=float | str | None),
]
#: A required text.
NeededText = Annotated[str, PlainValidator(_needed_text, json_schema_input_type=str)]
#: A list of texts.
Names = Annotated[tuple[str, ...], PlainValidator(_names, json_schema_input_type=tuple[str, ...])]
#: Numbers by name; nulls are ignored.
Numbers = Annotated[Mapping[str, Number], BeforeValidator(_without_nulls)]
#: Texts by name.
Texts = Mapping[str, Text]


def entry(
    meaning: str,
    default: object = None,
    *,
    key: str = "",
    omitted: Callable[[Any], bool] | None = None,
) -> Any:
    """Return a field of a record.

    Parameters
    ----------
    meaning : str
        For the schema, the reference page and columns of tables; ends with the unit in brackets.
    default : object
        Where a file does not give it.
    key : str
        Its name in JSON, if that is not the name of the field.
    omitted : callable, optional
        Whether a value is omitted from the file.
    """
    name = key or None
    return Field(
        default=default,
        description=meaning,
        exclude_if=omitted,
        validation_alias=name,
        serialization_alias=name,
    )


def inner(meaning: str, default: object = math.nan, *, column: str = "") -> Any:
    """Return a field that is in no JSON file; its type is a `SkipJsonSchema`.

    Parameters
    ----------
    meaning, default
        As of `entry`.
    column : str
        Its name in tables, if that is not the name of the field.
    """
    extra: JsonDict | None = {"column": column} if column else None
    return Field(default=default, description=meaning, exclude=True, json_schema_extra=extra)


class Record(BaseModel):
    """An object of a JSON file, made by the names of its fields and read by its keys.

    Examples
    --------
    >>> class Point(Record):
    ...     x_mm: Number = None
    ...     label: Text = ""
    >>> Point.read({"x_mm": 2, "colour": "red"})
    Point(x_mm=2, label='')
    >>> Point(x_mm=math.nan).document()
    {'x_mm': None, 'label': ''}
    >>> Point.read({"x_mm": "far"})
    Traceback (most recent call last):
    ...
    bayesdeg.records.RecordError: 'x_mm' must be a number or null, not 'far'
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=False
    )

    @model_validator(mode="before")
    @classmethod
    def _null_is_missing(cls, content: Any) -> Any:
        return _without_nulls(content)

    @classmethod
    def read(cls, content: object) -> Self:
        """Return a record from the content of a file.

        Raises
        ------
        RecordError
            If something is missing or has the wrong type.
        """
        try:
            return cls.model_validate(
                content, extra="ignore", context=_FROM_FILE, by_alias=True, by_name=False
            )
        except ValidationError as fault:
            raise RecordError(_worded(fault.errors(include_url=False)[0])) from None

    @classmethod
    def of(cls, source: object) -> Self:
        """Return a record from an object's attributes of the same names; ignore others."""
        return cls.model_validate(source, from_attributes=True)

    def document(self) -> dict[str, object]:
        """Return the content for JSON: nan and what no reader accepts become null."""
        return plain(self.model_dump(by_alias=True))


class FileRecord(Record):
    """A whole JSON file; it begins with the version of its format."""

    schema_version: Annotated[int, AfterValidator(_known_version)] = Field(
        default=VERSION, description="version of this format"
    )

    def text(self) -> str:
        """Return the text of the file."""
        return json.dumps(self.document(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    @classmethod
    def schema_text(cls) -> str:
        """Return the published JSON schema of the file."""
        schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
        schema |= cls.model_json_schema(by_alias=True)
        return json.dumps(_published(schema), indent=2, ensure_ascii=False) + "\n"


def _published(node: object) -> object:
    """Return a schema for publication: later versions may add keys; no repeated names."""
    if isinstance(node, list):
        return [_published(one) for one in node]
    if not isinstance(node, dict):
        return node
    cut = {
        key: _published(one) for key, one in node.items() if key != "additionalProperties" or one
    }
    if isinstance(cut.get("title"), str):
        del cut["title"]
    if isinstance(default := cut.get("default"), float) and math.isnan(default):
        cut["default"] = None
    if isinstance(text := cut.get("description"), str):
        cut["description"] = text.split("\n\n")[0]
    return cut


def plain(content: Mapping[str, object]) -> dict[str, object]:
    """Return a document for JSON: values that are not finite become null.

    Examples
    --------
    >>> plain({"p_value": float("nan"), "causes": ("creep",)})
    {'p_value': None, 'causes': ['creep']}
    """
    return {str(key): _plain(item) for key, item in content.items()}


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return plain(value)
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not abs(value) <= LARGEST:
        return None
    return value


_KINDS = {
    "missing": "is missing",
    "model_type": "must be an object, not {0}",
    "model_attributes_type": "must be an object, not {0}",
    "mapping_type": "must be an object, not {0}",
    "dict_type": "must be an object, not {0}",
    "tuple_type": "must be a list, not {0}",
    "bool_type": "must be true or false, not {0}",
    "bool_parsing": "must be true or false, not {0}",
    "extra_forbidden": "is not a key of this record",
}


def _worded(fault: ErrorDetails) -> str:
    """Say where a record is wrong, and what is expected."""
    place = _place(fault["loc"])
    if fault["type"] == "value_error":
        said = str(fault["ctx"]["error"])
    elif fault["type"] == "enum":
        said = f"must be {fault['ctx']['expected']}, not {_shown(fault['input'])}"
    else:
        said = _KINDS.get(fault["type"], f"is {{0}}: {fault['msg']}").format(_shown(fault["input"]))
    return f"{place} {said}"


def _place(keys: Iterable[str | int]) -> str:
    """Return the path to a value: ``'candidates[0].effect'``."""
    way = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return f"{way.removeprefix('.')!r}" if way else "the content"


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
