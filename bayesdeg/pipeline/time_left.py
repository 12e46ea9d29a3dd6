"""How long sampling will still take, from how its effective draws grow."""

import math
import time
from dataclasses import dataclass, field

from bayesdeg.inference.chain import Effort, Standing


def steps_left(standing: Standing, effort: Effort) -> float:
    """Return how many steps are still to be done, at most to the effort's limit; nan if unknown.

    A period begins anew with no kept steps, so what is wanted may have to wait for a later one.

    Examples
    --------
    >>> effort = Effort(effective=400.0, r_hat=1.01, chunk=50, longest=1000)
    >>> steps_left(Standing(100, kept=50, effective=250.0, r_hat=1.02, times=5.0), effort)
    50.0
    >>> steps_left(Standing(100, kept=50, effective=200.0, r_hat=1.03, times=5.0), effort)
    250.0
    """
    wanted, done = standing.steps_wanted(effort), 0
    if math.isnan(wanted):
        return math.nan
    if standing.enough(effort):
        return 0.0
    first, *periods = effort.periods(settled=standing.settled)
    for looks in periods:
        kept = 0
        for look in looks:
            kept += look
            reached = sum(first) + done + kept
            if kept >= wanted and reached > standing.steps:
                return float(reached - standing.steps)
        done += kept
    return float(max(effort.longest - standing.steps, 0))


@dataclass(frozen=True)
class Pace:
    """When sampling began, by which the seconds of a step are known.

    Parameters
    ----------
    began : float
        Of a clock [s].
    """

    began: float = field(default_factory=time.perf_counter)

    def left(self, standing: Standing, effort: Effort) -> float:
        """Return the seconds left; nan if they are not known yet."""
        computed = standing.steps - standing.resumed
        if computed == 0:
            return math.nan
        return (time.perf_counter() - self.began) / computed * steps_left(standing, effort)


def words(seconds: float) -> str:
    """Say a time in words; nothing if it is not known.

    Examples
    --------
    >>> words(42.0), words(400.0), words(float("nan"))
    ('about 42 s left', 'about 7 min left', '')
    """
    if math.isnan(seconds):
        return ""
    return f"about {seconds:.0f} s left" if seconds < 90.0 else f"about {seconds / 60:.0f} min left"
