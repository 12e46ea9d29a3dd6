"""The marker record in beam axes, nominal marker positions, and camera position.

Beam axes: x along the beam from the tip (clamp at x = −100), y across from 0 to 30, z up from 0 to
30 [mm].
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

TABLE = Path(__file__).with_name("srl_beam_markers_static.csv")

LENGTH, WIDTH, HEIGHT = 100.0, 30.0, 30.0  # [mm]
CLAMP = np.array([-LENGTH, WIDTH / 2.0, HEIGHT / 2.0])  # centre of the clamped face [mm]
DENSITY = 1070.0  # [kg/m³]
GRAVITY = 9.80709  # as the source has it [m/s²]

CASES = ("self-weight", "self-weight + 0.510 N", "self-weight + 1.001 N")
TIP_LOADS = (0.0, 0.51012, 1.00062)  # [N]
TAKES = (
    "gravity_V2_a",
    "gravity_V2_b",
    "load52_V2_a",
    "load52_V2_b",
    "load101_V2_a",
    "load101_V2_b",
)
CASE_OF_TAKE = np.array([0, 0, 1, 1, 2, 2])
HELD, REST = 0, 1

# ball centres [mm]: 0, 1, 2 move with the tip; 3, 4, 5 sit at the clamp
NOMINAL = np.array(
    [
        [0.0, 15.0, 36.0],
        [0.0, -6.0, 24.0],
        [0.0, 36.0, 6.0],
        [-94.0, -10.0, -1.0],
        [-94.0, 40.0, 27.5],
        [-94.0, 40.0, 0.0],
    ]
)
TIP, AT_CLAMP = slice(0, 3), slice(3, 6)

# the camera's vertical, across and along as beam axes: along, −across, vertical
_CAMERA_TO_BEAM = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Pose:
    """Where the beam stands before the camera: position = rotation · (beam coordinates) + shift.

    Parameters
    ----------
    rotation : array, shape (..., 3, 3)
        From beam axes to the camera's axes turned along them.
    shift : array, shape (..., 3)
        [mm].
    """

    rotation: Floats
    shift: Floats

    def back(self, points: Floats) -> Floats:
        """Return points (..., 3) of the camera in beam coordinates [mm]."""
        return (points - self.shift) @ self.rotation


def read(table: Path = TABLE) -> Floats:
    """Return marker positions along beam axes, origin the camera's, (take, state, marker, 3) [mm].

    States: held near the undeformed shape, at rest under load.
    """
    rows = pd.read_csv(table, comment="#").set_index(["file", "marker"])
    columns = [[f"{axis}_{state}" for axis in "xyz"] for state in ("first", "last")]
    take = [
        [rows.loc[f"srl_beam/beam_{name}.c3d"].sort_index()[three].to_numpy() for three in columns]
        for name in TAKES
    ]
    positions: Floats = np.array(take) @ _CAMERA_TO_BEAM.T
    return positions


def register(points: Floats, places: Floats) -> Pose:
    """Return the pose that carries places (n, 3) closest to points (n, 3), by least squares.

    Kabsch, W. (1976), Acta Cryst. A 32:922, doi:10.1107/S0567739476001873.
    """
    rotation, _ = Rotation.align_vectors(points - points.mean(axis=0), places - places.mean(axis=0))
    matrix: Floats = rotation.as_matrix()
    return Pose(matrix, points.mean(axis=0) - matrix @ places.mean(axis=0))


def repeat_scatter(record: Floats) -> dict[str, list[float]]:
    """Return the root mean square change from repeat a to repeat b by load case [mm].

    Over three coordinates of three markers, for tip and clamp markers, held and at rest.
    """
    change = record[1::2] - record[::2]
    groups = {"tip": TIP, "clamp": AT_CLAMP}
    return {
        f"{name} markers, {words}": np.sqrt(
            np.mean(change[:, state, markers] ** 2, axis=(1, 2))
        ).tolist()
        for name, markers in groups.items()
        for state, words in ((HELD, "held"), (REST, "at rest"))
    }
