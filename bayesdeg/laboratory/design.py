"""What tests are made: the tables of a study without what is read in them."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from bayesdeg.data.study import Study

LEVELS = (0, 5, 10, 15, 20, 25)
REPLICATES = 3
PRESSURES = np.arange(20.0, 241.0, 20.0)
STRETCH_POINTS = 15
LARGEST_SHARE = 0.97  # the last reading of a tensile curve is taken just before the break
TIMES = (0, 4, 8, 12, 16, 20, 24)
FILMS_A_TIME = 9
SHRINKAGE_FILMS = 4

SPECIMEN = ("specimen_id", "degradation_pct", "degradation_sd_pct")
_SCHEDULE = ("cycle", "branch")
_CONDITIONS = ("curvature_sd_per_m", "time_s", *_SCHEDULE, "humidity_pct", "mount")


def _specimens(prefix: str) -> pd.DataFrame:
    pairs = [(level, copy) for level in LEVELS for copy in range(1, REPLICATES + 1)]
    return pd.DataFrame(
        {
            "specimen_id": [f"{prefix}{level:02d}-{copy}" for level, copy in pairs],
            "degradation_pct": [float(level) for level, _ in pairs],
            "degradation_sd_pct": np.nan,
        }
    )


def _actuators() -> pd.DataFrame:
    return _specimens("A").merge(pd.DataFrame({"pressure_kPa": PRESSURES}), how="cross")


def _tensile() -> pd.DataFrame:
    share = LARGEST_SHARE * np.arange(1, STRETCH_POINTS + 1) / STRETCH_POINTS
    points = pd.DataFrame(
        {"mode": "uniaxial", "elongation_share": share, "stress_measure": "nominal"}
    )
    return _specimens("F").merge(points, how="cross")


def _breaks() -> pd.DataFrame:
    return _specimens("F")


def _moisture() -> pd.DataFrame:
    pairs = [(time, film) for time in TIMES for film in range(1, FILMS_A_TIME + 1)]
    names = [f"M{time:02d}-{film}" for time, film in pairs]
    return pd.DataFrame({"film_id": names, "time_h": [float(time) for time, _ in pairs]})


def _shrinkage() -> pd.DataFrame:
    return pd.DataFrame({"film_id": [f"S{film}" for film in range(1, SHRINKAGE_FILMS + 1)]})


@dataclass(frozen=True)
class Design:
    """What is tested and at what settings; the defaults are the tests of Nagai et al.

    Parameters
    ----------
    actuator : pandas.DataFrame
        One row a reading: ``specimen_id``, ``degradation_pct``, ``degradation_sd_pct`` (nan where
        the truth has the say), ``pressure_kPa``, and of the optional columns of ``actuator.csv``
        those that are recorded. Rows of a specimen stand in the order of the test. Default:
        6 levels of degradation, 3 actuators each, 20 to 240 kPa by 20 kPa.
    tensile : pandas.DataFrame
        One row a reading: the columns of the specimen, ``mode``, ``stress_measure``, and either
        ``stretch`` or ``elongation_share``, the share of the specimen's own elongation at break.
        Default: 3 films a level, 15 readings up to 97 % of the elongation at break.
    breaks : pandas.DataFrame
        One row a specimen; one that stands in ``tensile`` too is the same film. Default: those.
    moisture : pandas.DataFrame
        ``film_id``, ``time_h``. Default: 9 films each after 0, 4, …, 24 h.
    shrinkage : pandas.DataFrame
        ``film_id``. Default: 4 films.
    bend_angle : bool
        Whether the bend angle is read beside the curvature.

    References
    ----------
    Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485; doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> design = Design()
    >>> len(design.actuator), len(design.tensile), len(design.breaks), len(design.moisture)
    (216, 270, 18, 63)
    """

    actuator: pd.DataFrame = field(default_factory=_actuators)
    tensile: pd.DataFrame = field(default_factory=_tensile)
    breaks: pd.DataFrame = field(default_factory=_breaks)
    moisture: pd.DataFrame = field(default_factory=_moisture)
    shrinkage: pd.DataFrame = field(default_factory=_shrinkage)
    bend_angle: bool = True


def design_of(study: Study) -> Design:
    """Return the design of a study.

    What the study has no table of is tested as in the default design; films of its tensile
    tests are also torn if it has no ``break.csv``. Specimens that burst are given the readings
    that they would have had: those of the longest test that begins with theirs.

    Parameters
    ----------
    study : Study
        As read.

    Returns
    -------
    Design

    Examples
    --------
    >>> from pathlib import Path
    >>> table = pd.DataFrame({"film_id": ["a", "b"], "time_h": [0.0, 7.0]})
    >>> design_of(Study("s", Path("s"), moisture=table)).moisture["time_h"].tolist()
    [0.0, 7.0]
    """
    recorded = study.recorded.get("actuator", frozenset())
    tensile = _table(study, "tensile", _tensile, ("mode", "stretch", "stress_measure"))
    uniaxial = tensile.loc[tensile["mode"] == "uniaxial", list(SPECIMEN)]
    torn = uniaxial.drop_duplicates("specimen_id").reset_index(drop=True)
    return Design(
        actuator=_actuator_table(study),
        tensile=tensile,
        breaks=_table(study, "breaks", lambda: torn, ()),
        moisture=_films(study.moisture, ["film_id", "time_h"], _moisture),
        shrinkage=_films(study.shrinkage, ["film_id"], _shrinkage),
        bend_angle=study.actuator is None or "bend_angle_deg" in recorded,
    )


def _actuator_table(study: Study) -> pd.DataFrame:
    if study.actuator is None:
        return _actuators()
    recorded = study.recorded.get("actuator", frozenset())
    optional = [column for column in _CONDITIONS if column in recorded]
    whole = _completed(study.actuator)
    return _chosen(whole, ("pressure_kPa", *optional), recorded)


def _table(
    study: Study, name: str, default: Callable[[], pd.DataFrame], columns: Sequence[str]
) -> pd.DataFrame:
    frame: pd.DataFrame | None = getattr(study, name)
    if frame is None:
        return default()
    return _chosen(frame, columns, study.recorded.get(name, frozenset()))


def _chosen(frame: pd.DataFrame, columns: Sequence[str], recorded: Collection[str]) -> pd.DataFrame:
    chosen = frame[[*SPECIMEN, *columns]].reset_index(drop=True)
    if "degradation_sd_pct" in recorded:
        return chosen
    return chosen.assign(degradation_sd_pct=np.nan)


def _films(
    frame: pd.DataFrame | None, columns: list[str], default: Callable[[], pd.DataFrame]
) -> pd.DataFrame:
    return default() if frame is None else frame[columns].reset_index(drop=True)


def _completed(frame: pd.DataFrame) -> pd.DataFrame:
    tests = [test for _, test in frame.groupby("specimen_id", sort=False)]
    return pd.concat([_with_rest(test, tests) for test in tests], ignore_index=True)


def _with_rest(test: pd.DataFrame, tests: list[pd.DataFrame]) -> pd.DataFrame:
    if test["ruptured"].iloc[-1] != 1:
        return test
    steps = ["pressure_kPa", *_SCHEDULE]
    done = test[steps].to_numpy()
    alike = [other for other in tests if np.array_equal(other[steps].to_numpy()[: len(test)], done)]
    rest = max(alike, key=len).iloc[len(test) :]
    same = {column: test[column].iloc[0] for column in SPECIMEN}
    return pd.concat([test, rest.assign(**same)]) if len(rest) else test
