"""Recordings of motion capture in a study: where they are, and what was read of each hold."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

FILE, FOLDER = "captures.csv", "captures"
"""Of a study: the table of its recordings, and the folder in which they are."""
OFF_PLANE = 0.02
"""Of the length of the line: markers that leave the plane of bending by more are said. Of 43 mm it
is 0.9 mm, the radius of small markers; a length that is projected from a tenth is 0.5 % short."""


@dataclass(frozen=True)
class CapturedLine:
    """What was read of a hold.

    Parameters
    ----------
    file, specimen_id : str
        The recording, and whose it is.
    pressure : float
        Of the table, or the mean of its channel [kPa].
    frames, left_out : int
        How many were averaged, and how many were not since a marker was not seen in them.
    off_plane : float
        How far markers are from the plane of bending, over the length of the line [–].
    """

    file: str
    specimen_id: str
    pressure: float
    frames: int
    left_out: int
    off_plane: float


def captured_messages(lines: Iterable[CapturedLine]) -> Iterator[str]:
    """Say what was left out of which holds, and which markers do not move in a plane.

    Examples
    --------
    >>> list(captured_messages([CapturedLine("a.c3d", "S1", 40.0, 90, 10, 0.05)]))[0]
    'a.c3d, 40 kPa: 10 of 100 frames are left out, in which a marker was not seen'
    """
    for one in lines:
        place = f"{one.file}, {one.pressure:.3g} kPa"
        if one.left_out:
            whole = one.frames + one.left_out
            yield (
                f"{place}: {one.left_out} of {whole} frames are left out, in which a marker was "
                "not seen"
            )
        if one.off_plane > OFF_PLANE:
            yield (
                f"{place}: not sure: markers leave the plane of bending by "
                f"{100.0 * one.off_plane:.0f} % of the length of the line"
            )
