"""The pages that are made of the running package, of recorded runs and of the gallery's scripts.

What the package says of itself comes from `package_facts`; nothing else of it is imported here.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import package_facts as facts
import publish_reports
import signatures

ROOT = facts.ROOT
HERE = ROOT / "docs"
GALLERY = ROOT / "examples"
REPORTS = [publish_reports.TARGET / name for name in publish_reports.STUDIES]
BENCHMARKS = ROOT / "benchmarks"
WIDEST = 88  # characters of what a script prints
KEPT = ROOT / ".cache" / "gallery"
LONGEST_SCRIPT_S = 600.0  # each takes half a minute of computing at most


def write_all(target: Path) -> None:
    """Write every generated page; what another build wrote is removed."""
    shutil.rmtree(target, ignore_errors=True)
    pages = {
        **reference_pages(),
        **cause_pages(target / "causes"),
        **validation_pages(target / "validation"),
        **gallery_pages(),
    }
    for name, text in pages.items():
        file = target / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


def table(heads: tuple[str, ...], rows) -> str:
    """Return a table in Markdown; bars, and what would be taken for a tag, are escaped."""
    lines = [heads, tuple("---" for _ in heads), *rows]
    escaped = (" | ".join(_cell(str(cell)) for cell in line) for line in lines)
    return "\n".join(f"| {line} |" for line in escaped) + "\n"


def _cell(text: str) -> str:
    words = re.split(r"(`[^`]*`)", text)
    plain = [part if part.startswith("`") else part.replace("<", "&lt;") for part in words]
    return "".join(plain).replace("|", "\\|")


def code(text: str) -> str:
    """Return text as code; nothing for nothing."""
    return f"`{text}`" if text else ""


def toctree(names, depth: int = 1) -> str:
    """Return a tree of contents."""
    listed = "\n".join(names)
    return f"```{{toctree}}\n:maxdepth: {depth}\n\n{listed}\n```\n"


# --- reference -------------------------------------------------------------------------------


def reference_pages() -> dict[str, str]:
    """Return the pages of the reference by file name."""
    return {
        "reference/api.md": _api(),
        "reference/study_files.md": _study_files(),
        "reference/study_toml.md": _study_toml(),
        "reference/parameters.md": _parameters(),
        "reference/commands.md": _commands(),
        "reference/run_folder.md": _run_folder(),
        "reference/verdict.md": _verdict(),
    }


def _api() -> str:
    names = facts.public_names()
    parts = ["# Python\n\nWhat `import bayesdeg as bd` offers. Nothing else is public.\n"]
    for name in names:
        if facts.is_class(name):
            members = facts.members(name)
            directive = f".. autoclass:: bayesdeg.{name}" + (
                f"\n   :members: {members}" if members else ""
            )
        elif facts.is_callable(name):
            directive = f".. autofunction:: bayesdeg.{name}"
        else:
            continue
        parts.append(f"## `{name}`\n\n```{{eval-rst}}\n{directive}\n```\n")
    return "\n".join(parts)


def _study_files() -> str:
    rules = facts.rules_of_studies()
    parts = ["# Data files of a study\n", _STUDY_FILES]
    for file, columns in facts.columns_of_studies().items():
        rows = [
            (
                code(c.name),
                c.unit,
                "yes" if c.required else "no",
                code(c.default),
                c.meaning,
                c.accepts,
            )
            for c in columns
        ]
        heads = ("column", "unit", "required", "default", "meaning", "holds")
        parts.append(f"## {file}\n\n{table(heads, rows)}")
        if rules[file]:
            listed = "\n".join(f"- {rule}" for rule in rules[file])
            parts.append(f"A fault of rows together:\n\n{listed}\n")
    return "\n".join(parts)


_STUDY_FILES = """\
CSV is UTF-8, comma separated, with `.` as decimal point. The first line is the header, lines that
begin with `#` are comments, an empty cell means "not recorded". Further columns are kept. Stretch
is a ratio (1 is undeformed), percentages are in percent (25, not 0.25), pressures are gauge
pressures. The degradation rate D_R is the relative loss of moisture content on the wet basis: a
proxy, not a loss of mass. At least one of these files must be there.

