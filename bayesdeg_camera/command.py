"""The work of ``bayesdeg trace``: from photographs to points on the bottom line, in mm."""

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import typer

from bayesdeg.console import errors, output
from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.errors import BayesdegError
from bayesdeg.files import STUDY_MB, read_bytes, reason
from bayesdeg.quantities import SIDES, Side
from bayesdeg_camera.folder import refuse_lost_corrections, way_to, write_overlay, write_traces
from bayesdeg_camera.page import serve
from bayesdeg_camera.tracing.lines import line_of, parse_lines
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.record import recorded
from bayesdeg_camera.tracing.trace import PHOTO_MB, PictureScale, trace

_SIZE = re.compile(r"\s*([0-9.eE+-]+)\s*(mm)?\s*")
_SIDES: Mapping[str, Side] = {side: side for side in SIDES}


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
        if photos or out is not None:
            raise typer.BadParameter("--page shows earlier traces; give it without photographs")
        serve(page, port)
        return
    if not photos or out is None:
        raise typer.BadParameter("give photographs and --out FOLDER, or --page FOLDER")
    hints, lines = (
        {} if path is None else parse_lines(str(path), _content(path)) for path in (hint, line)
    )
    sizes = (_size(grid, "--grid"), _size(ruler, "--ruler"), _size(length, "--length"))
    known = PictureScale(*sizes, scale)
    if known == PictureScale():
        raise typer.BadParameter("no scale is given; give --grid, --ruler, --length or --scale")
    if scale is not None and not 0.0 < scale < 100.0:
        raise typer.BadParameter(
            f"--scale {scale:g} is not a pixel size in mm; give a number above 0"
        )
    side = _SIDES.get(base or "")
    if base is not None and side is None:
        raise typer.BadParameter(f"--base {base!r}: write {', '.join(SIDES)}")
    rows = None if about is None else _table(about)
    _refuse_names(photos, out)
    refuse_lost_corrections(out)
    facts = {path: _facts(about, rows, path.name) for path in photos}
    records = []
    for path, fact in facts.items():
        name, rng = path.name, np.random.default_rng(seed)
        near, by_hand = line_of(hints, name), line_of(lines, name)
        try:
            content = _content(path, most_mb=PHOTO_MB)
            image = read_picture(name, content)
            found = trace(image, known, rng=rng, hint=near, line=by_hand, base=side)
        except BayesdegError as fault:
            why = str(fault).removeprefix(f"{name}: ")
            records.append(TracedPhotograph(file=name, refused=why, **fact))
            continue
        fact |= {"place": way_to(out, path), "corrected": by_hand is not None}
        record = recorded(name, content, image, found).model_copy(update=fact)
        write_overlay(out, record, image, found.plane.target)
        records.append(record)
    write_traces(out, records)
    for record in records:
        for doubt in record.not_sure:
            errors.print(f"{record.file}: not sure: {doubt}", soft_wrap=True, markup=False)
    wrong = [f"{record.file}: {record.refused}" for record in records if record.refused]
    if len(wrong) < len(records):
        count = f"{len(records) - len(wrong)} of {len(records)} photographs traced"
        output().print(count, soft_wrap=True)
    if wrong:
        raise BayesdegError("\n".join(wrong))


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


def _refuse_names(photos: list[Path], out: Path) -> None:
    """Refuse photographs of one name, and the folder of a photograph for the results."""
    stems = [path.stem for path in photos]
    for path in photos:
        if stems.count(path.stem) > 1:
            raise BayesdegError(
                f"{path}: another photograph has the same name; rename one, or trace them into "
                "separate folders"
            )
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


def _table(path: Path) -> pd.DataFrame:
    try:
        frame = pd.read_csv(io.BytesIO(_content(path)), comment="#", encoding="utf-8-sig")
    except ValueError as fault:
        raise BayesdegError(f"{path}: not a readable table; write a CSV file") from fault
    if "file" not in frame:
        raise BayesdegError(f"{path}: the column file is missing; add it")
    return frame


def _facts(path: Path | None, rows: pd.DataFrame | None, name: str) -> dict[str, Any]:
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
