"""A study folder with every kind of data that there is a file for."""

import importlib
from pathlib import Path

from bayesdeg.data import study as folders
from bayesdeg.data.foreign import ForeignTable
from bayesdeg.data.settings import FILE, CaptureOptions, PhotographOptions
from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.markers import with_lines
from bayesdeg.pipeline.progress import Progress, Silent


def read_study(folder: Path | str, progress: Progress | None = None) -> Study:
    """Read a study folder and check everything in it; lines of points become curvatures.

    Recordings of motion are averaged over the frames of each hold, a second for a few of them.
    Photographs are traced, which takes about a second each; what was traced is kept in
    ``.cache/traces``.

    Parameters
    ----------
    folder : Path or str
        Holds ``study.toml`` and at least one of the data files.
    progress : Progress, optional
        Shows the tracing of photographs.

    Returns
    -------
    Study

    Raises
    ------
    StudyError
        With every fault of every file.

    Examples
    --------
    >>> read_study("studies/treloar").tensile["mode"].unique().tolist()
    ['uniaxial', 'equibiaxial', 'planar']
    """
    study = folders.read_study(folder, TABLES)
    _refuse_options_of_nothing(study)
    if study.table("captures") is None and study.table("photos") is None:
        return with_lines(study)
    # bring scipy's splines and OpenCV along, which no other study needs
    if study.table("captures") is not None:
        reader = importlib.import_module("bayesdeg.pipeline.captured").with_captures
    else:
        reader = importlib.import_module("bayesdeg.pipeline.traced").with_photographs
    found: Study = reader(study, progress or Silent())
    return found


def _refuse_options_of_nothing(study: Study) -> None:
    """Refuse what is said of photographs or points where there are none: a file is misnamed."""
    settings = study.settings
    of_files = (
        ("photographs", settings.photographs, PhotographOptions(), "photos", "photos.csv"),
        ("markers", settings.markers, ForeignTable(), "markers", "markers.csv"),
        ("captures", settings.captures, CaptureOptions(), "captures", "captures.csv"),
    )
    faults = [
        Fault(FILE, f"is given without {file}", f"add {file}, or leave [{key}] out", None, key)
        for key, stated, nothing, table, file in of_files
        if stated != nothing and study.table(table) is None
    ]
    if faults:
        raise StudyError(faults)
