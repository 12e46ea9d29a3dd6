"""Tracing the photographs of a study into lines of points.

A file that cannot be read as a picture is a fault of the study. A photograph without a detectable
line is left out and reported. Traces are cached by a hash of the photograph, the options and the
tracing code, in the working directory and never in the study.
"""

import importlib.resources
import json
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
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
from bayesdeg.progress import Progress
from bayesdeg_camera.places import contradictions, named_files, raise_faults, wrong_place
from bayesdeg_camera.tracing.lines import line_of, parse_lines
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.record import hash_of, marker_rows, recorded
from bayesdeg_camera.tracing.trace import LENGTH_AGREES, PHOTO_MB, PictureScale, trace

Floats = NDArray[np.float64]

CACHE = Path(".cache/traces")
FEWEST_LENGTHS = 4  # lengths needed for a median
SEED = 1  # seed of the error estimates, as in the command
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
        Cache of traces; not used if it is inside the study.

    Raises
    ------
    StudyError
        If a photograph is missing, is outside the study or no picture, or none can be traced.
    """
    table, options = study.table("photos"), study.settings.photographs
    assert table is not None
    faults = contradictions(study, FILE, "photographs")
    if not options.has_scale:
        problem = "states no scale of the photographs"
        remedy = "give grid, ruler, length or scale in mm"
        faults.append(Fault(SETTINGS_FILE, problem, remedy, None, "photographs"))
    raise_faults(faults)
    names = map(str, table["file"])
    places, faults = named_files(study.folder, FILE, FOLDER, names, "photographs")
    raise_faults(faults)
    hints, hashes = _lines_in(study, "hint", options.hint)
    lines, hashes_of_lines = _lines_in(study, "line", options.line)
    inside = kept.resolve().is_relative_to(study.folder.resolve())
    tracing = _Tracing(options, hints, lines, None if inside else kept)
    progress.stage("tracing photographs", len(places))
    found: list[TracedPhotograph] = []
    for name, path in places.items():
        try:
            found.append(tracing.of(name, path))
        except StudyError as fault:
            faults += fault.faults
        progress.advance(note=name)
    raise_faults(faults)
    rows = [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]
    columns = {"specimen_id": "specimen_id", "pressure": "pressure_kPa"}
    columns["degradation"] = "degradation_pct"
    found = [
        one.model_copy(update={name: row[column] for name, column in columns.items()})
        for one, row in zip(found, rows, strict=True)
    ]
    found = _of_one_length(found, study.geometry.length)
    read = [marker_rows(one, row) for one, row in zip(found, rows, strict=True) if not one.refused]
    if not read:
        why = f"{found[0].file}: {found[0].refused}"
        problem = f"has {len(found)} photographs, but no line could be traced in any"
        raise StudyError([Fault(FILE, problem, f"the first: {why}")])
    pixels = dict.fromkeys(("x_px", "y_px", "scale_mm_per_px"), np.nan)
    markers = pd.concat(read, ignore_index=True).assign(**pixels)
    hashes |= hashes_of_lines | {f"{FOLDER}/{one.file}": one.sha256 for one in found}
    traced = replace(
        study,
        others={**study.others, "markers": markers},
        recorded={**study.recorded, "markers": study.recorded.get("photos", frozenset())},
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
        other = ""
        if one.refused:
            pass
        elif not SHORTEST <= one.length_mm / moulded <= LONGEST:
            other = f"but the actuator is moulded with {moulded:.3g} mm"
        elif usual is not None and abs(one.length_mm / usual - 1.0) > LENGTH_AGREES:
            other = f"the median of all {usual:.3g} mm"
        remedy = "mark the line with [photographs] hint, and check the scale"
        why = f"its line measures {one.length_mm:.3g} mm, {other}; {remedy}"
        kept.append(one.model_copy(update={"refused": why}) if other else one)
    return kept


@dataclass(frozen=True)
class _Tracing:
    """Traces photographs of one study, or finds earlier traces.

    ``hints`` are lines near the edge by photograph, ``lines`` those given instead of tracing.
    """

    options: PhotographOptions
    hints: Mapping[str, Floats]
    lines: Mapping[str, Floats]
    kept: Path | None

    @cached_property
    def code(self) -> str:
        """A hash of the tracing code."""
        folder = importlib.resources.files("bayesdeg_camera.tracing")
        modules = sorted(
            (one for one in folder.iterdir() if one.name.endswith(".py")), key=lambda one: one.name
        )
        return hash_of(b"".join(one.read_bytes() for one in modules))

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
        if self.kept is None:
            return self._traced(name, content)
        own = {"hint": line_of(self.hints, name), "line": line_of(self.lines, name)}
        points = {key: None if line is None else line.tolist() for key, line in own.items()}
        asked = [self.code, cv2.__version__, asdict(self.options) | points]
        key = hash_of(content + json.dumps(asked, sort_keys=True).encode())
        with suppress(OSError, ValueError):  # a damaged trace is made again
            known = read_bytes(self.kept / f"{key}.json", most_mb=RUN_MB)
            return TracedPhotograph.read(parse_json(known)).model_copy(update={"file": name})
        found = self._traced(name, content)
        with suppress(ResumableError):  # without write access nothing is kept
            write_text(self.kept / f"{key}.json", found.text())
        return found

    def _traced(self, name: str, content: bytes) -> TracedPhotograph:
        try:
            image = read_picture(name, content)
        except BayesdegError as fault:
            raise StudyError([_fault_in(name, fault, f"{FOLDER}/{name}")]) from fault
        options, line = self.options, line_of(self.lines, name)
        scale = PictureScale(options.grid, options.ruler, options.length, options.scale)
        try:
            found = trace(
                image,
                scale,
                rng=np.random.default_rng(SEED),
                hint=line_of(self.hints, name),
                line=line,
                base=options.base,
            )
        except BayesdegError as fault:
            why = _OPTION.sub(r"[photographs] \1", str(fault))
            return TracedPhotograph(file=name, sha256=hash_of(content), refused=why)
        record = recorded(name, content, image, found)
        doubts = tuple(_OPTION.sub(r"[photographs] \1", doubt) for doubt in record.not_sure)
        return record.model_copy(update={"not_sure": doubts, "corrected": line is not None})


def _fault_in(name: str, error: BayesdegError, file: str) -> Fault:
    """Return the fault that an error about a file states as "name: problem; remedy"."""
    problem, _, remedy = str(error).removeprefix(f"{name}: ").partition("; ")
    return Fault(file, problem, remedy)


def _lines_in(study: Study, key: str, name: str | None) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return the lines of the file that a setting names, and its hash; neither without it."""
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
        raise StudyError([_fault_in(name, fault, name)]) from fault
