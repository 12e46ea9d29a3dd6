"""What it roughly takes to train an emulator, before anything is solved."""

from math import ceil

from bayesdeg.actuator.resolution import Resolution
from bayesdeg.emulator.recipe import Recipe
from bayesdeg.measure.settings import Dimensions

# both stages, and what a curve of the default geometry takes on one core (studies/scaling.md) [s]
COARSE_CURVES, FINE_CURVES = 576, 120
COARSE_SECONDS, FINE_SECONDS = 3.3, 27.0
TRAINING_SECONDS = 65.0


def rough_seconds(dimensions: Dimensions, *, workers: int = 1) -> float:
    """Return roughly how long it takes to train an emulator of a geometry [s].

    The time of a curve is taken as proportional to the number of elements, which it exceeds for
    meshes that are wider or higher; the campaign itself measures it.

    Parameters
    ----------
    dimensions : Dimensions
        Of the actuator.
    workers : int
        Processes, each with a core of its own.

    Examples
    --------
    >>> round(rough_seconds(Dimensions()) / 60.0)
    87
    >>> rough_seconds(Dimensions(length=100.0), workers=2) > rough_seconds(Dimensions(), workers=2)
    True
    """
    recipe = Recipe()
    curves = COARSE_CURVES * COARSE_SECONDS * _size(dimensions, recipe.coarse_mesh)
    curves += FINE_CURVES * FINE_SECONDS * _size(dimensions, recipe.fine_mesh)
    return curves / max(1, workers) + TRAINING_SECONDS


def _size(dimensions: Dimensions, mesh: Resolution) -> float:
    """Return the number of elements over that of the default geometry."""
    return _elements(dimensions, mesh) / _elements(Dimensions(), mesh)


def _elements(dimensions: Dimensions, mesh: Resolution) -> int:
    along, across = ceil(dimensions.length / mesh.along), ceil(dimensions.width / 2.0 / mesh.across)
    return along * across * ceil(dimensions.height / mesh.up)


def duration(seconds: float) -> str:
    """Word a time to come in minutes.

    Examples
    --------
    >>> duration(20.0), duration(500.0), duration(9000.0)
    ('less than a minute', 'about 8 min', 'about 2 h 30 min')
    """
    if seconds < 60.0:
        return "less than a minute"
    minutes = round(seconds / 60.0)
    return f"about {minutes} min" if minutes < 60 else f"about {minutes // 60} h {minutes % 60} min"
