"""Motion of a ball glued to the surface."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

GLUE = 4.0  # half width of the patch that carries a ball [mm]

# points of the surface under the balls 0, 1, 2, and the axis that the surface is normal to
FEET = np.array([[0.0, 15.0, 30.0], [0.0, 0.0, 24.0], [0.0, 30.0, 6.0]])
_NORMAL = (2, 1, 1)


def _patch(foot: Floats, normal: int) -> Floats:
    """Points of the surface around a foot, which stands on the edge of the tip."""
    offsets = np.linspace(-GLUE, GLUE, 5)
    along, aside = np.meshgrid(0.5 * (offsets - GLUE), offsets, indexing="ij")
    points = np.repeat(foot[None], along.size, axis=0)
    points[:, 0] += along.ravel()
    points[:, 3 - normal] += aside.ravel()
    return points


#: Points of the surface that each ball is glued to, 4 × 8 mm, shape (3, 25, 3) [mm].
PATCHES = np.array([_patch(foot, normal) for foot, normal in zip(FEET, _NORMAL, strict=True)])


def carried(patch: Floats, moved: Floats, ball: Floats) -> tuple[Floats, Floats]:
    """Return where a ball goes with its patch, and the patch's rotation vector.

    Parameters
    ----------
    patch, moved : array, shape (n, 3)
        Points of the patch before and after [mm].
    ball : array, shape (3,)
        Centre before [mm].

    Returns
    -------
    ball, turn : array, shape (3,)
        [mm] and [rad]; the motion is the rigid one closest to the patch's.
    """
    start, end = patch.mean(axis=0), moved.mean(axis=0)
    turn, _ = Rotation.align_vectors(moved - end, patch - start)
    return end + turn.apply(ball - start), turn.as_rotvec()
