r"""Lines of points from motion capture: markers, frames of a hold, pressures.

Each row of ``captures.csv`` is a hold. Its line goes through the markers named in ``[captures]`` of
``study.toml``, averaged over the frames in which all of them are visible, in the bending plane.
Faults of all recordings are reported together.

With s the standard deviation of a coordinate over n frames and τ its integrated autocorrelation
time in frames, the mean has the standard error

.. math:: \sigma = s \sqrt{\tau / n}, \qquad \tau = 1 + 2 \sum_{k=1}^{M} \rho_k,

with M the first lag of at least 5 τ (Sokal 1997, doi:10.1007/978-1-4899-0319-8_6): frames are not
independent, since programs smooth what cameras see, and gel creeps while it is held.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.util import find_spec

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayesdeg.data.captures import FILE, FOLDER, CapturedLine
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import CaptureOptions
from bayesdeg.data.study import Study
from bayesdeg.data.tables import of_actuators
from bayesdeg.errors import Fault, StudyError, use_one_of
from bayesdeg.files import read_bytes, reason
from bayesdeg.observations.markers import with_lines
from bayesdeg.progress import Progress
from bayesdeg_camera.c3d import LIBRARY, Recording, read_c3d
from bayesdeg_camera.places import contradictions, named_files, raise_faults

Floats = NDArray[np.float64]

#: Ten minutes of 20 markers and 16 channels at 1 kHz have 60 MB [MB].
CAPTURE_MB = 200.0
#: Share of the line's length by which markers may leave the bending plane.
OFF_PLANE = 0.1
#: With fewer frames the autocorrelation is unknown: the mean then counts as one frame.
FEW_FRAMES = 10
WINDOW = 5.0  # autocorrelation times, after Sokal
#: Least deviation from a straight line, over that from the plane, that counts as bending.
BENT = 3.0
SAME_PLACE = 1e-6  # mm: far below what is measured, far above rounding
MILLIMETRES: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
KILOPASCALS: Mapping[str, float] = {"pa": 1e-3, "hpa": 0.1, "mbar": 0.1, "kpa": 1.0, "bar": 100.0,
                                    "mpa": 1e3, "psi": 6.894757}  # fmt: skip
_MOST_NAMES = 12  # that a message lists


@dataclass(frozen=True)
class Hold:
    """A row of ``captures.csv`` with its markers, averaged.

    Parameters
    ----------
    row : mapping
        Of the table.
    pressure : float
        [kPa]
    points : array, shape (n_markers, 3)
        Means [mm].
    error : array, shape (n_markers, 3)
        Their standard errors from the scatter of frames [mm].
    frames, left_out : int
        How many were averaged, and how many not.
    """

    row: Mapping[str, object]
    pressure: float
    points: Floats
    error: Floats
    frames: int
    left_out: int

    @property
    def specimen(self) -> str:
        """The actuator."""
        return str(self.row["specimen_id"])

    @property
    def length(self) -> float:
        """Of the line through the markers [mm]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True)
class BendingPlane:
    """The bending plane of an actuator.

    Parameters
    ----------
    middle : array, shape (3,)
        A point of it [mm].
    axes : array, shape (2, 3)
        Its two directions: along the actuator, and away from the paper.
    off : float
        Root mean square distance of markers from it [mm].
    """

    middle: Floats
    axes: Floats
    off: float

    def placed(self, points: Floats) -> Floats:
        """Return points in its two directions, (..., 2) [mm]."""
        found: Floats = (points - self.middle) @ self.axes.T
        return found


