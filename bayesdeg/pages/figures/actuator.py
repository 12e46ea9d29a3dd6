"""Figure of the deformed actuator: section through its symmetry plane, if any, and 3-D view."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bayesdeg.pages.drawing import (
    FULL_WIDTH,
    INK,
    MUTED,
    PageFigure,
    Shown,
    Sketch,
    rate_title,
    styled,
)
from bayesdeg.pages.surface import (
    Quads,
    Shape,
    Surface,
    normals_of,
    quads_of,
    segments_of,
    sharp_edges,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PIECES = 4  # subdivisions of each side of a face, so that it looks curved
DOTS_PER_INCH = 160.0  # resolution of the coloured faces; lines and text are vectors
SHOWN_SHARE = 0.995  # share of the drawn area inside the colour range
COLOURS = colormaps["magma_r"]
EDGE = (0.08, 0.09, 0.11, 1.0)
MARGIN = 1.5  # around the drawn actuators [mm]
BAR = 10.0  # length of the scale bar [mm]

_AZIMUTH, _ELEVATION = np.radians(-62.0), np.radians(24.0)
RIGHT = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
TOWARDS = np.array([*(np.cos(_ELEVATION) * np.array([RIGHT[1], -RIGHT[0]])), np.sin(_ELEVATION)])
UP = np.cross(TOWARDS, RIGHT)
_LIGHT = np.array([-0.35, 0.65, 0.67])  # from the upper left, in the picture's axes
_ACROSS = np.array([1.0, -1.0, 1.0])  # mirror image at the plane of symmetry


@styled
def deformed_figure(surface: Surface, *, degrades: bool = True) -> Figure:
    """Draw solved actuators at true size, coloured by their largest principal stretch.

    Above, the cut through the plane of symmetry, with the chambers, and its outline before
    loading; below, the whole actuator in parallel projection, its second half mirrored. One that
    is meshed as a whole has no cut. All lengths and colours are to one scale.

    Parameters
    ----------
    surface : Surface
        With at least one shape; each has a column.
    degrades : bool
        Whether anything of the study does, so that columns say of which rate they are.

    Returns
    -------
    Figure
        Faces are pixels, all else vectors.
    """
    cuts = []
    if surface.is_half:
        on_cut = surface.faces[surface.on_cut]
        cuts = [quads_of(s.placed, s.stretch, on_cut, pieces=PIECES) for s in surface.shapes]
    wholes = [_whole(surface, shape) for shape in surface.shapes]
    norm = _range([*cuts, *wholes])
    boxes = [_box([cut.corners[..., [0, 2]] for cut in cuts])] if cuts else []
    boxes.append(_box([_projected(w)[..., :2] for w in wholes]))
    figure, rows = _panels(len(surface.shapes), boxes)
    for i, shape in enumerate(surface.shapes):
        rate = rate_title(shape.degradation, degrades=degrades)
        rows[0][i].set_title(", ".join(filter(None, (rate, f"{shape.pressure:g} kPa"))))
        if cuts:
            _draw_cut(rows[0][i], surface, shape, cuts[i], norm)
        _draw_whole(rows[-1][i], surface, shape, wholes[i], norm)
    (left, low), height = boxes[-1][0], np.ptp(boxes[-1][:, 1])
    x, y = left + MARGIN, low + 0.06 * height
    last = rows[-1][0]
    last.plot([x, x + BAR], [y, y], color=INK, linewidth=1.6, solid_capstyle="butt")
    last.text(x + BAR / 2, y + 0.02 * height, f"{BAR:g} mm", ha="center", va="bottom", color=INK)
    bar = figure.colorbar(
        ScalarMappable(norm, COLOURS),
        ax=rows[-1],
        location="bottom",
        extend="max",
        aspect=50,
        shrink=0.6,
    )
    bar.set_label("largest principal stretch [–]")
    assert bar.solids is not None  # a bar of lines has none
    bar.solids.set_rasterized(True)
    bar.outline.set_visible(False)
    return figure


def _panels(count: int, boxes: list[Floats]) -> tuple[Figure, list[list[Axes]]]:
    """Lay out rows of panels, in each of which a millimetre is as long; the last has no axes."""
    width = (FULL_WIDTH - 1.0) / max(count, 2)
    ratios = [float(np.ptp(box[:, 1]) / np.ptp(box[:, 0])) for box in boxes]
    height = width * sum(ratios) + 0.85
    figure = Figure(figsize=(FULL_WIDTH, height), dpi=DOTS_PER_INCH, layout="constrained")
    rows = figure.subplots(len(boxes), count, squeeze=False, sharey="row", height_ratios=ratios)
    for row, box in zip(rows, boxes, strict=True):
        for axes in row:
            axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal")
            axes.label_outer()
    for row in rows[:-1]:
        row[0].set_ylabel("z [mm]")
        for axes in row:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("x [mm]")
    for axes in rows[-1]:
        axes.set_axis_off()
    return figure, [list(row) for row in rows]


def _outside(surface: Surface) -> Indices:
    return surface.faces[~surface.on_cut & ~surface.in_cavity]


def _whole(surface: Surface, shape: Shape) -> Quads:
    """Return the outer faces, mirrored for a half."""
    half = quads_of(shape.placed, shape.stretch, _outside(surface), pieces=PIECES)
    if not surface.is_half:
        return half
    corners = np.concatenate([half.corners, (half.corners * _ACROSS)[:, ::-1]])
    return Quads(corners, np.tile(half.values, 2))


def _range(drawn: list[Quads]) -> Normalize:
    """Colour range from 1 to the value that nearly all of the drawn area stays below."""
    values, areas = (
        np.concatenate([getattr(quads, name) for quads in drawn]) for name in ("values", "areas")
    )
    order = np.argsort(values)
    below = np.cumsum(areas[order])
    top = values[order][np.searchsorted(below, SHOWN_SHARE * below[-1])]
    return Normalize(1.0, max(float(top), 1.01))


def _projected(points: Quads | Floats) -> Floats:
    """Return coordinates to the right, upwards and towards the viewer, (..., 3) [mm]."""
    corners = points.corners if isinstance(points, Quads) else points
    projected: Floats = corners @ np.stack([RIGHT, UP, TOWARDS], axis=1)
    return projected


def _box(drawn: list[Floats]) -> Floats:
    """Lowest and highest coordinates of all points, (2, 2), with a margin."""
    points = np.concatenate([d.reshape(-1, 2) for d in drawn])
    return np.stack([points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN])


def _draw_cut(axes: Axes, surface: Surface, shape: Shape, quads: Quads, norm: Normalize) -> None:
    edges = sharp_edges(shape.rest, surface.faces[surface.on_cut])
    rest = segments_of(shape.rest, edges, pieces=2)[..., [0, 2]]
    placed = segments_of(shape.placed, edges, pieces=2 * PIECES)[..., [0, 2]]
    colours = COLOURS(norm(quads.values))
    _lines(axes, rest, colour=MUTED, zorder=0.8)
    _paint(axes, quads.corners[..., [0, 2]], colours, colours, 0.3)
    _lines(axes, placed, colour=INK, zorder=2.0)


def _lines(axes: Axes, segments: Floats, *, colour: str, zorder: float) -> None:
    """Draw polylines (n, n_points, 2) as one path."""
    ended = np.pad(segments, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 2)
    axes.plot(
        *ended.T,
        color=colour,
        linewidth=0.55,
        zorder=zorder,
        alpha=0.55 if colour == MUTED else 1.0,
    )


def _paint(
    axes: Axes, corners: Floats, faces: Floats, edges: Floats, widths: Floats | float
) -> None:
    painted = PolyCollection(
        list(corners), facecolors=faces, edgecolors=edges, linewidths=widths, rasterized=True
    )
    axes.add_collection(painted)


def _draw_whole(axes: Axes, surface: Surface, shape: Shape, quads: Quads, norm: Normalize) -> None:
    _lines(axes, _ghost(surface, shape), colour=MUTED, zorder=0.8)
    corners, lines = _projected(quads), _projected(_edges_in_space(surface, shape))
    lines[..., 2] += 0.5  # in front of the faces that meet there
    normals = _projected(quads.vectors / quads.areas[:, None])
    colours = COLOURS(norm(quads.values))
    colours[:, :3] *= 0.72 + 0.28 * np.clip(normals @ _LIGHT, 0.0, 1.0)[:, None]
    seen = normals[:, 2] > 0.0
    corners, colours = corners[seen], colours[seen]
    far_first = np.argsort(np.concatenate([corners, lines])[..., 2].mean(axis=1))
    edges = np.concatenate([colours, np.broadcast_to(EDGE, (len(lines), 4))])
    widths = np.repeat([0.3, 0.55], [len(corners), len(lines)])
    painted = np.concatenate([corners, lines])[far_first, :, :2]
    _paint(axes, painted, edges[far_first], edges[far_first], widths[far_first])


def _edges_in_space(surface: Surface, shape: Shape) -> Floats:
    """Pieces of sharp edges, as quadrilaterals without area, (n, 4, 3); of a half those of both."""
    edges = _off_symmetry(surface, shape.rest, sharp_edges(shape.rest, _outside(surface)))
    points = segments_of(shape.placed, edges, pieces=PIECES)
    pieces = np.stack([points[:, :-1], points[:, 1:], points[:, 1:], points[:, :-1]], axis=2)
    pieces = pieces.reshape(-1, 4, 3)
    return np.concatenate([pieces, pieces * _ACROSS]) if surface.is_half else pieces


def _ghost(surface: Surface, shape: Shape) -> Floats:
    """Edges of the faces that are seen before loading, in the picture, (n, 3, 2)."""
    faces, lines = _outside(surface), []
    for side in (np.ones(3), _ACROSS) if surface.is_half else (np.ones(3),):
        facing = faces[normals_of(shape.rest, faces) @ (side * TOWARDS) > 0.0]
        edges = _off_symmetry(surface, shape.rest, sharp_edges(shape.rest, facing))
        lines.append(_projected(side * segments_of(shape.rest, edges, pieces=2))[..., :2])
    return np.concatenate(lines)


def _off_symmetry(surface: Surface, rest: Floats, edges: Indices) -> Indices:
    """Leave out the edges at which halves meet."""
    if not surface.is_half:
        return edges
    return edges[~np.all(np.isclose(rest[edges, 1], 0.0), axis=1)]


def _deformed(shown: Shown) -> Sketch | None:
    if shown.deformed is None:
        return None
    figure = deformed_figure(shown.deformed, degrades=shown.run.degrades)
    return Sketch(figure, {"is_half": shown.deformed.is_half})


FIGURES = (
    PageFigure(
        "deformed",
        "rupture",
        _deformed,
        "The actuator solved by finite elements with the fitted material, at true size"
        "{% if is_half %}: the cut through its plane of symmetry over the whole{% endif %}; thin "
        "lines show it before loading. The largest stretches are at re-entrant corners, where they "
        "grow as the mesh is refined; the colour scale leaves them out.",
    ),
)
