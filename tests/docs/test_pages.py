"""What the documentation says must be so; that it builds without warnings is `.ci/docs`."""

import doctest
import json
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.commands.interface import COMMANDS
from bayesdeg.data.settings import parse_settings
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.pages.tables import TABLES as RUN_TABLES

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if not {"generated", "_build"} & set(page.parts))
REPORTS = [ROOT / "reports" / name for name in ("gelatin_actuator", "treloar")]


@pytest.fixture(scope="module")
def generate():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS))
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        import generate  # noqa: PLC0415

        yield generate


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_the_examples_with_inner_modules_run(monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    tried = 0
    for block in blocks(DOCS / "howto" / "use-the-modules.md", "python"):
        example = doctest.DocTestParser().get_doctest(block, names, "page", "page", 0)
        runner = doctest.DocTestRunner()
        runner.run(example, clear_globs=False)
        names = example.globs
        assert runner.failures == 0
        tried += runner.tries
    assert tried == 15


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_is_shown_of_study_files_is_understood(page):
    for text in blocks(page, "toml"):
        assert tomllib.loads(text)
        assert not parse_settings(text.encode())[1]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_that_are_shown_exist(page):
    shown = set(re.findall(r"^(?:uv run )?bayesdeg (\w+)", "\n".join(blocks(page, "sh")), re.M))
    assert shown <= {command.name for command in COMMANDS}


def test_the_limits_name_every_cause():
    text = (DOCS / "limits.md").read_text(encoding="utf-8")
    count, names = re.findall(r"\*\*The catalogue\*\* holds (\d+) causes: (.*?)\. ", text)[0]
    assert int(count) == len(CATALOGUE)
    assert set(re.findall(r"`(\w+)`", names)) == set(CATALOGUE)


def test_the_reference_has_every_column_key_option_and_priors(generate):
    pages = generate.reference_pages()
    for table in TABLES.values():
        assert all(f"| `{c}` |" in pages["reference/study_files.md"] for c in table.columns)
    for name, table in RUN_TABLES.items():
        section = pages["reference/run_folder.md"].split(f"## {name}.csv\n")[1].split("\n## ")[0]
        assert all(f"| `{column.name}` |" in section for column in table.columns)
    settings = pages["reference/study_toml.md"]
    assert {"`chamber_wall` | `1.5`", "`order` | `2`", '`effort` | `"standard"`'} <= set(
        re.findall(r"`\w+` \| `[^`]+`", settings)
    )
    for command in COMMANDS:
        assert f"## `bayesdeg {command.name}`" in pages["reference/commands.md"]
    assert "`--risk PROBABILITY` | `0.05`" in pages["reference/commands.md"]
    assert "`pressure_offset.offset`" in pages["reference/parameters.md"]


def test_keys_of_a_verdict_have_a_meaning_or_the_build_fails(generate, monkeypatch, tmp_path):
    folder = tmp_path / "one"
    folder.mkdir()
    (folder / "verdict.json").write_text(json.dumps({"outcome": "named", "colour": 1}))
    monkeypatch.setattr(generate, "REPORTS", [folder])
    with pytest.raises(ValueError, match="colour"):
        generate.reference_pages()


def test_the_signature_of_a_cause_is_what_it_does_to_the_readings(generate):
    facts = generate.facts
    (kept,) = (p for p in facts.causes() if p.cause.name == "pressure_offset")
    assert set(kept.sections) >= {"Mechanism", "Equation", "Source"}
    readings = facts.signature("pressure_offset")["actuator"].set_index(["specimen_id", "row"])
    fresh = readings.loc["fresh"]
    # what is read at p with 14 kPa lost is what would be read at p − 14 kPa
    slope = (fresh["curvature_per_m"][10] - fresh["curvature_per_m"][8]) / 20.0
    assert fresh["change"][9] == pytest.approx(-14.0 * slope, rel=0.05)
    assert (facts.signature("stress_measure")["actuator"]["change"].abs().max()) == 0.0
    assert facts.signature("stress_measure")["tensile"]["change"].abs().max() > 1.0


def test_a_page_of_the_gallery_shows_what_the_script_prints(generate, tmp_path, monkeypatch):
    script = tmp_path / "sum.py"
    script.write_text('"""A sum.\n\nOf\nnumbers.\n"""\n\nprint(20 + 22)\n')
    monkeypatch.setattr(generate, "GALLERY", tmp_path)
    monkeypatch.setattr(generate, "KEPT", tmp_path / "kept")
    page = generate.gallery_pages()["gallery/sum.md"]
    assert page.startswith("# A sum\n\nOf numbers.\n")
    assert "```text\n42\n```" in page
    script.write_text('"""A sum."""\n\nprint(1 / 0)\n')
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        generate.gallery_pages()


def test_the_gallery_is_of_short_scripts():
    scripts = sorted((ROOT / "examples").glob("*.py"))
    assert len(scripts) >= 6
    for script in scripts:
        assert len(script.read_text(encoding="utf-8").splitlines()) <= 80, script


@pytest.mark.parametrize("folder", REPORTS, ids=lambda folder: folder.name)
def test_published_reports_are_small_whole_and_say_their_commit(folder):
    """As they are committed: a run of the same study may have replaced them since."""
    files = set(_git("ls-files", "--", str(folder)).splitlines())
    page = _git("show", f":{folder.relative_to(ROOT)}/index.html")
    assert len(page.encode()) <= 1_250_000
    assert re.search(r"commit [0-9a-f]{8} ", page)
    linked = set(re.findall(r'href="([\w.]+\.(?:csv|json))"', page))
    assert linked
    assert {f"{folder.relative_to(ROOT)}/{name}" for name in linked} <= files


def test_nothing_else_of_reports_is_committed():
    folders = {line.split("/")[1] for line in _git("ls-files", "reports").splitlines()}
    assert folders == {folder.name for folder in REPORTS}
    assert (DOCS / "_static" / "report.png").stat().st_size <= 200_000


def _git(*words):
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


def test_modules_that_pages_name_are_there():
    """In backticks; by whole paths, by paths in the package, or by their names alone."""
    tracked = subprocess.run(
        ["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    files = [f"/{line}" for line in tracked.stdout.splitlines()]
    invented = {"model.py", "study.py"}  # files of a reader's own
    pages = [ROOT / "CONTRIBUTING.md", ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    lost = {
        f"{page.name}: {name}"
        for page in pages
        if not {"_build", "generated"} & set(page.parts)
        for name in re.findall(r"`([\w/]+\.py)`", page.read_text(encoding="utf-8"))
        if name not in invented and not any(file.endswith(f"/{name}") for file in files)
    }
    assert not lost
