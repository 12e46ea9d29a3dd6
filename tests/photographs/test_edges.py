"""The edge of gel and paper, to a fraction of a pixel, and where it ends."""

import cv2
import numpy as np
import pytest

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing import edges
from bayesdeg_camera.tracing.edges import find_edge
from bayesdeg_camera.tracing.outline import Silhouette

FINE = 4  # drawn so many times as large
START, LENGTH, THICK, PAPER = np.array([150.0, 240.0]), 500.0, 110.0, 3.0  # px
GEL, BEHIND = (30, 105, 190), (140, 140, 140)


def drawn(slope, *, until=LENGTH):
    """A straight body of gel on paper against grey, its clamp on the left; and its line."""
    along = np.array([np.cos(slope), np.sin(slope)])
    down = np.array([-along[1], along[0]])
    image = np.full((FINE * 480, FINE * 800, 3), BEHIND, np.uint8)

    def fill(first, last, high, low, colour):
        corners = [first * along + high * down, last * along + high * down,
                   last * along + low * down, first * along + low * down]  # fmt: skip
        # pixel centres are whole numbers
        at = np.round(FINE * (START + np.array(corners) + 0.5) - 0.5).astype(np.int32)
        cv2.fillPoly(image, [at], colour)

    fill(0.0, LENGTH, 0.0, PAPER, (245, 245, 245))
    fill(0.0, LENGTH, -THICK, 0.0, GEL)
    fill(-90.0, 0.0, -THICK - 30.0, 60.0, (90, 90, 90))
    image = cv2.resize(image, None, fx=1 / FINE, fy=1 / FINE, interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    image = np.clip(cv2.GaussianBlur(image, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)
    halved = [cv2.IMWRITE_JPEG_QUALITY, 92]  # with colours at half the resolution
    image = cv2.imdecode(cv2.imencode(".jpg", image, halved)[1], cv2.IMREAD_COLOR)
    line = START + np.linspace(until, 0.0, 40)[:, None] * along  # gel on its left
    return image, line, down


def scatter(slope):
    image, line, down = drawn(slope)
    edge = find_edge(image, Silhouette(line, THICK))
    return float(np.std((edge.points - START)[edge.seen] @ down))


@pytest.mark.parametrize("slope", [0.03, 0.12, 0.3])
def test_edges_of_colours_at_half_resolution_are_straight(slope, monkeypatch):
    """Colour that counts in full bends the line by the squares in which it is compressed."""
    found = scatter(slope)
    assert found < 0.1  # px
    monkeypatch.setattr(edges, "WEIGHTS", np.ones(3, dtype=np.float32))
    assert scatter(slope) > 1.2 * found


def test_a_line_that_ends_within_the_gel_is_refused():
    image, line, _ = drawn(0.1)
    assert find_edge(image, Silhouette(line, THICK)).seen.mean() > 0.9
    image, line, _ = drawn(0.1, until=0.5 * LENGTH)
    with pytest.raises(BayesdegError, match="--hint"):
        find_edge(image, Silhouette(line, THICK))
