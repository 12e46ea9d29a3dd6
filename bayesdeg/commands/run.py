"""``bayesdeg run``: the main job."""

import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.text import Text

from bayesdeg.actuator.status import Backend
from bayesdeg.analysis.model_kind import kind_of_study
from bayesdeg.assembly.outline import passed_over
from bayesdeg.assembly.reading import read_study
from bayesdeg.console import errors, output, say
from bayesdeg.data.captures import captured_messages
from bayesdeg.data.photographs import messages
from bayesdeg.data.settings import Settings
from bayesdeg.display import shown
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import LEFT_OUT, RunFolder
from bayesdeg.pages.headline import doubts_of, sets_of
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.output import CHECKPOINTS, run_folder
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.quantities import Effort
from bayesdeg.run.deformed import compile_beside
from bayesdeg.run.stages import add_page, fingerprint, run_study, with_options
from bayesdeg.surrogate.workers import workplace
from bayesdeg.training import TrainingOptions, emulator_for, refuse_cells


def run(
    study: Path,
    effort: Effort | None,
    out: Path | None,
    seed: int | None,
    workers: int,
    scheduler: str | None,
    emulator: Path | None,
    refine: bool,
    backend: Backend,
    fresh: bool,
    yes: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Do what `interface.run` says."""
    with shown(quiet) as progress:
        checked = with_options(read_study(study, progress), effort, seed)
    kind = kind_of_study(checked)
    own = not kind.is_of_actuators
    if not own:
        refuse_cells(checked.settings, backend)
    unlikely = kind.doubts(checked)
    target, guard = out or Path("reports") / checked.name, Guard()
    # other processes do not know the functions of a study folder
    workers, scheduler = (1, None) if own else (workers, scheduler)
    with workplace(workers, scheduler) as executor, run_folder(target, checked) as folder:
        if not quiet:
            say((*messages(checked.photographs), *captured_messages(checked.captured)))
            say(f"in doubt: {doubt}" for doubt in unlikely)
            say(f"without {what}: {cost}" for what, cost in passed_over(checked))
        if checked.actuator is not None:
            compile_beside()
        options = TrainingOptions(yes=yes, quiet=quiet, refine=refine, backend=backend)
        forward = (
            None if own else emulator_for(checked, emulator, options=options, executor=executor)
        )
        checkpoints = Checkpoints(target / CHECKPOINTS, fingerprint(checked, forward))
        if fresh:
            checkpoints.clear()
        work = partial(run_study, executor=executor, forward=forward, guard=guard)
        with shown(quiet) as progress:
            document = work(checked, folder, checkpoints, progress=progress)
            progress.stage("report")
            document, page = add_page(folder, document, guard)
    if not (quiet and as_json):
        _say_verdict(document, page, errors if as_json else output(), checked.settings)
    if not quiet:
        say(_notices(document))
        _say_left_out(guard, target)
    if as_json:
        sys.stdout.write(json.dumps(RunFolder(target).read_json("verdict"), indent=2) + "\n")


def _notices(document: VerdictRecord) -> Iterator[str]:
    """Yield warnings to read before the verdict is used."""
    yield from (f"in doubt: {why}" for why in doubts_of(document))
    yield from (f"not used: {one.sentence}" for one in document.unused)
    yield from (f"not converged: {one}" for one in document.not_converged)


def _say_left_out(guard: Guard, target: Path) -> None:
    if not guard.left_out:
        return
    errors.print("\nleft out because it could not be computed:", style="yellow")
    for one in guard.left_out:
        said = f"  {one.stage}: {one.why}"
        errors.print(said, style="yellow", soft_wrap=True)
    errors.print(f"what happened: {target / LEFT_OUT}", soft_wrap=True)


def _say_verdict(
    verdict: VerdictRecord, page: Path | None, printed: Console, settings: Settings
) -> None:
    label = "virtual experiment: " if settings.virtual else ""
    names = ", ".join(verdict.causes)
    outcome = (f"{label}{verdict.outcome}", "bold")
    printed.print(Text.assemble(outcome, f": {names}" if names else ""))
    sets = sets_of(verdict)
    if sets:
        printed.print(f"sets of causes that may be right: {sets}", soft_wrap=True)
    printed.print(verdict.explanation)
    if page is not None:
        printed.print(f"report: {page}", soft_wrap=True)
