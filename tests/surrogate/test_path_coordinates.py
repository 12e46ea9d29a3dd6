"""Paths in the coordinates that the benchmark compares."""

import numpy as np
import pytest
from path_coordinates import CHOSEN, WAYS, equations, read, seen, shipped, write
from scipy.interpolate import BPoly

from bayesdeg.surrogate.terms import Family

PATHS = read()


def test_stored_paths_are_read_as_written(tmp_path):
    some = PATHS[:3]
    write(some, tmp_path / "paths.npz")
    for one, other in zip(some, read(tmp_path / "paths.npz"), strict=True):
        assert one.curve == other.curve
        assert (one.kind, one.is_fine, one.limit) == (other.kind, other.is_fine, other.limit)
        np.testing.assert_array_equal(one.samples.readings, other.samples.readings)
        np.testing.assert_array_equal(one.samples.gradients, other.samples.gradients)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.name)
def test_derivatives_along_a_path_are_those_of_its_values(way):
    """A cubic through every other equilibrium and slope predicts those between."""
    checked = 0
    for path in PATHS[:40]:
        one = seen(path, way)
        if one is None or len(one.z) < 9 or path.curve.material.paper_slack > 0.0:
            continue
        checked += 1
        at = np.log(one.z)
        for k in range(2):
            slope = one.gradients[:, k, 0] * one.z
            known = np.column_stack([one.values[::2, k], slope[::2]])
            between = BPoly.from_derivatives(at[::2], known)
            inner = (at > at[0]) & (at < at[::2][-1])
            error = between(at[inner]) - one.values[inner, k]
            assert np.max(np.abs(error)) < 0.02 + 0.1 * np.ptp(one.values[:, k])
    assert checked > 5


def test_only_ways_by_volume_or_angle_go_through_the_limit_point():
    limited = [one for one in PATHS if np.isfinite(one.limit)]
    assert limited
    for path in limited:
        by_volume = seen(path, CHOSEN)
        by_load = seen(path, WAYS[1])
        assert np.all(np.diff(by_volume.z) > 0.0)
        assert np.any(np.diff(by_volume.load) < 0.0)
        assert by_load is None or np.all(np.diff(by_load.load) > 0.0)


@pytest.mark.parametrize(("kind", "paths"), [("study", 12), ("fresh", 10)])
def test_the_shipped_emulator_predicts_fine_curves_as_far_as_they_go(kind, paths):
    found = shipped(PATHS)[kind]["curvature_pct"]
    assert found["paths"] == paths
    assert found["median_pct"] < 0.4
    assert found["max_pct"] < 1.0


def test_equations_hold_for_the_terms_that_they_came_from():
    """Values that are a sum of terms leave nothing of the equations of values."""
    one = next(found for path in PATHS if (found := seen(path, CHOSEN)) is not None)
    orders = Family((2, 1, 1, 1), (1, 0, 0, 0), 9 * (1,)).orders
    part = equations(one, orders, 0)
    assert part.matrix.shape == (14 * len(one.z), len(orders))
    assert part.targets.shape == (14 * len(one.z), 1)
    np.testing.assert_array_equal(part.targets[: part.n_values, 0], one.values[:, 0])
