"""The house rules that no type checker sees."""

import ast
import importlib
import re
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).resolve().parents[1]
PACKAGE, CAMERA = ROOT / "bayesdeg", ROOT / "bayesdeg_camera"
MODULES = sorted([*PACKAGE.rglob("*.py"), *CAMERA.rglob("*.py")])
TESTS = sorted((ROOT / "tests").rglob("*.py"))
SENTENCE = 4  # words of a literal from which it is one
MOST_PINNED = 20  # checks in tests that pin sentences; rendered templates are compared with a file
WORD = re.compile(r"(?<![\w.\[/])[^\W\d_]+(?:['’-][^\W\d_]+)*(?![\w(\]/])")

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
    "importlinter"
]


def place(path):
    return path.relative_to(PACKAGE if path.is_relative_to(PACKAGE) else ROOT).as_posix()


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def offences(find):
    """Run a search over all modules; keep those where it finds."""
    found = {place(path): find(tree_of(path)) for path in MODULES}
    return {name: what for name, what in found.items() if what}


def imports_of(*packages):
    """Return a search for imports of these packages: the lines on which they stand."""

    def find(tree):
        lines = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            else:
                continue
            lines += [node.lineno for name in names if name.split(".")[0] in packages]
        return lines

    return find


def functions_of(tree):
    return [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]


def attributes_of(tree, *owners):
    """Attributes of names such as ``np`` or ``np.random``."""
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in owners
    ]


# ---- rule 1: imports


