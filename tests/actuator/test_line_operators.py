"""Operators that read a line of points, and maps that predict what they read."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.line import OPERATORS, kappa_bend, read_line
from bayesdeg.actuator.reading import ReadByOperator, bottom_lines, evenly, operator_ratio
from bayesdeg.data.settings import parse_settings


def arc(angle, count=30, length=50.0):
    s, radius = np.linspace(0.0, angle, count), length / angle
    return np.column_stack([radius * np.sin(s), radius * (np.cos(s) - 1.0)])


def turned(points, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


@pytest.mark.parametrize("angle", [-4.0, -0.5, 1e-5, 2.0, 5.0])
@pytest.mark.parametrize("operator", OPERATORS)
def test_all_operators_agree_on_an_arc(operator, angle):
    bend = read_line(arc(angle), operator)
    assert bend.angle == pytest.approx(angle, rel=2e-3)
    assert bend.arc_length == pytest.approx(50.0, rel=1e-3)


@pytest.mark.parametrize("operator", ["angle_over_arc", "circle", "spline"])
def test_only_base_and_tip_depend_on_the_alignment(operator):
    line = bottom_lines().points[-1]
    moved = turned(line, 0.3) + 7.0
    assert read_line(moved, operator).curvature == pytest.approx(
        read_line(line, operator).curvature, rel=1e-9
    )
    assert read_line(turned(line, 0.3), "base_tip").angle == pytest.approx(
        read_line(line, "base_tip").angle - 0.6
    )


def test_curvature_goes_with_one_over_size_and_mirrors():
    line = bottom_lines().points[-1]
    for operator in OPERATORS:
        once = read_line(line, operator).curvature
        assert read_line(2.0 * line, operator).curvature == pytest.approx(0.5 * once, rel=1e-8)
        assert read_line(line * [1.0, -1.0], operator).curvature == pytest.approx(-once, rel=1e-8)


def test_circle_is_the_least_squares_fit():
    # an independent search over centre and radius
    rng = np.random.default_rng(2)
    line = arc(1.2) + rng.normal(0.0, 0.4, (30, 2))

    def distances(v):
        return np.hypot(*(line - v[:2]).T) - v[2]

    found = least_squares(distances, [0.0, -40.0, 40.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert read_line(line, "circle").curvature == pytest.approx(1e3 / found.x[2], rel=1e-6)


@pytest.mark.parametrize(
    ("operator", "most"),
    [("angle_over_arc", 2e-3), ("circle", 2e-3), ("spline", 6e-3), ("base_tip", 2e-3)],
)
def test_ratio_is_what_is_read_of_curves_left_out(operator, most):
    ratio, lines = operator_ratio(operator, 50), bottom_lines()
    assert 0.0 < ratio.sd < most
    # lines that do not bend have a ratio too, and it is that of the smallest angles
    at_rest, _ = ratio(np.zeros(1), np.array([50.0]))
    near, slope = ratio(np.array([0.01]), np.array([50.0]))
    assert at_rest == pytest.approx(near, abs=2e-3)
    step, _ = ratio(np.array([0.01 + 1e-6]), np.array([50.0]))
    assert slope == pytest.approx((step - near) / 1e-6, rel=1e-3, abs=1e-6)
    assert len(np.unique(lines.curve)) >= 20


def test_map_predicts_the_operator_and_its_slope():
    def linear(inputs):
        curvature = 0.1 * inputs.pressure
        zero = np.zeros_like(curvature)
        angle = np.degrees(curvature * 0.05)
        return Prediction(
            curvature, angle, 1.0 + zero, curvature, zero, zero, zero, zero.astype(int)
        )

    def at(pressure):
        one = np.ones(1)
        inputs = Inputs(pressure * one, 0.3 * one, 0 * one, 0 * one, one, 3e4 * one)
        return ReadByOperator(linear, "circle", 50)(inputs)

    found, step = at(100.0), at(100.0 * (1.0 + 1e-6))
    assert found.curvature == pytest.approx(11.8, abs=0.15)
    assert found.bend_angle == pytest.approx(np.degrees(0.5))
    assert found.slope == pytest.approx((step.curvature - found.curvature) / 1e-6, rel=1e-4)
    assert found.sd > 0.0


def test_settings_state_the_operator():
    settings, faults = parse_settings(b'[reading]\noperator = "circle"\npoints = 12\n')
    assert not faults
    assert (settings.reading.operator, settings.reading.points) == ("circle", 12)
    assert parse_settings(b"")[0].reading.operator is None
    _, faults = parse_settings(b'[reading]\noperator = "parabola"\n')
    assert "circle" in str(faults[0])
    _, faults = parse_settings(b'[reading]\nname = "x"\n')
    assert len(faults) == 1


def by_hand(row, count):
    """Return what Kappa reads, from the recursion of B-splines and distances one by one."""
    pieces = count - 3
    knots = np.concatenate([[0.0] * 4, np.arange(1, pieces) / pieces, [1.0] * 4])

    def basis(i, degree, u):
        if degree == 0:
            last = u == 1.0 and knots[i] < knots[i + 1] == 1.0
            return float(knots[i] <= u < knots[i + 1] or last)
        found = 0.0
        if knots[i + degree] > knots[i]:
            found += (u - knots[i]) / (knots[i + degree] - knots[i]) * basis(i, degree - 1, u)
        if knots[i + degree + 1] > knots[i + 1]:
            share = (knots[i + degree + 1] - u) / (knots[i + degree + 1] - knots[i + 1])
            found += share * basis(i + 1, degree - 1, u)
        return found

    places = np.concatenate([(k + np.linspace(0.0, 1.0, 129)) / pieces for k in range(pieces)])
    table = np.array([[basis(i, 3, u) for i in range(count)] for u in places])
    control = row[np.round(np.linspace(0, len(row) - 1, count)).astype(int)]
    mean = np.inf
    while True:
        apart = np.linalg.norm((table @ control)[:, None] - row, axis=2)
        if not apart.min(axis=1).mean() < mean:
            break
        best, mean = control, apart.min(axis=1).mean()
        given = table[apart.argmin(axis=0)]
        control = np.linalg.solve(given.T @ given, given.T @ row)
    fine = np.linspace(0.0, 1.0, 129 * 40)
    curve = np.array([[basis(i, 3, u) for i in range(count)] for u in fine]) @ best
    rate = np.gradient(curve, fine, axis=0)
    change = np.gradient(rate, fine, axis=0)
    bent = np.abs(rate[:, 0] * change[:, 1] - rate[:, 1] * change[:, 0])
    return 1e3 * np.mean(bent / np.hypot(*rate.T) ** 3)


@pytest.mark.parametrize("controls", [4, 5, 7])
def test_kappa_fits_and_averages_as_the_plugin_does(controls):
    row = evenly(bottom_lines().points[-1], 120)
    assert kappa_bend(row, controls).curvature == pytest.approx(by_hand(row, controls), rel=5e-3)


@pytest.mark.parametrize("angle", [-2.0, 0.3])
def test_kappa_reads_the_size_of_a_curvature_at_any_scale_and_side(angle):
    once = kappa_bend(arc(angle, 400), 6)
    assert once.angle == pytest.approx(abs(angle), rel=0.1)
    assert kappa_bend(2.0 * arc(-angle, 400), 6).angle == pytest.approx(once.angle, rel=1e-6)


@pytest.mark.parametrize("controls", [3, 31])
def test_kappa_needs_four_control_points_and_more_pixels(controls):
    with pytest.raises(ValueError, match="control"):
        kappa_bend(arc(1.0), controls)


@pytest.mark.parametrize("controls", [5, 6, 7, 8])
def test_error_of_kappa_holds_what_other_control_points_read(controls):
    rng = np.random.default_rng(5)
    ratio, apart = operator_ratio("kappa", controls), []
    for line in bottom_lines().points[::24]:
        row = evenly(line, 400)
        at = np.linspace(0, 399, controls)
        at[1:-1] += rng.normal(0.0, 0.15 * 399 / (controls - 1), controls - 2)
        # as many pixels, more of them where control points are closer
        uneven = np.interp(np.linspace(0, controls - 1, 400), np.arange(controls), np.sort(at))
        moved = np.column_stack([np.interp(uneven, np.arange(400), row[:, k]) for k in (0, 1)])
        apart.append(np.log(kappa_bend(moved, controls).angle / kappa_bend(row, controls).angle))
    assert np.sqrt(np.mean(np.square(apart))) < 2.0 * ratio.sd


@pytest.mark.parametrize("points", ["", "points = 4", "points = 9"])
def test_the_number_of_control_points_must_be_stated(points):
    _, faults = parse_settings(f'[reading]\noperator = "kappa"\n{points}'.encode())
    assert len(faults) == 1
    assert faults[0].column == "reading.points"


def test_a_study_states_its_control_points():
    settings, faults = parse_settings(b'[reading]\noperator = "kappa"\npoints = 6\n')
    assert not faults
    assert (settings.reading.operator, settings.reading.points) == ("kappa", 6)
