"""Optional stages of a run: one that fails is left out and reported, and the run goes on."""

import os
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from bayesdeg.errors import ResumableError, StudyError
from bayesdeg.pages.record import LeftOutEntry
from bayesdeg.pages.wording import sentences

STRICT: Final = "BAYESDEG_STRICT"
"""Environment variable; if it is 1, nothing is left out and the first fault ends the run."""

_PASSED_ON = (StudyError, ResumableError)  # for the user to correct, or to be resumed


class OptionalStage(StrEnum):
    """Stages whose result is more than one table or figure."""

    SUSPECTS = "outlying specimens and readings"
    WITH_SUSPECTS = "verdict with the suspects"
    VERDICT = "verdict"
    CALIBRATION = "misfit against chance"
    DETECTABLE = "smallest detectable misfit"
    ERRORS = "plausibility of noise and scatter"
    RUPTURE_MISFIT = "ruptures against the base model"
    RUPTURE_COUNTS = "counts of ruptures against the model"
    CONFLICT = "measured means and priors against the base model"
    HELD_OUT = "held-out specimens"
    STRUCTURE = "structure left by the causes"
    MISSING_TERMS = "terms that would remove the misfit"
    SETS = "sets of causes that may be right"
    SHARED_SCATTER = "scatter shared by a degradation rate"
    CONFUSABILITY = "causes that this design could confuse"
    ABSORPTION = "parameters that absorb an effect"
    LEVELS_OUT = "held-out degradation rates"
    EXPERIMENTS = "next experiments"
    EXTENDED = "calibration with the cause"
    PRIOR_SENSITIVITY = "sensitivity to priors"
    PRIOR_PREDICTIVE = "prior predictions"
    LEAVE_ONE_OUT = "specimens left out in turn"
    COURSE = "course of degradation"
    ORDERS = "order of the polynomials"
    LAWS = "material laws on held-out films"
    READINGS = "predictions at the readings"
    DEFORMED = "deformed actuator"
    PHOTOGRAPHS = "photographs with lines"
    HELD_OUT_MODES = "held-out modes of tension"
    WHERE = "where the misfit lies"
    CONCENTRATION = "specimens and branches with most of the misfit"
    EXPLANATION = "explanation in words"
    COMPARISONS = "published values against the posterior"
    REFUSED = "inputs that the emulator refuses"
    IN_DOUBT = "readings and parameters in doubt"
    CHECKS_IN_WORDS = "checks in words"
    PAGE = "report page"


@dataclass(frozen=True)
class LeftOut:
    """A failed stage that a run did without.

    Parameters
    ----------
    stage : str
        A member of `OptionalStage`, or a table, posterior or figure by name.
    why : str
        What is lost, and what happened.
    trace : str
        The traceback; empty where nothing was raised.
    """

    stage: str
    why: str
    trace: str = ""

    @property
    def entry(self) -> LeftOutEntry:
        """The entry of ``left_out`` in ``verdict.json``."""
        return LeftOutEntry(stage=str(self.stage), why=self.why)


class Guard:
    """Runs optional stages and records those that had to be left out.

    Parameters
    ----------
    strict : bool, optional
        Whether to raise instead of leaving out; by default where `STRICT` is 1 in the environment.

    Examples
    --------
    >>> guard = Guard(strict=False)
    >>> guard.attempt("bands.csv", float, "seven")
    >>> guard.left_out[0].why
    "It could not be computed (ValueError: could not convert string to float: 'seven')."
    """

    def __init__(self, *, strict: bool | None = None) -> None:
        self.strict = os.environ.get(STRICT) == "1" if strict is None else strict
        self.left_out: list[LeftOut] = []

    def attempt[T, **P](
        self, stage: str, compute: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> T | None:
        """Return the result of a stage; None if it fails, which is recorded.

        Faults of the input, resumable errors and interrupts are passed on.

        Parameters
        ----------
        stage : str
            Under which name it is left out.
        compute : callable
            Called with the other arguments.
        """
        try:
            return compute(*args, **kwargs)
        except _PASSED_ON:
            raise
        except Exception as fault:
            if self.strict:
                raise
            what = f"{type(fault).__name__}: {fault}".rstrip(": .")
            why = sentences("run", "stage_failed", stage=str(stage), what=what)
            self.note(stage, why, traceback.format_exc())
            return None

    def note(self, stage: str, why: str, trace: str = "") -> None:
        """Record that a stage was left out, with the first reason given for it."""
        if stage not in self.stages:
            self.left_out.append(LeftOut(stage, why, trace))

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of all that was left out."""
        return tuple(one.stage for one in self.left_out)

    def why(self, stage: str) -> str:
        """Return why a stage was left out; empty if it was not."""
        return next((one.why for one in self.left_out if one.stage == stage), "")

    def entries(self) -> tuple[LeftOutEntry, ...]:
        """Return ``left_out`` of ``verdict.json`` and ``run.json``."""
        return tuple(one.entry for one in self.left_out)

    def traces(self) -> str:
        """Return the content of ``left_out.txt``; empty if nothing was left out."""
        return "\n".join(
            f"{one.stage}: {one.why}\n\n{one.trace}".rstrip() + "\n" for one in self.left_out
        )


def table_stage(name: str) -> str:
    """Return under which name a table is left out.

    Examples
    --------
    >>> table_stage("bands"), posterior_stage("posterior"), figure_stage("bands")
    ('bands.csv', 'posterior.nc', 'figure bands')
    """
    return f"{name}.csv"


def posterior_stage(name: str) -> str:
    """Return under which name a posterior is left out."""
    return f"{name}.nc"


def figure_stage(name: str) -> str:
    """Return under which name a figure is left out."""
    return f"{FIGURE}{name}"


FIGURE: Final = "figure "
