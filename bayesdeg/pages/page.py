"""Build one self-contained HTML page from a run folder, without recomputing anything."""

import base64
import hashlib
import importlib
import pkgutil
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from bayesdeg.criticism.findings import Candidate
from bayesdeg.pages import figures, wording
from bayesdeg.pages.drawing import Drawing, PageFigure, Shown
from bayesdeg.pages.folder import RUN, VERDICT, RunFolder
from bayesdeg.pages.headline import Headline, doubts_of, headline_of, sets_of
from bayesdeg.pages.left_out import FIGURE, Guard, OptionalStage, figure_stage
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.summaries import (
    DecisionPair,
    GainParts,
    LevelRow,
    ParameterRow,
    Row,
    TensileError,
    by_criterion,
    decision_pairs,
    extended_model,
    farthest_first,
    gain_parts,
    influence_of_criteria,
    level_rows,
    meanings_of,
    parameter_rows,
    pooled,
    rows_of,
    several_levels,
    tensile_errors,
)
from bayesdeg.pages.surface import read_surface
from bayesdeg.pages.tables import NOT_OF_ACTUATORS, TABLES
from bayesdeg.pages.wording import environment


def _discover() -> dict[str, PageFigure]:
    names = (f"{figures.__name__}.{entry.name}" for entry in pkgutil.iter_modules(figures.__path__))
    modules = [importlib.import_module(name) for name in names]
    return {figure.name: figure for module in modules for figure in module.FIGURES}


#: Every figure listed by the modules of `bayesdeg.pages.figures`, by its name in the page.
FIGURES: dict[str, PageFigure] = _discover()


def drawings_of(shown: Shown, guard: Guard | None = None) -> dict[str, Drawing]:
    """Draw every figure for which the run has data.

    Parameters
    ----------
    shown : Shown
        What the run found.
    guard : Guard, optional
        Leaves out figures that fail; by default nothing is left out and faults are raised.

    Returns
    -------
    dict
        By name; those without data are left out.
    """
    guard = guard or Guard(strict=True)
    drawn = (
        guard.attempt(figure_stage(name), figure.drawing, shown) for name, figure in FIGURES.items()
    )
    return {drawing.name: drawing for drawing in drawn if drawing is not None}


@dataclass(frozen=True)
class Content:
    """Everything the template shows."""

    verdict: VerdictRecord
    run: RunRecord
    headline: Headline
    drawings: dict[str, Drawing]
    judged: list[Candidate]
    not_judged: list[Candidate]
    levels: list[LevelRow]
    gain: list[Row]
    gain_by_level: list[Row]
    extended: str | None
    parameters: list[ParameterRow]
    tensile: list[TensileError]
    measured: list[Row]
    leave_one_out: list[Row]
    sensitivity: list[Row]
    absorption: list[Row]
    orders: list[Row]
    laws: list[Row]
    gain_levels: list[Row]
    gain_modes: list[Row]
    decisions: list[DecisionPair]
    missing_terms: list[Row]
    sets: list[Row]
    supported: str
    criteria: list[Row]
    criteria_influence: str
    lookalikes: list[str]
    sized: list[Candidate]
    meanings: defaultdict[str, str]
    gain_parts: GainParts | None
    files: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...] = ()
    doubts: tuple[str, ...] = ()
    updated: str = ""
    before_update: frozenset[str] = frozenset()


def build_page(folder: Path, guard: Guard | None = None) -> Path:
    """Write the report of a run.

    Parameters
    ----------
    folder : pathlib.Path
        A run folder that holds at least ``verdict.json`` and ``run.json``.
    guard : Guard, optional
        Leaves out figures that fail; by default a new one, which reports them only in the page.

    Returns
    -------
    pathlib.Path
        The page: one HTML file that needs nothing outside itself.

    Raises
    ------
    BayesdegError
        If the folder is incomplete or a file is damaged.
    """
    run_folder = RunFolder(folder)
    verdict, run = run_folder.read_verdict(), run_folder.read_run()
    kept = (run_folder.read_tables(), read_surface(folder), run_folder.draws_of)
    shown = Shown(verdict, run, *kept, pictures=run_folder.read_pictures())
    return run_folder.write_page(render(content_of(shown, guard or Guard())))


