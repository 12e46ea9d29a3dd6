"""Optional parts of the package, found by entry point and loaded when they are needed."""

from importlib.metadata import entry_points
from typing import Any

from bayesdeg.errors import Fault, StudyError

CAMERA, PACKAGE = "bayesdeg.camera", "bayesdeg_camera"


def camera(name: str, needed_by: str) -> Any:
    """Return what the camera extra provides under a name.

    Parameters
    ----------
    name : str
        An entry point of the group ``bayesdeg.camera``.
    needed_by : str
        The file or command that needs it, for the message.

    Raises
    ------
    StudyError
        If the extra, or a library of it, is not installed.
    """
    missing: str | None = PACKAGE
    for entry in entry_points(group=CAMERA, name=name):
        try:
            return entry.load()
        except ModuleNotFoundError as fault:
            missing = fault.name
    problem = f"needs the camera extra, which is not installed ({missing} is missing)"
    raise StudyError([Fault(needed_by, problem, "run: pip install 'bayesdeg[camera]'")])
