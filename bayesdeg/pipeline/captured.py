"""Recordings of motion capture become lines of points: markers, frames of a hold, pressures.

Each row of ``captures.csv`` is a hold. Its line goes through the markers that ``[captures]`` of
``study.toml`` names, averaged over those frames in which all of them were seen, in the plane of
bending. What cannot be read is a fault of the study, all of them together.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.captures import FILE, FOLDER, CapturedLine
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import CaptureOptions
from bayesdeg.data.study import Study
from bayesdeg.data.tables import of_actuators
from bayesdeg.errors import Fault, StudyError, use_one_of
from bayesdeg.files import read_bytes, reason
from bayesdeg.observations.markers import with_lines
from bayesdeg.photographs.motion import (
    BendingPlane,
    error_of_mean,
    fitted_plane,
    shifted,
    stated_plane,
)
from bayesdeg.pipeline.c3d import Recording, is_readable, read_c3d
from bayesdeg.pipeline.places import named_files
from bayesdeg.pipeline.progress import Progress

Floats = NDArray[np.float64]

#: Ten minutes of 20 markers and 16 channels at 1 kHz have 60 MB [MB].
CAPTURE_MB = 200.0
#: Of the length of the line: markers that leave the plane of bending by more do not bend in it.
OFF_PLANE = 0.1
SAME_PLACE = 1e-6  # mm: far below what is measured, far above rounding
MILLIMETRES: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
KILOPASCALS: Mapping[str, float] = {"pa": 1e-3, "hpa": 0.1, "mbar": 0.1, "kpa": 1.0, "bar": 100.0,
                                    "mpa": 1e3, "psi": 6.894757}  # fmt: skip
_MARKERS, _CAPTURES = "markers", "captures"
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


def with_captures(study: Study, progress: Progress) -> Study:
    """Return a study whose recordings have been read, and their lines with them.

    Parameters
    ----------
    study : Study
        As read from its folder, with a table of recordings.
    progress : Progress
        Shows the work.

    Raises
    ------
    StudyError
        If a recording is not there, is outside the study, no C3D file or damaged, lacks markers,
        frames or the channel of pressures, or its markers do not bend in a plane.
    """
    table = study.table(_CAPTURES)
    assert table is not None
    _raise(_wrong_study(study))
    names = dict.fromkeys(map(str, table["file"]))
    places, faults = named_files(study.folder, FILE, FOLDER, names, "recordings")
    _raise(faults)
    recordings, hashes, faults = _recordings(places, progress)
    _raise(faults)
    options = study.settings.captures
    faults = [fault for name, one in recordings.items() for fault in _wrong(name, one, options)]
    _raise(faults)
    holds, faults = _holds(table, recordings, options)
    _raise(faults)
    planes, faults = _planes(holds, options)
    _raise(faults)
    _raise(_apart(hold, planes[_specimen(hold)], options) for hold in holds)
    lines = [_line(hold, planes[_specimen(hold)], options) for hold in holds]
    read = replace(
        study,
        others={**study.others, _MARKERS: pd.concat(lines, ignore_index=True)},
        recorded={**study.recorded, _MARKERS: study.recorded.get(_CAPTURES, frozenset())},
        hashes={**study.hashes, **hashes},
        captured=tuple(_record(hold, planes[_specimen(hold)]) for hold in holds),
    )
    return with_lines(read)


def _raise(faults: Iterable[Fault | None]) -> None:
    if found := tuple(one for one in faults if one is not None):
        raise StudyError(found)


def _wrong_study(study: Study) -> Iterator[Fault]:
    others = {"actuator": "actuator.csv", _MARKERS: "markers.csv", "photos": "photos.csv"}
    for name, file in others.items():
        if study.table(name) is not None:
            remedy = "keep the recordings, or what was read of them"
            yield Fault(FILE, f"is there beside {file}", remedy)
    if not study.settings.is_default_mould:
        problem = "is known of the default actuator alone: what points read of another is not"
        yield Fault(FILE, problem, "give bend angles of the end faces in actuator.csv")
    if study.settings.operator == "base_tip" and study.settings.captures.plane is None:
        problem = "is not stated, and without it is not known how the base lies"
        remedy = "give the axes along the clamped end and away from the paper, or another operator"
        yield Fault(SETTINGS_FILE, problem, remedy, None, "captures.plane")
    if not is_readable():
        problem = "needs the library ezc3d, which is not installed"
        yield Fault(FILE, problem, "pip install 'bayesdeg[motion]' installs it")


def _recordings(
    places: Mapping[str, Path], progress: Progress
) -> tuple[dict[str, Recording], dict[str, str], list[Fault]]:
    """Read every file once; return recordings and hashes by name, and what is wrong."""
    progress.stage("reading recordings", len(places))
    found, hashes, faults = {}, {}, []
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
    return found, hashes, faults


def _wrong(name: str, recording: Recording, options: CaptureOptions) -> Iterator[Fault]:
    """Find what a recording lacks that ``[captures]`` asks of it."""
    file, there = f"{FOLDER}/{name}", recording.labels
    if not options.markers:
        shown = ", ".join(there[:_MOST_NAMES])
        remedy = f"name them from the clamp to the tip; {file} has {shown}"
        yield Fault(SETTINGS_FILE, "names no markers", remedy, None, "captures.markers")
    for marker in options.markers:
        found = places_of(marker, there)
        if len(found) != 1:
            problem = "is no marker of it" if not found else "is the name of several markers of it"
            remedy = use_one_of(marker, there[:_MOST_NAMES])
            yield Fault(file, problem, remedy, None, "captures.markers", marker)
    if options.unit is None and recording.unit.lower() not in MILLIMETRES:
        problem = "states no unit of lengths that is known"
        remedy = f"state [captures] unit, one of {', '.join(MILLIMETRES)}"
        yield Fault(file, problem, remedy, None, "POINT:UNITS", recording.unit)
    if options.pressure is None:
        return
    at = places_of(options.pressure, recording.channels)
    if len(at) != 1:
        remedy = use_one_of(options.pressure, recording.channels[:_MOST_NAMES] or ("none",))
        place = (None, "captures.pressure", options.pressure)
        yield Fault(file, "is no analog channel of it", remedy, *place)
    elif options.kpa_per_unit is None and _unit_of(recording, at[0]) is None:
        unit = recording.channel_units[at[0]]
        problem = "has a channel of pressures in no unit of pressure"
        remedy = "state [captures] kPa_per_unit, and zero, what it reads at no pressure"
        yield Fault(file, problem, remedy, None, options.pressure, unit)


def places_of(name: str, labels: Sequence[str]) -> list[int]:
    """Return where a name is among labels: as it is, or less the subject before a colon.

    Examples
    --------
    >>> places_of("B1", ("A1:B1", "A1:B2")), places_of("B1", ("B1", "A1:B1"))
    ([0], [0])
    """
    whole = [i for i, label in enumerate(labels) if label == name]
    return whole or [i for i, label in enumerate(labels) if label.rpartition(":")[2] == name]


def _unit_of(recording: Recording, channel: int) -> float | None:
    """Return the kPa of a channel's unit, if that is one of pressure."""
    return KILOPASCALS.get(recording.channel_units[channel].lower())


