"""Motion capture recordings of a study: where they are, and what was read at each hold."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

FILE, FOLDER = "captures.csv", "captures"
"""Table and folder of a study's recordings."""
OFF_PLANE = 0.02
"""Share of the line's length by which markers may leave the bending plane without a warning. For
43 mm it is 0.9 mm, the radius of small markers; a tenth would shorten the projected length by
0.5 %."""


@dataclass(frozen=True)
class CapturedLine:
    """What was read at one hold.

    Parameters
    ----------
    file, specimen_id : str
        Recording and specimen.
    pressure : float
        From the table, or the mean of its channel [kPa].
    frames, left_out : int
        Number averaged, and number omitted because a marker was hidden.
    off_plane : float
        Distance of markers from the bending plane over the length of the line [–].
    """

    file: str
    specimen_id: str
    pressure: float
    frames: int
    left_out: int
    off_plane: float


def captured_messages(lines: Iterable[CapturedLine]) -> Iterator[str]:
    """Report omitted frames, and markers that leave the bending plane.

    Examples
    --------
    >>> list(captured_messages([CapturedLine("a.c3d", "S1", 40.0, 90, 10, 0.05)]))[0]
    'a.c3d, 40 kPa: 10 of 100 frames are left out because a marker was hidden'
    """
    for one in lines:
        place = f"{one.file}, {one.pressure:.3g} kPa"
        if one.left_out:
            whole = one.frames + one.left_out
            yield (
                f"{place}: {one.left_out} of {whole} frames are left out because a "
                "marker was hidden"
            )
        if one.off_plane > OFF_PLANE:
            yield (
                f"{place}: not sure: markers leave the bending plane by "
                f"{100.0 * one.off_plane:.0f} % of the length of the line"
            )
