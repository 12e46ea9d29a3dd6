"""How large is the package, which modules have one importer, how many does a study run?

modules, lines, code_lines   of both packages, cameras included; code: neither blank, comment nor
                             docstring
one_importer                 modules that a single other one imports, by that one; less those which
                             are found without an import: a cause, a kind of data, a figure, a
                             geometry, a command, a program, a home of names of ``bayesdeg`` itself
executed                     modules of which functions run: as a study is read and becomes a model,
                             and as vectors of parameters become log densities, and curvatures
is_none                      lines with ``is None`` or ``is not None``
private_used_once            private functions and methods with one use
own_map_files                files that ask whether a study has a forward map of its own
classes_named_alike          public classes of one name
public_names                 of ``bayesdeg`` itself
readme_bytes                 of README.md
test_lines                   of all tests
pinned_sentences             checks in tests in which a sentence stands
words                        of pages written by hand: README, contributing, changelog, docs; of
                             validation and changelog by themselves
longest                      words of the longest paragraph and of the largest table cell, with page

    uv run python benchmarks/structure.py
"""

import ast
import inspect
import io
import json
import re
import runpy
import sys
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import FrameType

import numpy as np

import bayesdeg
from bayesdeg.actuator.families import GEOMETRIES
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.commands.interface import COMMANDS
from bayesdeg.observations.curvature import Curvature

ROOT = Path(__file__).resolve().parents[1]
VECTORS = 64  # of parameters, drawn from the priors
#: Of packages that are searched: what a module has that is found there.
MARKS = {
    "bayesdeg.causes": {"CAUSE"},
    "bayesdeg.observations": {"from_study", "from_observations", "TABLE"},
    "bayesdeg.pages.figures": {"FIGURES"},
}
OWN_MAP = re.compile(r"\bis_own\b|\bis_of_actuators\b|settings\.forward\b|\buser_map\(")
NO_CODE = ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")

SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text(encoding="utf-8")
    for package in ("bayesdeg", "bayesdeg_camera")
    for path in sorted((ROOT / package).rglob("*.py"))
}
TREES = {name: ast.parse(source) for name, source in SOURCES.items()}


def code_lines(name: str) -> int:
    """Count the lines of a module on which there is code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(SOURCES[name]).readline):
        if tokenize.tok_name[token.type] not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(TREES[name]):  # a text that is a statement
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def imported(tree: ast.Module) -> Iterator[str]:
    """Yield what a module imports, also by its whole name in a text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def found_without_import() -> set[str]:
    """Return the modules that somebody finds who does not name them."""
    found = {f"bayesdeg.commands.{command.name}" for command in COMMANDS}
    found |= {entry.module for entry in entry_points(group="bayesdeg.camera")}
    found |= {made.__module__ for made in GEOMETRIES.values()}
    stub = ast.parse((ROOT / "bayesdeg/__init__.pyi").read_text(encoding="utf-8"))
    found |= {f"bayesdeg.{n.module}" for n in stub.body if isinstance(n, ast.ImportFrom)}
    for name, tree in TREES.items():
        marks = MARKS.get(name.rpartition(".")[0], set())
        for node in tree.body:
            is_program = isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)
            defines = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
            if is_program or marks & (defines | {getattr(node, "name", "")}):
                found.add(name)
    return found


def one_importer() -> dict[str, str]:
    """Return the modules that a single other one imports, each with that one."""
    importers = [(name, by) for by, tree in TREES.items() for name in set(imported(tree)) - {by}]
    counts, found = Counter(name for name, _ in importers), found_without_import()
    modules = {name for name in SOURCES if not name.endswith("__init__")} - found
    return {name: by for name, by in sorted(importers) if name in modules and counts[name] == 1}