def _holds(
    table: pd.DataFrame, recordings: Mapping[str, Recording], options: CaptureOptions
) -> tuple[list[Hold], list[Fault]]:
    holds: list[Hold] = []
    faults: list[Fault] = []
    for row in table.to_dict("records"):
        named = {str(name): value for name, value in row.items()}
        try:
            holds.append(_hold(named, recordings[str(row["file"])], options))
        except StudyError as fault:
            faults += fault.faults
    return holds, faults


def _hold(row: Mapping[str, object], recording: Recording, options: CaptureOptions) -> Hold:
    """Average the markers of a row over its frames.

    Raises
    ------
    StudyError
        If it has no such frames, a marker is not seen in any, or there is no pressure.
    """
    frames = _frames(row, recording)
    markers = [places_of(marker, recording.labels)[0] for marker in options.markers]
    unit = MILLIMETRES[options.unit or recording.unit.lower()]
    points = unit * recording.points[frames][:, markers]
    seen = np.isfinite(points).all(axis=2)
    whole = seen.all(axis=1)
    if not whole.any():
        marker = options.markers[int(np.argmin(seen.sum(axis=0)))]
        problem = f"has no frame in which all markers are seen; most often {marker} is not"
        raise _refused(row, problem, "fill its gaps where it was recorded, or name other frames")
    pressure = _pressure(row, recording, frames[whole], options)
    kept = points[whole]
    error = error_of_mean(kept.reshape(len(kept), -1)).reshape(-1, 3)
    left_out = int(np.sum(~whole))
    return Hold(row, pressure, kept.mean(axis=0), error, len(kept), left_out)


