"""Training an emulator: time estimate, confirmation on a terminal, training and results."""

import csv
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path

import typer
from rich.table import Table

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import Backend, Status
from bayesdeg.analysis.region import (
    LAST_ROUNDS,
    REFINING_ROUNDS,
    TARGET_SHIFT,
    AskedAfterwards,
    asked_after,
    asked_of,
    posteriors_of,
    refined_by,
    refining_campaign,
)
from bayesdeg.assembly.outline import outline
from bayesdeg.console import errors
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.part import read_part
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import Study
from bayesdeg.display import shown
from bayesdeg.errors import BayesdegError, Stopped
from bayesdeg.pages.wording import fixed, percent, words
from bayesdeg.progress import Progress
from bayesdeg.run.run_record import emulator_facts
from bayesdeg.surrogate.campaign import (
    Campaign,
    Expectation,
    endings,
    expect,
    solve_campaign,
    train_emulator,
)
from bayesdeg.surrogate.kept import (
    AT_THE_POSTERIOR,
    CACHE,
    Recipe,
    backend_of,
    duration,
    has_ground,
    local_recipe,
)
from bayesdeg.surrogate.local import (
    MORE_COARSE,
    MORE_FINE,
    REFINABLE_PCT,
    ROUNDS,
    TARGET_OUTSIDE,
    TARGET_PCT,
    LocalDesign,
    local_design,
    span_of,
    units_for,
)
from bayesdeg.surrogate.refinement import TooFewCurvesError
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.solutions import ANSWERS, Run, SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import (
    asked_for,
    covering,
    ended_with_refinement,
    find,
    is_current_fit,
    is_refined,
    lacking,
    not_refined,
    read_trained,
    refuse_lacking,
    surrogate_for,
    write_trained,
)

RECIPE = Recipe()
STORE = Path(".cache/campaign")  # folder of solutions, under the working directory
LOCAL = local_recipe


@dataclass(frozen=True)
class TrainingOptions:
    """Settings for training.

    Parameters
    ----------
    yes : bool
        Whether to proceed without asking.
    quiet : bool
        Whether to print nothing.
    refine : bool
        Whether to correct the emulator, found or trained, in the study's posterior region.
    cache : Path
        Folder of trained emulators.
    backend : Backend
        Finite element assembly.
    """

    yes: bool = False
    quiet: bool = False
    refine: bool = False
    cache: Path = CACHE
    backend: Backend = Backend.KERNELS

    @property
    def recipe(self) -> Recipe:
        """Recipe for an emulator of the whole range."""
        return replace(RECIPE, backend=self.backend)

    def local_recipe(self, geometry: Moulded) -> Recipe:
        """Return the recipe for an emulator of one study."""
        return replace(LOCAL(geometry.dimensions), backend=self.backend)

    def say(self, text: str) -> None:
        """Print a line about the training, unless quiet."""
        if not self.quiet:
            errors.print(text, soft_wrap=True)


def emulator_for(
    study: Study, given: Path | None, *, options: TrainingOptions, executor: Executor | None
) -> Surrogate | None:
    """Return the emulator of a study's geometry; train it if there is none, and refine it.

    Without actuator readings none is needed. ``given`` is a file made by ``bayesdeg emulate``.

    Raises
    ------
    BayesdegError
        If the file is damaged, outdated or for a different geometry.
    Stopped
        If the user declines the training or stops it.
    """
    found = _found_or_trained(study, given, options=options, executor=executor)
    if found is None or study.actuator is None or not options.refine:
        return found
    return refined_emulator(study, found, options=options, executor=executor)