`curvature_per_m` is the mean curvature less that at zero pressure: the bend angle in radians over
the deformed arc length of the bottom line; positive bends towards the paper. It may be empty after
rupture. On the row at whose pressure a specimen burst `ruptured` is 1; later rows of that specimen
are not read. `mount` is `horizontal` (the bending plane is horizontal), `hanging` (clamped end up),
or `bending_up` and `bending_down` (cantilever in a vertical plane, bending against or with
gravity).
"""


def _study_toml() -> str:
    parts = [
        "# study.toml\n",
        "Every key has a default, and the file may be empty. An unknown key is an error that "
        "suggests the nearest known one. `bayesdeg init FOLDER` writes a file in which every key "
        "is explained.\n",
    ]
    entries = facts.keys_of_study_toml()
    for place in dict.fromkeys(entry.place for entry in entries):
        rows = [
            (code(e.name), code(e.default), e.accepts, e.meaning)
            for e in entries
            if e.place == place
        ]
        title = f"`[{place}]`" if place else "Above the first table"
        if place.startswith("actuator."):
            kind = place.removeprefix("actuator.")
            title = f'`[actuator]` with `kind = "{kind}"`'
        parts.append(f"## {title}\n\n{table(('key', 'default', 'wanted', 'meaning'), rows)}")
    parts.append(
        "## `[parameters]`\n\nUnknowns of [a forward map of one's own]"
        "(../../tutorial/own-forward-map.md#as-a-folder), each a prior law with a unit and a "
        "meaning:\n\n```toml\n[parameters]\n"
        'k = { law = "lognormal", median = 2.0, sigma = 1.0, unit = "mm/N", meaning = "of the '
        'spring" }\n```\n'
    )
    laws = [(code(law.name), code(law.accepts), law.meaning) for law in facts.laws_of_priors()]
    parts.append(
        "## `[priors]`\n\nThe prior of any parameter by its name "
        "([list](parameters.md)), those of causes as `cause.parameter`:\n\n"
        '```toml\n[priors]\nvolume_ratio = { law = "normal", mean = 0.62, sd = 0.07 }\n'
        '"pressure_offset.offset" = { law = "normal", mean = 0.0, sd = 5.0 }\n```\n\n'
        + table(("law", "arguments", "meaning"), laws)
    )
    return "\n".join(parts)


def _parameters() -> str:
    base = [
        (code(p.name), p.unit, code(p.default), p.meaning)
        for p in facts.parameters_of_the_base_model()
    ]
    of_causes = [
        (f"`{page.cause.name}.{p.name}`", p.unit, code(str(p.law)), p.meaning)
        for page in facts.causes()
        for p in page.cause.parameters
    ]
    heads = ("parameter", "unit", "prior", "meaning")
    return (
        "# Parameters and priors\n\n"
        "Each prior can be replaced in `study.toml`. Why the defaults are what they are: "
        "[priors](../../method/model.md#default-priors).\n\n"
        "## Of the base model\n\nAs in the study `gelatin_actuator`, which has every kind of "
        f"data but published R²; where data are absent, so are their parameters.\n\n"
        f"{table(heads, base)}\n"
        f"## Of the causes\n\n{table(heads, of_causes)}"
    )


def _commands() -> str:
    parts = ["# Commands\n", _COMMANDS]
    for command in facts.commands():
        usage = f"bayesdeg {command.name} {command.usage}"
        rows = [(code(o.name), code(o.default), o.meaning) for o in command.options]
        parts.append(
            f"## `bayesdeg {command.name}`\n\n```sh\n{usage}\n```\n\n{command.text}\n\n"
            f"{table(('argument or option', 'default', 'meaning'), rows)}"
        )
        if command.example:
            parts.append(f"{command.example}\n")
    return "\n".join(parts)


_COMMANDS = """\
`bayesdeg --help` lists the commands, `bayesdeg COMMAND --help` says the same as this page,
`bayesdeg --version` the version. Tab completes commands and options once
`bayesdeg --install-completion` has been run and a new shell opened.

