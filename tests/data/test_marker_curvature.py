import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.actuator.line import measure_bend, spline_bend

Floats = npt.NDArray[np.float64]


def arc(angle: float, stations: Floats, *, length: float = 50.0, start: float = 0.0) -> Floats:
    """Points of an arc that bends downwards for positive angles; stations run from 0 to 1."""
    tangents = start + angle * stations
    radius = length / angle
    along = radius * (np.sin(tangents) - np.sin(start))
    return np.column_stack([along, radius * (np.cos(tangents) - np.cos(start))])


@given(
    angle=st.floats(1e-3, 5.5),
    sign=st.sampled_from([-1.0, 1.0]),
    steps=st.lists(st.floats(0.5, 1.5), min_size=12, max_size=30),
    start=st.floats(-3.0, 3.0),
    end_points=st.one_of(st.none(), st.integers(3, 40)),
)
def test_exact_on_arcs_with_uneven_points(
    angle: float, sign: float, steps: list[float], start: float, end_points: int | None
) -> None:
    stations = np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)
    bend = measure_bend(arc(sign * angle, stations, start=start), end_points=end_points)
    assert bend.angle == pytest.approx(sign * angle, abs=1e-9)
    assert bend.arc_length == pytest.approx(50.0, rel=1e-9)
    assert bend.curvature == pytest.approx(sign * angle / 0.05, abs=1e-7)


def test_few_points_on_a_strong_arc_are_no_chord_approximation() -> None:
    bend = measure_bend(arc(3.0, np.array([0.0, 0.5, 1.0])))
    assert bend.arc_length == pytest.approx(50.0, rel=1e-10)
    assert bend.curvature == pytest.approx(60.0, rel=1e-10)


def test_downwards_is_positive_and_beyond_half_a_turn_the_angle_goes_on() -> None:
    down = measure_bend(arc(np.radians(250.0), np.linspace(0, 1, 20)))
    up = measure_bend(arc(np.radians(-250.0), np.linspace(0, 1, 20)))
    assert np.degrees([down.angle, up.angle]) == pytest.approx([250.0, -250.0])
    assert arc(1.0, np.array([1.0]))[0, 1] < 0


def test_straight_row() -> None:
    row = np.column_stack([np.linspace(0, 50, 8), np.zeros(8)])
    bend = measure_bend(row)
    assert (bend.angle, bend.arc_length) == pytest.approx((0.0, 50.0), abs=1e-12)
    assert spline_bend(row).curvature == pytest.approx(0.0, abs=1e-9)


def clothoid(n: int) -> Floats:
    """A row whose curvature grows linearly from 0 to 40 1/m over 50 mm: bend angle 1 rad."""
    fine = np.linspace(0, 1, 40001)
    middle = (fine[1:] + fine[:-1]) / 2
    x = np.concatenate([[0], np.cumsum(50 * np.cos(middle**2) * np.diff(fine))])
    z = np.concatenate([[0], np.cumsum(-50 * np.sin(middle**2) * np.diff(fine))])
    keep = np.linspace(0, 40000, n).astype(int)
    return np.column_stack([x, z])[keep]


def test_ends_are_followed_more_closely_the_more_points_there_are() -> None:
    errors = [abs(measure_bend(clothoid(n), end_points=3).curvature - 20) for n in (11, 21, 41, 81)]
    assert errors[-1] < 0.01
    assert all(np.diff(errors) < 0)


def test_bulges_do_not_mislead_the_tangents_at_the_ends() -> None:
    # chambers bulge the floor between flat ends: a circle through all points misses the rotation
    stations = np.linspace(0, 1, 201)
    inside = np.clip((stations - 0.06) / 0.88, 0, 1)
    tangents = 0.15 * inside + 0.4 * np.sin(2 * np.pi * 5 * inside) * (0.5 + inside)
    middle = (tangents[1:] + tangents[:-1]) / 2
    steps = 50 * np.diff(stations)[:, None] * np.column_stack([np.cos(middle), -np.sin(middle)])
    row = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    assert measure_bend(row, end_points=5).curvature == pytest.approx(3.0, rel=1e-3)
    assert abs(measure_bend(row, end_points=201).curvature - 3.0) > 1.0


@pytest.mark.parametrize("angle", [-2.5, -0.5, 0.5, 2.5])
def test_spline_agrees_with_the_arc_and_improves_with_points(angle: float) -> None:
    errors = [
        abs(spline_bend(arc(angle, np.linspace(0, 1, n))).curvature - angle / 0.05)
        for n in (10, 20, 40)
    ]
    assert errors[1] < 2e-3 * abs(angle / 0.05)
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ([[0, 0], [1, 0]], "at least 3"),
        ([[0, 0, 0]] * 4, "shape"),
        ([[0, 0], [1, 0], [1, 0], [2, 0]], "coincide"),
        ([[0, 0], [1, np.nan], [2, 0], [3, 0]], "finite"),
    ],
)
def test_impossible_rows_are_refused(row: list[list[float]], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        measure_bend(row)
    with pytest.raises(ValueError, match=says):
        spline_bend(row)


@pytest.mark.parametrize("end_points", [None, 3, 18])
@pytest.mark.parametrize("angle", [1e-6, 1.0])
def test_noise_of_points_does_not_bias_the_curvature(end_points: int | None, angle: float) -> None:
    rng = np.random.default_rng(11)
    row = arc(angle, np.linspace(0, 1, 18))
    found = [
        measure_bend(row + rng.normal(0, 0.02, row.shape), end_points=end_points).curvature
        for _ in range(800)
    ]
    error = np.std(found) / np.sqrt(800)
    assert np.mean(found) == pytest.approx(angle / 0.05, abs=4 * error)


def test_too_few_points_for_a_spline() -> None:
    with pytest.raises(ValueError, match="at least 4"):
        spline_bend(arc(1.0, np.linspace(0, 1, 3)))