def with_captures(study: Study, progress: Progress) -> Study:
    """Return a study with the lines read from its recordings.

    Parameters
    ----------
    study : Study
        As read from its folder, with a table of recordings.
    progress : Progress
        Shows the work.

    Raises
    ------
    StudyError
        If a recording is missing, is outside the study, no C3D file or damaged, lacks markers,
        frames or the channel of pressures, or its markers do not bend in a plane.
    """
    table, options = study.table("captures"), study.settings.captures
    assert table is not None
    faults = contradictions(study, FILE, "recordings")
    if study.settings.reading.operator == "base_tip" and options.plane is None:
        problem = "is missing, so the direction of the base is unknown"
        remedy = (
            "give the axes along the clamped end and away from the paper, or a different operator"
        )
        faults.append(Fault(SETTINGS_FILE, problem, remedy, None, "captures.plane"))
    if find_spec(LIBRARY) is None:
        problem = f"needs the library {LIBRARY}, which is not installed"
        faults.append(Fault(FILE, problem, "run: pip install 'bayesdeg[motion]'"))
    raise_faults(faults)
    names = dict.fromkeys(map(str, table["file"]))
    recordings, hashes = _recordings(study, names, progress)
    raise_faults(
        fault for name, one in recordings.items() for fault in _lacking(name, one, options)
    )
    holds = []
    for row in table.to_dict("records"):
        named = {str(name): value for name, value in row.items()}
        try:
            holds.append(_hold(named, recordings[str(row["file"])], options))
        except StudyError as fault:
            faults += fault.faults
    raise_faults(faults)
    planes = _planes(holds, options)
    lines, captured = [], []
    for hold in holds:
        plane = planes[hold.specimen]
        points = plane.placed(hold.points)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if steps.min() <= SAME_PLACE:
            k = int(np.argmin(steps))
            both = f"{options.markers[k]} and {options.markers[k + 1]}"
            remedy = "name every marker once, and check the plane"
            faults.append(_fault_of(hold.row, f"has the markers {both} at the same place", remedy))
            continue
        points = shifted(points, options.offset)
        points -= points[0]
        within = np.sqrt(np.mean(hold.error**2 @ (plane.axes**2).T, axis=1))
        line = {name: hold.row[name] for name in of_actuators({})} | {
            "pressure_kPa": hold.pressure,
            "point": np.arange(1.0, len(points) + 1.0),
            "x_mm": points[:, 0],
            "y_mm": points[:, 1],
            "sd_mm": np.hypot(within, options.sd),
        }
        lines.append(pd.DataFrame(line).assign(x_px=np.nan, y_px=np.nan, scale_mm_per_px=np.nan))
        about = (str(hold.row["file"]), hold.specimen, hold.pressure, hold.frames, hold.left_out)
        captured.append(CapturedLine(*about, plane.off / hold.length))
    raise_faults(faults)
    read = replace(
        study,
        others={**study.others, "markers": pd.concat(lines, ignore_index=True)},
        recorded={**study.recorded, "markers": study.recorded.get("captures", frozenset())},
        hashes={**study.hashes, **hashes},
        captured=tuple(captured),
    )
    return with_lines(read)


def _recordings(
    study: Study, names: Iterable[str], progress: Progress
) -> tuple[dict[str, Recording], dict[str, str]]:
    """Read every file once; return recordings by name, and hashes by path."""
    places, faults = named_files(study.folder, FILE, FOLDER, names, "recordings")
    raise_faults(faults)
    progress.stage("reading recordings", len(places))
    found, hashes = {}, {}
    for name, path in places.items():
        file = f"{FOLDER}/{name}"
        try:
            content = read_bytes(path, most_mb=CAPTURE_MB)
            hashes[file] = sha256(content).hexdigest()
            found[name] = read_c3d(str(path.absolute()), content)
        except OSError as error:
            problem = f"cannot be read ({reason(error)})"
            faults.append(Fault(file, problem, "give a C3D file that can be read"))
        except ValueError as error:
            faults.append(Fault(file, str(error), "export it again as C3D"))
        progress.advance(note=name)
    raise_faults(faults)
    return found, hashes


def _lacking(name: str, recording: Recording, options: CaptureOptions) -> Iterator[Fault]:
    """Find what a recording lacks that ``[captures]`` requires."""
    file, there = f"{FOLDER}/{name}", recording.labels
    if not options.markers:
        shown = ", ".join(there[:_MOST_NAMES])
        remedy = f"name them from the clamp to the tip; {file} has {shown}"
        yield Fault(SETTINGS_FILE, "names no markers", remedy, None, "captures.markers")
    for marker in options.markers:
        found = places_of(marker, there)
        if len(found) != 1:
            problem = (
                "is not one of its markers"
                if not found
                else "is the name of several of its markers"
            )
            remedy = use_one_of(marker, there[:_MOST_NAMES])
            yield Fault(file, problem, remedy, None, "captures.markers", marker)
    if options.unit is None and recording.unit.lower() not in MILLIMETRES:
        problem = "states no known unit of length"
        remedy = f"state [captures] unit, one of {', '.join(MILLIMETRES)}"
        yield Fault(file, problem, remedy, None, "POINT:UNITS", recording.unit)
    if options.pressure is None:
        return
    at = places_of(options.pressure, recording.channels)
    if len(at) != 1:
        remedy = use_one_of(options.pressure, recording.channels[:_MOST_NAMES] or ("none",))
        place = (None, "captures.pressure", options.pressure)
        yield Fault(file, "is not one of its analog channels", remedy, *place)
    elif (
        options.kpa_per_unit is None
        and (unit := recording.channel_units[at[0]]).lower() not in KILOPASCALS
    ):
        problem = "has a pressure channel without a pressure unit"
        remedy = "state [captures] kPa_per_unit, and zero, its reading at zero pressure"
        yield Fault(file, problem, remedy, None, options.pressure, unit)


