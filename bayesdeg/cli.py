"""The command line: ``bayesdeg run STUDY`` and what stands around it."""

import json
import os
import sys
import traceback
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated
from zipfile import BadZipFile

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

import bayesdeg
from bayesdeg.actuator.forward import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import FINE
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.console import errors, pool, shown
from bayesdeg.emulator.build import build
from bayesdeg.emulator.build import runs as campaign_runs
from bayesdeg.emulator.store import from_bytes, to_bytes
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.errors import BayesdegError, StudyError
from bayesdeg.laboratory.design import design_of
from bayesdeg.laboratory.effects import parse_effects
from bayesdeg.laboratory.experiment import run_experiment
from bayesdeg.laboratory.truth import Truth, drawn_truth
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.measure.settings import Dimensions
from bayesdeg.measure.study import Study, read_study
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.run import fingerprint, run_study
from bayesdeg.report.checkpoints import Checkpoints
from bayesdeg.report.folder import RunFolder
from bayesdeg.report.page import build_page

app = typer.Typer(
    name="bayesdeg",
    help="Bayesian calibration of degrading soft actuators: names what the simulation gets wrong.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

INPUT_FAULT, OUR_FAULT, STOPPED = 2, 1, 3


class EffortChoice(StrEnum):
    """How much is spent on sampling."""

    QUICK = "quick"
    STANDARD = "standard"
    THOROUGH = "thorough"


StudyFolder = Annotated[
    Path, typer.Argument(help="A study folder: study.toml and CSV files.", metavar="STUDY")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but the result.")]


@app.command()
def run(
    study: StudyFolder,
    effort: Annotated[
        EffortChoice | None, typer.Option(help="Instead of the study's own effort.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Run folder; by default reports/<name of the study>.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the study's own seed.")] = None,
    workers: Annotated[
        int, typer.Option(help="Processes; the results do not depend on it.", min=1)
    ] = min(4, os.cpu_count() or 1),
    emulator: Annotated[
        Path | None, typer.Option(help="An emulator of another geometry, made by 'emulate'.")
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Do everything again, resume nothing.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print verdict.json last.")] = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate, criticise, name the cause, measure the gain, predict, and write the report.

    An interrupted run goes on where it stopped.
    """
    checked = _with_options(read_study(study), effort, seed)
    target = out or Path("reports") / checked.name
    forward = None if emulator is None else _read_emulator(emulator)
    checkpoints = Checkpoints(target / "checkpoints", fingerprint(checked, forward))
    if fresh:
        checkpoints.clear()
    with shown(quiet) as progress, pool(workers) as executor:
        document = run_study(
            checked,
            RunFolder(target),
            checkpoints,
            progress=progress,
            executor=executor,
            forward=forward,
        )
        progress.stage("report")
        page = build_page(target)
    if not quiet:
        _say_verdict(document, page, virtual=checked.settings.virtual)
    if as_json:
        sys.stdout.write(json.dumps(RunFolder(target).read_json("verdict"), indent=2) + "\n")


@app.command()
def check(study: StudyFolder) -> None:
    """Read and check the data only; exit code 2 and the list of faults if there are any."""
    checked = read_study(study)
    assembly = assemble(checked)
    table = Table(title=f"{checked.name}: no faults", title_justify="left")
    for heading in ("file", "rows", "read"):
        table.add_column(heading, justify="right" if heading == "rows" else "left")
    for name, frame in _tables(checked):
        table.add_row(name, "–" if frame is None else str(frame), "" if frame else "not there")
    errors.print(table)
    for what, cost in assembly.missing:
        errors.print(f"without {what}: {cost}")


@app.command()
def causes() -> None:
    """List the catalogue: mechanism, parameters with units and priors, what reveals each cause."""
    console = Console()
    for cause in CATALOGUE.values():
        console.print(f"[bold]{cause.name}[/bold]: {cause.mechanism}")
        for p in cause.parameters:
            console.print(f"    {p.name} [{p.unit}]: {p.meaning}; prior {p.law}", markup=False)
        console.print(f"    revealed by: {cause.revealed_by}", markup=False)
        if cause.confusable_with:
            console.print(f"    can be confused with: {', '.join(cause.confusable_with)}")
        if cause.needs:
            console.print(f"    needs columns: {', '.join(cause.needs)}")


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="REPORT")],
) -> None:
    """Rebuild the HTML report from a run folder without computing anything."""
    errors.print(f"wrote {build_page(folder)}")


@app.command()
def simulate(
    study: StudyFolder,
    out: Annotated[Path, typer.Option(help="Folder for the virtual study.")],
    cause: Annotated[
        list[str] | None,
        typer.Option(
            help="An effect to hide, NAME=VALUE or NAME.PARAMETER=VALUE; may be repeated."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the study's own seed.")] = None,
    draw_material: Annotated[
        bool,
        typer.Option("--draw-material", help="Draw the material laws anew instead of the default."),
    ] = False,
    workers: Annotated[int, typer.Option(help="Processes.", min=1)] = min(4, os.cpu_count() or 1),
    quiet: Quiet = False,
) -> None:
    """Make a virtual experiment with the study's design, from a fine finite element model.

    The curves take about half a minute each. What was hidden stands in truth.json, which no other
    command opens.
    """
    template = read_study(study)
    chosen = template.settings.seed if seed is None else seed
    generator = np.random.default_rng(chosen)
    effects = parse_effects(cause or [])
    truth = drawn_truth(generator) if draw_material else Truth()
    design = design_of(template)
    geometry = Geometry(template.settings.dimensions)
    with shown(quiet) as progress, pool(workers) as executor:
        curves = design.actuator["specimen_id"].nunique()
        progress.stage("finite element curves", total=curves)
        forward = ExactMap(geometry, FINE, executor=executor, on_curve=progress.advance)
        experiment = run_experiment(
            design, truth, forward=forward, generator=generator, effects=effects
        )
    named = " ".join(f"--cause {text}" for text in cause or [])
    drawn = " --draw-material" if draw_material else ""
    command = f"bayesdeg simulate {study} {named}{drawn} --out {out} --seed {chosen}"
    provenance = Provenance(command=command, seed=chosen, mesh=vars(FINE))
    out.mkdir(parents=True, exist_ok=True)
    for name, text in study_files(experiment, template.settings, provenance=provenance).items():
        if not (name == "study.toml" and study.resolve() == out.resolve()):
            (out / name).write_text(text, encoding="utf-8")
    errors.print(f"wrote a virtual experiment to {out}", highlight=False)


@app.command()
def emulate(
    geometry: Annotated[
        Path | None,
        typer.Argument(help="A study folder with the geometry; by default that of the paper."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Where the trained emulator goes.")] = Path(
        "emulator.npz"
    ),
    store: Annotated[
        Path, typer.Option(help="Folder of finite element solutions, to go on from.")
    ] = Path(".cache/campaign"),
    workers: Annotated[int, typer.Option(help="Processes.", min=1)] = min(4, os.cpu_count() or 1),
    quiet: Quiet = False,
) -> None:
    """Train an emulator: some 300 finite element curves, half an hour to an hour on two cores.

    Solutions are kept as they come; the same command goes on where it was stopped.
    """
    dimensions = Dimensions() if geometry is None else read_study(geometry).settings.dimensions
    actuator = Geometry(dimensions)
    with shown(quiet) as progress, pool(workers) as executor:
        coarse, fine = campaign_runs(actuator)
        progress.stage("finite element curves", total=len(coarse) + len(fine))
        surrogate = build(actuator, store, executor=executor, on_run=progress.advance)
    out.write_bytes(to_bytes(surrogate))
    errors.print(f"wrote {out}\n{surrogate.record}", highlight=False)


def _read_emulator(path: Path) -> Surrogate:
    try:
        return from_bytes(path.read_bytes())
    except (OSError, ValueError, KeyError, BadZipFile) as fault:
        raise BayesdegError(f"{path} is no emulator made by 'bayesdeg emulate': {fault}") from fault


def _with_options(study: Study, effort: EffortChoice | None, seed: int | None) -> Study:
    settings = study.settings
    if effort is not None:
        settings = replace(settings, effort=effort.value)
    if seed is not None:
        settings = replace(settings, seed=seed)
    return replace(study, settings=settings)


def _tables(study: Study) -> Iterator[tuple[str, int | None]]:
    for name in ("moisture", "shrinkage", "tensile", "breaks", "actuator", "summary"):
        frame = getattr(study, name)
        yield (
            ("break.csv" if name == "breaks" else f"{name}.csv"),
            None if frame is None else len(frame),
        )


def _say_verdict(document: dict[str, object], page: Path, *, virtual: bool) -> None:
    label = "virtual experiment: " if virtual else ""
    names = ", ".join(str(c) for c in document["causes"])  # type: ignore[attr-defined]
    errors.print(f"\n[bold]{label}{document['outcome']}[/bold]{': ' + names if names else ''}")
    errors.print(str(document["explanation"]), markup=False, highlight=False)
    errors.print(f"\nreport: {page}", highlight=False)


def main() -> None:
    """Run the command line with the exit codes of the contract."""
    try:
        app(standalone_mode=False)
    except StudyError as fault:
        for line in fault.faults:
            errors.print(str(line), style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(INPUT_FAULT)
    except BayesdegError as fault:
        errors.print(str(fault), style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(INPUT_FAULT)
    except typer.Exit as done:
        sys.exit(done.exit_code)
    except KeyboardInterrupt:
        errors.print("stopped; the same command goes on where this run stopped")
        sys.exit(STOPPED)
    except Exception as fault:
        if hasattr(fault, "format_message") and hasattr(fault, "exit_code"):  # click's usage errors
            errors.print(fault.format_message(), style="red", markup=False)
            sys.exit(INPUT_FAULT)
        traceback.print_exc()
        errors.print(
            f"This is a fault of bayesdeg {bayesdeg.__version__}: please send us the above."
        )
        sys.exit(OUR_FAULT)


if __name__ == "__main__":
    main()
