import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import same_color
from matplotlib.path import Path

from bayesdeg.actuator.body import LINEAR_CONSTANT, box
from bayesdeg.errors import BayesdegError
from bayesdeg.pages.drawing import MUTED, inline_svg
from bayesdeg.pages.figures.actuator import (
    COLOURS,
    RIGHT,
    SHOWN_SHARE,
    TOWARDS,
    UP,
    deformed_figure,
)
from bayesdeg.pages.page import build_page
from bayesdeg.pages.surface import (
    SURFACE,
    faces_of,
    normals_of,
    quads_of,
    read_surface,
    segments_of,
    sharp_edges,
    write_surface,
)
from tests.pages.html_reading import read_html
from tests.pages.solved_actuators import BENDING, SCALE, TWO_CHAMBERS, actuator, bent, pictured
from tests.pages.synthetic_run import write_full

LENGTH, HEIGHT = 20.0, 10.0  # of two chambers, as moulded [mm]


def slightly(nodes):
    return 0.1 * bent(nodes)


@pytest.fixture(scope="module")
def two():
    return pictured((bent, 0.0, 240.0), (slightly, 25.0, 240.0))


@pytest.fixture(scope="module")
def figure(two):
    return deformed_figure(two)


def panels_of(figure):
    """Axes of the cuts, of the wholes, and of the bar."""
    *drawn, bar = figure.axes
    half = len(drawn) // 2
    return drawn[:half], drawn[half:], bar


def painted(axes):
    (faces,) = (c for c in axes.collections if isinstance(c, PolyCollection))
    return np.array([p.vertices[:4] for p in faces.get_paths()]), faces


def lines(axes, colour):
    """The points of the lines of one colour, gaps left out."""
    (line,) = (entry for entry in axes.lines if same_color(entry.get_color(), colour))
    points = line.get_xydata()
    return points[np.isfinite(points).all(axis=1)]


# ---- the surface


def solid_side():
    """Area of the section at y = 0 as moulded [mm²] and its moment about z = 0 [mm³]."""
    *chambers, (along, _, channel) = TWO_CHAMBERS.cavities
    dividers = [(along[0], along[1], *channel)]
    dividers += [(x[0], x[1], z[0], z[1]) for x, _, z in (*chambers, *TWO_CHAMBERS.voids)]
    # the channel runs through the chambers, which are counted already
    twice = [(x[0], x[1], *channel) for x, _, _ in chambers]
    area, moment = LENGTH * HEIGHT, LENGTH * HEIGHT**2 / 2.0
    for rectangles, sign in ((dividers, -1.0), (twice, 1.0)):
        for left, right, low, top in rectangles:
            area += sign * (right - left) * (top - low)
            moment += sign * (right - left) * (top**2 - low**2) / 2.0
    return area, moment


def test_the_surface_is_closed_and_has_the_faces_of_the_drawing():
    body = actuator()
    surface, nodes = faces_of(body)
    points = body.nodes[nodes]
    quads = quads_of(points, points[:, 0], surface.faces, pieces=1)
    np.testing.assert_allclose(quads.vectors.sum(axis=0), 0.0, atol=1e-10)
    middles = quads.corners.mean(axis=1)
    volume = np.sum(middles * quads.vectors) / 3.0
    assert volume == pytest.approx(body.volume, rel=1e-12)
    cut = quads_of(points, points[:, 0], surface.faces[surface.on_cut], pieces=1)
    assert cut.areas.sum() == pytest.approx(solid_side()[0], rel=1e-12)
    np.testing.assert_allclose(normals_of(points, surface.faces[surface.on_cut])[:, 1], -1.0)
    assert surface.in_cavity.sum() == len(body.cavity)
    assert not np.any(surface.in_cavity & surface.on_cut)


def test_pieces_of_a_face_follow_its_curvature():
    line = np.array([0.0, 0.5, 1.0])
    x, y = (c.ravel() for c in np.meshgrid(line, line, indexing="ij"))
    curved = np.stack([x, y, x**2 + x * y**2], axis=1)
    quads = quads_of(curved, 3.0 * curved[:, 2], np.arange(9)[None], pieces=4)
    x, y, z = np.moveaxis(quads.corners, -1, 0)
    np.testing.assert_allclose(z, x**2 + x * y**2, atol=1e-14)
    np.testing.assert_allclose(quads.values, 3.0 * z.mean(axis=1), atol=1e-14)
    assert len(quads.values) == 16
    edge = segments_of(curved, np.array([[0, 3, 6]]), pieces=4)[0]
    along = np.linspace(0.0, 1.0, 5)
    np.testing.assert_allclose(edge, np.stack([along, 0.0 * along, along**2], axis=1), atol=1e-14)


