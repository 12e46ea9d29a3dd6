"""Checks of a posterior: influence of specimens and priors, and prior predictions."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bayesdeg.analysis.calibrate import Fit
from bayesdeg.criticism.holdout import leave_one_out as specimens
from bayesdeg.criticism.holdout.leave_one_out import LeaveOneOut
from bayesdeg.criticism.posterior import prior_sensitivity as priors
from bayesdeg.criticism.posterior.prior_sensitivity import PriorSensitivity
from bayesdeg.inference.model import blocks_of
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.pages import tables as columns
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.wording import worded
from bayesdeg.prediction import prior_predictive as alone
from bayesdeg.prediction.prior_predictive import PriorPredictive
from bayesdeg.progress import Progress

FEWEST = 2  # specimens needed to leave one out


@dataclass(frozen=True)
class Checks:
    """Checks of the final posterior.

    Parameters
    ----------
    leave_one_out : LeaveOneOut, optional
        None where there are fewer than two specimens.
    prior_sensitivity : PriorSensitivity, optional
        Of conclusions and parameters.
    prior_predictive : PriorPredictive, optional
        Curves before any reading.
    """

    leave_one_out: LeaveOneOut | None
    prior_sensitivity: PriorSensitivity | None
    prior_predictive: PriorPredictive | None

    def tables(self) -> dict[str, Callable[[], pd.DataFrame]]:
        """Return the functions that build the tables of the run folder, by name."""
        found: dict[str, Callable[[], pd.DataFrame]] = {}
        if self.prior_sensitivity is not None:
            found[columns.PRIOR_SENSITIVITY] = self.prior_sensitivity.table
        if self.prior_predictive is not None:
            found[columns.PRIOR_PREDICTIVE] = self.prior_predictive.table.copy
        if self.leave_one_out is not None:
            found[columns.LEAVE_ONE_OUT] = self.leave_one_out.table
        return found

    def sentences(self, *, degrades: bool = True) -> dict[str, str]:
        """Return the result of each check in words, by table name."""
        said = {}
        if self.prior_sensitivity is not None:
            said[columns.PRIOR_SENSITIVITY] = worded(self.prior_sensitivity, degrades=degrades)
        if self.prior_predictive is not None:
            said[columns.PRIOR_PREDICTIVE] = worded(self.prior_predictive)
        if self.leave_one_out is not None:
            said[columns.LEAVE_ONE_OUT] = worded(self.leave_one_out)
        return said


def check(
    fit: Fit,
    *,
    seed: np.random.SeedSequence,
    progress: Progress,
    executor: Executor | None = None,
    guard: Guard | None = None,
) -> Checks:
    """Run the checks of a posterior.

    Parameters
    ----------
    fit : Fit
        The final calibration.
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows each refit.
    executor : Executor, optional
        For refits.
    guard : Guard, optional
        Leaves out what fails; by default nothing is left out and faults are raised.
    """
    guard = guard or Guard(strict=True)
    refits, draws = seed.spawn(2)
    model, chain = fit.model, fit.chain
    progress.stage("sensitivity to priors")
    sensitivity = guard.attempt(
        OptionalStage.PRIOR_SENSITIVITY, priors.prior_sensitivity, model, chain
    )
    generator = np.random.default_rng(draws)
    predictive = None
    if isinstance(model.world, FilmsAndActuators):
        predictive = guard.attempt(
            OptionalStage.PRIOR_PREDICTIVE, alone.prior_predictive, model, generator
        )
    progress.stage("specimens left out in turn")
    left_out = None
    if len(blocks_of(model)) >= FEWEST:
        left_out = guard.attempt(
            OptionalStage.LEAVE_ONE_OUT,
            specimens.leave_one_out,
            model,
            chain,
            seed=refits,
            executor=executor,
            on_refit=lambda specimen: progress.advance(1, f"calibrated again without {specimen}"),
        )
    return Checks(left_out, sensitivity, predictive)
