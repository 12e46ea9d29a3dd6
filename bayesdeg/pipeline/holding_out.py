"""What else is held out than specimens of actuators: films, measured means, whole levels."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from bayesdeg.criticism.held_out import HeldOut, by_level, joined
from bayesdeg.criticism.leaving_out import carried_out, in_folds
from bayesdeg.criticism.model_readings import Held, ModelReadings
from bayesdeg.criticism.search import Names, Search
from bayesdeg.criticism.subject import Subject
from bayesdeg.criticism.support import Regroup, as_it_is, can_be_held_out, hold_out_each
from bayesdeg.pipeline.judgement import BASE, label

BESIDE: tuple[Held, ...] = ("films", "statistics")


def held_out_and_all(
    search: Search,
    chosen: Names,
    *,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
    on_set: Callable[[Names], None] | None = None,
) -> tuple[dict[Names, HeldOut], dict[Names, HeldOut]]:
    """Hold out what the study predicts, and that together with films and means of replicates.

    A model that is wrong for actuators is bent by them, and predicts them well; what bends it then
    is that it contradicts the films or the measured volume ratio.

    Returns
    -------
    tuple of dict
        By set of causes; the same where there is nothing beside, or no cause to compare.
    """
    subject = search.base.subject
    compared = bool(chosen) and can_be_held_out(subject)
    beside = compared and isinstance(subject, ModelReadings) and subject.model.actuator is not None
    ways: list[Regroup] = [as_it_is, *(partial(_holding, held) for held in BESIDE if beside)]
    own, *others = hold_out_each(search, chosen, ways, seed=seed, executor=executor, on_set=on_set)
    everything = dict(own)
    for other in others:
        everything |= {names: joined(everything[names], more) for names, more in other.items()}
    return own, everything


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
    plans = [in_folds(search.trials[one], fold, seed) for one in (BASE, names)]
    found = carried_out(plans, executor)
    return {label(one): held_out for one, held_out in zip((BASE, names), found, strict=True)}
