"""What a run has found, before it is written down."""

from dataclasses import dataclass

from bayesdeg.pipeline.assemble import Assembly
from bayesdeg.pipeline.calibrate import Fit
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
    """

    assembly: Assembly
    base: Fit
    final: Fit
    judgement: Judgement | None

    @property
    def fits(self) -> dict[str, Fit]:
        """Both calibrations by their labels in the tables."""
        return {"base": self.base, "final": self.final}
