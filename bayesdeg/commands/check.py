"""``bayesdeg check``: read and check a study and draw its actuator, and compute nothing."""

import importlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text

from bayesdeg.actuator.families import PartGeometry, geometry_of_study
from bayesdeg.actuator.moulded import Box, Moulded, volume_without
from bayesdeg.commands.options import CORES
from bayesdeg.console import errors, say, shown
from bayesdeg.data.captures import captured_messages
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.part import cavity_of
from bayesdeg.data.photographs import messages
from bayesdeg.data.plausibility import doubts, refuse_impossible
from bayesdeg.data.study import Study
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.emulator.kept import duration, rough_seconds, search
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.reading import read_study

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

# of a section that is drawn
MATERIAL, PRESSED, OPEN, LAYER, OUTSIDE = "#", " ", "o", "=", "-"
COLUMNS, ACROSS = 76, 40
CELL = 2.0  # height over width of a character


def check(study: Path) -> None:
    """Do what `interface.check` says."""
    with shown(False) as progress:
        checked = read_study(study, progress)
    say(messages(checked.photographs))
    say(captured_messages(checked.captured))
    if checked.settings.forward is not None:
        _check_own(checked)
        return
    plan = outline(checked)
    unlikely = refuse_impossible(doubts(checked, plan.expected))
    doubted = f", {len(unlikely)} in doubt" if unlikely else ""
    table = Table(title=Text(f"{checked.name}: no faults{doubted}"), title_justify="left")
    for heading in ("file", "rows", "read"):
        table.add_column(heading, justify="right" if heading == "rows" else "left")
    for name, frame in _tables(checked):
        table.add_row(name, "–" if frame is None else str(frame), "" if frame else "not there")
    errors.print(table)
    say(f"in doubt: {doubt}" for doubt in unlikely)
    for what, cost in plan.missing:
        errors.print(f"without {what}: {cost}", soft_wrap=True)
    if plan.has_actuators:
        _say_how_read(checked)
        geometry = geometry_of_study(checked.settings)
        errors.print(described(geometry), soft_wrap=True, markup=False, highlight=False)
        drawings = [section(geometry)]
        if geometry.dimensions.kind == "cylindrical":  # along it all sections look alike
            drawings += ["", across(geometry)]
        for drawing in drawings:
            errors.print(drawing, soft_wrap=True, markup=False, highlight=False)
        say(map(_said, checked.settings.uncertain))
        if isinstance(mould := geometry.dimensions, MeshDimensions):
            say(filter(None, [mould.assumption]))
        _say_how_long(geometry, checked.settings.uncertain)


def _say_how_long(geometry: Moulded, uncertain: tuple[UncertainDimension, ...]) -> None:
    """Say roughly how long an emulator of the actuator is trained, if one is."""
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
    errors.print(
        f"{reason}; 'bayesdeg run' trains one first: {duration(seconds)} with "
        f"--workers {CORES}, a rough guess that it replaces by a measured time",
        soft_wrap=True,
    )


def _said(one: UncertainDimension) -> str:
    """Say what is known of a dimension that is a prior."""
    left_out = f"; {100.0 * one.lost:.2g} % of its law has no actuator" if one.lost > 0.0 else ""
    return (
        f"{one.name} is a prior: {one.median:.4g} ± {one.step:.2g} mm, taken from {one.low:.4g} "
        f"to {one.high:.4g} mm{left_out}"
    )


def _say_how_read(study: Study) -> None:
    """Say by which operator curvatures are read, and of what."""
    operator = study.settings.operator
    if study.line_points is not None and study.actuator is not None:
        errors.print(
            f"{len(study.actuator)} lines: curvature and bend angle are read of "
            f"{study.line_points} even points each, as {operator or 'angle_over_arc'}, and so is "
            "the model's own line",
            soft_wrap=True,
        )
    elif operator is None:
        errors.print(
            "study.toml does not state [reading] operator: curvatures are taken for "
            "angle_over_arc, bend angle over arc length; a circle fitted to the bottom line reads "
            "up to a fifth more, which looks like shrinkage_reading",
            soft_wrap=True,
            markup=False,
        )


