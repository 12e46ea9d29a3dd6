r"""Points along the bottom line, from which curvature and angle are read.

A line of points becomes a curvature and a bend angle by the operator stated in the study, and the
forward map applies the same operator to as many points of its own bottom line. So definitions of
curvature cannot be confused.

With σ_i the standard error of either coordinate of point i, the angle θ read from a line of
length L has, to first order,

.. math::
    \sigma_\theta^2 = \sum_i \left|\frac{\partial \theta}{\partial r_i}\right|^2 \sigma_i^2,
    \qquad \sigma_\kappa = \sigma_\theta / L .

The change of L by errors, a share of σ/L, is ignored, as is an error of scale common to all lines:
it multiplies every curvature and no angle, see the cause `curvature_reading`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import pandera.pandas as pa
from numpy.typing import NDArray

from bayesdeg.actuator.line import MILLIMETRES_PER_METRE, OPERATORS, read_line
from bayesdeg.actuator.reading import evenly
from bayesdeg.data.settings import FEWEST_POINTS, Operator
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.study import Study
from bayesdeg.data.tables import (
    ACTUATOR,
    NOT_NEGATIVE,
    ONE_DEGRADATION,
    POSITIVE,
    WHOLE,
    Table,
    broken,
    number,
    of_actuators,
    row_check,
)
from bayesdeg.errors import Fault, StudyError

Floats = NDArray[np.float64]

FILE = "markers.csv"
#: Points by which a line is read: more add nothing, since the floor bulges smoothly.
MOST_POINTS = 50
#: Line length over mould length: gel shrinks to 0.6 of it, and no part stretches beyond.
SHORTEST, LONGEST = 0.4, 1.6
#: Displacement of points for derivatives, over the length of the line.
STEP = 1e-5
#: Number of lines at which derivatives are computed; in between they are linear in the angle.
MOVED_LINES = 7
_MILLIMETRES, _PIXELS = ("x_mm", "y_mm"), ("x_px", "y_px")


def _placed(frame: pd.DataFrame) -> pd.Series:
    in_pixels = frame[[*_PIXELS, "scale_mm_per_px"]].notna().all(axis=1)
    return frame[[*_MILLIMETRES]].notna().all(axis=1) | in_pixels


PLACED = row_check(
    None,
    "lacks the point's coordinates",
    "give x_mm and y_mm, or x_px, y_px and scale_mm_per_px",
    (*_MILLIMETRES, *_PIXELS, "scale_mm_per_px"),
    _placed,
)
TABLE = Table(
    "markers",
    pa.DataFrameSchema(
        of_actuators(
            {
                "point": number(POSITIVE, WHOLE),
                **{name: number(optional=True) for name in (*_MILLIMETRES, *_PIXELS)},
                "scale_mm_per_px": number(POSITIVE, optional=True),
                "sd_mm": number(NOT_NEGATIVE, optional=True),
            }
        ),
        [ONE_DEGRADATION, PLACED],
        name=FILE,
    ),
    supports="verdict, gain, curvature bands",
)


def angle_errors(lines: Sequence[Floats], operator: Operator, sd: Sequence[Floats]) -> Floats:
    """Return the standard errors of the angles that an operator reads from lines, (n_lines,) [rad].

    Parameters
    ----------
    lines : sequence of array, shape (n_points, 2)
        Evenly spaced points, equally many on each line [mm].
    operator : str
        One of `bayesdeg.actuator.line.OPERATORS`.
    sd : sequence of array, shape (n_points,)
        Standard error of each coordinate of each point [mm].

    Examples
    --------
    For three points at distances c, the angle follows from second differences, with an error of
    2 σ √6/c:

    >>> row = np.array([[0.0, 0.0], [20.0, 0.0], [40.0, -1.0]])
    >>> angle_errors([row], "angle_over_arc", [np.full(3, 0.1)]).round(4)
    array([0.0245])
    """
    read = [read_line(line, operator) for line in lines]
    angle, arc = (np.array(v) for v in zip(*((r.angle, r.arc_length) for r in read), strict=True))
    order = np.argsort(angle)
    chosen = np.unique(np.linspace(0, len(lines) - 1, MOVED_LINES).round().astype(int))
    places = order[chosen]
    effect = np.array([_moved(lines[i], operator) for i in places])  # per point, times the length
    at = np.array([np.interp(angle, angle[places], one) for one in effect.T]).T
    found: Floats = np.linalg.norm(at * np.array(sd), axis=1) / arc
    return found


def _moved(line: Floats, operator: Operator) -> Floats:
    """Return L |∂θ/∂e| of each point, moved along and up."""
    known = read_line(line, operator)
    step = STEP * known.arc_length
    moved = line + step * np.eye(line.size).reshape(-1, *line.shape)
    changes = [read_line(one, operator).angle - known.angle for one in moved]
    found: Floats = np.linalg.norm(np.reshape(changes, line.shape), axis=1) / STEP
    return found


def with_lines(study: Study) -> Study:
    """Return a study with its lines of points read; unchanged if it has none.

    Its `Study.actuator` has one row per line, with curvature, bend angle and their standard errors;
    `Study.line_points` is the number of evenly spaced points by which each was read.

    Parameters
    ----------
    study : Study
        As read from its folder.

    Raises
    ------
    StudyError
        If curvatures are given too, or lines cannot be read; lists every fault.
    """
    table = study.table(TABLE.name)
    if table is None:
        return study
    operator: Operator = study.settings.reading.operator or "angle_over_arc"
    _refuse(study, _wrong_study(study, operator, table))
    lines = [line for _, line in table.groupby(_line_numbers(table), sort=False)]
    points = [_points(line) for line in lines]
    faults = (_wrong_line(*pair, study.geometry.length) for pair in zip(lines, points, strict=True))
    _refuse(study, (fault for of_line in faults for fault in of_line))
    count = min(MOST_POINTS, min(map(len, lines)))
    read = _read(lines, points, operator, count)
    _refuse(study, _wrong_readings(read))
    given = study.recorded.get(TABLE.name, frozenset()) | _READ
    recorded = {**study.recorded, "actuator": frozenset(given & set(ACTUATOR.columns))}
    return replace(study, actuator=read, recorded=recorded, line_points=count)


def _read(
    lines: Sequence[pd.DataFrame], points: Sequence[Floats], operator: Operator, count: int
) -> pd.DataFrame:
    """Return the table of actuators read from lines."""
    even = [evenly(one, count) for one in points]
    ends, sd = np.linspace(0.0, 1.0, count), list[Floats]()
    for line in lines:
        given = line["sd_mm"].fillna(0.0).to_numpy(np.float64)
        sd.append(np.interp(ends, np.linspace(0.0, 1.0, len(given)), given))
    bends = [read_line(one, operator) for one in even]
    angle = np.array([bend.angle for bend in bends])
    arc = np.array([bend.arc_length for bend in bends]) / MILLIMETRES_PER_METRE
    error = angle_errors(even, operator, sd) if np.any(sd) else np.zeros(len(bends))
    rows = pd.concat([line.iloc[:1] for line in lines], ignore_index=True)
    rows["ruptured"] = 0
    angle = angle * _towards_the_paper(rows, angle)
    rows["curvature_per_m"], rows["curvature_sd_per_m"] = angle / arc, error / arc
    rows["bend_angle_deg"], rows["bend_angle_sd_deg"] = np.degrees(angle), np.degrees(error)
    return rows.reindex(columns=list(ACTUATOR.columns))  # columns without data stay empty


_READ = frozenset({"curvature_per_m", "curvature_sd_per_m", "bend_angle_deg", "bend_angle_sd_deg"})


def _line_numbers(table: pd.DataFrame) -> pd.Series:
    """Return line numbers; a line ends where conditions change or point numbers restart."""
    conditions = table[list(of_actuators({}))]
    before = conditions.shift()
    changed = (conditions != before) & ~(conditions.isna() & before.isna())
    begins = changed.any(axis=1) | (table["point"] <= table["point"].shift())
    return begins.cumsum()


def _points(line: pd.DataFrame) -> Floats:
    """Return the points of a line [mm]; pixel coordinates are flipped to point upwards."""
    if line[[*_MILLIMETRES]].notna().all(axis=None):
        found: Floats = line[[*_MILLIMETRES]].to_numpy(np.float64)
        return found
    found = line[[*_PIXELS]].to_numpy(np.float64) * [1.0, -1.0]
    found *= line["scale_mm_per_px"].to_numpy(np.float64)[:, None]
    return found


def _towards_the_paper(rows: pd.DataFrame, angle: Floats) -> Floats:
    """Return the sign that makes a specimen bend towards the paper, as pixels do not determine it.

    A picture may be taken from either side; at its largest pressure an actuator bends in its design
    direction.
    """
    most = rows.groupby("specimen_id")["pressure_kPa"].transform("idxmax").to_numpy()
    in_pixels = rows[[*_MILLIMETRES]].isna().any(axis=1).to_numpy()
    return np.where(in_pixels & (angle[most] < 0.0), -1.0, 1.0)


def _refuse(study: Study, faults: Iterator[Fault]) -> None:
    """Raise faults of lines, naming the file of the lines."""
    if found := tuple(faults):
        raise StudyError(
            replace(one, file=study.lines_file) if one.file == FILE else one for one in found
        )


def _wrong_study(study: Study, operator: Operator, table: pd.DataFrame) -> Iterator[Fault]:
    if study.actuator is not None:
        remedy = "keep either the points or the curvatures read from them"
        yield Fault(FILE, "is given together with actuator.csv", remedy)
    if not study.settings.is_default_mould:
        problem = "is supported for the default actuator only"
        yield Fault(FILE, problem, "give bend angles of the end faces in actuator.csv")
    if operator == "kappa":
        problem = "reads curves, but points are given"
        remedy = f"state one of {', '.join(OPERATORS)}"
        yield Fault(SETTINGS_FILE, problem, remedy, column="reading.operator", value=operator)
    if operator == "base_tip" and table[[*_MILLIMETRES]].isna().any(axis=None):
        remedy = "give x_mm along the clamped end and y_mm, or a different [reading] operator"
        yield Fault(FILE, "has pixels, which do not show the orientation of the base", remedy)


def _wrong_line(line: pd.DataFrame, points: Floats, length: float) -> Iterator[Fault]:
    steps = np.hypot(*np.diff(points, axis=0).T)
    if len(line) < FEWEST_POINTS:
        remedy = f"give at least {FEWEST_POINTS} points, from the clamped to the free end"
        yield _fault(line.iloc[0], f"has {len(line)} points", remedy)
    elif not steps.all():
        point = line["point"].iloc[int(np.argmin(steps)) + 1]
        problem = f"has point {point:g} at the position of the previous one"
        yield _fault(line.iloc[0], problem, "remove one of them")
    elif not SHORTEST <= steps.sum() / length <= LONGEST:
        problem = f"is {steps.sum():.3g} mm long, but the actuator is moulded with {length:.3g} mm"
        remedy = "check the scale, and that the points follow the bottom line to both ends"
        yield _fault(line.iloc[0], problem, remedy)


def _wrong_readings(read: pd.DataFrame) -> Iterator[Fault]:
    """Find faults of the readings, and report them for the line."""
    for check in ACTUATOR.checks:
        for place in broken(check, read):
            fault = _fault(read.iloc[place], check.error, check.description)
            yield replace(fault, column=check.statistics["column"])


def _fault(row: pd.Series, problem: str, remedy: str) -> Fault:
    line = f"{row['specimen_id']}, line at {row['pressure_kPa']:g} kPa"
    return Fault(FILE, problem, remedy, specimen=line)
