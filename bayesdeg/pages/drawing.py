"""Common parts of all figures: panels, colours that follow the page, and inline SVG."""

import base64
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import RcKeyType
from PIL import Image

from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.summaries import BASE, FINAL
from bayesdeg.pages.surface import Surface
from bayesdeg.pages.tables import TABLES, Tables
from bayesdeg.pages.wording import filled, level_words, model_words
from bayesdeg.quantities import axis_label

VIRTUAL = "virtual experiment"

# Placeholder colours for style variables of the page, so that figures follow light and dark mode.
INK, MUTED, PAPER = "#010203", "#010204", "#010205"
BASE_COLOUR, FINAL_COLOUR = "#010206", "#010207"
#: Colours of the two models, by their names in the tables.
COLOURS = {BASE: BASE_COLOUR, FINAL: FINAL_COLOUR}
_LEVEL_COLOURS = tuple(f"#0102{10 + index:02d}" for index in range(8))
_VARIABLES = {
    INK: "currentColor",
    MUTED: "var(--muted)",
    PAPER: "var(--paper)",
    BASE_COLOUR: "var(--base)",
    FINAL_COLOUR: "var(--final)",
    **{colour: f"var(--level-{index})" for index, colour in enumerate(_LEVEL_COLOURS)},
}

STYLE: dict[RcKeyType, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": MUTED,
    "grid.alpha": 0.22,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "text.color": INK,
    "figure.facecolor": "none",
    "figure.edgecolor": "none",
    "figure.labelsize": 8.0,
    "savefig.facecolor": "none",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.5,
    "svg.fonttype": "none",
    "path.simplify": True,
}

#: Decorator of every function that draws.
styled = rc_context(STYLE)

type Sharing = Literal["all", "row", "none"]

FULL_WIDTH = 7.6
HALF_WIDTH = 3.8
ONE_ROW = 4  # legend entries that fit side by side


@dataclass(frozen=True)
class Drawing:
    """A figure as it appears in the page.

    Parameters
    ----------
    name : str
        Unique within the page.
    svg : str
        One ``<svg>`` element that refers only to itself and the page's style.
    caption : str
        What is drawn.
    half : bool
        Whether two of its kind fit side by side.
    files : tuple of str
        The tables of the run folder that are drawn.
    section, title : str
        Section of the page, and the heading above the figure.
    """

    name: str
    svg: str
    caption: str
    half: bool = False
    files: tuple[str, ...] = ()
    section: str = ""
    title: str = ""


@dataclass(frozen=True)
class Shown:
    """The data that figures are drawn from.

    Parameters
    ----------
    verdict, run, tables : VerdictRecord, RunRecord, Tables
        What the run found.
    deformed : Surface, optional
        Of the solved actuators.
    posterior : callable, optional
        Returns the draws of a posterior of the run folder by its name; None if there are none.
    pictures : mapping of str to bytes
        Crops of photographs by their names in the run folder.
    """

    verdict: VerdictRecord
    run: RunRecord
    tables: Tables
    deformed: Surface | None = None
    posterior: Callable[[str], xr.Dataset | None] = lambda _name: None
    pictures: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Sketch:
    """A figure before it is converted for the page, and the facts for its caption.

    A figure not drawn by matplotlib is an ``<svg>`` element.
    """

    figure: Figure | str
    facts: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class PageFigure:
    """A figure that a report may have. A file of `bayesdeg.pages.figures` lists its own.

    Parameters
    ----------
    name : str
        Unique within the page.
    section : str
        Section of the page; a figure that the template does not place goes to its end.
    draw : callable
        Draws it; None where the run has no data for it.
    caption : str
        What is drawn: a template of the sketch's facts and of ``degrades``, whether anything of
        the study does. Those who cannot see the figure are told the same.
    tables : tuple of str
        Names of the tables that are drawn.
    half : bool
        Whether two of its kind fit side by side.
    title : str
        Heading above it, if the template does not place it.
    """

    name: str
    section: str
    draw: Callable[[Shown], Sketch | None]
    caption: str
    tables: tuple[str, ...] = ()
    half: bool = False
    title: str = ""

    def drawing(self, shown: Shown) -> Drawing | None:
        """Return the figure as it appears in the page; None if the run has no data for it."""
        sketch = self.draw(shown)
        if sketch is None:
            return None
        caption = filled(self.caption, degrades=shown.run.degrades, **sketch.facts)
        virtual = shown.run.virtual
        svg = inline_svg(sketch.figure, self.name, description=caption, virtual=virtual)
        there = (name for name in self.tables if shown.tables[name] is not None)
        files = tuple(TABLES[name].file for name in there)
        return Drawing(self.name, svg, caption, self.half, files, self.section, self.title)


