"""Exclusion of outlying specimens and readings from a study."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.checks.suspects import Anomaly, Suspect
from bayesdeg.data.study import Study, Unused, Why, unused_of
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import ACTUATOR
from bayesdeg.observations.kinds import Places
from bayesdeg.observations.tensile import FILM

BY_READING = (Anomaly.READING, Anomaly.JUMP, Anomaly.CUT_OFF, Anomaly.EDGE)
READ = ("curvature_per_m", "bend_angle_deg")
TABLE_OF_FAMILY = {ACTUATOR: "actuator", FILM: "tensile"}
"""Tables by family of readings; suspects in other tables are reported but not set aside."""
FILES = {"actuator.csv": "actuator", "tensile.csv": "tensile"} | dict.fromkeys(
    ("markers.csv", "photos.csv", "captures.csv"), "actuator"
)
"""The same tables by file."""


@dataclass(frozen=True)
class Exclusion:
    """The data excluded because of one suspect.

    Parameters
    ----------
    suspect : Suspect or None
        Why; None where its columns say it, or where no curve goes so far.
    table : str
        Of which table: ``actuator`` or ``tensile``.
    specimens : tuple of str
        Whose.
    readings : tuple of (str, float, str, float)
        Specimen, pressure [kPa] or stretch, history and time [s] of single readings; empty where
        the specimens are set aside.
    is_out : bool
        Whether it is: as many specimens as half of them are merely told.
    is_without_rows : bool
        Whether rows of single readings of actuators go as a whole, with what is known of rupture.
    """

    suspect: Suspect | None
    table: str
    specimens: tuple[str, ...]
    readings: tuple[tuple[str, float, str, float], ...]
    is_out: bool = True
    is_without_rows: bool = False


def asides(model: JointModel, found: Iterable[Suspect]) -> tuple[Exclusion, ...]:
    """Return the data to exclude because of the suspects of a model."""
    places, excluded = model.places, []
    for suspect in found:
        one = suspect.hypothesis
        family = places.family[np.argmax(one.rows)]
        table = TABLE_OF_FAMILY.get(str(family), "")
        if one.oddity in BY_READING:
            readings = readings_at(places, one.rows)
            excluded.append(Exclusion(suspect, table, one.specimens, readings))
        else:
            total = len(np.unique(places.specimen[places.family == family]))
            is_out = 2 * len(one.specimens) <= total
            excluded.append(Exclusion(suspect, table, one.specimens, (), is_out=is_out))
    return tuple(excluded)


def readings_at(
    places: Places, rows: NDArray[np.bool_]
) -> tuple[tuple[str, float, str, float], ...]:
    """Return the readings in some rows of the observations, as `Exclusion` names them."""
    keys = {
        (
            str(places.specimen[i]),
            float(places.along[i]),
            str(places.history[i]),
            float(np.nan_to_num(places.time[i], nan=-1.0)),
        )
        for i in np.flatnonzero(rows)
    }
    return tuple(sorted(keys))


def set_aside(study: Study, aside: Iterable[Exclusion]) -> Study:
    """Return a study without the excluded data.

    Specimens are removed from their table. For single readings of actuators the row stays with an
    empty reading, so that pressure and rupture are still known, unless no prediction reaches it.
    """
    changed: dict[str, Any] = {}
    for one in aside:
        table = changed.get(one.table, study.table(one.table)) if one.table else None
        if table is None or not one.is_out:
            continue
        wrong = is_set_aside(table, [one])
        if one.table == "tensile" or not one.readings or one.is_without_rows:
            changed[one.table] = table[~wrong].reset_index(drop=True)
        else:
            changed[one.table] = table.copy()
            changed[one.table].loc[wrong, list(READ)] = np.nan
    return replace(study, **changed)


def is_set_aside(table: pd.DataFrame, aside: Iterable[Exclusion]) -> NDArray[np.bool_]:
    """Return a mask of the excluded rows of a table, (n_rows,)."""
    specimen, found = table["specimen_id"].astype(str), np.zeros(len(table), dtype=bool)
    for one in aside:
        if one.readings:
            wanted = set(one.readings)
            found |= np.array([key in wanted for key in _keys(table, one.table)], dtype=bool)
        else:
            found |= specimen.isin(one.specimens).to_numpy()
    return found


def unused_rows(study: Study, whole: Study, aside: Iterable[Exclusion]) -> tuple[Unused, ...]:
    """Return the rows of a study's files that no likelihood uses.

    Parameters
    ----------
    study, whole : Study
        Without and with what is set aside.
    aside : iterable of Exclusion
        In the order in which they were.
    """
    found, left = list(study.unused), {name: whole.table(name) for name in TABLE_OF_FAMILY.values()}
    of_lines = {"actuator": whole.lines_file} if whole.line_points is not None else {}
    for one in aside:
        table = left.get(one.table)
        if table is None or not one.is_out:
            continue
        rows = is_set_aside(table, [one])
        why = Why.BEYOND_REACH if one.is_without_rows else Why.SET_ASIDE
        found += unused_of(of_lines.get(one.table, f"{one.table}.csv"), why, table[rows])
        left[one.table] = table[~rows]
    return tuple(found)


def _keys(table: pd.DataFrame, name: str) -> list[tuple[str, float, str, float]]:
    """Return specimen, path, history and time of each row, as in `Places`."""
    specimen = table["specimen_id"].astype(str)
    if name == "tensile":
        along, history, time = table["stretch"], table["mode"].astype(str), None
    else:
        along, time = table["pressure_kPa"], table["time_s"].fillna(-1.0)
        cycle = table["cycle"].fillna(1).astype(int).astype(str)
        history = table["branch"].astype(str) + " " + cycle + " " + table["mount"].astype(str)
    times = [-1.0] * len(table) if time is None else [float(t) for t in time]
    return list(
        zip(specimen, (float(a) for a in along), (str(h) for h in history), times, strict=True)
    )
