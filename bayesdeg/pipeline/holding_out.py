"""What else is held out than specimens of actuators: films, measured means, whole levels."""

from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from bayesdeg.criticism.held_out import HeldOut, by_level, joined, predict_folds
from bayesdeg.criticism.model_readings import Held, ModelReadings
from bayesdeg.criticism.search import Names, Search
from bayesdeg.criticism.subject import Subject
from bayesdeg.criticism.support import hold_out
from bayesdeg.pipeline.judgement import BASE, label

BESIDE: tuple[Held, ...] = ("films", "statistics")


def all_held_out(
    search: Search,
    chosen: Names,
    actuators: dict[Names, HeldOut],
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None,
) -> dict[Names, HeldOut]:
    """Hold out films and means of replicates too, beside actuators.

    A model that is wrong for actuators is bent by them, and predicts them well; what bends it then
    is that it contradicts the films or the measured volume ratio.
    """
    subject = search.base.subject
    if not isinstance(subject, ModelReadings) or subject.model.actuator is None:
        return actuators
    if not chosen or not actuators:  # nothing to compare
        return actuators
    found = dict(actuators)
    for held in BESIDE:
        other = hold_out(search, chosen, seed=seed, of=partial(_holding, held), executor=executor)
        for names, beside in other.items():
            found[names] = joined(found[names], beside)
    return found


def _holding(held: Held, subject: Subject) -> Subject:
    assert isinstance(subject, ModelReadings)
    return replace(subject, held=held)


def levels_out(
    search: Search, names: Names, *, seed: np.random.SeedSequence, executor: Executor | None
) -> dict[str, HeldOut]:
    """Predict whole levels of degradation that were left out, if there are several."""
    fold = by_level(search.base.subject)
    if not names or fold.max() < 1:
        return {}
    return {
        label(one): predict_folds(search.trials[one], fold, seed=seed, executor=executor)
        for one in (BASE, names)
    }