Exit codes: 0 done; 1 a fault of ours, with a traceback to send us; 2 the input is at fault; 3
stopped, can be resumed. Progress and messages go to standard error; with `--json` and `--quiet`
nothing but the result goes to standard output.
"""


def _run_folder() -> str:
    parts = ["# Tables of a run folder\n", _RUN_FOLDER]
    for file, columns in facts.columns_of_runs().items():
        rows = [(code(c.name), c.unit, c.meaning) for c in columns]
        parts.append(f"## {file}\n\n{table(('column', 'unit', 'meaning'), rows)}")
    return "\n".join(parts)


_RUN_FOLDER = """\
What each file is for stands in [a run's files](../../howto/read-a-run-folder.md). An empty cell
means "not available"; a file may hold further columns.
"""


def _verdict() -> str:
    meanings = facts.keys_of_verdicts()
    _refuse_unknown(meanings)
    rows = [(code(key), meaning) for key, meaning in meanings.items()]
    return (
        "# verdict.json\n\n`[]` is each entry of a list, `*` any name. A number that is not "
        "available is null. How to read it: [reading a verdict]"
        "(../../tutorial/reading-a-verdict.md); by what tests: "
        f"[naming](../../method/naming.md).\n\n{table(('key', 'meaning'), rows)}"
    )


def _refuse_unknown(meanings: dict[str, str]) -> None:
    for file in [folder / "verdict.json" for folder in REPORTS]:
        there = set(_keys(json.loads(file.read_text(encoding="utf-8"))))
        unknown = sorted(key for key in there if key not in meanings and not _parent(key, meanings))
        if unknown:
            raise ValueError(f"{file}: no record of a verdict has {unknown}")


def _parent(key: str, meanings: dict[str, str]) -> bool:
    """Return whether a key only holds others that have a meaning."""
    return any(other.startswith(f"{key}.") for other in meanings)


#: Objects whose keys are names of something.
BY_NAME = (".effect", ".criteria")


def _keys(value, path: str = ""):
    if isinstance(value, list):
        for entry in value:
            yield from _keys(entry, f"{path}[]")
    elif isinstance(value, dict) and path.endswith(BY_NAME):
        for entry in value.values():
            yield from _keys(entry, f"{path}.*")
    elif isinstance(value, dict):
        for name, entry in value.items():
            key = f"{path}.{name}" if path else name
            yield key
            yield from _keys(entry, key)


# --- causes ----------------------------------------------------------------------------------


def cause_pages(figures: Path) -> dict[str, str]:
    """Return a page for each cause and their list; draw their signatures beside them."""
    figures.mkdir(parents=True, exist_ok=True)
    pages = {}
    for page in facts.causes():
        name = page.cause.name
        signatures.draw(page.cause, facts.signature(name), figures / f"{name}.svg")
        pages[f"causes/{name}.md"] = _cause(page)
    rows = [
        (
            f"[`{page.cause.name}`]({page.cause.name}.md)",
            page.cause.stage.name.lower(),
            page.cause.mechanism,
        )
        for page in facts.causes()
    ]
    pages["causes/index.md"] = (
        f"# Causes\n\nThe catalogue holds {len(rows)} causes; each page is made of the file that "
        "defines the cause. To add one: [how to](../../howto/add-a-cause.md).\n\n"
        + table(("cause", "acts on", "mechanism"), rows)
        + "\n```{toctree}\n:hidden:\n\n"
        + "\n".join(page.cause.name for page in facts.causes())
        + "\n```\n"
    )
    return pages


def _cause(page) -> str:
    cause = page.cause
    rows = [
        (
            f"`{cause.name}.{p.name}`",
            p.unit,
            code(str(p.law)),
            f"{cause.typical[p.name]:g}",
            p.meaning,
        )
        for p in cause.parameters
    ]
    sections = "\n\n".join(f"## {name}\n\n{text}" for name, text in page.sections.items())
    confused = ", ".join(f"[`{name}`]({name}.md)" for name in cause.confusable_with)
    needs = ", ".join(code(name) for name in cause.needs)
    return f"""\
# {cause.name}

{page.title}

{table(("parameter", "unit", "prior", "typical", "meaning"), rows)}
- **Revealed by** {cause.revealed_by}
- **Can be confused with** {confused or "nothing in the catalogue, by its signature in curvature"}
- **Needs columns** {needs or "none beyond the required ones"}

```{{figure}} {cause.name}.svg
:alt: signature of {cause.name}

{signatures.caption(cause)}
```

{sections}
"""


# --- validation ------------------------------------------------------------------------------


def validation_pages(figures: Path) -> dict[str, str]:
    """Return the page of recorded results in full; copy its figures beside it."""
    figures.mkdir(parents=True, exist_ok=True)
    for name in ("calibration.svg", "rupture.svg"):
        shutil.copy(BENCHMARKS / name, figures / name)
    parts = ["# Recorded results in full\n", _DETAILS]
    parts += [_published(folder) for folder in REPORTS]
    for name, title in HIDDEN.items():
        tables = facts.tables_of_hidden_effects(BENCHMARKS / f"{name}.jsonl")
        parts.append(f"\n## {title}\n\n{tables}\n")
    parts.append(
        f"## Methods compared\n\n{facts.tables_of_scored_methods(BENCHMARKS / 'scored')}\n"
    )
    parts.append(_FIGURES)
    return {"validation/details.md": "\n".join(parts)}


HIDDEN = {
    "hidden_effects": "Hidden effects",
    "hidden_by_physics": "Effects planted by separate physics",
    "other_actuators": "Effects in other actuators",
}
_DETAILS = """\
Tables of the files that [validation](../../validation.md) summarises, made when these pages are
built. A size in sd is the change of the readings in standard deviations of scatter and noise, after
all other parameters are fitted again.

## Published reports
"""
_FIGURES = """\
## Figures

```{figure} calibration.svg
:alt: ranks and coverage of simulation-based calibration

Simulation-based calibration, drawn by `benchmarks/calibration.py`.
```

```{figure} rupture.svg
:alt: predicted against observed rupture, and places of ruptures in their predicted laws

Rupture, drawn by `benchmarks/rupture.py --figure`. Error bars are over studies.
```
"""


def _published(folder: Path) -> str:
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    named = ", ".join(f"`{name}`" for name in verdict["causes"])
    effects = [
        f"{short} {size['mean']:.3g} {size['unit']} (90 % interval {size['q05']:.3g} to "
        f"{size['q95']:.3g})"
        for candidate in verdict["candidates"]
        if candidate["cause"] in verdict["causes"]
        for short, size in candidate["effect"].items()
    ]
    link = f'<a href="../../reports/{folder.name}/index.html">{run["title"]}</a>'
    virtual = "virtual experiment; " if run["virtual"] else ""
    return f"- {link}: {virtual}`{verdict['outcome']}` {named}, {'; '.join(effects)}"


# --- gallery ---------------------------------------------------------------------------------


def gallery_pages() -> dict[str, str]:
    """Run every script of the gallery and return a page for each, with what it printed."""
    scripts = sorted(GALLERY.glob("*.py"))
    with ThreadPoolExecutor(2) as pool:
        printed = dict(zip(scripts, pool.map(output_of, scripts), strict=True))
    pages = {f"gallery/{script.stem}.md": _shown(script, printed[script]) for script in scripts}
    rows = [(f"[{_title(s)}]({s.stem}.md)", code(f"examples/{s.name}")) for s in scripts]
    listed = "\n".join(script.stem for script in scripts)
    pages["gallery/index.md"] = (
        "# Gallery\n\nShort scripts; each is run when these pages are built, and its page shows "
        "what it printed. Run one with `uv run python examples/NAME.py`.\n\n"
        + table(("what", "script"), rows)
        + f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
    )
    return pages


def output_of(script: Path) -> str:
    """Return what a script prints: kept from a build with the same script, package and studies."""
    kept = KEPT / f"{script.stem}-{facts.fingerprint(script)}.txt"
    if not kept.exists():
        printed = run_script(script)
        KEPT.mkdir(parents=True, exist_ok=True)
        kept.write_text(printed, encoding="utf-8")
    return kept.read_text(encoding="utf-8")


def run_script(script: Path) -> str:
    """Run a script of the gallery; return what it prints.

    Raises
    ------
    RuntimeError
        If it fails or takes too long.
    """
    # one thread of linear algebra: two scripts run side by side
    environment = os.environ | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LONGEST_SCRIPT_S,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"{script.name} failed:\n{done.stderr[-3000:]}")
    return done.stdout


def _title(script: Path) -> str:
    first = script.read_text(encoding="utf-8").split('"""')[1].strip().split("\n")[0]
    return first.rstrip(".")


def _shown(script: Path, printed: str) -> str:
    text = script.read_text(encoding="utf-8")
    _, words, rest = text.split('"""', 2)
    paragraphs = re.sub(r"\n(?=\S)", " ", words.strip().partition("\n")[2]).strip()
    return (
        f"# {_title(script)}\n\n{paragraphs}\n\n```python\n{rest.strip()}\n```\n\n"
        f"It prints\n\n```text\n{_wrapped(printed.strip())}\n```\n"
    )


def _wrapped(printed: str) -> str:
    """Return text with its paragraphs broken into lines; tables stay as they are."""
    return "\n".join(
        line if "  " in line else textwrap.fill(line, WIDEST) for line in printed.split("\n")
    )