def _found_or_trained(
    study: Study, given: Path | None, *, options: TrainingOptions, executor: Executor | None
) -> Surrogate | None:
    """Return the emulator of a study's geometry, found or trained."""
    asked_beside = outline(study).asked
    uncertain = study.settings.uncertain
    if given is not None:
        trained = read_trained(given)
        refuse_lacking(trained, asked_beside, uncertain if study.actuator is not None else ())
        made_by = backend_of(trained.record)
        if options.backend not in (Backend.KERNELS, made_by):
            raise BayesdegError(
                f"{given} was trained on curves of the {made_by}; train it with "
                f"'bayesdeg emulate --backend {options.backend}', or leave --backend out"
            )
        if study.actuator is None:
            return trained
        return surrogate_for(geometry_of_study(study.settings), trained)
    if study.actuator is None:
        return None
    geometry = geometry_of_study(study.settings)
    mould = geometry.dimensions
    if isinstance(mould, MeshDimensions) and mould.assumption:
        options.say(mould.assumption)
    found = find(geometry, recipe=options.recipe, cache=options.cache)
    is_known = found.surrogate is not None and not lacking(found.surrogate, asked_beside)
    if found.surrogate is not None:
        reason = lacking(found.surrogate, asked_beside, uncertain)
        if not reason:
            return found.surrogate
        found = replace(found, surrogate=None, reason=reason)
    with shown(options.quiet) as progress:
        progress.stage("in the study's region")
        asked = asked_of(study, study.settings.seed)
    units = units_for(geometry, asked)
    first = replace(
        local_design(asked, options.local_recipe(geometry), units),
        with_forces="tip_force" in asked_beside,
    ).departing_with(uncertain, alone=is_known and geometry.dimensions == Dimensions())
    known = _known(study, first, span_of(asked.in_units(units), wider=0.0), options)
    if known is not None:
        return known
    options.say(f"{found.reason}; one is trained now for this study and kept in {options.cache}")
    return train_for_study(study, first, executor, options)


def refuse_cells(settings: Settings, backend: Backend) -> None:
    """Raise BayesdegError for tetrahedra in scikit-fem, whose weak form here is for bricks."""
    mould = settings.dimensions
    if backend is Backend.KERNELS or not isinstance(mould, MeshDimensions):
        return
    if read_part(mould.path).is_tetrahedral:
        raise BayesdegError(
            f"{mould.file} has tetrahedra, but {backend} assembles only bricks; "
            f"use --backend {Backend.KERNELS}"
        )


def _known(
    study: Study, first: LocalDesign, wanted: TrainingRange, options: TrainingOptions
) -> Surrogate | None:
    """Return an emulator trained for this study, or one that covers it too."""
    geometry = geometry_of_study(study.settings)
    own = _kept_for(geometry, first, options)
    for path, surrogate in covering(geometry, wanted, options.cache):
        wanting = lacking(surrogate, outline(study).asked, study.settings.uncertain)
        is_other = wanting or backend_of(surrogate.record) is not options.backend
        if surrogate.units != first.units or is_other or is_refined(surrogate.record):
            continue
        done = not _ends_refined(geometry, first) or ended_with_refinement(surrogate.record)
        if path == own and done and is_current_fit(surrogate.record):
            return surrogate
        if path != own and _is_good(_asked_after(study, surrogate, options), first, TARGET_PCT):
            return surrogate
    return None


def _ends_refined(geometry: Moulded, design: LocalDesign) -> bool:
    """Return whether training ends by refining the emulator with fine curves."""
    return has_ground(geometry) and not design.only_departure and LAST_ROUNDS > 0


def _kept_for(geometry: Moulded, first: LocalDesign, options: TrainingOptions) -> Path:
    """Return the file of an emulator whose training began with a design."""
    recipe = options.local_recipe(geometry)
    campaign = Campaign(geometry, recipe, SolutionStore(STORE), design=first)
    return options.cache / f"{campaign.key()[:16]}.npz"


def _asked_after(study: Study, surrogate: Surrogate, options: TrainingOptions) -> AskedAfterwards:
    with shown(options.quiet) as progress:
        progress.stage("in the posterior region")
        return asked_after(study, surrogate, study.settings.seed)


def _is_good(
    found: AskedAfterwards,
    design: LocalDesign,
    wanted_pct: float,
    before: AskedAfterwards | None = None,
) -> bool:
    """Return whether an emulator is as accurate in the posterior region as curves can make it."""
    # Further curves cannot correct the errors of the shipped emulator itself. If the curves of a
    # round bring no more of the posterior into the range, those of the next would not either.
    is_exact = design.only_departure or found.error_pct <= wanted_pct
    mends = before is None or found.outside < before.outside
    return is_exact and (found.outside <= TARGET_OUTSIDE or not mends)