def _frames(row: Mapping[str, object], recording: Recording) -> NDArray[np.int_]:
    """Return the places of a row's frames in the recording; all of them where it names none."""
    first, last = recording.first_frame, recording.first_frame + len(recording.points) - 1
    low = first if np.isnan(start := _number(row, "first_frame")) else int(start)
    high = last if np.isnan(end := _number(row, "last_frame")) else int(end)
    if not first <= low <= high <= last:
        problem = f"names frames {low} to {high}, and the recording has {first} to {last}"
        raise _refused(row, problem, "give frames as the recording numbers them")
    return np.arange(low - first, high - first + 1)


def _pressure(
    row: Mapping[str, object],
    recording: Recording,
    frames: NDArray[np.int_],
    options: CaptureOptions,
) -> float:
    """Return the pressure that a row states, or the mean of its channel [kPa]."""
    if not np.isnan(stated := _number(row, "pressure_kPa")):
        return stated
    if options.pressure is None:
        remedy = "give it, or name the analog channel as [captures] pressure"
        raise _refused(row, "states no pressure_kPa", remedy)
    channel = places_of(options.pressure, recording.channels)[0]
    samples = recording.analogs[frames][..., channel]
    if not samples.size or not np.isfinite(samples).all():
        raise _refused(row, f"has no samples of {options.pressure}", "give pressure_kPa")
    factor = options.kpa_per_unit or _unit_of(recording, channel) or 1.0
    return round(factor * (float(np.mean(samples)) - options.zero), 6)


def _number(row: Mapping[str, object], name: str) -> float:
    """Return a cell; nan where nothing is recorded."""
    return float(str(row[name]))


def _refused(row: Mapping[str, object], problem: str, remedy: str) -> StudyError:
    name = str(row["specimen_id"])
    return StudyError([Fault(FILE, problem, remedy, None, "file", str(row["file"]), name)])


def _specimen(hold: Hold) -> str:
    return str(hold.row["specimen_id"])


def _planes(
    holds: list[Hold], options: CaptureOptions
) -> tuple[dict[str, BendingPlane], list[Fault]]:
    """Return the plane in which each specimen bends, and which bend in none."""
    planes: dict[str, BendingPlane] = {}
    faults = []
    for name in dict.fromkeys(map(_specimen, holds)):
        own = sorted((h for h in holds if _specimen(h) == name), key=lambda hold: hold.pressure)
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
        elif plane.off > OFF_PLANE * _length(lines[0]):
            problem = f"has markers {plane.off:.2g} mm off the plane of bending"
            remedy = "name the markers along the bottom line, or state [captures] plane"
            faults.append(Fault(FILE, problem, remedy, specimen=name))
        else:
            planes[name] = plane
    return planes, faults


def _length(line: Floats) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _apart(hold: Hold, plane: BendingPlane, options: CaptureOptions) -> Fault | None:
    """Return what is wrong with a line that has neighbours at one place."""
    steps = np.linalg.norm(np.diff(plane.placed(hold.points), axis=0), axis=1)
    if steps.min() > SAME_PLACE:
        return None
    k = int(np.argmin(steps))
    problem = f"has the markers {options.markers[k]} and {options.markers[k + 1]} at one place"
    return _refused(hold.row, problem, "name every marker once, and check the plane").faults[0]


def _line(hold: Hold, plane: BendingPlane, options: CaptureOptions) -> pd.DataFrame:
    """Return the rows of ``markers.csv`` of a hold."""
    points = shifted(plane.placed(hold.points), options.offset)
    within = np.sqrt(np.mean(hold.error**2 @ (plane.axes**2).T, axis=1))
    own = {name: hold.row[name] for name in of_actuators({})}
    points -= points[0]
    return pd.DataFrame(
        own
        | {
            "pressure_kPa": hold.pressure,
            "point": np.arange(1.0, len(points) + 1.0),
            "x_mm": points[:, 0],
            "y_mm": points[:, 1],
            "sd_mm": np.hypot(within, options.sd),
        }
    ).assign(x_px=np.nan, y_px=np.nan, scale_mm_per_px=np.nan)


def _record(hold: Hold, plane: BendingPlane) -> CapturedLine:
    off = plane.off / _length(hold.points)
    file, name = str(hold.row["file"]), _specimen(hold)
    return CapturedLine(file, name, hold.pressure, hold.frames, hold.left_out, off)
