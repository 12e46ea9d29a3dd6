"""``bayesdeg check``: read and check a study and draw its actuator, without computing."""

import importlib
from collections.abc import Iterator
from math import isnan
from pathlib import Path

from rich.table import Table
from rich.text import Text

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.section import across, described, section
from bayesdeg.assembly.outline import outline, unused
from bayesdeg.assembly.reading import read_study
from bayesdeg.commands.options import CORES
from bayesdeg.console import output, say
from bayesdeg.data.captures import captured_messages
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.moisture import MASS_LOSS_SLOPE, mass_loss_slope
from bayesdeg.data.photographs import messages
from bayesdeg.data.plausibility import doubts, names_alike, refuse_impossible
from bayesdeg.data.shrinkage import film_masses, mean_as_printed, mean_over_films
from bayesdeg.data.study import Study
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.display import shown
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.surrogate.kept import duration, rough_seconds, search

_LABELLED = {"specimen_id": "specimens", "film_id": "films"}


def check(study: Path) -> None:
    """Do what `interface.check` says."""
    with shown(False) as progress:
        checked = read_study(study, progress)
    say(messages(checked.photographs), output())
    say(captured_messages(checked.captured), output())
    if checked.settings.forward is not None:
        _check_own(checked)
        return
    plan = outline(checked)
    unlikely = refuse_impossible(doubts(checked, plan.expected))
    doubted = f", {len(unlikely)} in doubt" if unlikely else ""
    table = Table(title=Text(f"{checked.name}: no faults{doubted}"), title_justify="left")
    for heading in ("file", "rows", "read"):
        table.add_column(heading, justify="right" if heading == "rows" else "left")
    for name, rows, read in _tables(checked):
        table.add_row(name, "–" if rows is None else str(rows), read)
    output().print(table)
    say((f"in doubt: {doubt}" for doubt in unlikely), output())
    say((f"not used: {rows}" for rows in unused(checked)), output())
    for what, cost in plan.missing:
        output().print(f"without {what}: {cost}", soft_wrap=True)
    for line in (*_shrinkage(checked), *_mass_loss(checked)):
        output().print(line, soft_wrap=True)
    if plan.has_actuators:
        _say_how_read(checked)
        geometry = geometry_of_study(checked.settings)
        output().print(described(geometry), soft_wrap=True, markup=False, highlight=False)
        drawings = [section(geometry)]
        if geometry.dimensions.kind == "cylindrical":  # all sections along it look alike
            drawings += ["", across(geometry)]
        for drawing in drawings:
            output().print(drawing, soft_wrap=True, markup=False, highlight=False)
        say(map(_said, checked.settings.uncertain), output())
        if isinstance(mould := geometry.dimensions, MeshDimensions):
            say(filter(None, [mould.assumption]), output())
        _say_how_long(geometry, checked.settings.uncertain)


def _shrinkage(study: Study) -> Iterator[str]:
    """Return the volume ratio of the films as used, and by Eqs 15 and 16."""
    if study.shrinkage is None:
        return
    masses, recipe = film_masses(study.shrinkage), study.settings.shrinkage
    used, printed = mean_over_films(masses, recipe)[0], mean_as_printed(masses, recipe)
    yield (
        f"volume ratio α of {used.count} film{'s' if used.count > 1 else ''}: "
        f"{_with_error(used.value, used.standard_error)} from the volumes of the components "
        f"(used); {_with_error(printed.value, printed.standard_error)} from Eqs 15 and 16 as "
        "printed, which average densities by mass"
    )


def _mass_loss(study: Study) -> Iterator[str]:
    """Return the slope of Eq. 6 from the control experiment, and the published one."""
    if study.mass_loss is None:
        return
    try:
        found = mass_loss_slope(study.mass_loss)
    except ValueError as fault:
        yield f"mass_loss.csv: {fault}"
        return
    yield (
        f"mass loss over degradation rate of {found.samples} "
        f"sample{'s' if found.samples > 1 else ''}: {_with_error(found.dry, found.dry_se)} with "
        f"moisture on the dry basis (published: {MASS_LOSS_SLOPE}, Eq. 6); "
        f"{_with_error(found.wet, found.wet_se)} on the wet basis, which other files use for D_R"
    )


