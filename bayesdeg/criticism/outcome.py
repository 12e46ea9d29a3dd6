"""What can be said of a misfit: what records, reports and commands need to know of criticism."""

from enum import StrEnum

MISFIT_LEVEL = 0.02
"""p-value up to which a misfit is more than chance gives."""
LEFT_LEVEL = 0.005
"""p-value up to which what causes leave speaks against them: at `MISFIT_LEVEL` one right name in
fifty would be lost to chance. In 699 virtual studies no p-value between the two kept a wrong cause
from being named."""


class Outcome(StrEnum):
    """What can be said of the misfit."""

    ADEQUATE = "adequate"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    UNEXPLAINED = "unexplained"
    NOT_JUDGED = "not_judged"
