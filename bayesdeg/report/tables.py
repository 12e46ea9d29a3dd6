"""All tables of a run folder at once; those that are absent or have no rows are None.

The surface of the solved actuators comes with them.
"""

from dataclasses import dataclass, fields

import pandas as pd

from bayesdeg.report.actuator_files import read_surface
from bayesdeg.report.actuator_surface import Surface
from bayesdeg.report.columns import (
    BANDS,
    CONSTANTS,
    COURSE,
    DECISIONS,
    DISCREPANCY,
    ELONGATION,
    GAIN,
    GAIN_LEVELS,
    GAIN_MODES,
    LEAVE_ONE_OUT,
    LEVELS,
    LOO_PIT,
    MEASURED,
    MISFIT_NULL,
    OBSERVATIONS,
    ORDERS,
    PARAMETERS,
    PRIOR_PREDICTIVE,
    PRIOR_SENSITIVITY,
    RUPTURE,
    STATISTICS,
    TENSILE,
)
from bayesdeg.report.folder import RunFolder
from bayesdeg.report.summaries import present


@dataclass(frozen=True)
class Tables:
    """The tables of a run and its solved actuators, each None if there is nothing of its kind."""

    gain: pd.DataFrame | None
    bands: pd.DataFrame | None
    rupture: pd.DataFrame | None
    observations: pd.DataFrame | None
    tensile: pd.DataFrame | None
    constants: pd.DataFrame | None
    parameters: pd.DataFrame | None
    levels: pd.DataFrame | None
    elongation: pd.DataFrame | None
    measured: pd.DataFrame | None
    misfit_null: pd.DataFrame | None
    leave_one_out: pd.DataFrame | None = None
    prior_sensitivity: pd.DataFrame | None = None
    prior_predictive: pd.DataFrame | None = None
    course: pd.DataFrame | None = None
    orders: pd.DataFrame | None = None
    gain_levels: pd.DataFrame | None = None
    gain_modes: pd.DataFrame | None = None
    decisions: pd.DataFrame | None = None
    statistics: pd.DataFrame | None = None
    loo_pit: pd.DataFrame | None = None
    discrepancy: pd.DataFrame | None = None
    deformed: Surface | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files whose tables are there."""
        there = (field.name for field in fields(self) if getattr(self, field.name) is not None)
        return tuple(f"{name}.csv" for name in there if name != "deformed")


def read_tables(folder: RunFolder) -> Tables:
    """Read every table of a run folder.

    Raises
    ------
    BayesdegError
        If a file is there but damaged.
    """

    def read(name: str) -> pd.DataFrame | None:
        return present(folder.read_table(name))

    return Tables(
        gain=read(GAIN),
        bands=read(BANDS),
        rupture=read(RUPTURE),
        observations=read(OBSERVATIONS),
        tensile=read(TENSILE),
        constants=read(CONSTANTS),
        parameters=read(PARAMETERS),
        levels=read(LEVELS),
        elongation=read(ELONGATION),
        measured=read(MEASURED),
        misfit_null=read(MISFIT_NULL),
        leave_one_out=read(LEAVE_ONE_OUT),
        prior_sensitivity=read(PRIOR_SENSITIVITY),
        prior_predictive=read(PRIOR_PREDICTIVE),
        course=read(COURSE),
        orders=read(ORDERS),
        gain_levels=read(GAIN_LEVELS),
        gain_modes=read(GAIN_MODES),
        decisions=read(DECISIONS),
        statistics=read(STATISTICS),
        loo_pit=read(LOO_PIT),
        discrepancy=read(DISCREPANCY),
        deformed=read_surface(folder.path),
    )
