"""Tracing the photographs of a study into lines of points.

A file that cannot be read as a picture is a fault of the study. A photograph without a detectable
line is left out and reported. Traces are cached by a hash of the photograph, the options and the
tracing code, in the working directory and never in the study.
"""

import importlib.resources
import json
import re
from collections.abc import Hashable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.photographs import FILE, FOLDER, TracedPhotograph
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import PhotographOptions
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError, Fault, ResumableError, StudyError
from bayesdeg.files import RUN_MB, STUDY_MB, parse_json, read_bytes, reason, write_text
from bayesdeg.observations.markers import LONGEST, SHORTEST, with_lines
from bayesdeg.photographs.lines import line_of, parse_lines
from bayesdeg.photographs.picture import read_picture
from bayesdeg.photographs.record import hash_of, marker_rows, recorded
from bayesdeg.photographs.trace import LENGTH_AGREES, PHOTO_MB, PictureScale, trace
from bayesdeg.pipeline.places import named_files, wrong_place
from bayesdeg.progress import Progress

Floats = NDArray[np.float64]

CACHE = Path(".cache/traces")
FEWEST_LENGTHS = 4  # lengths needed for a median
SEED = 1  # seed of the error estimates, as in the command
_MARKERS, _PHOTOS = "markers", "photos"
_OPTION = re.compile(r"--(grid|ruler|length|scale|base|hint|line)\b")


def with_photographs(study: Study, progress: Progress, kept: Path = CACHE) -> Study:
    """Return a study with lines read from its photographs.

    Parameters
    ----------
    study : Study
        As read from its folder, with a table of photographs.
    progress : Progress
        Shows the work.
    kept : Path
        Where what was traced is kept; nothing is, where that is in the study.

    Raises
    ------
    StudyError
        If a photograph is not there, is outside the study or no picture, or none can be traced.
    """
    table = study.table(_PHOTOS)
    assert table is not None
    _raise(_wrong_study(study))
    names = map(str, table["file"])
    places, faults = named_files(study.folder, FILE, FOLDER, names, "photographs")
    _raise(faults)
    by_hand, hashes = _set_by_hand(study)
    tracing = _Tracing(study.settings.photographs, by_hand, _outside(kept, study.folder))
    progress.stage("tracing photographs", len(places))
    found: list[TracedPhotograph] = []
    wrong: list[Fault] = []
    for name, path in places.items():
        try:
            found.append(tracing.of(name, path))
        except StudyError as fault:
            wrong += fault.faults
        progress.advance(note=name)
    _raise(wrong)
    about = table.to_dict("records")
    found = [_labelled(one, row) for one, row in zip(found, about, strict=True)]
    found = _of_one_length(found, study.geometry.length)
    hashes |= {f"{FOLDER}/{one.file}": one.sha256 for one in found}
    return _read(study, found, hashes)


def _read(study: Study, found: list[TracedPhotograph], hashes: Mapping[str, str]) -> Study:
    """Read the lines of photographs like those of ``markers.csv``."""
    table = study.table(_PHOTOS)
    assert table is not None
    lines = [
        marker_rows(one, {str(name): value for name, value in row.items()})
        for one, row in zip(found, table.to_dict("records"), strict=True)
        if not one.refused
    ]
    if not lines:
        why = f"{found[0].file}: {found[0].refused}"
        problem = f"has {len(found)} photographs, but no line could be traced in any"
        raise StudyError([Fault(FILE, problem, f"the first: {why}")])
    pixels = dict.fromkeys(("x_px", "y_px", "scale_mm_per_px"), np.nan)
    markers = pd.concat(lines, ignore_index=True).assign(**pixels)
    traced = replace(
        study,
        others={**study.others, _MARKERS: markers},
        recorded={**study.recorded, _MARKERS: study.recorded.get(_PHOTOS, frozenset())},
        hashes={**study.hashes, **hashes},
        photographs=tuple(found),
    )
    return with_lines(traced)


def _of_one_length(found: list[TracedPhotograph], moulded: float) -> list[TracedPhotograph]:
    """Refuse lines much longer or shorter than most, since paper does not stretch.

    A wrong length shows that part of a line is hidden, or that a different edge was traced.
    """
    lengths = [one.length_mm for one in found if not one.refused]
    usual = float(np.median(lengths)) if len(lengths) >= FEWEST_LENGTHS else None
    kept = []
    for one in found:
        why = "" if one.refused else _odd_length(one.length_mm, usual, moulded)
        kept.append(one.model_copy(update={"refused": why}) if why else one)
    return kept


def _odd_length(length: float, usual: float | None, moulded: float) -> str:
    remedy = "mark the line with [photographs] hint, and check the scale"
    if not SHORTEST <= length / moulded <= LONGEST:
        found = f"{length:.3g} mm, but the actuator is moulded with {moulded:.3g} mm"
        return f"its line measures {found}; {remedy}"
    if usual is not None and abs(length / usual - 1.0) > LENGTH_AGREES:
        return f"its line measures {length:.3g} mm, the median of all {usual:.3g} mm; {remedy}"
    return ""


def _labelled(photograph: TracedPhotograph, row: Mapping[Hashable, object]) -> TracedPhotograph:
    names = {"specimen_id": "specimen_id", "pressure": "pressure_kPa"}
    names["degradation"] = "degradation_pct"
    return photograph.model_copy(update={name: row[column] for name, column in names.items()})


@dataclass(frozen=True)
class _ByHand:
    """Lines by photograph: hints near the edge, and lines given instead of tracing."""

    hints: Mapping[str, Floats]
    lines: Mapping[str, Floats]


