"""The rendered photographs: their truth is what is drawn."""

import numpy as np
import pytest


def test_the_same_seed_draws_the_same_photograph(scenes):
    first, second = (scenes.scene(5, megapixels=3) for _ in range(2))
    assert np.array_equal(first.image, second.image)
    assert not np.array_equal(first.image, scenes.scene(6, megapixels=3).image)


def test_sizes_are_those_of_cameras(scenes):
    assert scenes.scene(5, megapixels=12).image.shape == (3024, 4032, 3)


def test_the_line_of_a_shape_is_on_its_faces_and_keeps_its_length(scenes):
    for curve in scenes.shapes():
        for shape in curve:
            length = np.sum(np.hypot(*np.diff(shape.line, axis=0).T))
            assert length == pytest.approx(50.0 * 0.62 ** (1 / 3), rel=0.01)
            nodes = shape.faces.reshape(-1, 2)
            apart = np.hypot(*(shape.line[:, None] - nodes[None]).transpose(2, 0, 1)).min(axis=1)
            assert apart.max() < 1e-4


def test_the_true_line_is_where_gel_ends_in_the_photograph(scenes):
    """Colours a little above and below the edge differ; 0.5 mm above, they are those of gel."""
    one = scenes.scene(5, megapixels=3, target="grid", method="paper", kind="white")
    middle = one.line_px[20:-20:10]
    ahead = one.line_px[21:-19:10] - middle
    ahead /= np.hypot(*ahead.T)[:, None]
    below = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    for away, is_gel in ((-8.0, True), (8.0, False)):
        at = np.round(middle + away * below).astype(int)
        blue, red = one.image[at[:, 1], at[:, 0]][:, [0, 2]].astype(float).T
        assert (np.median(red - blue) > 80.0) == is_gel


def test_a_camera_keeps_straight_lines(scenes):
    homography = scenes.camera(np.random.default_rng(0), (2048, 1536), 12.0)
    at = scenes.seen(
        np.column_stack([np.linspace(-40, 40, 9), np.linspace(-10, 30, 9)]), homography
    )
    assert np.linalg.matrix_rank(at - at[0], tol=1e-6) == 1
