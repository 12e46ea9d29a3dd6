"""Published statistics: the unit each is given in, and the values it can have."""

from collections.abc import Mapping
from types import MappingProxyType

import pandas as pd

from bayesdeg.measure.rules import Rule

_NONE = ("–", "-", "1")

#: The ways in which the unit of each statistic may be written.
UNITS_OF_STATISTICS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "young_modulus": ("MPa",),
        "elongation_at_break": ("%", "pct"),
        "volume_ratio": _NONE,
        "r_squared": _NONE,
        "ruptured_count": _NONE,
        "tested_count": _NONE,
        "mass_loss_slope": (*_NONE, "%/%"),
    }
)
_COUNTS = ("ruptured_count", "tested_count")
_POSITIVE = ("young_modulus", "elongation_at_break", "volume_ratio")


def _unit_is_right(frame: pd.DataFrame) -> pd.Series:
    known = frame["quantity"].map(UNITS_OF_STATISTICS)
    pairs = zip(known, frame["unit"], strict=True)
    good = [not isinstance(units, tuple) or unit in units for units, unit in pairs]
    return pd.Series(good, index=frame.index, dtype=bool)


def _value_is_positive(frame: pd.DataFrame) -> pd.Series:
    return ~(frame["quantity"].isin(_POSITIVE) & (frame["value"] <= 0.0))


def _value_is_count(frame: pd.DataFrame) -> pd.Series:
    wrong = (frame["value"] < 0.0) | (frame["value"] % 1.0 > 0.0)
    return ~(frame["quantity"].isin(_COUNTS) & wrong)


def _value_is_at_most_one(frame: pd.DataFrame) -> pd.Series:
    return ~((frame["quantity"] == "r_squared") & (frame["value"] > 1.0))


SUMMARY_RULES: tuple[Rule, ...] = (
    Rule(
        "unit",
        "is not the unit of this quantity",
        "young_modulus is in MPa, elongation_at_break in %, all others have none (–)",
        ("quantity", "unit"),
        _unit_is_right,
    ),
    Rule(
        "value",
        "is not above 0",
        "give a number above 0",
        ("quantity", "value"),
        _value_is_positive,
    ),
    Rule(
        "value",
        "is not a count",
        "give a whole number, 0 or above",
        ("quantity", "value"),
        _value_is_count,
    ),
    Rule(
        "value",
        "is above 1, which no R² can be",
        "give 1 − SSE/SST",
        ("quantity", "value"),
        _value_is_at_most_one,
    ),
)
