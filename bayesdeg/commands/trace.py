"""``bayesdeg trace``: from photographs to points on the bottom line, in mm."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bayesdeg.console import errors
from bayesdeg.errors import BayesdegError
from bayesdeg.files import read_bytes, reason, spreadsheet_safe, write_bytes, written
from bayesdeg.photographs.overlay import overlay
from bayesdeg.photographs.picture import Colours, read_picture
from bayesdeg.photographs.trace import PictureScale, Side, Trace, trace
from bayesdeg.quantities import LARGEST_SEED

Floats = NDArray[np.float64]

PHOTO_MB = 100.0
"""A JPEG file of 12 megapixels has 3 … 10 MB, a TIFF file 36 MB."""
ABOUT = ("specimen_id", "pressure_kPa", "degradation_pct")
_SIZE = re.compile(r"\s*([0-9.eE+-]+)\s*(mm)?\s*")


Photos = Annotated[list[Path], typer.Argument(help="Photographs.", metavar="PHOTO…")]
Out = Annotated[Path, typer.Option(help="Where markers.csv goes.", metavar="FOLDER")]
Grid = Annotated[str | None, typer.Option(help="Side of a square of a checkerboard.", metavar="MM")]
Ruler = Annotated[str | None, typer.Option(help="From tick to tick of a ruler.", metavar="MM")]
Length = Annotated[
    str | None,
    typer.Option(help="Length of the bottom line; with another scale, a check.", metavar="MM"),
]
PixelSize = Annotated[
    float | None, typer.Option(help="Size of a pixel, seen square on [mm].", metavar="MM/PX")
]
Hint = Annotated[
    Path | None,
    typer.Option(
        help="Points near the line from end to end, a CSV file with x_px and y_px, and a "
        "column file where there are several photographs; an edited points.csv will do.",
        metavar="CSV",
    ),
]
About = Annotated[
    Path | None,
    typer.Option(
        help="photos.csv: file, specimen_id, pressure_kPa, degradation_pct.", metavar="CSV"
    ),
]
Base = Annotated[str | None, typer.Option(help="Where the clamp is: left, right, top, bottom.")]


def trace_photographs(
    photos: Photos,
    out: Out,
    grid: Grid = None,
    ruler: Ruler = None,
    length: Length = None,
    scale: PixelSize = None,
    hint: Hint = None,
    about: About = None,
    base: Base = None,
    seed: Annotated[
        int, typer.Option(min=0, max=LARGEST_SEED, help="Of the draws that errors are taken from.")
    ] = 1,
) -> None:
    """Trace the bottom line of actuators in photographs, and write points with their errors.

    Writes markers.csv, traces.csv (angle and curvature), points.csv (the points in pixels, to be
    corrected) and a picture with the line of every photograph. A checkerboard or ruler must lie in
    the plane of the side that is traced. What cannot be read is said, and left out.
    """
    known = _scale(grid, ruler, length, scale)
    side = _side(base)
    rows, hints = _table(about, ("file",)), _table(hint, ("x_px", "y_px"))
    _refuse_alike(photos)
    _refuse_beside(photos, out)
    known_of = {path.name: _about(about, rows, path.name) for path in photos}
    found: dict[str, Trace] = {}
    problems: list[str] = []
    for path in photos:
        try:
            image = _photograph(path)
            found[path.name] = trace(
                image,
                known,
                rng=np.random.default_rng(seed),
                hint=_hint(hints, path.name),
                base=side,
            )
        except BayesdegError as fault:
            text = str(fault)
            problems.append(text if text.startswith(path.name) else f"{path.name}: {text}")
            continue
        write_bytes(out / f"{path.stem}_traced.png", overlay(image, found[path.name], path.name))
    if found:
        _write(out, found, known_of)
    for name, one in found.items():
        for doubt in one.doubts:
            errors.print(f"{name}: not sure: {doubt}", soft_wrap=True, markup=False)
    errors.print(f"{len(found)} of {len(photos)} photographs traced", soft_wrap=True)
    if problems:
        raise BayesdegError("\n".join(problems))


def _size(text: str | None, option: str) -> float | None:
    if text is None:
        return None
    match = _SIZE.fullmatch(text)
    try:
        value = float(match[1]) if match else -1.0
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1e4:
        raise typer.BadParameter(f"{option} {text!r} is no length in mm; write 50, or '50 mm'")
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
        raise typer.BadParameter(f"--scale {scale:g} is no size of a pixel in mm")
    return known


SIDES: Mapping[str, Side] = {side: side for side in get_args(Side.__value__)}


def _side(base: str | None) -> Side | None:
    if base is not None and base not in SIDES:
        raise typer.BadParameter(f"--base {base!r}: write {', '.join(SIDES)}")
    return None if base is None else SIDES[base]


def _refuse_alike(photos: list[Path]) -> None:
    stems = [path.stem for path in photos]
    for path in photos:
        if stems.count(path.stem) > 1:
            raise BayesdegError(
                f"{path}: another photograph has the same name; rename one, or trace them one by "
                "one into folders of their own"
            )


def _refuse_beside(photos: list[Path], out: Path) -> None:
    for path in photos:
        if path.parent.resolve() == out.resolve():
            raise BayesdegError(
                f"{out}: the photographs are in this folder, and nothing is written beside them; "
                "name another with --out"
            )


def _photograph(path: Path) -> Colours:
    try:
        return read_picture(path.name, read_bytes(path, most_mb=PHOTO_MB))
    except OSError as fault:
        raise BayesdegError(
            f"{path.name}: cannot be read ({reason(fault)}); give the path of a photograph"
        ) from fault


def _table(path: Path | None, needed: tuple[str, ...]) -> pd.DataFrame | None:
    if path is None:
        return None
    try:
        frame = pd.read_csv(path, comment="#", encoding="utf-8-sig")
    except (OSError, ValueError) as fault:
        raise BayesdegError(f"{path}: it is no table that can be read; write a CSV file") from fault
    missing = [name for name in needed if name not in frame]
    if missing:
        raise BayesdegError(f"{path}: column {missing[0]} is missing; add it")
    return frame


def _hint(hints: pd.DataFrame | None, name: str) -> Floats | None:
    if hints is None:
        return None
    mine = hints[hints["file"] == name] if "file" in hints else hints
    if mine.empty:
        return None
    points = mine[["x_px", "y_px"]].apply(pd.to_numeric, errors="coerce").to_numpy(np.float64)
    if len(points) < 2 or not np.all(np.isfinite(points)):
        raise BayesdegError(f"{name}: its hint is not two points or more; give x_px and y_px")
    line: Floats = points
    return line


def _write(out: Path, found: dict[str, Trace], known_of: Mapping[str, dict[str, object]]) -> None:
    """Write the tables of all photographs."""
    markers, traces, pixels = [], [], []
    for name, one in found.items():
        about = known_of[name]
        count = np.arange(1, len(one.points) + 1)
        markers.append(
            pd.DataFrame(
                {
                    **about,
                    "point": count,
                    "x_mm": one.points[:, 0].round(4),
                    "y_mm": one.points[:, 1].round(4),
                    "sd_mm": np.sqrt(np.mean(one.error**2, axis=1)).round(5),
                    "file": name,
                }
            )
        )
        traces.append(
            {
                "file": name,
                **about,
                "bend_angle_deg": round(one.angle, 4),
                "bend_angle_error_deg": round(one.angle_error, 4),
                "curvature_per_m": round(one.curvature, 5),
                "curvature_error_per_m": round(one.curvature_error, 5),
                "length_mm": round(one.length, 4),
                "scale_from": one.plane.source,
                "not_sure": "; ".join(one.doubts),
            }
        )
        place = {"x_px": one.pixels[:, 0].round(2), "y_px": one.pixels[:, 1].round(2)}
        pixels.append(pd.DataFrame({"file": name, "point": count, **place}))
    for name, table in (
        ("markers.csv", pd.concat(markers)),
        ("traces.csv", pd.DataFrame(traces)),
        ("points.csv", pd.concat(pixels)),
    ):
        with written(out / name) as part:
            table.map(spreadsheet_safe).to_csv(part, index=False, encoding="utf-8")


def _about(path: Path | None, rows: pd.DataFrame | None, name: str) -> dict[str, object]:
    """Return what is known of a photograph; by default its name is the specimen's."""
    known: dict[str, object] = {"specimen_id": Path(name).stem, "pressure_kPa": None}
    if rows is None:
        return known
    mine = rows[rows["file"] == name]
    if len(mine) != 1:
        raise BayesdegError(
            f"{path}: {len(mine)} rows are of {name!r}; give one row for each photograph"
        )
    return known | {key: mine.iloc[0][key] for key in ABOUT if key in rows}
