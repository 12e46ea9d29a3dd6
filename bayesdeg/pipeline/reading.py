"""A study folder with every kind of data that there is a file for."""

from pathlib import Path

from bayesdeg.data import study as folders
from bayesdeg.data.study import Study
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.markers import with_lines


def read_study(folder: Path | str) -> Study:
    """Read a study folder and check everything in it; lines of points become curvatures.

    Parameters
    ----------
    folder : Path or str
        Holds ``study.toml`` and at least one of the data files.

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
    return with_lines(folders.read_study(folder, TABLES))