def _check_own(study: Study) -> None:
    """Try the forward map and the causes of a study, and say what there is."""
    # brings the engine along, which no other check needs
    found = importlib.import_module("bayesdeg.pipeline.assemble").assemble(study)
    title = f"{study.name}: no faults"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("what")
    table.add_column("found")
    own = found.own
    assert own is not None
    for block in own.readings:
        specimens = len(set(block.places.specimen.tolist()))
        table.add_row(block.name, f"{len(block.y)} readings on {specimens} specimens")
    table.add_row("inputs", ", ".join(block.x) if isinstance(block.x, dict) else "x")
    table.add_row("function", own.source)
    table.add_row("parameters", ", ".join(found.model.table.names))
    table.add_row("causes", ", ".join(cause.name for cause in found.candidates) or "none")
    errors.print(table)
    for what, cost in found.missing:
        errors.print(f"without {what}: {cost}", soft_wrap=True)


def _tables(study: Study) -> Iterator[tuple[str, int | None]]:
    for name, table in TABLES.items():
        frame = study.given(name)
        read = study.table(name) is not None and frame is None
        if not read and (frame is not None or table.cost_in(degrades=study.degrades)):
            yield table.file, None if frame is None else len(frame)


def air_volume(geometry: Moulded) -> float:
    """Return the volume of the cavities under pressure of the whole actuator [mm³].

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(air_volume(geometry_of(Dimensions())), 6)
    924.0
    """
    if isinstance(geometry, PartGeometry):
        part = geometry.part
        return cavity_of(part)[0] * (2.0 if part.is_half else 1.0)
    planes = geometry.planes()
    return 2.0 * (volume_without(planes, ()) - volume_without(planes, geometry.cavities))


def described(geometry: Moulded) -> str:
    """Say what an actuator is: family, dimensions, layer and volumes.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import RibbedDimensions
    >>> described(geometry_of(RibbedDimensions())).partition(", width")[0]
    'ribbed actuator as moulded [mm]: length 37.8'
    """
    mould, layer = geometry.dimensions, geometry.constraint
    shown = vars(mould).items()
    hidden = ("path", "content", "bending")
    sizes = ", ".join(f"{name} {value}" for name, value in shown if name not in hidden)
    at = f"{layer.kind} at a height of {geometry.line_height:g}" if layer.is_there else "none"
    if layer.is_slab:
        c1, c2, c3 = layer.c1, layer.c2, layer.c3
        at += f", {layer.thickness:g} thick, C1 {c1:g}, C2 {c2:g}, C3 {c3:g} kPa"
    return (
        f"{mould.kind} actuator as moulded [mm]: {sizes}; constraint layer: {at}; "
        f"material {1e-3 * geometry.volume:.4g} ml, cavity {1e-3 * air_volume(geometry):.3g} ml"
    )


def section(geometry: Moulded, columns: int = COLUMNS) -> str:
    """Draw the section along the middle of an actuator, the clamped end on the left.

    Material is ``#``, air under pressure blank, other air ``o``, the constraint layer ``=``; of a
    meshed part all air is blank.

    Parameters
    ----------
    geometry : Moulded
        Of any family.
    columns : int
        Characters for the length.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.settings import Dimensions
    >>> print(section(geometry_of(Dimensions(length=20.0, chambers=2)), 40))
    ##################oooo##################
    ##################oooo##################
    ######         ###oooo###         ######
    ######         ###oooo###         ######
    ######         ###oooo###         ######
    ######         ##########         ######
    ######         ##########         ######
    ######                            ######
    ########################################
    ########################################
    ========================================
    """
    (_, length), _, (bottom, top) = geometry.outer
    if isinstance(geometry, PartGeometry):
        return _of_bricks(geometry, columns)
    rows = max(2, round((top - bottom) / length * columns / CELL))
    x = length * (np.arange(columns) + 0.5) / columns
    z = top - (top - bottom) * (np.arange(rows) + 0.5) / rows
    drawn = np.full((rows, columns), MATERIAL)
    for boxes, mark in ((geometry.voids, OPEN), (geometry.cavities, PRESSED)):
        for box in boxes:
            drawn[np.ix_(*_within(box, z, x))] = mark
    for box in geometry.slab:
        drawn[np.ix_(*_within(box, z, x))] = LAYER
    lines = ["".join(row) for row in drawn]
    if geometry.constraint.is_there and LAYER not in drawn:
        lines.insert(int(np.sum(z > geometry.line_height)), LAYER * columns)
    return "\n".join(lines)