def places_of(name: str, labels: Sequence[str]) -> list[int]:
    """Return the index of a name among labels, with or without a subject before a colon.

    Examples
    --------
    >>> places_of("B1", ("A1:B1", "A1:B2")), places_of("B1", ("B1", "A1:B1"))
    ([0], [0])
    """
    whole = [i for i, label in enumerate(labels) if label == name]
    return whole or [i for i, label in enumerate(labels) if label.rpartition(":")[2] == name]


def _fault_of(row: Mapping[str, object], problem: str, remedy: str) -> Fault:
    name = str(row["specimen_id"])
    return Fault(FILE, problem, remedy, None, "file", str(row["file"]), name)


def _number(row: Mapping[str, object], name: str) -> float:
    """Return a cell; nan where nothing is recorded."""
    return float(str(row[name]))


def _hold(row: Mapping[str, object], recording: Recording, options: CaptureOptions) -> Hold:
    """Average the markers of a row over its frames, all if it names none.

    The pressure is the stated one, or the mean of the channel.

    Raises
    ------
    StudyError
        If it has no such frames, a marker is not seen in any, or there is no pressure.
    """
    first, last = recording.first_frame, recording.first_frame + len(recording.points) - 1
    low = first if np.isnan(start := _number(row, "first_frame")) else int(start)
    high = last if np.isnan(end := _number(row, "last_frame")) else int(end)
    if not first <= low <= high <= last:
        problem = f"names frames {low} to {high}, but the recording has {first} to {last}"
        remedy = "give frames by the numbers of the recording"
        raise StudyError([_fault_of(row, problem, remedy)])
    frames = np.arange(low - first, high - first + 1)
    markers = [places_of(marker, recording.labels)[0] for marker in options.markers]
    unit = MILLIMETRES[options.unit or recording.unit.lower()]
    points = unit * recording.points[frames][:, markers]
    seen = np.isfinite(points).all(axis=2)
    whole = seen.all(axis=1)
    if not whole.any():
        marker = options.markers[int(np.argmin(seen.sum(axis=0)))]
        problem = f"has no frame with all markers visible; {marker} is missing most often"
        remedy = "fill its gaps in the capture software, or name other frames"
        raise StudyError([_fault_of(row, problem, remedy)])
    pressure = _number(row, "pressure_kPa")
    if np.isnan(pressure):
        if options.pressure is None:
            remedy = "give it, or name the analog channel as [captures] pressure"
            raise StudyError([_fault_of(row, "states no pressure_kPa", remedy)])
        channel = places_of(options.pressure, recording.channels)[0]
        samples = recording.analogs[frames[whole]][..., channel]
        if not samples.size or not np.isfinite(samples).all():
            problem = f"has no samples of {options.pressure}"
            raise StudyError([_fault_of(row, problem, "give pressure_kPa")])
        in_kpa = KILOPASCALS.get(recording.channel_units[channel].lower(), 1.0)
        factor = options.kpa_per_unit or in_kpa
        pressure = round(factor * (float(np.mean(samples)) - options.zero), 6)
    kept = points[whole]
    error = error_of_mean(kept.reshape(len(kept), -1)).reshape(-1, 3)
    return Hold(row, pressure, kept.mean(axis=0), error, len(kept), int(np.sum(~whole)))


def _planes(holds: list[Hold], options: CaptureOptions) -> dict[str, BendingPlane]:
    """Return the bending plane of each specimen; refuse specimens without one."""
    planes: dict[str, BendingPlane] = {}
    faults = []
    for name in dict.fromkeys(hold.specimen for hold in holds):
        own = sorted((h for h in holds if h.specimen == name), key=lambda hold: hold.pressure)
        lines = [hold.points for hold in own]
        plane = (
            fitted_plane(lines)
            if options.plane is None
            else stated_plane(*options.plane, np.concatenate(lines))
        )
        if plane is None:
            problem = "is too straight in all of its holds to show the plane in which it bends"
            remedy = 'state [captures] plane, such as ["x", "-z"]'
            faults.append(Fault(FILE, problem, remedy, specimen=name))
        elif plane.off > OFF_PLANE * own[0].length:
            problem = f"has markers {plane.off:.2g} mm off the bending plane"
            remedy = "name the markers along the bottom line, or state [captures] plane"
            faults.append(Fault(FILE, problem, remedy, specimen=name))
        else:
            planes[name] = plane
    raise_faults(faults)
    return planes


