r"""Forward maps that predict readings by a stated operator.

Maps predict the contract's curvature, the bend angle of the end faces over the arc length. Any
other operator's reading of the same shape is a ratio to it, since shapes are similar: with θ the
bend angle and g = E t/(C1 s) the paper's group,

.. math:: \ln \frac{\kappa_\text{op}}{\kappa} = \sum_{i + j \le 3} a_{ij} \theta^i \ln^j g .

If the bend angle was read from the same points, its ratio to the rotation of the end faces has the
same form. Ratios are fitted to bottom lines of finite element curves of the default actuator,
sampled at as many evenly spaced points as were read; the error on curves left out of the fit is
added to the standard error of the map.
"""

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import (
    ForwardMap,
    Inputs,
    Prediction,
    continuation,
    paper_group_of,
    relative_to_reference,
)
from bayesdeg.actuator.line import MILLIMETRES_PER_METRE, Bend, kappa_bend, read_line, splines
from bayesdeg.data.settings import Operator

Floats = NDArray[np.float64]

LINES = "lines.npz"
_ORDER = 3
_POWERS = tuple((i, j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i))
_USUAL_GROUP = 50.0  # [mm], scales the paper's group to about 1


@dataclass(frozen=True)
class BottomLines:
    """Bottom lines of finite element curves of the default actuator.

    ``python benchmarks/bottom_lines.py`` generates the shipped ones.

    Parameters
    ----------
    curve : array of int, shape (n,)
        Curve of each line.
    bend_angle, arc_length, paper_group : array, shape (n,)
        Rotation of the free end face [rad], length of the line [mm], E t/(C1 s) [mm].
    points : array, shape (n, n_nodes, 2)
        (x, z) of the nodes [mm].
    """

    curve: NDArray[np.int64]
    bend_angle: Floats
    arc_length: Floats
    paper_group: Floats
    points: Floats


@cache
def bottom_lines() -> BottomLines:
    """Return the lines shipped with the package.

    Examples
    --------
    >>> bottom_lines().points.shape[1:]
    (49, 2)
    """
    with np.load(str(files(__package__) / LINES), allow_pickle=False) as stored:
        return BottomLines(**{name: stored[name] for name in stored.files})


@dataclass(frozen=True)
class OperatorRatio:
    """An operator's reading over the contract's curvature, or bend angle.

    Parameters
    ----------
    coefficients : array, shape (10,)
        Coefficients of ln ratio.
    sd : float
        Root mean square error on curves left out of the fit [–]; for Kappa, plus that of where its
        control points are set.
    largest_angle : float
        Largest angle of the lines [rad]; beyond it the ratio is constant.
    """

    coefficients: Floats
    sd: float
    largest_angle: float

    def __call__(self, angle: Floats, paper_group: Floats) -> tuple[Floats, Floats]:
        """Return the ratio and its derivative with respect to the angle [rad], broadcast."""
        inside = np.clip(np.abs(angle), 0.0, self.largest_angle)
        group = np.log(paper_group / _USUAL_GROUP)
        terms = zip(self.coefficients, _POWERS, strict=True)
        log_ratio, slope = np.zeros(np.broadcast_shapes(inside.shape, group.shape)), 0.0
        for a, (i, j) in terms:
            log_ratio = log_ratio + a * inside**i * group**j
            slope = slope + (a * i * inside ** (i - 1) * group**j if i else 0.0)
        ratio: Floats = np.exp(log_ratio)
        moves = (np.abs(angle) < self.largest_angle) * np.sign(angle)
        return ratio, ratio * slope * moves


@cache
def operator_ratio(operator: Operator, points: int, *, of_angle: bool = False) -> OperatorRatio:
    """Fit the ratio of an operator with a number of points: of curvature, or of the angle.

    Examples
    --------
    >>> ratio = operator_ratio("circle", 50)
    >>> float(ratio(np.array(0.5), np.array(50.0))[0].round(2)), ratio.sd < 2e-3
    (1.18, True)
    """
    lines = bottom_lines()
    bends = [read_shape(line, operator, points) for line in lines.points]
    read = np.array([bend.angle if of_angle else bend.curvature for bend in bends])
    length = 1.0 if of_angle else lines.arc_length / MILLIMETRES_PER_METRE
    log_ratio = np.log(read * length / lines.bend_angle)
    group = np.log(lines.paper_group / _USUAL_GROUP)
    design = np.stack([lines.bend_angle**i * group**j for i, j in _POWERS], axis=1)
    missed = np.empty(len(design))
    for curve in np.unique(lines.curve):
        out = lines.curve == curve
        fitted = np.linalg.lstsq(design[~out], log_ratio[~out], rcond=None)[0]
        missed[out] = log_ratio[out] - design[out] @ fitted
    whole = np.linalg.lstsq(design, log_ratio, rcond=None)[0]
    by_hand = _SET_BY_HAND if operator == "kappa" else 0.0
    sd = float(np.hypot(np.sqrt(np.mean(missed**2)), by_hand))
    return OperatorRatio(whole, sd, float(lines.bend_angle.max()))


_SET_BY_HAND = 0.03
"""Standard deviation of Kappa's reading when control points are displaced by 15 % of their spacing
along the line and 0.5 mm across it, for 5 to 8 of them: 2.0 to 3.4 %."""


def read_shape(line: Floats, operator: Operator, points: int) -> Bend:
    """Return an operator's reading of a whole line, given as evenly spaced points.

    Kappa gets the whole line, and the number is that of its control points.

    Examples
    --------
    >>> line, angle = bottom_lines().points[-1], bottom_lines().bend_angle[-1]
    >>> given = (("circle", 50), ("kappa", 5))
    >>> [float(round(read_shape(line, *one).angle / angle, 2)) for one in given]
    [1.18, 1.07]
    """
    if operator == "kappa":
        return kappa_bend(evenly(line, _PIXELS), points)
    return read_line(evenly(line, points), operator)