def executed[T](call: Callable[[], T]) -> tuple[int, T]:
    """Return of how many modules functions ran in a call, and what it returned."""
    files: set[str] = set()

    def look(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:  # a function
            files.add(frame.f_code.co_filename)

    sys.setprofile(look)
    try:
        found = call()
    finally:
        sys.setprofile(None)
    return sum(Path(file).is_relative_to(ROOT / "bayesdeg") for file in files), found


def modules_run_by_a_study() -> dict[str, int]:
    """Return of how many modules functions run in each step of a study."""
    read, study = executed(lambda: read_study(ROOT / "studies/gelatin_actuator"))
    assembled, assembly = executed(lambda: assemble(study))
    model = assembly.model
    vectors = model.table.sample(np.random.default_rng(0), VECTORS)
    density, _ = executed(lambda: model.log_prob(vectors))
    (kind,) = model.of_kind(Curvature)
    curvature, _ = executed(lambda: kind.expected(model.state(model.table.named(vectors))))
    return {"read": read, "assemble": assembled, "log_prob": density, "curvature": curvature}


def pages() -> dict[str, str]:
    """Return the pages that are written by hand, by their paths."""
    found = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    found += sorted((ROOT / "docs").rglob("*.md"))
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in found
        if not {"generated", "_build"} & set(path.parts)
    }


def paragraphs(page: str) -> Iterator[str]:
    """Yield paragraphs and list items of a page, without code, formulas, tables and headings."""
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "\n\n", page, flags=re.DOTALL)
    text = re.sub(r"^(\||#).*$", "", text, flags=re.MULTILINE)
    yield from re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.) ", text)


def cells(page: str) -> Iterator[str]:
    """Yield the cells of the tables of a page."""
    for line in re.findall(r"^\|(.*)\|$", page, flags=re.MULTILINE):
        yield from re.split(r"(?<!\\)\|", line)


def measured_pages() -> dict[str, object]:
    """Return how many words pages have, and where the longest paragraph and cell stand."""
    texts = pages()
    words = {name: len(text.split()) for name, text in texts.items()}

    def longest(parts: Callable[[str], Iterator[str]]) -> tuple[int, str]:
        return max((len(one.split()), n) for n, text in texts.items() for one in parts(text))

    return {
        "words": {
            "all": sum(words.values()),
            "validation": words["docs/validation.md"],
            "changelog": words["CHANGELOG.md"],
        },
        "longest": {"paragraph": longest(paragraphs), "cell": longest(cells)},
    }


def private_used_once(module: str) -> int:
    """Return how many functions of a module alone have a single use."""
    defined = [node.name for node in ast.walk(TREES[module]) if isinstance(node, ast.FunctionDef)]
    named = Counter(re.findall(r"\b_\w+", SOURCES[module]))
    return sum(named[name] == 2 for name in defined if not name.endswith("__"))


def measured() -> dict[str, object]:
    nodes = [node for tree in TREES.values() for node in ast.walk(tree)]
    classes = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    rules = runpy.run_path(str(ROOT / "tests/test_architecture.py"))
    tests = [ast.parse(path.read_text(encoding="utf-8")) for path in rules["TESTS"]]
    return {
        "modules": len(SOURCES),
        "lines": sum(source.count("\n") for source in SOURCES.values()),
        "code_lines": sum(map(code_lines, SOURCES)),
        "one_importer": one_importer(),
        "executed": modules_run_by_a_study(),
        "is_none": sum(
            bool(re.search(r"\bis (not )?None\b", line))
            for source in SOURCES.values()
            for line in source.splitlines()
        ),
        "private_used_once": sum(map(private_used_once, SOURCES)),
        "own_map_files": sorted(name for name, s in SOURCES.items() if OWN_MAP.search(s)),
        "classes_named_alike": [n for n, k in classes.items() if k > 1 and n[0] != "_"],
        "public_names": len(dir(bayesdeg)),
        "readme_bytes": (ROOT / "README.md").stat().st_size,
        "test_lines": sum(path.read_text(encoding="utf-8").count("\n") for path in rules["TESTS"]),
        "pinned_sentences": sum(len(list(rules["pins"](tree))) for tree in tests),
        **measured_pages(),
    }


if __name__ == "__main__":
    print(json.dumps(measured(), indent=1))