@pytest.mark.parametrize("options", [{}, {"element": LINEAR_CONSTANT}])
def test_a_box_has_twelve_edges_and_no_seams(options):
    body = box((3.0, 2.0, 1.0), divisions=(3, 2, 1), **options)
    surface, nodes = faces_of(body)
    edges = sharp_edges(body.nodes[nodes], surface.faces)
    ends = body.nodes[nodes][edges[:, [0, -1]]]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(4 * 6.0)
    on_bound = np.isclose(ends, 0.0) | np.isclose(ends, [3.0, 2.0, 1.0])
    assert np.all(on_bound.all(axis=1).sum(axis=1) >= 2)


# ---- what is drawn


def test_every_state_is_titled_with_its_rate_and_pressure(two, figure):
    above, below, _ = panels_of(figure)
    assert len(above) == len(below) == 2
    for axes, shape in zip(above, two.shapes, strict=True):
        words = axes.get_title(loc="left").replace("\N{NO-BREAK SPACE}", " ")
        assert words == f"{shape.degradation:g} % degradation, 240 kPa"


def test_the_axes_and_the_colours_state_their_units(figure):
    above, below, bar = panels_of(figure)
    assert [axes.get_xlabel() for axes in above] == ["x [mm]", "x [mm]"]
    assert above[0].get_ylabel() == "z [mm]"
    assert bar.get_xlabel() == "largest principal stretch [–]"
    assert not any(axes.axison for axes in below)
    (bar_text,) = below[0].texts
    (scale,) = (entry for entry in below[0].lines if len(entry.get_xdata()) == 2)
    assert bar_text.get_text() == f"{np.ptp(scale.get_xdata()):g} mm"


def test_a_millimetre_is_as_long_everywhere_and_nothing_is_cut_off(two, figure):
    figure.draw_without_rendering()
    above, below, _ = panels_of(figure)
    for row in (above, below):
        lengths = []
        for axes in row:
            origin, right, up = axes.transData.transform([(0, 0), (1, 0), (0, 1)])
            lengths += [right[0] - origin[0], up[1] - origin[1]]
            corners, _ = painted(axes)
            drawn = np.concatenate([corners.reshape(-1, 2), lines(axes, MUTED)])
            (left, end), (low, top) = axes.get_xlim(), axes.get_ylim()
            assert np.all((drawn > [left, low]) & (drawn < [end, top]))
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-6)


