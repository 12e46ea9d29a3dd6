"""The columns of every CSV file of a study, and the pandera schemas made of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import pandas as pd
import pandera.pandas as pa

from bayesdeg.measure.published import SUMMARY_RULES, UNITS_OF_STATISTICS
from bayesdeg.measure.rules import (
    CURVATURE_RECORDED,
    ONE_DEGRADATION,
    PRESSURE_PROCEEDS,
    SOMETHING_APPLIED,
    SOMETHING_STRESSED,
    TIME_PROCEEDS,
    Rule,
    at_most,
    once,
)
from bayesdeg.measure.settings import MODES

Kind = Literal["text", "number", "whole"]

#: A rate is a ratio of two means, so near 0 its scatter may take it below.
LOWEST_DEGRADATION_PCT = -5.0
#: The toughest hydrogels break at about 25; a length in percent is 100 and more.
LARGEST_STRETCH = 50.0


@dataclass(frozen=True)
class Demand:
    """What every recorded cell of a column must fulfil."""

    problem: str
    remedy: str
    holds: Callable[[pd.Series], pd.Series]


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Parameters
    ----------
    name : str
        A key of `bayesdeg.nomenclature.QUANTITIES`.
    kind : {"text", "number", "whole"}
        What its cells hold.
    demands : tuple of Demand
        What a cell must fulfil.
    one_of : tuple of str
        The words that may stand in it; empty for any.
    required : bool
        Whether the column must be there.
    may_be_empty : bool
        Whether a cell may be empty; always so in optional columns.
    default : str, int or None
        What an empty cell or an absent column means; ``None`` for "not recorded".
    """

    name: str
    kind: Kind = "number"
    demands: tuple[Demand, ...] = ()
    one_of: tuple[str, ...] = ()
    required: bool = True
    may_be_empty: bool = False
    default: str | int | None = None

    @property
    def dtype(self) -> type:
        """Type of the cells while they are checked."""
        return object if self.kind == "text" else float


@dataclass(frozen=True)
class Table:
    """One file: its columns, and what its rows must fulfil together."""

    name: str
    file: str
    columns: tuple[Column, ...]
    rules: tuple[Rule, ...] = ()


POSITIVE = Demand("is not above 0", "give a number above 0", lambda x: x > 0.0)
NOT_NEGATIVE = Demand("is below 0", "give 0 or a number above 0", lambda x: x >= 0.0)
PERCENT = Demand("is above 100 %", "give a percentage up to 100", lambda x: x <= 100.0)
WHOLE = Demand("is not a whole number", "give a whole number", lambda x: x % 1.0 == 0.0)
BURST = Demand("is neither 0 nor 1", "give 1 where it burst, else 0", lambda x: x.isin([0, 1]))
STRETCHABLE = Demand(
    f"is above {LARGEST_STRETCH:g}, which no elastomer bears",
    "give a ratio of lengths, 1 = undeformed; 150 % of the length is 1.5",
    lambda x: x <= LARGEST_STRETCH,
)
MEASURED_RATE = Demand(
    f"is below {LOWEST_DEGRADATION_PCT:g} %, which scatter cannot explain",
    "give the degradation rate in percent, 0 for undegraded",
    lambda x: x >= LOWEST_DEGRADATION_PCT,
)

_FILM = Column("film_id", "text")
_SPECIMEN = Column("specimen_id", "text")
_DEGRADATION = Column("degradation_pct", demands=(MEASURED_RATE, PERCENT))
_DEGRADATION_SD = Column("degradation_sd_pct", demands=(NOT_NEGATIVE,), required=False)


def _mass(name: str) -> Column:
    return Column(name, demands=(POSITIVE,))


def _word(name: str, *words: str) -> Column:
    return Column(name, "text", one_of=words, required=False, default=words[0])


