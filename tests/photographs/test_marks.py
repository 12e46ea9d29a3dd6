"""Marks along the bottom line: found where they are, and read through."""

import re

import cv2
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.edges import (
    FEWEST_KNOWN,
    SHARED,
    _refuse_small,
    _through_marks,
    find_edge,
)
from bayesdeg_camera.tracing.marks import FEWEST, Marks, find_marks
from bayesdeg_camera.tracing.outline import Silhouette
from bayesdeg_camera.tracing.trace import PictureScale, angle_and_length, trace


def centres_in(scenes, one):
    homography, _ = cv2.findHomography(one.line, one.line_px)
    return scenes.seen(one.dots, homography)


def compressed(image):
    return cv2.imdecode(
        cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1], cv2.IMREAD_COLOR
    )


# blue on black, black on wood, blue on grey, blue on a mat, black on white; of the last, marks next
# to white paper are seen in the whole photograph only
@pytest.mark.parametrize("seed", [101, 106, 102, 117, 104, 11077])
def test_marks_are_found_where_they_are(scenes, seed):
    one = scenes.scene(seed, method="markers", megapixels=3)
    marks, true = find_marks(compressed(one.image)), centres_in(scenes, one)
    apart = cdist(marks.centres, true)
    assert len(marks.centres) >= len(true) - 1  # one next to a dark clamp may be missing
    assert len(set(apart.argmin(axis=1))) == len(marks.centres)
    assert apart.min(axis=1).max() < 1.5  # px
    order = apart.argmin(axis=1)
    assert set(np.diff(order)) in ({1}, {-1})
    at = np.round(marks.centres).astype(int)
    assert marks.hidden[at[:, 1], at[:, 0]].all()


@pytest.mark.parametrize("seed", range(100, 112))
def test_no_marks_are_seen_where_there_are_none(scenes, seed):
    assert find_marks(compressed(scenes.scene(seed, method="paper", megapixels=3).image)) is None


def test_a_pattern_of_spots_is_no_row_of_marks():
    image = np.full((900, 1200, 3), 220, np.uint8)
    for x in range(20, 1200, 40):
        for y in range(20, 900, 40):
            cv2.circle(image, (x, y), 6, (30, 30, 30), -1)
    assert find_marks(image) is None


def test_fewer_marks_than_a_row_takes_are_none():
    image = np.full((900, 1200, 3), 220, np.uint8)
    for k in range(FEWEST - 1):
        cv2.circle(image, (200 + 80 * k, 400), 6, (30, 30, 30), -1)
    assert find_marks(image) is None
    cv2.circle(image, (200 + 80 * FEWEST, 400), 6, (30, 30, 30), -1)  # a gap is allowed
    assert len(find_marks(image).centres) == FEWEST


# targets and backgrounds of every kind; in all but one the edge alone was refused
@pytest.mark.parametrize("seed", [100, 101, 103, 117, 118, 122, 125, 127])
def test_a_marked_line_is_traced_to_its_angle(scenes, seed):
    one = scenes.scene(seed, method="markers", megapixels=3)
    length = {"length": 42.6}
    scale = {"grid": {"grid": scenes.SQUARE}, "ruler": {"ruler": 1.0}}.get(one.target, length)
    found = trace(compressed(one.image), PictureScale(**scale), rng=np.random.default_rng(1))
    angle = -np.degrees(angle_and_length(one.line)[0])
    assert found.angle == pytest.approx(angle, abs=1.2)
    assert abs(found.angle - angle) < 3.0 * found.angle_error
    assert found.length == pytest.approx(one.length, rel=0.03)
    assert np.mean(found.seen) > 0.95


def test_lines_of_a_mat_are_not_taken_for_the_actuator(scenes):
    one = scenes.scene(129, method="markers", megapixels=3)
    with pytest.raises(BayesdegError, match="both sides"):
        trace(compressed(one.image), PictureScale(length=42.6), rng=np.random.default_rng(1))


def along(place, centres, diameter=12.0):
    """Points a pixel apart along x, with edges where no mark hides them."""
    points = np.column_stack([np.arange(len(place)), np.zeros(len(place))])
    normals = np.tile([0.0, 1.0], (len(place), 1))
    hidden = np.abs(points[:, :1] - centres[None, :, 0]).min(axis=1) < 0.7 * diameter
    none = np.zeros((1, 1), dtype=bool)
    marks = Marks(centres, diameter, none, none)
    return _through_marks(points, normals, np.where(hidden, np.nan, place), marks), hidden


def test_what_marks_have_in_common_is_taken_off_and_their_scatter_is_the_error():
    rng = np.random.default_rng(3)
    x = np.arange(600)
    place = 0.004 * (x - 300.0)
    at = np.arange(30, 590, 55)
    scatter = 0.3 * rng.standard_normal(len(at))
    (through, error), hidden = along(place, np.column_stack([at, place[at] + 2.5 + scatter]))
    expected = place[at] + scatter - np.median(scatter)
    np.testing.assert_allclose(through[at], expected, atol=0.02)
    spread = 1.48 * np.median(np.abs(scatter - np.median(scatter)))
    assert error == pytest.approx(SHARED * spread, abs=0.03)
    assert np.isnan(through[~hidden]).all()


def test_too_few_marks_beside_a_seen_edge_say_nothing():
    at = np.array([20, 80, 140, 200, 260, 320])
    place = np.full(400, np.nan)
    place[: at[FEWEST_KNOWN - 2] + 40] = 0.0  # seen about three marks of six
    (through, error), _ = along(place, np.column_stack([at, np.ones(6)]))
    assert np.isnan(through).all()
    assert error == 0.0


def test_a_mark_that_touches_a_clamp_of_its_colour_is_found_where_the_end_is_known():
    image = np.full((900, 1200, 3), (30, 105, 190), np.uint8)
    image[450:] = 220
    cv2.rectangle(image, (0, 200), (200, 700), (30, 30, 30), -1)
    centres = np.column_stack([206.0 + 70.0 * np.arange(9), np.full(9, 450.0)])
    for x, y in centres.astype(int):
        cv2.circle(image, (x, y), 7, (30, 30, 30), -1, lineType=cv2.LINE_AA)
    found = find_marks(image)
    assert len(found.centres) == 8
    assert found.hidden[440:460, 150:190].any()  # the clamp, taken for ink
    line = np.column_stack([np.linspace(200.0, 800.0, 300), np.full(300, 450.0)])
    within = found.within(line)
    assert cdist(within.centres, centres).min(axis=0).max() < 2.0
    assert not within.hidden[440:460, 150:185].any()
    assert len(found.within(line[::-1]).centres) == 9


@pytest.mark.parametrize(("length", "thickness"), [(60.0, 200.0), (120.0, 10.0), (60.0, 10.0)])
def test_a_body_of_few_pixels_is_refused_and_the_size_it_needs_is_enough(length, thickness):
    image = np.full((300, 400, 3), 200, np.uint8)
    line = np.column_stack([np.linspace(100.0, 100.0 + length, 60), np.full(60, 150.0)])
    with pytest.raises(BayesdegError, match="too small") as refused:
        find_edge(image, Silhouette(line, thickness))
    found, needed = (
        float(re.search(f"{words} ([0-9]+) pixels", str(refused.value))[1])
        for words in ("edge:", "has")
    )
    assert needed > found
    larger = 1.01 * needed / found  # both are printed as whole pixels
    _refuse_small(larger * found, larger * thickness)