def content_of(shown: Shown, guard: Guard | None = None) -> Content:
    """Arrange what a run found for the template."""
    guard = guard or Guard(strict=True)
    verdict, tables, drawings = shown.verdict, shown.tables, drawings_of(shown, guard)
    return Content(
        verdict=verdict,
        run=shown.run,
        headline=headline_of(verdict, tables["gain"]),
        drawings=drawings,
        judged=[entry for entry in verdict.candidates if entry.probability is not None],
        not_judged=[entry for entry in verdict.candidates if entry.probability is None],
        levels=level_rows(tables["levels"]),
        gain=rows_of(pooled(tables["gain"])),
        gain_by_level=rows_of(several_levels(tables["gain"])),
        extended=extended_model(tables["gain"], verdict),
        parameters=parameter_rows(tables["parameters"]),
        tensile=tensile_errors(tables["tensile"]),
        measured=rows_of(tables["measured"]),
        leave_one_out=rows_of(tables["leave_one_out"]),
        sensitivity=rows_of(tables["prior_sensitivity"]),
        absorption=farthest_first(tables["absorption"]),
        orders=rows_of(tables["orders"]),
        laws=rows_of(tables["material_laws"]),
        gain_levels=rows_of(pooled(tables["gain_levels"])),
        gain_modes=sorted(rows_of(tables["gain_modes"]), key=lambda row: str(row["mode"])),
        decisions=decision_pairs(tables["decisions"]),
        missing_terms=rows_of(tables["missing_terms"]),
        sets=rows_of(tables["sets"]),
        supported=sets_of(verdict),
        criteria=by_criterion(tables["criteria"]),
        criteria_influence=influence_of_criteria(tables["criteria"], degrades=shown.run.degrades),
        lookalikes=lookalikes(verdict),
        sized=[c for c in map(verdict.candidate, verdict.causes) if c is not None and c.effect],
        meanings=defaultdict(str, meanings_of(tables["parameters"])),
        gain_parts=gain_parts(tables["gain"], verdict),
        files=(*tables.files, f"{VERDICT}.json", f"{RUN}.json"),
        left_out=_left_out(verdict, guard),
        doubts=doubts_of(verdict),
        updated=_updated(shown.run),
        before_update=_before_update(shown.run),
    )


def _updated(run: RunRecord) -> str:
    """Say which readings were added after the run; empty if none were."""
    if run.update is None:
        return ""
    return wording.sentences("run", "updated", update=run.update, degrades=run.degrades)


def _before_update(run: RunRecord) -> frozenset[str]:
    """Return the files from before the update that the new readings could have changed."""
    kept = () if run.update is None else run.update.as_before
    return frozenset(kept) - {TABLES[name].file for name in NOT_OF_ACTUATORS}


def _left_out(verdict: VerdictRecord, guard: Guard) -> tuple[tuple[str, str], ...]:
    """Return what the run left out, with the figures that fail now, not those that failed then."""
    of_page = (FIGURE, OptionalStage.PAGE)
    stages = [(o.stage, o.why) for o in verdict.left_out if not o.stage.startswith(of_page)]
    figures = [(o.stage, o.why) for o in guard.left_out if o.stage.startswith(FIGURE)]
    return (*stages, *figures)


def lookalikes(verdict: VerdictRecord) -> list[str]:
    """Return causes that a study of this design could mistake for a named one."""
    near = (set(pair) for pair in verdict.confusable if set(pair) & set(verdict.causes))
    return sorted(set().union(*near) - set(verdict.causes))


def render(content: Content) -> str:
    """Fill the template."""
    names = [candidate.cause for candidate in content.verdict.candidates]
    page = environment(autoescape=True)
    page.filters |= {
        "unbroken": _unbroken,
        "plain": lambda text: wording.plain(text, names),
        "drawing": lambda drawing: Markup(drawing.svg),
    }
    assert page.loader is not None
    script = page.loader.get_source(page, "page.js")[0]
    allowed = {"script": Markup(script), "script_hash": _source_hash(script)}
    return page.get_template("page.html").render(c=content, **allowed).lstrip()


def _source_hash(script: str) -> str:
    """Return the hash by which a page's security policy allows this script and no other.

    Examples
    --------
    >>> _source_hash("")
    'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='
    """
    digest = hashlib.sha256(script.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def _unbroken(text: str) -> str:
    """Keep numbers and units on one line, in markup as in plain text."""
    whole = wording.unbroken(text)
    return Markup(whole) if isinstance(text, Markup) else whole
