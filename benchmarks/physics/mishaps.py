"""Laboratory mishaps applied to the readings of a study: errors without physics.

Each takes a table like ``actuator.csv`` and returns it with the mishap, and the affected specimens.
Mishaps know nothing of how a study is judged. Readings at a wrong pressure are interpolated in the
specimen's own curve, so no model is needed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PRESSURE, CURVATURE, ANGLE = "pressure_kPa", "curvature_per_m", "bend_angle_deg"
SPECIMEN, RATE = "specimen_id", "degradation_pct"
READ = (CURVATURE, ANGLE)

MISTRACED_SHARE, MISTRACED = 0.04, (0.15, 0.40)
LEAK = (0.50, 0.75)  # pressure inside over that read
UNITS = (0.1, 0.14504, 7.5006, 10.0)  # 10 kPa (N/cm²), psi, mmHg and mbar, over kPa
EDGE, EDGE_ERROR = (0.70, 0.85), 0.005  # of the largest curvature of the study
SHORT_LENGTH = 0.93
SLIP = (0.12, 0.25)  # of the specimen's largest reading
MISMIXED = (1.3, 1.7)  # stiffness of the batch over what it should be
APART = 8.0  # degradation rates of exchanged specimens [%]: closer ones hardly differ
FEWEST_ROWS = 4


@dataclass(frozen=True)
class Mishap:
    """What went wrong, and where.

    Parameters
    ----------
    name : str
        One of `MISHAPS`.
    specimens : tuple of str
        Specimens with wrong or missing readings.
    rows : tuple of int
        Rows of the table that are wrong; empty where rows are missing.
    size : float
        Size of the mishap: a factor or a share.
    """

    name: str
    specimens: tuple[str, ...]
    rows: tuple[int, ...]
    size: float


Happened = tuple[pd.DataFrame, Mishap]


def happen(name: str, readings: pd.DataFrame, generator: Generator) -> Happened:
    """Apply a mishap to readings; return them and the mishap.

    Parameters
    ----------
    name : str
        One of `MISHAPS`.
    readings : pandas.DataFrame
        Rows of ``actuator.csv``.
    generator : Generator
        Draws the affected specimens, and the size.

    Raises
    ------
    ValueError
        If the mishap is unknown, or cannot happen to this study.

    Examples
    --------
    >>> pressure = np.tile([20.0, 40.0, 60.0, 80.0], 2)
    >>> readings = pd.DataFrame({
    ...     "specimen_id": ["A"] * 4 + ["B"] * 4, "degradation_pct": 0.0,
    ...     "pressure_kPa": pressure, "curvature_per_m": 0.1 * pressure})
    >>> wrong, mishap = happen("other_unit", readings, np.random.default_rng(1))
    >>> mishap.specimens, mishap.size, wrong["pressure_kPa"].iloc[4:].round(1).tolist()
    (('A',), 7.5006, [20.0, 40.0, 60.0, 80.0])
    """
    if name not in MISHAPS:
        raise ValueError(f"unknown mishap {name}; use one of {', '.join(MISHAPS)}")
    return MISHAPS[name](readings.reset_index(drop=True), generator)


def _specimens(readings: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(readings[SPECIMEN].astype(str)))


def _one(readings: pd.DataFrame, generator: Generator) -> str:
    """Return a specimen with enough rows."""
    count = readings[SPECIMEN].astype(str).value_counts()
    long = [name for name in _specimens(readings) if count[name] >= FEWEST_ROWS]
    if not long:
        raise ValueError(f"no specimen has {FEWEST_ROWS} readings")
    return str(generator.choice(long))


def _rows(readings: pd.DataFrame, *specimens: str) -> NDArray[np.intp]:
    return np.flatnonzero(readings[SPECIMEN].astype(str).isin(specimens))


def _read_columns(readings: pd.DataFrame) -> list[str]:
    return [column for column in READ if column in readings and readings[column].notna().any()]


def _at_pressures(curve: pd.DataFrame, factor: float) -> pd.DataFrame:
    """Return a specimen's readings at its pressures times a factor, along each stroke of its path.

    Beyond its largest pressure the last slope is extrapolated.
    """
    found = curve.copy()
    stroke = [c for c in ("cycle", "branch", "mount") if c in curve and curve[c].notna().any()]
    groups = [g for _, g in curve.groupby(stroke, sort=False)] if stroke else [curve]
    for group in groups:
        ordered = group.sort_values(PRESSURE, kind="stable")
        pressure = np.r_[0.0, ordered[PRESSURE].to_numpy(float)]
        wanted = factor * group[PRESSURE].to_numpy(float)
        for column in _read_columns(curve):
            values = np.r_[0.0, ordered[column].to_numpy(float)]
            inside = np.interp(wanted, pressure, values)
            slope = (values[-1] - values[-2]) / max(pressure[-1] - pressure[-2], 1e-9)
            beyond = np.maximum(wanted - pressure[-1], 0.0)
            found.loc[group.index, column] = inside + slope * beyond
    return found


def mistraced_pictures(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Trace 4 % of the pictures wrongly: their readings are off by 15 to 40 %."""
    count = max(1, round(MISTRACED_SHARE * len(readings)))
    rows = np.sort(generator.choice(len(readings), count, replace=False))
    off = generator.uniform(*MISTRACED, count) * generator.choice([-1.0, 1.0], count)
    found = readings.copy()
    for column in _read_columns(readings):
        found.loc[rows, column] = readings.loc[rows, column] * (1.0 + off)
    names = tuple(dict.fromkeys(readings.loc[rows, SPECIMEN].astype(str)))
    return found, Mishap(
        "mistraced_pictures", names, tuple(rows.tolist()), float(np.abs(off).max())
    )


