"""Everything that a verdict rests on, and what follows from it for the final model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.candidates import Candidate, effect_size
from bayesdeg.criticism.conflict import Conflict, Questioned
from bayesdeg.criticism.confusability import Confusability
from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.held_out import HeldOut
from bayesdeg.criticism.model_readings import CURVATURE, ModelReadings
from bayesdeg.criticism.rupture_misfit import RuptureMisfit
from bayesdeg.criticism.search import Names, Search
from bayesdeg.criticism.shared_scatter import SharedScatter
from bayesdeg.criticism.step import Step
from bayesdeg.criticism.support import Support
from bayesdeg.criticism.verdict import Decision
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.calibrate import Fit

Floats = NDArray[np.float64]

BASE: Names = frozenset()


@dataclass(frozen=True)
class Judgement:
    """Everything that the verdict rests on.

    Parameters
    ----------
    misfit, left : Misfit
        Of the base model, and of the one with all causes that the evidence favours.
    rupture : RuptureMisfit or None
        Whether the base model expects the ruptures; None where there are none to judge.
    contradicted : Conflict or None
        The measured mean that the base model contradicts most; None where none was measured.
    candidates : tuple of Candidate
        All that were tried, best first.
    supported : tuple of Support
        What speaks for those that the evidence favours.
    decision : Decision
        Outcome and causes.
    threshold : float
        Log Bayes factor needed to be named.
    confusability : Confusability
        What this study could not tell apart.
    held_out, levels_out : dict of str to HeldOut
        Specimens, and whole levels, that took no part; by name of the model, ``base`` first.
    search : Search
        The fitted sets of causes.
    experiments : list
        What to measure next, as in ``verdict.json``.
    alike : tuple of str
        Causes that could not be judged since another form of the law reads like them.
    shared : tuple of SharedScatter
        Whether specimens that the favoured causes let scatter one by one deviate level by level.
    questioned : tuple of Questioned
        Parameters that the base model takes far off their priors.
    sampled : bool
        Whether the model with the causes was calibrated, so that predictions are made with it.
    """

    misfit: Misfit
    left: Misfit
    rupture: RuptureMisfit | None
    contradicted: Conflict | None
    candidates: tuple[Candidate, ...]
    supported: tuple[Support, ...]
    decision: Decision
    threshold: float
    confusability: Confusability
    held_out: dict[str, HeldOut]
    levels_out: dict[str, HeldOut]
    search: Search
    experiments: list[dict[str, object]]
    alike: tuple[str, ...] = ()
    shared: tuple[SharedScatter, ...] = ()
    questioned: tuple[Questioned, ...] = ()
    sampled: bool = True

    @property
    def predicted_with(self) -> tuple[str, ...]:
        """Causes that are part of the model with which predictions are made."""
        return tuple(sorted(extension(self.decision, self.supported))) if self.sampled else ()

    @property
    def steps(self) -> tuple[Step, Step]:
        """What is known of the base model, and with all that the evidence favours."""
        chosen = frozenset(one.cause for one in self.supported)
        return self.search.step(BASE), self.search.step(chosen)


def label(names: Names) -> str:
    """Return the name of a model in tables.

    Examples
    --------
    >>> label(frozenset({"gravity", "creep"}))
    'base+creep+gravity'
    """
    return "+".join(("base", *sorted(names)))


def extended_model(judgement: Judgement) -> tuple[Model, Floats] | None:
    """Return the model with the named causes, or the leading one; None if there is none."""
    names = extension(judgement.decision, judgement.supported)
    if not names:
        return None
    trial = judgement.search.trials[names]
    assert isinstance(trial.subject, ModelReadings)
    return trial.subject.model, trial.mode


def extension(decision: Decision, supported: tuple[Support, ...]) -> Names:
    """Return the causes that join the final model: all that the evidence favours, if any is named.

    Of inseparable ones the best joins. At what was read its predictions are as good as those of the
    others, elsewhere they may differ: a wrong scale and thicker walls give the same curvatures, and
    other bend angles. Reports of ambiguous outcomes therefore say with which one they predict.
    """
    return frozenset(one.cause for one in supported) if decision.causes else BASE


def readings_misfit(
    judgement: Judgement, kind: str = CURVATURE
) -> tuple[float | None, float | None]:
    """Return RMS residuals of one kind of reading under the base model, and what is left.

    What is left after all that the evidence favours, and a smooth discrepancy, are taken off: the
    scatter of specimens and the errors of reading. In the unit of the kind (1/m, MPa); None where
    it was not read.
    """
    search = judgement.search
    rows = search.base.subject.places.kind == kind
    if not rows.any():
        return None, None
    chosen = search.step(frozenset(one.cause for one in judgement.supported))
    found = []
    for trial, explained in (
        (search.base, np.zeros(len(rows))),
        (chosen.trial, chosen.misfit.discrepancy),
    ):
        residual = trial.subject.observed - trial.linear.prediction - explained
        found.append(float(np.sqrt(np.mean(residual[rows] ** 2))))
    return found[0], found[1]


def with_sampled_sizes(judgement: Judgement, final: Fit) -> Judgement:
    """Replace the effects of the final model's causes by those of its sampled posterior."""
    flat = final.chain.vectors.reshape(-1, final.chain.vectors.shape[-1])
    values = final.model.table.named(flat)
    sizes = {
        cause.name: {
            p.name: effect_size(values[cause.qualified(p.name)], p.unit) for p in cause.parameters
        }
        for cause in final.model.causes
    }
    found = tuple(
        replace(c, effect=sizes[c.cause]) if c.cause in sizes else c for c in judgement.candidates
    )
    return replace(judgement, candidates=found)
