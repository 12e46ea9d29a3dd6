"""``bayesdeg trace``: from photographs to points on the bottom line, in mm."""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bayesdeg_camera.folder import (
    refuse_lost_corrections,
    way_to,
    write_overlay,
    write_traces,
)
from bayesdeg_camera.page import serve
from bayesdeg.console import errors, output
from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.errors import BayesdegError
from bayesdeg.files import STUDY_MB, read_bytes, reason
from bayesdeg_camera.tracing.lines import line_of, parse_lines
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.record import recorded
from bayesdeg_camera.tracing.trace import PHOTO_MB, PictureScale, trace
from bayesdeg.quantities import SIDES, Side

Floats = NDArray[np.float64]

_SIZE = re.compile(r"\s*([0-9.eE+-]+)\s*(mm)?\s*")


def trace_photographs(
    photos: list[Path] | None,
    out: Path | None,
    grid: str | None,
    ruler: str | None,
    length: str | None,
    scale: float | None,
    hint: Path | None,
    line: Path | None,
    about: Path | None,
    base: str | None,
    seed: int,
    page: Path | None,
    port: int | None,
) -> None:
    """Do what `interface.trace_photographs` says."""
    if page is not None:
        _refuse_with_page(photos, out)
        serve(page, port)
        return
    if not photos or out is None:
        raise typer.BadParameter("give photographs and --out FOLDER, or --page FOLDER")
    hints = {} if hint is None else parse_lines(str(hint), _content(hint))
    lines = {} if line is None else parse_lines(str(line), _content(line))
    asked = _Asked(_scale(grid, ruler, length, scale), _side(base), hints, lines, seed)
    rows = _table(about)
    _refuse_alike(photos)
    _refuse_beside(photos, out)
    refuse_lost_corrections(out)
    of_each = {path: _about(about, rows, path.name) for path in photos}
    found = [_traced(path, out, asked, known) for path, known in of_each.items()]
    write_traces(out, found)
    _report(found)


@dataclass(frozen=True)
class _Asked:
    """Settings for tracing all photographs."""

    scale: PictureScale
    base: Side | None
    hints: Mapping[str, Floats]
    lines: Mapping[str, Floats]
    seed: int


def _traced(path: Path, out: Path, asked: _Asked, known: dict[str, Any]) -> TracedPhotograph:
    """Trace a photograph and draw its line, or record why it was refused."""
    name, rng = path.name, np.random.default_rng(asked.seed)
    try:
        content = _content(path, most_mb=PHOTO_MB)
        image = read_picture(name, content)
        hint, line = line_of(asked.hints, name), line_of(asked.lines, name)
        found = trace(image, asked.scale, rng=rng, hint=hint, line=line, base=asked.base)
    except BayesdegError as fault:
        return TracedPhotograph(file=name, refused=str(fault).removeprefix(f"{name}: "), **known)
    record = recorded(name, content, image, found)
    about = {**known, "place": way_to(out, path), "corrected": line is not None}
    record = record.model_copy(update=about)
    write_overlay(out, record, image, found.plane.target)
    return record


def _report(found: Sequence[TracedPhotograph]) -> None:
    """Print doubts, and raise if a photograph could not be traced."""
    for one in found:
        for doubt in one.not_sure:
            errors.print(f"{one.file}: not sure: {doubt}", soft_wrap=True, markup=False)
    wrong = [f"{one.file}: {one.refused}" for one in found if one.refused]
    if len(wrong) < len(found):
        count = f"{len(found) - len(wrong)} of {len(found)} photographs traced"
        output().print(count, soft_wrap=True)
    if wrong:
        raise BayesdegError("\n".join(wrong))


def _refuse_with_page(photos: list[Path] | None, out: Path | None) -> None:
    if photos or out is not None:
        raise typer.BadParameter("--page shows earlier traces; give it without photographs")


def _size(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    match = _SIZE.fullmatch(text)
    try:
        value = float(match[1]) if match else -1.0
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1e4:
        raise typer.BadParameter(f"{option} {text!r} is not a length in mm; write 50, or '50 mm'")
    return value


def _scale(
    grid: str | None, ruler: str | None, length: str | None, scale: float | None
) -> PictureScale:
    known = PictureScale(
        _size(grid, "--grid"), _size(ruler, "--ruler"), _size(length, "--length"), scale
    )
    if known == PictureScale():
        raise typer.BadParameter("no scale is given; give --grid, --ruler, --length or --scale")
    if scale is not None and not 0.0 < scale < 100.0:
        raise typer.BadParameter(
            f"--scale {scale:g} is not a pixel size in mm; give a number above 0"
        )
    return known


_SIDES: Mapping[str, Side] = {side: side for side in SIDES}


def _side(base: str | None) -> Side | None:
    if base is not None and base not in _SIDES:
        raise typer.BadParameter(f"--base {base!r}: write {', '.join(SIDES)}")
    return None if base is None else _SIDES[base]


def _refuse_alike(photos: list[Path]) -> None:
    stems = [path.stem for path in photos]
    for path in photos:
        if stems.count(path.stem) > 1:
            raise BayesdegError(
                f"{path}: another photograph has the same name; rename one, or trace them into "
                "separate folders"
            )


def _refuse_beside(photos: list[Path], out: Path) -> None:
    for path in photos:
        if path.parent.resolve() == out.resolve():
            raise BayesdegError(
                f"{out}: this folder holds the photographs, so nothing is written there; "
                "name a different one with --out"
            )


def _content(path: Path, most_mb: float = STUDY_MB) -> bytes:
    try:
        return read_bytes(path, most_mb=most_mb)
    except OSError as fault:
        raise BayesdegError(
            f"{path.name}: cannot be read ({reason(fault)}); give the path of a readable file"
        ) from fault


def _table(path: Path | None) -> pd.DataFrame | None:
    if path is None:
        return None
    try:
        frame = pd.read_csv(io.BytesIO(_content(path)), comment="#", encoding="utf-8-sig")
    except ValueError as fault:
        raise BayesdegError(f"{path}: not a readable table; write a CSV file") from fault
    if "file" not in frame:
        raise BayesdegError(f"{path}: the column file is missing; add it")
    return frame


def _about(path: Path | None, rows: pd.DataFrame | None, name: str) -> dict[str, Any]:
    """Return the facts about a photograph; by default its name is the specimen's."""
    if rows is None:
        return {"specimen_id": Path(name).stem}
    mine = rows[rows["file"] == name]
    if len(mine) != 1:
        raise BayesdegError(f"{path}: {len(mine)} rows for {name!r}; give one row per photograph")
    row = mine.iloc[0]
    known: dict[str, Any] = {"specimen_id": str(row.get("specimen_id", Path(name).stem))}
    for field, column in (("pressure", "pressure_kPa"), ("degradation", "degradation_pct")):
        if column in rows:
            number = pd.to_numeric(row[column], errors="coerce")
            if not np.isfinite(number):
                raise BayesdegError(f"{path}: {column} of {name!r} is not a number; give a number")
            known[field] = float(number)
    return known