def test_the_layers_are_kept(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    status = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    printed = capsys.readouterr().out
    assert status == EXIT_STATUS_SUCCESS, printed
    assert "0 broken" in printed


def test_no_contract_has_an_exception():
    assert not any(contract.get("ignore_imports") for contract in CONTRACTS["contracts"])
    assert CONTRACTS["root_packages"] == [PACKAGE.name, CAMERA.name]
    cameras = CONTRACTS["contracts"][1]
    assert cameras["source_modules"] == [PACKAGE.name]
    assert set(cameras["forbidden_modules"]) == {CAMERA.name, "cv2", "roifile", "ezc3d"}


def test_no_module_declares_names_to_type_checkers_alone():
    def find(tree):
        return [node.lineno for node in ast.walk(tree) if ast.unparse(node) == "TYPE_CHECKING"]

    assert not offences(find)


def test_every_package_has_its_layer():
    there = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" and p.stem != "__init__"}
    there |= {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").exists()}
    layers = CONTRACTS["contracts"][0]["layers"]
    assert {f"{PACKAGE.name}.{name}" for name in there} == set(layers)


def test_names_are_imported_from_modules_and_not_from_packages():
    def find(tree):
        return [
            f"line {node.lineno}: {alias.name} from {node.module}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
            if node.level > 0
            or (
                (node.module or "").split(".")[0] in (PACKAGE.name, CAMERA.name)
                and (folder := ROOT.joinpath(*(node.module or "").split("."))).is_dir()
                and not (folder / f"{alias.name}.py").exists()
                and not (folder / alias.name / "__init__.py").exists()
            )
        ]

    assert not offences(find)


def test_no_import_stands_inside_a_function():
    def find(tree):
        return [
            node.lineno
            for function in functions_of(tree)
            for node in ast.walk(function)
            if isinstance(node, ast.Import | ast.ImportFrom)
        ]

    assert not offences(find)


# ---- rule 5: places


def test_matplotlib_is_used_for_figures_alone():
    using = set(offences(imports_of("matplotlib")))
    assert using
    assert using <= {"pages/drawing.py", *map(place, PACKAGE.glob("pages/figures/*.py"))}


def test_emcee_is_used_in_one_place():
    assert set(offences(imports_of("emcee"))) == {"inference/sampling.py"}


def test_files_are_read_and_written_in_few_places():
    """Reading a study, a store of solutions, runs and their reports, the command line."""

    def find(tree):
        opened = [
            node.lineno
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "open"
        ]
        return opened + imports_of("pathlib", "os", "shutil", "tempfile")(tree)

    places = {
        "data/study.py",
        "data/part.py",  # the mesh beside a study
        "actuator/linear.py",  # where a library is
        "surrogate/campaign.py",
        "surrogate/design.py",
        "surrogate/kept.py",
        "surrogate/solutions.py",
        "surrogate/trained.py",
        "surrogate/workers.py",
        "api.py",  # the door: studies and reports are where the user says
        "results.py",
        "training.py",  # trained emulators are kept
        "files.py",
        "assembly/assemble.py",  # code of a study
        "assembly/reading.py",
        "prediction/stored.py",
        "limited.py",  # the environment of another process
        "__main__.py",  # a signal may end it
        "cli.py",
        "__init__.py",  # a setting of the compiler
    }
    folders = ("pages/", "run/", "commands/", "bayesdeg_camera/")
    using = {name for name in offences(find) if not name.startswith(folders)}
    assert using <= places


# ---- rule 6: randomness


def test_randomness_comes_from_a_generator_that_was_passed():
    """Nothing draws from a global state; emcee alone is given the old kind of generator."""
    new = {"Generator", "SeedSequence", "default_rng"}

    def find(tree):
        return [
            f"line {node.lineno}: np.random.{node.attr}"
            for node in attributes_of(tree, "np.random", "numpy.random")
            if node.attr not in new
        ]

    found = offences(find)
    old = [word.split(".")[-1] for word in found.pop("inference/sampling.py", [])]
    assert not found
    assert set(old) <= {"RandomState", "MT19937"}
    assert not offences(imports_of("random"))


def test_no_generator_is_made_without_a_seed():
    def find(tree):
        return [
            node.lineno
            for node in ast.walk(tree)
            if isinstance(node, ast.Call)
            and ast.unparse(node.func).split(".")[-1] in ("default_rng", "SeedSequence")
            and not (node.args or node.keywords)
        ]

    assert not offences(find)


# ---- rule 8: no pickle


def test_nothing_is_pickled():
    packages = (
        "pickle",
        "cPickle",
        "_pickle",
        "dill",
        "joblib",
        "cloudpickle",
        "shelve",
        "marshal",
    )
    assert not offences(imports_of(*packages))

    def find(tree):
        allowed = [
            node.value.lineno
            for node in ast.walk(tree)
            if isinstance(node, ast.keyword)
            and node.arg == "allow_pickle"
            and not (isinstance(node.value, ast.Constant) and node.value.value is False)
        ]
        named = [
            node.lineno
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and node.attr in ("read_pickle", "to_pickle")
        ]
        return allowed + named

    assert not offences(find)


def test_arrays_are_read_with_pickling_refused_in_so_many_words():
    calls = []

    def find(tree):
        loads = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.load", "numpy.load")
        ]
        calls.extend(loads)
        return [n.lineno for n in loads if "allow_pickle" not in [k.arg for k in n.keywords]]

    assert not offences(find)
    assert calls


# ---- rule 10: sentences are asserted once, as a rendered template


def literals(tree):
    """Texts in a tree, those that are filled in as a whole."""
    inside = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part for part in node.values if isinstance(part, ast.Constant)]
            inside.update(parts)
            yield " 0 ".join(str(part.value) for part in parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in inside:
            yield node.value


def pins(tree):
    """Lines of assertions, matches and parameters of tests in which a sentence stands."""
    for node in ast.walk(tree):
        checked = []
        if isinstance(node, ast.Assert):
            checked = [node.test]
        elif isinstance(node, ast.Call):
            checked = [keyword.value for keyword in node.keywords if keyword.arg == "match"]
            if ast.unparse(node.func).endswith("parametrize"):
                checked += node.args
        if any(len(WORD.findall(text)) >= SENTENCE for one in checked for text in literals(one)):
            yield node.lineno


def test_tests_pin_few_sentences():
    found = {
        str(path.relative_to(ROOT)): lines
        for path in TESTS
        if (lines := list(pins(ast.parse(path.read_text(encoding="utf-8")))))
    }
    assert sum(map(len, found.values())) <= MOST_PINNED, found


# ---- what makes the above worth something


def test_every_module_can_be_imported_and_says_what_it_is():
    for path in MODULES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = importlib.import_module(".".join(p for p in parts if p != "__init__"))
        assert module.__doc__, place(path)


def test_every_class_has_a_name_of_its_own():
    """One that is private to its module may have any."""
    found = Counter(
        node.name
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert [name for name, count in found.items() if count > 1] == []


SCRIPTS = sorted(
    path
    for folder in ("benchmarks", "studies", "docs")
    for path in (ROOT / folder).rglob("*.py")
    if "_build" not in path.parts
)


def names_asked_for(tree):
    """Modules and names of the package that a script imports, but for those that it may lack."""
    tried = {
        child
        for node in ast.walk(tree)
        if isinstance(node, ast.Try)
        for handler in node.handlers
        for child in ast.walk(handler)
    }
    for node in ast.walk(tree):
        own = isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE.name)
        if own and node not in tried:
            yield from ((node.module, alias.name) for alias in node.names)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_scripts_import_is_there(path):
    """Benchmarks and studies are run seldom: a name that moved would not be missed for weeks."""
    for module, name in names_asked_for(tree_of(path)):
        found = importlib.import_module(module)
        if not hasattr(found, name):
            importlib.import_module(f"{module}.{name}")


def test_names_of_test_files_are_unique():
    names = [p.name for p in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_the_searches_find_what_they_look_for():
    source = """
import os.path
from emcee.moves import DEMove
def f():
    '''Text
    of three
    lines.'''
    import pickle
    return np.random.normal()
"""
    tree = ast.parse(source)
    assert imports_of("emcee")(tree) == [3]
    assert imports_of("os", "pickle")(tree) == [2, 8]
    assert [n.attr for n in attributes_of(tree, "np.random")] == ["normal"]


def test_pinned_sentences_are_found_wherever_they_stand():
    said = "it is not so"
    source = f"""
assert "{said}" in text
assert f"{{name}} {said}" == text
assert "a.csv, row 5" in text, "{said}"
@pytest.mark.parametrize("words", ["{said}"])
def test(words):
    with pytest.raises(ValueError, match="{said}"):
        pass
"""
    assert sorted(pins(ast.parse(source))) == [2, 3, 5, 7]
