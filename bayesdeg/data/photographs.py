"""Traced photographs: points in pixels, their conversion to mm, and the resulting readings."""

from collections.abc import Iterable, Iterator

import pandas as pd
from pydantic import Field

from bayesdeg.records import FileRecord, Names, Text

type Places = tuple[tuple[float, float], ...]
type Homography = tuple[tuple[float, float, float], ...]

FILE, FOLDER = "photos.csv", "photos"
"""Table and folder of a study's photographs."""


class TracedPhotograph(FileRecord):
    """A photograph and its traced bottom line, or why there is none."""

    file: Text = Field(default="", description="name of the photograph")
    place: Text = Field(default="", description="path of the photograph relative to this file")
    sha256: Text = Field(default="", description="SHA-256 of the photograph")
    refused: Text = Field(default="", description="why nothing was traced; empty if a line was")
    specimen_id: Text = Field(default="", description="the specimen")
    pressure: float | None = Field(default=None, description="gauge pressure [kPa]")
    degradation: float | None = Field(default=None, description="degradation rate [%]")
    width: int = Field(default=0, description="width of the upright photograph [px]")
    height: int = Field(default=0, description="height of the upright photograph [px]")
    pixels: Places = Field(default=(), description="points on the line from the clamp [px]")
    points: Places = Field(
        default=(),
        description="the same points, x along the clamped end, y away from the paper [mm]",
    )
    errors: Places = Field(default=(), description="standard errors of the points [mm]")
    seen: tuple[bool, ...] = Field(
        default=(), description="points at which an edge was found; others are interpolated"
    )
    to_mm: Homography = Field(default=(), description="rows of the homography from pixels to mm")
    bend_angle_deg: float = Field(default=0.0, description="bend angle towards the paper [deg]")
    bend_angle_error_deg: float = Field(default=0.0, description="its standard error [deg]")
    bent_ends: float = Field(
        default=0.0,
        description="probability that the line bends up to its ends: from 0.5 on the angle is "
        "taken between end tangents, below that between straight lines through stiff ends",
    )
    curvature_per_m: float = Field(default=0.0, description="curvature: angle over length [1/m]")
    curvature_error_per_m: float = Field(default=0.0, description="its standard error [1/m]")
    length_mm: float = Field(default=0.0, description="length of the line [mm]")
    scale_from: Text = Field(default="", description="source of the scale")
    not_sure: Names = Field(default=(), description="what a person should check")
    corrected: bool = Field(default=False, description="whether a person moved points")

    @property
    def about(self) -> dict[str, object]:
        """Table columns that describe the photograph."""
        return {
            "specimen_id": self.specimen_id,
            "pressure_kPa": self.pressure,
            "degradation_pct": self.degradation,
        }


def trace_rows(photographs: Iterable[TracedPhotograph]) -> pd.DataFrame:
    """Return one row per photograph: its readings, or why there are none."""
    read = (
        *("bend_angle_deg", "bend_angle_error_deg", "bent_ends"),
        *("curvature_per_m", "curvature_error_per_m", "length_mm"),
    )
    return pd.DataFrame(
        {
            "file": one.file,
            **one.about,
            **{name: None if one.refused else getattr(one, name) for name in read},
            "scale_from": one.scale_from,
            "not_sure": "; ".join(one.not_sure),
            "refused": one.refused,
            "corrected": int(one.corrected),
        }
        for one in photographs
    )


def messages(photographs: Iterable[TracedPhotograph]) -> Iterator[str]:
    """Say which photographs are left out and why, and what is not sure about the others.

    Examples
    --------
    >>> list(messages([TracedPhotograph(file="a.jpg", refused="it shows nothing")]))
    ['a.jpg is left out: it shows nothing']
    """
    for one in photographs:
        if one.refused:
            yield f"{one.file} is left out: {one.refused}"
        for doubt in one.not_sure:
            yield f"{one.file}: not sure: {doubt}"