def train_for_study(
    study: Study, first: LocalDesign, executor: Executor | None, options: TrainingOptions
) -> Surrogate:
    """Train an emulator over the range of a study, then in its posterior region until accurate.

    ``first`` is the range given by films, priors and conditions.

    Raises
    ------
    Stopped
        If the user declines or stops it.
    """
    geometry, store = geometry_of_study(study.settings), SolutionStore(STORE)
    recipe, design = options.local_recipe(geometry), first
    is_refined_last = _ends_refined(geometry, first)
    last_curves = AT_THE_POSTERIOR if is_refined_last else 0
    base: CandidateFit | None = None
    before: AskedAfterwards | None = None
    for more in range(ROUNDS + 1):
        campaign = Campaign(geometry, recipe, store, executor, design=design, later=last_curves)
        surrogate = _worked(campaign, options, train_emulator)
        if more == ROUNDS:
            break
        found = _asked_after(study, surrogate, options)
        wanted = REFINABLE_PCT if is_refined_last else TARGET_PCT
        good = _is_good(found, design, wanted, before)
        ends = (
            f" (in a further {100.0 * found.unanswered:.2g} % of plausible cases the actuator "
            "balloons below your highest pressure, which cannot be computed)"
        )
        options.say(
            "in the posterior region the emulator's standard error is "
            f"{found.error_pct:.2g} % (target: {wanted:g} %); {100.0 * found.outside:.2g} % of the "
            f"region is out of range{ends if found.unanswered else ''}"
            f"{'' if good else '; more curves are solved there'}"
        )
        if good:
            base = found.base
            break
        added = replace(recipe, coarse_runs=MORE_COARSE, fine_runs=MORE_FINE, seed=more + 1)
        design, before = design.further(found.asked, added), found
    campaigns = [campaign]
    if is_refined_last:
        begun = Campaign(geometry, recipe, store, executor, alike=campaign.runs)
        try:
            last, surrogate = _refined(study, surrogate, begun, LAST_ROUNDS, options, base=base)
        except TooFewCurvesError as fault:
            surrogate = replace(surrogate, record=not_refined(surrogate.record))
            options.say(f"{fault}; the emulator is kept as trained")
        else:
            campaigns.append(last)
    _keep(campaigns, _kept_for(geometry, first, options), surrogate, options)
    return surrogate


def refined_emulator(
    study: Study, ground: Surrogate, *, options: TrainingOptions, executor: Executor | None
) -> Surrogate:
    """Correct an emulator in a study's posterior region until its error no longer matters there.

    Fine curves are added until the remaining error can shift no posterior mean noticeably, or for
    `REFINING_ROUNDS` rounds. Solutions are reused.

    Raises
    ------
    Stopped
        If the user declines or stops it.
    BayesdegError
        If too few curves are informative.
    """
    geometry = geometry_of_study(study.settings)
    begun = Campaign(geometry, options.local_recipe(geometry), SolutionStore(STORE), executor)
    campaign, refined = _refined(study, ground, begun, REFINING_ROUNDS, options)
    found = replace(refined, record=asked_for(refined.record))
    key = sha256((campaign.key() + ground.record).encode()).hexdigest()
    _keep([campaign], options.cache / f"{key[:16]}.npz", found, options)
    return found


def _refined(
    study: Study,
    ground: Surrogate,
    begun: Campaign,
    rounds: int,
    options: TrainingOptions,
    *,
    base: CandidateFit | None = None,
) -> tuple[Campaign, Surrogate]:
    """Return an emulator corrected in at most this many rounds, and the solutions for it.

    Its base model is not calibrated again.
    """
    campaign, found = begun, ground
    for number in range(rounds):
        with shown(options.quiet) as progress:
            progress.stage("in the posterior region")
            known = base if number == 0 else None
            posteriors = posteriors_of(study, found, study.settings.seed, base=known)
        campaign = refining_campaign(campaign, posteriors, ground, number)
        solved = _worked(campaign, options, solve_campaign)
        found, left = refined_by(campaign, solved, posteriors, ground)
        more = "" if left.is_small or number + 1 == rounds else "; more curves are solved there"
        options.say(
            f"{left.curves} curves in the posterior region moved {left.moved_parameter} by "
            f"{left.moved_sd:.2g} sd; the emulator's remaining error shifts {left.parameter} by "
            f"{left.shift_sd:.2g} sd (target: {TARGET_SHIFT:g}) and is "
            f"{100.0 * left.share_of_reading_errors:.2g} % of a reading error{more}"
        )
        if left.is_small:
            break
    return campaign, found