_PIXELS = 400  # of a line in a photograph; twice as many change Kappa's reading by at most 0.6 %


def evenly(line: Floats, count: int) -> Floats:
    """Return evenly spaced points of the cubic spline through a line, (count, 2) [mm].

    Examples
    --------
    >>> evenly(np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0]]), 5)[:, 0].tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0]
    """
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    found: Floats = splines().CubicSpline(arc, line)(np.linspace(0.0, arc[-1], count))
    return found


def line_of_reading(
    angle: float, length: float, paper_group: float, operator: Operator, points: int
) -> Floats:
    r"""Return the model's bottom line that gives an operator's bend angle, (n, 2) [mm].

    Shapes are similar: with θ the rotation of the end face, l the logarithm of the paper's group
    and φ(s) the direction along the line, φ/θ is fitted at every s by a polynomial of second order
    in θ and l, to the shipped finite element lines.

    ``angle`` is the bend angle as the operator reads it [rad] from a number of points, ``length``
    that of the line [mm], and ``paper_group`` is E t/(C1 s) [mm].

    Examples
    --------
    >>> line = line_of_reading(0.7, 43.0, 50.0, "circle", 50)
    >>> line[0].tolist(), round(read_line(evenly(line, 50), "circle").angle, 4)
    ([0.0, 0.0], 0.7)
    """
    turned = abs(angle)
    for _ in range(_TRIES):
        terms = _shape_terms(np.array([turned]), np.array([paper_group]))
        headings = turned * (terms @ _shape_coefficients())[0]
        steps = length / len(headings) * np.column_stack([np.cos(headings), -np.sin(headings)])
        line = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        read = read_shape(line, operator, points).angle
        if read <= 0.0 or abs(read - abs(angle)) < _CLOSE:
            break
        turned *= abs(angle) / read
    return line * [1.0, -1.0 if angle < 0.0 else 1.0]


_TRIES, _CLOSE = 30, 1e-6


def _shape_terms(angle: Floats, paper_group: Floats) -> Floats:
    group = np.log(paper_group / _USUAL_GROUP)
    powers = (np.ones_like(angle), angle, angle**2, group, group**2, angle * group)
    return np.stack(powers, axis=1)


@cache
def _shape_coefficients() -> Floats:
    lines = bottom_lines()
    steps = np.diff([evenly(line, lines.points.shape[1]) for line in lines.points], axis=1)
    headings = np.unwrap(np.arctan2(-steps[..., 1], steps[..., 0]), axis=1)
    share = headings / lines.bend_angle[:, None]
    terms = _shape_terms(lines.bend_angle, lines.paper_group)
    found: Floats = np.linalg.lstsq(terms, share, rcond=None)[0]
    return found


@dataclass(frozen=True)
class ReadByOperator:
    """A forward map whose curvature is an operator's reading of points on the bottom line.

    Parameters
    ----------
    mechanics : ForwardMap
        Predicts the contract's curvature of the default actuator.
    operator : str
        Of `bayesdeg.actuator.line.OPERATORS`; ``angle_over_arc`` from points alone.
    points : int
        Number of evenly spaced points along the line.
    with_angle : bool
        Whether the bend angle is also the operator's reading, not that of the end faces.
    """

    mechanics: ForwardMap
    operator: Operator
    points: int
    with_angle: bool = False

    def __call__(self, inputs: Inputs) -> Prediction:
        """Return the prediction of the mechanics with the curvature as read."""
        if inputs.reference_pressure is not None:
            return relative_to_reference(self, inputs)
        found, ratio = self.mechanics(inputs), operator_ratio(self.operator, self.points)
        angle = np.radians(found.bend_angle)
        group = paper_group_of(inputs)
        gain, change = ratio(angle, group)
        if self.with_angle:
            of_angle = operator_ratio(self.operator, self.points, of_angle=True)
            larger, _ = of_angle(angle, group)
            error = np.hypot(found.bend_angle_sd, of_angle.sd * found.bend_angle)
            found = replace(
                found, bend_angle=larger * found.bend_angle, bend_angle_sd=larger * error
            )
        return replace(
            found,
            curvature=gain * found.curvature,
            slope=(gain + change * angle) * found.slope,
            sd=gain * np.hypot(found.sd, ratio.sd * found.curvature),
        )

    def continued(self, inputs: Inputs) -> Prediction:
        """Return the same for the extrapolating map."""
        return replace(self, mechanics=continuation(self.mechanics))(inputs)


def as_read(
    forward: ForwardMap, operator: Operator | None, points: int, *, of_line: bool = False
) -> ForwardMap:
    """Return the map that predicts readings by the operator stated in a study, if any.

    For the contract's curvature this is the map itself, unless curvature and angle were both read
    ``of_line``, from points alone.

    Examples
    --------
    >>> def mechanics(inputs): ...
    >>> as_read(mechanics, None, 50) is mechanics
    True
    >>> as_read(mechanics, "circle", 12).points
    12
    """
    if of_line:
        return ReadByOperator(forward, operator or "angle_over_arc", points, with_angle=True)
    if operator is None or operator == "angle_over_arc":
        return forward
    return ReadByOperator(forward, operator, points)


def mechanics_of(forward: ForwardMap | None) -> ForwardMap | None:
    """Return the map of the mechanics alone, without a reading operator."""
    return forward.mechanics if isinstance(forward, ReadByOperator) else forward
