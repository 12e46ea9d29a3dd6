"""What a run has found, before it is written down."""

from dataclasses import dataclass

from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.checks import Checks
from bayesdeg.pipeline.films import CourseFit, Films
from bayesdeg.pipeline.judge import Judgement


@dataclass(frozen=True)
class Results:
    """Everything that a run has found.

    Parameters
    ----------
    assembly : Assembly
        Base model, candidates, missing data.
    base, final : Fit
        Calibrations of the base model and of the one with the leading cause; the same where no
        cause leads.
    judgement : Judgement or None
        None where there are no actuator readings.
    checks : Checks, optional
        What the final calibration rests on.
    films : Films, optional
        What the films alone say.
    """

    assembly: Assembly
    base: Fit
    final: Fit
    judgement: Judgement | None
    checks: Checks | None = None
    films: Films | None = None

    @property
    def fits(self) -> dict[str, Fit]:
        """Both calibrations by their labels in the tables."""
        return {"base": self.base, "final": self.final}

    @property
    def sampled(self) -> dict[str, Fit | CourseFit]:
        """Everything that was sampled: both calibrations, and the course of degradation."""
        course = None if self.films is None else self.films.course
        return {**self.fits} if course is None else {**self.fits, "course": course}
