"""Build one self-contained HTML page from a run folder, without recomputing anything."""

import base64
import hashlib
import importlib
import pkgutil
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup

from bayesdeg.pages import figures, wording
from bayesdeg.pages.drawing import PageFigure, Shown
from bayesdeg.pages.folder import RUN, VERDICT, RunFolder
from bayesdeg.pages.headline import doubts_of, headline_of, sets_of
from bayesdeg.pages.left_out import FIGURE, Guard, OptionalStage, figure_stage
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.summaries import (
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
    return run_folder.write_page(render(shown, guard or Guard()))


def _content(shown: Shown, guard: Guard) -> Mapping[str, object]:
    """Arrange what a run found for the template."""
    verdict, run, tables = shown.verdict, shown.run, shown.tables
    drawn = (
        guard.attempt(figure_stage(name), figure.drawing, shown) for name, figure in FIGURES.items()
    )
    drawings = {drawing.name: drawing for drawing in drawn if drawing is not None}
    updated, as_before = "", frozenset[str]()
    if run.update is not None:
        updated = wording.sentences("run", "updated", update=run.update, degrades=run.degrades)
        # files that the new readings could have changed
        unchanged = {TABLES[name].file for name in NOT_OF_ACTUATORS}
        as_before = frozenset(run.update.as_before) - unchanged
    return {
        "verdict": verdict,
        "run": run,
        "headline": headline_of(verdict, tables["gain"]),
        "drawings": drawings,
        "judged": [entry for entry in verdict.candidates if entry.probability is not None],
        "not_judged": [entry for entry in verdict.candidates if entry.probability is None],
        "levels": level_rows(tables["levels"]),
        "gain": rows_of(pooled(tables["gain"])),
        "gain_by_level": rows_of(several_levels(tables["gain"])),
        "extended": extended_model(tables["gain"], verdict),
        "parameters": parameter_rows(tables["parameters"]),
        "tensile": tensile_errors(tables["tensile"]),
        "measured": rows_of(tables["measured"]),
        "leave_one_out": rows_of(tables["leave_one_out"]),
        "sensitivity": rows_of(tables["prior_sensitivity"]),
        "absorption": farthest_first(tables["absorption"]),
        "orders": rows_of(tables["orders"]),
        "laws": rows_of(tables["material_laws"]),
        "gain_levels": rows_of(pooled(tables["gain_levels"])),
        "gain_modes": sorted(rows_of(tables["gain_modes"]), key=lambda row: str(row["mode"])),
        "decisions": decision_pairs(tables["decisions"]),
        "missing_terms": rows_of(tables["missing_terms"]),
        "sets": rows_of(tables["sets"]),
        "supported": sets_of(verdict),
        "criteria": by_criterion(tables["criteria"]),
        "criteria_influence": influence_of_criteria(tables["criteria"], degrades=run.degrades),
        "lookalikes": lookalikes(verdict),
        "sized": [c for c in map(verdict.candidate, verdict.causes) if c is not None and c.effect],
        "meanings": defaultdict(str, meanings_of(tables["parameters"])),
        "gain_parts": gain_parts(tables["gain"], verdict),
        "files": (*tables.files, f"{VERDICT}.json", f"{RUN}.json"),
        "left_out": _left_out(verdict, guard),
        "doubts": doubts_of(verdict),
        "updated": updated,
        "before_update": as_before,
    }


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


def render(shown: Shown, guard: Guard | None = None) -> str:
    """Return the page; without a guard, a figure that fails raises."""
    names = [candidate.cause for candidate in shown.verdict.candidates]
    page = environment(autoescape=True)
    page.filters |= {
        "unbroken": _unbroken,
        "plain": lambda text: wording.plain(text, names),
        "drawing": lambda drawing: Markup(drawing.svg),
    }
    assert page.loader is not None
    script = page.loader.get_source(page, "page.js")[0]
    # the page's security policy allows the script with this hash and no other
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = {"script": Markup(script), "script_hash": f"sha256-{digest}"}
    content = _content(shown, guard or Guard(strict=True))
    return page.get_template("page.html").render(c=content, **allowed).lstrip()


def _unbroken(text: str) -> str:
    """Keep numbers and units on one line, in markup as in plain text."""
    whole = wording.unbroken(text)
    return Markup(whole) if isinstance(text, Markup) else whole