def train(campaign: Campaign, path: Path, options: TrainingOptions) -> Surrogate:
    """Announce the time of a campaign, complete it, train the emulator and save it.

    Raises
    ------
    Stopped
        If the user declines the training or stops it.
    """
    surrogate = _worked(campaign, options, train_emulator)
    _keep([campaign], path, surrogate, options)
    return surrogate


def _worked[Result](
    campaign: Campaign,
    options: TrainingOptions,
    work: Callable[[Campaign, Expectation, Progress], Result],
) -> Result:
    """Announce the time of a campaign, ask for consent on a terminal, and run it."""
    store = campaign.store.folder
    try:
        with shown(options.quiet) as progress:
            expectation = expect(campaign, progress)
        if expectation.left:
            options.say(f"training takes {expectation}; solutions are stored in {store}")
            if not options.yes and sys.stdin.isatty() and sys.stderr.isatty():
                question = f"Train the emulator, {duration(expectation.whole_seconds)}?"
                if not typer.confirm(question, default=True, err=True):
                    raise Stopped(
                        f"not trained; solutions are kept in {store}, and the same command "
                        "continues from there"
                    )
        with shown(options.quiet) as progress:
            return work(campaign, expectation, progress)
    except (KeyboardInterrupt, typer.Abort) as stop:
        total = len(campaign.runs)
        raise Stopped(
            f"stopped; {total - len(campaign.left())} of {total} finite element curves are kept in "
            f"{store}, and the same command continues from there"
        ) from stop


def _keep(
    campaigns: Sequence[Campaign], path: Path, surrogate: Surrogate, options: TrainingOptions
) -> None:
    """Write the emulator and the list of failures."""
    write_trained(path, surrogate)
    ended = [end for campaign in campaigns for end in endings(campaign)]
    listed = list_failures(path, ended)
    if options.quiet:
        return
    errors.print(runs_table(ended))
    if listed is not None:
        options.say(f"parameters of the failed ones: {listed}")
    errors.print(accuracy_table(surrogate))


def list_failures(path: Path, ended: list[tuple[Run, Status]]) -> Path | None:
    """List the parameters of failed runs in a CSV file next to an emulator; None if none failed."""
    listed = path.with_suffix(".failures.csv")
    rows = [
        {"status": status.name, "advice": status.advice, "run": run.key()}
        | {f"mesh_{name}": value for name, value in asdict(run.resolution).items()}
        | {"largest_load": run.curve.loads[-1] if run.curve.loads else 0.0}
        | asdict(run.curve.material)
        for run, status in ended
        if status not in ANSWERS
    ]
    if not rows:
        listed.unlink(missing_ok=True)
        return None
    with listed.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return listed


def runs_table(ended: list[tuple[Run, Status]]) -> Table:
    """Return the outcomes of the runs, by mesh and status."""
    table = Table(title="finite element curves", title_justify="left")
    meshes = list(dict.fromkeys(run.resolution for run, _ in ended))
    table.add_column("outcome", overflow="fold")
    for mesh in meshes:
        table.add_column(f"mesh of {mesh.along:g} mm", justify="right")
    counts = Counter((run.resolution, status) for run, status in ended)
    for status in sorted({status for _, status in ended}):
        failed = "" if status in ANSWERS else "failed: "
        numbers = [str(counts[mesh, status]) for mesh in meshes]
        table.add_row(f"{failed}{status.advice.split(':')[0].split(';')[0]}", *numbers)
    totals = [str(sum(run.resolution == mesh for run, _ in ended)) for mesh in meshes]
    table.add_section()
    table.add_row("all", *totals)
    return table


def accuracy_table(surrogate: Surrogate) -> Table:
    """Return the accuracy of an emulator on curves that it was not trained on."""
    table = Table(title="emulator, on held-out curves [%]", title_justify="left")
    table.add_column("quantity")
    for heading in ("rms", "95th percentile", "largest", "inside its 90 % interval"):
        table.add_column(heading, justify="right")
    for row in emulator_facts(surrogate.record).accuracy:
        sizes = [fixed(size) for size in (row.rms_pct, row.p95_pct, row.max_pct)]
        table.add_row(words(row.quantity), *sizes, percent(row.coverage_90))
    return table
