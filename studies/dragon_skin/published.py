"""Published moduli, COMSOL solutions and recipe of the source of the record."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from dragon_skin.causes import HIGHEST, LOWEST
from dragon_skin.marker_map import MarkerMap
from dragon_skin.record import AT_CLAMP, CASE_OF_TAKE, HELD, NOMINAL, REST, TAKES, register

Floats = NDArray[np.float64]

MODULI = {"static": 283.1, "dynamic": 293.6, "used": 263.8}  # E [kPa]

COMSOL_MODULUS = 263.824  # E [kPa]
# places of the surface points below balls 0, 1, 2 by load case [mm]; utils.py of the source
COMSOL = np.array(
    [
        [[1.0147, 15.001, 23.226], [0.51624, -0.0009737, 17.248], [-0.96361, 30.000, -0.69132]],
        [[2.0836, 15.015, 12.669], [0.46708, -0.10591, 7.1591], [-3.4292, 30.016, -10.282]],
        [[1.9954, 15.036, 2.4577], [-0.59825, -0.19764, -2.3518], [-6.7193, 30.034, -19.022]],
    ]
)
#: Take and marker from whose height alone the source's static value was found.
STATIC_TAKE, STATIC_MARKER = "load101_V2_a", 1


def recipe(record: Floats, forward: MarkerMap) -> dict[str, Any]:
    """Find E as the source did, from each take and each tip marker [kPa].

    Its recipe: the frame is the one that brings the markers of the held state closest to their
    nominal places, the weight stands on the edge, and one marker's height at rest is matched. The
    source did so with marker 1 of one take, in its own finite elements.

    Returns
    -------
    dict
        ``all_markers`` and ``clamp_markers``, by what the frame is fitted to: E by take and
        marker, nan where the solutions don't reach.
    """
    frames = {"all_markers": slice(0, 6), "clamp_markers": AT_CLAMP}
    found = {}
    for name, markers in frames.items():
        table = []
        for take, case in enumerate(CASE_OF_TAKE):
            pose = register(record[take, HELD, markers], NOMINAL[markers])
            heights = pose.back(record[take, REST])[:3, 2]
            table.append([_modulus(forward, case, k, z) for k, z in enumerate(heights)])
        found[name] = table
    value = found["all_markers"][TAKES.index(STATIC_TAKE)][STATIC_MARKER]
    values = np.array(found["all_markers"])
    return {
        "moduli_kPa": found,
        "as_published_kPa": value,
        "range_kPa": [float(np.nanmin(values)), float(np.nanmax(values))],
    }


def _modulus(forward: MarkerMap, case: int, marker: int, height: float) -> float:
    def above(c1: float) -> float:
        balls, _, _ = forward.at(np.array([c1]), np.zeros(1), {"edge_line": np.ones(1)})
        return float(balls[0, case, marker, 2]) - height

    if above(LOWEST) * above(HIGHEST) > 0.0:
        return float("nan")
    root: float = brentq(above, LOWEST, HIGHEST)
    return 6.0 * root
