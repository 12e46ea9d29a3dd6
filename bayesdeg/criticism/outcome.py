"""Outcomes and significance levels, for records, reports and commands."""

from enum import StrEnum

MISFIT_LEVEL = 0.02
"""p-value up to which a misfit is significant."""
LEFT_LEVEL = 0.005
"""p-value up to which the misfit left by causes counts against them: at `MISFIT_LEVEL` one correct
name in fifty would be lost to chance. In 699 virtual studies no p-value between the two levels
prevented a wrong name."""


class Outcome(StrEnum):
    """The outcome of a verdict."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
    NOT_JUDGED = "not_judged"
