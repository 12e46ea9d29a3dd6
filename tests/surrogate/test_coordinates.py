"""Coordinates of the polynomials: derivatives, slack paper, and what is refused."""

import numpy as np
import pytest

from bayesdeg.surrogate.coordinates import (
    LARGEST_SLACK_AND_MISMATCH,
    LARGEST_SWELLING,
    MISMATCH,
    PAPER,
    SLACK,
    coordinates,
    inside,
    paper_give,
    scaled_cause,
    unit_rate,
    unit_swelling,
)
from bayesdeg.surrogate.scaling import CAUSES, GROUPS, NAMES, TrainingRange

SPAN = TrainingRange()
MIDDLE_PAPER, STIFF_PAPER = np.log(100.0), np.log(1000.0)
NEUTRAL = np.array([0.3, *0.5 * (SPAN.lower + SPAN.upper)[:3], *(c.neutral for c in CAUSES)])


def random_groups(count, *, seed=0):
    generator = np.random.default_rng(seed)
    groups = generator.uniform(SPAN.lower, SPAN.upper, (count, len(GROUPS)))
    return np.column_stack([generator.uniform(0.05, 0.9 * LARGEST_SWELLING, count), groups])


def differences(groups, axis):
    """Central differences of points by the swelling or a group."""
    step = np.zeros(len(NAMES))
    step[axis] = 1e-6 * (1.0 if axis == 0 else GROUPS[axis - 1].high - GROUPS[axis - 1].low)
    more, less = (coordinates(groups + sign * step) for sign in (1.0, -1.0))
    return (more.points - less.points) / (2.0 * step[axis])


@pytest.mark.parametrize("axis", range(len(NAMES)), ids=NAMES)
def test_derivatives_are_those_of_central_differences(axis):
    groups = random_groups(50)
    groups[:, SLACK] = np.maximum(groups[:, SLACK], 1e-4)
    found = coordinates(groups)
    points = differences(groups, axis)
    scale = np.max(np.abs(points))
    np.testing.assert_allclose(found.jacobian[:, :, axis], points, rtol=1e-6, atol=1e-7 * scale)


def test_derivatives_of_tight_paper_are_one_sided():
    groups = random_groups(20)
    groups[:, SLACK] = 0.0
    more = groups.copy()
    more[:, SLACK] = 1e-10
    found = coordinates(groups)
    rise = (coordinates(more).points - found.points) / 1e-10
    np.testing.assert_allclose(found.jacobian[:, :, SLACK], rise, rtol=1e-5)
    others = [k for k in range(len(NAMES)) if k != SLACK]
    np.testing.assert_array_equal(found.jacobian[:, SLACK, others], 0.0)


def test_the_base_model_has_no_causes():
    found = coordinates(NEUTRAL[None])
    np.testing.assert_allclose(found.points[0, 1:], 0.0, atol=1e-12)


def test_swelling_enters_by_its_logarithm_from_rest_to_the_largest():
    swelling = np.array([0.0, 0.3, 2.0, LARGEST_SWELLING])
    groups = np.tile(NEUTRAL, (4, 1))
    groups[:, 0] = swelling
    wanted = 2.0 * np.log(1.0 + swelling) / np.log(15.0) - 1.0
    np.testing.assert_allclose(coordinates(groups).points[:, 0], wanted, atol=1e-15)
    np.testing.assert_allclose(unit_swelling(swelling), wanted, atol=1e-15)
    assert wanted[[0, -1]].tolist() == [-1.0, 1.0]
    inner, h = swelling[1:3], 1e-6
    more, less = (unit_swelling(inner * np.exp(sign * h)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(unit_rate(inner), (more - less) / (2.0 * h), rtol=1e-8)


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: cause.name)
def test_causes_are_at_most_one_in_size_and_reach_it(cause):
    values, _ = scaled_cause(cause.name, np.linspace(cause.low, cause.high, 101))
    assert np.max(np.abs(values)) == pytest.approx(1.0)
    assert np.all(np.diff(values) > 0.0)


def felt(swelling, slack, log_paper=MIDDLE_PAPER):
    groups = np.tile(NEUTRAL, (np.size(swelling), 1))
    groups[:, 0], groups[:, SLACK], groups[:, PAPER] = swelling, slack, log_paper
    return coordinates(groups).points[:, SLACK]


def test_slack_paper_is_not_felt_at_rest_and_tight_paper_always():
    np.testing.assert_array_equal(felt(np.zeros(1), 0.02), 1.0)
    np.testing.assert_array_equal(felt(np.array([0.0, 0.1, 0.9]), 0.0), 0.0)


def test_slack_is_taken_up_by_swelling():
    phi = felt(np.linspace(0.0, 0.9, 50), 0.02)
    assert np.all(np.diff(phi) < 0.0)
    assert phi[-1] < 0.5
    half = 0.02 / paper_give(MIDDLE_PAPER)  # strain of the paper equals the slack
    assert felt(np.array([half]), 0.02)[0] == pytest.approx(0.5)


def test_stiff_paper_takes_longer_to_be_stretched():
    assert felt(np.array([0.3]), 0.02, STIFF_PAPER)[0] > felt(np.array([0.3]), 0.02)[0]


def test_a_little_slack_is_nearly_none():
    np.testing.assert_allclose(felt(np.array([0.3]), 1e-9), 0.0, atol=1e-6)


def test_ranges_are_closed_and_nothing_lies_beyond_them():
    corners = np.array([SPAN.lower, SPAN.upper])
    corners[:, SLACK - 1] = 0.0
    assert np.all(inside(corners, SPAN))
    for k in range(len(GROUPS)):
        for sign, edge in ((-1.0, SPAN.lower), (1.0, SPAN.upper)):
            beyond = NEUTRAL[1:].copy()
            beyond[k] = edge[k] + sign * 1e-6 * (SPAN.upper[k] - SPAN.lower[k])
            found = inside(beyond[None], SPAN)[0]
            assert not found[k]
            assert np.sum(~found) == 1
    assert not np.any(inside(np.full((1, len(GROUPS)), np.nan), SPAN))


@pytest.mark.parametrize("mismatch", [-0.01, 0.01])
def test_slack_with_mismatch_is_refused_and_either_alone_is_not(mismatch):
    groups = np.tile(NEUTRAL[1:], (3, 1))
    groups[[0, 2], SLACK - 1] = 0.02
    groups[[1, 2], MISMATCH - 1] = mismatch
    found = inside(groups, SPAN)
    assert np.all(found[:2])
    assert not found[2, SLACK - 1]
    assert np.sum(~found[2]) == 1


@pytest.mark.parametrize("name", [SLACK, MISMATCH])
def test_next_to_none_of_either_goes_with_the_other(name):
    groups = NEUTRAL[1:].copy()
    groups[[SLACK - 1, MISMATCH - 1]] = 0.01
    groups[name - 1] = 0.99 * LARGEST_SLACK_AND_MISMATCH
    assert np.all(inside(groups[None], SPAN))
