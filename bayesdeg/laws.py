"""Prior laws by name, and the parameter that carries one: the way in to `distributions`."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields

from bayesdeg.distributions.bounded import HalfCauchy, HalfNormal, LogNormal, Uniform
from bayesdeg.distributions.law import FloatArray, Law
from bayesdeg.distributions.linear import Normal, StudentT, TruncatedNormal

__all__ = [
    "LAWS",
    "FloatArray",
    "HalfCauchy",
    "HalfNormal",
    "Law",
    "LogNormal",
    "Normal",
    "Parameter",
    "StudentT",
    "TruncatedNormal",
    "Uniform",
    "law_from_mapping",
]

type _LawClass = (
    type[Normal]
    | type[LogNormal]
    | type[HalfNormal]
    | type[Uniform]
    | type[StudentT]
    | type[TruncatedNormal]
    | type[HalfCauchy]
)

LAWS: Mapping[str, _LawClass] = {
    "normal": Normal,
    "lognormal": LogNormal,
    "half_normal": HalfNormal,
    "uniform": Uniform,
    "student_t": StudentT,
    "truncated_normal": TruncatedNormal,
    "half_cauchy": HalfCauchy,
}

#: Of an argument; no parameter is as large in its unit.
_LARGEST = 1e12


@dataclass(frozen=True)
class Parameter:
    """A named unknown with its prior law.

    Parameters
    ----------
    name : str
        Name by which sampler, report and study file know it.
    law : Law
        Prior law.
    unit : str
        Unit of its values; an en dash, the default, if it has none.
    meaning : str
        What it is, in words; empty by default.
    neutral : float, optional
        The value at which it has no effect; its prior density there must not vanish.

    Raises
    ------
    ValueError
        If the name is empty, or the neutral value is not finite or impossible under the prior.

    Examples
    --------
    >>> Parameter("volume_ratio", Normal(0.62, 0.07), "–", "volume after over before drying").name
    'volume_ratio'
    """

    name: str
    law: Law
    unit: str = "–"
    meaning: str = ""
    neutral: float | None = None

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise ValueError("a parameter needs a name")
        if self.neutral is None:
            return
        if not math.isfinite(self.neutral):
            raise ValueError(f"{self.name}: neutral must be finite, not {self.neutral!r}")
        if not math.isfinite(float(self.law.log_density(self.neutral))):
            raise ValueError(
                f"{self.name}: neutral {self.neutral!r} is impossible under {self.law}"
            )


def law_from_mapping(mapping: Mapping[str, object]) -> Law:
    """Return the law that a table of a study file describes.

    Parameters
    ----------
    mapping : Mapping
        ``law`` names one of `LAWS`; the other keys are its arguments.

    Returns
    -------
    Law

    Raises
    ------
    ValueError
        If the law is unknown, a key is missing or unknown, or a value is impossible.

    Examples
    --------
    >>> law_from_mapping({"law": "normal", "mean": 0.62, "sd": 0.07})
    Normal(mean=0.62, sd=0.07)
    >>> law_from_mapping({"law": "norml", "mean": 0.62, "sd": 0.07})
    Traceback (most recent call last):
    ...
    ValueError: unknown law 'norml'; did you mean 'normal'?
    """
    if "law" not in mapping:
        raise ValueError(f"key 'law' is missing; it is one of {', '.join(LAWS)}")
    name = mapping["law"]
    if not isinstance(name, str) or name not in LAWS:
        raise ValueError(f"unknown law {name!r}; {_suggestion(str(name), list(LAWS))}")
    law_class = LAWS[name]
    known = [field.name for field in fields(law_class)]
    required = [field.name for field in fields(law_class) if field.default is MISSING]
    arguments = {key: value for key, value in mapping.items() if key != "law"}
    for key in arguments:
        if key not in known:
            raise ValueError(f"law {name!r} has no key {key!r}; {_suggestion(key, known)}")
    for key in required:
        if key not in arguments:
            raise ValueError(f"law {name!r} needs key {key!r}")
    try:
        return law_class(**{key: _number(value, key) for key, value in arguments.items()})
    except ValueError as fault:
        raise ValueError(f"law {name!r}: {fault}") from None


def _suggestion(word: str, known: list[str]) -> str:
    nearest = difflib.get_close_matches(word.lower(), known, n=1)
    return f"did you mean {nearest[0]!r}?" if nearest else f"it is one of {', '.join(known)}"


def _number(value: object, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{key} must be a number, not {value!r}")
    if _LARGEST < abs(value) < math.inf:  # bounds may be infinite
        raise ValueError(f"{key} must be a number between −{_LARGEST:g} and {_LARGEST:g}")
    return float(value)
