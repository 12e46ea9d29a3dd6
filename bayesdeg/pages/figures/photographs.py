"""Photographs of actuators with the traced line and the lines that are predicted."""

import base64
import io
from collections.abc import Iterator, Mapping
from html import escape

import numpy as np
import pandas as pd
from PIL import Image

from bayesdeg.pages.drawing import PageFigure, Shown, Sketch, of_table
from bayesdeg.pages.summaries import BASE, FINAL
from bayesdeg.pages.wording import level_words, number

MEASURED = "measured"
#: Of lines on a photograph, whatever the page's colours: a dark core, or the model's colour.
COLOURS = {MEASURED: "#111", BASE: "var(--base)", FINAL: "var(--final)"}
DASHES = {MEASURED: "none", BASE: "7 3", FINAL: "none"}
LABELS = {MEASURED: "traced", BASE: "base model", FINAL: "final model"}
#: Width of the figure, room between panels, over them for their titles, and for the legend [px].
WIDTH, ROOM, TITLE, LEGEND = 800.0, 14.0, 18.0, 24.0
COLUMNS = 3
MOST_NAMES = 8  # of refused photographs that a caption lists


def photographs_svg(rows: pd.DataFrame, pictures: Mapping[str, bytes], *, degrades: bool) -> str:
    """Draw lines over photographs, which become part of the drawing.

    Parameters
    ----------
    rows : pandas.DataFrame
        Table ``photo_lines``.
    pictures : mapping of str to bytes
        JPEG files by their names in the table.
    degrades : bool
        Whether anything of the study does.

    Returns
    -------
    str
        An ``<svg>`` element that refers to nothing outside itself but the page's style.
    """
    parts, at = [], 0.0
    for line in LABELS:
        if (rows["line"] == line).any():
            parts.append(_polyline(f"{at:.0f},9 {at + 26:.0f},9", line))
            parts.append(f'<text x="{at + 32:.0f}" y="13">{LABELS[line]}</text>')
            at += 130.0
    names = list(dict.fromkeys(rows["picture"]))
    columns = min(COLUMNS, len(names))
    wide = (WIDTH - ROOM * (columns - 1)) / columns
    top, bottom = LEGEND, LEGEND
    for i, name in enumerate(names):
        if i % columns == 0:
            top = bottom
        with Image.open(io.BytesIO(pictures[name])) as image:
            size = image.size
        own = rows[rows["picture"] == name]
        high = wide * size[1] / size[0]
        left = (i % columns) * (wide + ROOM)
        parts += _panel(own, pictures[name], (left, top, wide, high), size, degrades=degrades)
        bottom = max(bottom, top + TITLE + high + ROOM)
    box = f'viewBox="0 0 {WIDTH:.0f} {bottom:.0f}"'
    style = 'style="font-family:var(--sans);font-size:12px" fill="currentColor"'
    return f'<svg {box} {style} xmlns="http://www.w3.org/2000/svg">{"".join(parts)}</svg>'


def _polyline(points: str, line: str) -> str:
    """Return a line with a light rim, which is seen on any photograph."""
    style = f'stroke-dasharray="{DASHES[line]}" vector-effect="non-scaling-stroke"'
    rim = f'<polyline points="{points}" fill="none" stroke="#fff" stroke-opacity="0.75" '
    core = f'<polyline points="{points}" fill="none" stroke="{COLOURS[line]}" '
    return f'{rim}stroke-width="4"/>{core}stroke-width="2" {style}/>'


def _panel(
    rows: pd.DataFrame,
    content: bytes,
    box: tuple[float, float, float, float],
    size: tuple[int, int],
    *,
    degrades: bool,
) -> Iterator[str]:
    left, top, wide, high = box
    title = escape(_title(rows.iloc[0], degrades=degrades))
    yield f'<text x="{left:.1f}" y="{top + 12:.1f}" font-weight="bold">{title}</text>'
    place = f'x="{left:.1f}" y="{top + TITLE:.1f}" width="{wide:.1f}" height="{high:.1f}"'
    yield f'<svg {place} viewBox="0 0 {size[0]} {size[1]}">'
    yield f'<image width="{size[0]}" height="{size[1]}" '
    yield f'href="data:image/jpeg;base64,{base64.b64encode(content).decode()}"/>'
    for line, own in rows.groupby("line", sort=False):
        if line in COLOURS:
            xy = own[["x_px", "y_px"]].to_numpy(np.float64)
            yield _polyline(" ".join(f"{x:.1f},{y:.1f}" for x, y in xy), str(line))
    yield "</svg>"


def _title(row: pd.Series, *, degrades: bool) -> str:
    rate = f", {level_words(row['degradation_pct'])}" if degrades else ""
    return f"{row['specimen_id']}, {row['pressure_kPa']:.4g} kPa{rate}"


def _photographs(shown: Shown, lines: pd.DataFrame) -> Sketch | None:
    traces = shown.tables["traces"]
    rows = lines[lines["picture"].isin(list(shown.pictures))]
    if rows.empty:
        return None
    degrades = shown.run.degrades
    panels = []
    for _, own in rows.groupby("picture", sort=False):
        each = own.drop_duplicates("line").set_index("line")["curvature_per_m"]
        there = [line for line in LABELS if line in each]
        curvatures = [f"{LABELS[line]} {number(float(each[line]))}" for line in there]
        panels.append(f"{_title(own.iloc[0], degrades=degrades)}: {', '.join(curvatures)} 1/m")
    refused = [] if traces is None else traces.loc[traces["refused"].notna(), "file"].tolist()
    facts = {
        "panels": panels,
        "both": FINAL in set(rows["line"]),
        "refused": len(refused),
        "names": refused[:MOST_NAMES],
        "more": max(0, len(refused) - MOST_NAMES),
        "count": 0 if traces is None else len(traces),
    }
    return Sketch(photographs_svg(rows, shown.pictures, degrades=degrades), facts)


FIGURES = (
    PageFigure(
        "photographs",
        "curvature",
        of_table("photo_lines", _photographs),
        "Photographs of actuators with the traced and the predicted lines"
        "{{ ' before and after the cause' if both }}. A predicted line starts and is as long "
        "as the traced one, bends by the predicted curvature of that "
        "reading, and has the shape of the finite element model between its ends. Curvatures: "
        "{{ panels | join('; ') }}."
        "{% if refused %} Of {{ count }} photographs {{ refused }} {{ 'was' if refused == 1 else "
        "'were' }} refused and left out: {{ names | join(', ') }}{{ ' and ' ~ more ~ ' more' if "
        "more }}; the reasons are in traces.csv.{% endif %}",
        ("photo_lines", "traces"),
        title="On the photographs",
    ),
)