MOISTURE = Table(
    "moisture",
    "moisture.csv",
    (
        _FILM,
        Column("time_h", demands=(NOT_NEGATIVE,)),
        _mass("mass_equilibrated_g"),
        _mass("mass_dry_g"),
    ),
    (
        once("film_id", "give one row a film, and every film its own name"),
        at_most(
            "mass_dry_g", "mass_equilibrated_g", "a film loses mass when it dries", strictly=True
        ),
    ),
)
SHRINKAGE = Table(
    "shrinkage",
    "shrinkage.csv",
    (_FILM, _mass("mass_poured_g"), _mass("mass_cured_g"), _mass("mass_conditioned_g")),
    (
        once("film_id", "give one row a film, and every film its own name"),
        at_most("mass_cured_g", "mass_poured_g", "a film loses mass when it cures"),
        at_most("mass_conditioned_g", "mass_cured_g", "a film loses mass when it is conditioned"),
    ),
)
TENSILE = Table(
    "tensile",
    "tensile.csv",
    (
        _SPECIMEN,
        _DEGRADATION,
        _DEGRADATION_SD,
        _word("mode", *MODES),
        Column("stretch", demands=(POSITIVE, STRETCHABLE)),
        Column("stress_MPa"),
        _word("stress_measure", "nominal", "cauchy"),
    ),
    (ONE_DEGRADATION, SOMETHING_STRESSED),
)
BREAKS = Table(
    "breaks",
    "break.csv",
    (_SPECIMEN, _DEGRADATION, _DEGRADATION_SD, Column("elongation_pct", demands=(POSITIVE,))),
    (once("specimen_id", "a specimen breaks once; give every specimen its own name"),),
)
ACTUATOR = Table(
    "actuator",
    "actuator.csv",
    (
        _SPECIMEN,
        _DEGRADATION,
        _DEGRADATION_SD,
        Column("pressure_kPa"),
        Column("curvature_per_m", may_be_empty=True),
        Column("bend_angle_deg", required=False),
        Column("curvature_sd_per_m", demands=(NOT_NEGATIVE,), required=False),
        Column("time_s", demands=(NOT_NEGATIVE,), required=False),
        Column("cycle", "whole", (POSITIVE, WHOLE), required=False, default=1),
        _word("branch", "loading", "unloading"),
        Column("humidity_pct", demands=(NOT_NEGATIVE, PERCENT), required=False),
        _word("mount", "horizontal", "hanging", "bending_up", "bending_down"),
        Column("ruptured", "whole", (BURST,), required=False, default=0),
    ),
    (
        ONE_DEGRADATION,
        PRESSURE_PROCEEDS,
        TIME_PROCEEDS,
        CURVATURE_RECORDED,
        SOMETHING_APPLIED,
    ),
)
SUMMARY = Table(
    "summary",
    "summary.csv",
    (
        Column("quantity", "text", one_of=tuple(UNITS_OF_STATISTICS)),
        Column("degradation_pct", demands=(NOT_NEGATIVE, PERCENT), may_be_empty=True),
        Column("value"),
        Column("sd", demands=(NOT_NEGATIVE,), may_be_empty=True),
        Column("n", demands=(POSITIVE, WHOLE), may_be_empty=True),
        Column("unit", "text", may_be_empty=True, default="–"),
        Column("source", "text"),
    ),
    SUMMARY_RULES,
)
#: Every table of a study by its name.
TABLES: Mapping[str, Table] = MappingProxyType(
    {t.name: t for t in (MOISTURE, SHRINKAGE, TENSILE, BREAKS, ACTUATOR, SUMMARY)}
)


def cell_schema(table: Table) -> pa.DataFrameSchema:
    """Make the schema of single cells: types, ranges and known words.

    Parameters
    ----------
    table : Table
        One of `TABLES`.

    Returns
    -------
    pandera.DataFrameSchema
        Extra columns pass; check number ``i`` of a column is its demand ``i``, and the known
        words come after the demands. Missing cells pass, since whether a cell may be empty is
        judged on the text.

    Examples
    --------
    >>> frame = pd.DataFrame({"film_id": ["a"], "time_h": [-1.0]})
    >>> cell_schema(MOISTURE).validate(frame)
    Traceback (most recent call last):
    ...
    pandera.errors.SchemaError: ...
    """
    return pa.DataFrameSchema(
        {
            column.name: pa.Column(
                column.dtype,
                [
                    *(pa.Check(demand.holds, error=demand.problem) for demand in column.demands),
                    *([pa.Check.isin(column.one_of)] if column.one_of else ()),
                ],
                nullable=True,
                required=False,
            )
            for column in table.columns
        }
    )


def row_schema(table: Table) -> pa.DataFrameSchema:
    """Make the schema of rows: check number ``i`` is rule ``i`` of the table.

    Parameters
    ----------
    table : Table
        One of `TABLES`.

    Returns
    -------
    pandera.DataFrameSchema
        Takes a frame with all columns of the table.
    """
    return pa.DataFrameSchema(
        checks=[pa.Check(rule.holds, error=rule.problem, ignore_na=False) for rule in table.rules]
    )