def exchanged_labels(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Swap the readings of two specimens."""
    rate = readings.assign(name=readings[SPECIMEN].astype(str)).groupby("name")[RATE].first()
    count = readings[SPECIMEN].astype(str).value_counts()
    pairs = [
        (one, other)
        for one in rate.index
        for other in rate.index
        if rate[other] - rate[one] >= APART and count[one] == count[other]
    ]
    if not pairs:
        raise ValueError("no two specimens differ enough in degradation")
    one, other = pairs[int(generator.integers(len(pairs)))]
    first, second = _rows(readings, one), _rows(readings, other)
    found = readings.copy()
    for column in _read_columns(readings):
        found.loc[first, column] = readings.loc[second, column].to_numpy()
        found.loc[second, column] = readings.loc[first, column].to_numpy()
    rows = (*first.tolist(), *second.tolist())
    return found, Mishap(
        "exchanged_labels", (str(one), str(other)), rows, float(rate[other] - rate[one])
    )


def leaking_specimen(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Let one specimen leak: the pressure inside is a fraction of the reading."""
    name, kept = _one(readings, generator), float(generator.uniform(*LEAK))
    return _replaced(readings, "leaking_specimen", (name,), kept)


def wrong_batch(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Stiffen all specimens of one degradation rate, as in a wrongly mixed batch."""
    rate = float(generator.choice(np.unique(readings[RATE].round(0))))
    names = _specimens(readings[readings[RATE].round(0) == rate])
    stiffer = float(generator.uniform(*MISMIXED))
    found, mishap = _replaced(readings, "wrong_batch", tuple(names), 1.0 / stiffer)
    return found, Mishap(mishap.name, mishap.specimens, mishap.rows, stiffer)


def _replaced(
    readings: pd.DataFrame, mishap: str, names: tuple[str, ...], factor: float
) -> Happened:
    """Replace readings of specimens by those at pressures times a factor."""
    found = readings.copy()
    for name in names:
        rows = _rows(readings, name)
        found.loc[rows] = _at_pressures(readings.loc[rows], factor)
    return found, Mishap(mishap, names, tuple(_rows(readings, *names).tolist()), factor)


def other_unit(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Give the pressures of one specimen in a different unit."""
    name, factor = _one(readings, generator), float(generator.choice(UNITS))
    rows, found = _rows(readings, name), readings.copy()
    found[PRESSURE] = readings[PRESSURE].astype(float)
    found.loc[rows, PRESSURE] = factor * readings.loc[rows, PRESSURE].astype(float)
    return found, Mishap("other_unit", (name,), tuple(rows.tolist()), factor)


def cut_off(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Freeze the curvature beyond the edge of the picture at the last visible value."""
    edge = float(generator.uniform(*EDGE) * readings[CURVATURE].max())
    rows = np.flatnonzero(readings[CURVATURE] > edge)
    error = 1.0 + EDGE_ERROR * generator.standard_normal(len(rows))
    found = readings.copy()
    found.loc[rows, CURVATURE] = edge * error
    names = tuple(dict.fromkeys(readings.loc[rows, SPECIMEN].astype(str)))
    return found, Mishap("cut_off", names, tuple(rows.tolist()), edge)


def short_lengths(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Measure lengths 7 % short for the last specimen of each rate, as on a second day."""
    names = [
        _specimens(group)[-1] for _, group in readings.groupby(readings[RATE].round(0), sort=False)
    ]
    rows, found = _rows(readings, *names), readings.copy()
    found.loc[rows, CURVATURE] = readings.loc[rows, CURVATURE] / SHORT_LENGTH
    return found, Mishap("short_lengths", tuple(names), tuple(rows.tolist()), SHORT_LENGTH)


def slipping_clamp(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Let the clamp of one specimen slip: beyond some pressure a part of the bending is lost."""
    name, share = _one(readings, generator), float(generator.uniform(*SLIP))
    rows, found = _rows(readings, name), readings.copy()
    after = rows[int(generator.integers(len(rows) // 3, 2 * len(rows) // 3 + 1)) :]
    for column in _read_columns(readings):
        lost = share * float(readings.loc[rows, column].abs().max())
        found.loc[after, column] = readings.loc[after, column] - lost
    return found, Mishap("slipping_clamp", (name,), tuple(after.tolist()), share)


def duplicated_curve(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Copy the curve of one specimen to a different one of the same rate."""
    name = _one(readings, generator)
    rows = _rows(readings, name)
    rate = readings.loc[rows[0], RATE]
    near = readings[(readings[RATE] - rate).abs() < 0.5 * APART]
    others = [
        one for one in _specimens(near) if one != name and len(_rows(readings, one)) == len(rows)
    ]
    if not others:
        raise ValueError("no other specimen has the same degradation rate and pressures")
    other, found = str(generator.choice(others)), readings.copy()
    for column in _read_columns(readings):
        found.loc[_rows(readings, other), column] = readings.loc[rows, column].to_numpy()
    wrong = _rows(readings, other)
    return found, Mishap("duplicated_curve", (name, other), tuple(wrong.tolist()), 1.0)


def survivors_only(readings: pd.DataFrame, generator: Generator) -> Happened:
    """Keep only the least bending of the most degraded specimens."""
    rate = readings[RATE].round(0)
    last = readings[rate == rate.max()]
    names = _specimens(last)
    if len(names) < 2:
        raise ValueError("only one specimen has the highest degradation rate")
    bending = {name: float(last.loc[_rows_of(last, name), CURVATURE].mean()) for name in names}
    gone = sorted(names, key=lambda name: bending[name])[1:]
    found = readings[~readings[SPECIMEN].astype(str).isin(gone)].reset_index(drop=True)
    return found, Mishap("survivors_only", tuple(gone), (), float(len(gone)))


def _rows_of(part: pd.DataFrame, name: str) -> pd.Index:
    return part.index[part[SPECIMEN].astype(str) == name]


MISHAPS: Mapping[str, Callable[[pd.DataFrame, Generator], Happened]] = {
    one.__name__: one
    for one in (
        mistraced_pictures,
        exchanged_labels,
        leaking_specimen,
        other_unit,
        cut_off,
        short_lengths,
        slipping_clamp,
        wrong_batch,
        duplicated_curve,
        survivors_only,
    )
}
"""Each by its name."""