def _with_error(value: float, error: float) -> str:
    """Format a number with its standard error, if known."""
    return f"{value:.3g}" if isnan(error) else f"{value:.3g} ± {error:.2g}"


def _say_how_long(geometry: Moulded, uncertain: tuple[UncertainDimension, ...]) -> None:
    """Say roughly how long training an emulator takes, if one is needed."""
    found = search(geometry)
    if found.source is not None and not uncertain:
        return
    seconds = rough_seconds(
        geometry.dimensions,
        geometry.constraint,
        workers=CORES,
        moved=uncertain,
        alone=found.source is not None,
    )
    reason = found.reason if found.source is None else f"{uncertain[0].name} is a prior"
    output().print(
        f"{reason}; 'bayesdeg run' trains one first: {duration(seconds)} with "
        f"--workers {CORES}, a rough guess until it has timed the meshes",
        soft_wrap=True,
    )


def _said(one: UncertainDimension) -> str:
    """Describe a dimension that is given as a prior."""
    left_out = (
        f"; no actuator can be made in {100.0 * one.lost:.2g} % of it" if one.lost > 0.0 else ""
    )
    return (
        f"{one.name} is a prior: {one.median:.4g} ± {one.step:.2g} mm, limited to {one.low:.4g} "
        f"to {one.high:.4g} mm{left_out}"
    )


def _say_how_read(study: Study) -> None:
    """Say with which operator curvatures are read, and from what."""
    operator = study.settings.reading.operator
    if study.line_points is not None and study.actuator is not None:
        output().print(
            f"{len(study.actuator)} lines: curvature and bend angle are read from "
            f"{study.line_points} equidistant points each, as {operator or 'angle_over_arc'}, "
            "as they are from the model's line",
            soft_wrap=True,
        )
    elif operator is None:
        output().print(
            "study.toml does not state [reading] operator: curvatures are assumed to be "
            "angle_over_arc, bend angle over arc length; a circle fitted to the bottom line gives "
            "up to a fifth more, which looks like shrinkage_reading",
            soft_wrap=True,
            markup=False,
        )


def _check_own(study: Study) -> None:
    """Try the forward map and the causes of a study, and list its readings."""
    # these import the engine, which no other check needs
    found = importlib.import_module("bayesdeg.assembly.assemble").assemble(study)
    title = f"{study.name}: no faults"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("what")
    table.add_column("found")
    own = importlib.import_module("bayesdeg.inference.own_map").own_map_of(found.model)
    for block in own.readings:
        specimens = len(set(block.places.specimen.tolist()))
        table.add_row(block.name, f"{len(block.y)} readings on {specimens} specimens")
    table.add_row("inputs", ", ".join(block.x) if isinstance(block.x, dict) else "x")
    table.add_row("function", own.source)
    table.add_row("parameters", ", ".join(found.model.table.names))
    table.add_row("causes", ", ".join(cause.name for cause in found.candidates) or "none")
    output().print(table)
    say((f"in doubt: {doubt}" for doubt in names_alike(study)), output())
    for what, cost in found.missing:
        output().print(f"without {what}: {cost}", soft_wrap=True)


def _tables(study: Study) -> Iterator[tuple[str, int | None, str]]:
    """Yield the files of a study with their rows and number of specimens."""
    for name, table in TABLES.items():
        frame = study.given(name)
        read = study.table(name) is not None and frame is None
        if frame is not None:
            labels = [column for column in ("specimen_id", "film_id") if column in frame]
            counts = [f"{frame[column].nunique()} {_LABELLED[column]}" for column in labels]
            yield table.file, len(frame), ", ".join(counts)
        elif not read and table.cost_in(degrades=study.degrades):
            yield table.file, None, "missing"
