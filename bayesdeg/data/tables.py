"""Columns of every CSV file of a study, and rules for its rows.

A file is a pandera schema. The wording of a check is ``error``, what is wrong, and ``description``,
what would be right.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import pandas as pd
import pandera.pandas as pa

from bayesdeg.data.settings import LARGEST_RATE_SD, MODES
from bayesdeg.quantities import BRANCHES, COLDEST, HOTTEST, MOUNTS, UNLOADING

BRANCH = ("specimen_id", "cycle", "branch")

type Holds = Callable[[pd.DataFrame], pd.Series]


def row_check(
    column: str | None, problem: str, remedy: str, needs: tuple[str, ...], holds: Holds
) -> pa.Check:
    """Check a rule over several columns or rows of a table.

    Parameters
    ----------
    column : str or None
        Column that the fault names; ``None`` for the row as a whole.
    problem, remedy : str
        Wording of the fault.
    needs : tuple of str
        Columns it reads; rows with a faulty cell in one of them are not checked.
    holds : callable
        Takes the checked columns and returns for every row whether the rule holds. Missing cells
        satisfy it.
    """
    return pa.Check(
        holds,
        error=problem,
        description=remedy,
        statistics={"column": column, "needs": needs},
        ignore_na=False,
    )


def broken(check: pa.Check, data: pd.DataFrame | pd.Series) -> list[int]:
    """Return the rows of a table, for a row check, or else of a column, that break a check.

    Examples
    --------
    >>> broken(POSITIVE, pd.Series([1.0, -2.0, float("nan")], index=[2, 3, 4]))
    [3]
    """
    holds = check(data).check_output
    return [int(row) for row in holds.index[~holds]]


def at_most(lower: str, upper: str, remedy: str, *, strictly: bool = False) -> pa.Check:
    """Check that one column does not exceed another, or, ``strictly``, is below it.

    Examples
    --------
    >>> rule = at_most("mass_cured_g", "mass_poured_g", "check both")
    >>> broken(rule, pd.DataFrame({"mass_cured_g": [9.0, 31.0], "mass_poured_g": 30.0}))
    [1]
    """

    def holds(frame: pd.DataFrame) -> pd.Series:
        if strictly:
            return ~(frame[lower] >= frame[upper])
        return ~(frame[lower] > frame[upper])

    word = "is not below" if strictly else "is above"
    return row_check(lower, f"{word} {upper}", remedy, (lower, upper), holds)


def once(column: str, remedy: str) -> pa.Check:
    """Check that a label is unique."""

    def holds(frame: pd.DataFrame) -> pd.Series:
        return frame[column].isna() | ~frame.duplicated([column])

    return row_check(column, "is on more than one row", remedy, (column,), holds)


def not_all_zero(column: str, *within: str, least: float, remedy: str) -> pa.Check:
    """Check that something was applied or measured; broken on the first row of a group.

    Parameters
    ----------
    column : str
        What must not be 0 on every row.
    *within : str
        Columns by which the rows are grouped first.
    least : float
        A value below this, in the column's unit, counts as 0.
    remedy : str
        What would be right.

    Examples
    --------
    >>> rule = not_all_zero("stress_MPa", least=1e-9, remedy="give stresses")
    >>> broken(rule, pd.DataFrame({"stress_MPa": [0.0, 0.0]}))
    [0]
    """

    def holds(frame: pd.DataFrame) -> pd.Series:
        keys = frame[list(within)].astype(str).agg(" ".join, axis=1) if within else frame.index * 0
        nothing = ~(frame[column].abs() > least).groupby(keys).transform("any")
        unknown = frame[column].isna().groupby(keys).transform("any")
        first = ~pd.Series(keys, index=frame.index).duplicated()
        return ~(nothing & first & ~unknown)

    problem = "is 0, like all others" + (f" of this {within[0]}" if within else "")
    return row_check(column, problem, remedy, (column, *within), holds)


def _one_degradation(frame: pd.DataFrame) -> pd.Series:
    rate = frame["degradation_pct"]
    first = rate.groupby(frame["specimen_id"]).transform("first")
    differs = rate.notna() & first.notna() & (rate != first)
    # report only the first row that differs
    return ~(differs & ~frame.assign(differs=differs).duplicated(["specimen_id", "differs"]))


def _previous(frame: pd.DataFrame, column: str) -> pd.Series:
    keys = [frame[key] for key in BRANCH]
    return frame[column].groupby(keys).ffill().groupby(keys).shift()


def _back_without_branch(frame: pd.DataFrame) -> pd.Series:
    """Return where pressure keeps falling, or returns to an earlier one, without any unloading.

    A single fall to a new pressure is a slip or a misplaced row.
    """
    if (frame["branch"] == UNLOADING).any():
        return pd.Series(False, index=frame.index)
    falls = frame["pressure_kPa"] < _previous(frame, "pressure_kPa")
    after = falls.groupby([frame[key] for key in BRANCH]).shift(-1, fill_value=False)
    return falls & (after | frame.duplicated([*BRANCH, "pressure_kPa"]))


def _branch_named(frame: pd.DataFrame) -> pd.Series:
    back = _back_without_branch(frame)
    # report only one row of the file
    return ~back | back.cumsum().gt(1)


def _pressure_proceeds(frame: pd.DataFrame) -> pd.Series:
    if _back_without_branch(frame).any():  # row order then follows no branch
        return pd.Series(True, index=frame.index)
    step = frame["pressure_kPa"] - _previous(frame, "pressure_kPa")
    held = (step == 0.0) & (frame["time_s"] > _previous(frame, "time_s"))
    backwards = (step <= 0.0).where(frame["branch"] != UNLOADING, step >= 0.0)
    return ~(backwards & ~held)


ONE_DEGRADATION = row_check(
    "degradation_pct",
    "differs from the degradation rate of the same specimen on an earlier row",
    "give a specimen one degradation rate; use a new specimen_id for a different rate",
    ("specimen_id", "degradation_pct"),
    _one_degradation,
)
BRANCH_NAMED = row_check(
    "pressure_kPa",
    "falls after rising, but no row has branch unloading",
    "add a column branch, with loading where pressure rises and unloading where it falls (for "
    "several ramps also a column cycle, with 1, 2, …), or correct the pressure",
    (*BRANCH, "pressure_kPa"),
    _branch_named,
)
PRESSURE_PROCEEDS = row_check(
    "pressure_kPa",
    "does not continue in the direction of its branch",
    "within one specimen, cycle and branch pressure must rise while loading and fall while "
    "unloading; it may be constant only where time_s advances",
    (*BRANCH, "pressure_kPa", "time_s"),
    _pressure_proceeds,
)
TIME_PROCEEDS = row_check(
    "time_s",
    "is earlier than in the previous row of the same branch",
    "sort the rows in the order of reading",
    (*BRANCH, "time_s"),
    lambda frame: ~(frame["time_s"] < _previous(frame, "time_s")),
)
CURVATURE_RECORDED = row_check(
    "curvature_per_m",
    "is empty although the specimen has not burst",
    "give the curvature; it may be empty only in the row with ruptured = 1",
    ("curvature_per_m", "ruptured"),
    lambda frame: frame["curvature_per_m"].notna() | (frame["ruptured"] == 1),
)
SOMETHING_APPLIED = not_all_zero(
    "pressure_kPa",
    least=1e-6,
    remedy="give gauge pressures in kPa; an actuator without pressure carries no information",
)
SOMETHING_STRESSED = not_all_zero(
    "stress_MPa", "mode", least=1e-9, remedy="give the measured stresses in MPa, or remove the rows"
)


_NONE = ("–", "-", "1")

#: Accepted spellings of the unit of each statistic.
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


def _unit_is_right(frame: pd.DataFrame) -> pd.Series:
    known = frame["quantity"].map(UNITS_OF_STATISTICS)
    pairs = zip(known, frame["unit"], strict=True)
    good = [not isinstance(units, tuple) or unit in units for units, unit in pairs]
    return pd.Series(good, index=frame.index, dtype=bool)


def _value_check(
    quantities: tuple[str, ...],
    problem: str,
    remedy: str,
    wrong: Callable[[pd.Series], pd.Series],
) -> pa.Check:
    """Check the values of some statistics."""

    def holds(frame: pd.DataFrame) -> pd.Series:
        return ~(frame["quantity"].isin(quantities) & wrong(frame["value"]))

    return row_check("value", problem, remedy, ("quantity", "value"), holds)


SUMMARY_CHECKS = (
    row_check(
        "unit",
        "is not the unit of this quantity",
        "young_modulus is in MPa, elongation_at_break in %, all others have none (–)",
        ("quantity", "unit"),
        _unit_is_right,
    ),
    _value_check(
        ("young_modulus", "elongation_at_break", "volume_ratio"),
        "is not above 0",
        "give a number above 0",
        lambda value: value <= 0.0,
    ),
    _value_check(
        ("ruptured_count", "tested_count"),
        "is not a count",
        "give a whole number, 0 or above",
        lambda value: (value < 0.0) | (value % 1.0 > 0.0),
    ),
    _value_check(
        ("r_squared",),
        "is above 1, impossible for R²",
        "give 1 − SSE/SST",
        lambda value: value > 1.0,
    ),
)


#: A rate is a ratio of two means, so scatter may make it slightly negative near 0.
LOWEST_DEGRADATION_PCT = -5.0
#: The toughest hydrogels break at about 25; lengths in percent are 100 and more.
LARGEST_STRETCH = 50.0

POSITIVE = pa.Check.gt(0.0, error="is not above 0", description="give a number above 0")
NOT_NEGATIVE = pa.Check.ge(0.0, error="is below 0", description="give 0 or a number above 0")
NO_VACUUM = pa.Check.ge(
    0.0,
    error="is below 0, but actuators under vacuum are not supported",
    description="remove these rows; if it is the gauge's zero error, subtract it everywhere",
)
PERCENT = pa.Check.le(100.0, error="is above 100 %", description="give a percentage up to 100")
WHOLE = pa.Check(
    lambda x: x % 1.0 == 0.0, error="is not a whole number", description="give a whole number"
)
ROOM = pa.Check.in_range(
    *(COLDEST, HOTTEST),
    error="is not a plausible room or oven temperature",
    description="give degrees Celsius",
)
BURST = pa.Check.isin(
    [0, 1], error="is neither 0 nor 1", description="give 1 where the specimen burst, else 0"
)
STRETCHABLE = pa.Check.le(
    LARGEST_STRETCH,
    error=f"is above {LARGEST_STRETCH:g}, beyond any elastomer",
    description="give a ratio of lengths, 1 = undeformed, 1.5 = 150 % of the length",
)
KNOWN_RATE = pa.Check.le(
    LARGEST_RATE_SD,
    error=f"is above {LARGEST_RATE_SD:g} %, the standard error of an unknown rate",
    description="give the standard error of degradation_pct in percent, or leave the cell empty",
)
MEASURED_RATE = pa.Check.ge(
    LOWEST_DEGRADATION_PCT,
    error=f"is below {LOWEST_DEGRADATION_PCT:g} %, which scatter cannot explain",
    description="give the degradation rate in percent, 0 for undegraded",
)


def number(*checks: pa.Check, empty: bool = False, optional: bool = False) -> pa.Column:
    """Make a column of numbers; ``empty`` allows empty cells, as ``optional`` always does."""
    return pa.Column(float, list(checks), nullable=empty or optional, required=not optional)


def text(*, empty: bool = False, default: str | None = None) -> pa.Column:
    """Make a column of names; ``empty`` allows empty cells, which mean the default."""
    return pa.Column(str, nullable=empty, default=default)


def _word(*words: str, optional: bool = True) -> pa.Column:
    """Make a column of known words; an empty optional cell means the first."""
    check = pa.Check.isin(words, error="is not known")
    default = words[0] if optional else None
    return pa.Column(str, check, nullable=optional, required=not optional, default=default)


def _label() -> pa.Column:
    """Make an optional column of names; an empty cell means none."""
    return pa.Column(str, nullable=True, required=False)


def _whole(*checks: pa.Check, default: int) -> pa.Column:
    return pa.Column(int, list(checks), nullable=True, required=False, default=default)


def words_of(column: pa.Column) -> tuple[str, ...]:
    """Return the words allowed in a column; none if any is.

    Examples
    --------
    >>> words_of(TENSILE.columns["stress_measure"])
    ('nominal', 'cauchy')
    """
    listed = [check.statistics.get("allowed_values", ()) for check in column.checks]
    return tuple(word for words in listed for word in words if isinstance(word, str))


AGAINST_DEGRADATION = " against degradation"
"""Ending of a statement, omitted where nothing degrades."""


@dataclass(frozen=True)
class Table:
    """A file of data.

    Parameters
    ----------
    name : str
        Name in a `bayesdeg.data.study.Study`.
    schema : pandera.DataFrameSchema
        Its columns in the order of the contract (a file may have more) and rules for its rows; its
        name is that of the file.
    cost : str
        Consequence of its absence; empty if there is none.
    supports : str
        Statements of a report that rest on it.
    counts : str
        What its first column lists, in the plural; the report gives their number.
    of_degradation : bool
        Whether it concerns degradation or shrinkage, so that it is not missed without them.
    """

    name: str
    schema: pa.DataFrameSchema
    cost: str = ""
    supports: str = ""
    counts: str = "specimens"
    of_degradation: bool = False

    @property
    def file(self) -> str:
        """Name of the file in the folder of a study."""
        return str(self.schema.name)

    @property
    def columns(self) -> Mapping[str, pa.Column]:
        """Columns by their names."""
        found: Mapping[str, pa.Column] = self.schema.columns
        return found

    def cost_in(self, *, degrades: bool) -> str:
        """Return the consequence of its absence; empty if there is none.

        Examples
        --------
        >>> BASE_TABLES["moisture"].cost_in(degrades=False), bool(BASE_TABLES["moisture"].cost)
        ('', True)
        """
        return self.cost if degrades or not self.of_degradation else ""

    def supports_in(self, *, degrades: bool) -> str:
        """Return the statements that rest on it.

        Examples
        --------
        >>> BASE_TABLES["tensile"].supports_in(degrades=False)
        'Yeoh constants'
        """
        return self.supports if degrades else self.supports.removesuffix(AGAINST_DEGRADATION)


def _specimens() -> dict[str, pa.Column]:
    return {
        "specimen_id": text(),
        "degradation_pct": number(MEASURED_RATE, PERCENT),
        "degradation_sd_pct": number(NOT_NEGATIVE, KNOWN_RATE, optional=True),
    }


MOISTURE = pa.DataFrameSchema(
    {
        "film_id": text(),
        "time_h": number(NOT_NEGATIVE),
        "mass_equilibrated_g": number(POSITIVE),
        "mass_dry_g": number(POSITIVE),
    },
    [
        once("film_id", "give one row per film, each film with its own name"),
        at_most(
            "mass_dry_g", "mass_equilibrated_g", "a film loses mass when it dries", strictly=True
        ),
    ],
    name="moisture.csv",
)
MASS_LOSS = pa.DataFrameSchema(
    {
        "specimen_id": text(),
        "time_min": number(NOT_NEGATIVE),
        "mass_dry_before_g": number(POSITIVE),
        "mass_dry_after_g": number(POSITIVE),
        "mass_equilibrated_before_g": number(POSITIVE),
        "mass_equilibrated_after_g": number(POSITIVE),
    },
    [
        once("specimen_id", "give one row per sample, each sample with its own name"),
        *(
            at_most(
                f"mass_dry_{state}_g",
                f"mass_equilibrated_{state}_g",
                "a sample loses mass when it dries",
                strictly=True,
            )
            for state in ("before", "after")
        ),
    ],
    name="mass_loss.csv",
)
SHRINKAGE = pa.DataFrameSchema(
    {
        "film_id": text(),
        "mass_poured_g": number(POSITIVE),
        "mass_cured_g": number(POSITIVE),
        "mass_conditioned_g": number(POSITIVE),
    },
    [
        once("film_id", "give one row per film, each film with its own name"),
        at_most("mass_cured_g", "mass_poured_g", "a film loses mass when it cures"),
        at_most("mass_conditioned_g", "mass_cured_g", "a film loses mass when it is conditioned"),
    ],
    name="shrinkage.csv",
)
TENSILE = pa.DataFrameSchema(
    _specimens()
    | {
        "mode": _word(*MODES),
        "stretch": number(POSITIVE, STRETCHABLE),
        "stress_MPa": number(),
        "stress_measure": _word("nominal", "cauchy"),
        "temperature_C": number(ROOM, optional=True),
        "batch": _label(),
    },
    [ONE_DEGRADATION, SOMETHING_STRESSED],
    name="tensile.csv",
)
BREAKS = pa.DataFrameSchema(
    _specimens() | {"elongation_pct": number(POSITIVE)},
    [once("specimen_id", "a specimen breaks once; give each specimen its own name")],
    name="break.csv",
)


def of_actuators(read: Mapping[str, pa.Column]) -> dict[str, pa.Column]:
    """Return the columns of a file of actuator tests with these readings."""
    return {
        **_specimens(),
        "pressure_kPa": number(NO_VACUUM),
        **read,
        "time_s": number(NOT_NEGATIVE, optional=True),
        "cycle": _whole(POSITIVE, WHOLE, default=1),
        "branch": _word(*BRANCHES),
        "humidity_pct": number(NOT_NEGATIVE, PERCENT, optional=True),
        "mount": _word(*MOUNTS),
        "temperature_C": number(ROOM, optional=True),
        "batch": _label(),
    }


ACTUATOR = pa.DataFrameSchema(
    of_actuators(
        {
            "curvature_per_m": number(empty=True),
            "bend_angle_deg": number(optional=True),
            "curvature_sd_per_m": number(NOT_NEGATIVE, optional=True),
            "bend_angle_sd_deg": number(NOT_NEGATIVE, optional=True),
            "cavity_volume_ml": number(optional=True),
        }
    )
    | {"ruptured": _whole(BURST, default=0)},
    [
        *(ONE_DEGRADATION, BRANCH_NAMED, PRESSURE_PROCEEDS, TIME_PROCEEDS),
        *(CURVATURE_RECORDED, SOMETHING_APPLIED),
    ],
    name="actuator.csv",
)
SUMMARY = pa.DataFrameSchema(
    {
        "quantity": _word(*UNITS_OF_STATISTICS, optional=False),
        "degradation_pct": number(NOT_NEGATIVE, PERCENT, empty=True),
        "value": number(),
        "sd": number(NOT_NEGATIVE, empty=True),
        "n": number(POSITIVE, WHOLE, empty=True),
        "unit": text(empty=True, default="–"),
        "source": text(),
    },
    SUMMARY_CHECKS,
    name="summary.csv",
)
#: The tables of films and actuators by their names; kinds of data that are files of
#: `bayesdeg.observations` define their own, see `bayesdeg.observations.catalogue.TABLES`.
BASE_TABLES: Mapping[str, Table] = MappingProxyType(
    {
        table.name: table
        for table in (
            Table(
                "moisture",
                MOISTURE,
                cost="degradation rates are not checked against time",
                of_degradation=True,
            ),
            Table(
                "mass_loss",
                MASS_LOSS,
                supports="mass loss over degradation rate",
                counts="samples",
                of_degradation=True,
            ),
            Table(
                "shrinkage",
                SHRINKAGE,
                cost="the volume ratio α rests on its prior and published statistics",
                supports="volume ratio α",
                counts="films",
                of_degradation=True,
            ),
            Table(
                "tensile",
                TENSILE,
                cost="the Yeoh constants rest on priors and published statistics",
                supports=f"Yeoh constants{AGAINST_DEGRADATION}",
            ),
            Table(
                "breaks",
                BREAKS,
                cost="the elongation limit rests on priors and published statistics",
                supports="elongation limit and rupture",
            ),
            Table(
                "actuator",
                ACTUATOR,
                cost="no statement about the actuator: no misfit, no cause, no bands",
                supports="verdict, gain, curvature bands",
            ),
            Table(
                "summary",
                SUMMARY,
                cost="published statistics are neither compared nor used",
            ),
        )
    }
)