def stated_plane(along: str, away: str, points: Floats) -> BendingPlane:
    """Return the plane of two axes of the laboratory.

    Parameters
    ----------
    along, away : str
        ``x``, ``-x`` and so on: along the clamped end towards the tip, and away from the paper.
    points : array, shape (n, 3)
        Of markers [mm].

    Examples
    --------
    >>> stated_plane("-z", "x", np.zeros((1, 3))).placed(np.array([3.0, 5.0, -40.0])).tolist()
    [40.0, 3.0]
    """
    axes = np.array([_axis(along), _axis(away)])
    normal = np.cross(*axes)
    distance = (points - points.mean(axis=0)) @ normal
    return BendingPlane(np.zeros(3), axes, float(np.sqrt(np.mean(distance**2))))


def _axis(name: str) -> Floats:
    found = np.zeros(3)
    found["xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return found


def fitted_plane(lines: list[Floats]) -> BendingPlane | None:
    """Return the bending plane of lines; None if they are too straight.

    Parameters
    ----------
    lines : list of array, shape (n_points, 3)
        Of one actuator from the clamp to the tip, the one that is bent most last [mm]. It bends
        towards the paper.

    Examples
    --------
    >>> at = np.linspace(0.0, 1.0, 8)
    >>> bent = [40.0 / k * np.column_stack([np.sin(k * at), 0.0 * at, np.cos(k * at)])
    ...         for k in (0.2, 0.7)]
    >>> plane = fitted_plane(bent)
    >>> round(plane.off, 9), bool(plane.placed(bent[1][-1] - bent[1][0])[1] < 0.0)
    (0.0, True)
    >>> fitted_plane([np.outer(at, [40.0, 1.0, 0.0])]) is None
    True
    """
    points = np.concatenate([line - line[0] for line in lines])
    middle = lines[-1][0]
    _, spread, axes = np.linalg.svd(points, full_matrices=False)
    rounding = 1e-9 * spread[0]
    if spread[1] <= BENT * max(spread[2], rounding):
        return None
    along, away = axes[:2]
    last = lines[-1]
    if along @ (last[-1] - last[0]) < 0.0:
        along = -along
    plane = BendingPlane(middle, np.array([along, away]), float(spread[2] / np.sqrt(len(points))))
    steps = np.diff(plane.placed(last), axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turned_left = heading[-1] > heading[0]
    return replace(plane, axes=np.array([along, -away])) if turned_left else plane


def error_of_mean(values: Floats) -> Floats:
    """Return the standard error of the mean of frames, (n_series,); 0 for one frame.

    Parameters
    ----------
    values : array, shape (n_frames, n_series)

    Examples
    --------
    Of 400 frames, and of as many that are each there four times:

    >>> noise = np.random.default_rng(1).normal(size=(400, 100))
    >>> [float(error_of_mean(one).mean().round(3)) for one in (noise, np.repeat(noise, 4, axis=0))]
    [0.052, 0.051]
    """
    count = len(values)
    if count < 2:
        return np.zeros(values.shape[1])
    spread = np.std(values, axis=0, ddof=1)
    if count < FEW_FRAMES:
        return np.asarray(spread)
    share = np.array([_correlation_time(series) for series in values.T]) / count
    return np.asarray(spread * np.sqrt(np.minimum(share, 1.0)))


def _correlation_time(series: Floats) -> float:
    """Return the integrated autocorrelation time in frames, at least 1."""
    centred = series - series.mean()
    if not np.any(np.abs(centred) > 1e-12 * np.abs(series).max()):
        return 1.0
    spectrum = np.fft.rfft(centred, 2 * len(series))
    rho = np.fft.irfft(np.abs(spectrum) ** 2)[: len(series)]
    times = 2.0 * np.cumsum(rho / rho[0]) - 1.0
    enough = np.arange(len(times)) >= WINDOW * times
    return max(1.0, float(times[np.argmax(enough) if enough.any() else -1]))


def shifted(line: Floats, distance: float) -> Floats:
    """Return a line offset normally away from the paper, (n, 2) [mm].

    Centres of markers that sit on the paper are a distance below the bottom line.

    Examples
    --------
    >>> shifted(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), 0.5)[:, 1].tolist()
    [0.5, 0.5, 0.5, 0.5]
    """
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    ahead = CubicSpline(arc, line)(arc, 1)
    ahead /= np.hypot(*ahead.T)[:, None]
    found: Floats = line + distance * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return found
