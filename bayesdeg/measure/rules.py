"""What rows must fulfil together: masses that only fall, pressures that only rise."""

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

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
