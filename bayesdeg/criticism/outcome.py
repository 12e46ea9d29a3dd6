"""What can be said of a misfit: what records, reports and commands need to know of criticism."""

from enum import StrEnum

MISFIT_LEVEL = 0.02
"""p-value up to which a misfit is more than chance gives."""


class Outcome(StrEnum):
    """What can be said of the misfit."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
    NOT_JUDGED = "not_judged"