class _Tracing:
    """Traces photographs of one study, or finds earlier traces."""

    def __init__(self, options: PhotographOptions, by_hand: _ByHand, kept: Path | None) -> None:
        self._options, self._by_hand, self._kept = options, by_hand, kept
        self._scale = PictureScale(options.grid, options.ruler, options.length, options.scale)

    def of(self, name: str, path: Path) -> TracedPhotograph:
        """Return the trace of a photograph, or why there is none.

        Raises
        ------
        StudyError
            If it is no picture that can be read.
        """
        try:
            content = read_bytes(path, most_mb=PHOTO_MB)
        except OSError as fault:
            remedy = "give a readable photograph"
            problem = f"cannot be read ({reason(fault)})"
            raise StudyError([Fault(f"{FOLDER}/{name}", problem, remedy)]) from fault
        key = self._key(name, content)
        known = self._known(key)
        if known is None:
            known = self._traced(name, content)
            if self._kept is not None:
                with suppress(ResumableError):  # without write access nothing is kept
                    write_text(self._kept / f"{key}.json", known.text())
        return known.model_copy(update={"file": name})

    def _key(self, name: str, content: bytes) -> str:
        of_each = {"hint": self._by_hand.hints, "line": self._by_hand.lines}
        own = {key: line_of(lines, name) for key, lines in of_each.items()}
        points = {key: None if line is None else line.tolist() for key, line in own.items()}
        options = asdict(self._options) | points
        asked = json.dumps([_code(), cv2.__version__, options], sort_keys=True)
        return hash_of(content + asked.encode())

    def _known(self, key: str) -> TracedPhotograph | None:
        if self._kept is None:
            return None
        with suppress(OSError, ValueError):  # a damaged trace is made again
            content = read_bytes(self._kept / f"{key}.json", most_mb=RUN_MB)
            return TracedPhotograph.read(parse_json(content))
        return None

    def _traced(self, name: str, content: bytes) -> TracedPhotograph:
        try:
            image = read_picture(name, content)
        except BayesdegError as fault:
            problem, _, remedy = str(fault).removeprefix(f"{name}: ").partition("; ")
            raise StudyError([Fault(f"{FOLDER}/{name}", problem, remedy)]) from fault
        hint, line = (line_of(one, name) for one in (self._by_hand.hints, self._by_hand.lines))
        rng, base = np.random.default_rng(SEED), self._options.base
        try:
            found = trace(image, self._scale, rng=rng, hint=hint, line=line, base=base)
        except BayesdegError as fault:
            why = _OPTION.sub(r"[photographs] \1", str(fault))
            return TracedPhotograph(file=name, sha256=hash_of(content), refused=why)
        record = recorded(name, content, image, found)
        doubts = tuple(_OPTION.sub(r"[photographs] \1", doubt) for doubt in record.not_sure)
        return record.model_copy(update={"not_sure": doubts, "corrected": line is not None})


@cache
def _code() -> str:
    """Return a hash of the tracing code."""
    folder = importlib.resources.files("bayesdeg.photographs")
    modules = sorted(
        (one for one in folder.iterdir() if one.name.endswith(".py")), key=lambda one: one.name
    )
    return hash_of(b"".join(one.read_bytes() for one in modules))


def _outside(kept: Path, study: Path) -> Path | None:
    """Return a folder unless it is inside the study, where nothing is written."""
    return None if kept.resolve().is_relative_to(study.resolve()) else kept


def _raise(faults: Iterator[Fault] | list[Fault]) -> None:
    if found := tuple(faults):
        raise StudyError(found)


def _wrong_study(study: Study) -> Iterator[Fault]:
    for name, file in (("actuator", "actuator.csv"), (_MARKERS, "markers.csv")):
        if study.table(name) is not None:
            remedy = "keep either the photographs or the readings from them"
            yield Fault(FILE, f"is given together with {file}", remedy)
    if not study.settings.photographs.has_scale:
        problem = "states no scale of the photographs"
        remedy = "give grid, ruler, length or scale in mm"
        yield Fault(SETTINGS_FILE, problem, remedy, None, "photographs")
    if not study.settings.is_default_mould:
        problem = "is available only for the default actuator, not for points on a different one"
        yield Fault(FILE, problem, "give bend angles of the end faces in actuator.csv")


def _set_by_hand(study: Study) -> tuple[_ByHand, dict[str, str]]:
    """Return hints and given lines, and the hashes of their files."""
    options = study.settings.photographs
    hints, hash_of_hints = _lines_in(study, "hint", options.hint)
    lines, hash_of_lines = _lines_in(study, "line", options.line)
    return _ByHand(hints, lines), hash_of_hints | hash_of_lines


def _lines_in(study: Study, key: str, name: str | None) -> tuple[dict[str, Floats], dict[str, str]]:
    if name is None:
        return {}, {}
    place = (f"photographs.{key}", name)
    if problem := wrong_place(study.folder, study.folder, name):
        remedy = "put the file into the study"
        raise StudyError([Fault(SETTINGS_FILE, problem, remedy, None, *place)])
    try:
        content = read_bytes(study.folder / name, most_mb=STUDY_MB)
        return parse_lines(name, content), {name: hash_of(content)}
    except OSError as fault:
        problem = f"cannot be read ({reason(fault)})"
        remedy = "name a file of the study with x_px and y_px, or ROIs of ImageJ"
        raise StudyError([Fault(SETTINGS_FILE, problem, remedy, None, *place)]) from fault
    except BayesdegError as fault:
        problem, _, remedy = str(fault).removeprefix(f"{name}: ").partition("; ")
        raise StudyError([Fault(name, problem, remedy)]) from fault