def _of_bricks(geometry: PartGeometry, columns: int) -> str:
    """Draw the bricks of a part that its middle plane cuts, or touches where it ends there.

    A character is material where it lies in the rectangle about the section of a brick.
    """
    part = geometry.part
    corners = part.points[part.bricks]
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 1e-3 * float(part.size[1])  # beside the plane, in which faces may lie
    cut = (low[:, 1] <= middle) & (high[:, 1] >= middle)
    length, top = float(part.size[0]), float(part.size[2])
    rows = max(2, round(top / length * columns / CELL))
    x = length * (np.arange(columns) + 0.5) / columns
    z = top - top * (np.arange(rows) + 0.5) / rows
    drawn = np.full((rows, columns), PRESSED)
    for a, b in zip(low[cut], high[cut], strict=True):
        drawn[np.ix_((a[2] <= z) & (z <= b[2]), (a[0] <= x) & (x <= b[0]))] = MATERIAL
    lines = ["".join(row) for row in drawn]
    if geometry.constraint.is_there:
        lines.insert(int(np.sum(z > geometry.line_height)), LAYER * columns)
    return "\n".join(lines)


def across(geometry: Moulded, columns: int = ACROSS) -> str:
    """Draw the section across the middle of an actuator's length, seen along it.

    As `section`; what lies outside a round outline is ``-``.

    Parameters
    ----------
    geometry : Moulded
        Of any family.
    columns : int
        Characters for the width.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import CylindricalDimensions
    >>> print(across(geometry_of(CylindricalDimensions(section="round")), 24))
    ------############------
    --#########  #########--
    -######################-
    ========================
    ########################
    -######################-
    --#########oo#########--
    ------############------
    """
    (_, length), (_, half), (bottom, top) = geometry.outer
    rows = max(2, round((top - bottom) / (2.0 * half) * columns / CELL))
    y = half * (2.0 * (np.arange(columns) + 0.5) / columns - 1.0)
    z = top - (top - bottom) * (np.arange(rows) + 0.5) / rows
    drawn = np.full((rows, columns), MATERIAL)
    parts = (geometry.voids, OPEN), (geometry.cavities, PRESSED), (geometry.slab, LAYER)
    for boxes, mark in parts:
        for (first, last), beside, upward in boxes:
            if first < 0.5 * length < last:
                drawn[np.ix_(*_within((beside, beside, upward), z, np.abs(y)))] = mark
    if geometry.rounded is not None:
        inside = geometry.rounded.holds(y[None, :], z[:, None])
        drawn = np.where(inside, drawn, OUTSIDE)
    lines = ["".join(row) for row in drawn]
    if geometry.constraint.is_membrane:
        place = int(np.sum(z > geometry.line_height))
        lines.insert(place, LAYER * columns)
    return "\n".join(lines)


def _within(box: Box, z: Floats, x: Floats) -> tuple[Bools, Bools]:
    """Return which heights and which places along the middle lie in a box."""
    along, _, upward = box
    return (upward[0] < z) & (z < upward[1]), (along[0] < x) & (x < along[1])
