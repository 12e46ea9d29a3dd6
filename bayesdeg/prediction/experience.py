"""Tested pressures and ruptures of actuators, which limit the settings allowed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bayesdeg.data.study import Study
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.pages.record import BurstEntry, ModelEntry

NEAR = 2.5
"""Degradation rates this close count as equal: half a step between tested levels [%]."""


@dataclass(frozen=True)
class Experience:
    """Pressures that tests allow.

    Parameters
    ----------
    pressure : float
        The largest that actuators were tested at [kPa].
    rate : float
        The largest degradation rate of which anything of actuators is known [%]; what holds there
        holds beyond.
    bursts : tuple of BurstEntry
        Actuators that burst.
    """

    pressure: float
    rate: float
    bursts: tuple[BurstEntry, ...] = ()

    def near(self, degradation: float) -> tuple[BurstEntry, ...]:
        """Return actuators that burst at or near a degradation rate [%]."""
        at = min(degradation, self.rate)
        return tuple(b for b in self.bursts if abs((b.degradation_pct or 0.0) - at) <= NEAR)

    def ceiling(self, degradation: float) -> float:
        """Return the largest pressure that was tested and at which none burst near a rate [kPa].

        Ruptures at unrecorded pressures do not lower it, since their pressure is unknown.

        Examples
        --------
        >>> burst = BurstEntry(degradation_pct=24.0, burst=1, pressure_kPa=120, survived_kPa=100)
        >>> known = Experience(240.0, 25.0, (burst,))
        >>> known.ceiling(25.0), known.ceiling(10.0), known.ceiling(40.0)
        (100.0, 240.0, 100.0)
        """
        known = (b.survived_kPa or 0.0 for b in self.near(degradation) if b.pressure_kPa)
        return min([self.pressure, *map(float, known)])


def experience_of(entry: ModelEntry) -> Experience:
    """Return the experience recorded in a run."""
    measured = entry.measured
    highest = float(measured.get("pressure_kPa", (entry.largest_pressure_kPa,))[-1] or 0.0)
    burst = [float(b.degradation_pct or 0.0) for b in entry.bursts]
    rates = [float(measured["degradation_pct"][-1] or 0.0)] if "degradation_pct" in measured else []
    return Experience(highest, max([*rates, *burst], default=100.0), entry.bursts)


def bursts_of(model: JointModel, study: Study | None) -> tuple[BurstEntry, ...]:
    """Return the burst actuators of a study, its own and published ones."""
    recorded = (burst for one in model.of_kind(Curvature) for burst in _recorded(one.tests))
    return (*recorded, *(() if study is None else _published(study)))


def _recorded(curves: ActuatorCurves) -> Iterator[BurstEntry]:
    survived, burst = curves.ruptures
    for i in np.flatnonzero(burst >= 0):
        before = survived[i]
        yield BurstEntry(
            degradation_pct=float(curves.degradation[i, 0]),
            burst=1,
            pressure_kPa=float(curves.pressure[i, burst[i]]),
            survived_kPa=float(curves.pressure[i, before]) if before >= 0 else None,
            source="actuator.csv",
        )


def _published(study: Study) -> Iterator[BurstEntry]:
    burst, tested = (_counts(study, f"{name}_count") for name in ("ruptured", "tested"))
    for level, (count, source) in burst.items():
        if count > 0.0:
            of = tested.get(level, (None, ""))[0]
            yield BurstEntry(degradation_pct=level, burst=count, tested=of, source=source)


def _counts(study: Study, quantity: str) -> Mapping[float, tuple[float, str]]:
    """Return published counts with their sources by degradation rate [%]."""
    if study.summary is None:
        return {}
    rows = study.summary[study.summary["quantity"] == quantity].dropna(subset="degradation_pct")
    return {
        float(row["degradation_pct"]): (float(row["value"]), str(row["source"]))
        for row in rows.to_dict("records")
    }
