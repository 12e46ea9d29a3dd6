"""A few photographs of a study for its report, cropped to the actuator, with lines.

The measured line is the traced one. A predicted line begins at the clamp, is as long as the
measured one, and bends by the predicted reading; between its ends it has the shape of the finite
element model.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL import Image

from bayesdeg.actuator.inputs import paper_group_of
from bayesdeg.actuator.line import MILLIMETRES_PER_METRE
from bayesdeg.actuator.reading import line_of_reading
from bayesdeg.analysis.calibrate import Fit
from bayesdeg.data.levels import levels
from bayesdeg.data.photographs import FOLDER, TracedPhotograph
from bayesdeg.data.settings import Operator
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError
from bayesdeg.files import read_bytes
from bayesdeg.pages.folder import PICTURES, RunFolder
from bayesdeg.pages.tables import PHOTO_LINES, TABLES
from bayesdeg.run.deformed import fitted_inputs
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.plane import mapped
from bayesdeg_camera.tracing.record import hash_of
from bayesdeg_camera.tracing.trace import PHOTO_MB, into_frame

Floats = NDArray[np.float64]

#: Most photographs per degradation rate, if there are few rates.
OF_A_RATE = 3
#: Margin around the line, as a share of its extent.
ROOM = 0.4
#: Longer side of a picture [px] and its JPEG quality: six such pictures keep a page small.
SIDE, QUALITY = 520, 78
#: Every n-th point of a traced line is drawn.
EVERY = 3


@dataclass(frozen=True)
class Picture:
    """A crop of a photograph.

    Parameters
    ----------
    name : str
        Of its file in the run folder.
    number : int
        Of the photograph among those of the study.
    photograph : TracedPhotograph
        With its line.
    """

    name: str
    number: int
    photograph: TracedPhotograph

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the cut around the line, wider than high [px]."""
        pixels = np.array(self.photograph.pixels)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        half = np.full(2, (0.5 + ROOM) * float(np.max(high - low)))
        half[1] *= 0.8
        half = np.maximum(half, (0.5 + 0.5 * ROOM) * (high - low))
        size = np.array([self.photograph.width, self.photograph.height])
        middle = 0.5 * (low + high)
        left, top = np.clip(middle - half, 0.0, size).astype(int).tolist()
        right, bottom = np.clip(middle + half, 0.0, size).astype(int).tolist()
        return left, top, right, bottom

    @property
    def scale(self) -> float:
        """Of the picture to the photograph."""
        left, top, right, bottom = self.box
        return min(1.0, SIDE / max(right - left, bottom - top))

    def placed(self, pixels: Floats) -> Floats:
        """Return points of the photograph in the picture [px]."""
        found: Floats = (pixels - np.array(self.box[:2])) * self.scale
        return found


def pictures_of(study: Study) -> tuple[Picture, ...]:
    """Return crops of a few photographs: of every degradation rate, at high pressures."""
    known = [(i, one) for i, one in enumerate(study.photographs) if not one.refused]
    if not known:
        return ()
    rates = np.array([one.degradation or 0.0 for _, one in known])
    pressures = np.array([one.pressure or 0.0 for _, one in known])
    _, member = levels(rates)
    every = np.unique(member)
    shown = every[np.unique(np.linspace(0, len(every) - 1, len(PICTURES)).round().astype(int))]
    each = min(OF_A_RATE, max(1, len(PICTURES) // len(shown)))
    chosen: list[int] = []
    for rate in shown:
        own = np.flatnonzero(member == rate)
        own = own[np.argsort(-pressures[own], kind="stable")]
        at = np.arange(each) * len(own) // each
        chosen += own[np.unique(at)].tolist()
    return tuple(Picture(name, *known[i]) for name, i in zip(PICTURES, chosen, strict=False))


def lines_of(study: Study, readings: pd.DataFrame | None, fits: Mapping[str, Fit]) -> pd.DataFrame:
    """Return the lines on the pictures of a study, one row per point: the table ``photo_lines``.

    Parameters
    ----------
    study : Study
        With photographs.
    readings : DataFrame, optional
        Table ``observations``, with what the models predict of the readings.
    fits : mapping of str to Fit
        The fit of each model.
    """
    operator: Operator = study.settings.reading.operator or "angle_over_arc"
    photos, pictures = study.table("photos"), pictures_of(study)
    assert photos is not None
    groups = {model: paper_groups(fit, pictures) for model, fit in fits.items()}
    frames = []
    for number, picture in enumerate(pictures):
        one, row = picture.photograph, photos.iloc[picture.number]
        pixels = np.array(one.pixels)
        measured, predicted = np.nan, dict[str, float]()
        if readings is not None:
            keys = ("specimen_id", "pressure_kPa", "branch", "cycle")
            own = readings[np.logical_and.reduce([readings[key] == row[key] for key in keys])]
            first = own.drop_duplicates("model").set_index("model")
            predicted = {str(model): float(mean) for model, mean in first["mean_per_m"].items()}
            measured = np.nan if first.empty else float(first["curvature_per_m"].iloc[0])
        if not np.isfinite(measured):
            measured = one.curvature_per_m
        frames.append(_rows(picture, "measured", measured, pixels[::EVERY]))
        for model, curvature in predicted.items():
            angle, group = curvature * one.length_mm / MILLIMETRES_PER_METRE, groups[model][number]
            points = study.line_points or len(pixels)
            line = line_of_reading(angle, one.length_mm, float(group), operator, points)
            # a traced line starts along the clamped end; the model's line leaves it at a small
            # angle
            line = mapped(into_frame(line), line)
            to_pixels = np.linalg.inv(np.array(one.to_mm))
            frames.append(_rows(picture, model, curvature, mapped(to_pixels, line)))
    if not frames:
        return TABLES[PHOTO_LINES].empty()
    return pd.concat(frames, ignore_index=True)


def paper_groups(fit: Fit, pictures: tuple[Picture, ...]) -> Floats:
    """Return the paper's group of a fitted actuator at the rates of pictures, (n_pictures,) [mm].

    At posterior medians, including causes that change it.
    """
    rates = np.array([one.photograph.degradation or 0.0 for one in pictures])
    pressures = np.array([one.photograph.pressure or 0.0 for one in pictures])
    groups = paper_group_of(fitted_inputs(fit, rates, pressures))
    found: Floats = np.broadcast_to(groups, (1, len(rates), len(rates)))[0].diagonal()
    return found


def _rows(picture: Picture, line: str, curvature: float, pixels: Floats) -> pd.DataFrame:
    x, y = picture.placed(pixels).round(1).T
    about = {"picture": picture.name, "file": picture.photograph.file, **picture.photograph.about}
    return pd.DataFrame({**about, "line": line, "curvature_per_m": curvature, "x_px": x, "y_px": y})


def write_pictures(folder: RunFolder, study: Study) -> None:
    """Write the pictures of a study into a run folder.

    Raises
    ------
    BayesdegError
        If a photograph has changed since it was traced.
    """
    for picture in pictures_of(study):
        one = picture.photograph
        content = read_bytes(study.folder / FOLDER / one.file, most_mb=PHOTO_MB)
        if hash_of(content) != one.sha256:
            raise BayesdegError(f"{one.file}: it has changed since it was traced; run again")
        image = Image.fromarray(read_picture(one.file, content)[:, :, ::-1]).crop(picture.box)
        size = [max(1, round(picture.scale * side)) for side in image.size]
        written = io.BytesIO()
        image.resize((size[0], size[1]), Image.Resampling.LANCZOS).save(
            written, "JPEG", quality=QUALITY, optimize=True
        )
        folder.write_picture(picture.name, written.getvalue())
