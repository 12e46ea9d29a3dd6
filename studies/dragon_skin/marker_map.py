"""Equilibrium positions of the tip markers, interpolated between finite element solutions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarkerMap:
    """Rest positions of the balls as polynomials in ln C1 and pitch, linear in the other effects.

    Parameters
    ----------
    log_c1 : array, shape (n_c1,)
        ln(C1/kPa) at Chebyshev's points of the second kind, rising.
    pitch : array, shape (n_pitch,)
        Angle of the beam below the horizontal [°].
    ball : array, shape (n_c1, n_pitch, 3 cases, 3 markers, 3)
        Ball centres in beam axes [mm].
    turn : array, shape (n_c1, n_pitch, 3 cases, 3 markers, 3)
        Rotation vector of the surface below each ball [rad].
    moment : array, shape (n_c1, n_pitch, 3 cases)
        Bending moment at the clamp [N mm].
    slopes : dict of array, shape (n_c1, 3 cases, 3 markers, 6)
        Derivatives of ball and turn by effect, per unit of the effect.
    """

    log_c1: Floats
    pitch: Floats
    ball: Floats
    turn: Floats
    moment: Floats
    slopes: Mapping[str, Floats]

    def covers(self, c1: Floats, pitch: Floats) -> NDArray[np.bool_]:
        """Return where values lie within the solved range."""
        log_c1 = np.log(c1)
        inside = (log_c1 >= self.log_c1[0]) & (log_c1 <= self.log_c1[-1])
        return np.asarray(
            inside & (pitch >= self.pitch[0]) & (pitch <= self.pitch[-1]), dtype=np.bool_
        )

    def at(
        self, c1: Floats, pitch: Floats, effects: Mapping[str, Floats]
    ) -> tuple[Floats, Floats, Floats]:
        """Return balls (n, 3 cases, 3 markers, 3), turns likewise, and moments (n, 3 cases).

        Parameters
        ----------
        c1, pitch : array, shape (n,)
            [kPa] and [°].
        effects : dict of array, shape (n,)
            Those not named are none.
        """
        along = lagrange_weights(self.log_c1, np.log(c1))
        across = lagrange_weights(self.pitch, pitch)
        both = np.einsum("nk,np->nkp", along, across).reshape(len(along), -1)
        ball, turn = (both @ x.reshape(both.shape[1], -1) for x in (self.ball, self.turn))
        moment = both @ self.moment.reshape(both.shape[1], -1)
        shape = (-1, *self.ball.shape[2:])
        fields = np.concatenate([ball.reshape(shape), turn.reshape(shape)], axis=-1)
        for name, size in effects.items():
            slope = (along @ self.slopes[name].reshape(len(self.log_c1), -1)).reshape(fields.shape)
            fields = fields + size[:, None, None, None] * slope
        return fields[..., :3], fields[..., 3:], moment


def chebyshev_points(low: float, high: float, number: int) -> Floats:
    """Return Chebyshev's points of the second kind between two values, both included, rising.

    Examples
    --------
    >>> chebyshev_points(0.0, 2.0, 3).round(12).tolist()
    [0.0, 1.0, 2.0]
    """
    angle = np.pi * np.arange(number) / (number - 1)
    points: Floats = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(angle)
    points[0], points[-1] = low, high
    return points


def lagrange_weights(nodes: Floats, at: Floats) -> Floats:
    """Return the value at each point (n,) of the polynomial that is 1 at one node: (n, n_nodes).

    Examples
    --------
    >>> lagrange_weights(np.array([0.0, 1.0]), np.array([0.25])).tolist()
    [[0.75, 0.25]]
    """
    gaps = nodes[:, None] - nodes
    np.fill_diagonal(gaps, 1.0)
    ratios = (at[:, None, None] - nodes) / gaps
    ratios[:, np.arange(len(nodes)), np.arange(len(nodes))] = 1.0
    weights: Floats = np.prod(ratios, axis=-1)
    return weights
