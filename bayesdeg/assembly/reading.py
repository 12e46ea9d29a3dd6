"""Reading a study folder with every kind of data."""

from pathlib import Path

from bayesdeg.data import study as folders
from bayesdeg.data.foreign import ForeignTable
from bayesdeg.data.settings import FILE, CaptureOptions, PhotographOptions
from bayesdeg.data.study import OF_LINES, Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.extras import camera
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.markers import with_lines
from bayesdeg.progress import Progress, Silent


def read_study(folder: Path | str, progress: Progress | None = None) -> Study:
    """Read and check a study folder; lines of points become curvatures.

    Motion recordings are averaged over the frames of each hold, which takes about a second for a
    few of them. Photographs are traced, which takes about a second each; traces are kept in
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
        With every fault of every file; or if photographs or recordings need the camera extra.

    Examples
    --------
    >>> read_study("studies/treloar").tensile["mode"].unique().tolist()
    ['uniaxial', 'equibiaxial', 'planar']
    """
    study = folders.read_study(folder, TABLES)
    _refuse_options_of_nothing(study)
    for name in ("captures", "photos"):
        if study.table(name) is not None:
            found: Study = camera(name, OF_LINES[name])(study, progress or Silent())
            return found
    return with_lines(study)


def _refuse_options_of_nothing(study: Study) -> None:
    """Refuse settings for photographs or points without such files: a file may be misnamed."""
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