def of_table(
    name: str, draw: Callable[[Shown, pd.DataFrame], Sketch | None]
) -> Callable[[Shown], Sketch | None]:
    """Return a function for `PageFigure.draw` that draws a table, and nothing without it."""

    def drawn(shown: Shown) -> Sketch | None:
        table = shown.tables[name]
        return None if table is None else draw(shown, table)

    return drawn


def rate_title(rate: float, *, degrades: bool) -> str:
    """Return the title of a panel of one degradation rate; empty if nothing degrades."""
    return f"{level_words(rate)} degradation" if degrades else ""


def label_rates(figure: Figure, every_axes: Sequence[Axes], *, degrades: bool) -> None:
    """Label horizontal axes of degradation rates; without degradation there is one position."""
    if degrades:
        figure.supxlabel(axis_label("degradation_pct"))
        return
    for axes in every_axes:
        axes.set_xticks([])


def level_colour(index: int, levels: int) -> str:
    """Return the colour of a degradation rate, brighter for higher rates.

    The page's style defines them: viridis, truncated where its contrast with the page is below 3:1.
    """
    last = len(_LEVEL_COLOURS) - 1
    return _LEVEL_COLOURS[round(index * last / max(levels - 1, 1))]


@styled
def panels(
    number: int, *, columns: int = 3, share_y: Sharing = "all", height: float = 2.05
) -> tuple[Figure, list[Axes]]:
    """Lay out small multiples that share their horizontal axis.

    Parameters
    ----------
    number : int
        Number of panels.
    columns : int
        Largest number in a row.
    share_y : {"all", "row", "none"}
        Which of them share the vertical axis too.
    height : float
        Of one row [in].

    Returns
    -------
    Figure, list of Axes
        The axes row by row; unused places are empty.
    """
    columns = min(columns, number)
    rows = -(-number // columns)
    figure = Figure(figsize=(FULL_WIDTH, height * rows + 0.45), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=share_y)
    flat = [axes for row in grid for axes in row]
    for place, axes in enumerate(flat):
        if place >= number:
            axes.set_axis_off()
        elif place + columns >= number:
            axes.tick_params(labelbottom=True)
    return figure, flat[:number]


@styled
def single(*, width: float = HALF_WIDTH, height: float = 2.7) -> tuple[Figure, Axes]:
    """Lay out one panel [in]."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


@styled
def side_by_side(*, height: float) -> tuple[Figure, Axes, Axes]:
    """Lay out two independent panels in one row of this height [in]."""
    figure = Figure(figsize=(FULL_WIDTH, height), layout="constrained")
    left, right = figure.subplots(1, 2)
    return figure, left, right


def legend_above(figure: Figure, entries: dict[str, Line2D]) -> None:
    """Put one legend over all panels."""
    if entries:
        figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside upper left",
            ncols=len(entries) if len(entries) <= ONE_ROW else -(-len(entries) // 2),
            handlelength=1.6,
            columnspacing=1.4,
        )


def key(colour: str, *, marker: str = "", line: bool = True, dashed: bool = False) -> Line2D:
    """Return an entry of a legend."""
    style: Literal["--", "-", ""] = "--" if dashed else "-" if line else ""
    return Line2D([], [], color=colour, marker=marker, linestyle=style, markersize=4)


def hollow_key(colour: str) -> Line2D:
    """Return an entry of a legend for open circles."""
    entry = key(colour, marker="o", line=False)
    entry.set(markerfacecolor=PAPER)
    return entry


def points_key() -> Line2D:
    """Return an entry of a legend for `points`."""
    entry = hollow_key(INK)
    entry.set(markeredgewidth=0.8)
    return entry


def area_key(colour: str = MUTED, *, width: float = 6, alpha: float = 0.3) -> Line2D:
    """Return an entry of a legend for a filled area."""
    entry = key(colour)
    entry.set(linewidth=width, alpha=alpha)
    return entry


def model_keys(table: pd.DataFrame, *, marker: str = "", dashed: bool = False) -> dict[str, Line2D]:
    """Return entries of a legend for the base and the final model, as far as a table has them."""
    return {
        model_words(model): key(colour, marker=marker, dashed=dashed)
        for model, colour in COLOURS.items()
        if (table["model"] == model).any()
    }


def band(axes: Axes, x: object, lower: object, upper: object, colour: str, alpha: float) -> None:
    """Fill the space between two curves."""
    axes.fill_between(
        np.asarray(x, float),
        np.asarray(lower, float),
        np.asarray(upper, float),
        color=colour,
        alpha=alpha,
        linewidth=0,
    )


def quantile_bands(
    axes: Axes,
    along: str,
    curve: pd.DataFrame,
    colour: str,
    alphas: tuple[float, float] = (0.18, 0.28),
) -> None:
    """Draw a median with its 90 % and 50 % bands of these alphas against the column ``along``."""
    x = curve[along]
    band(axes, x, curve["q05"], curve["q95"], colour, alphas[0])
    band(axes, x, curve["q25"], curve["q75"], colour, alphas[1])
    axes.plot(x, curve["q50"], color=colour)


def intervals(axes: Axes, at: float, row: pd.Series, colour: str) -> None:
    """Draw a median as a point with its 50 % (thick) and 90 % intervals, in place of a band.

    Parameters
    ----------
    axes : Axes
        To draw on.
    at : float
        Place on the horizontal axis.
    row : Series
        With ``q05``, ``q25``, ``q50``, ``q75`` and ``q95``; without those in between there is
        the 90 % interval alone.
    colour : str
        Of point and intervals.
    """
    axes.vlines(at, row["q05"], row["q95"], color=colour, linewidth=1.2)
    if "q25" in row:
        axes.vlines(at, row["q25"], row["q75"], color=colour, linewidth=3.6)
    axes.plot([at], [row["q50"]], "o", color=colour, markersize=5.5, markeredgecolor=PAPER)


def points(axes: Axes, x: object, y: object, label: str = "") -> None:
    """Draw measured values as open circles."""
    axes.plot(
        np.asarray(x, float),
        np.asarray(y, float),
        marker="o",
        linestyle="",
        markersize=3.4,
        color=INK,
        markerfacecolor=PAPER,
        markeredgewidth=0.8,
        label=label,
    )


def stamp_virtual(figure: Figure) -> None:
    """Write across a figure that its data come from a virtual experiment."""
    width = figure.get_size_inches()[0]
    figure.text(
        0.5,
        0.5,
        VIRTUAL,
        fontsize=6.2 * width if width < 5 else 5.4 * width,
        rotation=18,
        ha="center",
        va="center",
        color=INK,
        alpha=0.13,
        fontweight="bold",
        zorder=10,
    )


def inline_svg(figure: Figure | str, name: str, *, description: str, virtual: bool) -> str:
    """Turn a figure into an SVG element that can stand inside a page.

    Parameters
    ----------
    figure : Figure or str
        The figure; an ``<svg>`` element is kept except for its label.
    name : str
        Unique within the page; every id of the element begins with it.
    description : str
        Text for readers who cannot see the figure.
    virtual : bool
        Whether the words "virtual experiment" are written across it.

    Returns
    -------
    str
        Text stays text; colours follow the page.
    """
    if virtual:
        description = f"{VIRTUAL}: {description}"
    quoted = description.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    label = f'<svg role="img" aria-label="{quoted}"'
    if isinstance(figure, str):
        labelled = figure.replace("<svg", label, 1)
        return labelled.removesuffix("</svg>") + (_STAMP if virtual else "") + "</svg>"
    if virtual:
        stamp_virtual(figure)
    buffer = io.StringIO()
    with rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    svg = buffer.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(xlink:href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r"'DejaVu Sans'[^;\"]*", "var(--sans)", svg)
    for colour, variable in _VARIABLES.items():
        svg = svg.replace(colour, variable)
    svg = compact(svg)
    return re.sub(
        r'<svg (.*?)width="[^"]*" (.*?)height="[^"]*"',
        label.replace("\\", r"\\") + r" \1\2",
        svg,
        count=1,
        flags=re.DOTALL,
    ).strip()


_STAMP = (
    '<text x="50%" y="50%" text-anchor="middle" opacity="0.3" font-size="44" font-weight="bold" '
    f'style="transform-box:fill-box;transform-origin:center;transform:rotate(-18deg)">{VIRTUAL}'
    "</text>"
)

#: Decimals of a position [px], and colours of a picture, that the eye can tell apart.
_DIGITS, _COLOURS = 2, 128


def compact(svg: str) -> str:
    """Return the same drawing at about half the size, without invisible detail.

    Positions are rounded to hundredths of a pixel, a style shared by all marks of a group moves to
    the group, unused ids are removed, and pictures keep 128 colours.

    Examples
    --------
    >>> mark = '<use xlink:href="#m" x="1.23456" y="2.0" style="fill: red"/>'
    >>> print(compact(f'<g id="unused">{mark}{mark}</g>'))
    <g style="fill: red"><use xlink:href="#m" x="1.23" y="2.0"/><use xlink:href="#m" x="1.23" y="2.0"/></g>
    """  # noqa: E501
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]+)"', lambda m: m.group() if m.group(1) in used else "", svg)
    svg = re.sub(r' (?:d|x|y|transform)="[^"]*"', _rounded, svg)
    svg = re.sub(r"\n\s*", "\n", svg)
    svg = re.sub(r"<g([^>]*)>((?:\s*<use [^>]*/>)+\s*)</g>", _styled_once, svg)
    return re.sub(r"(data:image/png;base64,)([A-Za-z0-9+/=\s]+)", _fewer_colours, svg)


def _rounded(attribute: re.Match[str]) -> str:
    def number(found: re.Match[str]) -> str:
        text = f"{float(found.group()):.{_DIGITS}f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text

    in_a_line = re.sub(r"\s+", " ", attribute.group()).replace(' "', '"')
    return " " + re.sub(r"-?\d+\.\d{3,}", number, in_a_line.strip())


def _styled_once(group: re.Match[str]) -> str:
    attributes, marks = group.groups()
    styles = set(re.findall(r' style="[^"]*"', marks))
    if len(styles) != 1 or " style=" in attributes:
        return group.group()
    style = styles.pop()
    return f"<g{attributes}{style}>{marks.replace(style, '')}</g>"


def _fewer_colours(picture: re.Match[str]) -> str:
    start, content = picture.groups()
    drawn, kept = Image.open(io.BytesIO(base64.b64decode(content))), io.BytesIO()
    # the only way that keeps what is transparent
    drawn.quantize(_COLOURS, method=Image.Quantize.FASTOCTREE).save(kept, "PNG", optimize=True)
    return start + base64.b64encode(kept.getvalue()).decode()
