"""Every figure of a report: those that the modules of this package list as ``FIGURES``."""

import importlib
import pkgutil

from bayesdeg.report.drawing import Drawing, PageFigure, Shown
from bayesdeg.report.left_out import Guard, figure_stage


def _discover() -> dict[str, PageFigure]:
    package = importlib.import_module(__package__)
    names = (f"{package.__name__}.{entry.name}" for entry in pkgutil.iter_modules(package.__path__))
    modules = [importlib.import_module(name) for name in names if name != __name__]
    return {figure.name: figure for module in modules for figure in module.FIGURES}


#: Every figure by its name in the page.
FIGURES: dict[str, PageFigure] = _discover()


def drawings_of(shown: Shown, guard: Guard | None = None) -> dict[str, Drawing]:
    """Draw every figure for which the run has data.

    Parameters
    ----------
    shown : Shown
        What the run found.
    guard : Guard, optional
        Leaves out figures that fail; by default nothing is left out and faults are raised.

    Returns
    -------
    dict
        By name; those without data are left out.
    """
    guard = guard or Guard(strict=True)
    drawn = (
        guard.attempt(figure_stage(name), figure.drawing, shown) for name, figure in FIGURES.items()
    )
    return {drawing.name: drawing for drawing in drawn if drawing is not None}
