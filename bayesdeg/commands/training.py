"""Training an emulator: the time it takes is said, asked for if somebody is there, and shown."""

import sys
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import typer

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.commands.options import Stopped
from bayesdeg.commands.outcome import accuracy_table, list_failures, runs_table
from bayesdeg.console import errors, shown
from bayesdeg.data.study import Study
from bayesdeg.emulator.kept import (
    CACHE,
    Recipe,
    duration,
    local_recipe,
    refuse_without_emulator,
)
from bayesdeg.emulator.local import (
    MORE_COARSE,
    MORE_FINE,
    ROUNDS,
    TARGET_PCT,
    AskedInputs,
    local_design,
    span_of,
)
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import (
    find,
    find_covering,
    read_trained,
    surrogate_for,
    write_trained,
)
from bayesdeg.pipeline.asked import asked_of
from bayesdeg.pipeline.emulation import (
    Campaign,
    Expectation,
    endings,
    expect,
    largest_error,
    train_emulator,
)

STORE = Path(".cache/campaign")
RECIPE = Recipe()
LOCAL = local_recipe


@dataclass(frozen=True)
class Manner:
    """How a command goes about training.

    Parameters
    ----------
    yes : bool
        Whether it goes on without asking.
    quiet : bool
        Whether it says nothing.
    """

    yes: bool = False
    quiet: bool = False


def emulator_for(
    study: Study, given: Path | None, *, manner: Manner, executor: Executor | None
) -> Surrogate | None:
    """Return the emulator of a study's geometry; train it if there is none yet.

    Parameters
    ----------
    study : Study
        None is needed where there are no actuator readings.
    given : Path, optional
        A file made by ``bayesdeg emulate``.
    manner : Manner
        Of training.
    executor : Executor, optional
        Where to solve.

    Raises
    ------
    BayesdegError
        If the file is damaged, outdated, or of another geometry.
    Stopped
        If the user does not want to wait for the training, or stops it.
    """
    if given is not None:
        trained = read_trained(given)
        if study.actuator is None:
            return trained
        return surrogate_for(geometry_of_study(study.settings), trained)
    if study.actuator is None:
        return None
    geometry = geometry_of_study(study.settings)
    refuse_without_emulator(geometry)
    found = find(geometry, recipe=RECIPE, cache=CACHE)
    if found.surrogate is not None:
        return found.surrogate
    with shown(manner.quiet) as progress:
        progress.stage("where the study lies")
        asked = asked_of(study, study.settings.seed)
    known = find_covering(geometry, span_of(asked, wider=0.0), CACHE)
    if known is not None:
        return known
    if not manner.quiet:
        _print(f"{found.reason}; one is trained now where this study lies, and kept in {CACHE}")
    return train_where_asked(study, asked, executor, manner)


def train_where_asked(
    study: Study, asked: AskedInputs, executor: Executor | None, manner: Manner
) -> Surrogate:
    """Train an emulator where a study may ask, with further curves until its error is small.

    Raises
    ------
    Stopped
        If the user does not want to wait, or stops it.
    """
    geometry = geometry_of_study(study.settings)
    recipe = LOCAL(geometry.dimensions)
    for more in range(ROUNDS + 1):
        enough = replace(
            recipe,
            coarse_runs=recipe.coarse_runs + more * MORE_COARSE,
            fine_runs=recipe.fine_runs + more * MORE_FINE,
        )
        design = local_design(asked, enough)
        campaign = Campaign(geometry, enough, SolutionStore(STORE), executor, design=design)
        path = CACHE / f"{campaign.key()[:16]}.npz"
        surrogate = train(campaign, path, manner)
        if largest_error(surrogate) <= TARGET_PCT:
            break
    return surrogate


def train(campaign: Campaign, path: Path, manner: Manner) -> Surrogate:
    """Say how long a campaign takes, complete it, train the emulator and keep it in a file.

    Raises
    ------
    Stopped
        If the user does not want to wait, or stops it.
    """
    try:
        with shown(manner.quiet) as progress:
            expectation = expect(campaign, progress)
        if expectation.left:
            _say(expectation, campaign.store.folder, manner)
        with shown(manner.quiet) as progress:
            surrogate = train_emulator(campaign, expectation, progress)
        write_trained(path, surrogate)
    except KeyboardInterrupt as stop:
        raise Stopped(_what_stays(campaign)) from stop
    ended = endings(campaign)
    listed = list_failures(path, ended)
    if not manner.quiet:
        errors.print(runs_table(ended))
        if listed is not None:
            _print(f"parameters of the failed ones: {listed}")
        errors.print(accuracy_table(surrogate))
    return surrogate


def _say(expectation: Expectation, store: Path, manner: Manner) -> None:
    if not manner.quiet:
        _print(f"training takes {expectation}; solutions are kept in {store}")
    if manner.yes or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return
    question = f"Train the emulator, {duration(expectation.seconds)}?"
    try:
        agreed = typer.confirm(question, default=True, err=True)
    except typer.Abort as stop:
        raise KeyboardInterrupt from stop
    if not agreed:
        raise Stopped(
            f"not trained; what is solved stays in {store}, and the same command goes on from there"
        )


def _what_stays(campaign: Campaign) -> str:
    total, folder = len(campaign.runs), campaign.store.folder
    return (
        f"stopped; {total - len(campaign.left())} of {total} finite element curves stay in "
        f"{folder}, and the same command goes on from there"
    )


def _print(text: str) -> None:
    errors.print(text, soft_wrap=True)
