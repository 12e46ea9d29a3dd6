"""The columns of every CSV file of a study, and what rows must fulfil together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import pandas as pd
import pandera.pandas as pa

from bayesdeg.data.settings import MODES

BRANCH = ("specimen_id", "cycle", "branch")


@dataclass(frozen=True)
class Rule:
    """A demand on several columns or rows of a table.

    Parameters
    ----------
    column : str or None
        Column that the fault names; ``None`` for the row as a whole.
    problem, remedy : str
        The words of the fault.
    needs : tuple of str
        Columns it reads; a row with a faulty cell in one of them is not judged.
    holds : callable
        Takes the checked columns and says of every row whether the demand is met. Cells that
        are missing meet it.
    """

    column: str | None
    problem: str
    remedy: str
    needs: tuple[str, ...]
    holds: Callable[[pd.DataFrame], pd.Series]


def at_most(lower: str, upper: str, remedy: str, *, strictly: bool = False) -> Rule:
    """Demand that one column does not exceed another.

    Parameters
    ----------
    lower, upper : str
        The two columns.
    remedy : str
        What would be right.
    strictly : bool
        Whether equal values are refused too.

    Returns
    -------
    Rule

    Examples
    --------
    >>> rule = at_most("mass_cured_g", "mass_poured_g", "check both")
    >>> rule.holds(pd.DataFrame({"mass_cured_g": [9.0, 31.0], "mass_poured_g": 30.0})).tolist()
    [True, False]
    """

    def holds(frame: pd.DataFrame) -> pd.Series:
        if strictly:
            return ~(frame[lower] >= frame[upper])
        return ~(frame[lower] > frame[upper])

    word = "is not below" if strictly else "is above"
    return Rule(lower, f"{word} {upper}", remedy, (lower, upper), holds)


def once(column: str, remedy: str) -> Rule:
    """Demand that a label stands on one row only.

    Parameters
    ----------
    column : str
        The label.
    remedy : str
        What would be right.

    Returns
    -------
    Rule
    """

    def holds(frame: pd.DataFrame) -> pd.Series:
        return frame[column].isna() | ~frame.duplicated([column])

    return Rule(column, "stands on more than one row", remedy, (column,), holds)


def not_all_zero(column: str, *within: str, least: float, remedy: str) -> Rule:
    """Demand that something was applied or measured at all.

    Parameters
    ----------
    column : str
        What must not be 0 on every row.
    *within : str
        Columns by which the rows are grouped first.
    least : float
        Below this, of the column's unit, a value counts as 0.
    remedy : str
        What would be right.

    Returns
    -------
    Rule
        Broken on the first row of a group.

    Examples
    --------
    >>> rule = not_all_zero("stress_MPa", least=1e-9, remedy="give stresses")
    >>> rule.holds(pd.DataFrame({"stress_MPa": [0.0, 0.0]})).tolist()
    [False, True]
    """

    def holds(frame: pd.DataFrame) -> pd.Series:
        keys = frame[list(within)].astype(str).agg(" ".join, axis=1) if within else frame.index * 0
        nothing = ~(frame[column].abs() > least).groupby(keys).transform("any")
        unknown = frame[column].isna().groupby(keys).transform("any")
        first = ~pd.Series(keys, index=frame.index).duplicated()
        return ~(nothing & first & ~unknown)

    problem = "is 0, and so is every other one" + (f" of this {within[0]}" if within else "")
    return Rule(column, problem, remedy, (column, *within), holds)


def _one_degradation(frame: pd.DataFrame) -> pd.Series:
    rate = frame["degradation_pct"]
    first = rate.groupby(frame["specimen_id"]).transform("first")
    differs = rate.notna() & first.notna() & (rate != first)
    # the first row that differs speaks for the specimen
    return ~(differs & ~frame.assign(differs=differs).duplicated(["specimen_id", "differs"]))


def _previous(frame: pd.DataFrame, column: str) -> pd.Series:
    keys = [frame[key] for key in BRANCH]
    return frame[column].groupby(keys).transform(lambda values: values.ffill().shift())


def _pressure_proceeds(frame: pd.DataFrame) -> pd.Series:
    step = frame["pressure_kPa"] - _previous(frame, "pressure_kPa")
    held = (step == 0.0) & (frame["time_s"] > _previous(frame, "time_s"))
    backwards = (step <= 0.0).where(frame["branch"] != "unloading", step >= 0.0)
    return ~(backwards & ~held)


def _time_proceeds(frame: pd.DataFrame) -> pd.Series:
    return ~(frame["time_s"] < _previous(frame, "time_s"))


def _curvature_recorded(frame: pd.DataFrame) -> pd.Series:
    return frame["curvature_per_m"].notna() | (frame["ruptured"] == 1)


ONE_DEGRADATION = Rule(
    "degradation_pct",
    "differs from the degradation rate of the same specimen on an earlier row",
    "give one specimen one degradation rate; another rate is another specimen_id",
    ("specimen_id", "degradation_pct"),
    _one_degradation,
)
PRESSURE_PROCEEDS = Rule(
    "pressure_kPa",
    "does not go on in the direction of its branch",
    "within one specimen, cycle and branch pressure must rise while loading and fall while "
    "unloading; it may be held only where time_s goes on",
    (*BRANCH, "pressure_kPa", "time_s"),
    _pressure_proceeds,
)
TIME_PROCEEDS = Rule(
    "time_s",
    "is earlier than on the row before of the same branch",
    "put the rows in the order in which they were read",
    (*BRANCH, "time_s"),
    _time_proceeds,
)
CURVATURE_RECORDED = Rule(
    "curvature_per_m",
    "is empty although the specimen has not burst",
    "give the curvature; it may be empty only on the row with ruptured = 1",
    ("curvature_per_m", "ruptured"),
    _curvature_recorded,
)
SOMETHING_APPLIED = not_all_zero(
    "pressure_kPa",
    least=1e-6,
    remedy="give gauge pressures in kPa; an actuator without pressure shows nothing",
)
SOMETHING_STRESSED = not_all_zero(
    "stress_MPa", "mode", least=1e-9, remedy="give the measured stresses in MPa, or remove the rows"
)


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
        A key of `bayesdeg.quantities.QUANTITIES`.
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
    """One file: its columns, and what its rows must fulfil together.

    Parameters
    ----------
    name, file : str
        In a `bayesdeg.data.study.Study`, and in its folder.
    columns : tuple of Column
        Those of the contract; a file may have more.
    rules : tuple of Rule
        What rows must fulfil together.
    cost : str
        What a study without it goes without; empty where nothing is missed.
    supports : str
        Which statements of a report rest on it.
    counts : str
        What stands in its first column, in the plural: of these the report gives the number.
    """

    name: str
    file: str
    columns: tuple[Column, ...]
    rules: tuple[Rule, ...] = ()
    cost: str = ""
    supports: str = ""
    counts: str = "specimens"


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
    cost="degradation rates are taken as recorded, without a check against time",
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
    cost="the volume ratio α rests on its prior and published statistics",
    supports="volume ratio α",
    counts="films",
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
    cost="the Yeoh constants rest on priors and published statistics",
    supports="Yeoh constants against degradation",
)
BREAKS = Table(
    "breaks",
    "break.csv",
    (_SPECIMEN, _DEGRADATION, _DEGRADATION_SD, Column("elongation_pct", demands=(POSITIVE,))),
    (once("specimen_id", "a specimen breaks once; give every specimen its own name"),),
    cost="the elongation limit rests on priors and published statistics",
    supports="elongation limit and rupture",
)


def of_actuators(*read: Column) -> tuple[Column, ...]:
    """Return the columns of a file of tests of actuators at pressures, in which this was read."""
    return (
        _SPECIMEN,
        _DEGRADATION,
        _DEGRADATION_SD,
        Column("pressure_kPa"),
        *read,
        Column("time_s", demands=(NOT_NEGATIVE,), required=False),
        Column("cycle", "whole", (POSITIVE, WHOLE), required=False, default=1),
        _word("branch", "loading", "unloading"),
        Column("humidity_pct", demands=(NOT_NEGATIVE, PERCENT), required=False),
        _word("mount", "horizontal", "hanging", "bending_up", "bending_down"),
    )


ACTUATOR = Table(
    "actuator",
    "actuator.csv",
    (
        *of_actuators(
            Column("curvature_per_m", may_be_empty=True),
            Column("bend_angle_deg", required=False),
            Column("curvature_sd_per_m", demands=(NOT_NEGATIVE,), required=False),
        ),
        Column("ruptured", "whole", (BURST,), required=False, default=0),
    ),
    (
        ONE_DEGRADATION,
        PRESSURE_PROCEEDS,
        TIME_PROCEEDS,
        CURVATURE_RECORDED,
        SOMETHING_APPLIED,
    ),
    cost="nothing can be said of the actuator: no misfit, no cause, no bands",
    supports="verdict, gain, curvature bands",
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
    cost="nothing is compared with, or rests on, published statistics",
)
#: The tables of films and actuators by their names; kinds of data that are files of
#: `bayesdeg.observations` bring theirs along, see `bayesdeg.observations.catalogue.TABLES`.
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