def test_the_cut_stands_at_true_size_before_and_after_loading(two, figure):
    above, _, _ = panels_of(figure)
    rest = lines(above[0], MUTED)
    np.testing.assert_allclose(rest.min(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(rest.max(axis=0), [SCALE * LENGTH, SCALE * HEIGHT])
    corners, _ = painted(above[0])
    area, moment = solid_side()
    # a height z over the bottom is stretched by 1 + z/R
    grown = SCALE**2 * (area + BENDING * moment)
    assert np.abs(signed_areas(corners)).sum() == pytest.approx(grown, rel=2e-3)


def signed_areas(corners):
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def test_colours_mean_the_stretch_on_one_scale_for_all_states(two):
    uniform = tuple(
        replace(shape, stretch=np.full_like(shape.stretch, value))
        for shape, value in zip(two.shapes, (1.4, 1.1), strict=True)
    )
    above, _, bar = panels_of(deformed_figure(replace(two, shapes=uniform)))
    np.testing.assert_allclose(bar.get_xlim(), (1.0, 1.4), rtol=1e-6)
    for axes, place in zip(above, (1.0, 0.25), strict=True):
        _, faces = painted(axes)
        colours = faces.get_facecolor()
        np.testing.assert_allclose(colours, np.broadcast_to(COLOURS(place), colours.shape))


def test_the_scale_leaves_out_only_what_is_singular(two, figure):
    low, top = panels_of(figure)[2].get_xlim()
    largest = max(shape.stretch.max() for shape in two.shapes)
    assert low == 1.0
    assert 1.0 < top < largest
    values, areas = [], []
    for shape in two.shapes:
        for chosen, times in ((two.on_cut, 1.0), (~two.on_cut & ~two.in_cavity, 2.0)):
            quads = quads_of(shape.placed, shape.stretch, two.faces[chosen], pieces=4)
            values.append(quads.values)
            areas.append(times * quads.areas)
    inside = np.concatenate(values) <= top + 1e-12
    share = np.sum(np.concatenate(areas)[inside]) / np.sum(np.concatenate(areas))
    assert share == pytest.approx(SHOWN_SHARE, abs=1e-3)


def test_the_whole_is_both_halves_and_the_nearest_face_covers_those_behind(two, figure):
    _, below, _ = panels_of(figure)
    polygons, _ = painted(below[1])
    polygons = polygons[np.abs(signed_areas(polygons)) > 1e-9]
    assert np.all(signed_areas(polygons) > 0.0)  # none is seen from behind
    nearness = depths(two, two.shapes[1])
    rng = np.random.default_rng(2)
    covered = 0
    for _ in range(400):
        point = polygons[rng.integers(len(polygons))].mean(axis=0)
        hit = polygons[[Path(p).contains_point(point) for p in polygons]]
        depth = [nearness[key(p)] for p in hit]
        assert depth[-1] > max(depth) - 0.4
        covered += max(depth) - min(depth) > 1.0
    assert covered > 10


def key(polygon):
    return tuple(np.round(polygon.mean(axis=0), 6))


def depths(surface, shape):
    """How near to the viewer every quadrilateral is, by its place in the picture."""
    outside = surface.faces[~surface.on_cut & ~surface.in_cavity]
    half = quads_of(shape.placed, shape.stretch, outside, pieces=4).corners
    both = np.concatenate([half, half * [1.0, -1.0, 1.0]])
    places = (both @ np.stack([RIGHT, UP], axis=1)).mean(axis=1)
    nearness = (both @ TOWARDS).mean(axis=1)
    return {tuple(np.round(p, 6)): d for p, d in zip(places, nearness, strict=True)}


def test_one_that_is_meshed_as_a_whole_is_drawn_once_and_as_its_half_is_with_its_mirror_image():
    half = box((3.0, 1.0, 1.5), divisions=(2, 2, 1))
    whole = box((3.0, 2.0, 1.5), divisions=(2, 4, 1))
    whole = whole.placed_at(whole.nodes - [0.0, 1.0, 0.0])
    drawn = []
    for body in (half, whole):
        surface = pictured((bent, 0.0, 10.0), body=body)
        assert surface.is_half is (body is half)
        figure = deformed_figure(surface)
        *axes, _ = figure.axes
        assert len(axes) == (2 if body is half else 1)
        corners, _ = painted(axes[-1])
        drawn.append(np.unique(np.sort(corners.round(6), axis=1).reshape(len(corners), -1), axis=0))
    np.testing.assert_allclose(drawn[1], drawn[0], atol=2e-6)


def test_the_view_is_a_rotation():
    view = np.stack([RIGHT, UP, TOWARDS])
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(view) == pytest.approx(1.0)


@pytest.mark.parametrize("states", [1, 3])
def test_any_number_of_states_is_drawn(states):
    cases = [(slightly, 5.0 * i, 100.0) for i in range(states)]
    above, below, _ = panels_of(deformed_figure(pictured(*cases)))
    assert len(above) == len(below) == states


# ---- in the run folder and in the page


def test_the_figure_stands_in_the_page_on_its_own(two):
    svg = inline_svg(deformed_figure(two), "deformed", description="bent", virtual=False)
    ElementTree.fromstring(svg)
    assert not re.search(r"#0102", svg)
    assert svg.count("data:image/png;base64,") == 5
    assert len(svg) < 900_000
    assert "largest principal stretch [–]" in svg


def test_a_surface_is_read_as_it_was_written(two, tmp_path):
    assert read_surface(tmp_path) is None
    write_surface(tmp_path, two)
    found = read_surface(tmp_path)
    for name in ("faces", "on_cut", "in_cavity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(two, name))
    for shape, known in zip(found.shapes, two.shapes, strict=True):
        for name, value in vars(known).items():
            np.testing.assert_allclose(getattr(shape, name), value, rtol=1e-6, atol=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == [SURFACE]


@pytest.mark.parametrize("damage", ["cut", "text", "node"])
def test_a_damaged_surface_is_the_readers_fault_and_named(two, tmp_path, damage):
    path = tmp_path / SURFACE
    write_surface(tmp_path, replace(two, faces=two.faces + 1) if damage == "node" else two)
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-2000])
    if damage == "text":
        path.write_text("no archive", encoding="utf-8")
    with pytest.raises(BayesdegError, match=SURFACE.replace(".", r"\.")):
        read_surface(tmp_path)


def test_the_page_shows_the_actuator_where_it_was_solved(two, tmp_path):
    write_full(tmp_path, "named")
    without = build_page(tmp_path).read_text(encoding="utf-8")
    write_surface(tmp_path, two)
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    assert "figure-deformed" not in without
    assert "re-entrant corners" in page.by_id("figure-deformed").text
    assert page.by_id("figure-deformed").all("image")
