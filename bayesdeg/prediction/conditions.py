"""Service conditions of a new specimen; a light module, since options use it for defaults."""

import math
from dataclasses import dataclass, fields, replace

from bayesdeg.errors import BayesdegError, use_one_of
from bayesdeg.quantities import BRANCHES, COLDEST, HOTTEST, LOADING, MOUNTS, UNLOADING


@dataclass(frozen=True)
class ServiceConditions:
    """Service conditions of a new specimen: by default a prompt first loading, held horizontally.

    Parameters
    ----------
    hold_s : float
        How long the pressure has been held when the curvature is read, which is also how long the
        specimen has been in the room [s].
    cycle : int
        Loading cycle, from 1. Earlier cycles went promptly to the largest pressure of the study's
        tests and back to zero.
    branch : {"loading", "unloading"}
        Whether the pressure is on its way up, or came down promptly from the largest of the
        study's tests.
    humidity_pct : float, optional
        Relative humidity of the room [%]; by default that of the study's room where it recorded
        none. By `bayesdeg.causes.humidity_drift` it acts on curvature with time, so give `hold_s`
        as well; by `bayesdeg.causes.dry_embrittlement` it acts on rupture at once.
    mount : {"horizontal", "hanging", "bending_up", "bending_down"}
        How the actuator is held.
    degradation_sd : float
        Standard error of the specimen's degradation rate [% points].
    temperature_c : float, optional
        Of the room [°C]; by default that at which a test without one is taken. It acts by
        `bayesdeg.causes.temperature_softening`.

    Raises
    ------
    BayesdegError
        If a value is impossible.

    Examples
    --------
    >>> ServiceConditions(hold_s=60.0).changed
    ('hold_s',)
    >>> ServiceConditions(mount="upside down")
    Traceback (most recent call last):
    ...
    bayesdeg.errors.BayesdegError: mount 'upside down' is not known; use one of horizontal, ...
    """

    hold_s: float = 0.0
    cycle: int = 1
    branch: str = LOADING
    humidity_pct: float | None = None
    mount: str = "horizontal"
    degradation_sd: float = 0.0
    temperature_c: float | None = None

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        _number("hold_s", self.hold_s, "s", "a time not below 0")
        if self.humidity_pct is not None:
            _number("humidity_pct", self.humidity_pct, "%", "a humidity from 0 to 100 %", 100.0)
        if self.temperature_c is not None and not COLDEST <= self.temperature_c <= HOTTEST:
            right = f"degrees Celsius of a room or an oven, {COLDEST:g} to {HOTTEST:g}"
            raise BayesdegError(
                f"temperature_c {self.temperature_c:g} °C is out of range; give {right}"
            )
        sd = "a standard error from 0 to 100 % points"
        _number("degradation_sd", self.degradation_sd, "% points", sd, 100.0)
        if isinstance(self.cycle, bool) or self.cycle != int(self.cycle) or self.cycle < 1:
            raise BayesdegError(f"cycle {self.cycle} is out of range; cycles are counted from 1")
        for name, known in (("branch", BRANCHES), ("mount", MOUNTS)):
            given = getattr(self, name)
            if given not in known:
                raise BayesdegError(f"{name} {given!r} is not known; {use_one_of(given, known)}")

    @property
    def changed(self) -> tuple[str, ...]:
        """Names of conditions that differ from a prompt first loading."""
        return tuple(f.name for f in fields(self) if getattr(self, f.name) != f.default)

    @property
    def has_history(self) -> bool:
        """Whether a specimen has a load history before its reading."""
        return self.hold_s > 0.0 or self.cycle > 1 or self.branch == UNLOADING

    def without(self, name: str) -> "ServiceConditions":
        """Return the conditions with one reset to a prompt first loading."""
        return replace(self, **{name: getattr(PROMPT, name)})


def _number(name: str, value: float, unit: str, right: str, most: float = math.inf) -> None:
    if not (math.isfinite(value) and 0.0 <= value <= most):
        raise BayesdegError(f"{name} {value:g} {unit} is out of range; give {right}")


PROMPT = ServiceConditions()
