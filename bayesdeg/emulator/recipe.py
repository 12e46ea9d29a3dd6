"""The recipe of an emulator: which meshes, how many curves, from which seed."""

from dataclasses import dataclass, field

from bayesdeg.actuator.resolution import CONVERGED, Resolution

FIRST_STAGE = (512, 96, 11)  # numbers of runs and seed for which the second stage was chosen


@dataclass(frozen=True)
class Recipe:
    """What an emulator is trained on: many curves of a coarse mesh and few of a fine one.

    Parameters
    ----------
    coarse_mesh, fine_mesh : Resolution
        The mesh of the many curves, and the one that the emulator stands for.
    coarse_runs, fine_runs : int
        Numbers of curves.
    seed : int
        Of the design.
    further : bool
        Whether the second stage follows, where the first was found least certain; it belongs to
        the default numbers and seed alone.

    Examples
    --------
    >>> Recipe().coarse_runs, Recipe().fine_runs
    (512, 96)
    """

    coarse_mesh: Resolution = field(
        default_factory=lambda: Resolution(along=2.5, across=2.5, up=2.1)
    )
    fine_mesh: Resolution = CONVERGED
    coarse_runs: int = 512
    fine_runs: int = 96
    seed: int = 11
    further: bool = True

    @property
    def has_second_stage(self) -> bool:
        """Whether further runs follow the first stage."""
        return self.further and (self.coarse_runs, self.fine_runs, self.seed) == FIRST_STAGE
